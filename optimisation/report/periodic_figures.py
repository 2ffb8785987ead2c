"""Figures of periodic motions: harmonic balance beside the exact orbit, an isola map, and bifurcations over two parameters."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from impact_env.periodic.balance_branches import BalanceRow, Exact
from impact_env.periodic.branch import FOLD
from impact_env.periodic.isolas import IsolaMap
from impact_env.periodic.orbit_branches import GRAZING, PERIOD_DOUBLING, PULLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.symmetric import BIRTH
from optimisation.report.written_figure import write_figure

DPI = 160
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
MARKERS = "osv^Dx"
PAPERS = 20  # harmonics in the paper


def save_balance(path: Path, exact: Exact, rows: Sequence[BalanceRow], growing: bool) -> None:
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
        if axes is not folds:  # a decade or two: more ticks than its powers
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
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


SAME = 0.012  # how far an isola's birth may move from one restitution to the next
ALONG = {"restitution": "coefficient of restitution", "friction_limit": "friction limit in N"}
KIND_MARKS = {BIRTH: "v", "merger": "^"}


def save_isolas(path: Path, found: IsolaMap) -> None:
    """Draw the fold force, and a map over each of `ALONG` that has more than one value; the ending of ``path`` chooses the format."""
    maps = [name for name in ALONG if len({getattr(cell, name) for cell in found.cells}) > 1]
    figure = Figure(figsize=(5.8 * (1 + len(maps)), 5.6), layout="constrained")
    axes = figure.subplots(1, 1 + len(maps), squeeze=False)[0]
    _force(axes[0], found)
    for place, name in zip(axes[1:], maps, strict=True):
        _map(place, found, name)
    figure.suptitle(str(found.case.scene), fontsize=10)
    write_figure(figure, path, DPI)


def _force(axes: Axes, found: IsolaMap) -> None:
    force = found.fold_force
    finite = force[np.isfinite(force)]
    axes.plot(found.omega_ratio, force, color="#0072B2", lw=1.8)
    axes.fill_between(found.omega_ratio, force, np.max(finite) * 2, color="#0072B2", alpha=0.08, lw=0, label="two symmetric orbits")
    for level in found.own.found:
        label = f"{level.kind} {level.force:.4g} N" + (", no orbit" if level.refused else "")
        axes.plot(level.omega_ratio, level.force, KIND_MARKS[level.kind], ms=8, mfc="white" if level.refused else "#D55E00", mec="black", label=label)
    top = max([level.force for level in found.own.found], default=float(np.median(finite)))
    axes.set(xlim=found.omega_ratio[[0, -1]], ylim=(0, 1.6 * top), xlabel="frequency over the first resonance's", ylabel="smallest force in N")
    _below(axes)


def _map(axes: Axes, found: IsolaMap, name: str) -> None:
    """Draw births and mergers over one parameter, the other one as in the case itself, or as in the map's last cell."""
    (other,) = (one for one in ALONG if one != name)
    own = {getattr(cell, other) for cell in found.cells}
    fixed = getattr(found.own, other) if getattr(found.own, other) in own else getattr(found.cells[-1], other)
    cells = [cell for cell in found.cells if getattr(cell, other) == fixed]
    numbers = sorted({cell.modes for cell in cells})
    for n, colour in zip(numbers, colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), strict=True):
        axes.plot([], [], color=colour, label=f"{n} mode{'s' * (n != 1)}")
        for place, style in ((0, "-"), (1, "--")):
            pairs = [(getattr(cell, name), level) for cell in cells if cell.modes == n and (level := cell.pair[place]) is not None]
            known = sorted((value, level.force, level.omega_ratio) for value, level in pairs)
            for part in _one_isola_each(np.array(known).reshape(-1, 3)):
                axes.plot(part[:, 0], part[:, 1], style, marker="v^"[place], ms=4, color=colour)
            refused = np.array([(value, level.force) for value, level in pairs if level.refused]).reshape(-1, 2)
            axes.plot(refused[:, 0], refused[:, 1], "v^"[place], ms=4, mfc="white", mec=colour, zorder=3)
    for style, label in (("k-", "birth (of the isola next to the resonance)"), ("k--", "merger")):
        axes.plot([], [], style, label=label)
    if any(level is not None and level.refused for cell in cells for level in cell.pair):
        axes.plot([], [], "ks", ms=4, mfc="white", label="open: no orbit, by the exact method")
    axes.set(xlabel=ALONG[name], ylabel="force in N", ylim=(0, None))
    axes.set_title(f"{ALONG[other].removesuffix(' in N')} {fixed:g}{' N' if other == 'friction_limit' else ''}", fontsize=9)
    _below(axes)


def _below(axes: Axes) -> None:
    axes.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13))  # below the curves, not over them
    axes.grid(True, color="0.9", lw=0.6)


def _one_isola_each(rows: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Split rows (restitution, force, ratio) where the ratio jumps: another isola is the next one to the resonance there."""
    return [part for part in np.split(rows, np.flatnonzero(np.abs(np.diff(rows[:, 2])) > SAME) + 1) if len(part)]


KIND_COLOURS = {FOLD: "#0072B2", SYMMETRY_BREAKING: "#D55E00", PERIOD_DOUBLING: "#009E73", TORUS: "#CC79A7"}
MARKS = {FOLD: "o", GRAZING: "v", PULLING: "<"}


def save_curves(path: Path, curves: list[dict[str, Any]], title: str, parameter: str, scale: float) -> None:
    """Draw the plain forms of `BifurcationCurve`, ``scale`` times the parameter's values; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(9, 5.5), layout="constrained")
    axes = figure.subplots()
    for curve in curves:
        ratio, value, colour = np.array(curve["omega_ratio"]), scale * np.array(curve["value"]), KIND_COLOURS[curve["kind"]]
        good = np.array([told == "yes" for told in curve["orbit"]])
        beside = good | np.append(good[1:], False) | np.append(False, good[:-1])  # so that no gap is seen
        axes.plot(ratio, np.where(beside, value, np.nan), color=colour, lw=1.8)
        axes.plot(ratio, np.where(good, np.nan, value), color=colour, lw=1.0, ls=":")
        for mark in curve["located"]:
            if mark["kind"] in MARKS:
                axes.plot(mark["omega_ratio"], scale * mark["value"], MARKS[mark["kind"]], color=colour, mfc="white", ms=5)
    for kind in dict.fromkeys(curve["kind"] for curve in curves):
        axes.plot([], [], color=KIND_COLOURS[kind], lw=1.8, label=kind)
    for kind in sorted({mark["kind"] for curve in curves for mark in curve["located"]} & set(MARKS)):
        label = f"{parameter} least or greatest" if kind == FOLD else kind
        axes.plot([], [], MARKS[kind], color="black", mfc="white", ms=5, label=label)
    if any(told != "yes" for curve in curves for told in curve["orbit"]):
        axes.plot([], [], color="black", lw=1.0, ls=":", label="no orbit of the true motion")
    axes.set(xlabel="frequency over the first resonance's", ylabel=parameter)
    axes.set_title(title, fontsize=10)
    axes.grid(True, color="0.9", lw=0.6)
    figure.legend(loc="outside right upper", fontsize=8.5)  # beside the curves, not over them
    write_figure(figure, path)
