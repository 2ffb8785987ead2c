"""Bifurcation diagrams by runs, with exact branches."""

from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.checks import count
from impact_env.periodic.diagrams import (
    DIRECTIONS,
    FOLLOWED,
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
from optimisation.executors import stages_bar
from optimisation.report.attractor_report import QUANTITY_LABELS, make_diagram_report


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
    """Compute a bifurcation diagram over a parameter by runs.

    The parameter goes up and down, and each run starts from the last state of the previous one.

    Points are the stroboscopic section (relative displacement or displacement at phase 0), the
    phases of impacts, or the response level. Runs from random states may be added at each value
    (--starts). Exact branches of symmetric orbits, of what leaves them, and of orbits that runs end
    on are drawn over them, stable ones solid, unstable ones dashed.
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
        diagram = Diagram(case, parameter, tuple(points), tuple(branches))
        report = make_diagram_report(diagram, options.quantity, complete[0])
        common.write_report(report, options)
    common.end_early(complete[0])
