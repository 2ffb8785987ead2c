"""The content of an answer, `Report`, its output formats, and the style of all figures.

The formats are text, JSON, CSV, Markdown, figures, and an HTML page with curves, the card.

`CompleteAnswer` offers these forms to Python. The HTML requests nothing: its policy forbids it. Its
curves are drawn by the script of the explorer's page, which it contains with uPlot, and printed as
vectors.
"""

from __future__ import annotations

import html
import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.checks import ParameterError
from impact_env.ensemble import LaneProgress
from optimisation.files import markdown, replacing, require_writable, write_files

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image

    from impact_env.modes import ModalModel
    from impact_env.parameters import SlidingAbsorber
    from optimisation.absorber_rules import Baselines
    from optimisation.frequency_levels import WorstRun
    from optimisation.service import ImpactLoads

Json = dict[str, Any]
Record = Mapping[str, Any]
COLOURS = 7  # in report.html
# numbers of the colours that absorbers have in every figure and card, by how their names begin
ABSORBER_COLOURS = {
    "no absorber": 3,
    "impact absorber": 0,
    "friction damper": 1,
    "tuned absorber, paper": 4,
    "tuned absorber": 2,
}
MARKED = 60  # points: a curve of fewer has marks
FRAME = Path(__file__).with_name("report.html")
ASSETS = Path(__file__).parents[1] / "explore/assets"
SHARED = ("uplot-LICENSE.txt", "uplot.css", "uplot.js", "figure.js")
UNKNOWN = "not known"


def is_known(value: object) -> bool:
    """Return whether a value is neither None nor a number that is not finite."""
    return value is not None and not (isinstance(value, float) and not math.isfinite(value))


@dataclass(frozen=True)
class Row:
    """A number or words, with a label and a unit."""

    label: str
    value: float | str | None
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit in words."""
        if not is_known(self.value):
            return UNKNOWN
        if isinstance(self.value, str):
            return self.value
        return f"{self.value:.4g} {self.unit}".rstrip()


Group = tuple[str, tuple[Row, ...]]  # a heading with its rows


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    key : str
        Name in CSV and JSON; empty for a column of the text alone.
    heading : str, optional
        Name in text and Markdown, which may be empty; None for a column of CSV and JSON alone.
    show : str or callable
        Text of a cell: pattern of the value times ``scale``, or a function of the row's values by
        their keys.
    scale : float
        Unit of CSV and JSON over that of the text.
    unknown : str
        Text of a cell without a value.

    """

    key: str = ""
    heading: str | None = None
    show: str | Callable[[Record], str] = "{:.4g}"
    scale: float = 1.0
    unknown: str = "-"

    def cell(self, record: Record) -> str:
        """Return the text of a row's cell."""
        if callable(self.show):
            return self.show(record)
        value = record[self.key]
        if not is_known(value):
            return self.unknown
        return self.show.format(value if isinstance(value, str) else self.scale * value)


@dataclass(frozen=True)
class Table:
    """Rows of values in SI units, in the order of the columns with a key."""

    columns: tuple[Column, ...]
    rows: Sequence[Sequence[Any]]

    @classmethod
    def of_values(cls, keys: Iterable[str], rows: Iterable[Sequence[Any]]) -> Table:
        """Return a table for CSV and JSON alone."""
        return cls(tuple(map(Column, keys)), list(rows))

    @classmethod
    def of_words(cls, headings: Iterable[str], rows: Iterable[Sequence[str]]) -> Table:
        """Return a table for text and Markdown alone, with its cells in words."""
        columns = (Column(str(k), heading, "{}") for k, heading in enumerate(headings))
        return cls(tuple(columns), list(rows))

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the columns in CSV and JSON."""
        return tuple(column.key for column in self.columns if column.key)

    def records(self) -> list[Json]:
        """Return each row's values by their keys; None where a number is not finite."""
        return [
            {
                key: value if is_known(value) else None
                for key, value in zip(self.keys, row, strict=True)
            }
            for row in self.rows
        ]

    def to_csv(self) -> tuple[tuple[str, ...], Iterable[Sequence[object]]]:
        """Return names and rows for `optimisation.files.write_files`.

        The cell of a value that is not known is empty.
        """
        return self.keys, (["" if not is_known(x) else x for x in row] for row in self.rows)

    def to_text(self) -> str:
        """Return the columns with a heading as an aligned Markdown table."""
        columns = [column for column in self.columns if column.heading is not None]
        cells = [[column.cell(record) for column in columns] for record in self.records()]
        return markdown([column.heading or "" for column in columns], cells)


@dataclass(frozen=True)
class Curve:
    """Points (x, y) with a name, and a band if there is one; ``points``: not joined by a line."""

    name: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    low: Sequence[float | None] = ()
    high: Sequence[float | None] = ()
    points: bool = False

    def in_order(self) -> Curve:
        """Return the curve with its points by x, without those that have none."""
        order = sorted(
            (i for i, x in enumerate(self.x) if x is not None),
            key=lambda i: self.x[i],  # type: ignore[arg-type, return-value]
        )
        x, y, low, high = (
            [values[i] for i in order if values] for values in (self.x, self.y, self.low, self.high)
        )
        return replace(self, x=x, y=y, low=low, high=high)


@dataclass(frozen=True)
class Chart:
    """Curves over one axis, with marked places on it."""

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    marks: tuple[tuple[str, float], ...] = ()
    log_x: bool = False
    log_y: bool = False


def choose_colours(chart: Chart) -> list[int]:
    """Return the number of each curve's colour.

    It is that of the curve's absorber, or else the first free one.
    """
    chosen: list[int | None] = []
    for curve in chart.curves:
        known = (k for name, k in ABSORBER_COLOURS.items() if curve.name.startswith(name))
        colour = next(known, None)
        chosen.append(None if colour in chosen else colour)
    free = [k for k in range(COLOURS) if k not in chosen] or list(range(COLOURS))
    turns = cycle(free)
    return [next(turns) if colour is None else colour for colour in chosen]


def show_span(
    low: str, high: str, scale: float = 1.0, pattern: str = "{:.4g}"
) -> Callable[[Record], str]:
    """Return a cell's text from two keys: a range, or a dash where it is not known."""

    def show(record: Record) -> str:
        ends = record[low], record[high]
        if not all(map(is_known, ends)):
            return "-"
        return " to ".join(pattern.format(scale * end) for end in ends)

    return show


Block = Sequence[str | Table]  # lines and tables without a blank line between
Draw = Callable[[], "Figure"]


@dataclass(frozen=True, kw_only=True)
class Report:
    """The content of a result, in SI units unless a unit is named.

    Attributes
    ----------
    title : str
        Heading of the card.
    verdict : str
        The result in one sentence, with which the card begins.
    text : sequence of blocks
        Lines and tables that are printed, with a blank line between blocks.
    numbers : dict or list
        Content of summary.json, or of the file of --json.
    tables : dict
        Tables by the names of their CSV files.
    data : dict
        Further JSON files by their names.
    figures : dict
        Functions that draw, by the names of their files; the first is the main figure.
    resolution : float
        Dots per inch of figures.
    groups : tuple
        Rows of the card under their headings; empty: no card.
    charts : tuple of Chart
        Curves of the card.
    warnings : tuple of str
        Warnings on the card.
    prints_card : bool
        Whether the card is printed below the text.
    """

    title: str
    verdict: str = ""
    text: Sequence[Block] = ()
    numbers: Json | list[Json] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    data: Mapping[str, Json] = field(default_factory=dict)
    figures: Mapping[str, Draw] = field(default_factory=dict)
    resolution: float = 160
    groups: tuple[Group, ...] = ()
    charts: tuple[Chart, ...] = ()
    warnings: tuple[str, ...] = ()
    prints_card: bool = False


def render_text(report: Report) -> str:
    """Return what a command prints."""
    blocks = [
        "\n".join(part.to_text() if isinstance(part, Table) else part for part in block)
        for block in report.text
        if block
    ]
    if report.prints_card and report.groups:
        blocks.append(render_card_text(report))
    return "\n\n".join(blocks)


def render_card_text(report: Report) -> str:
    """Return the card to read in a terminal."""
    width = max((len(row.label) for _, rows in report.groups for row in rows), default=0)
    lines = [report.title]
    for heading, rows in report.groups:
        lines += ["", heading, *(f"  {row.label:<{width}}  {row.text}" for row in rows)]
    if report.warnings:
        lines += ["", "Warnings", *(f"  {line}" for line in report.warnings)]
    return "\n".join(lines)


def render_markdown(report: Report) -> str:
    """Return text, card and warnings as Markdown."""
    parts = [f"# {report.title}"]
    for block in report.text:
        parts += [part.to_text() if isinstance(part, Table) else part for part in block]
    for heading, rows in report.groups:
        cells = [(row.label, row.text) for row in rows]
        parts += [f"## {heading}", markdown(("", ""), cells)]
    if report.warnings:
        parts += ["## Warnings", "\n".join(f"- {line}" for line in report.warnings)]
    return "\n\n".join(part for part in parts if part) + "\n"


def render_card_json(report: Report) -> Json:
    """Return the card as JSON values."""
    groups = {
        heading: [
            {
                "label": row.label,
                "value": row.value if is_known(row.value) else None,
                "unit": row.unit,
            }
            for row in rows
        ]
        for heading, rows in report.groups
    }
    return {
        "title": report.title,
        "verdict": report.verdict,
        "groups": groups,
        "warnings": list(report.warnings),
    }


def render_html(report: Report) -> str:
    """Return the card as one HTML page."""
    parts = [f"<h1>{html.escape(report.title)}</h1>"]
    if report.verdict:
        parts.append(f"<p class='verdict'>{html.escape(report.verdict)}</p>")
    if report.warnings:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in report.warnings)
        parts.append(f"<ul class='warnings'>{items}</ul>")
    parts.append("<div class='groups'>")
    for heading, rows in report.groups:
        cells = "".join(
            f"<tr><th>{html.escape(row.label)}</th><td>{html.escape(row.text)}</td></tr>"
            for row in rows
        )
        parts.append(f"<section><h2>{html.escape(heading)}</h2><table>{cells}</table></section>")
    parts.append("</div>")
    charts = json.dumps([_figure(chart) for chart in report.charts], allow_nan=False)
    filled = {
        "title": html.escape(report.title),
        "body": "\n".join(parts),
        "charts": charts.replace("<", "\\u003c"),
    }
    filled |= {name: (ASSETS / name).read_text(encoding="utf-8") for name in SHARED}
    frame = FRAME.read_text(encoding="utf-8")
    return re.sub(r"\{\{([\w.-]+)\}\}", lambda match: filled[match[1]], frame)


def list_files(report: Report, folder: Path) -> dict[Path | None, object]:
    """Return summary, tables, figures and card of a report by their paths.

    They are in the form of `optimisation.files.write_files`.
    """
    contents: dict[Path | None, object] = {
        folder / name: table.to_csv() for name, table in report.tables.items()
    }
    if report.numbers:
        contents[folder / "summary.json"] = report.numbers
    contents |= {folder / name: content for name, content in report.data.items()}
    for name, draw in report.figures.items():
        contents[folder / name] = partial(write_drawing, draw=draw, dpi=report.resolution)
    if report.groups:
        contents[folder / "card.html"] = partial(write_html, report=report)
        contents[folder / "card.json"] = render_card_json(report)
    return contents


def list_named_files(
    report: Report, json: Path | None, csv: Path | None = None, plot: Path | None = None
) -> dict[Path | None, object]:
    """Return the numbers, first table and first figure of a report by the options' paths.

    The result is an argument of `optimisation.files.write_files`.

    No file is written for a path of None, nor for a part that the report does not have.
    """
    contents: dict[Path | None, object] = {json: report.numbers}
    for table in list(report.tables.values())[:1]:
        contents[csv] = table.to_csv()
    for draw in list(report.figures.values())[:1]:
        contents[plot] = partial(write_drawing, draw=draw, dpi=report.resolution)
    return contents


def write_drawing(path: Path, draw: Draw, dpi: float = 160) -> None:
    """Draw a figure into a file; the ending of ``path`` chooses the format."""
    write_figure(draw(), path, dpi)


def write_html(path: Path, report: Report) -> None:
    """Write the card as an HTML page."""
    with replacing(path) as temporary:
        temporary.write_text(render_html(report), encoding="utf-8")


def _figure(chart: Chart) -> Json:
    """Return a chart as figure.js draws it."""
    lines = list[Json]()
    areas = list[Json]()
    for colour, unsorted in zip(choose_colours(chart), chart.curves, strict=True):
        curve = unsorted.in_order()
        x, y, low, high = (
            [None if v is None or (log and v <= 0) else v for v in values]
            for values, log in (
                (curve.x, chart.log_x),
                (curve.y, chart.log_y),
                (curve.low, chart.log_y),
                (curve.high, chart.log_y),
            )
        )
        own: Json = {"name": curve.name, "colour": f"c{colour}", "x": x}
        lines.append(
            own
            | {
                "y": y,
                "width": 0 if curve.points else 2,
                "points": curve.points or len(x) < MARKED,
                "hollow": curve.points,
            }
        )
        areas += [own | {"low": low, "high": high, "strength": 0.2}] if low else []
    axes: Json = {
        "x": {"label": chart.x, "short": chart.x, "log": chart.log_x},
        "y": {"label": chart.y, "log": chart.log_y},
    }
    return axes | {
        "title": chart.title,
        "lines": lines,
        "areas": areas,
        "marks": [{"name": name, "x": at} for name, at in chart.marks],
    }


# Groups of rows that several answers have: the device, its service loads, other absorbers,
# assumptions. In SI units.

Rows = tuple[Row, ...]
RATE = "% per 100 pseudo periods"
NO_DEVICE = "no device in this cavity comes below"


def mass_rows(mass_ratio: float, model: ModalModel) -> Rows:
    """Return an absorber's mass and what it is a share of."""
    own = Row("absorber mass", mass_ratio * model.beam_mass, "kg")
    return own, Row("that is", 100 * mass_ratio, f"% of the structure's {model.beam_mass:.4g} kg")


def device_rows(absorber: SlidingAbsorber, model: ModalModel) -> Rows:
    """Return an impact absorber between rigid walls as it is built."""
    walls = absorber.walls
    friction = absorber.friction
    return (
        *mass_rows(absorber.mass_ratio, model),
        Row("clearance to either wall", 1e3 * walls.gap, "mm"),  # type: ignore[union-attr]
        Row("coefficient of restitution", float(walls.restitution)),  # type: ignore[union-attr]
        Row("friction limit", 0.0 if friction is None else friction.limit, "N"),
    )


def baseline_rows(baselines: Baselines) -> Rows:
    """Return the lines about other absorbers of the same mass."""
    damper = f"best friction damper of this mass, {baselines.damper_limit:.4g} N"
    return (
        Row("best tuned absorber of this mass", 1e3 * baselines.tuned, "mm"),
        Row(damper, 1e3 * baselines.damper, "mm"),
    )


def service_rows(gap: float, impacts: ImpactLoads, level: float) -> Rows:
    """Return the lines about a device's service: its structure has the ``level`` in m."""
    return (
        Row("stroke of the absorber, wall to wall", 2e3 * gap, "mm"),
        Row("largest impact speed", impacts.largest, "m/s"),
        Row("RMS impact speed", impacts.rms, "m/s"),
        Row("impacts", impacts.rate, "1/s"),
        Row("power lost in impacts", 1e3 * impacts.power, "mW"),
        Row(
            "largest acceleration of the structure, harmonic part",
            math.sqrt(2) * level * impacts.omega**2,
            "m/s^2",
        ),
    )


def assumed_rows(
    model: ModalModel, resonances: Sequence[int], rate: float | None, more: str = ""
) -> Rows:
    """Return the lines about the runs behind the levels; ``rate`` None: no sweeps."""
    rows = [
        Row(
            f"resonance {r}",
            (
                f"{model.resonance_omega(r) / (2 * math.pi):.4g} Hz, damping ratio "
                f"{100 * model.damping_ratio[r - 1]:.4g} %"
            ),
        )
        for r in dict.fromkeys(resonances)
    ]
    swept = () if rate is None else (Row("sweeps up and down at", rate, RATE),)
    return *rows, Row("modes kept", f"{model.modes}{more or '; more are not tried'}"), *swept


def with_band(
    value: float, low: float, high: float, pattern: str = "{:.4g}", unit: str = ""
) -> str:
    """Return a value with its unit, followed by its band in brackets.

    The band is left out if it is not known (NaN), or if its ends agree to the digits shown.
    """
    if math.isnan(low) or math.isnan(high):
        low = high = value
    ends = pattern.format(low), pattern.format(high)
    text = f"{pattern.format(value)} {unit}".rstrip()
    return text if ends[0] == ends[1] else f"{text} ({ends[0]} to {ends[1]})"


def between(low: float, high: float) -> str:
    """Return a range of forces in words."""
    return "at no force that is known" if math.isnan(low) else f"{low:.3g} to {high:.3g} N"


# what is run and the number of runs, about; gives the progress of these runs
Stages = Callable[[str, int], AbstractContextManager[LaneProgress | None]]


@contextmanager
def silent_stages(_label: str, _runs: int) -> Iterator[LaneProgress | None]:
    """Give no progress."""
    yield None


class CompleteAnswer(ABC):
    """A result with all its output formats, which are rendered from `report`."""

    @abstractmethod
    def make_report(self) -> Report:
        """Return the content of the result."""

    @cached_property
    def report(self) -> Report:
        """The content of the result: text, numbers, tables, figures and card."""
        return self.make_report()

    def __str__(self) -> str:
        """Return the text that the command prints."""
        return render_text(self.report)

    def to_json(self) -> Json:
        """Return the content of summary.json: plain data in SI units."""
        numbers = self.report.numbers
        assert isinstance(numbers, dict)
        return numbers

    def to_markdown(self) -> str:
        """Return text and card as Markdown."""
        return render_markdown(self.report)

    def to_html(self) -> str:
        """Return the card as one HTML page with curves that loads nothing else.

        Raises ParameterError without a card.
        """
        if not self.report.groups:
            raise ParameterError("this answer has no card: it was left out, or does not exist here")
        return render_html(self.report)

    def plot(self) -> Figure:
        """Return the first matplotlib figure of the result.

        Raises ParameterError if there is nothing to draw.
        """
        for draw in self.report.figures.values():
            return draw()
        raise ParameterError("this answer has no figure: nothing was run that could be drawn")

    def worst_run(self) -> WorstRun | None:
        """Return the recorded run with the highest level of the device, or None."""
        return None

    def device_scene(self) -> Json | None:
        """Return structure and recommended device as plain data, or None without a device.

        Other commands read these data with --scene.
        """
        return None

    def save(self, folder: Path | str) -> list[Path]:
        """Write summary, tables, figures and card into a folder and return their paths.

        The folder is created if it does not exist. Raises ParameterError if it is not writable.
        """
        folder = Path(folder)
        require_writable("folder", folder)
        return write_files(list_files(self.report, folder))


# Figures: their style, and how they are written. matplotlib, which is slow to import, is imported
# when something is drawn.

PALETTE_COLOURS = 256  # of a PNG
MM = 1e3
BLACK = "#000000"
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
PINK = "#CC79A7"
SKY = "#56B4E9"
YELLOW = "#E69F00"  # of Okabe and Ito
GREY = "0.55"
CHART_COLOURS = (BLUE, ORANGE, GREEN, BLACK, PINK, YELLOW, SKY)  # in the order of report.html
MARK_STYLES = ("--", ":", "-.")
TICKS = (1, 1.5, 2, 3, 5, 7)  # of a decade
HATCHED: dict[str, Any] = {
    "facecolor": "0.93",
    "edgecolor": "0.72",
    "hatch": "////",
    "lw": 0.8,
}  # what no device can reach


def figure_of(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure of a size in inches with its axes.

    They are one, a row, or an array (rows, columns). ``options`` as in `Figure.subplots`.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, (axes[0, 0] if columns == 1 else axes[0]) if rows == 1 else axes


def figure_with(count: int, height: float = 4.6) -> tuple[Figure, list[Axes]]:
    """Return a figure with this many panels side by side."""
    figure, axes = figure_of(max(5.4 * count, 6.4), height, 1, count)
    return figure, list(np.atleast_1d(axes))


def draw_charts(charts: Sequence[Chart]) -> Figure:
    """Draw a panel for each chart of a card, its curves in the card's colours."""
    figure, panels = figure_with(len(charts))
    for panel, chart in zip(panels, charts, strict=True):
        draw_chart(panel, chart)
    return figure


def draw_chart(panel: Axes, chart: Chart) -> None:
    """Draw curves with their bands, and marked places."""
    for number, unsorted in zip(choose_colours(chart), chart.curves, strict=True):
        colour = CHART_COLOURS[number]
        curve = unsorted.in_order()
        x, y, low, high = (
            np.array([np.nan if value is None else value for value in values])
            for values in (curve.x, curve.y, curve.low, curve.high)
        )
        if len(low):
            panel.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
        marker = "o" if curve.points or 2 < len(x) < MARKED else ""
        panel.plot(
            x,
            y,
            color=colour,
            lw=0 if curve.points else 1.8,
            marker=marker,
            ms=4,
            mfc="white" if curve.points else colour,
            label=curve.name,
        )
    for k, (name, at) in enumerate(chart.marks):
        style = MARK_STYLES[k % len(MARK_STYLES)]
        panel.axvline(at, color=GREY, lw=1.3, ls=style, label=f"{name}: {at:.3g}")
    if chart.log_x:
        panel.set_xscale("log")
        force_axis(panel.xaxis, TICKS)
    if chart.log_y:
        panel.set_yscale("log")
        force_axis(panel.yaxis)
    else:
        values = (value for curve in chart.curves for value in (*curve.y, *curve.low))
        negative = any(value is not None and value < 0 for value in values)
        panel.set_ylim(min(0.0, panel.get_ylim()[0] if negative else 0.0), None)
    panel.set_xlabel(chart.x)
    panel.set_ylabel(chart.y)
    panel.set_title(chart.title, fontsize=10)
    draw_grid(panel)
    panel.legend(fontsize=8.5, framealpha=0.95)


def force_axis(axis: Any, subs: tuple[float, ...] = (1, 2, 5)) -> None:
    """Put 1, 2 and 5 of each decade, or others, on a logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def draw_grid(panel: Axes) -> None:
    """Draw a light grid behind all else."""
    panel.grid(True, color="0.9", lw=0.7)
    panel.set_axisbelow(True)


def draw_legend(figure: Figure, panel: Axes, columns: int = 5, **options: Any) -> Any:
    """Put one panel's legend below the figure, and return it."""
    handles, labels = panel.get_legend_handles_labels()
    settings = {"ncols": min(columns, len(labels)), "frameon": False, "fontsize": 9} | options
    return figure.legend(handles, labels, loc="outside lower center", **settings)


def write_figure(figure: Figure, path: Path, dpi: float = 160) -> None:
    """Write a figure, completely or not at all.

    The ending of its path names the format (PNG without an ending).

    A PNG has a palette of 256 colours: less than half as large, and off by less than one of 255
    steps of a colour in the mean, at edges of lines.
    """
    from PIL import Image  # which matplotlib needs

    kind = path.suffix[1:] or "png"
    with replacing(path) as temporary:
        if kind != "png":
            figure.savefig(temporary, dpi=dpi, format=kind)
            return
        drawn = BytesIO()
        figure.savefig(drawn, dpi=dpi, format=kind)
        few_colours(Image.open(drawn)).save(temporary, format=kind, optimize=True, dpi=(dpi, dpi))


def few_colours(image: Image.Image) -> Image.Image:
    """Return an image with a palette of few colours, without dithering."""
    from PIL import Image

    return image.convert("RGB").quantize(
        PALETTE_COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
