"""What loads other than one force do to impact absorbers: both resonances at once, random, gravity, shocks, starts."""

from pathlib import Path

import click

from optimisation.cli.common import command
from optimisation.page import DOCS, published
from studies.load_answers import STUDY
from studies.load_spectra import Settings
from studies.runner import run
from studies.study import Place

QUICK_OUT = Path("results/load_answers")
MEMBERS, QUICK_MEMBERS = 5, 2


@command()
@click.option("--only", multiple=True, type=click.Choice([part.name for part in STUDY.parts]), help="Only this part; may be repeated.")
@click.option("--members", type=click.IntRange(min=1), help=f"Runs for each point, other in phase and 1e-6 of force.  [default: {MEMBERS}]")
@click.option("--quick", is_flag=True, help=f"Every fourth point, {QUICK_MEMBERS} members unless given, into {QUICK_OUT} unless told otherwise.")
@click.option("--redraw", is_flag=True, help="Draw and tell again from the files in the folder; nothing is run.")
@click.option("--resume", is_flag=True, help="Go on from files of runs that were stopped.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help=f"Folder.  [default: docs, without a checkout {QUICK_OUT}]")
def main(only: tuple[str, ...], members: int | None, quick: bool, redraw: bool, resume: bool, out: Path | None) -> None:
    """Measure what is left of level, RMS or decay time with impact absorbers on two beams, and write tables and figures into docs/loads.md."""
    folder = out or (QUICK_OUT if quick else published(DOCS, QUICK_OUT))
    settings = Settings(members or (QUICK_MEMBERS if quick else MEMBERS), quick)
    run(STUDY, settings, Place(folder, folder / "loads.md", DOCS / "loads.md"), only=only, redraw=redraw, resume=resume)
