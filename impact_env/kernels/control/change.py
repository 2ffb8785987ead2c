"""What a change from outside does to a lane that goes on: a friction limit that becomes another one, and a force whose amplitude jumps.

What slides goes on in its sense, with the new friction. What is joined stays so where the joint force is within what friction and a wall can now
give, and else begins to slide or to fly, as from a bound that the force has grown beyond. Positions and velocities do not jump (paper, Eqs. Signorini
and coulomb: friction is a force, no impulse). A slide that begins just at the change, without relative velocity, needs no look: if the new friction
can hold it, the search finds a reversal at once.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW
from impact_env.kernels.exact.free_and_joined import joint_force, release
from impact_env.kernels.exact.rigid import add_forced_part, solve_free, solve_joined
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINT_FORCE_TOL,
    joint_bounds,
    slide_on,
    static_limit,
)
from impact_env.kernels.motion.segments import window_count, window_of
from impact_env.kernels.motion.slots import copy


@jit
def hold_or_let_go(scene, window, room, state):
    """Leave the joined regime if the joint force is beyond its bounds; at a bound it is let join: there its rate decides, in the joined regime."""
    now = room.now[0]
    work = room.work
    solve_joined(scene, window, room)
    copy(work.z, work.rows[1])
    add_forced_part(window, now.tau, -1.0, room)
    f, scale = joint_force(
        scene.joined, room.joined_forced, window.omega, now.tau, scene.contact, work
    )
    low, high = joint_bounds(static_limit(scene.contact), now.side)
    slack = JOINT_FORCE_TOL * scale
    if low - slack <= f <= high + slack:
        copy(work.rows[1], work.z)  # to the last digit as if nobody had looked
        return
    solve_free(scene, window, room)
    release(scene, window, room, state, HIT_HIGH if f > high else HIT_LOW, None)
    add_forced_part(window, now.tau, 1.0, room)


@jit
def other_limit(limit, before):
    """Return whether there is friction, of another limit (N) than before, and whether of a lower one."""
    if limit is None:
        return False, False
    return limit != before, limit < before


@jit
def take_change(scene, limit, before, jumps, schedule, room, state):
    """Let a lane go on with the friction ``limit`` (N, or None) of its scene instead of the one ``before``.

    ``jumps``: whether the force's amplitude is another one; ``schedule``: of the stretch to come.
    """
    now, (other, lower) = room.now[0], other_limit(limit, before)
    if now.regime == FREE:
        if other:
            slide_on(scene.free.slots, limit, now.sign, now, room.work.z)
    elif jumps or lower:
        window = window_of(schedule, 0, 0, window_count(schedule, 0))
        now.tau = -window.half
        room.solved[:] = False
        hold_or_let_go(scene, window, room, state)
