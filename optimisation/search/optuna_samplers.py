"""Optuna's samplers by its public ask-and-tell interface.

A study is also written as a file that Optuna's dashboard reads.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impact_env.extras import optional
from optimisation.files import replacing
from optimisation.objectives import Objective
from optimisation.search.settings import Evaluated
from optimisation.space import DesignSpace

with optional():
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
    from optuna.samplers import BaseSampler, NSGAIISampler, nsgaii
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

if TYPE_CHECKING:
    from optimisation.search.samplers import BatchCosts

Array = NDArray[np.float64]
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
    designs: Sequence[Evaluated],
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
