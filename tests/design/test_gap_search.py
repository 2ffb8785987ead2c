"""The search for a gap: on landscapes that are known, by the scaling law, and in how many sweeps; and the study that puts it to the test."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from impact_env import Beam, ParameterError, modal_model
from impact_env.curve import performance_curve
from impact_env.scene import Scene
from impact_env.structures.matrices import lowest_modes
from optimisation.bounds import reach
from optimisation.friction_rule import scaled_friction
from optimisation.gap_advice import PAIRS, STEP, Advice, Table, advise, answers, bracket, search, worst
from optimisation.gap_check import scaled_absorber
from studies.cli import check_gaps
from studies.drawn import CASES as DRAWN
from studies.gaps import CASES, assembled, frame, hermite, judged, plate, storeys

MODEL = modal_model(Beam(modes=3))


def cliff(best: float, drop: float = 1.6) -> object:
    """Return a landscape over ln gap: in proportion to the gap above ``best``, ``drop`` times as high just below, rising slowly further down."""

    def level(x: float) -> float:
        return math.exp(x) if x >= best else drop * math.exp(best) * math.exp(0.7 * (best - x))

    return level


@pytest.mark.parametrize("seed", range(8))
def test_search_finds_the_edge_of_a_noisy_cliff(seed: int) -> None:
    generator = np.random.default_rng(seed)
    edge = generator.uniform(-0.9, 0.9)
    level = cliff(edge)
    runs = 0
    kept: dict[float, np.ndarray] = {}

    def look(n: float, members: int) -> np.ndarray:
        nonlocal runs
        if n not in kept:
            kept[n] = level(STEP * n) * np.exp(generator.normal(0, 0.02, 3))
        runs += members - len(table.levels.get(n, ()))
        return kept[n][:members]

    table = Table()
    search(look, 0, 0.1, 3, PAIRS, table)
    sharp, robust = answers(table, 0.1, 2)
    fine = np.arange(edge - 0.5, edge + 0.5, 0.002)
    exact = [max(k * level(x - math.log(k)) for k in (0.9, 1.0, 1.1)) for x in fine]
    own = max(k * level(STEP * robust - math.log(k)) for k in (0.9, 1.0, 1.1))
    assert level(STEP * sharp) <= 1.17 * math.exp(edge)  # three steps of 5 % at most, off the edge
    assert own <= 1.17 * min(exact)
    assert runs <= PAIRS


def test_bracket_ends_beside_the_lowest_and_at_the_ends() -> None:
    for best in (-40, -11, 0, 3, 40):
        seen = bracket(lambda n, best=best: abs(n - best) + 1.0, 0)
        assert abs(min(seen, key=lambda n: seen[n]) - np.clip(best, -32, 32)) <= 1
        assert len(seen) <= 12


def test_a_tolerance_is_that_of_neighbouring_gaps() -> None:
    """level(k f, g) = k level(f, g/k), by simulation of a device under 0.9 and 1.1 times the force."""
    absorber = scaled_absorber(MODEL, 6.0)
    changes = {k: math.log(1 / k) / STEP for k in (0.9, 1.0, 1.1)}
    levels = {}
    for k, step in changes.items():
        gap, friction = absorber.walls.gap / k, absorber.friction.limit / k
        other = replace(absorber, walls=replace(absorber.walls, gap=gap), friction=replace(absorber.friction, limit=friction))
        here, there = (
            performance_curve(Scene(MODEL, device), [force], members=1, percent_per_100_periods=100.0).combined[0]
            for device, force in ((other, 6.0), (absorber, 6.0 * k))
        )
        assert k * here[0] == pytest.approx(there[0], rel=1e-3)
        levels[step] = here[0]
    steps = np.array(sorted(levels))
    found = worst(STEP * steps, np.log([levels[n] for n in steps]), 0.0, 0.1)
    assert found == pytest.approx(max(k * levels[step] for k, step in changes.items()))


@pytest.fixture(scope="module")
def advice() -> Advice:
    return advise(MODEL, 6.0, members=2, percent_per_100_periods=20.0)


def test_answers_are_runs(advice: Advice) -> None:
    """Levels and bands are those of curves computed on their own, and the sweeps are counted."""
    assert advice.recommended is not None
    for answer in (advice.sharp, advice.recommended):
        curve = performance_curve(Scene(MODEL, answer.absorber), [6.0], members=2, limits=advice.check.limits, percent_per_100_periods=20.0)
        assert curve.median[0] == pytest.approx(answer.level, rel=1e-9)
        np.testing.assert_allclose(curve.band[:, 0], (answer.low, answer.high), rtol=1e-9)
        assert answer.friction_limit == pytest.approx(scaled_friction(MODEL, advice.check.mass, answer.gap))
    runs = sum(len(curve.members) for curve in (*advice.check.curves, advice.check.without))
    assert 2 * runs == advice.sweeps <= 40
    assert advice.at_force(advice.sharp, 1.0) == pytest.approx(advice.sharp.level)


def test_friction_is_scaled_with_the_first_frequency_near_any_resonance() -> None:
    first, second = (scaled_absorber(MODEL, force, resonance) for force, resonance in ((3.5, 1), (35.0, 2)))
    shares = [absorber.friction.limit / absorber.walls.gap for absorber in (first, second)]
    assert shares[0] == pytest.approx(shares[1], rel=1e-12)


@pytest.mark.parametrize(("given", "name"), [({"tolerance": 0.5}, "force_tolerance"), ({"free": ["mass"]}, "free"), ({"members": 0}, "members")])
def test_what_is_refused(given: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        advise(MODEL, 6.0, **given)


def test_structures_of_the_study_are_those_of_the_books() -> None:
    """Closed forms: a plate on simple supports, the clamped plate's and the portal's known numbers, and a chain's total mass in its modes."""
    steel = (210e9, 7850.0)
    own = plate(("pinned", "pinned"), (0.4, 0.3), 0.004, ((0.5, 0.5),) * 3, 0.01, steel)
    rigidity, area = 210e9 * 0.004**3 / (12 * 0.91), 7850 * 0.004
    first = np.pi**2 * (0.4**-2 + 0.3**-2) * np.sqrt(rigidity / area)
    assert own.omega[0] == pytest.approx(first, rel=1e-6)
    assert own.tip_shape[0] ** 2 == pytest.approx(4 / (area * 0.12), rel=1e-6)
    square = plate(("clamped", "clamped"), (0.3, 0.3), 0.004, ((0.5, 0.5),) * 3, 0.01, steel)
    assert square.omega[0] * 0.09 * np.sqrt(area / rigidity) == pytest.approx(35.99, rel=1e-3)  # Leissa, Vibration of plates, 1969
    # sway of a clamped portal with equal bending stiffness and span = height: omega = 1.7922^2 sqrt(EI/m)/h^2 (Blevins 1979)
    portal = frame(1.0, 1.0, 1000.0, 2.0, 3, 6, 12, 0.01)
    assert portal.omega[0] == pytest.approx(1.7922**2 * np.sqrt(1000.0 / 2.0), rel=0.01)
    chain = storeys(4, 0.01, 1, 4)
    assert np.sum(chain.tip_shape**2) == pytest.approx(1 / 1e3)
    stiffness = 2e6 * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    stiffness[-1, -1] = 2e6
    np.testing.assert_allclose(chain.omega, np.sqrt(np.linalg.eigvalsh(stiffness) / 1e3))
    edges = assembled(np.array([[0, 0], [0.5, 0.0], [1, 0]]), [(0, 1), (1, 2)], np.array([3.0, 3.0]), np.array([2.0, 2.0]))
    cantilever = lowest_modes(*(matrix[3:, 3:] for matrix in edges), 1).omega[0]
    assert cantilever == pytest.approx(1.8751**2 * np.sqrt(3.0 / 2.0), rel=1e-3)
    assert len({case.name for case in DRAWN}) == 10
    for case in DRAWN:
        model = case.model()
        assert 1.5 <= reach(model, case.mass_ratio * model.beam_mass, case.resonance) <= 15
        assert 0.0012 <= model.damping_ratio.min() <= model.damping_ratio.max() <= 0.03
    assert len(CASES) == len({(case.name, case.resonance, case.mass_ratio) for case in CASES}) == 20


def test_plates_by_elements_and_by_polynomials_are_one() -> None:
    """A plate clamped at one edge by Hermite elements and by Ritz's method with polynomials, which share no code."""
    (ax, bx, cx, dx), (ay, by, cy, dy) = hermite(0.4, 6), hermite(0.3, 5)
    stiffness = np.kron(cx, ay) + np.kron(ax, cy) + 0.3 * (np.kron(dx, dy.T) + np.kron(dx.T, dy)) + 1.4 * np.kron(bx, by)
    free = np.arange(len(stiffness)) // len(ay) >= 2
    omega = lowest_modes(np.kron(ax, ay)[np.ix_(free, free)], stiffness[np.ix_(free, free)], 5).omega
    ritz = plate(("cantilever", "free"), (0.4, 0.3), 1.0, ((1.0, 1.0),) * 3, 0.01, (12 * 0.91, 1.0))
    np.testing.assert_allclose(omega, ritz.omega[:5], rtol=2e-3)


def test_a_scan_judges_both_answers_by_their_own_criteria(advice: Advice) -> None:
    at = np.arange(-0.5, 0.6, 0.05)
    row = judged(CASES[0], advice, at, np.where(at < -0.01, 3.0, 1.0) * np.exp(at), 1.2, 1.0)
    assert row.best == pytest.approx(1.0)
    assert row.expected == pytest.approx(1.2, rel=1e-6)
    sharp = advice.sharp.gap / advice.check.rule
    assert row.sharp == pytest.approx((3.0 if sharp < 0.99 else 1.0) * sharp, rel=0.06)


def test_the_table_stands_on_its_page(tmp_path: Path) -> None:
    page, numbers = tmp_path / "page.md", tmp_path / "numbers.json"
    page.write_text("<!-- check_gaps -->\nold\n<!-- /check_gaps -->\n")
    line = ["--quick", "--members", "1", "--rate", "60", "--threads", "1", "--json", str(numbers), "--page", str(page)]
    for _ in range(2):  # the second time everything is known
        result = CliRunner().invoke(check_gaps.main, line)
        assert result.exit_code == 0, result.output
    rows = json.loads(numbers.read_text())["rows"]
    assert [row["name"] for row in rows] == ["floor panel, simply supported", "measured bracket"]
    assert all(row["sweeps"] <= 40 and min(row["sharp"], row["recommended"]) > 1 - 1e-9 for row in rows)
    assert "old" not in page.read_text()
    assert "of 2, worst" in page.read_text()
