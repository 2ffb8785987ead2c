"""Results as files and tables.

`SavedResult` writes a result with its scene, load and method to JSON or a NumPy archive, and reads
it back bit for bit. `TableResult` returns a table as columns or as a data frame of pandas.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.extras import optional
from impact_env.plain_files import replacing, require_readable

if TYPE_CHECKING:
    import pandas

FORMATS = (".json", ".npz")
SKELETON = "result"  # of a NumPy archive: all but the arrays, as JSON
Arrays = dict[str, NDArray[Any]]


def encode(value: Any, arrays: Arrays | None = None) -> Any:
    """Return a value made of dataclasses, arrays and plain data as plain data.

    Arrays are put into ``arrays`` and referred to by name, if ``arrays`` is given.
    """
    if isinstance(value, np.ndarray):
        if arrays is None:
            return {"array": value.tolist(), "type": value.dtype.name}
        arrays[f"array{len(arrays)}"] = value
        return {"array": f"array{len(arrays) - 1}"}
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and type(value).__name__ in SavedResult.classes:
        parts = {field.name: encode(getattr(value, field.name), arrays) for field in fields(value)}
        return {"class": type(value).__name__, "fields": parts}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [encode(part, arrays) for part in value]}
    if isinstance(value, Mapping):
        return {"table": [[encode(k, arrays), encode(v, arrays)] for k, v in value.items()]}
    plain = value is None or isinstance(value, str | bool | int | float)
    require(plain, "result", value, "made of what impact_env defines, to be saved")
    return value


def decode(plain: Any, arrays: Mapping[str, NDArray[Any]] | None = None) -> Any:
    """Return the value from the plain data of `encode`.

    Raise ParameterError for an unknown class.
    """
    if not isinstance(plain, dict):
        return plain
    if "array" in plain:
        if arrays is not None:
            return arrays[plain["array"]]
        return np.array(plain["array"], dtype=plain["type"])
    if "class" in plain:
        known = SavedResult.classes.get(plain["class"])
        if known is None:
            allowed = f"a class of {', '.join(SavedResult.classes)}"
            raise ParameterError(f"class = {plain['class']!r} is not allowed: {allowed}")
        return known(**{name: decode(part, arrays) for name, part in plain["fields"].items()})
    if "table" in plain:
        return {decode(key, arrays): decode(part, arrays) for key, part in plain["table"]}
    (kind, parts), *_ = plain.items()
    values = (decode(part, arrays) for part in parts)
    return tuple(values) if kind == "tuple" else list(values)


def to_plain_data(value: Any) -> Any:
    """Return a value as dictionaries, lists and numbers.

    The value consists of dataclasses, arrays and plain data.
    """
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value):
        return {field.name: to_plain_data(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_plain_data(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [to_plain_data(part) for part in value]
    return value


class TableResult(ABC):
    """A result that is a table, or contains one."""

    @abstractmethod
    def to_columns(self) -> Arrays:
        """Return the columns of the table, each (R,), by names that end in the unit."""

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the table as a data frame, with the columns of `to_columns`.

        Raises
        ------
        MissingExtraError
            pandas is not installed; the message says what installs it.
        ParameterError
            The run has not recorded what the table holds.
        """
        with optional():
            import pandas
        return pandas.DataFrame(self.to_columns())


class SavedResult:
    """A result that can be written to a file and read back."""

    classes: ClassVar[dict[str, type]] = {}

    def __init_subclass__(cls) -> None:
        SavedResult.classes[cls.__name__] = cls

    def to_dict(self) -> dict[str, Any]:
        """Return the result as dictionaries, lists and numbers, by the names of the attributes."""
        plain: dict[str, Any] = to_plain_data(self)
        return plain

    def to_json(self) -> str:
        """Return the result as JSON, with its scene, load and method.

        Numbers have all their digits; NaN and Infinity are written as such.
        """
        return json.dumps(encode(self))

    def save(self, path: Path | str) -> None:
        """Write the result to a file; after an error there is no incomplete file.

        Parameters
        ----------
        path : path
            Name that ends in ``.json``, or in ``.npz``: a NumPy archive, smaller and faster for
            recorded series.

        Raises
        ------
        ParameterError
            The name has another ending.
        OSError
            The file cannot be written.
        """
        path = Path(path)
        require(path.suffix in FORMATS, "path", str(path), f"a name in {' or '.join(FORMATS)}")
        with replacing(path) as temporary:
            if path.suffix == ".json":
                temporary.write_text(self.to_json(), encoding="utf-8")
                return
            arrays: Arrays = {}
            arrays[SKELETON] = np.array(json.dumps(encode(self, arrays)))
            np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]  # names of arrays alone

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Return the result that a file holds, equal to the last bit.

        Parameters
        ----------
        path : path
            File that `save` has written.

        Raises
        ------
        ParameterError
            There is no such file, or it contains something else.
        """
        path = Path(path)
        require(path.suffix in FORMATS, "path", str(path), f"a name in {' or '.join(FORMATS)}")
        require_readable("path", path)
        allowed = f"a file of a {cls.__name__} that `save` has written"
        try:
            if path.suffix == ".json":
                result = decode(json.loads(path.read_text(encoding="utf-8")))
            else:
                with np.load(path, allow_pickle=False) as archive:
                    result = decode(json.loads(str(archive[SKELETON])), archive)
        except ParameterError:
            raise
        except Exception as error:  # whatever is wrong with a file
            raise ParameterError(
                f"path = {str(path)!r} is not allowed: {allowed} ({error})"
            ) from error
        if not isinstance(result, cls):
            raise ParameterError(f"path = {str(path)!r} is not allowed: {allowed}")
        return result
