"""Births and mergers of isolas, as a report: a line for each, and the figure with maps."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from impact_env.periodic.isolas import ISOLA_COLUMNS, IsolaMap
from impact_env.periodic.orbit_table import EXACT_ORBITS, ORBIT_COLUMNS, make_row
from impact_env.periodic.symmetric import BIRTH
from optimisation.measures import format_number, shorten_numbers
from optimisation.report.report import BLUE, ORANGE, Report, Table, draw_grid, figure_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAME = 0.012  # how far an isola's birth may move from one restitution to the next
ALONG = {"restitution": "coefficient of restitution", "friction_limit": "friction limit in N"}
KIND_MARKS = {BIRTH: "v", "merger": "^"}


def make_isola_report(isola_map: IsolaMap) -> Report:
    """Return what `periodic isola` prints and writes.

    The births and mergers of the case itself come first, then those of the map.
    """
    rows = [row for cell in (isola_map.own, *isola_map.cells) for row in cell.rows()]
    named = [dict(zip(ISOLA_COLUMNS, row, strict=True)) for row in rows]
    cells = [
        make_row({"number": number, "method": EXACT_ORBITS, **cell})
        for number, cell in enumerate(named, 1)
    ]
    words = [
        (str(n), f"{e:g}", f"{limit:g}", str(kind), f"{force:.6f}", f"{ratio:.6f}", str(orbit))
        for n, e, limit, kind, force, ratio, orbit in rows
    ]
    header = (
        "modes",
        "restitution",
        "friction limit, N",
        "kind",
        "force, N",
        "omega/omega_1",
        "confirmed orbit",
    )
    return Report(
        title="Births and mergers of isolas",
        text=[[Table.of_words(header, words)]],
        numbers=isola_map.to_plain(),
        tables={"isolas.csv": Table.of_values(ORBIT_COLUMNS, cells)},
        figures={"isolas.png": partial(draw_isolas, isola_map)},
    )


def draw_isolas(isola_map: IsolaMap) -> Figure:
    """Draw the fold force, and a map over each of `ALONG` that has more than one value."""
    maps = [name for name in ALONG if len({getattr(cell, name) for cell in isola_map.cells}) > 1]
    rows = -(-(1 + len(maps)) // 2)
    figure, panels = figure_of(8.6, 4.6 * rows, rows, 2)
    axes = np.ravel(panels)
    for empty in axes[1 + len(maps) :]:
        empty.remove()
    _force(axes[0], isola_map)
    for place, name in zip(axes[1:], maps, strict=False):
        _map(place, isola_map, name)
    figure.suptitle(shorten_numbers(str(isola_map.case.scene)), fontsize=10)
    return figure


def _force(axes: Axes, isola_map: IsolaMap) -> None:
    force = isola_map.fold_force
    finite = force[np.isfinite(force)]
    axes.plot(isola_map.omega_ratio, force, color=BLUE, lw=1.8)
    axes.fill_between(
        isola_map.omega_ratio,
        force,
        np.max(finite) * 2,
        color=BLUE,
        alpha=0.08,
        lw=0,
        label="two symmetric orbits",
    )
    for level in isola_map.own.points:
        label = f"{level.kind} {level.force:.4g} N" + (", no orbit" if level.refused else "")
        axes.plot(
            level.omega_ratio,
            level.force,
            KIND_MARKS[level.kind],
            ms=8,
            mfc="white" if level.refused else ORANGE,
            mec="black",
            label=label,
        )
    top = max([level.force for level in isola_map.own.points], default=float(np.median(finite)))
    axes.set(
        xlim=isola_map.omega_ratio[[0, -1]],
        ylim=(0, 1.6 * top),
        xlabel="frequency over the first resonance's",
        ylabel="smallest force in N",
    )
    _below(axes)


def _map(axes: Axes, isola_map: IsolaMap, name: str) -> None:
    """Draw births and mergers of isolas over one parameter.

    The other parameter has the value of the case itself, or that of the map's last cell.
    """
    from matplotlib import colormaps

    (other,) = (one for one in ALONG if one != name)
    own = {getattr(cell, other) for cell in isola_map.cells}
    fixed = (
        getattr(isola_map.own, other)
        if getattr(isola_map.own, other) in own
        else getattr(isola_map.cells[-1], other)
    )
    cells = [cell for cell in isola_map.cells if getattr(cell, other) == fixed]
    numbers = sorted({cell.modes for cell in cells})
    for n, colour in zip(
        numbers, colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), strict=True
    ):
        axes.plot([], [], color=colour, label=f"{n} mode{'s' * (n != 1)}")
        for place, style in ((0, "-"), (1, "--")):
            pairs = [
                (getattr(cell, name), level)
                for cell in cells
                if cell.modes == n and (level := cell.pair[place]) is not None
            ]
            known = sorted((value, level.force, level.omega_ratio) for value, level in pairs)
            rows = np.array(known).reshape(
                -1, 3
            )  # where the ratio jumps another isola is the next one to the resonance
            for part in (
                np.split(rows, np.flatnonzero(np.abs(np.diff(rows[:, 2])) > SAME) + 1)
                if len(rows)
                else ()
            ):
                axes.plot(part[:, 0], part[:, 1], style, marker="v^"[place], ms=4, color=colour)
            refused = np.array(
                [(value, level.force) for value, level in pairs if level.refused]
            ).reshape(-1, 2)
            axes.plot(
                refused[:, 0], refused[:, 1], "v^"[place], ms=4, mfc="white", mec=colour, zorder=3
            )
    for style, label in (("k-", "birth (of the isola next to the resonance)"), ("k--", "merger")):
        axes.plot([], [], style, label=label)
    if any(level is not None and level.refused for cell in cells for level in cell.pair):
        axes.plot([], [], "ks", ms=4, mfc="white", label="open: no orbit, by the exact method")
    axes.set(xlabel=ALONG[name], ylabel="force in N", ylim=(0, None))
    axes.set_title(
        (
            f"{ALONG[other].removesuffix(' in N')} "
            f"{format_number(fixed)}{' N' if other == 'friction_limit' else ''}"
        ),
        fontsize=9,
    )
    _below(axes)


def _below(axes: Axes) -> None:
    axes.legend(
        fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13)
    )  # below the curves, not over them
    draw_grid(axes)
