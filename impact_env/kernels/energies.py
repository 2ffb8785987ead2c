"""Work of the force and losses of modes and damper over a stretch without events, from the motion alone: slots, their forced part, and the force.

A velocity is a sum of slots' free parts and of a forced part: powers of time times the force's carrier. So the integral of its square, or of its
product with the force, is a sum of closed forms: free times free, free times forced, forced times forced. No panel resolves the fastest slot, and a
stretch costs the same whatever its length. The stored energy enters nowhere, nor does the equation of motion.
"""

from __future__ import annotations

from impact_env.kernels.energy_account import (
    CANCELLING,
    CARRIER,
    OWN,
    PLAIN,
    PRODUCTS,
    TURNING,
    UNKNOWN,
    learn_regime,
    learn_window,
    places,
)
from impact_env.kernels.energy_coupled import add_coupled
from impact_env.kernels.energy_moments import fill_moments, fill_powers, plain_moments
from impact_env.kernels.energy_own import add_own, learn_mixed
from impact_env.kernels.energy_quadrature import add_by_quadrature
from impact_env.kernels.jit import jit, jit_inline
from impact_env.kernels.numbers import cos_sin
from impact_env.kernels.slots import advance, copy


@jit
def add_energy(stretch, losses, state, r, account):  # type: ignore[no-untyped-def]
    """Add work and losses of a `segments.Stretch`, which lies in regime number ``r`` of the account; None: not observed.

    A constant force bends, and moves nothing. ``state`` is scratch.
    """
    if account is None:
        return
    tau, end, window, forced, z, scratch = stretch.tau, stretch.end, stretch.window, stretch.forced, stretch.work.z, stretch.work.rows
    if not end > tau:
        return
    if account.known[r].kind == UNKNOWN:
        learn_regime(account, r, stretch.regime, losses)
    kind, slots, w = account.known[r].kind, stretch.regime.slots, scratch[0]
    if kind == CANCELLING:
        add_by_quadrature(stretch, losses, state, account)
        return
    if account.known[r].window != window.centre:
        learn_window(account, r, forced, window)
        if kind == OWN:
            learn_mixed(account, r, slots.rows, forced, window)
    copy(z, w)
    advance(slots.rows, slots.table, slots.scale, end - tau, w)
    _, _, at = places(account)
    found = account.velocities[r, at]
    _fill_scratch(account.scratch, window, tau, end)
    _set_forced_part(account, r, window, found)
    if kind == OWN:
        add_own(account, r, stretch, w, found)
    else:
        add_coupled(account, r, stretch, losses.damper, w, found)
    modes = losses.rate.shape[0]
    for i in range(modes):
        account.modal[i] += losses.rate[i] * found[i]
    account.totals[0].absorber_damping += losses.damper * found[modes]
    account.totals[0].work += found[modes + 1]


@jit_inline
def _fill_scratch(scratch, window, tau, end):  # type: ignore[no-untyped-def]
    """Fill powers and carriers of the stretch's ends."""
    fill_powers(tau / window.half, end / window.half, scratch.shape[1], scratch)
    scratch[CARRIER, 0], scratch[CARRIER, 1] = cos_sin(window.omega * tau)
    scratch[CARRIER, 2], scratch[CARRIER, 3] = cos_sin(window.omega * end)


@jit_inline
def _set_forced_part(account, r, window, found):  # type: ignore[no-untyped-def]
    """Write the products of forced parts and their partners to ``found``."""
    scratch, count, velocities = account.scratch, account.known[r].product_order, account.velocities[r]
    _, product, _ = places(account)
    c, s, d, t = scratch[CARRIER, 0], scratch[CARRIER, 1], scratch[CARRIER, 2], scratch[CARRIER, 3]
    first, last = complex(c * c - s * s, 2.0 * c * s), complex(d * d - t * t, 2.0 * d * t)
    plain_moments(window.half, scratch, scratch[PLAIN, :count])
    fill_moments(complex(0.0, 2.0 * window.omega), window.half, scratch, first, last, scratch[TURNING, :count], scratch[TURNING + 1, :count])
    for i in range(found.shape[0]):
        found[i] = 0.0
    for k in range(count):
        plain, x, y, at = scratch[PLAIN, k], scratch[TURNING, k], scratch[TURNING + 1, k], product + k
        for i in range(found.shape[0]):
            found[i] += velocities[at, i] * plain + velocities[at + PRODUCTS, i] * x - velocities[at + 2 * PRODUCTS, i] * y
