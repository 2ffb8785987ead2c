"""Energies where velocities are sums of any slots: what contains free parts, pair by pair."""

from __future__ import annotations

from impact_env.kernels.energy_account import CARRIER, MOMENTS, places
from impact_env.kernels.energy_moments import fill_moments, pair_integral
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.slots import SPEED, S
from impact_env.kernels.vector import TERMS


@jit
def _add_pairs(shape, rows, h, z, w, damper, found):  # type: ignore[no-untyped-def]
    """Add the squares of the velocities' free parts."""
    count = found.shape[0] - (1 if damper > 0.0 else 2)
    for j in range(z.shape[1]):
        if rows[SPEED, j] == 0.0:
            continue
        for k in range(j, z.shape[1]):
            if rows[SPEED, k] == 0.0:
                continue
            s_r, s_i, t_r, t_i, size = rows[S, j], rows[S + 1, j], rows[S, k], rows[S + 1, k], rows[SPEED, j]
            z_r, z_i, y_r, y_i = z[0, j], z[1, j], z[0, k], z[1, k]
            w_r, w_i, x_r, x_i = w[0, j], w[1, j], w[0, k], w[1, k]
            a_r, a_i, b_r, b_i = z_r * y_r - z_i * y_i, z_r * y_i + z_i * y_r, w_r * x_r - w_i * x_i, w_r * x_i + w_i * x_r
            p_r, p_i = pair_integral(s_r + t_r, s_i + t_i, size, h, a_r, a_i, b_r, b_i)
            a_r, a_i, b_r, b_i = z_r * y_r + z_i * y_i, z_i * y_r - z_r * y_i, w_r * x_r + w_i * x_i, w_i * x_r - w_r * x_i
            m_r, m_i = pair_integral(s_r + t_r, s_i - t_i, size, h, a_r, a_i, b_r, b_i)
            factor = 0.5 if j == k else 1.0
            # integrals of the products of real and imaginary parts of both slots
            rr, ii, ri, ir = factor * (m_r + p_r), factor * (m_r - p_r), factor * (p_i - m_i), factor * (p_i + m_i)
            n = z.shape[1]
            for i in range(count):
                v_r, v_i, u_r, u_i = shape[j, i], shape[n + j, i], shape[k, i], shape[n + k, i]
                found[i] += v_r * (rr * u_r - ri * u_i) - v_i * (ir * u_r - ii * u_i)


@jit
def _slot_moments(rows, j, window, scratch, z, w, own, count):  # type: ignore[no-untyped-def]
    """Fill the moments of slot j on the force's carrier and on its conjugate."""
    s_r, s_i = rows[S, j], rows[S + 1, j]
    z_r, z_i, w_r, w_i = z[0, j], z[1, j], w[0, j], w[1, j]
    for k in range(2):
        sign, at = 1.0 - 2.0 * k, MOMENTS + 2 * TERMS * k
        c, s, d, t = scratch[CARRIER, 0], sign * scratch[CARRIER, 1], scratch[CARRIER, 2], sign * scratch[CARRIER, 3]
        first, last = complex(z_r * c - z_i * s, z_i * c + z_r * s), complex(w_r * d - w_i * t, w_i * d + w_r * t)
        turning, out = complex(s_r, s_i + sign * window.omega), own[at : at + 2 * TERMS, j]
        fill_moments(turning, window.half, scratch, first, last, out[:count], out[TERMS : TERMS + count])


@jit
def _add_mixed(velocities, partner, own, count, j, found):  # type: ignore[no-untyped-def]
    """Add the products of slot j's free part and the velocities' partners."""
    n = own.shape[1]
    for k in range(count):
        m = MOMENTS + k
        up_r, up_i, down_r, down_i = own[m, j], own[m + TERMS, j], own[m + 2 * TERMS, j], own[m + 3 * TERMS, j]
        p_r, p_i, m_r, m_i = up_r + down_r, up_i + down_i, up_r - down_r, up_i - down_i
        for i in range(found.shape[0]):
            v_r, v_i = velocities[j, i], velocities[n + j, i]
            found[i] += velocities[partner + k, i] * (v_r * p_r - v_i * p_i) - velocities[partner + TERMS + k, i] * (v_r * m_i + v_i * m_r)


@jit_inline
def add_coupled(account, r, stretch, damper, w, found):  # type: ignore[no-untyped-def]
    """Add all products with free parts; w (2, J): the slots at the end of the stretch."""
    rows, z = stretch.regime.slots.rows, stretch.work.z
    velocities, own, count = account.velocities[r], account.slots[r], account.known[r].order
    partner, _, _ = places(account)
    _add_pairs(velocities, rows, stretch.end - stretch.tau, z, w, damper, found)
    for j in range(own.shape[1]):
        if rows[SPEED, j] > 0.0:
            _slot_moments(rows, j, stretch.window, account.scratch, z, w, own, count)
            _add_mixed(velocities, partner, own, count, j, found)
