"""Loads that are straight lines in a window, as samples with lines between them are: their response is a sum of four that are known.

A window of a record is as short as its step, and nothing turns in it. So the forced part of a regime is linear in two numbers, value and slope of the
force, and two more of a base that moves: it is solved once for each of these alone (`Units`), and a window takes its shares of them. Bounds add up.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Complex, Index, Number
from impact_env.kernels.motion.forced import Window, fill_terms, solve_forced, solve_response
from impact_env.kernels.motion.loads import EVEN
from impact_env.kernels.motion.slots import BASE, DRIVE, S, advance, copy
from impact_env.kernels.motion.vector import TERMS

SLACK = 1.001  # times the half window are `Units` made for: steps of a record differ by rounding
SAME_SPAN = 1e-9  # of a window: its square is below rounding
SHORTEST = 0.5  # of the half window that they were made for: below that it is judged anew which slots are driven at their own frequency


def _units(base: object) -> int:
    return 2 if base is None else 4


@vector_code()
def _combine(code: Code, size: Index, again: Index, base, shares, units, out):
    """Write the sum of shares[n] units[n], ``size`` numbers of each, to ``out``, and once more from ``again`` on."""
    for j in code.slots(size):
        total = code.spread(code.number(shares, 0)) * code.vector(units, j)
        for n in range(1, _units(base)):
            total = code.spread(code.number(shares, n)).fma(code.vector(units, size * n + j), total)
        code.store(total, out, j)
        code.store(total, out, again + j)


@vector_code()
def _keep(code: Code, size: Index, of_one, units, n: Index):
    """Write the ``size`` numbers ``of_one`` unit load to those of load ``n``."""
    for j in code.slots(size):
        code.store(code.vector(of_one, j), units, size * n + j)


@jit_inline
def _take_shares(terms, base, shares):
    """Write what the terms of a `Load` have of the unit loads."""
    shares[0], shares[1] = terms[0, 0], terms[0, 1]
    if base is not None:
        shares[2], shares[3] = base.terms[0, 0], base.terms[0, 1]


@jit_inline
def _set_terms(base, terms, n, value):
    """Set the term of unit load ``n``."""
    if n < 2:
        terms[0, n] = value
    elif base is not None:
        base.terms[0, n - 2] = value


def _plus(factor: Number, term: Complex, total: Complex) -> Complex:
    return Complex(factor.fma(term.real, total.real), factor.fma(term.imag, total.imag))


@vector_code()
def _leap(code: Code, base, rows, size: Index, leap, shares, half: Number, late: Number, z):
    """Move whole slots on by the span of a leap, and by ``late`` (s) more: so little that their rate times it will do.

    ``half`` (s): from the window's centre to its end, where the rate is that under the load there.
    """
    numbers = [code.number(shares, n) for n in range(_units(base))]
    ends = [
        (value + slope * half) * code.repeated(2.0, 0)
        for value, slope in zip(numbers[::2], numbers[1::2], strict=True)
    ]
    for j in code.slots(size):
        total = code.complex(z, j, j + size).times(code.complex(leap, j, j + size))
        for n, share in enumerate(numbers, 1):
            total = _plus(
                code.spread(share),
                code.complex(leap, size * (2 * n) + j, size * (2 * n + 1) + j),
                total,
            )
        rate = total.times(code.complex(rows, size * S + j, size * (S + 1) + j))
        for row, end in zip((DRIVE, BASE), ends, strict=False):
            rate = _plus(
                code.spread(end), code.complex(rows, size * row + j, size * (row + 1) + j), rate
            )
        code.store_complex(_plus(code.spread(late), rate, total), z, j, j + size)


@jit
def _learn_leap(slots, units, n, half, w):
    """Fill what unit load ``n`` adds to slots in a window, from their forced part at its ends; w (2, J) is scratch."""
    leap = units.leap
    size = w.shape[1]
    for side in range(2):
        w[:] = 0.0
        tau = half if side == 1 else -half
        for j in range(size):
            for part in range(2):
                x = 0.0
                for m in range(TERMS):
                    x = x * tau + units.slots[n, part, TERMS - 1 - m, j]
                w[part, j] = 2.0 * x
        if side == 0:
            advance(slots.rows, slots.table, slots.scale, 2.0 * half, w)
        for j in range(size):
            for part in range(2):
                leap[n + 1, part, j] = w[part, j] - (leap[n + 1, part, j] if side == 1 else 0.0)


@jit
def _learn_leaps(load, slots, window, forced, w):
    """Fill a regime's leap for a window's length."""
    units = forced.units
    if not SHORTEST * units.half[0] <= window.half <= units.half[0]:
        _solve_units(load, slots, window, None, False, forced)
    w[0, :], w[1, :] = 1.0, 0.0
    advance(slots.rows, slots.table, slots.scale, 2.0 * window.half, w)
    copy(w, units.leap[0])
    for n in range(units.shares.shape[0]):
        _learn_leap(slots, units, n, window.half, w)
    units.span[0] = 2.0 * window.half


@jit_inline
def leap_over(load, slots, window, forced, w, z):
    """Move whole slots over a window of straight lines; return False, and do nothing, where its length is not quite that of the others.

    w (2, J) is scratch.
    """
    units = forced.units
    length = 2.0 * window.half
    _take_shares(load.terms, load.base, units.shares)
    if abs(length - units.span[0]) > EVEN * length:
        _learn_leaps(load, slots, window, forced, w)
    if abs(length - units.span[0]) > SAME_SPAN * length:
        return False
    _leap(
        load.base,
        slots.rows,
        slots.rows.shape[1],
        units.leap,
        units.shares,
        window.half,
        length - units.span[0],
        z,
    )
    return True


@jit
def _solve_units(load, slots, window, absorber_mass, guarded, forced):
    """Fill the `Units` of a regime for windows of this length; the shares are known. ``guarded``: whether a guard signal is needed."""
    units = forced.units
    half = SLACK * window.half
    wide = Window(
        window.centre, half, window.omega, window.alpha, window.force_r, window.force_i, load
    )
    for n in range(units.shares.shape[0]):
        _set_terms(load.base, load.terms, n, 0.0)
    for n in range(units.shares.shape[0]):
        _set_terms(load.base, load.terms, n, 1.0)
        if guarded:
            solve_forced(slots, wide, absorber_mass, forced)
        else:
            solve_response(slots, wide, forced)
        _set_terms(load.base, load.terms, n, 0.0)
        _keep(units.slots[n].size, forced.slots, units.slots, n)
        _keep(forced.signals.size, forced.signals, units.signals, n)
        for m in range(forced.bound.shape[0]):
            units.bound[n, m] = forced.bound[m]
    for n in range(units.shares.shape[0]):
        _set_terms(load.base, load.terms, n, units.shares[n])
    units.half[0] = half


@jit_inline
def solve_lines(load, slots, window, absorber_mass, guarded, forced):
    """Fill a regime's forced part from `Units`, and return True where the window has nothing but straight lines.

    Arguments as in `solve_forced`; not ``guarded``: as in `solve_response`.
    """
    if load is None:
        return False
    units = forced.units
    if not load.straight[0]:
        return False
    shares = units.shares
    bound = forced.bound
    _take_shares(load.terms, load.base, shares)
    if not SHORTEST * units.half[0] <= window.half <= units.half[0]:
        _solve_units(load, slots, window, absorber_mass, guarded, forced)
    fill_terms(window, forced.terms)
    half = units.slots[0].size
    _combine(
        half, half, load.base, shares, units.slots, forced.slots
    )  # B is A, since nothing turns
    _combine(forced.signals.size, 0, load.base, shares, units.signals, forced.signals)
    bound[:] = 0.0
    for n in range(shares.shape[0]):
        for m in range(bound.shape[0]):
            bound[m] += abs(shares[n]) * units.bound[n, m]
    for level in range(forced.carrier.shape[0]):
        forced.carrier[level, 0, 0] = np.nan
    return True


@jit_inline
def solve_window(slots, window, absorber_mass, forced):
    """Fill a regime's forced part for a window as `solve_forced` does."""
    if not solve_lines(window.load, slots, window, absorber_mass, True, forced):
        solve_forced(slots, window, absorber_mass, forced)
