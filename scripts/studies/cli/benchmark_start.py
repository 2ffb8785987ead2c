"""From nothing to the first figure, in an empty folder with an empty home; and the first calls of other scenes and outputs."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.one_table import table_options, table_place
from studies.runner import run
from studies.specialisation.start import NAME, QUICK, STUDY, WHOLE


@command()
@click.option("--quick", is_flag=True, help="The quick comparison and one first call: a look, not a measurement.")
@table_options(NAME, "docs/internals/cost.md")
def main(quick: bool, target: Path | None, page: Path | None) -> None:
    """Clone the checkout into an empty folder and time set-up, compilation, comparison, and first calls of what is not compiled beforehand.

    Run it on an otherwise idle machine with a network. It measures what is committed, and leaves nothing behind.
    """
    run(STUDY, QUICK if quick else WHOLE, table_place(target, page))
