"""Timing of benchmarks.

Runs are timed in turn, so that a machine that slows down affects all of them. Results are medians
of repeats, without compilation.
"""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from impact_env import Drive, Scene, linear_sweep
from impact_env.drive import PAPER_RATE
from optimisation.executors import Bar
from studies.study import Json

K = TypeVar("K")
T = TypeVar("T")
Advance = Callable[[], object]  # told of each repeat, as a bar is


class TimingSettings(NamedTuple):
    """Pseudo periods of a run, or its samples, and how often each is timed."""

    periods: float
    repeats: int


def time_call(work: Callable[[], object]) -> float:
    """Return the time of a call in s."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def time_in_turn(
    runs: Mapping[K, Callable[[], float]], repeats: int, advance: Advance = lambda: None
) -> dict[K, list[float]]:
    """Return the times in s of each repeat, by name.

    In each repeat the runs are timed one after the other.
    """
    result: dict[K, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            result[name].append(run())
        advance()
    return result


def summarise_times(result: Mapping[str, Sequence[float]]) -> Json:
    """Return the values of a benchmark's file from times in s.

    By name they are all times in us and their median.
    """
    each = {name: [1e6 * x for x in times] for name, times in result.items()}
    return {f"{name}_us_each": times for name, times in each.items()} | {
        f"{name}_us": statistics.median(times) for name, times in each.items()
    }


def measure_median_time(
    run: Callable[[], float], repeats: int, patience: float = float("inf")
) -> float:
    """Return the median of several times in s.

    No further repeat starts after ``patience`` seconds, so that slow runs are repeated less often.
    """
    began = time.perf_counter()
    times = [run()]
    while len(times) < repeats and time.perf_counter() - began < patience:
        times.append(run())
    return statistics.median(times)


def make_sweep_up(scene: Scene, force: float, start: float, periods: float) -> Drive:
    """Return the paper's sweep up from a frequency over ``periods`` pseudo periods.

    ``start`` is relative to the first resonance.
    """
    return Drive(
        force,
        linear_sweep(scene.model.resonance_omega(1), start, start + periods * PAPER_RATE / 1e4),
    )


def measure_all_cases(
    cases: Sequence[T],
    settings: TimingSettings,
    measure: Callable[[T, TimingSettings, Advance], Json],
) -> Json:
    """Measure all cases, with a bar."""
    with Bar(total=settings.repeats * len(cases), desc="timing", unit="repeat", leave=False) as bar:
        return {
            "repeats": settings.repeats,
            "cases": [measure(case, settings, bar.update) for case in cases],
        }
