"""Progress bars of the commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from tqdm import tqdm

BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}, {remaining} left]"
UNIT_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} {unit} [{elapsed}, {remaining} left]{postfix}"


@contextmanager
def counting_bar(label: str, unit: str, leave: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Give a function that shows how many are done, and of how many; fewer than before begin a new count."""
    with tqdm(total=0, desc=label, unit=unit, bar_format=UNIT_BAR, disable=None, leave=leave) as bar:

        def show(done: int, total: int) -> None:
            if done < bar.n:
                bar.n = 0
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def stages_bar(label: str, leave: bool = True) -> Iterator[Callable[[str, int, int], None]]:
    """Give a function that shows what is being done, how many are done, and of how many (0: nobody knows)."""
    with tqdm(total=None, desc=label, bar_format="{desc} [{elapsed}]", disable=None, leave=leave) as bar:

        def show(what: str, done: int, total: int) -> None:
            bar.set_description_str(f"{label}: {what}, {done}" + (f" of {total}" if total else ""))

        yield show


def sweeps_bar(label: str, leave: bool = True) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a `counting_bar` of sweeps."""
    return counting_bar(label, "sweeps", leave)


def runs_bar(label: str) -> AbstractContextManager[Callable[[int, int], None]]:
    """Give a `counting_bar` of runs that leaves no trace."""
    return counting_bar(label, "runs", leave=False)
