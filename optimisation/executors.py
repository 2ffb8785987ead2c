"""Executors, worker processes, progress bars and estimates of duration for the commands.

Runs are computed by threads of this process, by the workers of a cluster (`executor`), or by
processes with a time limit for each task (`Pool`). A short timed run gives the estimate before the
other runs begin. Progress is shown as bars on a terminal, otherwise as lines of text.
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

    Raises ParameterError if both ``cluster`` and ``threads`` are given, or if the package
    ``distributed`` is missing; ClusterError if no scheduler answers.
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
    """Yield the executor of a study: the cluster's `workers`, or ``threads`` (None: all cores)."""
    with workers(threads, cluster) as on:
        yield Threads(threads) if on is None else on


ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)  # limits of numerical libraries: the processes share the cores
POLL_S = 0.5  # s between two checks of the time limits


@dataclass(frozen=True)
class PoolTask:
    """A call of a function in a worker process.

    The function is defined at module level, and function, arguments and result can be pickled.
    ``kind`` names the kernels that the call needs. ``limit_s`` is the time limit in s, without
    compilation.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    kind: str
    limit_s: float


@dataclass(frozen=True)
class PoolOutcome:
    """Outcome of a task.

    ``value`` is the function's result, None after an error. ``error`` is a message, empty after
    success. ``wall_s`` is the elapsed time in s, including any compilation of kernels.
    """

    task: PoolTask
    value: Any
    error: str
    wall_s: float


@dataclass
class _Worker:
    """A worker process and its current task.

    ``kinds``: kernels that it has compiled or is compiling. ``since``: start of the task
    (`time.perf_counter`). ``first``: whether the task is the worker's first of its kind, so that
    its time limit includes compilation.
    """

    process: Any
    connection: Connection
    kinds: set[str]
    task: PoolTask | None = None
    since: float = 0.0
    first: bool = False


def _serve(connection: Connection) -> None:
    """Run the tasks that arrive, and send (value, error message) for each, until None arrives."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C
    while True:
        task = connection.recv()
        if task is None:
            return
        try:
            connection.send((task.function(*task.arguments), ""))
        except Exception as error:
            connection.send((None, f"{type(error).__name__}: {error}"))


class Pool:
    """Up to ``workers`` processes that run tasks with time limits.

    ``compile_s`` (s) is added to the time limit of a worker's first task of each kind.
    """

    def __init__(self, workers: int, compile_s: float) -> None:
        self.context = multiprocessing.get_context("spawn")
        self.compile_s = compile_s
        self.count = workers
        self.workers: list[_Worker] = []

    def _start(self) -> _Worker:
        """Start a process whose numerical libraries use one thread each."""
        near_end, far_end = self.context.Pipe()
        process = self.context.Process(target=_serve, args=(far_end,), daemon=True)
        before = dict(os.environ)
        os.environ.update(ONE_THREAD)  # the child process inherits it
        try:
            process.start()
        finally:
            for name in ONE_THREAD.keys() - before.keys():
                del os.environ[name]
            os.environ.update(before)
        far_end.close()
        return _Worker(process, near_end, set())

    def run(self, tasks: Sequence[PoolTask]) -> Generator[PoolOutcome, None, None]:
        """Run tasks on all workers, and yield their outcomes in order of completion.

        Tasks of the same kind start in the given order. All workers end when the generator ends or
        is closed.
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
        """Send a pending task to a worker, preferably of a kind that the worker has compiled."""
        if not pending:
            return
        chosen = next((task for task in pending if task.kind in worker.kinds), pending[0])
        pending.remove(chosen)
        worker.first = chosen.kind not in worker.kinds
        worker.kinds.add(chosen.kind)
        worker.task = chosen
        worker.since = time.perf_counter()
        with suppress(OSError):  # `_collect` reports a process that has died
            worker.connection.send(worker.task)

    def _collect(self) -> Iterator[PoolOutcome]:
        """Yield the outcomes of finished tasks, of dead processes, and of tasks over their limit.

        Waits at most `POLL_S`. Processes of the last two are replaced.
        """
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
        """Return the outcome of a worker's task, and mark the worker as idle."""
        task = worker.task
        worker.task = None
        assert task is not None
        return PoolOutcome(task, value, error, time.perf_counter() - worker.since)

    def _replace(self, worker: _Worker, error: str) -> PoolOutcome:
        """End a worker, start another in its place, and return its task's outcome, an error."""
        outcome = self._outcome(worker, None, error)
        _end(worker)
        self.workers[self.workers.index(worker)] = self._start()
        return outcome

    def close(self) -> None:
        """End all worker processes at once; tasks that are running are lost."""
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
    """A tqdm bar on standard error, or lines of text if standard error is not a terminal.

    A line has the numbers of the bar. Lines are at least `EVERY` seconds apart, so shorter work
    writes none.
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
        """Draw the bar, or write a line if the last is at least `EVERY` seconds old."""
        if not self.plain:
            return bool(super().display(msg, pos))
        if time.monotonic() - self.last_line >= EVERY:
            self.last_line = time.monotonic()
            self.fp.write(f"{self}\n")
            self.fp.flush()
        return True

    def close(self) -> None:
        """End the bar: it stays on the terminal if ``leave`` is set, otherwise it is erased.

        Lines of text remain, and no further line is written.
        """
        if self.plain:
            self.disable = True  # or it would draw once more
        super().close()


@contextmanager
def counting_bar(label: str, unit: str, leave: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Yield a function ``show(done, total)`` that shows the progress of a count of items.

    If ``done`` is smaller than before, a new count begins. ``unit`` names the items.
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
    """Yield a function ``show(stage, done, total)`` that shows a stage and its finished items.

    A ``total`` of 0 is unknown and not shown.
    """
    with Bar(total=None, desc=label, bar_format="{desc} [{elapsed}]", leave=leave) as bar:

        def show(what: str, done: int, total: int) -> None:
            bar.set_description_str(f"{label}: {what}, {done}" + (f" of {total}" if total else ""))

        yield show


def sweeps_bar(
    label: str, leave: bool = True
) -> AbstractContextManager[Callable[[int, int], None]]:
    """Return a `counting_bar` of sweeps."""
    return counting_bar(label, "sweeps", leave)


def runs_bar(label: str) -> AbstractContextManager[Callable[[int, int], None]]:
    """Return a `counting_bar` of runs that is erased at the end."""
    return counting_bar(label, "runs", leave=False)


LONG_S = 20.0  # a command prints its estimated duration if it is longer
PROBE_PERIODS = 50.0  # length of the timed run; it takes milliseconds
COARSER = 10.0  # factor on the sweep rate for the coarse answer that long commands print first
COARSE_PERIODS = 200.0  # least length of a sweep for the coarse answer


@dataclass(frozen=True, eq=False)
class PlannedRuns:
    """Planned sweeps of a scene near a resonance, for an estimate of their computing time.

    ``force``: typical amplitude in N. ``periods``: length of a sweep in pseudo periods.
    ``number``: number of sweeps, not necessarily whole.
    """

    scene: Scene
    force: float
    resonance: int
    periods: float
    number: float


def seconds_per_period(scene: Scene, force: float, resonance: int) -> float:
    """Return the computing time in s per pseudo period under a force in N at a resonance.

    It is the smaller result of two timed runs, so compilation does not count.
    """
    schedule = constant_frequency(scene.model.resonance_omega(resonance), 1.0, PROBE_PERIODS)
    return min(simulate(scene, Drive(force, schedule)).wall_time for _ in "12") / PROBE_PERIODS


def duration_in_words(seconds: float) -> str:
    """Return a time in s as text in s, min, h or days, with two significant digits."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}'):g} s"


def announce_duration(
    scene: Scene, force: float, resonance: int, periods: float, runs: int, threads: int | None
) -> float:
    """Return the estimated duration in s of a number of equal ``runs`` (`announce_runs`).

    ``force`` in N; ``periods``: length of a run in pseudo periods; ``threads`` None: all cores.
    """
    return announce_runs([PlannedRuns(scene, force, resonance, periods, runs)], threads)


def announce_runs(
    planned: Sequence[PlannedRuns], threads: int | None, how: str = "A higher --rate takes less."
) -> float:
    """Return the estimated duration in s of planned runs on this machine.

    An estimate above `LONG_S` is printed on standard error, followed by ``how``, advice on a
    shorter duration. The estimate is right within a factor of about three, because the timed run
    may have fewer impacts per period than a sweep.
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
    """Return the estimated duration in s of a number of ``runs`` of a scene under loads.

    One whole run is timed, a second one if the first may have included compilation. An estimate
    above `LONG_S` is printed on standard error.
    """
    lane = Lane(scene, loads, steady_start=True)
    started = time.perf_counter()
    measure_lane(lane)
    seconds = time.perf_counter() - started
    if seconds > 1.0:  # the time may include compilation
        started = time.perf_counter()
        measure_lane(lane)
        seconds = time.perf_counter() - started
    total = runs * seconds / max(1, min(threads or available_cores(), runs))
    _announce(total, runs, f" of {loads.parts[0].duration:.4g} s", "Fewer --members take less.")
    return total


def _announce(seconds: float, number: int, size: str, how: str) -> None:
    """Print a duration in s on standard error if it is above `LONG_S`.

    The text has the number of runs, their ``size`` (length, in words) and the advice ``how``.
    """
    if seconds <= LONG_S:
        return
    runs = f"{number:,} runs" if number > 1 else "one run"
    click.echo(
        f"About {duration_in_words(seconds)}, within a factor of three: {runs}{size}. {how}",
        err=True,
    )


def announce_coarse(words: str) -> None:
    """Print on standard error the coarse answer that faster sweeps give before the full runs."""
    click.echo(f"Coarse answer, of single runs {COARSER:g} times as fast: {words}", err=True)
