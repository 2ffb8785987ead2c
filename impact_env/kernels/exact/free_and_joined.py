"""The two regimes of one absorber with rigid contact: how each goes on to its next event, and the ways from one to the other.

- free: the beam's modes and the absorber move apart, with a constant force between them if there is friction. Ends at a wall (impact), or where the
  relative velocity turns (friction).
- joined: the absorber moves with the tip. Its force, absorber mass times tip acceleration, must stay within what friction and the wall it
  touches can give; where it leaves that interval the phase ends. It begins where friction can hold at a reversal, or after a complete chatter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room, jit_view
from impact_env.kernels.energy.energies import add_energy
from impact_env.kernels.events.signals import HIT_HIGH, Signal, new_signal
from impact_env.kernels.exact.check import check_flight, check_hold
from impact_env.kernels.exact.next_event import end_of_flight, end_of_hold
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    JOINT_FORCE_TOL,
    Body,
    Contact,
    add_friction_loss,
    end_phase,
    fall,
    friction_force,
    joint_bounds,
    largest_kick,
    new_now,
    static_limit,
    stay_at_wall,
    tip_motion,
    touch,
    weight_held,
)
from impact_env.kernels.motion.forced import (
    Forced,
    add_forced,
    new_forced,
    own_motion,
    signal_value,
)
from impact_env.kernels.motion.observers import MOTION
from impact_env.kernels.motion.segments import (
    Losses,
    Regime,
    Stretch,
    Work,
    new_work,
    sample_level,
    sample_state,
    to_slots,
    to_state,
)
from impact_env.kernels.motion.slots import GUARD, REST, add, advance, copy, weigh


class Rigid(NamedTuple):
    """A scene of one absorber with rigid contact: its two regimes, the contact, and what the energy balance needs."""

    free: Regime
    joined: Regime
    contact: Contact
    losses: Losses


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``now`` (1,), a NOW record, and ``work.z``, and scratch for it.

    ``solved`` (2,): whether a regime's forced part is known in the current window; ``motion`` (1,) as in `segments.Stretch`.
    """

    now: NDArray[Any]
    work: Work
    signal: Signal
    free_forced: Forced
    joined_forced: Forced
    solved: NDArray[np.bool_]
    motion: NDArray[Any]
    scratch: NDArray[np.float64]


@jit_room
def new_room(free, joined, load, state):
    """Return room for lanes of one scene under a load, None: a chirp."""
    size = free.slots.rows.shape[1]
    now = new_now(1)
    now[0].kick = largest_kick(free.slots.rows)
    free_forced = new_forced(free.slots, load)
    joined_forced = new_forced(joined.slots, load)
    solved = np.zeros(2, np.bool_)
    return Room(
        now,
        new_work(size),
        new_signal(size),
        free_forced,
        joined_forced,
        solved,
        np.zeros(1, MOTION),
        np.zeros_like(state),
    )


@jit_view
def body_of(room):
    """Return the absorber."""
    return Body(room.now[0], room.work, room.signal)


@jit_inline
def move_own(window, room, sign):
    """Add to the absorber's motion, times ``sign``, what a base that moves gives it in the free regime; in flight the rest of it is a polynomial."""
    load = window.load
    if load is not None:
        now = room.now[0]
        q, v = own_motion(load, room.free_forced.signals, window.omega, now.tau)
        now.q += sign * q
        now.v += sign * v


@jit
def totals(regime, forced, omega, now, z, w):
    """Write the whole slots (free, forced and rest part) at the current time to w."""
    copy(z, w)
    add_forced(forced.slots, omega, now.tau, 1.0, w)
    add(regime.slots.rows, REST, now.force, w)


@jit
def enter(regime, forced, omega, now, state, z):
    """Write the free part of a regime's slots for a state at the current time."""
    to_slots(regime.into, state, z)
    add_forced(forced.slots, omega, now.tau, -1.0, z)
    add(regime.slots.rows, REST, -now.force, z)


@jit
def free_state(free, forced, omega, now, work, state):
    """Write the state in the free regime."""
    totals(free, forced, omega, now, work.z, work.rows[0])
    to_state(free.out, work.rows[0], state)
    half = state.shape[0] // 2
    state[half - 1] = now.q
    state[2 * half - 1] = now.v


@jit
def joint_force(joined, forced, omega, tau, contact, work):
    """Return the joint force at tau in the joined regime, whose free part is ``work.z``, and the size of its terms."""
    weigh(joined.slots.rows, GUARD, work.z, work.u)
    f = signal_value(forced.signals, 0, omega, tau)
    scale = forced.bound[0]
    for j in range(work.u.shape[1]):
        f += work.u[0, j]
        scale += abs(work.u[0, j]) + abs(work.u[1, j])
    if contact.gravity is not None:
        f += contact.mass * contact.gravity
        scale += abs(contact.mass * contact.gravity)
    return f, scale


@jit
def try_join(scene, window, room, state):
    """Join absorber and tip if the joint force allows it, else set the sign in which the absorber will slide; return True if joined."""
    now = room.now[0]
    joined = scene.joined
    forced = room.joined_forced
    work = room.work
    q_tip, v_tip = tip_motion(scene.contact, state)
    now.force = weight_held(scene.contact.gravity)
    enter(joined, forced, window.omega, now, state, work.z)
    f, scale = joint_force(joined, forced, window.omega, now.tau, scene.contact, work)
    stay_at_wall(scene.contact.walls, now, q_tip)
    low, high = joint_bounds(static_limit(scene.contact), now.side)
    slack = (
        JOINT_FORCE_TOL * scale
    )  # at its bound the joint force decides in the joined regime, by its rate
    now.v = v_tip
    now.offset = now.q - q_tip
    if low - slack <= f <= high + slack:
        now.regime = JOINED
        now.since = window.centre + now.tau
        return True
    now.sign = -1.0 if f > high else 1.0
    now.force = 0.0
    return False


@jit_inline
def observe_stretch(scene, stretch, r, scratch, observe):
    """Let the observers of samples and energies see a stretch, which lies in regime r."""
    sample_level(stretch, observe.clock, observe.level)
    sample_state(stretch, observe.clock, observe.series)
    add_energy(stretch, scene.losses, scratch, r, observe.energy)


@jit_inline
def fly(scene, window, room, observe):
    """Advance the free regime to its next event or to the window's end; return what the search found."""
    free = scene.free
    forced = room.free_forced
    contact = scene.contact
    body = body_of(room)
    omega = window.omega
    now = body.now
    slots = free.slots
    counters = observe.counters
    fall(contact, now)
    tau = now.tau
    bent = free.tip_rest * now.force
    found = end_of_flight(
        slots, forced, window, contact.walls, contact.limit, body, bent, window.half - tau
    )
    counters.counts.evaluations += found.evaluations
    offset = found.offset
    check_flight(counters.check, slots, forced, window, contact.walls, contact.limit, body, offset)
    end = tau + offset
    motion = room.motion[0]
    motion.q = now.q
    motion.v = now.v
    motion.a = now.a
    observe_stretch(
        scene,
        Stretch(free, forced, window, room.work, now.force, bent, room.motion, tau, end),
        FREE,
        room.scratch,
        observe,
    )
    add_friction_loss(contact.limit, slots, forced, omega, body, tau, offset, observe.energy)
    advance(slots.rows, slots.table, slots.scale, offset, room.work.z)
    now.q += offset * (now.v + 0.5 * offset * now.a)
    now.v += offset * now.a
    now.tau = end
    now.side = 0.0
    now.at_rest = False
    return found


@jit_inline
def hold(scene, window, room, observe):
    """Advance the joined regime to where the joint force leaves its interval, or to the window's end; return the event."""
    joined = scene.joined
    forced = room.joined_forced
    limit = static_limit(scene.contact)
    body = body_of(room)
    now = body.now
    slots = joined.slots
    counters = observe.counters
    tau = now.tau
    weight = weight_held(scene.contact.gravity)
    found = end_of_hold(
        slots, forced, window, limit, scene.contact.mass * weight, body, window.half - tau
    )
    counters.counts.evaluations += found.evaluations
    offset = found.offset
    check_hold(counters.check, slots, forced, window, limit, body, offset)
    end = tau + offset
    motion = room.motion[0]
    motion.q = now.offset
    motion.v = 0.0
    motion.a = 0.0
    stretch = Stretch(
        joined, forced, window, room.work, weight, joined.tip_rest * weight, room.motion, tau, end
    )
    observe_stretch(scene, stretch, JOINED, room.scratch, observe)
    advance(slots.rows, slots.table, slots.scale, offset, room.work.z)
    now.tau = end
    counters.counts.stuck_time += offset
    return found.kind


@jit
def release(scene, window, room, state, event, events):
    """Leave the joined regime: the absorber lags where the joint force is above its bound, leads where it is below."""
    now = room.now[0]
    joined = scene.joined
    work = room.work
    half = state.shape[0] // 2
    totals(joined, room.joined_forced, window.omega, now, work.z, work.rows[0])
    to_state(joined.out, work.rows[0], state)
    state[half - 1] += now.offset
    now.q = state[half - 1]
    now.v = state[2 * half - 1]
    end_phase(events, now, window.centre + now.tau)
    now.regime = FREE
    now.sign = -1.0 if event == HIT_HIGH else 1.0
    now.at_rest = True
    now.force = 0.0
    friction_force(scene.contact.limit, now)
    enter(scene.free, room.free_forced, window.omega, now, state, work.z)
    move_own(window, room, -1.0)


@jit_inline
def can_hold(limit, side):
    """Return whether friction or a wall could hold an absorber without relative velocity."""
    return limit is not None or side != 0.0


@jit
def begin(scene, window, room, state):
    """Set the first regime from the initial state: joined if the relative velocity is zero and friction or a wall can hold it."""
    now = room.now[0]
    contact = scene.contact
    half = state.shape[0] // 2
    now.q = state[half - 1]
    now.v = state[2 * half - 1]
    relative = touch(contact, contact.walls, now, state)
    if relative == 0.0 and can_hold(contact.limit, now.side):
        if try_join(scene, window, room, state):
            return
        now.at_rest = True
    elif relative * now.side > 0.0:
        now.side = 0.0  # on a wall and moving into it: the search reports the impact at once
    friction_force(contact.limit, now)
    enter(scene.free, room.free_forced, window.omega, now, state, room.work.z)
    move_own(window, room, -1.0)
