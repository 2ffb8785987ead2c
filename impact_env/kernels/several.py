"""Several absorbers on one beam: the events of rigid contact, for any set of joined absorbers (sets.py).

Each absorber has its own guard signal in the regime of the current set, and the next event is the earliest one. Signals, searches, impact law and
friction are those of the single absorber. What is added here is what one absorber's event does to the others:
- An impact changes all relative velocities at once, by the beam's mobility between the places. A finite friction force cannot hold against it, so a
  stuck absorber slides on with the velocity that it was given. One that a wall holds leaves it, or hits it at once and bounces. Only where all that
  would stay below the rounding of the position does it stay joined: else two absorbers at rest on walls would set each other free for ever. Then the
  impulse is still that of the law without joints, and the joint takes out what it gives, as coming to rest again would: bounces go on dying out.
- Where a force jumps (a reversal, an impact with friction, a new joint), all absorbers without relative velocity are settled together (settle.py).
Events at the same time are taken one after the other, in the order of the absorbers. Impacts at two places at once have no unique outcome in
rigid-body mechanics: this is a choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.budget import progress
from impact_env.kernels.check import check_set
from impact_env.kernels.contact_law import Walls
from impact_env.kernels.energies import add_energy
from impact_env.kernels.energy_account import new_account
from impact_env.kernels.forced import add_forced, signal_value
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.next_event import end_of_flight, end_of_hold
from impact_env.kernels.observers import DONE, EVALUATIONS, NOT_FINITE, REACHED, STUCK_TIME
from impact_env.kernels.rigid_contact import (
    AT_REST,
    FORCE,
    FREE,
    JOINED,
    KICK,
    NOW,
    OFFSET,
    REGIME,
    ROUNDING,
    SIDE,
    SIGN,
    TAU,
    WHICH,
    A,
    Contact,
    Q,
    V,
    add_friction_loss,
    end_phase,
    friction_force,
    impact,
    joint_bounds,
    touch,
    turn,
)
from impact_env.kernels.segments import Work, last_sample, new_work, sample_state, sample_tip, to_state, window_count, window_of
from impact_env.kernels.sets import (
    Flow,
    Signals,
    all_kicks,
    bend,
    enter_set,
    forced_of,
    is_joined,
    joined_set,
    new_flow,
    new_signals,
    regime_with,
    signal_of,
    slots_with,
    solve_set,
)
from impact_env.kernels.settle import Joints, new_joints, part, see_places, settle
from impact_env.kernels.signals import HIT_HIGH, NOTHING, REVERSAL, Event, at_offset
from impact_env.kernels.slots import GUARD, REST, SPEED, add, advance, copy, weigh

Array = NDArray[np.float64]
UNKNOWN = 1e300  # as a bound: none
NO_SET = -1  # before a run's first regime


class Room(NamedTuple):
    """What a lane of n absorbers carries from stretch to stretch, and scratch.

    ``now`` (n, NOW): one row for each absorber as in rigid_contact.py; ``own`` (2^n, 28, J): rows of weights of the level's place, with the rest
    part of all forces; ``bent`` (n + 1,): displacement of the places under them; ``motion`` (3 n,) as in `segments.sample_state`; ``kicks`` (2^n, n).
    """

    now: Array
    work: Work
    signals: Signals
    flow: Flow
    joints: Joints
    own: Array
    bent: Array
    motion: Array
    kicks: Array
    scratch: Array


@jit_room
def new_room(sets, absorbers, state):  # type: ignore[no-untyped-def]
    """Return room for a lane."""
    n = absorbers.mass.shape[0]
    now = np.zeros((n, NOW))
    for a in range(n):
        now[a, WHICH] = a
    own = np.ascontiguousarray(sets.rows[:, n])
    work, scratch = new_work(sets.rows.shape[3]), np.zeros_like(state)
    kicks = all_kicks(sets)
    return Room(now, work, new_signals(sets), new_flow(sets), new_joints(n), own, np.zeros(n + 1), np.zeros(3 * n), kicks, scratch)


@jit
def watch(sets, absorbers, window, s, a, length, room):  # type: ignore[no-untyped-def]
    """Return the first event of absorber a within ``length`` (s) in set s."""
    now, limit, z = room.now[a], absorbers.limit[a], room.work.z
    slots, forced, signal = slots_with(sets, s, sets.rows[s, a]), forced_of(room.flow, s, a), signal_of(room.signals, a)
    if is_joined(s, a):
        return end_of_hold(slots, forced, window, limit, now, length, z, signal)
    walls = Walls(absorbers.gap[a], absorbers.restitution[a])
    now[A] = now[FORCE] / absorbers.mass[a]
    if limit > 0.0:
        return end_of_flight(slots, forced, window, walls, limit, now, room.bent[a], length, z, signal)
    return end_of_flight(slots, forced, window, walls, None, now, room.bent[a], length, z, signal)


@jit
def earliest(sets, absorbers, window, s, counters, room):  # type: ignore[no-untyped-def]
    """Return the absorber whose event comes first, and that event; NOTHING at the window's end."""
    first, length = 0, window.half - room.now[0, TAU]
    found = Event(NOTHING, length, 0.0, 0.0, 0.0, 0)
    for a in range(room.now.shape[0]):
        event = watch(sets, absorbers, window, s, a, length, room)
        counters.values[EVALUATIONS] += event.evaluations
        if event.kind != NOTHING or np.isnan(event.offset):
            first, found, length = a, event, event.offset
        if np.isnan(length):
            break
    check_set(counters.check, sets, absorbers, window, s, found.offset, room)
    return first, found


@jit
def pass_time(sets, absorbers, window, losses, s, offset, clock, counters, level, series, energy, room):  # type: ignore[no-untyped-def]
    """Let all move on by ``offset`` (s) without an event."""
    now, work, motion, n = room.now, room.work, room.motion, room.now.shape[0]
    tau = now[0, TAU]
    end = tau + offset
    regime, forced = regime_with(sets, s, room.own[s]), forced_of(room.flow, s, n)
    for a in range(n):
        joined = is_joined(s, a)
        motion[3 * a] = now[a, OFFSET] if joined else now[a, Q]
        motion[3 * a + 1], motion[3 * a + 2] = 0.0 if joined else now[a, V], 0.0 if joined else now[a, A]
    sample_tip(regime.slots, forced.signals, window, work.z, work.u, room.bent[n], tau, end, clock, level)
    sample_state(regime, forced, window, work.z, 1.0, motion, tau, end, clock, work.rows[0], series)
    add_energy(regime, forced, window, losses, work.z, 1.0, motion, tau, end, work.rows, room.scratch, s, energy)
    for a in range(n):
        if is_joined(s, a):
            counters.values[STUCK_TIME] += offset
        else:
            own = slots_with(sets, s, sets.rows[s, a])
            there = forced_of(room.flow, s, a)
            add_friction_loss(absorbers.limit[a], own, there, window.omega, signal_of(room.signals, a), tau, offset, energy)
            now[a, Q] += offset * (now[a, V] + 0.5 * offset * now[a, A])
            now[a, V] += offset * now[a, A]
            if offset > 0.0:
                now[a, SIDE], now[a, AT_REST] = 0.0, 0.0
        now[a, TAU] = end
    advance(regime.slots.rows, sets.table[s], sets.scale[s], offset, work.z)


@jit
def write_state(sets, window, s, tau, room, state):  # type: ignore[no-untyped-def]
    """Write the state at the current time."""
    w = room.work.rows[0]
    copy(room.work.z, w)
    add_forced(room.flow.slots[s], window.omega, tau, 1.0, w)
    write_from(sets, s, w, room, state)


@jit
def write_from(sets, s, w, room, state):  # type: ignore[no-untyped-def]
    """Write the state from free and forced part of the slots of set s, and displacement and velocity of the absorbers; w is changed."""
    add(room.own[s], REST, 1.0, w)
    to_state(sets.out[s], w, state)
    now, n, half = room.now, room.now.shape[0], state.shape[0] // 2
    for a in range(n):
        if is_joined(s, a):
            state[half - n + a] += now[a, OFFSET]
            now[a, Q], now[a, V] = state[half - n + a], state[2 * half - n + a]
        else:
            state[half - n + a], state[2 * half - n + a] = now[a, Q], now[a, V]


@jit
def go_to(sets, absorbers, window, before, state, room):  # type: ignore[no-untyped-def]
    """Go on in the regime of the absorbers that are joined now, from a state that was left in set ``before``.

    The way through the state leaves the rounding of two maps. In the same set only the constant forces change, and that is all that is done; in
    another one the absorbers' motion relative to the beam is kept. Else bounces and slips as small as that rounding would never end.
    """
    s, z = joined_set(room.now), room.work.z
    if s == before:
        add(room.own[s], REST, 1.0, z)
        bend(sets, room.now, s, room.own, room.bent)
        add(room.own[s], REST, -1.0, z)
        return
    if before != NO_SET:
        note_relative(sets, absorbers, window, before, room)
    solve_set(sets, absorbers, window, s, room.flow)
    enter_set(sets, room.flow, window, room.now, s, room.own, room.bent, room.now[0, TAU], state, z)
    if before != NO_SET:
        keep_relative(sets, window, s, room)


@jit
def relative(sets, window, s, a, room):  # type: ignore[no-untyped-def]
    """Return displacement and velocity of absorber a, which is apart in set s, less those of the beam at its place."""
    now, slots, signal = room.now[a], slots_with(sets, s, sets.rows[s, a]), signal_of(room.signals, a)
    weigh(slots.rows, GUARD, room.work.z, signal.u)
    signal.polynomial[0], signal.polynomial[1], signal.polynomial[2] = now[Q] - room.bent[a], now[V], now[A]
    value, rate, _ = at_offset(slots, forced_of(room.flow, s, a).signals, window.omega, signal, now[TAU], 0.0)
    return value, rate


@jit
def rate_scale(sets, s, a, room):  # type: ignore[no-untyped-def]
    """Return the size of the terms that the relative velocity of absorber a in set s is the sum of, once `relative` has written its signal."""
    u, scale = room.signals.u[a], abs(room.now[a, V]) + room.flow.bound[s, a, 1]
    for j in range(u.shape[1]):
        scale += sets.rows[s, a, SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return scale


@jit
def note_relative(sets, absorbers, window, s, room):  # type: ignore[no-untyped-def]
    """Write the relative motion of the absorbers that are apart from now on, as set s has it, which is being left."""
    now, motion = room.now, room.motion
    for a in range(now.shape[0]):
        if now[a, REGIME] == FREE:
            value, rate = (now[a, OFFSET], 0.0) if is_joined(s, a) else relative(sets, window, s, a, room)
            if absorbers.limit[a] > 0.0 and abs(rate) <= ROUNDING * rate_scale(sets, s, a, room):
                now[a, AT_REST] = 1.0  # it has just begun to slide, and not yet by more than rounding
            motion[2 * a], motion[2 * a + 1] = value, 0.0 if now[a, AT_REST] > 0.0 else rate


@jit
def keep_relative(sets, window, s, room):  # type: ignore[no-untyped-def]
    """Shift the absorbers that are apart in set s by what the way through the state has changed in their relative motion."""
    now, motion = room.now, room.motion
    for a in range(now.shape[0]):
        if now[a, REGIME] == FREE:
            value, rate = relative(sets, window, s, a, room)
            now[a, Q] += motion[2 * a] - value
            now[a, V] += motion[2 * a + 1] - rate


@jit
def settle_waiting(sets, absorbers, losses, window, s, state, room, events):  # type: ignore[no-untyped-def]
    """Settle all absorbers without relative velocity, joined ones in set s and those that just came to rest, and go on in the regime that results."""
    write_state(sets, window, s, room.now[0, TAU], room, state)
    for a in range(room.now.shape[0]):
        room.joints.waits[a] = is_joined(s, a) or (room.now[a, AT_REST] > 0.0 and (absorbers.limit[a] > 0.0 or room.now[a, SIDE] != 0.0))
    settle(absorbers, losses, sets.compliance[0], window, room.now, state, room.joints, events)
    go_to(sets, absorbers, window, s, state, room)


@jit
def release(sets, absorbers, window, s, a, event, state, room, events):  # type: ignore[no-untyped-def]
    """Let absorber a leave set s: it lags where the joint force is above its bound, leads where it is below. No force jumps."""
    write_state(sets, window, s, room.now[0, TAU], room, state)
    see_places(absorbers, state, room.joints)
    time = window.centre + room.now[0, TAU]
    part(absorbers.limit[a], room.now[a], room.joints.speed[a], -1.0 if event == HIT_HIGH else 1.0, time, events)
    go_to(sets, absorbers, window, s, state, room)


@jit
def reverse(sets, absorbers, losses, window, s, a, found, state, room, events):  # type: ignore[no-untyped-def]
    """The relative velocity of absorber a is zero: stick, or slide on the other way."""
    now = room.now
    alone = s == 0
    for b in range(now.shape[0]):
        if b != a and now[b, AT_REST] > 0.0:
            alone = False
    if alone:
        regime = regime_with(sets, s, sets.rows[s, a])
        contact = Contact(absorbers.mass[a], sets.compliance[s, a, a], absorbers.shapes[a])
        if not turn(regime, contact, absorbers.limit[a], now[a], room.work, found):
            bend(sets, now, s, room.own, room.bent)
            return
    now[a, AT_REST] = 1.0
    settle_waiting(sets, absorbers, losses, window, s, state, room, events)


@jit
def stays(sets, absorbers, window, s, b, kick, state, room):  # type: ignore[no-untyped-def]
    """Return whether a joined absorber can be kept joined although an impulse gives it a relative velocity ``kick``.

    So it is where its way until it rests again, kick^2/(2 a), is below the rounding of the position; a, its deceleration, follows from how far the
    joint force is off its bounds.
    """
    z, u = room.work.z, room.work.u
    weigh(sets.rows[s, b], GUARD, z, u)
    f = signal_value(room.flow.signals[s, b], 0, window.omega, room.now[0, TAU])
    for j in range(u.shape[1]):
        f += u[0, j]
    low, high = joint_bounds(absorbers.limit[b], room.now[b, SIDE])
    margin = min(high - f, f - low)
    if not margin > 0.0:
        return False
    size = abs(room.now[b, OFFSET])
    for i in range(absorbers.shapes.shape[1]):
        size += abs(absorbers.shapes[b, i] * state[i])
    return kick * kick <= 2.0 * margin * sets.compliance[0, b, b] * ROUNDING * size


@jit
def set_free(sets, absorbers, window, s, a, found, state, room, events):  # type: ignore[no-untyped-def]
    """Free the joined absorbers that an impact of absorber a tears loose; return True if there are any."""
    now, compliance, time = room.now, sets.compliance[0], window.centre + room.now[0, TAU]
    impulse = -(1.0 + absorbers.restitution[a]) * found.rate / compliance[a, a]
    write_state(sets, window, s, now[0, TAU], room, state)
    see_places(absorbers, state, room.joints)
    freed = 0
    for b in range(now.shape[0]):
        if is_joined(s, b):
            if not stays(sets, absorbers, window, s, b, compliance[b, a] * impulse, state, room):
                freed |= 1 << b
    for b in range(now.shape[0]):
        if is_joined(freed, b):
            part(absorbers.limit[b], now[b], room.joints.speed[b], 1.0, time, events)
    if freed != 0:
        go_to(sets, absorbers, window, s, state, room)
    return freed != 0


@jit
def kick_others(sets, absorbers, window, s, a, impulse, state, room):  # type: ignore[no-untyped-def]
    """Let the other absorbers that are apart slide in the sign of the relative velocity that they have after an impulse on absorber a."""
    now, joints = room.now, room.joints
    others = 0
    for b in range(now.shape[0]):
        if b != a and now[b, REGIME] == FREE and (absorbers.limit[b] > 0.0 or now[b, AT_REST] > 0.0):
            others |= 1 << b
    if others == 0:
        return
    write_state(sets, window, s, now[0, TAU], room, state)
    see_places(absorbers, state, joints)
    turned = False
    for b in range(now.shape[0]):
        if is_joined(others, b):
            # of one that had none it is what the impulse gave, free of rounding
            speed = sets.compliance[s, b, a] * impulse if now[b, AT_REST] > 0.0 else now[b, V] - joints.speed[b]
            if speed != 0.0:
                sign = 1.0 if speed > 0.0 else -1.0
                turned = turned or sign != now[b, SIGN]
                now[b, SIGN], now[b, AT_REST] = sign, 0.0
                friction_force(absorbers.limit[b], now[b])
    if turned:
        go_to(sets, absorbers, window, s, state, room)


@jit
def rebound(sets, absorbers, s, a):  # type: ignore[no-untyped-def]
    """Return the restitution of an impact of absorber a in set s, in which those that are joined stay so.

    The impulse is that of the free beam. What it gives to the joined ones is taken out by their joints, so that the beam and they give way less.
    """
    if s == 0:
        return absorbers.restitution[a]
    return max((1.0 + absorbers.restitution[a]) * sets.compliance[s, a, a] / sets.compliance[0, a, a] - 1.0, 0.0)


@jit
def hit(sets, absorbers, losses, window, s, a, found, state, counters, events, energy, room):  # type: ignore[no-untyped-def]
    """Absorber a hits a wall in set s."""
    now, side = room.now, 1.0 if found.kind == HIT_HIGH else -1.0
    changed = False
    if s != 0:
        changed = set_free(sets, absorbers, window, s, a, found, state, room, events)
        s = joined_set(now)
    now[a, KICK] = UNKNOWN if changed else room.kicks[s, a]
    regime, forced, signal = regime_with(sets, s, sets.rows[s, a]), forced_of(room.flow, s, a), signal_of(room.signals, a)
    contact = Contact(absorbers.mass[a], sets.compliance[s, a, a], absorbers.shapes[a])
    walls, before = Walls(absorbers.gap[a], rebound(sets, absorbers, s, a)), now[a, V]
    rests = impact(regime, forced, window, contact, walls, absorbers.limit[a], now[a], room.work, signal, side, found, counters, events, energy)
    bend(sets, now, s, room.own, room.bent)
    now[a, AT_REST] = 1.0 if rests else 0.0
    kick_others(sets, absorbers, window, s, a, absorbers.mass[a] * (now[a, V] - before), state, room)
    if rests or s != 0:
        settle_waiting(sets, absorbers, losses, window, s, state, room, events)


@jit
def begin(sets, absorbers, losses, window, state, room, events):  # type: ignore[no-untyped-def]
    """Set the first regime from the initial state: absorbers without relative velocity are joined if friction or a wall can hold them."""
    now, half, n = room.now, state.shape[0] // 2, room.now.shape[0]
    for a in range(n):
        row, limit = now[a], absorbers.limit[a]
        row[Q], row[V] = state[half - n + a], state[2 * half - n + a]
        contact = Contact(absorbers.mass[a], sets.compliance[0, a, a], absorbers.shapes[a])
        relative = touch(contact, Walls(absorbers.gap[a], absorbers.restitution[a]), row, state)
        room.joints.waits[a] = relative == 0.0 and (limit > 0.0 or row[SIDE] != 0.0)
        if relative * row[SIDE] > 0.0:
            row[SIDE] = 0.0  # on a wall and moving into it: the search reports the impact at once
        friction_force(limit, row)
    settle(absorbers, losses, sets.compliance[0], window, now, state, room.joints, events)
    go_to(sets, absorbers, window, NO_SET, state, room)


@jit
def several_stretch(sets, absorbers, losses, schedule, k, started, room, state, clock, counters, level, events, series, energy):  # type: ignore[no-untyped-def]
    """Integrate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``.

    ``started`` False: the first stretch of a run, which begins with ``state``.
    """
    now, flow, z = room.now, room.flow, room.work.z
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        now[:, TAU] = -window.half
        flow.solved[:] = False
        if not started:
            begin(sets, absorbers, losses, window, state, room, events)
            started = True
        else:
            s = joined_set(now)
            solve_set(sets, absorbers, window, s, flow)
            add_forced(flow.slots[s], window.omega, -window.half, -1.0, z)
        last, stalled = now[0, TAU], 0
        while now[0, TAU] < window.half:
            s = joined_set(now)
            a, found = earliest(sets, absorbers, window, s, counters, room)
            pass_time(sets, absorbers, window, losses, s, found.offset, clock, counters, level, series, energy, room)
            if found.kind != NOTHING:
                if is_joined(s, a):
                    release(sets, absorbers, window, s, a, found.kind, state, room, events)
                elif found.kind == REVERSAL:
                    reverse(sets, absorbers, losses, window, s, a, found, state, room, events)
                else:
                    hit(sets, absorbers, losses, window, s, a, found, state, counters, events, energy, room)
            stalled, status = progress(counters, window, now[0, TAU], last, stalled)
            if status != DONE:
                add_forced(flow.slots[joined_set(now)], window.omega, now[0, TAU], 1.0, z)
                return status
            last = now[0, TAU]
        add_forced(flow.slots[joined_set(now)], window.omega, window.half, 1.0, z)
        if not np.isfinite(z[0, 0] + np.sum(now[:, Q])):
            return NOT_FINITE
    return DONE


@jit_room
def several_lane(sets, absorbers, losses, schedule, state, clock, counters, level, events, series, energy):  # type: ignore[no-untyped-def]
    """Integrate one lane of n absorbers; ``state`` (2 N_m + 2 n,) is the start and becomes the end. Return a status code.

    ``level``, ``events``, ``series``, ``energy`` None: not observed.
    """
    room, book, status = new_room(sets, absorbers, state), new_account(energy, sets.rows.shape[0], sets.rows.shape[3]), DONE
    for k in range(schedule.times.shape[0] - 1):
        status = several_stretch(sets, absorbers, losses, schedule, k, k > 0, room, state, clock, counters, level, events, series, book)
        if status != DONE:
            break
    if status == DONE:
        counters.values[REACHED] = schedule.times[-1]
    finish(sets, absorbers, counters.values[REACHED], room, state, clock, level, events, series)
    return status


@jit
def finish(sets, absorbers, end, room, state, clock, level, events, series):  # type: ignore[no-untyped-def]
    """Write the end state, close open phases, and take the sample that falls on the end (s)."""
    now, s, w = room.now, joined_set(room.now), room.work.rows[0]
    copy(room.work.z, w)
    write_from(sets, s, w, room, state)
    for a in range(now.shape[0]):
        if now[a, REGIME] == JOINED:
            end_phase(events, now[a], end)
    last_sample(state, absorbers.tip_shape, end, clock, level, series)
