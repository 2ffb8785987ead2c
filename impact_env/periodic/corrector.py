"""Points of a branch by Newton's method: the residual in scaled unknowns, a hyperplane across the branch, and tangents.

X = (z/scale, parameter/parameter scale) has n + 1 entries; arclength is measured in it. See Allgower and Georg, Numerical Continuation Methods
(1990), chapters 2 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require

Real = NDArray[np.float64]
Residual = Callable[[Real, float], tuple[Real, Real]]  # (z (n,), parameter) -> residual (n,), Jacobian (n, n + 1) by z and parameter


class NoConvergenceError(RuntimeError):
    """Newton's method found no point, or one elsewhere; the message says which."""


@dataclass(frozen=True, eq=False)
class System:
    """A residual in scaled unknowns: ``scale`` (n + 1,), the parameter's last; points are found to ``tolerance`` of 1 + |X|."""

    residual: Residual
    scale: Real
    tolerance: float
    iterations: int

    def scaled(self, z: Real, parameter: float) -> Real:
        """Return X."""
        return np.append(z, parameter) / self.scale

    def plain(self, x: Real) -> tuple[Real, float]:
        """Return z and the parameter."""
        values = x * self.scale
        return values[:-1], float(values[-1])

    def __call__(self, x: Real) -> tuple[Real, Real]:
        """Return residual (n,) and its Jacobian (n, n + 1) by X; raises NoConvergenceError where they are not finite."""
        n = len(x) - 1
        values, jacobian = self.residual(*self.plain(x))
        require(np.shape(values) == (n,) and np.shape(jacobian) == (n, n + 1), "residual", np.shape(jacobian), f"({n},) and ({n}, {n + 1})")
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(jacobian))):
            raise NoConvergenceError("the residual is not finite")
        return values, jacobian * self.scale


@dataclass(frozen=True, eq=False)
class Corrected:
    """A point X of the branch, the Jacobian there (by X), and how many steps it took."""

    x: Real
    jacobian: Real
    iterations: int


def _solved(matrix: Real, right: Real) -> Real:
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:  # exactly at a branch point, where the branch itself still is well defined
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def corrected(system: System, guess: Real, normal: Real, offset: float | None = None) -> Corrected:
    """Return the point of the branch in the plane normal . X = ``offset`` (None: through the guess); raises NoConvergenceError.

    The step's size decides, and the residual need not have a scale: once a step is below the root of the tolerance the next one,
    quadratically smaller, is the last.
    """
    x = guess.copy()
    offset = float(normal @ guess) if offset is None else offset
    last, close = np.inf, False
    for iteration in range(1, system.iterations + 1):
        values, jacobian = system(x)
        step = -_solved(np.vstack([jacobian, normal]), np.append(values, normal @ x - offset))
        size = float(np.linalg.norm(step))
        if not np.isfinite(size):
            raise NoConvergenceError("a Newton step is not finite")
        if size > 4 * last + 1e3 * system.tolerance:
            raise NoConvergenceError(f"Newton's steps grow: {last:.1e}, then {size:.1e}")
        x = x + step
        unit = 1 + float(np.linalg.norm(x))
        if size <= system.tolerance * unit or (close and size <= 10 * system.tolerance * unit):
            return Corrected(x, jacobian, iteration)  # of the last but one point, which is this one to all digits that a tangent needs
        last, close = size, size <= np.sqrt(system.tolerance) * unit
    raise NoConvergenceError(f"no convergence in {system.iterations} Newton steps, the last of {last:.1e}")


def tangent(jacobian: Real, along: Real) -> Real:
    """Return the unit tangent of the branch, in the direction of ``along``."""
    n = len(jacobian)
    found = _solved(np.vstack([jacobian, along]), np.append(np.zeros(n), 1.0))
    size = float(np.linalg.norm(found))
    if not (np.isfinite(size) and size > 0):
        raise NoConvergenceError("the branch has no tangent here")
    return np.asarray(found / size)


def kernel(jacobian: Real, size: int = 1) -> Real:
    """Return orthonormal rows (size, n + 1) that the Jacobian maps to what is next to zero: the tangents at a branch point."""
    return np.asarray(np.linalg.svd(jacobian)[2][-size:])
