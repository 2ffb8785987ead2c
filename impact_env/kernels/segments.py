"""What the exact kernels share: regimes with their maps, the walk through windows, and the observers of a stretch without events.

A lane's ``clock`` (3,) holds the level's next sample, the sampling interval in s, and the series' next sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import CHIRP_REMAINDER, Window, add_forced
from impact_env.kernels.forced_sums import slots_of_state, state_of_slots
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.observers import push_block, push_level
from impact_env.kernels.sampling import fill_samples
from impact_env.kernels.slots import REST, TIP, Slots, add, advance, copy, weigh

Array = NDArray[np.float64]
SAMPLE_ROUNDING = 1e-12  # of the sampling interval
MOST_PHASE = 300.0  # rad of the force from a window's centre to its end: rounding of time makes that times 1e-16 of the forced part noise


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
    """Breakpoints of the drive: times (s), circular frequencies (rad/s), phases (rad), each (K,); force amplitude (N); longest window (s)."""

    times: Array
    omegas: Array
    phases: Array
    amplitude: float
    reach: float


class Losses(NamedTuple):
    """What the energy balance needs: force shape, tip shape, 2 D omega, each (N_m,), and the tuned absorber's damper (N s/m)."""

    force_shape: Array
    tip_shape: Array
    rate: Array
    damper: float


@jit
def window_count(schedule, k):  # type: ignore[no-untyped-def]
    """Return how many windows stretch k of the schedule needs: within the tables' reach, the chirp's remainder and MOST_PHASE."""
    duration = schedule.times[k + 1] - schedule.times[k]
    alpha = abs(schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    longest = schedule.reach
    if alpha > 0.0:
        longest = min(longest, 2.0 * np.sqrt(2.0 * (120.0 * CHIRP_REMAINDER) ** 0.2 / alpha))
    longest = min(longest, 2.0 * MOST_PHASE / max(schedule.omegas[k], schedule.omegas[k + 1], 1e-300))
    return max(1, int(np.ceil(duration / longest * (1.0 - 1e-12))))


@jit
def window_of(schedule, k, w, count):  # type: ignore[no-untyped-def]
    """Return window w of ``count`` in stretch k."""
    duration = schedule.times[k + 1] - schedule.times[k]
    alpha = (schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    x = duration * (w + 0.5) / count
    phase = schedule.phases[k] + (schedule.omegas[k] + 0.5 * alpha * x) * x
    a = schedule.amplitude
    return Window(schedule.times[k] + x, 0.5 * duration / count, schedule.omegas[k] + alpha * x, alpha, a * np.cos(phase), a * np.sin(phase))


@jit
def to_state(out, z, state):  # type: ignore[no-untyped-def]
    """Write state = Re(out Z)."""
    state_of_slots(out, state.shape[0], z.shape[1], z, state)


@jit
def to_slots(into, state, z):  # type: ignore[no-untyped-def]
    """Write Z = into state."""
    slots_of_state(into, state.shape[0], z.shape[1], state, z)


@jit
def samples_before(end, interval):  # type: ignore[no-untyped-def]
    """Return how many of the times 0, interval, 2 interval, ... lie before ``end``; one that falls on the end within rounding does not."""
    return max(np.ceil(end / interval - SAMPLE_ROUNDING), 0.0)


@jit
def sample_tip(slots, signals, window, z, u, tip_rest, tau, end, clock, level):  # type: ignore[no-untyped-def]
    """Push the tip displacement at the samples in [tau, end) to the level; z holds the free part at tau, u is scratch."""
    if level is None:
        return
    n, interval = clock[0], clock[1]
    if n * interval - window.centre >= end:
        return
    stop = samples_before(end + window.centre, interval)
    if stop <= n:
        return
    weigh(slots.rows, TIP, z, u)
    while n < stop:
        first = int(n) % level.block.shape[0]
        count = min(int(stop - n), level.block.shape[0] - first)
        x = n * interval - window.centre
        fill_samples(slots, signals, window.omega, u, tip_rest, max(x - tau, 0.0), x, interval, level.block, first, count)
        push_block(level, first, count)
        n += count
    clock[0] = n


@jit
def state_at(regime, forced, omega, z, constant, tau, offset, w, state):  # type: ignore[no-untyped-def]
    """Write the state at tau + offset from the free part z at tau; ``constant`` is the constant relative force, w is scratch."""
    slots = regime.slots
    copy(z, w)
    advance(slots.rows, slots.table, slots.scale, offset, w)
    add_forced(forced.slots, omega, tau + offset, 1.0, w)
    add(slots.rows, REST, constant, w)
    to_state(regime.out, w, state)


@jit
def sample_state(regime, forced, window, z, constant, absorber, tau, end, clock, w, series):  # type: ignore[no-untyped-def]
    """Write the state at the samples in [tau, end).

    ``absorber`` (3 n,): for each absorber displacement, velocity and acceleration at tau, to be added to what the regime's map gives.
    """
    if series is None:
        return
    n, interval = int(clock[2]), clock[1]
    x = n * interval - window.centre
    half, absorbers = series.states.shape[1] // 2, absorber.shape[0] // 3
    while x < end and n < series.states.shape[0]:
        t = max(x - tau, 0.0)
        row = series.states[n]
        state_at(regime, forced, window.omega, z, constant, tau, t, w, row)
        for a in range(absorbers):
            row[half - absorbers + a] += absorber[3 * a] + t * (absorber[3 * a + 1] + 0.5 * t * absorber[3 * a + 2])
            row[2 * half - absorbers + a] += absorber[3 * a + 1] + t * absorber[3 * a + 2]
        n += 1
        x = n * interval - window.centre
    clock[2] = n


@jit
def last_sample(state, tip_shape, end, clock, level, series):  # type: ignore[no-untyped-def]
    """Take the sample that falls on the end of the run, within rounding."""
    interval = clock[1]
    if series is not None:
        n = int(clock[2])
        if n < series.states.shape[0] and abs(n * interval - end) < 1e-6 * interval:
            for i in range(state.shape[0]):
                series.states[n, i] = state[i]
    if level is not None:
        if abs(clock[0] * interval - end) < 1e-6 * interval:
            q = 0.0
            for i in range(tip_shape.shape[0]):
                q += tip_shape[i] * state[i]
            push_level(level, q)


class Work(NamedTuple):
    """Scratch of a lane: free part z, signal of the samples u, each (2, J), and room for the observers (2, 2, J)."""

    z: Array
    u: Array
    rows: Array


@jit_room
def new_work(size):  # type: ignore[no-untyped-def]
    """Return scratch for regimes of ``size`` slots."""
    return Work(np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, 2, size)))
