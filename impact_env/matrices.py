"""Mass, damping and stiffness of modes that carry masses, or that a spring and a damper link to one more coordinate.

In the free beam's modal coordinates, where its own matrices are 1, 2 D omega and omega^2 on the diagonal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]


def with_masses(shapes: Real, masses: Real) -> Real:
    """Return the mass matrix (N_m, N_m) of modes that carry ``masses`` (n,) in kg at places with ``shapes`` (n, N_m)."""
    return np.asarray(np.eye(shapes.shape[1]) + (shapes.T * masses) @ shapes)


def with_link(own: Real, factor: float, line: Real) -> Real:
    """Return the stiffness or damping matrix (N_m + 1, N_m + 1) of modes and a coordinate that has none of its own.

    ``own`` (N_m,): that of the modes; ``factor``: of the link, whose stretch is ``line`` (N_m + 1,) times the coordinates.
    """
    return np.asarray(np.diag(np.append(own, 0.0)) + factor * np.outer(line, line))
