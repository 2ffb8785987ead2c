"""Work of the force and losses of modes and damper over a stretch without events, from the motion alone: slots, their forced part, and the force.

A velocity is a sum of slots' free parts and of a forced part: powers of time times the force's carrier. So the integral of its square, or of its
product with the force, is a sum of closed forms: free times free, free times forced, forced times forced. No panel resolves the fastest slot, and a
stretch costs the same whatever its length. The stored energy enters nowhere, nor does the equation of motion.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.energy.account import CANCELLING, OWN, UNKNOWN, account_of, learn_regime
from impact_env.kernels.energy.moments import (
    PRODUCTS,
    SLOW,
    fill_factors,
    fill_moments,
    fill_powers,
)
from impact_env.kernels.energy.pairs import add_own_squares, add_pairs, integrate_pairs
from impact_env.kernels.energy.quadrature import add_by_quadrature
from impact_env.kernels.energy.sums import (
    NEGLIGIBLE,
    add_products,
    coupled_mixed,
    coupled_partners,
    forced_powers,
    mixed_power,
    own_mixed,
    own_partners,
    power_of_point,
    slot_moments,
    square_partners,
)
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.slots import S, advance, copy
from impact_env.kernels.motion.vector import TERMS


@jit
def add_energy(stretch, losses, state, r, account):
    """Add work and losses of a `segments.Stretch`, which lies in regime number ``r`` of the account; None: not observed.

    A constant force bends, and moves nothing. ``state`` is scratch.
    """
    if account is None:
        return
    tau = stretch.tau
    end = stretch.end
    window = stretch.window
    z = stretch.work.z
    w = stretch.work.rows[0]
    if not end > tau:
        return
    if window.load is not None:
        add_by_quadrature(stretch, losses, state, account)
        return
    known = account.known[r]
    own = account_of(account, r)
    slots = stretch.regime.slots
    if known.kind == UNKNOWN:
        learn_regime(known, account.mode[r], own, stretch.regime, losses)
    if known.kind == CANCELLING:
        add_by_quadrature(stretch, losses, state, account)
        return
    if known.window != window.centre:
        _learn_window(known, own, stretch.forced, window)
    copy(z, w)
    advance(slots.rows, slots.table, slots.scale, end - tau, w)
    _fill_powers(own, known.order, window, tau, end)
    add_products(own.products, own.squares.shape[0], known.order, own.factors, own.squares)
    work = _forced_work(own, known.order) + _add_free_part(
        known, own, slots.rows, window, end - tau, z, w
    )
    _book(known.kind, account.mode[r], own.squares, losses, account.modal, account.totals[0])
    account.totals[0].work += work


@jit_inline
def _learn_window(known, own, forced, window):
    """Fill what belongs to a regime's forced part in a window: velocities in powers of the time in half windows, and their products."""
    size = own.squares.shape[0]
    known.window = window.centre
    forced_powers(forced.slots, size, window.half, own.moments)
    if known.kind == OWN:
        own_partners(own.velocity, size, own.moments, own.partner)
    else:
        coupled_partners(own.shape, size, own.moments, own.partner)
    order = square_partners(own.partner, size, own.products)
    power_of_point(own.point, size, own.moments, forced.terms, window.half, own.force, own.power)
    known.order = max(order, _power_order(own.power))


@jit
def _power_order(power):
    """Return how many powers of the products with the force count."""
    order = 1
    largest = 0.0
    for p in range(PRODUCTS):
        largest = max(largest, abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]))
    for p in range(1, PRODUCTS):
        if abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]) > NEGLIGIBLE * largest:
            order = p + 1
    return order


@jit_inline
def _fill_powers(own, order, window, tau, end):
    """Fill the carrier, powers and factors of the stretch's ends."""
    (c, s), (d, t) = cos_sin(window.omega * tau), cos_sin(window.omega * end)
    own.carrier[0], own.carrier[1], own.carrier[2], own.carrier[3] = c, s, d, t
    fill_powers(tau / window.half, end / window.half, own.ends)
    first = complex(c * c - s * s, 2.0 * c * s)
    last = complex(d * d - t * t, 2.0 * d * t)
    fill_factors(window.omega, window.half, order, first, last, own.ends, own.factors)


@jit_inline
def _forced_work(own, order):
    """Return the work done on the forced part."""
    work = 0.0
    for k in range(order):
        for m in range(3):
            work += own.factors[m, k] * own.power[m, k]
    return work


@jit_inline
def _add_free_part(known, own, rows, window, h, z, w):
    """Add what contains free parts to the squares and return the work; ``h`` (s): length, z and w (2, J): slots at begin and end of the stretch."""
    size = own.squares.shape[0]
    slot_moments(rows, size, window.omega, window.half, own.ends, own.carrier, z, w, own.moments)
    _mend_moments(rows, window, own.ends, own.carrier, own.near, z, w, own.moments)
    if known.kind == OWN:
        add_own_squares(rows, own.velocity, h, z, w, own.decay, own.squares)
        own_mixed(own.velocity, size, own.moments, own.partner, own.squares)
    else:
        integrate_pairs(rows, own.pairs, known.series, h, z, w, own.decay)
        add_pairs(own.shape, size, own.pairs, own.squares)
        coupled_mixed(own.shape, size, own.moments, own.partner, own.squares)
    return mixed_power(own.point, size, own.moments, own.force)


@jit
def _mend_moments(rows, window, ends, carrier, near, z, w, moments):
    """Fill anew the moments of slots that turn almost like the carrier or its conjugate: ``moments`` (4 TERMS, J) of slots at begin z and end w."""
    least = SLOW * SLOW / (window.half * window.half)
    for j in range(rows.shape[1]):
        if rows[S, j] * rows[S, j] + (abs(rows[S + 1, j]) - window.omega) ** 2 >= least:
            continue
        for k in range(2):
            sign = 1.0 - 2.0 * k
            exponent = complex(rows[S, j], rows[S + 1, j] + sign * window.omega)
            first = complex(z[0, j], z[1, j]) * complex(carrier[0], sign * carrier[1])
            last = complex(w[0, j], w[1, j]) * complex(carrier[2], sign * carrier[3])
            fill_moments(
                exponent,
                window.half,
                ends,
                first,
                last,
                near[2 * k, :TERMS],
                near[2 * k + 1, :TERMS],
            )
        for n in range(TERMS):
            up_r = near[0, n]
            up_i = near[1, n]
            down_r = near[2, n]
            down_i = near[3, n]
            moments[n, j], moments[TERMS + n, j] = up_r + down_r, up_i - down_i
            moments[2 * TERMS + n, j], moments[3 * TERMS + n, j] = up_r - down_r, up_i + down_i


@jit_inline
def _book(kind, mode, squares, losses, modal, totals):
    """Add the squares of velocities times what damps them to the account."""
    modes = losses.rate.shape[0]
    if kind == OWN:
        for j in range(mode.shape[0]):
            if mode[j] >= 0:
                modal[mode[j]] += losses.rate[mode[j]] * squares[j]
        return
    for i in range(modes):
        modal[i] += losses.rate[i] * squares[i]
    if losses.damper > 0.0:  # else there may be no column for it
        totals.absorber_damping += losses.damper * squares[modes]
