"""All branches of symmetric two-impact orbits over a range of frequencies, from the closed form at frequencies between."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impact_env.parameters import require
from impact_env.periodic.branch import STOPPED
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps
from impact_env.periodic.green import NoOrbit, Solution, unknowns_of
from impact_env.periodic.orbit import mended
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.tracing import OrbitBranch, orbit_branch

Progress = Callable[[str, int, float], None]  # what is followed, number of points, frequency in rad/s
SEEDS = 24
STEPS = Steps(first=0.005, least=1e-8, most=0.03)  # fine enough to be drawn
NEAR = 0.02  # of phases in rad and scaled impulses: a start this close to a known branch lies on it


def orbit_branches(case: Case, low: float, high: float, seeds: int = SEEDS, progress: Progress | None = None) -> tuple[OrbitBranch, ...]:
    """Return the branches between two frequencies in rad/s, none if the closed form has no orbit at any of ``seeds`` frequencies.

    What lies on a known branch is not followed again; Ctrl-C ends with what is known so far. Raises ParameterError for a bad range.
    """
    require(0 < low < high, "frequency range", (low, high), "two frequencies in rad/s above 0, the lower one first")
    found: list[OrbitBranch] = []
    schedule = symmetric_schedule(case.friction_limit > 0)
    for omega in np.linspace(low, high, seeds + 2)[1:-1]:
        at = case.changed(omega=float(omega))
        for start in closed_form(at):
            motion = mended(at, schedule, [start.phase]) if start.pushes else None
            if motion is None or isinstance(motion, NoOrbit) or any(_lies_on(branch, motion.solution) for branch in found):
                continue
            number = len(found) + 1
            show = None if progress is None else (lambda n, w, number=number: progress(f"orbits {number}", n, w))
            found.append(orbit_branch(motion.solution, "omega", (low, high), STEPS, show))
            if found[-1].branch.ended == STOPPED:
                return tuple(found)
    return tuple(found)


def _lies_on(known: OrbitBranch, solution: Solution) -> bool:
    """Return whether a solution lies next to a branch, by phase and impulse of its first impact."""
    p, omega, z = known.branch.parameters, solution.case.omega, unknowns_of(solution)
    own = np.array([z[0], z[len(solution.schedule.events)]])
    for k in np.flatnonzero((p[:-1] - omega) * (p[1:] - omega) <= 0):
        share = 0.5 if p[k] == p[k + 1] else (omega - p[k]) / (p[k + 1] - p[k])
        ends = []
        for j in (k, k + 1):
            there = unknowns_of(known.solution(int(j)))
            ends.append(np.array([there[0], there[len(known.schedules[j].events)]]))
        away = (1 - share) * ends[0] + share * ends[1] - own
        away[0] = (away[0] + np.pi) % (2 * np.pi) - np.pi
        if np.max(np.abs(away)) <= NEAR * (1 + abs(own[1])) + float(np.max(np.abs(ends[1] - ends[0]))):
            return True
    return False
