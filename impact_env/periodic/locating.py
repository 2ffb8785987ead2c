"""What happens between two points of a branch: folds, branch points, and zeros of monitors, by a root search on the branch itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

from impact_env.periodic.branch import Located, NoConvergenceError, Real, System, corrected, tangent

FOLD, BRANCH_POINT, KINK = "fold", "branch point", "kink"


@dataclass(frozen=True)
class Monitor:
    """A function of (z, parameter) whose zeros are located, and called ``kind``; with ``ends`` the branch ends at the first. NaN: not known here."""

    kind: str
    value: Callable[[Real, float], float]
    ends: bool = False


@dataclass(frozen=True, eq=False)
class Place:
    """A point X (n + 1,) of the branch, its unit tangent, the Jacobian (n, n + 1), and sign and logarithm of the bordered determinant."""

    x: Real
    tangent: Real
    jacobian: Real
    determinant: tuple[float, float]


def determinant(jacobian: Real, along: Real) -> tuple[float, float]:
    """Return sign and logarithm of det [J; t], which is zero only where branches cross."""
    sign, logarithm = np.linalg.slogdet(np.vstack([jacobian, along]))
    return float(sign), float(logarithm)


@dataclass(frozen=True, eq=False)
class Gate:
    """A place that closes the branch when it is met again: the first one, and the first in each set of unknowns (the start's may not come again)."""

    index: int
    system: System
    place: Place

    def returned(self, here: Place, there: Place) -> bool:
        """Return whether the step goes over the place: next to the chord, and Newton's method from there ends in it."""
        chord, first = there.x - here.x, self.place
        if len(chord) != len(first.x) or first.tangent @ chord <= 0:
            return False
        length = float(np.linalg.norm(chord))
        share = float((first.x - here.x) @ chord) / length**2
        nearest = here.x + share * chord
        if not 0 < share <= 1 or np.linalg.norm(first.x - nearest) > 0.3 * length:
            return False
        try:
            at = corrected(self.system, nearest, first.tangent, float(first.tangent @ first.x))
        except NoConvergenceError:
            return False
        return bool(np.linalg.norm(at.x - first.x) <= 1e-6 * (1 + np.linalg.norm(first.x)))


@dataclass(frozen=True, eq=False)
class _Between:
    """The branch between two places, as a function of the share s of the way: Newton's method from a cubic through both."""

    system: System
    here: Place
    there: Place

    def __call__(self, s: float) -> Place:
        """Return the place in the plane across the chord at a share of it; raises NoConvergenceError."""
        chord = self.there.x - self.here.x
        length = float(np.linalg.norm(chord))
        a, b = length * self.here.tangent - chord, chord - length * self.there.tangent
        guess = self.here.x + s * chord + s * (1 - s) * ((1 - s) * a + s * b)
        normal = chord / length
        at = corrected(self.system, guess, normal, float(normal @ self.here.x) + s * length)
        along = tangent(at.jacobian, normal)
        return Place(at.x, along, at.jacobian, determinant(at.jacobian, along))


def _zero(between: _Between, value: Callable[[Place], float], kind: str, after: int) -> tuple[float, Located]:
    """Return the share of the way at which ``value`` changes sign, and what is there."""
    known: dict[float, Place] = {0.0: between.here, 1.0: between.there}

    def at(s: float) -> float:
        if s not in known:
            known[s] = between(s)
        return value(known[s])

    try:
        s = float(scipy.optimize.brentq(at, 0.0, 1.0, xtol=1e-13, rtol=4 * np.finfo(float).eps, maxiter=100))
        if s not in known:
            known[s] = between(s)
        place = known[s]
    except (NoConvergenceError, RuntimeError):
        s, place = 0.0, between.here
    return s, Located(kind, after, *between.system.plain(place.x), place.tangent)


def _crossing(between: _Between, after: int) -> tuple[float, Located]:
    """Return the branch point, or the kink at which the determinant jumps over zero."""
    logarithm = max(between.here.determinant[1], between.there.determinant[1])

    def scaled(place: Place) -> float:
        return place.determinant[0] * float(np.exp(place.determinant[1] - logarithm))

    s, event = _zero(between, scaled, BRANCH_POINT, after)
    smaller = min(abs(scaled(between.here)), abs(scaled(between.there)))
    try:
        jump = min(abs(scaled(between(float(np.clip(s + sign * 1e-6, 0, 1))))) for sign in (-1, 1))
    except NoConvergenceError:
        jump = 0.0
    if smaller > 0 and jump > 0.05 * smaller:
        event = replace(event, kind=KINK)
    return s, event


def located(monitors: tuple[Monitor, ...], system: System, here: Place, there: Place, after: int) -> tuple[Located, ...]:
    """Return what lies between two places, point number ``after`` and the next, in the order of the branch.

    Two zeros of one function in one step cancel and are missed: the continuation's limit on the tangent's turn is there to keep steps short of that.
    """
    between, found = _Between(system, here, there), []
    if here.tangent[-1] * there.tangent[-1] < 0:
        found.append(_zero(between, lambda place: float(place.tangent[-1]), FOLD, after))
    if here.determinant[0] * there.determinant[0] < 0:
        found.append(_crossing(between, after))
    for monitor in monitors:

        def value(place: Place, monitor: Monitor = monitor) -> float:
            return monitor.value(*system.plain(place.x))

        before, behind = value(here), value(there)
        if before * behind < 0 or (behind == 0 and before != 0):
            found.append(_zero(between, value, monitor.kind, after))
    return tuple(event for _, event in sorted(found, key=lambda pair: pair[0]))
