"""Output files, written whole or not at all."""

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

from impact_env.parameters import require
from impact_env.plain_files import replacing as replacing

STANDARD_OUTPUT = Path("standard output.json")  # this object itself stands for it; see `json_to`
HISTORY_FORMATS = (".csv", ".npz", ".png", ".pdf", ".svg")  # of the motion of a run
_TEXTS: ContextVar[list[str]] = ContextVar("_TEXTS")


def is_writable(folder: Path) -> bool:
    """Return whether a file can be made in a folder; tried, as permissions do not say what a file system allows."""
    try:
        TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def require_writable(name: str, folder: Path) -> None:
    """Make a folder, or raise ParameterError if nothing can be written there: better before a long run than after it."""
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
    """Write what `write_json` is given last for `STANDARD_OUTPUT` to this stream at the end, also of what is interrupted."""
    texts: list[str] = []
    token = _TEXTS.set(texts)
    try:
        yield
    finally:
        _TEXTS.reset(token)
        stream.writelines(texts[-1:])
        stream.flush()


def write_json(path: Path, content: object) -> None:
    """Write JSON, compressed if the name ends in .gz; a number that is not finite raises ValueError, as JSON has none."""
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
    """Write files by their paths, each whole or not at all, and return them; a path of None: not wanted.

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
    """Return the content of a file of `write_json`; raises OSError or ValueError if it cannot be read."""
    content = path.read_bytes()
    try:
        return json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except (EOFError, zlib.error) as error:
        raise ValueError(f"{path.name} is not whole: {error}") from error
