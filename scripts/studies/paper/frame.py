"""Common parts of the figures of the paper's study.

They are the figure's parts, its sizes in a full and in a quick run, and the style of the drawings.

A module measures groups of plain values. From these it writes the text of the page, draws the
figure, and judges the paper's statements.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from impact_env.curve import CurveCase, PerformanceCurve, performance_curves
from impact_env.ensemble import Executor, Lane, each_lane
from impact_env.methods import Method
from impact_env.periodic.residence import drop_unfinished
from optimisation.checkpoint import sources
from optimisation.executors import sweeps_bar
from optimisation.files import markdown
from optimisation.report.report import write_figure
from studies.paper.claim import Claim, compute_bands
from studies.study import CsvTable, Json, Measurement, Part, Saver, Steps

NAME = "paper"
ROWS = 7  # of a long table that the page shows
POINTS = 2  # two numbers are a pair, not points
R = TypeVar("R")
T = TypeVar("T")


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the paper's study.

    ``folder`` is that of the numbers. ``quick`` stands for few points and members. Runs are
    computed in ``threads`` (None: all cores), or by an ``executor``.

    The numbers depend on ``quick`` and ``seed`` only.
    """

    folder: Path
    quick: bool = False
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None

    def size(self, full: T, quick: T) -> T:
        """Return the size of the whole figure, or of a quick run."""
        return quick if self.quick else full

    def curves(
        self, label: str, cases: Sequence[CurveCase], members: int, method: Method | None = None
    ) -> list[PerformanceCurve]:
        """Return performance curves, with a progress bar.

        Raises KeyboardInterrupt if the computation is interrupted, and errors as
        `performance_curves`.
        """
        with sweeps_bar(label, leave=False) as show:
            result = performance_curves(
                cases,
                members,
                self.seed,
                method,
                threads=self.threads,
                progress=show,
                executor=self.executor,
            )
        if not all(curve.complete for curve in result):
            raise KeyboardInterrupt
        return result

    def each(
        self,
        label: str,
        lanes: Sequence[Lane],
        measure: Callable[[Lane], R],
        method: Method | None = None,
    ) -> list[R]:
        """Return the results of ``measure`` for each lane, with a progress bar.

        Raises KeyboardInterrupt if the computation is interrupted, and errors as `each_lane`.

        ``measure`` is a function of a module, or a partial of one, so that it can be sent to
        another process.
        """
        with sweeps_bar(label, leave=False) as show:
            return drop_unfinished(
                each_lane(
                    lanes,
                    measure,
                    method,
                    threads=self.threads,
                    progress=show,
                    executor=self.executor,
                )
            )


class Size(SimpleNamespace):
    """Size of the computation of a figure.

    Its names, such as ``members``, ``forces`` in N and ``modes``, are chosen by the figure's
    module.
    """


@dataclass(frozen=True)
class PaperFigure:
    """A figure with the paper's ``label``.

    Its part of the page, between its markers, has the drawing, the result of ``describe`` for its
    values, and the conditions of the measurement.

    ``sizes``: how much is computed in full and in a quick run, which beside the sources is all that
    the numbers depend on. ``measure(settings, size, known)`` yields values as that of a `Part`.
    Once all are there, ``draw(values)`` returns the drawing and ``claims(values)`` the statements
    of the paper that they decide. ``tables``: those too long for the page, as CSV files, of which
    `shorten_table` shows some rows. ``answer(values)``: a line on an open question, "question:
    answer".
    """

    label: str
    title: str
    _: KW_ONLY
    sizes: tuple[Size, Size]
    measure: Callable[[PaperSettings, Any, Json], Steps]
    describe: Callable[[Json], str]
    draw: Callable[[Json], Figure]
    claims: Callable[[Json], list[Claim]]
    tables: Callable[[Json], Sequence[CsvTable]] = lambda _: ()
    answer: Callable[[Json], str] | None = None

    def part(self) -> Part[PaperSettings]:
        """Return the part of the study."""
        return Part(
            self.label,
            self.title,
            markers=(marker(self.label),),
            sections=self._sections,
            measure=lambda settings, earlier: self.measure(
                settings, settings.size(*self.sizes), earlier
            ),
            figures=lambda measured: (
                {self.label: make_saver(lambda: self.draw(measured.values))}
                if measured.complete
                else {}
            ),
            tables=lambda measured: self.tables(measured.values) if measured.complete else (),
        )

    def _sections(self, measured: Measurement) -> dict[str, str]:
        made = (
            f"{describe_amounts(measured.conditions)}"
            f"{sources(measured.conditions | {'versions': {}})} "
            f"{measured.conditions['wall_s']:g} s."
        )
        if not measured.complete:
            return {marker(self.label): f"{made} Stopped early."}
        drawn = f"![{self.title[0].upper()}{self.title[1:]}]({NAME}/{self.label}.png)"
        return {
            marker(self.label): "\n\n".join(
                [drawn, format_details("Numbers", self.describe(measured.values)), made]
            )
        }


def marker(label: str) -> str:
    """Return the name of a figure's section on the page."""
    return f"{NAME}:{label}"


def format_details(title: str, text: str) -> str:
    """Return a text that the page shows once its title is clicked."""
    return f"<details><summary>{title}</summary>\n\n{text}\n\n</details>"


def shorten_table(whole: CsvTable) -> str:
    """Return some rows of a table, its first and last among them, and where all are."""
    rows = list(whole.rows)
    selection = (
        sorted({round(k * (len(rows) - 1) / (ROWS - 1)) for k in range(ROWS)})
        if len(rows) > ROWS
        else range(len(rows))
    )
    cells = [tuple(map(str, rows[k])) for k in selection]
    return (
        f"{markdown(whole.columns, cells)}\n\nAll {len(rows)} rows: "
        f"[{whole.name}.csv]({NAME}/{whole.name}.csv)."
    )


def describe_amounts(conditions: Json) -> str:
    """Return a text with the number of members and the number of points of each list.

    The lists are the parameters in the part's key. The text is empty if the key has none.
    """
    parameters = conditions.get("key", {}).get("parameters", {})
    members = (
        [f"{parameters['members']} members"] if isinstance(parameters.get("members"), int) else []
    )
    lists = {
        name: row
        for name, row in parameters.items()
        if isinstance(row, list) and len(row) > POINTS and name.endswith("s")
    }
    points = [
        f"{len(row)} {name.replace('_', ' ')}"
        for name, row in lists.items()
        if all(isinstance(x, int | float) for x in row)
    ]
    text = ", ".join([*members, *points])
    return f"{text[0].upper()}{text[1:]}. " if text else ""


def measure_groups(groups: Mapping[str, Callable[[], object]], earlier: Json) -> Steps:
    """Yield all known values by group, after each of the groups is measured.

    Values of an earlier run are reused.
    """
    values = {name: earlier[name] for name in groups if name in earlier}
    for name, measure in groups.items():
        if name not in values:
            values = {**values, name: measure()}
            yield {own: values[own] for own in groups if own in values}
    if all(name in earlier for name in groups):
        yield values


# One style for all figures, readable in print and in grey: no two lines differ by their colour
# alone. in inches the width of a page's text
WIDTH = 7.2
DPI = 180
SMALL = 7.5  # points: the smallest letters, of legends, insets and labels beside points
MM = 1e3
RC: Any = {
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markersize": 3.5,
    "savefig.dpi": DPI,
}


@dataclass(frozen=True)
class LineStyle:
    """Colour, dashes and marker of a line.

    The colours differ in lightness, so that they are distinct in grey as well.
    """

    colour: str
    dashes: Any = "-"
    marker: str = ""


STYLES = (
    LineStyle("#0b3c6f", "-", "o"),
    LineStyle("#c1440e", (0, (5, 1.5)), "s"),
    LineStyle("#2a9d8f", (0, (5, 1.5, 1, 1.5)), "^"),
    LineStyle("#e9a23b", (0, (1.5, 1)), "D"),
    LineStyle("#8d4a97", (0, (7, 1.5, 1, 1.5, 1, 1.5)), "v"),
    LineStyle("#6b705c", (0, (3, 2.5)), "x"),
)
REFERENCE = LineStyle("black", ":")  # no absorber
STUCK = LineStyle("black", "-.")  # absorber as a fixed mass
FAINT = "0.55"  # what stands behind: sweeps, guides


def make_saver(draw: Callable[[], Figure]) -> Saver:
    """Return a function that draws a figure in this style and saves it.

    The suffix of its path chooses the format.
    """

    def save(path: Path) -> None:
        with rc_context(RC):
            write_figure(draw(), path, DPI)

    return save


def make_panels(
    rows: int, columns: int, height: float, letters: str = "abcdefgh", **options: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of the page's width and its panels (rows, columns).

    The ``height`` is in inches. If there are several panels, they are named (a), (b) and so on.

    ``letters``: of the panels row by row, a blank for one that goes with the panel before it.
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False, **options))
    if axes.size > 1:
        for letter, own in zip(letters, axes.flat, strict=False):
            own.set_title(f"({letter})".replace("( )", ""), loc="left")
    return figure, axes


def draw_line(
    axes: Axes,
    x: ArrayLike,
    y: ArrayLike,
    style: LineStyle,
    label: str | None = None,
    *,
    band: tuple[ArrayLike, ArrayLike] | None = None,
    nominal: ArrayLike | None = None,
    marked: bool = True,
) -> None:
    """Draw a median with the ``band`` of an ensemble behind it.

    The ``nominal`` member, which is the paper's own run, is drawn as a thin line.
    """
    if band is not None:
        low, high = (np.asarray(edge, dtype=float) for edge in band)
        axes.fill_between(
            np.asarray(x, dtype=float), low, high, color=style.colour, alpha=0.18, lw=0
        )
    if nominal is not None:
        axes.plot(x, nominal, color=style.colour, lw=0.5, zorder=2.5)
    axes.plot(
        x,
        y,
        color=style.colour,
        ls=style.dashes,
        marker=style.marker if marked else "",
        label=label,
        zorder=3,
    )


def draw_band(
    axes: Axes,
    x: ArrayLike,
    rows: Any,
    style: LineStyle,
    label: str | None = None,
    factor: float = 1,
    *,
    nominal: bool = True,
    marked: bool = True,
) -> None:
    """Draw the median of members' values, (points, M), with their band.

    If ``nominal`` is set, the first member is drawn as the nominal one. All values are multiplied
    by ``factor``.
    """
    low, middle, high = factor * compute_bands(rows)
    draw_line(
        axes,
        x,
        middle,
        style,
        label,
        band=(low, high),
        nominal=factor * rows[:, 0] if nominal else None,
        marked=marked,
    )


def draw_unit_level(axes: Axes, label: str | None = None) -> None:
    """Draw a line at 1, the level without absorber where levels are relative to it."""
    axes.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9, label=label)


def draw_signal(
    axes: Axes,
    x: ArrayLike,
    y: ArrayLike,
    style: LineStyle,
    label: str | None = None,
    width: float = 0.6,
) -> None:
    """Draw a thin line without markers: a record in time, or a linear response."""
    axes.plot(x, y, color=style.colour, ls=style.dashes, lw=width, label=label)


def draw_legends(axes: Sequence[Axes] | NDArray[Any]) -> None:
    """Give every panel that has labelled lines its legend."""
    for own in np.asarray(axes, dtype=object).flat:
        if own.get_legend() is None and own.get_legend_handles_labels()[1]:
            own.legend()


def draw_legend_below(figure: Figure, axes: Sequence[Axes] | NDArray[Any], columns: int) -> None:
    """Put one legend of all panels below them, each label once."""
    named: dict[str, Any] = {}
    for own in np.asarray(axes, dtype=object).flat:
        for handle, label in zip(*own.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=columns)
