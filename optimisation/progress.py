"""Progress of the commands: bars on a terminal, and lines where there is none."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from tqdm import tqdm

BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}, {remaining} left]"
UNIT_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} {unit} [{elapsed}, {remaining} left]{postfix}"
EVERY = 10.0  # s between two lines


class Bar(tqdm):  # type: ignore[misc]
    """tqdm's bar on stderr or, where that is no terminal, a line of the same words every ten seconds."""

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
    """Give a function that shows how many are done, and of how many; fewer than before begin a new count."""
    with Bar(total=0, desc=label, unit=unit, leave=leave) as bar:

        def show(done: int, total: int) -> None:
            if done < bar.n:
                bar.n = 0
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def stages_bar(label: str, leave: bool = True) -> Iterator[Callable[[str, int, int], None]]:
    """Give a function that shows what is being done, how many are done, and of how many (0: nobody knows)."""
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
