"""Where a command's runs are made, how long they will take, and how far they are.

Runs are made by this machine's cores, by a cluster's workers, or by processes whose tasks have a
time limit each. The duration is estimated by a short run before the others begin. The progress is
shown by bars on a terminal, otherwise by lines.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

import click
from tqdm import tqdm

from impact_env.checks import ParameterError
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Executor, Lane, Threads, available_cores
from impact_env.extras import how_to_install
from impact_env.loads import Loads
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.measures import measure_lane

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


BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}, {remaining} left]"
UNIT_BAR = (
    "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} {unit} [{elapsed}, {remaining} "
    "left]{postfix}"
)
EVERY = 10.0  # s between two lines


class Bar(tqdm):  # type: ignore[misc]
    """tqdm's bar on stderr, or text lines if stderr is not a terminal.

    A line with the same text is written every ten seconds.
    """

    def __init__(self, *arguments: Any, bar_format: str = UNIT_BAR, **options: Any) -> None:
        self.plain = not sys.stderr.isatty()
        self.last_line = time.monotonic()
        super().__init__(
            *arguments,
            bar_format=bar_format.replace("|{bar}|", "") if self.plain else bar_format,
            **options,
        )

    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Draw the bar, or write the line if it is due."""
        if not self.plain:
            return bool(super().display(msg, pos))
        if time.monotonic() - self.last_line >= EVERY:
            self.last_line = time.monotonic()
            self.fp.write(f"{self}\n")
            self.fp.flush()
        return True

    def close(self) -> None:
        """Erase the bar or keep it; lines of text remain."""
        if self.plain:
            self.disable = True  # or it would draw once more
        super().close()


@contextmanager
def counting_bar(label: str, unit: str, leave: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows the numbers of finished and of all items.

    A number that is smaller than the previous one begins a new count.
    """
    with Bar(total=0, desc=label, unit=unit, leave=leave) as bar:

        def show(done: int, total: int) -> None:
            if done < bar.n:
                bar.n = 0
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def stages_bar(label: str, leave: bool = True) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function that shows the stage and the numbers of finished and of all items.

    The number of all items is 0 if it is not known.
    """
    with Bar(total=None, desc=label, bar_format="{desc} [{elapsed}]", leave=leave) as bar:

        def show(what: str, done: int, total: int) -> None:
            bar.set_description_str(f"{label}: {what}, {done}" + (f" of {total}" if total else ""))

        yield show


def sweeps_bar(
    label: str, leave: bool = True
) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a `counting_bar` of sweeps."""
    return counting_bar(label, "sweeps", leave)


def runs_bar(label: str) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a `counting_bar` of runs that leaves no trace."""
    return counting_bar(label, "runs", leave=False)


LONG_S = 20.0  # from here on a command says how long it will take
PROBE_PERIODS = 50.0  # of a run that is timed: milliseconds
COARSER = 10.0  # times the rate: of the answer that comes first where a command takes long
COARSE_PERIODS = 200.0  # of a sweep, at least, for such an answer


@dataclass(frozen=True, eq=False)
class PlannedRuns:
    """Runs of a scene whose duration is estimated.

    They are a ``number`` of sweeps near a resonance under about one ``force`` in N, of ``periods``
    pseudo periods each.
    """

    scene: Scene
    force: float
    resonance: int
    periods: float
    number: float


def seconds_per_period(scene: Scene, force: float, resonance: int) -> float:
    """Return the computing time in s of a pseudo period under a force in N at a resonance.

    It is that of the shorter of two runs, without compilation.
    """
    schedule = constant_frequency(scene.model.resonance_omega(resonance), 1.0, PROBE_PERIODS)
    return min(simulate(scene, Drive(force, schedule)).wall_time for _ in "12") / PROBE_PERIODS


def duration_in_words(seconds: float) -> str:
    """Return a time in s, min, h or days with two digits."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}'):g} s"


def announce_duration(
    scene: Scene, force: float, resonance: int, periods: float, runs: int, threads: int | None
) -> float:
    """Estimate how long runs take in s, and print the estimate if it is long.

    It is printed on standard error. ``periods``: pseudo periods of a run.
    """
    return announce_runs([PlannedRuns(scene, force, resonance, periods, runs)], threads)


def announce_runs(
    planned: Sequence[PlannedRuns], threads: int | None, how: str = "A higher --rate takes less."
) -> float:
    """Estimate how long runs take in s, and print the estimate if it is long.

    It is printed on standard error. ``how``: a sentence on how to make the runs shorter.

    The run that is timed has fewer impacts than a whole sweep may have: within a factor of about
    three.
    """
    number = sum(one.number for one in planned)
    cores = max(1.0, min(threads or available_cores(), number))
    seconds = sum(
        one.number * one.periods * seconds_per_period(one.scene, one.force, one.resonance)
        for one in planned
    )
    periods = max((one.periods for one in planned), default=0.0)
    _announce(seconds / cores, round(number), f" of up to {periods:,.0f} pseudo periods", how)
    return seconds / cores


def announce_load_runs(scene: Scene, loads: Loads, runs: int, threads: int | None) -> float:
    """Estimate how long ``runs`` of a scene under loads take in s, by timing one of them.

    The estimate is printed on standard error if it is long.
    """
    lane = Lane(scene, loads, steady_start=True)
    started = time.perf_counter()
    measure_lane(lane)
    seconds = time.perf_counter() - started
    if seconds > 1.0:  # it may have been the compilation
        started = time.perf_counter()
        measure_lane(lane)
        seconds = time.perf_counter() - started
    total = runs * seconds / max(1, min(threads or available_cores(), runs))
    _announce(total, runs, f" of {loads.parts[0].duration:.4g} s", "Fewer --members take less.")
    return total


def _announce(seconds: float, number: int, size: str, how: str) -> None:
    """Print a duration on standard error where it is long."""
    if seconds <= LONG_S:
        return
    runs = f"{number:,} runs" if number > 1 else "one run"
    click.echo(
        f"About {duration_in_words(seconds)}, within a factor of three: {runs}{size}. {how}",
        err=True,
    )


def announce_coarse(words: str) -> None:
    """Print the answer that fast runs give before the others begin, on standard error."""
    click.echo(f"Coarse answer, of single runs {COARSER:g} times as fast: {words}", err=True)
