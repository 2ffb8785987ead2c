"""Finished pieces of long work, kept in a file from which a stopped or killed run goes on.

The file is a SQLite database with one table. SQLite writes each piece whole or not at all, and lets no second process in meanwhile. A process that
is killed loses nothing; a machine that loses its power may lose the last pieces.
"""

from __future__ import annotations

import errno
import json
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from impact_env.kernels.compiling.cache import hash_sources
from impact_env.parameters import ParameterError
from impact_env.periodic.keeping import ComputeOrLoad, PlainResult

Json = dict[str, Any]
FORM = 0x696D7031  # SQLite's application_id: the file is of this package and of this form
WRITABLE = "is not allowed: a file that can be written to, in a folder that exists"
REFUSALS = {
    "SQLITE_BUSY": "is in use by another process: wait for it, or choose another file",
    "SQLITE_CANTOPEN": WRITABLE,
    "SQLITE_READONLY": WRITABLE,
}


class Checkpoint:
    """JSON values by name, ``known``, also in the file ``path`` unless it is None; the file belongs to this process until `close`.

    Raises ParameterError, which begins with the name of the ``option``, for a file that is something else, of an earlier form, damaged, in use, or
    not writable.
    """

    def __init__(self, path: Path | None = None, option: str = "--resume") -> None:
        self.path = path
        self.known = dict[str, Any]()
        self.something_else = f"{option} = {path} is not allowed: a file that this option has written before, or none yet"
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
        """Keep a value that JSON has, or NaN, for good; raises OSError if the file cannot take it: then it holds what it held."""
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
