"""Intervals for shares, distances between samples, and bootstrap intervals. All samples are rows of numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.stats
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
LEVEL = 0.95


def wilson(hits: int, runs: int, level: float = LEVEL) -> tuple[float, float]:
    """Return Wilson's score interval of a share (E. B. Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    _check(hits, runs, level)
    z = float(scipy.stats.norm.ppf(0.5 + level / 2))
    share = hits / runs
    centre = (share + z**2 / (2 * runs)) / (1 + z**2 / runs)
    half = z / (1 + z**2 / runs) * np.sqrt(share * (1 - share) / runs + z**2 / (4 * runs**2))
    return (0.0 if hits == 0 else float(centre - half)), (1.0 if hits == runs else float(centre + half))


def clopper_pearson(hits: int, runs: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the exact interval of a share, which holds at least its level (C. J. Clopper, E. S. Pearson, Biometrika 26, 1934)."""
    _check(hits, runs, level)
    tail = (1 - level) / 2
    low = 0.0 if hits == 0 else float(scipy.stats.beta.ppf(tail, hits, runs - hits + 1))
    high = 1.0 if hits == runs else float(scipy.stats.beta.ppf(1 - tail, hits + 1, runs - hits))
    return low, high


def _check(hits: int, runs: int, level: float) -> None:
    if runs < 1 or not 0 <= hits <= runs:
        raise ValueError(f"hits = {hits} of runs = {runs} is not allowed: at least one run, and no more hits than runs")
    if not 0 < level < 1:
        raise ValueError(f"level = {level} is not allowed: a number between 0 and 1")


def wasserstein(one: ArrayLike, other: ArrayLike) -> float:
    """Return the area between the distribution functions of two samples (the distance W1), in the samples' unit."""
    return float(scipy.stats.wasserstein_distance(np.asarray(one, dtype=float), np.asarray(other, dtype=float)))


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
    return wasserstein(one, other) / abs(float(np.mean(other)))


def distance_at_size(sample: ArrayLike, truth: ArrayLike, size: int, resamples: int = 200, seed: int = 0) -> float:
    """Return the distance to expect between ``size`` runs of a method and the truth, relative to the truth's mean: the mean over resamples."""
    values, target = np.asarray(sample, dtype=float), np.asarray(truth, dtype=float)
    if size < 1 or values.size == 0:
        raise ValueError(f"size = {size} is not allowed: at least one run, of a sample that is not empty")
    generator = np.random.default_rng(seed)
    return float(np.mean([relative_distance(generator.choice(values, size), target) for _ in range(resamples)]))


def kolmogorov_smirnov(one: ArrayLike, other: ArrayLike) -> tuple[float, float]:
    """Return the largest difference of two samples' distribution functions, and the chance of so large a one between samples of one distribution."""
    result = scipy.stats.ks_2samp(np.asarray(one, dtype=float), np.asarray(other, dtype=float))
    return float(result.statistic), float(result.pvalue)


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
