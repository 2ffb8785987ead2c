"""What tables and figures of the study share: looks, and numbers in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from optimisation.machine import sources
from studies.accuracy.cases import Row
from studies.study import Measured

# Okabe and Ito's colours, and a marker as well
LOOKS = {
    "Exact": ("#0072B2", "o"),
    "closed form": ("#0072B2", "o"),
    "Moreau": ("#D55E00", "s"),
    "Runge-Kutta": ("#009E73", "^"),
    "SciPy": ("#CC79A7", "v"),
    "heyoka": ("#E69F00", "D"),
}
COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#777777")
MARKERS = "osD^vPX*"


def number(value: float | None, digits: int = 2) -> str:
    """Return a number in words, nothing for None."""
    return "" if value is None else f"{value:.{digits}g}"


SHOWN_MODES = 10  # a page shows these alone, where they were measured; figures and files have all


def shown_rows(rows: list[Row]) -> list[Row]:
    """Return the rows that a page shows."""
    return [row for row in rows if row["modes"] == SHOWN_MODES] or rows


def named(row: Row) -> str:
    """Return a row's method with its setting."""
    if row["setting"] is None:
        return str(row["method"])
    return f"{row['method']}, {row['setting']:g}" + (" steps" if row["method"] in ("Moreau", "Runge-Kutta") else "")


def made_with(measured: Measured) -> str:
    """Say when, where and with what a part was measured."""
    words = f"{sources(measured.conditions)} {measured.conditions['wall_s']:g} s."
    if measured.conditions["quick"]:
        words += " A quick look: few cases and runs."
    return words if measured.complete else words + " Stopped early: what was finished."


def plain(panel: Axes, ticks: list[float]) -> None:
    """Write the ticks of an axis as plain numbers."""
    panel.set_xticks(ticks)
    panel.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.minorticks_off()


def unique(values: Iterable[Any]) -> list[Any]:
    """Return the values without repetition, in the order in which they appear."""
    return list(dict.fromkeys(values))
