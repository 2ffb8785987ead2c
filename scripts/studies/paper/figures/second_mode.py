"""Drawing of the figures `varom` and `vard`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from optimisation.report.design_figures import force_axis
from studies.paper.second_mode import quantiles_of
from studies.paper.style import LOOKS, REFERENCE, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json, names: Sequence[str], numbers: Sequence[float], label: str, shown: Sequence[tuple[str, str]]) -> None:
    """Draw level, shares and energy passed over what was changed, and below the energies over two pseudo periods at some of its values."""
    figure, grid = panels(2, 3, 5.2)
    _level(grid[0, 0], values, names, numbers)
    _banded(grid[0, 1], values, names, numbers, "share", 100)
    grid[0, 1].set(ylabel="dissipated in mode 2, % of both", ylim=(0, None))
    _passed(grid[0, 2], values, names, numbers)
    for axes in grid[0]:
        axes.set(xscale="log", xlim=(numbers[0], numbers[-1]), xlabel=label)
        force_axis(axes.xaxis)
        axes.tick_params(axis="x", labelsize=7)
    for axes, (name, title) in zip(grid[1], shown, strict=False):
        _signal(axes, values[name], title)
    _banded(grid[1, 2], values, names, numbers, "left", 100)
    grid[1, 2].set(
        xscale="log", xlim=(numbers[0], numbers[-1]), xlabel=label, ylim=(0, 105), ylabel="left of mode 2's energy\nbefore the next contact, %"
    )
    force_axis(grid[1, 2].xaxis)
    grid[1, 2].tick_params(axis="x", labelsize=7)
    finish(grid, path, figure)


def _level(axes: Axes, values: Json, names: Sequence[str], numbers: Sequence[float]) -> None:
    _banded(axes, values, names, numbers, "relative", 1)
    axes.plot(numbers, [values[name]["step"] for name in names], "x", color=LOOKS[1].colour, ms=4, label="one run, the paper's step")
    axes.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9)
    axes.set(ylabel="level over no absorber", ylim=(0.6, 1.1))


def _banded(axes: Axes, values: Json, names: Sequence[str], numbers: Sequence[float], key: str, factor: float) -> None:
    low, middle, high, nominal = (factor * row for row in quantiles_of(values, names, key))
    line(axes, numbers, middle, LOOKS[0], band=(low, high), nominal=nominal)


def _passed(axes: Axes, values: Json, names: Sequence[str], numbers: Sequence[float]) -> None:
    low, middle, high, _ = (100 * row for row in quantiles_of(values, names, "half"))
    line(axes, numbers, middle, LOOKS[0], "in half a period", band=(low, high))
    single = 100 * np.array([values[name]["single"] for name in names])
    axes.fill_between(numbers, single[:, 1], single[:, 3], color="0.6", alpha=0.35, lw=0, label="half of all contacts")
    axes.axhspan(2, 3, facecolor="none", edgecolor=LOOKS[1].colour, hatch="///", lw=0.5, label="the paper: 2 to 3 %")
    axes.set(ylabel="passed to mode 2, % of mode 1", ylim=(-2, 5))
    axes.legend(loc="upper left", fontsize=6.5, frameon=False)


def _signal(axes: Axes, own: Json, title: str) -> None:
    time, (first, second), absorber = np.array(own["time"]), np.array(own["modal"]), np.array(own["absorber"])
    total = first + second + absorber
    for look, energy, name in zip(LOOKS, (first, second, absorber), ("mode 1", "mode 2", "absorber"), strict=False):
        axes.plot(time, 100 * energy / np.mean(total), color=look.colour, ls=look.dashes, lw=1.0, label=name)
    axes.legend(loc="upper center", ncols=3, fontsize=5.5, columnspacing=0.5, handlelength=1.3, handletextpad=0.3, frameon=False)
    axes.set(yscale="log", ylim=(0.1, 600), xlim=(0, time[-1]), xlabel="pseudo periods", ylabel="energy, % of the mean total")
    axes.set_title(title, fontsize=8.5)
