"""Compare searches for the same cost: CMA-ES, random search, a Gaussian process with replication and a dense map, over several seeds."""

# needs: optimise

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, executor
from studies.runner import run
from studies.search_methods import QUESTIONS
from studies.search_methods_study import NAME, OUT, QUICK_OUT, STUDY, settings
from studies.study import beside


@command()
@click.option("--quick", is_flag=True, help="A look: 40 designs, 4 members, 2 seeds, sweeps 4 times as fast.")
@click.option("--question", multiple=True, type=click.Choice(list(QUESTIONS)), help="What is searched; may be repeated.  [default: all]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder.  [default: docs, with --quick {QUICK_OUT}]")
@click.option("--redraw", is_flag=True, help="Write the page again from the numbers in the folder; nothing is computed.")
def main(quick: bool, question: tuple[str, ...], threads: int | None, cluster: str | None, out: Path | None, redraw: bool) -> None:
    """Search with each method from scratch over several seeds, and judge the winners on fresh members.

    Writes search_methods.json.gz and the page search_methods.md. Ctrl-C keeps what is finished: the same command goes on from there.
    """
    with plain_errors(), executor(threads, None if redraw else cluster) as where:
        given = settings(quick, question, where)
        run(STUDY, given, beside(out or (QUICK_OUT if quick else OUT), NAME), redraw=redraw, keep=given.keep)
