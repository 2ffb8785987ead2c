"""Motion of a beam with attached masses by matrix exponentials with 40 digits.

It follows from the matrices alone, without events, and for any stiffness.
"""

import numpy as np
from numpy.typing import NDArray

from impact_env.extras import optional
from impact_env.modes import ModalModel

with optional():
    import mpmath

Array = NDArray[np.float64]
DIGITS = 40
TERMS = 24  # of the exponential's series, for an eighth at most


def joined_motion(model: ModalModel, masses: Array, shapes: Array, time: float) -> Array:
    """Return exp(A t) (2 N_m, 2 N_m) of a beam with fixed masses.

    The ``masses`` (p,) in kg are at places with ``shapes`` (p, N_m). Each coordinate is scaled to
    energy.
    """
    with mpmath.workdps(DIGITS):
        mass, damping, stiffness = _beam(model)
        for m, shape in zip(masses, shapes, strict=True):
            row = mpmath.matrix(list(shape))
            mass += mpmath.mpf(float(m)) * row * row.T
        return _motion(mass, damping, stiffness, np.append(model.omega, np.ones(model.modes)), time)


def sprung_motion(
    model: ModalModel, mass: float, stiffness: float, damper: float, time: float, scale: Array
) -> Array:
    """Return exp(A t) (2 N_m + 2, 2 N_m + 2) with an absorber on a spring and a damper.

    The spring is in N/m and the damper in N s/m. Coordinates are multiplied by ``scale``.
    """
    with mpmath.workdps(DIGITS):
        (masses, damping, springs), _ = _with_spring(model, mass, stiffness, damper)
        return _motion(masses, damping, springs, scale, time)


def swinging_tip(model: ModalModel, mass: float, stiffness: float, omega: float) -> complex:
    """Return the tip's complex amplitude (m/N) under a force between absorber and tip.

    The force acts on the absorber and against the tip, at ``omega`` in rad/s.
    """
    with mpmath.workdps(DIGITS):
        (masses, damping, springs), line = _with_spring(model, mass, stiffness, 0.0)
        at = mpmath.mpf(omega)
        moved = mpmath.lu_solve(springs - at**2 * masses + 1j * at * damping, line)
        return complex(sum(mpmath.mpf(float(x)) * moved[i] for i, x in enumerate(model.tip_shape)))


def _beam(model: ModalModel) -> list[mpmath.matrix]:
    """Return mass, damping and stiffness matrices."""
    omega, ratio = (
        [mpmath.mpf(float(x)) for x in row] for row in (model.omega, model.damping_ratio)
    )
    return [
        mpmath.eye(model.modes),
        mpmath.diag([2 * d * w for d, w in zip(ratio, omega, strict=True)]),
        mpmath.diag([w**2 for w in omega]),
    ]


def _with_spring(
    model: ModalModel, mass: float, stiffness: float, damper: float
) -> tuple[list[mpmath.matrix], mpmath.matrix]:
    """Return mass, damping and stiffness matrices, and the column of an internal force.

    The force acts on the absorber and against the tip.
    """
    n = model.modes
    line = mpmath.matrix([*(-model.tip_shape), 1.0])
    whole = [mpmath.mpf(x) * line * line.T for x in (0.0, damper, stiffness)]
    for matrix, part in zip(whole, _beam(model), strict=True):
        matrix[:n, :n] += part
    whole[0][n, n] = mpmath.mpf(mass)
    return whole, line


def _motion(
    mass: mpmath.matrix, damping: mpmath.matrix, stiffness: mpmath.matrix, scale: Array, time: float
) -> Array:
    """Return exp(A t) of displacements and velocities, as floats.

    It is in coordinates times ``scale`` and is computed by scaling and squaring of the Taylor
    series.
    """
    n = mass.rows
    size = 2 * mass.rows
    inverse = mass**-1
    matrix = mpmath.zeros(size)
    matrix[:n, n:] = mpmath.eye(n)
    matrix[n:, :n] = -inverse * stiffness
    matrix[n:, n:] = -inverse * damping
    sides = mpmath.diag([mpmath.mpf(float(x)) for x in scale])
    matrix = sides * matrix * sides**-1 * mpmath.mpf(time)
    halvings = max(0, int(mpmath.ceil(mpmath.log(mpmath.mnorm(matrix, 1), 2)))) + 3
    step = matrix / mpmath.mpf(2) ** halvings
    term = mpmath.eye(size)
    whole = mpmath.eye(size)
    for k in range(1, TERMS):
        term = term * step / k
        whole += term
    for _ in range(halvings):
        whole = whole * whole
    return np.array(whole.tolist(), dtype=float)
