"""Event-driven exact integration of rigid contact: free flight or sliding, impacts, and joined phases (stuck, or held by a wall).

Regimes and events (physics in the paper, section 2.2):
- free: the beam's modes and the absorber move apart, with a constant force between them if there is friction. Ends at a wall (impact), or where the
  relative velocity turns (friction).
- joined: the absorber moves with the tip. Its force, absorber mass times tip acceleration, must stay within what friction and the wall it
  touches can give; where it leaves that interval the phase ends.
An impact whose remaining bounces, all together, stay below the rounding of the position is completed at once (complete chatter): the remaining
relative velocity is taken out by a plastic impulse and the joined regime begins.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import Forced, add_forced, new_forced, signal_value, solve_forced
from impact_env.kernels.jit import jit, jit_inline, jit_room
from impact_env.kernels.observers import (
    DONE,
    EVALUATIONS,
    FRICTION_LOSS,
    HELD_LOWER,
    HELD_UPPER,
    IMPACT_LOSS,
    IMPACTS,
    NO_PROGRESS,
    NOT_FINITE,
    STEPS,
    STUCK_INSIDE,
    STUCK_TIME,
    TOO_MANY_EVENTS,
    push_impact,
    push_phase,
)
from impact_env.kernels.search import search
from impact_env.kernels.segments import Work, add_energy, last_sample, new_work, sample_state, sample_tip, to_slots, to_state, window_count, window_of
from impact_env.kernels.signals import EPSILON, HIT_HIGH, NOISE, NOTHING, REVERSAL, Signal, at_offset, new_signal, signal_scale
from impact_env.kernels.slots import GUARD, RELATIVE, REST, SPEED, add, advance, copy, weigh

FREE, JOINED = 0, 1
STALLED = 10_000  # events without progress in time
MOST_EVENTS = 500_000  # in one window
JOINT_SLACK = 1e-9  # of the joint force's scale: above the rounding of the change of basis
SLOWEST_DECAY = 0.1  # 1 - e counts as at least this where a chatter is completed
ROUNDING = 16.0 * NOISE  # of a signal: above what the search takes for zero distance


class Contact(NamedTuple):
    """Absorber mass (kg), G = 1/m_a + sum tip_shape^2 (1/kg), tip shape (N_m,)."""

    mass: float
    compliance: float
    tip_shape: NDArray[np.float64]


# rows of a lane's `now`: regime, time from the window's centre, absorber displacement, velocity, acceleration, constant relative
# force, sign of the relative velocity, wall touched (-1, 0, 1), relative velocity is zero (0, 1), joined offset absorber - tip, start of phase,
# largest relative acceleration by a unit impulse, number of the absorber
REGIME, TAU, Q, V, A, FORCE, SIGN, SIDE, AT_REST, OFFSET, SINCE, KICK, WHICH = range(13)
NOW = 13


@jit
def friction_force(limit, now):  # type: ignore[no-untyped-def]
    """Set the constant relative force and the absorber's acceleration from the sign of sliding."""
    if limit is not None:
        now[FORCE] = -now[SIGN] * limit


@jit
def joint_bounds(limit, side):  # type: ignore[no-untyped-def]
    """Return the interval of the joint force on the absorber: friction, and what the wall touched can push."""
    low, high = 0.0, 0.0
    if limit is not None:
        low, high = -limit, limit
    if side > 0.0:
        low = -np.inf
    if side < 0.0:
        high = np.inf
    return low, high


@jit
def totals(regime, forced, omega, now, z, w):  # type: ignore[no-untyped-def]
    """Write the whole slots (free, forced and rest part) at the current time to w."""
    copy(z, w)
    add_forced(forced.slots, omega, now[TAU], 1.0, w)
    add(regime.slots.rows, REST, now[FORCE], w)


@jit
def enter(regime, forced, omega, now, state, z):  # type: ignore[no-untyped-def]
    """Write the free part of a regime's slots for a state at the current time."""
    to_slots(regime.into, state, z)
    add_forced(forced.slots, omega, now[TAU], -1.0, z)
    add(regime.slots.rows, REST, -now[FORCE], z)


@jit
def free_state(free, forced, omega, now, work, state):  # type: ignore[no-untyped-def]
    """Write the state in the free regime."""
    totals(free, forced, omega, now, work.z, work.rows[0])
    to_state(free.out, work.rows[0], state)
    half = state.shape[0] // 2
    state[half - 1] = now[Q]
    state[2 * half - 1] = now[V]


@jit
def tip_motion(contact, state):  # type: ignore[no-untyped-def]
    """Return displacement and velocity of the tip."""
    half = state.shape[0] // 2
    q, v = 0.0, 0.0
    for i in range(contact.tip_shape.shape[0]):
        q += contact.tip_shape[i] * state[i]
        v += contact.tip_shape[i] * state[half + i]
    return q, v


@jit
def try_join(joined, forced, window, contact, limit, now, state, work, centre):  # type: ignore[no-untyped-def]
    """Join absorber and tip if the joint force allows it, else set the sign in which the absorber will slide; return True if joined."""
    q_tip, v_tip = tip_motion(contact, state)
    now[FORCE] = 0.0
    enter(joined, forced, window.omega, now, state, work.z)
    weigh(joined.slots.rows, GUARD, work.z, work.u)
    f = signal_value(forced.signals, 0, window.omega, now[TAU])
    for j in range(work.u.shape[1]):
        f += work.u[0, j]
    low, high = joint_bounds(limit, now[SIDE])
    scale = forced.bound[0]
    for j in range(work.u.shape[1]):
        scale += abs(work.u[0, j]) + abs(work.u[1, j])
    slack = JOINT_SLACK * scale  # at its bound the joint force decides in the joined regime, by its rate
    now[V] = v_tip
    now[OFFSET] = now[Q] - q_tip
    if low - slack <= f <= high + slack:
        now[REGIME] = JOINED
        now[SINCE] = centre + now[TAU]
        return True
    now[SIGN] = -1.0 if f > high else 1.0
    return False


@jit_inline
def end_of_flight(slots, forced, window, walls, limit, now, bent, length, z, signal):  # type: ignore[no-untyped-def]
    """Return the first event within ``length`` (s) of an absorber apart from the beam, which constant forces have bent by ``bent`` (m) there."""
    omega, tau, p = window.omega, now[TAU], signal.polynomial
    weigh(slots.rows, GUARD, z, signal.u)
    p[0], p[1], p[2] = now[Q] - bent, now[V], now[A]
    gap = 0.0
    if walls is not None:
        gap = walls.gap
    if limit is None:
        return search(slots, forced, omega, signal, tau, length, window.half, -gap, gap, int(now[SIDE]), None, False)
    zero = now[AT_REST] > 0.0
    if walls is None:
        return search(slots, forced, omega, signal, tau, length, window.half, None, None, 0, now[SIGN], zero)
    # only the wall ahead can be reached before the relative velocity turns
    low = -gap if now[SIGN] < 0.0 else -np.inf
    high = gap if now[SIGN] > 0.0 else np.inf
    return search(slots, forced, omega, signal, tau, length, window.half, low, high, 0, now[SIGN], zero)


@jit_inline
def end_of_hold(slots, forced, window, limit, now, length, z, signal):  # type: ignore[no-untyped-def]
    """Return the first event within ``length`` (s) of an absorber that moves with the beam: its joint force leaves what the joint can give."""
    weigh(slots.rows, GUARD, z, signal.u)
    signal.polynomial[:] = 0.0
    low, high = joint_bounds(limit, now[SIDE])
    return search(slots, forced, window.omega, signal, now[TAU], length, window.half, low, high, 0, None, False)


@jit
def fly(free, forced, window, contact, walls, limit, losses, now, work, signal, state, clock, counters, level, series, energy):  # type: ignore[no-untyped-def]
    """Advance the free regime to its next event or to the window's end; return what the search found."""
    slots, omega = free.slots, window.omega
    now[A] = now[FORCE] / contact.mass
    tau = now[TAU]
    found = end_of_flight(slots, forced, window, walls, limit, now, free.tip_rest * now[FORCE], window.half - tau, work.z, signal)
    counters.values[EVALUATIONS] += found.evaluations
    offset = found.offset
    end = tau + offset
    sample_tip(slots, forced.signals, window, work.z, work.u, free.tip_rest * now[FORCE], tau, end, clock, level)
    sample_state(free, forced, window, work.z, now[FORCE], now[Q : A + 1], tau, end, clock, work.rows[0], series)
    add_energy(free, forced, window, losses, work.z, now[FORCE], now[Q : A + 1], tau, end, work.rows, state, energy)
    add_friction_loss(limit, slots, forced, omega, signal, tau, offset, energy)
    advance(slots.rows, slots.table, slots.scale, offset, work.z)
    now[Q] += offset * (now[V] + 0.5 * offset * now[A])
    now[V] += offset * now[A]
    now[TAU] = end
    now[SIDE], now[AT_REST] = 0.0, 0.0
    return found


@jit
def add_friction_loss(limit, slots, forced, omega, signal, tau, offset, energy):  # type: ignore[no-untyped-def]
    """Add friction limit times the distance slid."""
    if energy is None or limit is None:
        return
    start, _, _ = at_offset(slots, forced.signals, omega, signal, tau, 0.0)
    end, _, _ = at_offset(slots, forced.signals, omega, signal, tau, offset)
    energy.totals[FRICTION_LOSS] += limit * abs(end - start)


@jit
def turn(free, contact, limit, now, work, found):  # type: ignore[no-untyped-def]
    """The relative velocity is zero: slide on the other way if friction cannot hold, and return False; else return True."""
    if limit is None:
        return False
    # the constant force F alone bends the relative displacement by F G
    needed = now[FORCE] - found.bend / contact.compliance
    if abs(needed) <= limit:
        return True
    old = now[FORCE]
    now[SIGN], now[AT_REST] = -1.0 if needed > 0.0 else 1.0, 1.0
    friction_force(limit, now)
    add(free.slots.rows, REST, old - now[FORCE], work.z)
    return False


@jit
def impact(free, forced, window, contact, walls, limit, now, work, signal, side, found, counters, events, energy):  # type: ignore[no-untyped-def]
    """Apply Newton's impact law; return True if the remaining chatter is below rounding and was completed by a plastic impulse."""
    if walls is None:
        return False
    v = found.rate
    now[Q] -= found.value - side * walls.gap  # rounding must not add up to a penetration
    impulse = -(1.0 + walls.restitution) * v / contact.compliance
    loss = 0.5 * (1.0 - walls.restitution**2) * v * v / contact.compliance
    after = -walls.restitution * v
    add(free.slots.rows, RELATIVE, impulse, work.z)
    now[V] += impulse / contact.mass
    now[SIDE] = side
    counters.values[IMPACTS] += 1.0
    largest = abs(found.bend) + abs(impulse) * now[KICK] + 2.0 * abs(now[FORCE]) * contact.compliance
    complete = chatter_is_complete(free, forced, window, walls, now, work, signal, side, after, largest)
    if complete:
        rest = -after / contact.compliance
        add(free.slots.rows, RELATIVE, rest, work.z)
        now[V] += rest / contact.mass
        impulse += rest
        loss += 0.5 * after * after / contact.compliance
    push_impact(events, window.centre + now[TAU], v, impulse, loss, now[WHICH])
    if energy is not None:
        energy.totals[IMPACT_LOSS] += loss
    if limit is not None:
        old = now[FORCE]
        now[SIGN] = -side
        friction_force(limit, now)
        add(free.slots.rows, REST, old - now[FORCE], work.z)
    return complete


@jit
def largest_kick(rows):  # type: ignore[no-untyped-def]
    """Return a bound of the relative acceleration that a unit impulse between beam and absorber leaves."""
    kick = 0.0
    for j in range(rows.shape[1]):
        gain = np.hypot(rows[GUARD, j], rows[GUARD + 1, j]) * np.hypot(rows[RELATIVE, j], rows[RELATIVE + 1, j])
        kick += gain * rows[SPEED, j] ** 2
    return kick


@jit
def chatter_is_complete(free, forced, window, walls, now, work, signal, side, after, largest):  # type: ignore[no-untyped-def]
    """Return whether all bounces to come, of heights summed to v^2/(2 a (1 - e)), stay below the rounding of the position.

    ``largest`` bounds the relative acceleration after the impact.
    """
    height = ROUNDING * signal_scale(signal, forced.bound) * max(1.0 - walls.restitution, SLOWEST_DECAY)
    if after * after > 2.0 * largest * height + 1e-300:
        return False
    weigh(free.slots.rows, GUARD, work.z, signal.u)
    _, _, a = at_offset(free.slots, forced.signals, window.omega, signal, now[TAU], 0.0)
    return side * a >= 0.0 and after * after <= 2.0 * abs(a) * height + 1e-300


@jit
def hold(joined, forced, window, limit, losses, now, work, signal, state, clock, counters, level, series, energy):  # type: ignore[no-untyped-def]
    """Advance the joined regime to where the joint force leaves its interval, or to the window's end; return the event."""
    slots = joined.slots
    tau = now[TAU]
    found = end_of_hold(slots, forced, window, limit, now, window.half - tau, work.z, signal)
    counters.values[EVALUATIONS] += found.evaluations
    offset = found.offset
    end = tau + offset
    sample_tip(slots, forced.signals, window, work.z, work.u, 0.0, tau, end, clock, level)
    now[V], now[A] = 0.0, 0.0
    now[Q] = now[OFFSET]
    sample_state(joined, forced, window, work.z, 0.0, now[Q : A + 1], tau, end, clock, work.rows[0], series)
    add_energy(joined, forced, window, losses, work.z, 0.0, now[Q : A + 1], tau, end, work.rows, state, energy)
    advance(slots.rows, slots.table, slots.scale, offset, work.z)
    now[TAU] = end
    counters.values[STUCK_TIME] += offset
    return found.kind


@jit
def end_phase(events, now, time):  # type: ignore[no-untyped-def]
    """Note a joined phase that ends."""
    kind = STUCK_INSIDE if now[SIDE] == 0.0 else (HELD_UPPER if now[SIDE] > 0.0 else HELD_LOWER)
    push_phase(events, now[SINCE], time, kind, now[WHICH])


@jit
def release(free, free_forced, joined, joined_forced, window, limit, now, work, state, event, events):  # type: ignore[no-untyped-def]
    """Leave the joined regime: the absorber lags where the joint force is above its bound, leads where it is below."""
    totals(joined, joined_forced, window.omega, now, work.z, work.rows[0])
    to_state(joined.out, work.rows[0], state)
    half = state.shape[0] // 2
    state[half - 1] += now[OFFSET]
    now[Q], now[V] = state[half - 1], state[2 * half - 1]
    end_phase(events, now, window.centre + now[TAU])
    now[REGIME] = FREE
    now[SIGN] = -1.0 if event == HIT_HIGH else 1.0
    now[AT_REST] = 1.0
    friction_force(limit, now)
    enter(free, free_forced, window.omega, now, state, work.z)


@jit
def touch(contact, walls, now, state):  # type: ignore[no-untyped-def]
    """Find the wall that an absorber touches and the sign in which it slides; return its relative velocity."""
    q_tip, v_tip = tip_motion(contact, state)
    relative = now[V] - v_tip
    if walls is not None:
        if abs(now[Q] - q_tip) >= walls.gap * (1.0 - 4.0 * EPSILON):
            now[SIDE] = 1.0 if now[Q] > q_tip else -1.0
    now[SIGN] = 1.0 if relative > 0.0 else -1.0
    return relative


@jit
def begin(free, free_forced, joined, joined_forced, window, contact, walls, limit, now, state, work):  # type: ignore[no-untyped-def]
    """Set the first regime from the initial state: joined if the relative velocity is zero and friction or a wall can hold it."""
    half = state.shape[0] // 2
    now[Q], now[V] = state[half - 1], state[2 * half - 1]
    relative = touch(contact, walls, now, state)
    if relative == 0.0 and (limit is not None or now[SIDE] != 0.0):
        if try_join(joined, joined_forced, window, contact, limit, now, state, work, window.centre):
            return
        now[AT_REST] = 1.0
    elif relative * now[SIDE] > 0.0:
        now[SIDE] = 0.0  # on a wall and moving into it: the search reports the impact at once
    friction_force(limit, now)
    enter(free, free_forced, window.omega, now, state, work.z)


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``now`` (NOW,) and ``work.z``, and scratch for it."""

    now: NDArray[np.float64]
    work: Work
    signal: Signal
    free_forced: Forced
    joined_forced: Forced
    scratch: NDArray[np.float64]


@jit_room
def new_room(free, joined, state):  # type: ignore[no-untyped-def]
    """Return room for lanes of one scene."""
    size = free.slots.rows.shape[1]
    now = np.zeros(NOW)
    now[KICK] = largest_kick(free.slots.rows)
    return Room(now, new_work(size), new_signal(size), new_forced(free.slots), new_forced(joined.slots), np.zeros_like(state))


@jit
def exact_stretch(  # type: ignore[no-untyped-def]
    free, joined, contact, walls, limit, losses, schedule, k, started, room, state, clock, counters, level, events, series, energy
):  # fmt: skip
    """Integrate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``.

    ``started`` False: the first stretch of a run, which begins with ``state``.
    """
    now, work, signal, free_forced, joined_forced, scratch = room
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        now[TAU] = -window.half
        in_free = now[REGIME] == FREE
        solved_free, solved_joined = in_free or not started, not in_free or not started
        if solved_free:
            solve_forced(free.slots, window, None, free_forced)
        if solved_joined:
            solve_forced(joined.slots, window, contact.mass, joined_forced)
        if not started:
            begin(free, free_forced, joined, joined_forced, window, contact, walls, limit, now, state, work)
            started = True
        elif in_free:
            add_forced(free_forced.slots, window.omega, now[TAU], -1.0, work.z)
        else:
            add_forced(joined_forced.slots, window.omega, now[TAU], -1.0, work.z)
        last, stalled, events_here = now[TAU], 0, 0
        while now[TAU] < window.half:
            if now[REGIME] == FREE:
                found = fly(
                    free, free_forced, window, contact, walls, limit, losses, now, work, signal, scratch, clock, counters, level, series, energy
                )
                join = False
                if found.kind == REVERSAL:
                    join = turn(free, contact, limit, now, work, found)
                elif found.kind != NOTHING:
                    side = 1.0 if found.kind == HIT_HIGH else -1.0
                    join = impact(free, free_forced, window, contact, walls, limit, now, work, signal, side, found, counters, events, energy)
                if join:
                    if not solved_joined:
                        solve_forced(joined.slots, window, contact.mass, joined_forced)
                        solved_joined = True
                    free_state(free, free_forced, window.omega, now, work, state)
                    if not try_join(joined, joined_forced, window, contact, limit, now, state, work, window.centre):
                        now[AT_REST] = 1.0
                        friction_force(limit, now)
                        enter(free, free_forced, window.omega, now, state, work.z)
            else:
                event = hold(joined, joined_forced, window, limit, losses, now, work, signal, scratch, clock, counters, level, series, energy)
                if event != NOTHING:
                    if not solved_free:
                        solve_forced(free.slots, window, None, free_forced)
                        solved_free = True
                    release(free, free_forced, joined, joined_forced, window, limit, now, work, state, event, events)
            counters.values[STEPS] += 1.0
            stalled = stalled + 1 if now[TAU] == last else 0
            if stalled > STALLED:
                return NO_PROGRESS
            events_here += 1
            if events_here > MOST_EVENTS:
                return TOO_MANY_EVENTS
            last = now[TAU]
        if now[REGIME] == FREE:
            add_forced(free_forced.slots, window.omega, window.half, 1.0, work.z)
        else:
            add_forced(joined_forced.slots, window.omega, window.half, 1.0, work.z)
        if not np.isfinite(work.z[0, 0] + now[Q]):
            return NOT_FINITE
    return DONE


@jit_room
def exact_lane(free, joined, contact, walls, limit, losses, schedule, state, clock, counters, level, events, series, energy):  # type: ignore[no-untyped-def]
    """Integrate one lane; ``state`` (2 N_m + 2,) is the start and becomes the end. Return a status code.

    ``walls`` None: no cavity; ``limit`` None: no friction; ``level``, ``events``, ``series``, ``energy`` None: not observed.
    """
    room = new_room(free, joined, state)
    for k in range(schedule.times.shape[0] - 1):
        status = exact_stretch(
            free, joined, contact, walls, limit, losses, schedule, k, k > 0, room, state, clock, counters, level, events, series, energy
        )
        if status != DONE:
            return status
    finish(free, joined, room.now, room.work, state, schedule, clock, contact, level, events, series)
    return DONE


@jit
def current_state(free, joined, now, work, state):  # type: ignore[no-untyped-def]
    """Write the state at the end of a stretch."""
    half = state.shape[0] // 2
    if now[REGIME] == FREE:
        w = work.rows[0]
        copy(work.z, w)
        add(free.slots.rows, REST, now[FORCE], w)
        to_state(free.out, w, state)
        state[half - 1], state[2 * half - 1] = now[Q], now[V]
    else:
        to_state(joined.out, work.z, state)
        state[half - 1] += now[OFFSET]


@jit
def finish(free, joined, now, work, state, schedule, clock, contact, level, events, series):  # type: ignore[no-untyped-def]
    """Write the end state, close an open phase, and take the sample that falls on the end."""
    end = schedule.times[-1]
    current_state(free, joined, now, work, state)
    if now[REGIME] != FREE:
        end_phase(events, now, end)
    last_sample(state, contact.tip_shape, end, clock, level, series)
