"""The next event of a regime: where a guard signal y leaves (low, high), or where its rate changes sign. No event is missed.

Proof. Let y = y_k + r_k, where y_k keeps the forced part, the polynomial and the slots of the first k blocks, and r_k the slots of the
other blocks. A slot's amplitude never grows, so from the current time on |r_k| <= H0, |r_k'| <= H1, |y_k''| <= B2 and |y_k'''| <= B3, with
sums over the slots' amplitudes. With d the distance of y_k to a wall less H0, g its closing speed and a its closing acceleration (all exact),
y keeps off the wall for s >= 0 as long as d - g s - b s^2/2 > 0, where b bounds the closing acceleration over the step: b = B2, or b = a + B3 S
for steps up to S. The smallest positive root of that parabola, cut to S, is therefore a safe step. For the rate the same holds one
derivative higher. The search advances by the smallest, over the guards, of the safe steps for a k that leaves little out, so it never passes
an event. Where the signal is monotone over twice the way to a guard (`root_ahead`), the event there is the next one and simple, and Newton's
method ends on it. Else the safe step with k the last block (H0 = 0) is Newton's step less a term of second order, and closes in from the
safe side. It stops when the step is below the resolution of time, or the distance below the rounding of y.

Leaving a wall. At a start on a wall (or at rate zero) y - wall is known to be zero while its computed value is rounding noise. There
the signal less its start is developed in a Taylor series, divided by its known factor; the remainder is of relative size (|s| t)^3/60 with
|s| t <= MICRO_REACH. Returns within that reach (the last flights of a chatter) are found in this series. The one weak spot: after a slow start
at rate zero the wall ahead is not watched within that reach, so an impact there is taken at its end, late by at most MICRO_REACH/|s|.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import guard_values, signal_value
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.slots import (
    FADE_HIGH,
    FADE_MIDDLE,
    FASTEST,
    FINEST,
    HEAD_SLOTS,
    MIDDLE,
    SPEED,
    digits,
    high_derivatives,
    slowest_on_grid,
    sum_and_bound,
    sum_and_bound_on_grid,
    sum_block,
)

# events
NOTHING, HIT_LOW, HIT_HIGH, REVERSAL = 0, 1, 2, 3
MICRO_REACH = 0.01
TIME_RESOLUTION = 5e-15  # of the slowest slot's time scale
EPSILON = 2.2e-16
NOISE = 4.0 * EPSILON  # rounding of a computed signal, relative to its scale
MAX_EVALUATIONS = 2_000_000
GROWTH = 4.0  # of a safe step against the one before
CLEAR = 0.5  # the blocks left out may take up this share of a distance


class Signal(NamedTuple):
    """A guard signal from a reference time on: slots' amplitudes ``u`` (2, J), a polynomial p0 + p1 t + p2 t^2/2 (3,)."""

    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]


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
    return Signal(np.zeros((2, size)), np.zeros(3))


@jit
def signal_scale(signal, bound):  # type: ignore[no-untyped-def]
    """Return the size of the terms that a signal is the sum of."""
    scale = bound[0] + abs(signal.polynomial[0])
    for j in range(signal.u.shape[1]):
        scale += abs(signal.u[0, j]) + abs(signal.u[1, j])
    return scale


@jit_inline
def parabola(d, g, b):  # type: ignore[no-untyped-def]
    """Return the smallest s > 0 with d - g s - b s^2/2 = 0 for d > 0, b >= 0; a huge number if there is none."""
    root = np.sqrt(g * g + 2.0 * b * d)
    if g >= 0.0:
        return 2.0 * d / (g + root + 1e-300)
    return (root - g) / (b + 1e-300)


@jit_inline
def safe_step(d, g, a, b2, b3, reach):  # type: ignore[no-untyped-def]
    """Return a step within which the wall at distance d > 0 cannot be reached; g closing speed, a closing acceleration.

    ``reach``: a guess of the step; no result is longer.
    """
    b = min(a + b3 * reach, b2)
    step = min(parabola(d, g, max(b, 0.0)), reach)
    if step < 0.4 * reach:  # the bound over the reach was too careful
        b = min(a + 2.0 * b3 * step, b2)
        step = max(step, min(parabola(d, g, max(b, 0.0)), 2.0 * step))
    return step


@jit_inline
def guards_step(low, high, direction, y, v, a, rest0, rest1, b2, b3, reach):  # type: ignore[no-untyped-def]
    """Return the safe step for all guards; the distances must be above what the left-out blocks (rest0, rest1) can take up."""
    step = reach
    if low is not None:
        to_high, to_low = high - y - rest0, y - low - rest0
        if v >= 0.0:
            ahead, behind, closing, bend = to_high, to_low, v, a
        else:
            ahead, behind, closing, bend = to_low, to_high, -v, -a
        if ahead < np.inf:
            step = safe_step(ahead, closing, bend, b2, b3, reach)
        # the wall behind needs a root only if the step could take the signal back to it
        if not behind + closing * step - 0.5 * b2 * step * step > 0.0:
            step = min(step, safe_step(behind, -closing, -bend, b2, b3, reach))
    if direction is not None:
        step = min(step, parabola(max(direction * v - rest1, 0.0), -direction * a, b3))
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
    """Return the first root in (0, reach] of v + a t/2 + j t^2/6 + s t^3/24, or -1 if it does not turn negative."""
    previous = 0.0
    for k in range(1, 5):
        t = reach * k / 4
        if v + t * (a / 2 + t * (j / 6 + t * s / 24)) < 0.0:
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


@jit_inline
def exactly_on_guard(low, high, side, noise, y, v):  # type: ignore[no-untyped-def]
    """Return signal and rate without the rounding of the guard on which they start; a wall that is not left keeps a distance of ``noise``."""
    if low is None:
        return y, 0.0
    if side == 0:
        return max(min(y, high - noise), low + noise), 0.0
    return (high, v) if side > 0 else (low, v)


@jit_inline
def leaves_quickly(slots, side, direction, v, a, b2, b3):  # type: ignore[no-untyped-def]
    """Return whether a start on a guard leaves it so quickly that the safe step from distance zero is beyond the rounding."""
    reach = MICRO_REACH / slots.scale[FASTEST]
    if side != 0:
        return -side * v > b2 * reach
    if direction is not None:
        return direction * a > b3 * reach
    return False


@jit
def start_on_guard(slots, forced, omega, signal, tau, side, direction, zero_rate, v, a):  # type: ignore[no-untyped-def]
    """Return (offset, event): the offset from which the search may trust computed distances, or an event before it.

    ``side`` -1 or 1: the signal starts on the low or the high wall; ``zero_rate``: its rate starts at zero. ``v``, ``a``: rate and second
    derivative at the start.
    """
    reach = MICRO_REACH / slots.scale[FASTEST]
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
def root_ahead(low, high, direction, y, v, a, b2, b3):  # type: ignore[no-untyped-def]
    """Return (kind, step) of the event ahead if it is certain to be the next one and simple, else NOTHING.

    A wall: the closing speed stays positive over twice the step. A reversal: the rate's slope keeps its sign over twice the step, and the wall
    ahead is further than the way made in it.
    """
    if direction is not None:
        w, slope = direction * v, -direction * a
        if slope > 0.0:
            step = w / slope
            if slope > 2.0 * b3 * step:
                if low is None:
                    return REVERSAL, step
                ahead = high - y if v > 0.0 else y - low
                if ahead > 2.0 * w * step:
                    return REVERSAL, step
    if low is not None:
        if v > 0.0:
            d, g, c, kind = high - y, v, a, HIT_HIGH
        else:
            d, g, c, kind = y - low, -v, -a, HIT_LOW
        if d < np.inf and g * g > 4.0 * b2 * d:
            step = 2.0 * d / (g + np.sqrt(max(g * g + 2.0 * c * d, 0.0)))
            if 2.0 * b2 * step < g:
                return kind, step
    return NOTHING, 0.0


@jit
def refine(slots, signals, omega, signal, tau, offset, step, kind, wall, b3, resolution):  # type: ignore[no-untyped-def]
    """Return the simple root near offset + step as an Event, by Newton's method with curvature.

    The last step is not evaluated again: it must be so short that the third derivative's bound b3 leaves time and rate exact.
    """
    rows, table, scale, p = slots.rows, slots.table, slots.scale, signal.polynomial
    y, v, a, count = 0.0, 0.0, 0.0, 0
    offset += step
    while count < 12:
        count += 1
        d1, d2, d3, x = digits(scale, offset)
        y, v, a = sum_block(rows, table, signal.u, d1, d2, d3, x, 0, signal.u.shape[1])
        f0, f1, f2 = guard_values(signals, omega, tau + offset)
        y += f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
        v += f1 + p[1] + offset * p[2]
        a += f2 + p[2]
        if kind == REVERSAL:
            step = -v / a
            exact = 0.5 * b3 * step * step <= abs(a) * resolution
        else:
            d = wall - y if kind == HIT_HIGH else y - wall
            g = v if kind == HIT_HIGH else -v
            c = a if kind == HIT_HIGH else -a
            step = d / g * (1.0 - 0.5 * c * d / (g * g))
            exact = b3 * step * step <= EPSILON * g
        offset += step
        y += step * (v + 0.5 * step * a)
        v += step * a
        if exact or abs(step) <= resolution:
            break
    return Event(kind, offset, y, v, a, count)


@jit
def search(slots, forced, omega, signal, tau, length, low, high, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return the first Event within ``length`` (s) from tau; its offset is ``length`` if there is none.

    ``low`` and ``high`` may be infinite; None: there are no walls at all. ``direction`` None: the rate is not watched; 1 or -1: the sign
    that it has at the start. ``side`` and ``zero_rate`` as in `start_on_guard`.
    """
    rows, table, scale, signals = slots.rows, slots.table, slots.scale, forced.signals
    u, p = signal.u, signal.polynomial
    size = u.shape[1]
    middle = min(MIDDLE, size)
    finest = scale[FINEST]
    resolution = max(TIME_RESOLUTION / rows[SPEED, 0], 4.0 * EPSILON * length)
    # bounds: slowest slot, then the others of the head, of the middle and of the high block (the last two as of ``anchor``)
    slow0 = np.sqrt(u[0, 0] * u[0, 0] + u[1, 0] * u[1, 0])
    slow2 = forced.bound[2] + abs(p[2]) + slow0 * rows[SPEED, 0] ** 2
    slow3 = forced.bound[3] + slow0 * rows[SPEED, 0] ** 3
    head0, head1, middle0, middle1, high0, high1, high2, high3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(1, HEAD_SLOTS):
        size_j = np.sqrt(u[0, j] * u[0, j] + u[1, j] * u[1, j])
        head0 += size_j
        head1 += size_j * rows[SPEED, j]
    noise, offset, anchor, count, reach = 0.0, 0.0, 0.0, 0, length
    while offset < length and count < MAX_EVALUATIONS:
        count += 1
        d1, d2, d3, x = digits(scale, offset)
        f0, f1, f2 = guard_values(signals, omega, tau + offset)
        f0 += p[0] + offset * (p[1] + 0.5 * offset * p[2])
        f1 += p[1] + offset * p[2]
        f2 += p[2]
        y, v, a, b2, b3, rest0, rest1, clear, on_guard = 0.0, 0.0, 0.0, slow2, slow3, 0.0, 0.0, False, False
        if x == 0.0 and count > 1:
            y, v, a = slowest_on_grid(rows, table, u, d1, d2, d3)
            y, v, a = y + f0, v + f1, a + f2
            fade_m, fade_h = fade(scale[FADE_MIDDLE], offset - anchor), fade(scale[FADE_HIGH], offset - anchor)
            rest0, rest1 = head0 + middle0 * fade_m + high0 * fade_h, head1 + middle1 * fade_m + high1 * fade_h
            clear = is_clear(low, high, direction, y, v, rest0, rest1)
        if not clear:
            if x == 0.0:
                y, v, a, b2, b3, h0, h1, h2, g2, g3, r0, r1 = sum_and_bound_on_grid(rows, table, u, d1, d2, d3, 0, middle)
            else:
                y, v, a, b2, b3, h0, h1, h2, g2, g3, r0, r1 = sum_and_bound(rows, table, u, d1, d2, d3, x, 0, middle)
            fade_h = fade(scale[FADE_HIGH], offset - anchor)
            high0, high1, high2, high3 = high0 * fade_h, high1 * fade_h, high2 * fade_h, high3 * fade_h
            middle0, middle1, anchor = r0, r1, offset
            y, v, a, b2, b3 = y + f0, v + f1, a + f2, b2 + forced.bound[2] + abs(p[2]), b3 + forced.bound[3]
            h0, h1, h2 = h0 + f0, h1 + f1, h2 + f2
            rest0, rest1 = middle0 + high0, middle1 + high1
            if count > 1 and is_clear(low, high, direction, h0, h1, rest0, rest1):
                y, v, a, clear = h0, h1, h2, True
                b2, b3 = g2 + forced.bound[2] + abs(p[2]), g3 + forced.bound[3]
            else:
                rest0, rest1 = high0, high1
                if size > middle:
                    if count > 1 and is_clear(low, high, direction, y, v, rest0, rest1):
                        clear = True
                    else:
                        if x == 0.0:
                            h0, h1, h2, high2, high3, _, _, _, _, _, high0, high1 = sum_and_bound_on_grid(rows, table, u, d1, d2, d3, middle, size)
                        else:
                            h0, h1, h2, high2, high3, _, _, _, _, _, high0, high1 = sum_and_bound(rows, table, u, d1, d2, d3, x, middle, size)
                        y, v, a, b2, b3 = y + h0, v + h1, a + h2, b2 + high2, b3 + high3
                        rest0, rest1 = 0.0, 0.0
        if count == 1:
            noise = NOISE * signal_scale(signal, forced.bound)
            if noise == 0.0 and v == 0.0 and a == 0.0:  # a signal that is zero for ever: an absorber at rest on a wall at rest
                break
            if side != 0 or zero_rate:
                if not leaves_quickly(slots, side, direction, v, a, b2, b3):
                    offset, kind = start_on_guard(slots, forced, omega, signal, tau, side, direction, zero_rate, v, a)
                    if kind != NOTHING and offset <= length:
                        y, v, a = at_offset(slots, signals, omega, signal, tau, offset)
                        return Event(kind, offset, y, v, a, 2)
                    continue
                on_guard = True
                y, v = exactly_on_guard(low, high, side, noise, y, v)
        if not (clear or on_guard):
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
            kind, step = root_ahead(low, high, direction, y, v, a, b2, b3)
            if kind != NOTHING:
                if offset + 2.0 * step < length:
                    wall = 0.0
                    if low is not None:
                        wall = high if kind == HIT_HIGH else low
                    found = refine(slots, signals, omega, signal, tau, offset, step, kind, wall, b3, resolution)
                    return Event(kind, found.offset, found.value, found.rate, found.bend, count + found.evaluations)
        step = guards_step(low, high, direction, y, v, a, rest0, rest1, b2, b3, reach)
        if on_guard:
            step *= 0.5  # the whole of it could end on the guard again
        reach = GROWTH * step
        if not step >= 0.0:  # not a number: the caller finds it in the state
            return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
        if offset + step >= length:  # also where the length left is below the resolution of time
            break
        if step <= resolution:
            return Event(nearest_event(low, high, direction, y, v, a), offset, y, v, a, count)
        offset += step
        if step > 2.0 * finest:
            offset = np.floor(offset / finest) * finest
    if count >= MAX_EVALUATIONS:  # not a number, so that the run ends in an error: an event could be missed
        return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
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
