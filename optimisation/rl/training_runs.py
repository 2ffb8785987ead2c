"""What `train` does with its runs: one after the other with a live bar, or in several processes whose files are watched."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from optimisation.progress import Bar
from optimisation.rl.runs import Evaluation, read_evaluations
from optimisation.rl.training import Job, train
from optimisation.workers import Pool, Task

BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} steps [{elapsed}, {remaining} left{postfix}]"
WATCH_S = 1.0
NO_LIMIT_S = 1e9
Told = Callable[["Planned", Evaluation], str]


@dataclass(frozen=True)
class Planned:
    """A job and its folder."""

    job: Job
    folder: Path

    @property
    def label(self) -> str:
        """Task, algorithm and seed."""
        return f"{self.job.env_id.split('/')[1]}, {self.job.algorithm.upper()}, seed {self.job.seed}"

    def share(self, steps: int) -> int:
        """Return so many steps, at most those that the job wants."""
        return min(steps, self.job.hyperparameters.steps)

    def reached(self) -> int:
        """Return the steps at the last evaluation."""
        evaluations = read_evaluations(self.folder)
        return self.share(evaluations[-1].steps) if evaluations else 0


class Shown:
    """The bar over all steps of all runs, and a line for each evaluation where they are asked for."""

    def __init__(self, bar: Bar, told: Told | None) -> None:
        self.bar, self.told = bar, told
        self.done: dict[Path, int] = {}
        self.seen: dict[Path, int] = {}

    def __call__(self, planned: Planned, steps: int, evaluations: Sequence[Evaluation]) -> None:
        """Show the steps that a run has made, and its last evaluation if that is new."""
        if evaluations and len(evaluations) != self.seen.get(planned.folder):
            self.seen[planned.folder] = len(evaluations)
            self.bar.set_postfix_str(f"{planned.label}: {evaluations[-1].score:.4f}", refresh=False)
            if self.told is not None:
                self.bar.write(self.told(planned, evaluations[-1]))
        before = self.done.get(planned.folder, 0)
        self.done[planned.folder] = planned.share(steps)
        self.bar.update(self.done[planned.folder] - before)


def train_all(runs: Sequence[Planned], workers: int, told: Told | None = None) -> list[str]:
    """Train or go on with all runs; return what went wrong, a line for each run that failed."""
    total = sum(planned.job.hyperparameters.steps for planned in runs)
    with Bar(total=total, desc="training", unit="step", bar_format=BAR, smoothing=0.05) as bar:
        show = Shown(bar, told)
        if min(workers, len(runs)) > 1:
            return _in_processes(runs, workers, show)
        for planned in runs:
            train(planned.job, planned.folder, partial(show, planned))
    return []


def _in_processes(runs: Sequence[Planned], workers: int, show: Shown) -> list[str]:
    tasks = [Task(train, (planned.job, planned.folder, None, 1), planned.label, NO_LIMIT_S) for planned in runs]
    with _watching(runs, show):
        return [f"{outcome.task.kind}: {outcome.error}" for outcome in Pool(workers, 0.0).run(tasks) if outcome.error]


@contextmanager
def _watching(runs: Sequence[Planned], show: Shown) -> Iterator[None]:
    """Show what the runs' files say while other processes write them."""
    over = threading.Event()

    def look() -> None:
        for planned in runs:
            evaluations = read_evaluations(planned.folder)
            show(planned, evaluations[-1].steps if evaluations else 0, evaluations)

    def follow() -> None:
        while not over.wait(WATCH_S):
            look()

    watcher = threading.Thread(target=follow, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        look()


def report_failures(failures: Sequence[str]) -> None:
    """Raise ClickException with a line for each run that failed, if there are any."""
    if failures:
        raise click.ClickException("\n".join(failures))
