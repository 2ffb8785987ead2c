"""The tip displacement at equidistant samples: slots and force turn by fixed factors from one to the next, instead of being looked up each time."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.core import cgutils, types
from numba.extending import intrinsic

from impact_env.kernels.forced import TIP_SIGNAL, signal_value
from impact_env.kernels.jit import jit
from impact_env.kernels.numbers import cos_sin
from impact_env.kernels.slot_sums import DIGITS, INTEGER, NUMBER, SlotsAt
from impact_env.kernels.slots import digits, value
from impact_env.kernels.vector import TERMS, signal_place
from impact_env.kernels.vector_code import Code, Complex, Number

FEW = 3  # samples up to which each is evaluated for itself
TOGETHER = 8  # samples that are computed at once


def _powers(factor: Complex, one: Complex) -> list[Complex]:
    """Return factor^0 ... factor^TOGETHER, each from two of half its power, so that rounding does not pile up."""
    powers = [one, factor]
    for k in range(2, TOGETHER + 1):
        powers.append(powers[k // 2].times(powers[k - k // 2]))
    return powers


def _add_to_block(code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool) -> None:
    """Add numbers to the block from a place on, or write them if it is ``fresh``: as many as are ``left``."""
    builder = code.builder
    for k, number in enumerate(numbers):
        with builder.if_then(builder.icmp_signed(">", left, code.index(k)), likely=True):
            at = code.plus(place, k)
            code.put(number if fresh else number + code.number(block, at), block, at)


def _whole_or_part(code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool) -> None:
    """Do what `_add_to_block` does, with one instruction where all are left."""
    whole = code.builder.icmp_signed(">=", left, code.index(TOGETHER))
    with code.builder.if_else(whole) as (all_of_them, some):
        with all_of_them:
            vector = code.gathered(numbers)
            code.store(vector if fresh else vector + code.vector(block, place, TOGETHER), block, place)
        with some:
            _add_to_block(code, numbers, block, place, left, fresh)


@intrinsic
def _fill_forced(typing_context, signals, tau, interval, c, s, turn_c, turn_s, rest, block, first, count):  # type: ignore[no-untyped-def]
    """Write ``rest`` and the forced tip displacement at ``count`` samples from ``tau`` on; c + i s is the force's phasor there, turning by turn."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        signals, tau, interval, c, s, turn_c, turn_s, rest, block, first, count = code.arguments
        one = Complex(code.repeated(1.0, 0), code.repeated(0.0, 0))
        *powers, leap = _powers(Complex(Number(builder, turn_c), Number(builder, turn_s)), one)
        turn = Complex(code.gathered([p.real for p in powers]), code.gathered([p.imag for p in powers]))
        phasor = [cgutils.alloca_once_value(builder, part) for part in (c, s)]
        steps = code.constant(range(TOGETHER))
        with code.loop(count, TOGETHER) as k:
            now = Complex(*(Number(builder, builder.load(part)) for part in phasor))
            here = Complex(code.spread(now.real, TOGETHER), code.spread(now.imag, TOGETHER)).times(turn)
            number = code.spread(builder.sitofp(k, tau.type), TOGETHER) + steps
            x = number.fma(code.spread(interval, TOGETHER), code.spread(tau, TOGETHER))
            parts = []
            for part in (0, 1):
                total = code.spread(code.number(signals, signal_place(code, TIP_SIGNAL, TERMS - 1, part)), TOGETHER)
                for n in range(TERMS - 2, -1, -1):
                    total = total.fma(x, code.spread(code.number(signals, signal_place(code, TIP_SIGNAL, n, part)), TOGETHER))
                parts.append(total)
            values = Complex(*parts).real_of_product(here) + code.spread(rest, TOGETHER)
            _whole_or_part(code, values.elements(), block, code.plus(first, k), builder.sub(count, k), True)
            for place, part in zip(phasor, now.times(leap), strict=True):
                builder.store(part.value, place)
        return context.get_dummy_value()

    return types.void(signals, *[NUMBER] * 7, block, INTEGER, INTEGER), build


@intrinsic
def _add_slots(typing_context, rows, table, size, base, d1, d2, d3, x, h1, h2, h3, h, u, block, first, count):  # type: ignore[no-untyped-def]
    """Add the slots' sum at ``count`` samples, the first at the offset d1, d2, d3, x, and h1, h2, h3, h between two."""

    def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
        code = Code(context, builder, signature.args, values)
        rows, table, size, base, d1, d2, d3, x, h1, h2, h3, h, u, block, first, count = code.arguments
        start, step = (SlotsAt(code, rows, table, size, base, place) for place in ([d1, d2, d3, x], [h1, h2, h3, h]))
        for j in code.slots(size):
            amplitude = start.turned(u, j)
            *powers, leap = _powers(step.factor(j), Complex(code.repeated(1.0), code.repeated(0.0)))
            places = [cgutils.alloca_once_value(builder, part.value) for part in amplitude]
            for part, place in zip(amplitude, places, strict=True):
                builder.store(part.value, place)
            with code.loop(count, TOGETHER) as k:
                now = Complex(*(Number(builder, builder.load(place)) for place in places))
                sums = [now.real_of_product(power).total() for power in powers]
                _whole_or_part(code, sums, block, code.plus(first, k), builder.sub(count, k), False)
                for place, part in zip(places, now.times(leap), strict=True):
                    builder.store(part.value, place)
        return context.get_dummy_value()

    return types.void(rows, table, INTEGER, INTEGER, *DIGITS, *DIGITS, u, block, INTEGER, INTEGER), build


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
def fill_samples(slots, signals, omega, u, rest, samples, block):  # type: ignore[no-untyped-def]
    """Write the tip displacement at `Samples` into the block; ``u``: the slots' shares at the stretch's start, ``rest`` (m) what stays the same.

    From sample to sample slots and force turn by fixed factors; what rounding adds to that stays below 1e-16 times their number.
    """
    rows, table, scale = slots.rows, slots.table, slots.scale
    offset, x, interval = samples.offset, samples.x, samples.interval
    first, count = samples.first, samples.number
    if count <= FEW:
        for k in range(count):
            t = k * interval
            block[first + k] = value(rows, table, scale, u, offset + t) + signal_value(signals, TIP_SIGNAL, omega, x + t) + rest
        return
    c, s = cos_sin(omega * x)
    turn_c, turn_s = cos_sin(omega * interval)
    _fill_forced(signals, x, interval, c, s, turn_c, turn_s, rest, block, first, count)
    d1, d2, d3, d = digits(scale, offset)
    h1, h2, h3, h = digits(scale, interval)
    _add_slots(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, d, h1, h2, h3, h, u, block, first, count)
