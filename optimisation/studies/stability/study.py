"""The study of stiff and extreme cases: its tasks in processes, its files and its exit code."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from optimisation.studies.page import published
from optimisation.studies.stability.page import CELL_COLUMNS, MARKERS, said, sections
from optimisation.studies.stability.tasks import Results, finished, gather, tasks
from optimisation.studies.study import Json, Measured, Part, Saver, Steps, Study, Table, unpack
from optimisation.workers import Pool

NAME = "stability"
COMPILE_S = 240.0  # at most, for the kernels of a kind of scene
QUICK_OUT = Path("results/stability")
OUT = published(Path("docs"), QUICK_OUT)


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


def _tables(measured: Measured) -> list[Table]:
    return [Table(NAME, CELL_COLUMNS, [[cell[name] for name in CELL_COLUMNS] for cell in measured.values["cells"]])]


def _figures(measured: Measured) -> dict[str, Saver]:
    from optimisation.studies.stability.figure import save_figure  # matplotlib is slow to import

    return {NAME: partial(save_figure, results=Results(**measured.values))}


def _failures(measured: Measured) -> list[str]:
    return list(Results(**measured.values).failures())


def _unpack(name: str, content: dict[str, Any]) -> Measured:
    measured = unpack(name, content)
    return Measured(vars(Results(**measured.values)), measured.conditions, measured.complete)


STUDY: Study[Settings] = Study(
    (
        Part(
            NAME,
            "stiff and extreme cases",
            measure=_measure,
            markers=MARKERS,
            sections=sections,
            steps=_steps,
            tables=_tables,
            figures=_figures,
            said=said,
            failures=_failures,
        ),
    ),
    notes=lambda settings: {"workers": settings.workers, "quick": settings.quick},
    unpack=_unpack,
)
