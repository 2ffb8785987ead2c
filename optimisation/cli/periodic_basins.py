"""Shares of initial states by attractor, lifetimes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from impact_env.parameters import count, non_negative, positive
from impact_env.periodic.basins import (
    BURN_IN,
    FRACTION_STARTS,
    MATCH_TOL,
    AttractorMap,
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
    ratio_text,
    values_of,
)
from optimisation.cli.options import number, option, switch
from optimisation.cli.scene_options import is_option_set
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import runs_bar
from optimisation.report.attractor_figures import map_class, save_attractor_map, save_basins

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


def basin_rows(points: list[BasinPoint]) -> list[list[Any]]:
    """Return the values of `BASIN_COLUMNS`, a row for each attractor at each point."""
    rows = []
    for point in points:
        own = {"parameter": point.parameter, "value": point.value, "runs": point.runs}
        for attractor in point.attractors:
            plain = own | attractor.to_plain()
            rows.append([plain[name] for name in BASIN_COLUMNS])
    return rows


def basin_table(points: list[BasinPoint]) -> str:
    """Return a line for each attractor at each point."""
    parameter = points[0].parameter
    rows = []
    for point in points:
        for attractor in point.attractors:
            motion = attractor.motion
            share = attractor.share
            details = ""
            if motion.exponent is not None:
                details = f"exponent {motion.exponent.value:.3f} ({motion.exponent.low:.3f} to {motion.exponent.high:.3f})"
            if motion.rotation is not None and motion.exponent and not motion.exponent.chaotic:
                details += f", rotation {motion.rotation.value:.5f}"
            rows.append(
                (
                    *(() if parameter is None else (f"{point.value:.6g}",)),
                    str(attractor.label),
                    motion.name,
                    f"{100 * share.value:.0f}",
                    f"{100 * share.low:.0f} to {100 * share.high:.0f}",
                    f"{1e3 * motion.level:.4f}",
                    f"{motion.impacts_per_period:.3f}",
                    details,
                )
            )
    header = ("attractor", "motion", "share, %", "95 %", "level, mm", "impacts/period", "")
    return markdown(header if parameter is None else (parameter, *header), rows)


def lifetime_lines(points: list[BasinPoint]) -> list[str]:
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
            f"{place}mean lifetime beyond {life.burn_in:g} periods {life.mean:.0f} periods ({low:.0f} to {high:.0f}), "
            f"{life.ended} runs captured, {life.censored} not{uneven}"
        )
    return lines


def map_text(result: AttractorMap) -> str:
    """Return how many points of a map have each kind of motion."""
    counted: dict[str, int] = {}
    for _, _, motion in result.cells():
        counted[map_class(motion)] = counted.get(map_class(motion), 0) + 1
    rows = [(name, str(number)) for name, number in sorted(counted.items(), key=lambda x: -x[1])]
    return markdown(("motion", "points"), rows)


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
    """Find the attractors that runs from random initial states end on, and the share of each with its 95 % interval.

    At one frequency and force, or over a parameter (--over), along which an attractor has one number. A mirror image counts as the same
    attractor. Where runs leave an irregular motion for a periodic one, or lose their impacts, their mean lifetime is printed.

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
    if points:
        click.echo(f"{points[0].runs} random initial states, {ratio_text(points[0].case)}\n")
        click.echo(basin_table(points))
        for line in lifetime_lines(points):
            click.echo(f"\n{line}")
    files = write_files(
        {
            options.json: {
                "complete": complete[0],
                "points": [point.to_plain() for point in points],
            },
            options.csv: (list(BASIN_COLUMNS), basin_rows(points)),
        }
        | ({options.plot: lambda path: save_basins(path, points)} if points else {})
    )
    common.name_files(files)
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
    click.echo(map_text(result))
    cells = result.to_plain()["cells"]
    names = [name for name in cells[0] if name != "state"] if cells else []
    rows = [[cell[name] for name in names] for cell in cells]
    files = write_files(
        {
            options.json: result.to_plain(),
            options.csv: (names, rows),
            options.plot: lambda path: save_attractor_map(path, result),
        }
    )
    common.name_files(files)
    return result.complete
