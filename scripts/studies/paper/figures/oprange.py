"""Drawing of the figure `oprange`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from optimisation.report.design_figures import force_axis
from studies.paper.curve import Curve
from studies.paper.ranges import Border, Ranges
from studies.paper.style import LOOKS, MM, REFERENCE, STUCK, finish, line, panels

SHADES = ("0.97", "0.90", "0.95")


def save(path: Path, own: Curve, none: Curve, stuck: Curve, step: Curve | None, found: Ranges) -> None:
    """Draw level over force with the ranges shaded; inset: the same relative to no absorber up to the highest force."""
    figure, grid = panels(1, 1, 4.2)
    axes = grid[0, 0]
    shown = own.forces <= 12.0
    draw_ranges(axes, found, 0.0, 12.0)
    line(axes, none.forces[shown], MM * none.median[shown], REFERENCE, "no absorber")
    low, high = own.band
    line(
        axes, own.forces[shown], MM * own.median[shown], LOOKS[0], "impact absorber, 1 mode, e = 0.75",
        band=(MM * low[shown], MM * high[shown]), nominal=MM * own.level[shown, 0],
    )  # fmt: skip
    if step is not None:
        axes.plot(step.forces[shown], MM * step.level[shown, 0], "x", color=LOOKS[1].colour, ms=4, label="one run at the paper's step")
    axes.set(
        xlim=(0.0, 12.0),
        ylim=(0.0, 1.05 * MM * float(np.max(none.median[shown]))),
    )
    axes.set(xlabel="amplitude of the force in N", ylabel="resonant response level in mm (RMS)")
    axes.legend(loc="upper left")
    _inset(axes, own, none, stuck)
    finish(grid, path, figure)


def draw_ranges(axes: Axes, found: Ranges, low: float, high: float) -> None:
    """Shade the linear, the primary and the secondary range between two forces in N."""
    edges = sorted({low, high, *(border.force for border in (found.first_impacts, found.transition) if border is not None)})
    words = ["linear"] + (["primary"] if _apart(found.first_impacts, found.transition) else []) + (["secondary"] if found.transition else [])
    for name, begin, end, shade in zip(words, edges, edges[1:], SHADES, strict=False):
        axes.axvspan(begin, end, color=shade, lw=0, zorder=0)
        own, place = axes.get_xaxis_transform(), min((begin + end) / 2, begin + 4.5)
        axes.text(place, 0.16, name, transform=own, ha="center", va="bottom", fontsize=8, color="0.3", rotation=90)


def _apart(first: Border | None, last: Border | None) -> bool:
    return first is not None and (last is None or last.force > first.force)


def _inset(axes: Axes, own: Curve, none: Curve, stuck: Curve) -> None:
    small = axes.inset_axes((0.62, 0.1, 0.36, 0.28))
    relative = np.quantile(own.relative(none), (0.05, 0.5, 0.95), axis=1)
    small.fill_between(own.forces, relative[0], relative[2], color=LOOKS[0].colour, alpha=0.18, lw=0)
    small.plot(own.forces, relative[1], color=LOOKS[0].colour)
    small.plot(own.forces, np.median(stuck.relative(none), axis=1), color=STUCK.colour, ls=STUCK.dashes, lw=0.9, label="absorber stuck")
    small.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9)
    small.set(xscale="log", xlim=(own.forces[0], own.forces[-1]), ylim=(0, 1.15))
    small.set_title("level over no absorber", fontsize=7, color="0.2", pad=2)
    small.tick_params(labelsize=6.5)
    small.legend(fontsize=6.5, loc="lower right", frameon=False)
    force_axis(small.xaxis)
