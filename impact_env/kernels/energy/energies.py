"""Work of the force and losses of modes and damper over a segment, from the motion alone.

A velocity is a sum of modal amplitudes' free parts and of a forced part: powers of time times the
force's carrier. So the integral of its square, or of its product with the force, is a sum of closed
forms: free times free, free times forced, forced times forced. No panel resolves the fastest modal
amplitude, and a segment costs the same whatever its length. The stored energy enters nowhere, nor
does the equation of motion.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.energy.account import (
    CANCELLING,
    NOT_INITIALISED,
    ONE_PER_MODE,
    init_regime_account,
    view_regime_account,
)
from impact_env.kernels.energy.moments import (
    PRODUCTS,
    SERIES_PHASE,
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
from impact_env.kernels.motion.modal_system import S, copy_amplitudes, propagate
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.search_block import TERMS


@jit
def add_energy(segment, losses, state, r, account):
    """Add work and losses of a segment in regime number ``r`` to the account; None: not observed.

    A constant force gives a static deflection only. ``state`` is scratch.
    """
    if account is None:
        return
    tau = segment.tau
    end = segment.end
    window = segment.window
    z = segment.buffers.z
    w = segment.buffers.rows[0]
    if not end > tau:
        return
    if window.load is not None:
        add_by_quadrature(segment, losses, state, account)
        return
    known = account.known[r]
    own = view_regime_account(account, r)
    system = segment.regime.system
    if known.kind == NOT_INITIALISED:
        init_regime_account(known, account.mode[r], own, segment.regime, losses)
    if known.kind == CANCELLING:
        add_by_quadrature(segment, losses, state, account)
        return
    if known.window != window.centre:
        _init_window(known, own, segment.forced, window)
    copy_amplitudes(z, w)
    propagate(system.rows, system.table, system.scale, end - tau, w)
    _fill_end_powers(own, known.order, window, tau, end)
    add_products(own.products, own.squares.shape[0], known.order, own.factors, own.squares)
    work = _compute_forced_work(own, known.order) + _add_free_part(
        known, own, system.rows, window, end - tau, z, w
    )
    _accumulate_losses(
        known.kind, account.mode[r], own.squares, losses, account.modal, account.totals[0]
    )
    account.totals[0].work += work


@jit_inline
def _init_window(known, own, forced, window):
    """Fill the parts of the account that depend on the forced response in a window."""
    size = own.squares.shape[0]
    known.window = window.centre
    forced_powers(forced.polynomials, size, window.half, own.moments)
    if known.kind == ONE_PER_MODE:
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
def _fill_end_powers(own, order, window, tau, end):
    """Fill the carrier, powers and factors of the segment's ends."""
    c, s = cos_sin(window.omega * tau)
    d, t = cos_sin(window.omega * end)
    own.carrier[0] = c
    own.carrier[1] = s
    own.carrier[2] = d
    own.carrier[3] = t
    fill_powers(tau / window.half, end / window.half, own.ends)
    first = complex(c * c - s * s, 2.0 * c * s)
    last = complex(d * d - t * t, 2.0 * d * t)
    fill_factors(window.omega, window.half, order, first, last, own.ends, own.factors)


@jit_inline
def _compute_forced_work(own, order):
    """Return the work done on the forced part."""
    work = 0.0
    for k in range(order):
        for m in range(3):
            work += own.factors[m, k] * own.power[m, k]
    return work


@jit_inline
def _add_free_part(known, own, rows, window, h, z, w):
    """Add the integrals with free parts to the squares and return their work.

    ``h`` (s): length of the segment; z and w (2, J): amplitudes at its begin and end.
    """
    size = own.squares.shape[0]
    slot_moments(rows, size, window.omega, window.half, own.ends, own.carrier, z, w, own.moments)
    _fix_resonant_moments(rows, window, own.ends, own.carrier, own.near, z, w, own.moments)
    if known.kind == ONE_PER_MODE:
        add_own_squares(rows, own.velocity, h, z, w, own.decay, own.squares)
        own_mixed(own.velocity, size, own.moments, own.partner, own.squares)
    else:
        integrate_pairs(rows, own.pairs, known.series, h, z, w, own.decay)
        add_pairs(own.shape, size, own.pairs, own.squares)
        coupled_mixed(own.shape, size, own.moments, own.partner, own.squares)
    return mixed_power(own.point, size, own.moments, own.force)


@jit
def _fix_resonant_moments(rows, window, ends, carrier, near, z, w, moments):
    """Recompute the moments of amplitudes whose frequency is close to the carrier.

    ``moments`` (4 TERMS, J) are changed. The amplitudes are z at the segment's begin and w at its
    end.
    """
    least = SERIES_PHASE * SERIES_PHASE / (window.half * window.half)
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
            moments[n, j] = up_r + down_r
            moments[TERMS + n, j] = up_i - down_i
            moments[2 * TERMS + n, j] = up_r - down_r
            moments[3 * TERMS + n, j] = up_i + down_i


@jit_inline
def _accumulate_losses(kind, mode, squares, losses, modal, totals):
    """Add the squared velocities times their damping to the totals."""
    modes = losses.rate.shape[0]
    if kind == ONE_PER_MODE:
        for j in range(mode.shape[0]):
            if mode[j] >= 0:
                modal[mode[j]] += losses.rate[mode[j]] * squares[j]
        return
    for i in range(modes):
        modal[i] += losses.rate[i] * squares[i]
    if losses.damper > 0.0:  # else there may be no column for it
        totals.absorber_damping += losses.damper * squares[modes]
