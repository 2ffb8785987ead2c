"""The symmetric orbit with one impact at each wall in closed form, and its fold force.

Isolas are born or merge at extrema of the fold force over the frequency; folds are at frequencies
where it equals the force.
"""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import require
from impact_env.kernels.periodic.closed_form import (
    compute_fold,
    compute_line,
    compute_phase,
    fill_fold_forces,
    solve_impulses,
)
from impact_env.periodic.case import Case
from impact_env.periodic.schedule import EventSchedule, flying_schedule

Array = NDArray[np.float64]
BIRTH = "birth"
MERGER = "merger"
# points of a map
LEAST_GRID_POINTS = 1001
MOST_GRID_POINTS = 100001
POINTS_PER_RESONANCE = 20  # points in the narrowest resonance
DIFFERENCE_STEP = (
    1e-4  # relative step of the differences by which a level place of the map is found
)


def symmetric_schedule(friction: bool) -> EventSchedule:
    """Return one impact on the lower wall in each half period, and its mirror image."""
    return flying_schedule([-1], friction, symmetric=True)


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """One branch of the closed form.

    ``impulse`` (N s) is that on the absorber at the lower wall, and ``phase`` (rad) is that of the
    force at this impact.
    """

    case: Case
    impulse: float
    phase: float

    @property
    def pushes(self) -> bool:
        """Whether the wall pushes; if it does not, there is no orbit."""
        return self.impulse > 0


def closed_form(case: Case) -> tuple[ClosedForm, ...]:
    """Return the branches with the smaller and the larger impulse, or none below the fold force.

    The friction force is assumed to have one sign between impacts. The motion between impacts is
    not checked; `impact_env.periodic.orbit` does this.
    """
    line = compute_line(case.structure, case.point)
    roots = solve_impulses(line, case.force)
    return tuple(
        ClosedForm(case, p, compute_phase(line, case.force, p)) for p in roots if np.isfinite(p)
    )


def fold_force(case: Case, omegas: ArrayLike) -> Array:
    """Return the smallest force (M,) in N with a symmetric orbit at frequencies (M,) in rad/s.

    It follows from the discriminant of the closed form.
    """
    at = np.ascontiguousarray(omegas, dtype=float)
    out = np.empty((len(at), 2))
    fill_fold_forces(case.structure, case.point, at, out)
    return out[:, 0]


def fold_impulse(case: Case) -> float:
    """Return the impulse (N s) at the fold of the case's frequency.

    If it is not above 0, the wall would pull and no orbit exists.
    """
    return float(compute_fold(compute_line(case.structure, case.point))[1])


def map_frequencies(case: Case, low: float, high: float) -> Array:
    """Return frequencies (M,) in rad/s between two ratios of the first resonance.

    Their spacing resolves the narrowest resonance.
    """
    require(
        0 < low < high,
        "frequency range",
        (low, high),
        "two ratios of the first resonance above 0, the lower one first",
    )
    width = max(float(np.min(case.model.damping_ratio)), 1e-6) * low
    points = int(
        np.clip(POINTS_PER_RESONANCE * (high - low) / width, LEAST_GRID_POINTS, MOST_GRID_POINTS)
    )
    return np.asarray(np.linspace(low, high, points) * float(case.model.omega[0]))


def find_level_places(case: Case, low: float, high: float) -> tuple[tuple[str, float, float], ...]:
    """Return minima and maxima of the closed form's fold force at which the wall pushes.

    Each is a kind, a force (N) and a frequency (rad/s).
    """
    omegas = map_frequencies(case, low, high)
    forces = fold_force(case, omegas)
    rise = np.diff(forces)
    result = []
    for k in _changes_of_sign(rise) + 1:
        omega = _level(case, omegas[k - 1], omegas[k + 1])
        at = case.changed(omega=omega)
        if fold_impulse(at) > 0:
            result.append(
                (BIRTH if rise[k] >= 0 else MERGER, float(fold_force(at, [omega])[0]), omega)
            )
    return tuple(result)


def _changes_of_sign(values: Array) -> NDArray[np.intp]:
    """Return k (K,) where the sign of values (M,) changes between k and k + 1.

    0 counts as positive. Values that are not finite have no sign.
    """
    below = values < 0
    known = np.isfinite(values)
    return np.flatnonzero((below[:-1] != below[1:]) & known[:-1] & known[1:])


def _level(case: Case, low: float, high: float) -> float:
    """Return the frequency (rad/s) between two at which the fold force has zero slope.

    The slope is computed by differences of fourth order.
    """

    def slope(omega: float) -> float:
        h = DIFFERENCE_STEP * omega * min(1.0, (high - low) / (2 * DIFFERENCE_STEP * omega))
        f = fold_force(case, omega + h * np.array([-2.0, -1.0, 1.0, 2.0]))
        return float(f[0] - 8 * f[1] + 8 * f[2] - f[3])

    wide = 0.5 * (high - low)
    low = low - 0.1 * wide
    high = high + 0.1 * wide
    if slope(low) * slope(high) > 0:
        return 0.5 * (low + high)
    return float(scipy.optimize.brentq(slope, low, high, xtol=1e-14 * high))


def closed_folds(case: Case, low: float, high: float) -> tuple[float, ...]:
    """Return the frequencies (rad/s) of the closed form's folds at the case's force.

    At these frequencies the fold force equals the case's force, and the wall pushes.
    """
    omegas = map_frequencies(case, low, high)
    above = fold_force(case, omegas) - case.force

    def excess(omega: float) -> float:
        return float(fold_force(case, [omega])[0]) - case.force

    result = []
    for k in _changes_of_sign(above):
        omega = float(
            scipy.optimize.brentq(
                excess, omegas[k], omegas[k + 1], xtol=1e-15 * omegas[k], rtol=1e-15
            )
        )
        if fold_impulse(case.changed(omega=omega)) > 0:
            result.append(omega)
    return tuple(result)
