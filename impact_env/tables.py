"""Tables of exp(s t) that the exact kernels propagate and search with, so that these call no transcendental function."""

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.events.search import SCAN_NOISE
from impact_env.kernels.events.steps import LEVEL_RATIO
from impact_env.kernels.motion.slots import TAYLOR_REACH
from impact_env.kernels.motion.vector import POINTS

MAX_BASE = 256
COARSEST = 16.0  # largest step of the event search: a share of the tables' reach
FINEST_PHASE = 0.08  # |s| h of the fastest slot at the finest level, at most

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


def table_reach(fastest: float, wanted: float) -> float:
    """Return the time offset in s that the tables cover: ``wanted``, or less if the fastest slot (1/s) turns too quickly for them."""
    return min(wanted, TAYLOR_REACH * MAX_BASE**3 / fastest)


def propagators(values: Complex, used: int, reach: float, speed: float | None = None) -> tuple[int, float, Complex]:
    """Return base, finest step (s) and exp(s h) (3, base, J) of the three-digit tables; slots from ``used`` on are empty.

    ``speed`` (1/s): the |s| that the steps are made for, None: the largest one.
    """
    fastest = np.max(np.abs(values[:used])) if speed is None else speed
    base = 4
    while base**3 * TAYLOR_REACH < reach * fastest * (1 - 1e-12):
        base *= 2
    finest = reach / base**3
    steps = finest * np.array([base**2, base, 1])
    table = np.exp(values * steps[:, None, None] * np.arange(base)[:, None])
    table[:, :, used:] = 1
    return base, finest, table


def ladder(values: Complex, used: int, reach: float, speed: float | None = None) -> tuple[Real, Real, Real, Real]:
    """Return steps (L, 2), waves (L, J, 2, POINTS), turns (L, POINTS, 2, J) and errors (L, J) of the event search, the finest level first.

    ``errors``: a slot's largest share of y - H, relative to its amplitude (see kernels/events/search.py). ``speed`` as in `propagators`.
    """
    speeds = np.abs(values)
    fastest = np.max(speeds[:used]) if speed is None else speed
    count = 1 + max(0, int(np.ceil(np.log(fastest * reach / COARSEST / FINEST_PHASE) / np.log(LEVEL_RATIO))))
    h = reach / COARSEST / LEVEL_RATIO ** np.arange(count - 1, -1, -1.0)
    share = (speeds * h[:, None]) ** 4 / 384
    share[:, used:] = 0
    summed = np.sum(share[:, :used] < 1, axis=1)
    wave = np.exp(values[:, None] * (h[:, None, None] * np.arange(1, POINTS + 1)))
    waves = np.stack([wave.real, wave.imag], axis=2)
    turns = np.stack([part.transpose(0, 2, 1) for part in (wave.real, wave.imag)], axis=2)
    return np.column_stack([h, summed]), np.ascontiguousarray(waves), np.ascontiguousarray(turns), np.minimum(share, 1) + SCAN_NOISE
