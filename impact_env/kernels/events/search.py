"""The next event of a regime.

At an event a guard signal y leaves (low, high), or its rate changes sign. No event is missed.

The search looks at y, y' (and y'' where the rate is watched) at blocks of POINTS equidistant times.
Between two of them, a step h apart, the cubic H through both values and both slopes leaves |y - H|
<= E = h^4/384 max|y''''|, and |y' - H'| <= 3.08 E/h [1]; H lies in the hull of its four Bernstein
coefficients. So a step is clear of a wall if these keep off it by more than E, and clear of a
reversal if those of y' do.

Bounds. A modal amplitude's amplitude |u exp(s t)| never grows, so its share of E is at most its
amplitude now times (|s| h)^4/384. Where that factor exceeds 1 the modal amplitude is not summed at
all, and its amplitude is its share (`errors`, tables.py). The forced part's share follows from a
bound of its fourth derivative; it is summed with SCAN_TERMS coefficients, and the bound of the rest
is added. Rounding, of sums and of the moving amplitudes, is covered by SCAN_NOISE in each share.

Levels. The steps h of the levels are a factor LEVEL_RATIO apart. A step that is not clear is looked
at again one level finer; where all of a block is clear and far from the guards the next block is
one level coarser. An event is accepted where y - H is small against the way across the step and H
is monotone by more than its slope's error: then it is the only one there, and Newton's method ends
on it. What is not clear at the finest level (grazing, two guards at once, flights near the rounding
of y) is left to careful.py. What one step shows is in steps.py.

[1] Birkhoff, Priver: Hermite interpolation errors for derivatives, J. Math. Phys. 46 (1967).
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.careful import careful_search, has_no_event
from impact_env.kernels.events.signals import (
    NOTHING,
    GuardEvent,
    failed_search,
    find_event_wall,
    refine_root,
    select_terms,
    time_resolution,
    with_evaluations,
)
from impact_env.kernels.events.steps import (
    correct_first_step,
    is_far,
    locate_event_in_step,
    refine_cubic_root,
    refine_quintic_root,
)
from impact_env.kernels.motion.forced import DERIVATIVES, fill_carrier
from impact_env.kernels.motion.forced_sums import evaluate_first_signals
from impact_env.kernels.motion.modal_system import LARGEST_RATE, SPEED_CUBE, propagate_to
from impact_env.kernels.motion.numbers import cos_sin, lowest_bit
from impact_env.kernels.motion.search_block import (
    COS,
    FORCED,
    POINTS,
    ROW,
    SIN,
    BlockStart,
    SearchStep,
    propagate_three_orders,
    propagate_two_orders,
    scan,
    start_orders,
    sum_weighted_magnitudes,
)

# of h^4 times the largest fourth derivative: error of the cubic between two points [1]
HERMITE_SHARE = 1.0 / 384.0
SCAN_NOISE = 1e-12  # of an amplitude: rounding of the sums and of the moving amplitudes
SLOPE_ERROR = (
    1.03  # of E: 3.08/3, since a difference of two coefficients is a third of the slope times h
)
STEP_HALF_WIDTH = 0.5 + 1e-9  # of a step, from its middle
# blocks after which the moving amplitudes are recomputed, long before their rounding comes near
# SCAN_NOISE
MOST_BLOCKS = 2_000


@jit_inline
def find_coarsest_level(steps, half):
    """Return the coarsest level that a window of half length ``half`` (s) allows.

    Bounds hold up to a quarter of the half length beyond the window.
    """
    top = steps.shape[0] - 1
    while top > 0 and steps[top, 0] > 0.25 * half:
        top -= 1
    return top


@jit_inline
def start_block(function, offset):
    """Compute amplitudes and forced parts at an offset afresh; return the start of a block."""
    system = function.system
    signal = function.signal
    omega = function.omega
    p = signal.polynomial
    w = signal.moving
    b = signal.block
    size = signal.u.shape[1]
    if offset > 0.0:
        propagate_to(system.rows, system.table, system.scale, signal.u, offset, w)
        start_orders(system.rows, w, w, size)
    else:
        start_orders(system.rows, signal.u, w, size)
    tau = function.tau + offset
    c, s = cos_sin(omega * tau)
    f0, f1, f2 = evaluate_first_signals(function.forced.signals, tau, c, s)
    b[FORCED] = f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    b[FORCED + ROW] = f1 + p[1] + offset * p[2]
    b[FORCED + 2 * ROW] = f2 + p[2]
    return BlockStart(offset, c, s, 0)


@jit_inline
def advance_block(function, guards, place, step, k):
    """Propagate amplitudes and forced parts by the first k > 0 steps of a block.

    Returns the start of the next block.
    """
    w = function.signal.moving
    b = function.signal.block
    size = function.signal.u.shape[1]
    at = (step.level * POINTS + k - 1) * 2 * size
    if guards.direction is None:
        propagate_two_orders(function.system.turns, at, w, size)
    else:
        propagate_three_orders(function.system.turns, at, w, size)
    b[FORCED], b[FORCED + ROW], b[FORCED + 2 * ROW] = (
        b[FORCED + k],
        b[FORCED + ROW + k],
        b[FORCED + 2 * ROW + k],
    )
    return BlockStart(place.offset + k * step.h, b[COS + k - 1], b[SIN + k - 1], place.turns + 1)


@jit_inline
def make_search_step(function, level):
    """Return the step of a level, with its errors from here on."""
    system = function.system
    bound = function.forced.bound
    p = function.signal.polynomial
    w = function.signal.moving
    size = system.errors.shape[1]
    e0, e1 = sum_weighted_magnitudes(system.errors, level * size, w, size)
    h = system.steps[level, 0]
    share = h * h * h * h * HERMITE_SHARE
    e0 += share * bound[4] + bound[DERIVATIVES] + SCAN_NOISE * (bound[0] + abs(p[0]))
    e1 += share * bound[5] + bound[DERIVATIVES + 1] + SCAN_NOISE * (bound[1] + abs(p[1]))
    return SearchStep(level, h, int(system.steps[level, 1]), e0, e1)


@jit_inline
def try_coarser_step(function, guards, step):
    """Return the step of the next coarser level if it will probably be clear after the block.

    Otherwise the same step is returned.
    """
    wide = make_search_step(function, step.level + 1)
    return wide if is_far(function.signal.block, step.h, guards, wide.e0, wide.e1) else step


@jit_inline
def scan_block(function, guards, place, step):
    """Fill a block and return (walls, reversals), as `search_block.scan` does.

    A first step may start on a guard.
    """
    fill_carrier(function.system.steps, function.omega, step.level, function.forced.carrier)
    walls, reversals = scan(function, guards, place, step, function.signal.u.shape[1])
    if place.offset == 0.0:
        walls, reversals = correct_first_step(function.signal, guards, step, walls, reversals)
    return walls, reversals


@jit_inline
def locate_event(function, guards, place, step, k, near, length):
    """Return the only event in step k, or NOTHING where that is not certain.

    ``near``: whether the step is not clear of walls, and of a reversal.
    """
    system = function.system
    forced = function.forced
    b = function.signal.block
    slope_error = SLOPE_ERROR + step.h * system.scale[LARGEST_RATE] / 3.0
    kind, x = locate_event_in_step(b, k, guards, step, near[0], near[1], slope_error)
    if kind == NOTHING:
        return GuardEvent(NOTHING, 0.0, 0.0, 0.0, 0.0, 0)
    wall = find_event_wall(kind, guards)
    if guards.direction is not None:
        x = refine_quintic_root(b, k, step.h, kind, wall, x)
    else:
        x = refine_cubic_root(b, k, step.h, wall, x)
    _, b4 = sum_weighted_magnitudes(
        system.rows,
        SPEED_CUBE * function.signal.u.shape[1],
        function.signal.moving,
        function.signal.u.shape[1],
    )
    b4 = b4 + forced.bound[4]
    resolution = time_resolution(system.rows, function.omega, length)
    event = refine_root(
        select_terms(function), place.offset + (k + x) * step.h, kind, wall, b4, resolution
    )
    if abs(event.offset - (place.offset + (k + 0.5) * step.h)) <= STEP_HALF_WIDTH * step.h:
        return event  # the only root in the step, and not one that Newton's method left it for
    return GuardEvent(NOTHING, 0.0, 0.0, 0.0, 0.0, event.evaluations)


@jit
def search_events(function, guards, length, half):
    """Return the first GuardEvent of an `EventFunction` within ``length`` (s).

    If none occurs, the result is at ``length``. ``half`` (s) is half the length of the window.
    """
    memory = function.signal.memory
    top = find_coarsest_level(function.system.steps, half)
    level = min(int(memory[0]), top)
    up = False
    careful = 1.0
    count = 0
    place = BlockStart(0.0, 0.0, 0.0, MOST_BLOCKS)
    step = SearchStep(-1, 0.0, 0, 0.0, 0.0)
    while place.offset < length and count < memory[1]:
        count += 1
        if place.turns >= MOST_BLOCKS:
            place = start_block(function, place.offset)
        if up:
            step = try_coarser_step(function, guards, step)
            level = step.level
        if (
            step.level != level
        ):  # amplitudes never grow: what was an error of a level once stays a bound
            step = make_search_step(function, level)
        walls, reversals = scan_block(function, guards, place, step)
        k = min(lowest_bit(walls | reversals), POINTS)
        clear = k == POINTS
        up = clear and level < top
        if place.offset == 0.0:
            memory[0] = level + 1 if clear else (level if k > 0 else max(level - 1, 0))
        if place.offset + k * step.h >= length:
            break
        if not clear:
            event = locate_event(
                function,
                guards,
                place,
                step,
                k,
                ((walls >> k) & 1 != 0, (reversals >> k) & 1 != 0),
                length,
            )
            count += event.evaluations
            if event.kind != NOTHING:
                if event.offset >= length:
                    break
                return with_evaluations(event, count)
        if k > 0:
            place = advance_block(function, guards, place, step, k)
            careful = 1.0
        if not clear:
            if level > 0:
                level -= 1
            else:
                event = careful_search(
                    function,
                    guards,
                    place.offset,
                    min(place.offset + careful * step.h, length),
                    length,
                )
                count += event.evaluations
                if event.kind != NOTHING or np.isnan(event.offset):
                    return with_evaluations(event, count)
                place = BlockStart(event.offset, 0.0, 0.0, MOST_BLOCKS)
                careful = 2.0 * careful
    return (
        failed_search(count)
        if count >= memory[1]
        else GuardEvent(NOTHING, length, 0.0, 0.0, 0.0, count)
    )


@jit_inline
def find_next_event(window, function, guards, length):
    """Return the first GuardEvent in a `forced.ForceWindow` within ``length`` (s).

    The result is that of `search_events`, for the signal of an `EventFunction`.
    """
    if has_no_event(window.load, function, guards, length):
        return GuardEvent(NOTHING, length, 0.0, 0.0, 0.0, 1)
    return search_events(function, guards, length, window.half)
