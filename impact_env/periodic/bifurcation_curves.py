"""Bifurcation curves over the frequency and a second parameter.

The bifurcations are folds, broken symmetry, doubled periods, tori, grazing and loss of contact.

A curve is a branch of solutions of a defining system (`defining_systems`): the conditions of an
orbit and that of the bifurcation. Its unknowns z (m + 1,) are the m unknowns of an orbit, and then
the frequency omega in rad/s. Points at which a second bifurcation condition holds (codimension two)
are located as zeros of the test functions in `codimension_two`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.periodic.bifurcations import (
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    TORUS,
    compute_half_difference,
    compute_multipliers,
    confirmed_bifurcation,
    kinds_of_birth,
    largest_half_difference,
    plus_one_test,
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
from impact_env.periodic.codimension_two import (
    CODIMENSION_TWO,
    ZERO_TOL,
    CriticalPoint,
    codimension_two_monitors,
    is_special,
)
from impact_env.periodic.continuation import (
    ContinuationChart,
    ContinuationProblem,
    PointProgress,
    Steps,
    follow_branch,
)
from impact_env.periodic.defining_systems import (
    DefiningSystem,
    GrazingSystem,
    LossSystem,
    nearest_turn,
    turns_after_first,
)
from impact_env.periodic.grazing import (
    CLEAR_SHARES,
    SMALL_IMPULSES,
    compute_weakest_impulse,
    confirm_nearby,
)
from impact_env.periodic.green import (
    ALL_PARAMETERS,
    NoOrbit,
    Solution,
    linear_states,
    make_solution,
    read_unknowns,
)
from impact_env.periodic.motion import Motion, motion_of
from impact_env.periodic.normal_forms import Vector
from impact_env.periodic.orbit import (
    Orbit,
    confirm_orbit,
    drop_held,
    is_consistent,
    order_of_motion,
    pack_orbits,
)
from impact_env.periodic.orbit_branches import (
    GRAZING,
    PARAMETER_SHARE,
    PULLING,
    OrbitBranch,
    OrbitContinuation,
    ScheduledBranch,
    compute_size,
    follow_to_both_sides,
    located_schedules,
    make_place,
    mirror_places,
    solution_in,
)
from impact_env.periodic.orbit_map import critical_point_of
from impact_env.periodic.schedule import EventSchedule

Array = NDArray[np.float64]
# bifurcations with a multiplier on the unit circle
MULTIPLIER_KINDS = (FOLD, SYMMETRY_BREAKING, PERIOD_DOUBLING, TORUS)
LOSS_OF_CONTACT = "loss of contact"  # an impulse is zero: beyond, the wall would have to pull
CONTACT_KINDS = (GRAZING, LOSS_OF_CONTACT)
CURVE_KINDS = (*MULTIPLIER_KINDS, *CONTACT_KINDS)
GRAZING_FOLD = "grazing-fold"
DOUBLE_GRAZING = "double grazing"
START_KINDS = {LOSS_OF_CONTACT: PULLING}  # kinds that have another name on branches of orbits
TOUCH_DRIFT = 0.05  # rad: change of the grazing phase from which on the residual is replaced
# points of a curve whose normal forms are stored: both ends of a step, and those of the root search
CACHED_POINTS = 4
SECOND_PARAMETERS = tuple(name for name in ALL_PARAMETERS if name != "omega")
END_OF_FREQUENCIES = "end of the frequencies"
CURVE_STEPS = Steps(first=0.02, least=1e-7, most=0.2, points=600)
# share of a curve's points on another curve from which on both are the same curve, followed from
# different orders of reversals
SAME_CURVE_SHARE = 0.9
# rad, and share of the largest impulse: where a curve cannot be continued, halves of an orbit that
# differ by less are taken as equal
EQUAL_HALVES_TOL = 0.02
# distance from 1 or -1 within which two multipliers meet there: the square root of their rounding
DOUBLE_MULTIPLIER_TOL = 1e-4


@dataclass(eq=False)
class CurveContinuation(OrbitContinuation):
    """State of the continuation of a bifurcation curve.

    ``kind`` is the kind of the bifurcation, ``limits`` and ``size`` are the range and the scale of
    the parameter in its SI unit, ``frequencies`` is the range of the frequency in rad/s, ``start``
    the solution at which the curve begins. ``touch`` is the phase (rad after the first event) at
    which a wall is grazed, ``lost`` the number of the impact whose impulse vanishes, from 0.
    """

    kind: str = FOLD
    size: float = 1.0
    limits: tuple[float, float] = (0.0, np.inf)
    frequencies: tuple[float, float] = (0.0, np.inf)
    start: Solution | None = None
    touch: float = 0.0
    lost: int = 0
    points: dict[tuple[EventSchedule, float, bytes], CriticalPoint] = field(default_factory=dict)
    reference: Vector | None = None  # critical vector of the last point passed

    @property
    def scale(self) -> Array:
        """Scales of the unknowns (m + 1,): 1 for those of the orbit, and that of the frequency."""
        return np.append(np.ones(self.schedule.unknowns), PARAMETER_SHARE * self.case.omega)

    def solution(self, z: Array, value: float) -> Solution:
        """Return the solution with unknowns ``z`` (m + 1,) at a ``value`` of the parameter."""
        return solution_in(
            self.case, self.schedule, z[:-1], {"omega": float(z[-1]), self.parameter: value}
        )

    def residual(self) -> Residual:
        """Return the defining system of the bifurcation, with the schedule in use."""
        scale = np.append(self.scale, self.size)
        common = (self.case, self.schedule, self.kind, self.parameter, scale, self.limits)
        if self.kind == GRAZING:
            return GrazingSystem(*common, touch=self.touch)
        if self.kind == LOSS_OF_CONTACT:
            return LossSystem(*common, number=self.lost)
        return DefiningSystem(*common)

    def monitors(self) -> tuple[Monitor, ...]:
        """Return the monitors: special points of the curve, and conditions that end it.

        A wall that would have to pull ends the curve. Grazing does not: beyond it the solutions are
        not orbits, but the curve may return to orbits.
        """
        low, high = self.frequencies
        within = Monitor(
            END_OF_FREQUENCIES,
            lambda z, _value: float((z[-1] - low) * (high - z[-1]) / self.case.omega**2),
            ends=True,
        )
        alike = tuple(
            Monitor(kind, partial(self._along_start, side))
            for side, kind in kinds_of_birth(self.schedule)
        )
        own: tuple[Monitor, ...]
        if self.kind == GRAZING:
            own = (
                Monitor(DOUBLE_GRAZING, self._other_clearance),
                Monitor(PULLING, self._weakest, ends=True),
                Monitor(GRAZING_FOLD, self._fold_test),
            )
        elif self.kind == LOSS_OF_CONTACT:
            own = (
                Monitor(GRAZING, self.clearance),
                Monitor(PULLING, self._weakest_other, ends=True),
            )
        else:
            touched = GRAZING_FOLD if self.kind == FOLD else GRAZING
            own = (
                Monitor(touched, self.clearance),
                Monitor(PULLING, self._weakest, ends=True),
                *codimension_two_monitors(self.kind, self.critical_point),
            )
        return (*own, within, *alike)

    def critical_point(self, z: Array, value: float) -> CriticalPoint:
        """Return multipliers and normal form at a point; the last `CACHED_POINTS` are stored.

        The sign of the critical vector is the one next to the vector at the last point passed, so
        that test functions do not jump.
        """
        key = (self.schedule, value, z.tobytes())
        if key not in self.points:
            if len(self.points) >= CACHED_POINTS:
                del self.points[next(iter(self.points))]
            self.points[key] = critical_point_of(
                self.kind, self.motion(z, value), reference=self.reference
            )
        point = self.points[key]
        if self.reference is None and np.all(np.isfinite(point.forms.matrix)):
            self.reference = point.vectors.right
        return point

    def _weakest(self, z: Array, value: float) -> float:
        """Return the smallest impulse, negative where a wall pulls; see `weakest`."""
        return self.weakest(z[:-1], value)

    def _weakest_other(self, z: Array, _value: float) -> float:
        """Return the smallest impulse except that of impact ``lost``; 1 if there is no other."""
        n = len(self.schedule.events)
        wall = self.schedule.order.wall
        impulses = -wall[wall != 0] * z[n : n + self.schedule.impacts]
        return float(np.min(np.delete(impulses, self.lost), initial=1.0))

    def _other_clearance(self, z: Array, value: float) -> float:
        """Return the smallest distance from a wall, relative to the gap, at all other reversals.

        Reversals of the relative velocity are meant, except the grazing one (``touch``). The result
        is 1 if there is no other, NaN without any reversal.
        """
        solution = self.solution(z, value)
        phases, distances = turns_after_first(solution)
        if len(phases) == 0:
            return np.nan
        k = nearest_turn(phases, self.touch, solution.schedule.turn)
        return float(np.min(np.delete(distances, k), initial=1.0))

    def _fold_test(self, z: Array, value: float) -> float:
        """Return a function that is zero where a multiplier is 1."""
        return plus_one_test(self.motion(z, value))

    def _along_start(self, side: float, z: Array, value: float) -> float:
        """Return the half difference at a point times that at the curve's start (dot product).

        The half difference is `compute_half_difference` with the sign ``side``. The result is zero
        where both halves of the orbit become equal, and possibly elsewhere. It is NaN for another
        number of events than at the start.
        """
        assert self.start is not None
        here = compute_half_difference(self.solution(z, value), side)
        reference = compute_half_difference(self.start, side)
        return (
            float(here @ reference)
            if len(here) == len(reference) and np.all(np.isfinite(reference))
            else np.nan
        )

    def recentre(self, z: Array, value: float, along: Array) -> ContinuationChart | None:
        """Return the unknowns and residual of another order of events if the motion has one.

        Otherwise the result is None, or has a new residual if the grazing phase has moved. The new
        unknowns come from the motion's event times and are not solved for an orbit, because that
        system is singular at a fold; the next Newton iteration of the curve corrects them.
        """
        self.passed.append(self.schedule)
        motion = self.motion(z, value)
        case = motion.solution.case
        moved = False
        if self.kind in MULTIPLIER_KINDS:
            self.reference = self.critical_point(z, value).vectors.right
        elif self.kind == GRAZING:
            moved = self._follow_touch(motion)
        if case.friction_limit == 0 or self.right(motion, along) or not motion.fits:
            return self._same_chart(z, along) if moved else None
        schedule, phases = drop_held(motion) if is_consistent(motion) else order_of_motion(motion)
        if schedule == self.schedule or schedule.impacts != self.schedule.impacts:
            return self._same_chart(z, along) if moved else None
        guess = make_solution(case, schedule, linear_states(case, schedule, phases), 0.0)
        self.schedule = schedule
        return self.chart(guess, float(z[0]), (case.omega,), self.scale)

    def _follow_touch(self, motion: Motion) -> bool:
        """Set ``touch`` to the phase at which a motion grazes the wall, if it differs much.

        Returns whether it has been set (`TOUCH_DRIFT`), so that a new residual is needed.
        """
        solution = motion.solution
        phases, _ = turns_after_first(solution)
        if len(phases) == 0:
            return False
        here = float(phases[nearest_turn(phases, self.touch, solution.schedule.turn)])
        if abs(here - self.touch) < TOUCH_DRIFT:
            return False
        self.touch = here
        return True

    def _same_chart(self, z: Array, along: Array) -> ContinuationChart:
        """Return the unknowns in use, with a residual for the new grazing phase."""
        return ContinuationChart(self.residual(), z, along, self.scale, self.monitors())


@dataclass(frozen=True, eq=False)
class BifurcationCurve(ScheduledBranch):
    """A curve of m bifurcations of a ``kind`` over the frequency and a second parameter.

    The second parameter is ``branch.parameter``, with the values ``branch.parameters`` in its SI
    unit. The special point `FOLD` of the curve is an extremum of the second parameter.
    """

    kind: str

    def at(self, schedule: EventSchedule, z: Array, value: float) -> Solution:
        """Return the solution with unknowns ``z``, the last of which is the frequency (rad/s)."""
        return solution_in(
            self.case, schedule, z[:-1], {"omega": float(z[-1]), self.branch.parameter: value}
        )

    @property
    def omega(self) -> Array:
        """Frequencies (m,) in rad/s."""
        return np.array([y[-1] for y in self.branch.points])

    @cached_property
    def orbits(self) -> tuple[Orbit | NoOrbit, ...]:
        """Orbit at each point, or the reason why there is none, (m,).

        The exact method has confirmed each orbit and its bifurcation: a multiplier on the unit
        circle, the grazing, or the vanishing impulse.
        """
        return tuple(
            self._confirmed(motion_of(self.solution(k))) for k in range(len(self.schedules))
        )

    @cached_property
    def located(self) -> tuple[tuple[str, Orbit | NoOrbit], ...]:
        """Kind of each special point on the curve, and its orbit or the reason why there is none.

        At grazing points the orbit is that of the neighbouring point of the curve with the larger
        distance from the wall. Kinks are left out.
        """
        orbits = []
        for event, (kind, solution) in zip(self.branch.located, self.places(), strict=True):
            if kind == KINK:
                continue
            motion = motion_of(solution)
            if kind in (GRAZING, GRAZING_FOLD, DOUBLE_GRAZING):
                sides = [k for k in (event.after, event.after + 1) if k < len(self.branch)]
                motions = (motion_of(self.solution(k)) for k in sides)
                motion = max(motions, key=lambda motion: motion.clearance)
            orbits.append((kind, self._confirmed(motion)))
        return tuple(orbits)

    def _confirmed(self, motion: Motion) -> Orbit | NoOrbit:
        """Return the orbit at a point of the curve, or the reason why there is none.

        Where two multipliers meet at 1 or -1, only the orbit is confirmed, not the bifurcation:
        there multipliers are accurate to no more than the square root of the rounding error.
        """
        if self.kind == LOSS_OF_CONTACT:
            return confirm_nearby(motion, compute_weakest_impulse, SMALL_IMPULSES)
        if self.kind == GRAZING:
            return confirm_nearby(
                motion, lambda near: near.clearance / near.solution.case.gap, CLEAR_SHARES
            )
        values = compute_multipliers(motion)
        if values is not None:
            ends = [np.sum(np.abs(values - side) < DOUBLE_MULTIPLIER_TOL) for side in (1.0, -1.0)]
            if max(ends) > 1:
                return confirm_orbit(motion)
        return confirmed_bifurcation(self.kind, motion)

    @cached_property
    def critical_points(self) -> tuple[CriticalPoint | None, ...]:
        """Multipliers and normal form of each point, (m,).

        The entries are None on a curve of grazing or loss of contact.
        """
        if self.kind not in MULTIPLIER_KINDS:
            return (None,) * len(self.schedules)
        return tuple(
            critical_point_of(self.kind, motion_of(self.solution(k)))
            for k in range(len(self.schedules))
        )

    def critical(self, k: int) -> complex:
        """Return the multiplier on the unit circle at point ``k``, over the schedule's span.

        It is near 1 or -1, or the one of a torus's pair with positive imaginary part; NaN on a
        curve of grazing or loss of contact.
        """
        point = self.critical_points[k]
        if point is None:
            return complex(np.nan, np.nan)
        values = point.multipliers[point.critical]
        return complex(values[np.argmax(values.imag)])

    def to_plain(self) -> dict[str, Any]:
        """Return the curve as a dictionary of lists, numbers and strings for JSON.

        Values of the parameter are in SI units, frequencies relative to omega_1, and orbits in the
        form of `pack_orbits`.
        """
        events = [event for event in self.branch.located if event.kind != KINK]
        first_resonance = float(self.case.model.omega[0])
        places = [
            {
                "kind": kind,
                "omega_ratio": float(event.point[-1]) / first_resonance,
                "value": event.parameter,
                "orbit": _describe_orbit(at),
            }
            for event, (kind, at) in zip(events, self.located, strict=True)
        ]
        first = self.schedules[0]
        return {
            "kind": self.kind,
            "parameter": self.branch.parameter,
            "period": first.period_multiple,
            "symmetric": first.symmetric,
            "closed": self.branch.closed,
            "ended": self.branch.message,
            "omega_ratio": (self.omega / first_resonance).tolist(),
            "value": self.branch.parameters.tolist(),
            "multiplier": [
                [_finite(m.real), _finite(m.imag)]
                for m in map(self.critical, range(len(self.schedules)))
            ],
            "coefficient": [
                None if point is None else _finite(point.coefficient)
                for point in self.critical_points
            ],
            "criticality": [
                None if point is None else point.criticality for point in self.critical_points
            ],
            "orbit": [_describe_orbit(orbit) for orbit in self.orbits],
            "located": places,
            "orbits": pack_orbits(self.orbits),
        }


def _describe_orbit(orbit: Orbit | NoOrbit) -> str:
    """Return "yes" for an orbit, and otherwise the reason why there is no orbit."""
    return "yes" if isinstance(orbit, Orbit) else orbit.reason


def _finite(value: float) -> float | None:
    """Return a finite value, None for NaN and infinity."""
    return float(value) if np.isfinite(value) else None


def bifurcation_curve(
    solution: Solution,
    kind: str,
    parameter: str,
    limits: tuple[float, float],
    frequencies: tuple[float, float],
    steps: Steps = CURVE_STEPS,
    progress: PointProgress | None = None,
) -> BifurcationCurve:
    """Return the curve of bifurcations of one ``kind`` through the one next to a solution.

    The curve is followed in both directions, while ``parameter`` is within ``limits`` (SI units)
    and the frequency within ``frequencies`` (rad/s). It ends

    - at these limits,
    - where a wall would have to pull,
    - where a torus's multipliers meet at 1 or -1 (strong resonances R1 and R2),
    - where both halves of its orbits become equal: at the curve of broken symmetry or doubled
      periods from which its orbits emerge,
    - where it returns to its start.

    After Ctrl-C the part followed so far is returned. Raises NoConvergenceError if there is no such
    bifurcation near the solution, ParameterError for bad input.
    """
    require(kind in CURVE_KINDS, "kind", kind, f"one of {', '.join(CURVE_KINDS)}")
    require(
        parameter in SECOND_PARAMETERS,
        "parameter",
        parameter,
        f"one of {', '.join(SECOND_PARAMETERS)}",
    )
    for limit in limits:
        solution.case.changed(**{parameter: limit})  # raises ParameterError if not allowed
    touch, lost = _contact_of(solution, kind)

    def one_way(direction: float) -> tuple[Branch, list[EventSchedule]]:
        """Return the part towards larger (1) or smaller (-1) values, and its points' schedules."""
        value = float(getattr(solution.case, parameter))
        size = PARAMETER_SHARE * compute_size(parameter, value, limits)
        continuation = CurveContinuation(
            solution.case,
            parameter,
            solution.schedule,
            kind=kind,
            size=size,
            limits=limits,
            frequencies=frequencies,
            start=solution,
            touch=touch,
            lost=lost,
        )
        problem = ContinuationProblem(
            continuation.residual(),
            parameter,
            continuation.scale,
            size,
            limits,
            continuation.monitors(),
            continuation.recentre,
        )
        part = follow_branch(
            problem,
            np.append(read_unknowns(solution), solution.case.omega),
            value,
            direction,
            steps,
            progress,
        )
        schedules = continuation.schedules(solution.schedule, len(part))
        part = _explain_end(part, solution.case, schedules)
        return part, schedules[: len(part)]

    return _without_false_labels(
        BifurcationCurve(solution.case, *follow_to_both_sides(one_way), kind)
    )


def _contact_of(solution: Solution, kind: str) -> tuple[float, int]:
    """Return the phase of a solution's closest approach to a wall, and its weakest impact's number.

    The phase is in rad after the first event, 0 unless the kind is `GRAZING`. Raises
    NoConvergenceError if the relative velocity then has no reversal.
    """
    touch = 0.0
    if kind == GRAZING:
        phases, distances = turns_after_first(solution)
        if len(phases) == 0:
            raise NoConvergenceError("the relative velocity does not turn between impacts")
        touch = float(phases[np.argmin(distances)])
    hits = solution.schedule.order.wall != 0
    return touch, int(np.argmin(np.abs(solution.impulses[hits])))


def _without_false_labels(curve: BifurcationCurve) -> BifurcationCurve:
    """Return a curve without special points at which a test function is not zero.

    There it has a jump or a pole instead.
    """
    pairs = []
    for event, schedule in zip(curve.branch.located, curve.located_schedules, strict=True):
        if event.kind in CODIMENSION_TWO or (event.kind, curve.kind) == (GRAZING_FOLD, GRAZING):
            motion = motion_of(curve.at(schedule, event.point, event.parameter))
            if event.kind == GRAZING_FOLD:
                if not abs(plus_one_test(motion)) < ZERO_TOL:
                    continue
            elif not is_special(critical_point_of(curve.kind, motion), event.kind):
                continue
        pairs.append((event, schedule))
    return replace(
        curve,
        branch=replace(curve.branch, located=tuple(event for event, _ in pairs)),
        located_schedules=tuple(schedule for _, schedule in pairs),
    )


def _explain_end(branch: Branch, case: Case, schedules: Sequence[EventSchedule]) -> Branch:
    """Return a branch that ends where both halves of its orbits become equal.

    That is at the broken symmetry or doubled period from which its orbits emerge. Beyond it the
    continuation fails, or runs back over the mirror images of the same orbits. The branch is cut
    there, and the reason for its end is the bifurcation's kind. A branch without such a point only
    loses the special points of these kinds.
    """
    for side, kind in kinds_of_birth(schedules[0]):
        at = {"omega": float(branch.points[-1][-1]), branch.parameter: float(branch.parameters[-1])}
        if (
            branch.ended == MINIMUM_STEP
            and largest_half_difference(
                solution_in(case, schedules[-1], branch.points[-1][:-1], at), side
            )
            < EQUAL_HALVES_TOL
        ):
            branch = replace(branch, ended=kind)
        for event, schedule in zip(
            branch.located, located_schedules(branch.located, list(schedules)), strict=True
        ):
            at = {"omega": float(event.point[-1]), branch.parameter: event.parameter}
            if (
                event.kind == kind
                and largest_half_difference(solution_in(case, schedule, event.point[:-1], at), side)
                < EQUAL_HALVES_TOL
            ):
                points = (*branch.points[: event.after + 1], event.point)
                values = np.append(branch.parameters[: event.after + 1], event.parameter)
                branch = Branch(
                    branch.parameter,
                    points,
                    values,
                    tuple(each for each in branch.located if each.after < event.after),
                    kind,
                    "",
                )
                break
        if branch.ended == kind:
            message = (
                f"{kind} at {branch.parameter} = {branch.parameters[-1]:.10g}, on whose curve it "
                "begins"
            )
            return replace(branch, message=message, located=_drop_kind(branch.located, kind))
        branch = replace(branch, located=_drop_kind(branch.located, kind))
    return branch


def _drop_kind(located: Iterable[SpecialPoint], kind: str) -> tuple[SpecialPoint, ...]:
    """Return the special points of all other kinds."""
    return tuple(event for event in located if event.kind != kind)


def bifurcation_curves(
    branches: Iterable[OrbitBranch],
    kinds: Sequence[str],
    parameter: str,
    limits: tuple[float, float],
    frequencies: tuple[float, float],
    progress: Callable[[str, int, float], None] | None = None,
) -> Iterator[BifurcationCurve]:
    """Yield the curves of ``kinds`` through the bifurcations on branches in frequency.

    A curve through several of these bifurcations is yielded once. Bifurcations from which Newton's
    method does not converge to a curve are left out, and so are curves without any orbit. After
    Ctrl-C the last curve has ended as `INTERRUPTED`. ``progress`` is called with the curve's kind
    and number, its number of points and the parameter's value; the other arguments are those of
    `bifurcation_curve`.
    """
    known: list[tuple[BifurcationCurve, Array]] = []
    for branch in branches:
        for kind in kinds:
            for solution in branch.starts(START_KINDS.get(kind, kind)):
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
    """Return whether the orbits of a curve have the symmetry and period of a solution.

    The period is counted in periods of the force.
    """
    first = curve.schedules[0]
    other = solution.schedule
    return first.symmetric == other.symmetric and first.period_multiple == other.period_multiple
