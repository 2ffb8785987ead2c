"""The one compile decorator and the one cache folder of all kernels.

Nothing is compiled with numba's fastmath. Where the compiler may reorder sums or contract products it does so anew in every library that a function
gets into, and of several copies of a function the one that was loaded first serves all: results would depend on what a process ran before.

numba's cache does not notice an edit in an imported module, so the folder carries a hash of the package's sources.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

_PACKAGE = Path(__file__).resolve().parent
_F = TypeVar("_F", bound=Callable[..., Any])


def cache_folder() -> Path:
    """Return the cache folder of these sources; ``IMPACT_ENV_CACHE`` names another parent folder."""
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.glob("*.py")):
        digest.update(source.name.encode() + source.read_bytes())
    for package in (numba,):
        digest.update(package.__version__.encode())
    parent = os.environ.get("IMPACT_ENV_CACHE") or str(Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "impact_env")
    folder = Path(parent) / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # a read-only home must not stop a simulation
        folder = Path(tempfile.gettempdir()) / "impact_env" / digest.hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
    return folder


numba.config.CACHE_DIR = str(cache_folder())


# Without numba's reference counts, whose atomic operations cost a fifth of an exact lane: such a function must not make
# or return an array.
_PLAIN: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
_njit: Any = numba.njit


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
