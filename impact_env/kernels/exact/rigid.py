"""Event-driven exact integration of one absorber with rigid contact (physics in the paper, section 2.2): window by window, event by event.

A window begins in one of the two regimes of free_and_joined.py; the forced part of the other is solved when an event leads there.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.energy.account import new_account, observe_with
from impact_env.kernels.events.signals import NOTHING, REVERSAL
from impact_env.kernels.exact.budget import limit_searches, progress
from impact_env.kernels.exact.free_and_joined import (
    begin,
    body_of,
    enter,
    fly,
    free_state,
    hold,
    move_own,
    new_room,
    release,
    try_join,
)
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    end_phase,
    friction_force,
    impact,
    turn,
    weight_held,
)
from impact_env.kernels.motion.forced import add_forced
from impact_env.kernels.motion.lines import solve_window
from impact_env.kernels.motion.observers import DONE, NOT_FINITE, push_reversal
from impact_env.kernels.motion.segments import (
    last_sample,
    own_schedule,
    to_state,
    window_count,
    window_of,
)
from impact_env.kernels.motion.slots import REST, add, copy


@jit_inline
def solve_free(scene, window, room):
    """Fill the forced part of the free regime for a window, unless it is known."""
    if not room.solved[FREE]:
        solve_window(scene.free.slots, window, None, room.free_forced)
        room.solved[FREE] = True


@jit_inline
def solve_joined(scene, window, room):
    """Fill the forced part of the joined regime for a window, unless it is known."""
    if not room.solved[JOINED]:
        solve_window(scene.joined.slots, window, scene.contact.mass, room.joined_forced)
        room.solved[JOINED] = True


@jit_inline
def add_forced_part(window, tau, sign, room):
    """Add the forced part of the regime in use, times ``sign``, to the slots."""
    if room.now[0].regime == FREE:
        add_forced(room.free_forced.slots, window.omega, tau, sign, room.work.z)
        move_own(window, room, sign)
    else:
        add_forced(room.joined_forced.slots, window.omega, tau, sign, room.work.z)


@jit_inline
def enter_window(scene, window, started, room, state):
    """Begin a window: take the forced part out of the slots, which hold the whole state, or set the first regime of a run."""
    now = room.now[0]
    now.tau = -window.half
    room.solved[:] = False
    if now.regime == FREE or not started:
        solve_free(scene, window, room)
    if now.regime != FREE or not started:
        solve_joined(scene, window, room)
    if started:
        add_forced_part(window, now.tau, -1.0, room)
    else:
        begin(scene, window, room, state)


@jit_inline
def meet(scene, window, found, room, observe):
    """Let the event that ended a flight happen; return True if absorber and tip have no relative velocity from then on."""
    slots = scene.free.slots
    contact = scene.contact
    body = body_of(room)
    if found.kind == NOTHING:
        return False
    if found.kind == REVERSAL:
        push_reversal(observe.events, window.centre + body.now.tau, body.now.which)
        return turn(slots, contact, contact.limit, body, found)
    return impact(slots, room.free_forced, window, contact.walls, contact, body, found, observe)


@jit_inline
def join_or_slide(scene, window, room, state):
    """Go on from the free regime without relative velocity: joined if the joint force allows it."""
    now = room.now[0]
    work = room.work
    solve_joined(scene, window, room)
    move_own(window, room, 1.0)
    free_state(scene.free, room.free_forced, window.omega, now, work, state)
    if not try_join(scene, window, room, state):
        now.at_rest = True
        friction_force(scene.contact.limit, now)
        enter(scene.free, room.free_forced, window.omega, now, state, work.z)
        move_own(window, room, -1.0)


@jit_inline
def pass_event(scene, window, room, state, observe):
    """Advance to the next event, or to the window's end, and let it happen."""
    if room.now[0].regime == FREE:
        found = fly(scene, window, room, observe)
        if meet(scene, window, found, room, observe):
            join_or_slide(scene, window, room, state)
    else:
        event = hold(scene, window, room, observe)
        if event != NOTHING:
            solve_free(scene, window, room)
            release(scene, window, room, state, event, observe.events)


@jit_inline
def exact_stretch(scene, schedule, k, started, room, state, observe):
    """Integrate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``.

    ``started`` False: the first stretch of a run, which begins with ``state``.
    """
    now = room.now[0]
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        enter_window(scene, window, started or w > 0, room, state)
        last = now.tau
        stalled = 0
        while now.tau < window.half:
            pass_event(scene, window, room, state, observe)
            stalled, status = progress(observe.counters, window, now.tau, last, stalled)
            if status != DONE:
                add_forced_part(window, now.tau, 1.0, room)
                return status
            last = now.tau
        add_forced_part(window, window.half, 1.0, room)
        if not np.isfinite(room.work.z[0, 0] + now.q):
            return NOT_FINITE
    return DONE


@jit_room
def exact_lane(scene, plan, state, observe):
    """Integrate one lane of a `free_and_joined.Rigid` scene and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end."""
    schedule = own_schedule(plan)
    room = new_room(scene.free, scene.joined, schedule.load, state)
    status = DONE
    limit_searches(room.signal.memory, observe.counters)
    seen = observe_with(observe, new_account(observe.energy, 2, scene.free.slots.rows.shape[1]))
    for k in range(schedule.times.shape[0] - 1):
        status = exact_stretch(scene, schedule, k, k > 0, room, state, seen)
        if status != DONE:
            break
    counts = observe.counters.counts
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish(scene, room, state, counts.reached, observe)
    return status


@jit
def current_state(scene, room, state):
    """Write the state at the end of a stretch, or where it was given up."""
    now = room.now[0]
    work = room.work
    half = state.shape[0] // 2
    if now.regime == FREE:
        w = work.rows[0]
        copy(work.z, w)
        add(scene.free.slots.rows, REST, now.force, w)
        to_state(scene.free.out, w, state)
        state[half - 1], state[2 * half - 1] = now.q, now.v
    else:
        w = work.rows[0]
        copy(work.z, w)
        add(scene.joined.slots.rows, REST, weight_held(scene.contact.gravity), w)
        to_state(scene.joined.out, w, state)
        state[half - 1] += now.offset


@jit
def finish(scene, room, state, end, observe):
    """Write the end state, close an open phase, and take the sample that falls on the end (s)."""
    current_state(scene, room, state)
    if room.now[0].regime != FREE:
        end_phase(observe.events, room.now[0], end)
    last_sample(state, scene.contact.tip_shape, end, observe.clock, observe.level, observe.series)
