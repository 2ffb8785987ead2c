"""What can be said of policies from few training runs: robust means, intervals, profiles, chances.

The measures are those of R. Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical Precipice", with one task. Scores
are arrays (R, E): R training runs (1 for a policy that is not trained), E evaluation seeds, which are the same for all. Intervals resample both, the
runs of each policy among themselves and the evaluation seeds in common (A. B. Owen 2007, "The pigeonhole bootstrap"), so that neither many
episodes of one run nor many runs on one seed pass for independent evidence.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, trim_mean

from impact_env.parameters import require

Array = NDArray[np.float64]
Statistic = Callable[..., Any]
RESAMPLES = 1000
COVERED = 0.95


def interquartile_mean(scores: Array) -> float:
    """Return the mean of the middle half of all scores."""
    return float(trim_mean(np.ravel(scores), 0.25))


def improvement(scores: Array, others: Array) -> float:
    """Return the chance that a score is above one of ``others``, both drawn at random; a tie counts half (Mann and Whitney's U)."""
    first, second = np.ravel(scores), np.ravel(others)
    ranks = rankdata(np.concatenate([first, second]))[: first.size]
    return float((ranks.sum() - first.size * (first.size + 1) / 2) / (first.size * second.size))


def difference(scores: Array, others: Array) -> float:
    """Return how much higher the mean of ``scores`` is; with `interval`, which resamples the seeds of both together, a paired comparison."""
    return float(scores.mean() - others.mean())


def normalised(scores: Array, zero: Array, one: Array) -> float:
    """Return the mean score on the scale where the mean of ``zero`` is 0 and that of ``one`` is 1."""
    return float((scores.mean() - zero.mean()) / (one.mean() - zero.mean()))


def profile(scores: Array, thresholds: Array) -> Array:
    """Return the share of scores above each threshold (T,)."""
    values = np.sort(np.ravel(scores))
    return np.asarray(1 - np.searchsorted(values, thresholds, side="right") / values.size)


def interval(statistic: Statistic, *scores: Array, resamples: int = RESAMPLES, covered: float = COVERED, seed: int = 0) -> Array:
    """Return (low, high) of a statistic of one or several score arrays by the bootstrap, (2, *shape of the statistic).

    Raises ParameterError unless all have the same number of evaluation seeds.
    """
    columns = scores[0].shape[1]
    require(all(s.ndim == 2 and s.shape[1] == columns for s in scores), "scores", [s.shape for s in scores], "arrays (runs, evaluation seeds)")
    generator = np.random.default_rng(seed)
    values = []
    for _ in range(resamples):
        chosen = generator.integers(columns, size=columns)
        values.append(statistic(*(s[generator.integers(len(s), size=len(s))][:, chosen] for s in scores)))
    tail = (1 - covered) / 2
    return np.quantile(np.asarray(values), [tail, 1 - tail], axis=0)
