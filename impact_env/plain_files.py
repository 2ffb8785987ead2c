"""Plain data from files: TOML or JSON, by the name's ending; and the lines of text files in any usual encoding."""

import codecs
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError, require

BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # UTF-32 before UTF-16, whose mark begins alike


def _refuse_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dict; a key that is given twice raises ValueError, as in TOML."""
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ValueError(f"the key {key} twice")
        result[key] = value
    return result


PLAIN_READERS: dict[str, Callable[[str], Any]] = {
    ".toml": tomllib.loads,
    ".json": partial(json.loads, object_pairs_hook=_refuse_repeated_keys),
}


def find_unreadable(path: Path) -> str | None:
    """Return why a file cannot be opened, in words; None if it can."""
    if not path.exists():
        return "there is no such file"
    if path.is_dir():
        return "it is a folder"
    return None if os.access(path, os.R_OK) else "it may not be read"


def require_readable(name: str, path: Path, wanted: str = "a file that can be read") -> None:
    """Raise ParameterError, which begins with ``name``, where a file does not exist, is a folder or may not be read."""
    try:
        why = find_unreadable(path)
    except (OSError, ValueError) as error:  # ValueError: a name with a byte of zero
        why = str(error)
    require(why is None, name, str(path), f"{wanted}: {why}")


def decode_text(file: Path) -> list[str]:
    """Return the lines of a text file in UTF-8, UTF-16 or UTF-32 with a byte order mark, or else Latin-1."""
    content = file.read_bytes()
    mark, encoding = next(
        ((mark, name) for mark, name in BYTE_ORDER_MARKS if content.startswith(mark)),
        (b"", "utf-8"),
    )
    content = content[len(mark) :]
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        if mark:
            raise ParameterError(
                f"file = {file.name!r} is not allowed: text in {encoding.upper()}, as its byte order mark says ({error.reason})"
            ) from error
        text = content.decode("cp1252", errors="replace")
    if "\0" in text:
        raise ParameterError(
            f"file = {file.name!r} is not allowed: text, in UTF-8 or with a byte order mark; it has bytes of zero"
        )
    return re.split(r"\r\n|\n|\r", text)


def read_plain(path: Path | str) -> dict[str, Any]:
    """Return the table that a file holds. Raises ParameterError that names the file if it cannot be read, or is not TOML or JSON."""
    path = Path(path)
    reader = PLAIN_READERS.get(path.suffix.lower())
    if reader is None:
        raise ParameterError(
            f"file = {str(path)!r} is not allowed: a name that ends in {' or '.join(PLAIN_READERS)}"
        )
    require_readable("file", path)
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
