"""Threads that do one call's lanes together, see `impact_env.kernels.crew`."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.crew import DONE, LEFT, Board

QUICK_S = 2e-4  # helpers stay for the next call where calls follow one another as quickly as this
STAY, LOOK_ROUND = 1 << 19, 1 << 12  # looks at the board before a helper leaves: some 0.3 ms, and just long enough to meet the call that woke it


class Crew:
    """A calling thread and its helpers. ``take`` (a kernel of `impact_env.kernels.crew`, bound to ``board``) takes parts and does them."""

    def __init__(self, take: Callable[[int, int], bool], board: Board) -> None:
        self._take, self._board = take, board
        self._pool: ThreadPoolExecutor | None = None
        self._helpers: list[Future[bool] | None] = []
        self._ended = 0.0

    def work(self, parts: NDArray[np.int64], helpers: int) -> None:
        """Do all parts, lanes [low, high) in rows (P, 2), with so many helpers beside the calling thread, and return when they are done.

        No part waits for a helper: what it has not taken when the caller gets there, the caller does.
        """
        number = len(parts)
        self._board.cuts[:number] = parts
        try:
            if helpers:
                self._call(helpers)
            if not self._take(number, 0):
                self._meet(number)
        except BaseException:  # Ctrl-C, or no room: a part that is left or under way must not be taken for one of the next call
            self._board.words[LEFT] = 0
            self.close()
            raise
        self._ended = time.perf_counter()

    def _call(self, helpers: int) -> None:
        """Wake the helpers that do not stand by."""
        if self._pool is None:
            self._pool, self._helpers = ThreadPoolExecutor(helpers), [None] * helpers
        quick = time.perf_counter() - self._ended < QUICK_S
        for k, helper in enumerate(self._helpers):
            if helper is None or helper.done():
                self._helpers[k] = self._pool.submit(self._take, 0, STAY if quick else LOOK_ROUND)

    def _meet(self, number: int) -> None:
        """Wait for a helper that has been put off its core in the midst of a part; raise what went wrong in one."""
        while self._board.words[DONE] != number:
            for helper in self._helpers:
                if helper is not None and helper.done():
                    helper.result()
            time.sleep(0)

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool, self._helpers = None, []
