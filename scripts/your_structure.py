"""Run the commands of docs/your_structure.md and write what they print into it."""

# needs: optimise

from __future__ import annotations

import time
from pathlib import Path

import click

from optimisation.command_line import plain_errors
from optimisation.commands.page_of_commands import PAGE, bring_up_to_date


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--page", type=click.Path(path_type=Path, dir_okay=False, exists=True), default=PAGE, show_default=True, help="Page to bring up to date."
)
def main(page: Path) -> None:
    """Run the commands of docs/your_structure.md, from file to absorber, and write what they print into the page.

    Ctrl-C leaves the page as it was.
    """
    started = time.perf_counter()
    with plain_errors("Broken off; the page is as it was."):
        number = bring_up_to_date(page)
    click.echo(f"{number} commands in {(time.perf_counter() - started) / 60:.1f} minutes, written: {page}")


if __name__ == "__main__":
    main()
