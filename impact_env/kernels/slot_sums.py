"""Loops over a regime's slots as vector code (vector_code.py): propagation, weights, sums and bounds.

Arrays are seen flat: ``rows`` (29, size) and ``table`` (2, 3, base, size) of `slots.Slots`, amplitudes ``u``, ``z`` and ``out`` (2, size). A time
offset is given by its three ``digits`` d1, d2, d3 in the tables and the rest ``x``.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.extending import intrinsic

from impact_env.kernels.vector_code import Code, Complex, Number

INTEGER, NUMBER = types.int64, types.float64
DIGITS = (INTEGER, INTEGER, INTEGER, NUMBER)

# rows of Slots.rows that the sums know; slots.py has them all
_S, _SQUARE, _TAYLOR, _SPEED = 0, 2, 14, 26
_TAYLOR_ROWS = 6


class SlotsAt:
    """The slots of a regime at a time offset: exp(s t)."""

    def __init__(self, code: Code, rows: Any, table: Any, size: Any, base: Any, digits: list[Any]) -> None:
        self.code, self.rows, self.table, self.size = code, rows, table, size
        plane = code.times(base, size)
        places = [code.plus(code.times(plane, k), code.times(digit, size)) for k, digit in enumerate(digits[:3])]
        self.places, self.imaginary, self.x = places, code.times(plane, 3), digits[3]

    def row(self, row: int, j: Any) -> Number:
        """Return a row's numbers."""
        return self.code.vector(self.rows, self.code.plus(self.code.times(self.size, row), j))

    def pair(self, row: int, j: Any) -> Complex:
        """Return the complex numbers whose parts are in a row and the one behind it."""
        return Complex(self.row(row, j), self.row(row + 1, j))

    def looked_up(self, k: int, j: Any) -> Complex:
        """Return the table's entry for digit ``k``."""
        at = self.code.plus(self.places[k], j)
        return self.code.complex(self.table, at, self.code.plus(at, self.imaginary))

    def taylor(self, j: Any) -> Complex:
        """Return exp(s x) for the rest of the offset."""
        x, total = self.code.spread(self.x), self.pair(_TAYLOR + 2 * (_TAYLOR_ROWS - 1), j)
        for k in range(_TAYLOR_ROWS - 2, -1, -1):
            next_one = self.pair(_TAYLOR + 2 * k, j)
            total = Complex(total.real.fma(x, next_one.real), total.imag.fma(x, next_one.imag))
        return Complex(total.real.fma(x, self.code.repeated(1.0)), total.imag * x)

    def factor(self, j: Any) -> Complex:
        """Return exp(s t)."""
        return self.looked_up(0, j).times(self.looked_up(1, j).times(self.looked_up(2, j))).times(self.taylor(j))

    def turned(self, u: Any, j: Any) -> Complex:
        """Return u exp(s t)."""
        amplitude = self.code.complex(u, j, self.code.plus(j, self.size))
        return amplitude.times(self.looked_up(0, j)).times(self.looked_up(1, j).times(self.looked_up(2, j))).times(self.taylor(j))


@intrinsic
def turn_to(typing_context, rows, table, size, base, d1, d2, d3, x, u, out):  # type: ignore[no-untyped-def]
    """Write u exp(s t) to ``out``, which may be ``u``."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, table, size, base, *digits, u, out = code.arguments
        slots = SlotsAt(code, rows, table, size, base, digits)
        for j in code.slots(size):
            code.store_complex(slots.turned(u, j), out, j, code.plus(j, size))
        return context.get_dummy_value()

    return types.void(rows, table, INTEGER, INTEGER, *DIGITS, u, out), build


def _sum(orders: int) -> Any:
    def sums(typing_context, rows, table, size, base, d1, d2, d3, x, u):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = Code(context, builder, signature.args, values)
            rows, table, size, base, *digits, u = code.arguments
            slots, totals = SlotsAt(code, rows, table, size, base, digits), [code.sum() for _ in range(orders)]
            for j in code.slots(size):
                turned = slots.turned(u, j)
                totals[0] += turned.real
                if orders > 1:
                    speed, square = slots.pair(_S, j), slots.pair(_SQUARE, j)
                    totals[1] += turned.real_of_product(speed)
                    totals[2] += turned.real_of_product(square)
                    totals[3] += turned.times(speed).real_of_product(square)
            return code.result(signature, context, [total.total() for total in totals])

        return types.UniTuple(NUMBER, orders)(rows, table, INTEGER, INTEGER, *DIGITS, u), build

    sums.__doc__ = "Return the sum of Re(u exp(s t)) and, for four sums, its first three derivatives."
    return intrinsic(sums)


sum_one, sum_four = _sum(1), _sum(4)


@intrinsic
def sum_and_bounds(typing_context, rows, table, size, base, d1, d2, d3, x, u):  # type: ignore[no-untyped-def]
    """Return the first three sums of `sum_four`, and the sums of |s|^2, |s|^3 and |s|^4 times |u exp(s t)|."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, table, size, base, *digits, u = code.arguments
        slots, (y0, y1, y2, b2, b3, b4) = SlotsAt(code, rows, table, size, base, digits), [code.sum() for _ in range(6)]
        for j in code.slots(size):
            turned, speed = slots.turned(u, j), slots.row(_SPEED, j)
            y0 += turned.real
            y1 += turned.real_of_product(slots.pair(_S, j))
            y2 += turned.real_of_product(slots.pair(_SQUARE, j))
            second = turned.real.fma(turned.real, turned.imag * turned.imag).root() * (speed * speed)
            b2 += second
            b3 += second * speed
            b4 += second * (speed * speed)
        return code.result(signature, context, [total.total() for total in (y0, y1, y2, b2, b3, b4)])

    return types.UniTuple(NUMBER, 6)(rows, table, INTEGER, INTEGER, *DIGITS, u), build


@intrinsic
def third_to_fifth(typing_context, rows, size, u):  # type: ignore[no-untyped-def]
    """Return the sums of Re(s^3 u), Re(s^4 u) and Re(s^5 u)."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, size, u = code.arguments
        third, fourth, fifth = code.sum(), code.sum(), code.sum()
        for j in code.slots(size):
            s, square = (code.complex(rows, code.plus(code.times(size, row), j), code.plus(code.times(size, row + 1), j)) for row in (_S, _SQUARE))
            bend = code.complex(u, j, code.plus(j, size)).times(square)
            third += bend.real_of_product(s)
            fourth += bend.real_of_product(square)
            fifth += bend.times(square).real_of_product(s)
        return code.result(signature, context, [total.total() for total in (third, fourth, fifth)])

    return types.UniTuple(NUMBER, 3)(rows, INTEGER, u), build


@intrinsic
def copy_slots(typing_context, size, z, w):  # type: ignore[no-untyped-def]
    """Write z to w: as vectors, since what reads w as vectors would have to wait for single numbers to be stored."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        size, z, w = code.arguments
        for j in code.slots(size):
            other = code.plus(j, size)
            code.store_complex(code.complex(z, j, other), w, j, other)
        return context.get_dummy_value()

    return types.void(INTEGER, z, w), build


@intrinsic
def multiply_row(typing_context, rows, row, size, z, u):  # type: ignore[no-untyped-def]
    """Write u = w z with the complex weights w in ``row`` and the row behind it."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, row, size, z, u = code.arguments
        for j in code.slots(size):
            at, other = code.plus(code.times(size, row), j), code.plus(j, size)
            weight = code.complex(rows, at, code.plus(at, size))
            code.store_complex(code.complex(z, j, other).times(weight), u, j, other)
        return context.get_dummy_value()

    return types.void(rows, INTEGER, INTEGER, z, u), build


@intrinsic
def add_row(typing_context, rows, row, size, factor, z):  # type: ignore[no-untyped-def]
    """Add factor * w to z with the complex weights w in ``row`` and the row behind it."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, row, size, factor, z = code.arguments
        for j in code.slots(size):
            at, other = code.plus(code.times(size, row), j), code.plus(j, size)
            weight, old = code.complex(rows, at, code.plus(at, size)), code.complex(z, j, other)
            code.store_complex(Complex(*(code.spread(factor).fma(new, part) for new, part in zip(weight, old, strict=True))), z, j, other)
        return context.get_dummy_value()

    return types.void(rows, INTEGER, INTEGER, NUMBER, z), build


@intrinsic
def sum_sizes(typing_context, size, u):  # type: ignore[no-untyped-def]
    """Return the sum of |Re u| + |Im u|."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        size, u = code.arguments
        total = code.sum()
        for j in code.slots(size):
            amplitude = code.complex(u, j, code.plus(j, size))
            total += amplitude.real.size() + amplitude.imag.size()
        return total.total().value

    return NUMBER(INTEGER, u), build
