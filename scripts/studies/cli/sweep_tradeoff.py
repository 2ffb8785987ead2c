"""Is there anything to choose in a passage? Level and score over the rate, for several scenes, and over the place of a slow window."""

# needs: env

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from studies.runner import run
from studies.study import Place
from studies.tradeoff import OUT, QUICK_OUT, STUDY


@command()
@click.option("--quick", is_flag=True, help=f"One scene, few rates and seeds, into {QUICK_OUT} unless told otherwise.")
@click.option("--redraw", is_flag=True, help="Draw the figure again from the JSON file in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for sweep_tradeoff.json.gz and .png.  [default: docs, without a checkout {QUICK_OUT}]",
)
def main(quick: bool, redraw: bool, out: Path | None) -> None:
    """Measure levels and scores of passages over the rate and over the place of a slow window, and draw them."""
    run(STUDY, quick, Place(out or (QUICK_OUT if quick else OUT)), redraw=redraw)
