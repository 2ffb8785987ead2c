"""Find out where the design rule holds: the best simulated gap over the rule's, over damping, mass ratio and place."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from studies.rule_study import MARKERS, MEMBERS, OUT, QUICK_MEMBERS, QUICK_OUT, STUDY, settings
from studies.runner import run
from studies.study import with_page


@command()
@click.option("--quick", is_flag=True, help="A look: one member, no gaps halfway to the best, no damping below 0.5 %.")
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help=f"Runs for each point, at most 1 below 0.2 % damping.  [default: {MEMBERS}, with --quick {QUICK_MEMBERS}]",
)
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for the numbers.  [default: {OUT}, with --quick {QUICK_OUT}]",
)
@click.option("--redraw", is_flag=True, help="Write the page again from the numbers in the folder; nothing is computed.")
def main(quick: bool, members: int | None, threads: int | None, cluster: str | None, out: Path | None, redraw: bool) -> None:
    """Simulate the rule's gap and its neighbours on two beams, over damping, mass ratio and place of the absorber, and in ten cases kept apart.

    Writes design_rule.json.gz, and its tables into the page FOLDER.md beside the folder, if there is one.
    Ctrl-C keeps what is finished: the same command goes on from there.
    """
    with plain_errors(), workers(threads, None if redraw else cluster) as found:
        given = settings(quick, members, threads if found is None else None, found)
        run(STUDY, given, with_page(out or (QUICK_OUT if quick else OUT), MARKERS), redraw=redraw, keep=given.keep)
