"""The effect of one absorber's event on the others.

The module also contains the change from one set of joined absorbers to another (sets.py).

- An impact changes all relative velocities at once, by the beam's mobility between the places. A
  finite friction force cannot hold against it, so a stuck absorber slides on with the velocity that
  the impulse gives it. An absorber that is held at a wall leaves the wall, or hits it at once and
  bounces. A joined absorber stays joined only if this motion would stay below the rounding of the
  position: otherwise two absorbers at rest on walls would release each other for ever. The impulse
  is then still computed by the law without joints, and the joint takes out the velocity that the
  impulse gives, so that bounces continue to decay.
- Where a force jumps (a reversal, an impact with friction, a new joint), all absorbers without
  relative velocity are resolved together (joint_forces.py), and so are those that come to rest, or
  leave their joint, at the same time. Impacts at the same time are taken one after the other.
  Impacts at two places at once have no unique outcome in rigid-body mechanics: this is a choice. It
  does not matter where an impulse at one place does not move the other, as with the masses of a
  chain with all its modes.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_view
from impact_env.kernels.events.signals import (
    HIT_HIGH,
    HIT_LOW,
    NOTHING,
    compute_signal_scale,
    evaluate_at_offset,
)
from impact_env.kernels.exact.joint_forces import (
    begin_slip,
    compute_contact_kinematics,
    resolve_joints,
)
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    POSITION_ROUNDING,
    AbsorberView,
    ContactLaw,
    Walls,
    apply_impact,
    compute_restitution,
    compute_tip_motion,
    detect_wall_contact,
    find_joint_bounds,
    reverse_or_stick,
    update_friction_force,
    update_wall_contact,
)
from impact_env.kernels.exact.safe_times import forget_safe_times, may_turn
from impact_env.kernels.exact.sets import (
    add_base_motion,
    enter_set,
    fill_guard_signal,
    find_joined_set,
    is_joined,
    update_guard_response,
    update_set_response,
    update_static_deflection,
    view_set_response,
    view_set_system,
    view_signal,
)
from impact_env.kernels.motion.forced import add_forced, compute_base_motion, evaluate_signal
from impact_env.kernels.motion.modal_system import (
    GUARD,
    REST,
    SPEED,
    add_weighted,
    apply_weights,
    copy_amplitudes,
)
from impact_env.kernels.motion.observers import push_reversal
from impact_env.kernels.motion.segments import compute_state

NO_BOUND = 1e300  # as a bound: none
BEFORE_FIRST_SET = -1  # before a run's first regime


@jit_view
def view_contact_law(scene, s, a, restitution):
    """Return the contact law of absorber a in the set at position s, without gravity.

    ``restitution``: its coefficient of restitution, which may differ from that of the walls.
    """
    absorbers = scene.absorbers
    walls = Walls(absorbers.gap[a], restitution, absorbers.yield_velocity[a])
    return ContactLaw(
        absorbers.mass[a],
        scene.sets.compliance[s, a, a],
        absorbers.shapes[a],
        walls,
        absorbers.limit[a],
        0.0,
        1.0,
    )


@jit
def write_set_state(sets, window, s, workspace, state):
    """Write the ``state`` (2 N_m + 2 n,) at the current time in the set at position s.

    ``workspace.buffers.rows`` is scratch; q and v of joined absorbers are written to their contact
    states.
    """
    w = workspace.buffers.rows[0]
    copy_amplitudes(workspace.buffers.z, w)
    add_forced(
        workspace.forced_sets.polynomials[s], window.omega, workspace.contact_states[0].tau, 1.0, w
    )
    write_state_from(sets, s, w, workspace, state)
    load = window.load
    if load is not None:
        n = workspace.contact_states.shape[0]
        half = state.shape[0] // 2
        signals = view_set_response(workspace.forced_sets, s, n).signals
        q, v = compute_base_motion(load, signals, window.omega, workspace.contact_states[0].tau)
        for a in range(n):
            if not is_joined(sets, s, a):
                state[half - n + a] += q
                state[2 * half - n + a] += v


@jit
def write_state_from(sets, s, w, workspace, state):
    """Write the state from the amplitudes ``w`` of set s and the absorbers' motion.

    ``w`` (2, J) contains the free and the forced part; the static part is added to it. q and v of
    joined absorbers are written to their contact states.
    """
    add_weighted(workspace.place_rows[s], REST, 1.0, w)
    compute_state(sets.out[s], w, state)
    contact_states = workspace.contact_states
    n = workspace.contact_states.shape[0]
    half = state.shape[0] // 2
    for a in range(n):
        if is_joined(sets, s, a):
            state[half - n + a] += contact_states[a].offset
            contact_states[a].q = state[half - n + a]
            contact_states[a].v = state[2 * half - n + a]
        else:
            state[half - n + a], state[2 * half - n + a] = contact_states[a].q, contact_states[a].v


@jit
def change_set(scene, window, before, state, workspace):
    """Continue in the set of absorbers that are joined now, from ``state`` in set ``before``.

    ``before``: position of the set that is left, BEFORE_FIRST_SET at the start of a run.

    Going through the state leaves the rounding of two maps. In the same set only the constant
    forces change. In another set the relative motion of the absorbers is kept: otherwise bounces
    and slips as small as that rounding would never end.
    """
    sets = scene.sets
    s = find_joined_set(sets, workspace.contact_states)
    z = workspace.buffers.z
    if s == before:
        add_weighted(workspace.place_rows[s], REST, 1.0, z)
        update_static_deflection(
            sets,
            scene.absorbers,
            workspace.contact_states,
            s,
            workspace.place_rows,
            workspace.deflection,
        )
        add_weighted(workspace.place_rows[s], REST, -1.0, z)
        return
    if before != BEFORE_FIRST_SET:
        save_relative_motion(scene, window, before, workspace)
    update_set_response(sets, window, s, workspace)
    enter_set(sets, scene.absorbers, window, s, workspace, state)
    if before != BEFORE_FIRST_SET:
        restore_relative_motion(scene, window, s, workspace)


@jit
def compute_relative_motion(scene, window, s, a, workspace):
    """Return relative displacement (m) and velocity (m/s) of the free absorber a in set s.

    They are absorber minus beam. The absorber's guard signal is filled.
    """
    sets = scene.sets
    contact_state = workspace.contact_states[a]
    update_guard_response(sets, scene.absorbers, window, s, a, workspace.forced_sets)
    fill_guard_signal(scene, s, a, workspace)
    signal = view_signal(workspace.signals, a)
    value, rate, _ = evaluate_at_offset(
        view_set_system(sets, s, sets.rows[s, a]),
        view_set_response(workspace.forced_sets, s, a).signals,
        window.omega,
        signal,
        contact_state.tau,
        0.0,
    )
    return value, rate


@jit
def compute_relative_rate_scale(sets, s, a, workspace):
    """Return the sum of the sizes of the terms of the relative velocity of absorber a in set s.

    `compute_relative_motion` must have filled its signal.
    """
    u = workspace.signals.u[a]
    scale = abs(workspace.contact_states[a].v) + workspace.forced_sets.bound[s, a, 1]
    for j in range(u.shape[1]):
        scale += sets.rows[s, a, SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return scale


@jit
def save_relative_motion(scene, window, s, workspace):
    """Save the relative motion of the absorbers that are free from now on, before set s is left.

    It goes to ``workspace.motion``. An absorber that slides no faster than rounding is set at rest.
    """
    sets = scene.sets
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        motion = workspace.motion[a]
        if contact_state.regime == FREE:
            value, rate = (
                (contact_state.offset, 0.0)
                if is_joined(sets, s, a)
                else compute_relative_motion(scene, window, s, a, workspace)
            )
            if scene.absorbers.limit[a] > 0.0 and abs(
                rate
            ) <= POSITION_ROUNDING * compute_relative_rate_scale(sets, s, a, workspace):
                # it has just begun to slide, and not yet by more than rounding
                contact_state.at_rest = True
            motion.q = value
            motion.v = 0.0 if contact_state.at_rest else rate


@jit
def restore_relative_motion(scene, window, s, workspace):
    """Correct q and v of the free absorbers in set s to the saved relative motion.

    It was changed by rounding on the way through the state.
    """
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        motion = workspace.motion[a]
        if contact_state.regime == FREE:
            value, rate = compute_relative_motion(scene, window, s, a, workspace)
            contact_state.q += motion.q - value
            contact_state.v += motion.v - rate


@jit
def resolve_resting_absorbers(scene, window, s, state, workspace, events):
    """Decide for all absorbers without relative velocity whether they stick or slip.

    The motion continues in the resulting set. ``state`` is overwritten by that at the current time.
    """
    absorbers = scene.absorbers
    sets = scene.sets
    write_set_state(sets, window, s, workspace, state)
    for a in range(workspace.contact_states.shape[0]):
        row = workspace.contact_states[a]
        contact = view_contact_law(scene, 0, a, absorbers.restitution[a])
        workspace.joints.complete[a] = row.at_rest or is_joined(sets, s, a)
        if row.at_rest and not is_joined(sets, s, a):
            add_base_motion(sets, window, s, a, 1.0, workspace)
            update_wall_contact(contact.walls, row, compute_tip_motion(contact, state)[0])
        workspace.joints.undecided[a] = is_joined(sets, s, a) or (
            row.at_rest and (absorbers.limit[a] > 0.0 or row.side != 0.0)
        )
    resolve_joints(
        absorbers,
        scene.losses,
        scene.sets.compliance[0],
        window,
        workspace.contact_states,
        state,
        workspace.joints,
        events,
    )
    for a in range(workspace.contact_states.shape[0]):
        if workspace.joints.complete[a] and workspace.contact_states[a].regime == FREE:
            add_base_motion(sets, window, s, a, -1.0, workspace)
    change_set(scene, window, s, state, workspace)


@jit
def find_passed_bound(scene, window, s, b, workspace):
    """Return the guard (HIT_LOW, HIT_HIGH) that the joint force of a joined absorber b leaves now.

    The joint force is at this guard up to rounding and moves beyond it. If it is at no guard, the
    result is NOTHING.
    """
    fill_guard_signal(scene, s, b, workspace)
    sets = scene.sets
    update_guard_response(sets, scene.absorbers, window, s, b, workspace.forced_sets)
    signal = view_signal(workspace.signals, b)
    forced = view_set_response(workspace.forced_sets, s, b)
    contact_state = workspace.contact_states[b]
    f, rate, _ = evaluate_at_offset(
        view_set_system(sets, s, sets.rows[s, b]),
        forced.signals,
        window.omega,
        signal,
        contact_state.tau,
        0.0,
    )
    low, high = find_joint_bounds(scene.absorbers.limit[b], contact_state.side)
    slack = POSITION_ROUNDING * compute_signal_scale(signal, forced.bound)
    if rate > 0.0 and f >= high - slack:
        return HIT_HIGH
    if rate < 0.0 and f <= low + slack:
        return HIT_LOW
    return NOTHING


@jit
def release_from_set(scene, window, s, a, event, state, workspace, events):
    """Release absorber a from set s, because its joint force has left its bounds.

    ``event``: HIT_LOW or HIT_HIGH. All others whose joint force leaves its bounds at this time are
    released as well. No force jumps. ``state`` is overwritten by that at the event.
    """
    sets = scene.sets
    contact_states = workspace.contact_states
    write_set_state(sets, window, s, workspace, state)
    compute_contact_kinematics(scene.absorbers, state, workspace.joints)
    time = window.centre + contact_states[0].tau
    for b in range(contact_states.shape[0]):
        kind = event if b == a else NOTHING
        if b != a and is_joined(sets, s, b):
            kind = find_passed_bound(scene, window, s, b, workspace)
        if kind != NOTHING:
            begin_slip(
                scene.absorbers.limit[b],
                contact_states[b],
                workspace.joints.beam_velocity[b],
                -1.0 if kind == HIT_HIGH else 1.0,
                time,
                events,
            )
            add_base_motion(sets, window, s, b, -1.0, workspace)
    change_set(scene, window, s, state, workspace)


@jit
def stop_simultaneous_reversals(scene, window, s, a, workspace, events):
    """Set at rest the other absorbers whose relative velocity is zero up to rounding now.

    This occurs in motions that many absorbers share. Their reversals are appended to ``events``.
    """
    contact_states = workspace.contact_states
    for b in range(contact_states.shape[0]):
        other = contact_states[b]
        if (
            b != a
            and other.regime == FREE
            and not other.at_rest
            and scene.absorbers.limit[b] > 0.0
            and not workspace.safe_times[b].until > other.tau
        ):
            _, rate = compute_relative_motion(scene, window, s, b, workspace)
            if abs(rate) <= POSITION_ROUNDING * compute_relative_rate_scale(
                scene.sets, s, b, workspace
            ):
                other.at_rest = True
                push_reversal(events, window.centre + other.tau, other.absorber)


@jit
def handle_reversal(scene, window, s, a, event, state, workspace, events):
    """Handle the REVERSAL of absorber a in set s: it sticks, or slips the other way.

    The motion in ``workspace`` continues in the resulting set; ``state`` is scratch.
    """
    contact_states = workspace.contact_states
    sets = scene.sets
    limit = scene.absorbers.limit[a]
    push_reversal(events, window.centre + contact_states[0].tau, contact_states[a].absorber)
    stop_simultaneous_reversals(scene, window, s, a, workspace, events)
    alone = s == 0
    for b in range(contact_states.shape[0]):
        if b != a and contact_states[b].at_rest:
            alone = False
    if alone:
        body = AbsorberView(contact_states[a], workspace.buffers, view_signal(workspace.signals, a))
        contact = view_contact_law(scene, s, a, scene.absorbers.restitution[a])
        if not reverse_or_stick(
            view_set_system(sets, s, sets.rows[s, a]), contact, limit, body, event
        ):
            update_static_deflection(
                sets,
                scene.absorbers,
                contact_states,
                s,
                workspace.place_rows,
                workspace.deflection,
            )
            return
    contact_states[a].at_rest = True
    resolve_resting_absorbers(scene, window, s, state, workspace, events)


@jit
def is_held(scene, window, s, b, kick, state, workspace):
    """Return whether absorber b stays joined after an impulse gives it the velocity ``kick`` (m/s).

    It does if the distance that it needs to come to rest, kick^2/(2 a), is below the rounding of
    the position. The deceleration a follows from the distance of the joint force from its bounds.
    """
    z = workspace.buffers.z
    u = workspace.buffers.u
    sets = scene.sets
    absorbers = scene.absorbers
    update_guard_response(sets, absorbers, window, s, b, workspace.forced_sets)
    apply_weights(sets.rows[s, b], GUARD, z, u)
    f = absorbers.mass[b] * absorbers.gravity[b] + evaluate_signal(
        workspace.forced_sets.signals[s, b], 0, window.omega, workspace.contact_states[0].tau
    )
    for j in range(u.shape[1]):
        f += u[0, j]
    low, high = find_joint_bounds(absorbers.limit[b], workspace.contact_states[b].side)
    margin = min(high - f, f - low)
    if not margin > 0.0:
        return False
    size = abs(workspace.contact_states[b].offset)
    for i in range(absorbers.shapes.shape[1]):
        size += abs(absorbers.shapes[b, i] * state[i])
    return kick * kick <= 2.0 * margin * sets.compliance[0, b, b] * POSITION_ROUNDING * size


@jit
def release_by_impact(scene, window, s, a, event, state, workspace, events):
    """Release the joined absorbers that an impact of absorber a separates from the beam.

    Returns True if there are any; the motion then continues in the new set. ``state`` is
    overwritten by that at the impact.
    """
    contact_states = workspace.contact_states
    sets = scene.sets
    compliance = sets.compliance[0]
    absorbers = scene.absorbers
    freed = workspace.joints.freed
    e = compute_restitution(
        view_contact_law(scene, s, a, absorbers.restitution[a]).walls, event.rate
    )
    impulse = -(1.0 + e) * event.rate / compliance[a, a]
    write_set_state(sets, window, s, workspace, state)
    compute_contact_kinematics(absorbers, state, workspace.joints)
    changed = False
    for b in range(contact_states.shape[0]):
        freed[b] = is_joined(sets, s, b) and not is_held(
            scene, window, s, b, compliance[b, a] * impulse, state, workspace
        )
        changed = changed or freed[b]
    for b in range(contact_states.shape[0]):
        if freed[b]:
            begin_slip(
                absorbers.limit[b],
                contact_states[b],
                workspace.joints.beam_velocity[b],
                1.0,
                window.centre + contact_states[b].tau,
                events,
            )
            add_base_motion(sets, window, s, b, -1.0, workspace)
    if changed:
        change_set(scene, window, s, state, workspace)
    return changed


@jit
def propagate_impulse(scene, window, s, a, impulse, state, workspace):
    """Update the slip directions of the other absorbers after an impulse (N s) on absorber a."""
    contact_states = workspace.contact_states
    absorbers = scene.absorbers
    turned = False
    for b in range(contact_states.shape[0]):
        other = contact_states[b]
        if (
            b != a
            and other.regime == FREE
            and (absorbers.limit[b] > 0.0 or other.at_rest)
            and may_turn(scene.sets, s, a, b, impulse, workspace)
        ):
            # an absorber at rest has the speed of the impulse's response, which is free of rounding
            speed = (
                scene.sets.compliance[s, b, a] * impulse
                if other.at_rest
                else compute_relative_motion(scene, window, s, b, workspace)[1]
            )
            if speed != 0.0:
                sign = 1.0 if speed > 0.0 else -1.0
                turned = turned or sign != other.sign
                other.sign = sign
                other.at_rest = False
                update_friction_force(absorbers.limit[b], other)
    if turned:
        write_set_state(scene.sets, window, s, workspace, state)
        change_set(scene, window, s, state, workspace)


@jit
def compute_set_restitution(scene, s, a, rate):
    """Return the effective restitution of an impact of absorber a in set s at ``rate`` (m/s).

    The impulse is computed for the free beam. The joints of joined absorbers, which stay joined,
    take out the velocity that it gives them, so the effective mass is larger.
    """
    sets = scene.sets
    restitution = scene.absorbers.restitution[a]
    e = compute_restitution(view_contact_law(scene, s, a, restitution).walls, rate)
    if s == 0:
        return e
    return max((1.0 + e) * sets.compliance[s, a, a] / sets.compliance[0, a, a] - 1.0, 0.0)


@jit
def handle_impact(scene, window, s, a, event, state, workspace, observers):
    """Handle the impact of absorber a in set s.

    This comprises the impact law, the release of joined absorbers, and the slip directions of the
    others. The motion in ``workspace`` continues in the resulting set; ``state`` is scratch.
    """
    contact_states = workspace.contact_states
    sets = scene.sets
    mass = scene.absorbers.mass[a]
    changed = False
    if s != 0:
        changed = release_by_impact(scene, window, s, a, event, state, workspace, observers.events)
        if changed:
            forget_safe_times(workspace.safe_times)
        s = find_joined_set(sets, contact_states)
    update_guard_response(sets, scene.absorbers, window, s, a, workspace.forced_sets)
    contact_states[a].impulse_bound = NO_BOUND if changed else sets.acceleration_bound[s, a, a]
    system = view_set_system(sets, s, sets.rows[s, a])
    forced = view_set_response(workspace.forced_sets, s, a)
    body = AbsorberView(contact_states[a], workspace.buffers, view_signal(workspace.signals, a))
    contact = view_contact_law(scene, s, a, compute_set_restitution(scene, s, a, event.rate))
    walls = Walls(contact.walls.gap, contact.walls.restitution, np.inf)
    before = contact_states[a].v
    rests = apply_impact(system, forced, window, walls, contact, body, event, observers)
    update_static_deflection(
        sets, scene.absorbers, contact_states, s, workspace.place_rows, workspace.deflection
    )
    contact_states[a].at_rest = rests
    propagate_impulse(scene, window, s, a, mass * (contact_states[a].v - before), state, workspace)
    if rests or s != 0:
        resolve_resting_absorbers(scene, window, s, state, workspace, observers.events)


@jit
def init_joined_set(scene, window, state, workspace, events):
    """Choose the first set of a run, which begins with ``state``.

    Absorbers without relative velocity are joined if friction or a wall can hold them. Contact
    states and amplitudes in ``workspace`` are written.
    """
    contact_states = workspace.contact_states
    absorbers = scene.absorbers
    half = state.shape[0] // 2
    n = workspace.contact_states.shape[0]
    for a in range(n):
        row = contact_states[a]
        limit = absorbers.limit[a]
        contact = view_contact_law(scene, 0, a, absorbers.restitution[a])
        row.q = state[half - n + a]
        row.v = state[2 * half - n + a]
        relative = detect_wall_contact(contact, contact.walls, row, state)
        workspace.joints.undecided[a] = relative == 0.0 and (limit > 0.0 or row.side != 0.0)
        if relative * row.side > 0.0:
            row.side = 0.0  # on a wall and moving into it: the search reports the impact at once
        update_friction_force(limit, row)
    resolve_joints(
        absorbers,
        scene.losses,
        scene.sets.compliance[0],
        window,
        contact_states,
        state,
        workspace.joints,
        events,
    )
    change_set(scene, window, BEFORE_FIRST_SET, state, workspace)
    s = find_joined_set(scene.sets, contact_states)
    for a in range(n):
        if contact_states[a].regime == FREE:
            add_base_motion(scene.sets, window, s, a, -1.0, workspace)
