"""Posterior predictive check: whether the model explains the measured statistics.

Parameters are drawn from the posterior and the measurement is simulated with each draw. Deviations
that other values of the parameters would remove do not contradict the model. The statistics (D,) of
a simulated or real measurement are therefore compared with the mean statistics of simulations with
the same fitted parameters. The residuals are summarised by three distances: the Mahalanobis
distance with a shrunk covariance, which is sensitive to many small deviations; the largest single
deviation; and, with several measurements, the difference between the parameters fitted to each
measurement. The distances of the simulations give the probability of a distance as large as the
real measurement's without an assumed distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from optimisation.calibration.inference import (
    Inference,
    Progress,
    StatisticsSimulator,
    find_neighbourhood,
    simulate_ensemble,
)
from optimisation.calibration.likelihood import fit_score_statistics, polynomial_terms
from optimisation.calibration.summaries import Statistic

Array = NDArray[np.float64]
REPLICATES = 160
LEAST_PROBABILITY = 0.05  # below it the model does not explain the measurement
BIN_PROBABILITY = 0.01  # of a single statistic, to be listed as not explained
SHRINKAGE = 0.2  # of the covariance towards its diagonal
LEAST_DEVIATION = 0.005  # of a logarithm: levels are not known better than 0.5 %
PARTS = 4  # of the simulations: each has distances by covariances of the others
MOST_DEVIATIONS = (
    6.0  # of a fitted parameter from the mean of simulations: the means are not extrapolated
)


@dataclass(frozen=True, eq=False)
class MeasurementEstimate:
    """Parameters estimated from one measurement alone.

    ``shares``: estimates (P,) as shares of the priors. ``scatter``: their scatter (P,) among
    simulations.
    """

    measurement: str
    shares: Array
    scatter: Array


@dataclass(frozen=True, eq=False)
class PredictiveCheck:
    """Position of the measured statistics among simulated ones.

    Attributes
    ----------
    statistics : tuple of Statistic
        Names of the statistics, (D,).
    observed : array, (D,)
        Measured statistics.
    quantiles : array, (3, D)
        5, 50 and 95 % quantiles of the replicates' statistics.
    deviations : array, (D,)
        Deviations of the measured statistics from those of the fitted parameters, in standard
        deviations of simulations.
    probability : float
        Probability of a distance at least as large as the measured one if the model is right.
    log_score : float
        Logarithm of the replicates' Gaussian density at the measured statistics.
    simulations : int
        Number of simulations with whose distances the measured one is compared.
    estimates : tuple of MeasurementEstimate
        Parameters fitted to each of several measurements.
    contradiction : float
        Probability of estimates that differ at least as much, 1 for one measurement.
    parameters : int
        Number of fitted parameters.
    """

    statistics: tuple[Statistic, ...]
    observed: Array
    quantiles: Array
    deviations: Array
    probability: float
    log_score: float
    simulations: int
    estimates: tuple[MeasurementEstimate, ...] = ()
    contradiction: float = 1.0
    parameters: int = 0

    @property
    def score(self) -> float:
        """Predictive score for the comparison of models.

        It is the log score less half the number of fitted parameters.

        In a linear normal model with n data and p parameters the squared distance of the data from
        a prediction that was fitted to them is n - p in the mean, and n for new data: the log score
        of the former is higher by p / 2.
        """
        return self.log_score - 0.5 * self.parameters

    @property
    def explains(self) -> bool:
        """Whether the model explains the measurement."""
        return self.probability >= LEAST_PROBABILITY

    @property
    def failing(self) -> list[int]:
        """Indices of the statistics that are not explained, the worst first.

        The list is empty if the model explains the measurement.
        """
        limit = float(scipy.stats.norm.isf(BIN_PROBABILITY / 2))
        if self.explains:
            return []
        order = np.argsort(-np.abs(self.deviations))
        return [int(k) for k in order if abs(self.deviations[k]) > limit] or [int(order[0])]


def standardise(statistics: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation (D,) of replicates.

    The standard deviation is at least `LEAST_DEVIATION`.
    """
    return np.mean(statistics, axis=0), np.maximum(
        np.std(statistics, axis=0, ddof=1), LEAST_DEVIATION
    )


def subtract_fit(
    estimates: Array, statistics: Array, own_estimate: Array, observed: Array
) -> tuple[Array, Array]:
    """Return residuals of simulated statistics (N, D) and of observed ones (D,) from a fit.

    The fit is a quadratic polynomial of the parameters' ``estimates`` (N, P), for each simulation
    without itself. ``own_estimate`` (P,) is the estimate for the observed statistics.
    """
    mean = np.mean(estimates, axis=0)
    deviation = np.maximum(np.std(estimates, axis=0), 1e-9)

    def terms_of(points: Array) -> Array:
        z = np.clip((points - mean) / deviation, -MOST_DEVIATIONS, MOST_DEVIATIONS)
        return polynomial_terms(0.5 + z / (2 * MOST_DEVIATIONS), 2)

    terms = terms_of(estimates)
    left, _, _ = np.linalg.svd(terms, full_matrices=False)
    leverage = np.minimum(np.sum(left**2, axis=1), 0.9)
    coefficients = np.linalg.lstsq(terms, statistics, rcond=None)[0]
    rest = (statistics - terms @ coefficients) / (1 - leverage)[:, None]
    return rest, observed - (terms_of(own_estimate[None]) @ coefficients)[0]


def measure_distances(simulated: Array, observed: Array) -> Array:
    """Return distances (2, N + 1) of simulated residuals (N, D), and last of the observed one.

    The two distances are the Mahalanobis distance and the largest deviation.
    """
    count = len(simulated)
    part = np.arange(count) % PARTS
    distances = np.zeros((2, count + 1))
    for k in range(PARTS):
        others = simulated[part != k]
        own = np.flatnonzero(part == k)
        mean, deviation = standardise(others)
        values, vectors = np.linalg.eigh(shrunk_correlation((others - mean) / deviation))
        z = (np.vstack([simulated[own], observed]) - mean) / deviation
        white = (z @ vectors) / np.sqrt(values)
        both = np.stack([np.sum(white**2, axis=1), np.max(np.abs(z), axis=1)])
        distances[:, own] = both[:, :-1]
        distances[:, -1] += both[:, -1] / PARTS
    return distances


def tail_probabilities(distances: Array) -> Array:
    """Return, for each of (N,) distances, the share of all that are at least as large."""
    ordered = np.sort(distances)
    below = np.searchsorted(ordered, distances, side="left")
    return np.asarray((len(distances) - below) / len(distances))


def compare_statistics(
    statistics: Sequence[Statistic],
    simulated: Array,
    observed: Array,
    estimates: tuple[Array, Array] | None = None,
    replicates: Array | None = None,
    contradiction: Array | None = None,
) -> PredictiveCheck:
    """Return how observed statistics (D,) lie among simulated ones (N, D).

    Parameters
    ----------
    statistics : sequence of Statistic
        Names of the statistics, (D,).
    simulated : array, (N, D)
        Statistics of simulations near the posterior.
    observed : array, (D,)
        Measured statistics.
    estimates : tuple of arrays (N, P) and (P,), optional
        Parameters fitted to the simulations and to the measurement. None: no parameter is fitted.
    replicates : array, (R, D), optional
        Simulations with draws of the posterior, from which quantiles and score are computed.
        Default: all.
    contradiction : array, (N + 1,), optional
        Difference between the estimates from single measurements, for each simulation and, last,
        for the measurement.

    """
    rest = simulated - np.mean(simulated, axis=0)
    own_rest = observed - np.mean(simulated, axis=0)
    if estimates is not None:
        rest, own_rest = subtract_fit(estimates[0], simulated, estimates[1], observed)
    distances = measure_distances(rest, own_rest)
    differ = 1.0
    if contradiction is not None:
        distances = np.vstack([distances, contradiction])
        differ = float(tail_probabilities(contradiction)[-1])
    # probability that the most unusual distance of the measurement is at least as unusual, if its
    # distances are drawn from the same distribution as those of the simulations
    least = np.min([tail_probabilities(one) for one in distances], axis=0)
    p_value = float(np.mean(least <= least[-1]))
    drawn = simulated if replicates is None else replicates
    return PredictiveCheck(
        tuple(statistics),
        observed,
        np.quantile(drawn, [0.05, 0.5, 0.95], axis=0),
        own_rest / standardise(rest)[1],
        p_value,
        log_density(drawn, observed),
        len(simulated),
        contradiction=differ,
        parameters=0 if estimates is None else len(estimates[1]),
    )


def shrunk_correlation(z: Array) -> Array:
    """Return the correlation (D, D) of standardised replicates (R, D).

    It is shrunk towards independence.
    """
    shrunk = (1 - SHRINKAGE) * np.atleast_2d(z.T @ z / len(z))
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)


def log_density(simulated: Array, observed: Array) -> float:
    """Return the logarithm of the Gaussian density at the observed statistics (D,).

    Mean and covariance are those of the replicates ``simulated`` (R, D).
    """
    mean, deviation = standardise(simulated)
    correlation = shrunk_correlation((simulated - mean) / deviation)
    factor = scipy.linalg.cholesky(correlation, lower=True)
    white = scipy.linalg.solve_triangular(factor, (observed - mean) / deviation, lower=True)
    logs = np.sum(np.log(np.diag(factor))) + np.sum(np.log(deviation))
    return float(-0.5 * np.sum(white**2) - logs - 0.5 * len(observed) * np.log(2 * np.pi))


def estimate_by_measurement(
    statistics: Sequence[Statistic],
    used: NDArray[np.bool_],
    shares: Array,
    simulated: Array,
    observed: Array,
    centre: Array,
) -> tuple[tuple[MeasurementEstimate, ...], Array | None]:
    """Return each measurement's own estimate of the parameters, and their difference.

    The difference is (N + 1,), or None for one measurement.

    The difference is the Mahalanobis distance of the estimates of all measurements but the last
    from those of the last, over simulations (N, D) at shares (N, P) of the priors, and last of the
    observed statistics (D,).
    """
    names = list(dict.fromkeys(one.measurement for one in statistics))
    if len(names) < 2:
        return (), None
    estimates = []
    columns = []
    for name in names:
        own = used & np.array([one.measurement == name for one in statistics])
        if not np.any(own):
            continue
        statistic, values = fit_score_statistics(shares, simulated[:, own], centre)
        measured = statistic.compute(observed[None, own])
        estimates.append(MeasurementEstimate(name, measured[0], np.std(values - shares, axis=0)))
        columns.append(np.vstack([values, measured]))
    if len(columns) < 2:
        return tuple(estimates), None
    apart = np.hstack([column - columns[-1] for column in columns[:-1]])
    apart = apart - np.mean(apart[:-1], axis=0)
    inverse = np.linalg.pinv(np.atleast_2d(np.cov(apart[:-1].T)), hermitian=True)
    return tuple(estimates), np.asarray(np.einsum("nd,de,ne->n", apart, inverse, apart))


def check_posterior(
    simulator: StatisticsSimulator,
    statistics: Sequence[Statistic],
    inference: Inference,
    seed: int,
    replicates: int = REPLICATES,
    progress: Progress | None = None,
) -> PredictiveCheck:
    """Return the posterior predictive check; raises KeyboardInterrupt if it is stopped.

    Simulations of the inference near the posterior are used in addition to ``replicates`` new ones.
    """
    generator = np.random.default_rng([seed, 4])
    rows = generator.choice(len(inference.shares), replicates, replace=False)
    drawn = simulate_ensemble(
        simulator, inference.priors, inference.shares[rows], seed, progress
    ).finite
    near = find_neighbourhood(inference.ensemble, inference.shares, least=0)
    known = inference.ensemble.select(near.contains(inference.ensemble.shares))
    both = known.join(drawn)
    both = both.select(generator.permutation(len(both.shares)))
    used = inference.sensitivity.used
    observed = simulator.observed
    own = inference.statistic.compute(observed[None, used])[0]
    estimates, contradiction = estimate_by_measurement(
        statistics, used, both.shares, both.statistics, observed, near.centre
    )
    check = compare_statistics(
        statistics,
        both.statistics,
        observed,
        (inference.statistic.compute(both.statistics[:, used]), own),
        drawn.statistics,
        contradiction,
    )
    return replace(check, estimates=estimates)
