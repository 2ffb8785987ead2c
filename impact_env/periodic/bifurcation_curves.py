"""Bifurcation curves over the frequency and a second parameter.

They are curves of folds, broken symmetry, doubled periods, tori, grazing and loss of contact.

Each is a branch of the conditions in `defining_systems`. Special points on it, at which a second
condition is met, are located as zeros of the test functions in `codimension_two`.
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
MULTIPLIER_KINDS = (FOLD, SYMMETRY_BREAKING, PERIOD_DOUBLING, TORUS)  # with one on the unit circle
LOSS_OF_CONTACT = "loss of contact"  # an impact without speed: behind it a wall would have to pull
CONTACT_KINDS = (GRAZING, LOSS_OF_CONTACT)
CURVE_KINDS = (*MULTIPLIER_KINDS, *CONTACT_KINDS)
GRAZING_FOLD = "grazing-fold"
DOUBLE_GRAZING = "double grazing"
START_KINDS = {LOSS_OF_CONTACT: PULLING}  # where a branch has another name for it
TOUCH_DRIFT = 0.05  # rad: how far a place of touching moves before the residual has its new place
CACHED_POINTS = (
    4  # of a curve, with their normal forms: the two ends of a step, and the root search's own
)
SECOND_PARAMETERS = tuple(name for name in ALL_PARAMETERS if name != "omega")
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


@dataclass(eq=False)
class CurveContinuation(OrbitContinuation):
    """State of the continuation of a bifurcation curve.

    ``kind`` is the kind of the bifurcation, ``size`` the unit of the parameter, ``limits`` its
    range and ``frequencies`` the range of the frequency in rad/s, ``start`` the solution at which
    the curve begins, ``touch`` the place of the touched wall in rad after the first event, ``lost``
    the number of the vanishing impact.
    """

    kind: str = FOLD
    size: float = 1.0  # of the parameter
    limits: tuple[float, float] = (0.0, np.inf)
    frequencies: tuple[float, float] = (0.0, np.inf)
    start: Solution | None = None
    touch: float = 0.0  # rad after the first event: where a wall is grazed
    lost: int = 0  # number of the impact without speed
    points: dict[tuple[EventSchedule, float, bytes], CriticalPoint] = field(default_factory=dict)
    reference: Vector | None = None  # critical vector of the last point passed

    @property
    def scale(self) -> Array:
        """Units of the unknowns (m + 1,) with the schedule in use."""
        return np.append(np.ones(self.schedule.unknowns), PARAMETER_SHARE * self.case.omega)

    def solution(self, z: Array, value: float) -> Solution:
        """See `OrbitContinuation`."""
        return solution_in(
            self.case, self.schedule, z[:-1], {"omega": float(z[-1]), self.parameter: value}
        )

    def residual(self) -> Residual:
        """See `OrbitContinuation`."""
        scale = np.append(self.scale, self.size)
        common = (self.case, self.schedule, self.kind, self.parameter, scale, self.limits)
        if self.kind == GRAZING:
            return GrazingSystem(*common, touch=self.touch)
        if self.kind == LOSS_OF_CONTACT:
            return LossSystem(*common, number=self.lost)
        return DefiningSystem(*common)

    def monitors(self) -> tuple[Monitor, ...]:
        """Return the monitors, see `OrbitContinuation`.

        Beyond a grazing point the solution is not an orbit, but the curve may return to orbits and
        is therefore followed.
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
        """Return multipliers and normal form at a point.

        The direction of its critical vector is that of the last point passed.
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
        return self.weakest(z[:-1], value)

    def _weakest_other(self, z: Array, _value: float) -> float:
        """Return the smallest impulse without the vanishing one; 1 if there is no other."""
        n = len(self.schedule.events)
        wall = self.schedule.order.wall
        impulses = -wall[wall != 0] * z[n : n + self.schedule.impacts]
        return float(np.min(np.delete(impulses, self.lost), initial=1.0))

    def _other_clearance(self, z: Array, value: float) -> float:
        """Return the smallest distance from a wall, relative to the gap, at the other reversals.

        All reversals of the relative velocity are considered, except the one that touches the wall.
        """
        solution = self.solution(z, value)
        phases, distances = turns_after_first(solution)
        if len(phases) == 0:
            return np.nan
        k = nearest_turn(phases, self.touch, solution.schedule.turn)
        return float(np.min(np.delete(distances, k), initial=1.0))

    def _fold_test(self, z: Array, value: float) -> float:
        return plus_one_test(self.motion(z, value))

    def _along_start(self, side: float, z: Array, value: float) -> float:
        """Return the difference of the halves, projected onto their difference at the start.

        It is zero where the halves become equal, and possibly elsewhere.
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
        """See `OrbitContinuation`.

        Newton's method for orbits fails at a fold. The curve's own Newton iteration therefore
        starts from the event order of the motion.
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
        """Move the place of the wall's contact to its place in a motion.

        Returns whether the displacement is so large that a new residual is needed.
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
        """Return the unknowns in use, with a residual for the new place of the wall's contact."""
        return ContinuationChart(self.residual(), z, along, self.scale, self.monitors())


@dataclass(frozen=True, eq=False)
class BifurcationCurve(ScheduledBranch):
    """A curve of bifurcations of a ``kind`` over the frequency and another parameter.

    The other parameter is ``branch.parameter``, and its values are ``branch.parameters``. A `FOLD`
    located on the curve is an extremum of the other parameter.
    """

    kind: str

    def at(self, schedule: EventSchedule, z: Array, value: float) -> Solution:
        """See `ScheduledBranch`; the frequency is the last unknown."""
        return solution_in(
            self.case, schedule, z[:-1], {"omega": float(z[-1]), self.branch.parameter: value}
        )

    @property
    def omega(self) -> Array:
        """Frequencies (m,) in rad/s."""
        return np.array([y[-1] for y in self.branch.points])

    @cached_property
    def orbits(self) -> tuple[Orbit | NoOrbit, ...]:
        """Each point's orbit, or the reason why there is no orbit.

        An orbit is confirmed by the exact method and has a multiplier on the unit circle.
        """
        return tuple(
            self._confirmed(motion_of(self.solution(k))) for k in range(len(self.schedules))
        )

    @cached_property
    def located(self) -> tuple[tuple[str, Orbit | NoOrbit], ...]:
        """Kind and orbit, or the reason why there is no orbit, of each special point on the curve.

        At a point where a wall is touched it is a neighbouring orbit that does not touch the wall.
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
        """Return the orbit at a point of the curve, or why none exists.

        Two multipliers that meet at 1 or -1 are only accurate to the square root of the rounding
        error.
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
        """Multipliers and normal form of each point.

        They are None on a curve of grazing or loss of contact.
        """
        if self.kind not in MULTIPLIER_KINDS:
            return (None,) * len(self.schedules)
        return tuple(
            critical_point_of(self.kind, motion_of(self.solution(k)))
            for k in range(len(self.schedules))
        )

    def critical(self, k: int) -> complex:
        """Return the multiplier on the unit circle at point ``k``, over the schedule's span.

        It is 1, -1, or that of a torus's pair with positive imaginary part.
        """
        point = self.critical_points[k]
        if point is None:
            return complex(np.nan, np.nan)
        values = point.multipliers[point.critical]
        return complex(values[np.argmax(values.imag)])

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings.

        Values of the parameter are in SI units, and orbits are in the form of `pack_orbits`.
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
    """Return the curve of bifurcations of one ``kind`` that starts next to a solution.

    The curve is followed in both directions over the frequency (``frequencies`` in rad/s) and
    ``parameter`` (``limits`` in SI units). It ends at these limits; where a wall would have to
    pull; where a torus's multipliers meet at 1 or -1 (R1, R2); on the curve of broken symmetry or
    doubled periods on which it begins; or where it returns to its start. Ctrl-C ends it, and the
    part that is known is returned. Raises NoConvergenceError if there is no such bifurcation near
    the solution, ParameterError for bad input.
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
    touch, lost = _contact_of(solution, kind)

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
            touch=touch,
            lost=lost,
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

    return _without_false_labels(
        BifurcationCurve(solution.case, *follow_to_both_sides(one_way), kind)
    )


def _contact_of(solution: Solution, kind: str) -> tuple[float, int]:
    """Return the place of a solution's closest approach to a wall, and the weakest impact's number.

    The place is in rad after the first event.
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
    """Return a curve without the special points at which a test function jumps or has a pole."""
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


def _explain_end(way: Branch, case: Case, schedules: Sequence[EventSchedule]) -> Branch:
    """Return a branch with its end at a bifurcation at which both halves of its orbits agree.

    There the curve either breaks down or passes over to the orbits' mirror images. A branch that
    reaches such a bifurcation is cut there, and the reason for its end is the bifurcation's kind.
    Any other branch is unchanged.
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
    """Yield the curves of ``kinds`` through bifurcations located on branches in frequency.

    Each curve is yielded once; arguments are as in `bifurcation_curve`. Places from which Newton's
    method does not converge to a curve are left out, and so are curves without any orbit. After
    Ctrl-C the last curve has ended as `INTERRUPTED`.
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
    """Return whether orbits of a curve have the period and the symmetry of a solution."""
    first = curve.schedules[0]
    other = solution.schedule
    return first.symmetric == other.symmetric and first.period_multiple == other.period_multiple
