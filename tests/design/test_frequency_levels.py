"""The level over the frequency agrees with the receptance.

The motion of the worst run agrees with its level.
"""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from impact_env import Beam, Record, Scene, impact_absorber, modal_model, simulate
from impact_env.checks import ParameterError
from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import Threads, draw_members
from impact_env.level import response_level
from optimisation import frequency_levels
from optimisation.frequency_levels import (
    find_worst_run,
    frequency_curve,
    lanes_of,
    record_worst_run,
    resonance_curves,
    samples_for,
    windowed_levels,
)
from optimisation.insight import member_levels
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.frequency_report import frequency_charts, history_arrays, save_history
from optimisation.space import design_space

MODEL = modal_model(Beam(modes=2))


def case(absorber: object, rate: float, force: float = 3.5) -> CurveCase:
    scene = Scene(MODEL, absorber)  # type: ignore[arg-type]
    return CurveCase(scene, np.array([force]), 1, (0.93, 1.06), rate, steady_start=True)


def test_without_absorber_it_is_the_receptance() -> None:
    """Without absorber the level over the frequency is the receptance.

    The test is a slow sweep from the steady state. The RMS is over a window of twenty periods, in
    which the frequency changes by 0.05 %.
    """
    lanes = lanes_of(case(None, 0.25), draw_members(1, 0), 0)
    curve = frequency_curve("no absorber", lanes, (0.93, 1.06))
    assert curve is not None
    omega = curve.ratio[:, None] * MODEL.omega[0]
    shapes = MODEL.force_shape * MODEL.level_shape
    terms = MODEL.omega**2 - omega**2 + 2j * MODEL.damping_ratio * MODEL.omega * omega
    stationary = 3.5 * np.abs(np.sum(shapes / terms, axis=1)) / np.sqrt(2)
    known = np.isfinite(curve.level)
    assert known.mean() > 0.9
    assert curve.level[known] == pytest.approx(stationary[known], rel=0.04)


def test_a_level_over_the_frequency_is_the_rms_of_ten_periods_to_either_side() -> None:
    lane, _ = lanes_of(case(impact_absorber(1e-3, 0.7, 0.1), 10.0), draw_members(1, 0), 0)
    ratio, levels = windowed_levels(lane, 8)
    record = Record(events=True, series=True, samples_per_period=8)
    run = simulate(lane.scene, lane.drive, initial=lane.start, record=record)
    assert run.history is not None
    motion = run.history.modal_displacement @ MODEL.level_shape
    for period in (0, 5, 60, len(levels) - 3):
        k = 8 * period
        window = motion[max(k - 80, 0) : k + 81]
        assert levels[period] == pytest.approx(math.sqrt(sum(x * x for x in window) / len(window)))
        swept = (ratio[period] - 0.93) / 0.13
        assert swept == pytest.approx(period / lane.drive.schedule.periods, abs=1e-9)


def test_the_worst_run_is_recorded_to_the_last_bit_of_its_level(tmp_path: Path) -> None:
    own = case(impact_absorber(1e-3, 0.7, 0.1), 40.0)
    (curve,) = performance_curves([own], 3, seed=5)
    member, direction = find_worst_run(curve)
    assert curve.level[0, member, direction] == curve.level.max()
    run = record_worst_run(own, curve)
    assert (run.member, run.direction) == (member, direction)
    assert run.response.level is not None
    assert run.response.level.value == curve.level.max()
    arrays = history_arrays(run)
    level, largest = response_level(arrays["displacement_m"], 32)
    assert level == pytest.approx(float(curve.level.max()), rel=1e-12)
    assert np.max(np.abs(arrays["absorber_relative_m"])) <= 1e-3 * (1 + 1e-9)
    assert arrays["frequency_hz"][0] == pytest.approx(
        (0.93, 1.06)[direction] * MODEL.omega[0] / (2 * np.pi)
    )
    save_history(tmp_path / "run.npz", run)
    with np.load(tmp_path / "run.npz") as recorded:
        assert np.array_equal(recorded["displacement_m"], arrays["displacement_m"])
        assert 0.98 * largest < float(np.max(np.abs(recorded["displacement_m"]))) <= largest
    save_history(tmp_path / "run.png", run)
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")

    # the curve of that member holds its level; each absorber is drawn, and charted
    none = case(None, 40.0)
    part = resonance_curves({"own": (own, member), "no absorber": (none, 0)}, curve.members)
    assert [one.name for one in part.curves] == ["own", "no absorber"]
    assert (
        0.97 * level < np.nanmax(part.curves[0].level) < 1.2 * level
    )  # the level's window is around the largest displacement
    (chart,) = frequency_charts([part])
    assert [one.name for one in chart.curves] == ["own", "no absorber"]


def test_what_takes_too_much_memory_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(MODEL, None)
    assert samples_for(scene, 1000.0) == 32
    assert samples_for(scene, 256e6 / (64 * 32) * 1.1) == 8
    assert samples_for(scene, 1e9 / (64 * 8) * 1.1) is None
    monkeypatch.setattr(frequency_levels, "FULL_BYTES", 0.0)
    monkeypatch.setattr(frequency_levels, "MOST_BYTES", 0.0)
    own = case(None, 40.0)
    (curve,) = performance_curves([own], 1)
    part = resonance_curves({"none": (own, 0)}, curve.members)
    assert part.curves == ()
    assert frequency_charts([part]) == ()
    with pytest.raises(ParameterError, match="history = '32"):
        record_worst_run(own, curve)


def test_the_winner_of_a_search_has_its_curve_and_its_worst_run() -> None:
    """The winner of a search has its curve over the frequency and its worst run.

    The highest of its levels is that of the winner's report on the same fresh members. The level
    without absorber is proportional to the force.
    """
    pytest.importorskip("optuna")
    from optimisation.answers.design import WinnerRuns

    problem = Problem(
        design_space("impact"), (Condition(1, 3.5),), beam=Beam(modes=2), members=2, rate=40.0
    )
    design = problem.space.default
    winner = SimpleNamespace(design=design)
    findings: Any = SimpleNamespace(
        problem=problem, finished=True, verdict=SimpleNamespace(feasible=True, winner=winner)
    )
    run = WinnerRuns(findings).worst_run(Threads(1))
    assert run is not None
    worse, without = member_levels(problem, [design], problem.conditions, 2, Threads(1))
    assert run.response.level is not None
    assert run.response.level.value == worse.max()
    (part,) = WinnerRuns(findings).frequency_levels(Threads(1))
    own, none = part.curves
    assert (own.name, none.name) == ("winner, highest of 2 members", "no absorber")
    assert 0.97 * worse.max() < np.nanmax(own.level) < 1.2 * worse.max()
    assert 0.97 * without[0, 0] < np.nanmax(none.level) < 1.2 * without[0, 0]
    findings.finished = False
    assert WinnerRuns(findings).frequency_levels(Threads(1)) == []
    assert WinnerRuns(findings).worst_run(Threads(1)) is None
