"""The careful search: safe steps that no event can hide in, for the few places where the scan (search.py) cannot tell.

Proof. A slot's amplitude never grows, so from the current time on |y''| <= B2 and |y'''| <= B3, with sums over the slots' amplitudes. With d the
distance to a wall, g its closing speed and a its closing acceleration (all exact), y keeps off the wall for s >= 0 as long as
d - g s - b s^2/2 > 0, where b bounds the closing acceleration over the step: b = B2, or b = a + B3 S for steps up to S. The smallest positive
root of that parabola, cut to S, is therefore a safe step. For the rate the same holds one derivative higher. The search advances by the
smallest, over the guards, of the safe steps, so it never passes an event. Where the signal is monotone over twice the way to a guard
(`root_ahead`), the event there is the next one and simple, and Newton's method ends on it. Else the safe step is Newton's step less a
term of second order, and closes in from the safe side. It stops when the step is below the resolution of time, or the distance below the
rounding of y.

Leaving a wall. At a start on a wall (or at rate zero) y - wall is known to be zero while its computed value is rounding noise. There
the signal less its start is developed in a Taylor series, divided by its known factor; the remainder is of relative size (|s| t)^4/360 with
|s| t <= MICRO_REACH, s of the fastest slot or of a quicker force. Returns within that reach (the last flights of a chatter) are found in this
series, and so is the wall ahead of a start at rate zero: the last bounces of a chatter against friction end on it. A rate into the wall, as an
impact of another absorber can leave it, is a hit at once, be it only for a moment. A rate that starts at zero grows in the sense that it is
watched for, since sliding was begun in that sense: a second derivative of the other sign that is as small as rounding counts as zero.

Grazing. A signal that would go beyond a wall by less than its rounding, and turns there, does not reach it. Else a joint whose force touches its
bound would break and close without end.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.forced import FIFTH, FOURTH, THIRD, guard_values, signal_value
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.signals import HIT_HIGH, HIT_LOW, NOISE, NOTHING, REVERSAL, Event, at_offset, refine, signal_scale, time_resolution, wall_of
from impact_env.kernels.slots import FASTEST, SPEED, digits, high_derivatives, sum_and_bound

MICRO_REACH = 0.01
MAX_EVALUATIONS = 2_000_000
GROWTH = 4.0  # of a safe step against the one before
RATE_NOISE = 16.0 * NOISE  # rounding of a computed rate, relative to its scale
BEND_NOISE = 1e-11  # of a second derivative's scale: above the rounding of a change of basis


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
def guards_step(low, high, direction, y, v, a, b2, b3, reach):  # type: ignore[no-untyped-def]
    """Return the safe step for all guards."""
    step = reach
    if low is not None:
        to_high, to_low = high - y, y - low
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
        step = min(step, parabola(direction * v, -direction * a, b3))
    return step


@jit
def micro_root(d, v, a, j, s, c, reach):  # type: ignore[no-untyped-def]
    """Return the first root in (0, reach] of d + v t + a t^2/2 + j t^3/6 + s t^4/24 + c t^5/120, or -1 if it does not turn negative."""
    previous = 0.0
    for k in range(1, 5):
        t = reach * k / 4
        if d + t * (v + t * (a / 2 + t * (j / 6 + t * (s / 24 + t * c / 120)))) < 0.0:
            left, right = previous, t
            for _ in range(200):
                mid = 0.5 * (left + right)
                if mid <= left or mid >= right:
                    break
                if d + mid * (v + mid * (a / 2 + mid * (j / 6 + mid * (s / 24 + mid * c / 120)))) > 0.0:
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
def leaves_quickly(slots, omega, side, direction, v, a, b2, b3):  # type: ignore[no-untyped-def]
    """Return whether a start on a guard leaves it so quickly that the safe step from distance zero is beyond the rounding."""
    reach = MICRO_REACH / max(slots.scale[FASTEST], omega)
    if side != 0:
        return -side * v > b2 * reach
    if direction is not None:
        return direction * a > b3 * reach
    return False


@jit
def rate_noise(rows, u, rate_bound, rate):  # type: ignore[no-untyped-def]
    """Return the rounding of the rate of a signal: slots' amplitudes u, a bound of the forced part's rate, and the polynomial's."""
    scale = rate_bound + abs(rate)
    for j in range(u.shape[1]):
        scale += rows[SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return RATE_NOISE * scale


@jit
def start_on_guard(slots, forced, omega, signal, tau, low, high, side, direction, zero_rate, y, v, a, b2):  # type: ignore[no-untyped-def]
    """Return (offset, event): the offset from which the search may trust computed distances, or an event before it.

    ``side`` -1 or 1: the signal starts on the low or the high wall; ``zero_rate``: its rate starts at zero. ``y``, ``v``, ``a``: signal, rate and
    second derivative at the start, ``b2`` the last one's bound. What is known to be zero is left out: the constant term, divided by t, or the
    linear one. Where both a wall and the rate are watched the earlier event is returned.
    """
    if zero_rate:
        v = 0.0
    if side != 0:
        if side * v > rate_noise(slots.rows, signal.u, forced.bound[1], signal.polynomial[1]):
            return 0.0, HIT_HIGH if side > 0 else HIT_LOW
    reach = MICRO_REACH / max(slots.scale[FASTEST], omega)
    j, s, c = high_derivatives(slots.rows, signal.u)
    j += signal_value(forced.signals, THIRD, omega, tau)
    s += signal_value(forced.signals, FOURTH, omega, tau)
    c += signal_value(forced.signals, FIFTH, omega, tau)
    offset, event = reach, NOTHING
    if direction is not None:
        if zero_rate:
            bend = direction * a
            if -BEND_NOISE * b2 <= bend < 0.0:
                bend = 0.0
            t = micro_root(bend, direction * j / 2, direction * s / 3, direction * c / 4, 0.0, 0.0, offset)
        else:
            t = micro_root(direction * v, direction * a, direction * j, direction * s, direction * c, 0.0, offset)
        if t >= 0.0:
            offset, event = t, REVERSAL
    if side != 0:
        t = micro_root(-side * v, -side * a / 2, -side * j / 3, -side * s / 4, -side * c / 5, 0.0, offset)
        if t >= 0.0:
            offset, event = t, HIT_HIGH if side > 0 else HIT_LOW
    elif low is not None:
        if direction is not None:
            ahead = high - y if direction > 0.0 else y - low
            if ahead < np.inf:
                t = micro_root(max(ahead, 0.0), 0.0, -direction * a, -direction * j, -direction * s, -direction * c, offset)
                if t >= 0.0:
                    offset, event = t, HIT_HIGH if direction > 0.0 else HIT_LOW
    return offset, event


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


@jit_inline
def bounded_at(slots, forced, omega, signal, tau, offset):  # type: ignore[no-untyped-def]
    """Return a signal with its first two derivatives at an offset, and bounds of the second and third that hold for ever after."""
    p, bound = signal.polynomial, forced.bound
    d1, d2, d3, x = digits(slots.scale, offset)
    f0, f1, f2 = guard_values(forced.signals, omega, tau + offset)
    y, v, a, b2, b3 = sum_and_bound(slots.rows, slots.table, signal.u, d1, d2, d3, x)
    y, v, a = y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2]), v + f1 + p[1] + offset * p[2], a + f2 + p[2]
    return y, v, a, b2 + bound[2] + abs(p[2]), b3 + bound[3]


@jit_inline
def at_guard(low, high, direction, noise, y, v, a):  # type: ignore[no-untyped-def]
    """Return (kind, y): the event that the search has come to, NOTHING before one, and the signal, kept off the walls by its ``noise``."""
    slowing = -a if v > 0.0 else a
    beyond = v * v > 2.0 * slowing * noise  # it goes on by more than its rounding before it turns
    if direction is not None:
        if direction * v <= 0.0:
            return REVERSAL, y
    if low is not None:
        if high - y <= noise:
            if v > 0.0 and beyond:
                return HIT_HIGH, y
            y = high - noise
        if y - low <= noise:
            if v < 0.0 and beyond:
                return HIT_LOW, y
            y = low + noise
    return NOTHING, y


@jit
def careful_search(slots, forced, omega, signal, tau, start, stop, length, low, high, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return the first Event from the offset ``start`` on; NOTHING, with the offset ``stop``, if there is none up to there.

    Other arguments as in `search.search`. An event between ``stop`` and ``length`` may be returned.
    """
    signals = forced.signals
    resolution = time_resolution(slots.rows, omega, length)
    noise, offset, count, reach = NOISE * signal_scale(signal, forced.bound), start, 0, stop - start
    while offset < stop and count < MAX_EVALUATIONS:
        count += 1
        y, v, a, b2, b3 = bounded_at(slots, forced, omega, signal, tau, offset)
        on_guard = False
        if offset == 0.0:
            if noise == 0.0 and v == 0.0 and a == 0.0:  # a signal that is zero for ever: an absorber at rest on a wall at rest
                return Event(NOTHING, length, 0.0, 0.0, 0.0, count)
            if side != 0 or zero_rate:
                if not leaves_quickly(slots, omega, side, direction, v, a, b2, b3):
                    offset, kind = start_on_guard(slots, forced, omega, signal, tau, low, high, side, direction, zero_rate, y, v, a, b2)
                    if kind != NOTHING and offset <= length:
                        y, v, a = at_offset(slots, signals, omega, signal, tau, offset)
                        return Event(kind, offset, y, v, a, 2)
                    continue
                on_guard = True
                y, v = exactly_on_guard(low, high, side, noise, y, v)
        if not on_guard:
            kind, y = at_guard(low, high, direction, noise, y, v, a)
            if kind != NOTHING:
                return Event(kind, offset, y, v, a, count)
            kind, step = root_ahead(low, high, direction, y, v, a, b2, b3)
            if kind != NOTHING:
                if offset + 2.0 * step < length:
                    wall, p = wall_of(kind, low, high), signal.polynomial
                    found = refine(slots.rows, slots.table, slots.scale, signals, omega, signal.u, p, tau, offset + step, kind, wall, b3, resolution)
                    return Event(kind, found.offset, found.value, found.rate, found.bend, count + found.evaluations)
        step = guards_step(low, high, direction, y, v, a, b2, b3, reach)
        if on_guard:
            step *= 0.5  # the whole of it could end on the guard again
        reach = GROWTH * step
        if not step >= 0.0:  # not a number: the caller finds it in the state
            return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
        if offset + step >= stop:  # also where the length left is below the resolution of time
            break
        if step <= resolution:
            return Event(nearest_event(low, high, direction, y, v, a), offset, y, v, a, count)
        offset += step
    if count >= MAX_EVALUATIONS:  # not a number, so that the run ends in an error: an event could be missed
        return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
    return Event(NOTHING, max(stop, offset), 0.0, 0.0, 0.0, count)
