"""The next event of a regime: where a guard signal y leaves (low, high), or where its rate changes sign. No event is missed.

Proof. Let y = y_k + r_k, where y_k keeps the forced part, the polynomial and the slots of the first k blocks, and r_k the slots of the other
blocks. A slot's amplitude never grows, so from the current time on |r_k| <= H0, |r_k'| <= H1, |y_k''| <= B2 and |y_k'''| <= B3, with the sums that
`Bounds` holds. With d the distance of y_k to a wall less H0, g its closing speed and a its closing acceleration (all exact), y keeps off
the wall for s >= 0 as long as d - g s - b s^2/2 > 0, where b bounds the closing acceleration over the step: b = B2, or
b = a + B3 S for steps up to S. The smallest positive root of that parabola, cut to S in the second case, is therefore a safe step. For the rate the same holds
one derivative higher. The search advances by the smallest, over the guards, of the largest safe step over k, so it never passes an event. With k
the last block H0 = 0, and near a wall the safe step is Newton's step less a term of second order: the search closes in on the event quadratically,
from the safe side. It stops when the step is below the resolution of time, or the distance below the rounding of y.

Leaving a wall. At a start on a wall (or at rate zero) y - wall is known to be zero while its computed value is rounding noise. There
the signal less its start is developed in a Taylor series, divided by its known factor; the remainder is of relative size (|s| t)^3/60 with
|s| t <= MICRO_REACH. Returns within that reach (the last flights of a chatter) are found in this series.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import guard_values, signal_value
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.slots import (
    BASE,
    FADE_HIGH,
    FADE_MIDDLE,
    FASTEST,
    FINEST,
    LOW,
    MIDDLE,
    block_amplitudes,
    digits,
    high_derivatives,
    sum_block,
    sum_block_on_grid,
)

# events
NOTHING, HIT_LOW, HIT_HIGH, REVERSAL = 0, 1, 2, 3
MICRO_REACH = 0.01
TIME_RESOLUTION = 1e-16  # of the window's length
EPSILON = 2.2e-16
MAX_EVALUATIONS = 2_000_000
CLEAR = 0.5  # the blocks left out may take up this share of a distance


class Signal(NamedTuple):
    """A guard signal from a reference time on: slots' amplitudes ``u`` (2, J), a polynomial p0 + p1 t + p2 t^2/2 (3,), bounds (4, 4).

    Rows of ``bounds``: low, middle and high block, and forced part with polynomial; columns: derivative 0 ... 3.
    """

    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    bounds: NDArray[np.float64]


class Event(NamedTuple):
    """What ended a search: kind, offset from the start (s), signal, its rate and its second derivative there, evaluations made."""

    kind: int
    offset: float
    value: float
    rate: float
    bend: float
    evaluations: int


@jit
def new_signal(size):  # type: ignore[no-untyped-def]
    """Return room for a signal of ``size`` slots."""
    return Signal(np.zeros((2, size)), np.zeros(3), np.zeros((4, 4)))


@jit
def bound_signal(rows, bound, signal):  # type: ignore[no-untyped-def]
    """Fill the signal's bounds; ``bound`` is that of the forced part."""
    u, b = signal.u, signal.bounds
    size = u.shape[1]
    middle = min(MIDDLE, size)
    b[0, 0], b[0, 1], b[0, 2], b[0, 3] = block_amplitudes(rows, u, 0, LOW)
    b[1, 0], b[1, 1], b[1, 2], b[1, 3] = block_amplitudes(rows, u, LOW, middle)
    if size > middle:
        b[2, 0], b[2, 1], b[2, 2], b[2, 3] = block_amplitudes(rows, u, middle, size)
    b[3, 0] = bound[0] + abs(signal.polynomial[0])
    b[3, 2] = bound[2] + abs(signal.polynomial[2])
    b[3, 3] = bound[3]


@jit_inline
def parabola(d, g, b):  # type: ignore[no-untyped-def]
    """Return the smallest s > 0 with d - g s - b s^2/2 = 0 for d > 0, b >= 0; a huge number if there is none."""
    root = np.sqrt(g * g + 2.0 * b * d)
    if g >= 0.0:
        return 2.0 * d / (g + root + 1e-300)
    return (root - g) / (b + 1e-300)


@jit_inline
def safe_step(d, g, a, b2, b3):  # type: ignore[no-untyped-def]
    """Return a step within which the wall at distance d > 0 cannot be reached; g closing speed, a closing acceleration."""
    step = parabola(d, g, b2)
    reach = 2.0 * step
    for _ in range(3):
        b = a + b3 * reach
        if b >= b2:
            break
        s = parabola(d, g, max(b, 0.0))
        if s < reach:
            step = max(step, s)
            break
        step = reach
        reach *= 2.0
    return step


@jit_inline
def guards_step(low, high, direction, y, v, a, rest0, rest1, b2, b3):  # type: ignore[no-untyped-def]
    """Return the safe step for all guards; the distances must be above what the left-out blocks (rest0, rest1) can take up."""
    step = np.inf
    if low is not None:
        to_high, to_low = high - y - rest0, y - low - rest0
        if v >= 0.0:
            ahead, behind, closing, bend = to_high, to_low, v, a
        else:
            ahead, behind, closing, bend = to_low, to_high, -v, -a
        if ahead < np.inf:
            step = safe_step(ahead, closing, bend, b2, b3)
        # the wall behind needs a root only if the step could take the signal back to it
        if behind < np.inf and not behind + closing * step - 0.5 * b2 * step * step > 0.0:
            step = min(step, safe_step(behind, -closing, -bend, b2, b3))
    if direction is not None:
        step = min(step, parabola(direction * v - rest1, -direction * a, b3))
    return step


@jit_inline
def is_clear(low, high, direction, y, v, rest0, rest1):  # type: ignore[no-untyped-def]
    """Return whether the blocks left out are small against every distance."""
    clear = True
    if low is not None:
        clear = rest0 < CLEAR * min(high - y, y - low)
    if direction is not None:
        clear = clear and rest1 < CLEAR * direction * v
    return clear


@jit
def micro_flight(v, a, j, s, reach):  # type: ignore[no-untyped-def]
    """Return the first root in (0, reach] of v + a t/2 + j t^2/6 + s t^3/24, or -1 if it stays positive."""
    previous = 0.0
    for k in range(1, 5):
        t = reach * k / 4
        if v + t * (a / 2 + t * (j / 6 + t * s / 24)) <= 0.0:
            left, right = previous, t
            for _ in range(200):
                mid = 0.5 * (left + right)
                if mid <= left or mid >= right:
                    break
                if v + mid * (a / 2 + mid * (j / 6 + mid * s / 24)) > 0.0:
                    left = mid
                else:
                    right = mid
            return right
        previous = t
    return -1.0


@jit
def start_on_guard(slots, forced, omega, signal, tau, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return (offset, event): the offset from which the search may trust computed distances, or an event before it.

    ``side`` -1 or 1: the signal starts on the low or the high wall; ``zero_rate``: its rate starts at zero.
    """
    reach = MICRO_REACH / slots.scale[FASTEST]
    _, v, a = at_offset(slots, forced.signals, omega, signal, tau, 0.0)
    if side != 0 and -side * v > signal_b2(signal) * reach:
        return 0.0, NOTHING
    j, s = high_derivatives(slots.rows, signal.u)
    j += signal_value(forced.signals, 3, omega, tau)
    s += signal_value(forced.signals, 4, omega, tau)
    if side != 0:
        t = micro_flight(-side * v, -side * a, -side * j, -side * s, reach)
        if t >= 0.0:
            return t, HIT_HIGH if side > 0 else HIT_LOW
    if direction is not None:
        if zero_rate:
            t = micro_flight(direction * a, direction * j, direction * s, 0.0, reach)
            if t >= 0.0:
                return t, REVERSAL
    return reach, NOTHING


@jit
def signal_b2(signal):  # type: ignore[no-untyped-def]
    """Return the bound of the signal's second derivative."""
    b = signal.bounds
    return b[0, 2] + b[1, 2] + b[2, 2] + b[3, 2]


@jit
def at_offset(slots, signals, omega, signal, tau, offset):  # type: ignore[no-untyped-def]
    """Return the signal and its first two derivatives at an offset from its reference time."""
    d1, d2, d3, x = digits(slots.scale, offset)
    y, v, a = sum_block(slots.rows, slots.table, signal.u, d1, d2, d3, x, 0, signal.u.shape[1])
    f0, f1, f2 = guard_values(signals, omega, tau + offset)
    p = signal.polynomial
    return y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2]), v + f1 + p[1] + offset * p[2], a + f2 + p[2]


@jit_inline
def fade(rate, offset):  # type: ignore[no-untyped-def]
    """Return a number above exp(-rate * offset) without calling exp."""
    x = rate * offset
    return 1.0 / (1.0 + x * (1.0 + 0.5 * x))


@jit_inline
def block(rows, table, u, on_grid, d1, d2, d3, x, start, stop):  # type: ignore[no-untyped-def]
    """Return the sums over a block by the cheaper way where the offset allows it."""
    if on_grid:
        return sum_block_on_grid(rows, table, u, d1, d2, start, stop)
    return sum_block(rows, table, u, d1, d2, d3, x, start, stop)


@jit
def search(slots, forced, omega, signal, tau, length, low, high, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return the first Event within ``length`` (s) from tau; its offset is ``length`` if there is none.

    ``low`` and ``high`` may be infinite; None: there are no walls at all. ``direction`` None: the rate is not watched; 1 or -1: the sign
    that it has at the start. ``side`` and ``zero_rate`` as in `start_on_guard`.
    """
    rows, table, scale, signals = slots.rows, slots.table, slots.scale, forced.signals
    u, b, p = signal.u, signal.bounds, signal.polynomial
    size = u.shape[1]
    middle = min(MIDDLE, size)
    grid = scale[FINEST] * scale[BASE]
    resolution = TIME_RESOLUTION * length + 1e-22
    noise = 4.0 * EPSILON * (b[0, 0] + b[1, 0] + b[2, 0] + b[3, 0])
    offset = 0.0
    if side != 0 or zero_rate:
        offset, kind = start_on_guard(slots, forced, omega, signal, tau, side, direction, zero_rate)
        if kind != NOTHING and offset <= length:
            y, v, a = at_offset(slots, signals, omega, signal, tau, offset)
            return Event(kind, offset, y, v, a, 2)
    count = 0
    while offset < length and count < MAX_EVALUATIONS:
        count += 1
        d1, d2, d3, x = digits(scale, offset)
        on_grid = d3 == 0 and x == 0.0
        y, v, a = guard_values(signals, omega, tau + offset)
        y += p[0] + offset * (p[1] + 0.5 * offset * p[2])
        v += p[1] + offset * p[2]
        a += p[2]
        l0, l1, l2 = block(rows, table, u, on_grid, d1, d2, d3, x, 0, LOW)
        y, v, a = y + l0, v + l1, a + l2
        b2, b3 = b[3, 2] + b[0, 2], b[3, 3] + b[0, 3]
        fade_m, fade_h = fade(scale[FADE_MIDDLE], offset), fade(scale[FADE_HIGH], offset)
        rest0, rest1 = b[1, 0] * fade_m + b[2, 0] * fade_h, b[1, 1] * fade_m + b[2, 1] * fade_h
        if not is_clear(low, high, direction, y, v, rest0, rest1):
            l0, l1, l2 = block(rows, table, u, on_grid, d1, d2, d3, x, LOW, middle)
            y, v, a = y + l0, v + l1, a + l2
            b2, b3 = b2 + b[1, 2] * fade_m, b3 + b[1, 3] * fade_m
            rest0, rest1 = b[2, 0] * fade_h, b[2, 1] * fade_h
            if size > middle:
                if not is_clear(low, high, direction, y, v, rest0, rest1):
                    l0, l1, l2 = block(rows, table, u, on_grid, d1, d2, d3, x, middle, size)
                    y, v, a = y + l0, v + l1, a + l2
                    b2, b3 = b2 + b[2, 2] * fade_h, b3 + b[2, 3] * fade_h
                    rest0, rest1 = 0.0, 0.0
        if direction is not None:
            if direction * v <= 0.0:
                return Event(REVERSAL, offset, y, v, a, count)
        if low is not None:
            if high - y <= noise:
                if v > 0.0:
                    return Event(HIT_HIGH, offset, y, v, a, count)
                y = high - noise
            if y - low <= noise:
                if v < 0.0:
                    return Event(HIT_LOW, offset, y, v, a, count)
                y = low + noise
        step = guards_step(low, high, direction, y, v, a, rest0, rest1, b2, b3)
        if step <= resolution:
            return Event(nearest_event(low, high, direction, y, v, a), offset, y, v, a, count)
        offset += step
        if step > 2.0 * grid:
            offset = np.floor(offset / grid) * grid
    return Event(NOTHING, length, 0.0, 0.0, 0.0, count)


@jit
def nearest_event(low, high, direction, y, v, a):  # type: ignore[no-untyped-def]
    """Return which guard the search has come down to."""
    to_high, to_low = np.inf, np.inf
    if low is not None:
        to_high, to_low = high - y, y - low
    if direction is not None:
        if direction * a < 0.0:
            distance = to_high if v > 0.0 else to_low
            if not distance < v * v / abs(a):
                return REVERSAL
    return HIT_HIGH if to_high < to_low else HIT_LOW
