"""Hermite Euler-Bernoulli cantilever: parameters to mass and stiffness matrices (paper, section 2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import Beam

_STIFFNESS = np.array([[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0], [-12.0, -6.0, 12.0, -6.0], [6.0, 2.0, -6.0, 4.0]])
_MASS = np.array([[156.0, 22.0, 54.0, -13.0], [22.0, 4.0, 13.0, -3.0], [54.0, 13.0, 156.0, -22.0], [-13.0, -3.0, -22.0, 4.0]]) / 420


def matrices(beam: Beam) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the clamped beam's mass and stiffness matrices, each (2 N_e, 2 N_e).

    The freedoms are deflection (m) and rotation (rad) times the element length, node by node from the clamped end, so that all
    entries of one matrix have one unit: kg and N/m. The scaling keeps the eigenproblem well conditioned.
    """
    element = beam.length / beam.elements
    size = 2 * beam.elements + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for e in range(beam.elements):
        span = slice(2 * e, 2 * e + 4)
        mass[span, span] += _MASS * beam.mass_per_length * element
        stiffness[span, span] += _STIFFNESS * beam.bending_stiffness / element**3
    return mass[2:, 2:], stiffness[2:, 2:]


def strain_energy(beam: Beam, shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return half of v^T K v in J, (S,), for shapes v (2 N_e, S) in the freedoms of `matrices`, with almost all digits.

    The element's stiffness is 12 a a^T + b b^T with a = (1, 1/2, -1, 1/2) and b = (0, 1, 0, -1). Squares of such differences have nothing
    to cancel, where in K v the large entries of a fine mesh cancel almost entirely.
    """
    nodes = np.concatenate([np.zeros((2, shapes.shape[1])), shapes])
    deflection, rotation = nodes[0::2], nodes[1::2]
    shear = deflection[:-1] - deflection[1:] + (rotation[:-1] + rotation[1:]) / 2
    bend = rotation[:-1] - rotation[1:]
    element = beam.length / beam.elements
    return np.asarray(0.5 * beam.bending_stiffness / element**3 * np.sum(12 * shear**2 + bend**2, axis=0))


def deflection_row(beam: Beam, position: float) -> NDArray[np.float64]:
    """Return the row (2 N_e,) that gives the deflection at ``position`` (fraction of the length) from the freedoms of `matrices`."""
    scaled = position * beam.elements
    e = min(int(np.floor(scaled + 1e-12)), beam.elements - 1)
    s = scaled - e
    shapes = [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2]
    row = np.zeros(2 * beam.elements + 2)
    row[2 * e : 2 * e + 4] = shapes
    return row[2:]
