from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

pytest.importorskip("distributed")
pytest.importorskip("optuna")

import distributed
from design_studies import Array

from impact_env import Beam
from optimisation.designs import design_space
from optimisation.evaluation import Threads, evaluate
from optimisation.measures import Chunk
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.cluster import ClusterError, Workers
from optimisation.search.settings import Rung, Settings
from optimisation.search.study import opened


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as local:
        yield local


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


def test_workers_give_what_threads_give_though_one_is_killed_on_the_way(cluster: object) -> None:
    given = problem()
    designs = [given.space.at([x, 0.5, y]) for x in (0.4, 0.5, 0.6) for y in (0.3, 0.7)]
    here = dict(evaluate(given, designs, given.phases, given.rate, Threads(2)))
    with Murderous(cluster.scheduler_address) as workers:  # type: ignore[attr-defined]
        workers.victim = next(iter(cluster.workers.values())).pid  # type: ignore[attr-defined]
        there = dict(evaluate(given, designs, given.phases, given.rate, workers))
        assert workers.victim is None
    assert sorted(here) == sorted(there)
    for k, values in here.items():
        np.testing.assert_array_equal(there[k], values)


def test_study_on_a_cluster_equals_a_local_one(cluster: object) -> None:
    chosen, found = Settings("cma", 4, (Rung(1, 2.0, 0.5), Rung(4))), []
    with Workers(cluster.scheduler_address) as workers:  # type: ignore[attr-defined]
        for executor in (Threads(), workers):
            with opened(problem(), chosen) as study:
                assert study.run(5, executor)
                found.append([(e.number, dict(e.design.values), e.score, e.rungs) for e in study.told])
    assert found[0] == found[1]


def test_no_scheduler_and_no_worker_are_clear_errors() -> None:
    with pytest.raises(ClusterError, match=r"--cluster = 127\.0\.0\.1:1 is not allowed"):
        Workers("127.0.0.1:1", patience=1.0)
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", silence_logs=50) as empty:
        given = problem()
        chunks = given.chunks(given.space.default, given.phases, given.rate)
        with Workers(empty.scheduler_address, patience=1.0) as workers, pytest.raises(ClusterError, match="one or more workers"):
            list(workers.run(chunks))


def test_worker_with_other_sources_is_refused(cluster: object, monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem()
    chunks = given.chunks(given.space.default, given.phases, given.rate)
    monkeypatch.setattr("optimisation.search.cluster.cache_folder", lambda: "/cache/of/another/version")
    with Workers(cluster.scheduler_address) as workers, pytest.raises(ClusterError, match="same version of this package"):  # type: ignore[attr-defined]
        list(workers.run(chunks))


class Closing(Workers):
    """Closes the whole cluster when the first results are there."""

    cluster: object = None

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        for count, result in enumerate(super().run(chunks)):
            if count == 2:
                self.cluster.close()  # type: ignore[attr-defined]
            yield result


def test_scheduler_that_dies_is_a_clear_error() -> None:
    given = problem()
    chunks = [chunk for x in (0.2, 0.4, 0.6, 0.8) for chunk in given.chunks(given.space.at([x, 0.5, 0.5]), given.phases, given.rate)]
    local = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50)
    with Closing(local.scheduler_address, patience=2.0) as workers:
        workers.cluster = local
        with pytest.raises(ClusterError, match="the study keeps what is finished"):
            list(workers.run(chunks))
