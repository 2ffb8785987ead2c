"""From a slider's move to what is drawn, on the explorer's page in a headless Chromium."""

# needs: explore, browser

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import check_target, command
from studies.benchmarks.explorer import NAME, QUICK_REPEATS, REPEATS, STUDY, Settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_REPEATS} moves of each case: a look, not a measurement.")
@click.option("--picture", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Keep a picture of the page: .png.")
@table_options(NAME, "docs/explore.md")
def main(quick: bool, picture: Path | None, target: Path | None, page: Path | None) -> None:
    """Move a slider of the page and time what it draws, until the first points, all forces and everything; and how soon stale work ends.

    Run it on an otherwise idle machine. It needs Chromium. The first call compiles kernels, which is not part of the times.
    """
    check_target("--picture", picture, (".png",))
    run(STUDY, Settings(QUICK_REPEATS if quick else REPEATS, None if picture is None else picture.resolve()), table_place(target, page))
