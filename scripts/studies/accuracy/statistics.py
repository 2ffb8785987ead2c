"""Distances between samples, bootstrap intervals, and shares of groups in a variance. All samples are rows of numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.stats
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
LEVEL = 0.95


def bootstrap(
    statistic: Callable[[Array, Array], float], one: ArrayLike, other: ArrayLike, resamples: int = 400, seed: int = 0, level: float = LEVEL
) -> tuple[float, float]:
    """Return the percentile interval of a statistic of two samples, both drawn anew with replacement."""
    a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    if a.size == 0 or b.size == 0:
        raise ValueError("a bootstrap needs two samples that are not empty")
    generator = np.random.default_rng(seed)
    values = [statistic(generator.choice(a, a.size), generator.choice(b, b.size)) for _ in range(resamples)]
    low, high = np.quantile(values, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def mean_difference(one: Array, other: Array) -> float:
    """Return the difference of the means, relative to the other's."""
    return float(np.mean(one) / np.mean(other) - 1)


def relative_distance(one: Array, other: Array) -> float:
    """Return W1 relative to the mean of the other sample."""
    return float(scipy.stats.wasserstein_distance(one, other)) / abs(float(np.mean(other)))


def distance_at_size(sample: ArrayLike, truth: ArrayLike, size: int, resamples: int = 200, seed: int = 0) -> float:
    """Return the distance to expect between ``size`` runs of a method and the truth, relative to the truth's mean: the mean over resamples."""
    values, target = np.asarray(sample, dtype=float), np.asarray(truth, dtype=float)
    if size < 1 or values.size == 0:
        raise ValueError(f"size = {size} is not allowed: at least one run, of a sample that is not empty")
    generator = np.random.default_rng(seed)
    return float(np.mean([relative_distance(generator.choice(values, size), target) for _ in range(resamples)]))


def between_groups(values: ArrayLike, level: float = LEVEL) -> tuple[float, float, float]:
    """Return the share of the variance that lies between groups, of values (groups, repeats), and its interval.

    One-way random effects: the intraclass correlation ICC(1,1) (P. E. Shrout, J. L. Fleiss, Psychological Bulletin 86, 1979). It is near 0,
    and may be below, where the group does not matter.
    """
    rows = np.asarray(values, dtype=float)
    if rows.ndim != 2 or min(rows.shape) < 2:
        raise ValueError(f"groups = {rows.shape} is not allowed: two groups or more, of two values or more")
    groups, repeats = rows.shape
    free = groups - 1, groups * (repeats - 1)
    between = repeats * float(np.var(rows.mean(axis=1), ddof=1))
    ratio = between / float(rows.var(axis=1, ddof=1).mean())
    tail = (1 + level) / 2
    ratios = ratio, ratio / scipy.stats.f.ppf(tail, *free), ratio * scipy.stats.f.ppf(tail, *free[::-1])
    share, low, high = (float((r - 1) / (r + repeats - 1)) for r in ratios)
    return share, low, high
