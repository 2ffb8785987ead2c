"""Checks of single values.

A check returns an allowed value. For any other it raises `ParameterError` with the name and the
value.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from numbers import Integral, Real
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Check = Callable[[str, Any], Any]  # (name, value) -> the value that is used

LARGEST_WRITTEN = 10**300  # Python refuses to write whole numbers of more than 4,300 digits
# products of several such numbers, and powers of order five, are still numbers
SMALL = 1e-30
LARGE = 1e30
MOST_NUMBERS = 2**25  # of an array, 0.27 GB
MOST_ITEMS = 10**6  # of a list, whose items are Python objects


class ParameterError(ValueError):
    """A parameter is out of range; the message names it, its value and what is allowed.

    Attributes
    ----------
    name : str or None
        The parameter as the message calls it; None if the message is about several.
    value : object
        Its value; None after the error has been pickled.
    allowed : str or None
        What is allowed, in words.
    argument : str or None
        The argument of the constructor or function, without an index.

    Examples
    --------
    >>> from impact_env import Beam, ParameterError
    >>> try:
    ...     Beam(length=-0.5)
    ... except ParameterError as error:
    ...     print(error.name, error.value)
    length -0.5
    """

    def __init__(
        self,
        message: str,
        name: str | None = None,
        value: object = None,
        allowed: str | None = None,
        argument: str | None = None,
    ) -> None:
        super().__init__(message)
        self.name = name
        self.value = value
        self.allowed = allowed
        if argument is None and name is not None:
            argument = re.split(r"[\['.]", name)[0].replace(" ", "_")
        self.argument = argument

    def __reduce__(self) -> tuple[Any, ...]:
        # a value that cannot be pickled must not keep a worker's error from its parent
        return type(self), (str(self), self.name, None, self.allowed, self.argument)

    def at_key(self, path: str, keys: Mapping[str, str]) -> "ParameterError":
        """Return this error with the argument's name replaced by its place in a file.

        ``path`` is the place of the table in the file ("structure.beam") and ``keys`` maps names of
        arguments to keys of that table. An error about several arguments, or about an argument
        without a key, keeps its message and has the path before it.
        """
        key = None if self.name is None or self.argument is None else keys.get(self.argument)
        if key is None:
            message = f"{path}: {self}"
            return type(self)(message, self.name, self.value, self.allowed, self.argument)
        index = re.search(r"[\['].*", self.name or "")
        return describe_error(
            f"{path}.{key}{index[0] if index else ''}", self.value, self.allowed or ""
        )


def describe_error(
    name: str, value: object, allowed: str, argument: str | None = None
) -> ParameterError:
    """Return the ParameterError "name = value is not allowed: allowed", without raising it.

    ``argument`` is the name of the caller's argument where ``name`` contains more than this name,
    such as an index.
    """
    message = f"{name} = {_written(value)} is not allowed: {allowed}"
    return ParameterError(message, name, value, allowed, argument)


def require(ok: bool, name: str, value: object, allowed: str, argument: str | None = None) -> None:
    """Raise ParameterError unless ``ok``.

    The message is "name = value is not allowed: allowed". ``argument`` is the name of the caller's
    argument where ``name`` contains more than this name, such as an index.
    """
    if not ok:
        raise describe_error(name, value, allowed, argument)


@contextmanager
def arguments_called(names: Mapping[str, str]) -> Iterator[None]:
    """Rename the argument of a ParameterError that is raised in this context.

    The arguments of a function are not always called like those of the class that the function
    makes. ``names`` maps the names of the class to those of the function.
    """
    try:
        yield
    except ParameterError as error:
        error.argument = names.get(error.argument or "", error.argument)
        raise


# functions by which errors write the values of some classes in words, not as Python would
DESCRIPTIONS: dict[type, Callable[[Any], str]] = {}


def _written(value: object) -> str:
    """Return a value as text for an error."""
    if isinstance(value, int) and abs(value) >= LARGEST_WRITTEN:
        return "a whole number of very many digits"
    if type(value) in DESCRIPTIONS:
        with suppress(Exception):  # a value that is not valid yet has no description
            return DESCRIPTIONS[type(value)](value)
    try:
        return repr(value)
    except ValueError:
        return f"{type(value).__name__} with a whole number of very many digits"
    except Exception:  # a repr of somebody else's class
        return f"an object of the kind {type(value).__name__}"


def _is_number(kind: type) -> bool:
    """Return whether objects of a class are real numbers: bools and NumPy's time spans are not."""
    return issubclass(kind, Real) and not issubclass(kind, bool | np.timedelta64)


def number(value: object) -> float:
    """Return a real number of any type as a float.

    Anything else, a bool, and a number that is too large for a float give NaN.
    """
    if not _is_number(type(value)):
        return math.nan
    try:
        return float(value)  # type: ignore[arg-type]
    except OverflowError:
        return math.nan


def positive(name: str, value: object, least: float = SMALL, most: float = LARGE) -> float:
    """Return ``value`` as a float if it lies from ``least`` to ``most``."""
    allowed = f"a finite number above 0, from {least:g} to {most:g}"
    return within(name, value, least, most, allowed)


def non_negative(name: str, value: object, most: float = LARGE) -> float:
    """Return ``value`` as a float if it lies from 0 to ``most``."""
    return within(name, value, 0.0, most, f"a finite number, 0 or above and at most {most:g}")


def finite(name: str, value: object) -> float:
    """Return ``value`` as a float if it lies from -1e30 to 1e30."""
    allowed = f"a finite number, from -{LARGE:g} to {LARGE:g}"
    return within(name, value, -LARGE, LARGE, allowed)


def fraction(name: str, value: object) -> float:
    """Return ``value`` as a float if it lies in (0, 1]."""
    # the smallest float above 0
    return within(name, value, math.ulp(0.0), 1.0, "a number in (0, 1]")


def within(name: str, value: object, least: float, most: float, allowed: str) -> float:
    """Return ``value`` as a float if it lies from ``least`` to ``most``.

    ``allowed`` describes the allowed values in the error's message.
    """
    result = number(value)
    require(least <= result <= most, name, value, allowed)
    return result


def count(
    name: str, value: object, low: int, high: int | None = None, allowed: str | None = None
) -> int:
    """Return ``value`` as an int if it is a whole number in [low, high].

    ``allowed`` describes the allowed values in the error's message.
    """
    if allowed is None:
        allowed = f"a whole number, {low} or more"
        if high is not None:
            allowed = f"a whole number from {low} to {high}"
    require(isinstance(value, Integral) and _is_number(type(value)), name, value, allowed)
    result = int(value)  # type: ignore[call-overload]
    require(result >= low and (high is None or result <= high), name, value, allowed)
    return int(result)


def flag(name: str, value: object) -> bool:
    """Return ``value`` as a bool if it is True or False."""
    require(isinstance(value, bool | np.bool_), name, value, "True or False")
    return bool(value)


def instance(name: str, value: T, kinds: object) -> T:
    """Return ``value`` if it is an object of a class in ``kinds``.

    ``kinds`` is a class, or several classes joined by ``|``.
    """
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
    """Return the items of an ordered collection, such as a list or a tuple, as a tuple.

    Text and bytes are not allowed.
    """
    ok = (
        isinstance(values, Iterable)
        and not isinstance(values, str | BYTES | Mapping | Set)
        and getattr(values, "ndim", 1) == 1
        and not _has_masked(values)
    )
    require(ok, name, values, "a list or tuple")
    items = tuple(islice(values, MOST_ITEMS + 1))
    require(len(items) <= MOST_ITEMS, f"length of {name}", len(items), f"at most {MOST_ITEMS}")
    return items


def two(name: str, values: Iterable[float]) -> tuple[float, float]:
    """Return a range (low, high) of two finite numbers, low below high, as floats."""
    items = listed(name, values)
    low, high = (*map(number, items), math.nan, math.nan)[:2]
    require(
        len(items) == 2 and -LARGE <= low < high <= LARGE,
        name,
        values,
        "(low, high), two finite numbers with low below high",
    )
    return low, high


BYTES = bytes | bytearray | memoryview


def _has_masked(values: object) -> bool:
    """Return whether a NumPy array has masked entries.

    A plain array would show masked entries as numbers.
    """
    return isinstance(values, np.ma.MaskedArray) and bool(np.ma.getmaskarray(values).any())


def _has_numbers_only(values: object) -> bool:
    """Return whether nested lists contain only real numbers.

    NumPy would accept True as 1 among numbers, so bools are refused here.
    """
    if isinstance(values, np.ndarray):
        return values.dtype.kind in "iuf" and not _has_masked(values)
    if isinstance(values, str | BYTES | bool | np.bool_ | np.timedelta64):
        return False
    if isinstance(values, Sequence):
        kinds = set(map(type, values)) if len(values) <= MOST_NUMBERS else {object}
        inner = any(issubclass(kind, Sequence | np.ndarray) for kind in kinds)
        return all(map(_has_numbers_only, values)) if inner else all(map(_is_number, kinds))
    return True  # the data type of its array says the rest


def numbers(name: str, values: object, allowed: str) -> NDArray[np.float64]:
    """Return an array of floats of any shape, in which NaN and infinity are allowed.

    Raises ParameterError for anything that is not made of real numbers.
    """
    size = getattr(values, "size", 0)
    most = f"at most {MOST_NUMBERS} numbers"
    require(not isinstance(size, int) or size <= MOST_NUMBERS, f"size of {name}", size, most)
    array = np.array(None)
    if _has_numbers_only(values):
        # rows of several lengths, or huge numbers
        with suppress(ValueError, TypeError, OverflowError):
            array = np.array(values)
    require(array.dtype.kind in "iuf", name, values, allowed)
    return array.astype(np.float64)


def row(name: str, values: object, allowed: str, axes: int = 1) -> NDArray[np.float64]:
    """Return a read-only copy of an array of numbers from -1e30 to 1e30 with ``axes`` axes.

    A single number gives an array of one number.
    """
    array = np.atleast_1d(numbers(name, values, allowed))
    require(array.ndim == axes and bool(np.all(np.abs(array) <= LARGE)), name, values, allowed)
    array.setflags(write=False)
    return array


def text(name: str, value: object) -> str:
    """Return ``value`` as a str if it is text."""
    require(isinstance(value, str), name, value, "text")
    return str(value)


def count_from(low: int, high: int | None = None) -> Check:
    """Return the check of a whole number in [low, high]."""
    return partial(count, low=low, high=high)


def word_of(allowed: Iterable[str]) -> Check:
    """Return the check of one of the words ``allowed``."""
    return partial(one_of, allowed=allowed)


def kind_of(kinds: object) -> Check:
    """Return the check of an object of a class, or of one of those that are joined by ``|``."""
    return partial(instance, kinds=kinds)


def or_none(check: Check) -> Check:
    """Return a check that accepts None, for what is absent, beside what ``check`` accepts."""
    return lambda name, value: None if value is None else check(name, value)


def each_of(check: Check) -> Check:
    """Return the check of a list or tuple whose items all pass ``check``; the value is a tuple."""
    return lambda name, values: tuple(check(name, value) for value in listed(name, values))


def table_of(check: Check) -> Check:
    """Return the check of a mapping whose values all pass ``check``; the value is a dict."""
    return lambda name, values: {
        key: check(f"{name}[{key}]", value)
        for key, value in instance(name, values, Mapping).items()
    }


def row_of(allowed: str, axes: int = 1) -> Check:
    """Return the check of an array of that many axes, see `row`."""
    return partial(row, allowed=allowed, axes=axes)


def labelled(label: str, check: Check) -> Check:
    """Return a check whose error calls the parameter by a label."""
    return lambda _name, value: check(label, value)
