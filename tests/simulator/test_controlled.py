import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from core import OMEGA, run, scene_of
from load_cases import record_of
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import DTypeLike

from impact_env import (
    Beam,
    CompliantWalls,
    Drive,
    ElasticCoulombFriction,
    Exact,
    FrequencySchedule,
    Moreau,
    ParameterError,
    Response,
    RungeKutta,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    impact_absorber,
    simulate,
)
from impact_env.controlled import ControlledRuns, WorkerPool, bind_kernel
from impact_env.drive import Pieces
from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.control.lanes import (
    new_work_queue,
    take_first_part,
    take_next_part,
    wait_until_done,
)
from impact_env.level import response_level
from impact_env.loads import BASE_QUANTITY, FORCE_QUANTITY, Loads, Random, ShakenBase
from impact_env.methods import Method

SAMPLES = 32


def controlled(
    scene: Scene, method: Method, force: float, ratios: list[float], interval: float, lanes: int = 1
) -> tuple[ControlledRuns, FrequencySchedule]:
    omega = scene.model.resonance_omega(1)
    runs = ControlledRuns(
        scene, lanes, omega, interval, method, samples_per_period=SAMPLES, threads=1
    )
    runs.orders["force"] = force
    for k, (before, after) in enumerate(pairwise(ratios)):
        runs.orders["omega_start"] = before * omega
        runs.orders["omega_stop"] = after * omega
        runs.orders["final"] = k == len(ratios) - 2
        runs.advance()
    times = runs.duration * np.arange(len(ratios))
    return runs, FrequencySchedule(times, np.array(ratios) * omega, omega)


def whole(
    scene: Scene, method: Method, force: float, schedule: FrequencySchedule
) -> tuple[Response, float]:
    """Return the response and its level.

    The records are those of the other tests, so that no kernel is compiled for this test alone.
    """
    response = run(scene, Drive(force, schedule), method, samples=SAMPLES)
    return response, response_level(response.history.tip_displacement, SAMPLES)[0]


RATIOS = [0.97, 0.975, 0.972, 0.98, 0.98, 0.99, 0.985, 0.999, 1.0]
COMPLIANT = SlidingAbsorber(walls=CompliantWalls(1e5), friction=ElasticCoulombFriction(0.1, 1e5))


@pytest.mark.parametrize(
    ("absorber", "force", "digits", "ratios"),
    [
        (None, 1.5, 1e-12, RATIOS),
        (StuckAbsorber(), 1.5, 1e-12, RATIOS),
        (TunedAbsorber(), 1.5, 1e-12, RATIOS),
        (impact_absorber(), 1.4, 1e-7, RATIOS),  # impacts are few: each amplifies rounding
        (impact_absorber(restitution=0.7, friction_limit=0.1), 2.0, 1e-6, RATIOS),
        (SlidingAbsorber(walls=CompliantWalls(1e5)), 1.7, 1e-7, RATIOS),
        pytest.param(COMPLIANT, 6.0, 1e-9, RATIOS[1:4], marks=pytest.mark.plain),
    ],
)
def test_intervals_make_the_run_that_a_single_call_makes(
    absorber: SlidingAbsorber | None, force: float, digits: float, ratios: list[float]
) -> None:
    scene = scene_of(absorber)
    runs, schedule = controlled(scene, Exact(), force, ratios, 2.5)
    response, level = whole(scene, Exact(), force, schedule)
    assert runs.reports["level"][0] == pytest.approx(level, rel=digits)
    scale = np.max(np.abs(response.end_state))
    np.testing.assert_allclose(runs.state[0], response.end_state, rtol=0, atol=digits * scale)
    if isinstance(absorber, SlidingAbsorber) and absorber.walls is not None:
        assert response.impact_count > 1


@pytest.mark.parametrize(
    ("absorber", "moves_base"),
    [
        pytest.param(None, False, marks=pytest.mark.plain),
        (impact_absorber(5e-5, 0.7, 0.1), True),
    ],
)
def test_a_record_added_to_the_force_makes_the_run_of_both_loads(
    absorber: SlidingAbsorber | None, moves_base: bool
) -> None:
    """From a place within a step, over the record's end."""
    scene = scene_of(absorber, modes=2)
    first = 30.3
    quantity = FORCE_QUANTITY if moves_base else BASE_QUANTITY
    omega = scene.model.resonance_omega(1)
    ratios = np.linspace(0.97, 0.98, 3)
    record = Random(np.array([[20.0, 0.02], [60.0, 0.02]]), 0.05, 3, quantity).record()
    runs = ControlledRuns(
        scene, 1, omega, 1.0, samples_per_period=SAMPLES, record=record, moves_base=moves_base
    )
    runs.orders["force"] = 1.5
    runs.orders["phase"] = 0.3
    runs.orders["place"] = first
    for before, after in pairwise(ratios):
        runs.orders["omega_start"] = before * omega
        runs.orders["omega_stop"] = after * omega
        runs.advance()
    end = runs.duration * 2
    step = record.times[1]
    schedule = FrequencySchedule(runs.duration * np.arange(3), ratios * omega, omega)
    sweep = (
        ShakenBase(schedule, acceleration=1.5, phase=0.3)
        if moves_base
        else Drive(1.5, schedule, 0.3)
    )
    times = np.concatenate([[0.0], (np.arange(31, first + end / step) - first) * step, [end]])

    class Cut(Random):
        """The part of the record that the lane meets, whose first and last steps are shorter."""

        @property
        def duration(self) -> float:
            return float(end)

        def pieces(self) -> list[Pieces]:
            places = np.mod(first + times / step, len(record.values) - 1)
            values = np.interp(places, np.arange(len(record.values)), record.values)
            rows = np.zeros((len(times) - 1, 9))
            rows[:, 3] = values[:-1]
            rows[:, 5] = np.diff(values) / np.diff(times)
            return [Pieces(times, rows, quantity == BASE_QUANTITY)]

    loads = Loads((sweep, Cut(np.array([[20.0, 0.02], [60.0, 0.02]]), 0.05, 3, quantity)), omega)
    response = simulate(scene, loads, record=replace(record_of(scene), samples_per_period=SAMPLES))
    np.testing.assert_allclose(runs.state[0], response.end_state, rtol=0, atol=1e-9)
    assert absorber is None or response.impact_count > 1


@pytest.mark.parametrize(
    ("absorber", "method"),
    [(impact_absorber(), Moreau()), (SlidingAbsorber(walls=CompliantWalls(1e5)), RungeKutta())],
)
def test_stepping_methods_go_on_from_interval_to_interval(
    absorber: SlidingAbsorber | None, method: Method
) -> None:
    """Steps are fitted to an interval, so those of a whole run are a little longer."""
    scene = scene_of(absorber, modes=2)
    runs, schedule = controlled(scene, method, 1.5, [0.97, 0.98, 0.975], 5.0)
    response, level = whole(scene, method, 1.5, schedule)
    assert runs.reports["level"][0] == pytest.approx(level, rel=2e-3)
    assert runs.reports["tip"][0] == pytest.approx(
        scene.model.tip_shape @ response.end_state[:2], rel=0.02
    )


def test_lanes_do_not_depend_on_threads_or_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impact_env.controlled.LANES_PER_THREAD", 2)
    scene = scene_of(impact_absorber(restitution=0.8))
    omega = scene.model.resonance_omega(1)
    results = []
    for threads, order in ((1, 1), (2, 1), (5, 1), (3, -1)):
        runs = ControlledRuns(scene, 24, omega, 1.0, samples_per_period=SAMPLES, threads=threads)
        runs.orders["force"] = np.linspace(1, 4, 24)[::order]
        runs.orders["omega_start"] = runs.orders["omega_stop"] = omega
        for _ in range(20):
            runs.advance()
        assert runs.reports["impact_count"].max() > 0
        results.append(
            np.concatenate([structured_to_unstructured(runs.reports), runs.state], axis=1)[::order]
        )
        runs.close()
    for other in results[1:]:
        np.testing.assert_array_equal(other, results[0])


@jit
def count_up(counts, queue, parts, patience):
    """Count each lane of the parts taken; return whether all are done."""
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        for lane in range(queue.cuts[part, 0], queue.cuts[part, 1]):
            counts[lane] += 1
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@pytest.mark.parametrize("dtype", [np.float64, np.int32])
def test_memory_of_another_type_is_not_handed_to_machine_code(dtype: DTypeLike) -> None:
    counts = np.zeros(40, dtype=np.int64)
    queue = new_work_queue(40)
    count_up(counts, queue, 0, 0)
    bind_kernel(partial(count_up, counts, queue))(0, 0)
    for wrong in (np.zeros(40, dtype), np.zeros(80, np.int64)[::2]):
        with pytest.raises(TypeError, match="count_up"):
            bind_kernel(partial(count_up, wrong, queue))


@pytest.mark.parametrize("helpers", [0, 1, 3])
def test_every_part_is_done_once_in_every_call(helpers: int) -> None:
    counts = np.zeros(40, dtype=np.int64)
    queue = new_work_queue(40)
    pool = WorkerPool(lambda: partial(count_up, counts, queue), queue)
    shares = [
        np.array(cuts).repeat(2)[1:-1].reshape(-1, 2)
        for cuts in ([0, 3, 4, 20, 40], list(range(41)), [0, 40], [0])
    ]
    for call in range(2000):
        pool.work(shares[call % 4], helpers)
        np.testing.assert_array_equal(counts, call + 1 - (call + 1) // 4)
        if call % 500 == 0:
            time.sleep(2e-3)  # longer than helpers stay
        if call % 400 == 0:
            pool.close()  # and they start again
    pool.close()
    pool.close()


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("first", [True, False], ids=["in the calling thread", "in a helper"])
def test_a_call_that_breaks_off_leaves_nobody_at_work(
    error: type[BaseException], first: bool
) -> None:
    counts = np.zeros(8, dtype=np.int64)
    queue = new_work_queue(8)
    both = threading.Barrier(2)
    parts = np.arange(9).repeat(2)[1:-1].reshape(8, 2)

    def breaks_off(number: int, patience: int) -> bool:
        taken = take_first_part(queue, number, patience)
        both.wait(10.0)  # two threads are at work
        if (number > 0) == first:
            raise error
        time.sleep(0.02)
        counts[taken] += 1
        return False

    kernels: list[Callable[[int, int], bool]] = [breaks_off]

    def take(number: int, patience: int) -> bool:
        return kernels[-1](number, patience)

    pool = WorkerPool(lambda: take, queue)
    with pytest.raises(error):
        pool.work(parts, 1)
    assert counts.sum() == 1  # the other thread's part was waited for
    counts[:] = 0
    kernels.append(partial(count_up, counts, queue))
    for call in range(1, 300):
        pool.work(parts, 1)
        np.testing.assert_array_equal(counts, call)
    pool.close()


def test_amplitudes_are_those_of_the_linear_response() -> None:
    scene = scene_of()
    omega = scene.model.resonance_omega(1)
    runs, _ = controlled(scene, Exact(), 1.0, [0.95] * 121, 20.0)
    model = scene.model
    steady = np.sum(
        model.force_shape
        * model.tip_shape
        / (
            model.omega**2
            - (0.95 * omega) ** 2
            + 2j * model.damping_ratio * model.omega * 0.95 * omega
        )
    )
    assert runs.reports["in_phase"][0] == pytest.approx(steady.real, rel=1e-3)
    assert runs.reports["quadrature"][0] == pytest.approx(-steady.imag, rel=2e-2)
    assert runs.reports["mean_square"][0] == pytest.approx(abs(steady) ** 2 / 2, rel=1e-3)


def test_energy_share_and_relative_motion_follow_from_the_state() -> None:
    scene = scene_of(impact_absorber())
    runs, _ = controlled(scene, Exact(), 3.0, RATIOS, 2.5)
    state = runs.state[0]
    model = scene.model
    q = state[:3]
    absorber = state[3]
    u = state[4:7]
    velocity = state[7]
    energy = np.array([np.sum((model.omega * q) ** 2 + u**2), scene.absorber_mass * velocity**2])
    assert runs.reports["absorber_share"][0] == pytest.approx(energy[1] / energy.sum(), rel=1e-12)
    assert runs.reports["distance"][0] == pytest.approx(absorber - model.tip_shape @ q, rel=1e-9)
    assert runs.reports["relative_velocity"][0] == pytest.approx(
        velocity - model.tip_shape @ u, rel=1e-9
    )
    assert abs(runs.reports["distance"][0]) <= 1e-3 * (1 + 1e-9)


@pytest.mark.parametrize(("method", "limit"), [(Exact(), None), (Exact(), 0.1), (Moreau(), None)])
def test_walls_that_move_never_close_onto_the_absorber(method: Method, limit: float | None) -> None:
    scene = scene_of(impact_absorber(restitution=0.3, friction_limit=limit))
    omega = scene.model.resonance_omega(1)
    runs = ControlledRuns(scene, 3, omega, 0.5, method, samples_per_period=SAMPLES, threads=1)
    runs.orders["force"] = 4.0
    runs.orders["omega_start"] = runs.orders["omega_stop"] = omega
    generator = np.random.default_rng(3)
    raised = 0
    tolerance = (
        1e-15 if isinstance(method, Exact) else 1e-4
    )  # m: the Moreau scheme notices an impact at the end of a step
    for _ in range(300):
        wanted = generator.uniform(1e-4, 2e-3, 3)
        runs.orders["gap"] = wanted
        runs.advance()
        gap = runs.orders["gap"]
        assert np.all(gap >= wanted)
        assert np.all(np.abs(runs.reports["distance"]) <= gap + tolerance)
        raised += int(np.sum(gap > wanted))
    assert 30 < raised < 870


def test_absorber_held_by_a_wall_is_released_when_the_wall_moves_away() -> None:
    """An absorber held by a wall is released when the wall moves away.

    A slow, strong force presses an absorber without rebound to the wall. When the cavity becomes
    wider, the absorber moves on.
    """
    scene = scene_of(impact_absorber(restitution=0.0), modes=1)
    omega = scene.model.resonance_omega(1)
    runs = ControlledRuns(scene, 1, omega, 0.25, samples_per_period=SAMPLES, threads=1)
    runs.orders["force"] = 6.0
    runs.orders["omega_start"] = runs.orders["omega_stop"] = omega
    for _ in range(200):
        runs.orders["gap"][0] = 1e-3
        runs.advance()
        if runs.reports["relative_velocity"][0] == 0.0:
            break
    assert runs.reports["relative_velocity"][0] == 0.0
    assert abs(runs.reports["distance"][0]) == pytest.approx(1e-3)
    runs.orders["gap"][0] = 4e-3
    runs.advance()
    assert runs.reports["relative_velocity"][0] != 0.0
    assert runs.reports["distance"][0] != pytest.approx(1e-3, rel=1e-6)
    assert runs.reports["impact_count"][0] == 0


@pytest.mark.parametrize("threads", [1, 2])
def test_idle_lanes_rest_and_the_others_go_on_as_before(threads: int) -> None:
    scene = beam_scene(Beam(modes=2), impact_absorber(friction_limit=0.025))
    lanes = 160
    omega = scene.model.resonance_omega(1)
    idle = np.zeros(lanes, dtype=np.bool_)
    idle[[0, 3, 4, 5, 90, 159]] = True
    free, partly = (
        ControlledRuns(scene, lanes, omega, 2.0, samples_per_period=32, threads=threads)
        for _ in range(2)
    )
    for runs in (free, partly):
        runs.orders["force"] = np.linspace(0.5, 3.0, lanes)
        runs.orders["omega_start"] = runs.orders["omega_stop"] = omega
        runs.advance()
    before = partly.state.copy()
    partly.idle = idle
    for _ in range(3):
        free.advance()
        partly.advance()
    np.testing.assert_array_equal(partly.state[idle], before[idle])
    np.testing.assert_array_equal(partly.state[~idle], free.state[~idle])
    np.testing.assert_array_equal(partly.reports[~idle], free.reports[~idle])
    assert not np.array_equal(free.state[idle], before[idle])


FAMILIES: dict[str, tuple[SlidingAbsorber | TunedAbsorber | None, Method]] = {
    "rigid": (impact_absorber(friction_limit=0.1), Exact()),
    "without friction": (impact_absorber(), Exact()),
    "linear": (None, Exact()),
    "compliant": (SlidingAbsorber(walls=CompliantWalls(1e5)), Exact()),
    "Moreau": (impact_absorber(), Moreau()),
    "Runge-Kutta": (SlidingAbsorber(walls=CompliantWalls(1e5)), RungeKutta()),
}


def orderly(name: str) -> ControlledRuns:
    absorber, method = FAMILIES[name]
    runs = ControlledRuns(
        scene_of(absorber, modes=1), 2, OMEGA, 1.25, method, samples_per_period=8, threads=1
    )
    runs.orders["omega_start"] = runs.orders["omega_stop"] = OMEGA
    return runs


@pytest.mark.parametrize(
    "interval", [1.3, 0.01, 20.0 / 0.95, 0.0, -1.0, np.nan, np.inf], ids="{:.3g}".format
)
def test_an_interval_is_a_whole_number_of_samples(interval: float) -> None:
    with pytest.raises(ParameterError, match="interval"):
        ControlledRuns(scene_of(), 1, OMEGA, interval, samples_per_period=8)


@pytest.mark.parametrize("name", FAMILIES)
def test_an_interval_that_is_longer_than_the_longest_is_refused(name: str) -> None:
    """An interval that is longer than the longest one is refused.

    The memory for its samples has the length of the longest interval. The other lane can advance,
    but this one does not.
    """
    runs = orderly(name)
    for duration in (runs.duration * (1 + 1e-6), 3 * runs.duration, 0.0, -1.0, np.nan, np.inf):
        before = runs.state[1].copy()
        runs.orders["duration"] = runs.duration, duration
        with pytest.raises(ParameterError, match=r'orders\["duration"\]\[1\] = .*at most the long'):
            runs.advance()
        np.testing.assert_array_equal(runs.state[1], before)
    runs.orders["duration"] = runs.duration, 0.3 * runs.duration
    runs.advance()


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("without friction", "limit"),
        ("linear", "gap"),
        ("linear", "limit"),
        ("linear", "place"),
        ("compliant", "gap"),
        ("compliant", "limit"),
        ("Moreau", "limit"),
        ("Runge-Kutta", "gap"),
    ],
)
def test_an_order_that_a_scene_would_ignore_is_refused(name: str, order: str) -> None:
    runs = orderly(name)
    runs.advance()
    runs.orders[order][1] = 0.5
    with pytest.raises(ParameterError, match=rf'orders\["{order}"\]\[1\] = 0.5 .* in this scene'):
        runs.advance()


def test_a_place_in_a_record_is_a_number() -> None:
    record = Random(np.array([[20.0, 0.02], [60.0, 0.02]]), 0.05, 3, FORCE_QUANTITY).record()
    scene = scene_of(impact_absorber(5e-5, 0.7, 0.1))  # a kind of kernel that others need, too
    runs = ControlledRuns(
        scene, 1, OMEGA, 1.0, samples_per_period=8, record=record, moves_base=True
    )
    runs.orders["place"] = np.nan
    with pytest.raises(ParameterError, match="place"):
        runs.advance()
