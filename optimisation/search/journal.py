"""A study's journal file: one process at a time, and in order again after a writer that was killed in the middle of a line."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError
from optimisation.files import held

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
