"""Figures of the paper's study: ranges, accounts and claims, on made curves whose answer is known and on small runs beside other means."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impact_env.curve import performance_curve
from impact_env.drive import Drive, constant_frequency, linear_sweep
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane
from impact_env.frequency import tip_response
from impact_env.methods import Exact
from impact_env.parameters import Beam, friction_damper, impact_absorber
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate
from studies.paper import oprange, scat, second_mode
from studies.paper.account import window_around
from studies.paper.claim import Verdict, verdict
from studies.paper.curve import (
    WATCHED,
    Contacts,
    Curve,
    Envelope,
    curve_of,
    operating_ranges,
    part_of,
    plain_curve,
    ranges_of,
    sampled_level,
    slopes,
    watched_curve,
)
from studies.paper.frame import PaperFigure, Settings
from studies.paper.style import saved
from studies.study import Json

FORCES = np.array([0.5, 1.0, 2.0, 4.0, 8.0])


def made(level: np.ndarray, impacts: float = 100.0, pause: np.ndarray | float = 0.5, at: float = 0.95) -> Curve:
    """A curve over FORCES of members with these levels (F, M)."""
    same = np.ones_like(level)
    rate = 2.0 * (impacts * same > 0)
    return Curve(FORCES, level, at * same, same, impacts * same, 1.4 * level, rate, pause * same, 300.0 * same)


def power(exponent: float, members: int = 3) -> np.ndarray:
    return np.outer(FORCES**exponent, np.linspace(1.0, 1.1, members)) * 1e-3


def lane(modes: int = 3, force: float = 3.0, restitution: float = 1.0, rate: float = 8.0) -> Lane:
    scene = beam_scene(Beam(modes=modes), impact_absorber(restitution=restitution))
    return Lane(scene, Drive(force, linear_sweep(scene.model.resonance_omega(1), 1.06, 0.9, rate), 0.4))


def settings(tmp_path: Path) -> Settings:
    return Settings(tmp_path, quick=True, threads=1)


def measured(figure: PaperFigure, given: Settings, size: object) -> Json:
    *_, values = figure.measure(given, size, {})
    return values


# ranges


def test_ranges_of_shares_of_members() -> None:
    found = operating_ranges(FORCES, [0, 0.2, 0.6, 1, 1], [0, 0, 0.4, 0.8, 1])
    assert (found.first_impacts.low, found.first_impacts.high) == (1.0, 2.0)
    assert (found.transition.low, found.transition.high) == (2.0, 4.0)
    assert found.transition.force == pytest.approx(8**0.5)


def test_sustained_means_no_pause_of_a_period_of_the_force() -> None:
    pauses = np.array([[0.5, 0.5], [1.04, 1.04], [1.04, 1.06], [1.06, 3.0], [20.0, 20.0]])  # pseudo periods, at 0.95 of the resonance
    assert made(power(1, 2), pause=pauses).sustained.tolist() == [1, 1, 0.5, 0, 0]
    assert made(power(1, 2), impacts=0.0).sustained.tolist() == [0] * 5
    assert ranges_of(made(power(1, 2), pause=pauses[::-1])).transition is not None


@pytest.mark.parametrize("exponent", [0.0, 0.15, 1.0])
def test_slopes_are_the_power_of_a_made_curve(exponent: float) -> None:
    assert slopes(made(power(exponent)), FORCES > 0.7) == pytest.approx(exponent, abs=1e-12)
    assert np.isnan(slopes(made(power(exponent)), FORCES > 7)).all()


# curves


def test_watched_curve_is_the_performance_curve(tmp_path: Path) -> None:
    scene, forces = beam_scene(Beam(modes=2), impact_absorber()), (0.7, 1.5)
    known = curve_of(plain_curve(performance_curve(scene, forces, members=2, threads=1)))
    own = curve_of(watched_curve(settings(tmp_path), "curve", scene, forces, 2))
    for name in ("level", "at", "down", "impacts", "tip"):
        assert getattr(own, name) == pytest.approx(getattr(known, name), rel=1e-9), name  # two libraries may round sums differently
    assert own.rate[0].max() == 0
    assert own.rate[1].min() > 0


# what is seen of a run


def test_level_of_samples_is_the_level() -> None:
    one = lane()
    own, known = sampled_level(simulate(one.scene, one.drive, record=WATCHED)), simulate(one.scene, one.drive).level
    assert known is not None
    assert vars(own) == pytest.approx(vars(known), rel=1e-9)


def test_contacts_count_by_hand() -> None:
    one = lane(force=4.0)
    seen, response = Contacts(Exact())(one), simulate(one.scene, one.drive, record=WATCHED)
    level, period = sampled_level(response), one.drive.schedule.pseudo_period
    inside = [t for t in response.impacts.time if abs(t - level.time) <= 10 * period]
    assert seen.rate == pytest.approx(len(inside) / 20)
    assert seen.before == pytest.approx((level.time - response.impacts.time[0]) / period)
    edges = [level.time - 10 * period, *inside, level.time + 10 * period]
    assert seen.pause == pytest.approx(max(np.diff(edges)) / period)


def test_envelope_of_a_slow_linear_sweep_is_the_frequency_response() -> None:
    scene = beam_scene(Beam(modes=2))
    drive = Drive(1.0, linear_sweep(scene.model.resonance_omega(1), 0.9, 1.06))
    watch = Envelope(4)
    ratio, found = watch.ratios(drive.schedule), watch(Lane(scene, drive))
    assert len(ratio) == len(found)
    inside = (ratio > 0.91) & (ratio < 0.97)
    still = np.abs(tip_response(scene.model, None, ratio[inside] * scene.model.resonance_omega(1)))
    assert found[inside] == pytest.approx(still, rel=0.06)


def test_part_of_a_drive_has_its_frequency_and_phase() -> None:
    drive = lane().drive
    start, stop = 0.2 * drive.schedule.times[-1], 0.7 * drive.schedule.times[-1]
    own, times = part_of(drive, start, stop), np.linspace(start, stop, 7)
    assert own.schedule.omega_at(times - start) == pytest.approx(drive.schedule.omega_at(times), rel=1e-12)
    assert own.phase + own.schedule.phase_at(times - start) == pytest.approx(drive.phase + drive.schedule.phase_at(times), rel=1e-12)


# accounts of the energy


def test_the_window_is_that_of_the_level() -> None:
    """Where no impact makes the motion part from the sweep's: friction alone, which starts in the middle of its motion all the same."""
    scene = beam_scene(Beam(modes=3), friction_damper(0.1))
    one = Lane(scene, Drive(3.0, linear_sweep(scene.model.resonance_omega(1), 1.06, 0.9, 8.0), 0.4))
    level = simulate(one.scene, one.drive).level
    history = window_around(one, level.time).history
    rms = float(np.sqrt(np.mean(history.tip_displacement**2)))
    assert rms == pytest.approx(level.value, rel=2e-3)


def test_losses_are_the_integral_of_the_modal_damping() -> None:
    one = lane()
    level = simulate(one.scene, one.drive).level
    response = window_around(one, level.time)
    history, model = response.history, one.scene.model
    power = 2 * model.damping_ratio * model.omega * history.modal_velocity**2
    assert response.energy.modal_loss == pytest.approx(np.trapezoid(power, history.time, axis=0), rel=2e-3)


def test_conservative_contacts_pass_energy_on_without_loss() -> None:
    """What the contacts take from the modes the absorber gets: by the account of single contacts, beside the states at the samples around each."""
    one = lane(modes=2)
    level = simulate(one.scene, one.drive).level
    response = window_around(one, level.time)
    energy = mechanical_energy(one.scene, response.history)
    sample = response.impacts.time / (response.history.time[1] - response.history.time[0])
    apart = np.flatnonzero(np.diff(sample) > 4)
    before, after = np.floor(sample[apart]).astype(int), np.ceil(sample[apart]).astype(int)
    assert (energy.total[after] - energy.total[before]) / energy.total[before] == pytest.approx(0, abs=2e-3)
    assert np.abs(energy.absorber[after] - energy.absorber[before]).max() > 0.02 * energy.total.mean()


# claims


def test_verdicts_at_the_papers_step() -> None:
    assert verdict(2.0, 3.0, 0.0, 1.0) is Verdict.NOT
    assert verdict(2.0, 3.0, 0.0, 1.0, at_step=0.5) is Verdict.STEP
    assert verdict(2.0, 3.0, 0.0, 1.0, at_step=1.5) is Verdict.NOT
    assert verdict(0.5, 3.0, 0.0, 1.0, at_step=5.0) is Verdict.SPREAD
    assert verdict(float("nan"), 3.0, 0.0, 1.0) is Verdict.NOT


def test_decay_of_a_mode_over_half_a_period() -> None:
    scene = Scene(replace(beam_scene(Beam(modes=1)).model, force_shape=np.zeros(1)))
    start = InitialState(np.array([1e-3]))
    drive = Drive(0.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 10.0))
    history = simulate(scene, drive, initial=start, record=WATCHED).history
    assert history is not None
    energy = mechanical_energy(scene, history).modal[:, 0]
    assert energy[-1] / energy[0] == pytest.approx(scat.decayed(1.0) ** 20, rel=1e-3)


def test_claims_of_the_operating_ranges(tmp_path: Path) -> None:
    found = measured(oprange.FIGURE, settings(tmp_path), oprange.Sizes((0.5, 0.7, 1.0, 1.3, 1.6, 2.5, 4.0, 9.0, 60.0), 2))
    claims = {own.name: own for own in oprange.FIGURE.claims(found)}
    assert len(claims) == 7
    assert claims["oprange_step"].verdict is Verdict.NOT  # with one mode a step is a twentieth of the force's period
    for name in ("linear_range", "saturation", "quasi_linear", "sustained", "linear_limit"):
        assert claims[f"oprange_{name}"].verdict is Verdict.HOLDS, claims[f"oprange_{name}"]
    ranges = ranges_of(curve_of(found["absorber"]))
    assert (ranges.first_impacts.low, ranges.first_impacts.high) == (0.7, 1.0)  # the gap is reached at 0.7806 N
    saved(lambda: oprange.FIGURE.draw(found))(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 20_000
    assert "first impacts between 0.7 and 1 N" in oprange.FIGURE.words(found)


def test_claims_of_the_second_modes_damping(tmp_path: Path) -> None:
    dampings = (0.01, 0.3, 0.5)
    found = measured(second_mode.DAMPING, settings(tmp_path), second_mode.Dampings(dampings, 2))
    claims = {own.name: own for own in second_mode.DAMPING.claims(found)}
    for name in ("improvement", "lower", "dissipated", "saturates"):
        assert claims[f"vard_{name}"].verdict is Verdict.HOLDS, claims[f"vard_{name}"]
    left = [np.median(second_mode.row(found, d, "left")) for d in dampings]
    assert left[0] > 0.5 > 0.1 > left[1]
