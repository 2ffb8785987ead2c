"""A study: batches of designs that a sampler proposes, each run in one call.

The sampler gets the results in the order of the designs' numbers.

A proposal depends on whole batches only, because no result is passed on before the batch has been
run. A study lives in memory: a study that was stopped is replayed from its seed with the runs that
a file holds (`optimisation.checkpoint`), and so equals one that was never interrupted.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from optimisation.objectives import Score
from optimisation.problem import Problem, evaluate
from optimisation.search.optuna_samplers import (
    OptunaSampler,
    nsga2,
    write_study,
)
from optimisation.search.samplers import BatchCosts, CmaSampler, RandomSampler, Sampler
from optimisation.search.settings import CMA, NSGA2, Evaluated, SearchSettings, seed_of
from optimisation.space import Design

Array = NDArray[np.float64]
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
        self.evaluated: list[Evaluated] = []
        self.runs = 0
        self.costs: list[BatchCosts] = []
        self._sampler = sampler or make_sampler(problem, settings)
        self._batch: Array | None = None

    @property
    def complete(self) -> list[Evaluated]:
        """The finished designs that kept all constraints on the last rung: one of them wins."""
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

        def show() -> None:
            progress(len(self.evaluated), self.runs)

        try:
            while len(self.evaluated) < wanted:
                show()
                if self._batch is None:
                    first = None if self.evaluated else self._first_point()
                    self._batch = self._sampler.ask(self.settings.batch, first)
                self._sampler.tell(self.run_batch(self._batch, executor, show))
                self._batch = None
                show()
        except KeyboardInterrupt:
            return False
        return True

    def _first_point(self) -> Array:
        """Return the first design's point.

        It is the start of the space, or a random point if the search is from scratch.
        """
        space = self.problem.space
        if self.settings.from_scratch:
            return np.random.default_rng(seed_of(self.settings.seed, 0)).random(len(space.free))
        return np.array(space.shares(space.default))

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
            Evaluated(first + k, design, score, rungs)
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
