"""Tell the best gap over the design rule's for several masses of the absorber, by simulation."""

from __future__ import annotations

from pathlib import Path

import click

from impact_env.drive import PAPER_LIMITS
from impact_env.parameters import Beam
from optimisation.command_line import check_target, name_files, plain_errors
from optimisation.commands.mass_table import MARKER, RATIOS, checks, text
from optimisation.commands.structure_option import RESONANCES_HELP, model_of, structure_option
from optimisation.comparison import RESONANCES
from optimisation.executors import cluster_option, workers
from optimisation.extremes import usable_rate
from optimisation.studies.machine import conditions, sources
from optimisation.studies.page import fill, require_markers

MEMBERS = 4


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@structure_option
@click.option("--resonances", type=(int, int), default=RESONANCES, show_default=True, help=RESONANCES_HELP)
@click.option("--mass-ratio", "ratios", type=float, multiple=True, help=f"Absorber mass over the structure's; may be repeated.  [default: {RATIOS}]")
@click.option("--members", type=click.IntRange(min=1), default=MEMBERS, show_default=True, help="Runs for each gap, with other phases and roundings.")
@click.option("--rate", type=float, help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option(
    "--page",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help=f"Write the table into this page, between <!-- {MARKER} --> and <!-- /{MARKER} -->, as in docs/limits.md.",
)
def main(
    structure: Path | None,
    resonances: tuple[int, int],
    ratios: tuple[float, ...],
    members: int,
    rate: float | None,
    threads: int | None,
    cluster: str | None,
    page: Path | None,
) -> None:
    """Simulate gaps from 0.4 to 1.6 times the design rule's for several masses, near two resonances, and print the best of each.

    By the scaling law the force does not matter: gap and friction are in proportion to it. Levels are relative to no absorber, at its own place.
    """
    with plain_errors():
        check_target("--page", page)
        if page is not None:
            require_markers(page, page, (MARKER,))
        model = model_of(structure, Beam.absorber_position)
        if rate is not None:
            usable_rate("--rate", rate, [PAPER_LIMITS])
        with workers(threads, cluster) as executor:
            found = checks(model, ratios or RATIOS, tuple(dict.fromkeys(resonances)), members, rate, threads, executor)
        table = text(found)
        if page is not None:
            fill(page, page, {MARKER: f"{table}\n\n{sources(conditions())}"})
    click.echo(table)
    if page is not None:
        name_files([page])


if __name__ == "__main__":
    main(prog_name="scripts/run mass_ratios")
