"""The effect of a change from outside on a lane that continues.

The change is a new friction limit, or a jump of the force's amplitude.

What slides goes on in its sense, with the new friction. What is joined stays so where the joint
force is within what friction and a wall can now give, and else begins to slide or to fly, as from a
bound that the force has grown beyond. Positions and velocities do not jump (paper, Eqs. Signorini
and coulomb: friction is a force, no impulse). A slide that begins just at the change, without
relative velocity, needs no special case: if the new friction can hold it, the search finds a
reversal at once.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW
from impact_env.kernels.exact.rigid import (
    add_forced_part,
    update_free_response,
    update_joined_response,
)
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINT_FORCE_TOL,
    joint_bounds,
    static_limit,
    update_slip_direction,
)
from impact_env.kernels.exact.stick_slip import compute_joint_force, release_absorber
from impact_env.kernels.motion.modal_system import copy_amplitudes
from impact_env.kernels.motion.segments import count_windows, expand_window


@jit
def recheck_stick(scene, window, workspace, state):
    """Leave the joined regime if the joint force is beyond its bounds.

    At a bound the absorber sticks, and the rate of the joint force decides.
    """
    contact_state = workspace.contact_states[0]
    buffers = workspace.buffers
    update_joined_response(scene, window, workspace)
    copy_amplitudes(buffers.z, buffers.rows[1])
    add_forced_part(window, contact_state.tau, -1.0, workspace)
    f, scale = compute_joint_force(
        scene.joined,
        workspace.joined_forced,
        window.omega,
        contact_state.tau,
        scene.contact,
        buffers,
    )
    low, high = joint_bounds(static_limit(scene.contact), contact_state.side)
    slack = JOINT_FORCE_TOL * scale
    if low - slack <= f <= high + slack:
        copy_amplitudes(buffers.rows[1], buffers.z)  # to the last digit as if nobody had looked
        return
    update_free_response(scene, window, workspace)
    release_absorber(scene, window, workspace, state, HIT_HIGH if f > high else HIT_LOW, None)
    add_forced_part(window, contact_state.tau, 1.0, workspace)


@jit
def compare_limits(limit, before):
    """Return whether the friction limit (N) has changed, and whether it is lower than before."""
    if limit is None:
        return False, False
    return limit != before, limit < before


@jit
def apply_order_change(scene, limit, before, jumps, schedule, workspace, state):
    """Continue a lane with the friction ``limit`` (N, or None) of its new order.

    It replaces the limit ``before``.

    ``jumps``: whether the amplitude of the force changes; ``schedule``: of the section to come.
    """
    contact_state = workspace.contact_states[0]
    other, lower = compare_limits(limit, before)
    if contact_state.regime == FREE:
        if other:
            update_slip_direction(
                scene.free.system, limit, contact_state.sign, contact_state, workspace.buffers.z
            )
    elif jumps or lower:
        window = expand_window(schedule, 0, 0, count_windows(schedule, 0))
        contact_state.tau = -window.half
        workspace.solved[:] = False
        recheck_stick(scene, window, workspace, state)
