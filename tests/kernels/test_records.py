"""Records: named numbers at the border to the kernels."""

from fractions import Fraction

import numba
import numpy as np
import pytest

from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record
from impact_env.kernels.motion.numbers import cos_sin, fma
from impact_env.level import response_level

KIND = record(flag=FLAG, number=NUMBER, count=INTEGER)


@numba.njit
def _fill(rows):
    for k in range(rows.shape[0]):
        row = rows[k]
        row.flag = k == 1
        row.number = 0.5 * k
        row.count = k
    rows[0] = rows[2]


def test_a_kernel_reads_and_writes_fields_in_place() -> None:
    rows = np.zeros(3, KIND)
    _fill(rows)
    assert rows.tolist() == [(False, 1.0, 2), (True, 0.5, 1), (False, 1.0, 2)]


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


def test_cosine_and_sine_are_exact_to_rounding() -> None:
    """In every quadrant, at the edges of the polynomials and as far as a million."""
    rng = np.random.default_rng(0)
    x = np.concatenate(
        [
            rng.uniform(-10, 10, 500),
            rng.uniform(-1e6, 1e6, 500),
            np.arange(-40, 41) * np.pi / 4,
            [0.0, 1e6, -1e6],
        ]
    )
    found = np.empty((len(x), 2))
    _each(x, found)
    with mpmath.workdps(40):
        truth = [(mpmath.cos(mpmath.mpf(float(v))), mpmath.sin(mpmath.mpf(float(v)))) for v in x]
        error = max(
            abs(mpmath.mpf(float(f)) - t)
            for row, both in zip(found, truth, strict=True)
            for f, t in zip(row, both, strict=True)
        )
    assert error < ROUNDING


def test_a_product_and_a_sum_are_rounded_once() -> None:
    """Against exact fractions, where nearly all of the product cancels."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-2, 2, (2, 500))
    z = -x * y
    found = np.empty(500)
    _fused(x, y, z, found)
    assert [
        float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in zip(x, y, z, strict=True)
    ] == list(found)
    assert np.count_nonzero(found) > 400


@pytest.mark.parametrize("at", [0, 17, 320, 1000, 1990])
def test_the_level_of_a_sine_is_its_amplitude_over_the_root_of_two(at: int) -> None:
    """Wherever the largest sample lies, the window around it holds whole or half periods, also where the run's start or end cuts it."""
    samples = 32
    phases = 2 * np.pi * (np.arange(2000) - at) / samples
    sine = 3e-4 * np.cos(phases)
    sine[at] *= 1 + 1e-12  # the largest
    level, largest = response_level(sine, samples)
    periods = (min(at, 10 * samples) + min(1999 - at, 10 * samples)) / samples
    assert level == pytest.approx(3e-4 / np.sqrt(2), rel=1e-11 if periods % 0.5 == 0 else 0.02)
    assert largest == pytest.approx(3e-4, rel=1e-9)
