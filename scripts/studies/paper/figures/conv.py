"""The figure conv: levels over the stiffness of contact, and performance curves with soft, stiff and rigid contact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from impact_env.curve import BAND, quantiles
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, finish, line, panels
from studies.study import Json

ROWS = (("walls", "k_n", "impact absorber"), ("friction", "k_t", "friction damper"))


def save(path: Path, values: Json, stiffnesses: tuple[float, float]) -> None:
    """Draw the walls above, friction below; the curves' ``stiffnesses`` are the low and the high one."""
    figure, axes = panels(2, 2, 5.6)
    for (left, right), (kind, symbol, title) in zip(axes, ROWS, strict=True):
        _stiffness(left, values[kind], values[f"{kind}, paper's method"])
        left.set(xscale="log", xlabel=f"${symbol}/k_\\mathrm{{eff}}$", ylabel="level over that of rigid contact")
        left.set_title(title)
        named = {"rigid": "rigid", "low": f"${symbol} = {stiffnesses[0]:g}\\,k_\\mathrm{{eff}}$"}
        named["high"] = f"${symbol} = {stiffnesses[1]:g}\\,k_\\mathrm{{eff}}$"
        _curves(right, values[f"{kind}, curves"], named)
        right.set(xlabel="force in N", ylabel="response level in mm")
        right.set_title(title)
    finish(axes, path, figure)


def _edges(levels: Any) -> tuple[Any, Any, Any, Any]:
    rows = np.array(levels, dtype=float)
    low, middle, high = quantiles(rows, (BAND[0], 0.5, BAND[1]))
    return low, middle, high, rows[:, 0]


def _stiffness(axes: Axes, part: Json, stepped: Json) -> None:
    unit = float(np.median(part["rigid_m"]))
    low, high = (x / unit for x in quantiles(np.array(part["rigid_m"]), BAND))
    axes.axhspan(float(low), float(high), color=FAINT, alpha=0.3, lw=0, label="rigid, 5 to 95 %")
    below, middle, above, own = (x / unit for x in _edges(part["level_m"]))
    line(axes, part["stiffness"], middle, LOOKS[0], "compliant, exact", band=(below, above), nominal=own)
    axes.plot(
        stepped["stiffness"],
        _edges(stepped["level_m"])[1] / unit,
        LOOKS[1].marker,
        color=LOOKS[1].colour,
        mfc="none",
        label="Runge-Kutta, paper's step",
    )


def _curves(axes: Axes, curves: Json, named: dict[str, str]) -> None:
    alone = curves["none"]
    axes.plot(alone["force_n"], MM * np.median(alone["level_m"], axis=1), color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1.0, label="no absorber")
    for look, (name, label) in zip(LOOKS, named.items(), strict=False):
        below, middle, above, own = (MM * x for x in _edges(curves[name]["level_m"]))
        line(axes, curves[name]["force_n"], middle, look, label, band=(below, above), nominal=own)
