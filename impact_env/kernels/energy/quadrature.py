"""Work and losses of a segment without events by quadrature.

For regimes whose modal amplitudes cancel, where sums of squares of modal amplitudes would lose
digits, and for loads other than the chirp of one force.
"""

from __future__ import annotations

import math

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.motion.loads import evaluate_load
from impact_env.kernels.motion.modal_system import SPEED, copy_amplitudes, propagate
from impact_env.kernels.motion.segments import add_base_motion_to_state, compute_state_at

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
PANEL_PHASE = 2.0  # phase of the fastest active modal amplitude in a quadrature panel
ACTIVE_RATE_SHARE = 1e-11  # of the largest modal amplitude velocity


@jit
def _find_active_rate(rows, omega, z):
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
    """Return the force at an offset from the window's centre (N).

    ``size`` and ``phase`` are those of a chirp at the centre.
    """
    load = window.load
    if load is not None:
        return evaluate_load(load.terms, window.omega, tau)
    return size * math.cos(phase + (window.omega + 0.5 * window.alpha * tau) * tau)


@jit
def compute_base_power(window, losses, motion, since, state, tau):
    """Return the power of the bases and of the forces that are represented as bases (W).

    In coordinates relative to the bases it is -a_b (Gamma q' + sum of m_a r Y'_a).

    ``state`` holds the modal velocities q' and those of the absorbers without their ``motion``
    (n,), whose segment began ``since`` (s) ago.
    """
    load = window.load
    if load is None:
        return 0.0
    return _compute_base_power(load.base, window.omega, losses, motion, since, state, tau)


@jit
def _compute_base_power(base, omega, losses, motion, since, state, tau):
    if not base.moves:
        return 0.0
    power = 0.0
    half = state.shape[0] // 2
    modes = losses.rate.shape[0]
    for c in range(base.terms.shape[0]):
        momentum = 0.0
        for a in range(motion.shape[0]):
            own = state[half + modes + a] + motion[a].v + motion[a].a * since
            momentum += base.carried[c, a] * own
        for i in range(modes):
            momentum += base.participation[c, i] * state[half + i]
        power -= evaluate_load(base.terms[c], omega, tau) * momentum
    return power


@jit
def add_by_quadrature(segment, losses, state, energy):
    """Add work and losses of a `segments.Segment` by Gauss-Legendre quadrature.

    The panels resolve every modal amplitude that is still active.

    Of absorbers only a tuned one has a damper; ``state`` is scratch.
    """
    modes = losses.rate.shape[0]
    half = state.shape[0] // 2
    window = segment.window
    system = segment.regime.system
    p = segment.buffers.rows[0]
    absorber = segment.motion[0]
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
            own = state[half + modes] + absorber.v + absorber.a * (c - tau)
            energy.totals[0].work += weight * compute_base_power(
                window, losses, segment.motion, c - tau, state, c
            )
            relative = own - tip
            energy.totals[0].absorber_damping += weight * losses.damper * relative * relative
        propagate(system.rows, system.table, system.scale, h, p)
        x += h
