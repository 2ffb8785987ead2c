"""What the energies need to know of each regime of a lane.

An account has velocities: of the modes, of the tuned absorber relative to the tip, and of the force's point. What is integrated is the square of
each, but for the last its product with the force.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_room, jit_view
from impact_env.kernels.compiling.records import INTEGER, NUMBER, record
from impact_env.kernels.energy.moments import EXTRA, PRODUCTS, ROWS, WIDTH
from impact_env.kernels.energy.pairs import PLANES, learn_pairs
from impact_env.kernels.motion.observers import Observe
from impact_env.kernels.motion.slots import SPEED
from impact_env.kernels.motion.vector import TERMS

Array = NDArray[np.float64]
SERIES_TERMS = TERMS + EXTRA  # coefficients of an antiderivative that is a power series
UNKNOWN, OWN, COUPLED, CANCELLING = range(4)  # kinds of regime: not met yet; one slot a mode; any slots; those that are left to quadrature
MOST_CANCELLING = 30.0  # amplitudes of slots over the velocity that they add up to: squared, it multiplies rounding

# rows of Account.places: a slot's mode, -1 for none; then, for either sign of the carrier, which slots turn almost like it
PLACE, NEAREST = 0, 1
# what is known of a regime: its kind; how many powers of products count, how many slots turn almost like the carrier (for either sign), how many
# pairs of slots need series; the centres of the windows that forced parts and antiderivatives are known for; until when the latter are, and the
# carrier then
KNOWN = record(kind=INTEGER, order=INTEGER, near=(INTEGER, 2), series=INTEGER, window=NUMBER, mixed=NUMBER, reached=NUMBER, cos=NUMBER, sin=NUMBER)
# rows of Account.rows, real parts before imaginary ones. Of a slot: its weight in its mode's velocity and in that of the force's point;
# antiderivatives, of loss and of work, before and after a stretch; its loss; powers of its forced part, or its moments; for either sign of the
# carrier antiderivatives as power series, then those that are polynomials, both of loss and of work
VELOCITY, POINT, BEGIN, END, LOSS, MOMENTS, SERIES = 0, 2, 4, 8, 12, 13, 13 + 4 * TERMS
# of a column: forced velocity as a factor of the carrier, half its square (`energy_sums.square_partners`), what a stretch adds. Then J rows each:
# weights of slots in columns, real and imaginary; pairs (`energy_pairs`)
MIXED = SERIES + 8 * SERIES_TERMS
PARTNER = MIXED + 8 * TERMS
SQUARES, ADDED, SHAPE = PARTNER + 2 * TERMS, PARTNER + 2 * TERMS + 3 * PRODUCTS, PARTNER + 2 * TERMS + 3 * PRODUCTS + 1


class Account(NamedTuple):
    """`observers.Energy`, and what is known of R regimes of J slots. Few arrays, because each costs time at every call.

    ``known`` (R,), ``places`` (R, 3, J), ``rows`` (R, SHAPE + (2 + PLANES) J, J), ``scratch`` (R, ROWS, WIDTH): see above and `energy_moments`.
    A column of ``rows`` is a velocity: that of a slot's mode, where each mode is one slot, else those of N_m modes and of a damper.
    """

    totals: NDArray[Any]
    modal: Array
    known: NDArray[Any]
    places: NDArray[np.int64]
    rows: Array
    scratch: Array


@jit_room
def new_account(energy, regimes, slots):
    """Return room for the energies of a lane with this many regimes of this many slots; None where they are not observed."""
    if energy is None:
        return None
    known = np.zeros(regimes, KNOWN)
    for r in range(regimes):
        known[r].window, known[r].mixed, known[r].reached = np.nan, np.nan, np.nan
    rows = np.zeros((regimes, SHAPE + (2 + PLANES) * slots, slots))
    return Account(energy.totals, energy.modal, known, np.zeros((regimes, 3, slots), np.int64), rows, np.zeros((regimes, ROWS, WIDTH)))


@jit_view
def observe_with(observe, account):
    """Return a lane's observers with the account in place of the energies."""
    return Observe(observe.clock, observe.counters, observe.level, observe.events, observe.series, account, observe.place)


@jit
def learn_regime(account, r, regime, losses):
    """Fill what belongs to regime r of the account."""
    modes, half, size, rows, known = losses.rate.shape[0], regime.out.shape[1] // 2, account.rows.shape[2], account.rows[r], account.known[r]
    for j in range(size):
        if regime.slots.rows[SPEED, j] == 0.0:
            continue
        for part in range(2):
            shape, tip, point = rows[SHAPE + part * size + j], 0.0, 0.0
            for i in range(modes):
                v = regime.out[part, half + i, j]
                shape[i] = v
                tip += losses.tip_shape[i] * v
                point += losses.force_shape[i] * v
            if losses.damper > 0.0:
                shape[modes] = regime.out[part, half + modes, j] - tip
            rows[POINT + part, j] = point
    if _cancels(regime, modes, half):
        known.kind = CANCELLING
    elif losses.damper == 0.0 and _find_places(modes, account.places[r, PLACE], rows):
        known.kind = OWN
    else:
        known.kind = COUPLED
        known.series = learn_pairs(regime.slots.rows, rows[SHAPE + 2 * size :])


@jit
def _cancels(regime, modes, half):
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
def _find_places(modes, place, rows):
    """Note each slot's mode and its weight in the mode's velocity and return True, or return False where slots and modes are not the same."""
    size = rows.shape[1]
    for j in range(size):
        place[j] = -1
        for i in range(modes):
            v_r, v_i = rows[SHAPE + j, i], rows[SHAPE + size + j, i]
            if v_r != 0.0 or v_i != 0.0:
                if place[j] >= 0:
                    return False
                for k in range(j):
                    if place[k] == i:
                        return False
                place[j] = i
                rows[VELOCITY, j], rows[VELOCITY + 1, j] = v_r, v_i
    return True
