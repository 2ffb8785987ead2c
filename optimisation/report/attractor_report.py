"""Reports on attractors, with their figures.

They have basin fractions, maps of the attractors on which runs end, bifurcation diagrams and
Poincare sections.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.attractors import MotionKind, SettledMotion
from impact_env.periodic.basins import AttractorMap, BasinPoint
from impact_env.periodic.case import Case
from impact_env.periodic.diagrams import (
    DIAGRAM_COLUMNS,
    DOWN,
    RANDOM,
    UP,
    BranchPoints,
    Diagram,
    DiagramPoint,
)
from optimisation.measures import format_number
from optimisation.report.report import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    Block,
    Report,
    Table,
    draw_grid,
    draw_legend,
    figure_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
LEAST_EXITS = 10  # runs captured after the burn-in, from which on a lifetime is printed
BASIN_COLUMNS = (
    "parameter",
    "value",
    "runs",
    "attractor",
    "ended",
    "share",
    "low",
    "high",
    "stable",
    "kind",
    "period",
    "symmetric",
    "level_m",
    "impacts_per_period",
    "offset_over_gap",
    "exponent_per_period",
    "exponent_low",
    "exponent_high",
    "rotation_number",
)
SECTION_COLUMNS = ("run", "section", "number", "phase_rad", "relative_m", "velocity_m_s", "wall")


def describe_place(case: Case) -> str:
    """Return where a case is, in words."""
    return f"{format_number(case.force)} N at {case.omega_ratio:.6g} of the first resonance"


def make_basin_report(points: Sequence[BasinPoint], complete: bool) -> Report:
    """Return what `periodic basins` prints and writes.

    ``complete`` states whether all points were computed.
    """
    text: list[Block] = []
    figures = {}
    if points:
        text.append([f"{points[0].runs} random initial states, {describe_place(points[0].case)}"])
        text.append([basin_table(points)])
        text += [[line] for line in lifetime_lines(points)]
        figures["basins.png"] = partial(draw_basins, points)
    return Report(
        title="Basins of attraction",
        text=text,
        numbers={"complete": complete, "points": [point.to_plain() for point in points]},
        tables={"basins.csv": Table.of_values(BASIN_COLUMNS, basin_rows(points))},
        figures=figures,
    )


def basin_table(points: Sequence[BasinPoint]) -> Table:
    """Return a line for each attractor at each point."""
    parameter = points[0].parameter
    rows = []
    for point in points:
        for attractor in point.attractors:
            motion = attractor.motion
            share = attractor.share
            details = ""
            if motion.exponent is not None:
                details = (
                    f"exponent {motion.exponent.value:.3f} ({motion.exponent.low:.3f} to "
                    f"{motion.exponent.high:.3f})"
                )
            if motion.rotation is not None and motion.exponent and not motion.exponent.chaotic:
                details += f", rotation {motion.rotation.value:.5f}"
            rows.append(
                (
                    *(() if parameter is None else (f"{point.value:.6g}",)),
                    str(attractor.label),
                    motion.name,
                    f"{100 * share.value:.0f}",
                    f"{100 * share.low:.0f} to {100 * share.high:.0f}",
                    f"{MM * motion.level:.4f}",
                    f"{motion.impacts_per_period:.3f}",
                    details,
                )
            )
    header = ("attractor", "motion", "share, %", "95 %", "level, mm", "impacts/period", "")
    return Table.of_words(header if parameter is None else (parameter, *header), rows)


def lifetime_lines(points: Sequence[BasinPoint]) -> list[str]:
    """Return a line for each point at which several runs left a transient after the burn-in."""
    lines = []
    for point in points:
        life = point.lifetimes
        if life.ended < LEAST_EXITS:
            continue
        low, high = life.interval
        place = "" if point.value is None else f"{point.parameter} {point.value:.6g}: "
        uneven = "" if life.constant > 0.05 else "; the rate is not constant"
        lines.append(
            f"{place}mean lifetime beyond {life.burn_in:g} periods {life.mean:.0f} periods "
            f"({low:.0f} to {high:.0f}), "
            f"{life.ended} runs captured, {life.censored} not{uneven}"
        )
    return lines


def basin_rows(points: Sequence[BasinPoint]) -> list[list[Any]]:
    """Return the values of `BASIN_COLUMNS`, a row for each attractor at each point."""
    rows = []
    for point in points:
        own = {"parameter": point.parameter, "value": point.value, "runs": point.runs}
        for attractor in point.attractors:
            plain = own | attractor.to_plain()
            rows.append([plain[name] for name in BASIN_COLUMNS])
    return rows


def draw_basins(points: Sequence[BasinPoint]) -> Figure:
    """Draw the share of each attractor with its interval, and its level, over the parameter.

    A single point is drawn as bars.
    """
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
    return figure


def make_map_report(result: AttractorMap) -> Report:
    """Return what `periodic basins --map` prints and writes.

    It includes the number of points of the map with each kind of motion.
    """
    counts = Counter(map_class(motion) for _, _, motion in result.cells())
    words = [(name, str(number)) for name, number in counts.most_common()]
    plain = result.to_plain()
    cells = plain["cells"]
    names = [name for name in cells[0] if name != "state"] if cells else []
    rows = [[cell[name] for name in names] for cell in cells]
    return Report(
        title="Motions over two parameters",
        text=[[Table.of_words(("motion", "points"), words)]],
        numbers=plain,
        tables={"map.csv": Table.of_values(names, rows)},
        figures={"map.png": partial(draw_attractor_map, result)},
    )


def map_class(motion: SettledMotion) -> str:
    """Return the key of `KIND_COLOURS` for a motion."""
    if motion.kind is MotionKind.PERIODIC:
        return "longer periods" if motion.multiple > 1 else motion.name
    return str(motion.kind)


def draw_attractor_map(result: AttractorMap) -> Figure:
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
    return figure


def make_diagram_report(diagram: Diagram, quantity: str, complete: bool) -> Report:
    """Return what `periodic diagram` prints and writes.

    ``quantity`` is the quantity that the figure shows. ``complete`` states whether all runs were
    made.
    """
    text: list[Block] = [[diagram_table(diagram.points)]]
    if diagram.branches:
        kinds = Counter(
            f"period {branch.multiple}{', symmetric' if branch.symmetric else ''}"
            for branch in diagram.branches
        )
        words = "; ".join(f"{number} of {name}" for name, number in kinds.items())
        text.append([f"{len(diagram.branches)} exact branches: {words}"])
    rows = [row for point in diagram.points for row in point.rows()]
    return Report(
        title="Bifurcation diagram",
        text=text,
        numbers=diagram.to_plain() | {"complete": complete},
        tables={"diagram.csv": Table.of_values(DIAGRAM_COLUMNS, rows)},
        figures={"diagram.png": partial(draw_diagram, diagram, quantity)},
    )


def diagram_table(every: Sequence[DiagramPoint]) -> Table:
    """Return a line for each stretch of neighbouring points with one kind of motion."""
    rows: list[list[str]] = []
    random = [point for point in every if point.direction == RANDOM]
    points = [point for point in every if point.direction != RANDOM]
    start: DiagramPoint | None = None
    number = 0
    for k, point in enumerate(points):
        if start is None:
            start = point
            number = 0
        number += 1
        following = points[k + 1] if k + 1 < len(points) else None
        if (
            following is None
            or following.direction != point.direction
            or following.motion.name != point.motion.name
        ):
            rows.append(
                [
                    point.direction,
                    f"{start.value:.6g}",
                    f"{point.value:.6g}",
                    point.motion.name,
                    str(number),
                ]
            )
            start = None
    for name, number in Counter(point.motion.name for point in random).items():
        values = [point.value for point in random if point.motion.name == name]
        rows.append([RANDOM, f"{min(values):.6g}", f"{max(values):.6g}", name, str(number)])
    return Table.of_words(("direction", "from", "to", "motion", "points"), rows)


def draw_diagram(result: Diagram, quantity: str) -> Figure:
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
    return figure


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
    """Return the impact phases (n, K) in rad.

    They are NaN if a point has another number of impacts, or if they jump by more than a quarter of
    a turn.
    """
    most = max((len(row) for row in branch.impact_phase), default=0)
    rows = np.full((len(branch.impact_phase), most), np.nan)
    for k, row in enumerate(branch.impact_phase):
        if len(row) == most:
            rows[k] = np.sort(row)
    jumps = np.max(np.abs(np.diff(rows, axis=0)), axis=1, initial=0.0) > np.pi / 2
    rows[1:][jumps] = np.nan
    return rows


def make_section_report(motions: Sequence[SettledMotion], section: str, complete: bool) -> Report:
    """Return what `periodic section` prints and writes.

    ``section`` is the section that the figure shows. ``complete`` states whether all runs were
    made.
    """
    text: list[Block] = []
    figures = {}
    if motions:
        text += [[describe_place(motions[0].case)], [section_table(motions)]]
        figures["section.png"] = partial(draw_section, motions, section)
    return Report(
        title="Poincare section",
        text=text,
        numbers={"complete": complete, "runs": [plain_section(motion) for motion in motions]},
        tables={"section.csv": Table.of_values(SECTION_COLUMNS, section_rows(motions))},
        figures=figures,
    )


def section_table(motions: Sequence[SettledMotion]) -> Table:
    """Return a line for each run."""
    rows = []
    for number, motion in enumerate(motions, 1):
        exponent = motion.exponent
        rotation = motion.rotation
        rows.append(
            (
                str(number),
                motion.name,
                f"{MM * motion.level:.4f}",
                f"{motion.impacts_per_period:.3f}",
                ""
                if exponent is None
                else f"{exponent.value:.4f} ({exponent.low:.4f} to {exponent.high:.4f})",
                "" if rotation is None else f"{rotation.value:.7f}",
                "" if rotation is None else f"{rotation.change:.1e}",
            )
        )
    header = (
        "run",
        "motion",
        "level, mm",
        "impacts/period",
        "exponent per period (95 %)",
        "rotation number",
        "change from half to half",
    )
    return Table.of_words(header, rows)


def section_rows(motions: Sequence[SettledMotion]) -> list[list[Any]]:
    """Return the values of `SECTION_COLUMNS` of each run.

    For each run these are the states at phase 0, followed by the impacts.
    """
    rows: list[list[Any]] = []
    for number, motion in enumerate(motions, 1):
        section = motion.section
        n = motion.case.model.modes
        shape = motion.case.model.tip_shape
        states = section.states
        relative = states[:, n] - states[:, :n] @ shape
        velocity = states[:, -1] - states[:, n + 1 : -1] @ shape
        rows += [
            [number, "stroboscopic", k, 0.0, float(relative[k]), float(velocity[k]), None]
            for k in range(len(states))
        ]
        impacts = zip(section.impact_phase, section.impact_velocity, section.wall, strict=True)
        for k, (phase, speed, wall) in enumerate(impacts):
            place = float(wall) * motion.case.gap
            rows.append([number, "impact", k, float(phase), place, float(speed), int(wall)])
    return rows


def plain_section(motion: SettledMotion) -> dict[str, Any]:
    """Return a run's numbers and its sections; keys with their units."""
    section = motion.section
    return motion.to_plain() | {
        "states": section.states.tolist(),
        "impact_phase_rad": section.impact_phase.tolist(),
        "impact_velocity_m_s": section.impact_velocity.tolist(),
        "impact_wall": section.wall.tolist(),
    }


def draw_section(motions: Sequence[SettledMotion], kind: str) -> Figure:
    """Draw the Poincare section of one or several motions.

    It is stroboscopic, or phase against velocity at impacts.
    """
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
    return figure
