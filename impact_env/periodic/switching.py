"""From a symmetric orbit to the pair without symmetry that leaves its branch where a half-period multiplier is -1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import Located
from impact_env.periodic.continuation import Problem, Progress, Steps, switched
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.green import Conditions, NoOrbit, Solution, solve, unknowns_of
from impact_env.periodic.locating import BRANCH_POINT
from impact_env.periodic.orbit_branches import lies_on, places_of
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.tracing import PARAMETER_SHARE, STEPS, SYMMETRY_BREAKING, OrbitBranch, orbit_branch

LEAST = 1e-4  # of what tells the two halves apart: below it is the symmetric orbit again
SIZES = (0.02, 0.05, 0.01, 0.1)  # of arclength: how far from the branch point the pair is sought, in turn


def whole_period(solution: Solution) -> Solution:
    """Return a symmetric orbit with the events of its whole period, the second half the mirror image of the first.

    Raises ParameterError for a solution that is none.
    """
    old = solution.schedule
    require(old.symmetric, "schedule", str(old), "one of a symmetric orbit")
    events = (*old.events, *(event.mirrored for event in old.events))
    phases = np.concatenate([solution.phases, solution.phases + old.turn])
    impulses = np.concatenate([solution.impulses, -solution.impulses])
    return Solution(solution.case, EventSchedule(events, False, old.period_multiple), phases, impulses, 0.0, solution.error, solution.steps)


def asymmetric_branches(
    orbits: OrbitBranch, limits: tuple[float, float], steps: Steps = STEPS, progress: Progress | None = None
) -> tuple[OrbitBranch, ...]:
    """Return the branch of the pair for each place at which the symmetry breaks on a branch of symmetric orbits, within limits of its parameter.

    Both of a pair lie on one branch, which goes through the place; one that goes through several is followed
    once. What leads to no orbit is left out; `OrbitBranch.of` lists the places.
    """
    found: list[OrbitBranch] = []
    for motion in orbits.of(SYMMETRY_BREAKING):
        solution = _of_pair(whole_period(motion.solution), orbits.branch.parameter)
        if solution is not None and not any(lies_on(places_of(branch), solution) for branch in found):
            found.append(orbit_branch(solution, orbits.branch.parameter, limits, steps, progress))
    return tuple(found)


def _of_pair(solution: Solution, parameter: str) -> Solution | None:
    """Return one of the pair next to a symmetric orbit at which the symmetry breaks, or None if no point of it is found."""
    conditions = Conditions(solution.case, solution.schedule, parameter)
    value = getattr(solution.case, parameter)
    problem = Problem(conditions, parameter, 1.0, PARAMETER_SHARE * (abs(value) if value != 0 else 1.0))
    z = unknowns_of(solution)
    system = problem.system(len(z), Steps())
    along = _symmetric_tangent(system(system.scaled(z, value))[1], solution)
    for size in SIZES:
        try:
            point, there, _ = switched(problem, Located(BRANCH_POINT, 0, z, value, along), size)[0]
        except NoConvergenceError:
            continue
        found = solve(solution.case.changed(**{parameter: there}), solution.schedule, _in_units(point, solution, parameter, there))
        if not isinstance(found, NoOrbit) and _lopsided(found) > LEAST:
            return found
    return None


def _in_units(point: NDArray[np.float64], solution: Solution, parameter: str, value: float) -> NDArray[np.float64]:
    """Return unknowns (m,) in the units of the case at another value of the parameter."""
    own, new = solution.case.scale, solution.case.changed(**{parameter: value}).scale
    n, m = len(solution.schedule.events), solution.schedule.impacts
    units = np.concatenate([np.ones(n), np.full(m, own.impulse / new.impulse), np.full(len(point) - n - m, own.length / new.length)])
    return np.asarray(units * point)


def _lopsided(solution: Solution) -> float:
    """Return by how much the second half is not the mirror image of the first: phases in rad, and shares of the largest impulse."""
    half = len(solution.phases) // 2
    late = solution.phases[half:] - solution.phases[:half] - solution.schedule.turn / 2
    stronger = (solution.impulses[half:] + solution.impulses[:half]) / np.max(np.abs(solution.impulses))
    return float(max(np.max(np.abs(late)), np.max(np.abs(stronger))))


def _symmetric_tangent(jacobian: NDArray[np.float64], solution: Solution) -> NDArray[np.float64]:
    """Return the unit tangent of the symmetric branch (m + 1,): the direction of the Jacobian's kernel in which both halves move alike."""
    n, m = len(solution.schedule.events), solution.schedule.impacts
    mirror = np.zeros((jacobian.shape[1], jacobian.shape[1]))
    for begin, size, sign in ((0, n, 1.0), (n, m, -1.0)):
        half = size // 2
        index = np.arange(begin, begin + size)
        mirror[index, np.roll(index, half)] = sign
    mirror[-2, -2], mirror[-1, -1] = -1.0, 1.0
    plane = np.linalg.svd(jacobian)[2][-2:]
    alike = plane @ (mirror + np.eye(len(mirror))) @ plane.T
    weights = np.linalg.eigh(0.5 * (alike + alike.T))[1][:, -1]
    found = weights @ plane
    return np.asarray(found / np.linalg.norm(found))
