"""Output files, written whole or not at all."""

import csv
import gzip
import json
import math
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from impact_env.parameters import require
from impact_env.plain_files import replacing as replacing


def require_writable(name: str, folder: Path) -> None:
    """Make a folder, or raise ParameterError if nothing can be written there: better before a long run than after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    require(
        writable,
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


def write_json(path: Path, content: object) -> None:
    """Write JSON, compressed if the name ends in .gz; a number that is not finite raises ValueError, as JSON has none."""
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
