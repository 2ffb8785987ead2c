"""Event-driven exact integration of one absorber with rigid contact (paper, section 2.2).

It proceeds window by window and event by event.

A window begins in one of the two regimes of stick_slip.py; the forced part of the other is solved
when an event leads there.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.energy.account import new_account, with_energy_account
from impact_env.kernels.events.signals import NOTHING, REVERSAL
from impact_env.kernels.exact.budget import count_progress, limit_searches
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    apply_impact,
    record_joined_phase,
    reverse_or_stick,
    update_friction_force,
)
from impact_env.kernels.exact.stick_slip import (
    add_base_motion,
    advance_free_regime,
    advance_joined_regime,
    enter_regime,
    init_regime,
    new_rigid_workspace,
    release_absorber,
    try_stick,
    view_absorber,
    write_free_state,
)
from impact_env.kernels.motion.forced import add_forced
from impact_env.kernels.motion.modal_system import REST, add_weighted, copy_amplitudes
from impact_env.kernels.motion.observers import DONE, NOT_FINITE, push_reversal
from impact_env.kernels.motion.segments import (
    compute_state,
    copy_schedule,
    count_windows,
    expand_window,
    take_last_sample,
)
from impact_env.kernels.motion.unit_loads import update_forced_response


@jit_inline
def update_free_response(scene, window, workspace):
    """Solve the forced response of the free regime in a window, unless it is known."""
    if not workspace.solved[FREE]:
        update_forced_response(scene.free.system, window, None, workspace.free_forced)
        workspace.solved[FREE] = True


@jit_inline
def update_joined_response(scene, window, workspace):
    """Solve the forced response of the joined regime in a window, unless it is known."""
    if not workspace.solved[JOINED]:
        update_forced_response(
            scene.joined.system, window, scene.contact.mass, workspace.joined_forced
        )
        workspace.solved[JOINED] = True


@jit_inline
def add_forced_part(window, tau, sign, workspace):
    """Add the forced response of the current regime to the modal amplitudes at ``tau`` (s).

    It is multiplied by ``sign``.
    """
    if workspace.contact_states[0].regime == FREE:
        add_forced(workspace.free_forced.polynomials, window.omega, tau, sign, workspace.buffers.z)
        add_base_motion(window, workspace, sign)
    else:
        add_forced(
            workspace.joined_forced.polynomials, window.omega, tau, sign, workspace.buffers.z
        )


@jit_inline
def enter_window(scene, window, started, workspace, state):
    """Begin a window.

    The forced response is subtracted from the amplitudes, or the first regime of a run is chosen.

    ``started`` False: the run begins with ``state``. Else the amplitudes hold the whole motion.
    """
    contact_state = workspace.contact_states[0]
    contact_state.tau = -window.half
    workspace.solved[:] = False
    if contact_state.regime == FREE or not started:
        update_free_response(scene, window, workspace)
    if contact_state.regime != FREE or not started:
        update_joined_response(scene, window, workspace)
    if started:
        add_forced_part(window, contact_state.tau, -1.0, workspace)
    else:
        init_regime(scene, window, workspace, state)


@jit_inline
def handle_event(scene, window, event, workspace, observers):
    """Apply the event that ended a free segment.

    Returns True if the relative velocity is zero after the event.
    """
    system = scene.free.system
    contact = scene.contact
    body = view_absorber(workspace)
    if event.kind == NOTHING:
        return False
    if event.kind == REVERSAL:
        push_reversal(
            observers.events, window.centre + body.contact_state.tau, body.contact_state.absorber
        )
        return reverse_or_stick(system, contact, contact.limit, body, event)
    return apply_impact(
        system, workspace.free_forced, window, contact.walls, contact, body, event, observers
    )


@jit_inline
def stick_or_slip(scene, window, workspace, state):
    """Continue from zero relative velocity: stick if the joint force allows it, else slip."""
    contact_state = workspace.contact_states[0]
    buffers = workspace.buffers
    update_joined_response(scene, window, workspace)
    add_base_motion(window, workspace, 1.0)
    write_free_state(scene.free, workspace.free_forced, window.omega, contact_state, buffers, state)
    if not try_stick(scene, window, workspace, state):
        contact_state.at_rest = True
        update_friction_force(scene.contact.limit, contact_state)
        enter_regime(
            scene.free, workspace.free_forced, window.omega, contact_state, state, buffers.z
        )
        add_base_motion(window, workspace, -1.0)


@jit_inline
def advance_to_event(scene, window, workspace, state, observers):
    """Advance the current regime to its next event, or to the window's end, and apply the event."""
    if workspace.contact_states[0].regime == FREE:
        event = advance_free_regime(scene, window, workspace, observers)
        if handle_event(scene, window, event, workspace, observers):
            stick_or_slip(scene, window, workspace, state)
    else:
        event = advance_joined_regime(scene, window, workspace, observers)
        if event != NOTHING:
            update_free_response(scene, window, workspace)
            release_absorber(scene, window, workspace, state, event, observers.events)


@jit_inline
def integrate_rigid_section(scene, schedule, k, started, workspace, state, observers):
    """Integrate section ``k`` of the schedule and return a status code.

    ``started`` False: the first section of a run, which begins with ``state``. The motion stays in
    ``workspace`` for the next section.
    """
    contact_state = workspace.contact_states[0]
    count = count_windows(schedule, k)
    for w in range(count):
        window = expand_window(schedule, k, w, count)
        enter_window(scene, window, started or w > 0, workspace, state)
        last = contact_state.tau
        stalled = 0
        while contact_state.tau < window.half:
            advance_to_event(scene, window, workspace, state, observers)
            stalled, status = count_progress(
                observers.counters, window, contact_state.tau, last, stalled
            )
            if status != DONE:
                add_forced_part(window, contact_state.tau, 1.0, workspace)
                return status
            last = contact_state.tau
        add_forced_part(window, window.half, 1.0, workspace)
        if not np.isfinite(workspace.buffers.z[0, 0] + contact_state.q):
            return NOT_FINITE
    return DONE


@jit_allocating
def rigid_lane(scene, plan, state, observers):
    """Integrate one run of a `stick_slip.Rigid` scene and return a status code.

    ``state`` (2 N_m + 2,) is the initial state and becomes the final one.
    """
    schedule = copy_schedule(plan)
    workspace = new_rigid_workspace(scene.free, scene.joined, schedule.load, state)
    status = DONE
    limit_searches(workspace.signal.memory, observers.counters)
    lane_observers = with_energy_account(
        observers, new_account(observers.energy, 2, scene.free.system.rows.shape[1])
    )
    for k in range(schedule.times.shape[0] - 1):
        status = integrate_rigid_section(
            scene, schedule, k, k > 0, workspace, state, lane_observers
        )
        if status != DONE:
            break
    counts = observers.counters.counts
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish_rigid_run(scene, workspace, state, counts.reached, observers)
    return status


@jit
def write_current_state(scene, workspace, state):
    """Write the state at the end of a section, or where the run was given up."""
    contact_state = workspace.contact_states[0]
    buffers = workspace.buffers
    half = state.shape[0] // 2
    if contact_state.regime == FREE:
        w = buffers.rows[0]
        copy_amplitudes(buffers.z, w)
        add_weighted(scene.free.system.rows, REST, contact_state.force, w)
        compute_state(scene.free.out, w, state)
        state[half - 1] = contact_state.q
        state[2 * half - 1] = contact_state.v
    else:
        w = buffers.rows[0]
        copy_amplitudes(buffers.z, w)
        add_weighted(scene.joined.system.rows, REST, scene.contact.gravity, w)
        compute_state(scene.joined.out, w, state)
        state[half - 1] += contact_state.offset


@jit
def finish_rigid_run(scene, workspace, state, end, observers):
    """Write the final state, record an open joined phase, and take the sample at ``end`` (s)."""
    write_current_state(scene, workspace, state)
    if workspace.contact_states[0].regime != FREE:
        record_joined_phase(observers.events, workspace.contact_states[0], end)
    take_last_sample(
        state, scene.contact.tip_shape, end, observers.clock, observers.level, observers.series
    )
