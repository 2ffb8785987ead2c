"""Event-driven exact integration of one absorber with rigid contact (paper, section 2.2).

In: a scene (`Rigid`), a schedule, the initial state, observers. Out: the final state and a status
code (`rigid_lane`). The integration proceeds window by window and event by event, in two regimes:

- free: the beam's modes and the absorber move apart, with a constant force between them if there is
  friction. It ends at a wall (impact), or where the relative velocity turns (friction).
- joined: the absorber moves with the tip. It begins where friction can hold the absorber at a
  reversal, or after a complete chatter. It ends where the joint force, absorber mass times tip
  acceleration plus weight, leaves the interval that friction and the touched wall allow.

The forced response of the regime in which a window begins is solved at its start, that of the other
regime when an event leads to it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, jit_view
from impact_env.kernels.energy.energies import add_energy, new_account, replace_energies_by_account
from impact_env.kernels.events.signals import HIT_HIGH, NOTHING, REVERSAL, Signal, new_signal
from impact_env.kernels.exact.check import check_free_segment, check_joined_segment
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    JOINT_FORCE_TOL,
    AbsorberView,
    ContactLaw,
    add_friction_loss,
    apply_impact,
    bound_impulse_response,
    compute_static_limit,
    compute_tip_motion,
    detect_wall_contact,
    find_end_of_flight,
    find_end_of_hold,
    find_joint_bounds,
    new_contact_states,
    record_joined_phase,
    reverse_or_stick,
    update_friction_force,
    update_wall_contact,
)
from impact_env.kernels.motion.forced import (
    Forced,
    add_forced,
    compute_base_motion,
    evaluate_signal,
    new_forced,
)
from impact_env.kernels.motion.loads import copy_schedule, count_windows, expand_window
from impact_env.kernels.motion.modal_system import (
    GUARD,
    REST,
    add_weighted,
    apply_weights,
    copy_amplitudes,
    propagate,
)
from impact_env.kernels.motion.observers import (
    ABSORBER_MOTION,
    DONE,
    NOT_FINITE,
    count_progress,
    limit_searches,
    push_reversal,
)
from impact_env.kernels.motion.segments import (
    Buffers,
    LinearRegime,
    Losses,
    Segment,
    compute_amplitudes,
    compute_state,
    new_buffers,
    sample_level,
    sample_state,
    take_last_sample,
    update_forced_response,
)


class Rigid(NamedTuple):
    """A scene of one absorber with rigid contact."""

    free: LinearRegime  # regime of the absorber apart from the beam
    joined: LinearRegime  # regime of the absorber that moves with the beam
    contact: ContactLaw  # laws of the contact
    losses: Losses  # data for the energy balance


class RigidWorkspace(NamedTuple):
    """Motion and scratch memory of a run with one absorber and rigid contact.

    ``contact_states`` and ``buffers.z`` carry the motion from section to section: there ``z`` is
    the sum of the free and the forced part, within a window the free part only.
    """

    contact_states: NDArray[Any]  # (1,) a RIGID_CONTACT_STATE record
    buffers: Buffers  # of the modal amplitudes
    signal: Signal  # guard signal
    free_forced: Forced  # response of the free regime
    joined_forced: Forced  # response of the joined regime
    solved: NDArray[np.bool_]  # (2,) whether the response of FREE, JOINED is known in the window
    motion: NDArray[Any]  # (1,) as `Segment.motion`
    scratch: NDArray[np.float64]  # (2 N_m + 2,) a state


@jit_allocating
def new_rigid_workspace(free, joined, load, state):
    """Return the workspace of a scene with the regimes ``free`` and ``joined``.

    ``load``: workspace of the loads, None under the chirp of one force; ``state`` (2 N_m + 2,)
    gives the size only.
    """
    size = free.system.rows.shape[1]
    contact_states = new_contact_states(1)
    contact_states[0].impulse_bound = bound_impulse_response(free.system.rows)
    free_forced = new_forced(free.system, load)
    joined_forced = new_forced(joined.system, load)
    solved = np.zeros(2, np.bool_)
    return RigidWorkspace(
        contact_states,
        new_buffers(size),
        new_signal(size),
        free_forced,
        joined_forced,
        solved,
        np.zeros(1, ABSORBER_MOTION),
        np.zeros_like(state),
    )


@jit_view
def view_absorber(workspace):
    """Return the absorber's contact state, buffers and guard signal."""
    return AbsorberView(workspace.contact_states[0], workspace.buffers, workspace.signal)


@jit_inline
def add_base_motion(window, workspace, sign):
    """Add the motion that a moving base gives a free absorber, times ``sign``.

    It is added to the contact state, which between events holds the rest of the motion, a
    polynomial of second order.
    """
    load = window.load
    if load is not None:
        contact_state = workspace.contact_states[0]
        q, v = compute_base_motion(
            load, workspace.free_forced.signals, window.omega, contact_state.tau
        )
        contact_state.q += sign * q
        contact_state.v += sign * v


@jit
def assemble_amplitudes(regime, forced, omega, contact_state, z, w):
    """Write the complete modal amplitudes at the current time to ``w`` (2, J).

    They are the sum of the free part z, the forced part, and the static part under
    ``contact_state.force``.
    """
    copy_amplitudes(z, w)
    add_forced(forced.polynomials, omega, contact_state.tau, 1.0, w)
    add_weighted(regime.system.rows, REST, contact_state.force, w)


@jit
def enter_regime(regime, forced, omega, contact_state, state, z):
    """Write the free part of a regime's amplitudes, for a state at the current time, to z (2, J).

    ``contact_state.force`` must be that of this regime.
    """
    compute_amplitudes(regime.into, state, z)
    add_forced(forced.polynomials, omega, contact_state.tau, -1.0, z)
    add_weighted(regime.system.rows, REST, -contact_state.force, z)


@jit
def write_free_state(free, forced, omega, contact_state, buffers, state):
    """Write the ``state`` at the current time in the free regime.

    The contact state must include the motion that a moving base gives the absorber
    (`add_base_motion`). ``buffers.rows`` is scratch.
    """
    assemble_amplitudes(free, forced, omega, contact_state, buffers.z, buffers.rows[0])
    compute_state(free.out, buffers.rows[0], state)
    half = state.shape[0] // 2
    state[half - 1] = contact_state.q
    state[2 * half - 1] = contact_state.v


@jit
def compute_joint_force(joined, forced, omega, tau, contact, buffers):
    """Return the joint force (N) at ``tau`` in the joined regime, and the sum of its terms' sizes.

    Both in newtons. ``buffers.z`` holds the free part of the amplitudes, ``buffers.u`` is
    overwritten.
    """
    apply_weights(joined.system.rows, GUARD, buffers.z, buffers.u)
    f = evaluate_signal(forced.signals, 0, omega, tau)
    scale = forced.bound[0]
    for j in range(buffers.u.shape[1]):
        f += buffers.u[0, j]
        scale += abs(buffers.u[0, j]) + abs(buffers.u[1, j])
    weight = contact.mass * contact.gravity
    return f + weight, scale + abs(weight)


@jit
def try_stick(scene, window, workspace, state):
    """Join absorber and beam if the joint force is within its bounds; return True if joined.

    If the force is at a bound the absorber sticks: the rate of the force then decides in the joined
    regime. ``state`` is that at the current time; the joined regime's forced response must be
    known. If the result is False the direction of slip is set, ``contact_state.force`` is 0 and
    ``buffers.z`` holds amplitudes of the joined regime: the caller must enter the free regime
    (`enter_regime`).
    """
    contact_state = workspace.contact_states[0]
    joined = scene.joined
    forced = workspace.joined_forced
    buffers = workspace.buffers
    q_tip, v_tip = compute_tip_motion(scene.contact, state)
    contact_state.force = scene.contact.gravity
    enter_regime(joined, forced, window.omega, contact_state, state, buffers.z)
    f, scale = compute_joint_force(
        joined, forced, window.omega, contact_state.tau, scene.contact, buffers
    )
    update_wall_contact(scene.contact.walls, contact_state, q_tip)
    low, high = find_joint_bounds(compute_static_limit(scene.contact), contact_state.side)
    # a joint force at its bound: its rate decides in the joined regime
    slack = JOINT_FORCE_TOL * scale
    contact_state.v = v_tip
    contact_state.offset = contact_state.q - q_tip
    if low - slack <= f <= high + slack:
        contact_state.regime = JOINED
        contact_state.phase_start = window.centre + contact_state.tau
        return True
    contact_state.sign = -1.0 if f > high else 1.0
    contact_state.force = 0.0
    return False


@jit_inline
def observe_segment(scene, segment, r, scratch, observers):
    """Pass a segment in regime ``r`` (FREE, JOINED) to the observers of samples and energies."""
    sample_level(segment, observers.clock, observers.level)
    sample_state(segment, observers.clock, observers.series)
    add_energy(segment, scene.losses, scratch, r, observers.energy)


@jit_inline
def advance_free_regime(scene, window, workspace, observers):
    """Advance the free regime to its next event or to the window's end; return the `GuardEvent`.

    Contact state and free amplitudes in ``workspace`` are then those at its end, before the event
    is applied; the segment is passed to the observers.
    """
    free = scene.free
    forced = workspace.free_forced
    contact = scene.contact
    body = view_absorber(workspace)
    omega = window.omega
    contact_state = body.contact_state
    system = free.system
    counters = observers.counters
    contact_state.a = contact_state.force / contact.mass - contact.gravity
    tau = contact_state.tau
    deflection = free.tip_rest * contact_state.force
    event = find_end_of_flight(
        system, forced, window, contact.walls, contact.limit, body, deflection, window.half - tau
    )
    counters.counts.evaluations += event.evaluations
    offset = event.offset
    check = counters.check
    if check is not None:
        if check.first.shape[0] > 0:
            check_free_segment(
                check, system, forced, window, contact.walls, contact.limit, body, offset
            )

    end = tau + offset
    motion = workspace.motion[0]
    motion.q = contact_state.q
    motion.v = contact_state.v
    motion.a = contact_state.a
    motion.base_share = 1.0
    segment = Segment(
        free,
        forced,
        window,
        workspace.buffers,
        contact_state.force,
        deflection,
        workspace.motion,
        tau,
        end,
    )
    observe_segment(scene, segment, FREE, workspace.scratch, observers)
    add_friction_loss(contact.limit, system, forced, omega, body, tau, offset, observers.energy)

    propagate(system.rows, system.table, system.scale, offset, workspace.buffers.z)
    contact_state.q += offset * (contact_state.v + 0.5 * offset * contact_state.a)
    contact_state.v += offset * contact_state.a
    contact_state.tau = end
    contact_state.side = 0.0
    contact_state.at_rest = False
    return event


@jit_inline
def advance_joined_regime(scene, window, workspace, observers):
    """Advance the joined regime and return the kind of the event that ends it.

    It is HIT_LOW or HIT_HIGH, where the joint force leaves its bounds, or NOTHING at the window's
    end. Time and free amplitudes in ``workspace`` are then those at the end, before the event is
    applied; the segment is passed to the observers.
    """
    joined = scene.joined
    forced = workspace.joined_forced
    limit = compute_static_limit(scene.contact)
    body = view_absorber(workspace)
    contact_state = body.contact_state
    system = joined.system
    counters = observers.counters
    tau = contact_state.tau
    weight = scene.contact.gravity
    event = find_end_of_hold(
        system, forced, window, limit, scene.contact.mass * weight, body, window.half - tau
    )
    counters.counts.evaluations += event.evaluations
    offset = event.offset
    check = counters.check
    if check is not None:
        if check.first.shape[0] > 0:
            check_joined_segment(check, system, forced, window, limit, body, offset)

    end = tau + offset
    motion = workspace.motion[0]
    motion.q = contact_state.offset
    motion.v = 0.0
    motion.a = 0.0
    motion.base_share = 0.0
    segment = Segment(
        joined,
        forced,
        window,
        workspace.buffers,
        weight,
        joined.tip_rest * weight,
        workspace.motion,
        tau,
        end,
    )
    observe_segment(scene, segment, JOINED, workspace.scratch, observers)

    propagate(system.rows, system.table, system.scale, offset, workspace.buffers.z)
    contact_state.tau = end
    counters.counts.stuck_time += offset
    return event.kind


@jit
def release_absorber(scene, window, workspace, state, event, events):
    """Change to the free regime, because the joint force has left its bounds.

    ``event``: HIT_HIGH, the absorber then lags behind the beam, or HIT_LOW, it leads. The free
    regime's forced response must be known. ``state`` is overwritten by that at the event, the
    joined phase is appended to ``events``.
    """
    contact_state = workspace.contact_states[0]
    joined = scene.joined
    buffers = workspace.buffers
    half = state.shape[0] // 2
    assemble_amplitudes(
        joined, workspace.joined_forced, window.omega, contact_state, buffers.z, buffers.rows[0]
    )
    compute_state(joined.out, buffers.rows[0], state)
    state[half - 1] += contact_state.offset
    contact_state.q = state[half - 1]
    contact_state.v = state[2 * half - 1]
    record_joined_phase(events, contact_state, window.centre + contact_state.tau)
    contact_state.regime = FREE
    contact_state.sign = -1.0 if event == HIT_HIGH else 1.0
    contact_state.at_rest = True
    contact_state.force = 0.0
    update_friction_force(scene.contact.limit, contact_state)
    enter_regime(scene.free, workspace.free_forced, window.omega, contact_state, state, buffers.z)
    add_base_motion(window, workspace, -1.0)


@jit
def init_regime(scene, window, workspace, state):
    """Choose the first regime of a run, which begins with ``state``.

    It is joined if the relative velocity is zero and friction or a wall can hold the absorber. The
    forced responses of both regimes must be known. Contact state and ``buffers.z`` are written.
    """
    contact_state = workspace.contact_states[0]
    contact = scene.contact
    half = state.shape[0] // 2
    contact_state.q = state[half - 1]
    contact_state.v = state[2 * half - 1]
    relative = detect_wall_contact(contact, contact.walls, contact_state, state)
    can_stick = contact_state.side != 0.0
    if contact.limit is not None:
        can_stick = True
    if relative == 0.0 and can_stick:
        if try_stick(scene, window, workspace, state):
            return
        contact_state.at_rest = True
    elif relative * contact_state.side > 0.0:
        # on a wall and moving into it: the search reports the impact at once
        contact_state.side = 0.0
    update_friction_force(contact.limit, contact_state)
    enter_regime(
        scene.free, workspace.free_forced, window.omega, contact_state, state, workspace.buffers.z
    )
    add_base_motion(window, workspace, -1.0)


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
    """Add the current regime's forced response at ``tau``, times ``sign``, to the amplitudes.

    In the free regime the motion of the absorber by a moving base is added as well. ``tau`` (s from
    the window's centre) must be the contact state's time.
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
    """Begin a window: subtract the forced response, or choose the first regime of a run.

    ``started`` False: the run begins with ``state``. Else ``state`` is not used, and the amplitudes
    are the sum of free and forced part before, and the free part after the call.
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

    Returns True if the relative velocity is zero after the event and the absorber may stick.
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
    """Continue from zero relative velocity: stick if the joint force allows it, else slip.

    The current regime is free. ``state`` is overwritten by that at the current time.
    """
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
    """Advance the current regime to its next event, or to the window's end, and apply the event.

    The motion is in ``workspace``; ``state`` (2 N_m + 2,) is scratch.
    """
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
    """Integrate section ``k`` of the schedule and return a status code, DONE or an error.

    ``started`` False: the first section of a run, which begins with ``state``. Else ``state`` is
    scratch: the motion stays in ``workspace`` from section to section (`write_current_state`).
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
    """Integrate one run of a `Rigid` scene and return a status code, DONE or an error.

    ``plan``: the `Schedule`, which is not written. ``state`` (2 N_m + 2,) is the initial state and
    becomes the final one, after an error that at the time reached.
    """
    schedule = copy_schedule(plan)
    workspace = new_rigid_workspace(scene.free, scene.joined, schedule.load, state)
    status = DONE
    limit_searches(workspace.signal.memory, observers.counters)
    lane_observers = replace_energies_by_account(
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
    """Write the ``state`` at the end of a section, or where the run was given up.

    The amplitudes in ``workspace`` must be the sum of free and forced part.
    """
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
