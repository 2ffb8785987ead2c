"""Kernels that a page waits for: which are ready, and those that other processes compile meanwhile."""

import threading
from collections.abc import Callable, Iterator

from impact_env.budget import Stop
from impact_env.prepare import Preparation


class Newer(Exception):  # noqa: N818 - no error
    """The page has moved on."""


class Kernels:
    """Which kernels are ready, and those on their way, each in a process of its own; shared by all tabs."""

    def __init__(self) -> None:
        self.ready: set[object] = set()
        self._preparing: dict[object, Preparation] = {}
        self._lock = threading.Lock()

    def waited(self, key: object, ready: Callable[[], bool], begin: Callable[[], Preparation], stop: Stop) -> Iterator[float]:
        """Yield the seconds of compiling until the kernels of a key are ready; raises Newer after a stop, and leaves the compiling be."""
        if key in self.ready:
            return
        with self._lock:
            work = self._preparing.get(key)
            if work is None and ready():
                self.ready.add(key)
                return
            work = self._preparing.setdefault(key, begin()) if work is None else work
        yield work.elapsed
        while not work.done:
            if stop.given:
                raise Newer
            work.wait(0.2)
            yield work.elapsed
        self._preparing.pop(key, None)
        self.ready.add(key)  # if the other process could not, this one compiles, or tells why it cannot

    def cancel(self) -> None:
        """End what is on its way."""
        for work in list(self._preparing.values()):
            work.cancel()
