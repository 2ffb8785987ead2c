"""Datasets of a Universal File in text format.

They are read as lines, and as numbers in the fixed columns of the format.

A file that is cut, or has lines outside of its datasets, is refused.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impact_env.checks import ParameterError, describe_error, require

END = "-1"
LARGEST_WHOLE = 10**10  # in ten columns
# numbers of the header of a binary dataset 58: lines of text, and bytes after them
BINARY_LINES = 3
BINARY_BYTES = 4


@dataclass(frozen=True)
class Dataset:
    """A dataset of a Universal File.

    ``kind`` is its number, ``lines`` are its lines without the end marks, and ``start`` is the line
    number (from 1) of the first of them in the file ``path``.
    """

    path: Path
    kind: int
    start: int
    lines: tuple[str, ...]

    def name(self, line: int | None = None) -> str:
        """Return file and dataset, and the line counted from 0 in the dataset, for an error."""
        where = self.start if line is None else self.start + line
        return f"{self.path}, dataset {self.kind}, line {where}"

    def refuse(self, line: int, allowed: str) -> ParameterError:
        """Return the error of a line, counted from 0 in the dataset."""
        result = self.lines[line].strip() if line < len(self.lines) else "(the dataset ends)"
        return describe_error("file", f"{self.name(line)}: {result}", allowed)

    def whole(self, line: int, number: int, least: int | None = None) -> list[int]:
        """Return the first ``number`` integers of a line in fields of 10 columns.

        At least ``least`` of them must be present (None: all); missing ones are 0.
        """
        allowed = f"{number} whole numbers, 10 columns each"
        if line >= len(self.lines):
            raise self.refuse(line, allowed)
        text = self.lines[line].rstrip()
        cells = text.split()
        if len(cells) < (number if least is None else least):
            cells = [text[k : k + 10].strip() for k in range(0, len(text), 10)]
        try:
            result = [int(cell) for cell in cells[:number]]
        except ValueError as error:
            raise self.refuse(line, allowed) from error
        if any(abs(value) >= LARGEST_WHOLE for value in result):
            raise self.refuse(line, allowed)
        if len(result) < (number if least is None else least):
            raise self.refuse(line, allowed)
        return result + [0] * (number - len(result))

    def numbers(self, line: int, number: int, width: int = 13) -> list[float]:
        """Return ``number`` numbers from a line on.

        A line has six or fewer numbers in fields of ``width`` columns.
        """
        per_line = 6 if width == 13 else 3
        result: list[float] = []
        while len(result) < number:
            wanted = min(per_line, number - len(result))
            result += self._line_numbers(line, wanted, width)
            line += 1
        return result

    def _line_numbers(self, line: int, number: int, width: int) -> list[float]:
        allowed = f"{number} finite numbers, {width} columns each"
        if line >= len(self.lines):
            raise self.refuse(line, allowed)
        text = self.lines[line].rstrip()
        cells = text.split()
        if len(cells) != number:  # they may touch
            cells = [text[k : k + width].strip() for k in range(0, len(text), width)]
        try:
            result = [float(cell.replace("D", "E").replace("d", "e")) for cell in cells]
        except ValueError as error:
            raise self.refuse(line, allowed) from error
        if len(result) != number or not np.all(np.isfinite(result)):
            raise self.refuse(line, allowed)
        return result


def read_datasets(path: Path) -> list[Dataset]:
    """Return all datasets of a Universal File.

    Those of binary data have no lines. Raises ParameterError for a file that is cut or that is no
    Universal File.
    """
    require(path.is_file(), "file", str(path), "a Universal File that exists")
    try:
        content = path.read_bytes()
    except OSError as error:
        allowed = f"a Universal File that can be read ({error})"
        raise describe_error("file", str(path), allowed) from error
    lines = content.splitlines(keepends=True)
    result = []
    k = 0
    while k < len(lines):
        text = lines[k].strip()
        if text == b"":
            k += 1
            continue
        require(
            text == END.encode(),
            "file",
            f"{path}, line {k + 1}: {_text(lines[k])[:40]}",
            "a Universal File: datasets, each between two lines with -1",
        )
        k, dataset = _dataset(path, lines, k + 1)
        result.append(dataset)
    return result


def _text(line: bytes) -> str:
    return line.decode("latin-1").rstrip("\r\n")


def _dataset(path: Path, lines: list[bytes], k: int) -> tuple[int, Dataset]:
    """Return the line after a dataset whose first line (its kind) is ``k``, and the dataset."""
    cut = describe_error(
        "file",
        f"{path}, line {k}",
        "a complete Universal File; its last dataset has no end (a line with -1)",
    )
    if k >= len(lines):
        raise cut
    cells = _text(lines[k]).split()
    word = cells[0] if cells else ""
    binary = word.endswith(("b", "B"))
    require(
        word.rstrip("bB").isdigit(),
        "file",
        f"{path}, line {k + 1}: {_text(lines[k])[:40]}",
        "the number of a dataset",
    )
    kind = int(word.rstrip("bB"))
    start = k + 1
    if binary:
        try:
            skipped = int(cells[BINARY_LINES])
            left = int(cells[BINARY_BYTES])
        except (IndexError, ValueError) as error:
            name = f"{path}, line {k + 1}"
            raise describe_error("file", name, "the header of a binary dataset") from error
        k = start + skipped
        while left > 0 and k < len(lines):
            left -= len(lines[k])
            if left < 0:  # the end mark follows the bytes on the same line
                lines[k] = lines[k][left:]
                break
            k += 1
        if left > 0:
            raise cut
        start = k
    end = k if binary else start
    while end < len(lines) and lines[end].strip() != END.encode():
        end += 1
    if end >= len(lines):
        raise cut
    body = () if binary else tuple(_text(line) for line in lines[start:end])
    return end + 1, Dataset(path, kind, start + 1, body)
