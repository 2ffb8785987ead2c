"""A kernel that Python calls is compiled in one piece with all that it calls.

Code that cannot be reached is not compiled.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from core import drive_of, scene_of
from numba.core.caching import NullCache
from numba.core.dispatcher import _FunctionCompiler
from numba.core.errors import TypingError
from places import SUPPORT
from places import fresh as process

from impact_env.kernels.compiling import numba_check
from impact_env.kernels.compiling.jit import (
    jit,
    jit_allocating,
    jit_inline,
    jit_separate,
    jit_view,
)
from impact_env.kernels.compiling.numba_check import FIRST_UNTESTED, OLDEST_TESTED
from impact_env.kernels.exact.linear import linear_lane
from impact_env.results import Record, Window
from impact_env.sweep import simulate


def fresh(kernel: Any) -> Any:
    """Give up a kernel's cache, so that it is compiled here."""
    kernel._cache = NullCache()
    return kernel


def test_only_the_kernel_that_is_called_from_python_becomes_machine_code() -> None:
    """The last of four calls two that share the first, the one of them by way of another."""

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
    @jit_allocating
    def both(x):
        scratch = np.zeros(2)
        scratch[0] = half(x)
        scratch[1] = third(x)
        return scratch.sum()

    assert both(2.0) == pytest.approx(4.0 + 4.0 + 8.0 / 3.0)
    assert [len(kernel.overloads) for kernel in (cube, half, third, both)] == [0, 0, 0, 1]
    assert [len(kernel.part.overloads) for kernel in (cube, half, third, both)] == [1, 1, 1, 0]
    (whole,) = both.overloads.values()
    assert third(2.0) == pytest.approx(
        4.0 + 8.0 / 3.0
    )  # a part is compiled once more where Python asks for it
    assert len(third.overloads) == 1
    assert both(3.0) == pytest.approx(0.5 * 27 * 2 + 9.0)
    assert list(both.overloads.values()) == [whole]
    assert numba.njit(lambda x: 2.0 * third(x))(2.0) == pytest.approx(
        2.0 * (4.0 + 8.0 / 3.0)
    )  # a function that is no kernel


# --- a branch for what is absent, or there, is not typed: each of these has one that does not compile


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
        return pair.low.nothing
    if pair.high is not None:
        return pair.high.nothing
    return pair.low * x


def by_another_name(pair, x):
    low = pair.low
    high = pair.high
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


def in_a_group_in_a_group(pair, x):
    return nested(Nest(pair, 1.0), x)


@fresh
@jit
def nested(nest, x):
    pair = nest.pair
    if nest.pair.low is None:
        return nest.pair.low.nothing
    if pair.high is not None:
        return pair.high.nothing
    return nest.pair.low * nest.factor * x


def as_arguments(pair, x):
    return of_arguments(pair.low, pair.high, x)


@fresh
@jit
def of_arguments(low, high, x):
    if low is None:
        return low.nothing
    return low * x if high is None else high.nothing


LEAVES = [
    by_name,
    by_another_name,
    in_one_expression,
    in_a_function_that_dissolves,
    in_a_group_in_a_group,
    as_arguments,
]


@pytest.mark.parametrize("function", LEAVES)
@pytest.mark.parametrize("decorate", [jit, jit_inline])
def test_a_branch_for_what_is_absent_is_not_typed(
    function: Callable[..., Any], decorate: Callable[..., Any]
) -> None:
    leaf = fresh(decorate(function))

    @fresh
    @jit
    def of(x):
        return leaf(Pair(x, None), 2.0)

    assert of(3.0) == 6.0
    for other in (Pair(None, None), Pair(None, 3.0), Pair(3.0, 3.0)):
        with pytest.raises(TypingError, match=r"nothing|none"):
            leaf(other, 2.0)


@numba.njit
def some(x):
    return x if x > 0.0 else None


def test_what_may_be_none_keeps_both_branches() -> None:
    @fresh
    @jit
    def size(low, pair):
        return (-1.0 if low is None else 1.0) + (-10.0 if pair.high is None else 10.0)

    @fresh
    @jit
    def of(x, y):
        return size(some(x), Pair(1.0, some(y)))

    @fresh
    @jit
    def at_times(pair, x):
        high = pair.high
        if x > 0.0:
            high = x
        return -1.0 if high is None else 1.0

    assert [of(x, y) for x in (2.0, -2.0) for y in (2.0, -2.0)] == [11.0, -9.0, 9.0, -11.0]
    assert [at_times(Pair(1.0, None), x) for x in (2.0, -2.0)] == [1.0, -1.0]
    assert [at_times(Pair(1.0, 3.0), x) for x in (2.0, -2.0)] == [1.0, 1.0]


def test_constants_share_a_part_and_its_errors_reach_python() -> None:
    @fresh
    @jit
    def power(x, n):
        if x < 0.0:
            raise ValueError("below zero")
        return x**n

    @fresh
    @jit
    def sums(x):
        return power(x, 2) + power(x, 3)

    assert sums(2.0) == 12.0
    assert len(power.part.overloads) == 1
    with pytest.raises(ValueError, match="below zero"):
        sums(-1.0)


# --- how far a kernel is inlined: decided by what it is given, and not by what a process has compiled before


def compiled(*words: str) -> dict[str, list[str]]:
    """Return for each word the kernel's result, and then its instructions, from a fresh process."""
    lines = process(SUPPORT / "inlined.py", *words).stdout.splitlines()
    return dict(zip(words, map(str.split, lines), strict=True))


def test_machine_code_does_not_depend_on_what_was_compiled_before_and_a_sparing_group_spares_copies() -> (
    None
):
    first = compiled("bare", "sparing", "plain")
    last = compiled("sparing", "bare")
    assert {word: first[word] for word in last} == last
    assert first["plain"][0] == first["sparing"][0] == first["bare"][0]
    assert len(first["sparing"]) < len(
        first["plain"]
    )  # by how much is the processor's: half on one with AVX-512, a few in a hundred without AVX


@pytest.mark.parametrize(("decorate", "calls"), [(jit, 0), (jit_separate, 2)])
def test_a_separate_function_is_called_also_where_its_caller_is_inlined(
    decorate: Callable[..., Any], calls: int
) -> None:
    @fresh
    @decorate
    def far(x):
        total = x
        for k in range(7):
            total += np.sin(total * k) / (2.0 + np.cos(total + k)) + np.exp(-total * total)
            total -= np.cos(total * k) / (2.0 + np.sin(total - k)) + np.tan(total) * np.sqrt(k)
        return total

    @fresh
    @jit_inline
    def near(x):
        return far(x) + far(2.0 * x)

    @fresh
    @jit
    def whole(x):
        return near(x)

    assert whole(1.5) == near.py_func(1.5)
    code = whole.inspect_llvm(whole.signatures[0])
    assert len(re.findall(r"call .*far", code)) == calls


# --- without numba's internals


BEFORE_OLDEST = (OLDEST_TESTED[0], OLDEST_TESTED[1] - 1)
SMALL_KERNELS = """
import logging
logging.basicConfig(format="%(levelname)s %(message)s")
from typing import Any, NamedTuple
import numpy as np
from impact_env.kernels.compiling.jit import jit, jit_inline

class Group(NamedTuple):
    values: Any
    others: Any

@jit_inline
def total(group):
    if group.values is None:
        return 0.0
    if group.others is None:
        return group.values[0] + 1.0
    return group.values[0] + group.others[0]

@jit
def double(group):
    return 2.0 * total(group)

three, four = np.array([3.0]), np.array([4.0])
print(*(double(group) for group in (Group(None, None), Group(three, None), Group(three, four))))
print(type(double).__name__)
"""


def test_kernels_compile_by_documented_options_where_numba_has_other_internals(
    tmp_path: Path,
) -> None:
    """The same values, with branches on None pruned, and one warning."""
    file = tmp_path / "small_kernels.py"
    file.write_text(SMALL_KERNELS, encoding="utf-8")
    usual = process(file)
    documented = process(file, IMPACT_ENV_DOCUMENTED_NUMBA=1)
    assert usual.stdout.splitlines() == ["0.0 8.0 14.0", "Kernel"]
    assert documented.stdout.splitlines() == ["0.0 8.0 14.0", "CPUDispatcher"]
    assert usual.stderr.count("WARNING") == 0
    assert documented.stderr.count("documented options") == 1


@pytest.mark.parametrize(
    ("version", "missing", "expected"),
    [
        (FIRST_UNTESTED, None, "not one of the versions tested"),
        (BEFORE_OLDEST, None, "not one of the versions tested"),
        (OLDEST_TESTED, "_compile_core", "_FunctionCompiler._compile_core"),
        (OLDEST_TESTED, None, ""),
    ],
)
def test_other_versions_and_missing_internals_of_numba_are_noticed(
    monkeypatch: pytest.MonkeyPatch, version: tuple[int, int], missing: str | None, expected: str
) -> None:
    monkeypatch.delenv(numba_check.DOCUMENTED_ONLY, raising=False)
    monkeypatch.setattr(numba, "__version__", "{}.{}.1".format(*version))
    if missing is not None:
        monkeypatch.delattr(_FunctionCompiler, missing)
    obstacle = numba_check.find_obstacle.__wrapped__()
    assert expected in obstacle
    assert bool(obstacle) == bool(expected)


# --- one kernel for every record


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_one_kernel_serves_every_record_but_energies() -> None:
    """One kernel serves every record except energies.

    The test uses scenes without absorber, whose kernel is the smallest. All kinds of scenes have
    the same observers.
    """
    scene = scene_of(None, modes=2)
    drive = drive_of(1.0, 1.0, periods=3.0)
    simulate(scene, drive)
    kernels = set(linear_lane.signatures)
    for record in (
        Record(level=False),
        Record(events=True),
        Record(series=True),
        Record(series=Window(0.0, 0.01)),
        Record(envelope=3),
        Record(events=True, series=True, envelope=2),
    ):
        simulate(scene, drive, record=record)
    assert set(linear_lane.signatures) == kernels
