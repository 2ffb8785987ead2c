"""Records: named numbers at the border to the kernels."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from impact_env import Beam, beam_scene, impact_absorber
from impact_env.controlled import ControlledRuns
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, one, record
from impact_env.kernels.control.interval import ORDER, REPORT
from impact_env.kernels.motion.observers import COUNTS, new_counters, new_events

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


def test_without_compilation_it_is_the_same() -> None:
    rows = np.zeros(3, KIND)
    _fill.py_func(rows)
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


@pytest.mark.parametrize("name", ["omega", "DURATION", 0])
def test_an_order_that_there_is_not_is_refused(name: str | int) -> None:
    runs = ControlledRuns(beam_scene(Beam(modes=2), impact_absorber()), 2, 250.0, 1.0, samples_per_period=16)
    with pytest.raises((ValueError, TypeError)):
        runs.orders[name] = "fast"
    with pytest.raises(AttributeError):
        runs.orders = np.zeros(2, ORDER)
    with pytest.raises(AttributeError):
        runs.reports = np.zeros(2, REPORT)


def test_records_are_laid_out_as_a_processor_reads_them() -> None:
    for kind in (KIND, COUNTS, ORDER, REPORT):
        assert all(offset % field.itemsize == 0 for field, offset in (where[:2] for where in kind.fields.values()))
        assert kind.itemsize % 8 == 0
