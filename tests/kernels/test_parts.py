"""How kernels are compiled: one that Python calls in one piece with all that it calls, without what cannot be reached."""

import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba import typeof
from numba.core.caching import NullCache
from numba.core.errors import TypingError
from places import ROOT, SUPPORT

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room, jit_view
from impact_env.kernels.compiling.parts import _is_sparing
from impact_env.kernels.motion.level import Level
from impact_env.kernels.motion.observers import Energy, Events, Observe, Series


def fresh(kernel: Any) -> Any:
    """Give up a kernel's cache, so that it is compiled here."""
    kernel._cache = NullCache()
    return kernel


def diamond() -> tuple[Any, ...]:
    """Return kernels of which the last calls two that share the first, the one of them by way of another."""

    @fresh
    @jit
    def cube(x):
        return x * x * x

    @fresh
    @jit_inline
    def half(x):
        return 0.5 * cube(x)

    @fresh
    @jit
    def third(x):
        return half(x) + cube(x) / 3.0

    @fresh
    @jit_room
    def both(x):
        room = np.zeros(2)
        room[0], room[1] = half(x), third(x)
        return room.sum()

    return cube, half, third, both


def test_only_the_kernel_that_is_called_from_python_becomes_machine_code() -> None:
    cube, half, third, both = diamond()
    assert both(2.0) == pytest.approx(4.0 + 4.0 + 8.0 / 3.0)
    assert [len(kernel.overloads) for kernel in (cube, half, third, both)] == [0, 0, 0, 1]
    assert [len(kernel.part.overloads) for kernel in (cube, half, third, both)] == [1, 1, 1, 0]
    (whole,) = both.overloads.values()
    assert third(2.0) == pytest.approx(4.0 + 8.0 / 3.0)  # a part is compiled once more where Python asks for it
    assert len(third.overloads) == 1
    assert both(3.0) == pytest.approx(0.5 * 27 * 2 + 9.0)
    assert list(both.overloads.values()) == [whole]


def test_a_function_that_is_no_kernel_calls_kernels() -> None:
    _, _, third, _ = diamond()

    @numba.njit
    def twice(x: float) -> Any:
        return 2.0 * third(x)

    assert twice(2.0) == pytest.approx(2.0 * (4.0 + 8.0 / 3.0))


def test_a_branch_for_a_part_that_is_absent_is_not_typed_where_it_is_there() -> None:
    @fresh
    @jit
    def force(x, limit):
        if limit is None:
            return x.nothing  # does not compile
        return limit * x

    @fresh
    @jit
    def other(x, limit):
        return force(x, limit) if limit is not None else x

    assert other(2.0, 3.0) == 6.0
    assert other(2.0, None) == 2.0
    with pytest.raises(TypingError, match="nothing"):
        force(2.0, None)


def test_an_argument_that_may_be_none_keeps_both_branches() -> None:
    @numba.njit
    def some(x):
        return x if x > 0.0 else None

    @fresh
    @jit
    def size(limit):
        return -1.0 if limit is None else 1.0

    @fresh
    @jit
    def of(x):
        return size(some(x))

    assert (of(2.0), of(-2.0)) == (1.0, -1.0)


class Pair(NamedTuple):
    """A group of parts, each of which may be absent."""

    low: float | None
    high: float | None


class Nest(NamedTuple):
    """A group in a group."""

    pair: Pair
    factor: float


def by_name(pair, x):
    if pair.low is None:
        return pair.low.nothing  # does not compile
    if pair.high is not None:
        return pair.high.nothing
    return pair.low * x


def by_another_name(pair, x):
    low, high = pair.low, pair.high
    lacks = high is None
    if low is None or not lacks:
        return low.nothing
    return low * x


def in_one_expression(pair, x):
    return pair.low * x if pair.low is not None and pair.high is None else x.nothing


@jit_view
def dissolves(pair, x):
    if pair.high is None:
        return pair.low * x
    return pair.high.nothing


def in_a_function_that_dissolves(pair, x):
    return dissolves(pair, x)


@pytest.mark.parametrize("function", [by_name, by_another_name, in_one_expression, in_a_function_that_dissolves])
@pytest.mark.parametrize("decorate", [jit, jit_inline])
def test_a_branch_for_an_absent_field_of_a_group_is_not_typed(function: Callable[..., Any], decorate: Callable[..., Any]) -> None:
    leaf = fresh(decorate(function))

    @fresh
    @jit
    def of(x):
        return leaf(Pair(x, None), 2.0)

    assert of(3.0) == 6.0
    for other in (Pair(None, None), Pair(None, 3.0), Pair(3.0, 3.0)):
        with pytest.raises(TypingError, match=r"nothing|none"):
            leaf(other, 2.0)


def test_a_branch_for_an_absent_field_of_a_group_in_a_group_is_not_typed() -> None:
    @fresh
    @jit
    def of(nest, x):
        pair = nest.pair
        if nest.pair.low is None:
            return nest.pair.low.nothing
        if pair.high is not None:
            return pair.high.nothing
        return nest.pair.low * nest.factor * x

    assert of(Nest(Pair(3.0, None), 2.0), 5.0) == 30.0
    with pytest.raises(TypingError, match="nothing"):
        of(Nest(Pair(3.0, 1.0), 2.0), 5.0)


def test_a_field_that_may_be_none_keeps_both_branches() -> None:
    @numba.njit
    def some(x):
        return x if x > 0.0 else None

    @fresh
    @jit
    def size(pair):
        return (-1.0 if pair.low is None else 1.0) + (-10.0 if pair.high is None else 10.0)

    @fresh
    @jit
    def of(x, y):
        return size(Pair(some(x), some(y)))

    assert [of(x, y) for x in (2.0, -2.0) for y in (2.0, -2.0)] == [11.0, -9.0, 9.0, -11.0]


def test_a_name_that_is_a_field_only_at_times_keeps_both_branches() -> None:
    @fresh
    @jit
    def size(pair, x):
        high = pair.high
        if x > 0.0:
            high = x
        return -1.0 if high is None else 1.0

    assert [size(Pair(1.0, None), x) for x in (2.0, -2.0)] == [1.0, -1.0]
    assert [size(Pair(1.0, 3.0), x) for x in (2.0, -2.0)] == [1.0, 1.0]


def test_what_is_no_named_tuple_keeps_its_own_meaning() -> None:
    @fresh
    @jit
    def real(x, pair):
        first, _ = pair
        return 0.0 if x.real is None or pair is None or first is None else x.real

    assert real(3.0 + 4.0j, (1.0, 2.0)) == 3.0


def test_constants_share_a_part() -> None:
    @fresh
    @jit
    def power(x, n):
        return x**n

    @fresh
    @jit
    def sums(x):
        return power(x, 2) + power(x, 3)

    assert sums(2.0) == 12.0
    assert len(power.part.overloads) == 1


def test_an_error_in_a_part_reaches_python() -> None:
    @fresh
    @jit
    def refuse(x):
        if x < 0.0:
            raise ValueError("below zero")
        return x

    @fresh
    @jit
    def outer(x):
        return 2.0 * refuse(x)

    assert outer(1.0) == 2.0
    with pytest.raises(ValueError, match="below zero"):
        outer(-1.0)


# How far a kernel is inlined: decided by what it is given, and not by what a process has compiled before. All in fresh processes.


@cache
def compiled(*words: str) -> dict[str, list[str]]:
    """Return for each word the kernel's result, and then its instructions."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run([sys.executable, str(SUPPORT / "inlined.py"), *words], env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    return dict(zip(words, map(str.split, result.stdout.splitlines()), strict=True))


def test_machine_code_does_not_depend_on_what_was_compiled_before() -> None:
    first, last = compiled("bare", "sparing"), compiled("sparing", "bare")
    assert first["bare"] == last["bare"]
    assert first["sparing"] == last["sparing"]


def test_a_sparing_group_spares_copies_and_changes_no_digit() -> None:
    code = compiled("plain", "sparing")
    assert code["plain"][0] == code["sparing"][0] == compiled("bare", "sparing")["bare"][0]
    assert len(code["sparing"]) < len(code["plain"])  # by how much is the processor's: half on one with AVX-512, a few in a hundred without AVX


def test_energies_and_states_spare_and_cheaper_observers_do_not() -> None:
    level, energy = Level(np.zeros(3), np.zeros(1), np.zeros(2)), Energy(np.zeros(1), np.zeros(2))
    events = Events(np.zeros(1), np.zeros(1), np.zeros(1))
    cheap = Observe(1.0, (2, 3), level, events)
    assert not _is_sparing(typeof(cheap))
    assert _is_sparing(typeof(cheap._replace(energy=energy)))
    assert _is_sparing(typeof((1.0, cheap._replace(series=Series(np.zeros((2, 2)))))))
