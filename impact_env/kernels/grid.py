"""What the two time-stepping kernels share: which step holds which sample, and the end of a contact phase."""

from __future__ import annotations

import numpy as np

from impact_env.kernels.jit import jit
from impact_env.kernels.observers import STUCK_TIME, push_phase

FREE = -1  # kind of phase: none


@jit
def rows_wanted(level, series, duration, sample_dt):  # type: ignore[no-untyped-def]
    """Return the number of samples that the observers want."""
    if level is None:
        if series is None:
            return 0
    return int(duration / sample_dt + 1e-9) + 1


@jit
def step_of_row(row, rows, sample_dt, dt, steps):  # type: ignore[no-untyped-def]
    """Return the step at whose end, or before it, sample ``row`` lies; -1 if there is none left."""
    if row >= rows:
        return -1
    return min(max(int(np.ceil(row * sample_dt / dt - 1e-9)) - 1, 0), steps - 1)


@jit
def close_phase(kind, start, end, counters, events):  # type: ignore[no-untyped-def]
    """Note the contact phase that ends, if it is one."""
    if kind != FREE:
        counters.values[STUCK_TIME] += end - start
        push_phase(events, start, end, kind)
