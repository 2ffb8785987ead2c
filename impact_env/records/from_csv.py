"""Records from tables of text with a header.

Columns are separated by commas, semicolons, tabs or spaces. Numbers have decimal points or commas.
"""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.plain_files import decode_text
from impact_env.records.channels import Channel, RecordOptions, channel_of_columns
from impact_env.records.units import find_unit

COMMENTS = ("#", "%", "//")
NUMERIC_LINE = re.compile(r"[\s\d.,;:+\-eEdD\"']*\d[\s\d.,;:+\-eEdD\"']*")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,(?:[eE][+-]?\d+)?")
SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)  # of spreadsheets, in the first line
NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
EXAMPLE_HEADER = "a header, as time_s,value"


@dataclass(frozen=True)
class TextTable:
    """The parts of a table in a text file.

    ``header`` are the labels, ``units`` the row of units (None: no such row), ``separator`` that of
    cells (None: spaces), and ``first`` the index of the first line of numbers.
    """

    header: list[str]
    units: list[str] | None
    separator: str | None
    first: int


def split_line(file: Path, row: int, line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without spaces around them."""
    if separator is None:
        return line.split()
    try:
        return [
            cell.strip()
            for cell in next(
                csv.reader([line], delimiter=separator, strict=True, skipinitialspace=True)
            )
        ]
    except csv.Error as error:
        raise ParameterError(
            f"{file.name}: row {row} = {line[:60]!r} is not allowed: cells whose quotes are "
            f"closed ({error})"
        ) from error


def _read_head(file: Path, lines: Sequence[str], options: RecordOptions) -> TextTable:
    """Return header and separator of a table.

    Raises ParameterError for lines before the numbers that are not a header.
    """
    first = next((k for k, line in enumerate(lines) if NUMERIC_LINE.fullmatch(line)), None)
    if first is None:
        filled = [k for k, line in enumerate(lines) if line.strip()]
        if len(filled) > 1 and re.search(r"\d", lines[filled[-1]]):
            k = filled[-1]
            raise ParameterError(
                f"{file.name}: row {k + 1} = {lines[k].strip()[:60]!r} is not allowed: rows "
                "of real numbers alone below the header, no dates"
            )
        raise ParameterError(
            f"{file.name}: rows of numbers = 0 is not allowed: {EXAMPLE_HEADER}, and two "
            "samples or more"
        )
    match = SEPARATOR_LINE.fullmatch(lines[0].strip())
    marks = (mark for mark in (";", "\t", ",") if mark in lines[first])
    separator = match[1] if match else next(marks, None)
    if separator is None and len(lines[first].split()) == 1:
        separator = ","
    rows = [
        (k, line.strip())
        for k, line in enumerate(lines[:first])
        if line.strip() and not (match and k == 0)
    ]
    comments = [(k, line.lstrip("#%/ \t")) for k, line in rows if line.startswith(COMMENTS)]
    titles = [(k, line) for k, line in rows if not line.startswith(COMMENTS)]
    width = len(split_line(file, first + 1, lines[first], separator))
    if (
        not titles
        and comments
        and len(split_line(file, comments[-1][0] + 1, comments[-1][1], separator)) == width
    ):
        titles = [comments.pop()]
    for k, line in comments:
        if options.unit is None and re.search(r"\bunits?\b", line, re.IGNORECASE):
            raise ParameterError(
                f"{file.name}: row {k + 1} = {line[:60]!r} is not allowed: units in the "
                "header, or the load's unit beside such a comment"
            )
    if not titles:
        cells = split_line(file, first + 1, lines[first], separator)
        raise ParameterError(
            f"{file.name}: row {first + 1} = {cells!r} is not allowed: {EXAMPLE_HEADER}"
        )
    heads = [split_line(file, k + 1, line, separator) for k, line in titles]
    units: list[str] | None = None
    if len(heads) == 2:
        texts = [re.sub(r"^[(\[{<]|[)\]}>]$", "", cell).strip() for cell in heads[1]]
        units = texts if all(not text or find_unit(text) for text in texts) else None
    if len(heads) > (2 if units is not None else 1):
        row = titles[-1][0] + 1
        raise ParameterError(
            f"{file.name}: row {row} = {heads[-1]!r} is not allowed: numbers after one "
            "header, or a row of units such as s,m/s^2"
        )
    return TextTable(heads[0], units, separator, first)


def _read_rows(file: Path, lines: Sequence[str], table: TextTable) -> Iterator[list[float]]:
    """Yield the numbers of each row.

    Raises ParameterError for a row with other content, or with more or fewer numbers.
    """
    width = len(table.header)
    last = max(k for k, line in enumerate(lines) if line.strip())
    decimal = ""
    for k in range(table.first, last + 1):
        cells = split_line(file, k + 1, lines[k], table.separator)
        row = f"{file.name}: row {k + 1}"
        excerpt = cells if len(cells) <= 8 else [*cells[:8], "..."]
        require(
            len(cells) == width, row, excerpt, f"{width} cells, as the header has; numbers, no gap"
        )
        for cell in cells:
            mark = "," if "," in cell else "." if "." in cell else ""
            if mark and mark != decimal:
                ok = not decimal and (mark == "." or DECIMAL_COMMA.fullmatch(cell) is not None)
                require(
                    ok,
                    row,
                    excerpt,
                    "numbers with one decimal mark throughout, and no marks of thousands",
                )
                decimal = mark
        numbers = []
        for cell in cells:
            number = cell.replace(",", ".") if decimal == "," else cell
            numbers.append(float(number) if NUMBER_PATTERN.fullmatch(number) else math.nan)
        require(all(map(math.isfinite, numbers)), row, excerpt, "finite numbers, no gap")
        yield numbers


def _read_plain_rows(lines: Sequence[str], table: TextTable) -> NDArray[np.float64] | None:
    """Return the numbers (K, columns) of regular rows, in a tenth of the time of `_read_rows`.

    The result is None if a row has another form.
    """
    last = max(k for k, line in enumerate(lines) if line.strip())
    body = lines[table.first : last + 1]
    if table.separator != "," and any("," in line for line in body):
        if any("." in line for line in body):
            return None
        body = [line.replace(",", ".") for line in body]
    try:
        rows = np.loadtxt(
            body, delimiter=table.separator, quotechar='"', comments=None, ndmin=2, encoding=None
        )
    except ValueError:
        return None
    plain = rows.shape == (len(body), len(table.header)) and bool(np.all(np.isfinite(rows)))
    return rows if plain else None


def _refuse_cut(file: Path, lines: Sequence[str], decimal_places: int = 3) -> None:
    """Raise ParameterError if a file was cut in its last line.

    This is the case if the last line has no line end and fewer decimals than all lines before it.
    """
    last = lines[-1].strip()
    before = [line for line in lines[-12:-1] if line.strip()]
    if not last or len(before) < 8:
        return
    lengths = {len(re.split(r"[.,]", line.rstrip())[-1]) for line in before}
    if len(lengths) == 1 and not any("e" in line.lower() for line in before):
        (usual,) = lengths
        ok = usual < decimal_places or len(re.split(r"[.,]", last)[-1]) >= usual
        require(
            ok,
            f"{file.name}: row {len(lines)}",
            last[:60],
            f"{usual} decimals and the end of a line, as in the rows before: the file is cut",
        )


def _without_last_separator(
    file: Path, lines: list[str], table: TextTable
) -> tuple[list[str], TextTable]:
    """Return lines and table without a separator at the end of each row.

    Files of some loggers have such a separator after the numbers of each row.
    """
    mark = table.separator
    first = lines[table.first].rstrip(" ")
    if mark is None or not first.endswith(mark):
        return lines, table
    width = len(split_line(file, table.first + 1, first, mark))
    header = table.header[:-1] if table.header[-1] == "" else table.header
    if len(header) != width - 1:
        return lines, table
    result = list(lines)
    for k in range(table.first, len(lines)):
        line = lines[k].rstrip(" ")
        ok = not line.strip() or line.endswith(mark)
        require(ok, f"{file.name}: row {k + 1}", line[:60], f"{mark!r} at the end, as in all rows")
        result[k] = line.removesuffix(mark)
    units = table.units
    if units is not None and len(units) == width and units[-1] == "":
        units = units[:-1]
    return result, replace(table, header=header, units=units)


def read_csv(file: Path, options: RecordOptions) -> Channel:
    """Return a channel of a table with a header.

    The table has a column of times and one or more columns of values, or values alone.
    """
    lines = decode_text(file)
    table = _read_head(file, lines, options)
    lines, table = _without_last_separator(file, lines, table)
    rows = _read_plain_rows(lines, table)
    if rows is None:
        rows = np.array(list(_read_rows(file, lines, table)))
    _refuse_cut(file, lines)
    header = table.header
    if table.units is not None:
        allowed = "as many units as columns, and none in the header beside them"
        require(len(table.units) == len(header), f"{file.name}: units", table.units, allowed)
        header = [
            f"{name} ({unit})" if unit else name
            for name, unit in zip(header, table.units, strict=True)
        ]
    return channel_of_columns(file, options, list(rows.T), header, table.first + 1)
