"""Many runs at once: lanes (scene and drive) to response levels, on all cores and with the same result for any number of threads.

The kernels release Python's lock, so plain threads share one copy of everything. A lane is one `simulate` and writes only its own slot.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.budget import checked_budget
from impact_env.drive import Drive
from impact_env.methods import Exact, Method, check_supported
from impact_env.parameters import ParameterError, SlidingAbsorber, count
from impact_env.response import DEFAULT_SAMPLES, Record
from impact_env.scene import Scene
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # takes the number of finished lanes and of all lanes


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


def member_phases(members: int, seed: int) -> Array:
    """Return the initial phases of the force, (members,) in rad: 0 for member 0 (the paper's run), the others uniform in [0, 2 pi).

    More members with the same seed continue the same list.
    """
    count("members", members, 1)
    generator = np.random.default_rng(count("seed", seed, 0))
    return np.concatenate([[0.0], generator.uniform(0, 2 * np.pi, members - 1)])


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
) -> LaneLevels:
    """Run lanes with a method (default: Exact) on a number of threads (default: all cores); arrays of the result are (len(lanes),).

    Each lane is bit for bit what `simulate` gives. Lanes start in the order given. A KeyboardInterrupt ends the run early: lanes under way
    are finished, the others stay NaN, ``complete`` is False; a second one is passed on. Raises ParameterError and IntegrationError,
    with the lane named, as `simulate` does. ``most_events`` is the budget of each lane.
    """
    method = Exact() if method is None else method
    workers = available_cores() if threads is None else count("threads", threads, 1)
    record, budget = Record(samples_per_period=samples_per_period), checked_budget(most_events)
    for scene in {id(lane.scene): lane.scene for lane in lanes}.values():
        check_supported(scene, method)
    values = np.full((6, len(lanes)), np.nan)

    def run(k: int) -> None:
        values[:, k] = _level_of(k, lanes[k], method, record, budget)

    _run_all(run, _first_of_each_kind(lanes), len(lanes), workers, progress)
    level, time, ratio, tip, impacts, stuck = values
    return LaneLevels(level, time, ratio, tip, impacts, stuck, complete=not np.isnan(level).any())


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


def _first_of_each_kind(lanes: Sequence[Lane]) -> list[int]:
    """Return the first lane of each kind of scene: the kernels are compiled once for each combination of parts."""
    first: dict[tuple[type, ...], int] = {}
    for k, lane in enumerate(lanes):
        absorber = lane.scene.absorber
        parts = (absorber.walls, absorber.friction) if isinstance(absorber, SlidingAbsorber) else ()
        first.setdefault((type(absorber), *map(type, parts)), k)
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
