"""What each scene leaves out: compiled code, compile time, speed and memory, beside a part that is only switched off."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command
from optimisation.page import DOCS
from studies.runner import run
from studies.specialisation.study import NAME, OUT, QUICK_OUT, STUDY
from studies.study import Place


@command()
@click.option("--quick", is_flag=True, help=f"Three scenes and short runs, into {QUICK_OUT} unless told otherwise.")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for specialisation.json.gz, .csv, .png and .md.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figure and page again from the specialisation.json.gz in the folder; nothing is measured.")
@click.option("--resume", is_flag=True, help="Go on from the specialisation.json.gz in the folder, if that run was stopped early.")
def main(quick: bool, out: Path | None, redraw: bool, resume: bool) -> None:
    """Compile each scene into a cache of its own, look into its compiled code, time it, and compare it with scenes that have a part switched off.

    Run it on an otherwise idle machine: it compiles some twenty variants, one process after the other. The exit code is 1 if a claim does not
    hold. Ctrl-C ends the run early and leaves what is finished.
    """
    folder = out or (QUICK_OUT if quick else OUT)
    place = Place(folder, folder / f"{NAME}.md", DOCS / "internals" / f"{NAME}.md")
    run(STUDY, quick, place, redraw=redraw, resume=resume)
