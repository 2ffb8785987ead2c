"""Output files, written whole or not at all, and finished pieces of long work, from which a stopped or killed run goes on."""

import csv
import gzip
import json
import math
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from impact_env.kernels.compiling.cache import digest
from impact_env.parameters import ParameterError, require
from impact_env.periodic.keeping import P
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


def write_files(contents: Mapping[Any, object]) -> list[Path]:
    """Write files by their paths, each whole or not at all, and return them; a path of None: not wanted.

    A tuple, of column names and rows, is a table (`write_csv`); a function draws what is in the file; all else is JSON.
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


Json = dict[str, Any]
FORM = "pieces 1"


class Pieces:
    """Pieces that are kept in ``path`` (None: nowhere) for the work that ``basis`` describes; other work may have its pieces in the same file.

    A piece is known again by basis, name and the kernels' sources. Each is written as soon as it is finished, and the file is always whole. Raises
    ParameterError for a file that is something else.
    """

    def __init__(self, path: Path | None, basis: Json, option: str = "--resume") -> None:
        self._path = path
        self._basis = basis | {"kernels": digest()}
        self._known: dict[str, list[Json]] = {}
        self._refusal = f"{option} = {path} is not allowed: a file that this option has written before, or none yet"
        if path is not None and path.exists():
            self._known = self._read(path)

    def _read(self, path: Path) -> dict[str, list[Json]]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["form"] != FORM:
                raise ValueError(f"form {content['form']}")
            return {str(piece["name"]): list(piece["values"]) for piece in content["pieces"]}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ParameterError(f"{self._refusal} ({error})") from error

    def __call__(self, name: Json, make: Callable[[], Iterator[P]], read: Callable[[Json], P], /) -> Iterator[P]:
        """Yield the pieces of ``make``, from the file by ``read`` if they were finished before for the same basis and ``name``."""
        key = json.dumps(self._basis | name, sort_keys=True)
        if key in self._known:
            try:
                pieces = [read(value) for value in self._known[key]]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(f"{self._refusal} ({error})") from error
            yield from pieces
            return
        done: list[Json] = []
        for piece in make():
            done.append(piece.to_plain())
            yield piece
        if self._path is not None:
            self._known[key] = done
            write_json(self._path, {"form": FORM, "pieces": [{"name": k, "values": values} for k, values in self._known.items()]})
