"""One look for all figures of the paper's study, readable in print and in grey: no two lines differ by their colour alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from optimisation.report.figures import write_figure
from studies.paper.claim import bands
from studies.study import Saver

WIDTH, DPI = 7.2, 180  # in inches the width of a page's text
MM = 1e3
RC: Any = {
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "legend.fontsize": 7.5,
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
class Look:
    """Colour, dashes and marker of a line. Colours fall apart in grey as well: their lightness differs."""

    colour: str
    dashes: Any = "-"
    marker: str = ""


LOOKS = (
    Look("#0b3c6f", "-", "o"),
    Look("#c1440e", (0, (5, 1.5)), "s"),
    Look("#2a9d8f", (0, (5, 1.5, 1, 1.5)), "^"),
    Look("#e9a23b", (0, (1.5, 1)), "D"),
    Look("#8d4a97", (0, (7, 1.5, 1, 1.5, 1, 1.5)), "v"),
    Look("#6b705c", (0, (3, 2.5)), "x"),
)
REFERENCE = Look("black", ":")  # no absorber
STUCK = Look("black", "-.")  # absorber as a fixed mass
FAINT = "0.55"  # what stands behind: sweeps, guides


def saved(draw: Callable[[], Figure]) -> Saver:
    """Return what draws a figure in this look and saves it, and leaves the look of others as it is; the ending of its path chooses the format."""

    def save(path: Path) -> None:
        with rc_context(RC):
            write_figure(draw(), path, DPI)

    return save


def panels(rows: int, columns: int, height: float, letters: str = "abcdefgh", **options: Any) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of the page's width and ``height`` in inches, and its panels (rows, columns), named (a), (b) ... where there are several.

    ``letters``: of the panels row by row, a blank for one that goes with the panel before it.
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False, **options))
    if axes.size > 1:
        for letter, own in zip(letters, axes.flat, strict=False):
            own.set_title(f"({letter})".replace("( )", ""), loc="left")
    return figure, axes


def line(
    axes: Axes,
    x: ArrayLike,
    y: ArrayLike,
    look: Look,
    label: str | None = None,
    *,
    band: tuple[ArrayLike, ArrayLike] | None = None,
    nominal: ArrayLike | None = None,
    marked: bool = True,
) -> None:
    """Draw a median with the ``band`` of an ensemble behind it, and the paper's own run, the ``nominal`` member, as a thin line."""
    if band is not None:
        low, high = (np.asarray(edge, dtype=float) for edge in band)
        axes.fill_between(np.asarray(x, dtype=float), low, high, color=look.colour, alpha=0.18, lw=0)
    if nominal is not None:
        axes.plot(x, nominal, color=look.colour, lw=0.5, zorder=2.5)
    axes.plot(x, y, color=look.colour, ls=look.dashes, marker=look.marker if marked else "", label=label, zorder=3)


def banded(
    axes: Axes,
    x: ArrayLike,
    rows: Any,
    look: Look,
    label: str | None = None,
    factor: float = 1,
    *,
    nominal: bool = True,
    marked: bool = True,
) -> None:
    """Draw the median of members' values, (points, M), with their band, and the first one as the ``nominal`` member, all times a ``factor``."""
    low, middle, high = factor * bands(rows)
    line(axes, x, middle, look, label, band=(low, high), nominal=factor * rows[:, 0] if nominal else None, marked=marked)


def level_of_nothing(axes: Axes, label: str | None = None) -> None:
    """Draw the level without absorber where levels are over it, or what else is 1."""
    axes.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9, label=label)


def signal(axes: Axes, x: ArrayLike, y: ArrayLike, look: Look, label: str | None = None, width: float = 0.6) -> None:
    """Draw a thin line without markers: a record in time, or a linear response."""
    axes.plot(x, y, color=look.colour, ls=look.dashes, lw=width, label=label)


def legends(axes: Sequence[Axes] | NDArray[Any]) -> None:
    """Give every panel that has labelled lines its legend."""
    for own in np.asarray(axes, dtype=object).flat:
        if own.get_legend() is None and own.get_legend_handles_labels()[1]:
            own.legend()


def legend_below(figure: Figure, axes: Sequence[Axes] | NDArray[Any], columns: int) -> None:
    """Put one legend of all panels below them, each label once."""
    named: dict[str, Any] = {}
    for own in np.asarray(axes, dtype=object).flat:
        for handle, label in zip(*own.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=columns)
