"""Report on the slow invariant manifold compared with exact orbits.

It has the variants of the formula, their errors, and the figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.slow_manifold import VARIANTS, ManifoldCheck, manifold_gap
from optimisation.measures import shorten_numbers
from optimisation.report.report import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    YELLOW,
    Block,
    Column,
    Report,
    Table,
    draw_grid,
    figure_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MANIFOLD_STYLES: dict[str, dict[str, Any]] = {
    "classical": {"color": YELLOW, "ls": ":", "lw": 2.0},
    "modal": {"color": GREEN, "ls": "--", "lw": 1.8},
    "corrected": {"color": BLUE, "ls": "-", "lw": 1.8},
    "complete": {"color": ORANGE, "ls": "-.", "lw": 1.4},
}
Array = NDArray[np.float64]


def make_manifold_report(
    own: ManifoldCheck,
    force: float | None = None,
    cells: Sequence[ManifoldCheck] = (),
    complete: bool = True,
) -> Report:
    """Return what `periodic manifold` prints and writes.

    ``force`` (N): amplitude for which a gap is wanted; ``cells``: checks of a map; ``complete``:
    whether all were made.
    """
    text: list[Block] = [[variant_table(own, force)]]
    if own.points:
        stable = sum(point.stable for point in own.points)
        text.append([f"{len(own.points)} exact orbits, {stable} of them stable"])
    table = map_table(cells)
    if cells:
        text += [["Median error in %:"], [table]]
    return Report(
        title="Slow invariant manifold",
        text=text,
        numbers=own.to_plain() | {"map": table.records(), "complete": complete},
        tables={"manifold.csv": table},
        figures={"manifold.png": partial(draw_manifold, own)},
    )


def variant_table(check: ManifoldCheck, force: float | None) -> Table:
    """Return a line for each variant: its predictions and its error relative to the orbits."""
    header = [
        "variant",
        "restitution of the mode",
        "least amplitude, mm",
        "fold force, N",
        "modulation below, N",
    ]
    if force is not None:
        header.append(f"gap for {force:g} N, mm")
    if check.points:
        header += ["median error, %", "95 % of orbits within, %"]
    rows = []
    for name in VARIANTS:
        manifold = check.manifold(name)
        row = [
            name,
            f"{manifold.restitution:.3f}",
            f"{MM * manifold.least_amplitude:.4g}",
            f"{manifold.fold_force:.4g}",
            f"{manifold.modulation_force:.4g}",
        ]
        if force is not None:
            gap = manifold_gap(check.case.changed(force=force), check.resonance, name)
            row.append(f"{MM * gap:.4g}")
        if check.points:
            size = 100 * np.abs(check.errors(name))
            row += [f"{np.median(size):.2f}", f"{np.quantile(size, 0.95):.2f}"]
        rows.append(row)
    return Table.of_words(header, rows)


def map_table(cells: Sequence[ManifoldCheck]) -> Table:
    """Return a table with a row for each cell of a map.

    A row has the cell's parameters, the number of orbits, and the median relative error of each
    variant.
    """
    columns = (
        Column("modes", "modes", "{:.0f}"),
        Column("restitution", "restitution", "{:g}"),
        Column("mass_ratio", "mass, %", "{:g}", 100),
        Column("friction_limit_N", "friction, N", "{:g}"),
        Column("orbits", "orbits", "{:.0f}"),
        *(Column(name, name, "{:.2f}", 100) for name in VARIANTS),
    )
    rows = [
        (
            check.case.model.modes,
            check.case.restitution,
            check.case.mass_ratio,
            check.case.friction_limit,
            len(check.points),
            *(check.median_error(name) for name in VARIANTS),
        )
        for check in cells
    ]
    return Table(columns, rows)


def draw_manifold(check: ManifoldCheck) -> Figure:
    """Draw each variant of the slow invariant manifold, and the exact orbits beside it."""
    figure, axes = figure_of(7.4, 5.2)
    gap = check.case.gap
    mass = check.case.mass_ratio * check.case.model.beam_mass

    def swing(impulse: Array, omega: float) -> Array:
        """Return the amplitude of the absorber's motion over the gap, for impulses in N s."""
        return np.asarray(np.pi * impulse / (4 * mass * omega) / gap)

    highest = max(
        [point.impulse / point.case.omega for point in check.points],
        default=3
        * check.manifold("complete").least_impulse
        / check.manifold("complete").case.omega,
    )
    for variant, style in MANIFOLD_STYLES.items():
        manifold = check.manifold(variant)
        omega = manifold.case.omega
        impulses = np.linspace(0.02, 1.08, 400) * highest * omega
        least = manifold.least_impulse
        axes.plot(
            swing(impulses, omega), manifold.amplitude(impulses) / gap, label=variant, **style
        )
        if least > 0:
            axes.plot(
                swing(np.array([least]), omega),
                [manifold.least_amplitude / gap],
                "|",
                ms=14,
                color=style["color"],
            )
    for stable, face, label in ((True, "black", "stable"), (False, "white", "unstable")):
        points = [point for point in check.points if point.stable is stable]
        if points:
            axes.plot(
                [float(swing(np.array(p.impulse), p.case.omega)) for p in points],
                [p.amplitude / gap for p in points],
                "o",
                ms=4,
                mfc=face,
                mec="black",
                mew=0.7,
                ls="none",
                label=f"exact orbits, {label}",
            )
    axes.set(
        xlim=(0, None),
        ylim=(0, None),
        xlabel="amplitude of the absorber over the gap",
        ylabel="amplitude of the resonant mode over the gap",
    )
    axes.set_title(shorten_numbers(str(check.case.scene)), fontsize=9)
    axes.legend(fontsize=9, frameon=False)
    draw_grid(axes)
    return figure
