"""The style of all figures, and how they are written: format by the ending, PNG with a palette.

matplotlib, which is slow to import, is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optimisation.files import replacing
from optimisation.report.report import MARKED, choose_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image

    from optimisation.report.report import Chart

COLOURS = 256
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
        COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )
