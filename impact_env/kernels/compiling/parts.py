"""The parts of the compilation of kernels that callers of kernels need.

They are events, waiting, limits of inlining, and loading without compiling.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from threading import Thread
from typing import TypeVar

# an event as numba tells them: a kernel is compiled for a caller in Python, with all its parts
COMPILING = "impact_env:compile"
ONLY_CACHED = ContextVar("only_cached", default=False)
_Group = TypeVar("_Group", bound=type)
_Result = TypeVar("_Result")
INLINING_LIMITED: set[type] = set()


def limit_inlining(group: _Group) -> _Group:
    """Declare that kernels with this named tuple as an argument are inlined less.

    The named tuple may be an argument itself or a part of one.
    """
    INLINING_LIMITED.add(group)
    return group


class CompilationAbandoned(Exception):  # noqa: N818 - no error: the program was interrupted
    """A thread does not wait any longer for a kernel that another one compiles."""


# how often a thread that waits for a compilation notices signals and `abandon_compilations`
_POLL_INTERVAL_S = 0.05
_compiling_threads: set[Thread] = set()
_abandoning = 0  # how many callers of `abandon_compilations` there are


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
    """Return whether a kernel is being compiled, also one that nobody waits for."""
    return any(thread.is_alive() for thread in tuple(_compiling_threads))


def run_in_thread(work: Callable[[], _Result]) -> _Result:
    """Return the result of ``work``, which runs in its own thread.

    An interrupt abandons this thread, because LLVM does not respond to signals for up to a minute.
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
    """A kernel would have to be compiled."""


@contextmanager
def only_cached() -> Iterator[None]:
    """Load kernels from the cache only, in this thread and context.

    Raises `NotCached` for a kernel that would have to be compiled.
    """
    token = ONLY_CACHED.set(True)
    try:
        yield
    finally:
        ONLY_CACHED.reset(token)
