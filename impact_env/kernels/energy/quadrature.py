"""Work and losses of a stretch without events by quadrature.

For regimes whose slots cancel, where sums of squares of slots would lose digits, and for loads other than the chirp of one force.
"""

from __future__ import annotations

import math

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.motion.loads import value_of
from impact_env.kernels.motion.segments import add_own_motion, state_at
from impact_env.kernels.motion.slots import SPEED, advance, copy

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
PANEL = 2.0  # phase of the fastest active slot in a quadrature panel
ACTIVE = 1e-11  # of the largest slot velocity


@jit
def _active_speed(rows, omega, z):
    largest = 0.0
    for j in range(z.shape[1]):
        largest = max(largest, rows[SPEED, j] * (abs(z[0, j]) + abs(z[1, j])))
    for m in range(z.shape[1]):
        j = z.shape[1] - 1 - m
        if rows[SPEED, j] * (abs(z[0, j]) + abs(z[1, j])) > ACTIVE * largest:
            return max(rows[SPEED, j], omega)
    return max(rows[SPEED, 0], omega)


@jit
def force_at(window, size, phase, tau):
    """Return the force at an offset from the window's centre (N); a chirp has ``size`` and ``phase`` there."""
    load = window.load
    if load is not None:
        return value_of(load.terms, window.omega, tau)
    return size * math.cos(phase + (window.omega + 0.5 * window.alpha * tau) * tau)


@jit
def base_power(window, losses, own, state, tau):
    """Return the power of the base in a state (W), in coordinates relative to it: -a_b (Gamma q' + m_a r Y'), Y' = ``own`` (m/s)."""
    load = window.load
    if load is None:
        return 0.0
    return _power_of(load.base, window.omega, losses, own, state, tau)


@jit
def _power_of(base, omega, losses, own, state, tau):
    if base is None:
        return 0.0
    momentum = base.carried * own
    half = state.shape[0] // 2
    for i in range(losses.rate.shape[0]):
        momentum += base.participation[i] * state[half + i]
    return -value_of(base.terms, omega, tau) * momentum


@jit
def add_by_quadrature(stretch, losses, state, energy):
    """Add work and losses of a `segments.Stretch` by Gauss-Legendre quadrature, in panels that resolve every slot still active.

    Of absorbers only a tuned one has a damper; ``state`` is scratch.
    """
    modes = losses.rate.shape[0]
    half = state.shape[0] // 2
    window = stretch.window
    slots = stretch.regime.slots
    p = stretch.work.rows[0]
    absorber = stretch.motion[0]
    tau = stretch.tau
    end = stretch.end
    copy(stretch.work.z, p)
    force_size = np.sqrt(window.force_r * window.force_r + window.force_i * window.force_i)
    phase = math.atan2(window.force_i, window.force_r)
    x = tau
    while x < end:
        h = min(PANEL / _active_speed(slots.rows, window.omega, p), end - x)
        if end - x - h < 1e-6 * h:
            h = end - x
        for k in range(_NODES.shape[0]):
            t = 0.5 * h * (1.0 + _NODES[k])
            state_at(stretch, p, x, t, stretch.work.rows[1], state)
            c = x + t
            f = force_at(window, force_size, phase, c)
            add_own_motion(stretch, c, state)
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
            energy.totals[0].work += weight * base_power(window, losses, own, state, c)
            relative = own - tip
            energy.totals[0].absorber_damping += weight * losses.damper * relative * relative
        advance(slots.rows, slots.table, slots.scale, h, p)
        x += h
