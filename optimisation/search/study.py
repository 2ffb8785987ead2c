"""A study: batches of designs asked of Optuna, run in one call, and told; every result is in the journal as soon as it is there.

A batch goes through three states, and each can be taken up where a killed process left it: its designs are asked for (`samplers`
makes a proposal repeatable), run rung by rung (the measures of a design are written when its runs are finished), and told in the order
of their numbers. Nothing is told before the whole batch has been run, so that a proposal depends on whole batches only. A resumed
study therefore equals one that was never interrupted.
"""

import json
import math
import os
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.extras import optional
from impact_env.parameters import ParameterError
from optimisation.designs import Design, DesignSpace
from optimisation.evaluation import evaluate
from optimisation.files import append
from optimisation.machine import SEARCHING, difference, fingerprint
from optimisation.objectives import Score
from optimisation.problem import Problem
from optimisation.search.ledger import StudyError, alone, line_of, listed, repair
from optimisation.search.settings import CMA, GP, NSGA2, RANDOM, Evaluated, Progress, Settings, seed_of

# Optuna's samplers without memory: what is proposed for a trial follows from the seed, its number, and the finished trials alone.
#
# A sampler that keeps a random generator from trial to trial cannot be resumed. Here each trial has a generator of its own, seeded by
# (seed, number of the trial), and each sampler object serves one trial: all that CMA-ES and NSGA-II carry along is in the study's file
# (Optuna stores it with the trials). So a study that was killed goes on as if it had not been.


with optional():
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
    from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, NSGAIISampler, RandomSampler
    from optuna.samplers import nsgaii as genetic
    from optuna.storages import InMemoryStorage, JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import FrozenTrial, Trial, TrialState

_NOTED = "gp:relative_params"  # where Optuna keeps a proposal of the Gaussian process


def distributions(space: DesignSpace) -> dict[str, BaseDistribution]:
    """Return the free variables as Optuna's distributions."""
    return {v.name: IntDistribution(int(v.low), int(v.high)) if v.whole else FloatDistribution(v.low, v.high, log=v.log) for v in space.free}


class _CmaEs(CmaEsSampler):
    """Optuna's CMA-ES, which looks for its state in the last two batches only: that is where it is, and a study has many.

    The state after the last batch, once the first trial of a batch has stored it, serves the others too; they would work out the same one.
    The state is stored in pieces, and a trial's generation after them: a process that was killed in between has left a part of it.
    """

    number = 0  # of the trial that this sampler serves

    def _get_trials(self, study: optuna.Study) -> list[FrozenTrial]:
        assert self._popsize is not None
        recent = study._get_trials(deepcopy=False, use_cache=True)[-2 * self._popsize - 1 :]
        return [t for t in recent if t.state == TrialState.COMPLETE or self._has_state(t)]

    def _has_state(self, trial: FrozenTrial) -> bool:
        """Return whether a trial before this one, and not yet told, has stored the whole state."""
        stored = any(key.startswith(self._attr_key_optimizer) for key in trial.system_attrs)
        return stored and trial.number < self.number and self._attr_key_generation in trial.system_attrs


class _Nsga2(NSGAIISampler):
    """Optuna's NSGA-II, which chooses the parents before it needs them: read back from the study they come in another order than when chosen."""

    def sample_relative(self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]) -> dict[str, Any]:
        self.get_parent_population(study, self.get_trial_generation(study, trial))
        return dict(super().sample_relative(study, trial, search_space))


def _make(name: str, batch: int, seed: int) -> BaseSampler:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        if name == CMA:
            return _CmaEs(n_startup_trials=0, popsize=batch, seed=seed, warn_independent_sampling=False)
        if name == NSGA2:
            # real-valued operators: the default ones swap and redraw whole coordinates, which does not home in on a front
            crossover, mutation = genetic.SBXCrossover(), genetic.PolynomialMutation()
            return _Nsga2(population_size=batch, crossover=crossover, mutation=mutation, seed=seed)
        if name == GP:
            return GPSampler(n_startup_trials=batch + 1, seed=seed, warn_independent_sampling=False)
        return RandomSampler(seed=seed)


class TrialSampler(BaseSampler):
    """The sampler of one trial. Trial 0 is the ``start``, if there is one; NSGA-II and the Gaussian process begin with random designs."""

    def __init__(self, name: str, space: DesignSpace, batch: int, seed: int, number: int, start: Mapping[str, float] | None) -> None:
        self._space = {} if number == 0 or name == RANDOM else distributions(space)
        self._start = start if number == 0 else None
        self._seed, self._number = seed, number
        self._inner = _make(name, batch, seed_of(seed, number))
        if isinstance(self._inner, _CmaEs):
            self._inner.number = number

    def infer_relative_search_space(self, study: optuna.Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:  # noqa: ARG002
        """Return all free variables; none where they are drawn one by one."""
        return self._space

    def sample_relative(self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]) -> dict[str, Any]:
        """Return the method's proposal; it is asked for trial 0 as well, since NSGA-II counts its generations there."""
        # a process that was killed between a proposal and its parameters: the Gaussian process would count its own proposal as another's
        noted = "".join(str(trial.system_attrs[key]) for key in sorted(trial.system_attrs) if key.startswith(_NOTED))
        return dict(json.loads(noted) if noted else self._inner.sample_relative(study, trial, search_space))

    def sample_independent(self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution) -> Any:
        """Return the start's value for trial 0, else a random one that depends on seed, trial and name only."""
        if self._start is not None:
            return self._start[param_name]
        generator = RandomSampler(seed=seed_of(self._seed, self._number, zlib.crc32(param_name.encode())))
        return generator.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(self, study: optuna.Study, trial: FrozenTrial, state: TrialState, values: Sequence[float] | None) -> None:
        """Let the method note what it keeps of a finished trial."""
        self._inner.after_trial(study, trial, state, values)


Array = NDArray[np.float64]
Json = dict[str, object]
STUDY_FORMAT = 2
NAME = "design"
_IDENTITY, _SCORE = "identity", "score"


class Journal(JournalFileBackend):
    """Optuna's journal file for a writer that has it to itself: no lock for each line, and no wait for the disk but at `sync`.

    A process that is killed loses nothing that it wrote; a machine that loses its power may lose what came after the last `sync`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self._path = path

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Write all of these lines or, with OSError, none of them."""
        append(self._path, b"".join(line_of(log) for log in logs))

    def sync(self) -> None:
        """Wait until the disk has everything."""
        with self._path.open("ab") as file:
            os.fsync(file.fileno())


class DesignStudy:
    """A study of a problem, in memory or in a journal file; use `opened`."""

    def __init__(self, problem: Problem, settings: Settings, study: optuna.Study, sync: Callable[[], None] = lambda: None) -> None:
        self.problem, self.settings = problem, settings
        self.seconds = 0.0  # of which
        self.evaluating = 0.0  # were spent in runs
        self.runs = 0
        self._study, self._sync = study, sync
        self._space = distributions(problem.space)

    @property
    def told(self) -> list[Evaluated]:
        """All designs that are finished, by number."""
        return [self._evaluated(trial) for trial in self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))]

    @property
    def complete(self) -> list[Evaluated]:
        """The finished designs that kept all constraints on the last rung: one of them wins."""
        return [e for e in self.told if e.score.feasible and e.rungs == len(self.settings.rungs)]

    def run(self, designs: int, executor: Executor, progress: Callable[[Progress], None] | None = None) -> bool:
        """Search until at least ``designs`` (whole batches) are told; return False if a KeyboardInterrupt ended it early.

        What is finished stays, so that a later call, of any process, goes on from there.
        """
        wanted, began = self.settings.whole_batches(designs), time.perf_counter()
        try:
            while (first := self._next_batch()) < wanted:

                def show(runs: int, told: int = first) -> None:
                    if progress is not None:
                        progress(Progress(told, wanted, runs))

                show(self.runs)
                self._batch(first, executor, show)
                show(self.runs, self._next_batch())
        except KeyboardInterrupt:
            return False
        finally:
            self.seconds += time.perf_counter() - began
        return True

    def _next_batch(self) -> int:
        """Return the number of the first design of the first batch that is not told."""
        told = len(self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)))
        return 0 if told < self.settings.batch + 1 else told - (told - 1) % self.settings.batch

    def _batch(self, first: int, executor: Executor, show: Callable[[int], None]) -> None:
        size = self.settings.batch + (first == 0)
        trials = self._asked(first, size)
        designs = [self.problem.space.decoded({name: trial.params[name] for name in self._space}) for trial in trials]
        going = list(range(size))
        reached: dict[int, tuple[int, Score]] = {}
        for level, rung in enumerate(self.settings.rungs):
            scores = self._climb(level, [(trials[k], designs[k]) for k in going], executor, show)
            for k, score in zip(going, scores, strict=True):
                reached[k] = (level + 1, score)
            if level + 1 < len(self.settings.rungs):
                order = sorted(range(len(going)), key=lambda i: (self.problem.penalised_cost(scores[i]), i))
                going = sorted(going[i] for i in order[: math.ceil(rung.keep * len(going))])
        self._tell(trials, [reached[k] for k in range(size)])

    def _asked(self, first: int, size: int) -> list[FrozenTrial]:
        """Return the batch's trials; what a killed process asked for is taken over, and what is missing is asked for."""
        known = {trial.number: trial for trial in self._study.get_trials(deepcopy=False)}
        chosen, space = self.settings, self.problem.space
        start = None if chosen.from_scratch else space.coordinates(space.default)
        for number in range(first, first + size):
            trial = known.get(number)
            if trial is not None and set(trial.params) == set(self._space):
                continue
            self._study.sampler = TrialSampler(chosen.sampler, space, chosen.batch, chosen.seed, number, start)
            if trial is None:
                self._study.ask(fixed_distributions=self._space)
            else:  # killed between two of its parameters
                half = Trial(self._study, trial._trial_id)
                for v in self.problem.space.free:
                    if v.whole:
                        half.suggest_int(v.name, int(v.low), int(v.high))
                    else:
                        half.suggest_float(v.name, v.low, v.high, log=v.log)
        self._study.sampler = RandomSampler()
        return sorted(self._study.get_trials(deepcopy=False), key=lambda trial: trial.number)[first : first + size]

    def _climb(self, level: int, going: Sequence[tuple[FrozenTrial, Design]], executor: Executor, show: Callable[[int], None]) -> list[Score]:
        """Return the scores of designs on a rung, running what the journal does not hold yet."""
        rung, problem = self.settings.rungs[level], self.problem
        rate, below = problem.rate * rung.speed, self.settings.rungs[level - 1] if level else None
        continued = below is not None and below.speed == rung.speed and below.members <= rung.members
        begin = below.members if continued and below is not None else 0
        ensemble, key = problem.ensemble[begin : rung.members], f"rung {level}"
        problem.reference(problem.ensemble[: rung.members], rate)
        missing = [(trial, design) for trial, design in going if key not in trial.user_attrs]
        before, began = self.runs, time.perf_counter()

        def count(done: int, _total: int) -> None:
            self.runs = before + done
            show(self.runs)

        try:
            for k, measured in evaluate(problem, [design for _, design in missing], ensemble, rate, executor, count) if len(ensemble) else ():
                self._study._storage.set_trial_user_attr(missing[k][0]._trial_id, key, listed(measured))
        finally:
            self.evaluating += time.perf_counter() - began
        stored = {trial.number: trial for trial in self._study.get_trials(deepcopy=False)}
        used = range(level - 1 if continued else level, level + 1) if len(ensemble) else range(level - 1, level)
        scores = []
        for trial, design in going:
            measured = np.concatenate([np.array(stored[trial.number].user_attrs[f"rung {i}"], dtype=float) for i in used])
            scores.append(problem.score(design, measured, problem.ensemble[: rung.members], rate))
        return scores

    def _tell(self, trials: Sequence[FrozenTrial], reached: Sequence[tuple[int, Score]]) -> None:
        """Tell a batch in the order of its numbers; designs left behind are told as worse than all that went on."""
        costs = [self.problem.penalised_cost(score) for _, score in reached]
        shifts = [0.0] * (len(self.settings.rungs) + 1)
        for rungs in range(len(self.settings.rungs) - 1, 0, -1):
            above = [costs[k] + shifts[r] for k, (r, _) in enumerate(reached) if r > rungs]
            here = [costs[k] for k, (r, _) in enumerate(reached) if r == rungs]
            shifts[rungs] = max(0.0, max(above) - min(here)) if above and here else 0.0
        sign = -1.0 if self.problem.objectives[0].maximise else 1.0
        for trial, cost, (rungs, score) in zip(trials, costs, reached, strict=True):
            if trial.state == TrialState.COMPLETE:
                continue
            penalised = len(score.values) == 1 and (self.settings.sampler == CMA or score.feasible)
            values = [sign * (cost + shifts[rungs])] if penalised else list(score.values)
            storage, key = self._study._storage, trial._trial_id
            storage.set_trial_user_attr(key, _SCORE, asdict(score) | {"rungs": rungs})
            if self.problem.constraints:
                open_trial = Trial(self._study, key)
                for constraint, violation in zip(self.problem.constraints, score.violations, strict=True):
                    open_trial.set_constraint(constraint.name, violation)
            self._study.tell(trial.number, values)
        self._sync()

    def _evaluated(self, trial: FrozenTrial) -> Evaluated:
        told = trial.user_attrs[_SCORE]
        score = Score(tuple(told["values"]), tuple(told["violations"]), bool(told["failed"]))
        return Evaluated(trial.number, self.problem.space.decoded({name: trial.params[name] for name in self._space}), score, int(told["rungs"]))


@contextmanager
def opened(problem: Problem, settings: Settings, journal: Path | None = None) -> Iterator[DesignStudy]:
    """Give the study of a problem: a new one, or the one that ``journal`` holds; None keeps it in memory.

    The file belongs to this process until the end; a last line that a killed process left half-written is taken out of it. Raises
    StudyError if the file is in use, damaged, or of another problem, method or version.
    """
    settings.check(problem)
    if journal is None:
        with _quiet():
            yield DesignStudy(problem, settings, _study(problem, settings, InMemoryStorage(), None))
        return
    with alone(journal), _quiet():
        repair(journal)
        try:
            backend = Journal(journal)
            study = _study(problem, settings, JournalStorage(backend), journal)
        except (KeyError, AssertionError, TypeError, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            raise StudyError(f"study file = {journal} is not allowed: it is not a journal that Optuna can read ({error!r})") from error
        yield DesignStudy(problem, settings, study, backend.sync)


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Optuna tell no more than warnings meanwhile."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)


def _study(problem: Problem, settings: Settings, storage: optuna.storages.BaseStorage, journal: Path | None) -> optuna.Study:
    directions = ["maximize" if objective.maximise else "minimize" for objective in problem.objectives]
    names = [summary.study_name for summary in optuna.get_all_study_summaries(storage)]
    made = {"problem": problem.describe(), "search": settings.describe(), "sources": fingerprint(__name__, SEARCHING)}
    identity = json.loads(json.dumps({"version": STUDY_FORMAT, **made}))
    if names and NAME not in names:
        raise StudyError(f"study file = {journal} is not allowed: it holds {', '.join(map(repr, names))}, and no study of this workbench")
    if not names:
        study = optuna.create_study(storage=storage, study_name=NAME, directions=directions, sampler=RandomSampler())
    else:
        study = optuna.load_study(storage=storage, study_name=NAME, sampler=RandomSampler())
    held = study.user_attrs.get(_IDENTITY)
    if held is None and not study.get_trials(deepcopy=False):  # new, or killed while it was made
        study.set_user_attr(_IDENTITY, identity)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study.set_metric_names([objective.label for objective in problem.objectives])
    elif held != identity:
        raise StudyError(f"study file = {journal} is not allowed: it is another study: {difference(held, identity)}; choose another file")
    return study
