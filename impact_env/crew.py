"""Threads that do one call's lanes together, see `impact_env.kernels.control.work_queue`."""

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.control.work_queue import PARTS_DONE, PARTS_LEFT, WorkQueue

QUICK_S = 2e-4  # helpers stay for the next call where calls follow one another as quickly as this
# looks at the board before a helper leaves: some 0.3 ms, and just long enough to meet the call that woke it
SPINS_BEFORE_SLEEP = 1 << 16
SPINS_BETWEEN_CHECKS = 1 << 9


class WorkerPool:
    """A calling thread and its helpers. ``take`` (a kernel of `impact_env.kernels.control.lanes`) takes parts from the board and does them."""

    def __init__(self, take: Callable[[int, int], bool], queue: WorkQueue) -> None:
        self.take = take
        self._queue = queue
        self._pool: ThreadPoolExecutor | None = None
        self._helpers: list[Future[bool]] = []
        self._ended = 0.0

    def work(self, parts: NDArray[np.int64], helpers: int) -> None:
        """Do all parts, lanes [low, high) in rows (P, 2), with so many helpers beside the calling thread, and return when they are done.

        No part waits for a helper: what it has not taken when the caller gets there, the caller does.
        """
        number = len(parts)
        self._queue.cuts[:number] = parts
        try:
            self._call(helpers)
            done = self.take(number, 0)
            while not done:  # a helper has been put off its core in the midst of a part
                for helper in self._helpers:
                    if helper.done():
                        helper.result()  # raises what went wrong there
                time.sleep(0)
                done = self._queue.words[PARTS_DONE] == number
        except BaseException:  # Ctrl-C, or no room: a part that is left or under way must not be taken for one of the next call
            self._queue.words[PARTS_LEFT] = 0
            self.close()
            raise
        self._ended = time.perf_counter()

    def _call(self, helpers: int) -> None:
        """Start helpers in the place of those that have left."""
        quick = time.perf_counter() - self._ended < QUICK_S
        standing_by = [helper for helper in self._helpers if not helper.done()]
        if self._pool is None and helpers:
            self._pool = ThreadPoolExecutor(helpers)
        self._helpers = standing_by + [
            self._pool.submit(self.take, 0, SPINS_BEFORE_SLEEP if quick else SPINS_BETWEEN_CHECKS)
            for _ in range(helpers - len(standing_by))
            if self._pool is not None
        ]

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
            self._helpers = []
