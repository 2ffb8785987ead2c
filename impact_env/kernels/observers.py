"""What a run may be asked to observe. Each observer is a NamedTuple of arrays or None; None is pruned when a kernel is compiled.

Every method hands its observers the same things: the tip displacement at equidistant samples (level), the state at those samples
(series), impacts and contact phases (events), and the terms of the energy balance (energy).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.jit import jit

# rows of Counters.values: what has been done, how far the run is, an order to end it, and what it may use (budget.py)
IMPACTS, STUCK_TIME, STEPS, EVALUATIONS, EVENTS, REACHED, STOP, MOST_EVENTS, EVENTS_PER_S, MOST_EVALUATIONS, EVALUATIONS_PER_S, SEARCHED = range(12)
COUNTS = 12
# kinds of contact phase
STUCK_INSIDE, HELD_LOWER, HELD_UPPER = 0, 1, 2
# counts of Check, and kinds of what a search can miss
SEARCHES, MISSES = 0, 1
PASSED, TURNED, PULLED = 0, 1, 2
# rows of Energy.totals
WORK, FRICTION_LOSS, IMPACT_LOSS, ABSORBER_DAMPING = 0, 1, 2, 3
# status codes of all integration kernels
DONE, TOO_MANY_EVENTS, NOT_FINITE, NO_PROGRESS, TOO_MANY_EVALUATIONS, SEARCH_GAVE_UP, STOPPED = range(7)


class Check(NamedTuple):
    """What comes of checking the exact method's searches (check.py).

    ``counts`` (2,): searches and misses. ``worst`` (3,), by kind of miss: how deep beyond a guard, of the clearance (of the signal's terms, if
    there is none), how fast in the wrong sense, of the rate's terms, how far the joint force out of its bounds, of its terms. ``first``
    (FIRST_MISSES, 3): time (s), kind and share of the first misses.
    """

    counts: NDArray[np.int64]
    worst: NDArray[np.float64]
    first: NDArray[np.float64]


class Counters(NamedTuple):
    """``values`` (COUNTS,): number of impacts, time in joined phases (s), steps or stretches between events, evaluations, events, time reached (s).

    Another thread reads the time reached while the run goes on, and ends it by a stop of 1. Then the events and evaluations that the run may use: at
    once, and for each second of it that has passed; and the evaluations before the stretch under way. ``check`` None: searches are not checked.
    """

    values: NDArray[np.float64]
    check: Check | None = None


class Level(NamedTuple):
    """Streaming windowed RMS around the maximum (paper, Eqs. tmax and barqtip), in memory that does not grow with the run.

    ``ring`` (W + 1,) holds the last running sums of q^2, W samples being half the window; ``state`` (10,) the rest. ``block`` (any size) is where
    samples are computed before they are pushed: sample n of a run goes to place n modulo its size, so the last ones can be read there.
    """

    ring: NDArray[np.float64]
    state: NDArray[np.float64]
    block: NDArray[np.float64]


class Events(NamedTuple):
    """What happened at the contacts, one row each.

    ``impacts`` (capacity, 5): time, relative velocity before, impulse on the absorber, energy lost, which absorber. ``phases`` (capacity, 4): start,
    end, kind, which absorber.
    ``counts`` (2,) goes on counting when the capacity is used up, so that the caller can run again with enough of it.
    """

    impacts: NDArray[np.float64]
    phases: NDArray[np.float64]
    counts: NDArray[np.int64]


class Series(NamedTuple):
    """``states`` (samples, 2 N_m + 2): modal displacements, absorber displacement, modal velocities, absorber velocity."""

    states: NDArray[np.float64]


class Energy(NamedTuple):
    """``totals`` (4,): work of the force, losses by friction, by impacts, in the tuned absorber's damper; ``modal`` (N_m,) loss per mode. In J."""

    totals: NDArray[np.float64]
    modal: NDArray[np.float64]


# Level.state: next sample, running sum, largest |q|, its sample, running sums at the first and last sample of the window,
# neighbours of the maximum, last |q|, flag: the right neighbour is due
_NEXT, _SUM, _MAX, _AT, _SUM0, _SUM1, _LEFT, _RIGHT, _PREVIOUS, _DUE = range(10)
BLOCK = 64


def new_counters(
    events: float = np.inf, events_per_s: float = 0.0, evaluations: float = np.inf, evaluations_per_s: float = 0.0, check: Check | None = None
) -> Counters:
    """Return counters at zero, and what the run may use."""
    values = np.zeros(COUNTS)
    values[[MOST_EVENTS, EVENTS_PER_S, MOST_EVALUATIONS, EVALUATIONS_PER_S]] = events, events_per_s, evaluations, evaluations_per_s
    return Counters(values, check)


FIRST_MISSES = 16


def new_check() -> Check:
    """Return an empty check."""
    return Check(np.zeros(2, dtype=np.int64), np.zeros(3), np.zeros((FIRST_MISSES, 3)))


def new_level(samples_per_period: int, half_window_periods: int = 10) -> Level:
    """Return an empty level observer for a window of +- ``half_window_periods`` pseudo periods."""
    state = np.zeros(10)
    state[_MAX] = -1.0
    return Level(np.zeros(half_window_periods * samples_per_period + 1), state, np.zeros(BLOCK))


@jit
def clear_level(level):  # type: ignore[no-untyped-def]
    """Forget all samples."""
    level.state[:] = 0.0
    level.state[_MAX] = -1.0


@jit
def push_level(level, q):  # type: ignore[no-untyped-def]
    """Take the next sample of the tip displacement (m)."""
    level.block[0] = q
    push_block(level, 0, 1)


@jit
def push_block(level, first, count):  # type: ignore[no-untyped-def]
    """Take the next ``count`` samples of the tip displacement (m), which lie in the block from place ``first`` on."""
    ring, state, block = level
    size = ring.shape[0]
    width = size - 1
    n, at, due = int(state[_NEXT]), int(state[_AT]), state[_DUE] > 0.0
    place = n % size
    total, largest, previous = state[_SUM], state[_MAX], state[_PREVIOUS]
    for k in range(first, first + count):
        q = block[k]
        total += q * q
        q = abs(q)
        ring[place] = total
        place = place + 1 if place < width else 0  # now where the sum at n - width is: the first sample of the window
        if due:
            state[_RIGHT] = q
            due = False
        if q > largest:
            largest, at, due = q, n, True
            state[_LEFT], state[_RIGHT] = previous, q
            state[_SUM0] = ring[place] if n >= width else ring[0]
        if n <= at + width:
            state[_SUM1] = total
        previous = q
        n += 1
    state[_NEXT], state[_AT], state[_DUE] = n, at, 1.0 if due else 0.0
    state[_SUM], state[_MAX], state[_PREVIOUS] = total, largest, previous


@jit
def close_level(level):  # type: ignore[no-untyped-def]
    """Return (response level in m, sample of the maximum with a parabola's fraction, largest |q| in m).

    The window is cut where the run starts or ends. The RMS is the mean of the samples after the window's first.
    """
    ring, state, _ = level
    width = ring.shape[0] - 1
    if state[_NEXT] < 2.0:
        return abs(state[_MAX]), 0.0, abs(state[_MAX])
    at = state[_AT]
    first = max(0.0, at - width)
    last = min(state[_NEXT] - 1.0, at + width)
    mean = (state[_SUM1] - state[_SUM0]) / max(last - first, 1.0)
    left, peak, right = state[_LEFT], state[_MAX], state[_RIGHT]
    bend = left - 2.0 * peak + right
    shift = 0.0
    if bend < 0.0 and at > 0.0:
        shift = 0.5 * (left - right) / bend
        peak -= 0.25 * (left - right) * shift
    return np.sqrt(max(mean, 0.0)), at + shift, peak


@jit
def push_impact(events, time, relative_velocity, impulse, loss, absorber=None):  # type: ignore[no-untyped-def]
    """Append an impact to the list, if one is kept. ``absorber`` None: there is only one."""
    if events is None:
        return
    k = events.counts[0]
    if k < events.impacts.shape[0]:
        events.impacts[k, 0] = time
        events.impacts[k, 1] = relative_velocity
        events.impacts[k, 2] = impulse
        events.impacts[k, 3] = loss
        if absorber is not None:
            events.impacts[k, 4] = absorber
    events.counts[0] = k + 1


@jit
def push_phase(events, start, end, kind, absorber=None):  # type: ignore[no-untyped-def]
    """Append a contact phase to the list, if one is kept. ``absorber`` None: there is only one."""
    if events is None:
        return
    k = events.counts[1]
    if k < events.phases.shape[0]:
        events.phases[k, 0] = start
        events.phases[k, 1] = end
        events.phases[k, 2] = kind
        if absorber is not None:
            events.phases[k, 3] = absorber
    events.counts[1] = k + 1
