"""Run as a process of its own: runs on a cluster, one worker of which is killed, beside runs here. Prints a line for each comparison."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence

import distributed
import numpy as np
from design_studies import Array

from impact_env import Beam
from optimisation.designs import design_space
from optimisation.evaluation import Threads, evaluate
from optimisation.measures import Chunk
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.cluster import Workers
from optimisation.search.settings import Rung, Settings
from optimisation.search.study import opened


def problem() -> Problem:
    return Problem(design_space("impact"), (Condition(1, 3.5), Condition(2, 35.0)), beam=Beam(modes=2), members=4, rate=20.0)


class Murderous(Workers):
    """Kills one of the workers when the first results are there."""

    victim: int | None = None

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        for count, result in enumerate(super().run(chunks)):
            if count == 2 and self.victim is not None:
                os.kill(self.victim, signal.SIGKILL)
                self.victim = None
            yield result


def compare(cluster: distributed.LocalCluster) -> None:
    given = problem()
    designs = [given.space.at([x, 0.5, y]) for x in (0.4, 0.5, 0.6) for y in (0.3, 0.7)]
    here = dict(evaluate(given, designs, given.ensemble, given.rate, Threads(2)))
    with Murderous(cluster.scheduler_address) as workers:
        workers.victim = next(iter(cluster.workers.values())).pid
        there = dict(evaluate(given, designs, given.ensemble, given.rate, workers))
        print("killed", workers.victim is None)
        print("runs", sorted(here) == sorted(there) and all(np.array_equal(there[k], values) for k, values in here.items()))
        found = []
        for executor in (Threads(), workers):
            with opened(given, Settings("cma", 4, (Rung(1, 2.0, 0.5), Rung(4)))) as study:
                study.run(5, executor)
                found.append([(e.number, dict(e.design.values), e.score, e.rungs) for e in study.told])
        print("studies", found[0] == found[1])


if __name__ == "__main__":
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as local:
        compare(local)
