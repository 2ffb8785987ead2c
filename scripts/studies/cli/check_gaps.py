"""Put the answers of design_gap to the test on twenty structures, beside fine scans over the gap."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from studies.gaps.study import NAME, STUDY, settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help="A look: two structures, with a coarse scan.")
@click.option("--members", type=click.IntRange(min=1), help="Runs for each gap.  [default: those of design_gap]")
@click.option("--rate", type=float, help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@table_options(NAME, "docs/which_gap.md")
def main(
    quick: bool, members: int | None, rate: float | None, threads: int | None, cluster: str | None, target: Path | None, page: Path | None
) -> None:
    """Print, for twenty beams, plates, frames and modal models, what the answers of design_gap lose against a scan with gaps 5 % apart.

    A scan has the same members, and is judged by what each answer minimises. Ctrl-C prints, and writes, what is finished; with --json the same
    command goes on from there.
    """
    with plain_errors(), workers(threads, cluster) as found:
        given = settings(quick, members, rate, threads if found is None else None, found)
        run(STUDY, given, table_place(target, page), keep=given.keep)
