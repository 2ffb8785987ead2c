"""The runs of a search kept in a file, so that it goes on after a stop by asking for them again.

All searches follow from their seed and from what the runs have told them. Begun anew, they ask for the same runs in the same order, and those
that the file holds are not made again. A run is known by all that goes into it, so that a search which takes another way finds nothing, and only
runs more.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.ensemble import Executor
from impact_env.parameters import ParameterError
from optimisation.checkpoint import Checkpoint
from optimisation.machine import difference
from optimisation.measures import Chunk

FILE = "study file"
IDENTITY = "identity"


@dataclass(eq=False)
class RunCache:
    """An executor that makes only the runs that are not ``checkpoint``, and keeps them; ``runs`` counts the lanes that were made."""

    executor: Executor
    checkpoint: Checkpoint = field(default_factory=Checkpoint)
    runs: int = 0

    def each(
        self, function: Callable[[Any], Any], items: Sequence[Any], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, Any], None, None]:
        """See `impact_env.ensemble.Executor`; raises OSError if the file cannot take more, which it then holds as it was."""
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

    The file belongs to this process until the end. Raises ParameterError if it cannot be used (`Kept`), or is of another identity.
    """
    with closing(Checkpoint(file, FILE)) as checkpoint:
        wanted = json.loads(json.dumps(identity))
        held = checkpoint.known.get(IDENTITY)
        if held is None:
            checkpoint.keep(IDENTITY, wanted)
        elif held != wanted:
            raise ParameterError(
                f"{FILE} = {file} is not allowed: it is another study: {difference(held, wanted)}; choose another file"
            )
        yield RunCache(executor, checkpoint)
