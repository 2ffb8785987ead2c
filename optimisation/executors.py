"""Executors of runs: this machine's cores, a cluster's workers, or processes with limits.

Each task of such a process has a time limit.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor, Threads
from impact_env.extras import how_to_install

if TYPE_CHECKING:
    from optimisation.search.cluster import Workers


@contextmanager
def workers(threads: int | None, cluster: str | None) -> Iterator[Workers | None]:
    """Yield the workers of the scheduler at ``cluster`` (host:port), or None without it.

    Raises ParameterError with ``threads``, which are this machine's, and where the package
    distributed is missing; ClusterError if nothing answers.
    """
    if cluster is None:
        yield None
        return
    if threads is not None:
        raise ParameterError(
            f"--threads = {threads} is not allowed: with --cluster, whose workers have their own"
        )
    try:
        from optimisation.search.cluster import Workers
    except ImportError as error:
        reason = f"where the package distributed is installed; {how_to_install('cluster')}"
        raise ParameterError(f"--cluster = {cluster} is not allowed: {reason}") from error
    with Workers(cluster) as on:
        yield on


@contextmanager
def executor(threads: int | None, cluster: str | None) -> Iterator[Executor]:
    """Give the executor of a study: `workers`, or else threads (None: all cores)."""
    with workers(threads, cluster) as on:
        yield Threads(threads) if on is None else on


ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)  # of libraries: the processes share the cores
POLL_S = 0.5


@dataclass(frozen=True)
class PoolTask:
    """A call of a module's function with plain values in a worker process.

    ``kind`` names the kernels that the call needs. ``limit_s``: time limit once these are compiled.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    kind: str
    limit_s: float


@dataclass(frozen=True)
class PoolOutcome:
    """Outcome of a task: its value, or the error because of which it has none.

    ``wall_s`` includes the compilation of kernels, if any.
    """

    task: PoolTask
    value: Any
    error: str
    wall_s: float


@dataclass
class _Worker:
    process: Any
    connection: Connection
    kinds: set[str]
    task: PoolTask | None = None
    since: float = 0.0
    first: bool = False


def _serve(connection: Connection) -> None:
    """Answer tasks until there are none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    while True:
        task = connection.recv()
        if task is None:
            return
        try:
            connection.send((task.function(*task.arguments), ""))
        except Exception as error:
            connection.send((None, f"{type(error).__name__}: {error}"))


class Pool:
    """Worker processes; `run` yields outcomes as they come."""

    def __init__(self, workers: int, compile_s: float) -> None:
        self.context = multiprocessing.get_context("spawn")
        self.compile_s = compile_s
        self.count = workers
        self.workers: list[_Worker] = []

    def _start(self) -> _Worker:
        near_end, far_end = self.context.Pipe()
        process = self.context.Process(target=_serve, args=(far_end,), daemon=True)
        before = dict(os.environ)
        os.environ.update(ONE_THREAD)  # of the child, which inherits it
        try:
            process.start()
        finally:
            for name in ONE_THREAD.keys() - before.keys():
                del os.environ[name]
            os.environ.update(before)
        far_end.close()
        return _Worker(process, near_end, set())

    def run(self, tasks: Sequence[PoolTask]) -> Generator[PoolOutcome, None, None]:
        """Run tasks on all workers, and yield their outcomes.

        Tasks of one kind start in the given order. The workers end with the generator, also if it
        is closed early.
        """
        pending = list(tasks)
        try:
            self.workers = [self._start() for _ in range(min(self.count, max(1, len(pending))))]
            while pending or any(worker.task for worker in self.workers):
                for worker in self.workers:
                    if worker.task is None:
                        self._give(worker, pending)
                yield from self._collect()
        finally:
            self.close()

    def _give(self, worker: _Worker, pending: list[PoolTask]) -> None:
        """Hand a worker its next task, of a kind whose kernels it has loaded if there is one."""
        if not pending:
            return
        chosen = next((task for task in pending if task.kind in worker.kinds), pending[0])
        pending.remove(chosen)
        worker.first = chosen.kind not in worker.kinds
        worker.kinds.add(chosen.kind)
        worker.task = chosen
        worker.since = time.perf_counter()
        with suppress(OSError):  # a process that has died is noticed when its answer is due
            worker.connection.send(worker.task)

    def _collect(self) -> Iterator[PoolOutcome]:
        """Yield the outcomes that have come in, and end tasks that take too long."""
        busy = {worker.connection: worker for worker in self.workers if worker.task is not None}
        for connection in wait(list(busy), timeout=POLL_S):
            worker = busy[connection]  # type: ignore[index]
            try:
                value, error = worker.connection.recv()
            except (EOFError, OSError):
                worker.process.join(1.0)
                yield self._replace(
                    worker, f"the process died (exit code {worker.process.exitcode})"
                )
                continue
            yield self._outcome(worker, value, error)
        for worker in self.workers:
            if worker.task is not None:
                limit = worker.task.limit_s + (self.compile_s if worker.first else 0.0)
                if time.perf_counter() - worker.since > limit:
                    yield self._replace(worker, f"not finished after {limit:.0f} s")

    def _outcome(self, worker: _Worker, value: Any, error: str) -> PoolOutcome:
        task = worker.task
        worker.task = None
        assert task is not None
        return PoolOutcome(task, value, error, time.perf_counter() - worker.since)

    def _replace(self, worker: _Worker, error: str) -> PoolOutcome:
        outcome = self._outcome(worker, None, error)
        _end(worker)
        self.workers[self.workers.index(worker)] = self._start()
        return outcome

    def close(self) -> None:
        """End all workers."""
        for worker in self.workers:
            _end(worker)
        self.workers = []


def _end(worker: _Worker) -> None:
    if worker.process.is_alive():
        worker.process.kill()
    worker.process.join()
    worker.connection.close()
