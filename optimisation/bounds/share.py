"""How much of the possible reduction a design reached: 0 is no absorber, 1 is the limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.frequency import frequency_range
from impact_env.modes import ModalModel
from impact_env.parameters import non_negative, require
from optimisation.bounds.stroke import SWEPT, resonance_limit
from optimisation.tuned import highest_amplitude

Real = NDArray[np.float64]


def _levels(name: str, values: ArrayLike) -> Real:
    array = np.asarray(values, dtype=np.float64)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, "finite levels in m, 0 or above")
    return array


def reduction_share(level: ArrayLike, without: ArrayLike, limit: ArrayLike) -> Real:
    """Return (without - level)/(without - limit), of the broadcast shape of the three levels in m.

    ``without`` is the level without an absorber, ``limit`` what no device can go below. A limit lies below the best device, so the share is
    a lower bound of what was reached; below 0 means worse than no absorber, and above 1 a level that is not a stationary one (a
    sweep's). Raises ParameterError where limit >= without: nothing can be gained there.
    """
    reached, start, end = _levels("level", level), _levels("without", without), _levels("limit", limit)
    require(bool(np.all(end < start)), "limit", limit, f"below the level without an absorber, {without!r} m")
    return np.asarray((start - reached) / (start - end))


def share_reached(
    model: ModalModel,
    mass: float,
    gap: float,
    force: float,
    level: ArrayLike,
    resonance: int = 1,
    low: float = SWEPT[0],
    high: float = SWEPT[1],
) -> Real:
    """Return the share of the possible reduction that a ``level`` (m, RMS, any shape) reached near a resonance, of level's shape.

    ``level`` is a design's largest level over low..high times omega_r, simulated or measured, at a ``force`` in N; ``mass`` m_a in kg and ``gap`` g0
    in m are the design's, and the limit is `resonance_limit`. It is compared with the free beam's largest stationary level over that range.
    Raises ParameterError for numbers out of range, a force of 0, and an undamped resonance in the range.
    """
    low, high = frequency_range(low, high)
    require(non_negative("force", force) > 0, "force", force, "above 0 N, since nothing is to be reduced")
    without = float(force) * highest_amplitude(model, None, resonance, low, high)[0] / np.sqrt(2)
    require(bool(np.isfinite(without)), "damping_ratio", model.damping_ratio, "above 0 at every resonance of the range")
    return reduction_share(level, without, resonance_limit(model, mass, gap, force, resonance, low, high))
