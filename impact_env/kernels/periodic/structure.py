"""The input of the kernels of periodic orbits.

It consists of a structure as exponentials, a point of the parameters, and an order of events.

A mode's response to a unit impulse is h(t) = sum of Re(weight exp(s t)) over its exponentials: one
complex exponential, or two real ones if the mode is overdamped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline


class Structure(NamedTuple):
    """A modal model of N_m modes and J exponentials, and an absorber."""

    s: NDArray[np.complex128]  # (J,) exponents of the modes (1/s)
    weight: NDArray[np.complex128]  # (J,) their weights in the response to a unit impulse
    powers: NDArray[np.complex128]  # (4, J) tip^2 weight/s, and that times s, s^2, s^3
    mode: NDArray[np.int64]  # (J,) index of the mode that an exponential belongs to
    omega: NDArray[np.float64]  # (N_m,) circular frequencies (rad/s)
    rate: NDArray[np.float64]  # (N_m,) 2 D omega (1/s)
    push: NDArray[np.float64]  # (N_m,) mode shape at the force
    tip: NDArray[np.float64]  # (N_m,) mode shape at the absorber
    mass: float  # of the absorber (kg)
    compliance: float  # G = 1/mass + sum tip^2 (1/kg)
    static: float  # sum tip^2/omega^2 (m/N)


class Point(NamedTuple):
    """A point of the parameters."""

    omega: float  # circular frequency of the force (rad/s)
    force: float  # amplitude (N)
    gap: float  # clearance from the middle of the cavity to either wall (m)
    restitution: float  # Newton's coefficient
    limit: float  # friction limit muN (N)


class Order(NamedTuple):
    """The n events, impacts and slip reversals, of one span of time, which repeats."""

    wall: NDArray[np.int64]  # (n,) wall of an impact, -1 lower or 1 upper; 0: a reversal
    sign: NDArray[np.int64]  # (n,) sign of the relative velocity after each event, 1 or -1
    turn: float  # length of the span in rad of the force's phase
    mirror: float  # -1: the next span has the opposite motion, 1: the same motion


class Scale(NamedTuple):
    """Units by which unknowns and residuals are divided."""

    length: float  # m
    velocity: float  # m/s
    impulse: float  # N s


@jit_inline
def replace_frequency(point, omega):
    """Return a copy of the `Point` with another circular frequency (rad/s)."""
    return Point(omega, point.force, point.gap, point.restitution, point.limit)


@jit_inline
def divide_complex(a, b):
    """Return a/b, complex.

    The result is infinite or nan if b is 0 (an undamped mode at resonance), for which numba's own
    division raises an error.
    """
    size = b.real * b.real + b.imag * b.imag
    value = a * complex(b.real, -b.imag)
    return complex(value.real / size, value.imag / size)


@jit
def compute_receptance(structure, omega):
    """Return the complex receptance H (m/N) and dH/domega (m s/N) at ``omega`` (rad/s).

    H exp(i omega t) is the displacement of the tip under the force exp(i omega t) (N).
    """
    value = 0j
    slope = 0j
    for i in range(structure.omega.shape[0]):
        below = (
            structure.omega[i] * structure.omega[i] - omega * omega + 1j * structure.rate[i] * omega
        )
        share = divide_complex(complex(structure.tip[i] * structure.push[i], 0.0), below)
        value += share
        slope -= divide_complex(share * complex(-2.0 * omega, structure.rate[i]), below)
    return value, slope
