"""Forms of plain data: how numbers, strings, lists and dicts become the values of classes, and back. `impact_env.plain` has those of a scene.

A sort is a pair of functions, ``read(path, plain)`` and ``write(value)``; ``path`` is the key path that an error names.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from impact_env.parameters import ParameterError, finite, require


@dataclass(frozen=True)
class Codec:
    """A sort of value: ``read`` raises ParameterError with the key path, or returns what a class takes; ``write`` is its inverse."""

    read: Callable[[str, Any], Any]
    write: Callable[[Any], Any]


Keys = Mapping[
    str, tuple[str, Codec]
]  # key of the plain form -> argument and attribute of the class, and its sort


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


NUMBER_CODEC = Codec(
    lambda _path, plain: plain, float
)  # the classes check single numbers themselves
WHOLE_CODEC = Codec(NUMBER_CODEC.read, int)
ROW_CODEC = Codec(_numbers, _row)
ROWS_CODEC = Codec(_lists, lambda values: [_row(row) for row in values])


def require_keys(
    path: str, plain: Any, keys: Mapping[str, Any], needed: tuple[str, ...] = ()
) -> None:
    """Raise ParameterError unless ``plain`` is a dict that has the ``needed`` keys, and none but ``keys``."""
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
    """Return the sort of a dict that stands for what ``make``, a class or a function, returns.

    A key that is left out has the default of ``make``; one whose argument has none must be given. Attributes that are None are not written.
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
            name: sort.read(f"{path}.{key}", plain[key])
            for key, (name, sort) in keys.items()
            if key in plain
        }
        try:
            return make(**arguments)
        except ParameterError as error:
            raise error.at_key(path, {name: key for key, (name, _) in keys.items()}) from error

    def write(value: Any) -> dict[str, Any]:
        result = {key: (getattr(value, name), sort) for key, (name, sort) in keys.items()}
        return {key: sort.write(part) for key, (part, sort) in result.items() if part is not None}

    return Codec(read, write)


def list_codec(make: Callable[..., Any], keys: Keys) -> Codec:
    """Return the sort of a list of such dicts, each of which is a `dataclass_codec`; it is read as a tuple."""
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


def optional_codec(sort: Codec) -> Codec:
    """Return a sort that may also be None, for what is absent."""
    return Codec(lambda path, plain: None if plain is None else sort.read(path, plain), sort.write)
