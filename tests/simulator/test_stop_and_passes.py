"""Runs that are stopped, curves that come in passes, kernels that are prepared, and what a record keeps of its samples."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from core import drive_of
from places import ROOT

from impact_env import (
    Beam,
    CurveCase,
    Drive,
    Moreau,
    ParameterError,
    Pass,
    Record,
    RungeKutta,
    Stop,
    Stopped,
    TunedAbsorber,
    Window,
    beam_scene,
    constant_frequency,
    curve_passes,
    impact_absorber,
    modal_model,
    mode_shapes,
    performance_curve,
    prepare,
    simulate,
)
from impact_env.ensemble import Lane, run_lanes
from impact_env.methods import Method
from impact_env.parameters import Absorber

BEAM = Beam(modes=3)
SCENE = beam_scene(BEAM, impact_absorber(restitution=0.7, friction_limit=0.1))
LONG = Drive(3.5, constant_frequency(SCENE.model.resonance_omega(1), 1.0, 1e7))  # minutes, if nothing stops it
FORCES = [0.5, 1.0, 2.0, 3.0, 4.0]
FAST = 50.0  # % per 100 pseudo periods


def given_after(seconds: float) -> tuple[Stop, list[float]]:
    stop, at = Stop(), list[float]()

    def give() -> None:
        at.append(time.monotonic())
        stop.give()

    threading.Timer(seconds, give).start()
    return stop, at


@pytest.mark.parametrize(
    ("absorber", "method"),
    [(SCENE.absorber, None), (None, None), (TunedAbsorber(), None), (impact_absorber(), Moreau())],
    ids=["friction", "none", "tuned", "moreau"],
)
def test_a_run_ends_soon_after_its_stop(absorber: Absorber | None, method: Method | None) -> None:
    scene = beam_scene(BEAM, absorber)
    simulate(scene, drive_of(1.0, 1.0, 1.0, periods=2), method)  # compiled
    stop, at = given_after(0.3)
    with pytest.raises(Stopped) as told:
        simulate(scene, LONG, method, stop=stop)
    assert time.monotonic() - at[0] < 1.0  # microseconds on a machine that is not busy
    assert told.value.response is not None
    assert told.value.time is not None
    assert 0 < told.value.time < LONG.schedule.times[-1]
    with pytest.raises(Stopped):
        simulate(scene, LONG, method, stop=stop)  # given for good


def test_stopped_lanes_stay_open_and_finished_ones_are_whole() -> None:
    short = drive_of(1.0, 0.98, 1.0, periods=20)
    alone = simulate(SCENE, short).level
    stop, _ = given_after(0.5)
    levels = run_lanes([Lane(SCENE, short), Lane(SCENE, LONG), Lane(SCENE, LONG), Lane(SCENE, short)], threads=2, stop=stop)
    assert alone is not None
    assert levels.level[0] == alone.value
    assert np.isnan(levels.level[1:3]).all()
    assert not levels.complete


def test_passes_end_with_the_numbers_of_the_curve() -> None:
    case = CurveCase(SCENE, FORCES, limits=(0.98, 1.02), percent_per_100_periods=FAST)  # type: ignore[arg-type]
    passes = (Pass(3, 4.0), Pass(), Pass(members=2))
    last = dict(curve_passes(case, passes, seed=3, threads=2))
    assert list(last) == list(passes)
    for one, curve in last.items():
        wanted = performance_curve(SCENE, curve.forces, 1, one.members, 3, limits=case.limits, percent_per_100_periods=one.faster * FAST)
        np.testing.assert_array_equal(curve.level, wanted.level)
        np.testing.assert_array_equal(curve.lanes.impacts, wanted.lanes.impacts)
        assert curve.complete
    np.testing.assert_array_equal(last[passes[0]].forces, [0.5, 2.0, 4.0])


def test_partial_curves_only_gain_points() -> None:
    case = CurveCase(SCENE, np.linspace(0.5, 5.0, 12))
    parts = [~np.isnan(curve.level) for _, curve in curve_passes(case, [Pass(members=2)])]
    assert len(parts) > 2
    assert all(later[earlier].all() for earlier, later in pairwise(parts))
    assert not parts[0].all()
    assert parts[-1].all()


def test_a_linear_scene_runs_one_force_in_passes() -> None:
    scene = beam_scene(BEAM, TunedAbsorber())
    ((_, curve),) = curve_passes(CurveCase(scene, FORCES, percent_per_100_periods=FAST), [Pass()])  # type: ignore[arg-type]
    np.testing.assert_array_equal(curve.level, performance_curve(scene, FORCES, members=1, percent_per_100_periods=FAST).level)


@pytest.mark.parametrize("way", ["stop", "close"])
def test_passes_end_at_a_stop_and_with_their_reader(way: str) -> None:
    case = CurveCase(SCENE, np.linspace(0.5, 5.0, 24), percent_per_100_periods=0.002)  # minutes, if nothing stops it
    stop, at = given_after(0.3)
    passes = curve_passes(case, [Pass(4, 2e4), Pass()], stop if way == "stop" else None)
    one, curve = next(passes)
    assert one.faster == 2e4
    if way == "stop":
        *_, (_, curve) = passes
        assert np.isnan(curve.level).any()
    else:
        at[:] = [time.monotonic()]
        passes.close()
    assert time.monotonic() - at[0] < 2.0


def test_passes_refuse_what_runs_refuse() -> None:
    with pytest.raises(ParameterError, match="method = RungeKutta"):
        list(curve_passes(CurveCase(SCENE, FORCES), [Pass()], method=RungeKutta()))  # type: ignore[arg-type]


def test_an_envelope_and_a_window_are_those_of_the_samples() -> None:
    drive = drive_of(3.0, 0.98, 1.02, periods=30)
    whole = simulate(SCENE, drive, record=Record(events=True, series=True))
    end = drive.schedule.times[-1]
    part = simulate(SCENE, drive, record=Record(events=True, envelope=7, series=Window(0.25 * end, 0.5 * end)))
    assert whole.history is not None
    assert part.history is not None
    assert part.envelope is not None
    tip, times = whole.history.tip_displacement, whole.history.time
    inside = (times >= 0.25 * end) & (times <= 0.5 * end)
    np.testing.assert_array_equal(part.history.time, times[inside])
    np.testing.assert_array_equal(part.history.tip_displacement, tip[inside])
    np.testing.assert_array_equal(part.history.absorber_velocity, whole.history.absorber_velocity[inside])
    for k, (low, high) in enumerate(zip(part.envelope.edges, part.envelope.edges[1:], strict=False)):
        mine = tip[(times >= low) & ((times < high) | (k == 6))]
        assert (part.envelope.low[k], part.envelope.high[k]) == (mine.min(), mine.max())
    assert part.level == whole.level
    assert simulate(SCENE, drive, record=Record(events=True, envelope=3)).history is None


def test_an_envelope_is_that_of_the_levels_place() -> None:
    scene = beam_scene(Beam(modes=3, absorber_position=0.6, response_position=1.0), SCENE.absorber)
    response = simulate(scene, drive_of(3.0, 0.98, 1.02, periods=30), record=Record(events=True, envelope=5, series=True))
    assert response.envelope is not None
    assert response.history is not None
    end = response.history.modal_displacement @ modal_model(Beam(modes=3)).tip_shape
    assert (response.envelope.low.min(), response.envelope.high.max()) == pytest.approx((end.min(), end.max()), rel=1e-12)


def test_shapes_along_a_beam_are_those_of_its_model() -> None:
    beam = Beam(modes=4, absorber_position=0.7, ends="clamped-pinned")
    model, shapes = modal_model(beam), mode_shapes(beam, [0.0, beam.force_position, 0.7, 1.0])
    np.testing.assert_array_equal(shapes[1], model.force_shape)
    np.testing.assert_array_equal(shapes[2], model.tip_shape)
    assert not shapes[[0, 3]].any()
    for bad in ([-0.1], [1.1], [np.nan], "0.5"):
        with pytest.raises(ParameterError, match="positions"):
            mode_shapes(beam, bad)  # type: ignore[arg-type]


PREPARED = """
from impact_env import Beam, TunedAbsorber, beam_scene, is_ready, on_compile, prepare
scene, told = beam_scene(Beam(modes=2), TunedAbsorber()), []
on_compile(told.append)
before = is_ready(scene)
work = prepare(scene)
early = work.wait(0.0)
print(before, early, work.wait(120.0), work.done, is_ready(scene), len(told), 0.5 < work.elapsed == work.elapsed)
"""


def test_kernels_are_prepared_by_another_process(tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "IMPACT_ENV_CACHE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", PREPARED], env=environment, capture_output=True, text=True, timeout=200)
    assert done.stdout.split() == ["False", "False", "True", "True", "True", "0", "True"], done.stderr
    assert done.stderr == ""


def test_a_preparation_can_be_ended() -> None:
    work = prepare(SCENE)
    work.cancel()
    assert work.done
    assert not work.wait(0.0)
    with pytest.raises(ParameterError, match="method = RungeKutta"):
        prepare(SCENE, RungeKutta())
