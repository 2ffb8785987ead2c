"""The language of vector_code.py for runs without compilation (NUMBA_DISABLE_JIT=1).

NumPy executes each operation immediately, with bitwise equal results.

Methods that vector_code.py builds from other methods, such as sums, are inherited. Loops and
branches are those of Python, and a debugger shows numbers.
"""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any

import numpy as np

from impact_env.kernels.compiling.vector_code import LANES, Code, Number


@cache
def fused() -> Callable[[float, float, float], float]:
    """Return a function fma(a, b, c) = a b + c of floats, rounded once.

    It is the function of the C library, else ``math.fma`` of Python 3.13 and later.

    Raises RuntimeError if neither rounds once: results would differ from those of compiled kernels.
    """
    for find in (_of_the_library, lambda: math.fma):  # type: ignore[attr-defined]
        try:
            fma: Callable[[float, float, float], float] = find()
        except (OSError, AttributeError):
            continue
        if fma(1.0 + 2.0**-30, 1.0 + 2.0**-30, -1.0 - 2.0**-29) == 2.0**-60:
            return fma
    raise RuntimeError(
        "NUMBA_DISABLE_JIT=1: kernels in plain Python need a fused multiplication and "
        "addition, which neither the C library nor Python (math.fma, "
        "from 3.13 on) offers here. Without it their results would differ from compiled ones; "
        "leave NUMBA_DISABLE_JIT unset, or take a newer Python"
    )


def _of_the_library() -> Callable[[float, float, float], float]:
    fma = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fma
    fma.argtypes = [ctypes.c_double] * 3
    fma.restype = ctypes.c_double
    return fma


class PlainNumber(Number):
    """A number (``value`` is a float64) or a vector (``value`` is an array of them)."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def _with(self, other: Number, operation: Any) -> PlainNumber:
        return PlainNumber(operation(self.value, other.value))

    def __add__(self, other: Number) -> PlainNumber:
        return self._with(other, np.add)

    def __sub__(self, other: Number) -> PlainNumber:
        return self._with(other, np.subtract)

    def __mul__(self, other: Number) -> PlainNumber:
        return self._with(other, np.multiply)

    def __truediv__(self, other: Number) -> PlainNumber:
        return self._with(other, np.divide)

    def __neg__(self) -> PlainNumber:
        return PlainNumber(-self.value)

    def __repr__(self) -> str:
        return str(self.value)

    def fma(self, factor: Number, summand: Number) -> PlainNumber:
        numbers = (self.value, factor.value, summand.value)
        fma = fused()
        if self.count == 0:
            return PlainNumber(np.float64(fma(*numbers)))
        return PlainNumber(
            np.array(
                [fma(*each) for each in zip(*(number.tolist() for number in numbers), strict=True)]
            )
        )

    def root(self) -> PlainNumber:
        return PlainNumber(np.sqrt(self.value))

    def least(self, other: Number) -> PlainNumber:
        return PlainNumber(np.where(self.value < other.value, self.value, other.value))

    def largest(self, other: Number) -> PlainNumber:
        return PlainNumber(np.where(self.value > other.value, self.value, other.value))

    def size(self) -> PlainNumber:
        return PlainNumber(np.abs(self.value))

    def elements(self) -> list[Number]:
        return [PlainNumber(number) for number in self.value]

    @property
    def count(self) -> int:
        return self.value.size if self.value.ndim else 0

    def folded(self) -> PlainNumber:
        low, high = np.split(self.value, 2)
        return PlainNumber(low + high)

    def not_positive(self) -> int:
        return sum(1 << k for k, number in enumerate(self.value) if not number > 0.0)


class PlainVariable:
    """A number or an index that later code may replace: ``value``."""

    def __init__(self, first: Any) -> None:
        self.value = first


class PlainFields:
    """A named tuple whose fields are read in the form that `opened` returns."""

    def __init__(self, group: Any) -> None:
        self._group = group

    def __getattr__(self, name: str) -> Any:
        return opened(getattr(self._group, name))


def opened(value: Any) -> Any:
    """Return an argument of a kernel in the form that vector code uses.

    An array becomes a flat view, a named tuple `PlainFields`, a float a `PlainNumber`; an int and
    None are returned as they are.
    """
    if isinstance(value, np.ndarray):
        return value.view().reshape(-1, copy=False)
    if isinstance(value, tuple):
        return PlainFields(value)
    return PlainNumber(np.float64(value)) if isinstance(value, float) else value


def _within(pointer: Any, index: int, count: int) -> slice:
    """Return the slice of ``count`` numbers of an array from an index on.

    Raises IndexError for positions beyond the array, where machine code would read or write other
    memory.
    """
    if not 0 <= index <= len(pointer) - count:
        raise IndexError(f"{count} numbers from {index} on are not in an array of {len(pointer)}")
    return slice(index, index + count)


class PlainCode(Code):
    """The operations of vector code, computed at once."""

    def __init__(self) -> None:
        self.lanes = LANES

    def loop(self, count: int, step: int = 1, first: int = 0) -> Iterator[int]:
        yield from range(first, count, step)

    def where(self, condition: bool, likely: bool | None = None) -> Iterator[None]:
        if condition:
            yield

    def either(self, condition: bool) -> Iterator[bool]:
        yield bool(condition)

    def choose(self, condition: bool, one: int, other: int) -> int:
        return one if condition else other

    def variable(self, first: Any) -> PlainVariable:
        return PlainVariable(first)

    def vector(self, pointer: Any, index: int, size: int | None = None) -> PlainNumber:
        return PlainNumber(pointer[_within(pointer, index, size or self.lanes)].copy())

    def store(self, vector: Number, pointer: Any, index: int) -> None:
        pointer[_within(pointer, index, vector.count)] = vector.value

    def number(self, pointer: Any, index: int) -> PlainNumber:
        return PlainNumber(pointer[_within(pointer, index, 1)][0])

    def put(self, number: Number, pointer: Any, index: int) -> None:
        pointer[_within(pointer, index, 1)] = number.value

    def repeated(self, number: float, size: int | None = None) -> PlainNumber:
        return PlainNumber(np.float64(number) if size == 0 else np.full(size or self.lanes, number))

    def spread(self, number: Number, size: int | None = None) -> PlainNumber:
        return PlainNumber(np.full(size or self.lanes, number.value))

    def gather(self, numbers: list[Number]) -> PlainNumber:
        return PlainNumber(np.array([number.value for number in numbers]))

    def before(self, first: Number, vector: Number) -> PlainNumber:
        return PlainNumber(np.append(first.value, vector.value[:-1]))

    def constant(self, numbers: Iterable[float]) -> PlainNumber:
        return PlainNumber(np.array(list(numbers), dtype=np.float64))

    def index(self, index: int) -> int:
        return index

    def as_number(self, index: int) -> PlainNumber:
        return PlainNumber(np.float64(index))

    def lowest_bit(self, mask: int) -> int:
        return (mask & -mask).bit_length() - 1 if mask else 64

    def atomic_rmw(self, change: str, words: Any, place: int, value: int) -> int:
        before = int(words[place])  # in plain Python one thread works
        words[place] = before + value if change == "add" else value
        return before

    def call(self, address: int) -> None:
        ctypes.CFUNCTYPE(None)(address)()
