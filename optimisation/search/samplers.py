"""Optuna's samplers without memory: what is proposed for a trial follows from the seed, its number, and the finished trials alone.

A sampler that keeps a random generator from trial to trial cannot be resumed. Here each trial has a generator of its own, seeded by
(seed, number of the trial), and each sampler object serves one trial: all that CMA-ES and NSGA-II carry along is in the study's file
(Optuna stores it with the trials). So a study that was killed goes on as if it had not been.
"""

from __future__ import annotations

import json
import warnings
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

from impact_env.extras import optional
from optimisation.designs import DesignSpace
from optimisation.search.settings import CMA, GP, NSGA2, RANDOM, seed_of

with optional():
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
    from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, NSGAIISampler, RandomSampler
    from optuna.samplers import nsgaii as genetic
    from optuna.trial import FrozenTrial, TrialState

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
        """Return what the method proposes; it is asked for trial 0 as well, since NSGA-II counts its generations there."""
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
