"""Common parts of the two time-stepping kernels.

They are the samples between the steps, and the end of a contact phase.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.motion.level import LEVEL_OFF
from impact_env.kernels.motion.loads import LoadPieces
from impact_env.kernels.motion.observers import push_phase

Array = NDArray[np.float64]
NO_PHASE = -1  # kind of phase: none


class BeamModes(NamedTuple):
    """The beam.

    It is given by circular frequencies (rad/s), damping ratios, and shapes at the force and at the
    tip, each (N_m,).
    """

    omega: Array
    damping_ratio: Array
    force_shape: Array
    tip_shape: Array


class DriveForce(NamedTuple):
    """Breakpoints of the drive.

    Times (s), circular frequencies (rad/s) and integrals of the frequency (rad) are (K,) each. The
    amplitude is in N, the phase in rad.

    ``load``: other loads than the chirp of one force, all of them forces, without sources where
    there are none; of the rest only the times then say something, and the amplitude is 1.
    """

    times: Array
    omegas: Array
    phases: Array
    amplitude: float
    phase: float
    load: LoadPieces


class TimeStep(NamedTuple):
    """Time step (s), reduced so that it divides the duration.

    ``wide_stride`` is the width of the table if it must be wider than usual: the number of
    oscillators, rounded up to a multiple of 4.
    """

    dt: float
    wide_stride: int | None


@jit
def find_sample_range(clock, level, series, duration):
    """Return the first sample that an observer needs, and the one after the last."""
    every = int(duration / clock.interval + 1e-9) + 1
    if level is not None:
        if clock.level != LEVEL_OFF:
            return 0, every
    if series is not None:
        return clock.first, min(every, clock.first + series.states.shape[0])
    return 0, 0


@jit
def find_sample_step(row, rows, sample_dt, dt, steps):
    """Return the step at whose end, or before it, sample ``row`` lies; -1 if none is left."""
    if row >= rows:
        return -1
    return min(max(int(np.ceil(row * sample_dt / dt - 1e-9)) - 1, 0), steps - 1)


@jit
def needs_all_modes(level, series):
    """Return whether a sample needs all modes, and not the motion of the absorber's place alone."""
    if series is not None:
        if series.states.shape[0] > 0:
            return True
    if level is not None:
        return level.place.shape[0] > 0
    return False


@jit
def find_series_row(clock, series, sample):
    """Return the row of the series for a sample of the run.

    The result is -1 if the series does not contain the sample.
    """
    row = sample - clock.first
    return row if 0 <= row < series.states.shape[0] else -1


@jit_inline
def interpolate_displacement(start, end, part, h):
    """Return the displacement at ``part`` (0 to 1) of a step of h (s).

    It is that of the cubic through displacements and velocities (q, v) at the step's ends.
    """
    q0, v0 = start
    q1, v1 = end
    left = 1.0 - part
    return left * left * ((1.0 + 2.0 * part) * q0 + part * h * v0) + part * part * (
        (3.0 - 2.0 * part) * q1 - left * h * v1
    )


@jit_inline
def interpolate_velocity(start, end, part, h):
    """Return the velocity of the cubic of `interpolate_displacement`."""
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
    """Note the contact phase that ends, if it is one."""
    if kind != NO_PHASE:
        counters.counts.stuck_time += end - start
        push_phase(events, start, end, kind, 0)
