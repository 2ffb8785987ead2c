"""Curves of folds, broken symmetry, doubled periods and tori over the frequency and a second parameter.

The events' conditions are joined by one more: with the derivative M of the return map, of half a
period for a symmetric orbit, a matrix A(M) is singular. It is M - I at a fold, M + I where the
symmetry breaks or the period doubles, and at a torus the second compound of M, whose eigenvalues
are the products of two multipliers, less I (Kuznetsov, Elements of Applied Bifurcation Theory,
2004, chapter 10). The condition is A's smallest singular value with the sign of its determinant:
smooth where it vanishes, and finite where an impact gets as slow as a graze and M grows without
bounds.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.bifurcations import (
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    TORUS,
    compute_half_difference,
    compute_multipliers,
    confirmed_bifurcation,
    kinds_of_birth,
    largest_half_difference,
)
from impact_env.periodic.branch import (
    FOLD,
    INTERRUPTED,
    KINK,
    MINIMUM_STEP,
    Branch,
    Monitor,
    NoConvergenceError,
    Residual,
    SpecialPoint,
)
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import (
    ContinuationChart,
    ContinuationProblem,
    PointProgress,
    Steps,
    follow_branch,
)
from impact_env.periodic.green import (
    ALL_PARAMETERS,
    Conditions,
    NoOrbit,
    Solution,
    linear_states,
    make_solution,
    read_unknowns,
)
from impact_env.periodic.motion import Motion, derivative_of, motion_of
from impact_env.periodic.orbit import (
    Orbit,
    confirmed,
    drop_held,
    is_consistent,
    order_of_motion,
    packed,
)
from impact_env.periodic.orbit_branches import (
    GRAZING,
    PARAMETER_SHARE,
    PULLING,
    OrbitBranch,
    OrbitContinuation,
    Scheduled,
    compute_size,
    follow_to_both_sides,
    located_schedules,
    make_place,
    mirror_places,
    solution_in,
)
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.shooting import units_of

Array = NDArray[np.float64]
CURVE_KINDS = (FOLD, SYMMETRY_BREAKING, PERIOD_DOUBLING, TORUS)
SECOND_PARAMETERS = tuple(name for name in ALL_PARAMETERS if name != "omega")
RESONANCE = "strong resonance"
END_OF_FREQUENCIES = "end of the frequencies"
CURVE_STEPS = Steps(first=0.02, least=1e-7, most=0.2, points=600)
# of a curve's points: with so many on another one it is that, begun from another order of reversals
SAME_CURVE_SHARE = 0.9
# in rad, and of the largest impulse: halves of an orbit that differ less get equal where a step
# cannot be made any more
EQUAL_HALVES_TOL = 0.02
DOUBLE_MULTIPLIER_TOL = (
    1e-4  # how close to 1 or -1 two multipliers are that meet there: the root of their rounding
)
MATRIX_DIFFERENCE_STEP = 1e-6  # of the unknowns' scales, for the derivatives of A


def second_compound(matrix: Array) -> Array:
    """Return the second compound (n (n - 1)/2,)^2 of a matrix (n, n): its minors of two rows and two columns."""
    i, j = np.triu_indices(len(matrix), 1)
    return np.asarray(
        matrix[np.ix_(i, i)] * matrix[np.ix_(j, j)] - matrix[np.ix_(i, j)] * matrix[np.ix_(j, i)]
    )


@dataclass(frozen=True, eq=False)
class DefiningSystem:
    """The conditions of a bifurcation as a residual(y, value) over a parameter: unknowns y (m + 1,) are those of the orbit, and omega in rad/s."""

    case: Case
    schedule: EventSchedule
    kind: str
    parameter: str
    scale: Array  # (m + 2,) of all unknowns and the parameter
    limits: tuple[float, float]

    def matrix(self, x: Array) -> Array:
        """Return A at all unknowns and the parameter (m + 2,), in units of gap and gap times the start's frequency.

        Beyond its limits the parameter may have no meaning, as a restitution above 1: A is that at
        the limit.
        """
        if not x[-2] > 0:
            return np.full((1, 1), np.nan)
        solution = solution_in(
            self.case,
            self.schedule,
            x[:-2],
            {"omega": float(x[-2]), self.parameter: float(np.clip(x[-1], *self.limits))},
        )
        units = units_of(self.case)
        derivative = derivative_of(solution) * units / units[:, None]
        matrix = second_compound(derivative) if self.kind == TORUS else derivative
        return matrix + (-1.0 if self.kind in (FOLD, TORUS) else 1.0) * np.eye(len(matrix))

    def __call__(self, y: Array, value: float) -> tuple[Array, Array]:
        """Return the residual (m + 1,) and its derivatives (m + 1, m + 2)."""
        residual, jacobian = Conditions(self.case, self.schedule).over(
            y[:-1], {"omega": float(y[-1]), self.parameter: value}
        )
        x = np.append(y, value)
        last = np.full(len(x), np.nan)
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(matrix := self.matrix(x)))):
            return np.append(residual, np.nan), np.vstack([jacobian, last])
        left, sizes, right = np.linalg.svd(matrix)
        sign = float(
            np.linalg.slogdet(left)[0] * np.linalg.slogdet(right)[0]
        )  # that of A's own determinant is lost to rounding on the curve
        for k, step in enumerate(MATRIX_DIFFERENCE_STEP * self.scale):
            shift = step * np.eye(len(x))[k]
            last[k] = (
                left[:, -1]
                @ (self.matrix(x + shift) - self.matrix(x - shift))
                @ right[-1]
                / (2 * step)
            )
        return np.append(residual, sign * sizes[-1]), np.vstack([jacobian, sign * last])


@dataclass(eq=False)
class CurveContinuation(OrbitContinuation):
    """What the continuation of a bifurcation needs to know on its way."""

    kind: str = FOLD
    size: float = 1.0  # of the parameter
    limits: tuple[float, float] = (0.0, np.inf)
    frequencies: tuple[float, float] = (0.0, np.inf)
    start: Solution | None = None

    @property
    def scale(self) -> Array:
        """Of the unknowns (m + 1,) with the schedule in use."""
        return np.append(np.ones(self.schedule.unknowns), PARAMETER_SHARE * self.case.omega)

    def solution(self, z: Array, value: float) -> Solution:
        """See `OrbitContinuation`."""
        return solution_in(
            self.case, self.schedule, z[:-1], {"omega": float(z[-1]), self.parameter: value}
        )

    def residual(self) -> Residual:
        """See `OrbitContinuation`."""
        return DefiningSystem(
            self.case,
            self.schedule,
            self.kind,
            self.parameter,
            np.append(self.scale, self.size),
            self.limits,
        )

    def monitors(self) -> tuple[Monitor, ...]:
        """See `OrbitContinuation`. Behind grazing the orbit is none, but the curve may come back, and is followed."""
        low, high = self.frequencies
        values = (
            Monitor(GRAZING, self.clearance),
            Monitor(PULLING, lambda z, value: self.weakest(z[:-1], value), ends=True),
            Monitor(
                END_OF_FREQUENCIES,
                lambda z, _value: float((z[-1] - low) * (high - z[-1]) / self.case.omega**2),
                ends=True,
            ),
        )
        alike = tuple(
            Monitor(kind, partial(self._along_start, side))
            for side, kind in kinds_of_birth(self.schedule)
        )
        return (
            (*values, *alike, Monitor(RESONANCE, self._apart, ends=True))
            if self.kind == TORUS
            else (*values, *alike)
        )

    def _along_start(self, side: float, z: Array, value: float) -> float:
        """Return by how much the halves differ in the way in which they do at the start: zero where they get alike, and maybe elsewhere."""
        assert self.start is not None
        here = compute_half_difference(self.solution(z, value), side)
        reference = compute_half_difference(self.start, side)
        return (
            float(here @ reference)
            if len(here) == len(reference) and np.all(np.isfinite(reference))
            else np.nan
        )

    def _apart(self, z: Array, value: float) -> float:
        """Return a function of the torus's pair that is zero where it meets at 1 or -1; behind that it is real, and no torus."""
        matrix = self.motion(z, value).derivative
        return (
            float(
                4
                - np.sum(_find_reciprocal_pair(np.linalg.eigvals(matrix).astype(complex))).real ** 2
            )
            if np.all(np.isfinite(matrix))
            else np.nan
        )

    def recentre(self, z: Array, value: float, along: Array) -> ContinuationChart | None:
        """See `OrbitContinuation`.

        Newton's method for orbits fails at a fold. The curve's own Newton iteration therefore
        starts from the event order of the motion.
        """
        self.passed.append(self.schedule)
        motion = self.motion(z, value)
        case = motion.solution.case
        if case.friction_limit == 0 or self.right(motion, along) or not motion.fits:
            return None
        schedule, phases = drop_held(motion) if is_consistent(motion) else order_of_motion(motion)
        if schedule == self.schedule or schedule.impacts != self.schedule.impacts:
            return None
        guess = make_solution(case, schedule, linear_states(case, schedule, phases), 0.0)
        self.schedule = schedule
        return self.chart(guess, float(z[0]), (case.omega,), self.scale)


@dataclass(frozen=True, eq=False)
class BifurcationCurve(Scheduled):
    """A curve of bifurcations of a ``kind`` over the frequency and another parameter: ``branch.parameter``, with its values in ``branch.parameters``.

    A `FOLD` located on it is where the curve turns in the other parameter.
    """

    kind: str

    def at(self, schedule: EventSchedule, z: Array, value: float) -> Solution:
        """See `Scheduled`; the frequency is the last unknown."""
        return solution_in(
            self.case, schedule, z[:-1], {"omega": float(z[-1]), self.branch.parameter: value}
        )

    @property
    def omega(self) -> Array:
        """Frequencies (m,) in rad/s."""
        return np.array([y[-1] for y in self.branch.points])

    @cached_property
    def orbits(self) -> tuple[Orbit | NoOrbit, ...]:
        """Each point's orbit, confirmed by the exact method and with a multiplier on the unit circle, or why it is none."""
        return tuple(
            self._confirmed(motion_of(self.solution(k))) for k in range(len(self.schedules))
        )

    @cached_property
    def located(self) -> tuple[tuple[str, Orbit | NoOrbit], ...]:
        """Kind and orbit, or why it is none, of each place located on the curve."""
        return tuple(
            (kind, self._confirmed(motion_of(solution)))
            for kind, solution in self.places()
            if kind != KINK
        )

    def _confirmed(self, motion: Motion) -> Orbit | NoOrbit:
        """Return the orbit at a point of the curve, or why there is none; a torus ends where its two multipliers meet at 1 or -1."""
        values = compute_multipliers(motion)
        if self.kind == TORUS and values is not None:
            ends = [np.sum(np.abs(values - side) < DOUBLE_MULTIPLIER_TOL) for side in (1.0, -1.0)]
            if max(ends) > 1:
                return confirmed(motion)
        return confirmed_bifurcation(self.kind, motion)

    def critical(self, k: int) -> complex:
        """Return the multiplier on the unit circle at point ``k``, over the schedule's span: 1, -1, or of a torus's pair the one above."""
        multipliers = np.linalg.eigvals(derivative_of(self.solution(k))).astype(complex)
        if self.kind == TORUS:
            first, second = _find_reciprocal_pair(multipliers)
            return complex(first if first.imag > 0 else second)
        return complex(
            multipliers[np.argmin(np.abs(multipliers - (1 if self.kind == FOLD else -1)))]
        )

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings; values of the parameter in SI units, orbits as `packed` has them."""
        places = [
            {
                "kind": kind,
                "omega_ratio": at.case.omega_ratio,
                "value": self._value(at),
                "orbit": _describe_orbit(at),
            }
            for kind, at in self.located
        ]
        first = self.schedules[0]
        return {
            "kind": self.kind,
            "parameter": self.branch.parameter,
            "period": first.period_multiple,
            "symmetric": first.symmetric,
            "closed": self.branch.closed,
            "ended": self.branch.message,
            "omega_ratio": (self.omega / float(self.case.model.omega[0])).tolist(),
            "value": self.branch.parameters.tolist(),
            "multiplier": [
                [m.real, m.imag] for m in map(self.critical, range(len(self.schedules)))
            ],
            "orbit": [_describe_orbit(orbit) for orbit in self.orbits],
            "located": places,
            "orbits": packed(self.orbits),
        }

    def _value(self, at: Orbit | NoOrbit) -> float:
        return float(getattr(at.case, self.branch.parameter))


def _describe_orbit(orbit: Orbit | NoOrbit) -> str:
    """Return "yes" for an orbit, and why it is none otherwise."""
    return "yes" if isinstance(orbit, Orbit) else orbit.reason


def _find_reciprocal_pair(multipliers: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the two multipliers (2,) whose product is next to 1."""
    first, second = np.triu_indices(len(multipliers), 1)
    k = int(np.argmin(np.abs(multipliers[first] * multipliers[second] - 1)))
    return np.array([multipliers[first[k]], multipliers[second[k]]], dtype=complex)


def bifurcation_curve(
    solution: Solution,
    kind: str,
    parameter: str,
    limits: tuple[float, float],
    frequencies: tuple[float, float],
    steps: Steps = CURVE_STEPS,
    progress: PointProgress | None = None,
) -> BifurcationCurve:
    """Return the curve of bifurcations through one of ``kind`` next to a solution, over the frequency (limits in rad/s) and ``parameter``.

    It is followed to both sides, and ends at its limits, where a wall would have to pull, where a
    torus's multipliers meet, on the curve of broken symmetry or doubled periods that it begins on,
    or where it is back at its start; Ctrl-C ends it with what is known so far. Raises
    NoConvergenceError if there is no such bifurcation here, ParameterError for bad input.
    """
    require(kind in CURVE_KINDS, "kind", kind, f"one of {', '.join(CURVE_KINDS)}")
    require(
        parameter in SECOND_PARAMETERS,
        "parameter",
        parameter,
        f"one of {', '.join(SECOND_PARAMETERS)}",
    )
    for limit in limits:
        solution.case.changed(**{parameter: limit})  # raises where it is not allowed

    def one_way(direction: float) -> tuple[Branch, list[EventSchedule]]:
        value = float(getattr(solution.case, parameter))
        size = PARAMETER_SHARE * compute_size(parameter, value, limits)
        walk = CurveContinuation(
            solution.case,
            parameter,
            solution.schedule,
            kind=kind,
            size=size,
            limits=limits,
            frequencies=frequencies,
            start=solution,
        )
        problem = ContinuationProblem(
            walk.residual(), parameter, walk.scale, size, limits, walk.monitors(), walk.recentre
        )
        way = follow_branch(
            problem,
            np.append(read_unknowns(solution), solution.case.omega),
            value,
            direction,
            steps,
            progress,
        )
        schedules = walk.schedules(solution.schedule, len(way))
        way = _explain_end(way, solution.case, schedules)
        return way, schedules[: len(way)]

    return BifurcationCurve(solution.case, *follow_to_both_sides(one_way), kind)


def _explain_end(way: Branch, case: Case, schedules: Sequence[EventSchedule]) -> Branch:
    """Return a way that ends where both halves of its orbits get alike, on the curve of the bifurcation there.

    It breaks down there, or passes over to the orbits' mirror images.
    """
    for side, kind in kinds_of_birth(schedules[0]):
        at = {"omega": float(way.points[-1][-1]), way.parameter: float(way.parameters[-1])}
        if (
            way.ended == MINIMUM_STEP
            and largest_half_difference(
                solution_in(case, schedules[-1], way.points[-1][:-1], at), side
            )
            < EQUAL_HALVES_TOL
        ):
            way = replace(way, ended=kind)
        for event, schedule in zip(
            way.located, located_schedules(way.located, list(schedules)), strict=True
        ):
            at = {"omega": float(event.point[-1]), way.parameter: event.parameter}
            if (
                event.kind == kind
                and largest_half_difference(solution_in(case, schedule, event.point[:-1], at), side)
                < EQUAL_HALVES_TOL
            ):
                points = (*way.points[: event.after + 1], event.point)
                values = np.append(way.parameters[: event.after + 1], event.parameter)
                way = Branch(
                    way.parameter,
                    points,
                    values,
                    tuple(each for each in way.located if each.after < event.after),
                    kind,
                    "",
                )
                break
        if way.ended == kind:
            message = (
                f"{kind} at {way.parameter} = {way.parameters[-1]:.10g}, on whose curve it begins"
            )
            return replace(way, message=message, located=_drop_kind(way.located, kind))
        way = replace(way, located=_drop_kind(way.located, kind))
    return way


def _drop_kind(located: Iterable[SpecialPoint], kind: str) -> tuple[SpecialPoint, ...]:
    return tuple(event for event in located if event.kind != kind)


def bifurcation_curves(
    branches: Iterable[OrbitBranch],
    kinds: Sequence[str],
    parameter: str,
    limits: tuple[float, float],
    frequencies: tuple[float, float],
    progress: Callable[[str, int, float], None] | None = None,
) -> Iterator[BifurcationCurve]:
    """Yield the curves of ``kinds`` through what was located on branches in frequency, each once; see `bifurcation_curve`.

    The last one has ended as `INTERRUPTED` after Ctrl-C. A place from which Newton's method does
    not come to a curve is left out, and so is a curve on which no point is an orbit.
    """
    known: list[tuple[BifurcationCurve, Array]] = []
    for branch in branches:
        for kind in kinds:
            for solution in branch.starts(kind):
                size = PARAMETER_SHARE * compute_size(
                    parameter, getattr(solution.case, parameter), limits
                )
                here = getattr(solution.case, parameter) / size
                if any(
                    curve.kind == kind
                    and has_same_form(curve, solution)
                    and mirror_places(places, solution, here)
                    for curve, places in known
                ):
                    continue
                show = None if progress is None else partial(progress, f"{kind} {len(known) + 1}")
                try:
                    curve = bifurcation_curve(
                        solution, kind, parameter, limits, frequencies, progress=show
                    )
                except NoConvergenceError:
                    continue
                at = [
                    (curve.solution(k), float(value) / size)
                    for k, value in enumerate(curve.branch.parameters)
                ]
                others = [
                    places
                    for other, places in known
                    if other.kind == kind and has_same_form(other, solution)
                ]
                known.append(
                    (curve, np.array([[*make_place(result), value] for result, value in at]))
                )
                stopped = curve.branch.ended == INTERRUPTED
                if not stopped and not any(isinstance(orbit, Orbit) for orbit in curve.orbits):
                    continue
                if any(
                    np.mean([mirror_places(places, result, value) for result, value in at])
                    > SAME_CURVE_SHARE
                    for places in others
                ):
                    continue
                yield curve
                if stopped:
                    return


def has_same_form(curve: BifurcationCurve, solution: Solution) -> bool:
    """Return whether orbits of a curve have the period and the symmetry of a solution."""
    first = curve.schedules[0]
    other = solution.schedule
    return first.symmetric == other.symmetric and first.period_multiple == other.period_multiple
