"""Records: the named numbers that a lane modifies in a run.

They are elements of NumPy's structured arrays, whose fields numba reads at the speed of a plain
array. A kernel takes a record out of an array, ``state = workspace.contact_states[0]``, and writes
to it in place. In a kernel a record is a bare pointer that does not keep its array alive: a
function that makes an array must return the array, not its record.
"""

from __future__ import annotations

from typing import Any

import numpy as np

INTEGER = np.int64
NUMBER = np.float64
FLAG = np.bool_


def record_type(**fields: Any) -> np.dtype[Any]:
    """Return the NumPy type of a record whose ``fields`` are given as name=type.

    Types are INTEGER, NUMBER and FLAG.
    """
    return np.dtype((np.record, np.dtype(list(fields.items()), align=True)))


def new_record(kind: np.dtype[Any], **values: Any) -> Any:
    """Return a record of a type from `record_type`, with the ``values`` given by name, else 0.

    Raises ValueError for a name that is not in the record.
    """
    made = np.zeros(1, kind)[0]
    for name, value in values.items():
        made[name] = value
    return made
