"""The figure of an isola map: fold force over frequency with births and mergers, and both over the restitution for each number of modes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isola_map import IsolaMap
from impact_env.periodic.isolas import BIRTH

DPI = 160
SAME = 0.012  # how far an isola's birth may move from one restitution to the next
MARKS = {BIRTH: "v", "merger": "^"}


def save_figure(path: Path, found: IsolaMap) -> None:
    """Draw both; the ending of ``path`` chooses the format."""
    columns = 2 if found.cells else 1
    figure = Figure(figsize=(5.8 * columns, 4.8), layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    _force(axes[0], found)
    if found.cells:
        _map(axes[1], found)
    figure.suptitle(str(found.case.scene), fontsize=10)
    figure.savefig(path, dpi=DPI, format=path.suffix[1:])


def _force(axes: Axes, found: IsolaMap) -> None:
    force = found.fold_force
    finite = force[np.isfinite(force)]
    axes.plot(found.omega_ratio, force, color="#0072B2", lw=1.8)
    axes.fill_between(found.omega_ratio, force, np.max(finite) * 2, color="#0072B2", alpha=0.08, lw=0, label="two symmetric orbits")
    for threshold in found.own.found:
        refused = isinstance(threshold.orbit, NoOrbit)
        label = f"{threshold.kind} {threshold.force:.4g} N" + (", no orbit" if refused else "")
        axes.plot(
            threshold.omega_ratio, threshold.force, MARKS[threshold.kind], ms=8, mfc="white" if refused else "#D55E00", mec="black", label=label
        )
    top = max([t.force for t in found.own.found], default=float(np.median(finite)))
    axes.set(xlim=found.omega_ratio[[0, -1]], ylim=(0, 1.6 * top), xlabel="frequency over the first resonance's", ylabel="smallest force in N")
    axes.legend(fontsize=8)
    axes.grid(True, color="0.9", lw=0.6)


def _map(axes: Axes, found: IsolaMap) -> None:
    numbers = sorted({cell.modes for cell in found.cells})
    for n, colour in zip(numbers, colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), strict=True):
        cells = [cell for cell in found.cells if cell.modes == n]
        for place, style in ((0, "-"), (1, "--")):
            known = sorted((cell.restitution, t.force, t.omega_ratio) for cell in cells if (t := cell.pair[place]) is not None)
            label = f"{n} mode{'s' * (n != 1)}" if place == 0 and known else None
            for part in _one_isola_each(np.array(known).reshape(-1, 3)):
                axes.plot(part[:, 0], part[:, 1], style, marker="v^"[place], ms=4, color=colour, label=label)
                label = None
    axes.plot([], [], "k-", label="birth (of the isola next to the resonance)")
    axes.plot([], [], "k--", label="merger")
    axes.set(xlabel="coefficient of restitution", ylabel="force in N", ylim=(0, None))
    axes.legend(fontsize=8)
    axes.grid(True, color="0.9", lw=0.6)


def _one_isola_each(rows: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Split rows (restitution, force, ratio) where the ratio jumps: another isola is the next one to the resonance there."""
    return [part for part in np.split(rows, np.flatnonzero(np.abs(np.diff(rows[:, 2])) > SAME) + 1) if len(part)]
