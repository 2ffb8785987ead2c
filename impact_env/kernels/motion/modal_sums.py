"""Loops over a regime's modal amplitudes, as vector code (vector_code.py).

They compute propagation, weights, sums and bounds.

Arrays are seen flat: ``rows`` (ROWS, size) and ``table`` (2, 3, base, size) of
`modal_system.ModalSystem`, amplitudes ``u``, ``z`` and ``out`` (2, size). A time offset is given by
its three ``digits`` d1, d2, d3 in the tables and the rest ``x``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impact_env.kernels.compiling.jit import NUMBER, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.modal_rows import SPEED, SQUARE, TAYLOR, TAYLOR_ROWS, S


class Propagator:
    """The modal amplitudes of a regime at a time offset: exp(s t)."""

    def __init__(
        self, code: Code, rows: Any, table: Any, size: Any, base: Any, digits: Sequence[Any]
    ) -> None:
        self.code = code
        self.rows = rows
        self.table = table
        self.size = size
        plane = base * size
        places = [plane * k + digit * size for k, digit in enumerate(digits[:3])]
        self.places = places
        self.imaginary = plane * 3
        self.x = digits[3]

    def row(self, row: int, j: Any) -> Number:
        """Return a row's numbers."""
        return self.code.vector(self.rows, self.size * row + j)

    def pair(self, row: int, j: Any) -> Complex:
        """Return the complex numbers whose parts are in a row and the one behind it."""
        return Complex(self.row(row, j), self.row(row + 1, j))

    def looked_up(self, k: int, j: Any) -> Complex:
        """Return the table's entry for digit ``k``."""
        at = self.places[k] + j
        return self.code.complex(self.table, at, at + self.imaginary)

    def taylor(self, j: Any) -> Complex:
        """Return exp(s x) for the rest of the offset."""
        x = self.code.spread(self.x)
        total = self.pair(TAYLOR + 2 * (TAYLOR_ROWS - 1), j)
        for k in range(TAYLOR_ROWS - 2, -1, -1):
            next_one = self.pair(TAYLOR + 2 * k, j)
            total = Complex(total.real.fma(x, next_one.real), total.imag.fma(x, next_one.imag))
        return Complex(total.real.fma(x, self.code.repeated(1.0)), total.imag * x)

    def factor(self, j: Any) -> Complex:
        """Return exp(s t)."""
        return (
            self.looked_up(0, j)
            .times(self.looked_up(1, j).times(self.looked_up(2, j)))
            .times(self.taylor(j))
        )

    def turned(self, u: Any, j: Any) -> Complex:
        """Return u exp(s t)."""
        amplitude = self.code.complex(u, j, j + self.size)
        return (
            amplitude.times(self.looked_up(0, j))
            .times(self.looked_up(1, j).times(self.looked_up(2, j)))
            .times(self.taylor(j))
        )


@vector_code()
def propagate_by_digits(
    code: Code,
    rows,
    table,
    size: Index,
    base: Index,
    d1: Index,
    d2: Index,
    d3: Index,
    x: Number,
    u,
    out,
):
    """Write u exp(s t) to ``out``, which may be ``u``."""
    propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
    for j in code.vectors(size):
        code.store_complex(propagator.turned(u, j), out, j, j + size)


def _sum(orders: int) -> Any:
    @vector_code(NUMBER, orders)
    def sums(
        code: Code,
        rows,
        table,
        size: Index,
        base: Index,
        d1: Index,
        d2: Index,
        d3: Index,
        x: Number,
        u,
    ):
        propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
        totals = [code.sum() for _ in range(orders)]
        for j in code.vectors(size):
            turned = propagator.turned(u, j)
            totals[0] += turned.real
            if orders > 1:
                speed = propagator.pair(S, j)
                square = propagator.pair(SQUARE, j)
                totals[1] += turned.real_of_product(speed)
                totals[2] += turned.real_of_product(square)
                totals[3] += turned.times(speed).real_of_product(square)
        return [total.total() for total in totals]

    sums.__doc__ = (
        "Return the sum of Re(u exp(s t)) and, for four sums, its first three derivatives."
    )
    return sums


sum_value = _sum(1)
sum_three_derivatives = _sum(4)


@vector_code(NUMBER, 6)
def sum_and_bound_derivatives(
    code: Code, rows, table, size: Index, base: Index, d1: Index, d2: Index, d3: Index, x: Number, u
):
    """Return the first three sums of `sum_three_derivatives`, and three bounds.

    The bounds are the sums of |s|^2, |s|^3 and |s|^4 times |u exp(s t)|.
    """
    propagator = Propagator(code, rows, table, size, base, (d1, d2, d3, x))
    y0, y1, y2, b2, b3, b4 = [code.sum() for _ in range(6)]
    for j in code.vectors(size):
        turned = propagator.turned(u, j)
        speed = propagator.row(SPEED, j)
        y0 += turned.real
        y1 += turned.real_of_product(propagator.pair(S, j))
        y2 += turned.real_of_product(propagator.pair(SQUARE, j))
        second = turned.real.fma(turned.real, turned.imag * turned.imag).root() * (speed * speed)
        b2 += second
        b3 += second * speed
        b4 += second * (speed * speed)
    return [total.total() for total in (y0, y1, y2, b2, b3, b4)]


@vector_code(NUMBER, 3)
def sum_third_to_fifth(code: Code, rows, size: Index, u):
    """Return the sums of Re(s^3 u), Re(s^4 u) and Re(s^5 u)."""
    third = code.sum()
    fourth = code.sum()
    fifth = code.sum()
    for j in code.vectors(size):
        s, square = (
            code.complex(rows, size * row + j, size * (row + 1) + j) for row in (S, SQUARE)
        )
        bend = code.complex(u, j, j + size).times(square)
        third += bend.real_of_product(s)
        fourth += bend.real_of_product(square)
        fifth += bend.times(square).real_of_product(s)
    return [total.total() for total in (third, fourth, fifth)]


@vector_code()
def copy_vectors(code: Code, size: Index, z, w):
    """Write z to w as vectors.

    If single numbers were stored, code that reads w as vectors would have to wait for them.
    """
    for j in code.vectors(size):
        other = j + size
        code.store_complex(code.complex(z, j, other), w, j, other)


@vector_code()
def multiply_by_row(code: Code, rows, row: Index, size: Index, z, u):
    """Write u = w z with the complex weights w in ``row`` and the row behind it."""
    for j in code.vectors(size):
        at = size * row + j
        other = j + size
        weight = code.complex(rows, at, at + size)
        code.store_complex(code.complex(z, j, other).times(weight), u, j, other)


@vector_code()
def add_row(code: Code, rows, row: Index, size: Index, factor: Number, z):
    """Add factor * w to z with the complex weights w in ``row`` and the row behind it."""
    for j in code.vectors(size):
        at = size * row + j
        other = j + size
        weight = code.complex(rows, at, at + size)
        old = code.complex(z, j, other)
        code.store_complex(
            Complex(
                *(code.spread(factor).fma(new, part) for new, part in zip(weight, old, strict=True))
            ),
            z,
            j,
            other,
        )


@vector_code(NUMBER)
def sum_magnitudes(code: Code, size: Index, u):
    """Return the sum of |Re u| + |Im u|."""
    total = code.sum()
    for j in code.vectors(size):
        amplitude = code.complex(u, j, j + size)
        total += amplitude.real.size() + amplitude.imag.size()
    return total.total()
