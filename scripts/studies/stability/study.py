"""The study of stiff and extreme cases: its tasks in processes, its files and its exit code."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from optimisation.page import published
from optimisation.workers import Pool
from studies.one_part import one_part
from studies.stability.page import CELL_COLUMNS, MARKERS, said, sections
from studies.stability.tasks import Results, finished, gather, tasks
from studies.study import Json, Steps, Study

NAME = "stability"
COMPILE_S = 240.0  # at most, for the kernels of a kind of scene
QUICK_OUT = Path("results/stability")
OUT = published(Path("docs/methods"), QUICK_OUT)


@dataclass(frozen=True)
class Settings:
    """Some of the cases and shorter runs, or all; number of processes."""

    quick: bool
    workers: int


def _measure(settings: Settings, known: Json) -> Steps:
    order = tasks(settings.quick)
    outcomes = finished(order, known)
    done = {(outcome.task.function, outcome.task.arguments) for outcome in outcomes}
    with closing(Pool(settings.workers, COMPILE_S).run([task for task in order if (task.function, task.arguments) not in done])) as stream:
        for outcome in stream:
            outcomes.append(outcome)
            yield vars(gather(outcomes, order))


def _steps(settings: Settings, known: Json) -> int:
    order = tasks(settings.quick)
    return len(order) - len(finished(order, known))


def _figure() -> Callable[[Path, Results], None]:
    from studies.stability.figure import save_figure  # matplotlib is slow to import

    return save_figure


STUDY: Study[Settings] = one_part(
    NAME,
    "stiff and extreme cases",
    Results,
    measure=_measure,
    steps=_steps,
    markers=MARKERS,
    sections=sections,
    said=said,
    columns=CELL_COLUMNS,
    rows=lambda results: results.cells,
    figure=_figure,
    failures=lambda results: results.failures(),
    notes=lambda settings: {"workers": settings.workers, "quick": settings.quick},
)
