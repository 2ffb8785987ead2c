"""A limit that no device in a cavity can beat, in closed form.

A mass m_a moves in a cavity of half-clearance g0 at the tip; r = its displacement minus the tip's, |r(t)| <= g0 at all times.
Whatever happens between them, the beam feels minus the mass times its acceleration. The beam is linear, so the spectral line at
the forcing frequency Omega of a stationary response obeys the linear equations on its own, whatever the other lines do:

    q = G_f f + G_t m_a Omega^2 (q + r),        so        q (1 - kappa) = f G_f + kappa r,        kappa = G_t m_a Omega^2,

with the free beam's responses of the tip to the force, G_f, and to a force at the tip, G_t. A signal that never leaves [-g0, g0]
has at most the line of a square wave: |r| = 2 |mean of r(t) exp(-i Omega t)| <= 2 g0 mean|cos| = 4 g0/pi = R. The best a device
can do with the phase of r is to oppose f G_f, and all other lines only add to the mean square. Therefore

    RMS(q_tip) >= max(0, f |G_f| - |kappa| R) / |1 - kappa| / sqrt(2).

What is assumed: a linear beam with these modes; a harmonic force of constant amplitude and frequency; a stationary response
(periodic, modulated or chaotic, RMS and line taken over the same long time); a device that acts on the beam only at the absorber's
position and only through its own mass; rigid walls (compliant ones let |r| exceed g0). Active devices are included. The response
level of a sweep is another quantity, a windowed RMS around a maximum while the frequency moves: it lies near a stationary RMS, but
nothing keeps it above this limit. Where "cannot be beaten" is the claim, compare with stationary runs.

That a device is passive does not sharpen the limit. A passive device feeds no power into the beam, and the beam only dissipates at
all other lines, so Im(r conj(q)) <= 0 at this one. The best r above makes q = (1 - s) A with A = f G_f/(1 - kappa), B = kappa/(1 - kappa),
r = -s A/B and s = R |B/A| < 1, so Im(r conj(q)) = s (1 - s) |A|^2 Im(B)/|B|^2, and Im(B) = Im(kappa)/|1 - kappa|^2 <= 0 because the free
beam is passive itself. `optimisation.bounds.relaxation` solves the problem with both constraints and comes to the same number.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from impact_env.modes import ModalModel
from impact_env.parameters import StuckAbsorber, non_negative, positive, require
from optimisation.response import frequency_range, natural_frequencies, scaled_receptances

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SWEPT = (0.9, 1.06)  # of the resonance frequency, the paper's sweep limits

GRID = 321


def line_amplitude(gap: float) -> float:
    """Return R = 4 g0/pi in m for a gap in m, the largest spectral line of a signal within +-g0."""
    return 4 * positive("gap", gap) / np.pi


def _amplitudes(name: str, values: ArrayLike) -> Real:
    array = np.asarray(values, dtype=np.float64)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, "finite numbers, 0 or above")
    return array


def line_responses(model: ModalModel, mass: float, omega: ArrayLike) -> tuple[Complex, Complex, Complex]:
    """Return d G_f, d kappa and d (1 - kappa), complex, with the factor d that keeps them finite at an undamped resonance."""
    w = np.asarray(omega, dtype=np.float64)
    d, by_force, by_tip = scaled_receptances(model, w, model.force_shape, model.tip_shape)
    kappa = by_tip * (positive("mass", mass) * w**2)
    return by_force, np.asarray(kappa), np.asarray(d - kappa)


def line_terms(model: ModalModel, mass: float, omega: ArrayLike) -> tuple[Real, Real, Real]:
    """Return the absolute values of `line_responses`."""
    by_force, kappa, joined = line_responses(model, mass, omega)
    return np.abs(by_force), np.abs(kappa), np.abs(joined)


def stroke_limit_rms(model: ModalModel, mass: float, gap: float, force_amplitude: ArrayLike, omega: ArrayLike) -> Real:
    """Return the lower bound of the tip's stationary RMS displacement in m, of the broadcast shape of force and frequency.

    ``mass`` m_a in kg, ``gap`` g0 in m, ``force_amplitude`` f in N, ``omega`` in rad/s. The module's docstring has the derivation and
    the assumptions. Multiplying gap and force by one factor multiplies the bound by it. Raises ParameterError for numbers out of
    range.
    """
    force = _amplitudes("force_amplitude", force_amplitude)
    by_force, kappa, joined = line_terms(model, mass, omega)
    excess = np.maximum(0.0, force * by_force - kappa * line_amplitude(gap))
    with np.errstate(divide="ignore"):
        # the joined beam at its own undamped resonance: infinite unless the device can cancel the force
        return np.asarray(np.where(excess > 0, excess / np.where(excess > 0, joined, 1.0), 0.0) / np.sqrt(2))


def resonance_limit(
    model: ModalModel, mass: float, gap: float, force: ArrayLike, resonance: int = 1, low: float = SWEPT[0], high: float = SWEPT[1]
) -> Real:
    """Return the largest `stroke_limit_rms` in m over low..high times omega_r, of force's shape.

    ``force`` in N; the other arguments as in `stroke_limit_rms`. No device keeps the largest of its stationary levels over the range
    below it; a sweep's level is a windowed RMS in passing and is only expected to follow it.
    """
    omega_r, (low, high) = model.resonance_omega(resonance), frequency_range(low, high)
    forces = _amplitudes("force", force)
    found = [_largest(model, mass, gap, float(amplitude), omega_r, low, high) for amplitude in forces.ravel()]
    return np.array([limit for limit, _ in found]).reshape(forces.shape)


def worst_frequency(
    model: ModalModel, mass: float, gap: float, force: float, resonance: int = 1, low: float = SWEPT[0], high: float = SWEPT[1]
) -> float:
    """Return the frequency in rad/s at which `resonance_limit` finds its value; arguments as there, with one force."""
    omega_r, (low, high) = model.resonance_omega(resonance), frequency_range(low, high)
    return _largest(model, mass, gap, non_negative("force", force), omega_r, low, high)[1] * omega_r


def _largest(model: ModalModel, mass: float, gap: float, force: float, omega_r: float, low: float, high: float) -> tuple[float, float]:
    """Return the largest limit in m over low..high times omega_r, and where it is (over omega_r)."""
    stuck = natural_frequencies(model, StuckAbsorber(positive("mass", mass) / model.beam_mass)) / omega_r
    # the limit is largest where the mass moves with the tip, however narrow that resonance is
    grid = np.union1d(np.linspace(low, high, GRID), stuck[(stuck > low) & (stuck < high)])
    limits = stroke_limit_rms(model, mass, gap, force, grid * omega_r)
    if not np.isfinite(limits.max()):
        return np.inf, float(grid[np.argmax(limits)])
    value, at = smallest(partial(_negative_limit, model, mass, gap, force, omega_r), grid, -limits)
    return -value, at


def _negative_limit(model: ModalModel, mass: float, gap: float, force: float, omega_r: float, ratio: float) -> float:
    return -float(stroke_limit_rms(model, mass, gap, force, ratio * omega_r))


def smallest(function: Callable[[float], float], grid: Real, values: Real) -> tuple[float, float]:
    """Return the smallest value of a function, refined around the smallest of its ``values`` on ``grid``, and where it is."""
    at = int(np.argmin(values))
    on_grid = (float(values[at]), float(grid[at]))
    if at in (0, len(grid) - 1):
        return on_grid
    bounds = (float(grid[at - 1]), float(grid[at + 1]))
    found = minimize_scalar(function, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return min(on_grid, (float(found.fun), float(found.x)))
