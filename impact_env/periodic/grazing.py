"""Confirmation of orbits that touch a wall without impact, or by an impact of zero velocity.

At a touch, rounding decides whether the exact method finds an impact, and the return map has no
derivative. A neighbouring orbit is therefore confirmed: at a force at which the absorber misses the
wall by a tiny share of the gap, or at which the impact has a small impulse.
"""

from collections.abc import Callable, Sequence

import numpy as np

from impact_env.periodic.green import NoOrbit, Solution, read_unknowns, solve
from impact_env.periodic.motion import Motion, motion_of
from impact_env.periodic.orbit import Orbit, confirm_orbit

TRIAL_SHARE = 1e-6  # of the force: the difference that says how the touch depends on it
MOST_SHARE = (
    1e-3  # of the force: a touch that depends on it less is not confirmed, as next to a fold
)
# tried in turn, as a slow impact leaves a residual in the exact method that comes and goes with
# them
CLEAR_SHARES = (1e-5, 1e-4)  # of the gap: below a millionth of it the exact method finds an impact
SMALL_IMPULSES = (1e-4, 3e-5, 3e-4, 1e-3)  # scaled
NEAR_ENOUGH = 0.5  # of the clearance or impulse sought


def compute_weakest_impulse(motion: Motion) -> float:
    """Return the smallest impulse of a motion's impacts, scaled; it is negative if a wall pulls."""
    solution = motion.solution
    wall = solution.schedule.order.wall
    pushes = -wall[wall != 0] * solution.impulses[wall != 0]
    return float(np.min(pushes)) / solution.case.scale.impulse


def confirm_nearby(
    motion: Motion, value_of: Callable[[Motion], float], wanted: Sequence[float]
) -> Orbit | NoOrbit:
    """Return the orbit confirmed at a force close to that of a motion.

    At this force a function that vanishes for the motion itself has one of the values ``wanted``.
    """
    solution = motion.solution
    here = value_of(motion)
    trial = _at_force(solution, solution.case.force * (1 + TRIAL_SHARE))
    if isinstance(trial, NoOrbit):
        return trial
    slope = (value_of(trial) - here) / TRIAL_SHARE
    reason = "the force hardly moves the absorber away from the wall that it touches"
    result = NoOrbit(solution.case, solution.schedule, reason, solution.phases)
    for value in wanted:
        share = (value - here) / slope if slope != 0 else np.inf
        if not abs(share) < MOST_SHARE:
            continue
        near = _at_force(solution, solution.case.force * (1 + share))
        if isinstance(near, NoOrbit):
            result = near
            continue
        if not value_of(near) > NEAR_ENOUGH * value:
            reason = "the absorber passes another wall or another impact pulls"
            result = NoOrbit(solution.case, solution.schedule, reason, solution.phases)
            continue
        confirmation = confirm_orbit(near)
        if isinstance(confirmation, Orbit):
            return confirmation
        result = confirmation
    return result


def _at_force(solution: Solution, force: float) -> Motion | NoOrbit:
    """Return the motion with the same events at another force."""
    near = solve(solution.case.changed(force=force), solution.schedule, read_unknowns(solution))
    return near if isinstance(near, NoOrbit) else motion_of(near)
