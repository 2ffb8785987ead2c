"""The decorators of all kernels.

Five are for functions that numba compiles, one is for functions in the language of vector code.

Nothing is compiled with numba's fastmath. With it the compiler may reorder sums and contract
products, differently in every library that contains a function; and of several copies of a function
the one loaded first is used by all callers. So results would depend on earlier calls of a process.

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
_KINDS = {"Index": INTEGER, "Number": NUMBER}  # type of an argument by its annotation

# Options without numba's reference counts (``_nrt``), whose atomic operations cost a fifth of the
# time of an exact lane: such a function must not make or return an array. And without the wrapper
# for callers in C.
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
    """Compile a function that neither makes nor returns arrays.

    Sums over slots are written as vector code (vector_code.py), since fastmath is not used.
    """
    return _njit(**_PLAIN)(function)  # type: ignore[no-any-return]


def jit_allocating(function: _F) -> _F:
    """Compile like `jit` a function that makes or returns arrays, or that calls such a function.

    Its arrays have reference counts, which take time: keep it out of the innermost loops.
    """
    return _njit(**{**_PLAIN, "_nrt": True})(function)  # type: ignore[no-any-return]


def jit_inline(function: _F) -> _F:
    """Compile like `jit`, and let LLVM inline at every call.

    It is for small functions in the innermost loops, and for functions with many arrays as
    arguments.
    """
    return _njit(**_PLAIN, forceinline=True)(function)  # type: ignore[no-any-return]


def jit_separate(function: _F) -> _F:
    """Compile like `jit`, and do not inline, even if the calling function is always inlined.

    It is for large functions outside the innermost loops. Each copy of such a function, with copies
    of all functions that it calls, would add to the time of compilation.
    """
    return _njit(**_PLAIN, forceinline=False)(function)  # type: ignore[no-any-return]


def jit_view(function: _F) -> _F:
    """Compile like `jit`, and let numba inline at every call, before types are inferred.

    It is for helper functions that return views of arrays, which `jit` alone cannot return.
    """
    return _njit(**_PLAIN, inline="always")(function)  # type: ignore[no-any-return]


def vector_code(kind: Any = types.void, several: int = 0) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that makes a function in the language of vector code callable.

    The decorated function takes a `Code` and arguments, and returns a `Number`, an `Index`, a list
    of these, or None. Kernels call the resulting function with the arguments alone.

    Parameters
    ----------
    kind : numba type
        Type of the result: NUMBER, INTEGER, or void for a function without result.
    several : int
        Number of results if they are a tuple of ``kind``; 0: one result, or none.

    Arguments annotated as `Index` or `Number` are converted to int64 or float64; arrays and named
    tuples have no annotation.
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
