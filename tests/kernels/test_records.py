"""Records: named numbers at the border to the kernels."""

import math
from fractions import Fraction

import numba
import numpy as np
import pytest

from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record_type
from impact_env.kernels.motion import modal_system
from impact_env.kernels.motion.modal_system import cos_sin, fma, split_time
from impact_env.kernels.motion.observers import compute_level, new_level
from impact_env.level import response_level
from impact_env.regimes import slot_rows as slot_rows_of

KIND = record_type(flag=FLAG, number=NUMBER, count=INTEGER)


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


@pytest.mark.slow
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
    computed = np.empty((len(x), 2))
    _each(x, computed)
    with mpmath.workdps(40):
        truth = [(mpmath.cos(mpmath.mpf(float(v))), mpmath.sin(mpmath.mpf(float(v)))) for v in x]
        error = max(
            abs(mpmath.mpf(float(f)) - t)
            for row, both in zip(computed, truth, strict=True)
            for f, t in zip(row, both, strict=True)
        )
    assert error < ROUNDING


@numba.njit
def _digits_of(scale, x, out):
    for i in range(len(x)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = split_time(scale, x[i])


def test_a_time_that_is_no_number_or_beyond_the_tables_stays_within_them() -> None:
    """A time that is NaN or outside the tables does not exceed their bounds.

    NaN stays NaN in the remainder and in cosine and sine. Digits are positions in tables of 2^2
    entries.
    """
    scale = np.array([2.0, 0.25, 4.0, 1.0])
    x = np.array([np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0, 0.3, 15.75, 17.0])
    computed = np.empty((len(x), 4))
    _digits_of(scale, x, computed)
    assert np.all((computed[:, :3] >= 0) & (computed[:, :3] < 4))
    assert np.isnan(computed[0, 3])
    within = computed[5:8]
    np.testing.assert_array_equal(within[:, :3] @ [4.0, 1.0, 0.25] + within[:, 3], x[5:8])
    turns = np.empty((2, 2))
    _each(x[:2], turns)
    assert np.all(np.isnan(turns))


def test_rows_of_slots_do_not_overlap_and_are_those_that_regimes_fill() -> None:
    """Of two eigenvalues with numbers of their own in each row."""
    s = np.array([-0.5 + 2.0j, -0.1 + 1.0j])
    options = {
        name: np.array([k + 0.25j, k + 0.5 + 0.75j])
        for k, name in enumerate(("DRIVE", "RELATIVE", "GUARD", "TIP"), 1)
    }
    rows = slot_rows_of(
        s, options["DRIVE"], options["RELATIVE"], options["GUARD"], options["TIP"], 4
    )
    assert rows.shape == (modal_system.ROWS, 4)
    s = s[::-1]  # by size
    wanted = {name: values[::-1] for name, values in options.items()}
    wanted |= {"S": s, "SQUARE": s**2, "REST": -wanted["RELATIVE"] / s}
    wanted |= {"SPEED": abs(s), "SPEED_SQUARE": abs(s) ** 2, "SPEED_CUBE": abs(s) ** 3}
    for name, values in wanted.items():
        row = getattr(modal_system, name)
        parts = [values] if name.startswith("SPEED") else [values.real, values.imag]
        np.testing.assert_allclose(rows[row : row + len(parts), :2], parts, rtol=1e-15)
    for n in range(1, modal_system.TAYLOR_ROWS + 1):
        row = modal_system.TAYLOR + 2 * (n - 1)
        term = s**n / math.factorial(n)
        np.testing.assert_allclose(rows[row : row + 2, :2], [term.real, term.imag], rtol=1e-15)


def test_a_level_of_no_samples_is_zero() -> None:
    assert compute_level(new_level(8)) == (0.0, 0.0, 0.0)


def test_a_product_and_a_sum_are_rounded_once() -> None:
    """Against exact fractions, where nearly all of the product cancels."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-2, 2, (2, 500))
    z = -x * y
    computed = np.empty(500)
    _fused(x, y, z, computed)
    assert [
        float(Fraction(a) * Fraction(b) + Fraction(c)) for a, b, c in zip(x, y, z, strict=True)
    ] == list(computed)
    assert np.count_nonzero(computed) > 400


@pytest.mark.parametrize("at", [0, 17, 320, 1000, 1990])
def test_the_level_of_a_sine_is_its_amplitude_over_the_root_of_two(at: int) -> None:
    """The level of a sine is its amplitude over the root of two.

    For any place of the largest sample, the window around it has whole or half periods, also if the
    run's start or end cuts it.
    """
    samples = 32
    phases = 2 * np.pi * (np.arange(2000) - at) / samples
    sine = 3e-4 * np.cos(phases)
    sine[at] *= 1 + 1e-12  # the largest
    level, largest = response_level(sine, samples)
    periods = (min(at, 10 * samples) + min(1999 - at, 10 * samples)) / samples
    assert level == pytest.approx(3e-4 / np.sqrt(2), rel=1e-11 if periods % 0.5 == 0 else 0.02)
    assert largest == pytest.approx(3e-4, rel=1e-9)


@pytest.mark.parametrize("shift", [-0.4, 0.0, 0.3, 0.5])
def test_the_largest_displacement_between_samples_is_the_top_of_their_parabola(
    shift: float,
) -> None:
    _, largest = response_level(2.0 - 1e-3 * (np.arange(40) - 20 - shift) ** 2, 8)
    assert largest == pytest.approx(2.0, rel=1e-14)
