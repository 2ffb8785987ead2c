"""The figure of an isola map: fold force over frequency with births and mergers, and both over the restitution for each number of modes."""

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.periodic.isolas import IsolaMap
from impact_env.periodic.symmetric import BIRTH
from optimisation.report.written_figure import write_figure

DPI = 160
SAME = 0.012  # how far an isola's birth may move from one restitution to the next
ALONG = {"restitution": "coefficient of restitution", "friction_limit": "friction limit in N"}
MARKS = {BIRTH: "v", "merger": "^"}


def save_figure(path: Path, found: IsolaMap) -> None:
    """Draw the fold force, and a map over each of `ALONG` that has more than one value; the ending of ``path`` chooses the format."""
    maps = [name for name in ALONG if len({getattr(cell, name) for cell in found.cells}) > 1]
    figure = Figure(figsize=(5.8 * (1 + len(maps)), 5.6), layout="constrained")
    axes = figure.subplots(1, 1 + len(maps), squeeze=False)[0]
    _force(axes[0], found)
    for place, name in zip(axes[1:], maps, strict=True):
        _map(place, found, name)
    figure.suptitle(str(found.case.scene), fontsize=10)
    write_figure(figure, path, DPI)


def _force(axes: Axes, found: IsolaMap) -> None:
    force = found.fold_force
    finite = force[np.isfinite(force)]
    axes.plot(found.omega_ratio, force, color="#0072B2", lw=1.8)
    axes.fill_between(found.omega_ratio, force, np.max(finite) * 2, color="#0072B2", alpha=0.08, lw=0, label="two symmetric orbits")
    for level in found.own.found:
        label = f"{level.kind} {level.force:.4g} N" + (", no orbit" if level.refused else "")
        axes.plot(level.omega_ratio, level.force, MARKS[level.kind], ms=8, mfc="white" if level.refused else "#D55E00", mec="black", label=label)
    top = max([level.force for level in found.own.found], default=float(np.median(finite)))
    axes.set(xlim=found.omega_ratio[[0, -1]], ylim=(0, 1.6 * top), xlabel="frequency over the first resonance's", ylabel="smallest force in N")
    _below(axes)


def _map(axes: Axes, found: IsolaMap, name: str) -> None:
    """Draw births and mergers over one parameter, the other one as in the case itself, or as in the map's last cell."""
    (other,) = (one for one in ALONG if one != name)
    own = {getattr(cell, other) for cell in found.cells}
    fixed = getattr(found.own, other) if getattr(found.own, other) in own else getattr(found.cells[-1], other)
    cells = [cell for cell in found.cells if getattr(cell, other) == fixed]
    numbers = sorted({cell.modes for cell in cells})
    for n, colour in zip(numbers, colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), strict=True):
        axes.plot([], [], color=colour, label=f"{n} mode{'s' * (n != 1)}")
        for place, style in ((0, "-"), (1, "--")):
            pairs = [(getattr(cell, name), level) for cell in cells if cell.modes == n and (level := cell.pair[place]) is not None]
            known = sorted((value, level.force, level.omega_ratio) for value, level in pairs)
            for part in _one_isola_each(np.array(known).reshape(-1, 3)):
                axes.plot(part[:, 0], part[:, 1], style, marker="v^"[place], ms=4, color=colour)
            refused = np.array([(value, level.force) for value, level in pairs if level.refused]).reshape(-1, 2)
            axes.plot(refused[:, 0], refused[:, 1], "v^"[place], ms=4, mfc="white", mec=colour, zorder=3)
    for style, label in (("k-", "birth (of the isola next to the resonance)"), ("k--", "merger")):
        axes.plot([], [], style, label=label)
    if any(level is not None and level.refused for cell in cells for level in cell.pair):
        axes.plot([], [], "ks", ms=4, mfc="white", label="open: no orbit, by the exact method")
    axes.set(xlabel=ALONG[name], ylabel="force in N", ylim=(0, None))
    axes.set_title(f"{ALONG[other].removesuffix(' in N')} {fixed:g}{' N' if other == 'friction_limit' else ''}", fontsize=9)
    _below(axes)


def _below(axes: Axes) -> None:
    axes.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13))  # below the curves, not over them
    axes.grid(True, color="0.9", lw=0.6)


def _one_isola_each(rows: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Split rows (restitution, force, ratio) where the ratio jumps: another isola is the next one to the resonance there."""
    return [part for part in np.split(rows, np.flatnonzero(np.abs(np.diff(rows[:, 2])) > SAME) + 1) if len(part)]
