"""Whole numbers in units of 2^-200 as numbers of some 60 digits: NumPy arrays of Python's integers, and what a Taylor series of them asks for."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from reference.automaton import Number

Array = NDArray[np.float64]
Whole = NDArray[np.object_]  # integers, in units of 2^-BITS

BITS = 200
ONE = 1 << BITS
UNIT = 2.0**-BITS
PARTS = 96  # places in a step at which a guard is looked at
BISECTIONS, NEWTON = 60, 5  # a quotient in double precision suffices for Newton's method: each pass gains its digits anew


def whole(value: Number) -> int:
    """Return a number in units of 2^-BITS."""
    number = Fraction(value)
    return (number.numerator << BITS) // number.denominator


def wholes(values: Sequence[Number] | Array) -> Whole:
    """Return numbers in units of 2^-BITS, as an array."""
    return np.array([whole(value) for value in values], dtype=object)


def fraction(value: int) -> Fraction:
    """Return the fraction that a whole number stands for."""
    return Fraction(value, ONE)


def inverse(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Return the inverse of a small positive definite matrix."""
    n = len(matrix)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        pivot = rows[i][i]
        rows[i] = [x / pivot for x in rows[i]]
        for j in range(n):
            if j != i:
                factor = rows[j][i]
                rows[j] = [x - factor * y for x, y in zip(rows[j], rows[i], strict=True)]
    return [row[n:] for row in rows]


def value_at(rows: Whole, at: int) -> tuple[Whole, Whole]:
    """Return the sums of rows[k] at^k, and their derivatives."""
    count = np.arange(1, len(rows)).astype(object)
    if at == ONE:
        return rows.sum(axis=0), count @ rows[1:]
    powers = [ONE]
    for _ in range(len(rows) - 1):
        powers.append((powers[-1] * at) >> BITS)
    row = np.array(powers, dtype=object)
    return (row @ rows) >> BITS, ((row[:-1] * count) @ rows[1:]) >> BITS


def first_root(row: list[int], end: int) -> int | None:
    """Return the first place in (0, end], in steps, where a guard turns negative.

    ``row`` is the guard's series less the powers of time that it starts with: so a regime that starts on its guard lasts until that is met again.
    """
    numbers = np.array(row, dtype=object).astype(float) * UNIT
    if numbers[0] < 0:
        return 0
    reach = end * UNIT
    places = np.arange(1, PARTS + 1) / PARTS
    negative = np.flatnonzero(np.polynomial.polynomial.polyval(reach * places, numbers) < 0)
    if not len(negative):
        return None
    low, high = (reach * (int(negative[0]) + k) / PARTS for k in (0, 1))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if np.polynomial.polynomial.polyval(middle, numbers) < 0 else (middle, high)
    at, series = whole(high), np.array(row, dtype=object)
    for _ in range(NEWTON):
        value, slope = (float(x) for x in value_at(series, at))
        at -= whole(value / slope)
    return at
