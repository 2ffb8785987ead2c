"""Samplers, which propose designs, and a study: batches of proposed designs, each run in one call.

The sampler gets the results in the order of the designs' numbers.

A proposal depends on whole batches only, because no result is passed on before the batch has been
run. A study lives in memory: a study that was stopped is replayed from its seed with the runs that
a file holds (`optimisation.checkpoint`), and so equals one that was never interrupted.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.extras import optional
from optimisation.files import replacing
from optimisation.objectives import Objective, Score
from optimisation.problem import Problem, evaluate
from optimisation.search.settings import CMA, NSGA2, EvaluatedDesign, SearchSettings, seed_of
from optimisation.space import Design, DesignSpace

# Samplers: methods that propose designs as points of the unit cube.
#
# A sampler is asked for a batch, the batch is run, and its costs are passed to the sampler.
#
# A coordinate of a point is the share of a free variable's range (`DesignSpace.at`). What a
# sampler proposes follows from its seed and from all batches before, and nothing else: the same
# search run again proposes the same designs.

with optional():
    import cmaes

Array = NDArray[np.float64]
CMA_STEP = 1 / 6  # standard deviation of CMA-ES's first generation, in shares of the ranges


@dataclass(frozen=True)
class BatchCosts:
    """Costs of a batch of n designs, all to be minimised.

    ``costs`` (n, objectives) are the objectives; ``violations`` (n, constraints) are 0 or below if
    a constraint is satisfied; ``penalised`` (n,) is the first objective's cost, or more than any
    cost if a constraint is violated.
    """

    costs: Array
    violations: Array
    penalised: Array


class Sampler(Protocol):
    """A method that proposes points from the costs of earlier ones."""

    def ask(self, count: int, first: Array | None = None) -> Array:
        """Return ``count`` points (count, variables) of the unit cube.

        If the point ``first`` (variables,) is given, it comes first, followed by ``count`` points.
        """
        ...

    def tell(self, batch: BatchCosts) -> None:
        """Take the costs of all points that were returned last, in their order."""
        ...


def prepend(first: Array | None, points: Array) -> Array:
    """Return points (n, variables) below ``first``, if there is one."""
    return points if first is None else np.vstack([first, points])


class RandomSampler:
    """Uniformly distributed points."""

    def __init__(self, variables: int, seed: int) -> None:
        self._variables = variables
        self._generator = np.random.default_rng(seed)

    def ask(self, count: int, first: Array | None = None) -> Array:
        """See `Sampler`."""
        return prepend(first, self._generator.random((count, self._variables)))

    def tell(self, batch: BatchCosts) -> None:
        """See `Sampler`; costs change nothing."""


class CmaSampler:
    """CMA-ES by the package cmaes (N. Hansen, arXiv:1604.00772).

    Each batch is a generation. The search starts from the middle of the ranges.

    After it has converged it begins again at a random point. The point ``first`` of `ask` has no
    part in its distribution.
    """

    def __init__(self, variables: int, population: int, seed: int) -> None:
        self._population = population
        self._generator = np.random.default_rng(seed)
        self._points = np.empty((0, variables))
        self._optimiser = self._begin(np.full(variables, 0.5))

    def _begin(self, mean: Array) -> cmaes.CMA:
        bounds = np.tile([0.0, 1.0], (len(mean), 1))
        seed = int(self._generator.integers(2**31))
        return cmaes.CMA(mean, CMA_STEP, bounds, seed=seed, population_size=self._population)

    def ask(self, count: int, first: Array | None = None) -> Array:
        """See `Sampler`; ``count`` is the population."""
        if self._optimiser.should_stop():
            self._optimiser = self._begin(self._generator.random(self._points.shape[1]))
        self._points = np.array([self._optimiser.ask() for _ in range(count)])
        return prepend(first, self._points)

    def tell(self, batch: BatchCosts) -> None:
        """See `Sampler`."""
        costs = batch.penalised[-len(self._points) :].tolist()
        self._optimiser.tell(list(zip(self._points, costs, strict=True)))


# Optuna's samplers by its public ask-and-tell interface.
#
# A study is also written as a file that Optuna's dashboard reads.

with optional():
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
    from optuna.samplers import BaseSampler, NSGAIISampler, nsgaii
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend


STUDY = "design"


class OptunaSampler:
    """A `Sampler` that asks one of Optuna."""

    def __init__(
        self, variables: int, sampler: BaseSampler, objectives: int = 1, constraints: int = 0
    ) -> None:
        self._ranges = {f"x{k}": FloatDistribution(0.0, 1.0) for k in range(variables)}
        self._constraints = [f"constraint {k}" for k in range(constraints)]
        self._trials: list[optuna.Trial] = []
        with quiet_optuna():
            self._study = optuna.create_study(directions=["minimize"] * objectives, sampler=sampler)

    def ask(self, count: int, first: Array | None = None) -> Array:
        """See `Sampler`."""
        with quiet_optuna():
            if first is not None:
                self._study.enqueue_trial(dict(zip(self._ranges, first.tolist(), strict=True)))
                count += 1
            self._trials = [self._study.ask(self._ranges) for _ in range(count)]
        return np.array([[trial.params[name] for name in self._ranges] for trial in self._trials])

    def tell(self, batch: BatchCosts) -> None:
        """See `Sampler`."""
        rows = zip(self._trials, batch.costs.tolist(), batch.violations.tolist(), strict=True)
        with quiet_optuna():
            for trial, costs, violations in rows:
                for name, violation in zip(self._constraints, violations, strict=True):
                    trial.set_constraint(name, violation)
                self._study.tell(trial, costs)


def nsga2(population: int, seed: int) -> BaseSampler:
    """Return NSGA-II with real-valued operators.

    The default operators swap and redraw whole coordinates, which does not converge to a front.
    """
    with quiet_optuna():
        return NSGAIISampler(
            population_size=population,
            crossover=nsgaii.SBXCrossover(),
            mutation=nsgaii.PolynomialMutation(),
            seed=seed,
        )


def write_study(
    path: Path,
    space: DesignSpace,
    objectives: Sequence[Objective],
    designs: Sequence[EvaluatedDesign],
    costs: Sequence[Sequence[float]],
) -> None:
    """Write designs with their costs as a file that Optuna and its dashboard read.

    ``costs``: (designs, objectives), to be minimised.
    """
    distributions: dict[str, BaseDistribution] = {
        v.name: IntDistribution(int(v.low), int(v.high))
        if v.whole
        else FloatDistribution(v.low, v.high, log=v.log)
        for v in space.free
    }
    directions = ["maximize" if objective.maximise else "minimize" for objective in objectives]
    signs = [-1.0 if objective.maximise else 1.0 for objective in objectives]
    whole = {v.name for v in space.free if v.whole}
    with replacing(path) as temporary, quiet_optuna():
        study = optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(temporary))),
            study_name=STUDY,
            directions=directions,
        )
        study.set_metric_names([objective.label for objective in objectives])
        trials = []
        for one, row in zip(designs, costs, strict=True):
            values = [sign * cost for sign, cost in zip(signs, row, strict=True)]
            params = space.coordinates(one.design)
            params |= {name: round(params[name]) for name in whole}
            trials.append(
                optuna.create_trial(params=params, distributions=distributions, values=values)
            )
        study.add_trials(trials)


@contextmanager
def quiet_optuna() -> Iterator[None]:
    """Keep Optuna's messages below warnings off, and its warnings of experimental features."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            yield
    finally:
        optuna.logging.set_verbosity(before)


Show = Callable[[], object]


def make_sampler(problem: Problem, settings: SearchSettings) -> Sampler:
    """Return the sampler that the settings name."""
    variables = len(problem.space.free)
    seed = seed_of(settings.seed)
    if settings.sampler == CMA:
        return CmaSampler(variables, settings.batch, seed)
    parts = len(problem.objectives), len(problem.constraints)
    if settings.sampler == NSGA2:
        return OptunaSampler(variables, nsga2(settings.batch, seed), *parts)
    return RandomSampler(variables, seed)


class DesignStudy:
    """A study of a problem.

    It has the finished designs by number, ``evaluated``. ``runs``: number of the runs of these
    designs.

    ``sampler`` takes the place of the sampler that the settings name. Raises as
    `SearchSettings.check`.
    """

    def __init__(
        self, problem: Problem, settings: SearchSettings, sampler: Sampler | None = None
    ) -> None:
        settings.check(problem)
        self.problem = problem
        self.settings = settings
        self.evaluated: list[EvaluatedDesign] = []
        self.runs = 0
        self.costs: list[BatchCosts] = []
        self._sampler = sampler or make_sampler(problem, settings)
        self._batch: Array | None = None

    @property
    def complete(self) -> list[EvaluatedDesign]:
        """The finished designs of the last rung; one of them wins."""
        return [
            e for e in self.evaluated if e.score.feasible and e.rungs == len(self.settings.rungs)
        ]

    def run(
        self,
        designs: int,
        executor: Executor,
        progress: Callable[[int, int], object] = lambda _designs, _runs: None,
    ) -> bool:
        """Search until at least ``designs`` designs, in whole batches, are finished.

        The result is False if a KeyboardInterrupt ended the search early. Another call continues
        it.
        """
        wanted = self.settings.whole_batches(designs)
        space = self.problem.space

        def show() -> None:
            progress(len(self.evaluated), self.runs)

        try:
            while len(self.evaluated) < wanted:
                show()
                if self._batch is None:
                    first = None  # point of the search's first design
                    if not self.evaluated and self.settings.from_scratch:
                        generator = np.random.default_rng(seed_of(self.settings.seed, 0))
                        first = generator.random(len(space.free))
                    elif not self.evaluated:
                        first = np.array(space.shares(space.default))
                    self._batch = self._sampler.ask(self.settings.batch, first)
                self._sampler.tell(self.run_batch(self._batch, executor, show))
                self._batch = None
                show()
        except KeyboardInterrupt:
            return False
        return True

    def run_batch(self, points: Array, executor: Executor, show: Show = lambda: None) -> BatchCosts:
        """Run designs at points (n, variables) of the unit cube, rung by rung.

        The costs of the designs are returned.
        """
        first = len(self.evaluated)
        designs = [self.problem.space.at(point) for point in points.tolist()]
        going = list(range(len(designs)))
        measured = dict[int, Array]()
        reached = dict[int, tuple[int, Score]]()
        for level, rung in enumerate(self.settings.rungs):
            self._run_rung(level, going, designs, measured, executor, show)
            rate = self.problem.rate * rung.speed
            members = self.problem.ensemble[: rung.members]
            for k in going:
                reached[k] = (
                    level + 1,
                    self.problem.score(designs[k], measured[k], members, rate),
                )
            order = sorted(going, key=lambda k: (self.problem.penalised_cost(reached[k][1]), k))
            going = sorted(order[: math.ceil(rung.keep * len(going))])

        rows = [reached[k] for k in range(len(designs))]
        batch = self._count_costs(rows)
        self.costs.append(batch)
        self.evaluated += [
            EvaluatedDesign(first + k, design, score, rungs)
            for k, (design, (rungs, score)) in enumerate(zip(designs, rows, strict=True))
        ]
        return batch

    def _run_rung(
        self,
        level: int,
        going: list[int],
        designs: list[Design],
        measured: dict[int, Array],
        executor: Executor,
        show: Show,
    ) -> None:
        """Run the missing members of the designs on a rung.

        For a design that had the same rate on the previous rung these are only the additional
        members.
        """
        rung = self.settings.rungs[level]
        below = self.settings.rungs[level - 1] if level else None
        problem = self.problem
        known = 0
        if below is not None and below.speed == rung.speed and below.members <= rung.members:
            known = below.members
        ensemble = problem.ensemble[known : rung.members]
        if not len(ensemble):
            return
        before = self.runs

        def count(done: int, _total: int) -> None:
            self.runs = before + done
            show()

        chosen = [designs[k] for k in going]
        rate = problem.rate * rung.speed
        for i, rows in evaluate(problem, chosen, ensemble, rate, executor, count):
            k = going[i]
            measured[k] = np.concatenate([measured[k], rows]) if known else rows

    def _count_costs(self, rows: list[tuple[int, Score]]) -> BatchCosts:
        """Return a batch's costs from (rungs, score) of each design.

        Designs that are abandoned on a rung cost more than all designs that continue.
        """
        problem = self.problem
        signs = np.array([-1.0 if o.maximise else 1.0 for o in problem.objectives])
        costs = np.array([score.values for _, score in rows]) * signs
        penalised = np.array([problem.penalised_cost(score) for _, score in rows])
        rungs = np.array([reached for reached, _ in rows])

        shifts = np.zeros(len(rows))
        for rung in range(len(self.settings.rungs) - 1, 0, -1):
            above = (penalised + shifts)[rungs > rung]
            here = rungs == rung
            if above.size and here.any():
                shifts[here] = max(0.0, above.max() - penalised[here].min())
        feasible = np.array([score.feasible for _, score in rows])
        if len(signs) == 1:
            costs[:, 0] += np.where(feasible, shifts, 0.0)
        violations = np.array([score.violations for _, score in rows]).reshape(
            len(rows), -1 if problem.constraints else 0
        )
        return BatchCosts(costs, violations, penalised + shifts)

    def save(self, path: Path) -> None:
        """Write the finished designs as a file that Optuna and its dashboard read."""
        problem = self.problem
        if len(problem.objectives) == 1:
            costs = [[cost] for batch in self.costs for cost in batch.penalised.tolist()]
        else:
            costs = [row for batch in self.costs for row in batch.costs.tolist()]
        write_study(path, problem.space, problem.objectives, self.evaluated, costs)
