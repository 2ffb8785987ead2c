"""Loads other than one force, and gravity, are correct.

They are compared with dense matrix exponentials, closed forms, and limits of refinement.
"""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from core import EVERYTHING
from load_cases import PARTICIPATION, cantilever, chirp, record_of
from numpy.typing import NDArray

from impact_env import solvers
from impact_env.checks import ParameterError
from impact_env.drive import Drive, FrequencySchedule, Load, Member
from impact_env.laws import SceneKind
from impact_env.loads import (
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
from impact_env.methods import Moreau, RungeKutta
from impact_env.parameters import (
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    NonlinearSink,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    friction_damper,
)
from impact_env.results import Record, Response
from impact_env.scene import InitialState, Scene
from impact_env.sweep import simulate
from reference.dense import Inputs, follow

Array = NDArray[np.float64]
Force = Callable[[Array], Array]
W1 = float(cantilever().omega[0])
SWEEP = FrequencySchedule(np.array([0.0, 0.25]), np.array([0.9, 1.1]) * W1, W1)
RUN_UP = FrequencySchedule(np.array([0.0, 0.25]), np.array([0.0, 1.2]) * W1, W1)
NOISE = np.random.default_rng(5).standard_normal(251)
CLOCK = np.linspace(0.0, 0.25, 251)
BOTH = SlidingAbsorber(0.02, RigidWalls(5e-4, 0.6), CoulombFriction(0.02), gravity=1.5)
SMOOTH = SlidingAbsorber(0.02, RigidWalls(5e-4, 0.7))
SOFT = SlidingAbsorber(0.02, CompliantWalls(2e5, 5e-4), ElasticCoulombFriction(0.05, 1e5))
TWO = SeveralAbsorbers(
    (SMOOTH, SlidingAbsorber(0.01, RigidWalls(4e-4, 0.6), CoulombFriction(0.05))), (1.0, 0.6)
)
HEAVY = SeveralAbsorbers(
    (BOTH, SlidingAbsorber(0.01, RigidWalls(4e-4, 0.6), gravity=1.5)), (1.0, 0.6)
)
BARE = Record(series=True, events=True)


def shaken(times: Array) -> Array:
    """Return the acceleration of a base.

    The base is displaced by 2e-4 m times the cosine of the sweep's phase + 0.3.
    """
    omega, rate, phase = chirp(SWEEP, times)
    return -2e-4 * (omega**2 * np.cos(phase + 0.3) + rate * np.sin(phase + 0.3))


def run_up(times: Array) -> Array:
    omega, _, phase = chirp(RUN_UP, times)
    return np.asarray(8e-5 * omega**2 * np.cos(phase))


def orders(times: Array) -> Array:
    _, _, phase = chirp(SWEEP, times)
    return np.asarray(6 * np.cos(phase + 0.5) + 2 * np.cos(2.9 * phase))


def noise(times: Array) -> Array:
    return np.asarray(np.interp(times, CLOCK, NOISE))


def half_sine(times: Array) -> Array:
    return np.where(times < 0.01, 40 * np.sin(np.pi * times / 0.01), 0.0)


def trapezoid(times: Array) -> Array:
    return np.interp(times, [0.0, 0.001, 0.005, 0.006, 1.0], [0.0, 60.0, 60.0, 0.0, 0.0])


def sawtooth(times: Array) -> Array:
    return np.where(times < 0.011, 60 * times / 0.011, 0.0)


BASE = ShakenBase(SWEEP, displacement=2e-4, phase=0.3)
RECORD = Samples(CLOCK, 3 * NOISE, "base_acceleration")
ORDERS = Tones((Tone(6.0, order=1.0, phase=0.5), Tone(2.0, order=2.9)), schedule=SWEEP)
FORCES = ORDERS, Samples(CLOCK, 3 * NOISE)
CASES: dict[str, tuple[tuple[Load, ...], Inputs]] = {
    "base": ((BASE,), Inputs(np.zeros_like, shaken, np.zeros(0), 1.1 * W1)),
    "run-up and noise": (
        (Unbalance(8e-5, RUN_UP), RECORD),
        Inputs(run_up, lambda t: 3 * noise(t), CLOCK, 1.2 * W1),
    ),
    "records of the force and the base": (
        (Samples(CLOCK, 40 * NOISE[::-1]), RECORD),
        Inputs(lambda t: 40 * noise(0.25 - t), lambda t: 3 * noise(t), CLOCK, 1.2 * W1),
    ),
    "orders and base": (
        (ORDERS, BASE),
        Inputs(orders, shaken, np.zeros(0), 3.2 * W1),
    ),
    "shock of the base and of the force": (
        (
            Shock("half-sine", 40.0, 0.01, 0.25, quantity="base_acceleration"),
            Shock("trapezoid", 60.0, 0.006, 0.25, 0.001),
        ),
        Inputs(trapezoid, half_sine, np.array([0.001, 0.005, 0.006, 0.01]), 314.2),
    ),
    "sawtooth": (
        (Shock("sawtooth", 60.0, 0.011, 0.25),),
        Inputs(sawtooth, np.zeros_like, np.array([0.011]), W1),
    ),
}

NO_FORCE = np.zeros_like
PLACES = {
    "tip": cantilever().tip_shape,
    "middle": np.array([0.7, 1.1, -0.9]),
    "root": np.array([0.1, 0.5, 1.2]),
}
RECORDS = {
    "tip": 20 * NOISE,
    "middle": 40 * np.roll(NOISE, 50),
    "root": -90 * NOISE[::-1],
}
HALF_CLOCK = np.linspace(0.0, 0.25, 201)


def at_place(name: str, values: Array, clock: Array = CLOCK) -> tuple[Array, Force]:
    """Return the shape at a place and its record as a function of time."""
    return PLACES[name], lambda times: np.interp(times, clock, values)


RECORDED = tuple(Samples(CLOCK, values, force_place=name) for name, values in RECORDS.items())
EVERY_RECORD = tuple(at_place(name, values) for name, values in RECORDS.items())
PLACED: dict[str, tuple[tuple[Load, ...], Inputs]] = {
    "records of three places": (
        RECORDED,
        Inputs(NO_FORCE, np.zeros_like, CLOCK, W1, EVERY_RECORD),
    ),
    "two records of one step each and of another, with a base": (
        (*RECORDED[:1], Samples(HALF_CLOCK, RECORDS["root"][:201], force_place="root"), BASE),
        Inputs(
            NO_FORCE,
            shaken,
            np.union1d(CLOCK, HALF_CLOCK),
            1.1 * W1,
            (EVERY_RECORD[0], at_place("root", RECORDS["root"][:201], HALF_CLOCK)),
        ),
    ),
    "a record, orders and a sweep of places, and a force": (
        (
            RECORDED[1],
            replace(ORDERS, force_place="root"),
            Drive(4.0, SWEEP, 0.2, "tip"),
            FORCES[1],
        ),
        Inputs(
            lambda t: 3 * noise(t),
            np.zeros_like,
            CLOCK,
            3.2 * W1,
            (
                EVERY_RECORD[1],
                (PLACES["root"], orders),
                (PLACES["tip"], lambda t: 4 * np.cos(chirp(SWEEP, t)[2] + 0.2)),
            ),
        ),
    ),
}
FORCED = FORCES, Inputs(lambda t: orders(t) + 3 * noise(t), np.zeros_like, CLOCK, 3.2 * W1)
EVENTS = {f"{name}, friction and gravity": (*case, BOTH) for name, case in CASES.items()}
EVENTS |= {f"{name}, smooth": (*case, SMOOTH) for name, case in CASES.items()}
EVENTS |= {f"{name}, several": (*CASES[name], TWO) for name in ("base", "run-up and noise")}
EVENTS |= {"orders and base, several with gravity": (*CASES["orders and base"], HEAVY)}
EVENTS |= {f"{name}, several": (*case, TWO) for name, case in PLACED.items()}
EVENTS |= {f"{name}, friction and gravity": (*case, BOTH) for name, case in PLACED.items()}
EVENTS |= {"records of three places, smooth": (*PLACED["records of three places"], SMOOTH)}
EVENTS |= {"forces, compliant": (*FORCED, SOFT), "forces, several": (*FORCED, TWO)}


def structure(absorber: object) -> Scene:
    places = (
        np.array([cantilever().tip_shape, cantilever().force_shape])
        if isinstance(absorber, SeveralAbsorbers)
        else None
    )
    model = cantilever().with_force_places(PLACES)
    return Scene(replace(model, absorber_shapes=places), absorber)


def run(absorber: object, loads: tuple[Load, ...], record: Record | None = None) -> Response:
    scene = structure(absorber)
    return simulate(scene, Loads(loads, W1), record=record or record_of(scene))


def states(response: Response) -> Array:
    history = response.history
    absorber = history.absorber_displacement, history.absorber_velocity
    return np.column_stack(
        [history.modal_displacement, absorber[0], history.modal_velocity, absorber[1]]
    )


@pytest.mark.parametrize("name", EVENTS)
def test_events_and_states_are_those_of_dense_exponentials(name: str) -> None:
    """Events and states under loads are those of dense matrix exponentials.

    Energies and checked searches are tested with friction, on springs and with several absorbers.
    Each of these is a further kernel.
    """
    loads, inputs, absorber = EVENTS[name]
    response = run(absorber, loads, BARE if absorber is SMOOTH else None)
    impacts = response.impacts
    history = response.history
    truth = follow(response.scene, inputs, None, history.time, most_impacts=12)
    known = min(len(truth.impacts), 10)
    assert known >= 5, known
    np.testing.assert_allclose(impacts.time[:known], truth.impacts[:known], rtol=0, atol=2e-10)
    np.testing.assert_allclose(
        impacts.relative_velocity[:known],
        truth.impact_velocity[:known],
        atol=2e-7 * np.max(np.abs(truth.impact_velocity)),
    )
    before = history.time[: len(truth.time)] < truth.impacts[known - 1]
    np.testing.assert_allclose(
        states(response)[: len(before)][before],
        truth.states[before],
        atol=1e-7 * np.max(np.abs(truth.states)),
    )
    if absorber is not SMOOTH:
        assert response.check.misses == 0
        assert response.energy.relative_error < 1e-10


LINEAR = {
    "no absorber": None,
    "stuck": StuckAbsorber(0.02),
    "tuned": TunedAbsorber(0.02, 615.4, 0.878),
    "heavy": TunedAbsorber(0.02, 615.4, 0.878, 9.81),
}


RECORDED_LOADS: dict[str, tuple[tuple[Load, ...], Inputs]] = {
    "base": ((RECORD,), Inputs(np.zeros_like, lambda t: 3 * noise(t), CLOCK, W1)),
    "three places": PLACED["records of three places"],
    "three places and base": (
        (*RECORDED, RECORD),
        Inputs(NO_FORCE, lambda t: 3 * noise(t), CLOCK, W1, EVERY_RECORD),
    ),
}


@pytest.mark.parametrize("kind", RECORDED_LOADS)
@pytest.mark.parametrize("absorber", LINEAR)
def test_linear_scenes_under_a_record_are_those_of_dense_exponentials(
    absorber: str, kind: str
) -> None:
    """Also where nothing is observed on the way, and the kernel leaps from sample to sample."""
    loads, inputs = RECORDED_LOADS[kind]
    run_states, unseen = (
        run(LINEAR[absorber], loads, record) for record in (None, Record(level=False))
    )
    truth = follow(
        run_states.scene,
        inputs,
        None,
        CLOCK[[0, -1]],
        long_steps=True,
    ).states[-1]
    columns = [0, 1, 2, 4, 5, 6] if absorber in ("no absorber", "stuck") else slice(None)
    for response in (run_states, unseen):
        np.testing.assert_allclose(
            response.end_state[columns], truth[columns], atol=1e-11 * np.max(np.abs(truth))
        )
    assert run_states.energy.relative_error < 1e-12


# metres for 1 m/s^2 of the base at the first frequency, in closed form
STEADY = {"no absorber": 1.229953900e-3, "stuck": 3.135898412e-4, "tuned": 1.047119145e-4}


@pytest.mark.parametrize("absorber", STEADY)
def test_a_base_gives_the_transfer_function(absorber: str) -> None:
    long = FrequencySchedule(np.array([0.0, 12.0]), np.full(2, W1), W1)
    response = run(LINEAR[absorber], (ShakenBase(long, acceleration=1.0),))
    tip = response.history.tip_displacement[-320:]
    assert np.sqrt(2 * np.mean(tip**2)) == pytest.approx(STEADY[absorber], rel=1e-8)


def test_a_random_load_has_the_mean_square_of_its_lines() -> None:
    """A random load gives the mean square of its lines.

    The record repeats. In the second pass the motion is the sum over its lines, each with the
    transfer function of the structure.
    """
    spectrum = np.array([[20.0, 1.0], [60.0, 1.0]])
    for quantity in ("force", "base_acceleration"):
        load = Random(spectrum, 4.0, seed=2, quantity=quantity)
        model = cantilever()
        record = load.record()
        twice = np.concatenate([record.values[:-1], record.values])
        response = run(
            None,
            (Samples(record.times[1] * np.arange(len(twice)), twice, quantity),),
            replace(record_of(Scene(model)), samples_per_period=64),
        )
        assert model.base_participation is not None
        driven = model.force_shape if quantity == "force" else -model.base_participation
        omega = 2 * np.pi * load.lines / 4.0
        transfer = np.sum(
            model.tip_shape
            * driven
            / (model.omega**2 - omega[:, None] ** 2 + 0.02j * model.omega * omega[:, None]),
            axis=1,
        )
        rms = np.sqrt(np.sum(np.abs(transfer * load.amplitudes()) ** 2) / 2)
        late = response.history.tip_displacement[response.history.time >= 4.0 - 1e-9]
        assert np.sqrt(np.mean(late**2)) == pytest.approx(rms, rel=2e-3)
        assert np.mean(record.values[:-1] ** 2) == pytest.approx(40.0, rel=0.2)


def test_records_of_members_are_gaussian_with_the_spectrum_s_size() -> None:
    load = Random(np.array([[20.0, 2.0], [40.0, 8.0]]), 5.0, seed=7)
    sizes = np.array(
        [np.abs(load.member(other).amplitudes()) ** 2 for other in map(Member, range(200))]
    )
    frequency = load.lines / 5.0
    np.testing.assert_allclose(
        np.mean(sizes, axis=0), 2 * 2 * (frequency / 20) ** 2 / 5, rtol=0.4
    )  # log-log: the slope is 2
    assert np.mean(sizes**2) / np.mean(sizes * np.mean(sizes, axis=0)) == pytest.approx(
        2.0, rel=0.1
    )  # of a squared Gaussian amplitude


def test_lines_of_a_random_record_have_the_spectrum_s_density() -> None:
    """Lines of a random record have the density of the spectrum.

    The spectrum is straight between points on logarithmic axes, with a step at 40 Hz. The squares
    of the lines average to twice the density over the duration.
    """
    spectrum = np.array([[20.0, 2.0], [40.0, 8.0], [40.0, 1.0], [60.0, 1.0]])
    load = Random(spectrum, 5.0, seed=7, factor=3.0)
    hertz = load.lines / 5.0
    density = 9 * np.where(hertz < 40, 2 * (hertz / 20) ** 2, 1.0)
    density[hertz == 40] = 9 * (8.0 + 1.0) / 2
    np.testing.assert_allclose(load.density, density, rtol=1e-10)
    squares = [np.abs(replace(load, number=k).amplitudes()) ** 2 for k in range(3000)]
    # 3,000 records of 201 lines, each exponentially distributed: a spread of 0.13 %
    assert np.mean(squares / (2 * density / 5.0)) == pytest.approx(1.0, abs=0.005)


def test_straight_lines_between_samples_of_a_random_record_have_its_lines() -> None:
    """Straight lines between samples of a random record have its spectral lines.

    The Fourier coefficients of the straight lines are computed by Gauss quadrature in each
    interval.
    """
    load = Random(np.array([[20.0, 2.0], [60.0, 3.0]]), 0.5, seed=3)
    record = load.record()
    step = record.times[1]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    shares = (1 + nodes) / 2
    times = record.times[:-1, None] + step * shares
    values = record.values[:-1, None] * (1 - shares) + record.values[1:, None] * shares
    for line, amplitude in zip(load.lines, load.amplitudes(), strict=True):
        turned = values * np.exp(-2j * np.pi * line * times / 0.5)
        coefficients = 2 / 0.5 * np.sum(turned @ (weights / 2)) * step
        assert abs(coefficients) == pytest.approx(abs(amplitude), rel=1e-9)


def test_a_sampled_chirp_tends_to_the_chirp_with_the_square_of_its_step() -> None:
    drive = Drive(5.0, SWEEP, 0.4)
    errors = []
    exact = simulate(Scene(cantilever()), drive).end_state
    np.testing.assert_allclose(run(None, (drive,)).end_state, exact, rtol=1e-11)
    for count in (500, 1000, 2000):
        times = np.linspace(0, 0.25, count + 1)
        record = Samples(times, 5 * np.cos(SWEEP.phase_at(times) + 0.4))
        errors.append(np.max(np.abs((run(None, (record,)).end_state - exact)[:3])))
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 4.0, rtol=0.02)


def test_starts_in_the_middle_and_on_the_lower_walls() -> None:
    for absorber, start, places in (
        (SMOOTH, "middle", [0]),
        (SMOOTH, "lower-wall", [-5e-4]),
        (TWO, "lower-wall", [-5e-4, -4e-4]),
    ):
        vector = (
            Loads((BASE,), start=start).initial(structure(absorber)).vector(structure(absorber))
        )
        assert vector.tolist() == [0, 0, 0, *places, 0, 0, 0, *np.zeros(len(places))]


def moved_by(load: Load, times: Array) -> tuple[float, Array]:
    """Return velocity at time 0, and displacement from then on, of a base.

    The mean velocity of the base is zero. Both are closed forms.
    """
    if isinstance(load, Samples):  # a cubic between samples
        step = load.times[1]
        low = load.values[:-1]
        high = load.values[1:]
        velocity = np.concatenate([[0.0], np.cumsum(step * (low + high) / 2)])
        gain = step * velocity[:-1] + step**2 * (low / 3 + high / 6)
        place = np.concatenate([[0.0], np.cumsum(gain)])
        start = -float(place[-1]) / load.duration
        k = np.clip((times / step).astype(int), 0, len(low) - 1)
        u = times - load.times[k]
        bend = low[k] / 2 + (high - low)[k] / step * u / 6
        return start, start * times + place[k] + (velocity[k] + bend * u) * u
    if isinstance(load, Tones):
        parts = [(tone.amplitude, 2 * np.pi * tone.frequency, tone.phase) for tone in load.tones]
    else:
        assert isinstance(load, ShakenBase)
        size = load.acceleration
        parts = [(-load.displacement * W1**2 if size is None else size, W1, load.phase)]
    start = sum(a / w * np.sin(p) for a, w, p in parts)
    return start, sum(a / w**2 * (np.cos(p) - np.cos(w * times + p)) for a, w, p in parts)


STEADY_SWEEP = FrequencySchedule(np.array([0.0, 0.25]), np.full(2, W1), W1)
AT_REST: dict[str, Load] = {
    "displacement": ShakenBase(STEADY_SWEEP, displacement=1e-4, phase=1.0),
    "acceleration": ShakenBase(STEADY_SWEEP, acceleration=7.0, phase=-0.6),
    "tones": Tones(
        (Tone(3.0, frequency=40.0, phase=0.7), Tone(2.0, frequency=96.0, phase=-2.0)),
        0.25,
        quantity="base_acceleration",
    ),
    "record": Samples(CLOCK, 3 * NOISE, "base_acceleration"),
}


@pytest.mark.parametrize("name", AT_REST)
def test_a_base_about_a_mean_at_rest_leaves_the_absorber_where_it_is_in_space(name: str) -> None:
    """A base about a mean at rest leaves a free absorber at its position in space.

    The absorber's displacement is the negative of the base's. Structure and absorber start with the
    negative velocity of the base.
    """
    load = AT_REST[name]
    scene = Scene(cantilever(), SlidingAbsorber(0.02, RigidWalls(1.0, 0.7)))
    loads = Loads((load,), W1, "base-mean-rest")
    response = simulate(scene, loads, record=BARE)
    start, moved = moved_by(load, response.history.time)
    np.testing.assert_allclose(response.history.absorber_displacement, -moved, atol=1e-13)
    initial = loads.initial(scene)
    np.testing.assert_allclose(initial.modal_velocity, -start * np.array(PARTICIPATION), rtol=1e-12)
    assert loads.base_velocity() == pytest.approx(start, rel=1e-12)


STEPPED = {"moreau": (SMOOTH, Moreau), "runge-kutta": (SOFT, RungeKutta)}


@pytest.mark.parametrize("name", STEPPED)
def test_stepping_methods_tend_to_the_exact_one_under_loads(name: str) -> None:
    """Up to the third impact, from where errors of a step grow."""
    absorber, method = STEPPED[name]
    record = EVERYTHING if absorber is SOFT else BARE  # each with the kernel of the tests above
    exact = simulate(structure(absorber), Loads(FORCES), record=record)
    before = exact.history.time < 0.03
    errors = []
    for steps in (40, 400):
        response = simulate(
            structure(absorber),
            Loads(FORCES),
            method(steps),
            record=BARE,
        )
        errors.append(
            np.max(
                np.abs(response.history.tip_displacement - exact.history.tip_displacement)[before]
            )
        )
    assert errors[1] < 0.3 * errors[0]
    assert errors[1] < 2e-3 * np.max(np.abs(exact.history.tip_displacement))


SPECTRUM = np.array([[20.0, 4.0], [60.0, 4.0]])
EACH: dict[str, Load] = {
    "force": Drive(8.0, SWEEP),
    "unbalance": Unbalance(1.2e-4, SWEEP),
    "base": ShakenBase(SWEEP, acceleration=12.0),
    "displaced base": BASE,
    "tones": Tones((Tone(8.0, frequency=40.0), Tone(9.0, frequency=251.0)), 0.25),
    "orders": ORDERS,
    "tones of the base": Tones((Tone(12.0, frequency=40.0),), 0.25, quantity="base_acceleration"),
    "record": FORCES[1],
    "record of the base": RECORD,
    "random": Random(SPECTRUM, 0.25),
    "random base": Random(SPECTRUM, 0.25, quantity="base_acceleration"),
    "shock": Shock("triangle", 60.0, 0.01, 0.25),
    "shock of the base": Shock("trapezoid", 60.0, 0.01, 0.25, 0.001, quantity="base_acceleration"),
    "sawtooth": Shock("sawtooth", 60.0, 0.011, 0.25),
    "strike": Strike(0.5, 0.25),
}
EVERY_ABSORBER = LINEAR | {
    "impacts": SMOOTH,
    "impacts, friction and gravity": BOTH,
    "yielding": SlidingAbsorber(0.02, YieldingWalls(0.01, 5e-4, 0.7), gravity=9.81),
    "friction": friction_damper(0.1, 0.02),
    "compliant": SOFT,
    "heavy compliant": replace(SOFT, gravity=9.81),
    "sink": NonlinearSink(1e6),
    "several": TWO,
}
EVERY_START = (
    "middle",
    "lower-wall",
    "base-mean-rest",
    InitialState(modal_velocity=np.array([0.01, 0.0, 0.0]), absorber_velocity=0.02),
)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.nightly)
        if name in ("impacts", "yielding")  # the kernel with friction has both laws
        else name
        for name in EVERY_ABSORBER
    ],
)
def test_each_load_on_each_absorber_from_each_start_balances_or_is_refused_by_name(
    name: str,
) -> None:
    scene = structure(EVERY_ABSORBER[name])
    general = scene.kind in (SceneKind.LINEAR, SceneKind.RIGID, SceneKind.SEVERAL)
    for kind, load in EACH.items():
        for start in EVERY_START:
            reasons = {"start"} if start == "base-mean-rest" and "base" not in kind else set()
            reasons |= {"loads"} if "base" in kind and not general else set()
            reasons |= (
                {"gravity"}
                if name == "heavy compliant"
                else {"method"}
                if name == "sink"
                else set()
            )
            loads = Loads((load,), W1, start)
            if reasons:
                with pytest.raises(ParameterError, match=rf"^({'|'.join(reasons)}) = "):
                    simulate(scene, loads, record=record_of(scene))
            else:
                error = simulate(scene, loads, record=record_of(scene)).energy.relative_error
                assert error < 1e-9, (kind, start, error)


def test_a_struck_structure_is_one_that_a_short_blow_has_left() -> None:
    """A struck structure moves as after a short blow.

    The impulse of velocity / sum(shape^2) acts at the place within a thousandth of the highest
    mode's period.
    """
    model = cantilever()
    width = 1e-6
    peak = 2 * 0.5 / float(np.sum(model.force_shape**2)) / width
    blow, strike = (
        run(None, (load,)).end_state
        for load in (Shock("triangle", peak, width, 0.1), Strike(0.5, 0.1))
    )
    np.testing.assert_allclose(strike, blow, atol=3e-3 * np.max(np.abs(strike)))
    assert model.force_shape @ Loads((Strike(0.5, 0.1),), W1).initial(
        Scene(model)
    ).modal_velocity == pytest.approx(0.5)


@pytest.mark.parametrize("record", [noise, shaken], ids=["record", "base"])
def test_runs_in_two_threads_may_share_what_a_load_is_for_the_kernels(
    record: Callable[[Array], Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs in two threads can share the compiled form of a load.

    The expansion in the current window belongs to each run. Threads in different windows of one
    load do not overwrite each other's values.
    """
    monkeypatch.setattr(solvers, "build_schedule", lru_cache(solvers.build_schedule))
    scene = Scene(cantilever(), BOTH)
    part = ShakenBase(SWEEP, displacement=2e-4) if record is shaken else Samples(CLOCK, NOISE)
    loads = Loads((part,), W1)
    alone = simulate(scene, loads, record=record_of(scene))
    together = threading.Barrier(2)

    def again(_: int) -> Response:
        together.wait(60.0)
        return simulate(scene, loads, record=record_of(scene))

    with ThreadPoolExecutor(2) as pool:
        for response in pool.map(again, range(8)):
            np.testing.assert_array_equal(response.end_state, alone.end_state)
            np.testing.assert_array_equal(response.impacts.time, alone.impacts.time)
