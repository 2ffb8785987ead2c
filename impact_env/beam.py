"""Hermite Euler-Bernoulli beam: parameters to mass and stiffness matrices (paper, section 2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import Beam

Real = NDArray[np.float64]

_STIFFNESS = np.array([[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0], [-12.0, -6.0, 12.0, -6.0], [6.0, 2.0, -6.0, 4.0]])
_MASS = np.array([[156.0, 22.0, 54.0, -13.0], [22.0, 4.0, 13.0, -3.0], [54.0, 13.0, 156.0, -22.0], [-13.0, -3.0, -22.0, 4.0]]) / 420


def _by_element(beam: Beam, name: str) -> Real:
    """Return a value of each element, (N_e,): its section's, or the beam's own."""
    values = np.full(beam.elements, getattr(beam, name))
    first = 0
    for section in beam.sections:
        values[first : first + section.elements] = getattr(section, name)
        first += section.elements
    return values


def free(beam: Beam) -> NDArray[np.int64]:
    """Return which of the 2 N_e + 2 deflections and rotations, node by node from the left, the ends leave free."""
    size = 2 * beam.elements + 2
    left, right = beam.ends.split("-")
    held = {"clamped": {0, 1}, "pinned": {0}, "free": set()}[left] | {"clamped": {size - 2, size - 1}, "pinned": {size - 2}, "free": set()}[right]
    return np.array([k for k in range(size) if k not in held])


def matrices(beam: Beam) -> tuple[Real, Real]:
    """Return the held beam's mass and stiffness matrices over the freedoms of `free`; 2 N_e of them for a cantilever.

    The freedoms are deflection (m) and rotation (rad) times the element length, node by node from the left, so that all
    entries of one matrix have one unit: kg and N/m. The scaling keeps the eigenproblem well conditioned.
    """
    mass, stiffness = _whole(beam)
    kept = np.ix_(free(beam), free(beam))
    return mass[kept], stiffness[kept]


def base_load(beam: Beam) -> Real:
    """Return M r in kg over the freedoms of `free`: r shifts the whole beam with its supports, which are masses of the beam's ends too."""
    shift = np.zeros(2 * beam.elements + 2)
    shift[0::2] = 1
    return np.asarray((_whole(beam)[0] @ shift)[free(beam)])


def _whole(beam: Beam) -> tuple[Real, Real]:
    """Return mass and stiffness matrices of the beam that nothing holds."""
    element = beam.length / beam.elements
    size = 2 * beam.elements + 2
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for e, (line, bending) in enumerate(zip(_by_element(beam, "mass_per_length"), _by_element(beam, "bending_stiffness"), strict=True)):
        span = slice(2 * e, 2 * e + 4)
        mass[span, span] += _MASS * line * element
        stiffness[span, span] += _STIFFNESS * bending / element**3
    mass[-2, -2] += beam.tip_mass
    return mass, stiffness


def rigid_shapes(beam: Beam) -> Real:
    """Return the motions that bend nothing, as columns over the freedoms of `free`: of a free beam a shift and a turn, of a pinned one the turn."""
    element, nodes = 1 / beam.elements, np.arange(beam.elements + 1)
    shift, turn = np.zeros(2 * beam.elements + 2), np.zeros(2 * beam.elements + 2)
    shift[0::2], turn[0::2], turn[1::2] = 1, nodes * element, element
    return np.column_stack([shift, turn][2 - beam.rigid_motions :])[free(beam)]


def strain_energy(beam: Beam, shapes: Real) -> Real:
    """Return half of v^T K v in J, (S,), for shapes v (., S) in the freedoms of `matrices`, with almost all digits.

    The element's stiffness is 12 a a^T + b b^T with a = (1, 1/2, -1, 1/2) and b = (0, 1, 0, -1). Squares of such differences have nothing
    to cancel, where in K v the large entries of a fine mesh cancel almost entirely.
    """
    nodes = np.zeros((2 * beam.elements + 2, shapes.shape[1]))
    nodes[free(beam)] = shapes
    deflection, rotation = nodes[0::2], nodes[1::2]
    shear = deflection[:-1] - deflection[1:] + (rotation[:-1] + rotation[1:]) / 2
    bend = rotation[:-1] - rotation[1:]
    element, share = beam.length / beam.elements, _by_element(beam, "bending_stiffness") / beam.bending_stiffness
    return np.asarray(0.5 * beam.bending_stiffness / element**3 * np.sum(share[:, None] * (12 * shear**2 + bend**2), axis=0))


def deflection_row(beam: Beam, position: float) -> Real:
    """Return the row that gives the deflection at ``position`` (fraction of the length) from the freedoms of `matrices`."""
    scaled = position * beam.elements
    e = min(int(np.floor(scaled + 1e-12)), beam.elements - 1)
    s = scaled - e
    shapes = [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2]
    row = np.zeros(2 * beam.elements + 2)
    row[2 * e : 2 * e + 4] = shapes
    return row[free(beam)]
