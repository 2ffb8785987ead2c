"""What one absorber's event does to the others, and the way from one set of joined absorbers to another (sets.py).

- An impact changes all relative velocities at once, by the beam's mobility between the places. A finite friction force cannot hold against it, so a
  stuck absorber slides on with the velocity that it was given. One that a wall holds leaves it, or hits it at once and bounces. Only where all that
  would stay below the rounding of the position does it stay joined: else two absorbers at rest on walls would set each other free for ever. Then the
  impulse is still that of the law without joints, and the joint takes out what it gives, as coming to rest again would: bounces go on dying out.
- Where a force jumps (a reversal, an impact with friction, a new joint), all absorbers without relative velocity are settled together (settle.py).
Events at the same time are taken one after the other, in the order of the absorbers. Impacts at two places at once have no unique outcome in
rigid-body mechanics: this is a choice.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_view
from impact_env.kernels.events.signals import HIT_HIGH, at_offset
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    ROUNDING,
    Body,
    Contact,
    Walls,
    friction_force,
    impact,
    joint_bounds,
    stay_at_wall,
    tip_motion,
    touch,
    turn,
)
from impact_env.kernels.exact.sets import (
    bend,
    enter_set,
    forced_of,
    is_joined,
    joined_set,
    signal_of,
    slots_with,
    solve_set,
)
from impact_env.kernels.exact.settle import part, see_places, settle
from impact_env.kernels.motion.forced import add_forced, signal_value
from impact_env.kernels.motion.observers import push_reversal
from impact_env.kernels.motion.segments import to_state
from impact_env.kernels.motion.slots import GUARD, REST, SPEED, add, copy, weigh

UNKNOWN = 1e300  # as a bound: none
NO_SET = -1  # before a run's first regime


@jit_view
def contact_of(scene, s, a, restitution):
    """Return the contact of absorber a in set s."""
    absorbers = scene.absorbers
    walls = Walls(absorbers.gap[a], restitution, None)
    return Contact(
        absorbers.mass[a],
        scene.sets.compliance[s, a, a],
        absorbers.shapes[a],
        walls,
        absorbers.limit[a],
        None,
        1.0,
    )


@jit
def write_state(sets, window, s, room, state):
    """Write the state at the current time."""
    w = room.work.rows[0]
    copy(room.work.z, w)
    add_forced(room.flow.slots[s], window.omega, room.now[0].tau, 1.0, w)
    write_from(sets, s, w, room, state)


@jit
def write_from(sets, s, w, room, state):
    """Write the state from free and forced part of the slots of set s, and displacement and velocity of the absorbers; w is changed."""
    add(room.own[s], REST, 1.0, w)
    to_state(sets.out[s], w, state)
    now = room.now
    n = room.now.shape[0]
    half = state.shape[0] // 2
    for a in range(n):
        if is_joined(s, a):
            state[half - n + a] += now[a].offset
            now[a].q = state[half - n + a]
            now[a].v = state[2 * half - n + a]
        else:
            state[half - n + a], state[2 * half - n + a] = now[a].q, now[a].v


@jit
def go_to(scene, window, before, state, room):
    """Go on in the regime of the absorbers that are joined now, from a state that was left in set ``before``.

    The way through the state leaves the rounding of two maps. In the same set only the constant forces change, and that is all that is done; in
    another one the absorbers' motion relative to the beam is kept. Else bounces and slips as small as that rounding would never end.
    """
    s = joined_set(room.now)
    z = room.work.z
    sets = scene.sets
    if s == before:
        add(room.own[s], REST, 1.0, z)
        bend(sets, room.now, s, room.own, room.bent)
        add(room.own[s], REST, -1.0, z)
        return
    if before != NO_SET:
        note_relative(scene, window, before, room)
    solve_set(sets, scene.absorbers, window, s, room.flow)
    enter_set(sets, window, s, room, state)
    if before != NO_SET:
        keep_relative(sets, window, s, room)


@jit
def relative(sets, window, s, a, room):
    """Return displacement and velocity of absorber a, which is apart in set s, less those of the beam at its place."""
    now = room.now[a]
    slots = slots_with(sets, s, sets.rows[s, a])
    signal = signal_of(room.signals, a)
    weigh(slots.rows, GUARD, room.work.z, signal.u)
    signal.polynomial[0], signal.polynomial[1], signal.polynomial[2] = (
        now.q - room.bent[a],
        now.v,
        now.a,
    )
    value, rate, _ = at_offset(
        slots, forced_of(room.flow, s, a).signals, window.omega, signal, now.tau, 0.0
    )
    return value, rate


@jit
def rate_scale(sets, s, a, room):
    """Return the size of the terms that the relative velocity of absorber a in set s is the sum of, once `relative` has written its signal."""
    u = room.signals.u[a]
    scale = abs(room.now[a].v) + room.flow.bound[s, a, 1]
    for j in range(u.shape[1]):
        scale += sets.rows[s, a, SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return scale


@jit
def note_relative(scene, window, s, room):
    """Write the relative motion of the absorbers that are apart from now on, as set s has it, which is being left."""
    sets = scene.sets
    for a in range(room.now.shape[0]):
        now = room.now[a]
        motion = room.motion[a]
        if now.regime == FREE:
            value, rate = (
                (now.offset, 0.0) if is_joined(s, a) else relative(sets, window, s, a, room)
            )
            if scene.absorbers.limit[a] > 0.0 and abs(rate) <= ROUNDING * rate_scale(
                sets, s, a, room
            ):
                now.at_rest = True  # it has just begun to slide, and not yet by more than rounding
            motion.q = value
            motion.v = 0.0 if now.at_rest else rate


@jit
def keep_relative(sets, window, s, room):
    """Shift the absorbers that are apart in set s by what the way through the state has changed in their relative motion."""
    for a in range(room.now.shape[0]):
        now = room.now[a]
        motion = room.motion[a]
        if now.regime == FREE:
            value, rate = relative(sets, window, s, a, room)
            now.q += motion.q - value
            now.v += motion.v - rate


@jit
def settle_waiting(scene, window, s, state, room, events):
    """Settle all absorbers without relative velocity, joined ones in set s and those that just came to rest, and go on in the regime that results."""
    absorbers = scene.absorbers
    write_state(scene.sets, window, s, room, state)
    for a in range(room.now.shape[0]):
        row = room.now[a]
        contact = contact_of(scene, 0, a, absorbers.restitution[a])
        if row.at_rest and not is_joined(s, a):
            stay_at_wall(contact.walls, row, tip_motion(contact, state)[0])
        room.joints.waits[a] = is_joined(s, a) or (
            row.at_rest and (absorbers.limit[a] > 0.0 or row.side != 0.0)
        )
    settle(
        absorbers,
        scene.losses,
        scene.sets.compliance[0],
        window,
        room.now,
        state,
        room.joints,
        events,
    )
    go_to(scene, window, s, state, room)


@jit
def release(scene, window, s, a, event, state, room, events):
    """Let absorber a leave set s: it lags where the joint force is above its bound, leads where it is below. No force jumps."""
    write_state(scene.sets, window, s, room, state)
    see_places(scene.absorbers, state, room.joints)
    time = window.centre + room.now[0].tau
    part(
        scene.absorbers.limit[a],
        room.now[a],
        room.joints.speed[a],
        -1.0 if event == HIT_HIGH else 1.0,
        time,
        events,
    )
    go_to(scene, window, s, state, room)


@jit
def reverse(scene, window, s, a, found, state, room, events):
    """The relative velocity of absorber a is zero: stick, or slide on the other way."""
    now = room.now
    sets = scene.sets
    limit = scene.absorbers.limit[a]
    push_reversal(events, window.centre + now[0].tau, now[a].which)
    alone = s == 0
    for b in range(now.shape[0]):
        if b != a and now[b].at_rest:
            alone = False
    if alone:
        body = Body(now[a], room.work, signal_of(room.signals, a))
        contact = contact_of(scene, s, a, scene.absorbers.restitution[a])
        if not turn(slots_with(sets, s, sets.rows[s, a]), contact, limit, body, found):
            bend(sets, now, s, room.own, room.bent)
            return
    now[a].at_rest = True
    settle_waiting(scene, window, s, state, room, events)


@jit
def stays(scene, window, s, b, kick, state, room):
    """Return whether a joined absorber can be kept joined although an impulse gives it a relative velocity ``kick``.

    So it is where its way until it rests again, kick^2/(2 a), is below the rounding of the position; a, its deceleration, follows from how far the
    joint force is off its bounds.
    """
    z = room.work.z
    u = room.work.u
    sets = scene.sets
    absorbers = scene.absorbers
    weigh(sets.rows[s, b], GUARD, z, u)
    f = signal_value(room.flow.signals[s, b], 0, window.omega, room.now[0].tau)
    for j in range(u.shape[1]):
        f += u[0, j]
    low, high = joint_bounds(absorbers.limit[b], room.now[b].side)
    margin = min(high - f, f - low)
    if not margin > 0.0:
        return False
    size = abs(room.now[b].offset)
    for i in range(absorbers.shapes.shape[1]):
        size += abs(absorbers.shapes[b, i] * state[i])
    return kick * kick <= 2.0 * margin * sets.compliance[0, b, b] * ROUNDING * size


@jit
def set_free(scene, window, s, a, found, state, room, events):
    """Free the joined absorbers that an impact of absorber a tears loose; return True if there are any."""
    now = room.now
    compliance = scene.sets.compliance[0]
    absorbers = scene.absorbers
    impulse = -(1.0 + absorbers.restitution[a]) * found.rate / compliance[a, a]
    write_state(scene.sets, window, s, room, state)
    see_places(absorbers, state, room.joints)
    freed = 0
    for b in range(now.shape[0]):
        if is_joined(s, b):
            if not stays(scene, window, s, b, compliance[b, a] * impulse, state, room):
                freed |= 1 << b
    for b in range(now.shape[0]):
        if is_joined(freed, b):
            part(
                absorbers.limit[b],
                now[b],
                room.joints.speed[b],
                1.0,
                window.centre + now[b].tau,
                events,
            )
    if freed != 0:
        go_to(scene, window, s, state, room)
    return freed != 0


@jit
def kick_others(scene, window, s, a, impulse, state, room):
    """Let the other absorbers that are apart slide in the sign of the relative velocity that they have after an impulse on absorber a."""
    now = room.now
    joints = room.joints
    absorbers = scene.absorbers
    others = 0
    for b in range(now.shape[0]):
        if b != a and now[b].regime == FREE and (absorbers.limit[b] > 0.0 or now[b].at_rest):
            others |= 1 << b
    if others == 0:
        return
    write_state(scene.sets, window, s, room, state)
    see_places(absorbers, state, joints)
    turned = False
    for b in range(now.shape[0]):
        if is_joined(others, b):
            # of one that had none it is what the impulse gave, free of rounding
            speed = (
                scene.sets.compliance[s, b, a] * impulse
                if now[b].at_rest
                else now[b].v - joints.speed[b]
            )
            if speed != 0.0:
                sign = 1.0 if speed > 0.0 else -1.0
                turned = turned or sign != now[b].sign
                now[b].sign = sign
                now[b].at_rest = False
                friction_force(absorbers.limit[b], now[b])
    if turned:
        go_to(scene, window, s, state, room)


@jit
def rebound(sets, absorbers, s, a):
    """Return the restitution of an impact of absorber a in set s, in which those that are joined stay so.

    The impulse is that of the free beam. What it gives to the joined ones is taken out by their joints, so that the beam and they give way less.
    """
    if s == 0:
        return absorbers.restitution[a]
    return max(
        (1.0 + absorbers.restitution[a]) * sets.compliance[s, a, a] / sets.compliance[0, a, a]
        - 1.0,
        0.0,
    )


@jit
def hit(scene, window, s, a, found, state, room, observe):
    """Absorber a hits a wall in set s."""
    now = room.now
    sets = scene.sets
    mass = scene.absorbers.mass[a]
    changed = False
    if s != 0:
        changed = set_free(scene, window, s, a, found, state, room, observe.events)
        s = joined_set(now)
    now[a].kick = UNKNOWN if changed else room.kicks[s, a]
    slots = slots_with(sets, s, sets.rows[s, a])
    forced = forced_of(room.flow, s, a)
    body = Body(now[a], room.work, signal_of(room.signals, a))
    contact = contact_of(scene, s, a, rebound(sets, scene.absorbers, s, a))
    before = now[a].v
    rests = impact(slots, forced, window, contact.walls, contact, body, found, observe)
    bend(sets, now, s, room.own, room.bent)
    now[a].at_rest = rests
    kick_others(scene, window, s, a, mass * (now[a].v - before), state, room)
    if rests or s != 0:
        settle_waiting(scene, window, s, state, room, observe.events)


@jit
def begin(scene, window, state, room, events):
    """Set the first regime from the initial state: absorbers without relative velocity are joined if friction or a wall can hold them."""
    now = room.now
    absorbers = scene.absorbers
    half = state.shape[0] // 2
    n = room.now.shape[0]
    for a in range(n):
        row = now[a]
        limit = absorbers.limit[a]
        contact = contact_of(scene, 0, a, absorbers.restitution[a])
        row.q = state[half - n + a]
        row.v = state[2 * half - n + a]
        relative = touch(contact, contact.walls, row, state)
        room.joints.waits[a] = relative == 0.0 and (limit > 0.0 or row.side != 0.0)
        if relative * row.side > 0.0:
            row.side = 0.0  # on a wall and moving into it: the search reports the impact at once
        friction_force(limit, row)
    settle(
        absorbers, scene.losses, scene.sets.compliance[0], window, now, state, room.joints, events
    )
    go_to(scene, window, NO_SET, state, room)
