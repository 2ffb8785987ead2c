"""Searches that model the noise: many designs with one member each, and a model of the quantile over the space.

A level of one member is one draw, so a member is better spent on another design than on the same one, as long as a model joins what neighbours say.
Both methods work in the space's coordinates, in which the scaling law has taken out force, mass and frequency (`optimisation.variables`), as shares
of their ranges.

*map*: designs of a low-discrepancy sequence, one member each. The quantile at a point is that of the designs around it, weighted by a Gaussian window
(kernel quantile regression: M. C. Jones and P. Hall 1990); its width is the one with the least check loss when each design is left out.

*replicated*: a Gaussian process (Matern 5/2, a length for each coordinate, all by maximum likelihood) of the logarithm of the levels. Each round asks
for new designs by Thompson sampling, and runs designs that look best for another member (replication: B. Ankenman, B. Nelson and J. Staum 2010).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.parameters import count, require
from optimisation.designs import Design
from optimisation.evaluation import evaluate
from optimisation.objectives import Score
from optimisation.problem import Problem
from optimisation.search.settings import Evaluated
from optimisation.variables import WITH_IMPACTS

Array = NDArray[np.float64]
MAP = "map"
REPLICATED = "replicated"
NOISY = {MAP: "dense map with quantile regression", REPLICATED: "Gaussian process with replication"}
# designs of a round of the Gaussian process, of which so many are new
ROUND = 8
NEW = 6
BEGIN = 2 * ROUND
CANDIDATES = 400
FINALISTS = 8  # designs that are handed on, best first
WIDTHS = np.geomspace(0.03, 0.5, 10)  # of the window, in shares of the ranges
_JITTER = 1e-8


@dataclass(eq=False)
class Table:
    """Designs that were run: ``shares`` (variables,) of each, and the values of its members so far, as logarithms where all are above 0."""

    problem: Problem
    executor: Executor
    shares: list[Array] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)

    def design(self, k: int) -> Design:
        """Return a design."""
        return self.problem.space.at(self.shares[k].tolist())

    def run(self, which: Sequence[int], first: Sequence[int] | None = None) -> None:
        """Run each of these designs for one more member: its next one, or the ``first`` given. A failed or forbidden one is as bad as the worst."""
        number = [len(self.values[k]) for k in which] if first is None else list(first)
        for member in sorted(set(number)):
            group = [k for k, m in zip(which, number, strict=True) if m == member]
            ensemble = self.problem.ensemble[
                member % self.problem.members : member % self.problem.members + 1
            ]
            designs = [self.design(k) for k in group]
            for i, measured in evaluate(
                self.problem, designs, ensemble, self.problem.rate, self.executor
            ):
                score = self.problem.score(designs[i], measured, ensemble, self.problem.rate)
                self.values[group[i]].append(self.problem.cost(score))

    @property
    def runs(self) -> int:
        """Number of members run, over all designs."""
        return sum(map(len, self.values))

    def arrays(self) -> tuple[Array, Array]:
        """Return shares (N, variables) and the transformed values as a row for each member, (N, most members), NaN where a design has fewer."""
        most = max(map(len, self.values))
        rows = np.array([[*own, *[np.nan] * (most - len(own))] for own in self.values])
        finite = rows[np.isfinite(rows)]
        rows[np.isinf(rows)] = finite.max() if finite.size else 0.0
        return np.array(self.shares), np.log(rows) if np.nanmin(rows) > 0 else rows


def kernel_quantile(
    points: Array, x: Array, y: Array, width: float, quantile: float, leave_out: bool = False
) -> Array:
    """Return the quantile of values ``y`` (N,) around each of ``points`` (K, d), weighted by a Gaussian window of the distance to ``x`` (N, d).

    ``leave_out``: ``points`` are ``x``, and each is left out of its own.
    """
    weights = np.exp(-0.5 * np.sum((points[:, None] - x[None]) ** 2, axis=2) / width**2) + 1e-300
    if leave_out:
        np.fill_diagonal(weights, 0.0)
    order = np.argsort(y)
    total = np.cumsum(weights[:, order], axis=1)
    at = np.argmax(total >= quantile * total[:, -1:], axis=1)
    return np.asarray(y[order][at])


def best_width(x: Array, y: Array, quantile: float) -> float:
    """Return the width whose left-out quantiles have the least check (pinball) loss."""

    def loss(width: float) -> float:
        off = y - kernel_quantile(x, x, y, width, quantile, leave_out=True)
        return float(np.mean(np.maximum(quantile * off, (quantile - 1) * off)))

    return float(min(WIDTHS, key=loss))


@dataclass(frozen=True, eq=False)
class Process:
    """A Gaussian process of N designs with means ``y`` (N,) of ``members`` (N,) values each; ``logs``: logarithms of lengths, deviation and noise."""

    x: Array
    y: Array
    members: Array
    within: float  # sum of squares of the members around their designs' means
    logs: Array

    def _kernel(self, a: Array, b: Array) -> Array:
        lengths = np.exp(self.logs[:-2])
        r = np.sqrt(5 * np.sum(((a[:, None] - b[None]) / lengths) ** 2, axis=2))
        return np.asarray(np.exp(2 * self.logs[-2]) * (1 + r + r**2 / 3) * np.exp(-r))

    def _factor(self) -> tuple[Array, float]:
        noise = np.exp(2 * self.logs[-1]) / self.members + _JITTER
        factor = np.linalg.cholesky(self._kernel(self.x, self.x) + np.diag(noise))
        return np.asarray(factor, dtype=np.float64), float(np.mean(self.y))

    def log_likelihood(self) -> float:
        """Return the log-likelihood of all members' values, up to a constant; with a weak prior that keeps lengths near the ranges."""
        factor, mean = self._factor()
        white = scipy.linalg.solve_triangular(factor, self.y - mean, lower=True)
        spare = float(np.sum(self.members - 1))
        noise = self.logs[-1]
        prior = (
            -0.5 * float(np.sum(((self.logs[:-2] - np.log(0.3)) / 1.0) ** 2))
            - 0.5 * ((noise - np.log(0.1)) / 1.5) ** 2
        )
        own = -0.5 * float(white @ white) - float(np.sum(np.log(np.diag(factor))))
        return float(own - spare * noise - 0.5 * self.within / np.exp(2 * noise) + prior)

    def predict(self, points: Array) -> tuple[Array, Array]:
        """Return mean (K,) and covariance (K, K) of the noiseless value at points (K, d)."""
        factor, mean = self._factor()
        cross = scipy.linalg.solve_triangular(factor, self._kernel(self.x, points), lower=True)
        white = scipy.linalg.solve_triangular(factor, self.y - mean, lower=True)
        return np.asarray(mean + cross.T @ white), np.asarray(
            self._kernel(points, points) - cross.T @ cross
        )


def fitted(x: Array, rows: Array, start: Array | None = None) -> Process:
    """Return the process of greatest likelihood for designs ``x`` (N, d) with members' values ``rows`` (N, M), NaN where there are fewer."""
    members = np.sum(~np.isnan(rows), axis=1)
    y = np.nanmean(rows, axis=1)
    within = float(np.nansum((rows - y[:, None]) ** 2))
    first = (
        np.concatenate([np.full(x.shape[1], np.log(0.3)), [np.log(np.std(y) + 1e-3), np.log(0.1)]])
        if start is None
        else start
    )

    def loss(logs: Array) -> float:
        try:
            return -Process(x, y, members, within, logs).log_likelihood()
        except np.linalg.LinAlgError:
            return 1e10

    bounds = [(np.log(0.02), np.log(20.0))] * x.shape[1] + [
        (np.log(1e-3), np.log(10.0)),
        (np.log(1e-3), np.log(2.0)),
    ]
    found = scipy.optimize.minimize(
        loss,
        np.clip(first, *np.array(bounds).T),
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 40},
    )
    return Process(x, y, members, within, found.x)


def noisy_search(
    problem: Problem,
    method: str,
    runs: int,
    executor: Executor,
    seed: int = 0,
    from_scratch: bool = False,
    progress: Callable[[int], None] | None = None,
) -> tuple[list[Evaluated], bool]:
    """Return the most promising designs, best first, with the values that the model gives them, after about ``runs`` members have been run.

    The flag is False if a KeyboardInterrupt ended it early. Raises ParameterError for an unknown method, several objectives, and concepts without
    walls.
    """
    require(method in NOISY, "sampler", method, f"one of {', '.join(NOISY)}")
    require(
        problem.space.concept in WITH_IMPACTS,
        "sampler",
        method,
        "an impact absorber: others have hardly any noise",
    )
    require(len(problem.objectives) == 1, "sampler", method, "one objective")
    table = Table(problem, executor)
    budget = count("runs", runs, 2)
    generator = np.random.default_rng(seed)
    if not from_scratch:
        _add(table, [np.array(problem.space.shares(problem.space.default))])
    found: list[Evaluated] = []
    try:
        for best in (_map if method == MAP else _replicated)(table, budget, generator):
            found = best
            if progress is not None:
                progress(table.runs)
    except KeyboardInterrupt:
        return found, False
    return found, True


def _add(table: Table, shares: Sequence[Array]) -> list[int]:
    table.shares += [np.clip(row, 0.0, 1.0) for row in shares]
    table.values += [[] for _ in shares]
    return list(range(len(table.shares) - len(shares), len(table.shares)))


def _candidates(table: Table, best: Array, generator: np.random.Generator) -> Array:
    """Return points of the unit cube: spread evenly, and around the best designs."""
    size = len(table.problem.space.free)
    even = scipy.stats.qmc.Halton(size, rng=generator).random(CANDIDATES // 2)
    scale = generator.choice([0.02, 0.05, 0.1], size=(CANDIDATES // 2, 1))
    near = best[generator.integers(len(best), size=CANDIDATES // 2)] + scale * generator.normal(
        size=(CANDIDATES // 2, size)
    )
    return np.clip(np.vstack([even, near]), 0.0, 1.0)


def _told(table: Table, shares: Array, values: Array) -> list[Evaluated]:
    """Return designs with the model's values as evaluated ones; constraints were counted in the values."""
    raw = [own for values_of in table.values for own in values_of]
    sign = -1.0 if table.problem.objectives[0].maximise else 1.0
    scores = np.exp(values) if min(raw) > 0 else values
    kept = (0.0,) * len(table.problem.constraints)
    return [
        Evaluated(k, table.problem.space.at(row.tolist()), Score((float(sign * value),), kept), 1)
        for k, (row, value) in enumerate(zip(shares, scores, strict=True))
    ]


def _map(table: Table, budget: int, generator: np.random.Generator) -> Iterator[list[Evaluated]]:
    """Yield the best of the map so far, batch by batch."""
    sequence = scipy.stats.qmc.Halton(len(table.problem.space.free), rng=generator)
    objective = table.problem.objectives[0]
    quantile = (
        1 - objective.share if objective.maximise else objective.share
    )  # of costs, whose sign is turned where more is better
    while table.runs < budget:
        _add(table, list(sequence.random(min(40, budget - table.runs))))
        new = [k for k, own in enumerate(table.values) if not own]
        table.run(new, [k % table.problem.members for k in new])
        x, rows = table.arrays()
        y = rows[:, 0]
        width = best_width(x, rows[:, 0], quantile)
        points = np.vstack([x, _candidates(table, x[np.argsort(y)[:10]], generator)])
        guessed = kernel_quantile(points, x, y, width, quantile)
        yield _told(table, *_apart(points, guessed, width / 2))


def _apart(points: Array, values: Array, distance: float) -> tuple[Array, Array]:
    """Return the finalists among points (K, d): the lowest, each at least a distance from those before it."""
    chosen: list[int] = []
    for k in np.argsort(values, kind="stable"):
        if all(np.linalg.norm(points[k] - points[i]) >= distance for i in chosen):
            chosen.append(int(k))
        if len(chosen) == FINALISTS:
            break
    return points[chosen], values[chosen]


def _replicated(
    table: Table, budget: int, generator: np.random.Generator
) -> Iterator[list[Evaluated]]:
    """Yield the best of the process so far, round by round."""
    _add(
        table,
        list(
            scipy.stats.qmc.Halton(len(table.problem.space.free), rng=generator).random(
                min(BEGIN, budget) - table.runs
            )
        ),
    )
    table.run(range(len(table.shares)))
    logs: Array | None = None
    while True:
        x, rows = table.arrays()
        process = fitted(x, rows, logs)
        logs = process.logs
        mean = process.predict(x)[0]
        order = np.argsort(mean, kind="stable")
        yield _told(table, x[order[:FINALISTS]], mean[order[:FINALISTS]])
        if table.runs >= budget:
            return
        points = _candidates(table, x[order[:5]], generator)
        middle, spread = process.predict(points)
        draws = generator.multivariate_normal(
            middle, spread + 1e-6 * np.eye(len(points)), size=NEW, method="cholesky"
        )
        new = _add(table, [points[k] for k in dict.fromkeys(np.argmin(draws, axis=1).tolist())])
        again = [int(k) for k in order if len(table.values[k]) < table.problem.members][
            : ROUND - len(new)
        ]
        table.run([*new, *again])
