"""Records: named numbers at the border to the kernels."""

from fractions import Fraction

import numba
import numpy as np
import pytest

from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, one, record
from impact_env.kernels.motion.numbers import cos_sin, fma, lowest_bit
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


# Functions of single numbers against arithmetic with many digits.


mpmath = pytest.importorskip("mpmath")

ROUNDING = 2e-16  # what cosine and sine are allowed


@numba.njit
def _each(x, out):
    for i in range(len(x)):
        out[i] = cos_sin(x[i])


@numba.njit
def _fused(x, y, z, out):
    for i in range(len(x)):
        out[i] = fma(x[i], y[i], z[i])


@numba.njit
def _lowest(mask):
    return lowest_bit(mask)


def test_cosine_and_sine_are_exact_to_rounding() -> None:
    """In every quadrant, at the edges of the polynomials and as far as a million."""
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-10, 10, 2000), rng.uniform(-1e6, 1e6, 2000), np.arange(-40, 41) * np.pi / 4, [0.0, 1e6, -1e6]])
    found = np.empty((len(x), 2))
    _each(x, found)
    with mpmath.workdps(40):
        truth = [(mpmath.cos(mpmath.mpf(float(v))), mpmath.sin(mpmath.mpf(float(v)))) for v in x]
        error = max(abs(mpmath.mpf(float(f)) - t) for row, both in zip(found, truth, strict=True) for f, t in zip(row, both, strict=True))
    assert error < ROUNDING


def test_a_product_and_a_sum_are_rounded_once() -> None:
    """Against exact fractions, where nearly all of the product cancels."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-2, 2, (2, 500))
    z, found = -x * y, np.empty(500)
    _fused(x, y, z, found)
    assert [float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in zip(x, y, z, strict=True)] == list(found)
    assert np.count_nonzero(found) > 400


def test_lowest_bit() -> None:
    """Of masks as a scan makes them; none is set in zero."""
    assert [_lowest(mask) for mask in (0, 1, 2, 8, 12, 255, 1 << 20)] == [64, 0, 1, 3, 2, 0, 20]
