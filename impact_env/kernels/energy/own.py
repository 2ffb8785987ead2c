"""Energies where each mode is one slot: what contains a slot's free part, mode by mode.

A slot times a polynomial on the force's carrier has an antiderivative of the same form, found by back-substitution. Where slot and carrier turn
almost alike that would divide by almost zero; there the antiderivative is a power series, built upwards.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.energy.account import BEGIN, END, LOSS, MIXED, NEAREST, PARTNER, POINT, SERIES, SERIES_TERMS, VELOCITY
from impact_env.kernels.energy.moments import CARRIER, SLOW, decay_integrals
from impact_env.kernels.motion.forced_sums import add_response
from impact_env.kernels.motion.slots import SPEED_SQUARE, S, copy
from impact_env.kernels.motion.vector import TERMS


@jit
def learn_mixed(account, r, rows, forced, window):
    """Fill the antiderivatives of regime r in a window."""
    known, places, own = account.known[r], account.places[r], account.rows[r]
    known.mixed, known.reached = window.centre, np.nan
    for k in range(2):
        sign = 1.0 - 2.0 * k
        _substitute(rows, window, sign, own, forced, MIXED + 2 * k * TERMS)
        for n in range(known.near[k]):
            j = places[NEAREST + k, n]
            exponent = complex(rows[S, j] * window.half, (rows[S + 1, j] + sign * window.omega) * window.half)
            _build_up(exponent, window.half, j, sign, own, forced, own[SERIES + 4 * SERIES_TERMS * k : SERIES + 4 * SERIES_TERMS * (k + 1), j])


@jit
def _substitute(rows, window, sign, own, forced, at):
    """Fill the antiderivatives of loss and work with one sign of the carrier, from row ``at`` of ``own`` on; 0 where they are to be series."""
    least, slots, terms, work = SLOW * SLOW / (window.half * window.half), forced.slots, forced.terms, at + 4 * TERMS
    for j in range(rows.shape[1]):
        l_r, l_i = rows[S, j], rows[S + 1, j] + sign * window.omega
        square = l_r * l_r + l_i * l_i
        scale = 1.0 / square if square >= least else 0.0
        l_r, l_i = l_r * scale, -l_i * scale
        v_r, v_i, p_r, p_i = own[VELOCITY, j], own[VELOCITY + 1, j], own[POINT, j], own[POINT + 1, j]
        a_r, a_i, b_r, b_i = 0.0, 0.0, 0.0, 0.0
        for m in range(TERMS):
            n = TERMS - 1 - m
            # forced velocity without its carrier: v A + conj(v B)
            g_r = v_r * (slots[0, n, j] + slots[2, n, j]) - v_i * (slots[1, n, j] + slots[3, n, j])
            g_i = sign * (v_r * (slots[1, n, j] - slots[3, n, j]) + v_i * (slots[0, n, j] - slots[2, n, j]))
            t_r, t_i = terms[0, n], sign * terms[1, n]
            x_r, x_i = v_r * g_r - v_i * g_i - (n + 1) * a_r, v_r * g_i + v_i * g_r - (n + 1) * a_i
            y_r, y_i = p_r * t_r - p_i * t_i - (n + 1) * b_r, p_r * t_i + p_i * t_r - (n + 1) * b_i
            a_r, a_i = x_r * l_r - x_i * l_i, x_r * l_i + x_i * l_r
            b_r, b_i = y_r * l_r - y_i * l_i, y_r * l_i + y_i * l_r
            own[at + n, j], own[at + TERMS + n, j] = a_r, a_i
            own[work + n, j], own[work + TERMS + n, j] = b_r, b_i


@jit
def _build_up(exponent, half, j, sign, own, forced, series):
    """Fill the series of slot j (4 SERIES_TERMS,) in powers of the time in half windows, as is ``exponent``: loss and work, real and imaginary."""
    l_r, l_i, slots, terms = exponent.real, exponent.imag, forced.slots, forced.terms
    v_r, v_i, p_r, p_i, scale = own[VELOCITY, j], own[VELOCITY + 1, j], own[POINT, j], own[POINT + 1, j], half
    a_r, a_i, b_r, b_i = 0.0, 0.0, 0.0, 0.0
    for n in range(SERIES_TERMS):
        series[n], series[SERIES_TERMS + n], series[2 * SERIES_TERMS + n], series[3 * SERIES_TERMS + n] = a_r, a_i, b_r, b_i
        x_r, x_i, y_r, y_i = -(l_r * a_r - l_i * a_i), -(l_r * a_i + l_i * a_r), -(l_r * b_r - l_i * b_i), -(l_r * b_i + l_i * b_r)
        if n < TERMS:
            g_r = v_r * (slots[0, n, j] + slots[2, n, j]) - v_i * (slots[1, n, j] + slots[3, n, j])
            g_i = sign * (v_r * (slots[1, n, j] - slots[3, n, j]) + v_i * (slots[0, n, j] - slots[2, n, j]))
            t_r, t_i = terms[0, n], sign * terms[1, n]
            x_r, x_i = x_r + scale * (v_r * g_r - v_i * g_i), x_i + scale * (v_r * g_i + v_i * g_r)
            y_r, y_i = y_r + scale * (p_r * t_r - p_i * t_i), y_i + scale * (p_r * t_i + p_i * t_r)
            scale *= half
        a_r, a_i, b_r, b_i = x_r / (n + 1), x_i / (n + 1), y_r / (n + 1), y_i / (n + 1)


@jit
def _antiderivatives(known, places, own, c, s, tau, half, at):
    """Write the antiderivatives of loss and work to own[at] ... own[at + 3], without the slots themselves.

    ``tau`` (s): from the window's centre, which is ``half`` from its end; c and s: the carrier there.
    """
    size = own.shape[1]
    for j in range(size):
        own[at, j], own[at + 1, j], own[at + 2, j], own[at + 3, j] = 0.0, 0.0, 0.0, 0.0
    add_response(own[MIXED : MIXED + 4 * TERMS], size, tau, c, s, own[at : at + 2])
    add_response(own[MIXED + 4 * TERMS : PARTNER], size, tau, c, s, own[at + 2 : at + 4])
    x = tau / half
    for k in range(2):
        for n in range(known.near[k]):
            j, p = places[NEAREST + k, n], SERIES + 4 * SERIES_TERMS * k
            a_r, a_i, b_r, b_i = 0.0, 0.0, 0.0, 0.0
            for m in range(SERIES_TERMS):
                q = p + SERIES_TERMS - 1 - m
                a_r, a_i = a_r * x + own[q, j], a_i * x + own[q + SERIES_TERMS, j]
                b_r, b_i = b_r * x + own[q + 2 * SERIES_TERMS, j], b_i * x + own[q + 3 * SERIES_TERMS, j]
            own[at, j] += a_r * c - a_i * s
            own[at + 1, j] += a_r * s + a_i * c
            own[at + 2, j] += b_r * c - b_i * s
            own[at + 3, j] += b_r * s + b_i * c
        s = -s


@jit
def _add_losses(rows, own, z, w, found):
    """Add the integrals of the slots' velocities squared, without forced times forced, to ``found``; own[LOSS]: their decays."""
    for j in range(own.shape[1]):
        v_r, v_i, s_r, s_i = own[VELOCITY, j], own[VELOCITY + 1, j], rows[S, j], rows[S + 1, j]
        z_r, z_i, w_r, w_i = z[0, j], z[1, j], w[0, j], w[1, j]
        a_r, a_i = v_r * z_r - v_i * z_i, v_r * z_i + v_i * z_r
        b_r, b_i = v_r * w_r - v_i * w_i, v_r * w_i + v_i * w_r
        d_r, d_i = b_r * b_r - b_i * b_i - a_r * a_r + a_i * a_i, 2.0 * (b_r * b_i - a_r * a_i)
        turning = 0.5 * (d_r * s_r + d_i * s_i) / (rows[SPEED_SQUARE, j] + 1e-300)
        mixed = w_r * own[END, j] - w_i * own[END + 1, j] - (z_r * own[BEGIN, j] - z_i * own[BEGIN + 1, j])
        found[j] += 0.5 * ((a_r * a_r + a_i * a_i) * own[LOSS, j] + turning) + mixed


@jit_inline
def add_own(account, r, stretch, w, found):
    """Add what contains free parts to ``found`` (J,), slot by slot, and return the work; w (2, J): the slots at the end of the stretch."""
    rows, window, tau, end, z = stretch.regime.slots.rows, stretch.window, stretch.tau, stretch.end, stretch.work.z
    known, places, own, turns = account.known[r], account.places[r], account.rows[r], account.scratch[r, CARRIER]
    if known.reached == tau:
        copy(own[END : END + 2], own[BEGIN : BEGIN + 2])
        copy(own[END + 2 : END + 4], own[BEGIN + 2 : BEGIN + 4])
    else:
        _antiderivatives(known, places, own, turns[0], turns[1], tau, window.half, BEGIN)
    _antiderivatives(known, places, own, turns[2], turns[3], end, window.half, END)
    decay_integrals(rows, end - tau, own[LOSS])
    _add_losses(rows, own, z, w, found)
    power = 0.0
    for j in range(own.shape[1]):
        power += w[0, j] * own[END + 2, j] - w[1, j] * own[END + 3, j] - (z[0, j] * own[BEGIN + 2, j] - z[1, j] * own[BEGIN + 3, j])
    return power


@jit
def add_free_losses(rows, own, z, w, h, found):
    """Add the integrals of the slots' free velocities squared over a stretch of length ``h`` (s) to ``found`` (J,)."""
    for j in range(own.shape[1]):
        own[BEGIN, j], own[BEGIN + 1, j], own[END, j], own[END + 1, j] = 0.0, 0.0, 0.0, 0.0
    decay_integrals(rows, h, own[LOSS])
    _add_losses(rows, own, z, w, found)
