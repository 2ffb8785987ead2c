"""Searches under the bars of the commands; the search itself is `optimisation.search.find`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from tqdm import tqdm

import optimisation.search.find as searching
from optimisation.evaluation import Executor
from optimisation.problem import Problem
from optimisation.progress import UNIT_BAR, runs_bar
from optimisation.search.find import SCIPY as SCIPY
from optimisation.search.find import Bars
from optimisation.search.find import Plan as Plan
from optimisation.search.result import Cost, Findings
from optimisation.search.settings import Settings
from optimisation.search.study import DesignStudy, Progress


@contextmanager
def study_bar(label: str, wanted: int) -> Iterator[Callable[[Progress], None]]:
    with tqdm(total=wanted, desc=label, unit="designs", bar_format=UNIT_BAR, disable=None) as bar:

        def show(progress: Progress) -> None:
            bar.set_postfix_str(f"{progress.runs} runs", refresh=False)
            bar.update(progress.designs - bar.n)
            bar.refresh()

        yield show


BARS = Bars(runs_bar, study_bar)


def searched(
    label: str, problem: Problem, settings: Settings, designs: int, journal: Path | None, executor: Executor
) -> AbstractContextManager[tuple[DesignStudy, bool, Cost]]:
    return searching.searched(label, problem, settings, designs, journal, executor, BARS)


def find(problem: Problem, plan: Plan, journal: Path | None, executor: Executor) -> Findings:
    return searching.find(problem, plan, journal, executor, BARS)
