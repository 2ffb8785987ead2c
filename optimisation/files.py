"""Files that commands write, either completely or not at all.

They are CSV files, JSON files, and pages whose tables stand between markers.

The text of a page is written by hand, its tables by a command. A marker is a line ``<!-- NAME
-->``, its end ``<!-- /NAME -->``.
"""

import csv
import gzip
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TextIO

from impact_env.checks import ParameterError, require
from impact_env.plain_files import replacing as replacing

STANDARD_OUTPUT = Path("standard output.json")  # this object itself stands for it; see `json_to`
HISTORY_FORMATS = (".csv", ".npz", ".png", ".pdf", ".svg")  # of the motion of a run
_TEXTS: ContextVar[list[str]] = ContextVar("_TEXTS")


def is_writable(folder: Path) -> bool:
    """Return whether a file can be made in a folder.

    This is tested by making a file, because permissions alone do not determine what a file system
    allows.
    """
    try:
        TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def require_writable(name: str, folder: Path) -> None:
    """Make a folder, or raise ParameterError if nothing can be written in it.

    So the error occurs before a long run instead of after it.
    """
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    require(
        is_writable(folder),
        name,
        str(folder),
        "a folder that exists or can be made, and that can be written to",
    )


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table under one line of column names; floats keep all their digits."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


@contextmanager
def json_to(stream: TextIO) -> Iterator[None]:
    """Write the last content that `write_json` received for `STANDARD_OUTPUT` to this stream.

    It is written at the end, also if the computation is interrupted.
    """
    texts: list[str] = []
    token = _TEXTS.set(texts)
    try:
        yield
    finally:
        _TEXTS.reset(token)
        stream.writelines(texts[-1:])
        stream.flush()


def write_json(path: Path, content: object) -> None:
    """Write JSON, compressed if the name ends in .gz.

    Raises ValueError for a number that is not finite, because JSON has none.
    """
    if path is STANDARD_OUTPUT:
        _TEXTS.get().append(json.dumps(content, indent=2, allow_nan=False) + "\n")
        return
    with replacing(path) as temporary:
        if path.suffix == ".gz":
            text = json.dumps(content, separators=(",", ":"), allow_nan=False)
            temporary.write_bytes(
                gzip.compress(text.encode(), mtime=0)
            )  # without the time the same content is the same file
        else:
            temporary.write_text(
                json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8"
            )


Table = tuple[Sequence[str], Iterable[Sequence[object]]]  # names of columns, and rows


def write_files(contents: Mapping[Any, object]) -> list[Path]:
    """Write files by their paths, each completely or not at all, and return the paths.

    A content with the path None is not written.

    A `Table` is CSV (`write_csv`); a function draws what is in the file; all else is JSON.
    """
    wanted = {path: content for path, content in contents.items() if path is not None}
    for path, content in wanted.items():
        if isinstance(content, tuple):
            write_csv(path, *content)
        elif callable(content):
            content(path)
        else:
            write_json(path, content)
    return list(wanted)


def number(value: float) -> float | None:
    """Return a number as JSON knows it: None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def numbers(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON knows them."""
    return [number(value) for value in values]


def read_json(path: Path) -> Any:
    """Return the content of a file of `write_json`.

    Raises OSError or ValueError if it cannot be read.
    """
    content = path.read_bytes()
    try:
        return json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except (EOFError, zlib.error) as error:
        raise ValueError(f"{path.name} is not whole: {error}") from error


ROOT = Path(__file__).resolve().parents[1]  # the checkout, if there is one
DOCS = (
    ROOT / "docs"
)  # the pages with their text: where a page is written anew, it starts from the one here


def publication_folder(docs: Path, results: Path) -> Path:
    """Return the folder to which a whole study is written by default.

    It is that of the checkout's docs, or ``results`` without a checkout.
    """
    return docs if (ROOT / "pyproject.toml").is_file() else results


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->", f"<!-- /{name} -->"


def has_markers(text: str, name: str) -> bool:
    """Return whether a text has the markers of a section, once and in order."""
    start, end = _markers(name)
    return text.count(start) == 1 == text.count(end) and text.index(start) < text.index(end)


def require_markers(path: Path, template: Path, names: Iterable[str]) -> str:
    """Return the text of the page from which `fill` starts.

    Raises ParameterError unless it has the markers of each section, once and in order.
    """
    source = path if path.exists() else template
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterError(
            f"{source} is not allowed: a page that can be read ({error})"
        ) from error
    for name in names:
        if not has_markers(text, name):
            start, end = _markers(name)
            raise ParameterError(
                f"{source} is not allowed: a page with one pair of markers {start} and {end}"
            )
    return text


def fill(path: Path, template: Path, sections: Mapping[str, str]) -> None:
    """Write a page with new text between the markers of each section.

    The text starts from ``path`` if it exists, else from ``template``, and is written to ``path``.

    Raises ParameterError, before anything is written, if a marker is missing.
    """
    text = require_markers(path, template, sections)
    for name, body in sections.items():
        start, end = _markers(name)
        head, rest = text.split(start)
        text = head + start + "\n" + body.strip("\n") + "\n" + end + rest.split(end)[1]
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an aligned Markdown table; the first column is flush left, the others flush right."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        first, *others = (
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "| " + " | ".join([first, *others]) + " |"

    rule = (
        "| "
        + " | ".join(
            "-" * width if i == 0 else "-" * (width - 1) + ":" for i, width in enumerate(widths)
        )
        + " |"
    )
    return "\n".join([line(header), rule, *map(line, rows)])
