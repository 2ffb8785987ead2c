"""Error against run time: all methods and two peers over all scenes, with the growth of errors, the jump study and the costs."""
# needs: peers

from dataclasses import replace
from pathlib import Path

import click

from optimisation.cli.common import command
from studies.accuracy.cases import FULL, QUICK
from studies.accuracy.study import OUT, PARTS, QUICK_OUT, STUDY
from studies.runner import run
from studies.study import with_page


@command()
@click.option("--only", type=click.Choice(PARTS), multiple=True, help="Compute this part only; may be given several times.")
@click.option("--quick", is_flag=True, help="A look in about two minutes: few scenes, methods and runs.")
@click.option("--no-peers", is_flag=True, help="Leave SciPy and heyoka out.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of phases and perturbations.")
@click.option("--redraw", is_flag=True, help="Draw figures and tables anew from the files in --out; nothing is computed.")
@click.option("--resume", is_flag=True, help="Go on from the files in --out where runs were stopped early; what is complete is left as it is.")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for results and figures.  [default: {OUT}; {QUICK_OUT} with --quick]")
def main(only: tuple[str, ...], quick: bool, no_peers: bool, seed: int, redraw: bool, resume: bool, out: Path | None) -> None:
    """Measure error against run time, on one core and without compilation.

    Each part writes PART.json.gz and its figures into --out, and its table into the page FOLDER.md beside that folder if there is one. Run
    it on an otherwise idle machine: the times are medians, but nothing can make up for a core that is shared. Ctrl-C ends a part early and leaves
    what is finished.
    """
    settings = replace(QUICK if quick else FULL, seed=seed, peers=not no_peers)
    run(STUDY, settings, with_page(out or (QUICK_OUT if quick else OUT), only or PARTS), only=only, redraw=redraw, resume=resume)
