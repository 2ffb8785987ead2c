"""The response level from a stream of samples.

It is the windowed RMS around the maximum (paper, Eqs. tmax and barqtip).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, new_record, record_type

SAMPLE_BLOCK = 64
# next sample, running sum of squares, largest |q| and its sample, running sums at the first and
# last sample of the window, neighbours of the maximum, last |q|, whether the right neighbour is
# due, bin of the envelope
LEVEL_STATE = record_type(
    next=INTEGER,
    total=NUMBER,
    largest=NUMBER,
    at=INTEGER,
    first_sum=NUMBER,
    last_sum=NUMBER,
    left=NUMBER,
    right=NUMBER,
    previous=NUMBER,
    due=FLAG,
    bin=INTEGER,
)
LEVEL_OFF = 2**62  # number of the next sample of a level that is not computed


class EnvelopeObserver(NamedTuple):
    """Smallest and largest displacement of each bin of a run.

    ``low`` and ``high`` (B,) are in m, and NaN in a bin without a sample. With B = 0 they are not
    computed.

    ``ends`` (B,): number of the first sample after each bin.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    ends: NDArray[np.int64]


class LevelObserver(NamedTuple):
    """Windowed RMS around the maximum of a stream of samples (paper, Eqs. tmax and barqtip).

    The memory does not grow with the run.

    ``ring`` (W + 1,) holds the last running sums of q^2, W samples being half the window; ``state``
    is a LEVEL_STATE record. ``block`` (any size) is where samples are computed before they are
    pushed: sample n of a run goes to place n modulo its size, so the last ones can be read there.
    ``place`` (N_m,): mode shape where the displacement is sampled, of size 0: at the absorber.
    ``envelope``: extremes of the same samples.
    """

    ring: NDArray[np.float64]
    state: Any
    block: NDArray[np.float64]
    place: NDArray[np.float64]
    envelope: EnvelopeObserver


def new_envelope(ends: Sequence[int] | NDArray[np.int64] = ()) -> EnvelopeObserver:
    """Return an envelope without samples.

    Its bins end before the samples of numbers ``ends`` (B,).
    """
    last = np.array(ends, dtype=np.int64)
    return EnvelopeObserver(np.full(len(last), np.nan), np.full(len(last), np.nan), last)


def new_level(
    samples_per_period: int,
    half_window_periods: int = 10,
    place: NDArray[np.float64] | None = None,
    envelope: EnvelopeObserver | None = None,
) -> LevelObserver:
    """Return an empty level observer for a window of +- ``half_window_periods`` pseudo periods.

    ``place`` (N_m,): mode shape where the level is read, None: at the absorber.
    """
    return LevelObserver(
        np.zeros(half_window_periods * samples_per_period + 1),
        new_record(LEVEL_STATE, largest=-1.0),
        np.zeros(SAMPLE_BLOCK),
        np.zeros(0) if place is None else np.array(place, dtype=np.float64),
        new_envelope() if envelope is None else envelope,
    )


@jit
def reset_level(level):
    """Discard all samples."""
    state = level.state
    state.next = 0
    state.at = 0
    state.due = False
    state.total = 0.0
    state.largest = -1.0
    state.first_sum = 0.0
    state.last_sum = 0.0
    state.left = 0.0
    state.right = 0.0
    state.previous = 0.0
    state.bin = 0


@jit
def push_sample(level, q):
    """Take the next sample of the displacement (m)."""
    level.block[0] = q
    push_samples(level, 0, 1)


@jit
def update_envelope(level, first, count):
    """Add ``count`` samples (m), from place ``first`` of the block on, to the envelope."""
    block = level.block
    low, high, ends = level.envelope
    n = level.state.next
    last = low.shape[0] - 1
    b = level.state.bin
    for k in range(first, first + count):
        while b < last and n >= ends[b]:
            b += 1
        q = block[k]
        if not low[b] <= q:
            low[b] = q
        if not high[b] >= q:
            high[b] = q
        n += 1
    level.state.bin = b


@jit
def push_samples(level, first, count):
    """Process the next ``count`` samples of the displacement (m).

    They are in the block from position ``first`` on.
    """
    ring = level.ring
    state = level.state
    block = level.block
    if level.envelope.low.shape[0] > 0:
        update_envelope(level, first, count)
    size = ring.shape[0]
    width = size - 1
    n = state.next
    at = state.at
    due = state.due
    place = n % size
    total = state.total
    largest = state.largest
    previous = state.previous
    for k in range(first, first + count):
        q = block[k]
        total += q * q
        q = abs(q)
        ring[place] = total
        place = (
            place + 1 if place < width else 0
        )  # now where the sum at n - width is: the first sample of the window
        if due:
            state.right = q
            due = False
        if q > largest:
            largest = q
            at = n
            due = True
            state.left = previous
            state.right = q
            state.first_sum = ring[place] if n >= width else ring[0]
        if n <= at + width:
            state.last_sum = total
        previous = q
        n += 1
    state.next = n
    state.at = at
    state.due = due
    state.total = total
    state.largest = largest
    state.previous = previous


@jit
def compute_level(level):
    """Return (response level in m, sample of the maximum, largest |q| in m).

    The sample of the maximum includes the fraction that a parabola gives.

    The window is cut where the run starts or ends. The RMS is the mean of the samples after the
    window's first.
    """
    ring = level.ring
    state = level.state
    width = ring.shape[0] - 1
    if state.next < 2:
        only = max(state.largest, 0.0)  # of one sample; 0 without any
        return only, 0.0, only
    at = state.at
    first = max(0, at - width)
    last = min(state.next - 1, at + width)
    mean = (state.last_sum - state.first_sum) / max(last - first, 1)
    left = state.left
    peak = state.largest
    right = state.right
    bend = left - 2.0 * peak + right
    shift = 0.0
    if bend < 0.0 and at > 0:
        shift = 0.5 * (left - right) / bend
        peak -= 0.25 * (left - right) * shift
    return np.sqrt(max(mean, 0.0)), at + shift, peak
