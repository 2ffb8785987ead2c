"""The options of studies that print one table: its numbers as JSON, and the table itself into a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from optimisation.command_line import check_target
from optimisation.studies.study import Place

Command = Callable[..., Any]


def table_options(marker: str, page: str) -> Callable[[Command], Command]:
    """Add --json and --page to a command whose table stands between the markers of ``page``; it gets them as ``target`` and ``page``."""
    file = click.Path(dir_okay=False, path_type=Path)
    words = f"Write the table into this page, between <!-- {marker} --> and <!-- /{marker} -->, as in {page}."

    def add(command: Command) -> Command:
        command = click.option("--page", type=file, metavar="FILE", help=words)(command)
        return click.option("--json", "target", type=file, metavar="FILE", help="Write the numbers, each repeat where there are any.")(command)

    return add


def table_place(target: Path | None, page: Path | None) -> Place:
    """Return where numbers and table go; raises BadInput, before any work is done, if they cannot be written."""
    check_target("--json", target)
    check_target("--page", page)
    return Place(json=target, page=page)
