"""Speed and accuracy of periodic orbits: closed form, maps, Newton's method, branches, folds and multipliers; one core, compilation apart."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.benchmarks.periodic import NAME, QUICK_REPEATS, REPEATS, STUDY
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} repeats instead of {REPEATS}.")
@table_options(NAME, "docs/frequency_domain.md")
def main(quick: bool, target: Path | None, page: Path | None) -> None:
    """Measure periodic orbits against their bars: medians of repeats in one process, compilation apart."""
    run(STUDY, QUICK_REPEATS if quick else REPEATS, table_place(target, page))
