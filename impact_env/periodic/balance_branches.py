"""All branches of harmonic balance over a range of frequencies: the main ones from its ends, isolas from exact orbits."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import STOPPED, Branch
from impact_env.periodic.case import Case
from impact_env.periodic.condensed import JointOfMass
from impact_env.periodic.continuation import Problem, Steps, both_ways, continuation
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.harmonic_balance import OMEGA, Balance
from impact_env.periodic.symmetric import closed_form
from impact_env.periodic.trigonometric import Real

Progress = Callable[[str, int, float], None]  # what is followed, number of points, frequency in rad/s
SEEDS = 24  # frequencies at which exact orbits are tried as starts
STEPS = Steps(first=0.02, most=0.15, least=1e-6, points=1500)
WIDTH = 0.05  # of the first frequency: the change of frequency that counts as much as a displacement of the size of the gap
NEAR, SAME = 0.2, 1e-5  # relative: a known point may be near; it is the same if Newton's method goes there


def frequency_problem(balance: Balance, low: float, high: float) -> Problem:
    """Return the continuation in frequency between two limits in rad/s."""
    gap = getattr(balance.law, "gap", None)
    scale = gap if gap is not None else max(float(np.max(np.abs(balance.free()))), np.finfo(float).tiny)
    return Problem(balance.residual(OMEGA), OMEGA, scale, WIDTH * high, (low, high))


def start_of_orbit(balance: Balance, impulse: float, phase: float) -> Real:
    """Return unknowns of an exact symmetric orbit: ``impulse`` (N s) on the absorber at the lower wall, at a ``phase`` of the force in rad.

    Friction, if there is any, is taken as one-signed from impact to impact.
    """
    limit = getattr(balance.law, "friction_limit", None) or 0.0

    def rubbed(order: Real) -> NDArray[np.complex128]:
        return np.where(order % 2 == 1, 4j * limit / (np.pi * order), 0) * np.exp(-1j * order * phase)

    return balance.at_impacts(np.array([phase, phase + np.pi]), np.array([impulse, -impulse]), rubbed)


def _starts(balance: Balance, low: float, high: float, seeds: int) -> Iterator[tuple[float, Real]]:
    """Yield frequency and unknowns: the free absorber at both ends, then exact orbits of either branch at frequencies between."""
    for omega in (low, high):
        yield omega, balance.at(OMEGA, omega).free()
    gap, linear = getattr(balance.law, "gap", None), balance.linear
    if gap is None or not isinstance(linear, JointOfMass) or linear.multiple != 1:
        return
    limit = getattr(balance.law, "friction_limit", None) or 0.0
    case = Case(linear.model, low, balance.force, gap, 1.0, limit, linear.mass / linear.model.beam_mass)
    for omega in np.linspace(low, high, seeds + 2)[1:-1]:
        for orbit in closed_form(case.changed(omega=float(omega))):
            if orbit.pushes:
                yield float(omega), start_of_orbit(balance.at(OMEGA, float(omega)), orbit.impulse, orbit.phase)


def balance_branches(
    balance: Balance, low: float, high: float, steps: Steps = STEPS, seeds: int = SEEDS, progress: Progress | None = None
) -> tuple[Branch, ...]:
    """Return the branches between two frequencies in rad/s, those from the ends first; Ctrl-C ends with what is known so far.

    Isolas are reached where one of ``seeds`` frequencies has an exact symmetric orbit in closed form from which the method converges; what lies on a
    known branch is not followed again. Raises ParameterError for a bad range, NoConvergenceError if no start leads anywhere.
    """
    require(0 < low < high, "frequency range", (low, high), "two frequencies in rad/s above 0, the lower one first")
    problem = frequency_problem(balance, low, high)
    found: list[Branch] = []
    for omega, z in _starts(balance, low, high, seeds):
        try:
            solution = balance.at(OMEGA, omega).solved(z)
        except NoConvergenceError:
            continue
        if any(lies_on(balance, branch, solution, omega) for branch in found):
            continue
        label = f"branch {len(found) + 1}"
        branch = _followed(problem, solution, omega, steps, None if progress is None else lambda n, w, label=label: progress(label, n, w))  # type: ignore[misc]
        found.append(branch)
        if branch.ended == STOPPED:
            break
    if not found:
        raise NoConvergenceError("harmonic balance: no start at either end of the range or from an exact orbit converged")
    return tuple(found)


def _followed(problem: Problem, z: Real, omega: float, steps: Steps, progress: Callable[[int, float], None] | None) -> Branch:
    """Return the branch through a point; from a limit of the frequency it has one side only."""
    if omega in problem.limits:
        return continuation(problem, z, omega, 1.0 if omega == problem.limits[0] else -1.0, steps, progress)
    return both_ways(problem, z, omega, steps, progress)


def lies_on(balance: Balance, branch: Branch, z: Real, omega: float) -> bool:
    """Return whether a solution at a frequency in rad/s is a point of a branch."""
    p, size = branch.parameters, float(np.linalg.norm(z))
    for k in np.flatnonzero((p[:-1] - omega) * (p[1:] - omega) <= 0):
        share = 0.5 if p[k] == p[k + 1] else (omega - p[k]) / (p[k + 1] - p[k])
        between = (1 - share) * branch.points[k] + share * branch.points[k + 1]
        if np.linalg.norm(between - z) > NEAR * size:
            continue
        try:
            there = balance.at(OMEGA, omega).solved(between)
        except NoConvergenceError:
            continue
        if np.linalg.norm(there - z) <= SAME * size:
            return True
    return False
