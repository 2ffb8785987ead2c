"""A branch of solutions as data, and Newton's method that finds its points: in scaled unknowns, across a plane; tangents and kernels.

X = (z/scale, parameter/parameter scale) has n + 1 entries; arclength is measured in it. See Allgower and Georg, Numerical Continuation Methods
(1990), chapters 2 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require

Real = NDArray[np.float64]
Residual = Callable[[Real, float], tuple[Real, Real]]  # (z (n,), parameter) -> residual (n,), Jacobian (n, n + 1) by z and parameter

# why a branch ended
CLOSED = "closed"  # it came back to its first point, or to a later one where the unknowns changed: an isola
LIMIT = "limit"  # the parameter's limit
COUNT = "number of points"
MINIMUM_STEP = "minimum step"  # no convergence, or a lost branch, whatever the step
STOPPED = "stopped"  # by Ctrl-C or the caller


def _frozen(values: Any) -> Real:
    array = np.array(values, dtype=np.float64, ndmin=1)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Located:
    """A point of the branch where something happens: ``kind`` is "fold", "branch point", "kink", or that of a monitor.

    It lies behind point number ``after``, or is that point where the root search broke down; ``tangent`` (n + 1,) is in the units of the branch's
    scaled arclength.
    """

    kind: str
    after: int
    point: Real
    parameter: float
    tangent: Real

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _frozen(self.point))
        object.__setattr__(self, "tangent", _frozen(self.tangent))


@dataclass(frozen=True, eq=False)
class Branch:
    """Solutions z of residual(z, parameter) = 0 in the order of arclength, m of them.

    ``points`` m rows (n,), whose length changes where the caller changes its unknowns; ``parameters`` (m,); ``ended`` one of the reasons above or
    the kind of a monitor, and ``message`` the same in words.
    """

    parameter: str
    points: tuple[Real, ...]
    parameters: Real
    located: tuple[Located, ...]
    ended: str
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(_frozen(z) for z in self.points))
        object.__setattr__(self, "parameters", _frozen(self.parameters) if len(self.points) else np.empty(0))
        require(len(self.points) == len(self.parameters), "branch", len(self.parameters), f"as many parameters as points, {len(self.points)}")

    def __len__(self) -> int:
        return len(self.points)

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one again, or a later one at which the unknowns changed."""
        return self.ended == CLOSED

    def of(self, kind: str) -> tuple[Located, ...]:
        """Return what was located of a kind, such as "fold"."""
        return tuple(event for event in self.located if event.kind == kind)

    def joined(self, backward: Branch) -> Branch:
        """Return one branch from a second one that left the same first point the other way: that one turned round, then this one."""
        m = len(backward)
        before = [Located(e.kind, m - 2 - e.after, e.point, e.parameter, -e.tangent) for e in reversed(backward.located)]
        return Branch(
            self.parameter,
            backward.points[:0:-1] + self.points,
            np.concatenate([backward.parameters[:0:-1], self.parameters]),
            (*before, *(replace(e, after=e.after + m - 1) for e in self.located)),
            self.ended if self.ended == backward.ended else f"{backward.ended}; {self.ended}",
            f"at its begin: {backward.message}; at its end: {self.message}",
        )


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
