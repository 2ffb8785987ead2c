"""Harmonic balance beside the exact orbit, as a report: a line for each setting, and the figure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from impact_env.periodic.balance_branches import BALANCE_COLUMNS, BalanceRow, ReferenceOrbit
from optimisation.measures import format_number, shorten_numbers
from optimisation.report.report import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    Column,
    Report,
    Table,
    draw_grid,
    figure_of,
    force_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, YELLOW)
MARKERS = "osv^Dx"
PAPERS = 20  # harmonics in the paper


def make_balance_report(
    exact: ReferenceOrbit, rows: Sequence[BalanceRow], growing: bool, complete: bool
) -> Report:
    """Return what `periodic balance-error` prints and writes.

    ``complete`` states whether all settings were solved.
    """
    plain = [row.to_plain() for row in rows]
    table = Table.of_values(BALANCE_COLUMNS, [list(row.values()) for row in plain])
    return Report(
        title="Harmonic balance beside the exact orbit",
        text=[orbit_lines(exact), [setting_table(rows)]],
        numbers={"complete": complete, "rows": plain},
        tables={"balance.csv": table},
        figures={"balance.png": partial(draw_balance, exact, rows, growing)},
    )


def orbit_lines(exact: ReferenceOrbit) -> list[str]:
    """Return the exact orbit and its branch in words."""
    case = exact.case
    peak = exact.curve.peak
    folds = sorted(fold.omega_ratio for fold in exact.curve.folds)
    lines = [
        (
            f"{case.scene}, {case.force:g} N. The exact orbit at {case.omega_ratio:g}: "
            f"{MM * exact.motion.tip_max:.4f} mm."
        )
    ]
    if peak is not None and folds:
        lines.append(
            f"Its branch: folds at {folds[0]:.6f} and {folds[-1]:.6f}, peak "
            f"{MM * peak.tip_max:.4f} mm at {peak.omega_ratio:.4f}."
        )
    return lines


def setting_table(rows: Sequence[BalanceRow]) -> Table:
    """Return a line for each setting of harmonic balance."""
    columns = (
        Column("harmonics", "harmonics", "{:.0f}"),
        Column("weight", "weight", "{:g}"),
        Column("tip_max_error", "error, %", "{:.2f}", 100, ""),
        Column("first_fold_ratio", "first fold", "{:.6f}", unknown=""),
        Column("last_fold_ratio", "last fold", "{:.6f}", unknown=""),
        Column("peak_error", "peak error, %", "{:.2f}", 100, ""),
        Column("cpu_seconds_per_250_points", "CPU s, 250 points", "{:.2f}", unknown=""),
        Column("ended", "ended", "{}"),
    )
    names = [column.key for column in columns[:-1]]
    cells = [
        [*(getattr(row, name) for name in names), "closed" if row.closed else row.reason]
        for row in rows
    ]
    return Table(columns, cells)


def draw_balance(exact: ReferenceOrbit, rows: Sequence[BalanceRow], growing: bool) -> Figure:
    """Draw the rows that have a solution.

    ``growing`` states whether the weights grow with the square of the number of harmonics.
    """
    figure, panels = figure_of(8.6, 7.4, 2, 2)
    error, folds, cost, empty = panels.flat
    empty.remove()
    series: dict[float, list[BalanceRow]] = {}
    for row in rows:
        if row.tip_max_error is not None:
            at_papers = row.weight * (PAPERS / row.harmonics) ** 2 if growing else row.weight
            series.setdefault(round(at_papers, 6), []).append(row)
    for (weight, points), colour, marker in zip(
        sorted(series.items()), COLOURS * 9, MARKERS * 9, strict=False
    ):
        label = f"weight {format_number(weight)}" + (f" (H/{PAPERS})²" if growing else "")
        _line(error, points, "tip_max_error", 100, color=colour, marker=marker, label=label)
        _line(error, points, "peak_error", 100, color=colour, marker=marker, mfc="white", ls="--")
        _line(folds, points, "first_fold_ratio", 1, color=colour, marker=marker, label=label)
        _line(
            folds, points, "last_fold_ratio", 1, color=colour, marker=marker, mfc="white", ls="--"
        )
        _line(
            cost, points, "cpu_seconds_per_250_points", 1, color=colour, marker=marker, label=label
        )
    located = sorted(fold.omega_ratio for fold in exact.curve.folds)
    for ratio, style in zip(located[:1] + located[-1:], ("-", "--"), strict=False):
        folds.axhline(ratio, color="0.4", lw=1.0, ls=style)
    error.set(yscale="log", ylabel="error of the largest tip displacement in %")
    error.set_title(
        f"solid: at {format_number(exact.case.omega_ratio)}, dashed: at the peak", fontsize=9
    )
    folds.set(ylabel="frequency of the folds over the first resonance's")
    folds.set_title("solid: first, dashed: last, grey: exact", fontsize=9)
    cost.set(yscale="log", ylabel="processor time of 250 points in s")
    for axes in (error, folds, cost):
        axes.set(xscale="log", xlabel="number of harmonics H")
        ticks = sorted({row.harmonics for row in rows})
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        if axes is not folds:  # a decade or two: more ticks than its powers
            force_axis(axes.yaxis)
        axes.axvline(PAPERS, color="0.8", lw=1.0, zorder=0)
        draw_grid(axes)
    error.legend(fontsize=8)
    scene = shorten_numbers(f"{exact.case.scene}, {exact.case.force:g} N")
    figure.suptitle(
        f"{scene}\nweights in $m_a\\omega_1^2$; the paper took {PAPERS} harmonics",
        fontsize=10,
    )
    return figure


def _line(axes: Axes, rows: Sequence[BalanceRow], name: str, scale: float, **style: Any) -> None:
    known = [
        (row.harmonics, scale * abs(value))
        for row in rows
        if (value := getattr(row, name)) is not None
    ]
    if known:
        axes.plot(*zip(*known, strict=True), lw=1.3, ms=5, **style)
