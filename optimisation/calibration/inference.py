"""Posterior of the free parameters from rounds of simulated ensembles.

Each round is closer to the measurement. A synthetic likelihood is fitted to the last round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from optimisation.calibration.likelihood import (
    RegressionStatistics,
    SyntheticLikelihood,
    fit_regression_statistics,
    fit_score_statistics,
    fit_synthetic_likelihood,
    polynomial_terms,
    sample_density,
)
from optimisation.calibration.parameters import Prior

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
FIRST_RUNS = 256  # simulated measurements of the whole prior
ROUND_RUNS = 128  # of each further round
ROUNDS = 6  # further rounds at most
LEAST_ROUNDS = 2
DRAWS = 2000  # of the posterior
PRIOR_DEGREE = 3  # of the means over the whole prior, at most
LOCAL_DEGREE = 2  # and near the posterior
RUNS_PER_TERM = 8  # simulations for each coefficient of the means
LEAST_NEAR = 240  # simulations near the posterior that the likelihood is fitted to
INFLATION = 1.5  # of the posterior's deviations, for the parameters of the next round
SENSITIVE_SHARE = 0.1  # of a statistic's variance that the parameters explain, in the whole prior
MOVED = 0.35  # posterior deviations, by which a settled posterior moves at most
WIDENED = 1.25  # factor by which its deviations change at most
MOST_FAILED = 0.2  # of all runs


class StatisticsSimulator(Protocol):
    """Simulator of summary statistics."""

    @property
    def observed(self) -> Array:
        """Observed statistics (D,)."""

    def simulate(
        self, names: Sequence[str], values: Array, seed: int, progress: Progress | None = None
    ) -> Array:
        """Return statistics (N, D) at values (N, P)."""


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Simulated measurements: shares (N, P) of the priors, and statistics (N, D)."""

    shares: Array
    statistics: Array

    def join(self, other: Ensemble) -> Ensemble:
        """Return the simulations of both ensembles."""
        return Ensemble(
            np.concatenate([self.shares, other.shares]),
            np.concatenate([self.statistics, other.statistics]),
        )

    def select(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> Ensemble:
        """Return the simulations of a mask, or with these indices."""
        return Ensemble(self.shares[which], self.statistics[which])

    @property
    def finite(self) -> Ensemble:
        """The simulations that did not fail."""
        return self.select(np.all(np.isfinite(self.statistics), axis=1))


@dataclass(frozen=True, eq=False)
class StatisticSensitivity:
    """Information of each of D statistics about the P parameters.

    Attributes
    ----------
    explained : array, (D,)
        Share of its variance over the prior that a cubic polynomial of the parameters explains, by
        cross-validation.
    shifts : array, (D, P)
        Change over the middle 90 % of each parameter's prior, in deviations of its scatter.
    used : array of bool, (D,)
        Whether the statistic is used.
    """

    explained: Array
    shifts: Array
    used: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Inference:
    """The posterior and the rounds of simulations from which it was computed.

    Attributes
    ----------
    priors : tuple of Prior
        Prior distributions, (P,).
    shares, values : array, (N, P)
        Draws of the posterior, as shares of the priors and in SI units.
    sensitivity : StatisticSensitivity
        Information of the statistics.
    statistic : RegressionStatistics
        Linear statistics of the last round.
    likelihood : SyntheticLikelihood
        Likelihood of the last round.
    history : array, (R, 2, P)
        Medians and deviations of each round, in shares.
    settled : bool
        Whether the last two rounds agree.
    ensemble : Ensemble
        All simulated measurements.
    """

    priors: tuple[Prior, ...]
    shares: Array
    values: Array
    sensitivity: StatisticSensitivity
    statistic: RegressionStatistics
    likelihood: SyntheticLikelihood
    history: Array
    settled: bool
    ensemble: Ensemble

    @property
    def runs(self) -> int:
        """Number of simulated measurements."""
        return len(self.ensemble.shares)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(one.name for one in self.priors)


def values_at(priors: Sequence[Prior], shares: Array) -> Array:
    """Return values (N, P) in SI units at shares (N, P) of the priors."""
    return np.stack([prior.at(shares[:, k]) for k, prior in enumerate(priors)], axis=1)


def prior_shares(priors: Sequence[Prior], runs: int, seed: int) -> Array:
    """Return shares (N, P) that fill the prior evenly (scrambled Sobol points)."""
    sampler = scipy.stats.qmc.Sobol(len(priors), rng=np.random.default_rng([seed, 1]))
    power = int(np.ceil(np.log2(max(runs, 2))))
    return np.asarray(sampler.random_base2(power)[:runs])


def simulate_ensemble(
    simulator: StatisticsSimulator,
    priors: Sequence[Prior],
    shares: Array,
    seed: int,
    progress: Progress | None = None,
) -> Ensemble:
    """Return simulated measurements at shares (N, P) of the priors."""
    names = [one.name for one in priors]
    values = values_at(priors, shares)
    return Ensemble(shares, simulator.simulate(names, values, seed, progress))


def measure_sensitivity(ensemble: Ensemble) -> StatisticSensitivity:
    """Return the information of each statistic about the parameters.

    ``ensemble`` are simulations over the whole prior.
    """
    shares = ensemble.shares
    statistics = ensemble.statistics
    degree = degree_for(len(shares), shares.shape[1], PRIOR_DEGREE)
    terms = polynomial_terms(shares, degree)
    left, _, _ = np.linalg.svd(terms, full_matrices=False)
    leverage = np.sum(left**2, axis=1)
    fitted = left @ (left.T @ statistics)
    residual = (statistics - fitted) / np.maximum(1 - leverage, 1e-6)[:, None]
    variance = np.var(statistics, axis=0)
    safe = np.where(variance > 0, variance, 1.0)
    explained = np.where(variance > 0, 1 - np.mean(residual**2, axis=0) / safe, 0.0)
    coefficients = np.linalg.lstsq(terms, statistics, rcond=None)[0]
    scatter = np.sqrt(np.maximum(np.mean(residual**2, axis=0), 1e-30))
    middle = np.full((1, shares.shape[1]), 0.5)
    shifts = np.empty((statistics.shape[1], shares.shape[1]))
    for p in range(shares.shape[1]):
        low = middle.copy()
        high = middle.copy()
        low[0, p] = 0.05
        high[0, p] = 0.95
        change = (polynomial_terms(high, degree) - polynomial_terms(low, degree)) @ coefficients
        shifts[:, p] = change[0] / scatter
    used = explained > SENSITIVE_SHARE
    if np.sum(used) < shares.shape[1]:
        used = np.zeros(len(explained), dtype=bool)
        used[np.argsort(-explained)[: max(shares.shape[1], 4)]] = True
    return StatisticSensitivity(explained, shifts, used)


def degree_for(runs: int, parameters: int, most: int) -> int:
    """Return the largest degree of a polynomial with `RUNS_PER_TERM` runs for each term.

    The degree is at least 1.
    """
    degree = 1
    for candidate in range(2, most + 1):
        terms = polynomial_terms(np.zeros((1, parameters)), candidate).shape[1]
        if runs >= RUNS_PER_TERM * terms:
            degree = candidate
    return degree


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """Points within a squared Mahalanobis distance ``reach`` of a centre (P,)."""

    centre: Array
    covariance: Array
    reach: float

    def distance(self, points: Array) -> Array:
        """Return the squared distance (N,) of points (N, P)."""
        apart = points - self.centre
        return np.asarray(np.sum((apart @ self.precision) * apart, axis=1))

    @cached_property
    def precision(self) -> Array:
        """Inverse of the covariance, (P, P)."""
        return np.asarray(np.linalg.inv(self.covariance + 1e-8 * np.eye(len(self.centre))))

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Return whether points (N, P) are inside, (N,)."""
        return self.distance(points) <= self.reach


def find_neighbourhood(ensemble: Ensemble, draws: Array, least: int = LEAST_NEAR) -> Neighbourhood:
    """Return the neighbourhood in which the next posterior is computed.

    It is the ellipsoid of the draws, inflated, and wide enough to contain ``least`` simulations.
    """
    near = Neighbourhood(np.median(draws, axis=0), np.atleast_2d(np.cov(draws.T)), np.inf)
    reach = INFLATION**2 * float(np.quantile(near.distance(draws), 0.99))
    if least > 0:
        own = np.sort(near.distance(ensemble.shares))
        reach = max(reach, float(own[min(least, len(own)) - 1]))
    return replace(near, reach=reach)


def fit_posterior(
    ensemble: Ensemble,
    observed: Array,
    used: NDArray[np.bool_],
    near: Neighbourhood | None,
    generator: np.random.Generator,
) -> tuple[Array, RegressionStatistics, SyntheticLikelihood]:
    """Return draws (N, P) of an ensemble's posterior, the linear statistics and the likelihood.

    Only simulations in the neighbourhood ``near`` are used, because means and variances would be
    extrapolated beyond it. None: the whole prior. ``used`` (D,) are the statistics that count.
    """
    if near is None:
        shares = ensemble.shares
        statistic, values = fit_regression_statistics(shares, ensemble.statistics[:, used])
        degree = degree_for(len(values), values.shape[1], PRIOR_DEGREE)
    else:
        inside = near.contains(ensemble.shares)
        shares = ensemble.shares[inside]
        statistic, values = fit_score_statistics(
            shares, ensemble.statistics[inside][:, used], near.centre
        )
        degree = degree_for(len(values), values.shape[1], LOCAL_DEGREE)
    likelihood = fit_synthetic_likelihood(shares, values, degree)
    target = statistic.compute(observed[None, used])[0]

    def log_density(points: Array) -> Array:
        density = likelihood.log_density(points, target)
        return density if near is None else np.where(near.contains(points), density, -np.inf)

    return sample_density(log_density, shares, DRAWS, generator), statistic, likelihood


def propose(draws: Array, runs: int, generator: np.random.Generator) -> Array:
    """Return the shares (N, P) of the next round of simulations.

    They are draws of the posterior with random shifts that inflate their deviations, reflected into
    0 to 1.
    """
    chosen = draws[generator.integers(len(draws), size=runs)]
    covariance = np.atleast_2d(np.cov(draws.T)) + 1e-8 * np.eye(draws.shape[1])
    factor = np.linalg.cholesky((INFLATION**2 - 1) * covariance)
    moved = chosen + generator.standard_normal(chosen.shape) @ factor.T
    folded = np.mod(moved, 2.0)
    return np.where(folded > 1, 2 - folded, folded)


def infer(
    simulator: StatisticsSimulator,
    priors: Sequence[Prior],
    *,
    seed: int = 0,
    first: Ensemble | None = None,
    first_runs: int = FIRST_RUNS,
    round_runs: int = ROUND_RUNS,
    rounds: int = ROUNDS,
    simulate: Callable[[Array, int], Ensemble] | None = None,
) -> Inference:
    """Return the posterior of the free parameters given the observed statistics.

    Parameters
    ----------
    simulator : StatisticsSimulator
        Simulates the measurement; has the observed statistics.
    priors : sequence of Prior
        Prior distributions, (P,).
    seed : int
        Seed of everything random.
    first : Ensemble, optional
        Simulations over the whole prior, where there are some already.
    first_runs, round_runs, rounds : int
        Simulated measurements of the whole prior and of each further round, and the number of these
        at most.
    simulate : callable, optional
        Returns the ensemble at shares of a round, such as from a checkpoint; default: by the
        simulator.

    Returns
    -------
    Inference

    Raises
    ------
    ParameterError
        For fewer statistics than parameters, and where too many runs fail.
    KeyboardInterrupt
        If it is stopped.

    """
    observed = simulator.observed
    require(
        len(observed) >= len(priors),
        "statistics",
        len(observed),
        (
            f"{len(priors)} or more, as many as there are free parameters: measure longer, or at "
            "more forces"
        ),
    )
    if simulate is None:

        def simulate(shares: Array, number: int) -> Ensemble:
            return simulate_ensemble(simulator, priors, shares, round_seed(seed, number))

    if first is None:
        first = simulate(prior_shares(priors, first_runs, seed), 0)
    ensemble = require_runs(first)
    sensitivity = measure_sensitivity(ensemble)
    generator = np.random.default_rng([seed, 2])
    draws, statistic, likelihood = fit_posterior(
        ensemble, observed, sensitivity.used, None, generator
    )
    history = [(np.median(draws, axis=0), np.std(draws, axis=0))]
    settled = False
    for number in range(1, rounds + 1):
        more = simulate(propose(draws, round_runs, generator), number)
        ensemble = ensemble.join(require_runs(more))
        near = find_neighbourhood(ensemble, draws)
        draws, statistic, likelihood = fit_posterior(
            ensemble, observed, sensitivity.used, near, generator
        )
        history.append((np.median(draws, axis=0), np.std(draws, axis=0)))
        settled = is_settled(history)
        if settled and number >= LEAST_ROUNDS:
            break
    return Inference(
        tuple(priors),
        draws,
        values_at(priors, draws),
        sensitivity,
        statistic,
        likelihood,
        np.array(history),
        settled,
        ensemble,
    )


def round_seed(seed: int, number: int) -> int:
    """Return the seed of the simulations of a round."""
    return int(np.random.SeedSequence([seed, 3, number]).generate_state(1)[0])


def require_runs(ensemble: Ensemble) -> Ensemble:
    """Return the simulations that did not fail; raise ParameterError if too many failed."""
    finite = ensemble.finite
    failed = len(ensemble.shares) - len(finite.shares)
    if failed > MOST_FAILED * len(ensemble.shares):
        raise ParameterError(
            f"free = {failed} failed runs of {len(ensemble.shares)} is not allowed: narrower "
            "ranges, "
            f"with which at most {100 * MOST_FAILED:.0f} % of the runs use up their budget of "
            "events"
        )
    return finite


def is_settled(history: Sequence[tuple[Array, Array]]) -> bool:
    """Return whether the posteriors of the last two rounds agree in medians and deviations."""
    (old_median, old_deviation), (median, deviation) = history[-2:]
    ratio = deviation / np.maximum(old_deviation, 1e-12)
    moved = np.abs(median - old_median) / np.maximum(deviation, 1e-12)
    return bool(
        np.all(moved <= MOVED) and np.all(ratio <= WIDENED) and np.all(ratio >= 1 / WIDENED)
    )
