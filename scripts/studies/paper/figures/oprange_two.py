"""Drawing of the figure `oprangeTWO`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from optimisation.report.design_figures import force_axis
from studies.paper.curve import curve_of
from studies.paper.oprange_two import BOTH, LOSSY, NONE, ONE, SWEPT, THREE
from studies.paper.ranges import ranges_of
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, STUCK, finish, legend_below, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the curves, and below them the sweeps at f* over the exact orbits."""
    figure, grid = panels(2, 2, 6.4)
    _curves(grid[0, 0], values)
    for axes, name in zip(grid.flat[1:], SWEPT, strict=True):
        if f"sweeps, {name}" in values:
            _sweeps(axes, values, name)
    for axes in grid.flat[1:]:
        axes.set_ylim(0, 1.35 * MM * max(values[f"orbits, {ONE}"]["linear"]["stuck"], default=2e-3) if f"orbits, {ONE}" in values else None)
    legend_below(figure, [grid[1, 1]], 5)
    finish([grid[0, 0]], path, figure)


def _curves(axes: Axes, values: Json) -> None:
    none = curve_of(values[NONE])
    line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for look, name in zip(LOOKS, (ONE, THREE, LOSSY, BOTH), strict=False):
        own = curve_of(values[name])
        low, high = MM * np.array(own.band)
        line(axes, own.forces, MM * own.median, look, name, band=(low, high), nominal=MM * own.level[:, 0], marked=False)
        border = ranges_of(own).transition
        if border is not None:
            axes.plot(border.force, np.interp(border.force, own.forces, MM * own.median), look.marker, color=look.colour, ms=5, zorder=4)
    if "force_n" in values:
        axes.axvline(values["force_n"], color=FAINT, lw=0.9, ls=":")
        axes.text(values["force_n"], 0.03, " f*", transform=axes.get_xaxis_transform(), fontsize=8)
    axes.set(xscale="log", yscale="log", xlim=(none.forces[0], none.forces[-1]))
    axes.set(xlabel="amplitude of the force in N", ylabel="response level in mm (RMS)")
    force_axis(axes.xaxis)
    force_axis(axes.yaxis)


def _sweeps(axes: Axes, values: Json, name: str) -> None:
    look = LOOKS[(ONE, THREE, LOSSY).index(name)]
    for direction, shade in (("down", look.colour), ("up", FAINT)):
        own = values[f"sweeps, {name}"][direction]
        ratio, low, middle, high, nominal = (np.array(own[k]) for k in ("ratio", "low", "median", "high", "nominal"))
        axes.fill_between(ratio, MM * low, MM * high, color=shade, alpha=0.25, lw=0)
        axes.plot(ratio, MM * middle, color=shade, lw=1.0, ls="-" if direction == "down" else "--", label=f"swept {direction}")
        axes.plot(ratio, MM * nominal, color=shade, lw=0.4)
    orbits = values.get(f"orbits, {name}")
    if orbits is not None:
        ratio = np.array(orbits["linear"]["ratio"])
        axes.plot(ratio, MM * np.array(orbits["linear"]["alone"]), color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.8, label="no absorber")
        axes.plot(ratio, MM * np.array(orbits["linear"]["stuck"]), color=STUCK.colour, ls=STUCK.dashes, lw=0.8, label="absorber stuck")
        for k, branch in enumerate(orbits["branches"]):
            tip = MM * np.array(branch["tip"], dtype=float)
            axes.plot(branch["ratio"], tip, color="black", lw=0.8, label="periodic, two impacts" if k == 0 else None)
    axes.set(xlim=(0.9, 1.06), xlabel="frequency over $\\omega_1$", ylabel="|tip displacement| in mm")
    axes.set_title(f"    {name}, {values['force_n']:.3g} N", loc="center", fontsize=8.5)
