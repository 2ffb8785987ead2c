"""What the energies need to know of each regime of a lane.

An account has velocities: of the modes, of the tuned absorber relative to the tip, and of the
force's point. What is integrated is the square of each, but for the last its product with the
force.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, jit_view
from impact_env.kernels.compiling.records import INTEGER, NUMBER, record_type
from impact_env.kernels.energy.moments import PRODUCTS, WIDTH
from impact_env.kernels.energy.pairs import PLANES, init_pairs
from impact_env.kernels.motion.modal_system import SPEED
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.motion.search_block import TERMS

Array = NDArray[np.float64]
# kinds of regime: not met yet; one modal amplitude a mode; any modal amplitudes; those that are
# left to quadrature
NOT_INITIALISED, ONE_PER_MODE, COUPLED, CANCELLING = range(4)
MOST_CANCELLATION = (
    30.0  # modal amplitudes over the velocity that they add up to: squared, it multiplies rounding
)
# of a regime: its kind; how many powers of products count; how many pairs of modal amplitudes need
# series; the centre of the window whose forced part is known
REGIME_STATE = record_type(kind=INTEGER, order=INTEGER, series=INTEGER, window=NUMBER)
_ROWS = 6 + 6 * TERMS + 3 * PRODUCTS  # of a regime's numbers, without the shape and the pairs


class Account(NamedTuple):
    """`observers.EnergyTotals`, and the sums of R regimes with J amplitudes.

    It consists of few arrays, because each costs time at every call.

    ``known`` (R,), ``mode`` (R, J), ``rows`` (R, 6 + 6 TERMS + 3 PRODUCTS + (2 + PLANES) J, J),
    ``powers`` (R, 15, WIDTH): `view_regime_account` names their parts.
    """

    totals: NDArray[Any]
    modal: Array
    known: NDArray[Any]
    mode: NDArray[np.int64]
    rows: Array
    powers: Array


class RegimeAccount(NamedTuple):
    """Quantities of one regime, with complex numbers as real and imaginary parts.

    Each column belongs to a velocity.

    ``velocity``, ``point`` (2, J): a modal amplitude's weight in its mode's velocity, where each
    mode is one modal amplitude, and in that of the force's point. ``shape`` (2 J, J): weights of
    modal amplitudes in columns. ``pairs`` (PLANES J, J): see pairs.py. ``squares``, ``decay`` (J,):
    of a segment, integrals of the columns' squares, of the modal amplitudes' decays. ``moments`` (4
    TERMS, J): powers of the modal amplitudes' forced parts, or moments of the modal amplitudes
    themselves. ``partner`` (2 TERMS, J): forced velocities as factors of the carrier, ``products``
    (3 PRODUCTS, J): half their squares.

    In powers of the time in half windows, each (., WIDTH): ``ends`` (2) of a segment; ``factors``
    (3) of the products of forced parts; ``power`` (3): products of force and forced velocity of its
    point; ``force`` (2): half the force; ``near`` (4): moments of a modal amplitude that turns like
    the carrier. ``carrier`` (4,): cosine and sine of the carrier at both ends.
    """

    velocity: Array
    point: Array
    shape: Array
    pairs: Array
    squares: Array
    decay: Array
    moments: Array
    partner: Array
    products: Array
    ends: Array
    factors: Array
    power: Array
    force: Array
    near: Array
    carrier: Array


@jit_allocating
def new_account(energy, regimes, size):
    """Return memory for the energies of a lane.

    The lane has ``regimes`` regimes with ``size`` modal amplitudes each. The result is None if
    energies are not observed.
    """
    if energy is None:
        return None
    known = np.zeros(regimes, REGIME_STATE)
    for r in range(regimes):
        known[r].window = np.nan
    rows = np.zeros((regimes, _ROWS + (2 + PLANES) * size, size))
    return Account(
        energy.totals,
        energy.modal,
        known,
        np.zeros((regimes, size), np.int64),
        rows,
        np.zeros((regimes, 15, WIDTH)),
    )


@jit
def forget_regime(account, r):
    """Clear regime number r of an account, because another regime has taken its place.

    ``account`` is None if energies are not observed.
    """
    if account is None:
        return
    account.known[r].kind = NOT_INITIALISED
    account.known[r].window = np.nan
    account.rows[r, :, :] = 0.0


@jit_view
def view_regime_account(account, r):
    """Return an account's sums of its regime number r."""
    rows = account.rows[r]
    powers = account.powers[r]
    size = account.rows.shape[2]
    at = 6 + 6 * TERMS
    return RegimeAccount(
        velocity=rows[:2],
        point=rows[2:4],
        shape=rows[_ROWS : _ROWS + 2 * size],
        pairs=rows[_ROWS + 2 * size :],
        squares=rows[4],
        decay=rows[5],
        moments=rows[6 : 6 + 4 * TERMS],
        partner=rows[6 + 4 * TERMS : at],
        products=rows[at : at + 3 * PRODUCTS],
        ends=powers[:2],
        factors=powers[2:5],
        power=powers[5:8],
        force=powers[8:10],
        near=powers[10:14],
        carrier=powers[14],
    )


@jit_view
def with_energy_account(observers, account):
    """Return a run's observers with the account in place of the energies."""
    return Observers(
        clock=observers.clock,
        counters=observers.counters,
        level=observers.level,
        events=observers.events,
        series=observers.series,
        energy=account,
    )


@jit_inline
def init_regime_account(known, mode, own, regime, losses):
    """Fill the parts of a regime's account that do not depend on the force.

    They are the record ``known``, ``mode`` (J,) and weights.
    """
    modes = losses.rate.shape[0]
    half = regime.out.shape[1] // 2
    size = regime.out.shape[2]
    for j in range(size):
        if regime.system.rows[SPEED, j] == 0.0:
            continue
        for part in range(2):
            tip = 0.0
            point = 0.0
            for i in range(modes):
                v = regime.out[part, half + i, j]
                own.shape[part * size + j, i] = v
                tip += losses.tip_shape[i] * v
                point += losses.force_shape[i] * v
            if losses.damper > 0.0:
                own.shape[part * size + j, modes] = regime.out[part, half + modes, j] - tip
            own.point[part, j] = point
    if _has_cancelling_amplitudes(regime, modes, half):
        known.kind = CANCELLING
    elif losses.damper == 0.0 and _match_modes(modes, mode, own.shape, own.velocity):
        known.kind = ONE_PER_MODE
    else:
        known.kind = COUPLED
        known.series = init_pairs(regime.system.rows, own.pairs)


@jit
def _has_cancelling_amplitudes(regime, modes, half):
    """Return whether modal amplitudes of a state can be much larger than their sum.

    This is the case if two eigenvalues are almost the same.
    """
    out = regime.out
    into = regime.into
    for i in range(half, half + modes):
        amplitude = 0.0
        for j in range(out.shape[2]):
            amplitude += np.hypot(out[0, i, j], out[1, i, j]) * np.hypot(
                into[0, i, j], into[1, i, j]
            )
        if amplitude > MOST_CANCELLATION:
            return True
    return False


@jit
def _match_modes(modes, mode, shape, velocity):
    """Assign each amplitude to its mode (-1: none), with its weight.

    Returns False if amplitudes and modes do not match one to one.
    """
    size = mode.shape[0]
    for j in range(size):
        mode[j] = -1
        for i in range(modes):
            v_r = shape[j, i]
            v_i = shape[size + j, i]
            if v_r != 0.0 or v_i != 0.0:
                if mode[j] >= 0:
                    return False
                for k in range(j):
                    if mode[k] == i:
                        return False
                mode[j] = i
                velocity[0, j] = v_r
                velocity[1, j] = v_i
    return True
