"""Studies of one table: it is printed, its numbers go to a JSON file, and the table itself into a page, each on request."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from optimisation.cli.common import Command, check_target, json_option, page_option
from optimisation.machine import machine, sources
from optimisation.page import markdown
from studies.study import Json, Measured, Part, Place, Steps, Study

S = TypeVar("S")


def pack(_name: str, measured: Measured) -> Json:
    """Return the content of the JSON file."""
    return {"machine": machine(measured.conditions), **measured.values}


def table_study(name: str, title: str, measure: Callable[[S], Json], said: Callable[[Measured], str]) -> Study[S]:
    """Return the study whose table ``said`` puts into words; what ``measure`` returns of the settings is whole, or there is nothing."""

    def measured(settings: S, _known: Json) -> Steps:
        yield measure(settings)

    def sections(found: Measured) -> dict[str, str]:
        return {name: f"{said(found)}\n\n{sources(found.conditions)}"}

    return Study((Part(name, title, measure=measured, markers=(name,), sections=sections, said=said),), pack=pack, kept="nothing is written.")


def lines(columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a Markdown table with a line for each row; ``columns`` say by their headers how values of a row are written, as for `str.format`."""
    return markdown(tuple(columns), [tuple(form.format(**row) for form in columns.values()) for row in rows])


def table_options(marker: str, page: str) -> Callable[[Command], Command]:
    """Add --json and --page to a command whose table stands between the markers of ``page``; it gets them as ``target`` and ``page``."""
    json, table = json_option("Write the numbers, each repeat where there are any.", "target"), page_option(marker, page)
    return lambda command: json(table(command))


def table_place(target: Path | None, page: Path | None) -> Place:
    """Return where numbers and table go; raises BadInput, before any work is done, if they cannot be written."""
    check_target("--json", target)
    check_target("--page", page)
    return Place(json=target, page=page)
