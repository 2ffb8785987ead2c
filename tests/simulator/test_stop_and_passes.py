"""Runs can be stopped, and curves are computed in passes.

Samples in records, and friction limits that change from interval to interval, are tested too.
"""

import threading
import time
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from core import EVERYTHING, OMEGA, drive_of, scene_of

from impact_env import (
    Beam,
    CurveCase,
    Drive,
    FrequencySchedule,
    InitialState,
    Moreau,
    ParameterError,
    Pass,
    Scene,
    SlidingAbsorber,
    Stop,
    Stopped,
    Window,
    beam_scene,
    constant_frequency,
    curve_passes,
    friction_damper,
    impact_absorber,
    mode_shapes,
    performance_curve,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.ensemble import Lane, run_lanes
from impact_env.kernels.exact.rigid_contact import FREE
from impact_env.methods import Method
from impact_env.parameters import Absorber
from reference import dense

BEAM = Beam(modes=3)
SCENE = beam_scene(BEAM, impact_absorber(restitution=0.7, friction_limit=0.1))
LONG = Drive(
    3.5, constant_frequency(SCENE.model.resonance_omega(1), 1.0, 1e7)
)  # minutes, if nothing stops it
FORCES = [0.5, 1.0, 2.0, 3.0, 4.0]
FAST = 50.0  # % per 100 pseudo periods


def stop_after(seconds: float) -> Stop:
    stop = Stop()
    threading.Timer(seconds, stop.give).start()
    return stop


@pytest.mark.parametrize(
    ("absorber", "method"),
    [(SCENE.absorber, None), (None, None), (impact_absorber(), Moreau())],
    ids=["friction", "none", "moreau"],
)
def test_a_run_ends_soon_after_its_stop(absorber: Absorber | None, method: Method | None) -> None:
    scene = beam_scene(BEAM, absorber)
    simulate(scene, drive_of(1.0, 1.0, 1.0, periods=2), method)  # compiled
    stop = stop_after(0.3)
    with pytest.raises(Stopped) as raised:
        simulate(scene, LONG, method, stop=stop)
    assert raised.value.response is not None
    assert 0 < raised.value.time < LONG.schedule.times[-1]
    with pytest.raises(Stopped):
        simulate(scene, LONG, method, stop=stop)  # given for good


def test_stopped_lanes_stay_open_and_finished_ones_are_whole() -> None:
    short = drive_of(1.0, 0.98, 1.0, periods=20)
    alone = simulate(SCENE, short).level
    stop = stop_after(0.5)
    levels = run_lanes(
        [Lane(SCENE, short), Lane(SCENE, LONG), Lane(SCENE, LONG), Lane(SCENE, short)],
        threads=2,
        stop=stop,
    )
    assert levels.level[0] == alone.value
    assert np.isnan(levels.level[1:3]).all()
    assert not levels.complete


def test_passes_end_with_the_numbers_of_the_curve_and_partial_curves_only_gain_points() -> None:
    case = CurveCase(SCENE, FORCES, limits=(0.98, 1.02), percent_per_100_periods=FAST)
    passes = (Pass(3, 4.0), Pass(), Pass(members=2))
    curves = list(curve_passes(case, passes, seed=3, threads=2))
    assert [one for one, curve in curves if curve.complete] == list(passes)
    for one, curve in dict(curves).items():
        wanted = performance_curve(
            SCENE,
            curve.forces,
            1,
            one.members,
            3,
            limits=case.limits,
            percent_per_100_periods=one.faster * FAST,
        )
        np.testing.assert_array_equal(curve.level, wanted.level)
        np.testing.assert_array_equal(curve.lanes.impacts, wanted.lanes.impacts)
    np.testing.assert_array_equal(curves[0][1].forces, [0.5, 2.0, 4.0])
    parts = [
        ~np.isnan(curve.level)
        for _, curve in curve_passes(CurveCase(SCENE, np.linspace(0.5, 5.0, 12)), [Pass(members=2)])
    ]
    assert len(parts) > 2
    assert all(later[earlier].all() for earlier, later in pairwise(parts))
    assert not parts[0].all()


def test_a_load_without_a_direction_is_run_once() -> None:
    case = CurveCase(SCENE, FORCES, limits=(0.98, 1.02), percent_per_100_periods=FAST)
    runs = []

    def measure(lane: Lane, stop: Stop) -> tuple[float, ...]:
        runs.append((lane, stop))
        return (lane.drive.amplitude * len(runs), *5 * [0.0])

    *_, (_, curve) = curve_passes(
        case, [Pass(), Pass(members=2)], threads=1, measure=measure, both_ways=False
    )
    assert len(runs) == 2 * len(FORCES)
    assert curve.complete
    np.testing.assert_array_equal(curve.level[..., 0], curve.level[..., 1])


@pytest.mark.parametrize("way", ["stop", "close"])
def test_passes_end_at_a_stop_and_with_their_reader(way: str) -> None:
    case = CurveCase(
        SCENE, np.linspace(0.5, 5.0, 24), percent_per_100_periods=0.002
    )  # minutes, if nothing stops it
    passes = curve_passes(case, [Pass(4, 2e4), Pass()], stop_after(0.3) if way == "stop" else None)
    one, curve = next(passes)
    assert one.faster == 2e4
    if way == "stop":
        *_, (_, curve) = passes
        assert np.isnan(curve.level).any()
    else:
        began = time.monotonic()
        passes.close()
        assert time.monotonic() - began < 20.0


def test_an_envelope_and_a_window_are_those_of_the_samples() -> None:
    drive = drive_of(3.0, 0.98, 1.02, periods=30)
    whole = simulate(SCENE, drive, record=EVERYTHING)
    end = drive.schedule.times[-1]
    part = simulate(
        SCENE, drive, record=replace(EVERYTHING, envelope=7, series=Window(0.25 * end, 0.5 * end))
    )
    tip = whole.history.tip_displacement
    times = whole.history.time
    inside = (times >= 0.25 * end) & (times <= 0.5 * end)
    for name in ("time", "tip_displacement", "absorber_velocity"):
        np.testing.assert_array_equal(
            getattr(part.history, name), getattr(whole.history, name)[inside]
        )
    for k, (low, high) in enumerate(
        zip(part.envelope.edges, part.envelope.edges[1:], strict=False)
    ):
        mine = tip[(times >= low) & ((times < high) | (k == 6))]
        # the level's samples, which are summed in another order
        envelope = [part.envelope.low[k], part.envelope.high[k]]
        np.testing.assert_allclose(envelope, [mine.min(), mine.max()], rtol=1e-13)
    assert part.level == whole.level
    assert (
        simulate(SCENE, drive, record=replace(EVERYTHING, envelope=3, series=False)).history is None
    )


def test_shapes_along_a_beam_are_those_of_its_model() -> None:
    beam = Beam(modes=4, absorber_position=0.7, ends="clamped-pinned")
    model = beam_scene(beam).model
    shapes = mode_shapes(model.beam, [0.0, beam.force_position, 0.7, 1.0])
    np.testing.assert_array_equal(shapes[1], model.force_shape)
    np.testing.assert_array_equal(shapes[2], model.tip_shape)
    assert not shapes[[0, 3]].any()
    with pytest.raises(ParameterError, match="positions"):
        mode_shapes(beam, [1.1])


# A friction limit that is another one from interval to interval: against references restarted where
# it changes, and against fixed limits.


# of an interval: short, so that many limits change
SAMPLES = 32
PERIODS = 0.75
ABSORBERS = {
    "damper": friction_damper(0.3),
    "impacts": impact_absorber(restitution=0.6, friction_limit=0.1),
    "dead": impact_absorber(1e-3, 0.0, 0.1),
}


def lanes_of(
    scene: Scene, lanes: int, method: Method | None = None, force: float = 3.0
) -> ControlledRuns:
    runs = ControlledRuns(
        scene, lanes, OMEGA, PERIODS, method, samples_per_period=SAMPLES, threads=1
    )
    runs.orders["force"] = np.linspace(0.5, 1.0, lanes) * force
    runs.orders["phase"] = np.linspace(0.0, 3.0, lanes)
    runs.orders["omega_start"] = 0.98 * OMEGA
    runs.orders["omega_stop"] = 0.99 * OMEGA
    return runs


def drive_of_order(order: Any) -> Drive:
    schedule = FrequencySchedule(
        np.array([0.0, order.duration]), np.array([order.omega_start, order.omega_stop]), OMEGA
    )
    return Drive(float(order.force), schedule, float(order.phase))


def start_of(state: np.ndarray) -> InitialState:
    modes = len(state) // 2 - 1
    return InitialState(state[:modes], state[modes + 1 : -1], state[modes], state[-1])


def with_limit(scene: Scene, limit: float) -> Scene:
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return Scene(
        scene.model,
        SlidingAbsorber(absorber.mass_ratio, absorber.walls, type(absorber.friction)(limit)),
    )


def reference(scene: Scene, state: np.ndarray, order: Any, share: float = 1.0) -> np.ndarray:
    """Return the dense reference's state after an interval, or a share of it.

    The reference starts again at each interval, so it decides itself which absorbers are joined or
    slide.
    """
    truth = dense.follow(
        scene,
        drive_of_order(order),
        start_of(state),
        np.array([0.0, share * order.duration]),
        most_events=1000,
    )
    assert truth.complete
    return truth.states[-1]


def assert_close(state: np.ndarray, truth: np.ndarray) -> None:
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(
            state[part], truth[part], rtol=0, atol=1e-8 * np.max(np.abs(truth[part]))
        )


@pytest.mark.parametrize("name", ABSORBERS)
def test_each_interval_is_that_of_a_reference_with_the_new_limit(name: str) -> None:
    scene = scene_of(ABSORBERS[name], modes=2)
    generator = np.random.default_rng(4)
    runs = lanes_of(scene, 1)
    regimes = set()
    impacts = 0
    before = np.inf
    for _ in range(30 if name == "damper" else 60):
        limit = float(0.02 * 150 ** generator.uniform())  # to 3 N
        runs.orders["limit"] = limit
        start = runs.state[0].copy()
        order = runs.orders[0].copy()
        joined = runs._memory.rigid[0].regime != FREE
        runs.advance()
        limited = with_limit(scene, limit)
        truth = reference(limited, start, order)
        first = reference(limited, start, order, 1e-3)
        assert_close(runs.state[0], truth)
        slides = abs(first[-1] - scene.model.tip_shape @ first[3:5]) > 1e-12 * np.max(
            np.abs(truth[3:])
        )
        regimes.add(
            (
                "joined" if joined else "sliding",
                "raised" if limit > before else "lowered",
                "slides" if slides else "holds",
            )
        )
        impacts += runs.reports["impact_count"][0]
        before = limit
    wanted = {
        ("joined", "lowered", "holds"),
        ("joined", "lowered", "slides"),
        ("sliding", "lowered", "slides"),
        ("sliding", "raised", "slides"),
    }
    assert (
        regimes >= wanted
        if name == "damper"
        else regimes >= wanted - {("joined", "lowered", "holds")}
    )
    assert (impacts > 10) == (name != "damper")


def test_the_stepping_scheme_takes_new_limits_as_the_exact_method_does() -> None:
    scene = scene_of(ABSORBERS["damper"], modes=1)
    exact = lanes_of(scene, 1)
    steps = lanes_of(scene, 1, Moreau(2000))
    for limit in (0.3, 0.05, 1.0, 0.02, 0.3, 5.0, 0.1):
        for runs in (exact, steps):
            runs.orders["limit"] = limit
            runs.advance()
    scale = np.max(np.abs(exact.state[0]))
    np.testing.assert_allclose(steps.state[0], exact.state[0], rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize(
    ("absorber", "amplitude"),
    [(friction_damper(0.3), 4.0), (impact_absorber(1e-3, 0.0), 20.0)],
    ids=["friction", "walls"],
)
def test_a_joined_absorber_is_let_go_where_the_force_jumps(
    absorber: SlidingAbsorber, amplitude: float
) -> None:
    """Whatever the force's phase at the jump; the reference finds for itself what can be held."""
    scene = scene_of(absorber, modes=2)
    lanes = 24
    runs = lanes_of(scene, lanes)
    runs.orders["force"] = 0.2 if absorber.walls is None else 6.0
    runs.orders["phase"] = 0.26 * np.arange(lanes)
    for _ in range(6 if absorber.walls is None else 40):
        runs.advance()
    held = np.flatnonzero(runs._memory.rigid["regime"] != FREE)
    assert len(held) > (20 if absorber.walls is None else 4)
    runs.orders["force"] = amplitude
    starts = runs.state.copy()
    orders = runs.orders.copy()
    runs.advance()
    for lane in held.tolist():
        assert_close(runs.state[lane], reference(scene, starts[lane], orders[lane]))
