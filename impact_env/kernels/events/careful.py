"""The careful search: safe steps in which no event can be missed.

It is used for the few steps in which the scan (search.py) cannot decide.

Proof. The magnitude of a modal amplitude never grows, so from the current time on |y''| <= B2 and
|y'''| <= B3, with sums over the modal amplitudes. With d the distance to a wall, g its closing
speed and a its closing acceleration (all exact), y keeps off the wall for s >= 0 as long as d - g s
- b s^2/2 > 0, where b bounds the closing acceleration over the step: b = B2, or b = a + B3 S for
steps up to S. The smallest positive root of that parabola, cut to S, is therefore a safe step. For
the rate the same holds one derivative higher. The search advances by the smallest, over the guards,
of the safe steps, so it never passes an event. Where the signal is monotone over twice the way to a
guard (`find_root_ahead`), the event there is the next one and simple, and Newton's method ends on
it. Else the safe step is Newton's step less a term of second order, and closes in from the safe
side. It stops when the step is below the resolution of time, or the distance below the rounding of
y.

Grazing. A signal that would go beyond a wall by less than its rounding, and turns there, does not
reach it. Else a joint whose force touches its bound would break and close without end.

Start on a guard. At a start on a wall (or at rate zero) the distance y - wall is known to be zero,
while its computed value is rounding noise. There the signal less its start is developed in a Taylor
series, divided by its known factor. The remainder is of relative size (|s| t)^4/360 with |s| t <=
TAYLOR_START_REACH, s of the fastest modal amplitude or of a quicker force. Returns within that
reach (the last flights of a chatter) are found in this series, and so is the wall ahead of a start
at rate zero: the last bounces of a chatter against friction end on it. A rate into the wall, as an
impact of another absorber can leave it, counts as an immediate impact. A rate that starts at zero
grows in the direction of slip: a second derivative of the other sign that is as small as rounding
counts as zero.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_separate
from impact_env.kernels.events.signals import (
    HIT_HIGH,
    HIT_LOW,
    NOTHING,
    REVERSAL,
    SIGNAL_ROUNDING,
    BoundedSignal,
    GuardEvent,
    compute_signal_scale,
    compute_time_resolution,
    evaluate_terms,
    find_event_wall,
    make_failed_search,
    refine_root,
    replace_evaluations,
    select_terms,
)
from impact_env.kernels.motion.forced import (
    FIFTH,
    FOURTH,
    THIRD,
    evaluate_first_signals,
    evaluate_signal,
)
from impact_env.kernels.motion.modal_system import (
    LARGEST_RATE,
    SPEED,
    cos_sin,
    split_time,
    sum_and_bound_derivatives,
    sum_third_to_fifth,
)

TAYLOR_START_REACH = 0.01
FINEST_SHARE = 2.0**-20  # of the reach
RATE_ROUNDING = 16.0 * SIGNAL_ROUNDING  # rounding of a computed rate, relative to its scale
# of the sizes of a second derivative's terms: what the change to a regime's basis may be off
# (`regimes.SOUND`); below it the derivative has no sign
ACCELERATION_TOL = 1e-11
# the same where a wall pushes: near critical damping a mode is three modal amplitudes, of larger
# amplitudes than its own, which cancel (`secular.raised`)
WALL_ACCELERATION_TOL = 10.0 * ACCELERATION_TOL

MOST_CAREFUL_EVALUATIONS = 2_000_000
STEP_GROWTH = 4.0  # of a safe step against the one before


@jit_inline
def compute_taylor_reach(function):
    """Return how far (s) the Taylor series of a start on a guard is used."""
    return TAYLOR_START_REACH / max(function.system.scale[LARGEST_RATE], function.omega)


@jit_inline
def evaluate_taylor(t, d, v, a, j, s, c):
    """Return d + v t + a t^2/2 + j t^3/6 + s t^4/24 + c t^5/120."""
    return d + t * (v + t * (a / 2 + t * (j / 6 + t * (s / 24 + t * c / 120))))


@jit_inline
def count_sign_changes(t, h, d, v, a, j, s, c):
    """Return the number of sign changes of Bernstein coefficients over (t, t + h).

    They are those of the polynomial of `evaluate_taylor`; the number bounds the number of its
    roots.
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
    """Return the floating-point number just after a root of `evaluate_taylor`.

    The polynomial is negative at ``right``, and not at ``left``.
    """
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
    """Return the first root in (0, reach] of `evaluate_taylor`, -1 if it does not become negative.

    ``noise`` is its rounding error. A start below 0 counts as 0, unless it continues below.
    Intervals are halved until the coefficients allow no root or only one. A dip below 0 by less
    than its rounding, or within less than FINEST_SHARE of the reach, does not count.
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
    """Return a `BoundedSignal` without the rounding error of the guard on which it starts.

    At a start on a wall the value is that of the wall. At a start inside, with a rate of zero, the
    rate is set to 0, and the distance from both walls to at least ``noise``.
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
    reach = compute_taylor_reach(function)
    if guards.side != 0:
        return -guards.side * bounded.v > bounded.b2 * reach
    if guards.direction is not None:
        return guards.direction * bounded.a > bounded.b3 * reach
    return False


@jit_inline
def find_first_reversal(guards, bounded, high, reach, noise):
    """Return the time (s) at which the rate first changes sign after a start on a guard, or -1.

    Times up to ``reach`` (s) are considered. ``high``: the third to fifth derivatives; ``noise``:
    the rounding of the rate.
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
    """Return (time, event) of the first hit of a wall within ``reach`` (s), time -1 without.

    ``v``: rate at the start; ``high`` and ``noise`` as in `find_first_reversal`. After a start on a
    wall it is the return to this wall, or the hit of the opposite one, whichever is first. In a gap
    far below the amplitudes the opposite wall, too, lies within reach: a slow flight covers up to
    b2 reach^2, 1e-4 of the amplitudes. A start at rest on a wall leaves it. After a start at rate
    zero inside the cavity it is the hit of the wall ahead.
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


@jit_separate
def search_from_guard(function, guards, bounded):
    """Return (offset in s, kind of event) after a start on a guard.

    With the kind NOTHING the search may use computed distances from this offset on; otherwise an
    event of this kind is there. ``bounded`` is the signal at its start. Terms that are known to be
    zero are left out: the constant one, the series being divided by t, or the linear one. Where
    both walls and rate have guards the earlier event is returned.
    """
    system = function.system
    signals = function.forced.signals
    omega = function.omega
    tau = function.tau
    v = 0.0 if guards.zero_rate else bounded.v
    u = function.signal.u
    scale = function.forced.bound[1] + abs(function.signal.polynomial[1])
    for i in range(u.shape[1]):
        scale += system.rows[SPEED, i] * (abs(u[0, i]) + abs(u[1, i]))
    noise = RATE_ROUNDING * scale
    if guards.side != 0:
        if guards.side * v > noise:
            return 0.0, HIT_HIGH if guards.side > 0 else HIT_LOW
    j, s, c = sum_third_to_fifth(system.rows, system.rows.shape[1], function.signal.u)
    j += evaluate_signal(signals, THIRD, omega, tau)
    s += evaluate_signal(signals, FOURTH, omega, tau)
    c += evaluate_signal(signals, FIFTH, omega, tau)
    offset = compute_taylor_reach(function)
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


@jit_inline
def solve_parabola(d, g, b):
    """Return the smallest s > 0 with d - g s - b s^2/2 = 0 for d > 0, b >= 0.

    The result is a huge number if no such s exists.
    """
    root = np.sqrt(g * g + 2.0 * b * d)
    if g >= 0.0:
        return 2.0 * d / (g + root + 1e-300)
    return (root - g) / (b + 1e-300)


@jit_inline
def compute_safe_wall_step(d, g, a, b2, b3, reach):
    """Return a step (s) within which the wall at distance d > 0 cannot be reached.

    g is the closing speed, a the closing acceleration, b2 and b3 are bounds of the second and third
    derivative. ``reach``: a guess of the step; no result is longer.
    """
    b = min(a + b3 * reach, b2)
    step = min(solve_parabola(d, g, max(b, 0.0)), reach)
    if step < 0.4 * reach:  # a shorter reach has a smaller bound
        b = min(a + 2.0 * b3 * step, b2)
        step = max(step, min(solve_parabola(d, g, max(b, 0.0)), 2.0 * step))
    return step


@jit_inline
def compute_safe_step(guards, bounded, reach):
    """Return a step (s), at most ``reach``, within which no guard can be reached."""
    step = reach
    y = bounded.y
    v = bounded.v
    to_high = guards.high - y
    to_low = y - guards.low
    if v >= 0.0:
        ahead = to_high
        behind = to_low
        closing = v
        bend = bounded.a
    else:
        ahead = to_low
        behind = to_high
        closing = -v
        bend = -bounded.a
    if ahead < np.inf:
        step = compute_safe_wall_step(ahead, closing, bend, bounded.b2, bounded.b3, reach)
    # the wall behind needs a root only if the step could take the signal back to it
    if not behind + closing * step - 0.5 * bounded.b2 * step * step > 0.0:
        step = min(
            step, compute_safe_wall_step(behind, -closing, -bend, bounded.b2, bounded.b3, reach)
        )
    if guards.direction is not None:
        step = min(
            step, solve_parabola(guards.direction * v, -guards.direction * bounded.a, bounded.b3)
        )
    return step


@jit_inline
def find_root_ahead(guards, bounded):
    """Return (kind, step) of the event ahead if it is certainly the next one and simple.

    Otherwise the kind is NOTHING. A wall: the closing speed stays positive over twice the step. A
    reversal: the rate's slope keeps its sign over twice the step, and the wall ahead is further
    than the way made in it.
    """
    y = bounded.y
    v = bounded.v
    a = bounded.a
    if guards.direction is not None:
        w = guards.direction * v
        slope = -guards.direction * a
        if slope > 0.0:
            step = w / slope
            if slope > 2.0 * bounded.b3 * step:
                ahead = guards.high - y if v > 0.0 else y - guards.low
                if ahead > 2.0 * w * step:
                    return REVERSAL, step
    if v > 0.0:
        d = guards.high - y
        g = v
        c = a
        kind = HIT_HIGH
    else:
        d = y - guards.low
        g = -v
        c = -a
        kind = HIT_LOW
    if d < np.inf and g * g > 4.0 * bounded.b2 * d:
        step = 2.0 * d / (g + np.sqrt(max(g * g + 2.0 * c * d, 0.0)))
        if 2.0 * bounded.b2 * step < g:
            return kind, step
    return NOTHING, 0.0


@jit
def find_nearest_event(guards, bounded):
    """Return HIT_LOW, HIT_HIGH or REVERSAL: the event that the search has converged to."""
    to_high = guards.high - bounded.y
    to_low = bounded.y - guards.low
    if guards.direction is not None:
        if guards.direction * bounded.a < 0.0:
            distance = to_high if bounded.v > 0.0 else to_low
            if not distance < bounded.v * bounded.v / abs(bounded.a):
                return REVERSAL
    return HIT_HIGH if to_high < to_low else HIT_LOW


@jit_inline
def bound_signal(function, offset):
    """Return the `BoundedSignal` at an offset (s) from the signal's reference time."""
    system = function.system
    p = function.signal.polynomial
    bound = function.forced.bound
    d1, d2, d3, x = split_time(system.scale, offset)
    tau = function.tau + offset
    c, s = cos_sin(function.omega * tau)
    f0, f1, f2 = evaluate_first_signals(function.forced.signals, tau, c, s)
    rows = system.rows
    table = system.table
    y, v, a, b2, b3, b4 = sum_and_bound_derivatives(
        rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, function.signal.u
    )
    y = y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    v = v + f1 + p[1] + offset * p[2]
    a = a + f2 + p[2]
    return BoundedSignal(y, v, a, b2 + bound[2] + abs(p[2]), b3 + bound[3], b4 + bound[4])


@jit_inline
def check_guards(guards, noise, bounded):
    """Return (kind, y), the kind of event that the search has reached and the signal's value.

    The kind is NOTHING before an event. The signal is moved away from the walls by its ``noise``.
    """
    y = bounded.y
    v = bounded.v
    slowing = -bounded.a if v > 0.0 else bounded.a
    beyond = v * v > 2.0 * slowing * noise  # it moves by more than its rounding before it turns
    if guards.direction is not None:
        if guards.direction * v <= 0.0:
            return REVERSAL, y
    if guards.high - y <= noise:
        if v > 0.0 and beyond:
            return HIT_HIGH, y
        y = guards.high - noise
    if y - guards.low <= noise:
        if v < 0.0 and beyond:
            return HIT_LOW, y
        y = guards.low + noise
    return NOTHING, y


@jit_inline
def refine_event_ahead(function, guards, bounded, offset, length, resolution):
    """Return the event ahead as a `GuardEvent` if it is certainly the next one and simple.

    It must also be well within ``length`` (s). Otherwise the kind of the result is NOTHING.
    ``resolution``: of time (s).
    """
    kind, step = find_root_ahead(guards, bounded)
    if kind != NOTHING:
        if offset + 2.0 * step < length:
            return refine_root(
                select_terms(function),
                offset + step,
                kind,
                find_event_wall(kind, guards),
                bounded.b4,
                resolution,
            )
    return GuardEvent(NOTHING, 0.0, 0.0, 0.0, 0.0, 0)


@jit_separate
def careful_search(function, guards, start, stop, length):
    """Return the first GuardEvent from the offset ``start`` (s) on.

    Without an event up to ``stop`` (s) the kind is NOTHING, at the offset up to which there is
    none, ``stop`` or later; if the search fails, the offset is NaN. Other arguments as in
    `search.search_events`. An event between ``stop`` and ``length`` may be returned.
    """
    resolution = compute_time_resolution(function.system.rows, function.omega, length)
    on_guard = guards.side != 0 or guards.zero_rate
    most = min(MOST_CAREFUL_EVALUATIONS, function.signal.memory[1])
    noise = SIGNAL_ROUNDING * compute_signal_scale(function.signal, function.forced.bound)
    offset = start
    count = 0
    reach = stop - start
    while offset < stop and count < most:
        count += 1

        # has the search reached an event?
        bounded = bound_signal(function, offset)
        first = on_guard and offset == 0.0
        if offset == 0.0 and noise == 0.0 and bounded.v == 0.0 and bounded.a == 0.0:
            return GuardEvent(
                NOTHING, length, 0.0, 0.0, 0.0, count
            )  # a signal that is zero for ever: an absorber at rest on a wall at rest
        if first:
            if not leaves_quickly(function, guards, bounded):
                offset, kind = search_from_guard(function, guards, bounded)
                if kind != NOTHING and offset <= length:
                    y, v, a, _ = evaluate_terms(select_terms(function), offset)
                    return GuardEvent(kind, offset, y, v, a, 2)
                continue
            bounded = snap_to_guard(guards, noise, bounded)
        else:
            kind, y = check_guards(guards, noise, bounded)
            bounded = BoundedSignal(y, bounded.v, bounded.a, bounded.b2, bounded.b3, bounded.b4)
            if kind != NOTHING:
                return GuardEvent(kind, offset, y, bounded.v, bounded.a, count)
            event = refine_event_ahead(function, guards, bounded, offset, length, resolution)
            if event.kind != NOTHING:
                return replace_evaluations(event, count + event.evaluations)

        # a step within which no guard can be reached
        step = compute_safe_step(guards, bounded, reach)
        if first:
            step *= 0.5  # the whole of it could end on the guard again
        reach = STEP_GROWTH * step
        if np.isnan(step):  # the caller finds it in the state
            return make_failed_search(count)
        if offset + step >= stop:  # also where the length left is below the resolution of time
            break
        if step <= resolution:  # also below zero: both walls are nearer than the signal's rounding
            return GuardEvent(
                find_nearest_event(guards, bounded), offset, bounded.y, bounded.v, bounded.a, count
            )
        offset += step
    return (
        make_failed_search(count)
        if count >= most
        else GuardEvent(NOTHING, max(stop, offset), 0.0, 0.0, 0.0, count)
    )


@jit_inline
def has_no_event(load, function, guards, length):
    """Return whether one evaluation proves that no event comes within ``length`` (s).

    ``load`` None: a chirp, whose windows are too long for it.
    """
    if load is None:
        return False
    if guards.side != 0 or guards.zero_rate:
        return False
    bounded = bound_signal(function, 0.0)
    kind, y = check_guards(
        guards,
        SIGNAL_ROUNDING * compute_signal_scale(function.signal, function.forced.bound),
        bounded,
    )
    return (
        kind == NOTHING
        and compute_safe_step(
            guards,
            BoundedSignal(y, bounded.v, bounded.a, bounded.b2, bounded.b3, bounded.b4),
            length,
        )
        >= length
    )
