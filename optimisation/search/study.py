"""A study: batches of designs asked of Optuna, run in one call, and told in the order of their numbers.

Nothing is told before the whole batch has been run, so that a proposal depends on whole batches only. A study lives in memory: one that was stopped
is gone through anew with the runs that a file holds (`optimisation.search.ledger`), and so equals one that was never interrupted.
"""

import math
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.extras import optional
from optimisation.designs import Design, DesignSpace
from optimisation.evaluation import evaluate
from optimisation.files import replacing
from optimisation.objectives import Score
from optimisation.problem import Problem
from optimisation.search.settings import CMA, GP, NSGA2, RANDOM, Evaluated, SearchSettings, seed_of

with optional():
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
    from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, NSGAIISampler, RandomSampler
    from optuna.samplers import nsgaii as genetic
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import FrozenTrial, Trial, TrialState

Array = NDArray[np.float64]
NAME = "design"


def distributions(space: DesignSpace) -> dict[str, BaseDistribution]:
    """Return the free variables as Optuna's distributions."""
    return {
        v.name: IntDistribution(int(v.low), int(v.high))
        if v.whole
        else FloatDistribution(v.low, v.high, log=v.log)
        for v in space.free
    }


class _CmaEs(CmaEsSampler):
    """Optuna's CMA-ES, which finds its state also in the first trial of a batch, where it has stored it: the others begin from there."""

    def _get_trials(self, study: optuna.Study) -> list[FrozenTrial]:
        running = study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
        stored = [
            trial
            for trial in running
            if any(key.startswith(self._attr_key_optimizer) for key in trial.system_attrs)
        ]
        return [*super()._get_trials(study), *stored]


def _make(name: str, batch: int, seed: int) -> BaseSampler:
    if name == CMA:
        return _CmaEs(n_startup_trials=0, popsize=batch, seed=seed, warn_independent_sampling=False)
    if name == NSGA2:
        # real-valued operators: the default ones swap and redraw whole coordinates, which does not home in on a front
        return NSGAIISampler(
            population_size=batch,
            crossover=genetic.SBXCrossover(),
            mutation=genetic.PolynomialMutation(),
            seed=seed,
        )
    if name == GP:
        return GPSampler(n_startup_trials=batch + 1, seed=seed, warn_independent_sampling=False)
    return RandomSampler(seed=seed)


class TrialSampler(BaseSampler):
    """The sampler of one trial: what it proposes follows from the seed, the trial's number, and the finished trials alone.

    Trial 0 is the ``start``, if there is one; NSGA-II and the Gaussian process begin with random designs.
    """

    def __init__(
        self,
        name: str,
        space: DesignSpace,
        batch: int,
        seed: int,
        number: int,
        start: Mapping[str, float] | None,
    ) -> None:
        self._space = {} if number == 0 or name == RANDOM else distributions(space)
        self._start = start if number == 0 else None
        self._seed = seed
        self._number = number
        self._inner = _make(name, batch, seed_of(seed, number))

    def infer_relative_search_space(
        self,
        study: optuna.Study,  # noqa: ARG002
        trial: FrozenTrial,  # noqa: ARG002
    ) -> dict[str, BaseDistribution]:
        """Return all free variables; none where they are drawn one by one."""
        return self._space

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Return the method's proposal; it is asked for trial 0 as well, since NSGA-II counts its generations there."""
        if isinstance(
            self._inner, NSGAIISampler
        ):  # so that a batch's first trial has the parents in the order in which its others find them
            self._inner.get_parent_population(study, self._inner.get_trial_generation(study, trial))
        return dict(self._inner.sample_relative(study, trial, search_space))

    def sample_independent(
        self,
        study: optuna.Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        """Return the start's value for trial 0, else a random one that depends on seed, trial and name only."""
        if self._start is not None:
            return self._start[param_name]
        generator = RandomSampler(
            seed=seed_of(self._seed, self._number, zlib.crc32(param_name.encode()))
        )
        return generator.sample_independent(study, trial, param_name, param_distribution)


class DesignStudy:
    """A study of a problem: ``told`` has the finished designs by number, and ``runs`` counts those behind them. Raises as `SearchSettings.check`."""

    def __init__(self, problem: Problem, settings: SearchSettings) -> None:
        settings.check(problem)
        self.problem = problem
        self.settings = settings
        self.told: list[Evaluated] = []
        self.runs = 0
        self._space, self._asked = distributions(problem.space), list[Trial]()
        with _quiet():
            self._study = self._empty()

    def _empty(self, storage: Any = None) -> optuna.Study:
        directions = [
            "maximize" if objective.maximise else "minimize"
            for objective in self.problem.objectives
        ]
        study = optuna.create_study(
            storage=storage, study_name=NAME, directions=directions, sampler=RandomSampler()
        )
        study.set_metric_names([objective.label for objective in self.problem.objectives])
        return study

    @property
    def complete(self) -> list[Evaluated]:
        """The finished designs that kept all constraints on the last rung: one of them wins."""
        return [e for e in self.told if e.score.feasible and e.rungs == len(self.settings.rungs)]

    def run(
        self,
        designs: int,
        executor: Executor,
        progress: Callable[[int, int], object] = lambda _designs, _runs: None,
    ) -> bool:
        """Search until at least ``designs`` (whole batches) are told; return False if a KeyboardInterrupt ended it early; call it again to go on."""
        wanted = self.settings.whole_batches(designs)
        try:
            with _quiet():
                while len(self.told) < wanted:
                    self._batch(executor, lambda: progress(len(self.told), self.runs))
        except KeyboardInterrupt:
            return False
        return True

    def save(self, path: Path) -> None:
        """Write the finished designs as a file that Optuna and its dashboard read."""
        trials = self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        with replacing(path) as temporary, _quiet():
            study = self._empty(JournalStorage(JournalFileBackend(str(temporary))))
            study.add_trials(
                [
                    optuna.create_trial(
                        params=t.params, distributions=t.distributions, values=t.values
                    )
                    for t in trials
                ]
            )

    def _batch(self, executor: Executor, show: Callable[[], object]) -> None:
        show()
        first = len(self.told)
        chosen = self.settings
        self._asked = self._asked or [
            self._ask(number) for number in range(first, first + chosen.batch + (first == 0))
        ]
        designs = [self.problem.space.decoded(trial.params) for trial in self._asked]
        going = list(range(len(designs)))
        measured = dict[int, Array]()
        reached = dict[int, tuple[int, Score]]()
        for level, rung in enumerate(chosen.rungs):
            self._climb(level, going, designs, measured, executor, show)
            rate = self.problem.rate * rung.speed
            members = self.problem.ensemble[: rung.members]
            reached |= {
                k: (level + 1, self.problem.score(designs[k], measured[k], members, rate))
                for k in going
            }
            order = sorted(going, key=lambda k: (self.problem.penalised_cost(reached[k][1]), k))
            going = sorted(order[: math.ceil(rung.keep * len(going))])
        self._tell([reached[k] for k in range(len(designs))])
        self.told += [
            Evaluated(first + k, design, reached[k][1], reached[k][0])
            for k, design in enumerate(designs)
        ]
        self._asked = []
        show()

    def _ask(self, number: int) -> Trial:
        chosen = self.settings
        space = self.problem.space
        start = None if chosen.from_scratch else space.coordinates(space.default)
        self._study.sampler = TrialSampler(
            chosen.sampler, space, chosen.batch, chosen.seed, number, start
        )
        return self._study.ask(fixed_distributions=self._space)

    def _climb(
        self,
        level: int,
        going: list[int],
        designs: list[Design],
        measured: dict[int, Array],
        executor: Executor,
        show: Callable[[], object],
    ) -> None:
        """Run what is missing on a rung: of a design that was run as fast on the one below only the members that come to it."""
        rung = self.settings.rungs[level]
        below = self.settings.rungs[level - 1] if level else None
        problem = self.problem
        known = (
            below.members
            if below is not None and below.speed == rung.speed and below.members <= rung.members
            else 0
        )
        ensemble = problem.ensemble[known : rung.members]
        before = self.runs

        def count(done: int, _total: int) -> None:
            self.runs = before + done
            show()

        asked = [designs[k] for k in going]
        for i, rows in (
            evaluate(problem, asked, ensemble, problem.rate * rung.speed, executor, count)
            if len(ensemble)
            else ()
        ):
            measured[going[i]] = np.concatenate([measured[going[i]], rows]) if known else rows

    def _tell(self, reached: Sequence[tuple[int, Score]]) -> None:
        """Tell a batch in the order of its numbers; designs left behind are told as worse than all that went on."""
        costs = [self.problem.penalised_cost(score) for _, score in reached]
        shifts = [0.0] * (len(self.settings.rungs) + 1)
        for rungs in range(len(self.settings.rungs) - 1, 0, -1):
            above = [costs[k] + shifts[r] for k, (r, _) in enumerate(reached) if r > rungs]
            here = [costs[k] for k, (r, _) in enumerate(reached) if r == rungs]
            shifts[rungs] = max(0.0, max(above) - min(here)) if above and here else 0.0
        sign = -1.0 if self.problem.objectives[0].maximise else 1.0
        for trial, cost, (rungs, score) in zip(self._asked, costs, reached, strict=True):
            for constraint, violation in zip(
                self.problem.constraints, score.violations, strict=True
            ):
                trial.set_constraint(constraint.name, violation)
            penalised = len(score.values) == 1 and (self.settings.sampler == CMA or score.feasible)
            self._study.tell(
                trial, [sign * (cost + shifts[rungs])] if penalised else list(score.values)
            )


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Optuna tell no more than warnings meanwhile, and nothing of what it calls experimental."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            yield
    finally:
        optuna.logging.set_verbosity(before)
