"""Reproduction of the paper, docs/paper.md.

It has the paper's figures with bands, and a verdict on each of its statements.
"""

import sys
from pathlib import Path

import click

from optimisation.cli.common import cluster_option, command, seed_option, threads_option
from optimisation.executors import workers
from studies.paper.frame import PaperSettings
from studies.paper.study import CLAIMS, LABELS, OUT, QUICK_OUT, STUDY, make_paths
from studies.study import run


@command()
@click.option(
    "--figure",
    "figures",
    type=click.Choice(LABELS),
    multiple=True,
    help="Figure by the paper's label; may be repeated.  [default: all]",
)
@click.option(
    "--quick",
    is_flag=True,
    help=f"Few points and members, by default into {QUICK_OUT}.",
)
@seed_option
@threads_option
@cluster_option
@click.option(
    "--redraw",
    is_flag=True,
    help="Write figures, page and claims again from the folder's numbers; nothing is computed.",
)
@click.option("--anew", "recompute", is_flag=True, help="Compute finished figures again too.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for paper.md and its folder paper; docs: the published page.  [default: {OUT}]",
)
def main(
    figures: tuple[str, ...],
    quick: bool,
    seed: int,
    threads: int | None,
    cluster: str | None,
    redraw: bool,
    recompute: bool,
    out: Path | None,
) -> None:
    """Compute the figures of the paper and judge its statements by them.

    Both are written as a page with files.

    A finished figure is kept as long as its parameters and the simulator are the same; a stopped
    command goes on where it was. Statements are judged by all figures in the folder, those of
    earlier commands too.
    """
    where = make_paths(out or (QUICK_OUT if quick else OUT))
    assert where.folder is not None
    ended = 0
    with workers(threads, None if redraw else cluster) as executor:
        settings = PaperSettings(where.folder, quick, seed, threads, executor)
        try:
            run(STUDY, settings, where, only=figures, redraw=redraw, resume=not recompute)
        except SystemExit as stopped:  # Ctrl-C: what is finished is judged all the same
            ended = int(stopped.code or 0)
        run(CLAIMS, settings, where)
    sys.exit(ended)
