"""Event-driven exact integration of compliant contact (paper, appendix): a spring k_n at either wall, a spring k_t in series with a Coulomb slider.

Between events the scene is linear: absorber and tip apart, or joined by the springs that act. Events are the contact of a wall and its end,
the slider's slip (its spring at the limit) and its stick (the relative velocity turns): all guards on the relative displacement and its rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.budget import progress
from impact_env.kernels.check import sample_guard
from impact_env.kernels.energies import add_energy
from impact_env.kernels.energy_account import new_account
from impact_env.kernels.forced import Forced, add_forced, new_forced, solve_forced
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.observers import (
    DONE,
    EVALUATIONS,
    FRICTION_LOSS,
    HELD_LOWER,
    HELD_UPPER,
    IMPACTS,
    NOT_FINITE,
    PASSED,
    REACHED,
    STUCK_INSIDE,
    STUCK_TIME,
    push_impact,
    push_phase,
)
from impact_env.kernels.search import search
from impact_env.kernels.segments import Work, last_sample, new_work, sample_state, sample_tip, to_slots, to_state, window_count, window_of
from impact_env.kernels.signals import HIT_HIGH, NOTHING, REVERSAL, Signal, new_signal
from impact_env.kernels.slots import GUARD, REST, add, advance, copy, weigh


class Springs(NamedTuple):
    """Stiffness of the walls and of the friction in N/m, 0 where absent."""

    wall: float
    friction: float


# rows of a lane's `now`: time from the window's centre; absorber displacement, velocity, acceleration (used in the free regime); constant
# relative force; wall touched (-1, 0, 1); slider sticks (0, 1); sign of sliding; slider's position; signal starts on the low or high guard
# (-1, 0, 1); start of the contact, relative velocity and absorber velocity there; start of the stick; relative velocity starts at zero
TAU, Q, V, A, FORCE, WALL, STICK, SIGN, ANCHOR, SIDE, CONTACT_TIME, CONTACT_RATE, CONTACT_V, STICK_TIME, AT_REST = range(15)


@jit
def regime_number(now):  # type: ignore[no-untyped-def]
    """Return 0 free, 1 wall's spring, 2 friction's spring, 3 both."""
    return (1 if now[WALL] != 0.0 else 0) + (2 if now[STICK] != 0.0 else 0)


@jit
def guard_bounds(gap, reach, now):  # type: ignore[no-untyped-def]
    """Return the interval of the relative displacement in which the regime holds; ``reach`` is the slider's limit over its stiffness."""
    low, high = -np.inf, np.inf
    if gap is not None:
        if now[WALL] == 0.0:
            low, high = -gap, gap
        elif now[WALL] > 0.0:
            low = gap
        else:
            high = -gap
    if now[STICK] != 0.0:
        low, high = max(low, now[ANCHOR] - reach), min(high, now[ANCHOR] + reach)
    return low, high


@jit
def constant_force(springs, gap, limit, now):  # type: ignore[no-untyped-def]
    """Set the constant part of the force on the absorber: from the wall's place, the slider's place, and sliding friction."""
    force = 0.0
    if gap is not None:
        force += springs.wall * gap * now[WALL]
    if limit is not None:
        force += springs.friction * now[ANCHOR] if now[STICK] != 0.0 else -limit * now[SIGN]
    now[FORCE] = force


@jit
def guard_rest(rows):  # type: ignore[no-untyped-def]
    """Return the relative displacement under a unit constant relative force."""
    r = 0.0
    for j in range(rows.shape[1]):
        r += rows[GUARD, j] * rows[REST, j] - rows[GUARD + 1, j] * rows[REST + 1, j]
    return r


@jit
def check_springs(check, slots, forced, window, gap, limit, low, high, now, signal, offset):  # type: ignore[no-untyped-def]
    """Check a search: no contact or slip is passed, and a slider that slides does not turn."""
    if check is None:
        return
    unit, sign = 0.0, 0.0
    if gap is not None:
        unit = gap
    if limit is not None:
        sign = now[SIGN] if now[STICK] == 0.0 else 0.0
    sample_guard(check, slots, forced, window, signal, now[TAU], offset, low, high, unit, 0.0, sign, PASSED)


@jit
def run_to_event(regime, forced, window, contact, gap, limit, reach, losses, now, work, signal, scratch, clock, counters, level, series, energy):  # type: ignore[no-untyped-def]
    """Advance a regime to its next event or the window's end."""
    slots, omega = regime.slots, window.omega
    weigh(slots.rows, GUARD, work.z, signal.u)
    p, rest = signal.polynomial, guard_rest(slots.rows) * now[FORCE]
    free = regime_number(now) == 0
    now[A] = now[FORCE] / contact.mass if free else 0.0
    if free:
        p[0], p[1], p[2] = now[Q] + rest, now[V], now[A]
    else:
        p[0], p[1], p[2] = rest, 0.0, 0.0
        now[Q], now[V] = 0.0, 0.0
    low, high = guard_bounds(gap, reach, now)
    tau, length, side = now[TAU], window.half - now[TAU], int(now[SIDE])
    if limit is None:
        found = search(slots, forced, omega, signal, tau, length, window.half, low, high, side, None, False)
    elif now[STICK] == 0.0:
        found = search(slots, forced, omega, signal, tau, length, window.half, low, high, side, now[SIGN], now[AT_REST] > 0.0)
    else:
        found = search(slots, forced, omega, signal, tau, length, window.half, low, high, side, None, now[AT_REST] > 0.0)
    counters.values[EVALUATIONS] += found.evaluations
    offset = found.offset
    check_springs(counters.check, slots, forced, window, gap, limit, low, high, now, signal, offset)
    end = tau + offset
    sample_tip(slots, forced.signals, window, work.z, work.u, regime.tip_rest * now[FORCE], tau, end, clock, level)
    sample_state(regime, forced, window, work.z, now[FORCE], now[Q : A + 1], tau, end, clock, work.rows[0], series)
    r = regime_number(now)
    add_energy(regime, forced, window, losses, work.z, now[FORCE], now[Q : A + 1], tau, end, work.rows, scratch, r, energy)
    advance(slots.rows, slots.table, slots.scale, offset, work.z)
    if free:
        now[Q] += offset * (now[V] + 0.5 * offset * now[A])
        now[V] += offset * now[A]
    now[TAU] = end
    now[SIDE], now[AT_REST] = 0.0, 0.0
    if now[STICK] != 0.0:
        counters.values[STUCK_TIME] += offset
    return found


@jit
def read_state(regime, forced, omega, now, work, state):  # type: ignore[no-untyped-def]
    """Write the state in the current regime at the current time."""
    w = work.rows[0]
    copy(work.z, w)
    add_forced(forced.slots, omega, now[TAU], 1.0, w)
    add(regime.slots.rows, REST, now[FORCE], w)
    to_state(regime.out, w, state)
    half = state.shape[0] // 2
    if regime_number(now) == 0:
        state[half - 1], state[2 * half - 1] = now[Q], now[V]


@jit
def write_state(regime, forced, omega, now, work, state):  # type: ignore[no-untyped-def]
    """Set the free part of the slots, and the absorber, from a state at the current time."""
    half = state.shape[0] // 2
    now[Q], now[V] = state[half - 1], state[2 * half - 1]
    to_slots(regime.into, state, work.z)
    add_forced(forced.slots, omega, now[TAU], -1.0, work.z)
    add(regime.slots.rows, REST, -now[FORCE], work.z)


@jit
def relative_motion(contact, state):  # type: ignore[no-untyped-def]
    """Return relative displacement and velocity, absorber less tip."""
    modes = contact.tip_shape.shape[0]
    r, v = state[modes], state[2 * modes + 1]
    for i in range(modes):
        r -= contact.tip_shape[i] * state[i]
        v -= contact.tip_shape[i] * state[modes + 1 + i]
    return r, v


@jit
def start_contact(side, time, rate, absorber_velocity, now, counters):  # type: ignore[no-untyped-def]
    """A wall is touched."""
    now[WALL] = side
    now[CONTACT_TIME], now[CONTACT_RATE], now[CONTACT_V] = time, rate, absorber_velocity
    counters.values[IMPACTS] += 1.0


@jit
def list_contact(time, absorber_velocity, now, events, mass):  # type: ignore[no-untyped-def]
    """List the contact that lasts up to ``time``."""
    push_impact(events, now[CONTACT_TIME], now[CONTACT_RATE], mass * (absorber_velocity - now[CONTACT_V]), 0.0)
    push_phase(events, now[CONTACT_TIME], time, HELD_UPPER if now[WALL] > 0.0 else HELD_LOWER)


@jit
def touch(found, gap, now, time, absorber_velocity, counters, events, mass):  # type: ignore[no-untyped-def]
    """A wall's contact begins or ends; without clearance the end at one wall is the begin at the other."""
    if now[WALL] == 0.0:
        side = 1.0 if found.kind == HIT_HIGH else -1.0
        now[SIDE] = -side
        start_contact(side, time, found.rate, absorber_velocity, now, counters)
        return
    list_contact(time, absorber_velocity, now, events, mass)
    now[SIDE] = now[WALL]
    if gap == 0.0:
        start_contact(-now[WALL], time, found.rate, absorber_velocity, now, counters)
    else:
        now[WALL] = 0.0


@jit
def switch(found, gap, reach, now, state, contact, time, counters, events):  # type: ignore[no-untyped-def]
    """Set the regime that follows an event."""
    half = state.shape[0] // 2
    r, v = relative_motion(contact, state)
    if found.kind == REVERSAL:
        now[STICK], now[ANCHOR], now[SIDE], now[AT_REST] = 1.0, r - now[SIGN] * reach, now[SIGN], 1.0
        now[STICK_TIME] = time
        return
    sign = 1.0 if found.kind == HIT_HIGH else -1.0
    if now[STICK] != 0.0:
        low, high = guard_bounds(gap, reach, now)
        slip = now[ANCHOR] + sign * reach
        if slip == (high if sign > 0.0 else low):
            now[STICK], now[SIGN] = 0.0, sign
            now[AT_REST] = 1.0 if sign * v <= 0.0 else 0.0
            push_phase(events, now[STICK_TIME], time, STUCK_INSIDE)
            return
    if gap is not None:
        touch(found, gap, now, time, state[2 * half - 1], counters, events, contact.mass)


@jit
def begin(springs, gap, limit, now, state, contact, time, counters):  # type: ignore[no-untyped-def]
    """Set the first regime: the slider starts without force, a wall that is already overlapped is in contact."""
    r, v = relative_motion(contact, state)
    if gap is not None:
        if abs(r) > gap or gap == 0.0:
            start_contact(1.0 if r >= 0.0 else -1.0, time, v, state[-1], now, counters)
            if r == 0.0:
                now[SIDE] = -1.0
    if limit is not None:
        now[STICK], now[ANCHOR], now[STICK_TIME] = 1.0, r, time
    constant_force(springs, gap, limit, now)


@jit
def add_slider_loss(limit, reach, r0, r1, now, energy):  # type: ignore[no-untyped-def]
    """Add limit times the distance slid."""
    if energy is None or limit is None:
        return
    if now[STICK] == 0.0:
        energy.totals[FRICTION_LOSS] += limit * abs(r1 - r0)


@jit
def add_slider_energy(springs, limit, reach, now, state, contact, energy):  # type: ignore[no-untyped-def]
    """Add what the slider's spring holds: at the limit while it slides."""
    if energy is None or limit is None:
        return
    stretch = reach
    if now[STICK] != 0.0:
        r, _ = relative_motion(contact, state)
        stretch = r - now[ANCHOR]
    energy.totals[FRICTION_LOSS] += 0.5 * springs.friction * stretch * stretch


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``now`` (15,), and scratch for it."""

    now: NDArray[np.float64]
    work: Work
    signal: Signal
    forced: tuple[Forced, Forced, Forced, Forced]
    solved: NDArray[np.float64]
    scratch: NDArray[np.float64]


@jit_room
def new_room(free, wall, friction, both, state):  # type: ignore[no-untyped-def]
    """Return room for lanes of one scene."""
    size = free.slots.rows.shape[1]
    forced = (new_forced(free.slots), new_forced(wall.slots), new_forced(friction.slots), new_forced(both.slots))
    return Room(np.zeros(15), new_work(size), new_signal(size), forced, np.zeros(4), np.zeros_like(state))


@jit
def slider_reach(springs, limit):  # type: ignore[no-untyped-def]
    """Return the slider's limit over its stiffness (m), 0 without a slider."""
    if limit is None:
        return 0.0
    return limit / springs.friction


@jit
def compliant_stretch(  # type: ignore[no-untyped-def]
    free, wall, friction, both, contact, springs, gap, limit, losses, schedule, k, room, state, clock, counters, level, events, series, energy
):  # fmt: skip
    """Integrate over stretch ``k`` of the schedule and return a status code; ``state`` and ``room.now`` are carried from stretch to stretch."""
    now, work, signal, forced, solved, scratch = room
    regimes, reach = (free, wall, friction, both), slider_reach(springs, limit)
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        now[TAU] = -window.half
        solved[:] = 0.0
        number, last, stalled = regime_number(now), now[TAU], 0
        solve_forced(regimes[number].slots, window, None, forced[number])
        solved[number] = 1.0
        write_state(regimes[number], forced[number], window.omega, now, work, state)
        while now[TAU] < window.half:
            r0, _ = relative_motion(contact, state)
            regime, part = regimes[number], forced[number]
            found = run_to_event(
                regime, part, window, contact, gap, limit, reach, losses, now, work, signal, scratch, clock, counters, level, series, energy
            )
            read_state(regime, part, window.omega, now, work, state)
            r1, _ = relative_motion(contact, state)
            add_slider_loss(limit, reach, r0, r1, now, energy)
            if found.kind != NOTHING:
                switch(found, gap, reach, now, state, contact, window.centre + now[TAU], counters, events)
                constant_force(springs, gap, limit, now)
                number = regime_number(now)
                if solved[number] == 0.0:
                    solve_forced(regimes[number].slots, window, None, forced[number])
                    solved[number] = 1.0
                write_state(regimes[number], forced[number], window.omega, now, work, state)
            stalled, status = progress(counters, window, now[TAU], last, stalled)
            if status != DONE:
                return status
            last = now[TAU]
        if not np.isfinite(state[0]):
            return NOT_FINITE
    return DONE


@jit_room
def compliant_lane(free, wall, friction, both, contact, springs, gap, limit, losses, schedule, state, clock, counters, level, events, series, energy):  # type: ignore[no-untyped-def]
    """Integrate one lane; ``state`` (2 N_m + 2,) is the start and becomes the end. Return a status code.

    ``gap`` None: no walls; ``limit`` None: no friction. ``wall``, ``friction``, ``both``: the regimes with these springs. The friction loss contains
    what the slider's spring holds at the end.
    """
    room, book, status = new_room(free, wall, friction, both, state), new_account(energy, 4, free.slots.rows.shape[1]), DONE
    now = room.now
    begin(springs, gap, limit, now, state, contact, 0.0, counters)
    for k in range(schedule.times.shape[0] - 1):
        status = compliant_stretch(
            free, wall, friction, both, contact, springs, gap, limit, losses, schedule, k, room, state, clock, counters, level, events, series, book
        )
        if status != DONE:
            break
    if status == DONE:
        counters.values[REACHED] = schedule.times[-1]
    end = counters.values[REACHED]
    if now[STICK] != 0.0:
        push_phase(events, now[STICK_TIME], end, STUCK_INSIDE)
    if now[WALL] != 0.0:
        list_contact(end, state[-1], now, events, contact.mass)
    add_slider_energy(springs, limit, slider_reach(springs, limit), now, state, contact, energy)
    last_sample(state, contact.tip_shape, end, clock, level, series)
    return status
