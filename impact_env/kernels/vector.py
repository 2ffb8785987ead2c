"""The innermost loops of the event search as vector code: sums over slots at POINTS times at once, and what follows from them.

LLVM cannot know that a lane's amplitudes and a regime's tables do not overlap, and it unrolls short loops before it could make vectors of them. So
these loops are written in its own language; a vector of 8 numbers becomes what the processor has: one, two or four registers.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

POINTS = 8  # times in a block
LANES = 4  # slots in a vector where slots are not summed one by one: their number is padded to a multiple of it
TERMS = 9  # coefficients of the forced part's polynomials (forced.py)
SCAN_TERMS = 7  # those that a block keeps

# entries of a block: 1 + POINTS numbers of the value, the rate and the bend, then of their forced parts, in rows; then the carrier of the force
ROW = 16
VALUE, RATE, BEND, FORCED, COS, SIN = 0, ROW, 2 * ROW, 3 * ROW, 6 * ROW, 6 * ROW + POINTS
BLOCK = 7 * ROW

_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(64)
_FLAGS = ("reassoc", "contract", "nsz")


class _Number:
    """A number, or a vector of numbers, of the code under construction."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _with(self, other: _Number, operation: Any) -> _Number:
        return _Number(self.builder, operation(self.value, other.value, flags=_FLAGS))

    def __add__(self, other: _Number) -> _Number:
        return self._with(other, self.builder.fadd)

    def __sub__(self, other: _Number) -> _Number:
        return self._with(other, self.builder.fsub)

    def __mul__(self, other: _Number) -> _Number:
        return self._with(other, self.builder.fmul)

    def least(self, other: _Number) -> _Number:
        """Return the smaller one, element by element."""
        return _Number(self.builder, self.builder.select(self.builder.fcmp_ordered("<", self.value, other.value), self.value, other.value))

    def largest(self, other: _Number) -> _Number:
        """Return the larger one, element by element."""
        return _Number(self.builder, self.builder.select(self.builder.fcmp_ordered(">", self.value, other.value), self.value, other.value))

    def size(self) -> _Number:
        """Return the absolute value, element by element."""
        kind = ir.VectorType(_INDEX, self.value.type.count)
        without_sign = ir.Constant(kind, [2**63 - 1] * kind.count)
        return _Number(self.builder, self.builder.bitcast(self.builder.and_(self.builder.bitcast(self.value, kind), without_sign), self.value.type))

    def total(self) -> _Number:
        """Return the sum of the elements."""
        builder, places = self.builder, [ir.Constant(ir.IntType(32), k) for k in range(self.value.type.count)]
        parts = [_Number(builder, builder.extract_element(self.value, place)) for place in places]
        return sum(parts[1:], parts[0])

    def not_positive(self) -> Any:
        """Return an integer whose bit k says that element k is not above zero (or not a number)."""
        builder, zero = self.builder, ir.Constant(self.value.type, [0.0] * POINTS)
        bits = builder.fcmp_unordered("<=", self.value, zero)
        return builder.zext(builder.bitcast(bits, ir.IntType(POINTS)), _INDEX)


class _Code:
    """Numbers and vectors of a function under construction."""

    def __init__(self, context: Any, builder: Any, kinds: Iterable[Any], arguments: Iterable[Any]) -> None:
        self.builder = builder
        arrays = [context.make_array(k)(context, builder, a).data if isinstance(k, types.Array) else a for k, a in zip(kinds, arguments, strict=True)]
        self.arguments = arrays

    def vector(self, pointer: Any, index: Any, size: int = POINTS) -> _Number:
        """Return ``size`` numbers from ``index`` on."""
        return _Number(self.builder, self.builder.load(self._place(pointer, index, size), align=8))

    def store(self, vector: _Number, pointer: Any, index: Any, size: int = POINTS) -> None:
        """Write a vector from ``index`` on."""
        self.builder.store(vector.value, self._place(pointer, index, size), align=8)

    def number(self, pointer: Any, index: Any) -> _Number:
        """Return one number."""
        return _Number(self.builder, self.builder.load(self.builder.gep(pointer, [self.index(index)])))

    def put(self, number: _Number, pointer: Any, index: Any) -> None:
        """Write one number."""
        self.builder.store(number.value, self.builder.gep(pointer, [self.index(index)]))

    def spread(self, number: _Number | Any) -> _Number:
        """Return a vector that repeats a number."""
        undefined = ir.Constant(ir.VectorType(_DOUBLE, POINTS), ir.Undefined)
        value = number.value if isinstance(number, _Number) else number
        first = self.builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
        return _Number(self.builder, self.builder.shuffle_vector(first, undefined, self._order([0] * POINTS)))

    def before(self, first: _Number, vector: _Number) -> _Number:
        """Return a vector moved on by one element, with ``first`` in front."""
        order = self._order([POINTS, *range(POINTS - 1)])
        return _Number(self.builder, self.builder.shuffle_vector(vector.value, self.spread(first).value, order))

    def constant(self, numbers: Iterable[float]) -> _Number:
        """Return a vector of known numbers."""
        values = list(numbers)
        return _Number(self.builder, ir.Constant(ir.VectorType(_DOUBLE, len(values)), values))

    def index(self, index: Any) -> Any:
        """Return an index as a value of the code."""
        return ir.Constant(_INDEX, index) if isinstance(index, int) else index

    def plus(self, index: Any, more: Any) -> Any:
        """Return the sum of two indices."""
        return self.builder.add(self.index(index), self.index(more))

    def times(self, index: Any, factor: Any) -> Any:
        """Return the product of two indices."""
        return self.builder.mul(self.index(index), self.index(factor))

    def _place(self, pointer: Any, index: Any, size: int) -> Any:
        return self.builder.bitcast(self.builder.gep(pointer, [self.index(index)]), ir.VectorType(_DOUBLE, size).as_pointer())

    @staticmethod
    def _order(elements: list[int]) -> Any:
        return ir.Constant(ir.VectorType(ir.IntType(32), len(elements)), elements)


def _sum_slots(code: _Code, orders: int, waves: Any, first: Any, w: Any, size: Any, count: Any) -> tuple[list[_Number], list[_Number]]:
    """Return sum_j Re(w[q, j] wave[j, k]) as a vector over k, and sum_j Re(w[q, j]), for each order q."""
    builder = code.builder
    sums = [cgutils.alloca_once_value(builder, code.constant([0.0] * POINTS).value) for _ in range(orders)]
    firsts = [cgutils.alloca_once_value(builder, ir.Constant(_DOUBLE, 0.0)) for _ in range(orders)]
    with cgutils.for_range(builder, count) as loop:
        at = code.plus(first, code.times(loop.index, 2 * POINTS))
        wave_r, wave_i = code.vector(waves, at), code.vector(waves, code.plus(at, POINTS))
        for q in range(orders):
            index = code.plus(code.times(size, 2 * q), loop.index)
            w_r, w_i = code.number(w, index), code.number(w, code.plus(index, size))
            total = _Number(builder, builder.load(sums[q])) + code.spread(w_r) * wave_r - code.spread(w_i) * wave_i
            builder.store(total.value, sums[q])
            builder.store((_Number(builder, builder.load(firsts[q])) + w_r).value, firsts[q])
    return [_Number(builder, builder.load(s)) for s in sums], [_Number(builder, builder.load(s)) for s in firsts]


def _horner(code: _Code, signals: Any, row: int, y: _Number) -> _Number:
    total = code.spread(code.number(signals, row * TERMS + SCAN_TERMS - 1))
    for n in range(SCAN_TERMS - 2, -1, -1):
        total = total * y + code.spread(code.number(signals, row * TERMS + n))
    return total


def _margins(code: _Code, left: _Number, right: _Number, left_slope: _Number, right_slope: _Number, third: _Number) -> tuple[_Number, _Number]:
    """Return the least and the largest of the Bernstein coefficients of the cubics through values and slopes at both ends."""
    a, b = left + third * left_slope, right - third * right_slope
    return left.least(right).least(a.least(b)), left.largest(right).largest(a.largest(b))


def _scan(orders: int, walls: bool, reversal: bool) -> Any:
    def scan(typing_context, waves, first, w, size, count, signals, carrier, at, c, s, x, h, offset, p, b, low, high, direction, e0, e1):  # type: ignore[no-untyped-def]
        number, integer = types.float64, types.int64
        arguments = (waves, integer, w, integer, integer, signals, carrier, integer, *[number] * 5, p, b, *[number] * 5)
        signature = types.UniTuple(integer, 2)(*arguments)

        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = _Code(context, builder, signature.args, values)
            waves, first, w, size, count, signals, carrier, at, c, s, x, h, offset, p, b, low, high, direction, e0, e1 = code.arguments
            sums, firsts = _sum_slots(code, orders, waves, first, w, size, count)
            t = code.constant(range(1, POINTS + 1)) * code.spread(h)
            y, z = code.spread(x) + t, code.spread(offset) + t
            carrier_r, carrier_i = code.vector(carrier, at), code.vector(carrier, code.plus(at, POINTS))
            cos = code.spread(c) * carrier_r - code.spread(s) * carrier_i
            sin = code.spread(s) * carrier_r + code.spread(c) * carrier_i
            code.store(cos, b, COS)
            code.store(sin, b, SIN)
            p0, p1, p2 = (code.number(p, n) for n in range(3))
            half = code.spread(p2) * code.constant([0.5] * POINTS)
            polynomials = (code.spread(p0) + z * (code.spread(p1) + z * half), code.spread(p1) + z * code.spread(p2), code.spread(p2))
            lefts, rights = [], []
            for q in range(orders):
                real, imaginary = (_horner(code, signals, 2 * q + part, y) for part in (0, 1))
                forced = real * cos - imaginary * sin + polynomials[q]
                code.store(forced, b, FORCED + ROW * q + 1)
                rights.append(sums[q] + forced)
                start = firsts[q] + code.number(b, FORCED + ROW * q)
                lefts.append(code.before(start, rights[q]))
                code.put(start, b, ROW * q)
                code.store(rights[q], b, ROW * q + 1)
            third = code.spread(h) * code.constant([1.0 / 3.0] * POINTS)
            masks = [ir.Constant(_INDEX, 0), ir.Constant(_INDEX, 0)]
            if walls:
                least, largest = _margins(code, lefts[0], rights[0], lefts[1], rights[1], third)
                clear = (code.spread(high) - largest).least(least - code.spread(low)) - code.spread(e0)
                masks[0] = clear.not_positive()
            if reversal:
                sign = code.spread(direction)
                least, _ = _margins(code, sign * lefts[1], sign * rights[1], sign * lefts[2], sign * rights[2], third)
                masks[1] = (least - code.spread(e1)).not_positive()
            return context.make_tuple(builder, signature.return_type, masks)

        return signature, build

    scan.__doc__ = """Fill a block and return (walls, reversals): bit k of either is set where step k is not clear of it.

    ``waves``: flat, from ``first`` on POINTS real and POINTS imaginary parts a slot; ``w``: flat (orders, 2, size), ``count`` slots of it are summed;
    ``signals``: flat (q, 2, TERMS); ``carrier``: flat, from ``at`` on POINTS cosines and POINTS sines; ``c``, ``s``: carrier at the block's start;
    ``x``, ``offset`` (s): its time from the window's centre and from the signal's reference; ``h``: the step; ``p`` (3,): the signal's polynomial;
    ``b``: the block, whose forced parts at its start are set; ``low``, ``high``, ``direction``: guards; ``e0``, ``e1``: errors of value and rate.
    """
    return intrinsic(scan)


def _turn(orders: int) -> Any:
    def turn(typing_context, turns, start, w, size):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = _Code(context, builder, signature.args, values)
            turns, start, w, size = code.arguments
            with cgutils.for_range_slice(builder, code.index(0), size, code.index(LANES), inc=True) as (j, _):
                at = code.plus(start, j)
                t_r, t_i = code.vector(turns, at, LANES), code.vector(turns, code.plus(at, size), LANES)
                for q in range(orders):
                    index = code.plus(code.times(size, 2 * q), j)
                    other = code.plus(index, size)
                    w_r, w_i = code.vector(w, index, LANES), code.vector(w, other, LANES)
                    code.store(w_r * t_r - w_i * t_i, w, index, LANES)
                    code.store(w_r * t_i + w_i * t_r, w, other, LANES)
            return context.get_dummy_value()

        return types.void(turns, types.int64, w, types.int64), build

    turn.__doc__ = "Multiply w[q, j] by turn[j] for all orders q; ``turns``: flat, from ``start`` on ``size`` real, then ``size`` imaginary parts."
    return intrinsic(turn)


@intrinsic
def begin_orders(typing_context, rows, u, w, size):  # type: ignore[no-untyped-def]
    """Write w[0] = u, w[1] = s u and w[2] = s^2 u; ``rows``: flat, its first four rows of ``size`` numbers hold s and s^2, real and imaginary."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = _Code(context, builder, signature.args, values)
        rows, u, w, size = code.arguments
        with cgutils.for_range_slice(builder, code.index(0), size, code.index(LANES), inc=True) as (j, _):
            other = code.plus(j, size)
            u_r, u_i = code.vector(u, j, LANES), code.vector(u, other, LANES)
            code.store(u_r, w, j, LANES)
            code.store(u_i, w, other, LANES)
            for q in (1, 2):
                index = code.plus(code.times(size, 2 * q - 2), j)
                s_r, s_i = code.vector(rows, index, LANES), code.vector(rows, code.plus(index, size), LANES)
                index = code.plus(code.times(size, 2 * q), j)
                code.store(u_r * s_r - u_i * s_i, w, index, LANES)
                code.store(u_r * s_i + u_i * s_r, w, code.plus(index, size), LANES)
        return context.get_dummy_value()

    return types.void(rows, u, w, types.int64), build


@intrinsic
def weighted_sizes(typing_context, weights, start, w, size):  # type: ignore[no-untyped-def]
    """Return sum_j weight[j] (|Re w[q, j]| + |Im w[q, j]|) for q = 0 and 1; ``weights``: flat, from ``start`` on."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = _Code(context, builder, signature.args, values)
        weights, start, w, size = code.arguments
        sums = [cgutils.alloca_once_value(builder, code.constant([0.0] * LANES).value) for _ in range(2)]
        with cgutils.for_range_slice(builder, code.index(0), size, code.index(LANES), inc=True) as (j, _):
            weight = code.vector(weights, code.plus(start, j), LANES)
            for q in range(2):
                index = code.plus(code.times(size, 2 * q), j)
                both = code.vector(w, index, LANES).size() + code.vector(w, code.plus(index, size), LANES).size()
                builder.store((_Number(builder, builder.load(sums[q])) + weight * both).value, sums[q])
        totals = [_Number(builder, builder.load(s)).total().value for s in sums]
        return context.make_tuple(builder, signature.return_type, totals)

    return types.UniTuple(types.float64, 2)(weights, types.int64, w, types.int64), build


scan_walls, scan_reversal, scan_both = _scan(2, True, False), _scan(3, False, True), _scan(3, True, True)
turn_2, turn_3 = _turn(2), _turn(3)
