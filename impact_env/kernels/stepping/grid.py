"""Common parts of the two time-stepping kernels: modes, drive, time steps and samples.

In: the drive's breakpoints and a time step. Out: the force at equidistant times, and the samples
between the steps.

The schedule has K breakpoints; section k lies between breakpoints k and k + 1. The force is the
real part of a rotating phasor, which spares a cosine at each step. Over one section the phase is a
quadratic in time, so the phasor's turn per step is itself a phasor that turns at a constant rate.
Rounding grows with the square of the number of steps; the phasor is computed again after
`PHASOR_STEPS` of them, when rounding is below 2e-13.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.motion.loads import LoadPieces, compute_force, has_sources
from impact_env.kernels.motion.observers import LEVEL_OFF, push_phase

PHASOR_STEPS = 32  # steps after which the phasor is computed again


class Spring(NamedTuple):
    """A linear spring and a damper between absorber and tip."""

    stiffness: float  # N/m, 0: neither spring nor damper
    damping: float  # N s/m


NO_SPRING = Spring(0.0, 0.0)

Array = NDArray[np.float64]
NO_PHASE = -1  # kind of contact phase: the absorber is free or slides


class BeamModes(NamedTuple):
    """The N_m mass-normalised modes of the beam."""

    omega: Array  # (N_m,) circular frequencies (rad/s)
    damping_ratio: Array  # (N_m,)
    force_shape: Array  # (N_m,) mode shapes at the force
    tip_shape: Array  # (N_m,) mode shapes at the absorber


class DriveForce(NamedTuple):
    """The K breakpoints of the drive and the values of the force there.

    If ``load`` has sources, it replaces the chirp: then only ``times`` is used, ``amplitude`` is 1,
    and all sources are forces, none a motion of the base.
    """

    times: Array  # (K,) s
    omegas: Array  # (K,) circular frequencies (rad/s)
    phases: Array  # (K,) integrals of the frequency from the first breakpoint on (rad)
    amplitude: float  # N
    phase: float  # phase at the first breakpoint, added to ``phases`` (rad)
    load: LoadPieces  # other loads; without sources: the chirp


class TimeStep(NamedTuple):
    """The largest time step, and the width of the table of modes."""

    dt: float  # s; the kernels reduce it so that it divides the duration
    # distance between rows of the table, None: the constant `STRIDE` of the method
    wide_stride: int | None


@jit
def find_section(times, k, t):
    """Return the index of the section of the schedule that contains time ``t`` (s).

    The search goes forward from section ``k``. A breakpoint belongs to the section that it begins,
    and times after the last breakpoint belong to the last section.
    """
    while k + 2 < times.shape[0] and t >= times[k + 1]:
        k += 1
    return k


@jit
def count_steps_left(times, k, t, dt, most):
    """Return a number of times t, t + dt, ..., 1 to ``most``, that all lie in section ``k``.

    ``t`` lies in the section. If the result is below ``most``, one more time may lie in it.
    """
    if k + 2 >= times.shape[0] or t + most * dt < times[k + 1]:
        return most
    return max(1, min(most, int((times[k + 1] - t) / dt)))


@jit
def compute_force_angle(force, k, t):
    """Return the phase of the chirp in section ``k`` at time ``t`` (s), and its derivatives.

    The result is (phase in rad without ``force.phase``, circular frequency in rad/s, its rate in
    rad/s^2).
    """
    times = force.times
    omegas = force.omegas
    phases = force.phases
    rate = (omegas[k + 1] - omegas[k]) / (times[k + 1] - times[k])
    tau = t - times[k]
    return phases[k] + (omegas[k] + 0.5 * rate * tau) * tau, omegas[k] + rate * tau, rate


@jit
def compute_phasor(force, k, t, dt):
    """Return cosine and sine of the force's phase, of its turn, and of the change of its turn.

    The six numbers are cosine and sine of the phase at ``t`` (s), of the turn from t to t + dt, and
    of the increase of the turn per step.
    """
    angle, omega, rate = compute_force_angle(force, k, t)
    turn = (omega + 0.5 * rate * dt) * dt
    change = rate * dt * dt
    return (
        math.cos(angle + force.phase),
        math.sin(angle + force.phase),
        math.cos(turn),
        math.sin(turn),
        math.cos(change),
        math.sin(change),
    )


@jit
def fill_force(target, count, force, k, t, dt):
    """Write the force at t, t + dt, ... into ``target``; return the section of time ``t`` (s).

    The first ``count`` entries are written: the chirp for amplitude 1, or the other loads in N. The
    search for the section begins at section ``k``.
    """
    times = force.times
    load = force.load
    first = find_section(times, k, t)
    k = first
    if has_sources(load):
        for n in range(count):
            k = find_section(times, k, t + n * dt)
            target[n] = compute_force(load, k, t + n * dt)
        return first
    done = 0
    while done < count:
        time = t + done * dt
        k = find_section(times, k, time)
        stop = done + count_steps_left(times, k, time, dt, min(PHASOR_STEPS, count - done))
        c, s, turn_c, turn_s, change_c, change_s = compute_phasor(force, k, time, dt)
        while done < stop:
            target[done] = c
            c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
            turn_c, turn_s = (
                turn_c * change_c - turn_s * change_s,
                turn_c * change_s + turn_s * change_c,
            )
            done += 1
    return first


@jit
def find_sample_range(clock, level, series, duration):
    """Return (first sample that an observer needs, first sample that none needs any more).

    Samples are numbered from 0 at time 0; ``duration`` (s) is that of the run. ``level`` and
    ``series`` are observers or None. The result is (0, 0) if no samples are needed.
    """
    every = int(duration / clock.interval + 1e-9) + 1
    if level is not None:
        if clock.level != LEVEL_OFF:
            return 0, every
    if series is not None:
        return clock.first, min(every, clock.first + series.states.shape[0])
    return 0, 0


@jit
def find_sample_step(row, rows, sample_dt, dt, steps):
    """Return the index of the step within which or at whose end sample ``row`` lies.

    The result is -1 if ``row`` is not below ``rows``, so that no sample is left. ``sample_dt`` and
    ``dt`` (s) are the distances of samples and steps; ``steps`` is the number of steps.
    """
    if row >= rows:
        return -1
    return min(max(int(np.ceil(row * sample_dt / dt - 1e-9)) - 1, 0), steps - 1)


@jit
def needs_all_modes(level, series):
    """Return whether a sample needs the motion of all modes, not only that of the tip.

    That is so if states are recorded, or the level at another point than the absorber.
    """
    if series is not None:
        if series.states.shape[0] > 0:
            return True
    if level is not None:
        return level.place.shape[0] > 0
    return False


@jit
def find_series_row(clock, series, sample):
    """Return the row of ``series.states`` for a sample of the run, -1 if it has none."""
    row = sample - clock.first
    return row if 0 <= row < series.states.shape[0] else -1


@jit_inline
def interpolate_displacement(start, end, part, h):
    """Return the displacement (m) at the fraction ``part`` (0 to 1) of a step of h (s).

    The cubic through ``start`` and ``end`` is evaluated, which are (displacement, velocity) at the
    step's ends.
    """
    q0, v0 = start
    q1, v1 = end
    left = 1.0 - part
    return left * left * ((1.0 + 2.0 * part) * q0 + part * h * v0) + part * part * (
        (3.0 - 2.0 * part) * q1 - left * h * v1
    )


@jit_inline
def interpolate_velocity(start, end, part, h):
    """Return the velocity (m/s) of the cubic of `interpolate_displacement`."""
    q0, v0 = start
    q1, v1 = end
    left = 1.0 - part
    return (
        6.0 * part * left * (q1 - q0) / h
        + left * (1.0 - 3.0 * part) * v0
        + part * (3.0 * part - 2.0) * v1
    )


@jit
def record_contact_phase(kind, start, end, counters, events):
    """Record the contact phase from ``start`` to ``end`` (s), unless its kind is NO_PHASE.

    The duration is added to ``counters.counts.stuck_time``, the phase to the list in ``events``.
    """
    if kind != NO_PHASE:
        counters.counts.stuck_time += end - start
        push_phase(events, start, end, kind, 0)
