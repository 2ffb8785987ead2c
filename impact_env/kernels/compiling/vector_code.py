"""A small language for vector code: loops over slots or times with vector instructions.

Results do not depend on which other code is compiled in the same library.

numba's own loops become vector instructions only if sums may be reordered and products contracted.
Then the compiler chooses an order in each library that contains a function, so that one source has
several results. Here the order is written down and nothing is reordered; product and sum are
rounded together only in ``fma``, on any processor.

A function of the language runs once, when a kernel is compiled: each operation emits LLVM's code. A
``for`` over `Code.loop`, `Code.where` or `Code.either` emits a loop or a branch around the code of
its body. The classes of plain_code.py have the same methods and compute at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import cgutils, types

LANES = 4  # numbers in a vector; the number of slots is padded to a multiple of it

DOUBLE = ir.DoubleType()
INDEX = ir.IntType(64)
PLACE = ir.IntType(32)  # position of an element within a vector


def _function(builder: Any, name: str, kind: Any, arguments: int) -> Any:
    """Return LLVM's function called ``name`` for numbers or vectors of the type ``kind``."""
    suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
    return cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [kind] * arguments), f"llvm.{name}.{suffix}"
    )


class Index:
    """An integer, or the result of a comparison, that the emitted code computes.

    The other operand of an operation may be an int of Python.
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
    """A float64, or a vector of them, that the emitted code computes.

    Both operands of an operation have the same size (`count`).
    """

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
        """Return the smaller number, element by element; ``other`` if either is not a number."""
        return Number(
            self.builder,
            self.builder.select(
                self.builder.fcmp_ordered("<", self.value, other.value), self.value, other.value
            ),
        )

    def largest(self, other: Number) -> Number:
        """Return the larger number, element by element; ``other`` if either is not a number."""
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
        """Number of elements of a vector, 0 of a single number."""
        return self.value.type.count if isinstance(self.value.type, ir.VectorType) else 0

    def folded(self) -> Number:
        """Return a vector of half the size: the sum of the vector's two halves."""
        half = self.count // 2
        undefined = ir.Constant(self.value.type, ir.Undefined)
        orders = (_order(range(first, first + half)) for first in (0, half))
        low, high = (
            Number(self.builder, self.builder.shuffle_vector(self.value, undefined, order))
            for order in orders
        )
        return low + high

    def total(self) -> Number:
        """Return the sum of the elements of a vector, whose size is a power of two.

        Halves are added until one number is left.
        """
        number = self
        while number.count > 2:
            number = number.folded()
        first, second = number.elements()
        return first + second

    def not_positive(self) -> Any:
        """Return an `Index` whose bit k is set if element k is zero, negative or not a number."""
        builder = self.builder
        count = self.value.type.count
        bits = builder.fcmp_unordered("<=", self.value, ir.Constant(self.value.type, [0.0] * count))
        return Index(builder, builder.zext(builder.bitcast(bits, ir.IntType(count)), INDEX))


class Complex(NamedTuple):
    """A complex number, or a vector of complex numbers."""

    real: Number
    imag: Number

    def times(self, other: Complex) -> Complex:
        """Return the product, with one fused operation in each part."""
        return Complex(
            self.real.fma(other.real, -(self.imag * other.imag)),
            self.real.fma(other.imag, self.imag * other.real),
        )

    def real_of_product(self, other: Complex) -> Number:
        """Return the real part of the product, as of `times`."""
        return self.real.fma(other.real, -(self.imag * other.imag))


class LoopVariable:
    """A `Number` or an `Index` that later code may replace, such as in each turn of a loop."""

    def __init__(self, first: Any) -> None:
        self._kind = type(first)
        self._builder = first.builder
        self._place = cgutils.alloca_once_value(first.builder, first.value)

    @property
    def value(self) -> Any:
        """The current value; assign to it to replace it."""
        return self._kind(self._builder, self._builder.load(self._place))

    @value.setter
    def value(self, value: Any) -> None:
        self._builder.store(value.value, self._place)


class Sum:
    """A sum that begins at 0, with a part for each size of summands (0: numbers).

    Add by ``+=`` or `add_product`; the part of a summand is that of its size.
    """

    def __init__(self, code: Code, sizes: Iterable[int]) -> None:
        self.parts = {size: code.variable(code.repeated(0.0, size)) for size in sizes}

    def __iadd__(self, summand: Number) -> Sum:
        part = self.parts[summand.count]
        part.value = part.value + summand
        return self

    def add_product(self, one: Number, other: Number) -> None:
        """Add the product of two numbers or vectors by a fused operation, rounded once."""
        part = self.parts[one.count]
        part.value = one.fma(other, part.value)

    def number(self) -> Number:
        """Return the sum so far, with larger vectors folded to the smallest size."""
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
        """Return the sum of all elements so far, a single number."""
        return self.number().total()


class Fields:
    """A named tuple in the emitted code; its fields are read by their names, as of `opened`.

    Fields that are never read emit no code.
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
    """Return an argument of a kernel in the form that vector code uses.

    An array, which must be contiguous, becomes a pointer to its numbers, a named tuple `Fields`, a
    float a `Number`, an integer an `Index`; None stays None. ``kind`` is the numba type.
    """
    if isinstance(kind, types.Array):
        return context.make_array(kind)(context, builder, value).data
    if isinstance(kind, types.BaseNamedTuple):
        return Fields(context, builder, kind, value)
    if isinstance(kind, types.NoneType):
        return None
    return (Number if isinstance(kind, types.Float) else Index)(builder, value)


class Code:
    """The operations of vector code that emit LLVM's code of a function.

    ``lanes`` is the size of vectors where none is given. Indices may be an `Index` or an int.
    """

    def __init__(self, context: Any, builder: Any) -> None:
        self.context = context
        self.builder = builder
        self.lanes = LANES

    def loop(self, count: Any, step: int = 1, first: Any = 0) -> Iterator[Any]:
        """Repeat the body of a ``for`` for the indices first, first + step, ... below ``count``."""
        start, stop, stride = (self.index(bound).value for bound in (first, count, step))
        with cgutils.for_range_slice(self.builder, start, stop, stride, inc=True) as (j, _):
            yield Index(self.builder, j)

    def where(self, condition: Any, likely: bool | None = None) -> Iterator[None]:
        """Execute the body of a ``for`` once if the condition holds, else not.

        ``likely`` is a hint for the compiler: True, False, or None for no hint.
        """
        with self.builder.if_then(condition.value, likely):
            yield

    def either(self, condition: Any) -> Iterator[bool]:
        """Execute the body of a ``for`` once: with True if the condition holds, else with False.

        The body is emitted twice, once for each branch.
        """
        with self.builder.if_else(condition.value) as (then, otherwise):
            with then:
                yield True
            with otherwise:
                yield False

    def choose(self, condition: Any, one: Any, other: Any) -> Any:
        """Return the index ``one`` if the condition holds, else ``other``."""
        return Index(
            self.builder,
            self.builder.select(condition.value, self.index(one).value, self.index(other).value),
        )

    def vectors(self, size: Any) -> Iterator[Any]:
        """Repeat the body of a ``for`` for ``size`` slots, 2 LANES at a time.

        ``size`` is a multiple of LANES; LANES slots that are left over follow at the end. The loop
        variable is the index of the first slot, and ``lanes`` the number of slots, of each
        repetition.
        """
        whole = size & -2 * LANES
        self.lanes = 2 * LANES
        yield from self.loop(whole, 2 * LANES)
        self.lanes = LANES
        for _ in self.where(whole != size):
            yield whole

    def single_vectors(self, size: Any) -> Iterator[Any]:
        """Repeat the body of a ``for`` for ``size`` slots, LANES at a time.

        This emits half the code of `vectors`.
        """
        self.lanes = LANES
        yield from self.loop(size, LANES)

    def sum(self, *sizes: int) -> Sum:
        """Return a new `Sum` for these sizes (0: numbers), by default the sizes of `vectors`."""
        return Sum(self, sizes or (2 * LANES, LANES))

    def variable(self, first: Any) -> Any:
        """Return a new `LoopVariable` with the value ``first``."""
        return LoopVariable(first if isinstance(first, Number) else self.index(first))

    def vector(self, pointer: Any, index: Any, size: int | None = None) -> Number:
        """Return a vector of ``size`` numbers of an array from ``index`` on; None: ``lanes``."""
        return Number(
            self.builder,
            self.builder.load(self._place(pointer, index, size or self.lanes), align=8),
        )

    def store(self, vector: Number, pointer: Any, index: Any) -> None:
        """Write a vector to an array from ``index`` on."""
        self.builder.store(vector.value, self._place(pointer, index, vector.count), align=8)

    def complex(self, pointer: Any, real: Any, imag: Any, size: int | None = None) -> Complex:
        """Return a vector of ``size`` complex numbers; None: ``lanes``.

        Real and imaginary parts are read from the indices ``real`` and ``imag`` on.
        """
        return Complex(self.vector(pointer, real, size), self.vector(pointer, imag, size))

    def store_complex(self, vector: Complex, pointer: Any, real: Any, imag: Any) -> None:
        """Write a vector of complex numbers to the indices from ``real`` and from ``imag`` on."""
        self.store(vector.real, pointer, real)
        self.store(vector.imag, pointer, imag)

    def number(self, pointer: Any, index: Any) -> Number:
        """Return the number of an array at ``index``."""
        return Number(self.builder, self.builder.load(self._at(pointer, index)))

    def put(self, number: Number, pointer: Any, index: Any) -> None:
        """Write a number to an array at ``index``."""
        self.builder.store(number.value, self._at(pointer, index))

    def repeated(self, number: float, size: int | None = None) -> Number:
        """Return a vector that repeats a float of Python; ``size`` 0: a single number."""
        if size == 0:
            return Number(self.builder, ir.Constant(DOUBLE, number))
        return self.constant([number] * (size or self.lanes))

    def spread(self, number: Number, size: int | None = None) -> Number:
        """Return a vector of ``size`` elements, None: ``lanes``, that repeats a `Number`."""
        size = size or self.lanes
        undefined = ir.Constant(ir.VectorType(DOUBLE, size), ir.Undefined)
        first = self.builder.insert_element(undefined, number.value, ir.Constant(PLACE, 0))
        return Number(
            self.builder, self.builder.shuffle_vector(first, undefined, _order([0] * size))
        )

    def gather(self, numbers: list[Number]) -> Number:
        """Return a vector whose elements are these numbers."""
        value = ir.Constant(ir.VectorType(DOUBLE, len(numbers)), ir.Undefined)
        for k, number in enumerate(numbers):
            value = self.builder.insert_element(value, number.value, ir.Constant(PLACE, k))
        return Number(self.builder, value)

    def before(self, first: Number, vector: Number) -> Number:
        """Return a vector of the same size: ``first``, then all elements but the last."""
        size = vector.count
        order = _order([size, *range(size - 1)])
        return Number(
            self.builder,
            self.builder.shuffle_vector(vector.value, self.spread(first, size).value, order),
        )

    def constant(self, numbers: Iterable[float]) -> Number:
        """Return a vector of floats of Python."""
        values = list(numbers)
        return Number(self.builder, ir.Constant(ir.VectorType(DOUBLE, len(values)), values))

    def index(self, index: Any) -> Any:
        """Return an `Index` or an int as an `Index`."""
        return index if isinstance(index, Index) else Index(self.builder, ir.Constant(INDEX, index))

    def as_number(self, index: Any) -> Number:
        """Return an `Index` as a `Number`."""
        return Number(self.builder, self.builder.sitofp(index.value, DOUBLE))

    def lowest_bit(self, mask: Any) -> Any:
        """Return the position of the lowest bit that is set, from 0 on; 64 if none is set."""
        return Index(self.builder, self.builder.cttz(mask.value, ir.Constant(ir.IntType(1), 0)))

    def atomic_rmw(self, change: str, words: Any, place: Any, value: Any) -> Any:
        """Change entry ``place`` of an int64 array that threads share; return its old value.

        The change is "add" or "xchg" (replace). All that the thread which wrote the old value had
        written before is visible afterwards.
        """
        return Index(
            self.builder,
            self.builder.atomic_rmw(change, self._at(words, place), value.value, "seq_cst"),
        )

    def call(self, address: Any) -> None:
        """Call the function at an address in memory, which has no arguments and no result."""
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
