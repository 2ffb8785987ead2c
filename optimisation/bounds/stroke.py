"""A limit that no device in a cavity can beat, in closed form.

A mass m_a moves in a cavity of half-clearance g0; r = its displacement minus that of its place, |r(t)| <= g0 at all times. The beam is linear, so
the spectral line at the forcing frequency Omega of a stationary response is q = f A + B r, whatever the other lines do (`optimisation.bounds.lines`,
which also has the sum over several masses). A signal that never leaves [-g0, g0] has at most the line of a square wave:
|r| = 2 |mean of r(t) exp(-i Omega t)| <= 2 g0 mean|cos| = 4 g0/pi = R. The best devices can do with the phases of their r is to oppose f A, and
all other lines only add to the mean square. Therefore, at any place of the beam,

    RMS(q) >= max(0, f |A| - sum_k |B_k| R_k) / sqrt(2).

What is assumed: a linear beam with these modes; a harmonic force of constant amplitude and frequency; a stationary response
(periodic, modulated or chaotic, RMS and line taken over the same long time); devices that act on the beam only at their
places and only through their own masses; rigid walls (compliant ones let |r| exceed g0). Active devices are included. The response
level of a sweep is another quantity, a windowed RMS around a maximum while the frequency moves: it lies near a stationary RMS, but
nothing keeps it above this limit. Where "cannot be beaten" is the claim, compare with stationary runs.

That a device is passive does not sharpen the limit of the level at its own place. A passive device feeds no power into the beam, and the beam only
dissipates at all other lines, so Im(r conj(q)) <= 0 at this one. The best r above makes q = (1 - s) f A, r = -s f A/B and s = R |B|/|f A| < 1, so
Im(r conj(q)) = s (1 - s) |f A|^2 Im(B)/|B|^2, and Im(B) = Im(kappa)/|1 - kappa|^2 <= 0 because the free beam is passive itself. Read at another
place the best stroke may feed power into the beam; `optimisation.bounds.relaxation` solves the problem with both constraints.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from impact_env.frequency import frequency_range
from impact_env.modes import ModalModel
from impact_env.parameters import require
from optimisation.bounds.lines import lines, masses_of, strokes_of, stuck_frequencies, watched

Real = NDArray[np.float64]

SWEPT = (0.9, 1.06)  # of the resonance frequency, the paper's sweep limits

GRID = 321


def _amplitudes(name: str, values: ArrayLike) -> Real:
    array = np.asarray(values, dtype=np.float64)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, "finite numbers, 0 or above")
    return array


def line_terms(model: ModalModel, mass: ArrayLike, gap: ArrayLike, omega: ArrayLike, at: ArrayLike | None = None) -> tuple[Real, Real, Real]:
    """Return |A| in m/N and sum |B_k| R_k in m, of omega's shape, and the scale that both are to be multiplied by (`lines.Lines`)."""
    found = lines(model, masses_of(model, mass), omega, watched(model, at))
    return np.abs(found.force), np.asarray(np.abs(found.strokes) @ strokes_of(model, gap)), found.scale


def _rms(force: ArrayLike, terms: tuple[Real, Real, Real]) -> Real:
    by_force, reach, scale = terms
    excess = np.asarray(force) * by_force - reach
    return np.asarray(np.where(excess > 0, excess, 0.0) * np.where(excess > 0, scale, 1.0) / np.sqrt(2))


def stroke_limit_rms(
    model: ModalModel, mass: ArrayLike, gap: ArrayLike, force_amplitude: ArrayLike, omega: ArrayLike, at: ArrayLike | None = None
) -> Real:
    """Return the lower bound of the stationary RMS displacement in m, of the broadcast shape of force and frequency.

    ``mass`` m_a in kg and ``gap`` g0 in m, (n,) each if the model has the places of n absorbers; ``force_amplitude`` f in N, ``omega`` in rad/s;
    ``at``: mode shape (N_m,) of the place whose displacement is meant, in 1/sqrt(kg), the model's tip by default. The module's docstring has the
    derivation and the assumptions. Multiplying gaps and force by one factor multiplies the bound by it. Raises ParameterError for numbers out of
    range.
    """
    return _rms(_amplitudes("force_amplitude", force_amplitude), line_terms(model, mass, gap, omega, at))


def resonance_limit(
    model: ModalModel,
    mass: ArrayLike,
    gap: ArrayLike,
    force: ArrayLike,
    resonance: int = 1,
    low: float = SWEPT[0],
    high: float = SWEPT[1],
    at: ArrayLike | None = None,
) -> Real:
    """Return the largest `stroke_limit_rms` in m over low..high times omega_r, of force's shape.

    ``force`` in N; the other arguments as in `stroke_limit_rms`. No device keeps the largest of its stationary levels over the range
    below it; a sweep's level is a windowed RMS in passing and is only expected to follow it.
    """
    forces = _amplitudes("force", force)
    omega_r, (low, high) = model.resonance_omega(resonance), frequency_range(low, high)
    stuck = stuck_frequencies(model, masses_of(model, mass)) / omega_r
    # the limit is largest where the masses move with the beam, however narrow that resonance is
    grid = np.union1d(np.linspace(low, high, GRID), stuck[(stuck > low) & (stuck < high)])
    terms = line_terms(model, mass, gap, grid * omega_r, at)
    found = []
    for amplitude in forces.ravel().tolist():
        limits = _rms(amplitude, terms)
        value = float(limits.max())
        if np.isfinite(value):
            value = -smallest(lambda x, f=amplitude: -float(_rms(f, line_terms(model, mass, gap, x * omega_r, at))), grid, -limits)[0]  # type: ignore[misc]
        found.append(value)
    return np.array(found).reshape(forces.shape)


def smallest(function: Callable[[float], float], grid: Real, values: Real) -> tuple[float, float]:
    """Return the smallest value of a function, refined around the smallest of its ``values`` on ``grid``, and where it is."""
    at = int(np.argmin(values))
    on_grid = (float(values[at]), float(grid[at]))
    if at in (0, len(grid) - 1):
        return on_grid
    bounds = (float(grid[at - 1]), float(grid[at + 1]))
    found = minimize_scalar(function, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return min(on_grid, (float(found.fun), float(found.x)))
