"""A small language for vector code: loops over slots or times whose result does not depend on what else is compiled beside them.

numba's own loops become vectors only where sums may be reordered and products contracted, and then the compiler chooses the order anew in each
library that a function gets into: one source, several results. Here order and contraction are written down. Nothing may be reordered, and a product
and a sum are one rounding where ``fma`` says so, on any processor.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import cgutils, types

LANES = 4  # the number of slots is padded to a multiple of it

DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)


def _function(builder: Any, name: str, kind: Any, arguments: int) -> Any:
    """Return one of the compiler's own functions of numbers or vectors of one kind."""
    suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
    return cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * arguments), f"llvm.{name}.{suffix}")


class Number:
    """A number, or a vector of numbers, of the code under construction."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _with(self, other: Number, operation: Any) -> Number:
        return Number(self.builder, operation(self.value, other.value))

    def __add__(self, other: Number) -> Number:
        return self._with(other, self.builder.fadd)

    def __sub__(self, other: Number) -> Number:
        return self._with(other, self.builder.fsub)

    def __mul__(self, other: Number) -> Number:
        return self._with(other, self.builder.fmul)

    def __truediv__(self, other: Number) -> Number:
        return self._with(other, self.builder.fdiv)

    def __neg__(self) -> Number:
        return Number(self.builder, self.builder.fneg(self.value))

    def fma(self, factor: Number, summand: Number) -> Number:
        """Return self * factor + summand, rounded once."""
        call = _function(self.builder, "fma", self.value.type, 3)
        return Number(self.builder, self.builder.call(call, [self.value, factor.value, summand.value]))

    def root(self) -> Number:
        """Return the square root."""
        return Number(self.builder, self.builder.call(_function(self.builder, "sqrt", self.value.type, 1), [self.value]))

    def least(self, other: Number) -> Number:
        """Return the smaller one, element by element."""
        return Number(self.builder, self.builder.select(self.builder.fcmp_ordered("<", self.value, other.value), self.value, other.value))

    def largest(self, other: Number) -> Number:
        """Return the larger one, element by element."""
        return Number(self.builder, self.builder.select(self.builder.fcmp_ordered(">", self.value, other.value), self.value, other.value))

    def size(self) -> Number:
        """Return the absolute value, element by element."""
        return Number(self.builder, self.builder.call(_function(self.builder, "fabs", self.value.type, 1), [self.value]))

    def elements(self) -> list[Number]:
        """Return the elements of a vector."""
        builder, places = self.builder, [ir.Constant(ir.IntType(32), k) for k in range(self.value.type.count)]
        return [Number(builder, builder.extract_element(self.value, place)) for place in places]

    @property
    def count(self) -> int:
        """Number of elements, 0 of a number that is no vector."""
        return self.value.type.count if isinstance(self.value.type, ir.VectorType) else 0

    def folded(self) -> Number:
        """Return the sum of the vector's two halves."""
        half, kind = self.count // 2, ir.IntType(32)
        undefined = ir.Constant(self.value.type, ir.Undefined)
        orders = (ir.Constant(ir.VectorType(kind, half), list(range(first, first + half))) for first in (0, half))
        low, high = (Number(self.builder, self.builder.shuffle_vector(self.value, undefined, order)) for order in orders)
        return low + high

    def total(self) -> Number:
        """Return the sum of the elements, a power of two of them: halves are added until one is left."""
        number = self
        while number.count > 2:
            number = number.folded()
        first, second = number.elements()
        return first + second

    def not_positive(self) -> Any:
        """Return an integer whose bit k says that element k is not above zero (or not a number)."""
        builder, count = self.builder, self.value.type.count
        bits = builder.fcmp_unordered("<=", self.value, ir.Constant(self.value.type, [0.0] * count))
        return builder.zext(builder.bitcast(bits, ir.IntType(count)), INDEX)


class Complex(NamedTuple):
    """A complex number, or a vector of them."""

    real: Number
    imag: Number

    def times(self, other: Complex) -> Complex:
        """Return the product."""
        return Complex(self.real.fma(other.real, -(self.imag * other.imag)), self.real.fma(other.imag, self.imag * other.real))

    def real_of_product(self, other: Complex) -> Number:
        """Return the real part of the product."""
        return self.real.fma(other.real, -(self.imag * other.imag))


class Sum:
    """A sum that a loop adds to: numbers, or vectors of any of some sizes."""

    def __init__(self, code: Code, sizes: Iterable[int]) -> None:
        self.code = code
        self.places = {size: cgutils.alloca_once_value(code.builder, code.repeated(0.0, size).value) for size in sizes}

    def __iadd__(self, summand: Number) -> Sum:
        self.code.builder.store((self._number(summand.count) + summand).value, self.places[summand.count])
        return self

    def add_product(self, one: Number, other: Number) -> None:
        """Add the product of two, rounded once."""
        self.code.builder.store(one.fma(other, self._number(one.count)).value, self.places[one.count])

    def number(self) -> Number:
        """Return the sum so far, vectors of other sizes folded to the smallest."""
        numbers = [self._number(size) for size in sorted(self.places, reverse=True)]
        total = numbers[0]
        for number in numbers[1:]:
            while total.count > number.count:
                total = total.folded()
            total += number
        return total

    def total(self) -> Number:
        """Return the sum of all elements so far."""
        return self.number().total()

    def _number(self, size: int) -> Number:
        return Number(self.code.builder, self.code.builder.load(self.places[size]))


class Fields:
    """A named tuple of the code under construction, its fields by their names: what is never read makes no code."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        self._context, self._builder, self._kind, self._value = context, builder, kind, value

    def __getattr__(self, name: str) -> Any:
        place = self._kind.fields.index(name)
        return opened(self._context, self._builder, self._kind.types[place], self._builder.extract_value(self._value, place))


def opened(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return what code works with: the data pointer of an array, which must be contiguous, the `Fields` of a named tuple, else the value."""
    if isinstance(kind, types.Array):
        return context.make_array(kind)(context, builder, value).data
    return Fields(context, builder, kind, value) if isinstance(kind, types.BaseNamedTuple) else value


class Code:
    """Numbers and vectors of a function under construction; ``arguments`` are `opened`."""

    def __init__(self, context: Any, builder: Any, kinds: Iterable[Any], arguments: Iterable[Any]) -> None:
        self.builder, self.lanes = builder, LANES
        self.arguments = [opened(context, builder, kind, value) for kind, value in zip(kinds, arguments, strict=True)]

    @contextmanager
    def loop(self, count: Any, step: int = 1, first: Any = 0) -> Iterator[Any]:
        """Repeat what follows for ``first``, ``first`` + ``step``, ... below ``count``."""
        with cgutils.for_range_slice(self.builder, self.index(first), self.index(count), self.index(step), inc=True) as (j, _):
            yield j

    def slots(self, size: Any) -> Iterator[Any]:
        """Repeat what follows for the first of 2 LANES slots each, and for the LANES that may be left; ``lanes`` says how many there are."""
        whole = self.builder.and_(size, self.index(-2 * LANES))
        self.lanes = 2 * LANES
        with self.loop(whole, 2 * LANES) as j:
            yield j
        self.lanes = LANES
        with self.builder.if_then(self.builder.icmp_signed("!=", whole, size)):
            yield whole

    def fours(self, size: Any) -> Iterator[Any]:
        """Repeat what follows for LANES slots each: half the code of `slots`."""
        self.lanes = LANES
        with self.loop(size, LANES) as j:
            yield j

    def sum(self) -> Sum:
        """Return a new sum over slots."""
        return Sum(self, (2 * LANES, LANES))

    def vector(self, pointer: Any, index: Any, size: int | None = None) -> Number:
        """Return ``size`` numbers from ``index`` on, None: as many as there are lanes."""
        return Number(self.builder, self.builder.load(self._place(pointer, index, size or self.lanes), align=8))

    def store(self, vector: Number, pointer: Any, index: Any) -> None:
        """Write a vector from ``index`` on."""
        self.builder.store(vector.value, self._place(pointer, index, vector.count), align=8)

    def complex(self, pointer: Any, real: Any, imag: Any, size: int | None = None) -> Complex:
        """Return ``size`` complex numbers whose parts lie from ``real`` and from ``imag`` on, None: as many as there are lanes."""
        return Complex(self.vector(pointer, real, size), self.vector(pointer, imag, size))

    def store_complex(self, vector: Complex, pointer: Any, real: Any, imag: Any) -> None:
        """Write complex numbers, their parts from ``real`` and from ``imag`` on."""
        self.store(vector.real, pointer, real)
        self.store(vector.imag, pointer, imag)

    def number(self, pointer: Any, index: Any) -> Number:
        """Return one number."""
        return Number(self.builder, self.builder.load(self.builder.gep(pointer, [self.index(index)])))

    def put(self, number: Number, pointer: Any, index: Any) -> None:
        """Write one number."""
        self.builder.store(number.value, self.builder.gep(pointer, [self.index(index)]))

    def repeated(self, number: float, size: int | None = None) -> Number:
        """Return a vector that repeats a known number, or the number itself for ``size`` 0."""
        if size == 0:
            return Number(self.builder, ir.Constant(DOUBLE, number))
        return self.constant([number] * (size or self.lanes))

    def spread(self, number: Number | Any, size: int | None = None) -> Number:
        """Return a vector that repeats a number."""
        size = size or self.lanes
        undefined = ir.Constant(ir.VectorType(DOUBLE, size), ir.Undefined)
        value = number.value if isinstance(number, Number) else number
        first = self.builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
        return Number(self.builder, self.builder.shuffle_vector(first, undefined, self._order([0] * size)))

    def gathered(self, numbers: list[Number]) -> Number:
        """Return a vector of these numbers."""
        value = ir.Constant(ir.VectorType(DOUBLE, len(numbers)), ir.Undefined)
        for k, number in enumerate(numbers):
            value = self.builder.insert_element(value, number.value, ir.Constant(ir.IntType(32), k))
        return Number(self.builder, value)

    def before(self, first: Number, vector: Number) -> Number:
        """Return a vector moved on by one element, with ``first`` in front."""
        size = vector.value.type.count
        order = self._order([size, *range(size - 1)])
        return Number(self.builder, self.builder.shuffle_vector(vector.value, self.spread(first, size).value, order))

    def constant(self, numbers: Iterable[float]) -> Number:
        """Return a vector of known numbers."""
        values = list(numbers)
        return Number(self.builder, ir.Constant(ir.VectorType(DOUBLE, len(values)), values))

    def index(self, index: Any) -> Any:
        """Return an index as a value of the code."""
        return ir.Constant(INDEX, index) if isinstance(index, int) else index

    def plus(self, index: Any, more: Any) -> Any:
        """Return the sum of two indices."""
        return self.builder.add(self.index(index), self.index(more))

    def times(self, index: Any, factor: Any) -> Any:
        """Return the product of two indices."""
        return self.builder.mul(self.index(index), self.index(factor))

    def result(self, signature: Any, context: Any, numbers: Iterable[Any]) -> Any:
        """Return several numbers from the function."""
        values = [number.value if isinstance(number, Number) else number for number in numbers]
        return context.make_tuple(self.builder, signature.return_type, values)

    def _place(self, pointer: Any, index: Any, size: int) -> Any:
        return self.builder.bitcast(self.builder.gep(pointer, [self.index(index)]), ir.VectorType(DOUBLE, size).as_pointer())

    @staticmethod
    def _order(elements: list[int]) -> Any:
        return ir.Constant(ir.VectorType(ir.IntType(32), len(elements)), elements)
