"""A start on a guard, for the careful search: what a signal does before computed distances can be trusted.

At a start on a wall (or at rate zero) y - wall is known to be zero while its computed value is rounding noise. There
the signal less its start is developed in a Taylor series, divided by its known factor; the remainder is of relative size (|s| t)^4/360 with
|s| t <= MICRO_REACH, s of the fastest slot or of a quicker force. Returns within that reach (the last flights of a chatter) are found in this
series, and so is the wall ahead of a start at rate zero: the last bounces of a chatter against friction end on it. A rate into the wall, as an
impact of another absorber can leave it, is a hit at once, be it only for a moment. A rate that starts at zero grows in the sense that it is
watched for, since sliding was begun in that sense: a second derivative of the other sign that is as small as rounding counts as zero.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW, NOISE, NOTHING, REVERSAL, Bounded
from impact_env.kernels.motion.forced import FIFTH, FOURTH, THIRD, signal_value
from impact_env.kernels.motion.slots import FASTEST, SPEED, high_derivatives

MICRO_REACH = 0.01
FINEST = 2.0**-20  # of the reach
RATE_NOISE = 16.0 * NOISE  # rounding of a computed rate, relative to its scale
# of the sizes of a second derivative's terms: what the change to a regime's basis may be off (`regimes.SOUND`); below it the derivative has no sign
ACCELERATION_TOL = 1e-11
# the same where a wall pushes: near critical damping a mode is three slots, of larger amplitudes than its own, which cancel (`secular.raised`)
WALL_ACCELERATION_TOL = 10.0 * ACCELERATION_TOL


@jit_inline
def micro_reach(course):
    """Return how far (s) the Taylor series of a start on a guard is used."""
    return MICRO_REACH / max(course.slots.scale[FASTEST], course.omega)


@jit_inline
def series(t, d, v, a, j, s, c):
    """Return d + v t + a t^2/2 + j t^3/6 + s t^4/24 + c t^5/120."""
    return d + t * (v + t * (a / 2 + t * (j / 6 + t * (s / 24 + t * c / 120))))


@jit_inline
def sign_changes(t, h, d, v, a, j, s, c):
    """Return how often the Bernstein coefficients of `series` over (t, t + h) change their sign: a bound of the number of its roots there."""
    p0 = series(t, d, v, a, j, s, c)
    p1 = h * series(t, v, a, j, s, c, 0.0) / 5
    p2 = h * h * series(t, a, j, s, c, 0.0, 0.0) / 20
    p3 = h * h * h * series(t, j, s, c, 0.0, 0.0, 0.0) / 60
    p4 = h * h * h * h * series(t, s, c, 0.0, 0.0, 0.0, 0.0) / 120
    n0 = p0 < 0.0
    n1 = p0 + p1 < 0.0
    n2 = p0 + 2 * p1 + p2 < 0.0
    n3 = p0 + 3 * p1 + 3 * p2 + p3 < 0.0
    n4 = p0 + 4 * p1 + 6 * p2 + 4 * p3 + p4 < 0.0
    n5 = series(t + h, d, v, a, j, s, c) < 0.0
    return (n0 != n1) + (n1 != n2) + (n2 != n3) + (n3 != n4) + (n4 != n5)


@jit
def bisect(left, right, d, v, a, j, s, c):
    """Return the first number after a root of `series`, which is negative at ``right``."""
    for _ in range(200):
        mid = 0.5 * (left + right)
        if mid <= left or mid >= right:
            break
        if series(mid, d, v, a, j, s, c) > 0.0:
            left = mid
        else:
            right = mid
    return right


@jit
def micro_root(d, v, a, j, s, c, reach, noise):
    """Return the first root in (0, reach] of `series`, whose rounding is ``noise``, or -1 if it does not turn negative.

    A start below 0 counts as 0, unless it goes on below. Intervals are halved until the coefficients allow no root or only one. What dips below 0 and
    turns there by less than its rounding, or within less than FINEST of the reach, does not reach it.
    """
    left = 0.0
    h = reach / 4
    start = max(d, 0.0)
    if d < 0.0 and series(h, d, v, a, j, s, c) < 0.0:
        return bisect(0.0, h, d, v, a, j, s, c)
    if sign_changes(0.0, reach, start, v, a, j, s, c) == 0:
        return -1.0
    while left < reach:
        h = min(h, reach - left)
        changes = sign_changes(left, h, start + noise, v, a, j, s, c)
        right = left + h
        if series(right, start, v, a, j, s, c) < 0.0 and (changes <= 1 or h <= FINEST * reach):
            return bisect(left, right, d, v, a, j, s, c)
        if changes == 0 or h <= FINEST * reach:
            left = right
            h = min(2 * h, reach / 4)
        else:
            h /= 2
    return -1.0


@jit_inline
def exactly_on_guard(guards, noise, now):
    """Return a signal without the rounding of the guard on which it starts; a wall that is not left keeps a distance of ``noise``."""
    y = now.y
    v = 0.0
    if guards.low is not None:
        if guards.side == 0:
            y = max(min(y, guards.high - noise), guards.low + noise)
        else:
            y = guards.high if guards.side > 0 else guards.low
            v = now.v
    return Bounded(y, v, now.a, now.b2, now.b3, now.b4)


@jit_inline
def leaves_quickly(course, guards, now):
    """Return whether a start on a guard leaves it so quickly that the safe step from distance zero is beyond the rounding."""
    reach = micro_reach(course)
    if guards.side != 0:
        return -guards.side * now.v > now.b2 * reach
    if guards.direction is not None:
        return guards.direction * now.a > now.b3 * reach
    return False


@jit
def rate_noise(rows, u, rate_bound, rate):
    """Return the rounding of the rate of a signal: slots' amplitudes u, a bound of the forced part's rate, and the polynomial's."""
    scale = rate_bound + abs(rate)
    for j in range(u.shape[1]):
        scale += rows[SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return RATE_NOISE * scale


@jit_inline
def first_reversal(guards, now, high, reach, noise):
    """Return when, within ``reach`` (s) of a start on a guard, the rate first changes its sign, or -1.

    ``high``: the third to fifth derivatives; ``noise``: the rounding of the rate.
    """
    if guards.direction is None:
        return -1.0
    direction, (j, s, c) = guards.direction, high
    if guards.zero_rate:
        bend = direction * now.a
        if -ACCELERATION_TOL * now.b2 <= bend < 0.0:
            bend = 0.0
        return micro_root(
            bend,
            direction * j / 2,
            direction * s / 3,
            direction * c / 4,
            0.0,
            0.0,
            reach,
            ACCELERATION_TOL * now.b2,
        )
    return micro_root(
        direction * now.v,
        direction * now.a,
        direction * j,
        direction * s,
        direction * c,
        0.0,
        reach,
        noise,
    )


@jit_inline
def first_hit(guards, now, v, high, reach, noise):
    """Return (time, event) of the first hit within ``reach`` (s), else a time of -1; ``high`` and ``noise`` as in `first_reversal`.

    From a wall: back on it, or on the opposite one, whichever is first. In a gap far below the amplitudes that one, too, lies within reach: a flight
    that is slow beside them makes up to b2 reach^2 in it, 1e-4 of the amplitudes. What begins at rest on a wall leaves it. From a start at rate
    zero inside the cavity: the wall ahead.
    """
    side, (j, s, c) = guards.side, high
    if guards.low is None:
        return -1.0, NOTHING
    if side != 0:
        bend = -side * now.a
        if guards.zero_rate and -WALL_ACCELERATION_TOL * now.b2 <= bend < 0.0:
            bend = 0.0
        back = micro_root(
            -side * v, bend / 2, -side * j / 3, -side * s / 4, -side * c / 5, 0.0, reach, noise
        )
        until = reach if back < 0.0 else back
        across = micro_root(
            guards.high - guards.low,
            side * v,
            side * now.a,
            side * j,
            side * s,
            side * c,
            until,
            noise * until,
        )
        if across >= 0.0:
            return across, HIT_LOW if side > 0 else HIT_HIGH
        return back, HIT_HIGH if side > 0 else HIT_LOW
    if guards.direction is None:
        return -1.0, NOTHING
    direction = guards.direction
    ahead = guards.high - now.y if direction > 0.0 else now.y - guards.low
    if not ahead < np.inf:
        return -1.0, NOTHING
    t = micro_root(
        max(ahead, 0.0),
        0.0,
        -direction * now.a,
        -direction * j,
        -direction * s,
        -direction * c,
        reach,
        noise * reach,
    )
    return t, HIT_HIGH if direction > 0.0 else HIT_LOW


@jit
def start_on_guard(course, guards, now):
    """Return (offset, event): the offset from which the search may trust computed distances, or an event before it; ``now``: the signal at its start.

    What is known to be zero is left out: the constant term, divided by t, or the linear one. Where both a wall and the rate are watched the earlier
    event is returned.
    """
    slots = course.slots
    signals = course.forced.signals
    omega = course.omega
    tau = course.tau
    v = 0.0 if guards.zero_rate else now.v
    noise = rate_noise(
        slots.rows, course.signal.u, course.forced.bound[1], course.signal.polynomial[1]
    )
    if guards.side != 0:
        if guards.side * v > noise:
            return 0.0, HIT_HIGH if guards.side > 0 else HIT_LOW
    j, s, c = high_derivatives(slots.rows, course.signal.u)
    j += signal_value(signals, THIRD, omega, tau)
    s += signal_value(signals, FOURTH, omega, tau)
    c += signal_value(signals, FIFTH, omega, tau)
    offset = micro_reach(course)
    event = NOTHING
    t = first_reversal(guards, now, (j, s, c), offset, noise)
    if t >= 0.0:
        offset = t
        event = REVERSAL
    t, hit = first_hit(guards, now, v, (j, s, c), offset, noise)
    if t >= 0.0:
        offset = t
        event = hit
    return offset, event
