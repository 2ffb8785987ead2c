"""Posterior predictive check: whether the model with the posterior's parameters explains the measured statistics.

Parameters are drawn from the posterior and the measurement is simulated with each. The measured statistics (D,) are compared with
these replicates by two distances: the Mahalanobis distance with a shrunk covariance, which notices many small deviations, and the
largest single deviation. Half of the replicates give mean and covariance; the other half are compared with them in the same way as
the measurement, so that the probability of a distance as large as the measured one needs no distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from optimisation.calibration.inference import (
    Inference,
    Progress,
    StatisticsSimulator,
    simulate_ensemble,
)
from optimisation.calibration.summaries import Statistic

Array = NDArray[np.float64]
REPLICATES = 160
LEAST_PROBABILITY = 0.05  # below it the model does not explain the measurement
BIN_PROBABILITY = 0.01  # of a single statistic, to be listed as not explained
SHRINKAGE = 0.2  # of the covariance towards its diagonal
LEAST_DEVIATION = 0.005  # of a logarithm: levels are not known better than 0.5 %


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """How the measured statistics lie among simulated ones.

    ``quantiles`` (3, D): 5, 50 and 95 % of the replicates' statistics; ``deviations`` (D,): of the measured ones from the
    replicates' mean, in their standard deviations; ``probability``: of a distance at least as large as the measured one if the
    model is right; ``log_score``: logarithm of the replicates' Gaussian density at the measured statistics.
    """

    statistics: tuple[Statistic, ...]
    observed: Array
    quantiles: Array
    deviations: Array
    probability: float
    log_score: float
    replicates: int

    @property
    def explains(self) -> bool:
        """Whether the model explains the measurement."""
        return self.probability >= LEAST_PROBABILITY

    @property
    def failing(self) -> list[int]:
        """Indices of the statistics that are not explained, the worst first; empty where the model explains the measurement."""
        limit = float(scipy.stats.norm.isf(BIN_PROBABILITY / 2))
        if self.explains:
            return []
        order = np.argsort(-np.abs(self.deviations))
        return [int(k) for k in order if abs(self.deviations[k]) > limit] or [int(order[0])]


def standardise(statistics: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation (D,) of replicates, the latter at least `LEAST_DEVIATION`."""
    return np.mean(statistics, axis=0), np.maximum(
        np.std(statistics, axis=0, ddof=1), LEAST_DEVIATION
    )


def tail_probability(distance: Array) -> float:
    """Return the share of replicates with at least the distance of the measurement, which is the last."""
    return float((1 + np.sum(distance[:-1] >= distance[-1])) / len(distance))


def compare_statistics(
    statistics: Sequence[Statistic], simulated: Array, observed: Array
) -> PredictiveCheck:
    """Return how observed statistics (D,) lie among simulated ones (R, D)."""
    half = len(simulated) // 2
    # deviations and covariance come from one half, distances of replicates from the other: these are then as new as the measurement
    probabilities: list[float] = []
    for fitted, fresh in (
        (simulated[:half], simulated[half:]),
        (simulated[half:], simulated[:half]),
    ):
        kinds = split_distances(fitted, fresh, observed)
        probabilities += [tail_probability(distance) for distance in kinds]
    squared = float(np.mean(probabilities[0::2]))
    largest = float(np.mean(probabilities[1::2]))
    mean, deviation = standardise(simulated)
    z = (observed - mean) / deviation
    return PredictiveCheck(
        tuple(statistics),
        observed,
        np.quantile(simulated, [0.05, 0.5, 0.95], axis=0),
        z,
        min(1.0, 2 * min(squared, largest)),
        log_density(simulated, observed),
        len(simulated),
    )


def split_distances(fitted: Array, fresh: Array, observed: Array) -> tuple[Array, Array]:
    """Return both distances (F + 1,) of fresh replicates (F, D), and last of the measurement, from replicates (R, D)."""
    mean, deviation = standardise(fitted)
    z = (np.vstack([fresh, observed]) - mean) / deviation
    values, vectors = np.linalg.eigh(shrunk_correlation((fitted - mean) / deviation))
    white = (z @ vectors) / np.sqrt(values)
    return np.sum(white**2, axis=1), np.max(np.abs(z), axis=1)


def shrunk_correlation(z: Array) -> Array:
    """Return the correlation (D, D) of standardised replicates (R, D), shrunk towards independence."""
    shrunk = (1 - SHRINKAGE) * np.atleast_2d(z.T @ z / len(z))
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)


def log_density(simulated: Array, observed: Array) -> float:
    """Return the logarithm of the Gaussian density of replicates (R, D) at the observed statistics (D,)."""
    mean, deviation = standardise(simulated)
    correlation = shrunk_correlation((simulated - mean) / deviation)
    factor = scipy.linalg.cholesky(correlation, lower=True)
    white = scipy.linalg.solve_triangular(factor, (observed - mean) / deviation, lower=True)
    logs = np.sum(np.log(np.diag(factor))) + np.sum(np.log(deviation))
    return float(-0.5 * np.sum(white**2) - logs - 0.5 * len(observed) * np.log(2 * np.pi))


def check_posterior(
    simulator: StatisticsSimulator,
    statistics: Sequence[Statistic],
    inference: Inference,
    seed: int,
    replicates: int = REPLICATES,
    progress: Progress | None = None,
) -> PredictiveCheck:
    """Return the posterior predictive check; raises KeyboardInterrupt if it is stopped."""
    generator = np.random.default_rng([seed, 4])
    rows = generator.choice(len(inference.shares), replicates, replace=False)
    ensemble = simulate_ensemble(
        simulator, inference.priors, inference.shares[rows], seed, progress
    )
    return compare_statistics(statistics, ensemble.finite.statistics, simulator.observed)
