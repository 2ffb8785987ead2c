"""A guard signal between two events.

The module contains its parts, its guards, its value at an offset, and the result of a search for
its events.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, jit_view
from impact_env.kernels.motion.forced import (
    THIRD,
    Forced,
    evaluate_first_signals,
    evaluate_polynomial,
    evaluate_signal,
)
from impact_env.kernels.motion.modal_system import (
    POINTS,
    SPEED,
    ModalSystem,
    cos_sin,
    split_time,
    sum_amplitudes,
    sum_magnitudes,
    sum_three_derivatives,
)

# positions in `Signal.block`: rows of 1 + POINTS numbers, at the block's start and at POINTS times,
# of the value, the rate and the second derivative (bend), then rows of their forced parts; then
# real and imaginary part of the force's carrier at POINTS times
ROW = 16
VALUE = 0
RATE = ROW
BEND = 2 * ROW
FORCED = 3 * ROW
COS = 6 * ROW
SIN = 6 * ROW + POINTS
BLOCK = 7 * ROW

# events
NOTHING = 0
HIT_LOW = 1
HIT_HIGH = 2
REVERSAL = 3
TIME_RESOLUTION = 5e-15  # of the time scale of the slowest modal amplitude, or of a quicker force
EPSILON = 2.2e-16
SIGNAL_ROUNDING = 4.0 * EPSILON  # rounding of a computed signal, relative to its scale
MOST_SEARCH_EVALUATIONS = 2e7  # evaluations after which a search fails
# largest share of the curvature in a step of Newton's method: below it the series of the step is as
# good as its root
CURVATURE_SHARE_TOL = 1e-4


class Signal(NamedTuple):
    """A guard signal from a reference time on, and memory for its search."""

    u: NDArray[np.float64]  # (2, J) amplitudes of its free part at the reference time
    polynomial: NDArray[np.float64]  # (3,) p0, p1, p2: p0 + p1 t + p2 t^2/2 is added
    moving: NDArray[np.float64]  # (6 J,) = (3, 2, J) amplitudes of value, rate, bend at a block
    block: NDArray[np.float64]  # (BLOCK,) value, rate and bend at its times
    memory: NDArray[np.float64]  # (2,) level that a search begins with, its most evaluations


class EventFunction(NamedTuple):
    """A guard signal in a window: sum over amplitudes, forced part and polynomial."""

    system: ModalSystem  # of its regime
    forced: Forced  # response of its regime in the window
    omega: float  # carrier of the force (rad/s)
    signal: Signal  # from its reference time on
    tau: float  # reference time (s from the window's centre)


class SignalTerms(NamedTuple):
    """The parts of an `EventFunction` that its value needs.

    They are fields of `ModalSystem`, `Forced`, `EventFunction` and `Signal`. Other fields are left
    out, because each array costs time at a call.
    """

    rows: NDArray[np.float64]
    table: NDArray[np.float64]
    scale: NDArray[np.float64]
    signals: NDArray[np.float64]
    omega: float
    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    tau: float


class Guards(NamedTuple):
    """What ends a search, and which guard the signal starts on."""

    low: float  # lower bound of the signal; without one, -infinity or a value out of reach
    high: float  # upper bound; without one, infinity or a value out of reach
    side: int  # -1 or 1: the signal starts on the lower or the upper bound, else 0
    direction: float | None  # sign (1 or -1) that the signal's rate must keep; None: any
    zero_rate: bool  # whether the rate starts at zero


class BoundedSignal(NamedTuple):
    """A signal at a time, with bounds that hold for all later times."""

    y: float  # value
    v: float  # rate
    a: float  # second derivative
    b2: float  # bound of the second derivative
    b3: float  # of the third
    b4: float  # of the fourth


class GuardEvent(NamedTuple):
    """Result of a search for an event.

    An offset of NaN: the search has failed (`make_failed_search`).
    """

    kind: int  # NOTHING, HIT_LOW, HIT_HIGH or REVERSAL
    offset: float  # from the signal's reference time (s)
    value: float  # of the signal there
    rate: float  # of the signal there
    bend: float  # second derivative there
    evaluations: int  # number of evaluations in the search


@jit_allocating
def new_signal(size):
    """Return a `Signal` of ``size`` modal amplitudes, all zero."""
    return Signal(
        np.zeros((2, size)),
        np.zeros(3),
        np.zeros(6 * size),
        np.zeros(BLOCK),
        np.array([0.0, MOST_SEARCH_EVALUATIONS]),
    )


@jit_view
def select_terms(function):
    """Return the `SignalTerms` of an `EventFunction`."""
    system = function.system
    signal = function.signal
    return SignalTerms(
        system.rows,
        system.table,
        system.scale,
        function.forced.signals,
        function.omega,
        signal.u,
        signal.polynomial,
        function.tau,
    )


@jit_inline
def compute_signal_scale(signal, bound):
    """Return the sum of the magnitudes of a signal's terms; ``bound``: `Forced.bound`."""
    return bound[0] + abs(signal.polynomial[0]) + sum_magnitudes(signal.u.shape[1], signal.u)


@jit_inline
def evaluate_terms(terms, offset):
    """Return (y, y', y'', y''') of a signal at an offset (s) from its reference time."""
    p = terms.polynomial
    rows = terms.rows
    table = terms.table
    tau = terms.tau + offset
    d1, d2, d3, x = split_time(terms.scale, offset)
    y, v, a, j = sum_three_derivatives(
        rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, terms.u
    )
    c, s = cos_sin(terms.omega * tau)
    f0, f1, f2 = evaluate_first_signals(terms.signals, tau, c, s)
    f3 = evaluate_polynomial(terms.signals, THIRD, tau, c, s)
    return (
        y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2]),
        v + f1 + p[1] + offset * p[2],
        a + f2 + p[2],
        j + f3,
    )


@jit
def evaluate_at_offset(system, signals, omega, signal, tau, offset):
    """Return (y, y', y'') of a signal at an offset (s) from its reference time ``tau``.

    ``signals``: `Forced.signals`; ``omega``: carrier (rad/s); ``tau``: s from the window's centre.
    """
    y, v, a, _ = evaluate_terms(
        SignalTerms(
            system.rows,
            system.table,
            system.scale,
            signals,
            omega,
            signal.u,
            signal.polynomial,
            tau,
        ),
        offset,
    )
    return y, v, a


@jit
def evaluate_value_at_offset(system, signals, omega, signal, tau, offset):
    """Return a signal at an offset (s) from its reference time.

    Arguments are those of `evaluate_at_offset`.

    The value equals that of `evaluate_at_offset` to the last digit.
    """
    p = signal.polynomial
    y = sum_amplitudes(system.rows, system.table, system.scale, signal.u, offset)
    return (
        y
        + evaluate_signal(signals, 0, omega, tau + offset)
        + p[0]
        + offset * (p[1] + 0.5 * offset * p[2])
    )


@jit_inline
def compute_time_resolution(rows, omega, length):
    """Return the shortest time (s) that a search over ``length`` (s) resolves.

    It follows from the slowest modal amplitude, or from the force's frequency ``omega`` (rad/s) if
    this is higher. ``rows``: `ModalSystem.rows`.
    """
    return max(TIME_RESOLUTION / max(rows[SPEED, 0], omega), 4.0 * EPSILON * length)


@jit_inline
def find_event_wall(kind, guards):
    """Return the bound of the signal that an event of a kind reaches; unused for a REVERSAL."""
    return guards.high if kind == HIT_HIGH else guards.low


@jit_inline
def replace_evaluations(event, evaluations):
    """Return a copy of a `GuardEvent` with another number of evaluations."""
    return GuardEvent(event.kind, event.offset, event.value, event.rate, event.bend, evaluations)


@jit_inline
def make_failed_search(evaluations):
    """Return a `GuardEvent` at NaN, which ends the run with an error: an event could be missed."""
    return GuardEvent(NOTHING, np.nan, np.nan, np.nan, np.nan, evaluations)


@jit
def refine_root(terms, offset, kind, wall, b4, resolution):
    """Return the simple root near ``offset`` (s) of a signal as a `GuardEvent` of ``kind``.

    The kind of the result is NOTHING if 12 steps do not suffice. ``wall``: bound that the signal
    reaches, unused for a REVERSAL; ``b4``: bound of the fourth derivative; ``resolution``: of time
    (s).

    Newton's method is used with the second and third derivatives. The last step is not evaluated
    again: it must be so short that time and rate are exact by the bound b4.
    """
    y = 0.0
    v = 0.0
    a = 0.0
    count = 0
    while count < 12:
        count += 1
        y, v, a, j = evaluate_terms(terms, offset)
        if kind == REVERSAL:
            inverse = 1.0 / a
            step = -v * inverse
            e = 0.5 * j * step * inverse
            step -= step * e * (1.0 - 2.0 * e)
            exact = (
                b4 * abs(step * step * step) <= 6.0 * abs(a) * resolution
                and abs(e) < CURVATURE_SHARE_TOL
            )
        else:
            d = wall - y if kind == HIT_HIGH else y - wall
            g = v if kind == HIT_HIGH else -v
            c = a if kind == HIT_HIGH else -a
            k = j if kind == HIT_HIGH else -j
            inverse = 1.0 / g
            first = d * inverse
            e = 0.5 * c * first * inverse
            step = first * (1.0 - e * (1.0 - 2.0 * e) - k * first * first * inverse / 6.0)
            exact = (
                b4 * abs(step * step * step) <= 6.0 * EPSILON * g and abs(e) < CURVATURE_SHARE_TOL
            )
        offset += step
        y += step * (v + step * (0.5 * a + step * j / 6.0))
        v += step * (a + 0.5 * step * j)
        a += step * j
        if exact or abs(step) <= resolution:
            return GuardEvent(kind, offset, y, v, a, count)
    return GuardEvent(NOTHING, 0.0, 0.0, 0.0, 0.0, count)
