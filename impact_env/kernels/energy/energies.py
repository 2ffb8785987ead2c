"""Work of the force and losses of modes and damper over a stretch without events, from the motion alone: slots, their forced part, and the force.

A velocity is a sum of slots' free parts and of a forced part: powers of time times the force's carrier. So the integral of its square, or of its
product with the force, is a sum of closed forms: free times free, free times forced, forced times forced. No panel resolves the fastest slot, and a
stretch costs the same whatever its length. The stored energy enters nowhere, nor does the equation of motion.
"""

from __future__ import annotations

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.energy.account import ADDED, CANCELLING, OWN, PLACE, SQUARES, UNKNOWN, learn_regime
from impact_env.kernels.energy.coupled import add_coupled
from impact_env.kernels.energy.moments import CARRIER, FACTORS, POWER, SLOW, WIDTH, fill_factors, fill_powers
from impact_env.kernels.energy.own import add_own, learn_mixed
from impact_env.kernels.energy.quadrature import add_by_quadrature
from impact_env.kernels.energy.sums import add_products
from impact_env.kernels.energy.window import learn_window
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.slots import advance, copy
from impact_env.kernels.motion.vector import TERMS


@jit
def add_energy(stretch, losses, state, r, account):
    """Add work and losses of a `segments.Stretch`, which lies in regime number ``r`` of the account; None: not observed.

    A constant force bends, and moves nothing. ``state`` is scratch.
    """
    if account is None:
        return
    tau, end, window, z, w = stretch.tau, stretch.end, stretch.window, stretch.work.z, stretch.work.rows[0]
    if not end > tau:
        return
    if window.load is not None:
        add_by_quadrature(stretch, losses, state, account)
        return
    known, slots = account.known[r], stretch.regime.slots
    if known.kind == UNKNOWN:
        learn_regime(account, r, stretch.regime, losses)
    if known.kind == CANCELLING:
        add_by_quadrature(stretch, losses, state, account)
        return
    if known.window != window.centre:
        learn_window(account, r, slots.rows, stretch.forced, window)
    in_parts = known.kind == OWN and (tau > -window.half or end < window.half)
    if in_parts and known.mixed != window.centre:
        learn_mixed(account, r, slots.rows, stretch.forced, window)
    copy(z, w)
    advance(slots.rows, slots.table, slots.scale, end - tau, w)
    found = account.rows[r, ADDED]
    _fill_scratch(account.scratch[r], known, window, tau, end, in_parts)
    work = _add_forced_part(account, r, found)
    if in_parts:
        work += add_own(account, r, stretch, w, found)
    else:
        work += add_coupled(account, r, stretch, w, found)
    _book(account, r, losses, found, work)
    known.reached, known.cos, known.sin = end, account.scratch[r, CARRIER, 2], account.scratch[r, CARRIER, 3]


@jit_inline
def _fill_scratch(scratch, known, window, tau, end, in_parts):
    """Fill carriers, powers and factors of the stretch's ends; powers for series only where they are needed."""
    turns = scratch[CARRIER]
    if known.reached == tau:
        turns[0], turns[1] = known.cos, known.sin
    else:
        turns[0], turns[1] = cos_sin(window.omega * tau)
    turns[2], turns[3] = cos_sin(window.omega * end)
    series = 2.0 * window.omega * window.half < SLOW or (not in_parts and known.near[0] + known.near[1] > 0)
    fill_powers(tau / window.half, end / window.half, WIDTH if series else max(known.order + 1, TERMS), scratch)
    c, s, d, t = turns[0], turns[1], turns[2], turns[3]
    first, last = complex(c * c - s * s, 2.0 * c * s), complex(d * d - t * t, 2.0 * d * t)
    fill_factors(window.omega, window.half, known.order, first, last, scratch)


@jit_inline
def _add_forced_part(account, r, found):
    """Write half the squares of the forced velocities to ``found`` (J,), and return the work done on the forced part."""
    scratch, count = account.scratch[r], account.known[r].order
    add_products(account.rows[r, SQUARES:ADDED], found.shape[0], count, scratch, found)
    work = 0.0
    for k in range(count):
        for m in range(3):
            work += scratch[FACTORS + m, k] * scratch[POWER + m, k]
    return work


@jit_inline
def _book(account, r, losses, found, work):
    """Add a stretch's work, and the squares of its velocities times what damps them, to the account."""
    modes, totals = losses.rate.shape[0], account.totals[0]
    if account.known[r].kind == OWN:
        for j in range(account.places.shape[2]):
            i = account.places[r, PLACE, j]
            if i >= 0:
                account.modal[i] += losses.rate[i] * found[j]
    else:
        for i in range(modes):
            account.modal[i] += losses.rate[i] * found[i]
        if losses.damper > 0.0:  # else there may be no column for it
            totals.absorber_damping += losses.damper * found[modes]
    totals.work += work
