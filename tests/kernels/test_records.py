"""Records: named numbers at the border to the kernels."""

import numba
import numpy as np
import pytest

from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, one, record
from impact_env.kernels.motion.observers import new_counters, new_events

KIND = record(flag=FLAG, number=NUMBER, count=INTEGER)


@numba.njit
def _fill(rows):
    for k in range(rows.shape[0]):
        row = rows[k]
        row.flag, row.number, row.count = k == 1, 0.5 * k, k
    rows[0] = rows[2]


def test_a_kernel_reads_and_writes_fields_in_place() -> None:
    rows = np.zeros(3, KIND)
    _fill(rows)
    assert rows.tolist() == [(False, 1.0, 2), (True, 0.5, 1), (False, 1.0, 2)]


def test_one_is_zero_but_for_what_is_given() -> None:
    assert one(KIND, number=2.0).tolist() == (False, 2.0, 0)
    with pytest.raises(ValueError, match="speed"):
        one(KIND, speed=1.0)


def test_a_record_is_part_of_its_observer() -> None:
    counters = new_counters(events=10)
    counters.counts["stop"] = True
    assert counters.counts["most_events"] == 10
    assert counters.counts["stop"]
    events = new_events(3)
    assert (len(events.impacts), len(events.phases), events.counts.tolist()) == (3, 3, (0, 0))
