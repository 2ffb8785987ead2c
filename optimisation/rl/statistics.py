"""What can be said of policies from few training runs, beside the means and intervals of `impact_env.envs.evaluation`: profiles, chances.

The measures are those of R. Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical Precipice", with one task. Scores
are arrays (R, E): R training runs (1 for a policy that is not trained), E evaluation seeds, which are the same for all. Intervals resample both, the
runs of each policy among themselves and the evaluation seeds in common (A. B. Owen 2007, "The pigeonhole bootstrap"), so that neither many
episodes of one run nor many runs on one seed pass for independent evidence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Array = NDArray[np.float64]


def improvement(scores: Array, others: Array) -> float:
    """Return the chance that a score is above one of ``others``, both drawn at random; a tie counts half (Mann and Whitney's U)."""
    first, second = np.ravel(scores), np.ravel(others)
    ranks = rankdata(np.concatenate([first, second]))[: first.size]
    return float((ranks.sum() - first.size * (first.size + 1) / 2) / (first.size * second.size))


def normalised(scores: Array, zero: Array, one: Array) -> float:
    """Return the mean score on the scale where the mean of ``zero`` is 0 and that of ``one`` is 1."""
    return float((scores.mean() - zero.mean()) / (one.mean() - zero.mean()))


def profile(scores: Array, thresholds: Array) -> Array:
    """Return the share of scores above each threshold (T,)."""
    values = np.sort(np.ravel(scores))
    return np.asarray(1 - np.searchsorted(values, thresholds, side="right") / values.size)
