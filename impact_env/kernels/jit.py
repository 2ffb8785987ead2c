"""The one compile decorator of all kernels.

Nothing is compiled with numba's fastmath. Where the compiler may reorder sums or contract products it does so anew in every library that a function
gets into, and of several copies of a function the one that was loaded first serves all: results would depend on what a process ran before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from impact_env.kernels.cache import keep
from impact_env.kernels.parts import kernel

_F = TypeVar("_F", bound=Callable[..., Any])

# Without numba's reference counts, whose atomic operations cost a fifth of an exact lane: such a function must not make
# or return an array. And without the wrapper for callers in C.
_PLAIN: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy", "_nrt": False}


def _njit(**options: Any) -> Callable[[Any], Any]:
    if numba.config.DISABLE_JIT:
        return lambda function: function
    return lambda function: keep(kernel(function, **options))


def jit(function: _F) -> _F:
    """Compile a function that makes no arrays. Never with fastmath: sums over slots are written as vector code (vector_code.py)."""
    return _njit(**_PLAIN)(function)  # type: ignore[no-any-return]


def jit_room(function: _F) -> _F:
    """Compile like `jit`, for a function that makes or returns arrays or calls one that does: once a lane, never in a loop."""
    return _njit(**{**_PLAIN, "_nrt": True})(function)  # type: ignore[no-any-return]


def jit_inline(function: _F) -> _F:
    """Compile like `jit` and inline at every call: small functions in the innermost loop."""
    return _njit(**_PLAIN, forceinline=True)(function)  # type: ignore[no-any-return]


def jit_view(function: _F) -> _F:
    """Compile like `jit` and dissolve in the caller's own code: a function that only picks arrays out of larger ones, and so returns arrays."""
    return _njit(**_PLAIN, inline="always")(function)  # type: ignore[no-any-return]
