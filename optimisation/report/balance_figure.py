"""The figure of harmonic balance beside the exact orbit: errors and folds over the number of harmonics for each weight, and what a branch takes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.periodic.balance_branches import BalanceRow, Exact
from optimisation.report.written_figure import write_figure

DPI = 160
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
MARKERS = "osv^Dx"
PAPERS = 20  # harmonics in the paper


def save_figure(path: Path, exact: Exact, rows: Sequence[BalanceRow], growing: bool) -> None:
    """Draw rows that have a solution; ``growing``: weights grow with the square of the harmonics. The ending of ``path`` chooses the format."""
    figure = Figure(figsize=(14.0, 4.4), layout="constrained")
    error, folds, cost = figure.subplots(1, 3)
    series: dict[float, list[BalanceRow]] = {}
    for row in rows:
        if row.tip_max_error is not None:
            at_papers = row.weight * (PAPERS / row.harmonics) ** 2 if growing else row.weight
            series.setdefault(round(at_papers, 6), []).append(row)
    for (weight, found), colour, marker in zip(sorted(series.items()), COLOURS * 9, MARKERS * 9, strict=False):
        label = f"weight {weight:g}" + (f" (H/{PAPERS})²" if growing else "")
        _line(error, found, "tip_max_error", 100, color=colour, marker=marker, label=label)
        _line(error, found, "peak_error", 100, color=colour, marker=marker, mfc="white", ls="--")
        _line(folds, found, "first_fold_ratio", 1, color=colour, marker=marker, label=label)
        _line(folds, found, "last_fold_ratio", 1, color=colour, marker=marker, mfc="white", ls="--")
        _line(cost, found, "cpu_seconds_per_250_points", 1, color=colour, marker=marker, label=label)
    located = sorted(fold.omega_ratio for fold in exact.curve.folds)
    for ratio, style in zip(located[:1] + located[-1:], ("-", "--"), strict=False):
        folds.axhline(ratio, color="0.4", lw=1.0, ls=style)
    error.set(yscale="log", ylabel="error of the largest tip displacement in %")
    error.set_title(f"solid: at {exact.case.omega_ratio:g}, dashed: at the peak", fontsize=9)
    folds.set(ylabel="frequency of the folds over the first resonance's")
    folds.set_title("solid: first, dashed: last, grey: exact", fontsize=9)
    cost.set(yscale="log", ylabel="processor time of 250 points in s")
    for axes in (error, folds, cost):
        axes.set(xscale="log", xlabel="number of harmonics H")
        ticks = sorted({row.harmonics for row in rows})
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.yaxis.set_major_formatter("{x:g}")
        axes.axvline(PAPERS, color="0.8", lw=1.0, zorder=0)
        axes.grid(True, color="0.9", lw=0.6)
    error.legend(fontsize=8)
    figure.suptitle(f"{exact.case.scene}, {exact.case.force:g} N; weights in $m_a\\omega_1^2$; the paper took {PAPERS} harmonics", fontsize=10)
    write_figure(figure, path, DPI)


def _line(axes: Axes, rows: Sequence[BalanceRow], name: str, scale: float, **style: Any) -> None:
    known = [(row.harmonics, scale * abs(value)) for row in rows if (value := getattr(row, name)) is not None]
    if known:
        axes.plot(*zip(*known, strict=True), lw=1.3, ms=5, **style)
