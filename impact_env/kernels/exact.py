"""Event-driven exact integration of rigid contact: free flight or sliding, impacts, and joined phases (stuck, or held by a wall).

Regimes and events (physics in the paper, section 2.2):
- free: the beam's modes and the absorber move apart, with a constant force between them if there is friction. Ends at a wall (impact), or where the
  relative velocity turns (friction).
- joined: the absorber moves with the tip. Its force, absorber mass times tip acceleration, must stay within what friction and the wall it
  touches can give; where it leaves that interval the phase ends. It begins where friction can hold at a reversal, or after a complete chatter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import Forced, add_forced, new_forced, signal_value, solve_forced
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.next_event import MOST_EVENTS, STALLED, end_of_flight, end_of_hold
from impact_env.kernels.observers import DONE, EVALUATIONS, NO_PROGRESS, NOT_FINITE, STEPS, STUCK_TIME, TOO_MANY_EVENTS
from impact_env.kernels.rigid_contact import (
    AT_REST,
    FORCE,
    FREE,
    JOINED,
    JOINT_SLACK,
    KICK,
    NOW,
    OFFSET,
    REGIME,
    SIDE,
    SIGN,
    SINCE,
    TAU,
    A,
    Q,
    V,
    add_friction_loss,
    end_phase,
    friction_force,
    impact,
    joint_bounds,
    largest_kick,
    tip_motion,
    touch,
    turn,
)
from impact_env.kernels.segments import Work, add_energy, last_sample, new_work, sample_state, sample_tip, to_slots, to_state, window_count, window_of
from impact_env.kernels.signals import HIT_HIGH, NOTHING, REVERSAL, Signal, new_signal
from impact_env.kernels.slots import GUARD, REST, add, advance, copy, weigh


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
