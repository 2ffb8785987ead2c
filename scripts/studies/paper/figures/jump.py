"""The figure jump: sweeps over the periodic responses, rates of leaving, and the share of sweeps that jump over their slowness."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from impact_env.periodic.jump import Hazard
from studies.paper.figures.branches import draw
from studies.paper.style import LOOKS, MM, finish, legend_below, panels
from studies.study import Json

SHOWN = (  # of the panels above: force, title, and sweeps with their looks and words
    (
        "medium",
        "1.5 N",
        (
            ("down", LOOKS[2], "down, 725 periods a percent"),
            ("down, half the rate", LOOKS[4], "down, 1450"),
            ("down, paper's step", LOOKS[3], "down, 725, paper's step"),
        ),
    ),
    ("high", "3 N", (("high force, down", LOOKS[2], "down, 725 periods a percent"), ("high force, up", LOOKS[5], "up, 725"))),
)


def save(path: Path, values: Json, found: Hazard | None, edges: Any, methods: Sequence[str]) -> None:
    """Draw it; ``edges`` (B + 1,) are those between which a sweep's largest displacement was kept."""
    figure, axes = panels(2, 2, 6.6)
    middles = 0.5 * (edges[1:] + edges[:-1])
    for own, (name, title, sweeps) in zip(axes[0], SHOWN, strict=True):
        draw(own, values[name])
        for sweep, look, label in sweeps:
            part = values["sweeps"][sweep]
            own.fill_between(middles, MM * np.array(part["low_m"]), MM * np.array(part["high_m"]), color=look.colour, alpha=0.3, lw=0)
            own.plot(middles, MM * np.array(part["nominal_m"]), color=look.colour, lw=0.8, drawstyle="steps-mid", label=label)
        top = 1.2 * MM * max(curve["peak"][1] for curve in values[name]["exact"])
        own.set(xlim=edges[[0, -1]], ylim=(0, top), xlabel=r"frequency $\Omega/\omega_1$")
        own.set_title(title)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    _rates(axes[1, 0], values["rates"])
    _shares(axes[1, 1], values, found, methods)
    legend_below(figure, axes[0], 3)
    finish(axes[1], path, figure)


def _rates(axes: Axes, rates: Sequence[Json]) -> None:
    known = [row for row in rates if row["rate"] is not None]
    x, y, low, high = (np.array([row[name] for row in known]) for name in ("omega_ratio", "rate", "low", "high"))
    axes.errorbar(
        x, 1e4 * y, 1e4 * np.array([y - low, high - y]), fmt="o", ms=3, lw=0.9, color=LOOKS[0].colour, label="exits over time at risk, 95 %"
    )
    axes.set_ylim(top=1.3e4 * float(high.max()))
    axes.locator_params(axis="x", nbins=5)
    axes.set(xlabel=r"constant frequency $\Omega/\omega_1$", ylabel=r"rate of leaving, $10^{-4}$ per pseudo period")


def _shares(axes: Axes, values: Json, found: Hazard | None, methods: Sequence[str]) -> None:
    n = np.geomspace(80, 4000, 200)
    if found is not None:
        told = np.array([found.probability(float(each)) for each in n]).T
        axes.plot(n, told[0], color="black", lw=0.9, label="from the rates, times A")
        axes.fill_between(n, told[1], told[2], color="0.8", lw=0)
    for k, name in enumerate(methods):
        rows = values.get(f"jumps, {name}", ())
        x, y, low, high = (np.array([row[column] for row in rows]) for column in ("periods_per_percent", "share", "low", "high"))
        look, aside = LOOKS[k], 1.04 ** (k - 1)
        axes.errorbar(aside * x, y, [y - low, high - y], fmt=look.marker, ls=look.dashes if k else "", ms=4, lw=0.9, color=look.colour, label=name)
    axes.set(xscale="log", ylim=(-0.02, 1.05), xlabel="pseudo periods per 1 % of a sweep down", ylabel="share that jumps")
