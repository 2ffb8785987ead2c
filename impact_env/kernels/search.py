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
clear at the finest level (grazing, two guards at once, flights near the rounding of y) is left to careful.py.

Start on a guard. There y(0) = wall is known, and the step is clear if the quadratic (H - wall)/t, three coefficients again, keeps off zero by more
than its error. Of a summed slot this is y''''/24 t (h - t)^2, at most 64/27 E/h. A slot U that is not summed is part of the known zero alone:
it adds U(t) - U(0) (1 - x)^2 (1 + 2 x) to the distance, x = t/h, at most (9/8 |U| + h |s U|) x (`start_error`; docs/method.md).

[1] Birkhoff, Priver: Hermite interpolation errors for derivatives, J. Math. Phys. 46 (1967).
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.careful import careful_search
from impact_env.kernels.forced import DERIVATIVES, fill_carrier, guard_values
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.signals import HIT_HIGH, HIT_LOW, NOTHING, REVERSAL, Event, refine, time_resolution, wall_of
from impact_env.kernels.slots import FASTEST, SPEED_SQUARE, cos_sin, move
from impact_env.kernels.vector import (
    BEND,
    COS,
    FORCED,
    POINTS,
    RATE,
    ROW,
    SIN,
    VALUE,
    begin_orders,
    scan_both,
    scan_reversal,
    scan_walls,
    turn_2,
    turn_3,
    weighted_sizes,
)

SCAN_NOISE = 1e-12  # of an amplitude: rounding of the sums and of the moving amplitudes
SLOPE_ERROR = 1.03  # of E: 3.08/3, since a difference of two coefficients is a third of the slope times h
START_ERROR = 64.0 / 27.0  # of E: what a summed slot's share becomes when it is divided by t/h
START_JUMP = 9.0 / 8.0  # of an unsummed slot's amplitude: largest (1 - (1 - x)^2 (1 + 2 x))/x
SHARP = 1e-3  # of the way across a step: E where an event is accepted
LEVEL_RATIO = 4.0
STEADY = 0.05  # of the way across a step: least fall between two coefficients where an event is accepted, so that Newton's method starts well
INSIDE = 0.5 + 1e-9  # of a step, from its middle
MOST_SCANS = 20_000_000
MOST_TURNS = 2_000  # blocks after which the moving amplitudes are computed anew, long before their rounding comes near SCAN_NOISE


@jit_inline
def begin_forced(signals, omega, p, tau, offset, b):  # type: ignore[no-untyped-def]
    """Write the forced parts, with the polynomial, at an offset to the block's first column."""
    f0, f1, f2 = guard_values(signals, omega, tau + offset)
    b[FORCED] = f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    b[FORCED + ROW] = f1 + p[1] + offset * p[2]
    b[FORCED + 2 * ROW] = f2 + p[2]


@jit_inline
def errors_of(errors, steps, w, p, bound, level):  # type: ignore[no-untyped-def]
    """Return E of the signal and of its rate at a level."""
    size = errors.shape[1]
    e0, e1 = weighted_sizes(errors, level * size, w, size)
    h = steps[level, 0]
    share = h * h * h * h / 384.0
    e0 += share * bound[4] + bound[DERIVATIVES] + SCAN_NOISE * (bound[0] + abs(p[0]))
    e1 += share * bound[5] + bound[DERIVATIVES + 1] + SCAN_NOISE * (bound[1] + abs(p[1]))
    return e0, e1


@jit_inline
def start_error(w, size, summed, order, h, error):  # type: ignore[no-untyped-def]
    """Return the error, in the quadratic (H - known zero)/t of a first step, of the derivative ``order`` with the error ``error``; times h.

    Each slot that is not summed, with the amplitudes w of this derivative and the next, has a share of its own instead of that in ``error``.
    """
    share = START_ERROR * error
    here, after = 2 * order * size, 2 * (order + 1) * size
    for j in range(summed, size):
        share += (START_JUMP - START_ERROR) * (abs(w[here + j]) + abs(w[here + size + j])) + h * (abs(w[after + j]) + abs(w[after + size + j]))
    return share


@jit_inline
def start_margin(d1, slope0, slope1, h):  # type: ignore[no-untyped-def]
    """Return the least of a first step that starts on a guard, from the distance at its end and the growth of the distance at both ends."""
    return min(min(h * slope0, 1.5 * (d1 - h / 3.0 * slope1)), d1)


@jit_inline
def leaves_wall(b, h, low, high, side, e0, error):  # type: ignore[no-untyped-def]
    """Return whether a block's first step, which starts on the wall ``side``, is clear of both walls; ``error`` as in `start_error`."""
    y0, y1 = b[VALUE], b[VALUE + 1]
    y2, y3 = y0 + h / 3.0 * b[RATE], y1 - h / 3.0 * b[RATE + 1]
    if side > 0:
        return start_margin(high - y1, -b[RATE], -b[RATE + 1], h) > error and min(min(y0, y1), min(y2, y3)) - low > e0
    return start_margin(y1 - low, b[RATE], b[RATE + 1], h) > error and high - max(max(y0, y1), max(y2, y3)) > e0


@jit_inline
def leaves_rest(b, h, direction, error):  # type: ignore[no-untyped-def]
    """Return whether a block's first step, which starts with rate zero, is clear of a reversal; ``error`` as in `start_error`."""
    return start_margin(direction * b[RATE + 1], direction * b[BEND], direction * b[BEND + 1], h) > error


@jit_inline
def first_bit(mask):  # type: ignore[no-untyped-def]
    """Return the place of the lowest bit that is set, or POINTS."""
    k = 0
    while k < POINTS and (mask >> k) & 1 == 0:
        k += 1
    return k


@jit_inline
def sharp_root(d0, d1, d2, d3, error, slope_error):  # type: ignore[no-untyped-def]
    """Return where in (0, 1) the cubic with these Bernstein coefficients falls through zero, or -1 if that is not sharp."""
    least = min(min(d0 - d1, d1 - d2), d2 - d3)
    if not (d0 > error and d3 < -error and least > max(slope_error * error, STEADY * (d0 - d3)) and error < SHARP * (d0 - d3)):
        return -1.0
    x = d0 / (d0 - d3)
    c1, c2, c3 = 3.0 * (d1 - d0), 3.0 * (d2 - 2.0 * d1 + d0), d3 - d0 + 3.0 * (d1 - d2)
    for _ in range(2):
        f = d0 + x * (c1 + x * (c2 + x * c3))
        x -= f / (c1 + x * (2.0 * c2 + 3.0 * x * c3))
        x = min(max(x, 0.0), 1.0)
    return x


@jit_inline
def closer_root(b, k, h, kind, wall, x):  # type: ignore[no-untyped-def]
    """Return a root near ``x``, in shares of step k, of the quintic through value, rate and bend at both ends: at the wall, or of its rate."""
    v0, a0 = h * b[RATE + k], h * h * b[BEND + k]
    way, turn, bend = b[VALUE + 1 + k] - b[VALUE + k] - v0 - 0.5 * a0, h * b[RATE + 1 + k] - v0 - a0, h * h * b[BEND + 1 + k] - a0
    c3, c4, c5 = 10.0 * way - 4.0 * turn + 0.5 * bend, 7.0 * turn - 15.0 * way - bend, 6.0 * way - 3.0 * turn + 0.5 * bend
    for _ in range(2):
        v = v0 + x * (a0 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))
        if kind == REVERSAL:
            step = v / (a0 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5)))
        else:
            step = (b[VALUE + k] - wall + x * (v0 + x * (0.5 * a0 + x * (c3 + x * (c4 + x * c5))))) / v
        x = min(max(x - step, 0.0), 1.0)
    return x


@jit_inline
def event_in_step(b, k, h, low, high, direction, near_wall, near_rest, e0, e1, slope_error):  # type: ignore[no-untyped-def]
    """Return (kind, share of the step) of the only event in step k, or NOTHING where that is not certain."""
    if direction is not None:
        if near_rest:
            if near_wall:
                return NOTHING, 0.0
            v0, v3 = direction * b[RATE + k], direction * b[RATE + 1 + k]
            x = sharp_root(v0, v0 + h / 3.0 * direction * b[BEND + k], v3 - h / 3.0 * direction * b[BEND + 1 + k], v3, e1, slope_error)
            return (REVERSAL, x) if x >= 0.0 else (NOTHING, 0.0)
    if low is not None:
        y0, y3 = b[VALUE + k], b[VALUE + 1 + k]
        y1, y2 = y0 + h / 3.0 * b[RATE + k], y3 - h / 3.0 * b[RATE + 1 + k]
        if y3 > y0:
            x = sharp_root(high - y0, high - y1, high - y2, high - y3, e0, slope_error)
            return (HIT_HIGH, x) if x >= 0.0 else (NOTHING, 0.0)
        x = sharp_root(y0 - low, y1 - low, y2 - low, y3 - low, e0, slope_error)
        return (HIT_LOW, x) if x >= 0.0 else (NOTHING, 0.0)
    return NOTHING, 0.0


@jit_inline
def is_far(b, h, low, high, direction, e0, e1):  # type: ignore[no-untyped-def]
    """Return whether a step of LEVEL_RATIO h from the block's end, with these errors, will probably be clear."""
    far = True
    if low is not None:
        y, way = b[VALUE + POINTS], LEVEL_RATIO * h * b[RATE + POINTS]
        far = min(high - max(y, y + way), min(y, y + way) - low) > e0
    if direction is not None:
        v, way = direction * b[RATE + POINTS], LEVEL_RATIO * h * direction * b[BEND + POINTS]
        far = far and min(v, v + way) > e1
    return far


@jit
def search(slots, forced, omega, signal, tau, length, half, low, high, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return the first Event within ``length`` (s) from tau; its offset is ``length`` if there is none. ``half`` (s): half length of the window.

    ``low`` and ``high`` may be infinite; None: there are no walls at all. ``direction`` None: the rate is not watched; 1 or -1: the sign
    that it has at the start. ``side`` -1 or 1: the signal starts on the low or the high wall; ``zero_rate``: its rate starts at zero.
    """
    rows, table, scale, steps, waves, turns, errors = slots.rows, slots.table, slots.scale, slots.steps, slots.waves, slots.turns, slots.errors
    u, p, w, b, memory = signal.u, signal.polynomial, signal.moving, signal.block, signal.memory
    signals, bound, carrier = forced.signals, forced.bound, forced.carrier
    size, top = u.shape[1], steps.shape[0] - 1
    while top > 0 and steps[top, 0] > 0.25 * half:  # bounds hold up to a quarter of half a window beyond it
        top -= 1
    level = min(int(memory[0]), top)
    c, s, offset, count, turns_made, begin, up, careful, known, e0, e1 = 0.0, 0.0, 0.0, 0, 0, True, False, 1.0, -1, 0.0, 0.0
    while offset < length and count < MOST_SCANS:
        count += 1
        if begin:
            if offset > 0.0:
                move(rows, table, scale, u, offset, w)
                begin_orders(rows, w, w, size)
            else:
                begin_orders(rows, u, w, size)
            begin_forced(signals, omega, p, tau, offset, b)
            c, s = cos_sin(omega * (tau + offset))
            begin, turns_made = False, 0
        if up:
            far0, far1 = errors_of(errors, steps, w, p, bound, level + 1)
            if is_far(b, steps[level, 0], low, high, direction, far0, far1):
                level, known, e0, e1 = level + 1, level + 1, far0, far1
        if known != level:  # amplitudes never grow: what was an error of a level once stays a bound
            e0, e1 = errors_of(errors, steps, w, p, bound, level)
            known = level
        fill_carrier(steps, omega, level, carrier)
        h, summed, first = steps[level, 0], int(steps[level, 1]), level * size * 2 * POINTS
        x = tau + offset
        at = 2 * POINTS * level
        if direction is None:
            if low is not None:
                walls, reversals = scan_walls(
                    waves, first, w, size, summed, signals, carrier, at, c, s, x, h, offset, p, b, low, high, 0.0, e0, e1
                )  # fmt: skip
        if direction is not None:
            if low is None:
                walls, reversals = scan_reversal(
                    waves, first, w, size, summed, signals, carrier, at, c, s, x, h, offset, p, b, 0.0, 0.0, direction, e0, e1
                )  # fmt: skip
            if low is not None:
                walls, reversals = scan_both(
                    waves, first, w, size, summed, signals, carrier, at, c, s, x, h, offset, p, b, low, high, direction, e0, e1
                )  # fmt: skip
        if offset == 0.0:
            if low is not None:
                if side != 0:
                    error = start_error(w, size, summed, 0, h, e0)
                    walls = (walls & -2) | (0 if leaves_wall(b, h, low, high, side, e0, error) else 1)
            if direction is not None:
                if zero_rate:
                    error = start_error(w, size, summed, 1, h, e1)
                    reversals = (reversals & -2) | (0 if leaves_rest(b, h, direction, error) else 1)
        k = first_bit(walls | reversals)
        clear = k == POINTS
        up = clear and level < top
        if offset == 0.0:
            memory[0] = level + 1 if clear else (level if k > 0 else max(level - 1, 0))
        if offset + k * h >= length:
            break
        if not clear:
            near_wall, near_rest = (walls >> k) & 1 != 0, (reversals >> k) & 1 != 0
            slope_error = SLOPE_ERROR + h * scale[FASTEST] / 3.0
            kind, x = event_in_step(b, k, h, low, high, direction, near_wall, near_rest, e0, e1, slope_error)
            if kind != NOTHING:
                wall = wall_of(kind, low, high)
                if direction is not None:
                    x = closer_root(b, k, h, kind, wall, x)
                _, b3 = weighted_sizes(rows, SPEED_SQUARE * size, w, size)
                b3, resolution = b3 + bound[3], time_resolution(rows, omega, length)
                found = refine(rows, table, scale, signals, omega, u, p, tau, offset + (k + x) * h, kind, wall, b3, resolution)
                count += found.evaluations
                if (
                    abs(found.offset - (offset + (k + 0.5) * h)) <= INSIDE * h
                ):  # the only root in the step, and not one that Newton's method left it for
                    if found.offset >= length:
                        break
                    return Event(kind, found.offset, found.value, found.rate, found.bend, count)
        if k > 0:
            careful = 1.0
            at = (level * POINTS + k - 1) * 2 * size
            if direction is None:
                turn_2(turns, at, w, size)
            else:
                turn_3(turns, at, w, size)
            c, s = b[COS + k - 1], b[SIN + k - 1]
            b[FORCED], b[FORCED + ROW], b[FORCED + 2 * ROW] = b[FORCED + k], b[FORCED + ROW + k], b[FORCED + 2 * ROW + k]
            offset += k * h
            turns_made += 1
            begin = turns_made >= MOST_TURNS
        if not clear:
            if level > 0:
                level -= 1
            else:
                stop = min(offset + careful * h, length)
                found = careful_search(slots, forced, omega, signal, tau, offset, stop, length, low, high, side, direction, zero_rate)
                count += found.evaluations
                if found.kind != NOTHING or np.isnan(found.offset):
                    return Event(found.kind, found.offset, found.value, found.rate, found.bend, count)
                offset, careful, begin = found.offset, 2.0 * careful, True
    if count >= MOST_SCANS:  # not a number, so that the run ends in an error: an event could be missed
        return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
    return Event(NOTHING, length, 0.0, 0.0, 0.0, count)
