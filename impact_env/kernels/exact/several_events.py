"""What one absorber's event does to the others, and the way from one set of joined absorbers to another (sets.py).

- An impact changes all relative velocities at once, by the beam's mobility between the places. A
  finite friction force cannot hold against it, so a stuck absorber slides on with the velocity that
  it was given. One that a wall holds leaves it, or hits it at once and bounces. Only where all that
  would stay below the rounding of the position does it stay joined: else two absorbers at rest on
  walls would set each other free for ever. Then the impulse is still that of the law without
  joints, and the joint takes out what it gives, as coming to rest again would: bounces go on dying
  out.
- Where a force jumps (a reversal, an impact with friction, a new joint), all absorbers without
  relative velocity are settled together (joint_forces.py). Events at the same time are taken one
  after the other, in the order of the absorbers. Impacts at two places at once have no unique
  outcome in rigid-body mechanics: this is a choice.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_view
from impact_env.kernels.events.signals import HIT_HIGH, evaluate_at_offset
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
    compute_tip_motion,
    detect_wall_contact,
    joint_bounds,
    reverse_or_stick,
    update_friction_force,
    update_wall_contact,
)
from impact_env.kernels.exact.sets import (
    enter_set,
    find_joined_set,
    forced_of_set,
    is_joined,
    signal_of_absorber,
    system_of_set,
    update_set_response,
    update_static_deflection,
)
from impact_env.kernels.motion.forced import add_forced, evaluate_signal
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
def contact_of_absorber(scene, s, a, restitution):
    """Return the contact law of absorber a in set s."""
    absorbers = scene.absorbers
    walls = Walls(absorbers.gap[a], restitution, None)
    return ContactLaw(
        absorbers.mass[a],
        scene.sets.compliance[s, a, a],
        absorbers.shapes[a],
        walls,
        absorbers.limit[a],
        None,
        1.0,
    )


@jit
def write_set_state(sets, window, s, workspace, state):
    """Write the state at the current time."""
    w = workspace.buffers.rows[0]
    copy_amplitudes(workspace.buffers.z, w)
    add_forced(
        workspace.forced_sets.polynomials[s], window.omega, workspace.contact_states[0].tau, 1.0, w
    )
    write_state_from(sets, s, w, workspace, state)


@jit
def write_state_from(sets, s, w, workspace, state):
    """Write the state from the amplitudes ``w`` (free and forced part) of set s and the absorbers' motion; ``w`` is changed."""
    add_weighted(workspace.place_rows[s], REST, 1.0, w)
    compute_state(sets.out[s], w, state)
    contact_states = workspace.contact_states
    n = workspace.contact_states.shape[0]
    half = state.shape[0] // 2
    for a in range(n):
        if is_joined(s, a):
            state[half - n + a] += contact_states[a].offset
            contact_states[a].q = state[half - n + a]
            contact_states[a].v = state[2 * half - n + a]
        else:
            state[half - n + a], state[2 * half - n + a] = contact_states[a].q, contact_states[a].v


@jit
def change_set(scene, window, before, state, workspace):
    """Continue in the regime of the absorbers that are joined now, from a state left in set ``before``.

    Going through the state leaves the rounding of two maps. In the same set only the constant
    forces change. In another set the relative motion of the absorbers is kept: otherwise bounces
    and slips as small as that rounding would never end.
    """
    s = find_joined_set(workspace.contact_states)
    z = workspace.buffers.z
    sets = scene.sets
    if s == before:
        add_weighted(workspace.place_rows[s], REST, 1.0, z)
        update_static_deflection(
            sets, workspace.contact_states, s, workspace.place_rows, workspace.deflection
        )
        add_weighted(workspace.place_rows[s], REST, -1.0, z)
        return
    if before != BEFORE_FIRST_SET:
        save_relative_motion(scene, window, before, workspace)
    update_set_response(sets, scene.absorbers, window, s, workspace.forced_sets)
    enter_set(sets, window, s, workspace, state)
    if before != BEFORE_FIRST_SET:
        restore_relative_motion(sets, window, s, workspace)


@jit
def compute_relative_motion(sets, window, s, a, workspace):
    """Return relative displacement and velocity (absorber minus beam) of the sliding absorber a in set s."""
    contact_state = workspace.contact_states[a]
    system = system_of_set(sets, s, sets.rows[s, a])
    signal = signal_of_absorber(workspace.signals, a)
    apply_weights(system.rows, GUARD, workspace.buffers.z, signal.u)
    signal.polynomial[0], signal.polynomial[1], signal.polynomial[2] = (
        contact_state.q - workspace.deflection[a],
        contact_state.v,
        contact_state.a,
    )
    value, rate, _ = evaluate_at_offset(
        system,
        forced_of_set(workspace.forced_sets, s, a).signals,
        window.omega,
        signal,
        contact_state.tau,
        0.0,
    )
    return value, rate


@jit
def compute_relative_rate_scale(sets, s, a, workspace):
    """Return the sum of the sizes of the terms of the relative velocity of absorber a in set s.

    `compute_relative_motion` has written its signal.
    """
    u = workspace.signals.u[a]
    scale = abs(workspace.contact_states[a].v) + workspace.forced_sets.bound[s, a, 1]
    for j in range(u.shape[1]):
        scale += sets.rows[s, a, SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return scale


@jit
def save_relative_motion(scene, window, s, workspace):
    """Save the relative motion of the absorbers that slide from now on, before set s is left."""
    sets = scene.sets
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        motion = workspace.motion[a]
        if contact_state.regime == FREE:
            value, rate = (
                (contact_state.offset, 0.0)
                if is_joined(s, a)
                else compute_relative_motion(sets, window, s, a, workspace)
            )
            if scene.absorbers.limit[a] > 0.0 and abs(
                rate
            ) <= POSITION_ROUNDING * compute_relative_rate_scale(sets, s, a, workspace):
                contact_state.at_rest = (
                    True  # it has just begun to slide, and not yet by more than rounding
                )
            motion.q = value
            motion.v = 0.0 if contact_state.at_rest else rate


@jit
def restore_relative_motion(sets, window, s, workspace):
    """Restore the relative motion that was lost to rounding on the way through the state."""
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        motion = workspace.motion[a]
        if contact_state.regime == FREE:
            value, rate = compute_relative_motion(sets, window, s, a, workspace)
            contact_state.q += motion.q - value
            contact_state.v += motion.v - rate


@jit
def resolve_resting_absorbers(scene, window, s, state, workspace, events):
    """Decide for all absorbers without relative velocity whether they stick or slip, and continue in the resulting set."""
    absorbers = scene.absorbers
    write_set_state(scene.sets, window, s, workspace, state)
    for a in range(workspace.contact_states.shape[0]):
        row = workspace.contact_states[a]
        contact = contact_of_absorber(scene, 0, a, absorbers.restitution[a])
        if row.at_rest and not is_joined(s, a):
            update_wall_contact(contact.walls, row, compute_tip_motion(contact, state)[0])
        workspace.joints.undecided[a] = is_joined(s, a) or (
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
    change_set(scene, window, s, state, workspace)


@jit
def release_from_set(scene, window, s, a, event, state, workspace, events):
    """Release absorber a from set s, as its joint force has left its bounds. No force jumps."""
    write_set_state(scene.sets, window, s, workspace, state)
    compute_contact_kinematics(scene.absorbers, state, workspace.joints)
    time = window.centre + workspace.contact_states[0].tau
    begin_slip(
        scene.absorbers.limit[a],
        workspace.contact_states[a],
        workspace.joints.beam_velocity[a],
        -1.0 if event == HIT_HIGH else 1.0,
        time,
        events,
    )
    change_set(scene, window, s, state, workspace)


@jit
def handle_reversal(scene, window, s, a, event, state, workspace, events):
    """Handle zero relative velocity of absorber a: it sticks, or slips the other way."""
    contact_states = workspace.contact_states
    sets = scene.sets
    limit = scene.absorbers.limit[a]
    push_reversal(events, window.centre + contact_states[0].tau, contact_states[a].absorber)
    alone = s == 0
    for b in range(contact_states.shape[0]):
        if b != a and contact_states[b].at_rest:
            alone = False
    if alone:
        body = AbsorberView(
            contact_states[a], workspace.buffers, signal_of_absorber(workspace.signals, a)
        )
        contact = contact_of_absorber(scene, s, a, scene.absorbers.restitution[a])
        if not reverse_or_stick(
            system_of_set(sets, s, sets.rows[s, a]), contact, limit, body, event
        ):
            update_static_deflection(
                sets, contact_states, s, workspace.place_rows, workspace.deflection
            )
            return
    contact_states[a].at_rest = True
    resolve_resting_absorbers(scene, window, s, state, workspace, events)


@jit
def remains_stuck(scene, window, s, b, kick, state, workspace):
    """Return whether a joined absorber stays joined although an impulse gives it a relative velocity ``kick`` (m/s).

    It does where its way to rest, kick^2/(2 a), is below the rounding of the position. The
    deceleration a follows from the distance of the joint force from its bounds.
    """
    z = workspace.buffers.z
    u = workspace.buffers.u
    sets = scene.sets
    absorbers = scene.absorbers
    apply_weights(sets.rows[s, b], GUARD, z, u)
    f = evaluate_signal(
        workspace.forced_sets.signals[s, b], 0, window.omega, workspace.contact_states[0].tau
    )
    for j in range(u.shape[1]):
        f += u[0, j]
    low, high = joint_bounds(absorbers.limit[b], workspace.contact_states[b].side)
    margin = min(high - f, f - low)
    if not margin > 0.0:
        return False
    size = abs(workspace.contact_states[b].offset)
    for i in range(absorbers.shapes.shape[1]):
        size += abs(absorbers.shapes[b, i] * state[i])
    return kick * kick <= 2.0 * margin * sets.compliance[0, b, b] * POSITION_ROUNDING * size


@jit
def release_by_impact(scene, window, s, a, event, state, workspace, events):
    """Release the joined absorbers that an impact of absorber a tears loose; return True if there are any."""
    contact_states = workspace.contact_states
    compliance = scene.sets.compliance[0]
    absorbers = scene.absorbers
    impulse = -(1.0 + absorbers.restitution[a]) * event.rate / compliance[a, a]
    write_set_state(scene.sets, window, s, workspace, state)
    compute_contact_kinematics(absorbers, state, workspace.joints)
    freed = 0
    for b in range(contact_states.shape[0]):
        if is_joined(s, b):
            if not remains_stuck(scene, window, s, b, compliance[b, a] * impulse, state, workspace):
                freed |= 1 << b
    for b in range(contact_states.shape[0]):
        if is_joined(freed, b):
            begin_slip(
                absorbers.limit[b],
                contact_states[b],
                workspace.joints.beam_velocity[b],
                1.0,
                window.centre + contact_states[b].tau,
                events,
            )
    if freed != 0:
        change_set(scene, window, s, state, workspace)
    return freed != 0


@jit
def propagate_impulse(scene, window, s, a, impulse, state, workspace):
    """Update the slip directions of the other absorbers after an impulse (N s) on absorber a."""
    contact_states = workspace.contact_states
    joints = workspace.joints
    absorbers = scene.absorbers
    others = 0
    for b in range(contact_states.shape[0]):
        if (
            b != a
            and contact_states[b].regime == FREE
            and (absorbers.limit[b] > 0.0 or contact_states[b].at_rest)
        ):
            others |= 1 << b
    if others == 0:
        return
    write_set_state(scene.sets, window, s, workspace, state)
    compute_contact_kinematics(absorbers, state, joints)
    turned = False
    for b in range(contact_states.shape[0]):
        if is_joined(others, b):
            # of one that had none it is what the impulse gave, free of rounding
            speed = (
                scene.sets.compliance[s, b, a] * impulse
                if contact_states[b].at_rest
                else contact_states[b].v - joints.beam_velocity[b]
            )
            if speed != 0.0:
                sign = 1.0 if speed > 0.0 else -1.0
                turned = turned or sign != contact_states[b].sign
                contact_states[b].sign = sign
                contact_states[b].at_rest = False
                update_friction_force(absorbers.limit[b], contact_states[b])
    if turned:
        change_set(scene, window, s, state, workspace)


@jit
def compute_set_restitution(sets, absorbers, s, a):
    """Return the effective restitution of an impact of absorber a in set s, in which joined absorbers stay joined.

    The impulse is that of the free beam. What it gives to joined absorbers is taken out by their
    joints, so the effective mass is larger.
    """
    if s == 0:
        return absorbers.restitution[a]
    return max(
        (1.0 + absorbers.restitution[a]) * sets.compliance[s, a, a] / sets.compliance[0, a, a]
        - 1.0,
        0.0,
    )


@jit
def handle_impact(scene, window, s, a, event, state, workspace, observers):
    """Handle the impact of absorber a in set s: impact law, release of joined absorbers, slip directions of the others."""
    contact_states = workspace.contact_states
    sets = scene.sets
    mass = scene.absorbers.mass[a]
    changed = False
    if s != 0:
        changed = release_by_impact(scene, window, s, a, event, state, workspace, observers.events)
        s = find_joined_set(contact_states)
    contact_states[a].impulse_bound = NO_BOUND if changed else workspace.impulse_bounds[s, a]
    system = system_of_set(sets, s, sets.rows[s, a])
    forced = forced_of_set(workspace.forced_sets, s, a)
    body = AbsorberView(
        contact_states[a], workspace.buffers, signal_of_absorber(workspace.signals, a)
    )
    contact = contact_of_absorber(scene, s, a, compute_set_restitution(sets, scene.absorbers, s, a))
    before = contact_states[a].v
    rests = apply_impact(system, forced, window, contact.walls, contact, body, event, observers)
    update_static_deflection(sets, contact_states, s, workspace.place_rows, workspace.deflection)
    contact_states[a].at_rest = rests
    propagate_impulse(scene, window, s, a, mass * (contact_states[a].v - before), state, workspace)
    if rests or s != 0:
        resolve_resting_absorbers(scene, window, s, state, workspace, observers.events)


@jit
def init_joined_set(scene, window, state, workspace, events):
    """Choose the first set: absorbers without relative velocity are joined if friction or a wall can hold them."""
    contact_states = workspace.contact_states
    absorbers = scene.absorbers
    half = state.shape[0] // 2
    n = workspace.contact_states.shape[0]
    for a in range(n):
        row = contact_states[a]
        limit = absorbers.limit[a]
        contact = contact_of_absorber(scene, 0, a, absorbers.restitution[a])
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
