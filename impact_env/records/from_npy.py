"""Records from NumPy's ``.npy`` files.

They are values, columns of times and values, or a structured array with named columns.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.records.channels import Channel, RecordOptions, channel_of_columns

REAL_DTYPES = "iuf"  # kinds of numbers that a record may have
ALLOWED_SHAPES = (
    "(K,) values, (K, 2) times and values, (K, n) times and several channels, one row a sample"
)


def _load(file: Path) -> NDArray[Any]:
    """Return the single array of a file.

    Raises ParameterError if the array is incomplete or followed by further data.
    """
    try:
        with file.open("rb") as source, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = np.load(source, allow_pickle=False)
            more = len(source.read(1))
    except (ValueError, EOFError, TypeError, SyntaxError, MemoryError, OverflowError) as error:
        words = " ".join(str(error).split())
        raise ParameterError(
            f"file = {file.name!r} is not allowed: an array of numbers, whole ({words})"
        ) from error
    if not isinstance(result, np.ndarray):
        raise ParameterError(
            f"file = {file.name!r} is not allowed: one array, not an archive of several"
        )
    require(not more, "file", file.name, "one array; the file has more bytes after it")
    return result


def read_npy(file: Path, options: RecordOptions) -> Channel:
    """Return the values of a file, with times if it has them."""
    result = _load(file)
    names = result.dtype.names
    if names is not None:
        require(
            result.ndim == 1,
            f"{file.name}: shape",
            result.shape,
            "(K,) for an array with named columns",
        )
        kinds = [result.dtype[name] for name in names]
    else:
        require(result.ndim in (1, 2), f"{file.name}: shape", result.shape, ALLOWED_SHAPES)
        kinds = [result.dtype]
    allowed = "real numbers: whole numbers or floats"
    for kind in kinds:
        ok = kind.kind in REAL_DTYPES and not kind.subdtype
        require(ok, f"{file.name}: data type", str(kind), allowed)
    require(result.size > 0, f"{file.name}: shape", result.shape, "two samples or more")
    if names is not None:
        columns = [result[name].astype(np.float64) for name in names]
        return channel_of_columns(file, options, columns, names, 1)
    if result.ndim == 2:
        require(
            result.shape[0] >= result.shape[1], f"{file.name}: shape", result.shape, ALLOWED_SHAPES
        )
    columns = list(result.reshape(len(result), -1).astype(np.float64).T)
    return channel_of_columns(file, options, columns, [""] * len(columns), 1)
