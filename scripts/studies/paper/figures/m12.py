"""Drawing of the figure `m12`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from optimisation.comparison import FRICTION, IMPACT, LTVA_PAPER, LTVA_PAPER_WIDE, LTVA_TUNED_WIDE, NONE, RESONANCES
from optimisation.report.comparison_figure import ORDINALS
from optimisation.report.design_figures import force_axis
from studies.paper.curve import Curve, curve_of
from studies.paper.m12 import read
from studies.paper.style import LOOKS, MM, REFERENCE, Look, finish, line, panels
from studies.study import Json

DRAWN = {
    FRICTION: (LOOKS[1], "friction damper, 0.5 N"),
    LTVA_PAPER: (Look(LOOKS[4].colour, LOOKS[4].dashes), "LTVA, the paper's"),
    LTVA_PAPER_WIDE: (Look(LOOKS[4].colour, ":"), "LTVA, the paper's, wide sweep"),
    LTVA_TUNED_WIDE: (Look(LOOKS[2].colour, LOOKS[2].dashes), "LTVA, well tuned, wide sweep"),
    IMPACT: (LOOKS[0], "impact absorber"),
}


def save(path: Path, values: Json) -> None:
    """Draw the curves of both resonances, with the damper's own range at the second as an inset."""
    figure, grid = panels(1, 2, 4.6)
    for axes, resonance in zip(grid[0], RESONANCES, strict=True):
        part = values[f"resonance {resonance}"]
        _curves(axes, read(part))
        _limit(axes, part)
        for key in (IMPACT, FRICTION):
            own = curve_of(part["step"][key])
            axes.plot(own.forces, MM * own.level[:, 0], "x", color=DRAWN[key][0].colour, ms=3.5, mew=0.7, zorder=4)
        axes.set_title(f"{ORDINALS[resonance]} resonance", fontsize=8.5)
        axes.set(xlabel="amplitude of the force in N", ylabel="resonant response level in mm (RMS)")
        force_axis(axes.xaxis)
        force_axis(axes.yaxis)
    if "low" in values:
        _inset(grid[0, 1], read(values["low"]))
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    finish([], path, figure)


def _curves(axes: Axes, found: dict[str, Curve]) -> None:
    none = found[NONE]
    line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for key, (look, label) in DRAWN.items():
        if key in found:
            own = found[key]
            low, high = own.band
            line(axes, own.forces, MM * own.median, look, label, band=(MM * low, MM * high), nominal=MM * own.level[:, 0])
    best = int(np.argmin(np.median(found[IMPACT].relative(none), axis=1)))
    axes.axvline(none.forces[best], color="0.55", lw=0.8, ls=":")
    axes.set(xscale="log", yscale="log", xlim=(none.forces[0], none.forces[-1]))
    axes.set_ylim(0.5 * MM * min(float(np.min(own.median)) for own in found.values()), 1.3 * MM * float(np.max(none.median)))


def _limit(axes: Axes, part: Json) -> None:
    force, level = np.array(part["limit"]["force"]), MM * np.array(part["limit"]["level"])
    style: Any = {"facecolor": "0.93", "edgecolor": "0.7", "hatch": "////", "lw": 0.5, "zorder": 0.4}
    axes.fill_between(force, 1e-9, np.maximum(level, 1e-9), label="out of reach of any mass in this cavity, stationary", **style)


def _inset(axes: Axes, found: dict[str, Curve]) -> None:
    small = axes.inset_axes((0.09, 0.62, 0.40, 0.34))
    for key in (FRICTION, LTVA_PAPER, IMPACT):
        own, look = found[key], DRAWN[key][0]
        low, middle, high = np.quantile(own.relative(found[NONE]), (0.05, 0.5, 0.95), axis=1)
        small.fill_between(own.forces, low, high, color=look.colour, alpha=0.18, lw=0)
        small.plot(own.forces, middle, color=look.colour, ls=look.dashes, lw=1.0)
    small.set(xscale="log", xlim=(found[NONE].forces[0], found[NONE].forces[-1]), ylim=(0, 1.15))
    small.set_title("low forces, over no absorber", fontsize=6.5, pad=2)
    force_axis(small.xaxis)
    small.tick_params(labelsize=6)
