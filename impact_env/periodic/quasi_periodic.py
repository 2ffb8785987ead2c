"""Rotation number of an invariant circle in a stroboscopic section, with its convergence.

The points of a quasi-periodic motion, one for each period of the force, lie on a closed curve and
move along it by a constant share of a turn on average: the rotation number. The mean of the angles'
increments with the weight exp(-1/(t (1 - t))) converges faster than any power of the number of
points (Das, Saiki, Sander, Yorke, Nonlinearity 30, 2017). On a chaotic motion its error only falls
with the square root of the number of points, so the difference between both halves of the points
distinguishes the two kinds of motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, require

Array = NDArray[np.float64]
LEAST_POINTS = 32  # on a circle
MOST_CIRCLES = 8  # a torus around an orbit of several periods has as many circles
MOST_DIRECTIONS = 4  # principal directions of the points whose planes are tried
FLAT_TOL = 1e-9  # of the widest direction: the points have no extent in a direction below
HOLE_TOL = 0.05  # of the mean radius: a curve that comes closer to its centre does not surround it
GAP_TOL = 0.3  # rad: least gap between the increments of a curve that surrounds its centre
LOCKED_TOL = 1e-7  # turns: a rotation number so close to a fraction is that fraction


@dataclass(frozen=True)
class RotationNumber:
    """Rotation number of a motion around its invariant circle.

    Attributes
    ----------
    value : float
        Turns around the circle for each return to it, 0 to 0.5: the sense of rotation is left out.
    change : float
        Difference of the rotation numbers of the first and the second half of the points.
    circles : int
        Number of circles in the section; the motion returns to each after as many periods of the
        force.
    """

    value: float
    change: float
    circles: int = 1


def rotation_number(points: Array, most_circles: int = MOST_CIRCLES) -> RotationNumber | None:
    """Return the rotation number of the points of a stroboscopic section.

    Parameters
    ----------
    points : array_like, (n, d)
        States, one for each period of the force, in comparable units.
    most_circles : int, optional
        Largest number of circles on which the points may lie.

    Returns
    -------
    RotationNumber or None
        None if the points surround no centre in any plane of their principal directions.

    Raises
    ------
    ParameterError
        Fewer than 32 points, or a value that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from impact_env.periodic import rotation_number
    >>> angle = 2 * np.pi * 0.381966 * np.arange(400)
    >>> rotation = rotation_number(np.column_stack([3 * np.cos(angle), np.sin(angle)]))
    >>> round(rotation.value, 6)
    0.381966
    """
    points = np.asarray(points, dtype=np.float64)
    allowed = f"a finite array of two dimensions with {LEAST_POINTS} points or more"
    ok = points.ndim == 2 and len(points) >= LEAST_POINTS and bool(np.all(np.isfinite(points)))
    require(ok, "points", points.shape, allowed)
    most_circles = count("most_circles", most_circles, 1)
    circles = 1
    while circles <= most_circles and len(points) // circles >= LEAST_POINTS:
        rotation = _rotation_on_circle(points[::circles])
        if rotation is None:
            return None
        value, change = rotation
        # the least denominator of a fraction that the rotation number is equal to
        denominators = range(1, most_circles // circles + 1)
        errors = ((d, abs(value * d - round(value * d))) for d in denominators)
        locked = next((d for d, error in errors if error < LOCKED_TOL * d), None)
        if locked == 1 or (locked is not None and circles * locked > most_circles):
            return None
        if locked is None:
            return RotationNumber(value, change, circles)
        circles *= locked
    return None


def _rotation_on_circle(points: Array) -> tuple[float, float] | None:
    """Return the rotation number and its change, or None if none is found.

    They are computed in the first plane in which the points (n, d) surround their centre.
    """
    centred = points - points.mean(axis=0)
    left, sizes, _ = np.linalg.svd(centred, full_matrices=False)
    directions = min(MOST_DIRECTIONS, int(np.sum(sizes > FLAT_TOL * sizes[0])))
    for one, other in combinations(range(directions), 2):
        plane = left[:, one] + 1j * left[:, other]
        radii = np.abs(plane)
        if np.min(radii) <= HOLE_TOL * np.mean(radii):
            continue
        increments = _lifted_increments(np.angle(plane))
        if increments is not None:
            break
    else:
        return None
    half = len(increments) // 2
    whole, first, second = (
        _compute_birkhoff_average(part) / (2 * np.pi)
        for part in (increments, increments[:half], increments[half:])
    )
    value = abs(whole) % 1
    return min(value, 1 - value), abs(first - second)


def _lifted_increments(angles: Array) -> Array | None:
    """Return the increments (n - 1,) of angles (n,) in rad, continuous across whole turns.

    On a curve that surrounds its centre the increments vary by less than a turn, so the widest gap
    between them is where a turn is added. The result is None if the increments fill the whole turn.
    """
    increments = np.diff(angles) % (2 * np.pi)
    ordered = np.sort(increments)
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    if gaps[widest] < GAP_TOL:
        return None
    cut = ordered[widest] + gaps[widest] / 2
    return np.asarray((increments - cut) % (2 * np.pi) + cut)


def _compute_birkhoff_average(values: Array) -> float:
    """Return the weighted Birkhoff average of values (n,).

    It is their mean with the weight exp(-1/(t (1 - t))) at t = k/(n + 1), k from 1.
    """
    t = np.arange(1, len(values) + 1) / (len(values) + 1)
    weight = np.exp(-1 / (t * (1 - t)))
    return float(weight @ values / weight.sum())
