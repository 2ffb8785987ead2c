"""Bifurcation diagrams by runs, with exact branches."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.parameters import count
from impact_env.periodic.diagrams import (
    DIAGRAM_COLUMNS,
    DIRECTIONS,
    FOLLOWED,
    RANDOM,
    BranchPoints,
    Diagram,
    DiagramPoint,
    diagram_branches,
    diagram_points,
)
from impact_env.periodic.validation import validation_alongside
from optimisation.cli import common
from optimisation.cli.attractor_options import (
    AttractorOptions,
    Range,
    range_option,
    values_of,
)
from optimisation.cli.options import OptionSpec, number, option, switch
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import stages_bar
from optimisation.report.attractor_figures import QUANTITY_LABELS, save_diagram


def diagram_table(points: list[DiagramPoint]) -> str:
    """Return a line for each stretch of neighbouring points with one kind of motion."""
    rows: list[list[str]] = []
    random = [point for point in points if point.direction == RANDOM]
    points = [point for point in points if point.direction != RANDOM]
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
    return markdown(("direction", "from", "to", "motion", "points"), rows)


@dataclass(frozen=True, kw_only=True)
class DiagramOptions(AttractorOptions):
    """Options of ``periodic diagram``; None: not given."""

    over: Range = range_option("--over", "Parameter and its range in SI units", required=True)
    points: int = option("points", default=101, usual=True)
    direction: str = option(
        OptionSpec(
            names=("--direction",),
            help="Whether the parameter rises or falls",
            type=click.Choice((*DIRECTIONS, "both")),
            default="both",
        )
    )
    random: bool = option(
        switch(
            "--random-start",
            "The first run of each direction begins at a random state, not at rest",
            older=("--random",),
        )
    )
    starts: int = option(
        "starts", help="Further runs at each value, from random initial states", default=0
    )
    quantity: str = option(
        OptionSpec(
            names=("--quantity",),
            help=f"What the figure has: {', '.join(QUANTITY_LABELS)}",
            more="Files have all.",
            type=click.Choice(tuple(QUANTITY_LABELS)),
            metavar="NAME",
            default="relative",
            section="Output",
        )
    )
    branches: bool = option(
        switch(
            "--branches/--no-branches",
            "Exact branches over the runs; not for the mass ratio",
            default=True,
        )
    )
    branch_period: int = option(
        number(
            "--branch-period",
            "Longest period of branches, in periods of the force",
            type=int,
            default=2,
        )
    )
    csv: Path | None = option("csv", help="Write a row for each number of each section")


@common.command(
    DiagramOptions,
    examples=(
        "periodic diagram --modes 1 --over force 1 1.5 --points 11",
        "periodic diagram --over frequency 0.92 0.94 --plot a.png",
    ),
)
def main(options: DiagramOptions) -> None:
    """Compute a bifurcation diagram over a parameter by runs, up and down, each from the last state of the one before.

    Points are the stroboscopic section (relative displacement or displacement at phase 0), the phases of impacts, or the response level. Runs from
    random states may be added at each value (--starts). Exact branches of symmetric orbits, of what leaves them, and of orbits that runs end on are
    drawn over them, stable ones solid, unstable ones dashed.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        settling = options.settling
        longest = count("--branch-period", options.branch_period, 1)
        case = options.case()
        parameter, low, high = options.over
        values = values_of("--over", options.over, options.points, case)
        directions = DIRECTIONS if options.direction == "both" else (options.direction,)
        complete = [True]
        points: list[DiagramPoint] = []
        branches: list[BranchPoints] = []
        with (
            common.stop_on_interrupt(complete),
            validation_alongside(case),
            stages_bar("diagram", leave=False) as show,
        ):
            for point in diagram_points(
                case,
                parameter,
                values.tolist(),
                directions=directions,
                starts=options.starts,
                random_start=options.random,
                seed=options.seed,
                options=settling,
                threads=options.threads,
                progress=lambda done, total: show("runs", done, total),
            ):
                points.append(point)  # noqa: PERF402 - an interrupt leaves those that are finished
            if options.branches and parameter in FOLLOWED:
                for branch in diagram_branches(
                    case,
                    parameter,
                    (low, high),
                    points,
                    longest=longest,
                    progress=lambda number: show(f"branch {len(branches) + 1}, points", number, 0),
                ):
                    branches.append(branch)  # noqa: PERF402 - as above
        result = Diagram(case, parameter, tuple(points), tuple(branches))
        click.echo(diagram_table(points))
        if branches:
            kinds = Counter(
                f"period {branch.multiple}{', symmetric' if branch.symmetric else ''}"
                for branch in branches
            )
            words = "; ".join(f"{number} of {name}" for name, number in kinds.items())
            click.echo(f"\n{len(branches)} exact branches: {words}")
        rows = [row for point in points for row in point.rows()]
        files = write_files(
            {
                options.json: result.to_plain() | {"complete": complete[0]},
                options.csv: (list(DIAGRAM_COLUMNS), rows),
                options.plot: lambda path: save_diagram(path, result, options.quantity),
            }
        )
    common.name_files(files)
    common.end_early(complete[0])
