"""Compare runs on a cluster, one worker of which is killed, with local runs.

The module runs as a process of its own and prints a line for each comparison.
"""

import os
import signal
from dataclasses import fields

import distributed
import numpy as np
from design_studies import Array
from distributed.core import Status

from impact_env import Beam
from impact_env.ensemble import LaneLevels, Threads
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber
from optimisation import comparison
from optimisation.comparison import compare as absorbers
from optimisation.objectives import Condition
from optimisation.problem import Problem, evaluate
from optimisation.search.cluster import Workers
from optimisation.search.settings import Rung, SearchSettings
from optimisation.search.study import DesignStudy
from optimisation.space import design_space
from optimisation.tuned import den_hartog


def tune_quickly(
    model: ModalModel,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    resonance: int = 1,
    *_range: float,
) -> TunedAbsorber:
    """Return a tuned absorber by the closed form, in place of a search."""
    return den_hartog(model, mass_ratio, resonance)


def problem() -> Problem:
    return Problem(
        design_space("impact"),
        (Condition(1, 3.5), Condition(2, 35.0)),
        beam=Beam(modes=2),
        members=4,
        rate=20.0,
    )


class Murderous(Workers):
    """An executor that kills one of the workers after ``mercy`` results.

    The first result comes from this process, before the workers have received any task.
    """

    victim: int | None = None
    mercy = 2

    def each(self, function, items, kinds):
        for count, result in enumerate(super().each(function, items, kinds)):
            if count == self.mercy and self.victim is not None:
                os.kill(self.victim, signal.SIGKILL)
                self.victim = None
            yield result


def same(here: dict[int, Array], remote: dict[int, Array]) -> bool:
    return sorted(here) == sorted(remote) and all(
        np.array_equal(remote[k], values) for k, values in here.items()
    )


def same_comparison(workers: Workers) -> bool:
    """Compare absorbers with lanes run here and there: all numbers of all lanes."""
    small = {"forces": 2, "members": 2, "percent_per_100_periods": 80.0}
    progress: list[tuple[int, int]] = []
    here = absorbers(Beam(modes=2), **small, threads=1)
    remote = absorbers(
        Beam(modes=2), **small, executor=workers, progress=lambda *n: progress.append(n)
    )
    pairs = [
        (a.curves[key].lanes, b.curves[key].lanes)
        for a, b in zip(here.resonances, remote.resonances, strict=True)
        for key in a.curves
    ]
    equal = all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name))
        for a, b in pairs
        for f in fields(LaneLevels)
    )
    return equal and remote.complete and progress[-1][0] == progress[-1][1] > 50


def compare(cluster: distributed.LocalCluster) -> None:
    tested = problem()
    designs = [tested.space.at([x, 0.5, y]) for x in (0.4, 0.5, 0.6) for y in (0.3, 0.7)]
    here = dict(evaluate(tested, designs, tested.ensemble, tested.rate, Threads(2)))
    with Murderous(cluster.scheduler_address) as workers:
        workers.victim = next(iter(cluster.workers.values())).pid
        remote = dict(evaluate(tested, designs, tested.ensemble, tested.rate, workers))
        print("killed", workers.victim is None)
        print("runs", same(here, remote))
        workers.victim = next(
            worker.pid for worker in cluster.workers.values() if worker.status == Status.running
        )
        workers.mercy = 0
        remote = dict(evaluate(tested, designs, tested.ensemble, tested.rate, workers))
        print("killed at once", workers.victim is None, same(here, remote))
        print("lanes", same_comparison(workers))
        results = []
        for executor in (Threads(), workers):
            study = DesignStudy(tested, SearchSettings("cma", 4, (Rung(1, 2.0, 0.5), Rung(4))))
            study.run(5, executor)
            results.append(
                [(e.number, dict(e.design.values), e.score, e.rungs) for e in study.evaluated]
            )
        print("studies", results[0] == results[1])


if __name__ == "__main__":
    comparison.minimax = comparison.smallest_amplitude = tune_quickly
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as local:
        compare(local)
