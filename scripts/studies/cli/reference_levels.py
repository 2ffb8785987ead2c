"""Response levels beside numbers computed earlier with the Moreau scheme, near the first and the second resonance."""

from __future__ import annotations

from pathlib import Path

import click

from impact_env.curve import DEFAULT_MEMBERS
from optimisation.cli.common import command
from studies.levels import NAME, STUDY, Settings
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option(
    "--members",
    type=click.IntRange(min=1),
    default=DEFAULT_MEMBERS,
    show_default=True,
    help="Runs for each point, other in phase and 1e-6 of force.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the phases and forces.")
@table_options(NAME, "docs/methods.md")
def main(members: int, seed: int, target: Path | None, page: Path | None) -> None:
    """Compute response levels of the paper's scenes and print them beside numbers computed earlier with the Moreau scheme."""
    run(STUDY, Settings(members, seed), table_place(target, page))
