"""Studies of one part: what is measured are the fields of one record, told with one table, one figure and one page, all of the study's name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from studies.study import Json, Measured, Part, Saver, Steps, Study, Table, unpack

S = TypeVar("S")
R = TypeVar("R")


def one_part(
    name: str,
    title: str,
    kind: Callable[..., R],
    *,
    measure: Callable[[S, Json], Steps],
    steps: Callable[[S, Json], int],
    markers: tuple[str, ...],
    sections: Callable[[Measured], Mapping[str, str]],
    said: Callable[[Measured], str],
    columns: Sequence[str],
    rows: Callable[[R], Sequence[Json]],
    figure: Callable[[], Callable[[Path, R], None]],
    failures: Callable[[R], Iterable[str]],
    notes: Callable[[S], Json],
) -> Study[S]:
    """Return the study whose values are the arguments of ``kind``, and of which table, figure and failures are read as that record.

    ``figure`` returns what draws it, since matplotlib is slow to import; the other arguments are those of `Part` and `Study`.
    """

    def read(measured: Measured) -> R:
        return kind(**measured.values)

    def tables(measured: Measured) -> list[Table]:
        return [Table(name, columns, [[row[column] for column in columns] for row in rows(read(measured))])]

    def figures(measured: Measured) -> dict[str, Saver]:
        draw, results = figure(), read(measured)
        return {name: lambda path: draw(path, results)}

    def unpacked(part: str, content: Json) -> Measured:
        measured = unpack(part, content)
        return Measured(vars(read(measured)), measured.conditions, measured.complete)

    part = Part(
        name,
        title,
        measure=measure,
        markers=markers,
        sections=sections,
        steps=steps,
        tables=tables,
        figures=figures,
        said=said,
        failures=lambda measured: list(failures(read(measured))),
    )
    return Study((part,), notes=notes, unpack=unpacked)
