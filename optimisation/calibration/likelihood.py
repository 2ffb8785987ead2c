"""A Gaussian synthetic likelihood of a few linear statistics, and its posterior by Markov chains.

The D summary statistics are reduced to one statistic for each parameter: over the whole prior by
ridge regression of the parameters on the summary statistics (Fearnhead and Prangle, 2012,
doi:10.1111/j.1467-9868.2011.01010.x), near the posterior by generalised least squares. Mean and
covariance of the reduced statistics, as functions of the parameters, are fitted to the simulated
ensembles and define a Gaussian, the synthetic likelihood (Wood, 2010, doi:10.1038/nature09319).
Parameters are shares (P,) from 0 to 1 of their prior distributions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
LogDensity = Callable[[Array], Array]  # of shares (N, P)
PENALTIES = np.logspace(-6, 3, 28)  # of the ridge regression, over the number of simulations
LOG_CHI2_MEAN = 1.2704  # minus the mean of the logarithm of a squared standard normal number
STRETCH = 2.0  # of the moves of Goodman and Weare (2010)
WALKERS = 60
BURN_IN = 400  # steps
FOLDS = 5
SHRINKAGE = 0.3  # of correlations of summary statistics towards none
PRIOR_PRECISION = 12.0  # one over the variance of a share of the prior
LEAST_DEVIATION = 1e-3  # of a logarithm
LEAST_VARIANCE = 1e-10  # of a regression statistic, in squared shares


@dataclass(frozen=True, eq=False)
class RegressionStatistics:
    """Linear statistics of summary statistics s (D,), one for each parameter.

    They are t = offset + ((s - mean) / scale) weights.
    """

    mean: Array
    scale: Array
    weights: Array
    offset: Array

    def compute(self, statistics: Array) -> Array:
        """Return the regression statistics (N, P) of summary statistics (N, D)."""
        return np.asarray(self.offset + ((statistics - self.mean) / self.scale) @ self.weights)


def fit_regression_statistics(
    shares: Array, statistics: Array
) -> tuple[RegressionStatistics, Array]:
    """Fit the regression statistics to simulations.

    Parameters
    ----------
    shares : array, (N, P)
        Parameters of the simulations.
    statistics : array, (N, D)
        Their summary statistics.

    Returns
    -------
    RegressionStatistics
        Statistics with the penalty that is best in cross-validation.
    array, (N, P)
        The regression statistics of the simulations, each by the fit without it, so that their
        scatter is that of new data.

    """
    mean = np.mean(statistics, axis=0)
    scale = np.std(statistics, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    x = (statistics - mean) / scale
    offset = np.mean(shares, axis=0)
    y = shares - offset
    left, singular, right = np.linalg.svd(x, full_matrices=False)
    best: tuple[float, Array, Array] | None = None
    for penalty in PENALTIES * len(x):
        shrink = singular**2 / (singular**2 + penalty)
        fitted = left @ (shrink[:, None] * (left.T @ y))
        leverage = np.sum(left**2 * shrink, axis=1) + 1 / len(x)
        residual = (y - fitted) / np.maximum(1 - leverage, 1e-6)[:, None]
        error = float(np.sum(np.mean(residual**2, axis=0) / np.var(y, axis=0)))
        if best is None or error < best[0]:
            factors = singular / (singular**2 + penalty)
            best = error, right.T @ (factors[:, None] * (left.T @ y)), residual
    assert best is not None
    _, weights, residual = best
    return RegressionStatistics(mean, scale, weights, offset), shares - residual


def fit_score_statistics(
    shares: Array, statistics: Array, centre: Array
) -> tuple[RegressionStatistics, Array]:
    """Fit the linear statistics that are best near a point in the space of parameters.

    They are best for normal summary statistics whose mean depends linearly on the parameters near
    that point.

    They are the generalised least squares estimates of the parameters, with a shrunk correlation of
    the summary statistics.

    Parameters
    ----------
    shares : array, (N, P)
        Parameters of the simulations.
    statistics : array, (N, D)
        Their summary statistics.
    centre : array, (P,)
        Point near which the parameters are.

    Returns
    -------
    RegressionStatistics
        Estimates of the parameters.
    array, (N, P)
        The estimates of the simulations, each by a fit to `FOLDS` - 1 parts without it.
    """
    values = np.empty(shares.shape)
    fold = np.arange(len(shares)) % FOLDS
    for k in range(FOLDS):
        own = fold == k
        part = _estimate_locally(shares[~own], statistics[~own], centre)
        values[own] = part.compute(statistics[own])
    return _estimate_locally(shares, statistics, centre), values


def _estimate_locally(shares: Array, statistics: Array, centre: Array) -> RegressionStatistics:
    """Return the generalised least squares estimates near a point."""
    parameters = shares.shape[1]
    terms = polynomial_terms(shares, 2)
    coefficients = np.linalg.lstsq(terms, statistics, rcond=None)[0]
    residual = statistics - terms @ coefficients
    deviation = np.maximum(np.std(residual, axis=0), LEAST_DEVIATION)
    z = residual / deviation
    correlation = (1 - SHRINKAGE) * (z.T @ z) / len(z)
    np.fill_diagonal(correlation, 1.0)
    mean = polynomial_terms(centre[None], 2)[0] @ coefficients
    step = 1e-4
    moved = polynomial_terms(centre + step * np.eye(parameters), 2) @ coefficients
    slopes = ((moved - mean) / step / deviation).T
    weighted = np.linalg.solve(correlation, slopes)
    precision = slopes.T @ weighted + PRIOR_PRECISION * np.eye(parameters)
    weights = np.linalg.solve(precision, weighted.T).T
    return RegressionStatistics(mean, deviation, weights, centre)


def polynomial_terms(shares: Array, degree: int) -> Array:
    """Return all products (N, C) of the coordinates 2 share - 1 up to ``degree``.

    The constant comes first.
    """
    x = 2 * shares - 1
    products: dict[tuple[int, ...], Array] = {(): np.ones(len(x))}
    for order in range(1, degree + 1):
        for which in combinations_with_replacement(range(x.shape[1]), order):
            products[which] = products[which[:-1]] * x[:, which[-1]]
    return np.stack(list(products.values()), axis=1)


@dataclass(frozen=True, eq=False)
class SyntheticLikelihood:
    """Gaussian likelihood of regression statistics.

    Their means are polynomials of the parameters, their variances are log-linear, and their
    correlation is constant.

    The variance of the fitted mean, which more simulations lower, is added to the scatter.
    """

    degree: int
    coefficients: Array
    log_variance: Array
    correlation: Array
    gram_inverse: Array

    def log_density(self, shares: Array, observed: Array) -> Array:
        """Return the log-likelihood (N,) of observed statistics (P,) at shares (N, P).

        The observed statistics are regression statistics. Outside of 0 to 1 the result is minus
        infinity.
        """
        inside = np.all((shares >= 0) & (shares <= 1), axis=1)
        clipped = np.clip(shares, 0, 1)
        terms = polynomial_terms(clipped, self.degree)
        linear = terms[:, : shares.shape[1] + 1]
        mean = terms @ self.coefficients
        inflation = 1 + np.sum((terms @ self.gram_inverse) * terms, axis=1)
        deviation = np.exp(linear @ self.log_variance / 2) * np.sqrt(inflation)[:, None]
        white = ((observed - mean) / deviation) @ self.whitening
        density = -0.5 * np.sum(white**2, axis=1) - np.sum(np.log(deviation), axis=1)
        return np.where(inside, density, -np.inf)

    @cached_property
    def whitening(self) -> Array:
        """Whitening matrix (P, P) of statistics with the likelihood's correlation.

        Statistics multiplied by it are independent.
        """
        factor = scipy.linalg.cholesky(self.correlation, lower=True)
        return np.asarray(scipy.linalg.inv(factor).T)


def fit_synthetic_likelihood(shares: Array, values: Array, degree: int) -> SyntheticLikelihood:
    """Fit the likelihood to regression statistics (N, P) of simulations at shares (N, P)."""
    terms = polynomial_terms(shares, degree)
    linear = polynomial_terms(shares, 1)
    weights = np.ones(values.shape)
    log_variance = np.zeros((linear.shape[1], values.shape[1]))
    coefficients = np.zeros((terms.shape[1], values.shape[1]))
    freedom = max(len(terms) - terms.shape[1], 1) / len(terms)
    for _ in range(3):
        for p in range(values.shape[1]):
            root = np.sqrt(weights[:, p])
            coefficients[:, p] = np.linalg.lstsq(
                root[:, None] * terms, root * values[:, p], rcond=None
            )[0]
            residual = values[:, p] - terms @ coefficients[:, p]
            log_variance[:, p] = fit_log_variance(linear, residual**2 / freedom)
            weights[:, p] = np.exp(-linear @ log_variance[:, p])
            weights[:, p] /= np.mean(weights[:, p])
    z = (values - terms @ coefficients) / np.exp(linear @ log_variance / 2)
    correlation = np.asarray(np.atleast_2d(np.corrcoef(z.T)), dtype=np.float64)
    gram = terms.T @ terms
    gram_inverse = np.asarray(np.linalg.pinv(gram, hermitian=True), dtype=np.float64)
    return SyntheticLikelihood(degree, coefficients, log_variance, correlation, gram_inverse)


def fit_log_variance(terms: Array, squares: Array) -> Array:
    """Return the coefficients (C,) of a log-linear variance by maximum likelihood.

    The residuals are normal, with ``squares`` (N,).
    """
    squares = np.maximum(squares, LEAST_VARIANCE)
    start = np.linalg.lstsq(terms, np.log(squares) + LOG_CHI2_MEAN, rcond=None)[0]
    for _ in range(20):  # Newton steps with the expected curvature
        ratio = squares * np.exp(-np.clip(terms @ start, -60, 60))
        step = np.linalg.lstsq(terms, np.clip(ratio, 0, 20) - 1, rcond=None)[0]
        start = start + step
        if np.max(np.abs(step)) < 1e-8:
            break
    return np.asarray(start)


def sample_density(
    log_density: LogDensity, start: Array, draws: int, generator: np.random.Generator
) -> Array:
    """Return draws (N, P) from a density by affine-invariant sampling.

    The method is the stretch moves of Goodman and Weare (2010, doi:10.2140/camcos.2010.5.65).

    Parameters
    ----------
    log_density : callable
        Logarithm of the density, up to a constant, of points (N, P).
    start : array, (M, P)
        Points of which the best begin the chains.
    draws : int
        Number of draws.
    generator : Generator
        Source of random numbers.

    Examples
    --------
    >>> normal = lambda x: -0.5 * np.sum(x**2, axis=1)
    >>> generator = np.random.default_rng(0)
    >>> draws = sample_density(normal, generator.standard_normal((200, 2)), 20_000, generator)
    >>> bool(np.all(np.abs(np.cov(draws.T) - np.eye(2)) < 0.1))
    True
    """
    density = log_density(start)
    order = np.argsort(-density)[: max(WALKERS, len(start) // 8)]
    order = order[np.isfinite(density[order])]
    chosen = generator.choice(order, WALKERS)
    spread = 1e-3 * np.std(start, axis=0)
    positions = start[chosen] + spread * generator.standard_normal((WALKERS, start.shape[1]))
    values = log_density(positions)
    outside = ~np.isfinite(values)
    positions[outside] = start[chosen][outside]
    values[outside] = density[chosen][outside]
    half = WALKERS // 2
    dimension = start.shape[1]
    rounds = -(-draws // WALKERS)
    thinning = 5
    chain = []
    for step in range(BURN_IN + thinning * rounds):
        for own, other in (
            (slice(0, half), slice(half, None)),
            (slice(half, None), slice(0, half)),
        ):
            z = ((STRETCH - 1) * generator.random(half) + 1) ** 2 / STRETCH
            partners = positions[other][generator.integers(half, size=half)]
            proposed = partners + z[:, None] * (positions[own] - partners)
            density = log_density(proposed)
            accept = (
                np.log(generator.random(half)) < (dimension - 1) * np.log(z) + density - values[own]
            )
            positions[own] = np.where(accept[:, None], proposed, positions[own])
            values[own] = np.where(accept, density, values[own])
        if step >= BURN_IN and (step - BURN_IN) % thinning == 0:
            chain.append(positions.copy())
    return np.concatenate(chain)[-draws:]
