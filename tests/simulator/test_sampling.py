"""Levels require enough samples under each excitation.

Start states with strikes, and results that are computed during the run instead of from a stored
one, are tested too.
"""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from core import OMEGA, PERIOD, drive_of, scene_of, steady_base
from load_cases import cantilever

from impact_env import (
    Beam,
    Drive,
    Exact,
    InitialState,
    ParameterError,
    Record,
    Scene,
    beam_scene,
    impact_absorber,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import Excitation, FrequencySchedule, Load, constant_frequency, linear_sweep
from impact_env.ensemble import Lane, run_lanes
from impact_env.level import require_sampled, response_level, response_spectrum
from impact_env.loads import (
    BASE_QUANTITY,
    FORCE_QUANTITY,
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
)
from impact_env.methods import Method, Moreau, RungeKutta
from impact_env.parameters import CompliantWalls, SlidingAbsorber
from impact_env.results import Window
from impact_env.sweep import EventRecorder
from optimisation.measures import RMS, Chunk, measure, measure_lane

MODEL = cantilever()
SCENE = Scene(MODEL)
W1 = float(MODEL.omega[0])
RATIO = 9.0  # of the force, with 8 samples a pseudo period: fewer than one a cycle
LENGTH = 40 * 2 * np.pi / W1
FAST = constant_frequency(W1, RATIO, 40)
SLOW = constant_frequency(W1, RATIO / 3, 40)
UP = FrequencySchedule(np.array([0.0, LENGTH]), np.array([0.5, RATIO]) * W1, W1)
CLOCK = np.linspace(0.0, LENGTH, 40 * 9 * 20 + 1)
SINE = np.sin(RATIO * W1 * CLOCK)
HERTZ = RATIO * W1 / (2 * np.pi)
BAND = np.array([[0.98 * HERTZ, 1.0], [1.02 * HERTZ, 1.0]])


def loads(*parts: Load, reference: float = W1) -> Loads:
    return Loads(parts, reference)


SLOWLY = W1 / RATIO  # a reference: the structure's first mode is nine times as fast
EXCITATIONS: dict[str, Excitation] = {
    "drive": Drive(1.0, FAST),
    "sweep": Drive(1.0, UP),
    "force": loads(Drive(1.0, FAST)),
    "force of a sweep": loads(Drive(1.0, UP)),
    "tone": loads(Tones((Tone(1.0, frequency=HERTZ),), LENGTH)),
    "one of two tones": loads(
        Tones((Tone(1.0, frequency=HERTZ / RATIO), Tone(1.0, frequency=HERTZ)), LENGTH)
    ),
    "order": loads(Tones((Tone(1.0, order=1), Tone(1.0, order=3)), schedule=SLOW)),
    "tone of the base": loads(Tones((Tone(1.0, frequency=HERTZ),), LENGTH, quantity=BASE_QUANTITY)),
    "unbalance": loads(Unbalance(1e-3, FAST)),
    "shaken base": loads(ShakenBase(FAST, acceleration=1.0)),
    "moved base": loads(ShakenBase(UP, displacement=1e-4)),
    "record": loads(Samples(CLOCK, SINE)),
    "record of the base": loads(Samples(CLOCK, SINE, BASE_QUANTITY)),
    "record beside a force": loads(Drive(1.0, constant_frequency(W1, 1, 40)), Samples(CLOCK, SINE)),
    "random": loads(Random(BAND, LENGTH)),
    "random base": loads(Random(BAND, LENGTH, quantity=BASE_QUANTITY)),
    "shock": loads(Shock("half-sine", 1.0, 1e-3, LENGTH), reference=SLOWLY),
    "shock of the base": loads(
        Shock("triangle", 1.0, 1e-3, LENGTH, quantity=BASE_QUANTITY), reference=SLOWLY
    ),
    "strike": loads(Strike(0.1, LENGTH, "absorber"), reference=SLOWLY),
}
FEW = 8
# four a cycle of the second mode, which a short shock moves, in a pseudo period of a ninth of the
# first frequency
ENOUGH = 250
REFUSED = "samples_per_period = 8 is not allowed: .* or more for the level"


@pytest.mark.parametrize("name", EXCITATIONS)
def test_every_excitation_with_too_few_samples_of_its_motion_is_refused(name: str) -> None:
    drive = EXCITATIONS[name]
    for record in (
        Record(samples_per_period=FEW),
        Record(samples_per_period=FEW, series=Window(0.0, 1.0)),
        Record(samples_per_period=FEW, level=False, envelope=5),
    ):
        with pytest.raises(ParameterError, match=REFUSED):
            simulate(SCENE, drive, record=record)
    with pytest.raises(ParameterError, match=rf"lane 1 .*{REFUSED}"):
        run_lanes([Lane(SCENE, Drive(0.0, FAST)), Lane(SCENE, drive)], samples_per_period=FEW)
    with pytest.raises(ParameterError, match=REFUSED):
        require_sampled(SCENE, drive, FEW)
    require_sampled(SCENE, drive, ENOUGH)


def test_what_asks_for_no_level_has_any_sampling() -> None:
    record = Record(level=False, series=True, samples_per_period=FEW)
    assert simulate(SCENE, EXCITATIONS["force"], record=record).level is None
    assert simulate(SCENE, Drive(0.0, FAST), record=Record(samples_per_period=FEW)).level.value == 0


def test_curves_controlled_runs_and_measures_are_refused_alike() -> None:
    def fast(amplitude: float, schedule: FrequencySchedule) -> Loads:
        order = Tones((Tone(amplitude, order=RATIO),), schedule=schedule)
        return Loads((order,))

    case = CurveCase(SCENE, [1.0], load=fast, percent_per_100_periods=100.0)
    with pytest.raises(ParameterError, match="samples_per_period = 8"):
        performance_curves([case], 1, samples_per_period=FEW)

    def runs(record: Samples | None = None) -> ControlledRuns:
        return ControlledRuns(SCENE, 2, W1, 1.0, samples_per_period=FEW, record=record)

    for record in (Samples(CLOCK, SINE), Samples(CLOCK, SINE, BASE_QUANTITY)):
        with pytest.raises(ParameterError, match=REFUSED):
            runs(record)
    controlled = runs()
    controlled.orders["omega_start"] = controlled.orders["omega_stop"] = RATIO * W1
    controlled.orders["force"] = [0.0, 1.0]
    with pytest.raises(ParameterError, match=REFUSED):
        controlled.advance()
    faster = Loads((Tones((Tone(1.0, frequency=2 * HERTZ),), LENGTH),), W1)  # 64 samples, 18 W1
    lane = Lane(SCENE, faster)
    with pytest.raises(ParameterError, match="samples_per_period = 64"):
        measure_lane(lane)
    with pytest.raises(ParameterError, match="samples_per_period = 64"):
        measure(Chunk((lane,), (RMS,), None, 3.0))


@pytest.mark.parametrize("pulse", ["half-sine", "triangle", "trapezoid"])
def test_the_spectrum_of_a_shock_is_the_integral_over_its_pulse(pulse: str) -> None:
    width = 2.5 / W1
    rise = 0.3 * width if pulse == "trapezoid" else None
    t = np.linspace(0.0, width, 400_001)
    shapes = {
        "half-sine": np.sin(np.pi * t / width),
        "triangle": 1 - np.abs(2 * t / width - 1),
        "trapezoid": np.minimum(1.0, np.minimum(t, width - t) / (0.3 * width)),
    }
    omega, square = response_spectrum(MODEL, Shock(pulse, 1.0, width, LENGTH, rise))
    integrals = [np.trapezoid(shapes[pulse] * np.exp(-1j * w * t), t) for w in MODEL.omega]
    truth = np.abs(integrals) * MODEL.tip_shape * MODEL.force_shape / MODEL.omega
    np.testing.assert_array_equal(omega, MODEL.omega)
    np.testing.assert_allclose(square, truth**2, rtol=1e-6)


@pytest.mark.parametrize("quantity", [FORCE_QUANTITY, BASE_QUANTITY])
def test_the_spectrum_of_a_record_is_the_structures_stationary_response(quantity: str) -> None:
    from scipy.signal import lsim

    rng = np.random.default_rng(3)
    clock = np.linspace(0.0, 200 * 2 * np.pi / W1, 20_001)
    values = np.append(rng.standard_normal(len(clock) - 1), 0.0)
    weight = MODEL.tip_shape * (
        MODEL.force_shape if quantity == FORCE_QUANTITY else MODEL.base_participation
    )
    moved = np.zeros(len(clock))
    for w, d, size in zip(MODEL.omega, MODEL.damping_ratio, weight, strict=True):
        moved += lsim(([size], [1.0, 2 * d * w, w * w]), values, clock)[1]
    spectrum = np.abs(np.fft.rfft(moved)) ** 2
    truth = np.sum(spectrum[: len(spectrum) // 20]) / np.sum(spectrum)
    _, square = response_spectrum(MODEL, Samples(clock, values, quantity))
    assert np.sum(square[: len(square) // 20]) / np.sum(square) == pytest.approx(truth, abs=0.02)


# --- start states


def decayed(q: np.ndarray, v: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and velocities (N_m,) of damped modes in free motion, in closed form."""
    rate = MODEL.damping_ratio * MODEL.omega
    own = np.sqrt(MODEL.omega**2 - rate**2)
    b = (v + rate * q) / own
    c = np.cos(own * time)
    s = np.sin(own * time)
    fall = np.exp(-rate * time)
    return fall * (q * c + b * s), fall * (v * c - (own * q + rate * b) * s)


@pytest.mark.parametrize("place", ["force", "absorber"])
def test_a_strike_adds_to_an_initial_state(place: str) -> None:
    strike = Strike(0.1, 0.2, place)
    shape = MODEL.force_shape if place == "force" else MODEL.tip_shape
    struck = 0.1 * shape / np.sum(shape**2)
    record = Record(level=False)
    alone = simulate(SCENE, Loads((strike,), W1), record=record)
    still = simulate(SCENE, Loads((strike,), W1), initial=InitialState(), record=record)
    np.testing.assert_array_equal(still.end_state, alone.end_state)
    q = np.array([1e-3, -2e-4, 1e-5])
    v = np.array([0.02, 0.1, -0.2])
    both = simulate(
        SCENE,
        Loads((strike, Strike(0.05, 0.2, place)), W1),
        initial=InitialState(q, v),
        record=record,
    )
    truth = np.concatenate(decayed(q, v + 1.5 * struck, 0.2))
    state = np.delete(both.end_state, [3, 7])
    np.testing.assert_allclose(state, truth, rtol=1e-10, atol=1e-14)
    lanes = run_lanes([Lane(SCENE, Loads((strike,), W1))])
    level = simulate(SCENE, Loads((strike,), W1), initial=InitialState()).level
    assert lanes.level[0] == level.value > 1e-5


def test_a_run_in_two_parts_is_struck_by_the_strike_of_each() -> None:
    first = simulate(SCENE, Loads((Strike(0.1, 0.1),), W1), record=Record(level=False))
    state = InitialState(first.end_state[:3], first.end_state[4:7])
    second = simulate(
        SCENE, Loads((Strike(0.1, 0.1),), W1), initial=state, record=Record(level=False)
    )
    struck = 0.1 * MODEL.force_shape / np.sum(MODEL.force_shape**2)
    q, v = decayed(np.zeros(3), struck, 0.1)
    truth = np.concatenate(decayed(q, v + struck, 0.1))
    np.testing.assert_allclose(np.delete(second.end_state, [3, 7]), truth, rtol=1e-10, atol=1e-14)


def test_two_initial_states_are_refused() -> None:
    base = ShakenBase(constant_frequency(W1, 1.0, 5), acceleration=1.0, phase=1.0)
    for start in ("base-mean-rest", "lower-wall", InitialState()):
        both = Loads((base,), start=start)
        with pytest.raises(ParameterError, match=r"initial = .*None under loads that start at"):
            simulate(SCENE, both, initial=InitialState())
    with pytest.raises(ParameterError, match=r"modal_velocity = .*3 finite numbers, one per mode"):
        simulate(SCENE, Loads((Strike(0.1, 0.2),), W1), initial=InitialState(None, np.zeros(2)))


# --- what is streamed

ELSEWHERE = Beam(modes=2, response_position=0.6)
RUNS: dict[str, tuple[Scene, Method]] = {
    "no absorber": (beam_scene(ELSEWHERE), Exact()),
    "impacts": (beam_scene(ELSEWHERE, impact_absorber(restitution=0.7)), Exact()),
    "compliant": (beam_scene(ELSEWHERE, SlidingAbsorber(walls=CompliantWalls(1e6))), Exact()),
    "Moreau": (beam_scene(ELSEWHERE, impact_absorber(restitution=0.7)), Moreau(150)),
    "Runge-Kutta": (
        beam_scene(ELSEWHERE, SlidingAbsorber(walls=CompliantWalls(1e6))),
        RungeKutta(50),
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_level_and_envelope_at_another_place_are_those_of_the_stored_motion(name: str) -> None:
    scene, method = RUNS[name]
    drive = drive_of(4.0, 0.98, 1.01, periods=24.3)
    whole = simulate(scene, drive, method, record=Record(level=False, series=True))
    moved = whole.history.modal_displacement @ scene.model.response_shape
    response = simulate(scene, drive, method, record=Record(envelope=7))
    level, largest = response_level(moved, 32)
    np.testing.assert_allclose(
        [response.level.value, response.level.max_tip], [level, largest], rtol=1e-12
    )
    np.testing.assert_array_equal(response.end_state, whole.end_state)
    assert response.history is None
    edges = np.linspace(0.0, drive.schedule.times[-1], 8)
    time = whole.history.time
    for k in range(7):
        mine = moved[(time >= edges[k]) & ((time < edges[k + 1]) | (k == 6))]
        truth = [mine.min(), mine.max()]
        low_high = [response.envelope.low[k], response.envelope.high[k]]
        np.testing.assert_allclose(low_high, truth, rtol=0, atol=1e-13 * largest)
    np.testing.assert_array_equal(response.envelope.edges, edges)


def test_parts_of_an_envelope_without_a_sample_are_open() -> None:
    response = simulate(
        scene_of(modes=2), drive_of(1.0, 1.0, periods=1.0), record=Record(envelope=100)
    )
    assert np.sum(np.isfinite(response.envelope.low)) == 33  # samples, each in a part of its own
    assert np.isfinite(response.envelope.high[[0, -1]]).all()


@pytest.mark.parametrize("method", [Exact(), Moreau(100), RungeKutta(50)], ids=str)
def test_a_window_holds_its_samples_ends_included(method: Method) -> None:
    scene = scene_of(modes=2)
    drive = drive_of(2.0, 0.9, periods=10.0)
    record = Record(level=False, series=True)
    whole = simulate(scene, drive, method, record=record).history
    for start, end in (
        (whole.time[40], whole.time[77]),
        (np.nextafter(whole.time[40], 1), np.nextafter(whole.time[77], 0)),
        (-1.0, whole.time[3]),
        (whole.time[-2], 1e9),
        (0.25 * PERIOD / 32, 0.5 * PERIOD / 32),
        (1e3, 1e4),
    ):
        window = replace(record, series=Window(start, end))
        response = simulate(scene, drive, method, record=window)
        inside = (whole.time >= start) & (whole.time <= end)
        for name in ("time", "modal_displacement", "modal_velocity", "absorber_displacement"):
            np.testing.assert_array_equal(
                getattr(response.history, name), getattr(whole, name)[inside]
            )
        assert [len(row) for row in response.displacement_columns()] == [
            min(600, np.sum(inside))
        ] * 3


@pytest.mark.parametrize(
    "record",
    [Record(), Record(envelope=50), Record(series=Window(0.0, 0.5), envelope=9)],
    ids=["level", "envelope", "window"],
)
def test_memory_does_not_grow_with_the_run(record: Record) -> None:
    scene = beam_scene(ELSEWHERE)

    def peak(periods: float) -> int:
        drive = drive_of(1.0, 1.0, periods=periods)
        simulate(scene, drive, record=record)
        tracemalloc.start()
        simulate(scene, drive, record=record)
        peak_bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak_bytes

    short = peak(50)
    assert peak(800) < short + 20_000  # whose motion takes 1.6 MB


# --- lists of events


def bouncing(impacts: int) -> tuple[Scene, Drive, InitialState]:
    """Return an absorber that flies between walls at rest at 1 m/s, and meets so many of them."""
    gap = 1e-3
    time = 2 * gap * impacts
    drive = Drive(0.0, FrequencySchedule([0.0, time], [100.0, 100.0], 100.0))
    return (
        Scene(steady_base(), impact_absorber(gap, 1.0)),
        drive,
        InitialState(absorber_velocity=1.0),
    )


def test_more_events_than_a_list_holds_are_all_listed_by_one_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from impact_env import solvers, sweep

    calls = list[int]()
    build_schedule: Callable[..., object] = solvers.build_schedule

    def counted(*arguments: object) -> object:
        calls.append(1)
        return build_schedule(*arguments)

    monkeypatch.setattr(solvers, "build_schedule", counted)
    monkeypatch.setattr(sweep, "EVENTS_PER_CHUNK", 16)
    scene, drive, start = bouncing(200)
    response = simulate(
        scene, drive, initial=start, record=Record(level=False, events=True, reversals=True)
    )
    assert len(calls) == 1
    assert response.impact_count == len(response.impacts.time) == 200
    np.testing.assert_allclose(response.impacts.time, 2e-3 * (np.arange(200) + 0.5), rtol=1e-9)
    np.testing.assert_allclose(np.abs(response.impacts.relative_velocity), 1.0, rtol=1e-9)
    assert len(response.phases.start) == 0


@pytest.mark.parametrize("method", [Exact(), Moreau(200)], ids=str)
def test_lists_in_chunks_are_those_in_one(method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    from impact_env import sweep

    scene = scene_of(impact_absorber(5e-4, 0.3, 0.1), modes=2)
    drive = drive_of(6.0, 0.98, 1.02, periods=20)
    record = Record(events=True, reversals=isinstance(method, Exact))
    whole = simulate(scene, drive, method, record=record)
    monkeypatch.setattr(sweep, "EVENTS_PER_CHUNK", 3)
    parts = simulate(scene, drive, method, record=record)
    assert len(whole.impacts.time) > 20
    assert len(whole.phases.start) > 3
    for name in ("impacts", "phases", "reversals") if record.reversals else ("impacts", "phases"):
        for column, values in vars(getattr(whole, name)).items():
            np.testing.assert_array_equal(getattr(getattr(parts, name), column), values)
    assert parts.level == whole.level


def failing(error: BaseException) -> Callable[[EventRecorder], None]:
    def empty(_: EventRecorder) -> None:
        raise error

    return empty


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MemoryError("no memory")], ids=repr)
def test_what_goes_wrong_while_a_list_is_emptied_ends_the_run(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    from impact_env import sweep

    monkeypatch.setattr(sweep, "EVENTS_PER_CHUNK", 4)
    monkeypatch.setattr(EventRecorder, "empty", failing(error))
    scene, drive, start = bouncing(10**7)  # minutes
    with pytest.raises(type(error)):
        simulate(scene, drive, initial=start, record=Record(level=False, events=True))


def test_a_sweep_s_rate_is_not_read_as_its_fastest_tone() -> None:
    """A sweep down is fastest at its begin."""
    down = linear_sweep(OMEGA, RATIO, 0.5, 1000.0)
    with pytest.raises(ParameterError, match=REFUSED):
        require_sampled(scene_of(modes=1), Loads((Drive(1.0, down),)), FEW)
