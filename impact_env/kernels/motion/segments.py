"""What the exact kernels share: regimes with their maps, the walk through windows, and the observers of a stretch without events."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.motion.forced import Forced, Window, add_forced, own_motion
from impact_env.kernels.motion.forced_sums import slots_of_state, state_of_slots
from impact_env.kernels.motion.level import push_block, push_level
from impact_env.kernels.motion.loads import (
    CHIRP_REMAINDER,
    MOST_PHASE,
    LoadPieces,
    count_windows,
    enter_load,
    new_load,
)
from impact_env.kernels.motion.sampling import Samples, fill_samples
from impact_env.kernels.motion.slots import REST, TIP, Slots, add, advance, copy, weigh

Array = NDArray[np.float64]
SAMPLE_ROUNDING = 1e-12  # of the sampling interval


class Regime(NamedTuple):
    """Slots and the maps between them and the state (modal displacements, absorber displacement, modal velocities, absorber velocity).

    With several absorbers the state has as many places for them. ``out`` (2, 2 N_m + 2, J), real and imaginary: state = Re(out Z); ``into``
    (2, 2 N_m + 2, J), transposed: Z = into^T state; ``tip_rest``: tip displacement under a unit constant relative force.
    """

    slots: Slots
    out: Array
    into: Array
    tip_rest: float


class Schedule(NamedTuple):
    """Breakpoints of the drive: times (s), circular frequencies (rad/s), phases (rad), each (K,); force amplitude (N); longest window (s).

    ``load``: other loads than the chirp of one force, in a lane as a `loads.Load`; of the rest only the times then say something.
    """

    times: Array
    omegas: Array
    phases: Array
    amplitude: float
    reach: float
    load: LoadPieces | None


@jit_room
def own_schedule(schedule):
    """Return a lane's schedule, whose load has scratch memory that no other lane writes."""
    return Schedule(
        schedule.times,
        schedule.omegas,
        schedule.phases,
        schedule.amplitude,
        schedule.reach,
        new_load(schedule.load),
    )


class Losses(NamedTuple):
    """What the energy balance needs: force shape, tip shape, 2 D omega, each (N_m,), and the tuned absorber's damper (N s/m)."""

    force_shape: Array
    tip_shape: Array
    rate: Array
    damper: float


class Work(NamedTuple):
    """Scratch of a lane: free part z, signal of the samples u, each (2, J), and room for the observers (2, 2, J)."""

    z: Array
    u: Array
    rows: Array


@jit_room
def new_work(size):
    """Return scratch for regimes of ``size`` slots."""
    return Work(np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, 2, size)))


class Stretch(NamedTuple):
    """A stretch without events, for its observers: times ``tau`` and ``end`` (s, from the window's centre), and all that moves from tau on.

    ``work.z`` is the free part at tau, ``constant`` the constant relative force (in units of the regime's rest part), ``bent`` what it does to the
    tip (m). ``motion`` (n,): MOTION records, for each absorber what is to be added to what the regime's map gives.
    """

    regime: Regime
    forced: Forced
    window: Window
    work: Work
    constant: float
    bent: float
    motion: NDArray[Any]
    tau: float
    end: float


@jit
def window_count(schedule, k):
    """Return how many windows stretch k of the schedule needs: within the tables' reach, the chirp's remainder and MOST_PHASE."""
    load = schedule.load
    if load is not None:
        return count_windows(load, schedule.times, k, schedule.reach)
    duration = schedule.times[k + 1] - schedule.times[k]
    alpha = abs(schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    longest = schedule.reach
    if alpha > 0.0:
        longest = min(longest, 2.0 * np.sqrt(2.0 * (120.0 * CHIRP_REMAINDER) ** 0.2 / alpha))
    longest = min(
        longest, 2.0 * MOST_PHASE / max(schedule.omegas[k], schedule.omegas[k + 1], 1e-300)
    )
    return max(1, int(np.ceil(duration / longest * (1.0 - 1e-12))))


@jit
def window_of(schedule, k, w, count):
    """Return window w of ``count`` in stretch k; of other loads than a chirp its terms are written."""
    duration = schedule.times[k + 1] - schedule.times[k]
    load = schedule.load
    if load is not None:
        centre = schedule.times[k] + duration * (w + 0.5) / count
        return Window(
            centre,
            0.5 * duration / count,
            enter_load(load, schedule.times, k, centre),
            0.0,
            0.0,
            0.0,
            load,
        )
    alpha = (schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    x = duration * (w + 0.5) / count
    phase = schedule.phases[k] + (schedule.omegas[k] + 0.5 * alpha * x) * x
    a = schedule.amplitude
    return Window(
        schedule.times[k] + x,
        0.5 * duration / count,
        schedule.omegas[k] + alpha * x,
        alpha,
        a * math.cos(phase),
        a * math.sin(phase),
        None,
    )


@jit
def to_state(out, z, state):
    """Write state = Re(out Z)."""
    state_of_slots(out, state.shape[0], z.shape[1], z, state)


@jit
def to_slots(into, state, z):
    """Write Z = into state."""
    slots_of_state(into, state.shape[0], z.shape[1], state, z)


@jit
def samples_before(end, interval):
    """Return how many of the times 0, interval, 2 interval, ... lie before ``end``; one that falls on the end within rounding does not."""
    return max(np.ceil(end / interval - SAMPLE_ROUNDING), 0.0)


@jit_inline
def sample_level(stretch, clock, level):
    """Push the displacement at the samples in [tau, end) to the level: that of the absorber's place, or at the level's ``place``."""
    if level is None:
        return
    slots = stretch.regime.slots
    signals = stretch.forced.signals
    window = stretch.window
    tau = stretch.tau
    end = stretch.end
    n = clock.level
    interval = clock.interval
    u = stretch.work.u
    if n * interval - window.centre >= end:
        return
    stop = samples_before(end + window.centre, interval)
    if stop <= n:
        return
    weigh(slots.rows, TIP, stretch.work.z, u)
    while n < stop:
        first = n % level.block.shape[0]
        count = min(int(stop - n), level.block.shape[0] - first)
        x = n * interval - window.centre
        samples = Samples(max(x - tau, 0.0), x, interval, first, count)
        if level.place.shape[0] == 0:
            fill_samples(slots, signals, window.omega, u, stretch.bent, samples, level.block)
        else:
            fill_places(stretch, level.place, samples, level.block)
        push_block(level, first, count)
        n += count
    clock.level = n


@jit_inline
def is_due(window, clock, level, series, energy):
    """Return whether anything is observed in a window."""
    if energy is not None:
        return True
    if series is not None:
        return True
    if level is not None:
        if level.place.shape[0] + level.envelope.low.shape[0] > 0:
            return True
        return clock.level * clock.interval - window.centre < window.half
    return False


@jit
def fill_places(stretch, place, samples, block):
    """Write the displacement at a place at `Samples` into the block."""
    slots = stretch.regime.slots
    out = stretch.regime.out
    w = stretch.work.rows[0]
    for k in range(samples.number):
        t = samples.offset + k * samples.interval
        copy(stretch.work.z, w)
        advance(slots.rows, slots.table, slots.scale, t, w)
        add_forced(stretch.forced.slots, stretch.window.omega, stretch.tau + t, 1.0, w)
        add(slots.rows, REST, stretch.constant, w)
        q = 0.0
        for i in range(place.shape[0]):
            for j in range(w.shape[1]):
                q += place[i] * (out[0, i, j] * w[0, j] - out[1, i, j] * w[1, j])
        block[samples.first + k] = q


@jit
def state_at(stretch, z, tau, offset, w, state):
    """Write the state at tau + offset from the free part z at tau, both within the stretch; w is scratch."""
    slots = stretch.regime.slots
    copy(z, w)
    advance(slots.rows, slots.table, slots.scale, offset, w)
    add_forced(stretch.forced.slots, stretch.window.omega, tau + offset, 1.0, w)
    add(slots.rows, REST, stretch.constant, w)
    to_state(stretch.regime.out, w, state)


@jit
def sample_state(stretch, clock, series):
    """Write the state at the samples in [tau, end)."""
    if series is None:
        return
    window = stretch.window
    tau = stretch.tau
    end = stretch.end
    motion = stretch.motion
    work = stretch.work
    n = clock.series
    interval = clock.interval
    x = n * interval - window.centre
    half = series.states.shape[1] // 2
    absorbers = motion.shape[0]
    stop = clock.first + series.states.shape[0]
    while x < end and n < stop:
        t = max(x - tau, 0.0)
        row = series.states[n - clock.first]
        state_at(stretch, work.z, tau, t, work.rows[0], row)
        for a in range(absorbers):
            own = motion[a]
            row[half - absorbers + a] += own.q + t * (own.v + 0.5 * t * own.a)
            row[2 * half - absorbers + a] += own.v + t * own.a
        add_own_motion(stretch, tau + t, row)
        n += 1
        x = n * interval - window.centre
    clock.series = n


@jit_inline
def add_own_motion(stretch, tau, state):
    """Add to a state at an offset from the window's centre what the base gives a single free absorber; nothing where the base does not move."""
    load = stretch.window.load
    if load is not None:
        q, v = own_motion(load, stretch.forced.signals, stretch.window.omega, tau)
        state[state.shape[0] // 2 - 1] += q
        state[state.shape[0] - 1] += v


@jit
def last_sample(state, tip_shape, end, clock, level, series):
    """Take the sample that falls on the end of the run, within rounding."""
    interval = clock.interval
    if series is not None:
        n = clock.series
        row = n - clock.first
        if row < series.states.shape[0] and abs(n * interval - end) < 1e-6 * interval:
            for i in range(state.shape[0]):
                series.states[row, i] = state[i]
    if level is not None:
        if abs(clock.level * interval - end) < 1e-6 * interval:
            if level.place.shape[0] == 0:
                push_level(level, weighted_sum(tip_shape, state))
            else:
                push_level(level, weighted_sum(level.place, state))


@jit
def weighted_sum(shape, state):
    """Return the displacement in m of the place of a mode shape (N_m,)."""
    q = 0.0
    for i in range(shape.shape[0]):
        q += shape[i] * state[i]
    return q
