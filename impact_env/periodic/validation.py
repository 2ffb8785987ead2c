"""Validation of an orbit by the exact method.

The method propagates the orbit's state over a period, with its own search for events, and must
return to this state.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.exact.rigid import rigid_lane
from impact_env.periodic.case import Case
from impact_env.periodic.motion import AnyMotion
from impact_env.periodic.passage import RECORD
from impact_env.periodic.schedule import Regime
from impact_env.prepare import run_alongside
from impact_env.results import Record, Response
from impact_env.scene import InitialState
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
RESIDUAL_BAR = 1e-10  # residual of an orbit that counts
CHATTER_BAR = 3e-10  # the same, of an orbit on which a chatter comes to its end
EVENT_BAR = (
    1e-6  # rad: how far an event may lie from where the orbit has it; the residual says the rest
)
PHASE_BAR = (
    1e-5  # rad: the same for a joined phase, whose ends lie as sharply as the root of a distance
)
# of the largest impulse: bounces below it are not compared one by one, a chatter has as many as
# rounding lets it have
FAINT_IMPULSE = 1e-5
JOINED_FOR_A_WHILE = "friction or a wall holds the absorber for a while"


@dataclass(frozen=True)
class Validation:
    """The validation of a motion by the exact method.

    Impacts are compared one by one. A wrong reversal in the schedule appears in the residual,
    because friction would have the wrong sign.

    Attributes
    ----------
    residual : float
        Largest difference of the state after a period (for a symmetric orbit the mirrored state
        after half a period): displacements over the gap, velocities over gap times omega.
    reason : str or None
        Reason why the motion is no orbit, None if it is an orbit.
    response : Response or None
        The run, None if it broke down or there were several.
    start : float
        Phase of the force at the run's start, in rad.
    """

    residual: float
    reason: str | None
    response: Response | None = None
    start: float = 0.0


def shortest_validation(case: Case) -> None:
    """Make a short run, a hundredth of a period, that needs the kernels of a validation."""
    simulate(case.scene, case.drive(0.01 * case.period, 0.0), record=RECORD)


def validation_alongside(case: Case) -> AbstractContextManager[None]:
    """Let another process compile the kernels for validations of such a case.

    This process compiles the kernels that find orbits at the same time, see `run_alongside`.
    """
    return run_alongside(rigid_lane, partial(shortest_validation, case))


def propagate_orbit(motion: AnyMotion, record: Record) -> tuple[Response, float]:
    """Return the exact method's run over the span of the schedule, and its first phase (rad).

    The run starts in the middle of the longest flight.
    """
    start, state = motion.mid_flight()
    return _run(motion, start, state, record), start


def iterate_map(motion: AnyMotion, start: float, state: Array) -> Array:
    """Return the state after the schedule's span by the exact method.

    The run starts from a state (2 N_m + 2,) at a phase (rad). The result is mirrored if the span is
    half a period.
    """
    end = _run(motion, start, state, RECORD).end_state
    return np.asarray(-end if motion.solution.schedule.symmetric else end)


def _run(
    motion: AnyMotion, start: float, state: Array, record: Record, turn: float | None = None
) -> Response:
    case = motion.solution.case
    n = motion.solution.case.model.modes
    initial = InitialState(state[:n], state[n + 1 : -1], float(state[n]), float(state[-1]))
    turn = motion.solution.schedule.turn if turn is None else turn
    return simulate(
        case.scene, case.drive(turn / case.omega, start), initial=initial, record=record
    )


def _compare_events(motion: AnyMotion, runs: Sequence[Response], starts: Array) -> str | None:
    """Return the difference between the events of runs and of a motion as text, None if they agree.

    The runs start at ``starts`` (rad). The faintest bounces of a chatter are not compared.
    """
    case = motion.solution.case
    schedule = motion.solution.schedule
    start = float(starts[0])
    impacted = [run.impacts for run in runs if run.impacts is not None]
    joining = [run.phases for run in runs if run.phases is not None]
    hits = np.array([event.is_impact for event in schedule.events])
    # ascending phases within one span after the start; in a mirrored span impulses change sign
    phases = motion.solution.phases[hits]
    rounds = -np.floor((phases - start) / schedule.turn)
    mirror = np.where(rounds % 2 == 1, -1.0, 1.0) if schedule.symmetric else 1.0
    impacts = np.array(
        [phases + rounds * schedule.turn - start, motion.solution.impulses[hits] * mirror]
    )
    impacts = impacts[:, np.argsort(impacts[0], kind="stable")]
    after = starts - start
    result = np.hstack(
        [
            [case.omega * each.time + at, each.impulse]
            for each, at in zip(impacted, after, strict=True)
        ]
    )
    begins, ends = (
        np.concatenate(
            [case.omega * getattr(each, name) + at for each, at in zip(joining, after, strict=True)]
        )
        for name in ("start", "end")
    )
    if schedule.flies:
        if len(begins) > 0:
            return JOINED_FOR_A_WHILE
        if result.shape != impacts.shape:
            return f"{result.shape[1]} impacts instead of {impacts.shape[1]}"
    faint = FAINT_IMPULSE * max(
        (float(np.max(np.abs(rows[1]))) for rows in (impacts, result) if rows.size), default=0.0
    )
    for rows, others in ((impacts, result), (result, impacts)):
        for phase, impulse in rows[:, np.abs(rows[1]) > faint].T:
            near = np.abs(others[0] - phase) <= EVENT_BAR
            if not np.any(near):
                return "impacts at other times"
            if np.all(np.sign(others[1][near]) != np.sign(impulse)):
                return "impacts on other walls"
    known = joins_for_a_while(motion, start)
    merged = merge_chatter(begins, ends)
    if known.shape != merged.shape:
        return f"{merged.shape[1]} joined phases instead of {known.shape[1]}"
    return (
        "joined phases at other times"
        if merged.size and np.max(np.abs(known - merged)) > PHASE_BAR
        else None
    )


def joins_for_a_while(motion: AnyMotion, start: float) -> Array:
    """Return the beginnings and ends of a motion's joined phases within one span, (2, K).

    The span starts at the phase ``start`` (rad). The beginnings and ends are in rad after it.
    """
    schedule = motion.solution.schedule
    phases = motion.solution.phases
    joined = np.array([event.regime is Regime.JOINED for event in schedule.events])
    begins = phases[joined]
    ends = np.append(phases[1:], phases[0] + schedule.turn)[joined]
    rounds = np.floor((begins - start) / schedule.turn) * schedule.turn + start
    return merge_chatter(begins - rounds, ends - rounds)


def merge_chatter(begins: Array, ends: Array) -> Array:
    """Return intervals (2, K) from beginnings and ends, (n,) each, without chatter.

    Intervals that are closer than `PHASE_BAR` are merged (wall contact followed by stick, for
    example), and shorter ones are removed.
    """
    rows: list[list[float]] = []
    for begin, end in sorted(zip(begins.tolist(), ends.tolist(), strict=True)):
        if rows and begin <= rows[-1][1] + PHASE_BAR:
            rows[-1][1] = max(end, rows[-1][1])
        else:
            rows.append([begin, end])
    return np.array([row for row in rows if row[1] - row[0] > PHASE_BAR]).reshape(-1, 2).T


def chatters(case: Case, response: Response) -> bool:
    """Return whether a chatter ends in wall contact in a run."""
    return (
        response.phases is not None
        and case.restitution > 0
        and bool(np.any(response.phases.kind != 0))
    )


def validate(motion: AnyMotion) -> Validation:
    """Return the validation of a motion by the exact method.

    A run that breaks down is a reason to reject the motion, too. Over several periods of the force
    an unstable orbit amplifies rounding errors by its multipliers. Each period is then run from the
    motion's own state, and must end at the motion's state one period later.
    """
    sections = _sections(motion)
    try:
        runs = [
            _run(motion, a, motion.state_at(a), RECORD, b - a)
            for a, b in pairwise(sections.tolist())
        ]
    except IntegrationError as error:
        return Validation(float("inf"), str(error))
    case = motion.solution.case
    velocities = case.model.modes + 1  # index of the first velocity of a state
    residuals = []
    for run, stop in zip(runs, sections[1:].tolist(), strict=True):
        miss = np.abs(run.end_state - motion.state_at(stop))
        largest = max(np.max(miss[:velocities]), np.max(miss[velocities:]) / case.omega)
        residuals.append(float(largest / case.gap))
    residual = max(residuals)
    reason = _compare_events(motion, runs, sections[:-1])
    bar = CHATTER_BAR if chatters(case, runs[0]) else RESIDUAL_BAR
    if reason is None and not residual <= bar:
        reason = f"the exact method comes back with a residual of {residual:.1e}, more than {bar:g}"
    return Validation(residual, reason, runs[0] if len(runs) == 1 else None, float(sections[0]))


def _sections(motion: AnyMotion) -> Array:
    """Return the phases (rad) between which a motion is run.

    They are the middle of the longest flight, the middle of a flight in each further period, and
    the first phase plus one span.
    """
    start = motion.mid_flight()[0]
    schedule = motion.solution.schedule
    span = np.array([start, start + schedule.turn])
    if not schedule.flies or schedule.turn <= 2 * np.pi:
        return span
    events = np.sort((motion.solution.phases - start) % schedule.turn) + start
    middles = 0.5 * (events[1:] + events[:-1])
    lengths = np.diff(events)
    inner = []
    for k in range(1, round(schedule.turn / (2 * np.pi))):
        near = np.flatnonzero(np.abs(middles - start - 2 * np.pi * k) < np.pi)
        inner += [float(middles[near[np.argmax(lengths[near])]])] if len(near) else []
    return np.sort(np.concatenate([span, inner]))
