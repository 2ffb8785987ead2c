"""The table of the commands, written into its page."""

from pathlib import Path

import click

from impact_env.checks import require
from optimisation.cli.common import command
from optimisation.cli.group import file_of, summary_of
from optimisation.cli.names import HEADINGS, OLDER_NAMES, list_needs
from optimisation.files import DOCS, fill

NAME = "command_table"
PAGE = DOCS / "commands.md"
HEADER = ("command", "what it does", "needs the extra", "name in the version before")


def make_row(name: str) -> list[str]:
    """Return the row of a command."""
    file = file_of(name)
    assert file is not None
    older = [f"`{old}`" for old, new in OLDER_NAMES.items() if new == name]
    needs = [f"`{extra}`" for extra in list_needs(file)]
    return [f"`{name}`", summary_of(file), ", ".join(needs), ", ".join(older)]


def make_tables() -> str:
    """Return a table for each heading of the list of commands."""
    parts = []
    for heading, names in HEADINGS.items():
        rows = [HEADER, ["---"] * len(HEADER), *(make_row(name) for name in names)]
        lines = [f"| {' | '.join(row)} |" for row in rows]
        parts.append("\n".join([f"**{heading}**", "", *lines]))
    return "\n\n".join(parts)


@command()
@click.option(
    "--page",
    type=click.Path(path_type=Path, dir_okay=False),
    default=PAGE,
    show_default="docs/commands.md",
    help="Page with a pair of markers into which the tables are written.",
)
def main(page: Path) -> None:
    """Write the tables of the commands into their page."""
    require(page.parent.is_dir(), "--page", str(page), "a file in a folder that exists")
    fill(page, PAGE, {NAME: make_tables()})
    click.echo(f"written: {page}")
