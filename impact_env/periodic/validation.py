"""An orbit's trial: the exact method propagates its state over a period, finds the events by itself, and must come back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.motion import Motion
from impact_env.response import Record, Response
from impact_env.scene import InitialState
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
BAR = 1e-10  # residual of an orbit that counts
EVENT_BAR = 1e-6  # rad: how far an event may lie from where the orbit has it; the residual says the rest


@dataclass(frozen=True)
class Trial:
    """What the exact method says of a motion: ``residual`` of the return, and ``reason`` why it is no orbit, None if it is one.

    Impacts are compared one by one. A reversal that the schedule misses or invents shows in the residual: friction would push the wrong way. The
    residual is the largest difference of the state after a period (mirrored after half of one, for a symmetric orbit): displacements over the gap,
    velocities over gap times omega.
    """

    residual: float
    reason: str | None


def propagated(motion: Motion, record: Record) -> tuple[Response, float]:
    """Return the exact method's run over the span of the schedule and the phase (rad) it began at: in the middle of the longest flight."""
    start, state = motion.mid_flight()
    return _run(motion, start, state, record), start


def map_over(motion: Motion, start: float, state: Array) -> Array:
    """Return where the exact method takes a state (2 N_m + 2,) from a phase (rad) over the schedule's span, mirrored if that is half a period."""
    end = _run(motion, start, state, Record(level=False, events=True)).end_state
    return np.asarray(-end if motion.solution.schedule.symmetric else end)


def _run(motion: Motion, start: float, state: Array, record: Record) -> Response:
    case, n = motion.solution.case, motion.solution.case.model.modes
    initial = InitialState(state[:n], state[n + 1 : -1], float(state[n]), float(state[-1]))
    return simulate(case.scene, case.drive(motion.solution.schedule.turn / case.omega, start), initial=initial, record=record)


def residual_of(motion: Motion, response: Response, start: float) -> float:
    """Return the residual of a run that began at a phase ``start`` in rad."""
    case, n = motion.solution.case, motion.solution.case.model.modes
    mirror = -1.0 if motion.solution.schedule.symmetric else 1.0
    miss = np.abs(mirror * response.end_state - motion.state_at(start))
    return float(max(np.max(miss[: n + 1]), np.max(miss[n + 1 :]) / case.omega) / case.gap)


def _unlike(motion: Motion, response: Response, start: float) -> str | None:
    """Return how the events found differ from the schedule's, or None."""
    solution, case = motion.solution, motion.solution.case
    schedule, turn = solution.schedule, solution.schedule.turn
    assert response.impacts is not None
    assert response.phases is not None
    if len(response.phases.start) > 0:
        return "friction or a wall holds the absorber for a while"
    found = start + case.omega * response.impacts.time
    hits = schedule.order.wall != 0
    if len(found) != schedule.impacts:
        return f"{len(found)} impacts instead of {schedule.impacts}"
    rounds = np.where(solution.phases[hits] < start, 1, 0)
    mirror = -1.0 if schedule.symmetric else 1.0
    order = np.argsort(solution.phases[hits] + rounds * turn)
    phases = (solution.phases[hits] + rounds * turn)[order]
    impulses = (solution.impulses[hits] * mirror**rounds)[order]
    if np.max(np.abs(found - phases)) > EVENT_BAR:
        return "impacts at other times"
    if np.any(np.sign(response.impacts.impulse) != np.sign(impulses)):
        return "impacts on other walls"
    return None


def trial_of(motion: Motion) -> Trial:
    """Return the trial of a motion by the exact method; a run that breaks down is a reason too."""
    try:
        response, start = propagated(motion, Record(level=False, events=True))
    except IntegrationError as error:
        return Trial(float("inf"), str(error))
    residual = residual_of(motion, response, start)
    reason = _unlike(motion, response, start)
    if reason is None and not residual <= BAR:
        reason = f"the exact method comes back with a residual of {residual:.1e}, more than {BAR:g}"
    return Trial(residual, reason)
