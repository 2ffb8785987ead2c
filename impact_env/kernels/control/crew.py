"""The lanes of one call shared out among threads that stay in compiled code.

A thread that sleeps is woken through the interpreter's lock: that takes as long as a step of some hundred lanes. So a helper stays in compiled code
for a while after its work, and looks for the next call's parts itself. Passive-v0 with 256 and 1,024 lanes takes 1.5 and 1.4 times as long a step
with a pool of Python's threads instead (two cores). Which thread does which part, and whether there are helpers at all, changes no number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import INTEGER, jit, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index

# places of the words that threads share: parts that nobody has taken, and parts that are done; each in a cache line of its own
LEFT = 0
DONE = 16
MEETING = 1 << 15  # looks at the other threads' last parts before the caller goes back to Python


class Board(NamedTuple):
    """What the threads of one call share: ``words`` (32,), each read and changed in one piece, and the parts ``cuts`` (P, 2), lanes [low, high)."""

    words: NDArray[np.int64]
    cuts: NDArray[np.int64]


def new_board(lanes: int) -> Board:
    """Return the board of a number of lanes, with nothing to do."""
    return Board(np.zeros(32, dtype=np.int64), np.zeros((lanes, 2), dtype=np.int64))


@vector_code(INTEGER)
def _add(code: Code, words, place: Index, change: Index):
    return code.in_one_piece("add", words, place, change)


@vector_code(INTEGER)
def _put(code: Code, words, place: Index, value: Index):
    return code.in_one_piece("xchg", words, place, value)


@jit
def first_part(board, parts, patience):
    """Let all threads take ``parts``, 0 from a helper, and take one as `next_part` does."""
    if parts > 0:
        _put(board.words, DONE, 0)
        _put(board.words, LEFT, parts)
    return _taken(board, patience)


@jit
def next_part(board, patience):
    """Hand a part in and take one that nobody has; return its number, or -1 if there was none in ``patience`` looks and one."""
    _add(board.words, DONE, 1)
    return _taken(board, patience)


@jit
def _taken(board, patience):
    for _ in range(patience + 1):
        if _add(board.words, LEFT, 0) > 0:
            part = _add(board.words, LEFT, -1) - 1
            if part >= 0:  # else another thread was quicker
                return part
    return -1


@jit
def all_done(board, parts):
    """Return whether all ``parts`` are done, after some patience with the other threads' last ones."""
    looks = 0
    while parts > 0 and _add(board.words, DONE, 0) != parts:
        if looks == MEETING:
            return False
        looks += 1
    return True
