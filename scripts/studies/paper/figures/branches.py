"""Branches of periodic responses in a panel: exact orbits by their stability, harmonic balance, and the two linear curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, STUCK
from studies.study import Json

KINDS = (  # of an exact orbit: unstable slowly, unstable by fast multipliers only, stable; its look and words
    (LOOKS[1].colour, (0, (1.5, 1.2)), 1.4, "exact orbit, unstable"),
    (LOOKS[0].colour, (0, (5, 1.2)), 1.8, "exact orbit, unstable by fast multipliers only"),
    (LOOKS[0].colour, "-", 2.6, "exact orbit, stable"),
)


def draw(axes: Axes, part: Json) -> None:
    """Draw what `responses.responses` returns, heights in mm."""
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
