"""Validation of single values: a check returns an allowed value and raises `ParameterError`, with name and value, for any other."""

import math
from collections.abc import Callable, Iterable, Mapping, Set
from numbers import Integral, Real
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


class ParameterError(ValueError):
    """A parameter is out of range; the message names it, its value and what is allowed."""


def require(ok: bool, name: str, value: object, allowed: str) -> None:
    """Raise ParameterError unless ``ok``."""
    if not ok:
        raise ParameterError(f"{name} = {_shown(value)} is not allowed: {allowed}")


def _shown(value: object) -> str:
    """Return a value as text for an error; Python refuses to write whole numbers of more than 4,300 digits."""
    if isinstance(value, int) and abs(value) >= MOST_SHOWN:
        return "a whole number of very many digits"
    try:
        return repr(value)
    except ValueError:
        return f"{type(value).__name__} with a whole number of very many digits"


MOST_SHOWN = 10**300
# products of several such numbers, and powers of order five, are still numbers
SMALL = 1e-30
LARGE = 1e30


def number(value: object) -> float:
    """Return a real number of any type as a float, NaN for anything else and for what is too large; a bool is not a number."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def positive(name: str, value: object, least: float = SMALL, most: float = LARGE) -> float:
    """Return ``value`` as a float if it lies from ``least`` to ``most``."""
    require(
        least <= number(value) <= most,
        name,
        value,
        f"a finite number above 0, from {least:g} to {most:g}",
    )
    return number(value)


def non_negative(name: str, value: object, most: float = LARGE) -> float:
    """Return ``value`` as a float if it lies from 0 to ``most``."""
    require(
        0 <= number(value) <= most, name, value, f"a finite number, 0 or above and at most {most:g}"
    )
    return number(value)


def finite(name: str, value: object) -> float:
    """Return ``value`` as a float if it lies from -1e30 to 1e30."""
    require(
        abs(number(value)) <= LARGE, name, value, f"a finite number, from -{LARGE:g} to {LARGE:g}"
    )
    return number(value)


def fraction(name: str, value: object) -> float:
    """Return ``value`` as a float if it lies in (0, 1]."""
    require(0 < number(value) <= 1, name, value, "a number in (0, 1]")
    return number(value)


def count(name: str, value: object, low: int, high: int | None = None) -> int:
    """Return ``value`` as an int if it is a whole number in [low, high]."""
    allowed = (
        f"a whole number, {low} or more" if high is None else f"a whole number from {low} to {high}"
    )
    ok = isinstance(value, Integral) and not isinstance(value, bool)
    require(ok and value >= low and (high is None or value <= high), name, value, allowed)  # type: ignore[operator]
    return int(value)  # type: ignore[call-overload]


def flag(name: str, value: object) -> bool:
    """Return ``value`` as a bool if it is True or False."""
    require(isinstance(value, bool | np.bool_), name, value, "True or False")
    return bool(value)


def instance(name: str, value: T, kinds: object) -> T:
    """Return ``value`` if it is an object of a class, or of one of those that are joined by ``|``."""
    if not isinstance(value, kinds):  # type: ignore[arg-type]  # the words are for this alone: a short run asks twenty times
        words = [
            getattr(kind, "__name__", "").replace("NoneType", "None")
            for kind in get_args(kinds) or (kinds,)
        ]
        require(False, name, value, f"an object of the kind {' or '.join(words)}")
    return value


def one_of(name: str, value: object, allowed: Iterable[str]) -> str:
    """Return ``value`` if it is one of the words ``allowed``."""
    require(
        isinstance(value, str) and value in allowed, name, value, f"one of {', '.join(allowed)}"
    )
    return str(value)


def listed(name: str, values: Iterable[T]) -> tuple[T, ...]:
    """Return the items of a list, a tuple or another sequence that is no text."""
    ok = (
        isinstance(values, Iterable)
        and not isinstance(values, str | bytes | Mapping | Set)
        and getattr(values, "ndim", 1) == 1
    )
    require(ok, name, values, "a list or tuple")
    return tuple(values)


def two(name: str, values: Iterable[float]) -> tuple[float, float]:
    """Return a range (low, high) of two finite numbers, low below high, as floats."""
    low, high = (*map(number, listed(name, values)), math.nan, math.nan)[:2]
    require(
        len(listed(name, values)) == 2 and -LARGE <= low < high <= LARGE,
        name,
        values,
        "(low, high), two finite numbers with low below high",
    )
    return low, high


def row(name: str, values: object, allowed: str, axes: int = 1) -> NDArray[np.float64]:
    """Return a read-only copy of an array of that many axes, of numbers from -1e30 to 1e30; one number is a row of one."""
    try:
        array = np.array(values, ndmin=1)
    except (
        ValueError,
        OverflowError,
    ):  # rows of several lengths, or huge whole numbers among others
        array = np.array(None)
    ok = (
        array.ndim == axes
        and (array.dtype.kind in "iuf" or array.size == 0)
        and bool(np.all(np.abs(array.astype(float)) <= LARGE))
    )
    require(ok, name, values, allowed)
    array = array.astype(np.float64)
    array.setflags(write=False)
    return array


def check_each(group: object, **checks: Callable[[str, Any], object]) -> None:
    """Check attributes of an object, each by one of the functions above."""
    for name, check in checks.items():
        check(name, getattr(group, name))


def keep_checked(group: object, **checks: Callable[[str, Any], object]) -> None:
    """Replace attributes of a frozen dataclass by what their checks return, in its ``__post_init__``."""
    for name, check in checks.items():
        object.__setattr__(group, name, check(name, getattr(group, name)))
