"""What the energies need to know of each regime of a lane, and of its forced part in the current window.

An account has velocities: of the modes, of the tuned absorber relative to the tip, and of the force's point. What is integrated is the square of
each, but for the last its product with the force. So every velocity has a partner: itself, or the force.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.energy_moments import EXTRA
from impact_env.kernels.jit import jit, jit_inline, jit_room, jit_view
from impact_env.kernels.observers import Observe
from impact_env.kernels.records import INTEGER, NUMBER, record
from impact_env.kernels.slots import SPEED
from impact_env.kernels.vector import TERMS

Array = NDArray[np.float64]
PRODUCTS = 2 * TERMS - 1  # coefficients of a product of two polynomials
SERIES = TERMS + EXTRA  # coefficients of an antiderivative that is a power series
UNKNOWN, OWN, COUPLED, CANCELLING = range(4)  # kinds of regime: not met yet; one slot a mode; any slots; those that are left to quadrature
MOST_CANCELLING = 30.0  # amplitudes of slots over the velocity that they add up to: squared, it multiplies rounding
NEGLIGIBLE = 1e-17  # coefficients below this share of the largest one are left out

# rows of Account.places: a slot's mode, -1 for none; then, for either sign of the carrier, which slots turn almost like it
PLACE, NEAREST = 0, 1
# what is known of a regime: its kind, how many powers of velocity and of product count, how many slots turn almost like the carrier (for either
# sign), the centre of the window that all is known for, and the time for which the antiderivatives are
KNOWN = record(kind=INTEGER, order=INTEGER, product_order=INTEGER, near=(INTEGER, 2), window=NUMBER, reached=NUMBER)
# rows of Account.slots: weight in the mode's velocity, the antiderivatives (of loss, of work) before and after a stretch, the loss of a stretch,
# moments on the carrier and on its conjugate, and for either sign of the carrier the series of loss and work; real, then imaginary parts
VELOCITY, BEGIN, END, LOSS, MOMENTS, NEAR_SERIES = 0, 2, 6, 10, 11, 11 + 4 * TERMS
SLOT_ROWS = NEAR_SERIES + 8 * SERIES
# rows of Account.scratch: powers of either end, integrals of powers, those that turn with twice the carrier, carriers of both ends
POWERS, PLAIN, TURNING, CARRIER = 0, 2, 3, 5


class Account(NamedTuple):
    """`observers.Energy`, and what is known of R regimes of J slots, with N_m + 2 velocities. Few arrays, because each costs time at every call.

    ``known`` (R,), ``places`` (R, 3, J), ``slots`` (R, SLOT_ROWS, J), ``scratch`` (6, any): see above. ``velocities`` (R, any, N_m + 2): shape
    (2 J: velocity = Re(shape Z), all real parts first), partner (2 TERMS), product (3 PRODUCTS), and what a stretch adds. Partner and product are in
    powers of the time in half windows. Partner: forced velocity, or half the force, as a factor of the carrier; product: half of the square, or the
    power, first without a carrier, then as a factor of its square. ``mixed`` (R, 2, 4, TERMS, J), where each mode is one slot: antiderivatives of a
    slot times its mode's forced velocity (twice), and of what it moves the force's point times the force, without the slot; as
    `forced.Forced.slots`.
    """

    totals: NDArray[Any]
    modal: Array
    known: NDArray[Any]
    places: NDArray[np.int64]
    velocities: Array
    slots: Array
    mixed: Array
    scratch: Array


@jit_room
def new_account(energy, regimes, slots):  # type: ignore[no-untyped-def]
    """Return room for the energies of a lane with this many regimes of this many slots; None where they are not observed."""
    if energy is None:
        return None
    known = np.zeros(regimes, KNOWN)
    for r in range(regimes):
        known[r].window, known[r].reached = np.nan, np.nan
    return Account(
        energy.totals,
        energy.modal,
        known,
        np.zeros((regimes, 3, slots), np.int64),
        np.zeros((regimes, 2 * slots + 2 * TERMS + 3 * PRODUCTS + 1, energy.modal.shape[0] + 2)),
        np.zeros((regimes, SLOT_ROWS, slots)),
        np.zeros((regimes, 2, 4, TERMS, slots)),
        np.zeros((6, PRODUCTS + EXTRA + 1)),
    )


@jit_view
def observe_with(observe, account):  # type: ignore[no-untyped-def]
    """Return a lane's observers with the account in place of the energies."""
    return Observe(observe.clock, observe.counters, observe.level, observe.events, observe.series, account, observe.place)


@jit_inline
def places(account):  # type: ignore[no-untyped-def]
    """Return where partner, product and sum begin in ``velocities``, behind the shape."""
    partner = 2 * account.slots.shape[2]
    return partner, partner + 2 * TERMS, partner + 2 * TERMS + 3 * PRODUCTS


@jit
def learn_regime(account, r, regime, losses):  # type: ignore[no-untyped-def]
    """Fill what belongs to regime r of the account."""
    modes, half, count = losses.rate.shape[0], regime.out.shape[1] // 2, account.slots.shape[2]
    for j in range(count):
        if regime.slots.rows[SPEED, j] == 0.0:
            continue
        for part in range(2):
            shape, tip, point = account.velocities[r, part * count + j], 0.0, 0.0
            for i in range(modes):
                v = regime.out[part, half + i, j]
                shape[i] = v
                tip += losses.tip_shape[i] * v
                point += losses.force_shape[i] * v
            shape[modes] = regime.out[part, half + modes, j] - tip if losses.damper > 0.0 else 0.0
            shape[modes + 1] = point
    if _cancels(regime, modes, half):
        account.known[r].kind = CANCELLING
    else:
        own = losses.damper == 0.0 and _find_places(account.velocities[r], modes, account.places[r, PLACE], account.slots[r])
        account.known[r].kind = OWN if own else COUPLED


@jit
def _cancels(regime, modes, half):  # type: ignore[no-untyped-def]
    """Return whether slots of a state can be much larger than what they add up to: two are almost the same."""
    out, into = regime.out, regime.into
    for i in range(half, half + modes):
        amplitude = 0.0
        for j in range(out.shape[2]):
            amplitude += np.hypot(out[0, i, j], out[1, i, j]) * np.hypot(into[0, i, j], into[1, i, j])
        if amplitude > MOST_CANCELLING:
            return True
    return False


@jit
def _find_places(shape, modes, place, slots):  # type: ignore[no-untyped-def]
    """Note each slot's mode and its weight in the mode's velocity and return True, or return False where slots and modes are not the same."""
    count = slots.shape[1]
    for j in range(count):
        place[j] = -1
        for i in range(modes):
            if shape[j, i] != 0.0 or shape[count + j, i] != 0.0:
                if place[j] >= 0:
                    return False
                for k in range(j):
                    if place[k] == i:
                        return False
                place[j] = i
                slots[VELOCITY, j], slots[VELOCITY + 1, j] = shape[j, i], shape[count + j, i]
    return True


@jit
def learn_window(account, r, forced, window):  # type: ignore[no-untyped-def]
    """Fill what belongs to the forced part of regime r in a window."""
    account.known[r].window = window.centre
    count, last = account.slots.shape[2], account.velocities.shape[2] - 1
    first, second, end = places(account)
    shape, partner, product = account.velocities[r, :first], account.velocities[r, first:second], account.velocities[r, second:end]
    partner[:] = 0.0
    for j in range(count):
        if account.known[r].kind != OWN:
            _add_forced_velocity(forced.slots, shape, j, count, 0, last + 1, window.half, partner)
        elif account.places[r, PLACE, j] >= 0:
            i = account.places[r, PLACE, j]
            _add_forced_velocity(forced.slots, shape, j, count, i, i + 1, window.half, partner)
            _add_forced_velocity(forced.slots, shape, j, count, last, last + 1, window.half, partner)
    product[:] = 0.0
    _fill_squares(partner, product)
    _fill_power(forced.terms, window.half, partner, product)
    account.known[r].order = _order(partner, TERMS)
    account.known[r].product_order = _order(product, PRODUCTS)


@jit
def _add_forced_velocity(slots, shape, j, count, first, stop, half, velocity):  # type: ignore[no-untyped-def]
    """Add what slot j of ``count`` contributes to the velocities from ``first`` to before ``stop``."""
    scale = 1.0
    for k in range(TERMS):
        p_r, p_i = scale * (slots[0, k, j] + slots[2, k, j]), scale * (slots[1, k, j] - slots[3, k, j])
        m_r, m_i = scale * (slots[0, k, j] - slots[2, k, j]), scale * (slots[1, k, j] + slots[3, k, j])
        for i in range(first, stop):
            velocity[k, i] += shape[j, i] * p_r - shape[count + j, i] * m_i
            velocity[TERMS + k, i] += shape[j, i] * p_i + shape[count + j, i] * m_r
        scale *= half


@jit
def _fill_squares(partner, product):  # type: ignore[no-untyped-def]
    """Add half of the squares of the forced velocities, but for the last."""
    for k in range(TERMS):
        for m in range(k, TERMS):
            factor, at = 0.5 if m == k else 1.0, k + m
            for i in range(partner.shape[1] - 1):
                a_r, a_i, b_r, b_i = factor * partner[k, i], factor * partner[TERMS + k, i], partner[m, i], partner[TERMS + m, i]
                product[at, i] += a_r * b_r + a_i * b_i
                product[PRODUCTS + at, i] += a_r * b_r - a_i * b_i
                product[2 * PRODUCTS + at, i] += a_r * b_i + a_i * b_r


@jit
def _fill_power(terms, half, partner, product):  # type: ignore[no-untyped-def]
    """Add the product of the last forced velocity and the force, which then takes its place as partner."""
    last, scale = partner.shape[1] - 1, 1.0
    for k in range(TERMS):
        a_r, a_i = scale * terms[0, k], scale * terms[1, k]
        for m in range(TERMS):
            b_r, b_i = partner[m, last], partner[TERMS + m, last]
            product[k + m, last] += a_r * b_r + a_i * b_i
            product[PRODUCTS + k + m, last] += a_r * b_r - a_i * b_i
            product[2 * PRODUCTS + k + m, last] += a_r * b_i + a_i * b_r
        scale *= half
    scale = 1.0
    for k in range(TERMS):
        partner[k, last], partner[TERMS + k, last] = scale * terms[0, k], scale * terms[1, k]
        scale *= half


@jit
def _order(rows, count):  # type: ignore[no-untyped-def]
    """Return how many of ``count`` powers are needed, at least one, so that what is left out of each column is negligible."""
    order = 1
    for i in range(rows.shape[1]):
        largest = 0.0
        for k in range(count):
            largest = max(largest, abs(rows[k, i]) + abs(rows[count + k, i]))
        for k in range(order, count):
            if abs(rows[k, i]) + abs(rows[count + k, i]) > NEGLIGIBLE * largest:
                order = k + 1
    return order
