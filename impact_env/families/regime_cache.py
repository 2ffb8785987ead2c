"""Regimes that were computed before, within a bound of memory: their tables take up to some megabytes each."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

MOST_BYTES_CACHED = (
    64 * 2**20
)  # of all regimes together: those of some 450 scenes of 10 modes, or of 28 of 60 modes
P = ParamSpec("P")
R = TypeVar("R")


def count_bytes(value: Any) -> int:
    """Return the size of all arrays in nested tuples."""
    if isinstance(value, tuple):
        return sum(map(count_bytes, value))
    return value.nbytes if isinstance(value, np.ndarray) else 0


class RegimeCache:
    """Results of functions by their arguments; those used least recently go where all together have more than ``most_bytes``."""

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self._values: OrderedDict[Any, tuple[Any, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def bytes(self) -> int:
        """Size of all results that are held."""
        return self._bytes

    def __call__(self, function: Callable[P, R]) -> Callable[P, R]:
        """Return the function, with its results held."""

        @wraps(function)
        def cached(*args: P.args, **kwargs: P.kwargs) -> R:
            key = (function, args, tuple(sorted(kwargs.items())))
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key][0]
            value = function(*args, **kwargs)
            with self._lock:
                if key not in self._values:
                    self._hold(key, value)
                return self._values[key][0]

        return cached

    def _hold(self, key: Any, value: Any) -> None:
        size = count_bytes(value)
        self._values[key] = value, size
        self._bytes += size
        while self._bytes > self.most_bytes and len(self._values) > 1:
            _, (_, dropped) = self._values.popitem(last=False)
            self._bytes -= dropped


cache_regimes = RegimeCache(MOST_BYTES_CACHED)
