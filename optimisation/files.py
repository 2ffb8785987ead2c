"""Output files, written whole or not at all."""

import csv
import gzip
import json
import os
import sys
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError, require
from impact_env.plain_files import replacing as replacing


def append(path: Path, content: bytes) -> None:
    """Add to the end of a file, or leave it as it was: a system may write a part only, and a disk may be full. Raises OSError then."""
    with path.open("ab", buffering=0) as file:
        begin, left = file.seek(0, os.SEEK_END), memoryview(content)
        try:
            while left:
                left = left[file.write(left) :]
        except BaseException:
            file.truncate(begin)
            raise


@contextmanager
def held(path: Path, refusal: ParameterError) -> Iterator[None]:
    """Hold a file for this process; the system lets go of it however the process ends. Raises ``refusal`` if another holds it.

    The file itself is locked, but on Windows, where nothing else could read it then, one beside it.
    """
    from filelock import lock_descriptor  # only studies that go on where they were killed need it

    lock = path.with_name(f"{path.name}.lock") if sys.platform == "win32" else path
    with lock.open("ab") as handle:
        if not lock_descriptor(handle.fileno(), blocking=False):
            raise refusal
        yield


def require_writable(name: str, folder: Path) -> None:
    """Make a folder, or raise ParameterError if nothing can be written there: better before a long run than after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    require(writable, name, str(folder), "a folder that exists or can be made, and that can be written to")


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
            temporary.write_bytes(gzip.compress(text.encode(), mtime=0))  # without the time the same content is the same file
        else:
            temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_json(path: Path) -> Any:
    """Return the content of a file of `write_json`; raises OSError or ValueError if it cannot be read."""
    content = path.read_bytes()
    try:
        return json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except (EOFError, zlib.error) as error:
        raise ValueError(f"{path.name} is not whole: {error}") from error
