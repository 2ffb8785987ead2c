"""What leaves a branch where a multiplier is -1: the pair without symmetry, doubled periods; and surveys of all of them."""

from functools import cache
from itertools import islice, pairwise

import numpy as np
import pytest
from places import EXAMPLES

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError
from impact_env.periodic import offspring
from impact_env.periodic.case import Case, start_from
from impact_env.periodic.isolas import truncated
from impact_env.periodic.offspring import all_orbits_over, descendants, leaving
from impact_env.periodic.orbit import Orbit, mirrored
from impact_env.periodic.orbit_branches import PERIOD_DOUBLING, SYMMETRY_BREAKING, OrbitBranch, orbit_branches
from impact_env.periodic.shooting import units_of
from impact_env.periodic.survey import crossings, orbits_over, same, state_after
from impact_env.structure import load_structure

MODEL = modal_model(Beam(modes=1))
FIRST = float(MODEL.omega[0])
LIMITS = (0.8 * FIRST, 0.96 * FIRST)


def test_the_high_branch_of_one_dissipative_mode_hands_over_to_a_pair() -> None:
    """N_m = 1, e = 0.75, 1.5 N: at 0.93 runs of the exact method settle to orbits of 0.714381 mm, one the mirror image of the other."""
    case = Case(MODEL, 0.9 * FIRST, 1.5, restitution=0.75)
    (branch,) = orbit_branches(case, *LIMITS)
    breaking = branch.of(SYMMETRY_BREAKING)
    for motion in breaking:
        values = np.linalg.eigvals(motion.derivative)
        assert np.min(np.abs(values + 1)) < 1e-7
    left, right = sorted(motion.solution.case.omega_ratio for motion in breaking)
    assert left < 0.91 < 0.93 < right
    (pair,) = (found for found in descendants([branch], LIMITS, longest=1) if isinstance(found, OrbitBranch))
    assert pair.branch.closed
    orbits = list(pair.orbits())
    assert all(isinstance(orbit, Orbit) for orbit in orbits)
    near = [(a, b) for a, b in pairwise(orbits) if (a.case.omega_ratio - 0.93) * (b.case.omega_ratio - 0.93) <= 0]
    assert len(near) == 2  # one of each
    for a, b in near:
        assert a.stability.stable
        share = (0.93 - a.case.omega_ratio) / (b.case.omega_ratio - a.case.omega_ratio)
        assert (1 - share) * a.motion.tip_max + share * b.motion.tip_max == pytest.approx(7.14381e-4, rel=2e-4)
    phases = [np.diff([impact.phase for impact in a.impacts])[0] for a, _ in near]
    assert phases[0] != pytest.approx(np.pi, abs=1e-2)


@cache
def doubling() -> tuple[OrbitBranch, OrbitBranch]:
    """N_m = 1, e = 0.8, 1.5 N: the pair, and what leaves it where its period doubles."""
    case = Case(MODEL, 0.9 * FIRST, 1.5, restitution=0.8)
    (branch,) = orbit_branches(case, *LIMITS)
    pair, doubled = islice(descendants([branch], LIMITS, longest=2), 2)
    assert isinstance(pair, OrbitBranch)
    assert isinstance(doubled, OrbitBranch)
    return pair, doubled


def test_a_multiplier_of_minus_one_leads_to_twice_the_period() -> None:
    pair, doubled = doubling()
    places = pair.of(PERIOD_DOUBLING)
    assert len(places) >= 2
    for motion in places:
        values = np.linalg.eigvals(motion.derivative)
        assert np.min(np.abs(values + 1)) < 1e-6
    where = min(motion.solution.case.omega_ratio for motion in places)
    orbits = [orbit for orbit in doubled.orbits() if isinstance(orbit, Orbit)]
    assert len(orbits) > 30
    assert {orbit.schedule.period_multiple for orbit in orbits} == {2}
    assert all(orbit.residual < 1e-10 for orbit in orbits)
    assert min(orbit.case.omega_ratio for orbit in orbits) == pytest.approx(where, abs=2e-5)
    stable = [orbit for orbit in orbits if orbit.stability.stable]
    assert stable
    with pytest.raises(ParameterError, match="kind = 'fold'"):
        next(leaving(pair, "fold"))


def test_runs_of_the_exact_method_settle_to_the_doubled_period_and_not_to_the_single_one() -> None:
    """Propagated for 600 periods from beside the orbit of one period: two periods bring the state back, one does not."""
    case = Case(MODEL, 0.933 * FIRST, 1.5, restitution=0.8)
    pair, doubled = doubling()
    single = next(o for o in crossings(pair, case.omega) if isinstance(o, Orbit) and len(o.impacts) == 2 and not o.stability.stable)
    double = next(o for o in crossings(doubled, case.omega) if isinstance(o, Orbit))
    assert double.stability.stable
    phase, state = single.motion.mid_flight()
    state[-1] += 1e-4 * case.gap * case.omega
    ends = [state_after(case, periods, start_from(case.scene, state), phase)[0] for periods in (600.0, 601.0, 602.0)]
    unit = units_of(case)
    assert np.max(np.abs(ends[2] - ends[0]) / unit) < 1e-7
    assert np.max(np.abs(ends[1] - ends[0]) / unit) > 1e-2
    middle = single.motion.mid_flight()[1]
    assert np.max(np.abs(state_after(case, 1, start_from(case.scene, middle), phase)[0] - middle) / unit) < 1e-10
    recorded = sorted(orbit.motion.tip_max for orbit in (single, double))
    assert recorded[0] != pytest.approx(recorded[1], rel=1e-3)


def test_all_orbits_over_a_range_have_pairs_doubled_periods_and_their_mirror_images() -> None:
    case = Case(MODEL, FIRST, 1.5, restitution=0.8)
    ratios = np.array([0.93, 0.934, 0.936, 0.94])
    told: list[str] = []
    groups = list(all_orbits_over(case, ratios, lambda what, _done, _total: told.append(what)))
    assert [group.case.omega_ratio for group in groups] == pytest.approx(ratios)
    assert {"closed form", "branches"} <= set(told)
    symmetric = list(orbits_over(case, ratios))
    for group, plain in zip(groups, symmetric, strict=True):
        assert [o.motion.tip_max for o in group.orbits if o.schedule.symmetric] == pytest.approx([o.motion.tip_max for o in plain.orbits])
        sided = [orbit for orbit in group.orbits if not orbit.schedule.symmetric]
        assert len(sided) % 2 == 0
        for orbit in sided:
            image = mirrored(orbit)
            assert isinstance(image, Orbit)
            assert sum(same(image, other) for other in sided) == 1
            assert orbit.residual < 1e-10
    multiples = [{orbit.schedule.period_multiple for orbit in group.orbits} for group in groups]
    assert multiples[0] == {1}
    assert multiples[1] == {1, 2}
    assert {1, 2, 4} <= multiples[2]
    assert any(orbit.stability.stable and orbit.schedule.period_multiple == 4 for orbit in groups[2].orbits)
    assert {orbit.schedule.period_multiple for group in all_orbits_over(case, ratios, longest=2) for orbit in group.orbits} == {1, 2}


def test_another_structure_has_a_cascade_too() -> None:
    """The beam of docs/examples/steel_beam.toml with two modes and friction: every orbit of its survey is confirmed, also without symmetry."""
    model = truncated(modal_model(load_structure(EXAMPLES / "steel_beam.toml")), 2)
    case = Case(model, float(model.omega[0]), 2.0, restitution=0.75, friction_limit=0.01)
    groups = list(all_orbits_over(case, np.linspace(0.9, 0.96, 5), longest=2))
    orbits = [orbit for group in groups for orbit in group.orbits]
    assert any(not orbit.schedule.symmetric for orbit in orbits)
    for orbit in orbits:
        assert orbit.residual < 1e-10


def test_branches_without_end_are_left_with_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offspring, "MOST_BRANCHES", 2)
    case = Case(MODEL, FIRST, 1.5, restitution=0.8)
    groups = list(all_orbits_over(case, np.array([0.93, 0.936]), settle=False))
    assert any("there are more" in refused.reason for group in groups for refused in group.refused)
    assert any(not orbit.schedule.symmetric for group in groups for orbit in group.orbits)
