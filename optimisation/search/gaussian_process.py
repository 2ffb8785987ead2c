"""A search with a Gaussian process that models the noise of the levels.

It runs one member of a design at a time, and further members of the most promising designs.

The level of one member is one draw from a design's distribution. A member is better spent on
another design than on the same one, as long as a model joins what neighbours say; near the optimum
it is better spent on a further member of a good design (B. Ankenman, B. Nelson and J. Staum,
Stochastic kriging, 2010). The process (Matern 5/2, a length for each coordinate, all by maximum
likelihood) models the logarithm of the cost over the unit cube (`DesignSpace.at`). Each round runs
new designs by Thompson sampling, and another member of designs with the lowest mean.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.ensemble import Executor
from optimisation.problem import Problem, measured_chunks
from optimisation.search.settings import GP, EvaluatedDesign
from optimisation.space import WITH_IMPACTS, Design

Array = NDArray[np.float64]
ROUND_MEMBERS = 8  # members of a round
NEW_SHARE = 0.75  # of them, those of new designs
FIRST_DESIGNS = 16  # evenly spread designs before the first round
CANDIDATE_POINTS = 400  # points among which a round chooses
NEIGHBOURS = 5  # best designs around which half of the candidates lie
NEIGHBOUR_STEPS = (
    0.02,
    0.05,
    0.1,
)  # standard deviations of these candidates, in shares of the ranges
# designs that the process knows at most, which bounds its time: of more the first ones, which are
# spread evenly, and the best
MOST_MODELLED = 600
FIRST_MODELLED = 150
REFIT_GROWTH = 1.15  # of the number of designs, after which the process is fitted again
VIOLATION_WEIGHT = 3.0  # power of 1 + the violation by which a broken constraint raises a cost
COVARIANCE_JITTER = 1e-8  # added to the covariance's diagonal
LENGTH_RANGE = (0.02, 20.0)  # range of the fitted lengths, in shares of the ranges
DEVIATION_RANGE = (1e-3, 10.0)  # of the fitted standard deviation of the mean
NOISE_RANGE = (1e-3, 2.0)  # of the fitted standard deviation of members around it
PRIOR_CENTRES = (0.3, 0.1)  # usual length and noise
PRIOR_WIDTHS = (1.0, 1.5)  # standard deviations of their logarithms


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A Gaussian process of the mean cost, fitted to N designs.

    Attributes
    ----------
    points : array, (N, d)
        Designs in the unit cube.
    means, members : array, (N,)
        Mean cost and number of members of each design.
    square : float
        Sum of squares of the members' values around their designs' means.
    logs : array, (d + 2,)
        Logarithms of the lengths, and of the standard deviations of the mean and of the members.
    """

    points: Array
    means: Array
    members: Array
    square: float
    logs: Array

    def _covariance(self, a: Array, b: Array) -> Array:
        lengths = np.exp(self.logs[:-2])
        r = np.sqrt(5) * scipy.spatial.distance.cdist(a / lengths, b / lengths)
        return np.asarray(np.exp(2 * self.logs[-2]) * (1 + r + r**2 / 3) * np.exp(-r))

    def _factor(self) -> Array:
        noise = np.exp(2 * self.logs[-1]) / self.members + COVARIANCE_JITTER
        covariance = self._covariance(self.points, self.points) + np.diag(noise)
        return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)

    def log_likelihood(self) -> float:
        """Return the log-likelihood of all values up to a constant.

        It includes a weak prior of lengths and noise.
        """
        factor = self._factor()
        white = scipy.linalg.solve_triangular(factor, self.means - self.means.mean(), lower=True)
        of_means = -0.5 * float(white @ white) - float(np.sum(np.log(np.diag(factor))))
        noise = self.logs[-1]
        repeats = float(np.sum(self.members - 1))
        of_members = -repeats * noise - 0.5 * self.square / np.exp(2 * noise)
        lengths = (self.logs[:-2] - np.log(PRIOR_CENTRES[0])) / PRIOR_WIDTHS[0]
        prior = (
            float(np.sum(lengths**2)) + ((noise - np.log(PRIOR_CENTRES[1])) / PRIOR_WIDTHS[1]) ** 2
        )
        return float(of_means + of_members - 0.5 * prior)

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Return mean (K,) and covariance (K, K) of the mean cost at points (K, d)."""
        factor = self._factor()
        cross = scipy.linalg.solve_triangular(
            factor, self._covariance(self.points, points), lower=True
        )
        white = scipy.linalg.solve_triangular(factor, self.means - self.means.mean(), lower=True)
        mean = self.means.mean() + cross.T @ white
        return np.asarray(mean), np.asarray(self._covariance(points, points) - cross.T @ cross)


def fit_process(
    points: Array, values: Sequence[Sequence[float]], logs: Array | None = None, fit: bool = True
) -> GaussianProcess:
    """Return the process of maximum likelihood for designs at ``points`` (N, d).

    ``values``: those of each design's members.

    ``logs`` is where the fit begins; without ``fit`` they are taken as they are.
    """
    means = np.array([np.mean(own) for own in values])
    members = np.array([len(own) for own in values], dtype=np.float64)
    square = float(sum(np.sum((np.array(own) - np.mean(own)) ** 2) for own in values))
    if logs is None:
        lengths = np.full(points.shape[1], np.log(PRIOR_CENTRES[0]))
        logs = np.array(
            [*lengths, np.log(np.std(means) + DEVIATION_RANGE[0]), np.log(PRIOR_CENTRES[1])]
        )
    if not fit:
        return GaussianProcess(points, means, members, square, logs)

    def loss(trial: Array) -> float:
        try:
            return -GaussianProcess(points, means, members, square, trial).log_likelihood()
        except np.linalg.LinAlgError:
            return 1e10

    bounds = np.log([LENGTH_RANGE] * points.shape[1] + [DEVIATION_RANGE, NOISE_RANGE])
    begin = np.clip(logs, *bounds.T)
    options = {"maxiter": 40}
    minimum = scipy.optimize.minimize(
        loss, begin, method="L-BFGS-B", bounds=bounds, options=options
    )
    return GaussianProcess(points, means, members, square, minimum.x)


@dataclass(eq=False)
class DesignRuns:
    """Designs that were run, as points of the unit cube, and their measures.

    A point is (variables,). The measures are (members so far, conditions, up or down, measures).
    """

    problem: Problem
    executor: Executor
    points: list[Array] = field(default_factory=list)
    designs: list[Design] = field(default_factory=list)
    measured: dict[int, Array] = field(default_factory=dict)
    costs: list[list[float]] = field(default_factory=list)
    violations: list[list[float]] = field(default_factory=list)

    @property
    def members(self) -> int:
        """Number of members run, over all designs."""
        return sum(map(len, self.costs))

    def points_of(self, numbers: Sequence[int]) -> Array:
        """Return the points (n, variables) of designs."""
        return np.array([self.points[k] for k in numbers])

    def add(self, points: Array) -> list[int]:
        """Add designs at points (n, variables) and return their numbers."""
        first = len(self.points)
        for point in points:
            self.points.append(np.clip(point, 0.0, 1.0))
            self.designs.append(self.problem.space.at(self.points[-1].tolist()))
            self.costs.append([])
            self.violations.append([])
        return list(range(first, len(self.points)))

    def run_next_member(self, numbers: Sequence[int]) -> None:
        """Run each of these designs for its next member, all in one call."""
        problem = self.problem
        members = [problem.ensemble[len(self.costs[k]) :][:1] for k in numbers]
        chunks = [
            problem.chunks(self.designs[k], member, problem.rate)
            for k, member in zip(numbers, members, strict=True)
        ]
        blocks = iter(measured_chunks([chunk for own in chunks for chunk in own], self.executor))
        sign = -1.0 if problem.objectives[0].maximise else 1.0
        for k, member, own in zip(numbers, members, chunks, strict=True):
            measured = problem.join([next(blocks) for _ in own], 1)
            score = problem.score(self.designs[k], measured, member, problem.rate)
            self.costs[k].append(math.nan if score.failed else sign * score.values[0])
            self.violations[k].append(0.0 if score.failed else score.violation)
            if k in self.measured:
                measured = np.concatenate([self.measured[k], measured])
            self.measured[k] = measured

    def list_evaluated(self) -> list[EvaluatedDesign]:
        """Return all designs with their scores by the members that each was run with."""
        problem = self.problem
        rows = []
        for k, measured in sorted(self.measured.items()):
            ensemble = problem.ensemble[: len(measured)]
            score = problem.score(self.designs[k], measured, ensemble, problem.rate)
            rows.append(EvaluatedDesign(k, self.designs[k], score, 1))
        return rows

    @property
    def positive(self) -> bool:
        """Whether all costs are above 0, so that the process models their logarithms."""
        costs = np.array([x for own in self.costs for x in own])
        finite = costs[np.isfinite(costs)]
        return bool(finite.size) and float(finite.min()) > 0

    def transform_values(self) -> list[list[float]]:
        """Return the values of the members of each design in the form that the process models.

        They are logarithms of the cost (the cost itself if it is not always positive), plus
        `VIOLATION_WEIGHT` for a violated constraint; a failed run has the value of the worst one.
        """
        positive = self.positive
        costs = np.array([x for own in self.costs for x in own])
        finite = costs[np.isfinite(costs)]
        weight = VIOLATION_WEIGHT * (1.0 if positive or not finite.size else float(np.std(finite)))
        rows = []
        for own, violations in zip(self.costs, self.violations, strict=True):
            values = np.log(own) if positive else np.array(own)
            rows.append((values + weight * np.log1p(np.array(violations))).tolist())
        worst = max((x for row in rows for x in row if np.isfinite(x)), default=0.0)
        return [[x if np.isfinite(x) else worst for x in row] for row in rows]


def model_search(
    problem: Problem,
    members: int,
    executor: Executor,
    seed: int = 0,
    from_scratch: bool = False,
    progress: Callable[[int], None] | None = None,
    batch: int = ROUND_MEMBERS,
) -> tuple[list[EvaluatedDesign], list[EvaluatedDesign], bool]:
    """Search until about ``members`` members have been run, ``batch`` of them in a round.

    Returns all designs by number; the same designs with their modelled values, the lowest cost
    first; and False if a KeyboardInterrupt ended it early. Begins with the space's start unless
    ``from_scratch``. Raises ParameterError for several objectives, and for concepts without walls.
    """
    with_walls = "an impact absorber: others have hardly any noise"
    require(problem.space.concept in WITH_IMPACTS, "sampler", GP, with_walls)
    require(len(problem.objectives) == 1, "sampler", GP, "one objective")
    budget = count("members", members, 2)
    runs = DesignRuns(problem, executor)
    generator = np.random.default_rng(seed)
    size = len(problem.space.free)
    try:
        if not from_scratch:
            runs.add(np.array([problem.space.shares(problem.space.default)]))
        spread = scipy.stats.qmc.Halton(size, rng=generator)
        runs.add(spread.random(min(FIRST_DESIGNS, budget) - len(runs.points)))
        runs.run_next_member(range(len(runs.points)))
        values = runs.transform_values()
        modelled = select_designs(values)
        process = fit_process(runs.points_of(modelled), values)
        fitted = len(runs.points)
        while runs.members < budget:
            if progress is not None:
                progress(runs.members)
            run_round(runs, modelled, process, generator, batch)
            values = runs.transform_values()
            modelled = select_designs(values)
            again = len(runs.points) >= REFIT_GROWTH * fitted
            fitted = len(runs.points) if again else fitted
            own = [values[k] for k in modelled]
            process = fit_process(runs.points_of(modelled), own, process.logs, again)
    except KeyboardInterrupt:
        return runs.list_evaluated(), [], False
    if progress is not None:
        progress(runs.members)
    every = runs.list_evaluated()
    mean = process.predict(process.points)[0]
    modelled_values = np.exp(mean) if runs.positive else mean
    sign = -1.0 if problem.objectives[0].maximise else 1.0
    ranked = []
    for i in np.argsort(mean, kind="stable"):
        one = every[modelled[i]]
        value = float(sign * modelled_values[i])
        ranked.append(replace(one, score=replace(one.score, values=(value,))))
    return every, ranked, True


def select_designs(values: Sequence[Sequence[float]]) -> list[int]:
    """Return the ascending numbers of the designs that the process uses.

    They are all up to `MOST_MODELLED` designs, else the first ones and those of lowest mean value.
    """
    if len(values) <= MOST_MODELLED:
        return list(range(len(values)))
    means = [float(np.mean(own)) for own in values]
    later = sorted(range(FIRST_MODELLED, len(values)), key=lambda k: (means[k], k))
    return sorted([*range(FIRST_MODELLED), *later[: MOST_MODELLED - FIRST_MODELLED]])


def run_round(
    runs: DesignRuns,
    modelled: Sequence[int],
    process: GaussianProcess,
    generator: np.random.Generator,
    members: int,
) -> None:
    """Run new designs, and further members of promising designs.

    The latter are those of the ``modelled`` designs with the lowest modelled cost.
    """
    mean = process.predict(process.points)[0]
    order = np.argsort(mean, kind="stable")
    candidates = draw_candidates(process.points[order[:NEIGHBOURS]], generator)
    middle, covariance = process.predict(candidates)
    covariance += 1e-6 * np.eye(len(candidates))
    number = max(1, round(NEW_SHARE * members))
    draws = generator.multivariate_normal(middle, covariance, size=number, method="cholesky")
    lowest = list(dict.fromkeys(np.argmin(draws, axis=1).tolist()))
    new = runs.add(candidates[lowest])
    ranked = [modelled[i] for i in order]
    unfinished = [k for k in ranked if len(runs.costs[k]) < runs.problem.members]
    runs.run_next_member([*new, *unfinished[: members - len(new)]])


def draw_candidates(best: Array, generator: np.random.Generator) -> Array:
    """Return points of the unit cube as candidates.

    Half of them are evenly distributed, and half are around the best designs (n, d).
    """
    half = CANDIDATE_POINTS // 2
    even = scipy.stats.qmc.Halton(best.shape[1], rng=generator).random(half)
    step = generator.choice(NEIGHBOUR_STEPS, size=(half, 1))
    around = best[generator.integers(len(best), size=half)]
    near = around + step * generator.normal(size=(half, best.shape[1]))
    return np.clip(np.vstack([even, near]), 0.0, 1.0)
