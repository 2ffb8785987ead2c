"""From an orbit to the branch that leaves its own where a multiplier is -1.

Over half a period of a symmetric orbit that multiplier breaks the symmetry, and leads to the pair without it; over the period of an orbit without
symmetry it doubles the period. A symmetric orbit does not double its period in one parameter: that would take a pair of half-period multipliers at
+i and -i, and their modulus and angle are two conditions (Swift and Wiesenfeld, Phys. Rev. Lett. 52, 1984).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import STOPPED, Located
from impact_env.periodic.continuation import Problem, Progress, Steps, switched
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.green import Conditions, NoOrbit, Solution, solve, unknowns_of
from impact_env.periodic.locating import BRANCH_POINT
from impact_env.periodic.orbit_branches import lies_on, places_of
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.tracing import PARAMETER_SHARE, PERIOD_DOUBLING, STEPS, SYMMETRY_BREAKING, OrbitBranch, orbit_branch

LEAST = 1e-4  # of what tells the two halves apart: below it is the orbit that was left
SIZES = (0.02, 0.05, 0.01, 0.1)  # of arclength: how far from the branch point the other branch is sought, in turn


def whole_period(solution: Solution) -> Solution:
    """Return a symmetric orbit with the events of its whole period, the second half the mirror image of the first.

    Raises ParameterError for a solution that is none.
    """
    require(solution.schedule.symmetric, "schedule", str(solution.schedule), "one of a symmetric orbit")
    return _listed_twice(solution, -1.0)


def twice(solution: Solution) -> Solution:
    """Return an orbit without symmetry with the events of two of its periods; raises ParameterError for a symmetric one."""
    require(not solution.schedule.symmetric, "schedule", str(solution.schedule), "one without symmetry")
    return _listed_twice(solution, 1.0)


def _listed_twice(solution: Solution, side: float) -> Solution:
    """Return the solution with its events and, behind them, what they are a span later: the mirrored ones if ``side`` is -1."""
    old = solution.schedule
    events = (*old.events, *((event.mirrored for event in old.events) if side < 0 else old.events))
    phases = np.concatenate([solution.phases, solution.phases + old.turn])
    impulses = np.concatenate([solution.impulses, side * solution.impulses])
    schedule = EventSchedule(events, False, old.period_multiple * (1 if side < 0 else 2))
    return Solution(solution.case, schedule, phases, impulses, solution.offset, solution.error, solution.steps)


def asymmetric_branches(
    orbits: OrbitBranch, limits: tuple[float, float], steps: Steps = STEPS, progress: Progress | None = None
) -> tuple[OrbitBranch, ...]:
    """Return the branch of the pair for each place at which the symmetry breaks on a branch of symmetric orbits, within limits of its parameter.

    Both of a pair lie on one branch, which goes through the place; one that goes through several is followed
    once. What leads to no orbit is left out; `OrbitBranch.of` lists the places. Ctrl-C ends the last branch early.
    """
    return _followed(leaving(orbits, SYMMETRY_BREAKING), orbits.branch.parameter, limits, steps, progress)


def doubled_branches(
    orbits: OrbitBranch, limits: tuple[float, float], steps: Steps = STEPS, progress: Progress | None = None
) -> tuple[OrbitBranch, ...]:
    """Return the branch of twice the period for each place at which a multiplier of an orbit without symmetry is -1, as `asymmetric_branches` does.

    Its `EventSchedule.period_multiple` is twice that of ``orbits``; to go on from period doubling to period doubling call it with what it returns.
    """
    return _followed(leaving(orbits, PERIOD_DOUBLING), orbits.branch.parameter, limits, steps, progress)


def leaving(orbits: OrbitBranch, kind: str) -> Iterator[Solution]:
    """Yield a solution beside each place of a branch at which the symmetry breaks or the period doubles (``kind``), on the branch that leaves there.

    A place from which no such solution is found is left out.
    """
    require(kind in (SYMMETRY_BREAKING, PERIOD_DOUBLING), "kind", kind, f"{SYMMETRY_BREAKING} or {PERIOD_DOUBLING}")
    side, listed_twice = (-1.0, whole_period) if kind == SYMMETRY_BREAKING else (1.0, twice)
    for motion in orbits.of(kind):
        found = _beside(listed_twice(motion.solution), side, orbits.branch.parameter)
        if found is not None:
            yield found


def _followed(
    starts: Iterable[Solution], parameter: str, limits: tuple[float, float], steps: Steps, progress: Progress | None
) -> tuple[OrbitBranch, ...]:
    found: list[OrbitBranch] = []
    for solution in starts:
        if not any(lies_on(places_of(branch), solution) for branch in found):
            found.append(orbit_branch(solution, parameter, limits, steps, progress))
            if found[-1].branch.ended == STOPPED:
                break
    return tuple(found)


def _beside(solution: Solution, side: float, parameter: str) -> Solution | None:
    """Return an orbit of the branch that leaves at a solution whose second half is its first one, times ``side``; None if no point of it is found."""
    conditions = Conditions(solution.case, solution.schedule, parameter)
    value = getattr(solution.case, parameter)
    problem = Problem(conditions, parameter, 1.0, PARAMETER_SHARE * (abs(value) if value != 0 else 1.0))
    z = unknowns_of(solution)
    system = problem.system(len(z), Steps())
    along = _tangent_alike(system(system.scaled(z, value))[1], solution, side)
    for size in SIZES:
        try:
            point, there, _ = switched(problem, Located(BRANCH_POINT, 0, z, value, along), size)[0]
        except NoConvergenceError:
            continue
        found = solve(solution.case.changed(**{parameter: there}), solution.schedule, _in_units(point, solution, parameter, there))
        if not isinstance(found, NoOrbit) and _unlike(found, side) > LEAST:
            return found
    return None


def _in_units(point: NDArray[np.float64], solution: Solution, parameter: str, value: float) -> NDArray[np.float64]:
    """Return unknowns (m,) in the units of the case at another value of the parameter."""
    own, new = solution.case.scale, solution.case.changed(**{parameter: value}).scale
    n, m = len(solution.schedule.events), solution.schedule.impacts
    units = np.concatenate([np.ones(n), np.full(m, own.impulse / new.impulse), np.full(len(point) - n - m, own.length / new.length)])
    return np.asarray(units * point)


def _unlike(solution: Solution, side: float) -> float:
    """Return by how much the second half is not the first one times ``side``: phases in rad, and shares of the largest impulse."""
    half = len(solution.phases) // 2
    late = solution.phases[half:] - solution.phases[:half] - solution.schedule.turn / 2
    stronger = (solution.impulses[half:] - side * solution.impulses[:half]) / np.max(np.abs(solution.impulses))
    return float(max(np.max(np.abs(late)), np.max(np.abs(stronger))))


def _tangent_alike(jacobian: NDArray[np.float64], solution: Solution, side: float) -> NDArray[np.float64]:
    """Return the unit tangent of the branch that is left (m + 1,): the direction of the Jacobian's kernel in which both halves move alike."""
    n, m = len(solution.schedule.events), solution.schedule.impacts
    shift = np.zeros((jacobian.shape[1], jacobian.shape[1]))
    for begin, size, sign in ((0, n, 1.0), (n, m, side)):
        index = np.arange(begin, begin + size)
        shift[index, np.roll(index, size // 2)] = sign
    shift[-2, -2], shift[-1, -1] = side, 1.0
    plane = np.linalg.svd(jacobian)[2][-2:]
    alike = plane @ (shift + np.eye(len(shift))) @ plane.T
    weights = np.linalg.eigh(0.5 * (alike + alike.T))[1][:, -1]
    found = weights @ plane
    return np.asarray(found / np.linalg.norm(found))
