"""All branches of symmetric two-impact orbits over a range of frequencies, from the closed form at frequencies between."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import STOPPED
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps
from impact_env.periodic.fold_map import closed_folds
from impact_env.periodic.green import NoOrbit, Solution, unknowns_of
from impact_env.periodic.orbit import mended
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.tracing import PARAMETER_SHARE, OrbitBranch, orbit_branch

Progress = Callable[[str, int, float], None]  # what is followed, number of points, frequency in rad/s
SEEDS = 24
BESIDE = 1e-3  # relative: how far from a fold a branch that no other frequency shows is begun
STEPS = Steps(first=0.005, least=1e-8, most=0.03)  # fine enough to be drawn
NEAR = 0.01  # of phases in rad, scaled impulses, and the frequency in its share: a start this close to a known branch lies on it


def orbit_branches(case: Case, low: float, high: float, seeds: int = SEEDS, progress: Progress | None = None) -> tuple[OrbitBranch, ...]:
    """Return the branches between two frequencies in rad/s, none if the closed form has no orbit at any of ``seeds`` frequencies or beside its folds.

    What lies on a known branch is not followed again; Ctrl-C ends with what is known so far. Raises ParameterError for a bad range.
    """
    require(0 < low < high, "frequency range", (low, high), "two frequencies in rad/s above 0, the lower one first")
    found: list[OrbitBranch] = []
    places: list[NDArray[np.float64]] = []
    schedule = symmetric_schedule(case.friction_limit > 0)
    first = float(case.model.omega[0])
    beside = [fold * (1 + side) for fold in closed_folds(case, low / first, high / first) for side in (-BESIDE, BESIDE)]
    for omega in (*np.linspace(low, high, seeds + 2)[1:-1], *(omega for omega in beside if low < omega < high)):
        at = case.changed(omega=float(omega))
        for start in closed_form(at):
            motion = mended(at, schedule, [start.phase]) if start.pushes else None
            if motion is None or isinstance(motion, NoOrbit) or any(lies_on(known, motion.solution) for known in places):
                continue
            number = len(found) + 1
            show = None if progress is None else (lambda n, w, number=number: progress(f"orbits {number}", n, w))
            found.append(orbit_branch(motion.solution, "omega", (low, high), STEPS, show))
            places.append(places_of(found[-1]))
            if found[-1].branch.ended == STOPPED:
                return tuple(found)
    return tuple(found)


def place(solution: Solution) -> NDArray[np.float64]:
    """Return phase, impulse and frequency of the first impact, (3,), in the units of the continuation."""
    z = unknowns_of(solution)
    return np.array([z[0], z[len(solution.schedule.events)], math.log(solution.case.omega) / PARAMETER_SHARE])


def places_of(branch: OrbitBranch) -> NDArray[np.float64]:
    """Return the place of each point of a branch, (m, 3)."""
    return np.array([place(branch.solution(k)) for k in range(len(branch.schedules))])


def lies_on(places: NDArray[np.float64], solution: Solution) -> bool:
    """Return whether a solution lies next to the polyline through the places (m, 3) of a branch's points."""
    return near(places, place(solution))


def mirrors(places: NDArray[np.float64], solution: Solution) -> bool:
    """Return whether a solution or its mirror image lies next to the polyline through places (m, 3), whichever impact it is counted from."""
    ratio = math.log(solution.case.omega) / PARAMETER_SHARE
    hits = solution.schedule.order.wall != 0
    pairs = zip(solution.phases[hits], solution.impulses[hits] / solution.case.scale.impulse, strict=True)
    return any(near(places, np.array([p + k * np.pi, (-1.0) ** k * i, ratio])) for p, i in pairs for k in (0, 1))


def near(places: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    """Return whether a place (3,) lies next to the polyline through others (m, 3)."""
    return distance(places, point) <= NEAR


def distance(places: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Return how far a place (3,) lies from the polyline through others (m, 3); phases count to within whole turns. Infinite without a line."""
    points = places - point
    points[:, 0] = (points[:, 0] + np.pi) % (2 * np.pi) - np.pi
    begin, chord = points[:-1], np.diff(points, axis=0)
    square = np.sum(chord**2, axis=1)
    share = np.clip(-np.sum(begin * chord, axis=1) / np.where(square > 0, square, 1), 0, 1)
    return float(np.min(np.linalg.norm(begin + share[:, None] * chord, axis=1), initial=np.inf))
