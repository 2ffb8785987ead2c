"""The motion on which a run ends: without impacts, periodic, quasi-periodic or chaotic.

The module also computes the features by which attractors are compared.

Runs use the exact method. They begin at any phase of the force, and their states are compared once
in each period of the force, at phase 0: the stroboscopic section.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    one_of,
    require,
)
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Lane, LaneProgress, each_lane
from impact_env.fields import check_fields
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.quasi_periodic import LEAST_POINTS, RotationNumber, rotation_number
from impact_env.periodic.residence import SILENT_PERIODS
from impact_env.periodic.shooting import (
    INDEPENDENT_BLOCKS,
    SETTLING_STRETCHES,
    STRETCH_LENGTH,
    Exponent,
    exponent_of,
    units_of,
)
from impact_env.periodic.survey import RETURN_TOL, orbit_next_to
from impact_env.results import History, Record
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]
SAMPLES = 16  # in a period of the force, for level and symmetry; even
CHUNK = int(SILENT_PERIODS)  # periods after which a run is examined
COMPARED_PERIODS = 24  # last periods of a chunk that a periodic motion repeats in
SETTLED_TOL = 1e-6  # of gap and gap times omega: a motion that repeats so closely has settled
ALTERNATING = 100  # times that tolerance: what an orbit of a doubled period differs by after half
CAPTURE_TOL = 0.05  # the same units: a run stays this close to its attractor once it is captured
TWIN_DISTANCE = 1e-8  # the same units: of a neighbouring run, whose growth is the exponent
LEAST_GROWTH = 1e-8  # of a neighbouring run's distance: below it rounding is all that is left
FAST_GROWTH = 1.5  # exponent per period from which neighbouring runs last a single period
LONGER = 4  # times the window: of motions that it leaves undecided
EXPONENT_TOL = 0.01  # per period: half the width of an exponent's interval that decides
ROTATION_TOL = 1e-3  # turns: change of a rotation number that has converged
SPREAD_TOL = 0.1  # relative: a section whose size changes more from half to half has not settled
TANGENT_LEAD = SETTLING_STRETCHES * STRETCH_LENGTH  # periods in which a tangent vector turns
FREQUENCY = "frequency"
PARAMETERS = {  # of diagrams and basins: the field of `Case` for each name
    FREQUENCY: "omega",
    "force": "force",
    "gap": "gap",
    "restitution": "restitution",
    "friction-limit": "friction_limit",
    "mass-ratio": "mass_ratio",
}


class MotionKind(StrEnum):
    """Kinds of motion that a run ends on."""

    NO_IMPACTS = "no impacts"  # the absorber slides or is stuck
    PERIODIC = "periodic"
    QUASI_PERIODIC = "quasi-periodic"
    CHAOTIC = "chaotic"
    UNDECIDED = "undecided"  # still on its way, or none of these within the window


@dataclass(frozen=True)
class SettleOptions:
    """Lengths of the runs that find attractors.

    Attributes
    ----------
    periods : int
        Periods of the force after which a run is judged at the latest.
    window : int
        Further periods from which a motion that is not periodic is judged.
    most_multiple : int
        Longest period that is sought, in periods of the force.

    Raises
    ------
    ParameterError
        A number is out of range.
    """

    periods: int = 1000
    window: int = 512
    most_multiple: int = 8

    def __post_init__(self) -> None:
        least = STRETCH_LENGTH * INDEPENDENT_BLOCKS
        check_fields(
            self,
            periods=count_from(CHUNK),
            window=count_from(least),
            most_multiple=count_from(1, COMPARED_PERIODS // 2),
        )
        require(
            self.window >= LEAST_POINTS, "window", self.window, f"{LEAST_POINTS} periods or more"
        )


@dataclass(frozen=True, eq=False)
class PoincareSection:
    """Stroboscopic section of a motion, and its impacts.

    Attributes
    ----------
    states : array, (n, 2 N_m + 2)
        States at phase 0 of the force, one for each period.
    impact_phase : array, (K,)
        Phase of the force at each impact between these states, in rad.
    impact_velocity : array, (K,)
        Relative velocity absorber - structure before each impact in m/s.
    wall : array of int, (K,)
        Wall of each impact, -1 or 1.
    """

    states: Array
    impact_phase: Array
    impact_velocity: Array
    wall: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SettledMotion:
    """The motion on which a run ends, described by its last periods of the force.

    Attributes
    ----------
    case : Case
        Structure, absorber, force and frequency.
    kind : MotionKind
        Kind of the motion.
    multiple : int
        Periods of the force after which a periodic motion repeats, 0 for other kinds.
    symmetric : bool
        Whether half of a periodic motion is the mirror image of the other half.
    level : float
        Root mean square of the displacement at the place of the response level, in m.
    impacts_per_period : float
        Mean number of impacts in a period of the force.
    offset : float
        Mean relative displacement of the absorber over the gap; the mirror image has the opposite
        sign.
    state : (2 N_m + 2,) ndarray
        State at the end, at phase 0 of the force.
    section : PoincareSection
        Section over the periods from which the kind was determined.
    periods : int
        Length of the run in periods of the force.
    captured : int or None
        Periods from the start until the run stays close to the motion, None for a motion that is
        neither periodic nor without impacts.
    exponent : Exponent or None
        Largest Lyapunov exponent, of motions that do not repeat.
    rotation : RotationNumber or None
        Rotation number, of motions that do not repeat.
    """

    case: Case
    kind: MotionKind
    multiple: int
    symmetric: bool
    level: float
    impacts_per_period: float
    offset: float
    state: Array
    section: PoincareSection
    periods: int
    captured: int | None = None
    exponent: Exponent | None = None
    rotation: RotationNumber | None = None

    @property
    def name(self) -> str:
        """The kind of motion as text.

        It includes period and symmetry of a periodic motion, and the number of circles of a
        quasi-periodic one.
        """
        if self.kind is MotionKind.PERIODIC:
            return f"period {self.multiple}{', symmetric' if self.symmetric else ''}"
        if self.kind is MotionKind.QUASI_PERIODIC and self.rotation and self.rotation.circles > 1:
            return f"{self.kind}, {self.rotation.circles} circles"
        return str(self.kind)

    def orbit(self) -> Orbit | None:
        """Return the periodic orbit next to a periodic motion.

        It is found by Newton's method. The result is None if none is found.
        """
        if self.kind is not MotionKind.PERIODIC:
            return None
        result = orbit_next_to(self.case, 0.0, self.state, self.symmetric, self.multiple)
        return result if isinstance(result, Orbit) else None

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        exponent = self.exponent
        rotation = self.rotation
        return {
            "kind": str(self.kind),
            "period": self.multiple or None,
            "symmetric": self.symmetric if self.multiple else None,
            "level_m": self.level,
            "impacts_per_period": self.impacts_per_period,
            "offset_over_gap": self.offset,
            "exponent_per_period": None if exponent is None else exponent.value,
            "exponent_low": None if exponent is None else exponent.low,
            "exponent_high": None if exponent is None else exponent.high,
            "rotation_number": None if rotation is None else rotation.value,
            "rotation_change": None if rotation is None else rotation.change,
            "circles": None if rotation is None else rotation.circles,
            "state": self.state.tolist(),
        }


def change_parameter(case: Case, name: str, value: float) -> Case:
    """Return the case with another value of one of `PARAMETERS`.

    A frequency is given relative to the first resonance.
    """
    field = PARAMETERS[one_of("parameter", name, tuple(PARAMETERS))]
    factor = float(case.model.omega[0]) if name == FREQUENCY else 1.0
    return case.changed(**{field: factor * value})


def parameter_of(case: Case, name: str) -> float:
    """Return the value of one of `PARAMETERS`; a frequency is relative to the first resonance."""
    return case.omega_ratio if name == FREQUENCY else float(getattr(case, PARAMETERS[name]))


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Whole periods of a run from phase 0 on.

    It has the states (n + 1, 2 N_m + 2) at phase 0, samples of displacements, and times (s),
    velocities (m/s) and impulses (N s) of the impacts.
    """

    states: Array
    displacement: Array  # where the response is read, in m
    relative: Array  # displacement of the absorber against the structure, in m
    samples: Array  # states at all samples
    time: Array
    velocity: Array
    impulse: Array


def _states_of(history: History) -> Array:
    return np.column_stack(
        [
            history.modal_displacement,
            history.absorber_displacement,
            history.modal_velocity,
            history.absorber_velocity,
        ]
    )


def _run(case: Case, state: Array, periods: int) -> _Stretch:
    """Run whole periods of the force from a state at phase 0."""
    record = Record(level=False, events=True, series=True, samples_per_period=SAMPLES)
    response = simulate(
        case.scene,
        Drive(case.force, constant_frequency(case.omega, 1.0, periods)),
        initial=InitialState.from_vector(case.scene, state),
        record=record,
    )
    history = response.recorded.history
    impacts = response.recorded.impacts
    samples = _states_of(history)[: periods * SAMPLES + 1]
    states = samples[::SAMPLES].copy()
    states[0] = state  # bit for bit, so that a run from it is the same run
    states[-1] = response.end_state
    return _Stretch(
        states,
        history.modal_displacement @ case.scene.model.level_shape,
        history.absorber_displacement - history.tip_displacement,
        samples,
        impacts.time,
        impacts.relative_velocity,
        impacts.impulse,
    )


def _to_phase_zero(case: Case, state: Array, phase: float) -> Array:
    """Return the state at the next time at which the force's phase is a whole number of turns.

    The run starts at ``phase`` (rad).
    """
    left = (-phase) % (2 * np.pi)
    if left < 1e-9:
        return state
    response = simulate(
        case.scene,
        case.drive(left / case.omega, phase),
        initial=InitialState.from_vector(case.scene, state),
        record=Record(level=False, events=True, series=True, samples_per_period=SAMPLES),
    )
    return response.end_state


def settle_motion(
    case: Case,
    state: Array | None = None,
    phase: float = 0.0,
    options: SettleOptions | None = None,
    *,
    with_exponent: bool = True,
) -> SettledMotion:
    """Return the motion on which a run ends.

    Parameters
    ----------
    case : Case
        Structure, absorber, force and frequency.
    state : array_like, (2 N_m + 2,), optional
        State at the start: modal displacements, the absorber's displacement in m, and their
        velocities. None: rest.
    phase : float, optional
        Phase of the force at the start, in rad.
    options : SettleOptions, optional
        Lengths of the runs.
    with_exponent : bool, optional
        Compute the largest Lyapunov exponent of a motion that does not repeat. False: such a motion
        is quasi-periodic if both halves of the window give the same rotation number, and else
        chaotic; `judge_motion` can add the exponent later.

    Returns
    -------
    SettledMotion
        A motion has no impacts if the last 100 periods have none, or if it repeats without any. It
        is periodic if its states at phase 0 repeat to within 1e-6 of gap and gap times omega, or to
        within 1e-3 at the end. Otherwise it is chaotic if the 95 % interval of its largest Lyapunov
        exponent lies above 0, and quasi-periodic if that interval contains 0, is at most 0.02 per
        period wide, both halves of the window give the same rotation number to within 1e-3, and the
        section keeps its size to within 10 %. For a motion that remains undecided, a window of four
        times the length is computed.

    Raises
    ------
    ParameterError
        The state has another length, or a number is out of range.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> from impact_env.periodic import Case, settle_motion
    >>> model = modal_model(Beam(modes=1))
    >>> settle_motion(Case(model, 0.95 * float(model.omega[0]), 0.1, gap=1e-3)).name
    'no impacts'
    """
    options = SettleOptions() if options is None else options
    size = 2 * case.model.modes + 2
    y = np.zeros(size) if state is None else np.array(state, dtype=np.float64)
    ok = y.shape == (size,) and bool(np.all(np.isfinite(y)))
    require(ok, "state", state, f"{size} finite numbers: modes, absorber, and their velocities")
    y = _to_phase_zero(case, y, phase)
    unit = units_of(case)
    passed: list[Array] = []
    last_impact = 0.0
    done = 0
    while done < options.periods:
        span = min(CHUNK, options.periods - done) if options.periods - done < 2 * CHUNK else CHUNK
        stretch = _run(case, y, span)
        y = stretch.states[-1]
        passed.append(stretch.states[:-1])
        if len(stretch.time):
            last_impact = done + float(stretch.time[-1]) / case.period
        done += span
        if len(stretch.time) == 0 and span == CHUNK:
            return _settled(
                case, MotionKind.NO_IMPACTS, stretch, COMPARED_PERIODS, done, round(last_impact)
            )
        if len(stretch.time) == 0:
            continue
        near = SETTLED_TOL if done < options.periods else RETURN_TOL
        multiple = _find_multiple(stretch.states / unit, options.most_multiple, near)
        if multiple and last_impact < done - COMPARED_PERIODS:  # what repeats has no impacts
            return _settled(
                case, MotionKind.NO_IMPACTS, stretch, COMPARED_PERIODS, done, round(last_impact)
            )
        if multiple:
            captured = _capture_time(np.concatenate(passed) / unit, stretch.states / unit, multiple)
            return _settled(
                case,
                MotionKind.PERIODIC,
                stretch,
                COMPARED_PERIODS // multiple * multiple,
                done,
                captured,
                multiple=multiple,
                symmetric=_is_symmetric(stretch.samples / unit, multiple, max(near, RETURN_TOL)),
            )
    if with_exponent:
        return _judge_longer(case, y, done, options, last_impact)
    window = TANGENT_LEAD + options.window
    stretch = _run(case, y, window)
    late = _settled_late(case, stretch, done, options, last_impact)
    if late is not None:
        return late
    points = stretch.states[:-1] / unit
    rotation = _find_rotation(stretch, points, options)
    kind = MotionKind.QUASI_PERIODIC if _is_circle(rotation, points) else MotionKind.CHAOTIC
    return _settled(case, kind, stretch, window, done + window, None, rotation=rotation)


def judge_motion(motion: SettledMotion, options: SettleOptions | None = None) -> SettledMotion:
    """Return a motion that does not repeat with its largest exponent and its kind.

    The exponent is computed over the same window, and the kind follows from it. Other motions are
    returned unchanged.
    """
    if motion.exponent is not None or motion.captured is not None:
        return motion
    options = SettleOptions() if options is None else options
    before = motion.periods - len(motion.section.states)
    return _judge_longer(motion.case, motion.section.states[0], before, options, float(before))


def _find_rotation(
    stretch: _Stretch, points: Array, options: SettleOptions
) -> RotationNumber | None:
    if len(stretch.time) == 0:
        return None
    return rotation_number(points, options.most_multiple)


def _judge_longer(
    case: Case, y: Array, done: int, options: SettleOptions, last_impact: float
) -> SettledMotion:
    """Return the motion of a run from a state (2 N_m + 2,) ``y``, if it does not repeat.

    ``done`` periods precede the state, and ``last_impact`` is the number of periods from the start
    to the last impact before it. If a window does not decide the kind of motion, a longer window is
    computed.
    """
    lead = TANGENT_LEAD
    unit = units_of(case)
    for window in (options.window, LONGER * options.window):
        stretch = _run(case, y, lead + window)
        late = _settled_late(case, stretch, done, options, last_impact)
        if late is not None:
            return late
        exponent = exponent_of(_twin_growth(case, stretch.states, STRETCH_LENGTH))
        if not exponent.value < FAST_GROWTH:
            exponent = exponent_of(_twin_growth(case, stretch.states, 1))
        points = stretch.states[lead:-1] / unit
        rotation = _find_rotation(stretch, points, options)
        kind = _judge(exponent, rotation, points)
        if kind is not MotionKind.UNDECIDED or rotation is None:
            break
    return _settled(
        case,
        kind,
        stretch,
        window,
        done + lead + window,
        None,
        exponent=exponent,
        rotation=rotation,
    )


def _settled_late(
    case: Case, stretch: _Stretch, done: int, options: SettleOptions, last_impact: float
) -> SettledMotion | None:
    """Return the motion on which a run of at least the window has settled.

    The motion is periodic or without impacts. The result is None if the run has not settled.
    """
    points = stretch.states / units_of(case)
    last = last_impact
    if len(stretch.time):
        last = done + float(stretch.time[-1]) / case.period
    end = done + len(points) - 1
    if last < end - CHUNK:
        captured = round(last)
        return _settled(case, MotionKind.NO_IMPACTS, stretch, COMPARED_PERIODS, end, captured)
    multiple = _find_multiple(points, options.most_multiple, SETTLED_TOL)
    if not multiple:
        return None
    if last < end - COMPARED_PERIODS:
        return _settled(case, MotionKind.NO_IMPACTS, stretch, COMPARED_PERIODS, end, round(last))
    return _settled(
        case,
        MotionKind.PERIODIC,
        stretch,
        COMPARED_PERIODS // multiple * multiple,
        end,
        done + _capture_time(points[:-1], points, multiple),
        multiple=multiple,
        symmetric=_is_symmetric(stretch.samples / units_of(case), multiple, RETURN_TOL),
    )


def _is_circle(rotation: RotationNumber | None, points: Array) -> bool:
    """Return whether a rotation number has converged, on a section that keeps its size."""
    if rotation is None or rotation.change > ROTATION_TOL:
        return False
    half = len(points) // 2
    sizes = [float(np.linalg.norm(np.std(part, axis=0))) for part in (points[:half], points[half:])]
    return sizes[0] > 0 and abs(sizes[1] / sizes[0] - 1) <= SPREAD_TOL


def _judge(exponent: Exponent, rotation: RotationNumber | None, points: Array) -> MotionKind:
    if exponent.chaotic:
        return MotionKind.CHAOTIC
    neutral = exponent.high >= 0 and exponent.high - exponent.low <= 2 * EXPONENT_TOL
    if neutral and _is_circle(rotation, points):
        return MotionKind.QUASI_PERIODIC
    return MotionKind.UNDECIDED


def _settled(
    case: Case,
    kind: MotionKind,
    stretch: _Stretch,
    window: int,
    before: int,
    captured: int | None,
    *,
    multiple: int = 0,
    symmetric: bool = False,
    exponent: Exponent | None = None,
    rotation: RotationNumber | None = None,
) -> SettledMotion:
    """Return the motion with the features of the last ``window`` periods of a stretch."""
    lead = len(stretch.states) - 1 - window
    inside = stretch.time >= lead * case.period
    phase = (case.omega * stretch.time[inside]) % (2 * np.pi)
    section = PoincareSection(
        stretch.states[lead:-1],
        phase,
        stretch.velocity[inside],
        -np.sign(stretch.impulse[inside]).astype(np.int64),
    )
    samples = slice(lead * SAMPLES, -1)
    return SettledMotion(
        case,
        kind,
        multiple,
        symmetric,
        float(np.sqrt(np.mean(stretch.displacement[samples] ** 2))),
        float(np.sum(inside)) / window,
        float(np.mean(stretch.relative[samples])) / case.gap,
        stretch.states[-1],
        section,
        before,
        captured,
        exponent,
        rotation,
    )


def _find_multiple(states: Array, most: int, near: float) -> int:
    """Return the least number of periods after which the last states repeat, 0 if they do not.

    ``states`` (n, d) repeat if their distance is below ``near``. The result is also 0 if they
    almost repeat after a part of these periods, because a slow alternating approach looks like a
    doubled period.
    """
    last = states[-COMPARED_PERIODS:]
    misses = [
        float(np.max(np.abs(last[multiple:] - last[:-multiple]))) for multiple in range(1, most + 1)
    ]
    for multiple, miss in enumerate(misses, 1):
        if miss >= near:
            continue
        parts = [misses[part - 1] for part in range(1, multiple) if multiple % part == 0]
        return multiple if min(parts, default=np.inf) > ALTERNATING * near else 0
    return 0


def _is_symmetric(samples: Array, multiple: int, near: float) -> bool:
    """Return whether the last period of a motion is its own mirror image half a period later."""
    if multiple % 2 == 0:
        return False
    half = multiple * SAMPLES // 2
    last = samples[-2 * half - 1 :]
    return bool(np.max(np.abs(last[half:] + last[: half + 1])) < near)


def _capture_time(passed: Array, last: Array, multiple: int) -> int:
    """Return the number of periods before a run stays within `CAPTURE_TOL` of its periodic motion.

    ``passed`` (n, d) are the states at phase 0, and ``last`` those of the motion's last periods.
    """
    final = last[-multiple - 1 : -1]  # phase k of the motion at period len(passed) - multiple + k
    places = (np.arange(len(passed)) - len(passed)) % multiple
    far = np.max(np.abs(passed - final[places]), axis=1) > CAPTURE_TOL
    return int(np.max(np.flatnonzero(far), initial=-1)) + 1


def _twin_growth(case: Case, states: Array, periods: int) -> Array:
    """Return the logarithmic growth per period in neighbouring runs of ``periods`` periods each.

    The runs begin close to the states (n, d) of a run at phase 0. Each next one begins at the same
    small distance in the direction in which the last one ended. The mean growth is the largest
    Lyapunov exponent per period (Benettin et al., Meccanica 15, 1980).
    """
    unit = units_of(case)
    rng = np.random.default_rng(0)
    vector = rng.normal(size=len(unit))
    vector /= np.linalg.norm(vector)
    drive = case.drive(periods * case.period, 0.0)
    record = Record(level=False, events=True)
    growth = []
    for k in range(0, len(states) - periods, periods):
        twin = states[k] + TWIN_DISTANCE * unit * vector
        initial = InitialState.from_vector(case.scene, twin)
        end = simulate(case.scene, drive, initial=initial, record=record).end_state
        vector = (end - states[k + periods]) / unit / TWIN_DISTANCE
        size = float(np.linalg.norm(vector))
        growth.append(np.log(max(size, LEAST_GROWTH)))
        if size < LEAST_GROWTH:
            vector = rng.normal(size=len(unit))
            size = float(np.linalg.norm(vector))
        vector = vector / size
    settling = SETTLING_STRETCHES * STRETCH_LENGTH // periods
    return np.array(growth[settling:]) / periods


def _settle_lane(options: SettleOptions, with_exponent: bool, lane: Lane) -> SettledMotion:
    case = case_of(lane.scene, lane.drive.amplitude, float(lane.drive.schedule.omegas[0]))
    initial = lane.initial
    state = None if initial is None else initial.vector(lane.scene)
    return settle_motion(case, state, lane.drive.phase, options, with_exponent=with_exponent)


def settle_runs(
    starts: Sequence[tuple[Case, Array, float]],
    options: SettleOptions | None = None,
    *,
    with_exponent: bool = True,
    threads: int | None = None,
    progress: LaneProgress | None = None,
) -> list[SettledMotion | None]:
    """Return the motions on which runs end, computed on several threads.

    ``starts`` contains case, state (2 N_m + 2,) and phase (rad) of each run. The list has a motion
    for each start, None for runs that an interrupt prevented. Other arguments are as in
    `settle_motion` and `run_lanes`.
    """
    options = SettleOptions() if options is None else options
    lanes = [
        Lane(
            case.scene,
            case.drive(case.period, phase),
            initial=InitialState.from_vector(case.scene, state),
        )
        for case, state, phase in starts
    ]
    measure = partial(_settle_lane, options, with_exponent)
    return each_lane(lanes, measure, threads=threads, progress=progress)


FeatureDistance = Callable[[SettledMotion, SettledMotion], float]
REGULAR_TOL = (
    0.02  # of the features of motions that are periodic, quasi-periodic or without impacts
)
CHAOTIC_TOL = 0.2  # of the others, whose means vary from window to window


def feature_distance(one: SettledMotion, other: SettledMotion) -> float:
    """Return the largest difference of two motions' features, a number without unit.

    The features are: levels, relative to the larger one; impacts per period, relative to the larger
    one or 1; and absolute offsets (over the gap). Mirror images have distance 0. Without impacts
    only levels count.
    """
    level = abs(one.level - other.level) / max(one.level, other.level, 1e-300)
    if one.kind is MotionKind.NO_IMPACTS and other.kind is MotionKind.NO_IMPACTS:
        return level
    most = max(1.0, one.impacts_per_period, other.impacts_per_period)
    impacts = abs(one.impacts_per_period - other.impacts_per_period) / most
    return max(level, impacts, abs(abs(one.offset) - abs(other.offset)))


def group_motions(motions: Sequence[SettledMotion]) -> Iterator[list[int]]:
    """Yield lists of indices of the motions that belong to one attractor or its mirror image.

    They have the same kind and period, and features within 0.02 of those of the group's first
    motion (0.2 for chaotic and undecided motions).
    """
    groups: list[list[int]] = []
    for k, motion in enumerate(motions):
        regular = motion.kind not in (MotionKind.CHAOTIC, MotionKind.UNDECIDED)
        tolerance = REGULAR_TOL if regular else CHAOTIC_TOL
        for group in groups:
            first = motions[group[0]]
            same = (first.kind, first.multiple) == (motion.kind, motion.multiple)
            if same and feature_distance(first, motion) <= tolerance:
                group.append(k)
                break
        else:
            groups.append([k])
    yield from groups
