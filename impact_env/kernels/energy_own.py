"""Energies where each mode is one slot: what contains a slot's free part, mode by mode.

A slot times a polynomial on the force's carrier has an antiderivative of the same form, found by back-substitution. Where slot and carrier turn
almost alike that would divide by almost zero; there the antiderivative is a power series, built upwards.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.energy_account import BEGIN, END, LOSS, NEAR_SERIES, NEAREST, PLACE, SERIES, VELOCITY
from impact_env.kernels.energy_moments import SLOW, decay_integrals
from impact_env.kernels.forced import add_forced
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.numbers import cos_sin
from impact_env.kernels.slots import SPEED_SQUARE, S, copy
from impact_env.kernels.vector import TERMS


@jit
def learn_mixed(account, r, rows, forced, window):  # type: ignore[no-untyped-def]
    """Fill the antiderivatives of regime r in a window."""
    known, places, own, count = account.known[r], account.places[r], account.slots[r], rows.shape[1]
    point = account.velocities[r, : 2 * count, account.velocities.shape[2] - 1]
    known.reached, least = np.nan, SLOW**2 / window.half**2
    for k in range(2):
        sign, near = 1.0 - 2.0 * k, 0
        _substitute(rows, window, sign, own, point, forced, account.mixed[r, :, 2 * k : 2 * k + 2])
        for j in range(count):
            l_r, l_i = rows[S, j], rows[S + 1, j] + sign * window.omega
            if places[PLACE, j] >= 0 and l_r * l_r + l_i * l_i < least:
                places[NEAREST + k, near] = j
                near += 1
                series = own[NEAR_SERIES + 4 * SERIES * k : NEAR_SERIES + 4 * SERIES * (k + 1), j]
                _build_up(complex(l_r * window.half, l_i * window.half), window.half, j, sign, own, point, forced, series)
        known.near[k] = near


@jit
def _substitute(rows, window, sign, own, point, forced, mixed):  # type: ignore[no-untyped-def]
    """Fill the antiderivatives of loss and work with one sign of the carrier, ``mixed`` (2, 2, TERMS, J); 0 where they are to be series."""
    least, slots, terms, loss, work = SLOW**2 / window.half**2, forced.slots, forced.terms, mixed[0], mixed[1]
    for j in range(rows.shape[1]):
        l_r, l_i = rows[S, j], rows[S + 1, j] + sign * window.omega
        square = l_r * l_r + l_i * l_i
        scale = 1.0 / square if square >= least else 0.0
        l_r, l_i = l_r * scale, -l_i * scale
        v_r, v_i, p_r, p_i = own[VELOCITY, j], own[VELOCITY + 1, j], point[j], point[rows.shape[1] + j]
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
            loss[0, n, j], loss[1, n, j] = a_r, a_i
            work[0, n, j], work[1, n, j] = b_r, b_i


@jit
def _build_up(exponent, half, j, sign, own, point, forced, series):  # type: ignore[no-untyped-def]
    """Fill the series of slot j (4 SERIES,), loss and work, real and imaginary, in powers of the time in half windows, as is its ``exponent``."""
    l_r, l_i, slots, terms = exponent.real, exponent.imag, forced.slots, forced.terms
    v_r, v_i, p_r, p_i, scale = own[VELOCITY, j], own[VELOCITY + 1, j], point[j], point[own.shape[1] + j], half
    a_r, a_i, b_r, b_i = 0.0, 0.0, 0.0, 0.0
    for n in range(SERIES):
        series[n], series[SERIES + n], series[2 * SERIES + n], series[3 * SERIES + n] = a_r, a_i, b_r, b_i
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
def _antiderivatives(known, places, mixed, own, omega, half, tau, at):  # type: ignore[no-untyped-def]
    """Write the antiderivatives of loss and work at an offset from the window's centre to own[at] ... own[at + 3]; without the slots themselves."""
    for j in range(own.shape[1]):
        own[at, j], own[at + 1, j], own[at + 2, j], own[at + 3, j] = 0.0, 0.0, 0.0, 0.0
    add_forced(mixed[0], omega, tau, 1.0, own[at : at + 2])
    add_forced(mixed[1], omega, tau, 1.0, own[at + 2 : at + 4])
    if known.near[0] + known.near[1] == 0:
        return
    c, s = cos_sin(omega * tau)
    x = tau / half
    for k in range(2):
        for n in range(known.near[k]):
            j, p = places[NEAREST + k, n], NEAR_SERIES + 4 * SERIES * k
            a_r, a_i, b_r, b_i = 0.0, 0.0, 0.0, 0.0
            for m in range(SERIES):
                q = p + SERIES - 1 - m
                a_r, a_i = a_r * x + own[q, j], a_i * x + own[q + SERIES, j]
                b_r, b_i = b_r * x + own[q + 2 * SERIES, j], b_i * x + own[q + 3 * SERIES, j]
            own[at, j] += a_r * c - a_i * s
            own[at + 1, j] += a_r * s + a_i * c
            own[at + 2, j] += b_r * c - b_i * s
            own[at + 3, j] += b_r * s + b_i * c
        s = -s


@jit
def _losses_of_slots(rows, own, z, w):  # type: ignore[no-untyped-def]
    """Turn the slots' decays into the integrals of their modes' velocities squared, without forced times forced."""
    for j in range(own.shape[1]):
        v_r, v_i, s_r, s_i = own[VELOCITY, j], own[VELOCITY + 1, j], rows[S, j], rows[S + 1, j]
        z_r, z_i, w_r, w_i = z[0, j], z[1, j], w[0, j], w[1, j]
        a_r, a_i = v_r * z_r - v_i * z_i, v_r * z_i + v_i * z_r
        b_r, b_i = v_r * w_r - v_i * w_i, v_r * w_i + v_i * w_r
        d_r, d_i = b_r * b_r - b_i * b_i - a_r * a_r + a_i * a_i, 2.0 * (b_r * b_i - a_r * a_i)
        turning = 0.5 * (d_r * s_r + d_i * s_i) / (rows[SPEED_SQUARE, j] + 1e-300)
        mixed = w_r * own[END, j] - w_i * own[END + 1, j] - (z_r * own[BEGIN, j] - z_i * own[BEGIN + 1, j])
        own[LOSS, j] = 0.5 * ((a_r * a_r + a_i * a_i) * own[LOSS, j] + turning) + mixed


@jit_inline
def add_own(account, r, stretch, w, found):  # type: ignore[no-untyped-def]
    """Add all products with free parts; w (2, J): the slots at the end of the stretch."""
    rows, window, tau, end, z = stretch.regime.slots.rows, stretch.window, stretch.tau, stretch.end, stretch.work.z
    known, places, own = account.known[r], account.places[r], account.slots[r]
    if known.reached == tau:
        copy(own[END : END + 2], own[BEGIN : BEGIN + 2])
        copy(own[END + 2 : END + 4], own[BEGIN + 2 : BEGIN + 4])
    else:
        _antiderivatives(known, places, account.mixed[r], own, window.omega, window.half, tau, BEGIN)
    _antiderivatives(known, places, account.mixed[r], own, window.omega, window.half, end, END)
    known.reached = end
    decay_integrals(rows, end - tau, own[LOSS])
    _losses_of_slots(rows, own, z, w)
    power = 0.0
    for j in range(own.shape[1]):
        if places[PLACE, j] >= 0:
            found[places[PLACE, j]] += own[LOSS, j]
            power += w[0, j] * own[END + 2, j] - w[1, j] * own[END + 3, j] - (z[0, j] * own[BEGIN + 2, j] - z[1, j] * own[BEGIN + 3, j])
    found[found.shape[0] - 1] += power
