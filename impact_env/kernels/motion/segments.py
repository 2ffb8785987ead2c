"""Common parts of the exact kernels.

They are regimes with their maps, the loop over windows, and the observers of a segment without
events.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.motion.forced import Forced, ForceWindow, add_forced, base_motion
from impact_env.kernels.motion.forced_sums import sum_amplitudes_of_state, sum_state
from impact_env.kernels.motion.level import push_sample, push_samples
from impact_env.kernels.motion.loads import (
    CHIRP_REMAINDER,
    MOST_PHASE,
    LoadPieces,
    count_load_windows,
    expand_load,
    new_load_workspace,
)
from impact_env.kernels.motion.modal_system import (
    REST,
    TIP,
    ModalSystem,
    add_weighted,
    apply_weights,
    copy_amplitudes,
    propagate,
)
from impact_env.kernels.motion.sampling import SampleTimes, fill_samples

Array = NDArray[np.float64]
SAMPLE_TIME_TOL = 1e-12  # of the sampling interval


class LinearRegime(NamedTuple):
    """A modal system with its maps to and from the state.

    The state consists of modal displacements, absorber displacement, modal velocities and absorber
    velocity.

    With several absorbers the state has as many places for them. ``out`` (2, 2 N_m + 2, J), real
    and imaginary: state = Re(out Z); ``into`` (2, 2 N_m + 2, J), transposed: Z = into^T state;
    ``tip_rest`` (m/N): tip displacement under a unit constant relative force.
    """

    system: ModalSystem
    out: Array
    into: Array
    tip_rest: float


class Schedule(NamedTuple):
    """Breakpoints of the drive.

    ``times`` are in s, circular frequencies ``omegas`` in rad/s and ``phases`` in rad, each (K,).
    ``amplitude`` is the force amplitude (N) and ``reach`` the longest window (s).

    ``load``: other loads than the chirp of one force, in a lane as a `loads.LoadWorkspace`; of the
    rest only the times then say something.
    """

    times: Array
    omegas: Array
    phases: Array
    amplitude: float
    reach: float
    load: LoadPieces | None


@jit_allocating
def copy_schedule(schedule):
    """Return the schedule with load workspace of its own, which no other run writes."""
    return Schedule(
        schedule.times,
        schedule.omegas,
        schedule.phases,
        schedule.amplitude,
        schedule.reach,
        new_load_workspace(schedule.load),
    )


class Losses(NamedTuple):
    """Data for the energy balance.

    They are force shape, tip shape and 2 D omega, each (N_m,), and the tuned absorber's damper (N
    s/m).
    """

    force_shape: Array
    tip_shape: Array
    rate: Array
    damper: float


class Buffers(NamedTuple):
    """Scratch memory of a run.

    It contains the free part z of the amplitudes and the signal of the samples u, each (2, J), and
    rows (2, 2, J) for the observers.
    """

    z: Array
    u: Array
    rows: Array


@jit_allocating
def new_buffers(size):
    """Return scratch memory for regimes of ``size`` amplitudes."""
    return Buffers(np.zeros((2, size)), np.zeros((2, size)), np.zeros((2, 2, size)))


class Segment(NamedTuple):
    """A smooth piece of motion without events, for the observers.

    It extends from ``tau`` to ``end`` (s from the window's centre).

    ``buffers.z`` is the free part at tau, ``constant`` the constant relative force (in units of
    the regime's rest part), ``deflection`` its displacement of the tip (m). ``motion`` (n,):
    ABSORBER_MOTION records, to be added for each absorber to the state of the regime's map.
    """

    regime: LinearRegime
    forced: Forced
    window: ForceWindow
    buffers: Buffers
    constant: float
    deflection: float
    motion: NDArray[Any]
    tau: float
    end: float


@jit
def count_windows(schedule, k):
    """Return the number of windows of section k of the schedule.

    It is limited by the reach of the tables, by the chirp's remainder and by MOST_PHASE.
    """
    load = schedule.load
    if load is not None:
        return count_load_windows(load, schedule.times, k, schedule.reach)
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
def expand_window(schedule, k, w, count):
    """Return window w of ``count`` in section k.

    The terms of a load other than a chirp are written.
    """
    duration = schedule.times[k + 1] - schedule.times[k]
    load = schedule.load
    if load is not None:
        centre = schedule.times[k] + duration * (w + 0.5) / count
        return ForceWindow(
            centre,
            0.5 * duration / count,
            expand_load(load, schedule.times, k, centre),
            0.0,
            0.0,
            0.0,
            load,
        )
    alpha = (schedule.omegas[k + 1] - schedule.omegas[k]) / duration
    x = duration * (w + 0.5) / count
    phase = schedule.phases[k] + (schedule.omegas[k] + 0.5 * alpha * x) * x
    a = schedule.amplitude
    return ForceWindow(
        schedule.times[k] + x,
        0.5 * duration / count,
        schedule.omegas[k] + alpha * x,
        alpha,
        a * math.cos(phase),
        a * math.sin(phase),
        None,
    )


@jit
def compute_state(out, z, state):
    """Write state = Re(out Z)."""
    sum_state(out, state.shape[0], z.shape[1], z, state)


@jit
def compute_amplitudes(into, state, z):
    """Write Z = into^T state."""
    sum_amplitudes_of_state(into, state.shape[0], z.shape[1], state, z)


@jit
def count_samples_before(end, interval):
    """Return the number of the times 0, interval, 2 interval, ... before ``end``.

    A time equal to ``end`` within rounding is not counted.
    """
    return max(np.ceil(end / interval - SAMPLE_TIME_TOL), 0.0)


@jit_inline
def sample_level(segment, clock, level):
    """Add the displacement at the samples in [tau, end) to the level.

    It is the displacement at the absorber's place, or at the level's ``place`` if this is given.
    """
    if level is None:
        return
    system = segment.regime.system
    signals = segment.forced.signals
    window = segment.window
    tau = segment.tau
    end = segment.end
    n = clock.level
    interval = clock.interval
    u = segment.buffers.u
    if n * interval - window.centre >= end:
        return
    stop = count_samples_before(end + window.centre, interval)
    if stop <= n:
        return
    apply_weights(system.rows, TIP, segment.buffers.z, u)
    while n < stop:
        first = n % level.block.shape[0]
        count = min(int(stop - n), level.block.shape[0] - first)
        x = n * interval - window.centre
        samples = SampleTimes(max(x - tau, 0.0), x, interval, first, count)
        if level.place.shape[0] == 0:
            fill_samples(system, signals, window.omega, u, segment.deflection, samples, level.block)
        else:
            sample_place(segment, level.place, samples, level.block)
        push_samples(level, first, count)
        n += count
    clock.level = n


@jit_inline
def is_observed(window, clock, level, series, energy):
    """Return whether anything is observed in a window."""
    if energy is not None:
        return True
    if series is not None:
        if series.states.shape[0] > 0:
            return True
    if level is not None:
        if level.place.shape[0] + level.envelope.low.shape[0] > 0:
            return True
        return clock.level * clock.interval - window.centre < window.half
    return False


@jit
def sample_place(segment, place, samples, block):
    """Write the displacement of a place at `SampleTimes` into the block."""
    system = segment.regime.system
    out = segment.regime.out
    w = segment.buffers.rows[0]
    for k in range(samples.number):
        t = samples.offset + k * samples.interval
        copy_amplitudes(segment.buffers.z, w)
        propagate(system.rows, system.table, system.scale, t, w)
        add_forced(segment.forced.polynomials, segment.window.omega, segment.tau + t, 1.0, w)
        add_weighted(system.rows, REST, segment.constant, w)
        q = 0.0
        for i in range(place.shape[0]):
            for j in range(w.shape[1]):
                q += place[i] * (out[0, i, j] * w[0, j] - out[1, i, j] * w[1, j])
        block[samples.first + k] = q


@jit
def compute_state_at(segment, z, tau, offset, w, state):
    """Write the state at tau + offset, computed from the free part z at tau.

    Both times are within the segment. w is scratch.
    """
    system = segment.regime.system
    copy_amplitudes(z, w)
    propagate(system.rows, system.table, system.scale, offset, w)
    add_forced(segment.forced.polynomials, segment.window.omega, tau + offset, 1.0, w)
    add_weighted(system.rows, REST, segment.constant, w)
    compute_state(segment.regime.out, w, state)


@jit_inline
def sample_state(segment, clock, series):
    """Write the state at the samples in [tau, end), if states are recorded."""
    if series is None:
        return
    if series.states.shape[0] > 0:
        _write_states(segment, clock, series)


@jit
def _write_states(segment, clock, series):
    window = segment.window
    tau = segment.tau
    end = segment.end
    motion = segment.motion
    buffers = segment.buffers
    n = clock.series
    interval = clock.interval
    x = n * interval - window.centre
    half = series.states.shape[1] // 2
    absorbers = motion.shape[0]
    stop = clock.first + series.states.shape[0]
    while x < end and n < stop:
        t = max(x - tau, 0.0)
        row = series.states[n - clock.first]
        compute_state_at(segment, buffers.z, tau, t, buffers.rows[0], row)
        for a in range(absorbers):
            own = motion[a]
            row[half - absorbers + a] += own.q + t * (own.v + 0.5 * t * own.a)
            row[2 * half - absorbers + a] += own.v + t * own.a
        add_base_motion_to_state(segment, tau + t, row)
        n += 1
        x = n * interval - window.centre
    clock.series = n


@jit_inline
def add_base_motion_to_state(segment, tau, state):
    """Add the motion that the base gives free absorbers to a state.

    Nothing is added if the base is at rest.
    """
    load = segment.window.load
    if load is not None:
        q, v = base_motion(load, segment.forced.signals, segment.window.omega, tau)
        motion = segment.motion
        n = motion.shape[0]
        half = state.shape[0] // 2
        for a in range(n):
            state[half - n + a] += motion[a].base_share * q
            state[2 * half - n + a] += motion[a].base_share * v


@jit
def take_last_sample(state, tip_shape, end, clock, level, series):
    """Take the sample at the end of the run, within rounding."""
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
                push_sample(level, displacement_at(tip_shape, state))
            else:
                push_sample(level, displacement_at(level.place, state))


@jit
def displacement_at(shape, state):
    """Return the displacement (m) of the place of a mode shape (N_m,)."""
    q = 0.0
    for i in range(shape.shape[0]):
        q += shape[i] * state[i]
    return q
