"""A start on a guard, for the careful search.

The module follows a signal until computed distances from the guard can be trusted.

At a start on a wall (or at rate zero) the distance y - wall is known to be zero, while its computed
value is rounding noise. There the signal less its start is developed in a Taylor series, divided by
its known factor. The remainder is of relative size (|s| t)^4/360 with |s| t <= TAYLOR_START_REACH,
s of the fastest modal amplitude or of a quicker force. Returns within that reach (the last flights
of a chatter) are found in this series, and so is the wall ahead of a start at rate zero: the last
bounces of a chatter against friction end on it.

A rate into the wall, as an impact of another absorber can leave it, counts as an immediate impact.
A rate that starts at zero grows in the watched direction, since slip was begun in that direction: a
second derivative of the other sign that is as small as rounding counts as zero.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.signals import (
    HIT_HIGH,
    HIT_LOW,
    NOTHING,
    REVERSAL,
    SIGNAL_ROUNDING,
    BoundedSignal,
)
from impact_env.kernels.motion.forced import FIFTH, FOURTH, THIRD, evaluate_signal
from impact_env.kernels.motion.modal_system import LARGEST_RATE, SPEED, sum_high_derivatives

TAYLOR_START_REACH = 0.01
FINEST_SHARE = 2.0**-20  # of the reach
RATE_ROUNDING = 16.0 * SIGNAL_ROUNDING  # rounding of a computed rate, relative to its scale
# of the sizes of a second derivative's terms: what the change to a regime's basis may be off
# (`regimes.SOUND`); below it the derivative has no sign
ACCELERATION_TOL = 1e-11
# the same where a wall pushes: near critical damping a mode is three modal amplitudes, of larger
# amplitudes than its own, which cancel (`secular.raised`)
WALL_ACCELERATION_TOL = 10.0 * ACCELERATION_TOL


@jit_inline
def taylor_reach(function):
    """Return how far (s) the Taylor series of a start on a guard is used."""
    return TAYLOR_START_REACH / max(function.system.scale[LARGEST_RATE], function.omega)


@jit_inline
def evaluate_taylor(t, d, v, a, j, s, c):
    """Return d + v t + a t^2/2 + j t^3/6 + s t^4/24 + c t^5/120."""
    return d + t * (v + t * (a / 2 + t * (j / 6 + t * (s / 24 + t * c / 120))))


@jit_inline
def count_sign_changes(t, h, d, v, a, j, s, c):
    """Return the number of sign changes of Bernstein coefficients over (t, t + h).

    The number refers to the polynomial of `evaluate_taylor`.

    It bounds the number of roots there.
    """
    p0 = evaluate_taylor(t, d, v, a, j, s, c)
    p1 = h * evaluate_taylor(t, v, a, j, s, c, 0.0) / 5
    p2 = h * h * evaluate_taylor(t, a, j, s, c, 0.0, 0.0) / 20
    p3 = h * h * h * evaluate_taylor(t, j, s, c, 0.0, 0.0, 0.0) / 60
    p4 = h * h * h * h * evaluate_taylor(t, s, c, 0.0, 0.0, 0.0, 0.0) / 120
    n0 = p0 < 0.0
    n1 = p0 + p1 < 0.0
    n2 = p0 + 2 * p1 + p2 < 0.0
    n3 = p0 + 3 * p1 + 3 * p2 + p3 < 0.0
    n4 = p0 + 4 * p1 + 6 * p2 + 4 * p3 + p4 < 0.0
    n5 = evaluate_taylor(t + h, d, v, a, j, s, c) < 0.0
    return (n0 != n1) + (n1 != n2) + (n2 != n3) + (n3 != n4) + (n4 != n5)


@jit
def bisect_root(left, right, d, v, a, j, s, c):
    """Return the first number after a root of `evaluate_taylor`, which is negative at ``right``."""
    for _ in range(200):
        mid = 0.5 * (left + right)
        if mid <= left or mid >= right:
            break
        if evaluate_taylor(mid, d, v, a, j, s, c) > 0.0:
            left = mid
        else:
            right = mid
    return right


@jit
def find_taylor_root(d, v, a, j, s, c, reach, noise):
    """Return the first root in (0, reach] of `evaluate_taylor`.

    The result is -1 if the polynomial does not become negative. ``noise`` is its rounding error.

    A start below 0 counts as 0, unless it goes on below. Intervals are halved until the
    coefficients allow no root or only one. What dips below 0 and turns there by less than its
    rounding, or within less than FINEST_SHARE of the reach, does not reach it.
    """
    left = 0.0
    h = reach / 4
    start = max(d, 0.0)
    if d < 0.0 and evaluate_taylor(h, d, v, a, j, s, c) < 0.0:
        return bisect_root(0.0, h, d, v, a, j, s, c)
    if count_sign_changes(0.0, reach, start, v, a, j, s, c) == 0:
        return -1.0
    while left < reach:
        h = min(h, reach - left)
        changes = count_sign_changes(left, h, start + noise, v, a, j, s, c)
        right = left + h
        if evaluate_taylor(right, start, v, a, j, s, c) < 0.0 and (
            changes <= 1 or h <= FINEST_SHARE * reach
        ):
            return bisect_root(left, right, d, v, a, j, s, c)
        if changes == 0 or h <= FINEST_SHARE * reach:
            left = right
            h = min(2 * h, reach / 4)
        else:
            h /= 2
    return -1.0


@jit_inline
def snap_to_guard(guards, noise, bounded):
    """Return a signal without the rounding error of the guard on which it starts.

    From a wall that the signal does not leave it has a distance of ``noise``.
    """
    y = bounded.y
    v = 0.0
    if guards.side == 0:
        y = max(min(y, guards.high - noise), guards.low + noise)
    else:
        y = guards.high if guards.side > 0 else guards.low
        v = bounded.v
    return BoundedSignal(y, v, bounded.a, bounded.b2, bounded.b3, bounded.b4)


@jit_inline
def leaves_quickly(function, guards, bounded):
    """Return whether a signal that starts on a guard leaves it quickly.

    This is the case if the safe step from distance zero is longer than the time in which rounding
    matters.
    """
    reach = taylor_reach(function)
    if guards.side != 0:
        return -guards.side * bounded.v > bounded.b2 * reach
    if guards.direction is not None:
        return guards.direction * bounded.a > bounded.b3 * reach
    return False


@jit
def compute_rate_rounding(rows, u, rate_bound, rate):
    """Return the rounding error of a signal's rate.

    It follows from the modal amplitudes u, a bound of the forced part's rate, and the polynomial's
    rate.
    """
    scale = rate_bound + abs(rate)
    for j in range(u.shape[1]):
        scale += rows[SPEED, j] * (abs(u[0, j]) + abs(u[1, j]))
    return RATE_ROUNDING * scale


@jit_inline
def find_first_reversal(guards, bounded, high, reach, noise):
    """Return the time at which the rate first changes its sign after a start on a guard, or -1.

    Times up to ``reach`` (s) after the start are considered.

    ``high``: the third to fifth derivatives; ``noise``: the rounding of the rate.
    """
    if guards.direction is None:
        return -1.0
    direction = guards.direction
    j, s, c = high
    if guards.zero_rate:
        bend = direction * bounded.a
        if -ACCELERATION_TOL * bounded.b2 <= bend < 0.0:
            bend = 0.0
        return find_taylor_root(
            bend,
            direction * j / 2,
            direction * s / 3,
            direction * c / 4,
            0.0,
            0.0,
            reach,
            ACCELERATION_TOL * bounded.b2,
        )
    return find_taylor_root(
        direction * bounded.v,
        direction * bounded.a,
        direction * j,
        direction * s,
        direction * c,
        0.0,
        reach,
        noise,
    )


@jit_inline
def find_first_hit(guards, bounded, v, high, reach, noise):
    """Return (time, event) of the first hit within ``reach`` (s).

    If none occurs, the time is -1. ``high`` and ``noise`` are those of `find_first_reversal`.

    From a wall: back on it, or on the opposite one, whichever is first. In a gap far below the
    amplitudes that one, too, lies within reach: a flight that is slow beside them makes up to b2
    reach^2 in it, 1e-4 of the amplitudes. What begins at rest on a wall leaves it. From a start at
    rate zero inside the cavity: the wall ahead.
    """
    side = guards.side
    j, s, c = high
    if side != 0:
        bend = -side * bounded.a
        if guards.zero_rate and -WALL_ACCELERATION_TOL * bounded.b2 <= bend < 0.0:
            bend = 0.0
        back = find_taylor_root(
            -side * v, bend / 2, -side * j / 3, -side * s / 4, -side * c / 5, 0.0, reach, noise
        )
        until = reach if back < 0.0 else back
        across = find_taylor_root(
            guards.high - guards.low,
            side * v,
            side * bounded.a,
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
    ahead = guards.high - bounded.y if direction > 0.0 else bounded.y - guards.low
    if not ahead < np.inf:
        return -1.0, NOTHING
    t = find_taylor_root(
        max(ahead, 0.0),
        0.0,
        -direction * bounded.a,
        -direction * j,
        -direction * s,
        -direction * c,
        reach,
        noise * reach,
    )
    return t, HIT_HIGH if direction > 0.0 else HIT_LOW


@jit
def search_from_guard(function, guards, bounded):
    """Return (offset, event) after a start on a guard.

    The offset is that from which the search may trust computed distances, or that of an event
    before it. ``bounded`` is the signal at its start.

    What is known to be zero is left out: the constant term, divided by t, or the linear one. Where
    both a wall and the rate are watched the earlier event is returned.
    """
    system = function.system
    signals = function.forced.signals
    omega = function.omega
    tau = function.tau
    v = 0.0 if guards.zero_rate else bounded.v
    noise = compute_rate_rounding(
        system.rows, function.signal.u, function.forced.bound[1], function.signal.polynomial[1]
    )
    if guards.side != 0:
        if guards.side * v > noise:
            return 0.0, HIT_HIGH if guards.side > 0 else HIT_LOW
    j, s, c = sum_high_derivatives(system.rows, function.signal.u)
    j += evaluate_signal(signals, THIRD, omega, tau)
    s += evaluate_signal(signals, FOURTH, omega, tau)
    c += evaluate_signal(signals, FIFTH, omega, tau)
    offset = taylor_reach(function)
    event = NOTHING
    t = find_first_reversal(guards, bounded, (j, s, c), offset, noise)
    if t >= 0.0:
        offset = t
        event = REVERSAL
    t, hit = find_first_hit(guards, bounded, v, (j, s, c), offset, noise)
    if t >= 0.0:
        offset = t
        event = hit
    return offset, event
