"""The figure high_low: exact orbits by their stability, harmonic balance, and the two linear curves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from optimisation.studies.paper.style import FAINT, LOOKS, MM, REFERENCE, STUCK, finish, legend_below, panels
from optimisation.studies.study import Json

KINDS = (  # of an exact orbit: unstable slowly, unstable by fast multipliers only, stable; its look and words
    (LOOKS[1].colour, (0, (1.5, 1.2)), 1.4, "exact orbit, unstable"),
    (LOOKS[0].colour, (0, (5, 1.2)), 1.8, "exact orbit, unstable by fast multipliers only"),
    (LOOKS[0].colour, "-", 2.6, "exact orbit, stable"),
)
RANGE = (0.9, 1.06)


def save(path: Path, values: Json) -> None:
    """Draw the largest tip displacement over the frequency for both forces."""
    figure, axes = panels(1, 2, 3.6)
    for own, name in zip(axes.flat, ("medium", "high"), strict=True):
        part = values[name]
        _draw(own, part)
        own.set(xlim=RANGE, ylim=(0, 1.25 * MM * max(curve["peak"][1] for curve in part["balance"])), xlabel=r"frequency $\Omega/\omega_1$")
        own.set_title(f"{part['force_n']:g} N")
        own.axhline(1.0, color=FAINT, lw=0.5)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    inset = axes[0, 1].inset_axes((0.7, 0.5, 0.28, 0.45))
    _draw(inset, values["high"])
    inset.set(xlim=(1.02, 1.19), ylim=(0, 1.3))
    inset.tick_params(labelsize=6)
    legend_below(figure, axes, 3)
    finish([], path, figure)


def _draw(axes: Axes, part: Json) -> None:
    linear = part["linear"]
    ratio = np.array(linear["omega_ratio"])
    for name, look, label in (("alone", REFERENCE, "no absorber"), ("stuck", STUCK, "absorber stuck")):
        axes.plot(ratio, MM * np.array(linear[name]), color=look.colour, ls=look.dashes, lw=0.9, label=label)
    for number, curve in enumerate(part["balance"]):
        axes.plot(curve["omega_ratio"], _mm(curve["tip_max"]), color=FAINT, lw=1.0, label=None if number else "harmonic balance, 20 harmonics")
    shown: set[int] = set()
    for curve in part["exact"]:
        _exact(axes, curve, shown)


def _mm(values: list[Any]) -> Any:
    return MM * np.array([np.nan if value is None else value for value in values])


def _exact(axes: Axes, curve: Json, shown: set[int]) -> None:
    """Draw each stretch of one stability; neighbours share the point between."""
    x, y, kinds = np.array(curve["omega_ratio"]), _mm(curve["tip_max"]), np.array(curve["kind"])
    ends = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    for begin, end in zip([0, *ends], [*ends, len(kinds)], strict=True):
        kind = int(kinds[begin])
        colour, dashes, width, label = KINDS[kind]
        part = slice(begin, min(int(end) + 1, len(kinds)))
        axes.plot(x[part], y[part], color=colour, ls=dashes, lw=width, label=None if kind in shown else label)
        shown.add(kind)
    for ratio, height in curve["folds"]:
        axes.plot(ratio, MM * height, "o", ms=3.5, mfc="white", mec="black", mew=0.7, zorder=5)
