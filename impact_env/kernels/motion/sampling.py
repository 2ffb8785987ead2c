"""The tip displacement at equidistant samples: slots and force turn by fixed factors from one to the next, instead of being looked up each time."""

from __future__ import annotations

from typing import Any, NamedTuple

from impact_env.kernels.compiling.jit import jit, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.forced import TIP_SIGNAL, signal_value
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.slot_sums import SlotsAt
from impact_env.kernels.motion.slots import digits, value
from impact_env.kernels.motion.vector import TERMS, signal_place

FEW = 3  # samples up to which each is evaluated for itself
TOGETHER = 8  # samples that are computed at once


def _powers(factor: Complex, one: Complex) -> list[Complex]:
    """Return factor^0 ... factor^TOGETHER, each from two of half its power, so that rounding does not pile up."""
    powers = [one, factor]
    for k in range(2, TOGETHER + 1):
        powers.append(powers[k // 2].times(powers[k - k // 2]))
    return powers


def _add_to_block(
    code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool
) -> None:
    """Add numbers to the block from a place on, or write them if it is ``fresh``: as many as are ``left``."""
    for k, number in enumerate(numbers):
        for _ in code.where(left > k, likely=True):
            at = place + k
            code.put(number if fresh else number + code.number(block, at), block, at)


def _whole_or_part(
    code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool
) -> None:
    """Do what `_add_to_block` does, with one instruction where all are left."""
    for whole in code.either(left >= TOGETHER):
        if whole:
            vector = code.gathered(numbers)
            code.store(
                vector if fresh else vector + code.vector(block, place, TOGETHER), block, place
            )
        else:
            _add_to_block(code, numbers, block, place, left, fresh)


@vector_code()
def _fill_forced(
    code: Code,
    signals,
    tau: Number,
    interval: Number,
    c: Number,
    s: Number,
    turn_c: Number,
    turn_s: Number,
    rest: Number,
    block,
    first: Index,
    count: Index,
):
    """Write ``rest`` and the forced tip displacement at ``count`` samples from ``tau`` on; c + i s is the force's phasor there, turning by turn."""
    one = Complex(code.repeated(1.0, 0), code.repeated(0.0, 0))
    *powers, leap = _powers(Complex(turn_c, turn_s), one)
    turn = Complex(code.gathered([p.real for p in powers]), code.gathered([p.imag for p in powers]))
    phasor = [code.variable(part) for part in (c, s)]
    steps = code.constant(range(TOGETHER))
    for k in code.loop(count, TOGETHER):
        now = Complex(*(part.value for part in phasor))
        here = Complex(code.spread(now.real, TOGETHER), code.spread(now.imag, TOGETHER)).times(turn)
        number = code.spread(code.as_number(k), TOGETHER) + steps
        x = number.fma(code.spread(interval, TOGETHER), code.spread(tau, TOGETHER))
        parts = []
        for part in (0, 1):
            total = code.spread(
                code.number(signals, signal_place(TIP_SIGNAL, TERMS - 1, part)), TOGETHER
            )
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(
                    x,
                    code.spread(code.number(signals, signal_place(TIP_SIGNAL, n, part)), TOGETHER),
                )
            parts.append(total)
        values = Complex(*parts).real_of_product(here) + code.spread(rest, TOGETHER)
        _whole_or_part(code, values.elements(), block, first + k, count - k, True)
        for place, moved in zip(phasor, now.times(leap), strict=True):
            place.value = moved


@vector_code()
def _add_slots(
    code: Code,
    rows,
    table,
    size: Index,
    base: Index,
    d1: Index,
    d2: Index,
    d3: Index,
    x: Number,
    h1: Index,
    h2: Index,
    h3: Index,
    h: Number,
    u,
    block,
    first: Index,
    count: Index,
):
    """Add the slots' sum at ``count`` samples, the first at the offset d1, d2, d3, x, and h1, h2, h3, h between two."""
    start, step = (
        SlotsAt(code, rows, table, size, base, place)
        for place in ([d1, d2, d3, x], [h1, h2, h3, h])
    )
    for j in code.slots(size):
        amplitude = start.turned(u, j)
        *powers, leap = _powers(step.factor(j), Complex(code.repeated(1.0), code.repeated(0.0)))
        turning = [code.variable(part) for part in amplitude]
        for k in code.loop(count, TOGETHER):
            now = Complex(*(part.value for part in turning))
            sums = [now.real_of_product(power).total() for power in powers]
            _whole_or_part(code, sums, block, first + k, count - k, False)
            for place, moved in zip(turning, now.times(leap), strict=True):
                place.value = moved


class Samples(NamedTuple):
    """``number`` equidistant samples, and the place ``first`` in a block that takes them.

    The first one lies ``offset`` (s) from the start of a stretch and ``x`` (s) from its window's centre, the next ones an ``interval`` (s) apart.
    """

    offset: float
    x: float
    interval: float
    first: int
    number: int


@jit
def fill_samples(slots, signals, omega, u, rest, samples, block):
    """Write the tip displacement at `Samples` into the block; ``u``: the slots' shares at the stretch's start, ``rest`` (m) what stays the same.

    From sample to sample slots and force turn by fixed factors; what rounding adds to that stays below 1e-16 times their number.
    """
    rows = slots.rows
    table = slots.table
    scale = slots.scale
    offset = samples.offset
    x = samples.x
    interval = samples.interval
    first = samples.first
    count = samples.number
    if count <= FEW:
        for k in range(count):
            t = k * interval
            block[first + k] = (
                value(rows, table, scale, u, offset + t)
                + signal_value(signals, TIP_SIGNAL, omega, x + t)
                + rest
            )
        return
    c, s = cos_sin(omega * x)
    turn_c, turn_s = cos_sin(omega * interval)
    _fill_forced(signals, x, interval, c, s, turn_c, turn_s, rest, block, first, count)
    d1, d2, d3, d = digits(scale, offset)
    h1, h2, h3, h = digits(scale, interval)
    _add_slots(
        rows,
        table,
        rows.shape[1],
        table.shape[2],
        d1,
        d2,
        d3,
        d,
        h1,
        h2,
        h3,
        h,
        u,
        block,
        first,
        count,
    )
