"""Expected duration and progress of the runs of a command.

The duration is estimated by a short run before the others begin. The progress is shown by bars on a
terminal, otherwise by lines.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import click
from tqdm import tqdm

from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Lane, available_cores
from impact_env.loads import Loads
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.measures import measured

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
        """Leave the bar or take it away; what stands in lines stays."""
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
    measured(lane)
    seconds = time.perf_counter() - started
    if seconds > 1.0:  # it may have been the compilation
        started = time.perf_counter()
        measured(lane)
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
