"""The careful search: safe steps that no event can hide in, for the few places where the scan (search.py) cannot tell.

Proof. A slot's amplitude never grows, so from the current time on |y''| <= B2 and |y'''| <= B3, with sums over the slots' amplitudes. With d the
distance to a wall, g its closing speed and a its closing acceleration (all exact), y keeps off the wall for s >= 0 as long as
d - g s - b s^2/2 > 0, where b bounds the closing acceleration over the step: b = B2, or b = a + B3 S for steps up to S. The smallest positive
root of that parabola, cut to S, is therefore a safe step. For the rate the same holds one derivative higher. The search advances by the
smallest, over the guards, of the safe steps, so it never passes an event. Where the signal is monotone over twice the way to a guard
(`root_ahead`), the event there is the next one and simple, and Newton's method ends on it. Else the safe step is Newton's step less a
term of second order, and closes in from the safe side. It stops when the step is below the resolution of time, or the distance below the
rounding of y.

Grazing. A signal that would go beyond a wall by less than its rounding, and turns there, does not reach it. Else a joint whose force touches its
bound would break and close without end.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.signals import (
    HIT_HIGH,
    HIT_LOW,
    NOISE,
    NOTHING,
    REVERSAL,
    Bounded,
    Event,
    counted,
    given_up,
    refine,
    signal_at,
    signal_scale,
    terms_of,
    time_resolution,
    wall_of,
)
from impact_env.kernels.events.starts import exactly_on_guard, leaves_quickly, start_on_guard
from impact_env.kernels.motion.forced import guard_values
from impact_env.kernels.motion.slots import digits, sum_and_bound

MAX_EVALUATIONS = 2_000_000
GROWTH = 4.0  # of a safe step against the one before


@jit_inline
def parabola(d, g, b):
    """Return the smallest s > 0 with d - g s - b s^2/2 = 0 for d > 0, b >= 0; a huge number if there is none."""
    root = np.sqrt(g * g + 2.0 * b * d)
    if g >= 0.0:
        return 2.0 * d / (g + root + 1e-300)
    return (root - g) / (b + 1e-300)


@jit_inline
def safe_step(d, g, a, b2, b3, reach):
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
def guards_step(guards, now, reach):
    """Return the safe step for all guards."""
    step = reach
    y = now.y
    v = now.v
    if guards.low is not None:
        to_high = guards.high - y
        to_low = y - guards.low
        if v >= 0.0:
            ahead = to_high
            behind = to_low
            closing = v
            bend = now.a
        else:
            ahead = to_low
            behind = to_high
            closing = -v
            bend = -now.a
        if ahead < np.inf:
            step = safe_step(ahead, closing, bend, now.b2, now.b3, reach)
        # the wall behind needs a root only if the step could take the signal back to it
        if not behind + closing * step - 0.5 * now.b2 * step * step > 0.0:
            step = min(step, safe_step(behind, -closing, -bend, now.b2, now.b3, reach))
    if guards.direction is not None:
        step = min(step, parabola(guards.direction * v, -guards.direction * now.a, now.b3))
    return step


@jit_inline
def root_ahead(guards, now):
    """Return (kind, step) of the event ahead if it is certain to be the next one and simple, else NOTHING.

    A wall: the closing speed stays positive over twice the step. A reversal: the rate's slope keeps its sign over twice the step, and the wall
    ahead is further than the way made in it.
    """
    y = now.y
    v = now.v
    a = now.a
    if guards.direction is not None:
        w = guards.direction * v
        slope = -guards.direction * a
        if slope > 0.0:
            step = w / slope
            if slope > 2.0 * now.b3 * step:
                if guards.low is None:
                    return REVERSAL, step
                ahead = guards.high - y if v > 0.0 else y - guards.low
                if ahead > 2.0 * w * step:
                    return REVERSAL, step
    if guards.low is not None:
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
        if d < np.inf and g * g > 4.0 * now.b2 * d:
            step = 2.0 * d / (g + np.sqrt(max(g * g + 2.0 * c * d, 0.0)))
            if 2.0 * now.b2 * step < g:
                return kind, step
    return NOTHING, 0.0


@jit
def nearest_event(guards, now):
    """Return which guard the search has come down to."""
    to_high = np.inf
    to_low = np.inf
    if guards.low is not None:
        to_high = guards.high - now.y
        to_low = now.y - guards.low
    if guards.direction is not None:
        if guards.direction * now.a < 0.0:
            distance = to_high if now.v > 0.0 else to_low
            if not distance < now.v * now.v / abs(now.a):
                return REVERSAL
    return HIT_HIGH if to_high < to_low else HIT_LOW


@jit_inline
def bounded_at(course, offset):
    """Return a signal at an offset, as `Bounded`."""
    slots = course.slots
    p = course.signal.polynomial
    bound = course.forced.bound
    d1, d2, d3, x = digits(slots.scale, offset)
    f0, f1, f2 = guard_values(course.forced.signals, course.omega, course.tau + offset)
    y, v, a, b2, b3, b4 = sum_and_bound(slots.rows, slots.table, course.signal.u, d1, d2, d3, x)
    y = y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    v = v + f1 + p[1] + offset * p[2]
    a = a + f2 + p[2]
    return Bounded(y, v, a, b2 + bound[2] + abs(p[2]), b3 + bound[3], b4 + bound[4])


@jit_inline
def at_guard(guards, noise, now):
    """Return (kind, y): the event that the search has come to, NOTHING before one, and the signal, kept off the walls by its ``noise``."""
    y = now.y
    v = now.v
    slowing = -now.a if v > 0.0 else now.a
    beyond = v * v > 2.0 * slowing * noise  # it goes on by more than its rounding before it turns
    if guards.direction is not None:
        if guards.direction * v <= 0.0:
            return REVERSAL, y
    if guards.low is not None:
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
def event_ahead(course, guards, now, offset, length, resolution):
    """Return the event ahead if it is certain to be the next one, simple and well within ``length``, else NOTHING."""
    kind, step = root_ahead(guards, now)
    if kind != NOTHING:
        if offset + 2.0 * step < length:
            return refine(
                terms_of(course), offset + step, kind, wall_of(kind, guards), now.b4, resolution
            )
    return Event(NOTHING, 0.0, 0.0, 0.0, 0.0, 0)


@jit
def careful_search(course, guards, start, stop, length):
    """Return the first Event from the offset ``start`` on; NOTHING, with the offset ``stop``, if there is none up to there.

    Other arguments as in `search.search`. An event between ``stop`` and ``length`` may be returned.
    """
    resolution = time_resolution(course.slots.rows, course.omega, length)
    on_guard = guards.side != 0 or guards.zero_rate
    most = min(MAX_EVALUATIONS, course.signal.memory[1])
    noise = NOISE * signal_scale(course.signal, course.forced.bound)
    offset = start
    count = 0
    reach = stop - start
    while offset < stop and count < most:
        count += 1
        now = bounded_at(course, offset)
        first = on_guard and offset == 0.0
        if offset == 0.0 and noise == 0.0 and now.v == 0.0 and now.a == 0.0:
            return Event(
                NOTHING, length, 0.0, 0.0, 0.0, count
            )  # a signal that is zero for ever: an absorber at rest on a wall at rest
        if first:
            if not leaves_quickly(course, guards, now):
                offset, kind = start_on_guard(course, guards, now)
                if kind != NOTHING and offset <= length:
                    y, v, a, _ = signal_at(terms_of(course), offset)
                    return Event(kind, offset, y, v, a, 2)
                continue
            now = exactly_on_guard(guards, noise, now)
        else:
            kind, y = at_guard(guards, noise, now)
            now = Bounded(y, now.v, now.a, now.b2, now.b3, now.b4)
            if kind != NOTHING:
                return Event(kind, offset, y, now.v, now.a, count)
            found = event_ahead(course, guards, now, offset, length, resolution)
            if found.kind != NOTHING:
                return counted(found, count + found.evaluations)
        step = guards_step(guards, now, reach)
        if first:
            step *= 0.5  # the whole of it could end on the guard again
        reach = GROWTH * step
        if np.isnan(step):  # the caller finds it in the state
            return given_up(count)
        if offset + step >= stop:  # also where the length left is below the resolution of time
            break
        if step <= resolution:  # also below zero: both walls are nearer than the signal's rounding
            return Event(nearest_event(guards, now), offset, now.y, now.v, now.a, count)
        offset += step
    return (
        given_up(count)
        if count >= most
        else Event(NOTHING, max(stop, offset), 0.0, 0.0, 0.0, count)
    )


@jit_inline
def is_clear(load, course, guards, length):
    """Return whether one evaluation shows that no event comes within ``length`` (s), as it does in most of a record's short windows.

    ``load`` None: a chirp, whose windows are so long that it is not tried.
    """
    if load is None:
        return False
    if guards.side != 0 or guards.zero_rate:
        return False
    now = bounded_at(course, 0.0)
    kind, y = at_guard(guards, NOISE * signal_scale(course.signal, course.forced.bound), now)
    return (
        kind == NOTHING
        and guards_step(guards, Bounded(y, now.v, now.a, now.b2, now.b3, now.b4), length) >= length
    )
