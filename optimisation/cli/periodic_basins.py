"""Shares of initial states by attractor, lifetimes."""

from dataclasses import dataclass
from pathlib import Path

from impact_env.checks import count, non_negative, positive
from impact_env.periodic.basins import (
    BURN_IN,
    FRACTION_STARTS,
    MATCH_TOL,
    BasinPoint,
    attractor_map,
    basin_fractions,
)
from impact_env.periodic.case import Case
from optimisation.cli import common
from optimisation.cli.attractor_options import (
    AttractorOptions,
    Range,
    range_option,
    values_of,
)
from optimisation.cli.options import number, option, switch
from optimisation.cli.scene_options import is_option_set
from optimisation.executors import runs_bar
from optimisation.report.attractor_report import make_basin_report, make_map_report


@dataclass(frozen=True, kw_only=True)
class BasinOptions(AttractorOptions):
    """Options of ``periodic basins``; None: not given."""

    over: Range | None = range_option(
        "--over", "Parameter along which shares are followed, and its range in SI units"
    )
    map: Range | None = range_option(
        "--map", "With --over: second parameter of a map of what one run ends on"
    )
    points: int = option("points", help="Number of values of the parameter of --over", default=11)
    map_points: int = option(
        number("--map-points", "Number of values of the parameter of --map", type=int, default=11)
    )
    starts: int = option(
        "starts", help="Random initial states at each point", default=FRACTION_STARTS, usual=True
    )
    random: bool = option(
        switch(
            "--random-start",
            "With --map: runs begin at one random state, not at rest",
            older=("--random",),
        )
    )
    reach: float | None = option(
        number(
            "--reach", "How far initial states reach", unit="m", default_text="1.5 times the gap"
        )
    )
    match_tolerance: float = option(
        number(
            "--match",
            "Largest difference of the features of one attractor at neighbouring values",
            default=MATCH_TOL,
        )
    )
    burn_in: float = option(
        number(
            "--burn-in",
            "Periods at the start of runs that are left out of lifetimes",
            default=BURN_IN,
        )
    )
    csv: Path | None = option(
        "csv", help="Write a row for each attractor and value, or for each point of a map"
    )


@common.command(
    BasinOptions,
    examples=(
        "periodic basins --modes 1 --restitution 0.75 --starts 16",
        "periodic basins --modes 1 --over force 1 2 --points 5",
    ),
)
def main(options: BasinOptions) -> None:
    """Find the attractors of runs from random initial states, and the share of each.

    Each share comes with its 95 % interval.

    At one frequency and force, or over a parameter (--over), along which an attractor has one
    number. A mirror image counts as the same attractor. Where runs leave an irregular motion for a
    periodic one, or lose their impacts, their mean lifetime is printed.

    --over with --map draws what one run ends on at each point of two parameters.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        if options.map is not None and options.over is None:
            raise common.BadInput("--map needs --over, the first parameter")
        if options.map is None and (options.random or is_option_set("map_points")):
            raise common.BadInput("--random-start and --map-points go with --map")
        if options.map is not None and is_option_set("starts"):
            raise common.BadInput("--starts does not go with --map: one run at each point")
        case = options.case()
        complete = shares(options, case) if options.map is None else mapped(options, case)
    common.end_early(complete)


def shares(options: BasinOptions, case: Case) -> bool:
    """Print and write basin fractions; return whether all were computed."""
    settling = options.settling
    starts = count("--starts", options.starts, 1)
    match_tolerance = positive("--match", options.match_tolerance)
    burn_in = non_negative("--burn-in", options.burn_in)
    over = options.over
    parameter = None if over is None else over[0]
    values = [] if over is None else values_of("--over", over, options.points, case).tolist()
    complete = [True]
    points: list[BasinPoint] = []
    with common.stop_on_interrupt(complete), runs_bar("basins") as show:
        total = max(len(values), 1)

        def progress(done: int, _here: int) -> None:
            show(
                len(points) * starts + min(done, starts),
                total * starts,
            )

        for point in basin_fractions(
            case,
            parameter,
            values,
            starts=starts,
            options=settling,
            reach=options.reach,
            match_tolerance=match_tolerance,
            burn_in=burn_in,
            seed=options.seed,
            threads=options.threads,
            progress=progress,
        ):
            points.append(point)  # noqa: PERF402 - an interrupt leaves those that are finished
    common.write_report(make_basin_report(points, complete[0]), options)
    return complete[0]


def mapped(options: BasinOptions, case: Case) -> bool:
    """Print and write the map of two parameters; return whether all was computed."""
    settling = options.settling
    assert options.over is not None
    assert options.map is not None
    first = values_of("--over", options.over, options.points, case)
    second = values_of("--map", options.map, count("--map-points", options.map_points, 2), case)
    with runs_bar("map") as show:
        result = attractor_map(
            case,
            (options.over[0], options.map[0]),
            first.tolist(),
            second.tolist(),
            random_start=options.seed if options.random else None,
            options=settling,
            threads=options.threads,
            progress=show,
        )
    common.write_report(make_map_report(result), options)
    return result.complete
