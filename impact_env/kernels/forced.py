"""The response to the chirp within one window, exact up to a bounded Taylor remainder.

Around a window's centre the force is Re(F exp(i phi + i Omega tau) exp(i alpha tau^2/2)). The last factor is expanded to alpha^4; its
remainder is below (alpha tau^2/2)^5/120, and the windows are cut so that this is below CHIRP_REMAINDER. The particular solution of a slot is
then A(tau) exp(i Omega tau) + B(tau) exp(-i Omega tau) with polynomials A, B of degree 8 (TERMS coefficients, alpha^4 tau^8), found by
back-substitution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.jit import jit, jit_room, jit_sum
from impact_env.kernels.slots import DRIVE, GUARD, TIP, S, cos_sin
from impact_env.kernels.vector import POINTS, SCAN_TERMS, TERMS

CHIRP_REMAINDER = 1e-17
NEAR_RESONANCE = 0.05  # of |i Omega - s| times half the window: then the polynomial is built upwards
DERIVATIVES = 6
SCANNED = 3  # derivatives of the guard signal that the event search scans
BEYOND = 1.25  # of half a window: up to there bounds hold
TIP_SIGNAL = DERIVATIVES  # row of Forced.signals


class Forced(NamedTuple):
    """One regime's forced part in one window.

    ``slots`` (4, TERMS, J) holds A and B, real and imaginary in turn. ``signals`` (DERIVATIVES + 1, 2, TERMS): polynomials, as factors of
    exp(i Omega tau), of the guard signal and its derivatives, and last of the tip displacement. ``bound`` (DERIVATIVES + SCANNED,): the largest
    size, up to BEYOND half windows from the centre, of the guard signal's derivatives, and of what SCAN_TERMS coefficients leave out of the first
    of them. ``carrier`` (L, 2, POINTS): exp(i Omega k h_L), k = 1 ... POINTS, for the levels of `slots.Slots`.
    ``terms`` (2, TERMS): Taylor coefficients in tau of half the complex force without its carrier.
    """

    slots: NDArray[np.float64]
    signals: NDArray[np.float64]
    bound: NDArray[np.float64]
    carrier: NDArray[np.float64]
    terms: NDArray[np.float64]


class Window(NamedTuple):
    """A stretch of time with one expansion of the chirp: centre (s), half length (s), frequency (rad/s), rate (rad/s^2), force at the centre (N)."""

    centre: float
    half: float
    omega: float
    alpha: float
    force_r: float
    force_i: float


@jit_room
def new_forced(slots):  # type: ignore[no-untyped-def]
    """Return empty room for the forced part of a regime."""
    size, levels = slots.rows.shape[1], slots.steps.shape[0]
    signals, bound, carrier = np.zeros((DERIVATIVES + 1, 2, TERMS)), np.zeros(DERIVATIVES + SCANNED), np.zeros((levels, 2, POINTS))
    return Forced(np.zeros((4, TERMS, size)), signals, bound, carrier, np.zeros((2, TERMS)))


@jit
def fill_terms(window, terms):  # type: ignore[no-untyped-def]
    """Write the terms of `Forced`: only even ones are not zero."""
    c_r, c_i = 0.5 * window.force_r, 0.5 * window.force_i
    terms[0, 0], terms[1, 0] = c_r, c_i
    for m in range(1, 5):
        factor = 0.5 * window.alpha / m
        c_r, c_i = -c_i * factor, c_r * factor
        terms[0, 2 * m], terms[1, 2 * m] = c_r, c_i


@jit_sum
def back_substitute(rows, omega, sign, terms, at, out):  # type: ignore[no-untyped-def]
    """Solve P' + (i sign Omega - s) P = drive * terms for polynomials P, slot by slot, into out[at], out[at + 1].

    ``sign`` -1 takes the conjugate terms.
    """
    for j in range(rows.shape[1]):
        l_r = -rows[0, j]
        l_i = sign * omega - rows[1, j]
        scale = 1.0 / (l_r * l_r + l_i * l_i + 1e-300)
        l_r = l_r * scale
        l_i = -l_i * scale
        n_r = 0.0
        n_i = 0.0
        for m in range(TERMS):
            n = TERMS - 1 - m
            t_r = terms[0, n]
            t_i = sign * terms[1, n]
            x_r = rows[DRIVE, j] * t_r - rows[DRIVE + 1, j] * t_i - (n + 1) * n_r
            x_i = rows[DRIVE, j] * t_i + rows[DRIVE + 1, j] * t_r - (n + 1) * n_i
            n_r = x_r * l_r - x_i * l_i
            n_i = x_r * l_i + x_i * l_r
            out[at, n, j] = n_r
            out[at + 1, n, j] = n_i


@jit
def forward_substitute(rows, j, omega, sign, terms, at, out):  # type: ignore[no-untyped-def]
    """Solve the same for one slot that the force drives at its own frequency, where back-substitution divides by almost zero."""
    l_r, l_i = -rows[S, j], sign * omega - rows[S + 1, j]
    p_r, p_i = 0.0, 0.0
    for n in range(TERMS):
        out[at, n, j], out[at + 1, n, j] = p_r, p_i
        t_r, t_i = terms[0, n], sign * terms[1, n]
        x_r = rows[DRIVE, j] * t_r - rows[DRIVE + 1, j] * t_i - (l_r * p_r - l_i * p_i)
        x_i = rows[DRIVE, j] * t_i + rows[DRIVE + 1, j] * t_r - (l_r * p_i + l_i * p_r)
        p_r, p_i = x_r / (n + 1), x_i / (n + 1)


@jit
def _at_resonance(rows, window, sign, terms, at, out):  # type: ignore[no-untyped-def]
    limit = NEAR_RESONANCE / window.half
    for j in range(rows.shape[1]):
        if abs(rows[S, j]) < limit and abs(sign * window.omega - rows[S + 1, j]) < limit:
            forward_substitute(rows, j, window.omega, sign, terms, at, out)


@jit_sum
def _combine_all(rows, row, slots, signals, at):  # type: ignore[no-untyped-def]
    """Write the coefficients of the signal with the weights w in ``row`` to signals[at]: sum of w A + conj(w B)."""
    for n in range(TERMS):
        q_r = 0.0
        q_i = 0.0
        for j in range(rows.shape[1]):
            q_r += rows[row, j] * (slots[0, n, j] + slots[2, n, j]) - rows[row + 1, j] * (slots[1, n, j] + slots[3, n, j])
            q_i += rows[row, j] * (slots[1, n, j] - slots[3, n, j]) + rows[row + 1, j] * (slots[0, n, j] - slots[2, n, j])
        signals[at, 0, n] = q_r
        signals[at, 1, n] = q_i


@jit
def _derive(omega, signals, start, at):  # type: ignore[no-untyped-def]
    """Write into ``at`` the polynomial of the derivative of the signal ``start``: p' + i omega p."""
    for n in range(TERMS):
        d_r, d_i = -omega * signals[start, 1, n], omega * signals[start, 0, n]
        if n + 1 < TERMS:
            d_r += (n + 1) * signals[start, 0, n + 1]
            d_i += (n + 1) * signals[start, 1, n + 1]
        signals[at, 0, n], signals[at, 1, n] = d_r, d_i


@jit
def _fill_bounds(signals, reach, bound):  # type: ignore[no-untyped-def]
    for m in range(DERIVATIVES):
        whole, rest, power = 0.0, 0.0, 1.0
        for n in range(TERMS):
            size = (abs(signals[m, 0, n]) + abs(signals[m, 1, n])) * power
            whole += size
            if n >= SCAN_TERMS:
                rest += size
            power *= reach
        bound[m] = whole
        if m < SCANNED:
            bound[DERIVATIVES + m] = rest


@jit
def _fill_carrier(steps, omega, carrier):  # type: ignore[no-untyped-def]
    for level in range(steps.shape[0]):
        c, s = cos_sin(omega * steps[level, 0])
        x, y = 1.0, 0.0
        for k in range(POINTS):
            x, y = x * c - y * s, x * s + y * c
            carrier[level, 0, k], carrier[level, 1, k] = x, y


@jit
def solve_response(slots, window, forced):  # type: ignore[no-untyped-def]
    """Fill the slots' and the tip's forced part for a window: all that a regime without guards needs."""
    rows, terms = slots.rows, forced.terms
    fill_terms(window, terms)
    back_substitute(rows, window.omega, 1.0, terms, 0, forced.slots)
    back_substitute(rows, window.omega, -1.0, terms, 2, forced.slots)
    _at_resonance(rows, window, 1.0, terms, 0, forced.slots)
    _at_resonance(rows, window, -1.0, terms, 2, forced.slots)
    solve_place(slots, forced)


@jit
def solve_forced(slots, window, absorber_mass, forced):  # type: ignore[no-untyped-def]
    """Fill a regime's forced part for a window.

    ``absorber_mass`` None: the guard signal is a displacement with the weights in row GUARD. A number (kg): it is the joint force, this
    mass times the tip acceleration, whose direct share of the force only the displacement's derivatives contain.
    """
    solve_response(slots, window, forced)
    solve_guard(slots, window, absorber_mass, forced)


@jit
def solve_place(slots, forced):  # type: ignore[no-untyped-def]
    """Fill the signal of the displacement with the weights in row TIP; the slots' forced part is known."""
    _combine_all(slots.rows, TIP, forced.slots, forced.signals, TIP_SIGNAL)


@jit
def solve_guard(slots, window, absorber_mass, forced):  # type: ignore[no-untyped-def]
    """Fill the guard signal, its derivatives and bounds; slots' forced part and displacement are known, ``absorber_mass`` as in `solve_forced`."""
    signals = forced.signals
    if absorber_mass is None:
        _combine_all(slots.rows, GUARD, forced.slots, signals, 0)
    else:
        _derive(window.omega, signals, TIP_SIGNAL, 1)
        _derive(window.omega, signals, 1, 0)
        for n in range(TERMS):
            signals[0, 0, n] *= absorber_mass
            signals[0, 1, n] *= absorber_mass
    for m in range(1, DERIVATIVES):
        _derive(window.omega, signals, m - 1, m)
    _fill_bounds(signals, BEYOND * window.half, forced.bound)
    _fill_carrier(slots.steps, window.omega, forced.carrier)


@jit_sum
def signal_value(signals, m, omega, tau):  # type: ignore[no-untyped-def]
    """Return signal m at an offset from the window's centre: Re(polynomial(tau) exp(i omega tau))."""
    c, s = cos_sin(omega * tau)
    q_r = 0.0
    q_i = 0.0
    for k in range(TERMS):
        q_r = q_r * tau + signals[m, 0, TERMS - 1 - k]
        q_i = q_i * tau + signals[m, 1, TERMS - 1 - k]
    return q_r * c - q_i * s


@jit_sum
def guard_values(signals, omega, tau):  # type: ignore[no-untyped-def]
    """Return the forced guard signal and its first two derivatives at an offset from the window's centre."""
    c, s = cos_sin(omega * tau)
    a_r = a_i = b_r = b_i = d_r = d_i = 0.0
    for k in range(TERMS):
        n = TERMS - 1 - k
        a_r = a_r * tau + signals[0, 0, n]
        a_i = a_i * tau + signals[0, 1, n]
        b_r = b_r * tau + signals[1, 0, n]
        b_i = b_i * tau + signals[1, 1, n]
        d_r = d_r * tau + signals[2, 0, n]
        d_i = d_i * tau + signals[2, 1, n]
    return a_r * c - a_i * s, b_r * c - b_i * s, d_r * c - d_i * s


@jit_sum
def add_forced(slots, omega, tau, factor, z):  # type: ignore[no-untyped-def]
    """Add factor * (A exp(i omega tau) + B exp(-i omega tau)) to z."""
    c, s = cos_sin(omega * tau)
    c *= factor
    s *= factor
    f, t = slots, tau
    for j in range(z.shape[1]):
        a_r = f[0, 0, j] + t * (
            f[0, 1, j]
            + t * (f[0, 2, j] + t * (f[0, 3, j] + t * (f[0, 4, j] + t * (f[0, 5, j] + t * (f[0, 6, j] + t * (f[0, 7, j] + t * f[0, 8, j]))))))
        )
        a_i = f[1, 0, j] + t * (
            f[1, 1, j]
            + t * (f[1, 2, j] + t * (f[1, 3, j] + t * (f[1, 4, j] + t * (f[1, 5, j] + t * (f[1, 6, j] + t * (f[1, 7, j] + t * f[1, 8, j]))))))
        )
        b_r = f[2, 0, j] + t * (
            f[2, 1, j]
            + t * (f[2, 2, j] + t * (f[2, 3, j] + t * (f[2, 4, j] + t * (f[2, 5, j] + t * (f[2, 6, j] + t * (f[2, 7, j] + t * f[2, 8, j]))))))
        )
        b_i = f[3, 0, j] + t * (
            f[3, 1, j]
            + t * (f[3, 2, j] + t * (f[3, 3, j] + t * (f[3, 4, j] + t * (f[3, 5, j] + t * (f[3, 6, j] + t * (f[3, 7, j] + t * f[3, 8, j]))))))
        )
        z[0, j] += (a_r + b_r) * c - (a_i - b_i) * s
        z[1, j] += (a_i + b_i) * c + (a_r - b_r) * s
