"""Energies where velocities are sums of any slots, or where a window is one stretch: slots times powers of time, as moments over the stretch."""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.energy.account import BEGIN, LOSS, MOMENTS, NEAREST, OWN, PARTNER, POINT, SERIES, SHAPE, SQUARES, VELOCITY
from impact_env.kernels.energy.moments import CARRIER, MENDED, ROWS, fill_moments
from impact_env.kernels.energy.own import add_free_losses
from impact_env.kernels.energy.pairs import add_pairs, integrate_pairs
from impact_env.kernels.energy.sums import coupled_mixed, mixed_power, own_mixed, slot_moments
from impact_env.kernels.motion.slots import S
from impact_env.kernels.motion.vector import TERMS


@jit
def _mend_moments(rows, window, j, scratch, z, w, powers):
    """Fill the moments of slot j, which turns almost like the carrier or its conjugate."""
    z_r, z_i, w_r, w_i, found = z[0, j], z[1, j], w[0, j], w[1, j], scratch[MENDED:ROWS]
    for k in range(2):
        sign = 1.0 - 2.0 * k
        c, s, d, t = scratch[CARRIER, 0], sign * scratch[CARRIER, 1], scratch[CARRIER, 2], sign * scratch[CARRIER, 3]
        first, last = complex(z_r * c - z_i * s, z_i * c + z_r * s), complex(w_r * d - w_i * t, w_i * d + w_r * t)
        exponent, real, imag = complex(rows[S, j], rows[S + 1, j] + sign * window.omega), found[2 * k, :TERMS], found[2 * k + 1, :TERMS]
        fill_moments(exponent, window.half, scratch, first, last, real, imag)
    for n in range(TERMS):
        up_r, up_i, down_r, down_i = found[0, n], found[1, n], found[2, n], found[3, n]
        powers[n, j], powers[TERMS + n, j] = up_r + down_r, up_i - down_i
        powers[2 * TERMS + n, j], powers[3 * TERMS + n, j] = up_r - down_r, up_i + down_i


@jit_inline
def add_coupled(account, r, stretch, w, found):
    """Add what contains free parts to ``found`` (J,) and return the work; w (2, J): the slots at the end of the stretch."""
    rows, window, h, z = stretch.regime.slots.rows, stretch.window, stretch.end - stretch.tau, stretch.work.z
    known, own, scratch, size = account.known[r], account.rows[r], account.scratch[r], account.rows.shape[2]
    powers, partner = own[MOMENTS:SERIES], own[PARTNER:SQUARES]
    slot_moments(rows, size, window.omega, window.half, scratch, z, w, powers)
    for k in range(2):
        for n in range(known.near[k]):
            _mend_moments(rows, window, account.places[r, NEAREST + k, n], scratch, z, w, powers)
    if known.kind == OWN:
        add_free_losses(rows, own, z, w, h, found)
        own_mixed(own[VELOCITY:POINT], size, powers, partner, found)
    else:
        shape, pairs = own[SHAPE : SHAPE + 2 * size], own[SHAPE + 2 * size :]
        integrate_pairs(rows, pairs, known.series, h, z, w, own[LOSS])
        add_pairs(shape, size, pairs, found)
        coupled_mixed(shape, size, powers, partner, found)
    return mixed_power(own[POINT:BEGIN], size, powers, scratch)
