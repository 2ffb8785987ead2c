"""What the workbench finds on the paper's beam: best designs, optima, place, robustness, limits; figures and tables of docs/findings.md."""

# needs: optimise, cluster

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, executor
from optimisation.files import require_writable
from studies.findings.page import PARTS
from studies.findings.study import OUT, QUICK_OUT, STUDY, place, settings
from studies.runner import run


@command()
@click.option("--part", "parts", type=click.Choice(list(PARTS)), multiple=True, help="Part to do; may be repeated.  [default: all]")
@click.option("--quick", is_flag=True, help=f"A look: few designs, fast sweeps, into {QUICK_OUT} unless told otherwise; the numbers mean little.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of searches and members.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the numbers do not depend on it.  [default: all cores]")
@cluster_option
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for findings.md and its folder findings.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figures and tables again from the numbers in the folder; nothing is computed.")
def main(parts: tuple[str, ...], quick: bool, seed: int, threads: int | None, cluster: str | None, out: Path | None, redraw: bool) -> None:
    """Search, judge and explain the best absorbers for the paper's beam, and write docs/findings.md with its figures and tables.

    The text of the page is written by hand; what stands between markers is written by this command. Ctrl-C ends a part; finished parts are written,
    and the same command goes on inside the searches of the other.
    """
    out = out or (QUICK_OUT if quick else OUT)
    with plain_errors(), executor(threads, None if redraw else cluster) as where:
        given = settings(quick, where, seed, out)
        require_writable("results", given.folder)
        run(STUDY, given, place(out), only=parts, redraw=redraw)
