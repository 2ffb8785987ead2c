"""Drawing of the figure `scat`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from impact_env.response import DEFAULT_SAMPLES
from studies.paper.scat import NEAR_PERIODS, known_modes
from studies.paper.style import LOOKS, MM, REFERENCE, finish, line, panels, signal
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw levels over the number of modes, losses by mode, and below them the motion of the tip near the resonance."""
    shown = known_modes(values, "signal")
    figure, grid = panels(3, 2, 7.0)
    _levels(grid[0, 0], values)
    _losses(grid[0, 1], values)
    for axes, modes in zip(grid[1:].flat, shown, strict=False):
        tip = MM * np.array(values[f"signal, {modes}"])
        signal(axes, np.arange(len(tip)) / DEFAULT_SAMPLES - NEAR_PERIODS / 2, tip, LOOKS[0])
        axes.set(
            xlim=(-NEAR_PERIODS / 2, NEAR_PERIODS / 2), ylim=(-1.35, 1.35), xlabel="pseudo periods from $\\omega_1$, 1.5 N, down", ylabel="tip, mm"
        )
        axes.set_title(f"{modes} mode{'s' * (modes > 1)}", fontsize=8.5)
    finish(grid, path, figure)


def _levels(axes: Axes, values: Json) -> None:
    modes = known_modes(values, "level")
    for look, key, name in ((LOOKS[0], "relative", "5 N, whole sweep"), (LOOKS[1], "near_rms", "1.5 N, around $\\omega_1$")):
        rows = np.array([values[f"level, {n}"][key] for n in modes])
        low, middle, high = np.quantile(rows, (0.05, 0.5, 0.95), axis=1)
        line(axes, modes, middle, look, name, band=(low, high), nominal=rows[:, 0])
    axes.plot(
        modes, [values[f"level, {n}"]["step"] for n in modes], "x", color=LOOKS[3].colour, ms=4, zorder=5, label="5 N, one run, the paper's step"
    )
    axes.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9)
    axes.set(xlim=(0, max(modes) + 1), ylim=(0, 1.15), xlabel="number of modes $N_m$", ylabel="level over no absorber")


def _losses(axes: Axes, values: Json) -> None:
    for look, modes in zip(LOOKS, known_modes(values, "account"), strict=False):
        own = values[f"account, {modes}"]
        number = np.arange(1, modes + 1)
        for key, marker, name in (("shares", look.marker, "dissipated"), ("left", "", "left before the next contact")):
            low, middle, high = 100 * np.quantile(np.array(own[key]), (0.05, 0.5, 0.95), axis=0)
            kept = slice(0, None) if key == "shares" else slice(1, None)
            dashes = look.dashes if key == "shares" else ":"
            axes.fill_between(number[kept], low[kept], high[kept], color=look.colour, alpha=0.18, lw=0)
            axes.plot(number[kept], middle[kept], color=look.colour, ls=dashes, marker=marker, lw=1.1, label=f"{modes} modes: {name}")
    axes.legend(loc="lower left", fontsize=6.5)
    axes.set(yscale="log", ylim=(0.01, 150), xlabel="mode", ylabel="% (of all modes; of the mode)")
