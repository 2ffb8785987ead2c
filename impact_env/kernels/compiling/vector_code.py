"""A small language for vector code, that is for loops over slots or times.

Results do not depend on which other code is compiled in the same library.

numba's own loops become vectors only where sums may be reordered and products contracted, and then
the compiler chooses the order anew in each library that a function gets into: one source, several
results. Here order and contraction are written down. Nothing may be reordered, and a product and a
sum are one rounding where ``fma`` says so, on any processor.

The classes of this module write LLVM's code for what is asked of them; those of plain_code.py have
the same methods and compute at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import cgutils, types

LANES = 4  # the number of slots is padded to a multiple of it

DOUBLE = ir.DoubleType()
INDEX = ir.IntType(64)
PLACE = ir.IntType(32)


def _function(builder: Any, name: str, kind: Any, arguments: int) -> Any:
    """Return one of the compiler's own functions of numbers or vectors of one kind."""
    suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
    return cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [kind] * arguments), f"llvm.{name}.{suffix}"
    )


class Index:
    """A whole number, or the result of a comparison, of the code under construction.

    The other operand of an operation may be a known number.
    """

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder = builder
        self.value = value

    def _with(self, other: Any, operation: Any) -> Index:
        return Index(
            self.builder,
            operation(
                self.value,
                other.value if isinstance(other, Index) else ir.Constant(self.value.type, other),
            ),
        )

    def _compared(self, sign: str, other: Any) -> Index:
        return self._with(other, lambda one, two: self.builder.icmp_signed(sign, one, two))

    def __add__(self, other: Any) -> Index:
        return self._with(other, self.builder.add)

    def __sub__(self, other: Any) -> Index:
        return self._with(other, self.builder.sub)

    def __mul__(self, other: Any) -> Index:
        return self._with(other, self.builder.mul)

    def __and__(self, other: Any) -> Index:
        return self._with(other, self.builder.and_)

    def __rshift__(self, other: Any) -> Index:
        return self._with(other, self.builder.lshr)

    __radd__ = __add__
    __rmul__ = __mul__

    def __gt__(self, other: Any) -> Index:
        return self._compared(">", other)

    def __ge__(self, other: Any) -> Index:
        return self._compared(">=", other)

    def __lt__(self, other: Any) -> Index:
        return self._compared("<", other)

    def __ne__(self, other: object) -> Any:
        return self._compared("!=", other)

    __hash__ = None  # type: ignore[assignment]


class Number:
    """A number, or a vector of numbers, of the code under construction."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder = builder
        self.value = value

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
        return Number(
            self.builder, self.builder.call(call, [self.value, factor.value, summand.value])
        )

    def root(self) -> Number:
        """Return the square root."""
        return Number(
            self.builder,
            self.builder.call(_function(self.builder, "sqrt", self.value.type, 1), [self.value]),
        )

    def least(self, other: Number) -> Number:
        """Return the smaller one, element by element."""
        return Number(
            self.builder,
            self.builder.select(
                self.builder.fcmp_ordered("<", self.value, other.value), self.value, other.value
            ),
        )

    def largest(self, other: Number) -> Number:
        """Return the larger one, element by element."""
        return Number(
            self.builder,
            self.builder.select(
                self.builder.fcmp_ordered(">", self.value, other.value), self.value, other.value
            ),
        )

    def size(self) -> Number:
        """Return the absolute value, element by element."""
        return Number(
            self.builder,
            self.builder.call(_function(self.builder, "fabs", self.value.type, 1), [self.value]),
        )

    def elements(self) -> list[Number]:
        """Return the elements of a vector."""
        builder = self.builder
        places = [ir.Constant(PLACE, k) for k in range(self.value.type.count)]
        return [Number(builder, builder.extract_element(self.value, place)) for place in places]

    @property
    def count(self) -> int:
        """Number of elements, 0 of a number that is no vector."""
        return self.value.type.count if isinstance(self.value.type, ir.VectorType) else 0

    def folded(self) -> Number:
        """Return the sum of the vector's two halves."""
        half = self.count // 2
        undefined = ir.Constant(self.value.type, ir.Undefined)
        orders = (_order(range(first, first + half)) for first in (0, half))
        low, high = (
            Number(self.builder, self.builder.shuffle_vector(self.value, undefined, order))
            for order in orders
        )
        return low + high

    def total(self) -> Number:
        """Return the sum of the elements, whose number is a power of two.

        Halves are added until one element is left.
        """
        number = self
        while number.count > 2:
            number = number.folded()
        first, second = number.elements()
        return first + second

    def not_positive(self) -> Any:
        """Return an integer whose bit k says that element k is not above zero (or not a number)."""
        builder = self.builder
        count = self.value.type.count
        bits = builder.fcmp_unordered("<=", self.value, ir.Constant(self.value.type, [0.0] * count))
        return Index(builder, builder.zext(builder.bitcast(bits, ir.IntType(count)), INDEX))


class Complex(NamedTuple):
    """A complex number, or a vector of them."""

    real: Number
    imag: Number

    def times(self, other: Complex) -> Complex:
        """Return the product."""
        return Complex(
            self.real.fma(other.real, -(self.imag * other.imag)),
            self.real.fma(other.imag, self.imag * other.real),
        )

    def real_of_product(self, other: Complex) -> Number:
        """Return the real part of the product."""
        return self.real.fma(other.real, -(self.imag * other.imag))


class LoopVariable:
    """A `Number` or an `Index` that may be replaced, as within a loop."""

    def __init__(self, first: Any) -> None:
        self._kind = type(first)
        self._builder = first.builder
        self._place = cgutils.alloca_once_value(first.builder, first.value)

    @property
    def value(self) -> Any:
        """What it is now."""
        return self._kind(self._builder, self._builder.load(self._place))

    @value.setter
    def value(self, value: Any) -> None:
        self._builder.store(value.value, self._place)


class Sum:
    """A sum that a loop adds to: numbers, or vectors of any of some sizes."""

    def __init__(self, code: Code, sizes: Iterable[int]) -> None:
        self.parts = {size: code.variable(code.repeated(0.0, size)) for size in sizes}

    def __iadd__(self, summand: Number) -> Sum:
        part = self.parts[summand.count]
        part.value = part.value + summand
        return self

    def add_product(self, one: Number, other: Number) -> None:
        """Add the product of two, rounded once."""
        part = self.parts[one.count]
        part.value = one.fma(other, part.value)

    def number(self) -> Number:
        """Return the sum so far, vectors of other sizes folded to the smallest."""
        numbers: list[Number] = [
            self.parts[size].value for size in sorted(self.parts, reverse=True)
        ]
        total = numbers[0]
        for number in numbers[1:]:
            while total.count > number.count:
                total = total.folded()
            total += number
        return total

    def total(self) -> Number:
        """Return the sum of all elements so far."""
        return self.number().total()


class Fields:
    """A named tuple of the code under construction, with its fields by their names.

    Fields that are never read generate no code.
    """

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        self._context = context
        self._builder = builder
        self._kind = kind
        self._value = value

    def __getattr__(self, name: str) -> Any:
        place = self._kind.fields.index(name)
        return opened(
            self._context,
            self._builder,
            self._kind.types[place],
            self._builder.extract_value(self._value, place),
        )


def opened(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return an argument in the form that vector code takes.

    It is a pointer to the numbers of a contiguous array, a named tuple's `Fields`, None, or
    otherwise a number.
    """
    if isinstance(kind, types.Array):
        return context.make_array(kind)(context, builder, value).data
    if isinstance(kind, types.BaseNamedTuple):
        return Fields(context, builder, kind, value)
    if isinstance(kind, types.NoneType):
        return None
    return (Number if isinstance(kind, types.Float) else Index)(builder, value)


class Code:
    """Numbers and vectors of a function under construction."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context = context
        self.builder = builder
        self.lanes = LANES

    def loop(self, count: Any, step: int = 1, first: Any = 0) -> Iterator[Any]:
        """Repeat what follows for ``first``, ``first`` + ``step``, ... below ``count``."""
        start, stop, stride = (self.index(bound).value for bound in (first, count, step))
        with cgutils.for_range_slice(self.builder, start, stop, stride, inc=True) as (j, _):
            yield Index(self.builder, j)

    def where(self, condition: Any, likely: bool | None = None) -> Iterator[None]:
        """Do what follows if the condition holds, which is ``likely`` or not."""
        with self.builder.if_then(condition.value, likely):
            yield

    def either(self, condition: Any) -> Iterator[bool]:
        """Do what follows with True if the condition holds, else with False."""
        with self.builder.if_else(condition.value) as (then, otherwise):
            with then:
                yield True
            with otherwise:
                yield False

    def choose(self, condition: Any, one: Any, other: Any) -> Any:
        """Return one index if the condition holds, else the other."""
        return Index(
            self.builder,
            self.builder.select(condition.value, self.index(one).value, self.index(other).value),
        )

    def vectors(self, size: Any) -> Iterator[Any]:
        """Repeat the following code for the first slots, 2 LANES at a time, and for the rest.

        The rest are LANES slots, if they are left. ``lanes`` is the number of slots in the current
        repetition.
        """
        whole = size & -2 * LANES
        self.lanes = 2 * LANES
        yield from self.loop(whole, 2 * LANES)
        self.lanes = LANES
        for _ in self.where(whole != size):
            yield whole

    def single_vectors(self, size: Any) -> Iterator[Any]:
        """Repeat what follows for LANES slots each: half the code of `vectors`."""
        self.lanes = LANES
        yield from self.loop(size, LANES)

    def sum(self, *sizes: int) -> Sum:
        """Return a new sum over vectors of these sizes (0: numbers), by default over slots."""
        return Sum(self, sizes or (2 * LANES, LANES))

    def variable(self, first: Any) -> Any:
        """Return a new variable."""
        return LoopVariable(first if isinstance(first, Number) else self.index(first))

    def vector(self, pointer: Any, index: Any, size: int | None = None) -> Number:
        """Return ``size`` numbers from ``index`` on, None: as many as there are lanes."""
        return Number(
            self.builder,
            self.builder.load(self._place(pointer, index, size or self.lanes), align=8),
        )

    def store(self, vector: Number, pointer: Any, index: Any) -> None:
        """Write a vector from ``index`` on."""
        self.builder.store(vector.value, self._place(pointer, index, vector.count), align=8)

    def complex(self, pointer: Any, real: Any, imag: Any, size: int | None = None) -> Complex:
        """Return ``size`` complex numbers.

        Their real and imaginary parts are stored from ``real`` and ``imag`` on. If ``size`` is
        None, there are as many numbers as lanes.
        """
        return Complex(self.vector(pointer, real, size), self.vector(pointer, imag, size))

    def store_complex(self, vector: Complex, pointer: Any, real: Any, imag: Any) -> None:
        """Write complex numbers, their parts from ``real`` and from ``imag`` on."""
        self.store(vector.real, pointer, real)
        self.store(vector.imag, pointer, imag)

    def number(self, pointer: Any, index: Any) -> Number:
        """Return one number."""
        return Number(self.builder, self.builder.load(self._at(pointer, index)))

    def put(self, number: Number, pointer: Any, index: Any) -> None:
        """Write one number."""
        self.builder.store(number.value, self._at(pointer, index))

    def repeated(self, number: float, size: int | None = None) -> Number:
        """Return a vector that repeats a known number, or the number itself for ``size`` 0."""
        if size == 0:
            return Number(self.builder, ir.Constant(DOUBLE, number))
        return self.constant([number] * (size or self.lanes))

    def spread(self, number: Number, size: int | None = None) -> Number:
        """Return a vector that repeats a number."""
        size = size or self.lanes
        undefined = ir.Constant(ir.VectorType(DOUBLE, size), ir.Undefined)
        first = self.builder.insert_element(undefined, number.value, ir.Constant(PLACE, 0))
        return Number(
            self.builder, self.builder.shuffle_vector(first, undefined, _order([0] * size))
        )

    def gather(self, numbers: list[Number]) -> Number:
        """Return a vector of these numbers."""
        value = ir.Constant(ir.VectorType(DOUBLE, len(numbers)), ir.Undefined)
        for k, number in enumerate(numbers):
            value = self.builder.insert_element(value, number.value, ir.Constant(PLACE, k))
        return Number(self.builder, value)

    def before(self, first: Number, vector: Number) -> Number:
        """Return a vector moved on by one element, with ``first`` in front."""
        size = vector.count
        order = _order([size, *range(size - 1)])
        return Number(
            self.builder,
            self.builder.shuffle_vector(vector.value, self.spread(first, size).value, order),
        )

    def constant(self, numbers: Iterable[float]) -> Number:
        """Return a vector of known numbers."""
        values = list(numbers)
        return Number(self.builder, ir.Constant(ir.VectorType(DOUBLE, len(values)), values))

    def index(self, index: Any) -> Any:
        """Return an index, which may be a known number, as one of the code."""
        return index if isinstance(index, Index) else Index(self.builder, ir.Constant(INDEX, index))

    def as_number(self, index: Any) -> Number:
        """Return an index as a number."""
        return Number(self.builder, self.builder.sitofp(index.value, DOUBLE))

    def lowest_bit(self, mask: Any) -> Any:
        """Return the place of the lowest bit that is set; 64 where there is none."""
        return Index(self.builder, self.builder.cttz(mask.value, ir.Constant(ir.IntType(1), 0)))

    def atomic_rmw(self, change: str, words: Any, place: Any, value: Any) -> Any:
        """Change a word that threads share, and return its previous value.

        The change is "add" or "xchg". Everything that was written before the previous value is
        visible afterwards.
        """
        return Index(
            self.builder,
            self.builder.atomic_rmw(change, self._at(words, place), value.value, "seq_cst"),
        )

    def call(self, address: Any) -> None:
        """Call a function without arguments and result at an address in memory."""
        kind = ir.FunctionType(ir.VoidType(), [])
        self.builder.call(self.builder.inttoptr(address.value, kind.as_pointer()), [])

    def _at(self, pointer: Any, index: Any) -> Any:
        return self.builder.gep(pointer, [self.index(index).value])

    def _place(self, pointer: Any, index: Any, size: int) -> Any:
        return self.builder.bitcast(
            self._at(pointer, index), ir.VectorType(DOUBLE, size).as_pointer()
        )


def _order(elements: Iterable[int]) -> Any:
    values = list(elements)
    return ir.Constant(ir.VectorType(PLACE, len(values)), values)
