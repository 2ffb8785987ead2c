"""Several absorbers on one beam: the loop over the events of rigid contact, for any set of joined absorbers (sets.py).

Each absorber has its own guard signal in the regime of the current set, and the next event is the earliest one. Signals, searches, impact law and
friction are those of the single absorber. What one absorber's event does to the others is in several_events.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_room
from impact_env.kernels.energy.account import new_account, observe_with
from impact_env.kernels.energy.energies import add_energy
from impact_env.kernels.events.signals import NOTHING, REVERSAL, Event
from impact_env.kernels.exact.budget import limit_searches, progress
from impact_env.kernels.exact.check import check_set
from impact_env.kernels.exact.next_event import end_of_flight, end_of_hold
from impact_env.kernels.exact.rigid_contact import (
    JOINED,
    Body,
    Walls,
    add_friction_loss,
    end_phase,
    new_now,
)
from impact_env.kernels.exact.sets import (
    Absorbers,
    Flow,
    Sets,
    Signals,
    all_kicks,
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
from impact_env.kernels.exact.settle import Joints, new_joints
from impact_env.kernels.exact.several_events import begin, hit, release, reverse, write_from
from impact_env.kernels.motion.forced import add_forced
from impact_env.kernels.motion.observers import DONE, JOINTS_UNSOLVED, MOTION, NOT_FINITE
from impact_env.kernels.motion.segments import (
    Losses,
    Stretch,
    Work,
    last_sample,
    new_work,
    own_schedule,
    sample_level,
    sample_state,
    window_count,
    window_of,
)
from impact_env.kernels.motion.slots import advance, copy

Array = NDArray[np.float64]


class Several(NamedTuple):
    """A scene of several absorbers."""

    sets: Sets
    absorbers: Absorbers
    losses: Losses


class Room(NamedTuple):
    """What a lane of n absorbers carries from stretch to stretch, and scratch.

    ``now`` (n,): a `rigid_contact.NOW` record for each absorber; ``own`` (2^n, ROWS, J): rows of weights of the level's place, with the rest part of
    all forces; ``bent`` (n + 1,): displacement of the places under them; ``motion`` (n,) as in `segments.Stretch`, and from one set to another the
    motion relative to the beam; ``kicks`` (2^n, n).
    """

    now: NDArray[Any]
    work: Work
    signals: Signals
    flow: Flow
    joints: Joints
    own: Array
    bent: Array
    motion: NDArray[Any]
    kicks: Array
    scratch: Array


@jit_room
def new_room(sets, absorbers, state):
    """Return room for a lane."""
    n = absorbers.mass.shape[0]
    now = new_now(n)
    for a in range(n):
        now[a].which = a
    own = np.ascontiguousarray(sets.rows[:, n])
    work = new_work(sets.rows.shape[3])
    scratch = np.zeros_like(state)
    kicks = all_kicks(sets)
    return Room(
        now,
        work,
        new_signals(sets),
        new_flow(sets),
        new_joints(n),
        own,
        np.zeros(n + 1),
        np.zeros(n, MOTION),
        kicks,
        scratch,
    )


@jit
def watch(scene, window, s, a, length, room):
    """Return the first event of absorber a within ``length`` (s) in set s."""
    sets = scene.sets
    absorbers = scene.absorbers
    slots = slots_with(sets, s, sets.rows[s, a])
    forced = forced_of(room.flow, s, a)
    now = room.now[a]
    limit = absorbers.limit[a]
    body = Body(room.now[a], room.work, signal_of(room.signals, a))
    if is_joined(s, a):
        return end_of_hold(slots, forced, window, limit, 0.0, body, length)
    walls = Walls(absorbers.gap[a], absorbers.restitution[a], None)
    now.a = now.force / absorbers.mass[a]
    if limit > 0.0:
        return end_of_flight(slots, forced, window, walls, limit, body, room.bent[a], length)
    return end_of_flight(slots, forced, window, walls, None, body, room.bent[a], length)


@jit
def earliest(scene, window, s, counters, room):
    """Return the absorber whose event comes first, and that event; NOTHING at the window's end."""
    first = 0
    length = window.half - room.now[0].tau
    found = Event(NOTHING, length, 0.0, 0.0, 0.0, 0)
    for a in range(room.now.shape[0]):
        event = watch(scene, window, s, a, length, room)
        counters.counts.evaluations += event.evaluations
        if event.kind != NOTHING or np.isnan(event.offset):
            first = a
            found = event
            length = event.offset
        if np.isnan(length):
            break
    check_set(counters.check, scene, window, s, found.offset, room)
    return first, found


@jit
def observe_stretch(scene, window, s, offset, room, observe):
    """Let the observers see ``offset`` (s) without an event."""
    n = room.now.shape[0]
    sets = scene.sets
    tau = room.now[0].tau
    regime = regime_with(sets, s, room.own[s])
    forced = forced_of(room.flow, s, n)
    for a in range(n):
        now = room.now[a]
        motion = room.motion[a]
        joined = is_joined(s, a)
        motion.q = now.offset if joined else now.q
        motion.v = 0.0 if joined else now.v
        motion.a = 0.0 if joined else now.a
    stretch = Stretch(
        regime, forced, window, room.work, 1.0, room.bent[n], room.motion, tau, tau + offset
    )
    sample_level(stretch, observe.clock, observe.level)
    sample_state(stretch, observe.clock, observe.series)
    add_energy(stretch, scene.losses, room.scratch, s, observe.energy)


@jit
def pass_time(scene, window, s, offset, room, observe):
    """Let all move on by ``offset`` (s) without an event."""
    sets = scene.sets
    absorbers = scene.absorbers
    tau = room.now[0].tau
    observe_stretch(scene, window, s, offset, room, observe)
    for a in range(room.now.shape[0]):
        now = room.now[a]
        if is_joined(s, a):
            observe.counters.counts.stuck_time += offset
        else:
            own = slots_with(sets, s, sets.rows[s, a])
            there = forced_of(room.flow, s, a)
            body = Body(now, room.work, signal_of(room.signals, a))
            add_friction_loss(
                absorbers.limit[a], own, there, window.omega, body, tau, offset, observe.energy
            )
            now.q += offset * (now.v + 0.5 * offset * now.a)
            now.v += offset * now.a
            if offset > 0.0:
                now.side = 0.0
                now.at_rest = False
        now.tau = tau + offset
    advance(room.own[s], sets.table[s], sets.scale[s], offset, room.work.z)


@jit
def enter_window(scene, window, started, room, state, events):
    """Begin a window: take the forced part out of the slots, which hold the whole state, or set the first regime of a run."""
    for a in range(room.now.shape[0]):
        room.now[a].tau = -window.half
    room.flow.solved[:] = False
    if not started:
        begin(scene, window, state, room, events)
    else:
        s = joined_set(room.now)
        solve_set(scene.sets, scene.absorbers, window, s, room.flow)
        add_forced(room.flow.slots[s], window.omega, -window.half, -1.0, room.work.z)


@jit
def pass_event(scene, window, state, room, observe):
    """Advance to the next event of any absorber, or to the window's end, and let it happen."""
    s = joined_set(room.now)
    a, found = earliest(scene, window, s, observe.counters, room)
    pass_time(scene, window, s, found.offset, room, observe)
    if found.kind == NOTHING:
        return
    if is_joined(s, a):
        release(scene, window, s, a, found.kind, state, room, observe.events)
    elif found.kind == REVERSAL:
        reverse(scene, window, s, a, found, state, room, observe.events)
    else:
        hit(scene, window, s, a, found, state, room, observe)


@jit
def is_finite(room):
    """Return whether slots and absorbers are."""
    total = room.work.z[0, 0]
    for a in range(room.now.shape[0]):
        total += room.now[a].q
    return np.isfinite(total)


@jit
def several_stretch(scene, schedule, k, started, room, state, observe):
    """Integrate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``.

    ``started`` False: the first stretch of a run, which begins with ``state``.
    """
    now = room.now
    flow = room.flow
    z = room.work.z
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        enter_window(scene, window, started or w > 0, room, state, observe.events)
        last = now[0].tau
        stalled = 0
        while now[0].tau < window.half:
            pass_event(scene, window, state, room, observe)
            stalled, status = progress(observe.counters, window, now[0].tau, last, stalled)
            if room.joints.unsolved[0]:
                status = JOINTS_UNSOLVED
            if status != DONE:
                add_forced(flow.slots[joined_set(now)], window.omega, now[0].tau, 1.0, z)
                return status
            last = now[0].tau
        add_forced(flow.slots[joined_set(now)], window.omega, window.half, 1.0, z)
        if not is_finite(room):
            return NOT_FINITE
    return DONE


@jit_room
def several_lane(scene, plan, state, observe):
    """Integrate one lane of a `Several` scene of n absorbers and return a status code; ``state`` (2 N_m + 2 n,) is the start and becomes the end."""
    schedule = own_schedule(plan)
    sets = scene.sets
    room = new_room(scene.sets, scene.absorbers, state)
    status = DONE
    counts = observe.counters.counts
    for a in range(room.now.shape[0]):
        limit_searches(room.signals.memory[a], observe.counters)
    seen = observe_with(
        observe, new_account(observe.energy, sets.rows.shape[0], sets.rows.shape[3])
    )
    for k in range(schedule.times.shape[0] - 1):
        status = several_stretch(scene, schedule, k, k > 0, room, state, seen)
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish(scene, counts.reached, room, state, observe)
    return status


@jit
def finish(scene, end, room, state, observe):
    """Write the end state, close open phases, and take the sample that falls on the end (s)."""
    now = room.now
    s = joined_set(room.now)
    w = room.work.rows[0]
    copy(room.work.z, w)
    write_from(scene.sets, s, w, room, state)
    for a in range(now.shape[0]):
        if now[a].regime == JOINED:
            end_phase(observe.events, now[a], end)
    last_sample(state, scene.absorbers.tip_shape, end, observe.clock, observe.level, observe.series)
