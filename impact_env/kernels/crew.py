"""Lanes of one call shared out among threads inside compiled code, one function for each family of integrators.

A thread that sleeps is woken through the interpreter's lock, often on the core of the one that wakes it: that can take as long as a step of some
hundred lanes. So a helper stays in compiled code for a while after its work and looks for the next call's parts itself. Which thread takes which
part, and whether there are helpers at all, changes no number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.jit import INTEGER, jit, jit_room, vector_code
from impact_env.kernels.lanes import compliant_lanes, linear_lanes, moreau_lanes, rigid_lanes, runge_kutta_lanes
from impact_env.kernels.vector_code import Code, Index

LEFT, DONE = 0, 16  # places of the words that threads share: parts that nobody has taken, and parts that are done; each in a cache line of its own
ROUND = 1023  # looks, less one, after which others get the core if they wait for it
MEETING = 1 << 18  # looks at the other threads' last parts before the caller sleeps


class Board(NamedTuple):
    """What the threads of one call share: ``words`` (32,), each read and changed in one piece, and the parts ``cuts`` (P, 2), lanes [low, high)."""

    words: NDArray[np.int64]
    cuts: NDArray[np.int64]


def new_board(lanes: int) -> Board:
    """Return the board of a number of lanes, with nothing to do."""
    return Board(np.zeros(32, dtype=np.int64), np.zeros((lanes, 2), dtype=np.int64))


@vector_code(INTEGER)
def _look(code: Code, words, place: Index):
    """Return a word as it is now, and with it all that was written before it."""
    return code.look(words, place)


@vector_code(INTEGER)
def _add(code: Code, words, place: Index, change: Index):
    """Add to a word and return what it was, in one piece."""
    return code.exchange(words, place, change)


@vector_code()
def _put(code: Code, words, place: Index, value: Index):
    """Set a word, after all that was written before it."""
    code.publish(words, place, value)


@vector_code()
def _give_way(code: Code):
    """Let others who wait for this core have it: a thread that only looks must not keep the caller off it."""
    code.give_way()


@jit
def next_part(board, patience):
    """Take a part that nobody has; return its number, or -1 if there was none in ``patience`` looks and one."""
    for k in range(patience + 1):
        if k & ROUND == ROUND:
            _give_way()
        if _look(board.words, LEFT) > 0:
            part = _add(board.words, LEFT, -1) - 1
            if part >= 0:  # else another thread was quicker
                return part
    return -1


@jit
def open_call(board, parts):
    """Let all threads take ``parts``; nothing, if that is 0: what a helper says."""
    if parts > 0:
        _put(board.words, DONE, 0)
        _put(board.words, LEFT, parts)


@jit
def all_done(board, parts):
    """Return whether all ``parts`` are done, after some patience with the other threads' last ones."""
    for k in range(MEETING):
        if parts == 0 or _look(board.words, DONE) == parts:
            return True
        if k & ROUND == ROUND:
            _give_way()
    return False


@jit
def hand_in(board):
    """Say that a part is done."""
    _add(board.words, DONE, 1)


@jit_room
def rigid_crew(scene, reach, batch, board, parts, patience):
    """Take and advance parts as long as there are any; return whether all are done.

    The caller gives the number of ``parts`` that it has written on the board, a helper 0; ``patience``: looks at the board before a thread leaves.
    """
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        rigid_lanes(scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1])
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def linear_crew(scene, reach, batch, board, parts, patience):
    """Take and advance parts of a scene with one linear regime, as `rigid_crew`."""
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        linear_lanes(scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1])
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def compliant_crew(scene, reach, batch, board, parts, patience):
    """Take and advance parts of a scene with compliant contact, as `rigid_crew`."""
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        compliant_lanes(scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1])
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def moreau_crew(modes, laws, step, batch, board, parts, patience):
    """Take and advance parts with the Moreau scheme, as `rigid_crew`."""
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        moreau_lanes(modes, laws, step, batch, board.cuts[part, 0], board.cuts[part, 1])
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def runge_kutta_crew(modes, laws, step, batch, board, parts, patience):
    """Take and advance parts with the Runge-Kutta method, as `rigid_crew`."""
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        runge_kutta_lanes(modes, laws, step, batch, board.cuts[part, 0], board.cuts[part, 1])
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)
