"""Figures of the paper's study have correct ranges, energies, claims and verdicts.

They are tested on constructed curves with known results, and on small runs against other methods.
"""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawing import line, saved_figures
from matplotlib import rc_context
from matplotlib.legend import Legend
from matplotlib.text import Text

from impact_env.curve import CurveCase, performance_curve
from impact_env.drive import Drive, constant_frequency, linear_sweep
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.methods import Exact, Moreau
from impact_env.parameters import Beam, friction_damper, impact_absorber
from impact_env.periodic.residence import Approach, hold
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.files import DOCS, read_json
from studies.paper import basics, claim, conv, high_low, jump, m12, oprange, scat, second_mode, smr
from studies.paper.account import simulate_window
from studies.paper.claim import ClaimVerdict, judge_interval, judge_values
from studies.paper.curve import (
    FULL_RECORD,
    LevelCurve,
    compute_contact_curve,
    compute_envelope,
    compute_envelope_ratios,
    compute_slopes,
    find_operating_ranges,
    find_ranges,
    measure_contacts,
    read_curve,
    to_plain_curve,
)
from studies.paper.frame import RC, SMALL, PaperFigure, PaperSettings, Size, make_saver
from studies.paper.study import FIGURES, make_paths
from studies.study import Json, read_measurement

FORCES = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
QUICK = PaperSettings(Path("nowhere"), quick=True, threads=1)


def made(
    level: np.ndarray, impacts: float = 100.0, pause: np.ndarray | float = 0.5, at: float = 0.95
) -> LevelCurve:
    """A curve over FORCES of members with these levels (F, M)."""
    same = np.ones_like(level)
    rate = 2.0 * (impacts * same > 0)
    return LevelCurve(
        FORCES, level, at * same, same, impacts * same, 1.4 * level, rate, pause * same
    )


def power(exponent: float, members: int = 3) -> np.ndarray:
    return np.outer(FORCES**exponent, np.linspace(1.0, 1.1, members)) * 1e-3


def lane(force: float = 3.0) -> Lane:
    scene = beam_scene(Beam(modes=3), impact_absorber())
    return Lane(
        scene, Drive(force, linear_sweep(scene.model.resonance_omega(1), 1.06, 0.9, 8.0), 0.4)
    )


def measured(figure: PaperFigure, size: object) -> tuple[Json, dict[str, ClaimVerdict]]:
    """Return the values of a figure, and its verdicts by the names of claims."""
    *_, values = figure.measure(QUICK, size, {})
    return values, {claim.name: claim.verdict for claim in figure.claims(values)}


# ranges and curves


def test_ranges_of_shares_of_members() -> None:
    ranges = find_operating_ranges(FORCES, [0, 0.2, 0.6, 1, 1], [0, 0, 0.4, 0.8, 1])
    assert (ranges.first_impacts.low, ranges.first_impacts.high) == (1.0, 2.0)
    assert (ranges.transition.low, ranges.transition.high) == (2.0, 4.0)
    assert ranges.transition.force == pytest.approx(8**0.5)


def test_sustained_means_no_pause_of_a_period_of_the_force() -> None:
    pauses = np.array(
        [[0.5, 0.5], [1.04, 1.04], [1.04, 1.06], [1.06, 3.0], [20.0, 20.0]]
    )  # pseudo periods, at 0.95 of the resonance
    assert made(power(1, 2), pause=pauses).sustained.tolist() == [1, 1, 0.5, 0, 0]
    assert made(power(1, 2), impacts=0.0).sustained.tolist() == [0] * 5
    assert find_ranges(made(power(1, 2), pause=pauses[::-1])).transition is not None


@pytest.mark.parametrize("exponent", [0.0, 0.15, 1.0])
def test_slopes_are_the_power_of_a_made_curve(exponent: float) -> None:
    assert compute_slopes(made(power(exponent)), FORCES > 0.7) == pytest.approx(exponent, abs=1e-12)
    assert np.isnan(compute_slopes(made(power(exponent)), FORCES > 7)).all()


def test_curve_with_contacts_is_the_performance_curve() -> None:
    scene = beam_scene(Beam(modes=2), impact_absorber())
    forces = (0.7, 1.5)
    known = read_curve(to_plain_curve(performance_curve(scene, forces, members=2, threads=1)))
    own = read_curve(compute_contact_curve(QUICK, "curve", scene, forces, 2))
    for name in ("level", "at", "down", "impacts", "tip"):
        assert getattr(own, name) == pytest.approx(getattr(known, name), rel=1e-9), (
            name
        )  # two libraries may round sums differently
    assert own.rate[0].max() == 0
    assert own.rate[1].min() > 0


# what is seen of a run


def test_contacts_count_by_hand() -> None:
    one = lane(force=4.0)
    contacts = measure_contacts(one)
    response = simulate(one.scene, one.drive, record=FULL_RECORD)
    level = response.recorded.level
    period = one.drive.schedule.pseudo_period
    inside = [t for t in response.impacts.time if abs(t - level.time) <= 10 * period]
    assert contacts.rate == pytest.approx(len(inside) / 20)
    edges = [level.time - 10 * period, *inside, level.time + 10 * period]
    assert contacts.pause == pytest.approx(max(np.diff(edges)) / period)


def test_envelope_of_a_slow_linear_sweep_is_the_frequency_response() -> None:
    scene = beam_scene(Beam(modes=2))
    drive = Drive(1.0, linear_sweep(scene.model.resonance_omega(1), 0.9, 1.06))
    ratio = compute_envelope_ratios(drive.schedule)
    envelope = compute_envelope(Lane(scene, drive))
    assert len(ratio) == len(envelope)
    inside = (ratio > 0.91) & (ratio < 0.97)
    still = np.abs(tip_response(scene.model, None, ratio[inside] * scene.model.resonance_omega(1)))
    assert envelope[inside] == pytest.approx(still, rel=0.06)


def test_the_window_is_that_of_the_level() -> None:
    """The window of the energies is that of the level.

    The scene has friction alone, so no impact makes the motion differ from that of the sweep. The
    window also starts during the motion.
    """
    one = replace(lane(), scene=beam_scene(Beam(modes=3), friction_damper(0.1)))
    level = simulate(one.scene, one.drive).level
    history = simulate_window(one, level.time).history
    assert np.sqrt(np.mean(history.tip_displacement**2)) == pytest.approx(level.value, rel=2e-3)


def test_decay_of_a_mode_over_half_a_period() -> None:
    scene = Scene(replace(beam_scene(Beam(modes=1)).model, force_shape=np.zeros(1)))
    drive = Drive(0.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 10.0))
    history = simulate(
        scene, drive, initial=InitialState(np.array([1e-3])), record=FULL_RECORD
    ).history
    energy = mechanical_energy(scene, history).modal[:, 0]
    assert energy[-1] / energy[0] == pytest.approx(scat.compute_decay(1.0) ** 20, rel=1e-3)


@pytest.mark.parametrize("damper", [0.0, 0.1])
def test_a_damper_to_ground_is_that_of_an_own_integration(damper: float) -> None:
    """A damper to ground agrees with a separate integration.

    It uses small steps with elastic impacts, from rest over the first impacts. At 0.1 N s/m a free
    absorber would lose two thirds of its velocity.
    """
    scene = beam_scene(Beam(modes=2), impact_absorber())
    periods = 5
    each = 4000
    model = scene.model
    mass = float(scene.absorber_mass or 0)
    omega = model.resonance_omega(1)
    tip = model.tip_shape
    mean_squares = basics.simulate_mean_squares(
        scene, [Drive(4.0, constant_frequency(omega, 1.0, periods))], damper, Exact(), 1, 16
    )[:, 0]
    dt = 2 * np.pi / omega / each
    q = np.zeros(2)
    v = np.zeros(2)
    a = 0.0
    u = 0.0
    impacts = 0
    tips = np.zeros(periods * each + 1)
    for k in range(periods * each):
        push = model.force_shape * 4.0 * np.cos(omega * (k + 0.5) * dt)
        q = q + 0.5 * dt * v
        a = a + 0.5 * dt * u
        v = v + dt * (push - model.omega**2 * q - 2 * model.damping_ratio * model.omega * v)
        u = u * (1 - dt * damper / mass)
        closing = float(u - tip @ v)
        place = float(a - tip @ q)
        if abs(place) >= 1e-3 and place * closing > 0:
            impulse = 2 * closing / (1 / mass + tip @ tip)
            impacts = impacts + 1
            v = v + tip * impulse
            u = u - impulse / mass
        q = q + 0.5 * dt * v
        a = a + 0.5 * dt * u
        tips[k + 1] = tip @ q
    square = tips[: -1 : each // basics.SAMPLES].reshape(periods * 16, -1) ** 2
    assert impacts >= 3
    assert mean_squares == pytest.approx(square.mean(axis=1), abs=0.01 * square.max())


# claims


def test_the_comparison_starts_from_rest_as_the_paper_does(monkeypatch: pytest.MonkeyPatch) -> None:
    cases: list[CurveCase] = []

    def collect(_settings: PaperSettings, _label: str, each: list[CurveCase], *_: object) -> None:
        cases.extend(each)
        raise KeyboardInterrupt

    monkeypatch.setattr(PaperSettings, "curves", collect)
    with pytest.raises(KeyboardInterrupt):
        next(m12.FIGURE.measure(QUICK, m12.FIGURE.sizes[1], {}))
    assert len(cases) == 7
    assert not any(case.steady_start for case in cases)


def test_verdicts_of_intervals_and_at_the_papers_step() -> None:
    assert judge_interval(1.0, 2.0, 0.5, 2.0) is ClaimVerdict.HOLDS
    for limits, at_step, expected in (
        ((2.0, 3.0, 0.0, 1.0), None, ClaimVerdict.NOT),
        ((2.0, 3.0, 0.0, 1.0), 0.5, ClaimVerdict.STEP),
        ((2.0, 3.0, 0.0, 1.0), 1.5, ClaimVerdict.NOT),
        ((0.5, 3.0, 0.0, 1.0), 5.0, ClaimVerdict.SPREAD),
        ((float("nan"), 3.0, 0.0, 1.0), None, ClaimVerdict.NOT),
    ):
        assert judge_values(*limits, at_step=at_step) is expected


def test_claims_of_the_operating_ranges(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    claims, verdicts = measured(
        oprange.FIGURE, Size(forces=(0.5, 0.7, 1.0, 1.3, 1.6, 2.5, 4.0, 9.0, 60.0), members=2)
    )
    assert len(verdicts) == 6
    for name in ("linear_range", "saturation", "quasi_linear", "sustained", "linear_limit"):
        assert verdicts[f"oprange_{name}"] is ClaimVerdict.HOLDS, name
    ranges = find_ranges(read_curve(claims["absorber"]))
    assert (ranges.first_impacts.low, ranges.first_impacts.high) == (
        0.7,
        1.0,
    )  # the gap is reached at 0.7806 N
    drawn = saved_figures(monkeypatch)
    make_saver(lambda: oprange.FIGURE.draw(claims))(tmp_path / "figure.png")
    panel = drawn[0].axes[0]
    curve, step = (read_curve(claims[name]) for name in ("absorber", "step"))
    none = read_curve(claims["linear"]["none"])
    in_range = curve.forces <= 12
    level = 1e3 * np.median(curve.level, axis=1)
    np.testing.assert_allclose(
        line(panel, "impact absorber"), [curve.forces[in_range], level[in_range]]
    )
    np.testing.assert_allclose(
        line(panel, "no absorber")[1], 1e3 * np.median(none.level, axis=1)[in_range]
    )
    np.testing.assert_allclose(line(panel, "one run at")[1], 1e3 * step.level[in_range, 0])
    assert "first impacts between 0.7 and 1 N" in oprange.FIGURE.describe(claims)


def test_claims_of_the_second_modes_damping() -> None:
    dampings = (0.01, 0.3, 0.5)
    claims, verdicts = measured(second_mode.DAMPING, Size(dampings=dampings, members=2))
    for name in ("improvement", "lower", "dissipated", "saturates"):
        assert verdicts[f"vard_{name}"] is ClaimVerdict.HOLDS, name
    left = [np.median(second_mode.read_row(claims, d, "left")) for d in dampings]
    assert left[0] > 0.5 > 0.1 > left[1]


def test_one_mode_without_losses_at_its_contact_is_strongly_modulated() -> None:
    values, verdicts = measured(smr.FIGURE, Size(members=3, periods=300, elsewhere=(2, 100)))
    for name in (
        "two impacts in the burst",
        "fewer impacts between",
        "lag near zero",
        "ninety per cent",
        "effective at resonance",
    ):
        assert verdicts[name] in (ClaimVerdict.HOLDS, ClaimVerdict.SPREAD), name
    assert all(0.5 < depth < 1 for depth in values["exact"]["depth"])
    record = values["exact"]["record"]
    assert np.max(np.abs(np.array(record["absorber_m"]) - record["tip_m"])) <= values["linear"][
        "gap_m"
    ] * (1 + 1e-4)


def test_the_sliding_absorber_drifts_at_the_papers_step_only() -> None:
    """The sliding absorber drifts only at the paper's step.

    With the exact method, whole periods of friction do not change the absorber's mean position. A
    scheme that is late at each slip reversal moves it to a wall.
    """
    scene = jump.make_scene()
    start, stop, _ = jump.DRIFT
    drives = draw_members(3, 0, "phase").drives(
        1.5, linear_sweep(scene.model.resonance_omega(1), start, stop, 0.2)
    )
    drifts = {
        method: [jump.measure_drift(Lane(scene, drive), method)[0] for drive in drives]
        for method in (Exact(), Moreau())
    }
    assert max(drifts[Exact()]) < 0.02e-3
    assert min(drifts[Moreau()]) > 0.04e-3


@pytest.mark.nightly
def test_friction_springs_and_walls_approach_the_rigid_laws() -> None:
    for kind in (conv.WALLS, conv.FRICTION):
        rows = conv._over_stiffness(QUICK, conv.sizes(3, 4, 3), kind, Exact())
        ratio = np.median(rows["level_m"], axis=1) / np.median(rows["rigid_m"])
        assert abs(ratio[-1] - 1) < 0.05
        assert abs(ratio[0] - 1) > 0.1


def test_on_the_high_branch_the_absorber_visits_two_walls_a_period_and_is_struck_more_often() -> (
    None
):
    scene = high_low.make_scene()
    impacts, visits = high_low.measure_rhythm(
        Lane(scene, hold(Approach(scene.model.resonance_omega(1), 1.0), 3.0, 0.955, 400.0)), Exact()
    )
    assert visits == pytest.approx(2.0, abs=0.1)
    assert 3 < impacts < 6


class Judged(dict[str, dict[str, Any]]):
    """The texts of a figure's claims, which note each name that is looked up."""

    def __init__(self, stated: dict[str, dict[str, Any]]) -> None:
        super().__init__(stated)
        self.names: set[str] = set()

    def __getitem__(self, name: str) -> dict[str, Any]:
        self.names.add(name)
        return super().__getitem__(name)


def test_published_claims_are_those_of_the_published_numbers_and_each_text_is_judged_by_its_figure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = read_json(DOCS / "paper" / "claims.json.gz")
    claims = []
    assert not content["missing"]
    for figure in FIGURES:
        own = Judged(claim.STATED[figure.label])
        monkeypatch.setattr(
            claim, "STATED", {figure.label: own}
        )  # what another figure judges is not there
        claims += figure.claims(read_measurement(figure.part(), make_paths(DOCS)).values)
        monkeypatch.undo()
        assert own.names == set(own), figure.label
    assert set(claim.STATED) == {figure.label for figure in FIGURES}
    assert [one.to_plain() for one in claims] == content["claims"]
    assert len({one.name for one in claims}) == len(claims) >= 30
    page = (DOCS / "paper.md").read_text()
    with (DOCS / "paper" / "claims.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["statement"] for row in rows] == [one.statement for one in claims]
    assert all(one.statement[1:] in page for one in claims if one.verdict is not ClaimVerdict.HOLDS)


@pytest.mark.parametrize("label", ["SMR", "scat", "dissinf", "varom", "high_low", "m12", "further"])
def test_letters_of_published_figures_can_be_read_and_legends_are_short(label: str) -> None:
    figure = next(figure for figure in FIGURES if figure.label == label)
    with rc_context(RC):
        drawing = figure.draw(read_measurement(figure.part(), make_paths(DOCS)).values)
    texts = [text for text in drawing.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= SMALL
    legends = drawing.findobj(Legend)
    assert all(len(legend.get_texts()) <= 9 for legend in legends)
    names = [text.get_text() for legend in legends for text in legend.get_texts()]
    if label == "high_low":
        assert "fold (saddle node)" in names
    if label == "further":
        x, y = line(drawing.axes[0], "sweep up")
        rows = read_measurement(figure.part(), make_paths(DOCS)).values["limits"]
        assert x.tolist() == [row["force_n"] for row in rows]
        assert y.tolist() == [row["up"]["first_impact"] for row in rows]
