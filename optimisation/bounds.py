"""A limit that no device in a cavity can beat, in closed form, and the design rule that follows from it.

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
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from impact_env.modes import ModalModel
from impact_env.parameters import StuckAbsorber, finite, positive, require
from optimisation.response import natural_frequencies, scaled_receptances

Real = NDArray[np.float64]

SWEPT = (0.9, 1.06)  # of the resonance frequency, the paper's sweep limits
NEAR = (0.93, 1.06)  # of the resonance frequency, where `design_force` asks for the limit to be zero

_GRID = 321


def _line_amplitude(gap: float) -> float:
    """Return R = 4 g0/pi in m, the largest spectral line of a signal within +-g0."""
    return 4 * positive("gap", gap) / np.pi


def _amplitudes(name: str, values: ArrayLike) -> Real:
    array = np.asarray(values, dtype=np.float64)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, "finite numbers, 0 or above")
    return array


def _range(low: float, high: float) -> tuple[float, float]:
    low, high = positive("low", low), finite("high", high)
    require(high > low, "high", high, f"above low = {low}")
    return low, high


def _terms(model: ModalModel, mass: float, omega: ArrayLike) -> tuple[Real, Real, Real]:
    """Return |d G_f|, |d kappa| and |d (1 - kappa)|, with the factor d that keeps them finite at an undamped resonance."""
    w = np.asarray(omega, dtype=np.float64)
    d, by_force, by_tip = scaled_receptances(model, w, model.force_shape, model.tip_shape)
    kappa = by_tip * (positive("mass", mass) * w**2)
    return np.abs(by_force), np.abs(kappa), np.abs(d - kappa)


def stroke_limit_rms(model: ModalModel, mass: float, gap: float, force_amplitude: ArrayLike, omega: ArrayLike) -> Real:
    """Return the lower bound of the tip's stationary RMS displacement in m, of the broadcast shape of force and frequency.

    ``mass`` m_a in kg, ``gap`` g0 in m, ``force_amplitude`` f in N, ``omega`` in rad/s. The module's docstring has the derivation and
    the assumptions. Multiplying gap and force by one factor multiplies the bound by it. Raises ParameterError for numbers out of
    range.
    """
    force = _amplitudes("force_amplitude", force_amplitude)
    by_force, kappa, joined = _terms(model, mass, omega)
    excess = np.maximum(0.0, force * by_force - kappa * _line_amplitude(gap))
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
    omega_r, (low, high) = model.resonance_omega(resonance), _range(low, high)
    forces = _amplitudes("force", force)
    stuck = natural_frequencies(model, StuckAbsorber(positive("mass", mass) / model.beam_mass)) / omega_r
    # the limit is largest where the mass moves with the tip, however narrow that resonance is
    grid = np.union1d(np.linspace(low, high, _GRID), stuck[(stuck > low) & (stuck < high)])
    limits = stroke_limit_rms(model, mass, gap, forces.ravel()[:, None], grid * omega_r)
    best = limits.max(axis=1)
    for i, amplitude in enumerate(forces.ravel()):
        if np.isfinite(best[i]):
            best[i] = -_smallest(partial(_negative_limit, model, mass, gap, amplitude, omega_r), grid, -limits[i])
    return np.asarray(best.reshape(forces.shape))


def _negative_limit(model: ModalModel, mass: float, gap: float, force: float, omega_r: float, ratio: float) -> float:
    return -float(stroke_limit_rms(model, mass, gap, force, ratio * omega_r))


def _smallest(function: Callable[[float], float], grid: Real, values: Real) -> float:
    """Return the smallest value of a function, refined around the smallest of its ``values`` on ``grid``."""
    at = int(np.argmin(values))
    if at in (0, len(grid) - 1):
        return float(values[at])
    bounds = (float(grid[at - 1]), float(grid[at + 1]))
    return min(float(values[at]), float(minimize_scalar(function, bounds=bounds, method="bounded", options={"xatol": 1e-10}).fun))


def design_force(model: ModalModel, mass: float, gap: float, resonance: int = 1, low: float = NEAR[0], high: float = NEAR[1]) -> float:
    """Return f* in N, the force at which the limit leaves zero somewhere in low..high times omega_r: min over Omega of |kappa| R/|G_f|.

    ``mass`` m_a in kg, ``gap`` g0 in m. The paper's best operating points of the first two modes, found by simulation, lie close to f*.
    For the paper's beam |kappa|/|G_f| grows with the frequency, so the minimum sits at the lower end of the range, and f* depends on
    where "near the resonance" begins: 1 % of frequency moves it by 2 % at the first mode and by 5 to 6 % at the second. The default
    begins 7 % below the resonance. Raises ParameterError for numbers out of range, and for a range without the resonance of the
    beam with the mass stuck to it, around which the limit is largest.
    """
    omega_r, (low, high) = model.resonance_omega(resonance), _range(low, high)
    size = _line_amplitude(gap)
    stuck = float(natural_frequencies(model, StuckAbsorber(positive("mass", mass) / model.beam_mass))[resonance - 1]) / omega_r
    require(low <= stuck <= high, "range (low, high)", (low, high), f"a range that holds the resonance with the mass stuck, at {stuck:.4f}")

    def needed(ratio: Real) -> Real:
        by_force, kappa, _ = _terms(model, mass, ratio * omega_r)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(by_force > 0, kappa * size / by_force, np.inf))

    grid = np.linspace(low, high, _GRID)
    forces = needed(grid)
    require(bool(np.isfinite(forces.min())), "force_shape", model.force_shape, "a force that moves the tip")
    return _smallest(lambda ratio: float(needed(np.asarray(ratio))), grid, forces)


def design_gap(model: ModalModel, mass: float, force: float, resonance: int = 1, low: float = NEAR[0], high: float = NEAR[1]) -> float:
    """Return the half-clearance g0 in m whose `design_force` is ``force`` (N): f* is proportional to the gap, so no simulation is needed."""
    return positive("force", force) / design_force(model, mass, 1.0, resonance, low, high)
