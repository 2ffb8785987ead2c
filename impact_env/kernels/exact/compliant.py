"""Event-driven exact integration of compliant contact (paper, appendix): a spring k_n at either wall, a spring k_t in series with a Coulomb slider.

Between events the scene is linear: absorber and tip apart, or joined by the springs that act. Events are the contact of a wall and its end,
the slider's slip (its spring at the limit) and its stick (the relative velocity turns): all guards on the relative displacement and its rate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.energy.account import new_account, observe_with
from impact_env.kernels.energy.energies import add_energy
from impact_env.kernels.events.search import next_event
from impact_env.kernels.events.signals import NOTHING, Course, Guards, Signal, new_signal
from impact_env.kernels.exact.budget import limit_searches, progress
from impact_env.kernels.exact.check import Guard, sample_guard
from impact_env.kernels.exact.rigid_contact import Contact
from impact_env.kernels.exact.springs import (
    Springs,
    add_slider_energy,
    add_slider_loss,
    begin,
    book_contact_loss,
    clearance,
    constant_force,
    damper_loss,
    guard_bounds,
    list_contact,
    new_now,
    regime_number,
    relative_motion,
    slider_reach,
    slider_sign,
    switch,
)
from impact_env.kernels.motion.forced import Forced, add_forced, new_forced
from impact_env.kernels.motion.lines import solve_window
from impact_env.kernels.motion.observers import (
    DONE,
    MOTION,
    NOT_FINITE,
    PASSED,
    STUCK_INSIDE,
    push_phase,
)
from impact_env.kernels.motion.segments import (
    Losses,
    Regime,
    Stretch,
    Work,
    last_sample,
    new_work,
    own_schedule,
    sample_level,
    sample_state,
    to_slots,
    to_state,
    window_count,
    window_of,
)
from impact_env.kernels.motion.slots import GUARD, REST, add, advance, copy, weigh


class Sprung(NamedTuple):
    """A scene of one absorber with compliant contact.

    Regimes without a spring, with the wall's, with the friction's, with both; the contact, the springs, half-clearance (m) and limit of friction (N),
    None where absent, and what the energy balance needs: ``wall_losses`` while a wall is touched, with the walls' damper, else ``losses``.
    """

    regimes: tuple[Regime, Regime, Regime, Regime]
    contact: Contact
    springs: Springs
    gap: float | None
    limit: float | None
    losses: Losses
    wall_losses: Losses


@jit
def guard_rest(rows):
    """Return the relative displacement under a unit constant relative force."""
    r = 0.0
    for j in range(rows.shape[1]):
        r += rows[GUARD, j] * rows[REST, j] - rows[GUARD + 1, j] * rows[REST + 1, j]
    return r


@jit
def check_springs(check, scene, slots, forced, window, bounds, room, offset):
    """Check a search: no contact or slip is passed, and a slider that slides does not turn."""
    if check is None:
        return
    now = room.now[0]
    guard = Guard(
        bounds[0], bounds[1], clearance(scene.gap), 0.0, slider_sign(scene.limit, now), PASSED
    )
    sample_guard(check, slots, forced, window, room.signal, now.tau, offset, guard)


@jit_inline
def end_of_stretch(slots, forced, window, limit, low, high, room):
    """Return the first event up to the window's end of the signal in ``room``: a bound of the interval, or the turn of a slider that slides."""
    now = room.now[0]
    length = window.half - now.tau
    side = int(now.side)
    course = Course(slots, forced, window.omega, room.signal, now.tau)
    if limit is None:
        return next_event(window, course, Guards(low, high, side, None, False), length)
    if not now.sticks:
        return next_event(window, course, Guards(low, high, side, now.sign, now.at_rest), length)
    return next_event(window, course, Guards(low, high, side, None, now.at_rest), length)


@jit_inline
def run_to_event(regime, forced, scene, window, reach, room, observe):
    """Advance a regime to its next event or the window's end."""
    now = room.now[0]
    work = room.work
    counters = observe.counters
    r = regime_number(room.now[0])
    free = r == 0
    slots = regime.slots
    p = room.signal.polynomial
    rest = guard_rest(regime.slots.rows) * now.force
    weigh(slots.rows, GUARD, work.z, room.signal.u)
    now.a = now.force / scene.contact.mass if free else 0.0
    if free:
        p[0], p[1], p[2] = now.q + rest, now.v, now.a
    else:
        p[0], p[1], p[2] = rest, 0.0, 0.0
        now.q = 0.0
        now.v = 0.0
    low, high = guard_bounds(scene.gap, reach, now)
    tau = now.tau
    found = end_of_stretch(slots, forced, window, scene.limit, low, high, room)
    counters.counts.evaluations += found.evaluations
    offset = found.offset
    check_springs(counters.check, scene, slots, forced, window, (low, high), room, offset)
    end = tau + offset
    motion = room.motion[0]
    motion.q = now.q
    motion.v = now.v
    motion.a = now.a
    stretch = Stretch(
        regime, forced, window, work, now.force, regime.tip_rest * now.force, room.motion, tau, end
    )
    sample_level(stretch, observe.clock, observe.level)
    sample_state(stretch, observe.clock, observe.series)
    if now.wall != 0.0:
        add_energy(stretch, scene.wall_losses, room.scratch, r, observe.energy)
    else:
        add_energy(stretch, scene.losses, room.scratch, r, observe.energy)
    advance(slots.rows, slots.table, slots.scale, offset, work.z)
    if free:
        now.q += offset * (now.v + 0.5 * offset * now.a)
        now.v += offset * now.a
    now.tau = end
    now.side = 0.0
    now.at_rest = False
    if now.sticks:
        counters.counts.stuck_time += offset
    return found


@jit
def read_state(regime, forced, omega, now, work, state):
    """Write the state in the current regime at the current time."""
    w = work.rows[0]
    copy(work.z, w)
    add_forced(forced.slots, omega, now.tau, 1.0, w)
    add(regime.slots.rows, REST, now.force, w)
    to_state(regime.out, w, state)
    half = state.shape[0] // 2
    if regime_number(now) == 0:
        state[half - 1], state[2 * half - 1] = now.q, now.v


@jit
def write_state(regime, forced, omega, now, work, state):
    """Set the free part of the slots, and the absorber, from a state at the current time."""
    half = state.shape[0] // 2
    now.q = state[half - 1]
    now.v = state[2 * half - 1]
    to_slots(regime.into, state, work.z)
    add_forced(forced.slots, omega, now.tau, -1.0, work.z)
    add(regime.slots.rows, REST, -now.force, work.z)


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``now`` (1,), a `springs.NOW` record, and scratch; ``motion`` (1,) as in `segments.Stretch`."""

    now: NDArray[Any]
    work: Work
    signal: Signal
    forced: tuple[Forced, Forced, Forced, Forced]
    solved: NDArray[np.bool_]
    motion: NDArray[Any]
    scratch: NDArray[np.float64]


@jit_room
def new_room(regimes, load, state):
    """Return room for lanes of one scene under a load, None: a chirp."""
    free, wall, friction, both = regimes
    size = free.slots.rows.shape[1]
    forced = (
        new_forced(free.slots, load),
        new_forced(wall.slots, load),
        new_forced(friction.slots, load),
        new_forced(both.slots, load),
    )
    return Room(
        new_now(),
        new_work(size),
        new_signal(size),
        forced,
        np.zeros(4, np.bool_),
        np.zeros(1, MOTION),
        np.zeros_like(state),
    )


@jit_inline
def enter_regime(scene, window, room, state):
    """Go on from a state in the regime that `regime_number` says."""
    now = room.now[0]
    r = regime_number(now)
    regime = scene.regimes[r]
    forced = room.forced[r]
    if not room.solved[r]:
        solve_window(regime.slots, window, None, forced)
        room.solved[r] = True
    write_state(regime, forced, window.omega, now, room.work, state)


@jit_inline
def pass_event(scene, window, reach, room, state, observe):
    """Advance to the next event, or to the window's end, and let it happen."""
    now = room.now[0]
    r0, _ = relative_motion(scene.contact, state)
    number = regime_number(now)
    regime = scene.regimes[number]
    forced = room.forced[number]
    found = run_to_event(regime, forced, scene, window, reach, room, observe)
    read_state(regime, forced, window.omega, now, room.work, state)
    r1, _ = relative_motion(scene.contact, state)
    add_slider_loss(scene.limit, r0, r1, now, observe.energy)
    if found.kind != NOTHING:
        switch(found, scene, reach, now, state, window.centre + now.tau, observe)
        constant_force(scene.springs, scene.gap, scene.limit, now)
        enter_regime(scene, window, room, state)


@jit
def compliant_stretch(scene, schedule, k, room, state, observe):
    """Integrate over stretch ``k`` of the schedule and return a status code; ``state`` and ``room.now`` are carried from stretch to stretch."""
    now = room.now[0]
    reach = slider_reach(scene.springs, scene.limit)
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        now.tau = -window.half
        room.solved[:] = False
        last = now.tau
        stalled = 0
        enter_regime(scene, window, room, state)
        while now.tau < window.half:
            pass_event(scene, window, reach, room, state, observe)
            stalled, status = progress(observe.counters, window, now.tau, last, stalled)
            if status != DONE:
                return status
            last = now.tau
        if not np.isfinite(state[0]):
            return NOT_FINITE
    return DONE


@jit_room
def compliant_lane(scene, plan, state, observe):
    """Integrate one lane of a `Sprung` scene and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end.

    The friction loss contains what the slider's spring holds at the end.
    """
    schedule = own_schedule(plan)
    room = new_room(scene.regimes, schedule.load, state)
    status = DONE
    counts = observe.counters.counts
    limit_searches(room.signal.memory, observe.counters)
    seen = observe_with(observe, new_account(observe.energy, 4, room.work.z.shape[1]))
    begin(
        scene.springs, scene.gap, scene.limit, room.now[0], state, scene.contact, observe.counters
    )
    for k in range(schedule.times.shape[0] - 1):
        status = compliant_stretch(scene, schedule, k, room, state, seen)
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish(scene, room, state, counts.reached, observe)
    return status


@jit
def finish(scene, room, state, end, observe):
    """Close what is open at the end (s), and take the sample that falls on it."""
    now = room.now[0]
    contact = scene.contact
    if now.sticks:
        push_phase(observe.events, now.stick_time, end, STUCK_INSIDE, 0)
    if now.wall != 0.0:
        loss = damper_loss(scene.wall_losses.damper > 0.0, observe.energy)
        list_contact(end, state[-1], loss, now, observe.events, contact.mass)
    add_slider_energy(scene, scene.limit, now, state, observe.energy)
    book_contact_loss(observe.energy)
    last_sample(state, contact.tip_shape, end, observe.clock, observe.level, observe.series)
