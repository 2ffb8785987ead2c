"""Sampling times: whether they are even, up to the rounding with which they were written."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EVEN_TOL = 1e-6  # of the sampling interval: times that differ by less from even ones are kept
JITTER_TOL = 1e-3  # of the sampling interval: times that differ by less from even ones are even
MOST_ROUNDING = 0.5  # of the sampling interval: coarser times do not show whether they are even
LENGTH_TOL = 1e-3  # of the duration: coarser times do not show how long it is
DIGIT_TOL = 1e-6  # of a decimal place: a number is a multiple of it
MOST_DIGITS = 12  # of a decimal number: beyond it, multiples of a place cannot be told from others


def possible_roundings(times: Array) -> Iterator[Array]:
    """Yield the possible rounding steps (K,) in s of times (K,) in s.

    They are steps of a decimal place, of a number of significant digits, and of a shorter float.
    """
    for kind in (np.float16, np.float32):
        with np.errstate(over="ignore"):
            short = times.astype(kind)
        if np.all(short.astype(np.float64) == times):
            yield np.spacing(np.abs(short)).astype(np.float64)
            break
    sizes = np.abs(times)
    decades = np.floor(np.log10(np.where(sizes > 0, sizes, np.max(sizes))) + DIGIT_TOL)
    for places in (np.full(len(times), np.max(decades)), decades):
        for digits in range(MOST_DIGITS):
            steps = 10.0 ** (places - digits)
            multiples = times / steps
            error = np.abs(multiples - np.round(multiples))
            if np.all(error <= DIGIT_TOL + 4 * np.finfo(float).eps * np.abs(multiples)):
                yield steps
                break


def is_even(times: Array) -> bool:
    """Return whether ascending times (K,) in s are even, up to rounding as written."""
    steps = len(times) - 1
    step = float(times[-1] - times[0]) / steps
    error = np.abs(times - times[0] - step * np.arange(len(times)))
    if np.max(error) <= JITTER_TOL * step:
        return True
    for places in possible_roundings(times):
        coarsest = float(np.max(places))
        if coarsest > min(MOST_ROUNDING, LENGTH_TOL * steps) * step:
            continue
        # half a place for the time itself, half a place for the two ends of the line
        if np.all(error <= (1 + DIGIT_TOL) * (places + coarsest) / 2):
            return True
    return False


def even_times(count: int, duration: float) -> Array:
    """Return ``count`` even times in s from 0 to ``duration``."""
    return np.asarray(duration / (count - 1) * np.arange(count))


def find_uneven(times: Array) -> int:
    """Return the index of the first time that ends an unequal step, for times that are not even."""
    steps = np.diff(times)
    error = np.abs(steps - np.median(steps))
    odd = np.flatnonzero(error > np.max(error) / 2)
    return int(odd[0]) + 1
