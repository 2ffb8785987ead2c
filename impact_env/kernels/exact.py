"""Event-driven exact integration of one absorber with rigid contact (physics in the paper, section 2.2): window by window, event by event.

A window begins in one of the two regimes of free_and_joined.py; the forced part of the other is solved when an event leads there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.budget import progress
from impact_env.kernels.energy_account import new_account
from impact_env.kernels.forced import Forced, add_forced, new_forced, solve_forced
from impact_env.kernels.free_and_joined import begin, enter, fly, free_state, hold, release, try_join
from impact_env.kernels.jit import jit, jit_inline, jit_room
from impact_env.kernels.observers import DONE, NOT_FINITE, REACHED
from impact_env.kernels.rigid_contact import (
    AT_REST,
    FORCE,
    FREE,
    JOINED,
    KICK,
    NOW,
    OFFSET,
    REGIME,
    TAU,
    Q,
    V,
    end_phase,
    friction_force,
    impact,
    largest_kick,
    turn,
)
from impact_env.kernels.segments import Work, last_sample, new_work, to_state, window_count, window_of
from impact_env.kernels.signals import HIT_HIGH, NOTHING, REVERSAL, Signal, new_signal
from impact_env.kernels.slots import REST, add, copy


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``now`` (NOW,) and ``work.z``, and scratch for it.

    ``solved`` (2,): whether a regime's forced part is known in the current window.
    """

    now: NDArray[np.float64]
    work: Work
    signal: Signal
    free_forced: Forced
    joined_forced: Forced
    solved: NDArray[np.bool_]
    scratch: NDArray[np.float64]


@jit_room
def new_room(free, joined, state):  # type: ignore[no-untyped-def]
    """Return room for lanes of one scene."""
    size = free.slots.rows.shape[1]
    now = np.zeros(NOW)
    now[KICK] = largest_kick(free.slots.rows)
    free_forced, joined_forced, solved = new_forced(free.slots), new_forced(joined.slots), np.zeros(2, np.bool_)
    return Room(now, new_work(size), new_signal(size), free_forced, joined_forced, solved, np.zeros_like(state))


@jit_inline
def solve_free(free, window, room):  # type: ignore[no-untyped-def]
    """Fill the forced part of the free regime for a window, unless it is known."""
    if not room.solved[FREE]:
        solve_forced(free.slots, window, None, room.free_forced)
        room.solved[FREE] = True


@jit_inline
def solve_joined(joined, window, contact, room):  # type: ignore[no-untyped-def]
    """Fill the forced part of the joined regime for a window, unless it is known."""
    if not room.solved[JOINED]:
        solve_forced(joined.slots, window, contact.mass, room.joined_forced)
        room.solved[JOINED] = True


@jit_inline
def add_forced_part(window, tau, sign, room):  # type: ignore[no-untyped-def]
    """Add the forced part of the regime in use, times ``sign``, to the slots."""
    if room.now[REGIME] == FREE:
        add_forced(room.free_forced.slots, window.omega, tau, sign, room.work.z)
    else:
        add_forced(room.joined_forced.slots, window.omega, tau, sign, room.work.z)


@jit_inline
def enter_window(free, joined, contact, walls, limit, window, started, room, state):  # type: ignore[no-untyped-def]
    """Begin a window: take the forced part out of the slots, which hold the whole state, or set the first regime of a run."""
    now = room.now
    now[TAU] = -window.half
    room.solved[:] = False
    if now[REGIME] == FREE or not started:
        solve_free(free, window, room)
    if now[REGIME] != FREE or not started:
        solve_joined(joined, window, contact, room)
    if started:
        add_forced_part(window, now[TAU], -1.0, room)
    else:
        begin(free, room.free_forced, joined, room.joined_forced, window, contact, walls, limit, now, state, room.work)


@jit_inline
def meet(free, window, contact, walls, limit, found, room, counters, events, energy):  # type: ignore[no-untyped-def]
    """Let the event that ended a flight happen; return True if absorber and tip have no relative velocity from then on."""
    if found.kind == NOTHING:
        return False
    if found.kind == REVERSAL:
        return turn(free, contact, limit, room.now, room.work, found)
    side = 1.0 if found.kind == HIT_HIGH else -1.0
    return impact(free, room.free_forced, window, contact, walls, limit, room.now, room.work, room.signal, side, found, counters, events, energy)


@jit_inline
def join_or_slide(free, joined, window, contact, limit, room, state):  # type: ignore[no-untyped-def]
    """Go on from the free regime without relative velocity: joined if the joint force allows it."""
    now, work = room.now, room.work
    solve_joined(joined, window, contact, room)
    free_state(free, room.free_forced, window.omega, now, work, state)
    if not try_join(joined, room.joined_forced, window, contact, limit, now, state, work, window.centre):
        now[AT_REST] = 1.0
        friction_force(limit, now)
        enter(free, room.free_forced, window.omega, now, state, work.z)


@jit_inline
def pass_event(  # type: ignore[no-untyped-def]
    free, joined, window, contact, walls, limit, losses, room, state, clock, counters, level, events, series, energy
):  # fmt: skip
    """Advance to the next event, or to the window's end, and let it happen."""
    now, work, signal, free_forced, joined_forced, _, scratch = room
    if now[REGIME] == FREE:
        found = fly(free, free_forced, window, contact, walls, limit, losses, now, work, signal, scratch, clock, counters, level, series, energy)
        if meet(free, window, contact, walls, limit, found, room, counters, events, energy):
            join_or_slide(free, joined, window, contact, limit, room, state)
    else:
        event = hold(joined, joined_forced, window, limit, losses, now, work, signal, scratch, clock, counters, level, series, energy)
        if event != NOTHING:
            solve_free(free, window, room)
            release(free, free_forced, joined, joined_forced, window, limit, now, work, state, event, events)


@jit
def exact_stretch(  # type: ignore[no-untyped-def]
    free, joined, contact, walls, limit, losses, schedule, k, started, room, state, clock, counters, level, events, series, energy
):  # fmt: skip
    """Integrate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``.

    ``started`` False: the first stretch of a run, which begins with ``state``.
    """
    now = room.now
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        enter_window(free, joined, contact, walls, limit, window, started or w > 0, room, state)
        last, stalled = now[TAU], 0
        while now[TAU] < window.half:
            pass_event(free, joined, window, contact, walls, limit, losses, room, state, clock, counters, level, events, series, energy)
            stalled, status = progress(counters, window, now[TAU], last, stalled)
            if status != DONE:
                add_forced_part(window, now[TAU], 1.0, room)
                return status
            last = now[TAU]
        add_forced_part(window, window.half, 1.0, room)
        if not np.isfinite(room.work.z[0, 0] + now[Q]):
            return NOT_FINITE
    return DONE


@jit_room
def exact_lane(free, joined, contact, walls, limit, losses, schedule, state, clock, counters, level, events, series, energy):  # type: ignore[no-untyped-def]
    """Integrate one lane; ``state`` (2 N_m + 2,) is the start and becomes the end. Return a status code.

    ``walls`` None: no cavity; ``limit`` None: no friction; ``level``, ``events``, ``series``, ``energy`` None: not observed.
    """
    room, book, status = new_room(free, joined, state), new_account(energy, 2, free.slots.rows.shape[1]), DONE
    for k in range(schedule.times.shape[0] - 1):
        status = exact_stretch(
            free, joined, contact, walls, limit, losses, schedule, k, k > 0, room, state, clock, counters, level, events, series, book
        )
        if status != DONE:
            break
    if status == DONE:
        counters.values[REACHED] = schedule.times[-1]
    finish(free, joined, room.now, room.work, state, counters.values[REACHED], clock, contact, level, events, series)
    return status


@jit
def current_state(free, joined, now, work, state):  # type: ignore[no-untyped-def]
    """Write the state at the end of a stretch, or where it was given up."""
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
def finish(free, joined, now, work, state, end, clock, contact, level, events, series):  # type: ignore[no-untyped-def]
    """Write the end state, close an open phase, and take the sample that falls on the end (s)."""
    current_state(free, joined, now, work, state)
    if now[REGIME] != FREE:
        end_phase(events, now, end)
    last_sample(state, contact.tip_shape, end, clock, level, series)
