"""Stiff and extreme cases with every method, step limits, eigenproblem, very long runs: what holds, what is refused, what fails."""

from pathlib import Path

import click

from impact_env.ensemble import available_cores
from optimisation.cli.common import command
from studies.runner import run
from studies.stability.study import OUT, PART, QUICK_OUT, STUDY, Settings
from studies.study import with_page


@command()
@click.option("--quick", is_flag=True, help=f"Some of the cases and shorter runs, into {QUICK_OUT} unless told otherwise.")
@click.option("--workers", type=click.IntRange(min=1), help="Number of processes.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for stability.json.gz, .csv and .png.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figure and page again from the stability.json.gz in the folder; nothing is computed.")
@click.option("--resume", is_flag=True, help="Go on from the stability.json.gz in the folder, if that run was stopped early.")
def main(quick: bool, workers: int | None, out: Path | None, redraw: bool, resume: bool) -> None:
    """Run the matrix of stiff and extreme cases with every method, and look for step limits, eigenproblem errors and drift in very long runs.

    Each cell either comes close to an independent reference or is refused with a clear error. The exit code is 1 if any cell failed.
    Tables go into the page FOLDER.md beside the folder, if there is one. Under 10 minutes (--quick: under one) once the kernels are
    compiled. Ctrl-C ends the run early and leaves what is finished.
    """
    place = with_page(out or (QUICK_OUT if quick else OUT), PART.markers)
    run(STUDY, Settings(quick, workers or available_cores()), place, redraw=redraw, resume=resume)
