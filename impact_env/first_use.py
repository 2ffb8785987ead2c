"""The first use of a kind of scene compiles its kernels, for up to a minute: one line says so, on a terminal and in the log."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from numba.core import event

LOG = logging.getLogger("impact_env")
PATIENCE = 2.0  # s of compiling before anything is said
HINT = "python -m impact_env.warm_up"

_thread = threading.local()  # ``purpose``: what this thread compiles for, if it has to compile at all


class CompilingFor:
    """While it is entered, what this thread compiles is compiled for this scene and method; ``words`` is what the hint's command needs.

    The two are turned into text only if there is something to say, since every run passes here.
    """

    __slots__ = ("_before", "_purpose")

    def __init__(self, scene: object, method: object, words: str = "") -> None:
        self._purpose = (scene, method, words)

    def __enter__(self) -> None:
        self._before = getattr(_thread, "purpose", None)
        _thread.purpose = self._purpose

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        _thread.purpose = self._before


class _Announcer(event.Listener):
    """Says once in a process that kernels are being compiled, as soon as that has taken `PATIENCE`.

    numba tells of a function that it has to compile, not of one that it loads; functions within functions nest, under one lock for all threads.
    """

    def __init__(self) -> None:
        self.said = False
        self._depth = 0
        self._timer: threading.Timer | None = None

    def on_start(self, event: event.Event) -> None:
        if self.said or not _is_kernel(event):
            return
        self._depth += 1
        if self._depth == 1:
            self._timer = threading.Timer(PATIENCE, self._say, [getattr(_thread, "purpose", None)])
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: event.Event) -> None:
        if self._timer is None or not _is_kernel(event):
            return
        self._depth -= 1
        if self._depth == 0:
            self._timer.cancel()
            self._timer = None

    def _say(self, purpose: tuple[object, object, str] | None) -> None:
        if self.said:
            return
        self.said = True
        line = _line(purpose)
        LOG.info(line)
        seen = LOG.isEnabledFor(logging.INFO) and LOG.hasHandlers()  # then the log is where the user wants it
        if not seen and sys.stderr is not None and sys.stderr.isatty():
            sys.stderr.write(f"\r{line}\n")  # over a progress bar, which is drawn anew below
            sys.stderr.flush()


def _is_kernel(event: event.Event) -> bool:
    return str(event.data["dispatcher"].py_func.__module__).startswith("impact_env.")


def _line(purpose: tuple[object, object, str] | None) -> str:
    scene, method, words = purpose or (None, None, "")
    what = "kernels" if scene is None else f"the kernels of: {scene}, {method}"
    hint = f"{HINT} {words}".rstrip()
    return f"impact_env: compiling {what}. Once for a kind of scene, up to a minute; `{hint}` does the usual ones beforehand."


_ANNOUNCER = _Announcer()
event.register("numba:compile", _ANNOUNCER)


@contextmanager
def quiet() -> Iterator[None]:
    """Say nothing meanwhile: the caller tells what is being compiled."""
    before, _ANNOUNCER.said = _ANNOUNCER.said, True
    try:
        yield
    finally:
        _ANNOUNCER.said = before
