"""Progress bars of the scripts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}, {remaining} left]"
SWEEPS_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} sweeps [{elapsed}, {remaining} left]"


@contextmanager
def sweeps_bar(label: str, leave: bool = True) -> Iterator[Callable[[int, int], None]]:
    """Give a function that shows how many sweeps are done, and of how many."""
    with tqdm(total=0, desc=label, bar_format=SWEEPS_BAR, disable=None, leave=leave) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show
