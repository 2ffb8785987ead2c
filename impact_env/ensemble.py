"""Many runs at once: lanes (scene and drive) to response levels, on all cores and with the same result for any number of threads.

The kernels release Python's lock, so plain threads share one copy of everything. A lane is one `simulate` and writes only its own slot.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from typing import Literal, Protocol, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from impact_env.budget import checked_budget
from impact_env.drive import Drive, FrequencySchedule
from impact_env.families import kernel_key
from impact_env.methods import Exact, Method
from impact_env.parameters import ParameterError, count, require
from impact_env.response import DEFAULT_SAMPLES, Record
from impact_env.scene import Scene
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
PERTURBATION = 1e-6  # of the force: far above rounding and far below what a force is known to
MemberKind = Literal["both", "phase", "rounding"]
Progress = Callable[[int, int], None]  # takes the number of finished lanes and of all lanes
LANES_A_BATCH = 4  # that an executor gets at once: few enough to spread, and more work than it takes to send them
T = TypeVar("T")
R = TypeVar("R")


class Executor(Protocol):
    """Something that does work elsewhere than in threads of this process, as a cluster's workers do."""

    def each(self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]) -> Generator[tuple[int, R], None, None]:
        """Yield (number of the item, ``function(item)``) in the order in which they are finished; closing it drops what has not begun.

        Function and items can be pickled. Items of one of the ``kinds`` need the same kernels.
        """


@dataclass(frozen=True, eq=False)
class Lane:
    """One run of an ensemble, from rest."""

    scene: Scene
    drive: Drive

    def __str__(self) -> str:
        return f"{self.drive.amplitude:g} N, phase {self.drive.phase:g} rad, absorber {self.scene.absorber}"


@dataclass(frozen=True, eq=False)
class LaneLevels:
    """Results of lanes, arrays of one shape, NaN where a lane was not run; ``complete`` says whether all were.

    level: response level in m; time (s) and frequency_ratio of the maximum; max_tip: largest |q_tip| in m; number of impacts; stuck_time: time
    in joined phases in s.
    """

    level: Array
    time: Array
    frequency_ratio: Array
    max_tip: Array
    impacts: Array
    stuck_time: Array
    complete: bool


@dataclass(frozen=True, eq=False)
class Members:
    """What the members of an ensemble differ in, (M,) each: initial ``phases`` of the force in rad, and ``factors`` of its amplitude."""

    phases: Array
    factors: Array

    def __post_init__(self) -> None:
        phases, factors = (np.array(values, dtype=np.float64, ndmin=1) for values in (self.phases, self.factors))
        require(phases.ndim == 1 and phases.shape == factors.shape, "members", (phases.shape, factors.shape), "as many phases as factors")
        for name, values in (("phases", phases), ("factors", factors)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.phases)

    def __getitem__(self, which: slice) -> Members:
        return Members(self.phases[which], self.factors[which])

    @property
    def key(self) -> bytes:
        """What is the same for the same members, and else differs."""
        return self.phases.tobytes() + self.factors.tobytes()

    def drives(self, force: float, schedule: FrequencySchedule, phase: float = 0.0) -> list[Drive]:
        """Return each member's drive at a force in N whose own initial phase is ``phase`` in rad."""
        return [Drive(force * float(factor), schedule, phase + float(own)) for own, factor in zip(self.phases, self.factors, strict=True)]


def draw_members(members: int, seed: int, kind: MemberKind = "both") -> Members:
    """Return the members of an ensemble. Member 0 is the paper's run: phase 0, and the force as it is.

    Every other one stands for what nobody knows about a run, which impacts amplify: when it began, a phase uniform in [0, 2 pi), and how it
    is rounded, a force changed by a share that is uniform within `PERTURBATION`. ``kind`` "phase" and "rounding" leave one of them
    out. More members with the same seed continue the same lists, and a kind's list does not depend on the other.
    """
    count("members", members, 1)
    require(kind in get_args(MemberKind), "kind", kind, " or ".join(get_args(MemberKind)))
    own = np.random.SeedSequence(count("seed", seed, 0))
    phases, factors = np.zeros(members), np.ones(members)
    if kind != "rounding":
        phases[1:] = np.random.default_rng(own).uniform(0, 2 * np.pi, members - 1)
    if kind != "phase":
        factors[1:] += np.random.default_rng(own.spawn(1)[0]).uniform(-PERTURBATION, PERTURBATION, members - 1)
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
    progress: Progress | None = None,
    most_events: int | None = None,
    executor: Executor | None = None,
) -> LaneLevels:
    """Run lanes with a method (default: Exact) on a number of threads (default: all cores); arrays of the result are (len(lanes),).

    An ``executor`` runs them elsewhere, with the same result; it has threads of its own, so that ``threads`` must be None.

    Each lane is bit for bit what `simulate` gives. Lanes start in the order given. A KeyboardInterrupt ends the run early: lanes under way
    are finished (an executor drops them), the others stay NaN, ``complete`` is False; a second one is passed on. Raises ParameterError and
    IntegrationError, with the lane named, as `simulate` does. ``most_events`` is the budget of each lane.
    """
    method = Exact() if method is None else method
    require(threads is None or executor is None, "threads", threads, "None with an executor, which has its own")
    workers = available_cores() if threads is None else count("threads", threads, 1)
    record, budget = Record(samples_per_period=samples_per_period), checked_budget(most_events)
    keys = [kernel_key(lane.scene, method) for lane in lanes]
    values = np.full((6, len(lanes)), np.nan)

    def run(k: int) -> None:
        values[:, k] = _level_of(k, lanes[k], method, record, budget)

    if executor is None:
        _run_all(run, first_of_each(keys), len(lanes), workers, progress)
    else:
        starts = range(0, len(lanes), LANES_A_BATCH)
        batches = [LaneBatch(k, tuple(lanes[k : k + LANES_A_BATCH]), method, record, budget) for k in starts]
        _run_elsewhere(batches, [frozenset(keys[k : k + LANES_A_BATCH]) for k in starts], executor, values, progress)
    level, time, ratio, tip, impacts, stuck = values
    return LaneLevels(level, time, ratio, tip, impacts, stuck, complete=not np.isnan(level).any())


@dataclass(frozen=True, eq=False)
class LaneBatch:
    """Lanes from number ``start`` on with how to run them: plain data, which another process turns into the same levels."""

    start: int
    lanes: tuple[Lane, ...]
    method: Method
    record: Record
    most_events: int | None


def levels_of(batch: LaneBatch) -> Array:
    """Return the results of a batch, (6, lanes), in the order of `LaneLevels`; errors as in `run_lanes`."""
    numbered = enumerate(batch.lanes, batch.start)
    return np.array([_level_of(k, lane, batch.method, batch.record, batch.most_events) for k, lane in numbered]).T


def _run_elsewhere(batches: Sequence[LaneBatch], kinds: Sequence[Hashable], executor: Executor, values: Array, progress: Progress | None) -> None:
    """Fill ``values`` (6, all lanes) batch by batch."""
    done = 0
    with closing(executor.each(levels_of, batches, kinds)) as results:
        try:
            for k, found in results:
                start, lanes = batches[k].start, found.shape[1]
                values[:, start : start + lanes] = found
                done += lanes
                if progress is not None:
                    progress(done, values.shape[1])
        except KeyboardInterrupt:
            pass  # what is finished is in its slots


def _level_of(k: int, lane: Lane, method: Method, record: Record, most_events: int | None) -> tuple[float, ...]:
    try:
        response = simulate(lane.scene, lane.drive, method, record=record, most_events=most_events)
    except IntegrationError as error:
        raise IntegrationError(f"lane {k} ({lane}): {error}", error.time, error.response) from error
    except ParameterError as error:
        raise ParameterError(f"lane {k} ({lane}): {error}") from error
    level = response.level
    assert level is not None
    return level.value, level.time, level.frequency_ratio, level.max_tip, float(response.impact_count), response.stuck_time


def first_of_each(keys: Iterable[Hashable]) -> list[int]:
    """Return where each key comes first: what needs kernels that may have to be compiled."""
    first: dict[Hashable, int] = {}
    for k, key in enumerate(keys):
        first.setdefault(key, k)
    return list(first.values())


def _run_all(run: Callable[[int], None], first: list[int], total: int, workers: int, progress: Progress | None) -> None:
    """Call ``run`` for 0..total - 1, ``first`` one after the other: threads that need the same kernel would only wait for its compilation."""
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
        for future in as_completed([pool.submit(run, k) for k in range(total) if k not in set(first)]):
            finished(future)
    except KeyboardInterrupt:
        pass  # what is finished is in its slots; a second interrupt reaches the caller from the wait below
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
