"""What the energies need to know of a regime's forced part in a window: velocities in powers of the time in half windows, and their products."""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.energy.account import ADDED, BEGIN, MOMENTS, NEAREST, OWN, PARTNER, POINT, SERIES, SHAPE, SQUARES, VELOCITY
from impact_env.kernels.energy.moments import FORCE, POWER, PRODUCTS, SLOW
from impact_env.kernels.energy.sums import NEGLIGIBLE, coupled_partners, forced_powers, own_partners, power_of_point, square_partners
from impact_env.kernels.motion.slots import SPEED, S


@jit
def learn_window(account, r, slots, forced, window):
    """Fill what belongs to the forced part of regime r in a window; ``slots``: rows of `slots.Slots`."""
    known, rows, scratch, size = account.known[r], account.rows[r], account.scratch[r], slots.shape[1]
    known.window, known.reached = window.centre, np.nan
    powers, partner = rows[MOMENTS:SERIES], rows[PARTNER:SQUARES]
    forced_powers(forced.slots, size, window.half, powers)
    if known.kind == OWN:
        own_partners(rows[VELOCITY:POINT], size, powers, partner)
    else:
        coupled_partners(rows[SHAPE:], size, powers, partner)
    order = square_partners(partner, size, rows[SQUARES:ADDED])
    power_of_point(rows[POINT:BEGIN], size, powers, forced.terms, window.half, scratch)
    known.order = max(order, _power_order(scratch[POWER:FORCE]))
    _find_near(account, r, slots, window)


@jit
def _power_order(power):
    """Return how many powers of the products with the force count."""
    order, largest = 1, 0.0
    for p in range(PRODUCTS):
        largest = max(largest, abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]))
    for p in range(1, PRODUCTS):
        if abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]) > NEGLIGIBLE * largest:
            order = p + 1
    return order


@jit
def _find_near(account, r, rows, window):
    """Note which slots turn almost like the force's carrier, or its conjugate."""
    least = SLOW * SLOW / (window.half * window.half)
    for k in range(2):
        sign, near = 1.0 - 2.0 * k, 0
        for j in range(rows.shape[1]):
            l_r, l_i = rows[S, j], rows[S + 1, j] + sign * window.omega
            if rows[SPEED, j] > 0.0 and l_r * l_r + l_i * l_i < least:
                account.places[r, NEAREST + k, near] = j
                near += 1
        account.known[r].near[k] = near
