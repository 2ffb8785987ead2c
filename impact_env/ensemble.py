"""Response levels of many runs at once, computed on all cores.

A lane is a scene with a drive, which `simulate` runs. The results are the same for any number of
threads.

The kernels release Python's global lock, so threads of one process use all cores. Each lane writes
only its own entry of the result.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Protocol, TypeVar, get_args, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    ParameterError,
    count,
    count_from,
    flag,
    instance,
    kind_of,
    listed,
    one_of,
    require,
    row_of,
)
from impact_env.drive import Drive, Excitation, FrequencySchedule, Member
from impact_env.fields import check_fields
from impact_env.frequency import find_steady_start
from impact_env.kernels.compiling.parts import abandon_compilations
from impact_env.loads import Loads
from impact_env.methods import Exact, Method
from impact_env.result_files import SavedResult
from impact_env.results import DEFAULT_SAMPLES, Record
from impact_env.scene import InitialState, Scene
from impact_env.solvers import kernel_key
from impact_env.sweep import IntegrationError, Stop, Stopped, simulate

Array = NDArray[np.float64]
PERTURBATION = 1e-6  # of the force: far above rounding and far below what a force is known to
MemberKind = Literal["both", "phase", "force"]
LaneProgress = Callable[[int, int], None]  # takes the number of finished lanes and of all lanes
MOST_MEMBERS = 1_000_000
# that an executor gets at once: few enough to spread, and more work than it takes to send them
LANES_A_BATCH = 4
_was_imported: set[Hashable] = (
    set()
)  # kinds of scene, with the kind of measure, that lanes of this process have run
T = TypeVar("T")
R = TypeVar("R")


@runtime_checkable
class Executor(Protocol):
    """Runs work outside the threads of this process, such as on the workers of a cluster."""

    def each(
        self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        """Yield pairs (index of the item, ``function(item)``) in the order of completion.

        ``function`` and ``items`` must be picklable. ``kinds`` has a key for each item: items with
        equal keys need the same compiled kernels. Closing the generator discards the items that
        have not begun.
        """


@dataclass(frozen=True)
class Threads:
    """The cores of this machine as an executor.

    Threads suffice because the kernels release Python's lock. The results do not depend on the
    number of ``threads``.
    """

    threads: int | None = None

    def __post_init__(self) -> None:
        if self.threads is not None:
            check_fields(self, threads=count_from(1))

    def each(
        self, function: Callable[[T], R], items: Sequence[T], _kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        """Yield results as described in `Executor`; ``_kinds`` is not used.

        Items that have begun are finished before the generator is closed. A KeyboardInterrupt does
        not wait for compilations.
        """
        pool = ThreadPoolExecutor(self.threads or available_cores())
        try:
            futures: dict[Future[R], int] = {
                pool.submit(function, item): k for k, item in enumerate(items)
            }
            for future in as_completed(futures):
                yield futures[future], future.result()
        except KeyboardInterrupt:
            with abandon_compilations():
                pool.shutdown(wait=True, cancel_futures=True)
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True, eq=False)
class Lane:
    """One run of an ensemble.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber.
    drive : Drive or Loads
        Force or loads over time.
    steady_start : bool, optional
        Start from the steady state of the linear structure under the harmonic loads
        (`find_steady_start`), without the transient of a force that appears at once.
    initial : InitialState, optional
        State at time 0. None: rest, the loads' start, or the steady state.

    Raises
    ------
    ParameterError
        An argument is of another class.
    """

    scene: Scene
    drive: Any  # Drive, or Loads
    steady_start: bool = False
    initial: InitialState | None = None

    def __post_init__(self) -> None:
        check_fields(
            self,
            scene=kind_of(Scene),
            drive=kind_of(Drive | Loads),
            initial=kind_of(InitialState | None),
            steady_start=flag,
        )

    def __str__(self) -> str:
        return f"{self.drive.describe()}, absorber {self.scene.absorber}"

    @property
    def start(self) -> InitialState | None:
        """State at time 0, the argument ``initial`` of `simulate`.

        None stands for rest, or for the start that the loads define.
        """
        if self.initial is not None:
            return self.initial
        if self.steady_start:
            return find_steady_start(self.scene, self.drive)
        return None


@dataclass(frozen=True, eq=False)
class LaneLevels(SavedResult):
    """Results of lanes as arrays of one shape, with NaN for lanes that were not run.

    Attributes
    ----------
    level : array
        Response level in m.
    time, frequency_ratio : array
        Time in s and frequency over the resonance's at the largest displacement.
    max_tip : array
        Largest ``|q_tip|`` in m.
    impacts : array
        Number of impacts.
    stuck_time : array
        Time in s in which absorber and structure moved as one.
    complete : bool
        Whether all lanes were run.
    """

    level: Array
    time: Array
    frequency_ratio: Array
    max_tip: Array
    impacts: Array
    stuck_time: Array
    complete: bool


@dataclass(frozen=True, eq=False)
class Members(SavedResult):
    """The random part of an ensemble's M members.

    Parameters
    ----------
    phases : array_like, (M,)
        Initial phases of the force in rad, added to its own.
    factors : array_like, (M,)
        Factors of the force's amplitude.

    Raises
    ------
    ParameterError
        A number is not finite, or there are not as many phases as factors.

    See Also
    --------
    draw_members : Members from a seed.

    Examples
    --------
    >>> from impact_env.ensemble import Members
    >>> len(Members([0.0, 1.5], [1.0, 1.0]))
    2
    """

    phases: Array
    factors: Array

    def __post_init__(self) -> None:
        numbers = row_of("a row of finite numbers")
        check_fields(self, phases=numbers, factors=numbers)
        require(
            len(self.phases) == len(self.factors),
            "members",
            (len(self.phases), len(self.factors)),
            "as many phases as factors",
        )

    def __len__(self) -> int:
        return len(self.phases)

    def __getitem__(self, which: slice) -> Members:
        return Members(self.phases[which], self.factors[which])

    @property
    def key(self) -> bytes:
        """Bytes that are equal for equal members only."""
        return self.phases.tobytes() + self.factors.tobytes()

    def drives(self, force: float, schedule: FrequencySchedule, phase: float = 0.0) -> list[Drive]:
        """Return each member's drive at a force in N.

        ``phase`` in rad is added to the initial phase of each member.
        """
        return [
            Drive(force * float(factor), schedule, phase + float(own))
            for own, factor in zip(self.phases, self.factors, strict=True)
        ]


def drives_of(members: Members, drive: Excitation) -> list[Excitation]:
    """Return the excitation of each member, (M,).

    Each member has its own phase and factor, and for random loads its own record.
    """
    drawn = zip(members.phases.tolist(), members.factors.tolist(), strict=True)
    return [drive.member(Member(k, phase, factor)) for k, (phase, factor) in enumerate(drawn)]


def draw_members(members: int, seed: int, kind: MemberKind = "both") -> Members:
    """Return ``members`` members of an ensemble.

    Member 0 is the paper's run, with phase 0 and the unchanged force. The others have an initial
    phase uniform in [0, 2 pi) and a factor of the force uniform in 1 +- `PERTURBATION`, which is
    far above rounding: impacts amplify such differences. ``kind`` "phase" or "force" draws only the
    phase or only the factor, with the same values as "both". More members with the same seed
    continue the same lists.
    """
    members = count("members", members, 1, MOST_MEMBERS)
    varied = one_of("kind", kind, get_args(MemberKind))
    own = np.random.SeedSequence(count("seed", seed, 0))
    phases = np.zeros(members)
    factors = np.ones(members)
    if varied != "force":
        phases[1:] = np.random.default_rng(own).uniform(0, 2 * np.pi, members - 1)
    if varied != "phase":
        factors[1:] += np.random.default_rng(own.spawn(1)[0]).uniform(
            -PERTURBATION, PERTURBATION, members - 1
        )
    return Members(phases, factors)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_lanes(
    lanes: Sequence[Lane],
    method: Method | None = None,
    *,
    threads: int | None = None,
    samples_per_period: int = DEFAULT_SAMPLES,
    progress: LaneProgress | None = None,
    most_events: int | None = None,
    executor: Executor | None = None,
    stop: Stop | None = None,
) -> LaneLevels:
    """Run lanes in parallel and return their response levels.

    Each result is bit for bit that of `simulate`.

    Parameters
    ----------
    lanes : sequence of Lane, (L,)
        Runs, which start in this order.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    threads : int, optional
        Threads (default: all cores). The result does not depend on it.
    samples_per_period : int, optional
        Samples of the level in a pseudo period.
    progress : callable, optional
        ``progress(done, total)`` is called after each run.
    most_events : int, optional
        Budget of each run, see `simulate`.
    executor : Executor, optional
        Runs the lanes elsewhere, such as on a cluster, with the same result. ``threads`` and
        ``stop`` are then not allowed.
    stop : Stop, optional
        Ends the runs from any other thread.

    Returns
    -------
    LaneLevels
        Arrays (L,). Lanes that a KeyboardInterrupt or ``stop`` left out are NaN, and ``complete``
        is False. After an interrupt lanes under way are finished (an executor drops them); a second
        interrupt is raised.

    Raises
    ------
    ParameterError, IntegrationError
        As `simulate`, with the lane named.

    Examples
    --------
    >>> from impact_env import Beam, Drive, Scene, constant_frequency, modal_model
    >>> from impact_env.ensemble import Lane, run_lanes
    >>> scene = Scene(modal_model(Beam(modes=2)))
    >>> schedule = constant_frequency(scene.model.resonance_omega(1), 1.0, 20.0)
    >>> levels = run_lanes([Lane(scene, Drive(force, schedule)) for force in (1.0, 2.0)])
    >>> print(f"{levels.level[1] / levels.level[0]:.6f}")
    2.000000
    """
    method = Exact() if method is None else method
    require(
        threads is None or executor is None,
        "threads",
        threads,
        "None with an executor, which has its own",
    )
    stop = instance("stop", stop, Stop | None)
    require(
        stop is None or executor is None,
        "stop",
        stop,
        "None with an executor, which it does not reach",
    )
    lanes = [instance("lanes", lane, Lane) for lane in listed("lanes", lanes)]
    progress = instance("progress", progress, Callable | None)
    executor = instance("executor", executor, Executor | None)
    budget = None if most_events is None else count("most_events", most_events, 1)
    measure = LevelOf(method, Record(samples_per_period=samples_per_period), budget, stop)
    values = np.full((6, len(lanes)), np.nan)
    for k, result in enumerate(
        each_lane(lanes, measure, method, threads=threads, progress=progress, executor=executor)
    ):
        if result is not None:
            values[:, k] = result
    level, time, ratio, tip, impacts, stuck = values
    return LaneLevels(level, time, ratio, tip, impacts, stuck, complete=not np.isnan(level).any())


@dataclass(frozen=True, eq=False)
class LevelOf:
    """Function object with which `run_lanes` measures a lane; it can be pickled."""

    method: Method
    record: Record
    most_events: int | None
    stop: Stop | None = None

    def __call__(self, lane: Lane) -> tuple[float, ...]:
        """Run a lane; return its six numbers in the order of `LaneLevels`."""
        response = simulate(
            lane.scene,
            lane.drive,
            self.method,
            initial=lane.start,
            record=self.record,
            most_events=self.most_events,
            stop=self.stop,
        )
        level = response.level
        assert level is not None
        return (
            level.value,
            level.time,
            level.frequency_ratio,
            level.max_tip,
            float(response.impact_count),
            response.stuck_time,
        )


def each_lane(
    lanes: Sequence[Lane],
    measure: Callable[[Lane], R],
    method: Method | None = None,
    *,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> list[R | None]:
    """Return ``measure(lane)`` of each lane in order, or None for lanes that were not run.

    Threads, executor, interruption and errors are those of `run_lanes`.

    ``measure`` may run its lane with any record and from any start, but must use ``method``, whose
    kernels are compiled in one thread. With an ``executor`` it must be picklable.
    """
    method = Exact() if method is None else method
    kind = getattr(measure, "func", type(measure))
    workers = available_cores() if threads is None else count("threads", threads, 1)
    keys = [kernel_key(lane.scene, method, lane.drive) for lane in lanes]
    result: list[R | None] = [None] * len(lanes)
    if executor is not None:
        _run_elsewhere(lanes, keys, measure, executor, result, progress)
        return result

    def run(k: int) -> None:
        with suppress(Stopped):
            result[k] = _measured(k, lanes[k], measure)
            _was_imported.add((kind, keys[k]))

    _run_all(
        run,
        [k for k in find_first_of_each(keys) if (kind, keys[k]) not in _was_imported],
        len(lanes),
        workers,
        progress,
    )
    return result


def _measured(k: int, lane: Lane, measure: Callable[[Lane], R]) -> R:
    try:
        return measure(lane)
    except Stopped:
        raise
    except IntegrationError as error:
        raise IntegrationError(f"lane {k} ({lane}): {error}", error.time, error.response) from error
    except ParameterError as error:
        raise ParameterError(f"lane {k} ({lane}): {error}") from error


def _measured_batch(measure: Callable[[Lane], R], batch: tuple[int, Sequence[Lane]]) -> list[R]:
    """Return the measures of a batch: the number of its first lane, and its lanes."""
    return [_measured(k, lane, measure) for k, lane in enumerate(batch[1], batch[0])]


def _run_elsewhere(
    lanes: Sequence[Lane],
    keys: Sequence[Hashable],
    measure: Callable[[Lane], R],
    executor: Executor,
    result: list[R | None],
    progress: LaneProgress | None,
) -> None:
    """Measure the lanes batch by batch by an executor; write the measures into ``result``."""
    starts = range(0, len(lanes), LANES_A_BATCH)
    done = 0
    batches = [(k, lanes[k : k + LANES_A_BATCH]) for k in starts]
    with closing(
        executor.each(
            partial(_measured_batch, measure),
            batches,
            [frozenset(keys[k : k + LANES_A_BATCH]) for k in starts],
        )
    ) as results:
        try:
            for number, values in results:
                result[starts[number] : starts[number] + len(values)] = values
                done += len(values)
                if progress is not None:
                    progress(done, len(lanes))
        except KeyboardInterrupt:
            pass  # what is finished is in its slots


def find_first_of_each(keys: Iterable[Hashable]) -> list[int]:
    """Return the first index of each different key, in ascending order."""
    first: dict[Hashable, int] = {}
    for k, key in enumerate(keys):
        first.setdefault(key, k)
    return list(first.values())


def _run_all(
    run: Callable[[int], None],
    first: list[int],
    total: int,
    workers: int,
    progress: LaneProgress | None,
) -> None:
    """Call ``run(k)`` for k from 0 to total - 1, the numbers in ``first`` one after the other.

    Lanes in ``first`` may need kernels compiled, and threads that need the same kernel would only
    wait for its compilation.
    """
    done = 0

    def finished(future: Future[None]) -> None:
        nonlocal done
        future.result()
        done += 1
        if progress is not None:
            progress(done, total)

    pool = ThreadPoolExecutor(workers)
    try:
        for k in first:
            finished(pool.submit(run, k))
        for future in as_completed(
            [pool.submit(run, k) for k in range(total) if k not in set(first)]
        ):
            finished(future)
    except (
        KeyboardInterrupt
    ):  # what is finished is in its slots; a second interrupt reaches the caller from this wait
        with abandon_compilations():
            pool.shutdown(wait=True, cancel_futures=True)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
