"""Two designs compared by noisy values: the ratio of their quantiles, with an interval.

Runs part after some impacts, so the same members (phases, roundings) of two designs have nothing in common: the correlation of their levels was
measured as -0.17. Pairing them buys nothing, and the interval resamples each design's members on its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import bootstrap

from impact_env.parameters import require

Array = NDArray[np.float64]
COVERED, RESAMPLES = 0.95, 2000


@dataclass(frozen=True)
class Gain:
    """``ratio`` of two designs' values and the ends of its 95 % bootstrap interval; NaN where the second value is 0, or a run broke down."""

    ratio: float
    low: float
    high: float

    @property
    def clear(self) -> bool:
        """Whether the interval leaves out 1: the two designs differ."""
        return self.high < 1 or self.low > 1

    def __str__(self) -> str:
        return f"{self.ratio:.3f} ({self.low:.3f} to {self.high:.3f})"


def _members(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    require(array.ndim == 1 and array.size > 0, name, array.shape, "a row of one value or more")
    return array


def ratio_of_quantiles(first: ArrayLike, second: ArrayLike, quantile: float = 0.5, seed: int = 0) -> Gain:
    """Return the quantile of ``first`` (M,) over that of ``second`` (K,), values of members; the default is the ratio of medians.

    The interval is a percentile bootstrap, of no width where either has one member only. Raises ParameterError for empty rows.
    """
    a, b = _members("first", first), _members("second", second)

    def ratio(x: Array, y: Array, axis: int = -1) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.quantile(x, quantile, axis=axis) / np.quantile(y, quantile, axis=axis))

    middle = float(ratio(a, b))
    if not np.isfinite(middle):
        return Gain(*(float("nan"),) * 3)
    if min(a.size, b.size) < 2:
        return Gain(middle, middle, middle)
    options = {"n_resamples": RESAMPLES, "confidence_level": COVERED, "method": "percentile", "rng": np.random.default_rng(seed)}
    found = bootstrap((a, b), ratio, paired=False, vectorized=True, **options).confidence_interval
    return Gain(middle, float(found.low), float(found.high))


def standard_error(values: ArrayLike, quantile: float = 0.5, seed: int = 0) -> float:
    """Return the bootstrap's standard error of a quantile of members (M,); NaN for one member, from which nothing can be said."""
    row = _members("values", values)
    if row.size < 2 or not np.all(np.isfinite(row)):
        return float("nan")

    def value(x: Array, axis: int = -1) -> Array:
        return np.asarray(np.quantile(x, quantile, axis=axis))

    return float(
        bootstrap((row,), value, n_resamples=RESAMPLES, method="percentile", vectorized=True, rng=np.random.default_rng(seed)).standard_error
    )
