"""Speed of the exact method against the Moreau scheme at the paper's step: one core, one process, compilation apart."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.benchmarks.speed import NAME, QUICK, QUICK_REPEATS, REPEATS, STUDY, WHOLE, Settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} repeat of {QUICK:g} pseudo periods: a look, not a measurement.")
@click.option("--repeats", type=click.IntRange(min=1), help=f"Runs of each method, of which the median counts.  [default: {REPEATS}]")
@table_options(NAME, "README.md")
def main(quick: bool, repeats: int | None, target: Path | None, page: Path | None) -> None:
    """Time the exact method and the Moreau scheme at the paper's step on the same sweeps, and print a table.

    Run it on an otherwise idle machine. The first call compiles the kernels, which is not part of the times.
    """
    settings = Settings(QUICK if quick else WHOLE, repeats or (QUICK_REPEATS if quick else REPEATS))
    run(STUDY, settings, table_place(target, page))
