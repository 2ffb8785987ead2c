"""The runs of a search kept in a file, so that a repeatable search goes on after a stop by asking for them again.

Searches by SciPy and by a model of the noise follow from their seed and from what the runs have told them. Begun anew, they ask for
the same runs in the same order, and those that the file holds are not made again. A run is known by all that goes into it, so that a search
which takes another way finds nothing, and only runs more.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.parameters import ParameterError
from optimisation.files import append, held
from optimisation.machine import difference
from optimisation.measures import Chunk

DAMAGED = ".damaged"


class StudyError(ParameterError):
    """A study file cannot be used; the message says why and what to do."""


def line_of(entry: dict[str, Any]) -> bytes:
    """Return an entry as a line of a journal."""
    return json.dumps(entry, separators=(",", ":")).encode() + b"\n"


@contextmanager
def alone(journal: Path) -> Iterator[None]:
    """Hold a journal for this process; raises StudyError if another holds it, or if nothing can be written there."""
    folder = journal.resolve().parent
    usable = (journal.is_file() and os.access(journal, os.R_OK | os.W_OK)) if journal.exists() else True
    if not (usable and folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        raise StudyError(f"study file = {journal} is not allowed: a file that can be written to, in a folder that exists")
    with held(journal, StudyError(f"study file = {journal} is in use by another process: wait for it, or choose another file")):
        yield


def repair(journal: Path) -> int:
    """Take a torn last line out of a journal, and keep it beside the journal; return its length in bytes, 0 if there was none.

    The storage writes whole lines, so only the last one can be torn. Raises StudyError if an earlier line is no JSON object.
    """
    if not journal.exists():
        return 0
    content = journal.read_bytes()
    lines = content.splitlines(keepends=True)
    whole = len(lines) - (len(lines) > 0 and not _is_entry(lines[-1]))
    for number, line in enumerate(lines[:whole], 1):
        if not _is_entry(line):
            raise StudyError(f"study file = {journal} is not allowed: line {number} of {len(lines)} is damaged, and only the last can be left out")
    torn = b"".join(lines[whole:])
    if torn:
        with journal.with_name(journal.name + DAMAGED).open("ab") as kept:
            kept.write(torn if torn.endswith(b"\n") else torn + b"\n")
        with journal.open("r+b") as file:
            file.truncate(len(content) - len(torn))
    return len(torn)


def _is_entry(line: bytes) -> bool:
    try:
        return line.endswith(b"\n") and isinstance(json.loads(line), dict)
    except ValueError:
        return False


Array = NDArray[np.float64]
LEDGER_FORMAT = 1
_HEAD, _RUNS, _MEASURES = "ledger", "runs", "measures"


@dataclass(eq=False)
class Ledger:
    """An executor that makes only the runs that ``known`` lacks, and keeps them, also in the file ``path`` unless it is None.

    ``runs`` counts the lanes that were made.
    """

    executor: Executor
    path: Path | None = None
    known: dict[str, Array] = field(default_factory=dict)
    runs: int = 0

    def each(self, function: Callable[[Any], Any], items: Sequence[Any], kinds: Sequence[Hashable]) -> Generator[tuple[int, Any], None, None]:
        """See `impact_env.ensemble.Executor`; raises OSError if the file cannot take more, which it then holds as it was."""
        same: dict[str, list[int]] = {}
        for k, chunk in enumerate(items):
            same.setdefault(key_of(chunk), []).append(k)
        new = [key for key in same if key not in self.known]
        first = [same[key][0] for key in new]
        for i, values in self.executor.each(function, [items[k] for k in first], [kinds[k] for k in first]) if new else ():
            self.runs += len(values)
            self.known[new[i]] = values
            if self.path is not None:
                append(self.path, line_of({_RUNS: new[i], _MEASURES: listed(values)}))
            yield from ((k, values) for k in same.pop(new[i]))
        for key, numbers in same.items():  # those that were known
            yield from ((k, self.known[key]) for k in numbers)


def listed(measured: Array) -> object:
    """Return an array as nested lists, with None for NaN, which JSON lacks."""
    values = measured.astype(object)
    values[np.isnan(measured)] = None
    return values.tolist()


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


@contextmanager
def remembering(executor: Executor, identity: dict[str, object], journal: Path | None) -> Iterator[Ledger]:
    """Give an executor that goes on with the runs that a file holds; None keeps them in memory.

    The file belongs to this process until the end; a last line that a killed process left half-written is taken out of it. Raises
    StudyError if the file cannot be used, is damaged, or is of another identity.
    """
    if journal is None:
        yield Ledger(executor)
        return
    head = json.loads(json.dumps({_HEAD: {"format": LEDGER_FORMAT, **identity}}))
    with alone(journal):
        repair(journal)
        lines = [json.loads(line) for line in journal.read_bytes().splitlines()]
        if not lines:
            append(journal, line_of(head))
        elif _HEAD not in lines[0]:
            raise StudyError(f"study file = {journal} is not allowed: it is the journal of another method; choose another file")
        elif lines[0] != head:
            other = difference(lines[0][_HEAD], head[_HEAD])
            raise StudyError(f"study file = {journal} is not allowed: it is another study: {other}; choose another file")
        try:
            known = {str(line[_RUNS]): np.array(line[_MEASURES], dtype=float) for line in lines[1:]}
        except (KeyError, TypeError, ValueError) as error:
            raise StudyError(f"study file = {journal} is not allowed: a line is not one of this workbench ({error!r})") from error
        yield Ledger(executor, journal, known)
