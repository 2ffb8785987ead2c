"""What the two time-stepping kernels share: which step holds which sample, and the end of a contact phase."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.motion.loads import LoadPieces
from impact_env.kernels.motion.observers import push_phase

Array = NDArray[np.float64]
FREE = -1  # kind of phase: none


class Modes(NamedTuple):
    """The beam: circular frequencies (rad/s), damping ratios, shapes at the force and at the tip, each (N_m,)."""

    omega: Array
    damping_ratio: Array
    force_shape: Array
    tip_shape: Array


class Force(NamedTuple):
    """Breakpoints of the drive: times (s), circular frequencies (rad/s), integrals of the frequency (rad), each (K,); amplitude (N), phase (rad).

    ``load``: other loads than the chirp of one force, all of them forces; of the rest only the times then say something, and the amplitude is 1.
    """

    times: Array
    omegas: Array
    phases: Array
    amplitude: float
    phase: float
    load: LoadPieces | None


class Step(NamedTuple):
    """Time step (s), which is reduced so that it divides the duration; ``wide``: number of oscillators in steps of 4 if the table is to be wider."""

    dt: float
    wide: int | None


@jit
def rows_wanted(level, series, duration, sample_dt):
    """Return the number of samples that the observers want."""
    if level is None:
        if series is None:
            return 0
    return int(duration / sample_dt + 1e-9) + 1


@jit
def step_of_row(row, rows, sample_dt, dt, steps):
    """Return the step at whose end, or before it, sample ``row`` lies; -1 if there is none left."""
    if row >= rows:
        return -1
    return min(max(int(np.ceil(row * sample_dt / dt - 1e-9)) - 1, 0), steps - 1)


@jit
def close_phase(kind, start, end, counters, events):
    """Note the contact phase that ends, if it is one."""
    if kind != FREE:
        counters.counts.stuck_time += end - start
        push_phase(events, start, end, kind, 0)
