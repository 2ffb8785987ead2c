"""Trigonometric polynomials: values, all real roots, and their restriction to intervals.

A polynomial with harmonics 0 to H is a row (2H + 1,): the mean, then H cosines, then H sines of an
angle. Samples only bracket the roots; a bound on the second derivative excludes roots elsewhere.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
IndexArray = NDArray[np.intp]

SAMPLES_PER_HARMONIC = 8  # a period of the highest harmonic, to begin with
PARTS_PER_CELL = 8  # into which an uncertain cell is cut
FINEST_CELL = 1e-9  # rad: where cells are no longer cut; two roots closer than this are none
TURN = 2 * np.pi


def harmonics_of(row: Real) -> int:
    """Return the number H of harmonics of a polynomial (2H + 1,)."""
    return (row.shape[-1] - 1) // 2


def values(rows: Real, which: IndexArray, angle: Real) -> tuple[Real, Real]:
    """Return values and derivatives of polynomials ``rows`` (p, 2H + 1).

    Polynomial number ``which`` (q,) is evaluated at each ``angle`` (q,).
    """
    h = harmonics_of(rows)
    order = np.arange(1, h + 1)
    terms = (rows[:, 1 : h + 1] - 1j * rows[:, h + 1 :])[which] * np.exp(
        1j * (angle[:, None] * order)
    )
    return rows[which, 0] + np.sum(terms.real, axis=1), -(terms.imag @ order)


def derivative(row: Real) -> Real:
    """Return the polynomial's derivative by the angle, (..., 2H + 1)."""
    h = harmonics_of(row)
    order = np.arange(1, h + 1)
    return np.concatenate(
        [np.zeros_like(row[..., :1]), order * row[..., h + 1 :], -order * row[..., 1 : h + 1]],
        axis=-1,
    )


def _sample(rows: Real, points: int) -> Real:
    """Return values (p, points) at equal angles from 0."""
    h = harmonics_of(rows)
    spectrum = np.zeros((len(rows), points // 2 + 1), dtype=np.complex128)
    spectrum[:, 0] = rows[:, 0] * points
    spectrum[:, 1 : h + 1] = (rows[:, 1 : h + 1] - 1j * rows[:, h + 1 :]) * (points / 2)
    return np.asarray(np.fft.irfft(spectrum, points, axis=1))


def find_roots(rows: Real) -> list[Real]:
    """Return the angles in [0, 2 pi) at which each polynomial (p, 2H + 1) changes its sign.

    The angles are in ascending order. An interval between two samples of equal sign is halved as
    long as the bound of |f''| allows roots in it, down to `FINEST_CELL`.
    """
    h = max(harmonics_of(rows), 1)
    points = 2 * (SAMPLES_PER_HARMONIC * h // 2) + 8
    bend = np.sum(np.arange(1, h + 1) ** 2 * np.hypot(rows[:, 1 : h + 1], rows[:, h + 1 :]), axis=1)
    sampled = _sample(rows, points)
    which = np.repeat(np.arange(len(rows)), points)
    left = np.tile(np.arange(points) * (TURN / points), len(rows))
    low = sampled.ravel()
    high = np.roll(sampled, -1, axis=1).ravel()
    width = TURN / points
    brackets = []
    while True:
        change = (low < 0) != (high < 0)
        brackets.append(
            (
                which[change],
                left[change],
                np.full(int(np.sum(change)), width),
                low[change],
                high[change],
            )
        )
        unsure = (
            ~change
            & (np.minimum(np.abs(low), np.abs(high)) <= bend[which] * width**2 / 8)
            & (bend[which] > 0)
        )
        if width < FINEST_CELL or not np.any(unsure):
            break
        which = which[unsure]
        left = left[unsure]
        width = width / PARTS_PER_CELL
        inner = left[:, None] + width * np.arange(1, PARTS_PER_CELL)
        between = values(rows, np.repeat(which, PARTS_PER_CELL - 1), inner.ravel())[0].reshape(
            inner.shape
        )
        ends = np.column_stack([low[unsure], between, high[unsure]])
        which = np.repeat(which, PARTS_PER_CELL)
        left = (left[:, None] + width * np.arange(PARTS_PER_CELL)).ravel()
        low = ends[:, :-1].ravel()
        high = ends[:, 1:].ravel()
    which, left, size, low, high = (np.concatenate(parts) for parts in zip(*brackets, strict=True))
    result = _polish_roots(rows, which, left, left + size, low, high) % TURN
    return [np.sort(result[which == p]) for p in range(len(rows))]


def _polish_roots(
    rows: Real, which: IndexArray, left: Real, right: Real, low: Real, high: Real
) -> Real:
    """Return the root in each bracket by Newton's method, or bisection if it leaves the bracket."""
    if len(which) == 0:
        return left
    span = high - low
    x = np.where(
        span != 0, left - low * (right - left) / np.where(span == 0, 1, span), 0.5 * (left + right)
    )
    for _ in range(60):
        value, slope = values(rows, which, x)
        rises = (value < 0) == (low < 0)
        left = np.where(rises, x, left)
        right = np.where(rises, right, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = x - value / slope
        rounding = 2e-15 * (1 + np.abs(x))
        after = np.where(
            (after >= left - rounding) & (after <= right + rounding), after, 0.5 * (left + right)
        )
        moved = np.abs(after - x)
        x = after
        if np.all(moved <= rounding):
            break
    return x


def find_largest(row: Real) -> tuple[float, float]:
    """Return the least and the largest value of a polynomial (2H + 1,)."""
    turns = find_roots(derivative(row)[None])[0]
    at = np.concatenate([[0.0], turns])
    result = values(row[None], np.zeros(len(at), dtype=np.intp), at)[0]
    return float(np.min(result)), float(np.max(result))


Intervals = (
    Real  # (i, 2): begin and end of each in rad, the end behind the begin, perhaps beyond 2 pi
)


def negative(row: Real, at: Real) -> Intervals:
    """Return the intervals in which a polynomial is negative, from its sign changes ``at``."""
    if len(at) == 0:
        return (
            np.array([[0.0, TURN]]) if row[0] < 0 else np.empty((0, 2))
        )  # without a sign change the mean has the sign of all
    ends = np.append(at[1:], at[0] + TURN)
    middle = 0.5 * (at + ends)
    inside = values(row[None], np.zeros(len(at), dtype=np.intp), middle)[0] < 0
    return np.column_stack([at[inside], ends[inside]])


def moments(intervals: Intervals, harmonics: int) -> tuple[Real, Real]:
    """Return the means of cos(n angle) and sin(n angle), n = 0 to ``harmonics``.

    They are means over a period, in which only the intervals contribute.
    """
    order = np.arange(1, harmonics + 1)
    begin = np.exp(1j * np.outer(intervals[:, 0], order))
    end = np.exp(1j * np.outer(intervals[:, 1], order))
    both = np.sum(end - begin, axis=0) / (1j * order * TURN)
    length = float(np.sum(intervals[:, 1] - intervals[:, 0])) / TURN
    return np.append(length, both.real), np.append(0.0, both.imag)


@lru_cache(maxsize=16)
def _orders(harmonics: int) -> tuple[IndexArray, IndexArray, Real]:
    k = np.arange(1, harmonics + 1)
    difference = k[:, None] - k
    total = k[:, None] + k
    return np.abs(difference), total, np.sign(difference).astype(np.float64)


def window(intervals: Intervals, harmonics: int) -> Real:
    """Return the matrix (2H + 1, 2H + 1) that restricts a polynomial to intervals.

    The matrix maps a polynomial to the harmonics 0 to H of the function that equals it on the
    intervals and is zero elsewhere. It is computed in closed form.
    """
    c, s = moments(intervals, 2 * harmonics)
    difference, total, sign = _orders(harmonics)
    h = harmonics
    matrix = np.empty((2 * h + 1, 2 * h + 1))
    matrix[0] = np.concatenate([c[:1], c[1 : h + 1], s[1 : h + 1]])
    matrix[1 : h + 1, 0], matrix[h + 1 :, 0] = 2 * c[1 : h + 1], 2 * s[1 : h + 1]
    odd = sign * s[difference]  # sin((k - m) angle)
    matrix[1 : h + 1, 1 : h + 1] = c[difference] + c[total]
    matrix[h + 1 :, h + 1 :] = c[difference] - c[total]
    matrix[1 : h + 1, h + 1 :] = s[total] - odd
    matrix[h + 1 :, 1 : h + 1] = s[total] + odd
    return matrix


def share(intervals: Intervals, harmonics: int) -> Real:
    """Return the polynomial (2H + 1,) of the function that is 1 on the intervals, else 0."""
    c, s = moments(intervals, harmonics)
    return np.concatenate([c[:1], 2 * c[1:], 2 * s[1:]])


def basis(angle: float, harmonics: int) -> Real:
    """Return the row (2H + 1,) whose product with a polynomial is its value at an angle."""
    turned = np.arange(1, harmonics + 1) * angle
    return np.concatenate([[1.0], np.cos(turned), np.sin(turned)])
