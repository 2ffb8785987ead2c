"""The two regimes of one absorber with rigid contact: how each goes on to its next event, and the ways from one to the other.

- free: the beam's modes and the absorber move apart, with a constant force between them if there is friction. Ends at a wall (impact), or where the
  relative velocity turns (friction).
- joined: the absorber moves with the tip. Its force, absorber mass times tip acceleration, must stay within what friction and the wall it
  touches can give; where it leaves that interval the phase ends. It begins where friction can hold at a reversal, or after a complete chatter.
"""

from __future__ import annotations

from impact_env.kernels.check import check_flight, check_hold
from impact_env.kernels.energies import add_energy
from impact_env.kernels.forced import add_forced, signal_value
from impact_env.kernels.jit import jit
from impact_env.kernels.next_event import end_of_flight, end_of_hold
from impact_env.kernels.observers import EVALUATIONS, STUCK_TIME
from impact_env.kernels.rigid_contact import (
    AT_REST,
    FORCE,
    FREE,
    JOINED,
    JOINT_SLACK,
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
    joint_bounds,
    tip_motion,
    touch,
)
from impact_env.kernels.segments import sample_state, sample_tip, to_slots, to_state
from impact_env.kernels.signals import HIT_HIGH
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
    check_flight(counters.check, slots, forced, window, walls, limit, now, signal, offset)
    end = tau + offset
    sample_tip(slots, forced.signals, window, work.z, work.u, free.tip_rest * now[FORCE], tau, end, clock, level)
    sample_state(free, forced, window, work.z, now[FORCE], now[Q : A + 1], tau, end, clock, work.rows[0], series)
    add_energy(free, forced, window, losses, work.z, now[FORCE], now[Q : A + 1], tau, end, work.rows, state, FREE, energy)
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
    check_hold(counters.check, slots, forced, window, limit, now, signal, offset)
    end = tau + offset
    sample_tip(slots, forced.signals, window, work.z, work.u, 0.0, tau, end, clock, level)
    now[V], now[A] = 0.0, 0.0
    now[Q] = now[OFFSET]
    sample_state(joined, forced, window, work.z, 0.0, now[Q : A + 1], tau, end, clock, work.rows[0], series)
    add_energy(joined, forced, window, losses, work.z, 0.0, now[Q : A + 1], tau, end, work.rows, state, JOINED, energy)
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
