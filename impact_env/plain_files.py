"""Plain data from TOML or JSON files, and codecs of classes.

A codec converts numbers, strings, lists and dicts to the values of classes, and back.

`impact_env.plain` has the codecs of a scene. The lines of text files in any usual encoding are read
here, too.
"""

import codecs
import inspect
import json
import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from impact_env.checks import ParameterError, finite, require
from impact_env.fields import list_file_keys

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
    """Return the reason why a file cannot be opened, None if it can."""
    if not path.exists():
        return "there is no such file"
    if path.is_dir():
        return "it is a folder"
    return None if os.access(path, os.R_OK) else "it may not be read"


def require_readable(name: str, path: Path, wanted: str = "a file that can be read") -> None:
    """Raise ParameterError if a file does not exist, is a folder or may not be read.

    The error begins with ``name``.
    """
    try:
        why = find_unreadable(path)
    except (OSError, ValueError) as error:  # ValueError: a name with a byte of zero
        why = str(error)
    require(why is None, name, str(path), f"{wanted}: {why}")


def decode_text(file: Path) -> list[str]:
    """Return the lines of a text file.

    The encoding is UTF-8, or UTF-16 or UTF-32 with a byte order mark, or else Latin-1.
    """
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
                f"file = {file.name!r} is not allowed: text in {encoding.upper()}, as its "
                f"byte order mark says ({error.reason})"
            ) from error
        text = content.decode("cp1252", errors="replace")
    if "\0" in text:
        raise ParameterError(
            f"file = {file.name!r} is not allowed: text, in UTF-8 or with a byte order mark; "
            "it has bytes of zero"
        )
    return re.split(r"\r\n|\n|\r", text)


def read_plain(path: Path | str) -> dict[str, Any]:
    """Return the table that a file contains.

    Raises ParameterError with the file's name if it cannot be read, or if it is not TOML or JSON.
    """
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
            f"file = {str(path)!r} is not allowed: {path.suffix.lower()[1:].upper()} that can "
            f"be read ({error})"
        ) from error
    require(isinstance(plain, dict), "file", str(path), "a table of keys and values")
    return plain


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path`` with the same ending.

    The temporary file replaces ``path`` at the end, or is removed after an error. The message of an
    OSError in this context, such as a full disk, has the name ``path``.
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


@dataclass(frozen=True)
class Codec:
    """Conversion between plain data and a value of a class.

    ``read(path, plain)`` returns the value, or raises ParameterError with the path of the key.
    ``write`` is its inverse.
    """

    read: Callable[[str, Any], Any]
    write: Callable[[Any], Any]


Keys = Mapping[
    str, tuple[str, Codec]
]  # key of a table -> argument and attribute of the class, and the codec of its value


def _numbers(path: str, plain: Any) -> list[float]:
    require(
        isinstance(plain, list | tuple) and len(plain) > 0, path, plain, "a list of finite numbers"
    )
    return [finite(f"{path}[{i}]", x) for i, x in enumerate(plain)]


def _lists(path: str, plain: Any) -> list[list[float]]:
    require(
        isinstance(plain, list | tuple) and len(plain) > 0,
        path,
        plain,
        "a list of lists of finite numbers",
    )
    rows = [_numbers(f"{path}[{i}]", row) for i, row in enumerate(plain)]
    require(len({len(row) for row in rows}) == 1, path, plain, "lists of one length")
    return rows


def _row(values: Any) -> list[float]:
    return [float(x) for x in values]


# a value that its class checks, and converts to a number, a word or a flag of Python
VALUE_CODEC = Codec(lambda _path, plain: plain, lambda value: value)
NUMBER_CODEC = Codec(
    lambda _path, plain: plain, float
)  # the classes check single numbers themselves
WHOLE_CODEC = Codec(NUMBER_CODEC.read, int)
ROW_CODEC = Codec(_numbers, _row)
ROWS_CODEC = Codec(_lists, lambda values: [_row(row) for row in values])


def dataclass_keys(kind: type, /, without: Collection[str] = (), **codecs: Codec) -> Keys:
    """Return the keys that the fields of a dataclass declare.

    Parameters
    ----------
    kind : type
        The dataclass (`impact_env.fields`).
    without : collection of str, optional
        Fields that are no keys.
    **codecs : Codec
        Codecs of fields by name. Default: `VALUE_CODEC`.
    """
    keys = list_file_keys(kind)
    strange = sorted({*codecs, *without} - set(keys.values()))
    if strange:
        raise TypeError(f"{kind.__name__} has no fields {', '.join(strange)}")
    return {
        key: (name, codecs.get(name, VALUE_CODEC))
        for key, name in keys.items()
        if name not in without
    }


def require_keys(
    path: str, plain: Any, keys: Mapping[str, Any], needed: tuple[str, ...] = ()
) -> None:
    """Raise ParameterError unless ``plain`` is a dict with the right keys.

    It must have the ``needed`` keys, and no others than ``keys``.
    """
    require(isinstance(plain, Mapping), path, plain, f"a table with keys among {', '.join(keys)}")
    for key in plain:
        require(
            key in keys,
            f"{path}.{key}",
            plain[key],
            f"only the keys {', '.join(keys)} are known here",
        )
    for key in needed:
        require(key in plain, path, dict(plain), f"the key {key} must be given: it has no default")


def dataclass_codec(
    make: Callable[..., Any], keys: Keys, more_needed: tuple[str, ...] = ()
) -> Codec:
    """Return the codec of a dict of arguments of ``make``, a class or a function.

    ``keys`` are the keys of the dict. A missing key has the default of ``make``; keys without
    default, and those of ``more_needed``, must be present. Attributes that are None are not
    written.
    """
    arguments = inspect.signature(make).parameters
    needed = tuple(
        key
        for key, (name, _) in keys.items()
        if key in more_needed
        or (name in arguments and arguments[name].default is inspect.Parameter.empty)
    )

    def read(path: str, plain: Any) -> Any:
        require_keys(path, plain, keys, needed)
        arguments = {
            name: codec.read(f"{path}.{key}", plain[key])
            for key, (name, codec) in keys.items()
            if key in plain
        }
        try:
            return make(**arguments)
        except ParameterError as error:
            raise error.at_key(path, {name: key for key, (name, _) in keys.items()}) from error

    def write(value: Any) -> dict[str, Any]:
        result = {key: (getattr(value, name), codec) for key, (name, codec) in keys.items()}
        return {key: codec.write(part) for key, (part, codec) in result.items() if part is not None}

    return Codec(read, write)


def list_codec(make: Callable[..., Any], keys: Keys) -> Codec:
    """Return the codec of a list of dicts, each with the codec of `dataclass_codec`.

    The list is read as a tuple.
    """
    one = dataclass_codec(make, keys)

    def read(path: str, plain: Any) -> tuple[Any, ...]:
        require(
            isinstance(plain, list | tuple),
            path,
            plain,
            f"a list of tables with the keys {', '.join(keys)}",
        )
        return tuple(one.read(f"{path}[{i}]", part) for i, part in enumerate(plain))

    return Codec(read, lambda values: [one.write(value) for value in values])
