"""The innermost loops of the event search, as vector code.

They compute sums over modal amplitudes at POINTS times at once, and the bounds that follow from
them.

LLVM cannot know that a lane's amplitudes and a regime's tables do not overlap, and it unrolls short
loops before it could make vectors of them. So these loops are written down (vector_code.py); a
vector of 8 numbers becomes what the processor has: one, two or four registers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from impact_env.kernels.compiling.jit import INTEGER, NUMBER, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number

POINTS = 8  # times in a block
TERMS = 9  # coefficients of the forced part's polynomials (forced.py)
SCAN_TERMS = 7  # those that a block keeps

# entries of a block: 1 + POINTS numbers of the value, the rate and the bend, then of their forced
# parts, in rows; then the carrier of the force
ROW = 16
VALUE = 0
RATE = ROW
BEND = 2 * ROW
FORCED = 3 * ROW
COS = 6 * ROW
SIN = 6 * ROW + POINTS
BLOCK = 7 * ROW


class BlockStart(NamedTuple):
    """The begin of a block.

    ``offset`` (s) is measured from the signal's reference time, ``cos`` and ``sin`` are the force's
    carrier at this time, and ``turns`` counts the blocks since the amplitudes were computed.
    """

    offset: float
    cos: float
    sin: float
    turns: int


class SearchStep(NamedTuple):
    """Step of a search level.

    ``h`` (s) is its length, ``summed`` the number of amplitudes to sum, and ``e0`` and ``e1`` are
    the errors E of signal and rate.
    """

    level: int
    h: float
    summed: int
    e0: float
    e1: float


def coefficient_index(m: Any, n: int, part: int) -> Any:
    """Return the index of coefficient n of signal m in the flat array `forced.Forced.signals`.

    ``part`` selects its real (0) or imaginary (1) part.
    """
    return (m >> 2) * (8 * TERMS) + (m & 3) + (8 * n + 4 * part)


def _sum_slots(
    code: Code, orders: int, waves: Any, first: Any, w: Any, size: Any, count: Any
) -> tuple[list[Number], list[Number]]:
    """Return two sums of real parts for each order q.

    They are sum_j Re(w[q, j] wave[j, k]) as a vector over k, and sum_j Re(w[q, j]).

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


def _horner(code: Code, signals: Any, m: int, part: int, y: Number) -> Number:
    total = code.spread(code.number(signals, coefficient_index(m, SCAN_TERMS - 1, part)), POINTS)
    for n in range(SCAN_TERMS - 2, -1, -1):
        total = total.fma(
            y, code.spread(code.number(signals, coefficient_index(m, n, part)), POINTS)
        )
    return total


def _margins(
    left: Number, right: Number, left_slope: Number, right_slope: Number, third: Number
) -> tuple[Number, Number]:
    """Return the smallest and the largest of the Bernstein coefficients of cubics.

    The cubics match values and slopes at both ends.
    """
    a = third.fma(left_slope, left)
    b = (-third).fma(right_slope, right)
    return left.least(right).least(a.least(b)), left.largest(right).largest(a.largest(b))


def _fill_block(
    code: Code, orders: int, function: Any, place: Any, step: Any, size: Any
) -> tuple[list[Number], list[Number]]:
    """Write all of a block, and return derivatives at the start and end of each step.

    The first ``orders`` derivatives are returned, beginning with the signal itself.
    """
    b = function.signal.block
    w = function.signal.moving
    p = function.signal.polynomial
    signals = function.forced.signals
    h = code.spread(step.h, POINTS)
    x = function.tau + place.offset
    first = step.level * size * (2 * POINTS)
    sums, firsts = _sum_slots(code, orders, function.system.waves, first, w, size, step.summed)
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
        real, imaginary = (_horner(code, signals, q, part, y) for part in (0, 1))
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
    """Fill a block and return (walls, reversals).

    Bit k of walls or reversals is set if step k is not clear of walls or of a reversal.

    ``function``: a `signals.EventFunction`, whose block has the forced parts at its start set, and
    the carrier of the step's level; ``guards``: its `signals.Guards`; ``place``: where the block
    begins; ``size``: modal amplitudes that the signal has.
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
        least, largest = _margins(lefts[0], rights[0], lefts[1], rights[1], third)
        masks[0] = ((high - largest).least(least - low) - error).not_positive()
    if reversal:
        sign = code.spread(guards.direction, POINTS)
        least, _ = _margins(
            sign * lefts[1], sign * rights[1], sign * lefts[2], sign * rights[2], third
        )
        masks[1] = (least - code.spread(step.e1, POINTS)).not_positive()
    return masks


def _propagation_code(orders: int) -> Any:
    @vector_code()
    def turn(code: Code, turns, start: Index, w, size: Index):
        for j in code.vectors(size):
            at = start + j
            factor = code.complex(turns, at, at + size)
            for q in range(orders):
                index = size * (2 * q) + j
                other = index + size
                code.store_complex(code.complex(w, index, other).times(factor), w, index, other)

    turn.__doc__ = (
        "Multiply w[q, j] by turn[j] for all orders q; ``turns``: flat, from ``start`` on "
        "``size`` real, then ``size`` imaginary parts."
    )
    return turn


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
