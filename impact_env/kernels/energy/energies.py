"""Work of the force and losses of modes and damper over a segment, from the motion alone.

A velocity is a sum of modal amplitudes' free parts and of a forced part: powers of time times the
force's carrier. So the integral of its square, or of its product with the force, is a sum of closed
forms (integrals.py): free times free, free times forced, forced times forced. No panel resolves the
fastest modal amplitude, and a segment costs the same whatever its length. The stored energy enters
nowhere, nor does the equation of motion.

In: a `segments.Segment`, the losses of the scene, and the lane's `Account`: the velocities of the
modes, of the tuned absorber relative to the tip, and of the force's point, for each regime. Out:
joules, added to the account (`add_energy`).

Quadrature (`add_by_quadrature`) serves regimes whose modal amplitudes cancel, where sums of squares
of modal amplitudes would lose digits, and loads other than the chirp of one force.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, jit_view
from impact_env.kernels.compiling.records import INTEGER, NUMBER, record_type
from impact_env.kernels.energy.integrals import (
    NEGLIGIBLE,
    PLANES,
    PRODUCTS,
    SERIES_PHASE,
    WIDTH,
    add_coupled_mixed,
    add_own_mixed,
    add_own_squares,
    add_pairs,
    add_products,
    compute_amplitude_moments,
    compute_mixed_power,
    compute_point_power,
    fill_factors,
    fill_moments,
    fill_powers,
    init_pairs,
    integrate_pairs,
    square_partners,
    write_coupled_partners,
    write_forced_powers,
    write_own_partners,
)
from impact_env.kernels.motion.loads import TERMS, evaluate_load
from impact_env.kernels.motion.modal_system import SPEED, S, copy_amplitudes, cos_sin, propagate
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.motion.segments import add_base_motion_to_state, compute_state_at

Array = NDArray[np.float64]
# kinds of regime: not initialised yet; one modal amplitude a mode; any modal amplitudes; modal
# amplitudes that cancel, which need quadrature
NOT_INITIALISED, ONE_PER_MODE, COUPLED, CANCELLING = range(4)
# sum of the modal amplitudes' sizes over the velocity that they add up to: the square of this ratio
# multiplies rounding errors
MOST_CANCELLATION = 30.0
# state of a regime's account
REGIME_STATE = record_type(
    kind=INTEGER,  # NOT_INITIALISED to CANCELLING
    order=INTEGER,  # powers of products that count
    series=INTEGER,  # pairs of modal amplitudes that need series
    window=NUMBER,  # centre of the window whose forced part is known (s)
)
_ROWS = 6 + 6 * TERMS + 3 * PRODUCTS  # rows of `Account.rows` without shape and pairs


class Account(NamedTuple):
    """`observers.EnergyTotals`, and the sums of R regimes with J amplitudes.

    It consists of few arrays, because each costs time at every call; `view_regime_account` names
    the parts of ``rows`` and ``powers``.
    """

    totals: NDArray[Any]  # (1,) a TOTALS record
    modal: Array  # (N_m,) loss in each mode (J)
    states: NDArray[Any]  # (R,) REGIME_STATE records
    mode: NDArray[np.int64]  # (R, J) mode of an amplitude, -1: none
    rows: Array  # (R, 6 + 6 TERMS + 3 PRODUCTS + (2 + PLANES) J, J)
    powers: Array  # (R, 15, WIDTH)


class RegimeAccount(NamedTuple):
    """Quantities of one regime; complex numbers are real parts, then imaginary parts.

    The squares of velocities are integrated: of the modes and of the tuned absorber relative to the
    tip, a column each. Powers are those of the time in half windows.
    """

    velocity: Array  # (2, J) an amplitude's weight in its mode's velocity, for ONE_PER_MODE
    point: Array  # (2, J) an amplitude's weight in the velocity of the force's point
    shape: Array  # (2 J, J) weights of the amplitudes (rows) in the velocities (columns)
    pairs: Array  # (PLANES J, J) see `integrals.PLANES`
    squares: Array  # (J,) of a segment: integrals of the velocities' squares
    decay: Array  # (J,) of a segment: integrals of the amplitudes' decays
    moments: Array  # (4 TERMS, J) powers of the amplitudes' forced parts, or their moments
    partner: Array  # (2 TERMS, J) forced velocities as factors of the carrier
    products: Array  # (3 PRODUCTS, J) half their squares
    ends: Array  # (2, WIDTH) powers of the times of both ends of a segment
    factors: Array  # (3, WIDTH) integrals for the products of forced parts
    power: Array  # (3, WIDTH) products of force and forced velocity of its point
    force: Array  # (2, WIDTH) half the force
    near: Array  # (4, WIDTH) moments of an amplitude near resonance
    carrier: Array  # (4,) cosine and sine of the carrier at both ends


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
PANEL_PHASE = 2.0  # phase of the fastest active modal amplitude in a quadrature panel
ACTIVE_RATE_SHARE = 1e-11  # of the largest modal amplitude velocity


@jit_allocating
def new_account(energy, regimes, size):
    """Return memory for the energies of a lane.

    The lane has ``regimes`` regimes with ``size`` modal amplitudes each. The result is None if
    energies are not observed.
    """
    if energy is None:
        return None
    states = np.zeros(regimes, REGIME_STATE)
    for r in range(regimes):
        states[r].window = np.nan
    rows = np.zeros((regimes, _ROWS + (2 + PLANES) * size, size))
    return Account(
        energy.totals,
        energy.modal,
        states,
        np.zeros((regimes, size), np.int64),
        rows,
        np.zeros((regimes, 15, WIDTH)),
    )


@jit_view
def view_regime_account(account, r):
    """Return the `RegimeAccount` of regime number r, views of the account's arrays."""
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
def replace_energies_by_account(observers, account):
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
def init_regime_account(regime_state, mode, sums, regime, losses):
    """Fill the parts of a regime's account that do not depend on the force.

    They are the record ``regime_state``, ``mode`` (J,), and weights and pairs in ``sums``.
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
                sums.shape[part * size + j, i] = v
                tip += losses.tip_shape[i] * v
                point += losses.force_shape[i] * v
            if losses.damper > 0.0:
                sums.shape[part * size + j, modes] = regime.out[part, half + modes, j] - tip
            sums.point[part, j] = point
    if _has_cancelling_amplitudes(regime, modes, half):
        regime_state.kind = CANCELLING
    elif losses.damper == 0.0 and _match_modes(modes, mode, sums.shape, sums.velocity):
        regime_state.kind = ONE_PER_MODE
    else:
        regime_state.kind = COUPLED
        regime_state.series = init_pairs(regime.system.rows, sums.pairs)


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
    """Write each amplitude's mode (-1: none) to ``mode`` (J,), its weight to ``velocity`` (2, J).

    Returns False if an amplitude belongs to several modes, or a mode to several amplitudes.
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


@jit
def _find_active_rate(rows, omega, z):
    """Return |s| (1/s) of the fastest active modal amplitude in z (2, J), at least ``omega``."""
    largest = 0.0
    for j in range(z.shape[1]):
        largest = max(largest, rows[SPEED, j] * (abs(z[0, j]) + abs(z[1, j])))
    for m in range(z.shape[1]):
        j = z.shape[1] - 1 - m
        if rows[SPEED, j] * (abs(z[0, j]) + abs(z[1, j])) > ACTIVE_RATE_SHARE * largest:
            return max(rows[SPEED, j], omega)
    return max(rows[SPEED, 0], omega)


@jit
def compute_force_at(window, size, phase, tau):
    """Return the force (N) at an offset ``tau`` (s) from the window's centre.

    ``size`` (N) and ``phase`` (rad) are those of the chirp at the centre.
    """
    load = window.load
    if load is not None:
        return evaluate_load(load.terms, window.omega, tau)
    return size * math.cos(phase + (window.omega + 0.5 * window.alpha * tau) * tau)


@jit
def compute_base_power(base, omega, losses, motion, since, state, tau):
    """Return the power of the bases and of the forces that are represented as bases (W).

    In coordinates relative to the bases it is -a_b (Gamma q' + sum of m_a r Y'_a). ``state`` holds
    the modal velocities q' and those of the absorbers without their ``motion`` (n,), whose segment
    began ``since`` (s) ago.
    """
    if not base.moves:
        return 0.0
    power = 0.0
    half = state.shape[0] // 2
    modes = losses.rate.shape[0]
    for c in range(base.terms.shape[0]):
        momentum = 0.0
        for a in range(motion.shape[0]):
            velocity = state[half + modes + a] + motion[a].v + motion[a].a * since
            momentum += base.carried[c, a] * velocity
        for i in range(modes):
            momentum += base.participation[c, i] * state[half + i]
        power -= evaluate_load(base.terms[c], omega, tau) * momentum
    return power


@jit
def add_by_quadrature(segment, losses, state, energy):
    """Add work and losses of a `segments.Segment` by Gauss-Legendre quadrature.

    The panels resolve every modal amplitude that is still active. Only a tuned absorber has a
    damper. The results are added to ``energy`` (`Account`); ``state`` and the segment's
    ``buffers.rows`` are scratch.
    """
    modes = losses.rate.shape[0]
    half = state.shape[0] // 2
    window = segment.window
    system = segment.regime.system
    p = segment.buffers.rows[0]
    absorber = segment.motion[0]
    load = window.load
    tau = segment.tau
    end = segment.end
    copy_amplitudes(segment.buffers.z, p)
    force_size = np.sqrt(window.force_r * window.force_r + window.force_i * window.force_i)
    phase = math.atan2(window.force_i, window.force_r)
    x = tau
    while x < end:
        h = min(PANEL_PHASE / _find_active_rate(system.rows, window.omega, p), end - x)
        if end - x - h < 1e-6 * h:
            h = end - x
        for k in range(_NODES.shape[0]):
            t = 0.5 * h * (1.0 + _NODES[k])
            compute_state_at(segment, p, x, t, segment.buffers.rows[1], state)
            c = x + t
            f = compute_force_at(window, force_size, phase, c)
            add_base_motion_to_state(segment, c, state)
            weight = 0.5 * h * _WEIGHTS[k]
            power = 0.0
            tip = 0.0
            for i in range(modes):
                v = state[half + i]
                power += losses.force_shape[i] * v
                tip += losses.tip_shape[i] * v
                energy.modal[i] += weight * losses.rate[i] * v * v
            energy.totals[0].work += weight * f * power
            velocity = state[half + modes] + absorber.v + absorber.a * (c - tau)
            base_power = 0.0
            if load is not None:
                base_power = compute_base_power(
                    load.base, window.omega, losses, segment.motion, c - tau, state, c
                )
            energy.totals[0].work += weight * base_power
            relative = velocity - tip
            energy.totals[0].absorber_damping += weight * losses.damper * relative * relative
        propagate(system.rows, system.table, system.scale, h, p)
        x += h


@jit
def add_energy(segment, losses, state, r, account):
    """Add work and losses of a segment in regime number ``r`` to the account; None: not observed.

    A constant force gives a static deflection only. ``state`` and the segment's ``buffers.rows``
    are scratch.
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
    regime_state = account.states[r]
    sums = view_regime_account(account, r)
    system = segment.regime.system
    if regime_state.kind == NOT_INITIALISED:
        init_regime_account(regime_state, account.mode[r], sums, segment.regime, losses)
    if regime_state.kind == CANCELLING:
        add_by_quadrature(segment, losses, state, account)
        return
    if regime_state.window != window.centre:
        _init_window(regime_state, sums, segment.forced, window)

    # integrals of squared velocities, and the work: forced parts, then free parts
    copy_amplitudes(z, w)
    propagate(system.rows, system.table, system.scale, end - tau, w)
    _fill_end_powers(sums, regime_state.order, window, tau, end)
    add_products(
        sums.products, sums.squares.shape[0], regime_state.order, sums.factors, sums.squares
    )
    work = _compute_forced_work(sums, regime_state.order) + _add_free_part(
        regime_state, sums, system.rows, window, end - tau, z, w
    )

    _accumulate_losses(
        regime_state.kind, account.mode[r], sums.squares, losses, account.modal, account.totals[0]
    )
    account.totals[0].work += work


@jit_inline
def _init_window(regime_state, sums, forced, window):
    """Fill the parts of the account that depend on the forced response in a window."""
    size = sums.squares.shape[0]
    regime_state.window = window.centre
    write_forced_powers(forced.polynomials, size, window.half, sums.moments)
    if regime_state.kind == ONE_PER_MODE:
        write_own_partners(sums.velocity, size, sums.moments, sums.partner)
    else:
        write_coupled_partners(sums.shape, size, sums.moments, sums.partner)
    order = square_partners(sums.partner, size, sums.products)
    compute_point_power(
        sums.point, size, sums.moments, forced.terms, window.half, sums.force, sums.power
    )
    regime_state.order = max(order, _count_powers(sums.power))


@jit
def _count_powers(power):
    """Return how many powers of the products ``power`` (3, WIDTH) with the force count."""
    order = 1
    largest = 0.0
    for p in range(PRODUCTS):
        largest = max(largest, abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]))
    for p in range(1, PRODUCTS):
        if abs(power[0, p]) + abs(power[1, p]) + abs(power[2, p]) > NEGLIGIBLE * largest:
            order = p + 1
    return order


@jit_inline
def _fill_end_powers(sums, order, window, tau, end):
    """Fill the carrier, powers and factors of the segment's ends."""
    c, s = cos_sin(window.omega * tau)
    d, t = cos_sin(window.omega * end)
    sums.carrier[0] = c
    sums.carrier[1] = s
    sums.carrier[2] = d
    sums.carrier[3] = t
    fill_powers(tau / window.half, end / window.half, sums.ends)
    first = complex(c * c - s * s, 2.0 * c * s)
    last = complex(d * d - t * t, 2.0 * d * t)
    fill_factors(window.omega, window.half, order, first, last, sums.ends, sums.factors)


@jit_inline
def _compute_forced_work(sums, order):
    """Return the work (J) of the force on the forced part of the velocity of its point."""
    work = 0.0
    for k in range(order):
        for m in range(3):
            work += sums.factors[m, k] * sums.power[m, k]
    return work


@jit_inline
def _add_free_part(regime_state, sums, rows, window, h, z, w):
    """Add the integrals with free parts to the squares and return their work.

    ``h`` (s): length of the segment; z and w (2, J): amplitudes at its begin and end.
    """
    size = sums.squares.shape[0]
    compute_amplitude_moments(
        rows, size, window.omega, window.half, sums.ends, sums.carrier, z, w, sums.moments
    )
    _fix_resonant_moments(rows, window, sums.ends, sums.carrier, sums.near, z, w, sums.moments)
    if regime_state.kind == ONE_PER_MODE:
        add_own_squares(rows, sums.velocity, h, z, w, sums.decay, sums.squares)
        add_own_mixed(sums.velocity, size, sums.moments, sums.partner, sums.squares)
    else:
        integrate_pairs(rows, sums.pairs, regime_state.series, h, z, w, sums.decay)
        add_pairs(sums.shape, size, sums.pairs, sums.squares)
        add_coupled_mixed(sums.shape, size, sums.moments, sums.partner, sums.squares)
    return compute_mixed_power(sums.point, size, sums.moments, sums.force)


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
