"""Finished work saved in files, from which a stopped or killed run continues.

The saved work consists of pieces of long work, and of the runs of a search.

The file is a SQLite database with one table. SQLite writes each piece whole or not at all, and lets
no second process in meanwhile. A process that is killed loses nothing; a machine that loses its
power may lose the last pieces.

All searches follow from their seed and from what the runs have told them. Begun again, they ask for
the same runs in the same order, and those that the file holds are not made again. A run is known by
all that goes into it, so that a search which takes another way finds nothing, and only runs more.
"""

from __future__ import annotations

import errno
import hashlib
import json
import sqlite3
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor
from impact_env.kernels.compiling.cache import hash_sources
from impact_env.periodic.keeping import ComputeOrLoad, PlainResult
from optimisation.machine import difference
from optimisation.measures import Chunk

Json = dict[str, Any]
FORM = 0x696D7031  # SQLite's application_id: the file is of this package and of this form
WRITABLE = "is not allowed: a file that can be written to, in a folder that exists"
REFUSALS = {
    "SQLITE_BUSY": "is in use by another process: wait for it, or choose another file",
    "SQLITE_CANTOPEN": WRITABLE,
    "SQLITE_READONLY": WRITABLE,
}


class Checkpoint:
    """JSON values by name, in memory and in a file.

    ``known``: the values. ``path``: the file, or None for memory alone. The file belongs to this
    process until `close`.

    Raises ParameterError, which begins with the name of the ``option``, for a file that is
    something else, of an earlier form, damaged, in use, or not writable.
    """

    def __init__(self, path: Path | None = None, option: str = "--resume") -> None:
        self.path = path
        self.known = dict[str, Any]()
        self.something_else = (
            f"{option} = {path} is not allowed: a file that this option has written before, or "
            "none yet"
        )
        if path is None:
            return
        try:
            self._file = sqlite3.connect(path, timeout=0, isolation_level=None)
            self._file.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._file.execute("BEGIN EXCLUSIVE")
            (tables,) = self._file.execute("SELECT count(*) FROM sqlite_master").fetchone()
            (form,) = self._file.execute("PRAGMA application_id").fetchone()
            if tables and form != FORM:
                raise ParameterError(
                    f"{self.something_else} (of another program, or of another version of this one)"
                )
            if not tables:
                self._file.execute(
                    "CREATE TABLE pieces (name TEXT PRIMARY KEY, value TEXT NOT NULL)"
                )
                self._file.execute(f"PRAGMA application_id = {FORM}")
            self._file.execute("COMMIT")
            self._file.execute(
                "PRAGMA journal_mode = WAL"
            )  # a piece then costs no wait for the disk
            self._file.execute("PRAGMA synchronous = NORMAL")
            self.known |= {
                name: json.loads(value)
                for name, value in self._file.execute("SELECT name, value FROM pieces")
            }
        except (sqlite3.Error, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            refusal = REFUSALS.get(getattr(error, "sqlite_errorname", ""))
            raise ParameterError(
                f"{option} = {path} {refusal}" if refusal else f"{self.something_else} ({error})"
            ) from error

    def keep(self, name: str, value: object) -> None:
        """Store a value that JSON can express, or NaN, permanently.

        Raises OSError if the file cannot be written. The file then has its old content.
        """
        self.known[name] = value
        if self.path is not None:
            try:
                self._file.execute(
                    "INSERT OR REPLACE INTO pieces VALUES (?, ?)", (name, json.dumps(value))
                )
            except sqlite3.Error as error:
                raise OSError(errno.EIO, str(error), str(self.path)) from error

    def close(self) -> None:
        """Let go of the file."""
        if self.path is not None:
            self._file.close()

    def section(self, basis: Json) -> ComputeOrLoad:
        """Return the `ComputeOrLoad` for the work that ``basis`` and the kernels' sources describe.

        Other work may have its pieces in the same file.
        """
        basis = basis | {"kernels": hash_sources()}

        def keep(
            name: Json,
            make: Callable[[], Iterator[PlainResult]],
            read: Callable[[Json], PlainResult],
            /,
        ) -> Iterator[PlainResult]:
            key = json.dumps(basis | name, sort_keys=True)
            if key not in self.known:
                done = []
                for piece in make():
                    done.append(piece.to_plain())
                    yield piece
                self.keep(key, done)
                return
            try:
                pieces = [read(value) for value in self.known[key]]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(f"{self.something_else} ({error})") from error
            yield from pieces

        return keep


FILE = "study file"
IDENTITY = "identity"


@dataclass(eq=False)
class RunCache:
    """An executor that makes only the runs that ``checkpoint`` lacks, and stores them.

    ``runs``: number of lanes that were made.
    """

    executor: Executor
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    runs: int = 0

    def each(
        self, function: Callable[[Any], Any], items: Sequence[Any], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, Any], None, None]:
        """Yield the results of all items, see `impact_env.ensemble.Executor`.

        Raises OSError if the file cannot be written. The file then has its old content.
        """
        same: dict[str, list[int]] = {}
        for k, chunk in enumerate(items):
            same.setdefault(key_of(chunk), []).append(k)
        new = [key for key in same if key not in self.checkpoint.known]
        first = [same[key][0] for key in new]
        for i, values in (
            self.executor.each(function, [items[k] for k in first], [kinds[k] for k in first])
            if new
            else ()
        ):
            self.runs += len(values)
            self.checkpoint.keep(new[i], values.tolist())
            yield from ((k, values) for k in same.pop(new[i]))
        for key, numbers in same.items():  # those that were known
            yield from (
                (k, np.array(self.checkpoint.known[key], dtype=np.float64)) for k in numbers
            )


def key_of(chunk: Chunk) -> str:
    """Return a key of the runs and their measures, the same in any process."""
    known = hashlib.sha256()
    _fold(chunk, known)
    return known.hexdigest()[:24]


def _fold(value: object, known: hashlib._Hash) -> None:
    if is_dataclass(value):
        known.update(type(value).__name__.encode() + b"(")
        for part in fields(value):
            _fold(getattr(value, part.name), known)
    elif isinstance(value, np.ndarray):
        known.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        _fold(sorted(value.items()), known)
    elif isinstance(value, tuple | list):
        known.update(f"[{len(value)}".encode())
        for part in value:
            _fold(part, known)
    else:
        known.update(repr(value).encode() + b";")


def check_study_file(file: Path) -> None:
    """Raise ParameterError if a file cannot take a study."""
    Checkpoint(file, FILE).close()


@contextmanager
def open_run_cache(
    executor: Executor, identity: dict[str, object], file: Path | None
) -> Iterator[RunCache]:
    """Give an executor that goes on with the runs that a file holds; None keeps them in memory.

    The file belongs to this process until the end. Raises ParameterError if it cannot be used
    (`Kept`), or is of another identity.
    """
    with closing(Checkpoint(file, FILE)) as checkpoint:
        wanted = json.loads(json.dumps(identity))
        held = checkpoint.known.get(IDENTITY)
        if held is None:
            checkpoint.keep(IDENTITY, wanted)
        elif held != wanted:
            raise ParameterError(
                f"{FILE} = {file} is not allowed: it is another study: "
                f"{difference(held, wanted)}; choose another file"
            )
        yield RunCache(executor, checkpoint)
