"""A branch as a frequency response, for reports and figures.

It is independent of the method that computed the branch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.periodic.bifurcations import ON_CIRCLE, confirmed_bifurcation, critical_multipliers
from impact_env.periodic.branch import FOLD, KINK, Branch
from impact_env.periodic.codimension_two import LABELS
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import OMEGA_PARAMETER, Balance, hill_multipliers
from impact_env.periodic.motion import Motion, motion_of, stability_of
from impact_env.periodic.orbit import pack_orbits
from impact_env.periodic.orbit_branches import CHECKED_KINDS, OrbitBranch
from impact_env.periodic.orbit_map import critical_point_of

Real = NDArray[np.float64]
EXACT = "exact orbits"
HARMONIC_BALANCE = "harmonic balance"
SAME_POINT_TOL = (
    1e-9  # of the frequency: two places of one kind are one, met on both mirror images of a branch
)


@dataclass(frozen=True)
class CurvePoint:
    """A special point of a curve.

    Attributes
    ----------
    kind : str
        "fold", "torus" or another kind.
    omega_ratio, tip_max : float
        Frequency ratio, and largest displacement in m.
    multipliers : tuple of complex
        Multipliers on the unit circle, empty if unknown.
    coefficient, criticality : float and str, or None
        Coefficient of the normal form, and whether the bifurcation is supercritical, see
        `impact_env.periodic.codimension_two.CriticalPoint`. None if unknown.
    """

    kind: str
    omega_ratio: float
    tip_max: float
    multipliers: tuple[complex, ...] = ()
    coefficient: float | None = None
    criticality: str | None = None

    def to_plain(self) -> dict[str, Any]:
        """Return the point as a dict.

        Keys contain their units, and multipliers are pairs of a real and an imaginary part.
        """
        plain: dict[str, Any] = {
            "kind": self.kind,
            "omega_ratio": self.omega_ratio,
            "tip_max_m": self.tip_max,
        }
        if self.multipliers:
            plain["multipliers"] = [[m.real, m.imag] for m in self.multipliers]
        if self.coefficient is not None:
            plain |= {"coefficient": self.coefficient, "criticality": self.criticality}
        return plain


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Tip displacement along a branch with m points.

    Attributes
    ----------
    method : str
        Name of the method.
    omega_ratio : array, (m,)
        Frequency ratios.
    tip_max, tip_rms : array, (m,)
        Largest displacement and RMS in m, NaN at points without an orbit.
    located : tuple of CurvePoint
        Special points.
    closed : bool
        Whether the branch is closed.
    message : str
        Reason for the end of the branch.
    stable, slowly_stable : array of bool, (m,), or None
        Whether all multipliers, and whether the slow ones lie inside the unit circle; None if the
        method does not compute them.
    refused : tuple of (str, int)
        Reasons of points without an orbit, and the number of points of each.
    period : int
        Period in periods of the force.
    symmetric : bool
        Whether each half of an orbit is the mirror image of the other.
    orbits : dict or None
        The points' orbits in the form of `pack_orbits`, None if the method has none.
    """

    method: str
    omega_ratio: Real
    tip_max: Real
    tip_rms: Real
    located: tuple[CurvePoint, ...]
    closed: bool
    message: str
    stable: NDArray[np.bool_] | None = None
    slowly_stable: NDArray[np.bool_] | None = None
    refused: tuple[tuple[str, int], ...] = ()
    period: int = 1
    symmetric: bool = True
    orbits: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        rows = [
            row
            for row in (
                self.omega_ratio,
                self.tip_max,
                self.tip_rms,
                self.stable,
                self.slowly_stable,
            )
            if row is not None
        ]
        require(
            len({len(row) for row in rows}) == 1,
            "curve",
            [len(row) for row in rows],
            "rows of one length",
        )

    @property
    def folds(self) -> tuple[CurvePoint, ...]:
        """Turning points in the frequency."""
        return tuple(point for point in self.located if point.kind == FOLD)

    @property
    def peak(self) -> CurvePoint | None:
        """The point with the largest displacement, None if no point is an orbit."""
        if not np.any(np.isfinite(self.tip_max)):
            return None
        k = int(np.nanargmax(self.tip_max))
        return CurvePoint("peak", float(self.omega_ratio[k]), float(self.tip_max[k]))

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings by name, with units in the names.

        None stands for NaN.
        """
        rows = {
            "omega_ratio": self.omega_ratio,
            "tip_max_m": self.tip_max,
            "tip_rms_m": self.tip_rms,
        }
        plain: dict[str, Any] = {
            "method": self.method,
            "closed": self.closed,
            "ended": self.message,
            "period": self.period,
            "symmetric": self.symmetric,
        }
        plain["peak"] = None if self.peak is None else self.peak.to_plain()
        plain["located"] = [point.to_plain() for point in self.located]
        plain["refused"] = [{"reason": reason, "points": number} for reason, number in self.refused]
        plain |= {
            name: [float(x) if np.isfinite(x) else None for x in row] for name, row in rows.items()
        }
        for name, truths in (("stable", self.stable), ("slowly_stable", self.slowly_stable)):
            plain[name] = None if truths is None else truths.tolist()
        return plain | {"orbits": self.orbits}

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> ResponseCurve:
        """Return the curve of the plain values of `to_plain`.

        Raises KeyError, TypeError or ValueError for any other data.
        """
        names = ("omega_ratio", "tip_max_m", "tip_rms_m")
        ratio, largest, rms = (
            np.array([np.nan if x is None else x for x in plain[name]], dtype=np.float64)
            for name in names
        )
        marks = tuple(
            CurvePoint(
                mark["kind"],
                mark["omega_ratio"],
                mark["tip_max_m"],
                tuple(complex(*pair) for pair in mark.get("multipliers", ())),
                mark.get("coefficient"),
                mark.get("criticality"),
            )
            for mark in plain["located"]
        )
        stable, slowly = (
            None if plain[name] is None else np.array(plain[name], dtype=np.bool_)
            for name in ("stable", "slowly_stable")
        )
        refused = tuple((each["reason"], each["points"]) for each in plain["refused"])
        more = plain.get("period", 1), plain.get("symmetric", True), plain.get("orbits")
        return ResponseCurve(
            plain["method"],
            ratio,
            largest,
            rms,
            marks,
            plain["closed"],
            plain["ended"],
            stable,
            slowly,
            refused,
            *more,
        )


def balance_curve(
    balance: Balance, branch: Branch, reference: float, hill: bool = False
) -> ResponseCurve:
    """Return the frequency response of a branch of harmonic balance.

    Frequencies are relative to ``reference`` in rad/s. ``hill``: compute the stability by
    `hill_multipliers`, which do not converge at rigid walls; raises ParameterError if the law has
    none.
    """
    solutions = [
        (balance.at(OMEGA_PARAMETER, p), z)
        for z, p in zip(branch.points, branch.parameters, strict=True)
    ]
    responses = [at.response(z) for at, z in solutions]
    marks = tuple(
        CurvePoint(
            e.kind,
            e.parameter / reference,
            balance.at(OMEGA_PARAMETER, e.parameter).response(e.point).tip_max,
        )
        for e in branch.located
    )
    largest, rms = (
        np.array([getattr(r, name) for r in responses]) for name in ("tip_max", "tip_rms")
    )
    period = getattr(balance.linear, "multiple", 1)
    return ResponseCurve(
        HARMONIC_BALANCE,
        branch.parameters / reference,
        largest,
        rms,
        marks,
        branch.closed,
        branch.message,
        np.array([abs(hill_multipliers(at, z)[0]) < 1 + ON_CIRCLE for at, z in solutions])
        if hill
        else None,
        period=period,
        symmetric=balance.symmetric,
    )


def orbit_curve(
    orbits: OrbitBranch, reference: float, folds: Iterable[Motion] | None = None
) -> ResponseCurve:
    """Return the frequency response of a branch of exact orbits.

    Each point is propagated by the exact method, and is NaN if this method does not confirm it. The
    abscissa is the branch's parameter over ``reference``. ``folds``: motions at the branch's folds
    if known; None: those located on the branch.
    """
    result = list(orbits.orbits())
    refused = dict[str, int]()
    values = np.array([(np.nan, np.nan, 0.0, 0.0)] * len(result))
    for k, orbit in enumerate(result):
        if isinstance(orbit, NoOrbit):
            refused[orbit.reason] = refused.get(orbit.reason, 0) + 1
        else:
            values[k] = (
                orbit.motion.tip_max,
                orbit.motion.tip_rms,
                orbit.stability.stable,
                orbit.stability.slowly_stable,
            )
    marks = list[CurvePoint]()
    for kind, motion in _marks(orbits, folds):
        mark = CurvePoint(
            kind,
            getattr(motion.solution.case, orbits.branch.parameter) / reference,
            motion.tip_max,
            _critical(kind, motion),
            *_normal_form(kind, motion),
        )
        if not any(
            mark.kind == known.kind and abs(mark.omega_ratio - known.omega_ratio) < SAME_POINT_TOL
            for known in marks
        ):
            marks.append(mark)
    truths = values[:, 2:].astype(np.bool_)
    branch = orbits.branch
    return ResponseCurve(
        EXACT,
        branch.parameters / reference,
        values[:, 0],
        values[:, 1],
        tuple(marks),
        branch.closed,
        branch.message,
        truths[:, 0],
        truths[:, 1],
        tuple(refused.items()),
        orbits.schedules[0].period_multiple,
        orbits.schedules[0].symmetric,
        pack_orbits(result),
    )


def _critical(kind: str, motion: Motion) -> tuple[complex, ...]:
    """Return the multipliers over the schedule's span that cause the bifurcation of a ``kind``.

    The result is empty at a special point that is no bifurcation.
    """
    if kind not in CHECKED_KINDS:
        return ()
    result = critical_multipliers(kind, stability_of(motion).multipliers)
    return tuple(complex(m) for m in result)


def _normal_form(kind: str, motion: Motion) -> tuple[float | None, str | None]:
    """Return coefficient and criticality of a bifurcation.

    Both are None at a place that is no bifurcation or has no normal form.
    """
    if kind not in LABELS:
        return None, None
    point = critical_point_of(kind, motion)
    finite = np.isfinite(point.coefficient)
    return (point.coefficient if finite else None), point.criticality


def _marks(orbits: OrbitBranch, folds: Iterable[Motion] | None) -> Iterator[tuple[str, Motion]]:
    """Yield kind and motion of the special points that are orbits.

    Folds are computed to full accuracy by Newton's method.
    """
    if folds is None:
        reached_folds = (fold for fold in orbits.folds() if not isinstance(fold, NoOrbit))
        folds = (
            fold.motion
            for fold in reached_folds
            if not isinstance(confirmed_bifurcation(FOLD, fold.motion), NoOrbit)
        )
    yield from ((FOLD, motion) for motion in folds)
    places = sorted(orbits.places(), key=lambda place: place[0])
    for kind, solution in places:
        if kind not in (FOLD, KINK):
            yield kind, motion_of(solution)
