"""The next event of a regime: where a guard signal y leaves (low, high), or where its rate changes sign. No event is missed.

The search looks at y, y' (and y'' where the rate is watched) at blocks of POINTS equidistant times. Between two of them, a step h apart, the cubic H
through both values and both slopes leaves |y - H| <= E = h^4/384 max|y''''|, and |y' - H'| <= 3.08 E/h [1]; H lies in the hull of its four
Bernstein coefficients. So a step is clear of a wall if these keep off it by more than E, and clear of a reversal if those of y' do.

Bounds. A slot's amplitude |u exp(s t)| never grows, so its share of E is at most its amplitude now times (|s| h)^4/384. Where that factor exceeds 1
the slot is not summed at all, and its amplitude is its share (`errors`, tables.py). The forced part's share follows from a bound of its fourth
derivative; it is summed with SCAN_TERMS coefficients, and the bound of the rest is added. Rounding, of sums and of the moving amplitudes, is
covered by SCAN_NOISE in each share.

Levels. The steps h of the levels are a factor LEVEL_RATIO apart. A step that is not clear is looked at again one level finer; where all of a block
is clear and far from the guards the next block is one level coarser. An event is accepted where y - H is small against the way across
the step and H is monotone by more than its slope's error: then it is the only one there, and Newton's method ends on it. What is not
clear at the finest level (grazing, two guards at once, flights near the rounding of y) is left to careful.py. What one step shows is in steps.py.

[1] Birkhoff, Priver: Hermite interpolation errors for derivatives, J. Math. Phys. 46 (1967).
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.careful import careful_search, is_clear
from impact_env.kernels.events.signals import (
    NOTHING,
    Event,
    counted,
    given_up,
    refine,
    terms_of,
    time_resolution,
    wall_of,
)
from impact_env.kernels.events.steps import (
    closer_root,
    cubic_root,
    event_in_step,
    is_far,
    leaves_guard,
)
from impact_env.kernels.motion.forced import DERIVATIVES, fill_carrier
from impact_env.kernels.motion.forced_sums import first_values
from impact_env.kernels.motion.numbers import cos_sin, lowest_bit
from impact_env.kernels.motion.slots import FASTEST, SPEED_CUBE, move
from impact_env.kernels.motion.vector import (
    COS,
    FORCED,
    POINTS,
    ROW,
    SIN,
    Place,
    Step,
    begin_orders,
    scan,
    turn_2,
    turn_3,
    weighted_sizes,
)

# of h^4 times the largest fourth derivative: error of the cubic between two points [1]
HERMITE_SHARE = 1.0 / 384.0
SCAN_NOISE = 1e-12  # of an amplitude: rounding of the sums and of the moving amplitudes
SLOPE_ERROR = (
    1.03  # of E: 3.08/3, since a difference of two coefficients is a third of the slope times h
)
INSIDE = 0.5 + 1e-9  # of a step, from its middle
MOST_TURNS = 2_000  # blocks after which the moving amplitudes are computed anew, long before their rounding comes near SCAN_NOISE


@jit_inline
def coarsest_level(steps, half):
    """Return the coarsest level that a window of half length ``half`` (s) allows: bounds hold up to a quarter of that beyond it."""
    top = steps.shape[0] - 1
    while top > 0 and steps[top, 0] > 0.25 * half:
        top -= 1
    return top


@jit_inline
def begin_at(course, offset):
    """Compute amplitudes and forced parts at an offset anew, and return the place."""
    slots = course.slots
    signal = course.signal
    omega = course.omega
    p = signal.polynomial
    w = signal.moving
    b = signal.block
    size = signal.u.shape[1]
    if offset > 0.0:
        move(slots.rows, slots.table, slots.scale, signal.u, offset, w)
        begin_orders(slots.rows, w, w, size)
    else:
        begin_orders(slots.rows, signal.u, w, size)
    tau = course.tau + offset
    c, s = cos_sin(omega * tau)
    f0, f1, f2 = first_values(course.forced.signals, tau, c, s)
    b[FORCED] = f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    b[FORCED + ROW] = f1 + p[1] + offset * p[2]
    b[FORCED + 2 * ROW] = f2 + p[2]
    return Place(offset, c, s, 0)


@jit_inline
def move_on(course, guards, place, step, k):
    """Turn amplitudes and forced parts to the end of a block's first k > 0 steps, and return the place."""
    w = course.signal.moving
    b = course.signal.block
    size = course.signal.u.shape[1]
    at = (step.level * POINTS + k - 1) * 2 * size
    if guards.direction is None:
        turn_2(course.slots.turns, at, w, size)
    else:
        turn_3(course.slots.turns, at, w, size)
    b[FORCED], b[FORCED + ROW], b[FORCED + 2 * ROW] = (
        b[FORCED + k],
        b[FORCED + ROW + k],
        b[FORCED + 2 * ROW + k],
    )
    return Place(place.offset + k * step.h, b[COS + k - 1], b[SIN + k - 1], place.turns + 1)


@jit_inline
def steps_of(course, level):
    """Return the steps of a level, with the errors that they have from here on."""
    slots = course.slots
    bound = course.forced.bound
    p = course.signal.polynomial
    w = course.signal.moving
    size = slots.errors.shape[1]
    e0, e1 = weighted_sizes(slots.errors, level * size, w, size)
    h = slots.steps[level, 0]
    share = h * h * h * h * HERMITE_SHARE
    e0 += share * bound[4] + bound[DERIVATIVES] + SCAN_NOISE * (bound[0] + abs(p[0]))
    e1 += share * bound[5] + bound[DERIVATIVES + 1] + SCAN_NOISE * (bound[1] + abs(p[1]))
    return Step(level, h, int(slots.steps[level, 1]), e0, e1)


@jit_inline
def coarser(course, guards, step):
    """Return the steps of the next level if one of them, after the block, will probably be clear, else the same."""
    wide = steps_of(course, step.level + 1)
    return wide if is_far(course.signal.block, step.h, guards, wide.e0, wide.e1) else step


@jit_inline
def scan_block(course, guards, place, step):
    """Fill a block and return (walls, reversals), as `vector.scan` does; a first step may start on a guard."""
    fill_carrier(course.slots.steps, course.omega, step.level, course.forced.carrier)
    walls, reversals = scan(course, guards, place, step, course.signal.u.shape[1])
    if place.offset == 0.0:
        walls, reversals = leaves_guard(course.signal, guards, step, walls, reversals)
    return walls, reversals


@jit_inline
def event_in(course, guards, place, step, k, near, length):
    """Return the only event in step k, or NOTHING where that is not certain; ``near``: whether the step is not clear of walls, of a reversal."""
    slots = course.slots
    forced = course.forced
    b = course.signal.block
    slope_error = SLOPE_ERROR + step.h * slots.scale[FASTEST] / 3.0
    kind, x = event_in_step(b, k, guards, step, near[0], near[1], slope_error)
    if kind == NOTHING:
        return Event(NOTHING, 0.0, 0.0, 0.0, 0.0, 0)
    wall = wall_of(kind, guards)
    if guards.direction is not None:
        x = closer_root(b, k, step.h, kind, wall, x)
    else:
        x = cubic_root(b, k, step.h, wall, x)
    _, b4 = weighted_sizes(
        slots.rows,
        SPEED_CUBE * course.signal.u.shape[1],
        course.signal.moving,
        course.signal.u.shape[1],
    )
    b4 = b4 + forced.bound[4]
    resolution = time_resolution(slots.rows, course.omega, length)
    found = refine(terms_of(course), place.offset + (k + x) * step.h, kind, wall, b4, resolution)
    if abs(found.offset - (place.offset + (k + 0.5) * step.h)) <= INSIDE * step.h:
        return found  # the only root in the step, and not one that Newton's method left it for
    return Event(NOTHING, 0.0, 0.0, 0.0, 0.0, found.evaluations)


@jit
def search(course, guards, length, half):
    """Return the first Event of a `Course` within ``length`` (s), else one at ``length``; ``half`` (s): half length of the window."""
    memory = course.signal.memory
    top = coarsest_level(course.slots.steps, half)
    level = min(int(memory[0]), top)
    up = False
    careful = 1.0
    count = 0
    place = Place(0.0, 0.0, 0.0, MOST_TURNS)
    step = Step(-1, 0.0, 0, 0.0, 0.0)
    while place.offset < length and count < memory[1]:
        count += 1
        if place.turns >= MOST_TURNS:
            place = begin_at(course, place.offset)
        if up:
            step = coarser(course, guards, step)
            level = step.level
        if (
            step.level != level
        ):  # amplitudes never grow: what was an error of a level once stays a bound
            step = steps_of(course, level)
        walls, reversals = scan_block(course, guards, place, step)
        k = min(lowest_bit(walls | reversals), POINTS)
        clear = k == POINTS
        up = clear and level < top
        if place.offset == 0.0:
            memory[0] = level + 1 if clear else (level if k > 0 else max(level - 1, 0))
        if place.offset + k * step.h >= length:
            break
        if not clear:
            found = event_in(
                course,
                guards,
                place,
                step,
                k,
                ((walls >> k) & 1 != 0, (reversals >> k) & 1 != 0),
                length,
            )
            count += found.evaluations
            if found.kind != NOTHING:
                if found.offset >= length:
                    break
                return counted(found, count)
        if k > 0:
            place = move_on(course, guards, place, step, k)
            careful = 1.0
        if not clear:
            if level > 0:
                level -= 1
            else:
                found = careful_search(
                    course,
                    guards,
                    place.offset,
                    min(place.offset + careful * step.h, length),
                    length,
                )
                count += found.evaluations
                if found.kind != NOTHING or np.isnan(found.offset):
                    return counted(found, count)
                place = Place(found.offset, 0.0, 0.0, MOST_TURNS)
                careful = 2.0 * careful
    return given_up(count) if count >= memory[1] else Event(NOTHING, length, 0.0, 0.0, 0.0, count)


@jit_inline
def next_event(window, course, guards, length):
    """Return the first Event of a `Course` in a `forced.Window` within ``length`` (s), as `search` does."""
    if is_clear(window.load, course, guards, length):
        return Event(NOTHING, length, 0.0, 0.0, 0.0, 1)
    return search(course, guards, length, window.half)
