"""Records: what a lane carries as named numbers.

They are elements of NumPy's structured arrays, whose fields numba reads at the speed of a plain
array. A kernel takes a record out of an array, ``now = room.now[0]``, and writes to it in place. It
is a bare pointer there: a function that makes an array hands on the array, not its record.
"""

from __future__ import annotations

from typing import Any

import numpy as np

INTEGER = np.int64
NUMBER = np.float64
FLAG = np.bool_


def record_type(**fields: Any) -> np.dtype[Any]:
    """Return a kind of record: each field's name and type."""
    return np.dtype((np.record, np.dtype(list(fields.items()), align=True)))


def new_record(kind: np.dtype[Any], **values: Any) -> Any:
    """Return a record of zeros, except for the ``values`` given by name.

    Raises ValueError for a name that is not in the record.
    """
    made = np.zeros(1, kind)[0]
    for name, value in values.items():
        made[name] = value
    return made
