"""Tasks in processes of their own: on all cores, each with a time limit, and a crash is a result like any other.

numba's cache must not be filled by several processes at once, so each worker has its own copy of it; tasks that need the same kernels go to the
same worker as far as that keeps all of them busy.
"""

import multiprocessing
import os
import shutil
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from impact_env.kernels.compiling.cache import digest, folders

ENOUGH = 6  # tasks left of a kind: worth compiling its kernels once more for a worker that is idle
POLL_S = 0.5


@dataclass(frozen=True)
class Task:
    """A function of a module, called with plain values. ``kind`` names the kernels that it needs; ``limit_s`` holds once these are compiled."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    kind: str
    limit_s: float


@dataclass(frozen=True)
class Outcome:
    """What came of a task: its value, or why there is none. ``wall_s`` includes compiling where it was needed."""

    task: Task
    value: Any
    error: str
    wall_s: float


@dataclass
class _Worker:
    process: Any
    connection: Connection
    number: int
    kinds: set[str]
    task: Task | None = None
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


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set variables for the children that are started here."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _own_cache(number: int) -> str:
    """Return the parent folder of a worker's kernel cache, filled with what is compiled already."""
    known = folders()
    if known.write is None:
        return "" if known.read is None else str(known.read.parent)
    own = known.write.parent / f"worker-{number}"
    target = own / digest()
    with suppress(OSError):
        if not target.exists():
            for file in (file for filled in (known.read, known.write) if filled is not None for file in filled.glob("*/*.nb?")):
                (target / file.parent.name).mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target / file.parent.name / file.name)  # without the permissions of a folder that is only read
    return str(own if target.exists() else known.write.parent)


class Pool:
    """Worker processes; `run` yields outcomes as they come."""

    def __init__(self, workers: int, compile_s: float) -> None:
        self.context = multiprocessing.get_context("spawn")
        self.compile_s = compile_s
        self.count = workers
        self.workers: list[_Worker] = []

    def _start(self, number: int) -> _Worker:
        here, there = self.context.Pipe()
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        with _environment({"IMPACT_ENV_CACHE": _own_cache(number), **threads}):
            process = self.context.Process(target=_serve, args=(there,), daemon=True)
            process.start()
        there.close()
        return _Worker(process, here, number, set())

    def run(self, tasks: Sequence[Task]) -> Generator[Outcome, None, None]:
        """Run tasks on all workers; those of one kind start in the order given. Workers end with the generator, also when it is closed early."""
        pending = list(tasks)
        try:
            self.workers = [self._start(number) for number in range(min(self.count, max(1, len(pending))))]
            while pending or any(worker.task for worker in self.workers):
                for worker in self.workers:
                    if worker.task is None:
                        self._give(worker, pending)
                yield from self._collect()
        finally:
            self.close()

    def _give(self, worker: _Worker, pending: list[Task]) -> None:
        """Hand a worker its next task: of a kind it knows, else of a kind nobody has begun, else of one with enough left."""
        if not pending:
            return
        begun = set().union(*(other.kinds for other in self.workers))
        left: dict[str, int] = {}
        for task in pending:
            left[task.kind] = left.get(task.kind, 0) + 1
        known = next((task for task in pending if task.kind in worker.kinds), None)
        fresh = next((task for task in pending if task.kind not in begun), None)
        most = max(left, key=left.__getitem__)
        stolen = next((task for task in pending if task.kind == most), None) if left[most] >= ENOUGH else None
        chosen = known or fresh or stolen
        if chosen is None:
            return
        pending.remove(chosen)
        worker.first = chosen.kind not in worker.kinds
        worker.kinds.add(chosen.kind)
        worker.task, worker.since = chosen, time.perf_counter()
        with suppress(OSError):  # a process that has died is noticed when its answer is due
            worker.connection.send(worker.task)

    def _collect(self) -> Iterator[Outcome]:
        """Yield the outcomes that have come in, and end tasks that take too long."""
        busy = {worker.connection: worker for worker in self.workers if worker.task is not None}
        for connection in wait(list(busy), timeout=POLL_S):
            worker = busy[connection]  # type: ignore[index]
            try:
                value, error = worker.connection.recv()
            except (EOFError, OSError):
                worker.process.join(1.0)
                yield self._replace(worker, f"the process died (exit code {worker.process.exitcode})")
                continue
            yield self._outcome(worker, value, error)
        for worker in self.workers:
            if worker.task is not None:
                limit = worker.task.limit_s + (self.compile_s if worker.first else 0.0)
                if time.perf_counter() - worker.since > limit:
                    yield self._replace(worker, f"not finished after {limit:.0f} s")

    def _outcome(self, worker: _Worker, value: Any, error: str) -> Outcome:
        task = worker.task
        assert task is not None
        worker.task = None
        return Outcome(task, value, error, time.perf_counter() - worker.since)

    def _replace(self, worker: _Worker, error: str) -> Outcome:
        outcome = self._outcome(worker, None, error)
        _end(worker)
        self.workers[self.workers.index(worker)] = self._start(worker.number)
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
