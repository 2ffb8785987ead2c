"""The fold force over the frequency, in closed form: where it is level isolas are born or merge, its level set at a force are the folds."""

from __future__ import annotations

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.case import Case
from impact_env.periodic.symmetric import fold_force, fold_impulse

Array = NDArray[np.float64]
BIRTH, MERGER = "birth", "merger"
FEWEST, MOST = 1001, 100001  # points of a map
FINE = 20  # points in the narrowest resonance
STEP = 1e-4  # relative step of the differences by which a level place of the map is found


def map_frequencies(case: Case, low: float, high: float) -> Array:
    """Return frequencies (M,) in rad/s between two ratios of the first resonance's, fine enough for the narrowest resonance."""
    require(0 < low < high, "frequency range", (low, high), "two ratios of the first resonance above 0, the lower one first")
    width = max(float(np.min(case.model.damping_ratio)), 1e-6) * low
    points = int(np.clip(FINE * (high - low) / width, FEWEST, MOST))
    return np.asarray(np.linspace(low, high, points) * float(case.model.omega[0]))


def level_places(case: Case, low: float, high: float) -> tuple[tuple[str, float, float], ...]:
    """Return kind, force (N) and frequency (rad/s) of the valleys and ridges of the closed form's fold force where the wall pushes."""
    omegas = map_frequencies(case, low, high)
    forces = fold_force(case, omegas)
    rise = np.diff(forces)
    found = []
    for k in np.flatnonzero(rise[:-1] * rise[1:] < 0) + 1:
        omega = _level(case, omegas[k - 1], omegas[k + 1])
        at = case.changed(omega=omega)
        if fold_impulse(at) > 0:
            found.append((BIRTH if rise[k] > 0 else MERGER, float(fold_force(at, [omega])[0]), omega))
    return tuple(found)


def _level(case: Case, low: float, high: float) -> float:
    """Return the frequency (rad/s) between two at which the fold force is level, by differences of fourth order."""

    def slope(omega: float) -> float:
        h = STEP * omega * min(1.0, (high - low) / (2 * STEP * omega))
        f = fold_force(case, omega + h * np.array([-2.0, -1.0, 1.0, 2.0]))
        return float(f[0] - 8 * f[1] + 8 * f[2] - f[3])

    wide = 0.5 * (high - low)
    low, high = low - 0.1 * wide, high + 0.1 * wide
    if slope(low) * slope(high) > 0:
        return 0.5 * (low + high)
    return float(scipy.optimize.brentq(slope, low, high, xtol=1e-14 * high))


def closed_folds(case: Case, low: float, high: float) -> tuple[float, ...]:
    """Return the frequencies (rad/s) of the closed form's folds at the case's force: the level set of the fold force, where the wall pushes."""
    omegas = map_frequencies(case, low, high)
    above = fold_force(case, omegas) - case.force

    def excess(omega: float) -> float:
        return float(fold_force(case, [omega])[0]) - case.force

    found = []
    for k in np.flatnonzero(above[:-1] * above[1:] < 0):
        omega = float(scipy.optimize.brentq(excess, omegas[k], omegas[k + 1], xtol=1e-15 * omegas[k], rtol=1e-15))
        if fold_impulse(case.changed(omega=omega)) > 0:
            found.append(omega)
    return tuple(found)
