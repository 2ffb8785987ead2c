"""The lanes of one call shared out among threads that stay in compiled code.

A thread that sleeps is woken through the interpreter's lock: that takes as long as a step of some
hundred lanes. So a helper stays in compiled code for a while after its work, and looks for the next
call's parts itself. Passive-v0 with 256 and 1,024 lanes takes 1.5 and 1.4 times as long a step with
a pool of Python's threads instead (two cores). Which thread does which part, and whether there are
helpers at all, changes no number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import INTEGER, jit, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index

# places of the words that threads share: parts that nobody has taken, and parts that are done; each
# in a cache line of its own
PARTS_LEFT = 0
PARTS_DONE = 16
MOST_POLLS = 1 << 15  # looks at the other threads' last parts before the caller goes back to Python


class WorkQueue(NamedTuple):
    """Memory shared by the threads of one call.

    ``words`` (32,) are read and changed atomically. The parts are ``cuts`` (P, 2), ranges of lanes
    [low, high).
    """

    words: NDArray[np.int64]
    cuts: NDArray[np.int64]


def new_work_queue(lanes: int) -> WorkQueue:
    """Return an empty queue for a number of lanes."""
    return WorkQueue(np.zeros(32, dtype=np.int64), np.zeros((lanes, 2), dtype=np.int64))


@vector_code(INTEGER)
def _atomic_add(code: Code, words, place: Index, change: Index):
    return code.atomic_rmw("add", words, place, change)


@vector_code(INTEGER)
def _atomic_exchange(code: Code, words, place: Index, value: Index):
    return code.atomic_rmw("xchg", words, place, value)


@jit
def take_first_part(queue, parts, patience):
    """Publish ``parts`` parts (0 from a helper thread) and take one as `take_next_part` does."""
    if parts > 0:
        _atomic_exchange(queue.words, PARTS_DONE, 0)
        _atomic_exchange(queue.words, PARTS_LEFT, parts)
    return _take_part(queue, patience)


@jit
def take_next_part(queue, patience):
    """Report a part as done, and return the number of another part.

    The result is -1 if none was available in ``patience`` + 1 polls.
    """
    _atomic_add(queue.words, PARTS_DONE, 1)
    return _take_part(queue, patience)


@jit
def _take_part(queue, patience):
    for _ in range(patience + 1):
        if _atomic_add(queue.words, PARTS_LEFT, 0) > 0:
            part = _atomic_add(queue.words, PARTS_LEFT, -1) - 1
            if part >= 0:  # else another thread was quicker
                return part
    return -1


@jit
def wait_until_done(queue, parts):
    """Return whether all ``parts`` are done, after at most MOST_POLLS polls."""
    looks = 0
    while parts > 0 and _atomic_add(queue.words, PARTS_DONE, 0) != parts:
        if looks == MOST_POLLS:
            return False
        looks += 1
    return True
