"""Drawing of the figure `dissinf`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from optimisation.report.design_figures import force_axis
from studies.paper.curve import curve_of
from studies.paper.dissinf import CONSERVATIVE, DISSIPATIVE, LIMITS, NONE, SWEPT, impacting, sliding, swept_scenes
from studies.paper.style import LOOKS, MM, REFERENCE, Look, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the curves, and the sweeps below them."""
    figure, grid = panels(2, 1, 7.6)
    _curves(grid[0, 0], values)
    _sweeps(grid[1, 0], values)
    finish([], path, figure)


def _curves(axes: Axes, values: Json) -> None:
    none = curve_of(values[NONE])
    line(axes, none.forces, MM * none.median, REFERENCE, NONE, marked=False)
    names = {CONSERVATIVE: LOOKS[5], **{impacting(limit): look for limit, look in zip(LIMITS, LOOKS, strict=False)}, DISSIPATIVE: LOOKS[4]}
    for name, look in names.items():
        own = curve_of(values[name])
        low, high = own.band
        solid = look if name == CONSERVATIVE else Look(look.colour, "-", look.marker)
        line(axes, own.forces, MM * own.median, solid, name, band=(MM * low, MM * high), nominal=MM * own.level[:, 0], marked=name != CONSERVATIVE)
    for limit, look in zip(LIMITS, LOOKS, strict=False):
        own = curve_of(values[sliding(limit)])
        axes.plot(own.forces, MM * own.median, color=look.colour, ls=(0, (4, 2)), lw=1.0, label=sliding(limit))
    axes.set(xscale="log", yscale="log", xlim=(none.forces[0], none.forces[-1]), ylim=(0.08, 20))
    axes.set(xlabel="amplitude of the force in N", ylabel="resonant response level in mm (RMS)")
    force_axis(axes.xaxis)
    force_axis(axes.yaxis)
    axes.legend(fontsize=7, frameon=False, ncols=2, loc="upper left")


def _sweeps(axes: Axes, values: Json) -> None:
    for look, name in zip(LOOKS, swept_scenes(), strict=False):
        if f"sweep, {name}" in values:
            own = values[f"sweep, {name}"]
            ratio, low, middle, high, nominal = (np.array(own[key]) for key in ("ratio", "low", "median", "high", "nominal"))
            look = Look(look.colour, look.dashes)
            line(axes, ratio, MM * middle, look, name, band=(MM * low, MM * high), nominal=MM * nominal)
    axes.set(xlim=(0.9, 1.06), ylim=(0, None), xlabel="frequency over $\\omega_1$", ylabel=f"|tip displacement| in mm, down at {SWEPT:g} N")
    axes.legend(fontsize=7, frameon=False)
