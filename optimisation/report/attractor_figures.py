"""Attractors as figures: basin fractions over a parameter, maps of what runs end on, bifurcation diagrams, and Poincare sections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.attractors import MotionKind, SettledMotion
from impact_env.periodic.basins import AttractorMap, BasinPoint
from impact_env.periodic.diagrams import DOWN, RANDOM, UP, BranchPoints, Diagram, DiagramPoint
from optimisation.report.figures import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    draw_grid,
    draw_legend,
    figure_of,
    write_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
AXIS_LABELS = {
    "frequency": "frequency over the first resonance",
    "force": "force in N",
    "gap": "gap in m",
    "restitution": "restitution",
    "friction-limit": "friction limit in N",
    "mass-ratio": "mass ratio",
}
QUANTITY_LABELS = {
    "relative": "relative displacement at phase 0 over the gap",
    "displacement": "displacement at phase 0 in mm",
    "impact-phase": "phase of impacts over a turn",
    "level": "response level in mm",
}
QUANTITY_SCALES = {"impact-phase": 1 / (2 * np.pi), "displacement": MM, "level": MM}
LABEL_COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, YELLOW, "#000000", "#7F7F7F")
KIND_COLOURS = {
    "no impacts": "0.85",
    "period 1, symmetric": BLUE,
    "period 1": SKY,
    "longer periods": GREEN,
    str(MotionKind.QUASI_PERIODIC): YELLOW,
    str(MotionKind.CHAOTIC): ORANGE,
    str(MotionKind.UNDECIDED): PINK,
}
MAP_SYMBOL = "s"
DIRECTION_WORDS = {UP: "runs up", DOWN: "runs down", RANDOM: "runs from random states"}


def map_class(motion: SettledMotion) -> str:
    """Return the key of `KIND_COLOURS` for a motion."""
    if motion.kind is MotionKind.PERIODIC:
        return "longer periods" if motion.multiple > 1 else motion.name
    return str(motion.kind)


def save_basins(path: Path, points: Sequence[BasinPoint]) -> None:
    """Draw the share of each attractor with its interval over the parameter, and its level; a single point as bars."""
    figure, (shares, levels) = figure_of(7.4, 7.2, 2, 1, sharex=True)
    shares, levels = shares[0], levels[0]
    labels = sorted({attractor.label for point in points for attractor in point.attractors})
    for number, label in enumerate(labels):
        colour = LABEL_COLOURS[number % len(LABEL_COLOURS)]
        rows = [
            (0.0 if point.value is None else point.value, attractor)
            for point in points
            for attractor in point.attractors
            if attractor.label == label
        ]
        x = np.array([value for value, _ in rows])
        share = [attractor.share for _, attractor in rows]
        names = dict.fromkeys(attractor.motion.name for _, attractor in rows)
        text = f"{label}: {', then '.join(names)}"
        middle = np.array([each.value for each in share])
        spread = np.array(
            [
                middle - np.array([each.low for each in share]),
                np.array([each.high for each in share]) - middle,
            ]
        )
        shares.errorbar(
            x, middle, np.maximum(spread, 0), color=colour, marker="o", ms=4, capsize=2, label=text
        )
        levels.plot(
            x, [MM * attractor.motion.level for _, attractor in rows], "o-", ms=4, color=colour
        )
    parameter = points[0].parameter
    shares.set(ylim=(-0.03, 1.03), ylabel="share of random initial states")
    levels.set_ylabel(QUANTITY_LABELS["level"])
    levels.set_ylim(bottom=0)
    if parameter is None:
        levels.set_xticks([])
    else:
        levels.set_xlabel(AXIS_LABELS[parameter])
    for axes in (shares, levels):
        draw_grid(axes)
    draw_legend(figure, shares, 2)
    write_figure(figure, path)


def save_attractor_map(path: Path, result: AttractorMap) -> None:
    """Draw the kind of motion, and its level, at each point of two parameters."""
    from matplotlib.colors import ListedColormap

    figure, panels = figure_of(11.5, 5.2, 1, 2, sharex=True, sharey=True)
    classes = list(KIND_COLOURS)
    kinds = np.full((len(result.second), len(result.first)), np.nan)
    levels = np.full(kinds.shape, np.nan)
    for i, row in enumerate(result.motions):
        for j, motion in enumerate(row):
            if motion is not None:
                kinds[j, i] = classes.index(map_class(motion))
                levels[j, i] = MM * motion.level
    palette = ListedColormap([KIND_COLOURS[name] for name in classes])
    grid: tuple[Array, Array, Any] = (result.first, result.second, kinds)
    panels[0].pcolormesh(*grid, cmap=palette, vmin=-0.5, vmax=len(classes) - 0.5, shading="nearest")
    shades = panels[1].pcolormesh(
        result.first, result.second, levels, cmap="viridis", shading="nearest"
    )
    figure.colorbar(shades, ax=panels[1], label=QUANTITY_LABELS["level"])
    for k, name in enumerate(classes):
        if np.any(kinds == k):
            panels[0].plot([], [], MAP_SYMBOL, color=KIND_COLOURS[name], label=name)
    for axes in panels:
        axes.set_xlabel(AXIS_LABELS[result.names[0]])
    panels[0].set_ylabel(AXIS_LABELS[result.names[1]])
    draw_legend(figure, panels[0], 4)
    write_figure(figure, path)


def save_diagram(path: Path, result: Diagram, quantity: str) -> None:
    """Draw a bifurcation diagram: points of runs, stable branches solid, unstable ones dashed."""
    figure, axes = figure_of(8.6, 5.4)
    scale = QUANTITY_SCALES.get(quantity, 1.0)
    for branch in result.branches:
        _draw_branch(axes, branch, quantity, scale)
    styles = ((RANDOM, "0.6", 3.2), (UP, GREEN, 2.4), (DOWN, PINK, 1.4))
    for direction, colour, size in styles:
        points = [point for point in result.points if point.direction == direction]
        if points:
            x, y = _scatter(points, quantity)
            axes.plot(
                x,
                scale * y,
                ".",
                ms=size,
                color=colour,
                ls="none",
                label=DIRECTION_WORDS[direction],
            )
    axes.set_xlabel(AXIS_LABELS[result.parameter])
    axes.set_ylabel(QUANTITY_LABELS[quantity])
    draw_grid(axes)
    if axes.get_legend_handles_labels()[0]:
        draw_legend(figure, axes, 4, markerscale=3)
    write_figure(figure, path)


def _scatter(points: Sequence[DiagramPoint], quantity: str) -> tuple[Array, Array]:
    values = [point.quantities()[quantity] for point in points]
    x = np.concatenate(
        [np.full(len(row), point.value) for point, row in zip(points, values, strict=True)]
    )
    return x, np.concatenate(values)


def _draw_branch(axes: Axes, branch: BranchPoints, quantity: str, scale: float) -> None:
    if quantity == "impact-phase":
        rows = _phase_rows(branch)
    elif quantity == "level":
        rows = branch.level[:, None]
    else:
        rows = branch.relative if quantity == "relative" else branch.displacement
    for stable, style in ((True, "-"), (False, "--")):
        words = f"exact orbits, {'stable' if stable else 'unstable'}"
        for column in rows.T:
            known = words in axes.get_legend_handles_labels()[1]
            inside = branch.stable if stable else _with_neighbours(branch.stable)
            axes.plot(
                branch.values,
                np.where(inside, scale * column, np.nan),
                style,
                color=BLUE if stable else ORANGE,
                lw=1.4 if stable else 0.9,
                label=None if known else words,
            )


def _with_neighbours(stable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points are unstable or next to one that is, so that lines have no gaps."""
    unstable = ~stable
    wide = unstable.copy()
    wide[1:] |= unstable[:-1]
    wide[:-1] |= unstable[1:]
    return wide


def _phase_rows(branch: BranchPoints) -> Array:
    """Return the impact phases (n, K) in rad, NaN where a point has another number of impacts, or jumps by half a turn."""
    most = max((len(row) for row in branch.impact_phase), default=0)
    rows = np.full((len(branch.impact_phase), most), np.nan)
    for k, row in enumerate(branch.impact_phase):
        if len(row) == most:
            rows[k] = np.sort(row)
    jumps = np.max(np.abs(np.diff(rows, axis=0)), axis=1, initial=0.0) > np.pi / 2
    rows[1:][jumps] = np.nan
    return rows


def save_section(path: Path, motions: Sequence[SettledMotion], kind: str) -> None:
    """Draw the Poincare section of one or several motions: stroboscopic, or phase against velocity at impacts."""
    figure, axes = figure_of(6.6, 5.4)
    for number, motion in enumerate(motions):
        section = motion.section
        case = motion.case
        n = case.model.modes
        colour = LABEL_COLOURS[number % len(LABEL_COLOURS)]
        if kind == "impacts":
            x = section.impact_phase / (2 * np.pi)
            y = section.impact_velocity / (case.gap * case.omega)
        else:
            shape = case.model.tip_shape
            states = section.states
            x = (states[:, n] - states[:, :n] @ shape) / case.gap
            y = (states[:, -1] - states[:, n + 1 : -1] @ shape) / (case.gap * case.omega)
        axes.plot(
            x,
            y,
            ".",
            ms=8 if motion.kind is MotionKind.PERIODIC else 1.6,
            color=colour,
            label=f"run {number + 1}: {motion.name}",
        )
    velocity = "relative velocity{} over gap times circular frequency"
    if kind == "impacts":
        axes.set_xlabel("phase of the force at impacts over a turn")
        axes.set_ylabel(velocity.format(" before impacts"))
    else:
        axes.set_xlabel(QUANTITY_LABELS["relative"])
        axes.set_ylabel(velocity.format(" at phase 0"))
    draw_grid(axes)
    draw_legend(figure, axes, 2)
    write_figure(figure, path)
