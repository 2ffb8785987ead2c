"""The bars that show a search on the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from optimisation.progress import Bar, runs_bar
from optimisation.search.find import Bars
from optimisation.search.told import Progress


@contextmanager
def study_bar(label: str, wanted: int) -> Iterator[Callable[[Progress], None]]:
    """Give a function that shows how many designs are done of those that are ``wanted``, and the runs that they took."""
    with Bar(total=wanted, desc=label, unit="designs") as bar:

        def show(progress: Progress) -> None:
            bar.set_postfix_str(f"{progress.runs} runs", refresh=False)
            bar.update(progress.designs - bar.n)
            bar.refresh()

        yield show


BARS = Bars(runs_bar, study_bar)
