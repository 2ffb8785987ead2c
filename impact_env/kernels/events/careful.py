"""The careful search: safe steps in which no event can be missed.

It is used for the few places where the scan (search.py) cannot decide.

Proof. A modal amplitude's amplitude never grows, so from the current time on |y''| <= B2 and |y'''|
<= B3, with sums over the modal amplitudes. With d the distance to a wall, g its closing speed and a
its closing acceleration (all exact), y keeps off the wall for s >= 0 as long as d - g s - b s^2/2 >
0, where b bounds the closing acceleration over the step: b = B2, or b = a + B3 S for steps up to S.
The smallest positive root of that parabola, cut to S, is therefore a safe step. For the rate the
same holds one derivative higher. The search advances by the smallest, over the guards, of the safe
steps, so it never passes an event. Where the signal is monotone over twice the way to a guard
(`find_root_ahead`), the event there is the next one and simple, and Newton's method ends on it.
Else the safe step is Newton's step less a term of second order, and closes in from the safe side.
It stops when the step is below the resolution of time, or the distance below the rounding of y.

Grazing. A signal that would go beyond a wall by less than its rounding, and turns there, does not
reach it. Else a joint whose force touches its bound would break and close without end.
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
    GuardEvent,
    evaluate_terms,
    failed_search,
    find_event_wall,
    refine_root,
    select_terms,
    signal_scale,
    time_resolution,
    with_evaluations,
)
from impact_env.kernels.events.starts import leaves_quickly, search_from_guard, snap_to_guard
from impact_env.kernels.motion.forced import evaluate_guard
from impact_env.kernels.motion.modal_system import split_time, sum_with_bounds

MOST_CAREFUL_EVALUATIONS = 2_000_000
STEP_GROWTH = 4.0  # of a safe step against the one before


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
def safe_step(d, g, a, b2, b3, reach):
    """Return a step within which the wall at distance d > 0 cannot be reached.

    g is the closing speed and a the closing acceleration.

    ``reach``: a guess of the step; no result is longer.
    """
    b = min(a + b3 * reach, b2)
    step = min(solve_parabola(d, g, max(b, 0.0)), reach)
    if step < 0.4 * reach:  # the bound over the reach was too careful
        b = min(a + 2.0 * b3 * step, b2)
        step = max(step, min(solve_parabola(d, g, max(b, 0.0)), 2.0 * step))
    return step


@jit_inline
def compute_safe_step(guards, bounded, reach):
    """Return the longest step that is safe for all guards."""
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
        step = safe_step(ahead, closing, bend, bounded.b2, bounded.b3, reach)
    # the wall behind needs a root only if the step could take the signal back to it
    if not behind + closing * step - 0.5 * bounded.b2 * step * step > 0.0:
        step = min(step, safe_step(behind, -closing, -bend, bounded.b2, bounded.b3, reach))
    if guards.direction is not None:
        step = min(
            step, solve_parabola(guards.direction * v, -guards.direction * bounded.a, bounded.b3)
        )
    return step


@jit_inline
def find_root_ahead(guards, bounded):
    """Return (kind, step) of the event ahead if it is certainly the next one and simple.

    Otherwise the kind is NOTHING.

    A wall: the closing speed stays positive over twice the step. A reversal: the rate's slope
    keeps its sign over twice the step, and the wall ahead is further than the way made in it.
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
    """Return the guard that the search has converged to."""
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
    """Return the signal at an offset, with bounds of its derivatives."""
    system = function.system
    p = function.signal.polynomial
    bound = function.forced.bound
    d1, d2, d3, x = split_time(system.scale, offset)
    f0, f1, f2 = evaluate_guard(function.forced.signals, function.omega, function.tau + offset)
    y, v, a, b2, b3, b4 = sum_with_bounds(
        system.rows, system.table, function.signal.u, d1, d2, d3, x
    )
    y = y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    v = v + f1 + p[1] + offset * p[2]
    a = a + f2 + p[2]
    return BoundedSignal(y, v, a, b2 + bound[2] + abs(p[2]), b3 + bound[3], b4 + bound[4])


@jit_inline
def check_guards(guards, noise, bounded):
    """Return (kind, y), the event that the search has reached and the signal.

    The kind is NOTHING before an event. The signal is moved away from the walls by its ``noise``.
    """
    y = bounded.y
    v = bounded.v
    slowing = -bounded.a if v > 0.0 else bounded.a
    beyond = v * v > 2.0 * slowing * noise  # it goes on by more than its rounding before it turns
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
    """Return the event ahead if it is certainly the next one and simple.

    It must also be well within ``length``. Otherwise the kind of the result is NOTHING.
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


@jit
def careful_search(function, guards, start, stop, length):
    """Return the first GuardEvent from the offset ``start`` on.

    If no event occurs up to ``stop``, the result is NOTHING with the offset ``stop``.

    Other arguments as in `search.search_events`. An event between ``stop`` and ``length`` may be
    returned.
    """
    resolution = time_resolution(function.system.rows, function.omega, length)
    on_guard = guards.side != 0 or guards.zero_rate
    most = min(MOST_CAREFUL_EVALUATIONS, function.signal.memory[1])
    noise = SIGNAL_ROUNDING * signal_scale(function.signal, function.forced.bound)
    offset = start
    count = 0
    reach = stop - start
    while offset < stop and count < most:
        count += 1
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
                return with_evaluations(event, count + event.evaluations)
        step = compute_safe_step(guards, bounded, reach)
        if first:
            step *= 0.5  # the whole of it could end on the guard again
        reach = STEP_GROWTH * step
        if np.isnan(step):  # the caller finds it in the state
            return failed_search(count)
        if offset + step >= stop:  # also where the length left is below the resolution of time
            break
        if step <= resolution:  # also below zero: both walls are nearer than the signal's rounding
            return GuardEvent(
                find_nearest_event(guards, bounded), offset, bounded.y, bounded.v, bounded.a, count
            )
        offset += step
    return (
        failed_search(count)
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
        guards, SIGNAL_ROUNDING * signal_scale(function.signal, function.forced.bound), bounded
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
