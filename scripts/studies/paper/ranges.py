"""The operating ranges of an absorber, marked by what its contacts do (paper, table of operating ranges).

Linear: no impacts. Primary: impacts and pauses take turns around the largest response. Secondary: there they go on without pause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.parameters import require
from studies.paper.curve import Curve

MOST = 0.5  # share of the members that decides


@dataclass(frozen=True)
class Border:
    """Where a range ends: between two forces in N of a curve, ``low`` and ``high``; ``force``: their geometric mean."""

    low: float
    high: float

    @property
    def force(self) -> float:
        """The middle on a logarithmic axis, in N."""
        return float(np.sqrt(self.low * self.high))


@dataclass(frozen=True)
class Ranges:
    """``first_impacts``: the end of the linear range, ``transition``: of the primary one; None where the curve's forces do not hold it."""

    first_impacts: Border | None
    transition: Border | None


def operating_ranges(forces: ArrayLike, impacting: ArrayLike, sustained: ArrayLike) -> Ranges:
    """Return the borders between rising forces (F,) in N, from the shares (F,) of members with impacts, and with sustained ones.

    The linear range ends at the first force at which most have impacts. The secondary range is what lies above the last force at which most have
    pauses. Raises ParameterError unless the forces rise and all rows have one length.
    """
    rising, first, last = (np.asarray(row, dtype=float) for row in (forces, impacting, sustained))
    require(rising.ndim == 1 and bool(np.all(np.diff(rising) > 0)), "forces", forces, "a row of rising forces in N")
    require(first.shape == last.shape == rising.shape, "shares", (first.shape, last.shape), f"one for each of the {len(rising)} forces")
    impacts, paused = np.flatnonzero(first > MOST), np.flatnonzero(last <= MOST)
    return Ranges(
        _border(rising, int(impacts[0])) if len(impacts) else None,
        _border(rising, int(paused[-1]) + 1) if len(paused) else None,
    )


def _border(forces: NDArray[np.float64], k: int) -> Border | None:
    """Return the border below force ``k``, None at either end of the curve."""
    return Border(float(forces[k - 1]), float(forces[k])) if 0 < k < len(forces) else None


def ranges_of(curve: Curve) -> Ranges:
    """Return the operating ranges of a curve whose contacts were looked at."""
    return operating_ranges(curve.forces, curve.impacting, curve.sustained)


def slopes(curve: Curve, inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return d log(level)/d log(force) of each member, (M,), by least squares over the forces ``inside`` (F,): 1 is proportional, 0 saturated.

    NaN where that is fewer than two forces.
    """
    if np.count_nonzero(inside) < 2:
        return np.full(curve.level.shape[1], np.nan)
    return np.asarray(np.polynomial.polynomial.polyfit(np.log(curve.forces[inside]), np.log(curve.level[inside]), 1)[1])
