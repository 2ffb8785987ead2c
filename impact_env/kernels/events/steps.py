"""One step of the search's scan (search.py).

The module decides whether a step is clear of the guards, also if it starts on one, and locates the
only event in it.

Start on a guard. There y(0) = wall is known, and the step is clear if the quadratic (H - wall)/t,
three coefficients again, keeps off zero by more than its error. Of a summed modal amplitude this is
y''''/24 t (h - t)^2, at most 64/27 E/h. A modal amplitude U that is not summed is part of the known
zero alone: it adds U(t) - U(0) (1 - x)^2 (1 + 2 x) to the distance, x = t/h, at most (9/8 |U| + h
|s U|) x (`start_error`; docs/method.md).
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit_inline
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW, NOTHING, REVERSAL
from impact_env.kernels.motion.numbers import fma
from impact_env.kernels.motion.search_block import BEND, POINTS, RATE, VALUE

START_ERROR = (
    64.0 / 27.0
)  # of E: what a summed modal amplitude's share becomes when it is divided by t/h
START_JUMP = (
    9.0 / 8.0
)  # of an unsummed modal amplitude's amplitude: largest (1 - (1 - x)^2 (1 + 2 x))/x
# of the signal's fall over a step, where an event in it is accepted: the error E is below the
# first, and the fall between any two coefficients above the second. Then E moves the root by a
# third of a step at most, and usually by a twentieth, and Newton's method goes on with the signal
# itself. Both only decide whether a step is halved first: an event that is found does not depend on
# them
ROOT_ERROR_TOL = 0.05
ROOT_SLOPE_TOL = 0.05
LEVEL_RATIO = 4.0


@jit_inline
def start_error(w, size, summed, order, h, error):
    """Return the error of the quadratic (H - known zero)/t of a first step, times h.

    It is the error for the derivative ``order``, which has the error ``error``.

    Each modal amplitude that is not summed, with the amplitudes w of this derivative and the next,
    has a share of its own instead of that in ``error``.
    """
    share = START_ERROR * error
    here = 2 * order * size
    after = 2 * (order + 1) * size
    for j in range(summed, size):
        share += (START_JUMP - START_ERROR) * (abs(w[here + j]) + abs(w[here + size + j])) + h * (
            abs(w[after + j]) + abs(w[after + size + j])
        )
    return share


@jit_inline
def start_margin(d1, slope0, slope1, h):
    """Return the least coefficient of a first step that starts on a guard.

    It follows from the distance at the step's end and from the growth of the distance at both ends.
    """
    return min(min(h * slope0, 1.5 * (d1 - h / 3.0 * slope1)), d1)


@jit_inline
def leaves_wall(b, guards, step, error):
    """Return whether a block's first step, which starts on a wall, is clear of both walls.

    ``error`` is that of `start_error`.
    """
    h = step.h
    y0 = b[VALUE]
    y1 = b[VALUE + 1]
    y2 = y0 + h / 3.0 * b[RATE]
    y3 = y1 - h / 3.0 * b[RATE + 1]
    if guards.side > 0:
        clear = start_margin(guards.high - y1, -b[RATE], -b[RATE + 1], h) > error
        return clear and min(min(y0, y1), min(y2, y3)) - guards.low > step.e0
    clear = start_margin(y1 - guards.low, b[RATE], b[RATE + 1], h) > error
    return clear and guards.high - max(max(y0, y1), max(y2, y3)) > step.e0


@jit_inline
def leaves_rest(b, h, direction, error):
    """Return whether a block's first step, which starts with rate zero, is clear of a reversal.

    ``error`` is that of `start_error`.
    """
    return (
        start_margin(direction * b[RATE + 1], direction * b[BEND], direction * b[BEND + 1], h)
        > error
    )


@jit_inline
def correct_first_step(signal, guards, step, walls, reversals):
    """Return a scan's (walls, reversals) with the corrected bit of the first step.

    The bit is corrected for the guard on which the signal starts.
    """
    b = signal.block
    w = signal.moving
    size = signal.u.shape[1]
    if guards.side != 0:
        error = start_error(w, size, step.summed, 0, step.h, step.e0)
        walls = (walls & -2) | (0 if leaves_wall(b, guards, step, error) else 1)
    if guards.direction is not None:
        if guards.zero_rate:
            error = start_error(w, size, step.summed, 1, step.h, step.e1)
            reversals = (reversals & -2) | (
                0 if leaves_rest(b, step.h, guards.direction, error) else 1
            )
    return walls, reversals


@jit_inline
def find_sharp_root(d0, d1, d2, d3, error, slope_error):
    """Return the zero in (0, 1) of the secant of the cubic with these Bernstein coefficients.

    The result is -1 if the cubic's root is not sharp.
    """
    least = min(min(d0 - d1, d1 - d2), d2 - d3)
    if not (
        d0 > error
        and d3 < -error
        and least > max(slope_error * error, ROOT_SLOPE_TOL * (d0 - d3))
        and error < ROOT_ERROR_TOL * (d0 - d3)
    ):
        return -1.0
    return d0 / (d0 - d3)


@jit_inline
def halley_step(x, f, slope, bend):
    """Return a better root than x, by Halley's method."""
    return x - f * slope / fma(-0.5 * f, bend, slope * slope)


@jit_inline
def refine_cubic_root(b, k, h, wall, x):
    """Return a root near ``x`` of a cubic minus the wall's position.

    The cubic matches value and rate at both ends of step k. Roots are given as shares of the step.
    """
    y = b[VALUE + k] - wall
    v = h * b[RATE + k]
    way = b[VALUE + 1 + k] - b[VALUE + k] - v
    turn = h * b[RATE + 1 + k] - v
    c2 = fma(3.0, way, -turn)
    c3 = fma(-2.0, way, turn)
    for _ in range(2):
        f = fma(x, fma(x, fma(x, c3, c2), v), y)
        slope = fma(x, fma(x, 3.0 * c3, 2.0 * c2), v)
        x = halley_step(x, f, slope, fma(x, 6.0 * c3, 2.0 * c2))
    return x


@jit_inline
def refine_quintic_root(b, k, h, kind, wall, x):
    """Return a root near ``x`` of a quintic minus the wall's position, or of its rate.

    The quintic matches value, rate and second derivative at both ends of step k. Roots are given as
    shares of the step.
    """
    y0 = b[VALUE + k] - wall
    v0 = h * b[RATE + k]
    a0 = h * h * b[BEND + k]
    way = b[VALUE + 1 + k] - b[VALUE + k] - v0 - 0.5 * a0
    turn = h * b[RATE + 1 + k] - v0 - a0
    bend = h * h * b[BEND + 1 + k] - a0
    c3 = 10.0 * way - 4.0 * turn + 0.5 * bend
    c4 = 7.0 * turn - 15.0 * way - bend
    c5 = 6.0 * way - 3.0 * turn + 0.5 * bend
    for _ in range(2):
        v = fma(x, fma(x, fma(x, fma(x, 5.0 * c5, 4.0 * c4), 3.0 * c3), a0), v0)
        a = fma(x, fma(x, fma(x, 20.0 * c5, 12.0 * c4), 6.0 * c3), a0)
        if kind == REVERSAL:
            x = halley_step(x, v, a, fma(x, fma(x, 60.0 * c5, 24.0 * c4), 6.0 * c3))
        else:
            y = fma(x, fma(x, fma(x, fma(x, fma(x, c5, c4), c3), 0.5 * a0), v0), y0)
            x = halley_step(x, y, v, a)
    return x


@jit_inline
def locate_reversal(b, k, step, direction, slope_error):
    """Return the share of step k where the rate changes its sign, or -1 if that is not sharp."""
    h = step.h
    v0 = direction * b[RATE + k]
    v3 = direction * b[RATE + 1 + k]
    return find_sharp_root(
        v0,
        v0 + h / 3.0 * direction * b[BEND + k],
        v3 - h / 3.0 * direction * b[BEND + 1 + k],
        v3,
        step.e1,
        slope_error,
    )


@jit_inline
def locate_event_in_step(b, k, guards, step, near_wall, near_rest, slope_error):
    """Return (kind, share of the step) of the only event in step k.

    The kind is NOTHING if it is not certain that this event is the only one.
    """
    low = guards.low
    high = guards.high
    if guards.direction is not None:
        if near_rest:
            if near_wall:
                return NOTHING, 0.0
            x = locate_reversal(b, k, step, guards.direction, slope_error)
            return (REVERSAL, x) if x >= 0.0 else (NOTHING, 0.0)
    y0 = b[VALUE + k]
    y3 = b[VALUE + 1 + k]
    y1 = y0 + step.h / 3.0 * b[RATE + k]
    y2 = y3 - step.h / 3.0 * b[RATE + 1 + k]
    if y3 > y0:
        x = find_sharp_root(high - y0, high - y1, high - y2, high - y3, step.e0, slope_error)
        return (HIT_HIGH, x) if x >= 0.0 else (NOTHING, 0.0)
    x = find_sharp_root(y0 - low, y1 - low, y2 - low, y3 - low, step.e0, slope_error)
    return (HIT_LOW, x) if x >= 0.0 else (NOTHING, 0.0)


@jit_inline
def is_far(b, h, guards, e0, e1):
    """Return whether a step of LEVEL_RATIO h from the block's end will probably be clear.

    ``e0`` and ``e1`` are the errors of this step.
    """
    y = b[VALUE + POINTS]
    way = LEVEL_RATIO * h * b[RATE + POINTS]
    far = min(guards.high - max(y, y + way), min(y, y + way) - guards.low) > e0
    if guards.direction is not None:
        v = guards.direction * b[RATE + POINTS]
        way = LEVEL_RATIO * h * guards.direction * b[BEND + POINTS]
        far = far and min(v, v + way) > e1
    return far
