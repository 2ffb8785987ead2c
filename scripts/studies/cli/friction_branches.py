"""Print what friction does to the paper's impact absorber: levels and branches of the members, with 1, 0.5 and 0.2 % damping."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, executor
from studies.friction import CASES, MEMBERS, NAME, STUDY, Settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help="A look: the paper's damping only.")
@click.option(
    "--members", type=click.IntRange(min=1), default=MEMBERS, show_default=True, help="Runs for each point at 1 %; half and a quarter at less."
)
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@table_options(NAME, "docs/findings.md")
def main(quick: bool, members: int, threads: int | None, cluster: str | None, target: Path | None, page: Path | None) -> None:
    """Print the table of docs/findings.md on friction; sweeps as slow as the damping asks for, so 0.2 % takes longest.

    Ctrl-C prints, and writes, what is finished; with --json the same command goes on from there.
    """
    with plain_errors(), executor(threads, cluster) as where:
        given = Settings(members, CASES[:1] if quick else CASES, where)
        run(STUDY, given, table_place(target, page), keep=given.keep)
