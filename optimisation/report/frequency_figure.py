"""The figure of a frequency response: exact branches by their stability, harmonic balance, linear curves, sweeps."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.parameters import CompliantWalls, RigidWalls, SlidingAbsorber
from impact_env.periodic.branch import FOLD
from impact_env.periodic.orbit_branches import GRAZING, PERIOD_DOUBLING, PULLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.overview import Overview
from impact_env.periodic.response_curve import EXACT, ResponseCurve
from impact_env.periodic.stationary import QUANTILES
from optimisation.report.written_figure import write_figure

MM = 1e3
DPI = 160
ASIDE = 4e-3  # of the curve's height and width: closer than this two of its stretches are one line
MARKS = {FOLD: "o", TORUS: "^", PERIOD_DOUBLING: "s", SYMMETRY_BREAKING: "D", GRAZING: "v", PULLING: "<"}
MARKED: dict[str, Any] = {"ms": 5.0, "mfc": "white", "mec": "black", "mew": 0.9}
STABLE, FAST, SLOW, BALANCE, UP, DOWN, RUNS = "#0072B2", "#56B4E9", "#D55E00", "#555555", "#009E73", "#CC79A7", "#E69F00"
LOOKS = {  # exact orbits: colour, dashes, width, label
    "stable": (STABLE, "-", 2.4, "exact orbit, stable"),
    "fast": (FAST, (0, (6, 1.5)), 2.0, "unstable by fast multipliers only"),
    "slow": (SLOW, (0, (2, 1.5)), 1.6, "unstable by the slow pair too"),
}


def save_figure(path: Path, overview: Overview) -> None:
    """Draw the largest displacement of the tip over the frequency; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(12, 6), layout="constrained")
    axes = figure.subplots()
    _sweeps(axes, overview)
    _stationary(axes, overview)
    _linear(axes, overview)
    for curve in overview.curves:
        if curve.method == EXACT:
            _exact(axes, curve)
        else:
            unstable = np.zeros(len(curve.tip_max), dtype=np.bool_) if curve.stable is None else ~curve.stable
            axes.plot(curve.omega_ratio, np.where(unstable, np.nan, MM * curve.tip_max), color=BALANCE, lw=1.0, zorder=3)
            axes.plot(curve.omega_ratio, np.where(unstable, MM * curve.tip_max, np.nan), color=BALANCE, lw=1.0, ls="--", zorder=3)
    _legend(axes, overview)
    low, high = overview.linear.omega_ratio[[0, -1]]
    tops = [curve.peak.tip_max for curve in overview.curves if curve.peak is not None]
    tops += [float(np.max(sweep.tip_max)) for sweep in overview.sweeps]
    tops += [float(np.max(at.tip_max)) for at in overview.stationary]
    axes.set(xlim=(low, high), ylim=(0, 1.15 * MM * max([*tops, _gap(overview)], default=float(np.max(overview.linear.alone)))))
    axes.set_xlabel(f"frequency of the force over {overview.reference / (2 * np.pi):.2f} Hz")
    axes.set_ylabel(f"largest displacement {overview.where} in mm")
    axes.set_title(f"{overview.scene}, {overview.force:g} N", fontsize=10)
    axes.grid(True, color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    write_figure(figure, path, DPI)


def _gap(overview: Overview) -> float:
    absorber = overview.scene.absorber
    walls = absorber.walls if isinstance(absorber, SlidingAbsorber) else None
    return walls.gap if isinstance(walls, RigidWalls | CompliantWalls) else 0.0


def _sweeps(axes: Axes, overview: Overview) -> None:
    for sweep in overview.sweeps:
        up = sweep.omega_ratio[-1] > sweep.omega_ratio[0]
        label = f"sweep {'up' if up else 'down'}, maximum of each period"
        axes.plot(sweep.omega_ratio, MM * sweep.tip_max, color=UP if up else DOWN, lw=0.7, alpha=0.8, zorder=1, label=label)


def _stationary(axes: Axes, overview: Overview) -> None:
    """Draw the median of the stationary responses, and a band between the lowest and the highest of their quantiles."""
    if not overview.stationary:
        return
    ratio = np.array([at.omega_ratio for at in overview.stationary])
    rows = MM * np.array([at.tip_max for at in overview.stationary]).T
    percent = [f"{100 * q:g}" for q in QUANTILES]
    axes.fill_between(ratio, rows[0], rows[-1], color=RUNS, alpha=0.3, lw=0, zorder=1.5, label=f"stationary runs, {percent[0]} to {percent[-1]} %")
    axes.plot(ratio, rows[len(rows) // 2], color=RUNS, lw=1.4, marker=".", ms=4, zorder=3.5, label="stationary runs, median")


def _linear(axes: Axes, overview: Overview) -> None:
    linear = overview.linear
    axes.plot(linear.omega_ratio, MM * linear.alone, color="black", lw=0.9, ls=":", zorder=2, label="no absorber")
    axes.plot(linear.omega_ratio, MM * linear.stuck, color="black", lw=0.9, ls="-.", zorder=2, label="absorber stuck")


def _kinds(curve: ResponseCurve) -> NDArray[np.str_]:
    assert curve.stable is not None
    assert curve.slowly_stable is not None
    return np.where(curve.stable, "stable", np.where(curve.slowly_stable, "fast", "slow"))


def _exact(axes: Axes, curve: ResponseCurve) -> None:
    """Draw each stretch of one stability with its look; neighbours share the point between, so that no gap is seen."""
    kinds, tip_max = _kinds(curve), MM * np.where(_drawn_already(curve), np.nan, curve.tip_max)
    ends = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    for begin, end in zip([0, *ends], [*ends, len(kinds)], strict=True):
        colour, dashes, width, _ = LOOKS[str(kinds[begin])]
        part = slice(begin, min(end + 1, len(kinds)))
        order = 4.5 if kinds[begin] == "stable" else 4  # two orbits may have the same largest displacement: the stable one is seen
        thinner = 1.0 if curve.symmetric else 0.6
        axes.plot(curve.omega_ratio[part], tip_max[part], color=colour, ls=dashes, lw=thinner * width, zorder=order)
    for mark in curve.located:
        axes.plot(mark.omega_ratio, MM * mark.tip_max, MARKS.get(mark.kind, "x"), **MARKED, zorder=5)


def _drawn_already(curve: ResponseCurve) -> NDArray[np.bool_]:
    """Return which points (m,) lie on what was drawn of their own curve before.

    A branch without symmetry leads through its mirror image, whose dashes would fill the gaps between the first ones.
    """
    rows = np.column_stack([curve.omega_ratio, curve.tip_max])
    known, found = np.isfinite(rows).all(axis=1), np.zeros(len(rows), dtype=np.bool_)
    if curve.symmetric or not np.any(known):
        return found
    rows = (rows - np.nanmin(rows, axis=0)) / np.maximum(np.ptp(rows[known], axis=0), 1e-12)
    way = np.append(0, np.cumsum(np.nan_to_num(np.hypot(*np.diff(rows, axis=0).T))))
    for k in np.flatnonzero(known):
        begin = rows[: max(int(np.searchsorted(way, way[k] - 3 * ASIDE)), 1)] - rows[k]
        chord = np.diff(begin, axis=0)
        share = np.clip(-np.sum(begin[:-1] * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-30), 0, 1)
        found[k] = np.any(np.hypot(*(begin[:-1] + share[:, None] * chord).T) < ASIDE)
    return found


def _legend(axes: Axes, overview: Overview) -> None:
    shown = {str(kind) for curve in overview.curves if curve.method == EXACT for kind in np.unique(_kinds(curve))}
    for kind, (colour, dashes, width, label) in LOOKS.items():
        if kind in shown:
            axes.plot([], [], color=colour, ls=dashes, lw=width, label=label)
    if any(not curve.symmetric for curve in overview.curves):
        axes.plot([], [], color=STABLE, lw=0.6 * LOOKS["stable"][2], label="thinner: orbits without symmetry")
    if any(curve.method != EXACT for curve in overview.curves):
        axes.plot([], [], color=BALANCE, lw=1.0, label="harmonic balance")
    if any(curve.method != EXACT and curve.stable is not None for curve in overview.curves):
        axes.plot([], [], color=BALANCE, lw=1.0, ls="--", label="the same, unstable")
    for kind in sorted({mark.kind for curve in overview.curves if curve.method == EXACT for mark in curve.located}):
        axes.plot([], [], MARKS.get(kind, "x"), **MARKED, ls="", label=kind)
    axes.figure.legend(loc="outside right upper", fontsize=8.5)  # beside the curves, not over them
