"""The next event of a regime: where a guard signal y leaves (low, high), or where its rate changes sign. No event is missed.

The search looks at y, y' (and y'' where the rate is watched) at blocks of POINTS equidistant times. Between two of them, a step h apart, the cubic H
through both values and both slopes leaves |y - H| <= E = h^4/384 max|y''''|, and |y' - H'| <= 3.08 E/h [1]; H lies in the hull of its four
Bernstein coefficients. So a step is clear of a wall if these keep off it by more than E, and clear of a reversal if those of y' do.

Bounds. A slot's amplitude |u exp(s t)| never grows, so its share of E is at most its amplitude now times (|s| h)^4/384. Where that factor exceeds 1
the slot is not summed at all, and its amplitude is its share (`errors`, regimes.py). The forced part's share follows from a bound of its fourth
derivative; it is summed with SCAN_TERMS coefficients, and the bound of the rest is added. Rounding, of sums and of the moving amplitudes, is
covered by SCAN_NOISE in each share.

Levels. The steps h of the levels are a factor LEVEL_RATIO apart. A step that is not clear is looked at again one level finer; where all of a block
is clear and far from the guards the next block is one level coarser. An event is accepted where y - H is small against the way across
the step and H is monotone by more than its slope's error: then it is the only one there, and Newton's method ends on it. What is not
clear at the finest level (grazing, two guards at once, flights near the rounding of y) is left to careful.py.

Start on a guard. There y(0) = wall is known. The remainder is y''''/24 t^2 (h - t)^2, at most E/h 64/27 of t, so the step is clear if
the quadratic (H - wall)/t keeps off zero by more than that: three coefficients again.

[1] Birkhoff, Priver: Hermite interpolation errors for derivatives, J. Math. Phys. 46 (1967).
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.careful import careful_search
from impact_env.kernels.forced import DERIVATIVES, cos_sin, guard_values
from impact_env.kernels.jit import jit, jit_inline, jit_sum_inline
from impact_env.kernels.signals import HIT_HIGH, HIT_LOW, NOTHING, REVERSAL, Event, refine, time_resolution
from impact_env.kernels.slots import FASTEST, SPEED, digits, turned
from impact_env.kernels.vector import POINTS, ROW, block_sums_2, block_sums_3, turn_2, turn_3

SCAN_NOISE = 1e-12  # of an amplitude: rounding of the sums and of the moving amplitudes
SLOPE_ERROR = 1.03  # of E: 3.08/3, since a difference of two coefficients is a third of the slope times h
START_ERROR = 64.0 / 27.0
SHARP = 1e-4  # of the way across a step: E where an event is accepted
LOOK_AHEAD = 4.0  # LEVEL_RATIO: steps of a level in one of the next
MOST_SCANS = 20_000_000

# entries of Signal.block: rows of 1 + POINTS numbers of the value, the rate and the bend, then of their forced parts; POINTS numbers each of the
# carrier and of the margins to walls and to a reversal; the level to begin with
VALUE, RATE, BEND, FORCED, COS, SIN, WALLS, REVERSALS, LEVEL = 0, ROW, 2 * ROW, 3 * ROW, 6 * ROW, 6 * ROW + 8, 7 * ROW, 7 * ROW + 8, 8 * ROW


@jit_sum_inline
def begin_at(rows, table, scale, u, w, offset):  # type: ignore[no-untyped-def]
    """Set the moving amplitudes at an offset."""
    size = u.shape[1]
    d1, d2, d3, x = digits(scale, offset)
    for j in range(size):
        u_r, u_i = turned(rows, table, u, d1, d2, d3, x, j)
        w[j], w[size + j] = u_r, u_i
        w[2 * size + j], w[3 * size + j] = rows[0, j] * u_r - rows[1, j] * u_i, rows[0, j] * u_i + rows[1, j] * u_r
        w[4 * size + j], w[5 * size + j] = rows[2, j] * u_r - rows[3, j] * u_i, rows[2, j] * u_i + rows[3, j] * u_r


@jit_inline
def begin_forced(signals, omega, p, tau, offset, b):  # type: ignore[no-untyped-def]
    """Write the forced parts, with the polynomial, at an offset to the block's first column."""
    f0, f1, f2 = guard_values(signals, omega, tau + offset)
    b[FORCED] = f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2])
    b[FORCED + ROW] = f1 + p[1] + offset * p[2]
    b[FORCED + 2 * ROW] = f2 + p[2]


@jit_sum_inline
def errors_of(factors, steps, w, p, bound, level):  # type: ignore[no-untyped-def]
    """Return E of the signal and of its rate at a level."""
    size = factors.shape[1]
    e0 = 0.0
    e1 = 0.0
    for j in range(size):
        e0 += factors[level, j] * (abs(w[j]) + abs(w[size + j]))
        e1 += factors[level, j] * (abs(w[2 * size + j]) + abs(w[3 * size + j]))
    h = steps[level, 0]
    share = h * h * h * h / 384.0
    e0 += share * bound[4] + bound[DERIVATIVES] + SCAN_NOISE * (bound[0] + abs(p[0]))
    e1 += share * bound[5] + bound[DERIVATIVES + 1] + SCAN_NOISE * (bound[1] + abs(p[1]))
    return e0, e1


@jit_sum_inline
def add_forced_block(signals, carrier, level, c, s, x, h, offset, p, b, orders):  # type: ignore[no-untyped-def]
    """Write the forced parts at the block's times and add all forced parts to its rows.

    ``c``, ``s``: the force's carrier at the block's start, ``x`` (s) from the window's centre.
    """
    for k in range(POINTS):
        b[COS + k] = c * carrier[level, 0, k] - s * carrier[level, 1, k]
        b[SIN + k] = s * carrier[level, 0, k] + c * carrier[level, 1, k]
    for q in range(orders):
        r0, r1, r2, r3, r4, r5 = signals[q, 0, 0], signals[q, 0, 1], signals[q, 0, 2], signals[q, 0, 3], signals[q, 0, 4], signals[q, 0, 5]
        i0, i1, i2, i3, i4, i5 = signals[q, 1, 0], signals[q, 1, 1], signals[q, 1, 2], signals[q, 1, 3], signals[q, 1, 4], signals[q, 1, 5]
        p0, p1, p2 = p[0], p[1], 0.5 * p[2]
        if q == 1:
            p0, p1, p2 = p[1], p[2], 0.0
        if q == 2:
            p0, p1, p2 = p[2], 0.0, 0.0
        row = ROW * q
        for k in range(POINTS):
            t = h * (k + 1.0)
            y = x + t
            z = offset + t
            real = r0 + y * (r1 + y * (r2 + y * (r3 + y * (r4 + y * r5))))
            imaginary = i0 + y * (i1 + y * (i2 + y * (i3 + y * (i4 + y * i5))))
            f = real * b[COS + k] - imaginary * b[SIN + k] + p0 + z * (p1 + z * p2)
            b[FORCED + row + 1 + k] = f
            b[row + 1 + k] += f
        b[row] += b[FORCED + row]


@jit_sum_inline
def wall_margins(b, h, low, high, error):  # type: ignore[no-untyped-def]
    """Write by how much each step of the block is clear of the walls."""
    for k in range(POINTS):
        y0 = b[VALUE + k]
        y1 = b[VALUE + 1 + k]
        y2 = y0 + h / 3.0 * b[RATE + k]
        y3 = y1 - h / 3.0 * b[RATE + 1 + k]
        top = max(max(y0, y1), max(y2, y3))
        bottom = min(min(y0, y1), min(y2, y3))
        b[WALLS + k] = min(high - top, bottom - low) - error


@jit_sum_inline
def reversal_margins(b, h, direction, error):  # type: ignore[no-untyped-def]
    """Write by how much each step of the block is clear of a reversal."""
    for k in range(POINTS):
        v0 = direction * b[RATE + k]
        v1 = direction * b[RATE + 1 + k]
        v2 = v0 + h / 3.0 * direction * b[BEND + k]
        v3 = v1 - h / 3.0 * direction * b[BEND + 1 + k]
        b[REVERSALS + k] = min(min(v0, v1), min(v2, v3)) - error


@jit_inline
def start_margin(d1, slope0, slope1, h, error):  # type: ignore[no-untyped-def]
    """Return the margin of a first step that starts on a guard, from the distance at its end and the growth of the distance at both ends."""
    return min(min(h * slope0, 1.5 * (d1 - h / 3.0 * slope1)), d1) - START_ERROR * error


@jit_inline
def leave_guard(b, h, low, high, side, direction, zero_rate, e0, e1):  # type: ignore[no-untyped-def]
    """Mend the margins of a block whose first value, or rate, is known to lie on its guard."""
    if low is not None:
        y0, y1 = b[VALUE], b[VALUE + 1]
        y2, y3 = y0 + h / 3.0 * b[RATE], y1 - h / 3.0 * b[RATE + 1]
        if side > 0:
            leaving = start_margin(high - y1, -b[RATE], -b[RATE + 1], h, e0)
            b[WALLS] = min(leaving, min(min(y0, y1), min(y2, y3)) - low - e0)
        elif side < 0:
            leaving = start_margin(y1 - low, b[RATE], b[RATE + 1], h, e0)
            b[WALLS] = min(leaving, high - max(max(y0, y1), max(y2, y3)) - e0)
    if direction is not None:
        if zero_rate:
            b[REVERSALS] = start_margin(direction * b[RATE + 1], direction * b[BEND], direction * b[BEND + 1], h, e1)


@jit_inline
def first_unclear(b, low, direction):  # type: ignore[no-untyped-def]
    """Return the first step of the block that is not clear, or POINTS."""
    for k in range(POINTS):
        if low is not None:
            if not b[WALLS + k] > 0.0:
                return k
        if direction is not None:
            if not b[REVERSALS + k] > 0.0:
                return k
    return POINTS


@jit_inline
def sharp_root(d0, d1, d2, d3, error, slope_error):  # type: ignore[no-untyped-def]
    """Return where in (0, 1) the cubic with these Bernstein coefficients falls through zero, or -1 if that is not sharp."""
    least = min(min(d0 - d1, d1 - d2), d2 - d3)
    if not (d0 > error and d3 < -error and least > slope_error * error and error < SHARP * (d0 - d3)):
        return -1.0
    x = d0 / (d0 - d3)
    c1, c2, c3 = 3.0 * (d1 - d0), 3.0 * (d2 - 2.0 * d1 + d0), d3 - d0 + 3.0 * (d1 - d2)
    for _ in range(4):
        f = d0 + x * (c1 + x * (c2 + x * c3))
        x -= f / (c1 + x * (2.0 * c2 + 3.0 * x * c3))
        x = min(max(x, 0.0), 1.0)
    return x


@jit_inline
def event_in_step(b, k, h, low, high, direction, e0, e1, slope_error):  # type: ignore[no-untyped-def]
    """Return (kind, share of the step) of the only event in step k, or NOTHING where that is not certain."""
    if direction is not None:
        if not b[REVERSALS + k] > 0.0:
            if low is not None:
                if not b[WALLS + k] > 0.0:
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
    """Return whether a step of LOOK_AHEAD h from the block's end, with these errors, will probably be clear."""
    far = True
    if low is not None:
        y, way = b[VALUE + POINTS], LOOK_AHEAD * h * b[RATE + POINTS]
        far = min(high - max(y, y + way), min(y, y + way) - low) > e0
    if direction is not None:
        v, way = direction * b[RATE + POINTS], LOOK_AHEAD * h * direction * b[BEND + POINTS]
        far = far and min(v, v + way) > e1
    return far


@jit_sum_inline
def third_bound(rows, w, bound):  # type: ignore[no-untyped-def]
    """Return a bound of the signal's third derivative from the moving amplitudes' time on."""
    size = rows.shape[1]
    b3 = bound[3]
    for j in range(size):
        b3 += (abs(w[2 * size + j]) + abs(w[3 * size + j])) * rows[SPEED, j] * rows[SPEED, j]
    return b3


@jit
def search(slots, forced, omega, signal, tau, length, low, high, side, direction, zero_rate):  # type: ignore[no-untyped-def]
    """Return the first Event within ``length`` (s) from tau; its offset is ``length`` if there is none.

    ``low`` and ``high`` may be infinite; None: there are no walls at all. ``direction`` None: the rate is not watched; 1 or -1: the sign
    that it has at the start. ``side`` -1 or 1: the signal starts on the low or the high wall; ``zero_rate``: its rate starts at zero.
    """
    rows, table, scale, steps, waves, turns, errors = slots.rows, slots.table, slots.scale, slots.steps, slots.waves, slots.turns, slots.errors
    u, p, w, b = signal.u, signal.polynomial, signal.moving, signal.block
    signals, bound, carrier = forced.signals, forced.bound, forced.carrier
    size, top = u.shape[1], steps.shape[0] - 1
    while top > 0 and steps[top, 0] > 0.25 * (tau + length):  # bounds hold up to a quarter of half a window beyond it
        top -= 1
    level = min(int(b[LEVEL]), top)
    c, s, offset, count, begin, up, careful, e0, e1 = 0.0, 0.0, 0.0, 0, True, False, 1.0, 0.0, 0.0
    while offset < length and count < MOST_SCANS:
        count += 1
        if begin:
            begin_at(rows, table, scale, u, w, offset)
            begin_forced(signals, omega, p, tau, offset, b)
            c, s = cos_sin(omega * (tau + offset))
            begin = False
        if up:
            level += 1
        e0, e1 = errors_of(errors, steps, w, p, bound, level)
        if up:
            if not is_far(b, steps[level - 1, 0], low, high, direction, e0, e1):
                level -= 1
                e0, e1 = errors_of(errors, steps, w, p, bound, level)
        h, summed, first = steps[level, 0], int(steps[level, 1]), level * size * 2 * POINTS
        if direction is None:
            block_sums_2(waves, first, w, size, summed, b)
            add_forced_block(signals, carrier, level, c, s, tau + offset, h, offset, p, b, 2)
        else:
            block_sums_3(waves, first, w, size, summed, b)
            add_forced_block(signals, carrier, level, c, s, tau + offset, h, offset, p, b, 3)
            reversal_margins(b, h, direction, e1)
        if low is not None:
            wall_margins(b, h, low, high, e0)
        if offset == 0.0:
            leave_guard(b, h, low, high, side, direction, zero_rate, e0, e1)
        k = first_unclear(b, low, direction)
        clear = k == POINTS
        up = clear and level < top
        if offset == 0.0:
            b[LEVEL] = level + 1 if clear else (level if k > 0 else max(level - 1, 0))
        if offset + k * h >= length:
            break
        if not clear:
            kind, x = event_in_step(b, k, h, low, high, direction, e0, e1, SLOPE_ERROR + h * scale[FASTEST] / 3.0)
            if kind != NOTHING:
                wall = 0.0
                if low is not None:
                    wall = high if kind == HIT_HIGH else low
                b3, resolution = third_bound(rows, w, bound), time_resolution(rows, length)
                found = refine(rows, table, scale, signals, omega, u, p, tau, offset + (k + x) * h, kind, wall, b3, resolution)
                if found.offset >= length:
                    break
                return Event(kind, found.offset, found.value, found.rate, found.bend, count + found.evaluations)
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
        if not clear:
            if level > 0:
                level -= 1
            else:
                stop = min(offset + careful * h, length)
                found = careful_search(slots, forced, omega, signal, tau, offset, stop, length, low, high, side, direction, zero_rate)
                count += found.evaluations
                if found.kind != NOTHING or not found.offset < length:
                    return Event(found.kind, found.offset, found.value, found.rate, found.bend, count)
                offset, careful, begin = found.offset, 2.0 * careful, True
    if count >= MOST_SCANS:  # not a number, so that the run ends in an error: an event could be missed
        return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, count)
    return Event(NOTHING, length, 0.0, 0.0, 0.0, count)
