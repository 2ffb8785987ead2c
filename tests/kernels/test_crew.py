"""Lanes shared out among threads: every part is done once, whoever comes, is late or fails."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
import pytest

from impact_env.crew import Crew
from impact_env.kernels.crew import DONE, LEFT, all_done, hand_in, new_board, next_part, open_call
from impact_env.kernels.jit import jit


@jit
def count_up(counts, board, parts, patience):  # type: ignore[no-untyped-def]
    """Count each lane of the parts taken; return whether all are done."""
    open_call(board, parts)
    part = next_part(board, patience)
    while part >= 0:
        for lane in range(board.cuts[part, 0], board.cuts[part, 1]):
            counts[lane] += 1
        hand_in(board)
        part = next_part(board, patience)
    return all_done(board, parts)


def stretches(cuts: list[int]) -> np.ndarray:
    return np.column_stack([cuts[:-1], cuts[1:]])


@pytest.mark.parametrize("helpers", [0, 1, 3])
def test_every_part_is_done_once_in_every_call(helpers: int) -> None:
    lanes, calls = 40, 3000
    counts, board = np.zeros(lanes, dtype=np.int64), new_board(lanes)
    crew = Crew(partial(count_up, counts, board), board)
    parts = [stretches([0, 3, 4, 20, 40]), stretches(list(range(41))), stretches([0, 40]), np.empty((0, 2), dtype=np.int64)]
    try:
        for call in range(calls):
            crew.work(parts[call % 4], helpers)
            np.testing.assert_array_equal(counts, call + 1 - (call + 1) // 4)
            if call % 500 == 0:
                time.sleep(2e-3)  # longer than helpers stay
    finally:
        crew.close()


def test_no_part_waits_for_a_helper_that_is_late() -> None:
    board, done = new_board(8), []

    def take(parts: int, _patience: int) -> bool:
        if parts == 0:
            time.sleep(5.0)
        done.append(parts)
        return True

    crew = Crew(take, board)
    began = time.perf_counter()
    crew.work(stretches([0, 4, 8]), 1)
    assert done == [2]
    assert time.perf_counter() - began < 4.0
    crew.close()


def test_what_goes_wrong_in_a_helper_is_raised() -> None:
    board = new_board(8)

    def take(parts: int, _patience: int) -> bool:
        if parts == 0:
            raise MemoryError("no room for a lane")
        board.words[LEFT], board.words[DONE] = 0, parts - 1  # the helper has the last part
        return False

    crew = Crew(take, board)
    with pytest.raises(MemoryError, match="no room"):
        crew.work(stretches([0, 4, 8]), 1)
    crew.close()


def test_threads_start_again_after_they_were_ended() -> None:
    counts, board = np.zeros(8, dtype=np.int64), new_board(8)
    crew = Crew(partial(count_up, counts, board), board)
    for calls in (1, 2, 3):
        crew.work(stretches([0, 2, 4, 6, 8]), 1)
        crew.close()
        crew.close()
        np.testing.assert_array_equal(counts, calls)


def test_a_call_that_is_broken_off_leaves_nothing_to_the_next() -> None:
    counts, board = np.zeros(8, dtype=np.int64), new_board(8)
    broken = []

    def take(parts: int, patience: int) -> bool:
        if parts > 0 and not broken:
            broken.append(parts)
            open_call(board, parts)
            raise KeyboardInterrupt
        return bool(count_up(counts, board, parts, patience))

    crew = Crew(take, board)
    with pytest.raises(KeyboardInterrupt):
        crew.work(stretches([0, 2, 4, 6, 8]), 1)
    counts[:] = 0  # nobody is at work any more
    for calls in range(1, 300):
        crew.work(stretches([0, 2, 4, 6, 8]), 1)
        np.testing.assert_array_equal(counts, calls)
    crew.close()
