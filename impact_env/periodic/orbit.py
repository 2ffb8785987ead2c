"""An orbit that stood its trial, and the way to it: solve, look between the events, mend the order, propagate, judge stability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit, Solution, solve
from impact_env.periodic.motion import Motion, motion_of
from impact_env.periodic.schedule import EventSchedule, flying_schedule
from impact_env.periodic.stability import Stability, derivative_of, stability_of
from impact_env.periodic.validation import trial_of

Array = NDArray[np.float64]
MOST_MENDINGS = 12


@dataclass(frozen=True, eq=False)
class Impact:
    """One impact: ``phase`` of the force in rad, ``impulse`` on the absorber in N s, ``wall`` -1 or 1."""

    phase: float
    impulse: float
    wall: int


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic orbit that the exact method confirmed: ``residual`` is that of its propagation (see `validation.Trial`)."""

    motion: Motion
    stability: Stability
    residual: float

    @property
    def solution(self) -> Solution:
        """Its events."""
        return self.motion.solution

    @property
    def case(self) -> Case:
        """Where it is."""
        return self.motion.solution.case

    @property
    def schedule(self) -> EventSchedule:
        """The order of its events."""
        return self.motion.solution.schedule

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """All impacts of a whole period, the mirrored half of a symmetric orbit too, by rising phase from 0 on."""
        schedule, solution, whole = self.schedule, self.solution, 2 * np.pi * self.schedule.period_multiple
        found = [
            Impact(float(p % whole), float(i), int(w)) for p, i, w in zip(solution.phases, solution.impulses, schedule.order.wall, strict=True) if w
        ]
        if schedule.symmetric:
            found += [Impact((impact.phase + schedule.turn) % whole, -impact.impulse, -impact.wall) for impact in found]
        return tuple(sorted(found, key=lambda impact: impact.phase))


def confirmed(motion: Motion, least_reversal: float, stability: Stability) -> Orbit | NoOrbit:
    """Return the orbit of a motion if the exact method confirms it, or why it is none."""
    reason = objection(motion, least_reversal)
    if reason is None:
        trial = trial_of(motion)
        if trial.reason is None:
            return Orbit(motion, stability, trial.residual)
        reason = trial.reason
    solution = motion.solution
    return NoOrbit(solution.case, solution.schedule, reason, solution.phases)


def objection(motion: Motion, least_reversal: float = np.inf) -> str | None:
    """Return what speaks against a motion without propagating it, or None: an impulse that pulls, a wall passed, friction in the wrong sense."""
    solution, schedule = motion.solution, motion.solution.schedule
    if np.any(solution.impulses * schedule.order.wall > 0):
        return "a wall would have to pull"
    if motion.penetration > 0:
        return f"the absorber passes a wall by {motion.penetration:.3g} m"
    if solution.case.friction_limit > 0 and (not motion.fits or len(motion.turns) != schedule.reversals):
        return f"the relative velocity turns {len(motion.turns)} times, not {schedule.reversals} times, between impacts"
    if least_reversal < 1:
        return "friction would hold the absorber at a reversal"
    return None


def orbit_at(case: Case, schedule: EventSchedule, start: ArrayLike, mend: bool = True) -> Orbit | NoOrbit:
    """Return the confirmed orbit near ``start`` (unknowns, or phases in rad), or why there is none.

    ``mend``: with friction the reversals of the schedule may be wrong at the start; they are then those that the motion shows, until both agree.
    """
    found = mended(case, schedule, start) if mend else settled(case, schedule, start)
    if isinstance(found, NoOrbit):
        return found
    matrix, least = derivative_of(found)
    return confirmed(found, least, stability_of(found, matrix))


def settled(case: Case, schedule: EventSchedule, start: ArrayLike) -> Motion | NoOrbit:
    """Return the motion of the solution near ``start``."""
    solution = solve(case, schedule, start)
    return solution if isinstance(solution, NoOrbit) else motion_of(solution)


def mended(case: Case, schedule: EventSchedule, start: ArrayLike) -> Motion | NoOrbit:
    """Return the motion near ``start`` whose schedule has the reversals that it shows.

    A schedule that does not settle within `MOST_MENDINGS` is returned as no orbit: where friction holds for a moment no order of reversals is right.
    """
    motion = settled(case, schedule, start)
    for _ in range(MOST_MENDINGS):
        if isinstance(motion, NoOrbit) or case.friction_limit == 0 or not motion.fits:
            return motion
        if len(motion.turns) == motion.solution.schedule.reversals and same_order(motion):
            return motion
        motion = settled(case, *reordered(motion))
    if isinstance(motion, NoOrbit):
        return motion
    return NoOrbit(case, motion.solution.schedule, "the order of its reversals does not settle", motion.solution.phases)


def same_order(motion: Motion) -> bool:
    """Return whether the turns seen lie between the same impacts as the schedule's reversals."""
    schedule, phases = reordered(motion)
    return schedule.events == motion.solution.schedule.events


def reordered(motion: Motion) -> tuple[EventSchedule, Array]:
    """Return the schedule with the turns that a motion shows as its reversals, and the phases (n,) of its events in rad."""
    solution, old = motion.solution, motion.solution.schedule
    hits = old.order.wall != 0
    phases = np.concatenate([solution.phases[hits], motion.turns])
    walls = np.concatenate([old.order.wall[hits], np.zeros(len(motion.turns), np.int64)])
    rank = np.argsort(phases, kind="stable")
    friction = solution.case.friction_limit > 0
    return flying_schedule(walls[rank].tolist(), friction, old.symmetric, old.period_multiple), phases[rank]
