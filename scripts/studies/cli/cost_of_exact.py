"""What the exact method's time is spent on: the cost of its parts, how often each is needed, and what is left over."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.cost.study import NAME, PERIODS, QUICK_PERIODS, STUDY
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"Runs of {QUICK_PERIODS:g} pseudo periods instead of {PERIODS:g}.")
@table_options(NAME, "docs/internals/cost.md")
def main(quick: bool, target: Path | None, page: Path | None) -> None:
    """Say what the exact method's time is spent on, on one core."""
    run(STUDY, QUICK_PERIODS if quick else PERIODS, table_place(target, page))
