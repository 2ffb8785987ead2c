"""Print what friction does to the paper's impact absorber: levels and branches of the members, with 1, 0.5 and 0.2 % damping."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.studies.friction import CASES, MEMBERS, STUDY, Settings
from optimisation.studies.one_table import table_place
from optimisation.studies.runner import run


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help="A look: the paper's damping only.")
@click.option("--members", type=click.IntRange(min=1), default=MEMBERS, show_default=True, help="Runs for each point.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@click.option("--json", "target", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the numbers too.")
def main(quick: bool, members: int, threads: int | None, target: Path | None) -> None:
    """Print the table of docs/findings.md on friction; sweeps as slow as the damping asks for, so 0.2 % takes longest.

    Ctrl-C prints, and writes, what is finished.
    """
    run(STUDY, Settings(members, CASES[:1] if quick else CASES, threads), table_place(target, None))


if __name__ == "__main__":
    main(prog_name="scripts/run friction_branches")
