"""A branch of solutions, Newton's method for its points, and special points between two points.

X = (z/scale, parameter/parameter scale) has n + 1 entries; arclength is measured in X. Points are
computed in planes across the branch; folds, branch points and zeros of monitors are found by a root
search on the branch itself. See Allgower and Georg, Numerical Continuation Methods (1990), chapters
2 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.checks import require

Real = NDArray[np.float64]
Residual = Callable[
    [Real, float], tuple[Real, Real]
]  # (z (n,), parameter) -> residual (n,), Jacobian (n, n + 1) by z and parameter
# why a branch ended
# it came back to its first point, or to a later one where the unknowns changed: an isola
CLOSED = "closed"
PARAMETER_LIMIT = "limit"  # the parameter's limit
POINT_LIMIT = "number of points"
MINIMUM_STEP = "minimum step"  # no convergence, or a lost branch, whatever the step
INTERRUPTED = "stopped"  # by Ctrl-C or the caller
FOLD = "fold"
BRANCH_POINT = "branch point"
KINK = "kink"


@dataclass(frozen=True, eq=False)
class SpecialPoint:
    """A special point of a branch.

    Attributes
    ----------
    kind : str
        "fold", "branch point", "kink", or the kind of a monitor.
    after : int
        Index of the branch's point before it. If the root search failed, the special point is this
        point.
    point : array, (n,)
        Unknowns z.
    parameter : float
        Value of the parameter.
    tangent : array, (n + 1,)
        Unit tangent of the branch in scaled unknowns X.
    """

    kind: str
    after: int
    point: Real
    parameter: float
    tangent: Real


@dataclass(frozen=True, eq=False)
class Branch:
    """Solutions z of residual(z, parameter) = 0, m points in the order of arclength.

    Attributes
    ----------
    parameter : str
        Name of the parameter.
    points : tuple of array, m rows (n,)
        Unknowns. Their number n changes with the event order, for example.
    parameters : array, (m,)
        Values of the parameter.
    located : tuple of SpecialPoint
        Special points on the branch.
    ended : str
        Reason for the end: a constant of this module, or the kind of a monitor.
    message : str
        Reason for the end as text.
    """

    parameter: str
    points: tuple[Real, ...]
    parameters: Real
    located: tuple[SpecialPoint, ...]
    ended: str
    message: str

    def __len__(self) -> int:
        return len(self.points)

    @property
    def closed(self) -> bool:
        """Whether the branch is closed.

        Its last point is then the first one again, or a later one at which the unknowns changed.
        """
        return self.ended == CLOSED

    def of(self, kind: str) -> tuple[SpecialPoint, ...]:
        """Return the located points of a kind, such as "fold"."""
        return tuple(event for event in self.located if event.kind == kind)

    def joined(self, backward: Branch) -> Branch:
        """Return one branch of this branch and one in the other direction.

        ``backward`` starts at the same point. It is reversed and put before this branch.
        """
        m = len(backward)
        before = [
            SpecialPoint(e.kind, m - 2 - e.after, e.point, e.parameter, -e.tangent)
            for e in reversed(backward.located)
        ]
        return Branch(
            self.parameter,
            backward.points[:0:-1] + self.points,
            np.concatenate([backward.parameters[:0:-1], self.parameters]),
            (*before, *(replace(e, after=e.after + m - 1) for e in self.located)),
            self.ended
            if self.ended == backward.ended
            else INTERRUPTED
            if backward.ended == INTERRUPTED
            else f"{backward.ended}; {self.ended}",
            f"at its begin: {backward.message}; at its end: {self.message}",
        )


class NoConvergenceError(RuntimeError):
    """Newton's method found no point, or a point elsewhere; the message says which."""


@dataclass(frozen=True, eq=False)
class ScaledSystem:
    """A residual in scaled unknowns X.

    ``scale`` (n + 1,) has the units of z and of the parameter. Newton's method stops at steps of
    ``tolerance`` times 1 + |X|, and fails after ``iterations`` steps.
    """

    residual: Residual
    scale: Real
    tolerance: float
    iterations: int

    def scaled(self, z: Real, parameter: float) -> Real:
        """Return the scaled unknowns X (n + 1,) of z (n,) and a parameter."""
        return np.append(z, parameter) / self.scale

    def plain(self, x: Real) -> tuple[Real, float]:
        """Return z (n,) and the parameter of scaled unknowns X (n + 1,)."""
        values = x * self.scale
        return values[:-1], float(values[-1])

    def __call__(self, x: Real) -> tuple[Real, Real]:
        """Return the residual (n,) and its Jacobian (n, n + 1) with respect to X.

        Raises NoConvergenceError if they are not finite.
        """
        n = len(x) - 1
        values, jacobian = self.residual(*self.plain(x))
        require(
            np.shape(values) == (n,) and np.shape(jacobian) == (n, n + 1),
            "residual",
            np.shape(jacobian),
            f"({n},) and ({n}, {n + 1})",
        )
        if not (np.all(np.isfinite(values)) and np.all(np.isfinite(jacobian))):
            raise NoConvergenceError("the residual is not finite")
        return values, jacobian * self.scale


def _solve_bordered(matrix: Real, right: Real) -> Real:
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except (
        np.linalg.LinAlgError
    ):  # exactly at a branch point, where the branch itself still is well defined
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def correct_point(
    system: ScaledSystem, guess: Real, normal: Real, offset: float | None = None
) -> tuple[Real, Real, int]:
    """Return the branch's point X in a plane, its Jacobian, and the number of Newton steps.

    The plane is normal . X = ``offset`` (None: the plane through ``guess``). Convergence is judged
    by the size of the steps, so the residual needs no scale: after a step below the root of the
    tolerance, the next step, quadratically smaller, is the last. Raises NoConvergenceError.
    """
    x = guess.copy()
    offset = float(normal @ guess) if offset is None else offset
    last = np.inf
    close = False
    for iteration in range(1, system.iterations + 1):
        values, jacobian = system(x)
        step = -_solve_bordered(
            np.vstack([jacobian, normal]), np.append(values, normal @ x - offset)
        )
        size = float(np.linalg.norm(step))
        if not np.isfinite(size):
            raise NoConvergenceError("a Newton step is not finite")
        if size > 4 * last + 1e3 * system.tolerance:
            raise NoConvergenceError(f"Newton's steps grow: {last:.1e}, then {size:.1e}")
        x = x + step
        unit = 1 + float(np.linalg.norm(x))
        if size <= system.tolerance * unit or (close and size <= 10 * system.tolerance * unit):
            return (
                x,
                jacobian,
                iteration,
            )  # of the last but one point, which is this one to all digits that a tangent needs
        last = size
        close = size <= np.sqrt(system.tolerance) * unit
    raise NoConvergenceError(
        f"no convergence in {system.iterations} Newton steps, the last of {last:.1e}"
    )


def compute_tangent(jacobian: Real, along: Real) -> Real:
    """Return the unit tangent of the branch, in the direction of ``along``."""
    n = len(jacobian)
    result = _solve_bordered(np.vstack([jacobian, along]), np.append(np.zeros(n), 1.0))
    size = float(np.linalg.norm(result))
    if not (np.isfinite(size) and size > 0):
        raise NoConvergenceError("the branch has no tangent here")
    return np.asarray(result / size)


@dataclass(frozen=True)
class Monitor:
    """A function ``value(z, parameter)`` with zeros that are located as points of a ``kind``.

    If ``ends``, the branch ends at the first zero. NaN means that the value is unknown at a point.
    """

    kind: str
    value: Callable[[Real, float], float]
    ends: bool = False


@dataclass(frozen=True, eq=False)
class BranchState:
    """A point X (n + 1,) of the branch with its tangent and Jacobian.

    It has the unit tangent t (n + 1,), the Jacobian J (n, n + 1) with respect to X, and sign and
    logarithm of det [J; t]. The determinant is zero only where branches cross.
    """

    x: Real
    tangent: Real
    jacobian: Real
    determinant: tuple[float, float]


def make_state(x: Real, jacobian: Real, along: Real) -> BranchState:
    """Return the state at a point of the branch, with the tangent in the direction of ``along``."""
    direction = compute_tangent(jacobian, along)
    sign, logarithm = np.linalg.slogdet(np.vstack([jacobian, direction]))
    return BranchState(x, direction, jacobian, (float(sign), float(logarithm)))


@dataclass(frozen=True, eq=False)
class ReturnGate:
    """A point of the branch that closes it when the branch passes it again.

    It is the first point of the branch, or the first point in another set of unknowns, because the
    unknowns of the start may not occur again. ``index`` is its index in the branch.
    """

    index: int
    system: ScaledSystem
    place: BranchState

    def returned(self, before: BranchState, after: BranchState) -> bool:
        """Return whether a step passes this point.

        The point must be close to the chord, and Newton's method must lead from the chord to it.
        """
        chord = after.x - before.x
        first = self.place
        if len(chord) != len(first.x) or first.tangent @ chord <= 0:
            return False
        length = float(np.linalg.norm(chord))
        share = float((first.x - before.x) @ chord) / length**2
        nearest = before.x + share * chord
        if not 0 < share <= 1 or np.linalg.norm(first.x - nearest) > 0.3 * length:
            return False
        try:
            x = correct_point(self.system, nearest, first.tangent, float(first.tangent @ first.x))[
                0
            ]
        except NoConvergenceError:
            return False
        return bool(np.linalg.norm(x - first.x) <= 1e-6 * (1 + np.linalg.norm(first.x)))


@dataclass(frozen=True, eq=False)
class _Between:
    """The branch between two points as a function of the share s of the chord.

    Points are found by Newton's method from a cubic through both points.
    """

    system: ScaledSystem
    begin: BranchState
    end: BranchState

    def __call__(self, s: float) -> BranchState:
        """Return the branch's point in the plane across the chord, at a share of the chord.

        Raises NoConvergenceError.
        """
        chord = self.end.x - self.begin.x
        length = float(np.linalg.norm(chord))
        a = length * self.begin.tangent - chord
        b = chord - length * self.end.tangent
        guess = self.begin.x + s * chord + s * (1 - s) * ((1 - s) * a + s * b)
        normal = chord / length
        x, jacobian, _ = correct_point(
            self.system, guess, normal, float(normal @ self.begin.x) + s * length
        )
        return make_state(x, jacobian, normal)


def _locate_zero(
    between: _Between, value: Callable[[BranchState], float], kind: str, after: int
) -> tuple[float, SpecialPoint]:
    """Return the share of the chord at which ``value`` changes sign, and the point there."""
    known: dict[float, BranchState] = {0.0: between.begin, 1.0: between.end}

    def at(s: float) -> float:
        if s not in known:
            known[s] = between(s)
        return value(known[s])

    try:
        s = float(
            scipy.optimize.brentq(
                at, 0.0, 1.0, xtol=1e-13, rtol=4 * np.finfo(float).eps, maxiter=100
            )
        )
        if s not in known:
            known[s] = between(s)
        place = known[s]
    except (
        NoConvergenceError,
        RuntimeError,
        ValueError,
    ):  # no point, no end of the search, or a value that is not a number on the way
        s = 0.0
        place = between.begin
    return s, SpecialPoint(kind, after, *between.system.plain(place.x), place.tangent)


def _locate_crossing(between: _Between, after: int) -> tuple[float, SpecialPoint]:
    """Return share of the chord and special point where the bordered determinant changes its sign.

    The point is a branch point, or a kink if the determinant jumps.
    """
    logarithm = max(between.begin.determinant[1], between.end.determinant[1])

    def scaled(place: BranchState) -> float:
        return place.determinant[0] * float(np.exp(place.determinant[1] - logarithm))

    s, event = _locate_zero(between, scaled, BRANCH_POINT, after)
    smaller = min(abs(scaled(between.begin)), abs(scaled(between.end)))
    try:
        jump = min(abs(scaled(between(float(np.clip(s + sign * 1e-6, 0, 1))))) for sign in (-1, 1))
    except NoConvergenceError:
        jump = 0.0
    if smaller > 0 and jump > 0.05 * smaller:
        event = replace(event, kind=KINK)
    return s, event


def locate_zeros(
    monitors: tuple[Monitor, ...],
    system: ScaledSystem,
    begin: BranchState,
    end: BranchState,
    after: int,
) -> tuple[SpecialPoint, ...]:
    """Return the zeros of monitors between two points, in the order of the branch.

    ``after`` is the index of the first point, ``begin``. Two zeros of a function in one step are
    missed; the continuation limits the turn of the tangent so that this is rare.
    """
    between = _Between(system, begin, end)
    result = []
    if begin.tangent[-1] * end.tangent[-1] < 0:
        result.append(_locate_zero(between, lambda place: float(place.tangent[-1]), FOLD, after))
    if begin.determinant[0] * end.determinant[0] < 0:
        result.append(_locate_crossing(between, after))
    for monitor in monitors:

        def value(place: BranchState, monitor: Monitor = monitor) -> float:
            return monitor.value(*system.plain(place.x))

        before = value(begin)
        behind = value(end)
        if before * behind < 0 or (behind == 0 and before != 0):
            result.append(_locate_zero(between, value, monitor.kind, after))
    return tuple(event for _, event in sorted(result, key=lambda pair: pair[0]))
