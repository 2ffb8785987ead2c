"""Plain data from files: TOML or JSON, by the name's ending."""

import json
import os
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError, require


def _refuse_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dict; a key that is given twice raises ValueError, as in TOML."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {key} twice")
        found[key] = value
    return found


PLAIN_READERS: dict[str, Callable[[str], Any]] = {
    ".toml": tomllib.loads,
    ".json": partial(json.loads, object_pairs_hook=_refuse_repeated_keys),
}


def read_plain(path: Path | str) -> dict[str, Any]:
    """Return the table that a file holds. Raises ParameterError that names the file if it cannot be read, or is not TOML or JSON."""
    path = Path(path)
    reader = PLAIN_READERS.get(path.suffix.lower())
    if reader is None:
        raise ParameterError(
            f"file = {str(path)!r} is not allowed: a name that ends in {' or '.join(PLAIN_READERS)}"
        )
    try:
        plain = reader(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ParameterError(
            f"file = {str(path)!r} is not allowed: {path.suffix.lower()[1:].upper()} that can be read ({error})"
        ) from error
    require(isinstance(plain, dict), "file", str(path), "a table of keys and values")
    return plain


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside ``path`` with the same ending; it takes ``path``'s place at the end, or is removed on any error.

    An OSError meanwhile, such as that of a full disk, names ``path``.
    """
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.filename not in (None, temporary, str(temporary)):
            raise  # about another file
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        with suppress(OSError):
            temporary.unlink()
