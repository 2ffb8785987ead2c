"""What each figure's module has: `PART`, what its numbers depend on, and the claims that are read from them.

A module measures in groups of plain values and says them in words; lines, bands and markers are drawn by the module of its name in ``figures``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from optimisation.machine import sources
from optimisation.report.markdown import markdown
from studies.paper.claim import Claim
from studies.paper.settings import Settings
from studies.study import Json, Measured, Part, Saver, Steps, Table

NAME = "paper"
ROWS = 7  # of a long table that the page shows
POINTS = 2  # two numbers are a pair, not points


class PaperFigure(Protocol):
    """A module of a figure. ``parameters(settings)``: all that its numbers depend on beside the kernels and its source, as plain values.

    ``claims(measured)``: the statements of the paper that its numbers, all of them, decide.
    """

    __file__: str | None
    PART: Part[Settings]

    def parameters(self, settings: Settings) -> Json:
        """See above."""

    def claims(self, measured: Measured) -> list[Claim]:
        """See above."""


def marker(label: str) -> str:
    """Return the name of a figure's section on the page."""
    return f"{NAME}:{label}"


def figure_part(
    label: str,
    title: str,
    measure: Callable[[Settings, Json], Steps],
    words: Callable[[Json], str],
    figures: Callable[[Measured], Mapping[str, Saver]],
    tables: Callable[[Json], Sequence[Table]] = lambda _: (),
) -> Part[Settings]:
    """Return the part of a figure with the paper's ``label``.

    Between its markers stand the figures, ``words`` of its values, and what they were measured by. ``tables``: those too long for the page, as CSV
    files, of which `shortened` shows some rows.
    """

    def sections(measured: Measured) -> dict[str, str]:
        drawn = [f"![{title[0].upper()}{title[1:]}]({NAME}/{name}.png)" for name in figures(measured)]
        seconds = f"{measured.conditions['wall_s']:g} s.{'' if measured.complete else ' Stopped early.'}"
        made = f"{amounts(measured.conditions)}{sources(measured.conditions)} {seconds}"
        return {marker(label): "\n\n".join([*drawn, words(measured.values), made])}

    def drawn(measured: Measured) -> dict[str, Saver]:
        from studies.paper.style import styled  # matplotlib is slow to import

        return {name: styled(save) for name, save in figures(measured).items()}

    return Part(
        label, title, measure=measure, markers=(marker(label),), sections=sections, figures=drawn,
        tables=lambda measured: tables(measured.values) if measured.complete else (),
    )  # fmt: skip


def shortened(whole: Table) -> str:
    """Return some rows of a table, its first and last among them, and where all are."""
    rows = list(whole.rows)
    kept = sorted({round(k * (len(rows) - 1) / (ROWS - 1)) for k in range(ROWS)}) if len(rows) > ROWS else range(len(rows))
    cells = [tuple(map(str, rows[k])) for k in kept]
    return f"{markdown(whole.columns, cells)}\n\nAll {len(rows)} rows: [{whole.name}.csv]({NAME}/{whole.name}.csv)."


def amounts(conditions: Json) -> str:
    """Say how many members there are, and how many points of each list of numbers, by the parameters of the part's key; empty if it has none."""
    parameters = conditions.get("key", {}).get("parameters", {})
    members = [f"{parameters['members']} members"] if isinstance(parameters.get("members"), int) else []
    lists = {name: row for name, row in parameters.items() if isinstance(row, list) and len(row) > POINTS and name.endswith("s")}
    points = [f"{name} {len(row)}" for name, row in lists.items() if all(isinstance(x, int | float) for x in row)]
    said = "; ".join([*members, *([f"number of points: {', '.join(points)}"] if points else [])])
    return f"{said[0].upper()}{said[1:]}. " if said else ""


def in_turn(groups: Mapping[str, Callable[[], object]], known: Json) -> Steps:
    """Yield all values that are known after each of the groups, by its name; those of an earlier run are kept."""
    values = {name: known[name] for name in groups if name in known}
    for name, measure in groups.items():
        if name not in values:
            values = {**values, name: measure()}
            yield {own: values[own] for own in groups if own in values}
    if all(name in known for name in groups):
        yield values


def has(measured: Json, *names: str) -> bool:
    """Return whether groups are among the values: words and figures of a run that was stopped show what there is."""
    return all(name in measured for name in names)
