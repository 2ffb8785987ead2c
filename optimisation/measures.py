"""Measures of a design from its runs: level, fatigue damage, stroke, impacts and heat.

Under loads other measures are read.

A chunk is a handful of lanes with what to measure in them: plain data, so that a thread, or a
worker on another machine, turns it into the same numbers.
"""

import hashlib
from collections.abc import Callable, Container
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.drive import Excitation, find_schedule
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane
from impact_env.level import require_sampled
from impact_env.loads import Loads, Shock, Strike
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import SeveralAbsorbers, SlidingAbsorber
from impact_env.results import Record, Response, require_recorded
from impact_env.scene import Scene
from impact_env.sweep import IntegrationError, simulate

# What is read from a response under loads: one definition for each kind of load, smaller is better.
#
# - level: loads with a schedule, which sweep. The paper's response level, as everywhere.
# - rms: records, random loads and fixed tones. Root mean square of the displacement (relative to
#   the base) where the level is read, after a start that is left out: `SETTLING` time constants
#   1/(D omega) of the first mode, at most half of the record.
# - decay: shocks and strikes. The integral of the structure's energy from the end of the pulse on
#   over its value at that end, in s: 1/(2 D omega) where it decays as exp(-2 D omega t).


LEVEL = "level"
RMS = "rms"
DECAY = "decay"
UNITS = {LEVEL: "m", RMS: "m", DECAY: "s"}
LABELS = {LEVEL: "response level", RMS: "RMS", DECAY: "decay time of the energy"}
DISPLAY_UNITS = {"m": (1e3, "mm"), "s": (1.0, "s")}  # factor and unit for people
SETTLING = 5.0
SAMPLES = 64  # a pseudo period
STRANGE = 1e6  # a gap over the free motion, or this over it
START = 1.5  # of the size of the free motion at the absorber: a gap where there is no rule


def format_number(value: float) -> str:
    """Return a number for people, with at most four significant digits, as "2.149" or "12350"."""
    return f"{float(f'{value:.4g}'):g}"


def measure_of(loads: Loads) -> str:
    """Return which measure belongs to loads."""
    if any(find_schedule(part) for part in loads.parts):
        return LEVEL
    return DECAY if any(isinstance(part, Shock | Strike) for part in loads.parts) else RMS


def _level(response: Response) -> float:
    return require_recorded("level", response.level).value


def settled_after(response: Response) -> float:
    """Return how long the start is that is left out, in s: none of sweeps and shocks."""
    drive = response.drive
    model = response.scene.model
    if measure_of(drive) != RMS if isinstance(drive, Loads) else np.ptp(drive.schedule.omegas) > 0:
        return 0.0
    decay = float(model.damping_ratio[0] * model.omega[0])
    half = float(drive.schedule.times[-1]) / 2
    return min(SETTLING / decay, half) if decay > 0 else half


def _rms(response: Response) -> float:
    history = require_recorded("history", response.history)
    late = (history.modal_displacement @ response.scene.model.level_shape)[
        history.time >= settled_after(response)
    ]
    return float(np.sqrt(np.mean(late**2)))


def after_pulse(response: Response) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (S,) in s after the last pulse, and the modes' energies (S, N_m) in J."""
    history = require_recorded("history", response.history)
    late = history.time >= max(
        part.width for part in response.drive.parts if isinstance(part, Shock | Strike)
    )
    return history.time[late], mechanical_energy(response.scene, history).modal[late]


def _decay(response: Response) -> float:
    times, modal = after_pulse(response)
    energy = np.sum(modal, axis=1)
    return float(np.trapezoid(energy, times) / energy[0])


OF_LOADS: dict[str, tuple[Callable[[Response], float], Record]] = {
    LEVEL: (_level, Record()),
    RMS: (_rms, Record(level=False, series=True, samples_per_period=SAMPLES)),
    DECAY: (_decay, Record(level=False, series=True, samples_per_period=SAMPLES)),
}


def record_of(loads: Loads) -> Record:
    """Return the `Record` that the loads' measure needs."""
    return OF_LOADS[measure_of(loads)][1]


def read(response: Response) -> float:
    """Return the measure of a run's loads, of a harmonic force the response level."""
    return OF_LOADS[measure_of(response.drive) if isinstance(response.drive, Loads) else LEVEL][0](
        response
    )


def check_sampling(lane: Lane, measures: Container[str] = ()) -> None:
    """Raise ParameterError if a lane's run has too few samples.

    The samples must suffice for the measure of its loads and for other ``measures`` of its motion.
    """
    loads = lane.drive if isinstance(lane.drive, Loads) else None
    record = Record() if loads is None else record_of(loads)
    rms = loads is not None and measure_of(loads) == RMS
    if rms or any(name in measures for name in _OF_SAMPLES):
        require_sampled(lane.scene, lane.drive, record.samples_per_period, lane.start)


def measured(lane: Lane) -> float:
    """Return the measure of a lane's loads."""
    check_sampling(lane)
    return read(simulate(lane.scene, lane.drive, initial=lane.start, record=record_of(lane.drive)))


def loads_key(loads: Loads) -> str:
    """Return a key, equal for equal loads only."""
    strikes = [part for part in loads.parts if isinstance(part, Strike)]
    known = hashlib.sha256(f"{loads.reference!r} {loads.start!r} {strikes}".encode())
    for part in loads.on_one_clock():
        known.update(np.ascontiguousarray(part).tobytes())
    return known.hexdigest()


def free_size(lane: Lane) -> float:
    """Return the unit of gaps in m, the RMS of the free motion of the absorber's place.

    It is the root mean square over the whole run.

    For a shock, whose mean square depends on the length of the record, it is the largest
    displacement over the root of two.
    """
    check_sampling(lane)
    history = simulate(lane.scene, lane.drive, initial=lane.start, record=OF_LOADS[RMS][1]).history
    assert history is not None
    motion = history.tip_displacement
    return float(
        np.max(np.abs(motion)) / np.sqrt(2)
        if measure_of(lane.drive) == DECAY
        else np.sqrt(np.mean(motion**2))
    )


def design_gap_for(model: ModalModel, loads: Loads) -> float:
    """Return the gap in m from which a search starts if there is no design rule.

    It is `START` times `free_size`, and 0 if nothing moves.
    """
    return START * free_size(Lane(Scene(model), loads, steady_start=True))


def check_size(scene: Scene, drive: Excitation) -> None:
    """Raise ParameterError if a place moves far too little or too much under the loads.

    The motion is compared with the gap of the absorber at that place. A large mismatch means a
    wrong unit.
    """
    walls = scene.cavity(0)
    if not isinstance(drive, Loads) or walls is None or walls.gap == 0:
        return
    size = free_size(Lane(Scene(scene.model), drive))
    allowed = (
        f"from {1 / STRANGE:g} to {STRANGE:g} times the free motion at the absorber, {size:.3g} "
        "m: look at the load's units and scale"
    )
    require(size / STRANGE <= walls.gap <= size * STRANGE, "gap", walls.gap, allowed)


Array = NDArray[np.float64]

# what a lane can be measured by; the order is that of the columns
STROKE = "stroke"
IMPACT_POWER = "impact_power"
IMPACT_SPEED = "impact_speed"
FRICTION_HEAT = "friction_heat"
DAMAGE = "damage"
IMPACT_RATE = "impact_rate"
IMPACT_RMS = "impact_rms_speed"
ACCELERATION = "acceleration"
STRESS = "stress"
LEVEL_RATIO = "level_ratio"
MEASURES = {
    LEVEL: (
        "response level in m (paper, Eq. barqtip) where it is read, on a cantilever the free end; "
        "of loads the measure that belongs to them"
    ),
    STROKE: "largest distance of the absorber from the middle of its cavity in m",
    IMPACT_POWER: (
        "energy lost in impacts over the sweep, or after the start (`settled_after`), per second, "
        "in W"
    ),
    IMPACT_SPEED: "largest relative velocity before an impact in m/s",
    IMPACT_RMS: (
        "root of the mean square of the relative velocities before impacts in m/s, after the start"
    ),
    FRICTION_HEAT: (
        "energy lost in dry friction over the sweep, or after the start, per second, in W, from "
        "the mean relative speed at the samples"
    ),
    DAMAGE: (
        "sum over the rainflow cycles of the bending moment at the clamp, or of a modal model's "
        "stress, to the power of the fatigue exponent"
    ),
    IMPACT_RATE: "impacts per second over the sweep, or after the start",
    ACCELERATION: (
        "largest change of velocity where the level is read from sample to sample, over the time "
        "between, in m/s^2, impacts included"
    ),
    STRESS: (
        "largest bending moment at the clamp in N m, or of a modal model's stress in the file's "
        "unit"
    ),
    RMS: (
        "root of the mean square of the free end's displacement in m over the second half of the "
        "run"
    ),
    LEVEL_RATIO: (
        "frequency over the resonance at which the response level of a swept force was read; 0 of "
        "other loads"
    ),
}
_OF_IMPACTS = {IMPACT_POWER, IMPACT_SPEED, IMPACT_RMS, IMPACT_RATE}
_OF_SAMPLES = {STROKE, FRICTION_HEAT, DAMAGE, RMS, ACCELERATION, STRESS}


FATIGUES = (
    "for a beam that is clamped at its left end, or a modal model whose file gives the stress "
    "that fatigues"
)


def stress_shape(structure: Structure) -> Array | None:
    """Return the mode shapes (N_m,) of the stress that causes fatigue, or None.

    For a beam it is the bending moment at the left clamp in N/sqrt(kg), for a modal model the
    stress of its file. The result is None if there is none.

    A Hermite element at the clamp deflects as a x^2 + b x^3, so the curvature 2 a there follows
    from the shapes at two points of it.
    """
    if isinstance(structure, ModalModel):
        return structure.stress_shape
    if not structure.ends.startswith("clamped"):
        return None
    near = 0.5 / structure.elements
    far = 1.0 / structure.elements
    first, second = (
        modal_model(replace(structure, force_position=x)).one_phase_force_shape for x in (near, far)
    )
    slopes = [shape / (x * structure.length) ** 2 for shape, x in ((first, near), (second, far))]
    a = (slopes[0] * far - slopes[1] * near) / (far - near)
    stiffness = (
        structure.sections[0].bending_stiffness
        if structure.sections
        else structure.bending_stiffness
    )
    return np.asarray(2 * a * stiffness)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Lanes and the measures that are computed from them.

    ``measures``: columns of the result. ``stress_shape`` (N_m,): result of the function of this
    name.
    """

    lanes: tuple[Lane, ...]
    measures: tuple[str, ...]
    stress_shape: Array | None
    fatigue_exponent: float

    def __post_init__(self) -> None:
        for name in self.measures:
            require(name in MEASURES, "measure", name, f"one of {', '.join(MEASURES)}")

    @property
    def record(self) -> Record:
        """Recording options of the runs: only what the measures need.

        This is the level during the run, and impacts or samples of the state if a measure needs
        them.

        The energy account would give losses too, but it takes many times the time of the run
        itself.
        """
        wanted = set(self.measures)
        loads = [lane.drive for lane in self.lanes if isinstance(lane.drive, Loads)]
        own = record_of(loads[0]) if loads else Record()
        return replace(
            own, events=bool(wanted & _OF_IMPACTS), series=own.series or bool(wanted & _OF_SAMPLES)
        )


def measure(chunk: Chunk) -> Array:
    """Run a chunk and return its measures, (lanes, measures).

    The measures are NaN in lanes that the integrator gives up.
    """
    rows = np.full((len(chunk.lanes), len(chunk.measures)), np.nan)
    for row, lane in zip(rows, chunk.lanes, strict=True):
        try:
            check_sampling(lane, chunk.measures)
            response = simulate(lane.scene, lane.drive, initial=lane.start, record=chunk.record)
        except IntegrationError:
            continue
        except ParameterError as error:
            raise ParameterError(f"{lane}: {error}") from error
        row[:] = [_value(name, chunk, response) for name in chunk.measures]
    return rows


def _value(name: str, chunk: Chunk, response: Response) -> float:
    if name == LEVEL:
        return read(response)
    if name == LEVEL_RATIO:
        swept = not isinstance(response.drive, Loads)
        return require_recorded("level", response.level).frequency_ratio if swept else 0.0
    if name in _OF_IMPACTS:
        return _of_impacts(name, response)
    history = require_recorded("history", response.history)
    if name == RMS:
        return float(
            np.sqrt(
                np.mean(
                    (
                        history.modal_displacement[len(history.time) // 2 :]
                        @ response.scene.model.level_shape
                    )
                    ** 2
                )
            )
        )
    if name in (DAMAGE, STRESS):
        require(chunk.stress_shape is not None, "measure", name, FATIGUES)
        stress = np.asarray(history.modal_displacement @ np.asarray(chunk.stress_shape))
        return (
            fatigue_damage(stress, chunk.fatigue_exponent)
            if name == DAMAGE
            else float(np.max(np.abs(stress)))
        )
    if name == ACCELERATION:
        change = np.diff(history.modal_velocity @ response.scene.model.level_shape)
        return float(np.max(np.abs(change) / np.diff(history.time)))
    return of_motion(name, response)


def _of_impacts(name: str, response: Response) -> float:
    impacts = require_recorded("impacts", response.impacts)
    if name == IMPACT_SPEED:
        return float(np.max(np.abs(impacts.relative_velocity), initial=0.0))
    start = settled_after(response)
    late = impacts.time >= start
    if name == IMPACT_RMS:
        return float(np.sqrt(np.mean(impacts.relative_velocity[late] ** 2))) if late.any() else 0.0
    total = float(np.sum(impacts.energy_lost[late] if name == IMPACT_POWER else late))
    return total / (float(response.drive.schedule.times[-1]) - start)


def impact_measures(response: Response) -> tuple[float, float, float, float]:
    """Return the measures of a run's impacts (see `MEASURES`).

    They are the largest and RMS speed in m/s, the number of impacts in a second, and the power in W
    lost in them.
    """
    speed, rms, rate, power = (
        _of_impacts(name, response)
        for name in (IMPACT_SPEED, IMPACT_RMS, IMPACT_RATE, IMPACT_POWER)
    )
    return speed, rms, rate, power


def of_motion(name: str, response: Response) -> float:
    """Return the stroke or the friction heat of a run with samples of the state (`MEASURES`).

    The stroke is the largest of all absorbers, the heat is the sum over all absorbers.
    """
    history = require_recorded("history", response.history)
    absorber = response.scene.absorber
    if absorber is None:
        return 0.0
    shapes = response.scene.absorber_shapes.T
    samples = len(history.time)
    if name == STROKE:
        return float(
            np.max(
                np.abs(
                    history.absorber_displacement.reshape(samples, -1)
                    - history.modal_displacement @ shapes
                )
            )
        )
    speed = np.abs(history.absorber_velocity.reshape(samples, -1) - history.modal_velocity @ shapes)
    speed = speed[history.time >= settled_after(response)]
    every = absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,)
    limits = [
        a.friction.limit if isinstance(a, SlidingAbsorber) and a.friction is not None else 0.0
        for a in every
    ]
    return float(np.mean(speed, axis=0) @ np.array(limits))  # sticking loses nothing


def turning_points(values: Array) -> Array:
    """Return first, last and local extrema of samples (S,), each extremum once."""
    moved = values[np.concatenate([[True], np.diff(values) != 0])]
    if len(moved) < 3:
        return moved
    turns = (
        np.sign(np.diff(moved[:-1])) * np.sign(np.diff(moved[1:])) < 0
    )  # of signs: products of tiny steps are zero
    return moved[np.concatenate([[True], turns, [True]])]


def rainflow_amplitudes(values: Array) -> tuple[Array, Array]:
    """Return amplitudes and counts of the rainflow cycles of samples (S,).

    Amplitudes are half ranges. Counts are 1, or 0.5 for cycles that remain open.

    The four-point rule: a range between two larger-or-equal neighbours is a closed cycle and is
    taken out; the rest counts by halves.
    """
    amplitudes: list[float] = []
    stack: list[float] = []
    for point in turning_points(values).tolist():
        stack.append(point)
        while len(stack) >= 4:
            inner = abs(stack[-2] - stack[-3])
            if inner > abs(stack[-1] - stack[-2]) or inner > abs(stack[-3] - stack[-4]):
                break
            amplitudes.append(inner / 2)
            del stack[-3:-1]
    rest = np.abs(np.diff(stack)) / 2 if len(stack) > 1 else np.empty(0)
    return np.concatenate([np.array(amplitudes), rest]), np.concatenate(
        [np.ones(len(amplitudes)), np.full(len(rest), 0.5)]
    )


def fatigue_damage(values: Array, exponent: float) -> float:
    """Return the fatigue damage of samples by Miner's rule on a straight Basquin line.

    It is the sum over the rainflow cycles of count times amplitude to the power of ``exponent``.
    """
    amplitudes, counts = rainflow_amplitudes(values)
    return float(np.sum(counts * amplitudes**exponent))
