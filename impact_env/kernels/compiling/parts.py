"""Controls of compilation that callers of kernels need.

They are the name of numba's event, waiting in a thread, limits of inlining, and loading without
compiling.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from threading import Thread
from typing import TypeVar

# name of the numba event that a kernel, with all its parts, is compiled for a caller in Python
COMPILING = "impact_env:compile"
ONLY_CACHED = ContextVar("only_cached", default=False)  # whether `only_cached` is in effect
_Group = TypeVar("_Group", bound=type)
_Result = TypeVar("_Result")
INLINING_LIMITED: set[type] = set()  # classes declared by `limit_inlining`


def limit_inlining(group: _Group) -> _Group:
    """Declare that parts of kernels with this named tuple as an argument are inlined less.

    It is a class decorator that returns the same class. The named tuple may be an argument of the
    kernel called from Python, or an element of one. See numba_internals.py.
    """
    INLINING_LIMITED.add(group)
    return group


class CompilationAbandoned(Exception):  # noqa: N818 - no error: the program was interrupted
    """Raised in a thread that stops waiting for a kernel that another thread compiles."""


# interval at which a thread that waits for a compilation checks for signals and for
# `abandon_compilations`
_POLL_INTERVAL_S = 0.05
_compiling_threads: set[Thread] = set()
_abandoning = 0  # number of contexts of `abandon_compilations` that are open


@contextmanager
def abandon_compilations() -> Iterator[None]:
    """Make threads that wait for a compilation raise `CompilationAbandoned`.

    This holds within the context, also for threads that begin to wait. Compilations under way
    continue.
    """
    global _abandoning
    _abandoning += 1
    try:
        yield
    finally:
        _abandoning -= 1


def is_compiling() -> bool:
    """Return whether a thread of `run_in_thread` is at work, even if its caller no longer waits."""
    return any(thread.is_alive() for thread in tuple(_compiling_threads))


def run_in_thread(work: Callable[[], _Result]) -> _Result:
    """Run ``work`` in a thread of its own, wait for it, and return its result or raise its error.

    An interrupt of the waiting thread, or `abandon_compilations`, ends the wait while the work
    continues: LLVM does not respond to signals for up to a minute.
    """
    results: list[_Result] = []
    errors: list[BaseException] = []
    context = copy_context()

    def run() -> None:
        try:
            results.append(context.run(work))
        except BaseException as error:
            errors.append(error)
        finally:
            _compiling_threads.discard(thread)

    thread = Thread(target=run, daemon=True)
    _compiling_threads.add(thread)
    thread.start()
    while thread.is_alive():
        thread.join(_POLL_INTERVAL_S)
        if _abandoning and thread.is_alive():
            raise CompilationAbandoned
    if errors:
        raise errors[0]
    return results[0]


class NotCached(Exception):  # noqa: N818 - no error: an answer
    """Raised under `only_cached` by a kernel that would have to be compiled."""


@contextmanager
def only_cached() -> Iterator[None]:
    """Load kernels from the cache only, in this thread and within the context.

    A call of a kernel that is neither loaded nor in the cache raises `NotCached`.
    """
    token = ONLY_CACHED.set(True)
    try:
        yield
    finally:
        ONLY_CACHED.reset(token)
