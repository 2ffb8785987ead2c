"""The tip displacement at equidistant samples.

Modal amplitudes and force are multiplied by fixed factors from one sample to the next.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from impact_env.kernels.compiling.jit import jit, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.forced import TIP_SIGNAL, evaluate_signal
from impact_env.kernels.motion.modal_sums import Propagator
from impact_env.kernels.motion.modal_system import split_time, sum_amplitudes
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.search_block import TERMS, coefficient_index

MOST_SINGLE_SAMPLES = 3  # samples up to which each is evaluated for itself
SAMPLES_AT_ONCE = 8  # samples that are computed at once


def _powers(factor: Complex, one: Complex) -> list[Complex]:
    """Return factor^0 ... factor^SAMPLES_AT_ONCE.

    Each power is the product of two powers of about half its exponent, so that rounding errors do
    not accumulate.
    """
    powers = [one, factor]
    for k in range(2, SAMPLES_AT_ONCE + 1):
        powers.append(powers[k // 2].times(powers[k - k // 2]))
    return powers


def _add_to_block(
    code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool
) -> None:
    """Add numbers to the block from a position on, or write them if the block is ``fresh``.

    ``left`` numbers are used.
    """
    for k, number in enumerate(numbers):
        for _ in code.where(left > k, likely=True):
            at = place + k
            code.put(number if fresh else number + code.number(block, at), block, at)


def _whole_or_part(
    code: Code, numbers: list[Number], block: Any, place: Any, left: Any, fresh: bool
) -> None:
    """Do what `_add_to_block` does, with one instruction where all are left."""
    for whole in code.either(left >= SAMPLES_AT_ONCE):
        if whole:
            vector = code.gather(numbers)
            code.store(
                vector if fresh else vector + code.vector(block, place, SAMPLES_AT_ONCE),
                block,
                place,
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
    """Write ``rest`` plus the forced tip displacement at ``count`` samples from ``tau`` on.

    c + i s is the force's phasor at ``tau``, which is multiplied by the phasor ``turn_c`` + i
    ``turn_s`` from sample to sample.
    """
    one = Complex(code.repeated(1.0, 0), code.repeated(0.0, 0))
    *powers, leap = _powers(Complex(turn_c, turn_s), one)
    turn = Complex(code.gather([p.real for p in powers]), code.gather([p.imag for p in powers]))
    phasor = [code.variable(part) for part in (c, s)]
    steps = code.constant(range(SAMPLES_AT_ONCE))
    for k in code.loop(count, SAMPLES_AT_ONCE):
        current = Complex(*(part.value for part in phasor))
        here = Complex(
            code.spread(current.real, SAMPLES_AT_ONCE), code.spread(current.imag, SAMPLES_AT_ONCE)
        ).times(turn)
        number = code.spread(code.as_number(k), SAMPLES_AT_ONCE) + steps
        x = number.fma(code.spread(interval, SAMPLES_AT_ONCE), code.spread(tau, SAMPLES_AT_ONCE))
        parts = []
        for part in (0, 1):
            total = code.spread(
                code.number(signals, coefficient_index(TIP_SIGNAL, TERMS - 1, part)),
                SAMPLES_AT_ONCE,
            )
            for n in range(TERMS - 2, -1, -1):
                total = total.fma(
                    x,
                    code.spread(
                        code.number(signals, coefficient_index(TIP_SIGNAL, n, part)),
                        SAMPLES_AT_ONCE,
                    ),
                )
            parts.append(total)
        values = Complex(*parts).real_of_product(here) + code.spread(rest, SAMPLES_AT_ONCE)
        _whole_or_part(code, values.elements(), block, first + k, count - k, True)
        for place, moved in zip(phasor, current.times(leap), strict=True):
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
    """Add the sum of the modal amplitudes at ``count`` samples.

    The first sample has the offset d1, d2, d3, x, and the step between two samples is h1, h2, h3,
    h.
    """
    start, step = (
        Propagator(code, rows, table, size, base, place)
        for place in ([d1, d2, d3, x], [h1, h2, h3, h])
    )
    for j in code.vectors(size):
        amplitude = start.turned(u, j)
        *powers, leap = _powers(step.factor(j), Complex(code.repeated(1.0), code.repeated(0.0)))
        turning = [code.variable(part) for part in amplitude]
        for k in code.loop(count, SAMPLES_AT_ONCE):
            current = Complex(*(part.value for part in turning))
            sums = [current.real_of_product(power).total() for power in powers]
            _whole_or_part(code, sums, block, first + k, count - k, False)
            for place, moved in zip(turning, current.times(leap), strict=True):
                place.value = moved


class SampleTimes(NamedTuple):
    """``number`` equidistant samples, and the place ``first`` in a block that takes them.

    The first one lies ``offset`` (s) from the start of a segment and ``x`` (s) from its window's
    centre, the next ones an ``interval`` (s) apart.
    """

    offset: float
    x: float
    interval: float
    first: int
    number: int


@jit
def fill_samples(system, signals, omega, u, rest, samples, block):
    """Write the tip displacement at `SampleTimes` into the block.

    ``u``: the modal amplitudes' shares at the segment's start; ``rest`` (m): the constant part.

    From sample to sample modal amplitudes and force turn by fixed factors; what rounding adds to
    that stays below 1e-16 times their number.
    """
    rows = system.rows
    table = system.table
    scale = system.scale
    offset = samples.offset
    x = samples.x
    interval = samples.interval
    first = samples.first
    count = samples.number
    if count <= MOST_SINGLE_SAMPLES:
        for k in range(count):
            t = k * interval
            block[first + k] = (
                sum_amplitudes(rows, table, scale, u, offset + t)
                + evaluate_signal(signals, TIP_SIGNAL, omega, x + t)
                + rest
            )
        return
    c, s = cos_sin(omega * x)
    turn_c, turn_s = cos_sin(omega * interval)
    _fill_forced(signals, x, interval, c, s, turn_c, turn_s, rest, block, first, count)
    d1, d2, d3, d = split_time(scale, offset)
    h1, h2, h3, h = split_time(scale, interval)
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
