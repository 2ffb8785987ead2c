"""The figure high_low: exact orbits by their stability, harmonic balance, and the two linear curves."""

from __future__ import annotations

from pathlib import Path

from studies.paper.figures.branches import draw
from studies.paper.style import FAINT, MM, finish, legend_below, panels
from studies.study import Json

RANGE = (0.9, 1.06)


def save(path: Path, values: Json) -> None:
    """Draw the largest tip displacement over the frequency for both forces."""
    figure, axes = panels(1, 2, 3.6)
    for own, name in zip(axes.flat, ("medium", "high"), strict=True):
        part = values[name]
        draw(own, part)
        own.set(xlim=RANGE, ylim=(0, 1.25 * MM * max(curve["peak"][1] for curve in part["balance"])), xlabel=r"frequency $\Omega/\omega_1$")
        own.set_title(f"{part['force_n']:g} N")
        own.axhline(1.0, color=FAINT, lw=0.5)
    axes[0, 0].set_ylabel("largest tip displacement in mm")
    inset = axes[0, 1].inset_axes((0.75, 0.52, 0.24, 0.44))
    draw(inset, values["high"])
    inset.set(xlim=(1.02, 1.19), ylim=(0, 1.2), xticks=(1.05, 1.1, 1.15), yticks=(0, 0.5, 1.0))
    inset.tick_params(labelsize=6)
    legend_below(figure, axes, 3)
    finish([], path, figure)
