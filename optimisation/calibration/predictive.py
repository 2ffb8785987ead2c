"""Posterior predictive check: whether the model explains the measured statistics.

Parameters are drawn from the posterior and the measurement is simulated with each draw. Deviations
that other values of the parameters would remove do not contradict the model. Therefore parameters
are fitted to the D statistics of each simulated measurement and of the real one. The mean
statistics of simulations, as a function of the fitted parameters, are subtracted from the
statistics. The residuals are summarised by three distances: the Mahalanobis distance with a shrunk
covariance, which is sensitive to many small deviations; the largest single deviation; and, with
several measurements, the difference between the parameters fitted to each measurement. The
probability of a distance as large as that of the real measurement is the share of simulations with
such a distance; no distribution is assumed.

Here a replicate is a measurement simulated with a draw of the posterior.
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
REPLICATES = 160  # simulated measurements
LEAST_PROBABILITY = 0.05  # below it the model does not explain the measurement
BIN_PROBABILITY = 0.01  # of a single statistic, to be listed as not explained
SHRINKAGE = 0.2  # of the covariance towards its diagonal
LEAST_DEVIATION = 0.005  # of a logarithm: levels are not known to better than 0.5 %
PARTS = 4  # of the simulations: distances in each part use mean and covariance of the other parts
# standard deviations from the mean at which fitted parameters are clipped: no extrapolation beyond
MOST_DEVIATIONS = 6.0


@dataclass(frozen=True, eq=False)
class MeasurementEstimate:
    """Parameters estimated from one measurement alone.

    ``shares``: estimates (P,), from 0 to 1 as shares of the prior distributions. ``scatter``:
    standard deviation (P,) of the errors of such estimates in simulations.
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
        Residuals of the measured statistics from the mean statistics at the fitted parameters,
        divided by the standard deviation of the simulations' residuals.
    probability : float
        p-value of all distances together: probability that they are at least as unusual as the
        measured ones if the model is right.
    log_score : float
        Logarithm of the replicates' Gaussian density at the measured statistics.
    simulations : int
        Number of simulations with whose distances the measured ones are compared.
    estimates : tuple of MeasurementEstimate
        Parameters fitted to each of several measurements alone; empty for one measurement.
    contradiction : float
        p-value of the difference between these estimates, 1 for one measurement.
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
        """Predictive score for the comparison of models; the higher, the better.

        It is the log score less half the number of fitted parameters, because the fit to the same
        data raises the log score. In a linear normal model with n data and p parameters, the mean
        squared distance from the fitted prediction is n - p for these data and n for new data. The
        log score of these data is therefore higher by p/2.
        """
        return self.log_score - 0.5 * self.parameters

    @property
    def explains(self) -> bool:
        """Whether the model explains the measurement: ``probability`` >= `LEAST_PROBABILITY`."""
        return self.probability >= LEAST_PROBABILITY

    @property
    def failing(self) -> list[int]:
        """Indices of the statistics that the model does not explain, by descending deviation.

        The list is empty if the model explains the measurement, and otherwise has at least the
        statistic with the largest deviation.
        """
        limit = float(scipy.stats.norm.isf(BIN_PROBABILITY / 2))
        if self.explains:
            return []
        order = np.argsort(-np.abs(self.deviations))
        return [int(k) for k in order if abs(self.deviations[k]) > limit] or [int(order[0])]


def standardise(statistics: Array) -> tuple[Array, Array]:
    """Return mean (D,) and standard deviation (D,) of ``statistics`` (N, D).

    The standard deviation is at least `LEAST_DEVIATION`.
    """
    return np.mean(statistics, axis=0), np.maximum(
        np.std(statistics, axis=0, ddof=1), LEAST_DEVIATION
    )


def subtract_fit(
    estimates: Array, statistics: Array, own_estimate: Array, observed: Array
) -> tuple[Array, Array]:
    """Return residuals of simulated ``statistics`` (N, D) and of ``observed`` ones (D,).

    The residuals (N, D) and (D,) are those from quadratic polynomials of the parameters fitted to
    each simulation (``estimates``, (N, P)) or to the observation (``own_estimate``, (P,)). The
    polynomials are fitted to the simulations; a simulation's residual is that of the fit to all
    other simulations.
    """
    mean = np.mean(estimates, axis=0)
    deviation = np.maximum(np.std(estimates, axis=0), 1e-9)

    def terms_of(points: Array) -> Array:
        """Return the terms (N, C) of the polynomials at estimates (N, P), which are clipped."""
        z = np.clip((points - mean) / deviation, -MOST_DEVIATIONS, MOST_DEVIATIONS)
        return polynomial_terms(0.5 + z / (2 * MOST_DEVIATIONS), 2)

    terms = terms_of(estimates)
    left, _, _ = np.linalg.svd(terms, full_matrices=False)
    leverage = np.minimum(np.sum(left**2, axis=1), 0.9)
    coefficients = np.linalg.lstsq(terms, statistics, rcond=None)[0]
    # division by 1 - leverage gives the residual of the fit without the simulation itself
    residuals = (statistics - terms @ coefficients) / (1 - leverage)[:, None]
    return residuals, observed - (terms_of(own_estimate[None]) @ coefficients)[0]


def measure_distances(simulated: Array, observed: Array) -> Array:
    """Return distances (2, N + 1) of N simulated residuals (N, D) and, last, of the observed (D,).

    They are the squared Mahalanobis distance, and the largest deviation in standard deviations.
    Mean and covariance for a simulation are those of the other `PARTS` - 1 parts; the observed
    distances are averages over the parts.
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
    """Return the share of ``distances`` (N,) that are at least as large, for each of them, (N,)."""
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
    """Return the check of observed statistics (D,) against simulated ones (N, D).

    Its ``estimates`` are empty.

    Parameters
    ----------
    statistics : sequence of Statistic
        Names of the statistics, (D,).
    simulated : array, (N, D)
        Statistics of simulations near the posterior.
    observed : array, (D,)
        Measured statistics.
    estimates : tuple of arrays (N, P) and (P,), optional
        Parameters fitted to each simulation and to the measurement. None: no parameter is fitted.
    replicates : array, (R, D), optional
        Statistics of simulations with draws of the posterior, for quantiles and score. None: all
        simulations.
    contradiction : array, (N + 1,), optional
        Difference between the estimates from single measurements (`estimate_by_measurement`), a
        third distance. None: one measurement.

    Returns
    -------
    PredictiveCheck
        The check.
    """
    residuals = simulated - np.mean(simulated, axis=0)
    own_residuals = observed - np.mean(simulated, axis=0)
    if estimates is not None:
        residuals, own_residuals = subtract_fit(estimates[0], simulated, estimates[1], observed)
    distances = measure_distances(residuals, own_residuals)
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
        own_residuals / standardise(residuals)[1],
        p_value,
        log_density(drawn, observed),
        len(simulated),
        contradiction=differ,
        parameters=0 if estimates is None else len(estimates[1]),
    )


def shrunk_correlation(z: Array) -> Array:
    """Return the correlation (D, D) of standardised statistics (N, D), shrunk towards 0.

    Entries off the diagonal are multiplied by 1 - `SHRINKAGE`.
    """
    shrunk = (1 - SHRINKAGE) * np.atleast_2d(z.T @ z / len(z))
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)


def log_density(simulated: Array, observed: Array) -> float:
    """Return the logarithm of a Gaussian density at the ``observed`` statistics (D,).

    Its mean is that of the statistics ``simulated`` (R, D), its covariance theirs with the
    correlation of `shrunk_correlation`.
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
    """Return the parameters estimated from each measurement alone, and the estimates' difference.

    The difference (N + 1,) is the squared Mahalanobis distance of the vector that consists of the
    estimates from each measurement less those from the last measurement: for N simulations and,
    last, for the real measurements. With one measurement there are no estimates, and the difference
    is None.

    Parameters
    ----------
    statistics : sequence of Statistic
        Names of the statistics, (D,).
    used : array of bool, (D,)
        Statistics from which parameters are estimated.
    shares : array, (N, P)
        Parameters of the simulations as shares of their priors.
    simulated : array, (N, D)
        Statistics of the simulations.
    observed : array, (D,)
        Measured statistics.
    centre : array, (P,)
        Shares near which the estimates are most accurate, see `fit_score_statistics`.
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
    """Return the posterior predictive check of an inference.

    ``replicates`` is the number of new simulations with draws of the posterior; in addition, those
    simulations of the inference that are near the posterior are used. Results depend on ``seed``.
    Raises KeyboardInterrupt if the simulations are interrupted.
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
