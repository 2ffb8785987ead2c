"""The decorators of all kernels.

Five are for functions that numba compiles, one is for functions in the language of vector code.

Nothing is compiled with numba's fastmath. Where the compiler may reorder sums or contract products
it does so anew in every library that a function gets into, and of several copies of a function the
one that was loaded first serves all: results would depend on what a process ran before.

Under NUMBA_DISABLE_JIT=1 nothing is compiled: each decorator returns a function of plain Python
that gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from inspect import signature
from typing import Any, TypeVar

import numba
from numba.core import types
from numba.extending import intrinsic

from impact_env.kernels.compiling.numba_check import compile_documented, find_obstacle
from impact_env.kernels.compiling.plain_code import PlainCode, PlainNumber
from impact_env.kernels.compiling.plain_code import opened as at_hand
from impact_env.kernels.compiling.vector_code import Code, opened

_F = TypeVar("_F", bound=Callable[..., Any])
COMPILED = not numba.config.DISABLE_JIT
INTEGER = types.int64
NUMBER = types.float64
_KINDS = {"Index": INTEGER, "Number": NUMBER}  # by the annotation

# Without numba's reference counts, whose atomic operations cost a fifth of an exact lane: such a
# function must not make or return an array. And without the wrapper for callers in C.
_PLAIN: dict[str, Any] = {
    "nogil": True,
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "_nrt": False,
}


def _njit(**options: Any) -> Callable[[Any], Any]:
    if not COMPILED:
        return lambda function: function
    if find_obstacle():
        return lambda function: compile_documented(function, **options)
    from impact_env.kernels.compiling.cache import attach_cache
    from impact_env.kernels.compiling.numba_internals import kernel

    return lambda function: attach_cache(kernel(function, **options))


def jit(function: _F) -> _F:
    """Compile a function that makes no arrays.

    fastmath is never used. Sums over slots are written as vector code (vector_code.py).
    """
    return _njit(**_PLAIN)(function)  # type: ignore[no-any-return]


def jit_allocating(function: _F) -> _F:
    """Compile like `jit` a function that makes or returns arrays, or that calls such a function.

    Such a function is called once a run and never in a loop.
    """
    return _njit(**{**_PLAIN, "_nrt": True})(function)  # type: ignore[no-any-return]


def jit_inline(function: _F) -> _F:
    """Compile like `jit` and inline at every call: small functions in the innermost loop."""
    return _njit(**_PLAIN, forceinline=True)(function)  # type: ignore[no-any-return]


def jit_separate(function: _F) -> _F:
    """Compile like `jit`, as a function of its own also where its caller is inlined.

    It is for large functions outside the innermost loops. Each copy of one, with copies of all that
    it calls, would add to the time of compilation.
    """
    return _njit(**_PLAIN, forceinline=False)(function)  # type: ignore[no-any-return]


def jit_view(function: _F) -> _F:
    """Compile like `jit`, and always inline on numba's level.

    It is for helper functions that return views, which select arrays from larger ones.
    """
    return _njit(**_PLAIN, inline="always")(function)  # type: ignore[no-any-return]


def vector_code(kind: Any = types.void, several: int = 0) -> Callable[[Callable[..., Any]], Any]:
    """Make a function that kernels call from a function of `Code` and of arguments.

    The new function takes the arguments only. It returns a ``kind``, or a tuple of ``several`` of
    this kind.

    An argument annotated as an `Index` or a `Number` is taken for a whole or a floating number;
    arrays and named tuples have no annotation. The function returns a `Number`, an `Index`, a list
    of such or nothing.
    """
    returns = types.UniTuple(kind, several) if several else kind

    def decorate(function: Callable[..., Any]) -> Any:
        _, *parameters = signature(function).parameters.values()
        kinds = [_KINDS.get(parameter.annotation) for parameter in parameters]
        return (_compiled if COMPILED else _in_plain_python)(function, kinds, returns)

    return decorate


def _compiled(function: Callable[..., Any], kinds: list[Any], returns: Any) -> Any:
    def typed(typing_context: Any, *argument_types: Any) -> Any:
        return returns(
            *(
                own if kind is None else kind
                for own, kind in zip(argument_types, kinds, strict=True)
            )
        ), build

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        result = function(
            Code(context, builder),
            *map(opened, [context] * len(kinds), [builder] * len(kinds), signature.args, values),
        )
        if result is None:
            return context.get_dummy_value()
        return (
            context.make_tuple(builder, returns, [each.value for each in result])
            if isinstance(result, list)
            else result.value
        )

    return intrinsic(update_wrapper(typed, function))


def _in_plain_python(function: Callable[..., Any], kinds: list[Any], returns: Any) -> Any:
    def call(*values: Any) -> Any:
        result = function(
            PlainCode(),
            *(
                at_hand(value if kind is None else _CASTS[kind](value))
                for value, kind in zip(values, kinds, strict=True)
            ),
        )
        return tuple(map(_unwrap, result)) if isinstance(result, list) else _unwrap(result)

    return update_wrapper(call, function)


_CASTS = {INTEGER: int, NUMBER: float}


def _unwrap(value: Any) -> Any:
    return value.value if isinstance(value, PlainNumber) else value
