"""Integrals over a segment, of which the energies are sums.

Of two modal amplitudes, of a modal amplitude and a power of time on the force's carrier, and of
such powers.

Each is a difference of an antiderivative between the segment's ends, or a series where that would
divide by almost zero. Its error is a few roundings of the antiderivative, so it is small beside the
energy of the modal amplitude, though not always beside the integral of a very short segment. No
integral knows the equations of motion.
"""

from __future__ import annotations

import math

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.motion.modal_system import S
from impact_env.kernels.motion.search_block import TERMS

SERIES_DECAY = 0.125  # exponent up to which a decay is a series
# two modal amplitudes are close if their difference turns less than this over the segment, and is
# below this share of them
SERIES_TURN = 0.3
CLOSE_POLES_TOL = 0.05
SERIES_PHASE = 0.5  # rad over half a window: what turns less is integrated by series
_F = tuple(1.0 / math.factorial(n + 1) for n in range(11))
# orders above the wanted ones where that begins: SERIES_PHASE^EXTRA_ORDERS 8!/(8 + EXTRA_ORDERS)!
# is far below rounding of the whole
EXTRA_ORDERS = 10
PRODUCTS = 2 * TERMS - 1  # coefficients of a product of two polynomials
WIDTH = PRODUCTS + EXTRA_ORDERS + 1  # powers of the time that series need
_INVERSE = 1.0 / np.maximum(np.arange(2.0 * EXTRA_ORDERS + 20.0), 1.0)


@jit_inline
def decay_series(y):
    """Return (exp(y) - 1)/y for -SERIES_DECAY <= y <= 0."""
    f = _F[6] + y * (_F[7] + y * (_F[8] + y * (_F[9] + y * _F[10])))
    return 1.0 + y * (_F[1] + y * (_F[2] + y * (_F[3] + y * (_F[4] + y * (_F[5] + y * f)))))


@jit
def decay_integral(rate, h):
    """Return the integral of exp(rate t) over [0, h] for rate <= 0.

    A series gives the integral over a part of h, which is then doubled repeatedly. No table is
    used.
    """
    y = rate * h
    doublings = 0
    while y < -SERIES_DECAY:
        y *= 0.5
        doublings += 1
    f = decay_series(y)
    for _ in range(doublings):
        f *= 1.0 + 0.5 * y * f
        y *= 2.0
    return h * f


@jit
def decay_integrals(rows, h, decay):
    """Write the integral of |exp(s t)|^2 over [0, h] for each modal amplitude to decay (J,)."""
    fastest = 0.0
    part = 2.0 * h
    doublings = 0
    for j in range(decay.shape[0]):
        fastest = min(fastest, rows[S, j])
    while fastest * part < -SERIES_DECAY:
        part *= 0.5
        doublings += 1
    for j in range(decay.shape[0]):
        decay[j] = decay_series(rows[S, j] * part)
    for _ in range(doublings):
        for j in range(decay.shape[0]):
            decay[j] *= 1.0 + 0.5 * part * rows[S, j] * decay[j]
        part *= 2.0
    for j in range(decay.shape[0]):
        decay[j] *= h


@jit_inline
def are_close_poles(l_r, l_i, size):
    """Return whether the sum l of two eigenvalues is small beside ``size``, that of one of them."""
    return l_r * l_r + l_i * l_i < (CLOSE_POLES_TOL * size) * (CLOSE_POLES_TOL * size)


@jit
def pair_integral(l_r, l_i, h, a_r, a_i, b_r, b_i):
    """Return the integral of a exp(l t) over [0, h], where l is real or almost zero.

    b is the value at the end.
    """
    if l_i == 0.0:
        f = decay_integral(l_r, h)
        return f * a_r, f * a_i
    square = l_r * l_r + l_i * l_i
    if square * h * h < SERIES_TURN * SERIES_TURN:
        x_r = l_r * h
        x_i = l_i * h
        f_r = 1.0
        f_i = 0.0
        for n in range(11):
            scale = 1.0 / (12.0 - n)
            f_r, f_i = 1.0 + (f_r * x_r - f_i * x_i) * scale, (f_r * x_i + f_i * x_r) * scale
        return h * (a_r * f_r - a_i * f_i), h * (a_r * f_i + a_i * f_r)
    d_r = b_r - a_r
    d_i = b_i - a_i
    return (d_r * l_r + d_i * l_i) / square, (d_i * l_r - d_r * l_i) / square


@jit_inline
def fill_powers(first, last, ends):
    """Write the powers of the times of the segment's ends to ``ends`` (2, WIDTH).

    The times are in half windows from the window's centre.
    """
    p = 1.0
    q = 1.0
    for k in range(WIDTH):
        ends[0, k] = p
        ends[1, k] = q
        p = p * first
        q = q * last


@jit
def fill_moments(exponent, half, ends, first, last, out_r, out_i):
    """Write the integrals of x^k y, k = 0 ... len(out_r) - 1, over the segment.

    x is the time in half windows. Real and imaginary parts are written to ``out_r`` and ``out_i``.

    y turns as exp(exponent t), from ``first`` at the begin of the segment to ``last`` at its end,
    complex numbers all three. ``ends``: from `fill_powers`.
    """
    count = out_r.shape[0]
    square = exponent.real * exponent.real + exponent.imag * exponent.imag
    moment = complex(0.0, 0.0)
    if square * half * half < SERIES_PHASE * SERIES_PHASE:
        for m in range(count + EXTRA_ORDERS):
            k = count + EXTRA_ORDERS - m
            moment = (
                half * _INVERSE[k] * (ends[1, k] * last - ends[0, k] * first - exponent * moment)
            )
            if k <= count:
                out_r[k - 1] = moment.real
                out_i[k - 1] = moment.imag
        return
    inverse = complex(exponent.real / square, -exponent.imag / square)
    for k in range(count):
        moment = (ends[1, k] * last - ends[0, k] * first - k / half * moment) * inverse
        out_r[k] = moment.real
        out_i[k] = moment.imag


@jit_inline
def fill_factors(omega, half, count, first, last, ends, factors):
    """Write the factors for products of two factors of the carrier to ``factors`` (3, WIDTH).

    ``count`` powers are filled.

    The product of Re(a E) and Re(b E), twice: Re a Re b + Im a Im b without a carrier, and a b on
    its square, which turns from ``first`` to ``last``.
    """
    fill_moments(
        complex(0.0, 2.0 * omega), half, ends, first, last, factors[0, :count], factors[2, :count]
    )
    for k in range(count):
        plain = half * (ends[1, k + 1] - ends[0, k + 1]) * _INVERSE[k + 1]
        x = factors[0, k]
        factors[0, k], factors[1, k], factors[2, k] = plain + x, plain - x, -factors[2, k]
