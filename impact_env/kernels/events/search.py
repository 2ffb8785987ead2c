"""The next event of a regime.

At an event a guard signal y leaves (low, high), or its rate changes sign. No event is missed.

In: a guard signal in a window (`EventFunction`) and the bounds that end it (`Guards`). Out: the
first `GuardEvent`, or none (`find_next_event`).

The search evaluates y, y' (and y'' where the rate has a guard) at blocks of POINTS equidistant
times. Between two of them, a step h apart, the cubic H through both values and both slopes leaves
|y - H| <= E = h^4/384 max|y''''|, and |y' - H'| <= 3.08 E/h [1]; H lies in the hull of its four
Bernstein coefficients. So a step is clear of a wall if these keep off it by more than E, and clear
of a reversal if those of y' do.

Bounds. The magnitude of a modal amplitude |u exp(s t)| never grows, so its share of E is at most
its magnitude now times (|s| h)^4/384. Where that factor exceeds 1 the modal amplitude is not summed
at all, and its magnitude is its share (`ModalSystem.errors`). The forced part's share follows from
a bound of its fourth derivative; it is summed with SCAN_TERMS coefficients, and the bound of the
rest is added. Rounding, of sums and of the moving amplitudes, is covered by SCAN_NOISE in each
share.

Levels. The steps h of the levels are a factor LEVEL_RATIO apart. A step that is not clear is
scanned again one level finer; where all of a block is clear and far from the guards the next block
is one level coarser. An event is accepted where y - H is small against the way across the step and
H is monotone by more than its slope's error: then it is the only one there, and Newton's method
ends on it. What is not clear at the finest level (grazing, two guards at once, flights near the
rounding of y) is left to careful.py.

Start on a guard. There y(0) = wall is known, and the first step is clear if the quadratic
(H - wall)/t, three coefficients again, keeps off zero by more than its error. Of a summed modal
amplitude this is y''''/24 t (h - t)^2, at most 64/27 E/h. A modal amplitude U that is not summed is
part of the known zero alone: it adds U(t) - U(0) (1 - x)^2 (1 + 2 x) to the distance, x = t/h, at
most (9/8 |U| + h |s U|) x (`compute_start_error`; docs/method.md).

[1] Birkhoff, Priver: Hermite interpolation errors for derivatives, J. Math. Phys. 46 (1967).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import INTEGER, NUMBER, jit, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number
from impact_env.kernels.events.careful import careful_search, has_no_event
from impact_env.kernels.events.signals import (
    BEND,
    COS,
    FORCED,
    HIT_HIGH,
    HIT_LOW,
    NOTHING,
    RATE,
    REVERSAL,
    ROW,
    SIN,
    VALUE,
    GuardEvent,
    compute_time_resolution,
    find_event_wall,
    make_failed_search,
    refine_root,
    replace_evaluations,
    select_terms,
)
from impact_env.kernels.motion.forced import (
    DERIVATIVES,
    SCAN_TERMS,
    coefficient_index,
    evaluate_first_signals,
    fill_carrier,
)
from impact_env.kernels.motion.modal_system import (
    LARGEST_RATE,
    POINTS,
    SPEED_CUBE,
    cos_sin,
    fma,
    propagate_to,
)


class BlockStart(NamedTuple):
    """The start of a block of POINTS steps."""

    offset: float  # from the signal's reference time (s)
    cos: float  # real part of the force's carrier there
    sin: float  # its imaginary part
    turns: int  # blocks since `start_block` computed the amplitudes


class SearchStep(NamedTuple):
    """The step of a search level."""

    level: int  # its number
    h: float  # length (s)
    summed: int  # number of modal amplitudes to sum
    e0: float  # error E of the signal
    e1: float  # error E of its rate


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

# of h^4 times the largest fourth derivative: error of the cubic between two points [1]
HERMITE_SHARE = 1.0 / 384.0
SCAN_NOISE = 1e-12  # of an amplitude: rounding of the sums and of the moving amplitudes
# of E: 3.08/3, since a difference of two coefficients is a third of the slope times h
SLOPE_ERROR = 1.03
STEP_HALF_WIDTH = 0.5 + 1e-9  # of a step, from its middle
# blocks after which the moving amplitudes are recomputed, long before their rounding comes near
# SCAN_NOISE
MOST_BLOCKS = 2_000


@vector_code(INTEGER)
def lowest_bit(code: Code, mask: Index):
    """Return the number of the lowest bit that is set; 64 if none is set."""
    return code.lowest_bit(mask)


def _sum_amplitudes(
    code: Code, orders: int, waves: Any, first: Any, w: Any, size: Any, count: Any
) -> tuple[list[Number], list[Number]]:
    """Return sum_j Re(w[q, j] wave[j, k]) as a vector over k, and sum_j Re(w[q, j]), for orders q.

    The products of real and of imaginary parts have sums of their own, so that none waits for the
    other.
    """
    reals, imags, firsts = (
        [code.sum(lanes) for _ in range(orders)] for lanes in (POINTS, POINTS, 0)
    )
    for j in code.loop(count):
        at = first + j * (2 * POINTS)
        wave = code.complex(waves, at, at + POINTS, POINTS)
        for q in range(orders):
            index = size * (2 * q) + j
            w_r = code.number(w, index)
            w_i = code.number(w, index + size)
            reals[q].add_product(code.spread(w_r, POINTS), wave.real)
            imags[q].add_product(code.spread(w_i, POINTS), wave.imag)
            firsts[q] += w_r
    return [real.number() - imag.number() for real, imag in zip(reals, imags, strict=True)], [
        s.number() for s in firsts
    ]


def _evaluate_polynomials(code: Code, signals: Any, m: int, part: int, y: Number) -> Number:
    """Return part 0 or 1 of signal m's forced polynomial at POINTS times ``y`` (s)."""
    total = code.spread(code.number(signals, coefficient_index(m, SCAN_TERMS - 1, part)), POINTS)
    for n in range(SCAN_TERMS - 2, -1, -1):
        total = total.fma(
            y, code.spread(code.number(signals, coefficient_index(m, n, part)), POINTS)
        )
    return total


def _find_bernstein_range(
    left: Number, right: Number, left_slope: Number, right_slope: Number, third: Number
) -> tuple[Number, Number]:
    """Return the smallest and the largest of the Bernstein coefficients of cubics.

    The cubics match values and slopes at both ends of a step h; ``third`` is h/3.
    """
    a = third.fma(left_slope, left)
    b = (-third).fma(right_slope, right)
    return left.least(right).least(a.least(b)), left.largest(right).largest(a.largest(b))


def _fill_block(
    code: Code, orders: int, function: Any, place: Any, step: Any, size: Any
) -> tuple[list[Number], list[Number]]:
    """Fill a block, and return (values at the start, values at the end) of each step.

    Both are lists of ``orders`` vectors, of the signal and its first derivatives. ``place``: the
    `BlockStart`; ``step``: the `SearchStep`; ``size``: J.
    """
    b = function.signal.block
    w = function.signal.moving
    p = function.signal.polynomial
    signals = function.forced.signals
    h = code.spread(step.h, POINTS)
    x = function.tau + place.offset
    first = step.level * size * (2 * POINTS)
    sums, firsts = _sum_amplitudes(code, orders, function.system.waves, first, w, size, step.summed)
    steps = code.constant(range(1, POINTS + 1))
    y, z = (steps.fma(h, code.spread(start, POINTS)) for start in (x, place.offset))
    at = step.level * (2 * POINTS)
    turn = code.complex(function.forced.carrier, at, at + POINTS, POINTS)
    c = code.spread(place.cos, POINTS)
    s = code.spread(place.sin, POINTS)
    cos = c.fma(turn.real, -(s * turn.imag))
    sin = s.fma(turn.real, c * turn.imag)
    code.store(cos, b, COS)
    code.store(sin, b, SIN)
    p0, p1, p2 = (code.spread(code.number(p, n), POINTS) for n in range(3))
    half = p2 * code.constant([0.5] * POINTS)
    polynomials = (z.fma(z.fma(half, p1), p0), z.fma(p2, p1), p2)
    lefts = []
    rights = []
    for q in range(orders):
        real, imaginary = (_evaluate_polynomials(code, signals, q, part, y) for part in (0, 1))
        forced = real.fma(cos, (-imaginary).fma(sin, polynomials[q]))
        code.store(forced, b, FORCED + ROW * q + 1)
        rights.append(sums[q] + forced)
        start = firsts[q] + code.number(b, FORCED + ROW * q)
        lefts.append(code.before(start, rights[q]))
        code.put(start, b, ROW * q)
        code.store(rights[q], b, ROW * q + 1)
    return lefts, rights


@vector_code(INTEGER, 2)
def scan(code: Code, function, guards, place, step, size: Index):
    """Fill a block and return (walls, reversals); bit k is set if step k is not clear of them.

    ``function``: a `signals.EventFunction`, whose block has the forced parts at its start set, and
    the carrier of the step's level; ``guards``: its `signals.Guards`; ``place``: the `BlockStart`;
    ``step``: the `SearchStep`; ``size``: modal amplitudes that the signal has.
    """
    walls = guards.low is not None
    reversal = guards.direction is not None
    lefts, rights = _fill_block(code, 3 if reversal else 2, function, place, step, size)
    third = code.spread(step.h, POINTS) * code.constant([1.0 / 3.0] * POINTS)
    masks = [code.index(0), code.index(0)]
    if walls:
        low, high, error = (
            code.spread(number, POINTS) for number in (guards.low, guards.high, step.e0)
        )
        least, largest = _find_bernstein_range(lefts[0], rights[0], lefts[1], rights[1], third)
        masks[0] = ((high - largest).least(least - low) - error).not_positive()
    if reversal:
        sign = code.spread(guards.direction, POINTS)
        least, _ = _find_bernstein_range(
            sign * lefts[1], sign * rights[1], sign * lefts[2], sign * rights[2], third
        )
        masks[1] = (least - code.spread(step.e1, POINTS)).not_positive()
    return masks


def _propagation_code(orders: int) -> Any:
    """Return vector code that propagates the amplitudes of ``orders`` derivatives in place."""

    @vector_code()
    def propagate(code: Code, turns, start: Index, w, size: Index):
        for j in code.vectors(size):
            at = start + j
            factor = code.complex(turns, at, at + size)
            for q in range(orders):
                index = size * (2 * q) + j
                other = index + size
                code.store_complex(code.complex(w, index, other).times(factor), w, index, other)

    propagate.__doc__ = (
        "Multiply w[q, j] by turn[j] for all orders q; ``turns``: flat, from ``start`` on "
        "``size`` real, then ``size`` imaginary parts."
    )
    return propagate


@vector_code()
def start_orders(code: Code, rows, u, w, size: Index):
    """Write w[0] = u, w[1] = s u and w[2] = s^2 u.

    ``rows`` is flat. Its first four rows of ``size`` numbers contain s and s^2, real and imaginary.
    """
    for j in code.vectors(size):
        amplitude = code.complex(u, j, j + size)
        code.store_complex(amplitude, w, j, j + size)
        for q in (1, 2):
            index = size * (2 * q - 2) + j
            speed = code.complex(rows, index, index + size)
            index = size * (2 * q) + j
            code.store_complex(amplitude.times(speed), w, index, index + size)


@vector_code(NUMBER, 2)
def sum_weighted_magnitudes(code: Code, weights, start: Index, w, size: Index):
    """Return sum_j weight[j] (|Re w[q, j]| + |Im w[q, j]|) for q = 0 and 1.

    ``weights`` is flat, and the weights begin at ``start``.
    """
    sums = [code.sum() for _ in range(2)]
    for j in code.vectors(size):
        weight = code.vector(weights, start + j)
        for q in range(2):
            index = size * (2 * q) + j
            both = code.complex(w, index, index + size)
            sums[q].add_product(weight, both.real.size() + both.imag.size())
    return [s.total() for s in sums]


propagate_two_orders = _propagation_code(2)
propagate_three_orders = _propagation_code(3)


@jit_inline
def compute_start_error(w, size, summed, order, h, error):
    """Return the error of the quadratic (H - known zero)/t of a first step, times h.

    It is the error for the derivative ``order``, which has the error ``error``. Each modal
    amplitude that is not summed, with the amplitudes w of this derivative and the next, has a share
    of its own instead of its share in ``error``.
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
def compute_start_margin(d1, slope0, slope1, h):
    """Return the least coefficient of a first step that starts on a guard.

    It follows from the distance at the step's end and from the growth of the distance at both ends.
    """
    return min(min(h * slope0, 1.5 * (d1 - h / 3.0 * slope1)), d1)


@jit_inline
def is_clear_of_walls(b, guards, step, error):
    """Return whether a block's first step, which starts on a wall, is clear of both walls.

    ``error`` is that of `compute_start_error`.
    """
    h = step.h
    y0 = b[VALUE]
    y1 = b[VALUE + 1]
    y2 = y0 + h / 3.0 * b[RATE]
    y3 = y1 - h / 3.0 * b[RATE + 1]
    if guards.side > 0:
        clear = compute_start_margin(guards.high - y1, -b[RATE], -b[RATE + 1], h) > error
        return clear and min(min(y0, y1), min(y2, y3)) - guards.low > step.e0
    clear = compute_start_margin(y1 - guards.low, b[RATE], b[RATE + 1], h) > error
    return clear and guards.high - max(max(y0, y1), max(y2, y3)) > step.e0


@jit_inline
def correct_first_step(signal, guards, step, walls, reversals):
    """Return a scan's (walls, reversals) with bit 0, of the first step, corrected.

    It is corrected for the guard on which the signal starts.
    """
    b = signal.block
    w = signal.moving
    size = signal.u.shape[1]
    if guards.side != 0:
        error = compute_start_error(w, size, step.summed, 0, step.h, step.e0)
        walls = (walls & -2) | (0 if is_clear_of_walls(b, guards, step, error) else 1)
    if guards.direction is not None:
        if guards.zero_rate:
            error = compute_start_error(w, size, step.summed, 1, step.h, step.e1)
            direction = guards.direction
            margin = compute_start_margin(
                direction * b[RATE + 1], direction * b[BEND], direction * b[BEND + 1], step.h
            )
            reversals = (reversals & -2) | (0 if margin > error else 1)
    return walls, reversals


@jit_inline
def find_sharp_root(d0, d1, d2, d3, error, slope_error):
    """Return the zero in (0, 1) of the secant of the cubic with Bernstein coefficients d0 to d3.

    ``error`` bounds the error of the cubic; ``slope_error`` times it that of a difference of two
    coefficients. The result is -1 if the root is not certainly simple and the only one.
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
def apply_halley_step(x, f, slope, bend):
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
        x = apply_halley_step(x, f, slope, fma(x, 6.0 * c3, 2.0 * c2))
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
            x = apply_halley_step(x, v, a, fma(x, fma(x, 60.0 * c5, 24.0 * c4), 6.0 * c3))
        else:
            y = fma(x, fma(x, fma(x, fma(x, fma(x, c5, c4), c3), 0.5 * a0), v0), y0)
            x = apply_halley_step(x, y, v, a)
    return x


@jit_inline
def locate_reversal(b, k, step, direction, slope_error):
    """Return the share of step k where the rate changes its sign, -1 as in `find_sharp_root`."""
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

    ``b`` is `Signal.block`. The kind is NOTHING if it is not certain that there is exactly one
    event. ``near_wall`` and ``near_rest``: whether the step is not clear of walls, and of a
    reversal.
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
    """Return whether a step of LEVEL_RATIO h after the block will probably be clear.

    ``e0`` and ``e1`` are the errors of this step. A wrong answer only costs time.
    """
    y = b[VALUE + POINTS]
    way = LEVEL_RATIO * h * b[RATE + POINTS]
    far = min(guards.high - max(y, y + way), min(y, y + way) - guards.low) > e0
    if guards.direction is not None:
        v = guards.direction * b[RATE + POINTS]
        way = LEVEL_RATIO * h * guards.direction * b[BEND + POINTS]
        far = far and min(v, v + way) > e1
    return far


@jit_inline
def start_block(function, offset):
    """Compute amplitudes and forced parts at ``offset`` (s); return the `BlockStart` there.

    They are written to the signal's ``moving`` and ``block``.
    """
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
    """Propagate amplitudes and forced parts by the first k > 0 steps of a block, in place.

    Returns the `BlockStart` of the next block.
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
    """Return the `SearchStep` of a level; its errors hold from the current block on."""
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
def scan_block(function, guards, place, step):
    """Fill a block and return (walls, reversals), as `scan` does.

    A first step may start on a guard.
    """
    fill_carrier(function.system.steps, function.omega, step.level, function.forced.carrier)
    walls, reversals = scan(function, guards, place, step, function.signal.u.shape[1])
    if place.offset == 0.0:
        walls, reversals = correct_first_step(function.signal, guards, step, walls, reversals)
    return walls, reversals


@jit_inline
def locate_event(function, guards, place, step, k, near, length):
    """Return the only event in step k as a `GuardEvent`.

    Its kind is NOTHING where this is not certain; its evaluations count anyway. ``near`` (two
    flags): whether the step is not clear of walls, and of a reversal. ``length`` (s): of the
    search.
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
    resolution = compute_time_resolution(system.rows, function.omega, length)
    event = refine_root(
        select_terms(function), place.offset + (k + x) * step.h, kind, wall, b4, resolution
    )
    if abs(event.offset - (place.offset + (k + 0.5) * step.h)) <= STEP_HALF_WIDTH * step.h:
        return event  # Newton's method has stayed in the step, which has only this root
    return GuardEvent(NOTHING, 0.0, 0.0, 0.0, 0.0, event.evaluations)


@jit
def search_events(function, guards, length, half):
    """Return the first GuardEvent of an `EventFunction` within ``length`` (s).

    If none occurs, the result has the kind NOTHING and the offset ``length``; if the search fails,
    the offset NaN. ``half`` (s) is half the length of the window. The signal's ``moving`` and
    ``block`` are scratch; ``memory[0]`` becomes the level for the next search.
    """
    memory = function.signal.memory
    steps = function.system.steps
    top = steps.shape[0] - 1  # the coarsest level that the window allows: bounds hold beyond it
    while top > 0 and steps[top, 0] > 0.25 * half:  # by a quarter of its half length
        top -= 1
    level = min(int(memory[0]), top)
    up = False
    careful = 1.0
    count = 0
    place = BlockStart(0.0, 0.0, 0.0, MOST_BLOCKS)  # MOST_BLOCKS: amplitudes are not computed yet
    step = SearchStep(-1, 0.0, 0, 0.0, 0.0)
    while place.offset < length and count < memory[1]:
        count += 1

        # amplitudes at the block's start, and its step
        if place.turns >= MOST_BLOCKS:
            place = start_block(function, place.offset)
        if up:
            wide = make_search_step(function, step.level + 1)
            if is_far(function.signal.block, step.h, guards, wide.e0, wide.e1):
                step = wide
            level = step.level
        if step.level != level:  # amplitudes never grow: an error of a level stays a bound
            step = make_search_step(function, level)

        # the first step of the block that is not clear, k
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
                return replace_evaluations(event, count)

        # on to step k; there a finer level, and at the finest the careful search
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
                    return replace_evaluations(event, count)
                place = BlockStart(event.offset, 0.0, 0.0, MOST_BLOCKS)
                careful = 2.0 * careful
    return (
        make_failed_search(count)
        if count >= memory[1]
        else GuardEvent(NOTHING, length, 0.0, 0.0, 0.0, count)
    )


@jit_inline
def find_next_event(window, function, guards, length):
    """Return the first GuardEvent in a `loads.ForceWindow` within ``length`` (s).

    The result is that of `search_events`, for the signal of an `EventFunction`.
    """
    if has_no_event(window.load, function, guards, length):
        return GuardEvent(NOTHING, length, 0.0, 0.0, 0.0, 1)
    return search_events(function, guards, length, window.half)
