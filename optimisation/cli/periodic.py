"""Exact orbits, isolas, and the slow invariant manifold; periodic --help lists its subcommands."""

from pathlib import Path

import click

from optimisation.cli.group import GROUP_SETTINGS, Commands, subcommand_files


class Subcommands(Commands):
    """The subcommands of `optimisation.cli.group.PERIODIC`."""

    def sections(self) -> dict[str, dict[str, Path]]:
        """Return the subcommands under one heading."""
        return {"Subcommands": subcommand_files()}

    def older(self) -> dict[str, Path]:
        """Return no further names."""
        return {}


@click.command(
    cls=Subcommands,
    subcommand_metavar="NAME [OPTIONS]",
    options_metavar="",
    context_settings=GROUP_SETTINGS,
)
def main() -> None:
    """Compute periodic orbits, their bifurcations, and which motions runs end on, with the exact method.

    NAME --help lists the options of a subcommand.
    """
