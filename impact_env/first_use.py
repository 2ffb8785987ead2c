"""Notice of compilation when the first use of a kind of scene compiles its kernels.

Compilation takes up to a minute. One line is printed, and registered callbacks are called.
"""

import gc
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from numba.core import event

from impact_env.checks import require
from impact_env.kernels.compiling.cache import cache_folder
from impact_env.kernels.compiling.parts import COMPILING

LOG = logging.getLogger("impact_env")
SILENT_SECONDS = 1.0  # s of compiling before anything is said
HINT = "impact-absorber prepare"

# what is compiled for, if it has to be: scene, method and words
_purpose: ContextVar[tuple[object, object, str]] = ContextVar("_purpose", default=(None, None, ""))


@dataclass(frozen=True)
class Compilation:
    """The compilation of a kernel.

    Attributes
    ----------
    what : str
        Purpose of the kernel: scene and method.
    state : {"started", "finished"}
        Whether the compilation begins or has ended.
    seconds : float
        How long it has taken so far in s.
    """

    what: str
    state: Literal["started", "finished"]
    seconds: float = 0.0


_callbacks: list[Callable[[Compilation], object]] = []


def on_compile(callback: Callable[[Compilation], object]) -> Callable[[], None]:
    """Call a function when a kernel begins to be compiled, and when that ends.

    The function is called in the thread that compiles, which waits for its return. An exception
    of the function is logged as a warning and otherwise ignored. A kernel that is loaded from the
    cache causes no call.

    Parameters
    ----------
    callback : callable
        Function that takes a `Compilation`. Its result is ignored.

    Returns
    -------
    callable
        Function without arguments that ends these calls.

    Raises
    ------
    ParameterError
        The callback cannot be called.

    Examples
    --------
    >>> from impact_env import on_compile
    >>> compilations = []
    >>> end_calls = on_compile(compilations.append)
    >>> end_calls()
    """
    require(callable(callback), "callback", callback, "a function of one argument")
    own = [callback]  # the same callback may be given twice
    _callbacks.extend(own)

    def end() -> None:
        while own:
            _callbacks.remove(own.pop())

    return end


@contextmanager
def compiling_for(scene: object, method: object, words: str = "") -> Iterator[None]:
    """Announce compilations in this thread as compilations for this scene and method.

    ``words`` are the arguments of ``prepare`` in the announcement's hint. Scene and method are
    turned into text only for an announcement, because every run passes this context.
    """
    token = _purpose.set((scene, method, words))
    try:
        yield
    finally:
        _purpose.reset(token)


class _SeldomCollected(event.Listener):
    """Less frequent garbage collection while numba compiles.

    Most objects remain in use, and the default frequency takes up to a tenth of the time.
    """

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002 - numba's interface
        self._before = gc.get_threshold()
        if 0 < self._before[0] < 50_000:  # 0: never
            gc.set_threshold(50_000, 20, 50)

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        gc.set_threshold(*self._before)


class _Announcer(event.Listener):
    """Announces each compilation, one at a time.

    Callbacks are called immediately. The user is notified when the compilation has taken
    `SILENT_SECONDS`.
    """

    silent = False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002 - numba's interface
        scene, method, words = _purpose.get()
        self._what = "kernels" if scene is None else f"the kernels of: {scene}, {method}"
        self._began = time.perf_counter()
        self._timer = threading.Timer(SILENT_SECONDS, _say, [self._what, words])
        self._timer.daemon = True
        if not self.silent:
            self._timer.start()
        _call(Compilation(self._what, "started"))

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        self._timer.cancel()
        _call(Compilation(self._what, "finished", time.perf_counter() - self._began))


def _call(about: Compilation) -> None:
    for callback in tuple(_callbacks):
        try:
            callback(about)
        except Exception:
            LOG.warning("what was registered by on_compile failed", exc_info=True)


def describe_unused_cache() -> str:
    """Return a sentence if ``IMPACT_ENV_CACHE`` names a folder that is not writable.

    Otherwise the result is an empty string.
    """
    named = os.environ.get("IMPACT_ENV_CACHE")
    used = cache_folder()
    if not named or (used is not None and Path(named) in used.parents):
        return ""
    place = "nowhere" if used is None else f"in {used.parent}"
    return f" IMPACT_ENV_CACHE = {named!r} cannot be written to: kernels are kept {place}."


def _say(what: str, words: str) -> None:
    line = (
        (
            f"impact_env: compiling {what}. Once for a kind of scene, up to a minute; `{HINT} "
            f"{words}"
        ).rstrip()
        + "` does the usual ones beforehand."
        + describe_unused_cache()
    )
    if (
        LOG.isEnabledFor(logging.INFO) and LOG.hasHandlers()
    ):  # then the log is where the user wants it
        LOG.info(line)
    elif sys.stderr is not None:
        with suppress(OSError, ValueError):  # it is closed
            sys.stderr.write(
                f"\r{line}\n" if sys.stderr.isatty() else f"{line}\n"
            )  # over a progress bar, which is drawn anew below
            sys.stderr.flush()


_ANNOUNCER = _Announcer()
event.register(COMPILING, _ANNOUNCER)
event.register(COMPILING, _SeldomCollected())


@contextmanager
def suppress_announcements() -> Iterator[None]:
    """Print no announcements of compilations in this context; the caller announces them."""
    before = _ANNOUNCER.silent
    _ANNOUNCER.silent = True
    try:
        yield
    finally:
        _ANNOUNCER.silent = before
