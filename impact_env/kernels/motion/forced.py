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

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.motion.forced_sums import (
    add_response,
    back_substitute,
    back_substitute_both,
    combine,
    first_values,
    polynomial_value,
)
from impact_env.kernels.motion.loads import Load, add_base_drive, unit_count
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.slots import BASE, DRIVE, GUARD, TIP, S
from impact_env.kernels.motion.vector import POINTS, SCAN_TERMS, TERMS

NEAR_RESONANCE = (
    0.05  # of |i Omega - s| times half the window: then the polynomial is built upwards
)
DERIVATIVES = 6
SCANNED = 3  # derivatives of the guard signal that the event search scans
SIGNALS = (2, TERMS, 2, 4)  # shape of Forced.signals
BEYOND = 1.25  # of half a window: up to there bounds hold
# numbers of the signals in Forced.signals: the guard signal and its derivatives, the tip displacement, that of a free absorber under a base that
# moves; those of the scan are together
GUARD_SIGNALS = (0, 1, 2, 4, 5, 6)
TIP_SIGNAL = 3
THIRD, FOURTH, FIFTH = GUARD_SIGNALS[3:]


class Units(NamedTuple):
    """A regime's forced part under unit loads without a carrier, of which straight lines are sums (lines.py): 1, and the time from the centre.

    ``slots`` (only A, which B equals), ``signals`` and ``bound``: those of `Forced`, with one axis more for the two loads, first as forces, then as
    the base's acceleration where it moves. ``shares`` (2,) or (4,): what a window has of each. ``half`` (1,): the longest half window (s) that they
    hold in. ``leap`` (3, 2, J) or (5, 2, J): what slots become in ``span`` (1,) s, as factor of what they were and for each unit load.
    """

    slots: NDArray[np.float64]
    signals: NDArray[np.float64]
    bound: NDArray[np.float64]
    shares: NDArray[np.float64]
    half: NDArray[np.float64]
    leap: NDArray[np.float64]
    span: NDArray[np.float64]


class Forced(NamedTuple):
    """One regime's forced part in one window.

    ``slots`` (4, TERMS, J) holds A and B, real and imaginary in turn. ``signals`` (2, TERMS, 2, 4): polynomials, as factors of
    exp(i Omega tau), of the guard signal, its derivatives and the tip displacement; the coefficients of signal m, real and imaginary, are
    signals[m // 4, :, :, m % 4]. ``bound`` (DERIVATIVES + SCANNED,): the largest
    size, up to BEYOND half windows from the centre, of the guard signal's derivatives, and of what SCAN_TERMS coefficients leave out of the first
    of them. ``carrier`` (L, 2, POINTS): exp(i Omega k h_L), k = 1 ... POINTS, for the levels of `slots.Slots`; not a number
    first where a level is not known yet.
    ``terms`` (2, TERMS): Taylor coefficients in tau of half the complex force without its carrier. ``units`` None: every window is solved anew.
    """

    slots: NDArray[np.float64]
    signals: NDArray[np.float64]
    bound: NDArray[np.float64]
    carrier: NDArray[np.float64]
    terms: NDArray[np.float64]
    units: Units | None


class Window(NamedTuple):
    """A stretch of time with one expansion of the load: centre (s), half length (s), frequency (rad/s), rate (rad/s^2), force at the centre (N).

    ``load``: other loads than the chirp of one force, whose terms it holds; the frequency is their carrier, rate and force then say nothing.
    """

    centre: float
    half: float
    omega: float
    alpha: float
    force_r: float
    force_i: float
    load: Load | None = None


@jit_room
def new_units(load, size):
    """Return empty room for `Units` of ``size`` slots, None for the chirp."""
    if load is None:
        return None
    n = unit_count(load.base)
    slots = np.zeros((n, 2, TERMS, size))
    signals = np.zeros((n, *SIGNALS))
    bound = np.zeros((n, DERIVATIVES + SCANNED))
    leap = np.zeros((n + 1, 2, size))
    return Units(slots, signals, bound, np.zeros(n), np.zeros(1), leap, np.zeros(1))


@jit_room
def new_forced(slots, load):
    """Return empty room for the forced part of a regime under a `Load`, None: under a chirp."""
    size = slots.rows.shape[1]
    levels = slots.steps.shape[0]
    signals = np.zeros(SIGNALS)
    bound = np.zeros(DERIVATIVES + SCANNED)
    carrier = np.zeros((levels, 2, POINTS))
    return Forced(
        np.zeros((4, TERMS, size)),
        signals,
        bound,
        carrier,
        np.zeros((2, TERMS)),
        new_units(load, size),
    )


@jit
def fill_terms(window, terms):
    """Write the terms of `Forced`; of a chirp only even ones are not zero."""
    load = window.load
    if load is not None:
        for n in range(TERMS):
            terms[0, n], terms[1, n] = load.terms[0, n], load.terms[1, n]
        return
    c_r = 0.5 * window.force_r
    c_i = 0.5 * window.force_i
    terms[0, 0], terms[1, 0] = c_r, c_i
    for m in range(1, 5):
        factor = 0.5 * window.alpha / m
        c_r, c_i = -c_i * factor, c_r * factor
        terms[0, 2 * m], terms[1, 2 * m] = c_r, c_i


@jit
def forward_substitute(rows, j, window, sign, terms, at, out):
    """Solve the same for one slot that the force drives at its own frequency, where back-substitution divides by almost zero."""
    load = window.load
    l_r = -rows[S, j]
    l_i = sign * window.omega - rows[S + 1, j]
    p_r = 0.0
    p_i = 0.0
    for n in range(TERMS):
        out[at, n, j], out[at + 1, n, j] = p_r, p_i
        t_r = terms[0, n]
        t_i = sign * terms[1, n]
        x_r = rows[DRIVE, j] * t_r - rows[DRIVE + 1, j] * t_i - (l_r * p_r - l_i * p_i)
        x_i = rows[DRIVE, j] * t_i + rows[DRIVE + 1, j] * t_r - (l_r * p_i + l_i * p_r)
        if load is not None:
            x_r, x_i = add_base_drive(load.base, rows, j, BASE, sign, n, x_r, x_i)
        p_r = x_r / (n + 1)
        p_i = x_i / (n + 1)


@jit
def _at_resonance(rows, window, sign, terms, at, out):
    limit = NEAR_RESONANCE / window.half
    for j in range(rows.shape[1]):
        if abs(rows[S, j]) < limit and abs(sign * window.omega - rows[S + 1, j]) < limit:
            forward_substitute(rows, j, window, sign, terms, at, out)


@jit
def _derive(omega, signals, start, at):
    """Write into ``at`` the polynomial of the derivative of the signal ``start``: p' + i omega p."""
    for n in range(TERMS):
        d_r = -omega * signals[start // 4, n, 1, start % 4]
        d_i = omega * signals[start // 4, n, 0, start % 4]
        if n + 1 < TERMS:
            d_r += (n + 1) * signals[start // 4, n + 1, 0, start % 4]
            d_i += (n + 1) * signals[start // 4, n + 1, 1, start % 4]
        signals[at // 4, n, 0, at % 4], signals[at // 4, n, 1, at % 4] = d_r, d_i


@jit
def _fill_bounds(signals, reach, bound):
    for m in range(DERIVATIVES):
        whole = 0.0
        rest = 0.0
        power = 1.0
        for n in range(TERMS):
            at = GUARD_SIGNALS[m]
            size = (
                abs(signals[at // 4, n, 0, at % 4]) + abs(signals[at // 4, n, 1, at % 4])
            ) * power
            whole += size
            if n >= SCAN_TERMS:
                rest += size
            power *= reach
        bound[m] = whole
        if m < SCANNED:
            bound[DERIVATIVES + m] = rest


@jit
def fill_carrier(steps, omega, level, carrier):
    """Write the carrier of one level, unless it is known: a search needs few of them."""
    if not np.isnan(carrier[level, 0, 0]):
        return
    c, s = cos_sin(omega * steps[level, 0])
    x = 1.0
    y = 0.0
    for k in range(POINTS):
        x, y = x * c - y * s, x * s + y * c
        carrier[level, 0, k], carrier[level, 1, k] = x, y


@jit_inline
def _substitute(rows, window, sign, terms, at, out):
    """Solve for all slots by back-substitution, which divides by the difference of slot and carrier."""
    load = window.load
    if load is None:
        back_substitute(rows, rows.shape[1], window.omega, sign, terms, at, out)
    else:
        _substitute_loads(rows, window.omega, sign, terms, load.base, at, out)


@jit_inline
def _substitute_loads(rows, omega, sign, terms, base, at, out):
    if base is None:
        back_substitute(rows, rows.shape[1], omega, sign, terms, at, out)
    else:
        back_substitute_both(rows, rows.shape[1], omega, sign, terms, base.terms, at, out)


@jit
def solve_response(slots, window, forced):
    """Fill the slots' and the tip's forced part for a window: all that a regime without guards needs."""
    rows = slots.rows
    terms = forced.terms
    fill_terms(window, terms)
    _substitute(rows, window, 1.0, terms, 0, forced.slots)
    _substitute(rows, window, -1.0, terms, 2, forced.slots)
    _at_resonance(rows, window, 1.0, terms, 0, forced.slots)
    _at_resonance(rows, window, -1.0, terms, 2, forced.slots)
    solve_place(slots, forced)


@jit
def solve_forced(slots, window, absorber_mass, forced):
    """Fill a regime's forced part for a window.

    ``absorber_mass`` None: the guard signal is a displacement with the weights in row GUARD. A number (kg): it is the joint force, this
    mass times the tip acceleration, whose direct share of the force only the displacement's derivatives contain.
    """
    solve_response(slots, window, forced)
    solve_guard(slots, window, absorber_mass, forced)


@jit
def solve_place(slots, forced):
    """Fill the signal of the displacement with the weights in row TIP; the slots' forced part is known."""
    combine(slots.rows, TIP, slots.rows.shape[1], forced.slots, forced.signals, TIP_SIGNAL)


@jit
def solve_own(window, forced):
    """Add to the guard signal of a free absorber its own displacement under a base that moves: Y'' = -r a_b, r of `loads.Base`."""
    load = window.load
    if load is not None:
        _integrate_base(load.base, window.omega, window.half, forced.signals)


@jit
def _integrate_base(base, omega, half, signals):
    """Fill the signal of a free absorber's displacement, which is twice the integral of what the base does to it, and add it to the guard signal.

    P' + i Omega P = F as in `solve_response`, with s = 0: where Omega is small the polynomial is built upwards.
    """
    if base is None:
        return
    for n in range(TERMS):
        for part in range(2):
            signals[1, n, part, 3] = -2.0 * base.at_absorber * base.terms[part, n]
    for _ in range(2):
        if omega * half < NEAR_RESONANCE:
            p_r = 0.0
            p_i = 0.0
            for n in range(TERMS):
                x_r = signals[1, n, 0, 3] + omega * p_i
                x_i = signals[1, n, 1, 3] - omega * p_r
                signals[1, n, 0, 3], signals[1, n, 1, 3] = p_r, p_i
                p_r = x_r / (n + 1)
                p_i = x_i / (n + 1)
        else:
            p_r = 0.0
            p_i = 0.0
            for m in range(TERMS):
                n = TERMS - 1 - m
                x_r = signals[1, n, 0, 3] - (n + 1) * p_r
                x_i = signals[1, n, 1, 3] - (n + 1) * p_i
                p_r = x_i / omega
                p_i = -x_r / omega
                signals[1, n, 0, 3], signals[1, n, 1, 3] = p_r, p_i
    for n in range(TERMS):
        for part in range(2):
            signals[0, n, part, 0] += signals[1, n, part, 3]


@jit
def pull_joint(window, mass, signals):
    """Add to a joint force what moves the absorber with the base."""
    load = window.load
    if load is not None:
        _pull_by_base(load.base, mass, signals)


@jit
def _pull_by_base(base, mass, signals):
    if base is not None:
        for n in range(TERMS):
            for part in range(2):
                signals[0, n, part, 0] += 2.0 * mass * base.at_absorber * base.terms[part, n]


@jit
def own_motion(load, signals, omega, tau):
    """Return displacement and velocity that the base gives a free absorber at an offset from the window's centre, both 0 where it does not move."""
    if load is None:
        return 0.0, 0.0
    return _own_motion(load.base, signals, omega, tau)


@jit
def _own_motion(base, signals, omega, tau):
    if base is None:
        return 0.0, 0.0
    c, s = cos_sin(omega * tau)
    x = 0.0
    y = 0.0
    dx = 0.0
    dy = 0.0
    for m in range(TERMS):
        n = TERMS - 1 - m
        dx = dx * tau + x
        dy = dy * tau + y
        x = x * tau + signals[1, n, 0, 3]
        y = y * tau + signals[1, n, 1, 3]
    dx = dx - omega * y
    dy = dy + omega * x
    return x * c - y * s, dx * c - dy * s


@jit
def solve_guard(slots, window, absorber_mass, forced):
    """Fill the guard signal, its derivatives and bounds; slots' forced part and displacement are known, ``absorber_mass`` as in `solve_forced`."""
    signals = forced.signals
    if absorber_mass is None:
        combine(slots.rows, GUARD, slots.rows.shape[1], forced.slots, signals, 0)
        solve_own(window, forced)
    else:
        _derive(window.omega, signals, TIP_SIGNAL, 1)
        _derive(window.omega, signals, 1, 0)
        for n in range(TERMS):
            signals[0, n, 0, 0] *= absorber_mass
            signals[0, n, 1, 0] *= absorber_mass
        pull_joint(window, absorber_mass, signals)
    for m in range(1, DERIVATIVES):
        _derive(window.omega, signals, GUARD_SIGNALS[m - 1], GUARD_SIGNALS[m])
    # the last step of a search may begin in the window and end beyond it: by a quarter of its half, or by the finest step where that is longer
    _fill_bounds(signals, max(BEYOND * window.half, window.half + slots.steps[0, 0]), forced.bound)
    for level in range(slots.steps.shape[0]):
        forced.carrier[level, 0, 0] = np.nan


@jit_inline
def signal_value(signals, m, omega, tau):
    """Return signal m at an offset from the window's centre: Re(polynomial(tau) exp(i omega tau))."""
    c, s = cos_sin(omega * tau)
    return polynomial_value(signals, m, tau, c, s)


@jit_inline
def guard_values(signals, omega, tau):
    """Return the forced guard signal and its first two derivatives at an offset from the window's centre."""
    c, s = cos_sin(omega * tau)
    return first_values(signals, tau, c, s)


@jit
def add_forced(slots, omega, tau, factor, z):
    """Add factor * (A exp(i omega tau) + B exp(-i omega tau)) to z."""
    c, s = cos_sin(omega * tau)
    add_response(slots, z.shape[1], tau, c * factor, s * factor, z)
