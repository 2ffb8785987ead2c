"""The smallest force with a symmetric orbit at a frequency, found along the branch over the force: for folds among many reversals of friction.

With friction and many modes the order of events changes so close to a fold that Newton's method on the fold's own conditions runs from one order to
the other. The branch over the force takes each change where it comes; the smallest force on it is what the closed form's fold force stands for.
"""

from __future__ import annotations

import numpy as np
import scipy.optimize

from impact_env.periodic.branch import STOPPED
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.fold_map import BIRTH
from impact_env.periodic.folds import Fold, level_fold
from impact_env.periodic.green import NoOrbit, Solution
from impact_env.periodic.orbit import confirmed, mended
from impact_env.periodic.symmetric import closed_form, fold_force, symmetric_schedule
from impact_env.periodic.tracing import orbit_branch

ABOVE = (1.05, 1.02, 1.1)  # of the closed form's fold force: where an orbit of the branch is sought
REACH = (0.85, 1.15)  # of it: forces between which the branch is followed
STEPS = Steps(first=0.01, least=1e-7, most=0.1, points=250)
COARSE = 1e-5  # of the frequency: how sharply a level place is found before Newton's method finishes it
EDGE = 0.02  # of the range: a level place this close to its end lies elsewhere
SAME = 1e-3  # of the force
BESIDE, JUMP = 1e-4, 5e-4  # of frequency and force: where the smallest force changes faster than so it has gone over to another fold


def lowest_fold(case: Case) -> Fold | NoOrbit:
    """Return the orbit with the smallest force at the case's frequency, whose force is not asked for, or why none is found. Ctrl-C breaks it off."""
    schedule, reason = symmetric_schedule(case.friction_limit > 0), "no orbit above the fold"
    lowest = float(fold_force(case, [case.omega])[0])
    for share in ABOVE:
        at, found = case.changed(force=share * lowest), list[Fold]()
        for start in closed_form(at):
            motion = mended(at, schedule, [start.phase])
            if isinstance(motion, NoOrbit):
                reason = motion.reason
                continue
            try:
                found += _folds_over_force(motion.solution, REACH[0] * lowest, REACH[1] * lowest)
                reason = "no fold of the branch over the force is an orbit"
            except NoConvergenceError as error:
                reason = str(error)
        if found:
            return min(found, key=lambda fold: fold.case.force)
    return NoOrbit(case, schedule, reason, np.zeros(1))


def _folds_over_force(solution: Solution, low: float, high: float) -> list[Fold]:
    """Return the folds that are orbits on the branch over the force (N) through a solution; raises NoConvergenceError where it has no branch."""
    branch = orbit_branch(solution, "force", (low, high), STEPS)
    if branch.branch.ended == STOPPED:
        raise KeyboardInterrupt
    return [fold for fold in branch.folds() if isinstance(fold, Fold) and not isinstance(confirmed(fold.motion), NoOrbit)]


def lowest_level(case: Case, kind: str, reach: float) -> Fold | NoOrbit:
    """Return the fold within ``reach`` (rad/s) of the case's frequency at which the smallest force is least, or greatest where ``kind`` is a merger.

    The level place itself, or the corner where two orders of events meet. Ctrl-C breaks it off.
    """
    sign, known, lost = (1.0 if kind == BIRTH else -1.0), dict[float, Fold](), list[NoOrbit]()

    def height(omega: float) -> float:
        fold = lowest_fold(case.changed(omega=omega))
        if isinstance(fold, NoOrbit):
            lost.append(fold)
            return 2 * abs(case.force)  # higher than any force near a birth, lower than any near a merger
        known[omega] = fold
        return sign * fold.case.force

    low, high = case.omega - reach, case.omega + reach
    scipy.optimize.minimize_scalar(height, bounds=(low, high), method="bounded", options={"xatol": COARSE * case.omega, "maxiter": 40})
    if not known:
        return lost[0]
    best = min(known.values(), key=lambda fold: sign * fold.case.force)
    if min(best.case.omega - low, high - best.case.omega) < EDGE * (high - low):
        return NoOrbit(best.case, best.motion.solution.schedule, "its level fold lies elsewhere", best.motion.solution.phases)
    for omega in (best.case.omega * (1 - BESIDE), best.case.omega * (1 + BESIDE)):
        next_to = lowest_fold(best.case.changed(omega=omega))
        if isinstance(next_to, NoOrbit) or abs(next_to.case.force / best.case.force - 1) > JUMP:
            return NoOrbit(best.case, best.motion.solution.schedule, "the smallest force jumps there", best.motion.solution.phases)
    finished = level_fold(best, reach)
    if isinstance(finished, Fold) and abs(finished.case.force / best.case.force - 1) < SAME:
        return finished
    return best
