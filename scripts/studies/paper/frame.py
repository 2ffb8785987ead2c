"""What each figure of the paper's study is, and how much of it is computed where.

A module measures in groups of plain values, says them in words, draws them, and reads the paper's claims from them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

from matplotlib.figure import Figure

from impact_env.curve import CurveCase, PerformanceCurve, performance_curves
from impact_env.ensemble import Executor, Lane, each_lane
from impact_env.methods import Method
from impact_env.parameters import count
from impact_env.periodic.residence import finished
from optimisation.machine import sources
from optimisation.page import markdown
from optimisation.progress import sweeps_bar
from studies.paper.claim import Claim
from studies.paper.style import saved
from studies.study import Json, Measured, Part, Steps, Table

NAME = "paper"
ROWS = 7  # of a long table that the page shows
POINTS = 2  # two numbers are a pair, not points
R = TypeVar("R")
T = TypeVar("T")


@dataclass(frozen=True)
class Settings:
    """``folder`` of the numbers; ``quick``: a look with few points and members; runs in ``threads`` (None: all cores), or by an ``executor``.

    The numbers depend on ``quick`` and ``seed`` only.
    """

    folder: Path
    quick: bool = False
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        count("seed", self.seed, 0)
        if self.threads is not None:
            count("threads", self.threads, 1)

    def size(self, full: T, quick: T) -> T:
        """Return one of two sizes: that of the whole figure, or that of a look."""
        return quick if self.quick else full

    def curves(self, label: str, cases: Sequence[CurveCase], members: int, method: Method | None = None) -> list[PerformanceCurve]:
        """Return performance curves, with a bar; raises KeyboardInterrupt if they are broken off, errors as `performance_curves`."""
        with sweeps_bar(label, leave=False) as show:
            found = performance_curves(cases, members, self.seed, method, threads=self.threads, progress=show, executor=self.executor)
        if not all(curve.complete for curve in found):
            raise KeyboardInterrupt
        return found

    def each(self, label: str, lanes: Sequence[Lane], measure: Callable[[Lane], R], method: Method | None = None) -> list[R]:
        """Return what ``measure`` finds of each lane, with a bar; raises KeyboardInterrupt if that is broken off, errors as `each_lane`.

        ``measure`` is a function of a module or a frozen value that can be called, so that it can be sent to another process.
        """
        with sweeps_bar(label, leave=False) as show:
            return finished(each_lane(lanes, measure, method, threads=self.threads, progress=show, executor=self.executor))


class Size(SimpleNamespace):
    """How much of a figure is computed: ``members``, ``forces`` in N, ``modes``, ... as the figure's module names and takes them."""


@dataclass(frozen=True)
class PaperFigure:
    """A figure with the paper's ``label``: between its markers stand the drawing, ``words`` of its values, and what they were measured by.

    ``sizes``: how much is computed in full and in a quick look, which beside the sources is all that the numbers depend on. ``measure(settings, size,
    known)`` yields values as that of a `Part`. Once all are there, ``draw(values)`` returns the drawing and ``claims(values)`` the statements of the
    paper that they decide. ``tables``: those too long for the page, as CSV files, of which `shortened` shows some rows. ``answer(values)``: a line on
    an open question, "what is asked: what was found".
    """

    label: str
    title: str
    _: KW_ONLY
    sizes: tuple[Size, Size]
    measure: Callable[[Settings, Any, Json], Steps]
    words: Callable[[Json], str]
    draw: Callable[[Json], Figure]
    claims: Callable[[Json], list[Claim]]
    tables: Callable[[Json], Sequence[Table]] = lambda _: ()
    answer: Callable[[Json], str] | None = None

    def part(self) -> Part[Settings]:
        """Return the part of the study."""
        return Part(
            self.label, self.title, markers=(marker(self.label),), sections=self._sections,
            measure=lambda settings, known: self.measure(settings, settings.size(*self.sizes), known),
            figures=lambda measured: {self.label: saved(lambda: self.draw(measured.values))} if measured.complete else {},
            tables=lambda measured: self.tables(measured.values) if measured.complete else (),
        )  # fmt: skip

    def _sections(self, measured: Measured) -> dict[str, str]:
        made = f"{amounts(measured.conditions)}{sources(measured.conditions)} {measured.conditions['wall_s']:g} s."
        if not measured.complete:
            return {marker(self.label): f"{made} Stopped early."}
        drawn = f"![{self.title[0].upper()}{self.title[1:]}]({NAME}/{self.label}.png)"
        return {marker(self.label): "\n\n".join([drawn, folded("Numbers", self.words(measured.values)), made])}


def marker(label: str) -> str:
    """Return the name of a figure's section on the page."""
    return f"{NAME}:{label}"


def folded(title: str, text: str) -> str:
    """Return a text that the page shows once its title is clicked."""
    return f"<details><summary>{title}</summary>\n\n{text}\n\n</details>"


def shortened(whole: Table) -> str:
    """Return some rows of a table, its first and last among them, and where all are."""
    rows = list(whole.rows)
    kept = sorted({round(k * (len(rows) - 1) / (ROWS - 1)) for k in range(ROWS)}) if len(rows) > ROWS else range(len(rows))
    cells = [tuple(map(str, rows[k])) for k in kept]
    return f"{markdown(whole.columns, cells)}\n\nAll {len(rows)} rows: [{whole.name}.csv]({NAME}/{whole.name}.csv)."


def amounts(conditions: Json) -> str:
    """Say how many members there are, and how many points of each list of numbers, by the parameters of the part's key; empty if it has none."""
    parameters = conditions.get("key", {}).get("parameters", {})
    members = [f"{parameters['members']} members"] if isinstance(parameters.get("members"), int) else []
    lists = {name: row for name, row in parameters.items() if isinstance(row, list) and len(row) > POINTS and name.endswith("s")}
    points = [f"{name} {len(row)}" for name, row in lists.items() if all(isinstance(x, int | float) for x in row)]
    said = "; ".join([*members, *([f"number of points: {', '.join(points)}"] if points else [])])
    return f"{said[0].upper()}{said[1:]}. " if said else ""


def in_turn(groups: Mapping[str, Callable[[], object]], known: Json) -> Steps:
    """Yield all values that are known after each of the groups, by its name; those of an earlier run are kept."""
    values = {name: known[name] for name in groups if name in known}
    for name, measure in groups.items():
        if name not in values:
            values = {**values, name: measure()}
            yield {own: values[own] for own in groups if own in values}
    if all(name in known for name in groups):
        yield values
