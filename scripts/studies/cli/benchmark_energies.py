"""Price of an energy account: runs with it beside runs without, one core, one process, compilation apart."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.benchmarks.energies import NAME, QUICK, QUICK_REPEATS, REPEATS, STUDY, WHOLE, Settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} repeats of {QUICK:g} pseudo periods: a look, not a measurement.")
@click.option("--repeats", type=click.IntRange(min=1), help=f"Runs of either kind, of which the median counts.  [default: {REPEATS}]")
@table_options(NAME, "docs/method.md")
def main(quick: bool, repeats: int | None, target: Path | None, page: Path | None) -> None:
    """Time scenes of all kinds without and with an account of energies, and print a table.

    Run it on an otherwise idle machine. The first call compiles the kernels, up to a quarter of a minute a scene, which is not part of the times.
    """
    settings = Settings(QUICK if quick else WHOLE, repeats or (QUICK_REPEATS if quick else REPEATS))
    run(STUDY, settings, table_place(target, page))
