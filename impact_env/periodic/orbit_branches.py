"""Branches of orbits by continuation.

The module also finds all branches of symmetric two-impact orbits over a range of frequencies.

The residual consists of the conditions at the events. The order of events is changed where the
motion has another order.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.periodic.bifurcations import (
    LOST_BIRTH,
    NEAR_BIRTH,
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    TORUS,
    confirmed_bifurcation,
    find_objection,
    find_parent_at_birth,
    minus_one_test,
    torus_test,
)
from impact_env.periodic.branch import (
    BRANCH_POINT,
    CLOSED,
    FOLD,
    INTERRUPTED,
    KINK,
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
from impact_env.periodic.folds import Fold, find_fold
from impact_env.periodic.green import (
    Conditions,
    NoOrbit,
    Solution,
    make_solution,
    read_unknowns,
    solve,
)
from impact_env.periodic.motion import Motion, motion_of
from impact_env.periodic.orbit import (
    Orbit,
    has_held_phase,
    is_consistent,
    reorder_events,
    shoot_held_orbit,
)
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.symmetric import closed_folds, closed_form, symmetric_schedule

Array = NDArray[np.float64]
Kind = TypeVar("Kind")
GRAZING = "grazing"
PULLING = "pulling"
CHECKED_KINDS = (FOLD, BRANCH_POINT, SYMMETRY_BREAKING, PERIOD_DOUBLING, TORUS)  # by a multiplier
PARAMETER_SHARE = (
    0.02  # of the parameter: a change that counts as much as a radian of an event's phase
)
ORBIT_BRANCH_STEPS = Steps(first=0.005, least=1e-8, most=0.03)  # fine enough to be drawn
COARSE_STEPS = Steps(first=0.01, least=1e-8, most=0.1, points=1000)
END_STEP_SHARES = (
    1e-3,
    1e-2,
    0.1,
    1.0,
)  # of the last step: how far from an end at a wall an orbit is tried
SEED_FREQUENCIES = 24  # frequencies at which branches are begun
FOLD_DISTANCE = (
    1e-3  # relative: how far from a fold a branch that no other frequency shows is begun
)
# of phases in rad, scaled impulses, and the frequency in its share: a start this close to a known
# branch lies on it
KNOWN_BRANCH_DISTANCE = 0.01


@dataclass(frozen=True, eq=False)
class ScheduledBranch:
    """A branch with the schedule of each of its points.

    ``schedules`` has the schedule of each point, and ``located_schedules`` that of each special
    point.
    """

    case: Case
    branch: Branch
    schedules: tuple[EventSchedule, ...]
    located_schedules: tuple[EventSchedule, ...]

    def at(self, schedule: EventSchedule, z: Array, value: float) -> Solution:
        """Return the solution with unknowns z (m,) at a value of the parameter."""
        return solution_in(self.case, schedule, z, {self.branch.parameter: value})

    def solution(self, k: int) -> Solution:
        """Return the solution at point ``k``."""
        return self.at(self.schedules[k], self.branch.points[k], float(self.branch.parameters[k]))

    def places(self) -> Iterator[tuple[str, Solution]]:
        """Yield kind and solution of each special point."""
        for event, schedule in zip(self.branch.located, self.located_schedules, strict=True):
            yield event.kind, self.at(schedule, event.point, event.parameter)


@dataclass(frozen=True, eq=False)
class UnconfirmedPlace:
    """A special point of a branch that is no bifurcation of an orbit, with the ``reason``."""

    kind: str
    solution: Solution
    reason: str


@dataclass(frozen=True, eq=False)
class OrbitBranch(ScheduledBranch):
    """A branch of orbits in one parameter.

    Points are solutions of the conditions at the events. Where friction would hold the absorber
    briefly they are not orbits; `orbits` then has the orbits with a joined phase that shooting
    finds next to them. Folds, broken symmetry, doubled periods and tori in ``branch.located`` are
    confirmed by the exact method and by a multiplier on the unit circle; ``unconfirmed`` has the
    others. If the branch emerges from another branch by broken symmetry or a doubled period, the
    special point has the kind of this bifurcation, and its solution is the orbit of the other
    branch, over half of the span.
    """

    unconfirmed: tuple[UnconfirmedPlace, ...] = ()

    def orbits(self) -> Iterator[Orbit | NoOrbit]:
        """Yield each point's orbit, confirmed by the exact method, or why there is none."""
        for k in range(len(self.schedules)):
            yield shoot_held_orbit(motion_of(self.solution(k)))

    def folds(self) -> tuple[Fold | NoOrbit, ...]:
        """Return the folds located on the branch, computed to full accuracy by Newton's method.

        Unconfirmed folds are included.
        """
        return tuple(
            find_fold(solution, self.branch.parameter)
            for solution in (
                *(solution for kind, solution in self.places() if kind == FOLD),
                *(each.solution for each in self.unconfirmed if each.kind == FOLD),
            )
        )

    def of(self, kind: str) -> tuple[Motion, ...]:
        """Return the motions at the special points of a kind, such as `GRAZING`.

        Bifurcations of another branch, from which this branch emerges, are not included: their
        orbits have another symmetry or another number of periods.
        """
        return tuple(
            motion_of(solution)
            for each, solution in self.places()
            if each == kind
            and solution.schedule.symmetric == self.schedules[0].symmetric
            and solution.schedule.period_multiple == self.schedules[0].period_multiple
        )

    def starts(self, kind: str) -> tuple[Solution, ...]:
        """Return the solutions at bifurcations of a kind from which other branches are followed.

        Solutions that the exact method refuses, but which have the multiplier of the bifurcation,
        are included: the branches that emerge there may have orbits farther on.
        """
        return (
            *(motion.solution for motion in self.of(kind)),
            *(
                each.solution
                for each in self.unconfirmed
                if each.kind == kind
                and kind in CHECKED_KINDS
                and find_objection(kind, motion_of(each.solution)) is None
            ),
        )


def confirmed_places(orbits: OrbitBranch) -> OrbitBranch:
    """Return a branch with confirmed special points.

    They are bifurcations of orbits; the points at which this branch emerges from another one have
    the kind of that bifurcation. All other points are listed as unconfirmed. At an emergence the
    determinant of the conditions vanishes, too: a branch point or kink in the same step is left
    out.
    """
    good: list[tuple[SpecialPoint, EventSchedule]] = []
    refused: list[UnconfirmedPlace] = []
    born: list[SpecialPoint] = []
    for event, schedule in zip(orbits.branch.located, orbits.located_schedules, strict=True):
        if event.kind in (GRAZING, PULLING):
            reason = _objection_to_end(orbits, event.parameter)
            if reason is None:
                good.append((event, schedule))
            else:
                solution = orbits.at(schedule, event.point, event.parameter)
                refused.append(UnconfirmedPlace(event.kind, solution, reason))
            continue
        if event.kind not in CHECKED_KINDS:
            good.append((event, schedule))
            continue
        birth = _birth(orbits, event, schedule)
        if birth is not None:
            if not any(other.after == event.after for other in born):
                good.append(birth)
            born.append(event)
            continue
        solution = orbits.at(schedule, event.point, event.parameter)
        result = confirmed_bifurcation(event.kind, motion_of(solution))
        if isinstance(result, NoOrbit):
            refused.append(UnconfirmedPlace(event.kind, solution, result.reason))
        else:
            good.append((event, schedule))
    steps = {event.after for event in born}
    good = [pair for pair in good if pair[0].kind != KINK or pair[0].after not in steps]
    return replace(
        orbits,
        branch=replace(orbits.branch, located=tuple(event for event, _ in good)),
        located_schedules=tuple(schedule for _, schedule in good),
        unconfirmed=tuple(refused),
    )


def _objection_to_end(orbits: OrbitBranch, value: float) -> str | None:
    """Return the reason why there is no orbit next to the branch's end at a wall, else None.

    The end is at a ``value`` of the parameter.
    """
    branch = orbits.branch
    last = len(branch) - 1
    at_end = abs(branch.parameters[last] - value) < abs(branch.parameters[0] - value)
    k, inner = (last, last - 1) if at_end else (0, 1)
    reason = "the branch has no other point"
    if last == 0 or len(branch.points[k]) != len(branch.points[inner]):
        return reason
    for share in END_STEP_SHARES:
        z = branch.points[k] + share * (branch.points[inner] - branch.points[k])
        near = branch.parameters[k] + share * (branch.parameters[inner] - branch.parameters[k])
        start = orbits.at(orbits.schedules[k], z, float(near))
        result = solve(start.case, start.schedule, read_unknowns(start))
        orbit = result if isinstance(result, NoOrbit) else shoot_held_orbit(motion_of(result))
        if isinstance(orbit, Orbit):
            return None
        reason = orbit.reason
    return reason


def _birth(
    orbits: OrbitBranch, event: SpecialPoint, schedule: EventSchedule
) -> tuple[SpecialPoint, EventSchedule] | None:
    """Return special point and schedule where the branch emerges, or None if not confirmed.

    The point has the orbit of the other branch, in the units of this branch's case.
    """
    if event.kind not in (FOLD, BRANCH_POINT):
        return None
    solution = orbits.at(schedule, event.point, event.parameter)
    parameter = orbits.branch.parameter
    at_one = find_objection(event.kind, motion_of(solution)) is None
    birth = find_parent_at_birth(solution, parameter, NEAR_BIRTH if at_one else LOST_BIRTH)
    if birth is None or isinstance(confirmed_bifurcation(birth[0], motion_of(birth[1])), NoOrbit):
        return None
    kind, parent = birth
    point = in_units(orbits.case, parent.schedule, read_unknowns(parent), parent.case)
    value = float(getattr(parent.case, parameter))
    return replace(event, kind=kind, point=point, parameter=value), parent.schedule


def solution_in(
    units: Case, schedule: EventSchedule, z: Array, values: dict[str, float]
) -> Solution:
    """Return the solution with unknowns z (m,) at ``values`` of parameters.

    The unknowns are in the units of the case ``units``.
    """
    case = units.changed(**values)
    return make_solution(case, schedule, in_units(case, schedule, z, units), 0.0)


def in_units(new: Case, schedule: EventSchedule, z: Array, old: Case) -> Array:
    """Return unknowns (m,) in the units of a ``new`` case.

    ``z`` contains the unknowns in the units of an ``old`` case.
    """
    n = len(schedule.events)
    units = np.ones(len(z))
    units[n : n + schedule.impacts] = old.scale.impulse / new.scale.impulse
    units[n + schedule.impacts :] = old.scale.length / new.scale.length
    return np.asarray(units * z)


@dataclass(eq=False)
class OrbitContinuation:
    """State of a continuation of orbits.

    It has the present schedule, those of the points passed, and the last motion.
    """

    case: Case
    parameter: str
    schedule: EventSchedule
    passed: list[EventSchedule] = field(default_factory=list)
    most_wrong: int | None = None
    wrong: int = 0
    last: tuple[tuple[EventSchedule, float, bytes], Motion] | None = None
    heading: Array | None = (
        # of phases and impulses at impacts, and of the rest but the reversals, at the last orbit
        # passed
        None
    )

    def motion(self, z: Array, value: float) -> Motion:
        """Return the motion at a point; the last one is stored for monitors and `recentre`."""
        key = (self.schedule, value, z.tobytes())
        if self.last is None or self.last[0] != key:
            self.last = (key, motion_of(self.solution(z, value)))
        return self.last[1]

    def solution(self, z: Array, value: float) -> Solution:
        """Return the solution at a point."""
        return solution_in(self.case, self.schedule, z, {self.parameter: value})

    def residual(self) -> Residual:
        """Return the residual for the continuation, with the schedule in use."""
        return Conditions(self.case, self.schedule, self.parameter)

    def clearance(self, z: Array, value: float) -> float:
        """Return the distance to a wall at the closest approach, relative to the gap.

        It is zero if the absorber grazes the wall.
        """
        return self.motion(z, value).clearance / self.case.gap

    def monitors(self) -> tuple[Monitor, ...]:
        """Return the monitors of a branch."""
        return (
            Monitor(GRAZING, self.clearance, ends=True),
            Monitor(PULLING, self.weakest, ends=True),
            Monitor(
                SYMMETRY_BREAKING if self.schedule.symmetric else PERIOD_DOUBLING,
                self._period_doubling_monitor,
            ),
            Monitor(TORUS, self._on_circle),
        )

    def _on_circle(self, z: Array, value: float) -> float:
        """Return a monitor that is zero where the product of two multipliers is 1."""
        motion = self.motion(z, value)
        return np.nan if self._is_left_out(motion) else torus_test(motion)

    def _period_doubling_monitor(self, z: Array, value: float) -> float:
        """Return a monitor that is zero where a multiplier is -1."""
        motion = self.motion(z, value)
        return np.nan if self._is_left_out(motion) else minus_one_test(motion)

    def _is_left_out(self, motion: Motion) -> bool:
        """Return whether no bifurcation is sought at a motion.

        In a search for orbits this is the case where friction would cause a different motion.
        """
        return (
            self.most_wrong is not None
            and motion.solution.case.friction_limit > 0
            and not shows_schedule(motion)
        )

    def weakest(self, z: Array, _value: float) -> float:
        """Return the least of the impulses, which is positive if no wall pulls."""
        order = self.schedule.order
        n = len(self.schedule.events)
        return float(np.min(-order.wall[order.wall != 0] * z[n : n + self.schedule.impacts]))

    def schedules(self, first: EventSchedule, number: int) -> list[EventSchedule]:
        """Return the schedules of ``number`` points, the first of which has the schedule ``first``.

        Point k > 0 was computed with the schedule before it was possibly changed at this point.
        """
        passed = [first, *self.passed]
        return [*passed, *[self.schedule] * (number - len(passed))][:number]

    def recentre(self, z: Array, value: float, along: Array) -> ContinuationChart | None:
        """Return the unknowns of another order of events if the motion has another order.

        Otherwise the result is None.
        """
        self.passed.append(self.schedule)
        if self.case.changed(**{self.parameter: value}).friction_limit == 0:
            return None
        motion = self.motion(z, value)
        if self.right(motion, along):
            self.wrong = 0
            return None
        self.wrong += 1
        if self.most_wrong is not None and self.wrong > self.most_wrong:
            raise NoConvergenceError(f"no orbit at the last {self.wrong} points")
        result = reorder_events(motion.solution.case, self.schedule, read_unknowns(motion.solution))
        if (
            isinstance(result, NoOrbit)
            or result.solution.schedule == self.schedule
            or result.solution.schedule.impacts != self.schedule.impacts
        ):
            return None
        return self.chart(result.solution, float(z[0]))

    def right(self, motion: Motion, along: Array) -> bool:
        """Return whether the schedule is that of the motion.

        If it is, the direction ``along`` the branch is stored.
        """
        right = shows_schedule(motion)
        hits = self.schedule.order.wall != 0
        if self.heading is None or right:
            self.heading = np.concatenate([along[: len(hits)][hits], along[len(hits) :]])
        return right

    def chart(
        self,
        solution: Solution,
        first: float,
        more: tuple[float, ...] = (),
        scale: Array | float = 1.0,
    ) -> ContinuationChart:
        """Return the unknowns of a solution for the continuation of the branch.

        The first event's phase is shifted by whole turns to the one nearest to ``first`` (rad).
        ``more`` unknowns are appended. The direction is that at the last orbit passed, because the
        unknowns have a fold where two reversals meet, after which the last tangent leads back.
        """
        new = solution.schedule.order.wall != 0
        direction = np.zeros(solution.schedule.unknowns + len(more) + 1)
        assert self.heading is not None
        direction[: len(new)][new] = self.heading[: int(np.sum(new))]
        direction[len(new) :] = self.heading[int(np.sum(new)) :]
        self.schedule = solution.schedule
        z = in_units(self.case, self.schedule, read_unknowns(solution), solution.case)
        whole = 2 * np.pi * self.schedule.period_multiple
        z[: len(new)] += whole * round(
            (first - float(z[0])) / whole
        )  # so that a closed branch is known again
        return ContinuationChart(
            self.residual(), np.append(z, more), direction, scale, self.monitors()
        )


def shows_schedule(motion: Motion) -> bool:
    """Return whether a motion has the reversals of its schedule, and friction holds at none."""
    return is_consistent(motion) and not has_held_phase(motion)


def _follow_one_way(
    solution: Solution,
    parameter: str,
    limits: tuple[float, float],
    steps: Steps,
    progress: PointProgress | None,
    most_wrong: int | None,
    direction: float,
) -> tuple[Branch, list[EventSchedule]]:
    walk = OrbitContinuation(solution.case, parameter, solution.schedule, most_wrong=most_wrong)
    value = getattr(solution.case, parameter)
    problem = ContinuationProblem(
        walk.residual(),
        parameter,
        1.0,
        PARAMETER_SHARE * compute_size(parameter, value, limits),
        limits,
        walk.monitors(),
        walk.recentre,
    )
    branch = follow_branch(problem, read_unknowns(solution), value, direction, steps, progress)
    return branch, walk.schedules(solution.schedule, len(branch))


def compute_size(parameter: str, value: float, limits: tuple[float, float]) -> float:
    """Return the unit of a parameter: its value for the frequency, else the largest |limit|."""
    if parameter == "omega":
        return abs(value)
    return max((abs(x) for x in (value, *limits) if math.isfinite(x)), default=0.0) or 1.0


def orbit_branch(
    solution: Solution,
    parameter: str,
    limits: tuple[float, float],
    steps: Steps = COARSE_STEPS,
    progress: PointProgress | None = None,
    most_wrong: int | None = None,
) -> OrbitBranch:
    """Return the branch in both directions through a solution, in a parameter of `PARAMETERS`.

    ``limits`` are in SI units. The branch ends at its limits, where the absorber grazes a wall or a
    wall would have to pull, or where it returns to its start; after Ctrl-C it ends at the last
    point. Bifurcations are located on the way, and confirmed at the end. ``most_wrong``: with
    friction it ends after so many consecutive points whose motion is held or has other reversals
    than its events; no bifurcation is sought at such points.
    """
    result = OrbitBranch(
        solution.case,
        *follow_to_both_sides(
            partial(_follow_one_way, solution, parameter, limits, steps, progress, most_wrong)
        ),
    )
    return confirmed_places(result)


def follow_to_both_sides(
    one_way: Callable[[float], tuple[Branch, list[Kind]]],
) -> tuple[Branch, tuple[Kind, ...], tuple[Kind, ...]]:
    """Return a branch from its parts towards larger values (1) and smaller ones (-1).

    ``one_way(direction)`` returns one part with the kind of unknowns (such as a schedule) of each
    of its points. The other results are the kinds of all points and of all special points. A branch
    that closes or is interrupted on its way to larger values is not followed in the other
    direction.
    """
    forward, schedules = one_way(1.0)
    if forward.ended in (CLOSED, INTERRUPTED):
        return forward, tuple(schedules), located_schedules(forward.located, schedules)
    backward, others = one_way(-1.0)
    located = (
        *reversed(located_schedules(backward.located, others)),
        *located_schedules(forward.located, schedules),
    )
    return forward.joined(backward), (*others[:0:-1], *schedules), located


def located_schedules(located: tuple[SpecialPoint, ...], schedules: list[Kind]) -> tuple[Kind, ...]:
    """Return the schedule of each special point, from those of the points."""
    return tuple(schedules[min(event.after + 1, len(schedules) - 1)] for event in located)


def orbit_branches(
    case: Case,
    low: float,
    high: float,
    also: Iterable[float] = (),
    steps: Steps = ORBIT_BRANCH_STEPS,
    progress: Callable[[str, int, float], None] | None = None,
    most_wrong: int | None = None,
) -> Iterator[OrbitBranch]:
    """Yield the branches of symmetric two-impact orbits between two frequencies in rad/s.

    They start from the closed form's orbits at `SEED_FREQUENCIES` frequencies, next to the closed
    form's folds, and at the frequencies ``also``; orbits on a known branch are not followed again.
    ``steps`` is `COARSE_STEPS` if only the orbits at some frequencies are wanted. ``progress`` is
    called with a text, the number of points, and the frequency. ``most_wrong`` is as in
    `orbit_branch`. After Ctrl-C the last branch has ended as `INTERRUPTED`. Raises ParameterError
    for a bad range.
    """
    require(
        0 < low < high,
        "frequency range",
        (low, high),
        "two frequencies in rad/s above 0, the lower one first",
    )
    known: list[Array] = []
    schedule = symmetric_schedule(case.friction_limit > 0)
    first = float(case.model.omega[0])
    neighbours = [
        fold * (1 + side)
        for fold in closed_folds(case, low / first, high / first)
        for side in (-FOLD_DISTANCE, FOLD_DISTANCE)
    ]
    for omega in (
        *np.linspace(low, high, SEED_FREQUENCIES + 2)[1:-1],
        *(omega for omega in (*neighbours, *also) if low < omega < high),
    ):
        at = case.changed(omega=float(omega))
        for start in closed_form(at):
            motion = reorder_events(at, schedule, [start.phase]) if start.pushes else None
            if (
                motion is None
                or isinstance(motion, NoOrbit)
                or any(lies_on(places, motion.solution) for places in known)
            ):
                continue
            show = None if progress is None else partial(progress, f"orbits {len(known) + 1}")
            branch = orbit_branch(motion.solution, "omega", (low, high), steps, show, most_wrong)
            known.append(list_places(branch))
            yield branch
            if branch.branch.ended == INTERRUPTED:
                return


def make_place(solution: Solution) -> Array:
    """Return phase, impulse and frequency (3,) of the first impact.

    They are in the units of the continuation.
    """
    z = read_unknowns(solution)
    return np.array(
        [z[0], z[len(solution.schedule.events)], math.log(solution.case.omega) / PARAMETER_SHARE]
    )


def list_places(branch: OrbitBranch) -> Array:
    """Return the place of each point of a branch, (m, 3)."""
    return np.array([make_place(branch.solution(k)) for k in range(len(branch.schedules))])


def lies_on(places: Array, solution: Solution) -> bool:
    """Return whether a solution lies close to a branch.

    ``places`` (m, 3) are those of the branch's points, which are connected by straight lines.
    """
    return is_near(places, make_place(solution))


def mirror_places(places: Array, solution: Solution, *more: float) -> bool:
    """Return whether a solution or its mirror image lies close to a branch.

    ``places`` (m, 3 + k) are those of the branch's points, which are connected by straight lines;
    the k numbers ``more`` of the solution are compared with their last columns. Any impact of the
    solution may be the first one.
    """
    ratio = math.log(solution.case.omega) / PARAMETER_SHARE
    hits = solution.schedule.order.wall != 0
    pairs = zip(
        solution.phases[hits], solution.impulses[hits] / solution.case.scale.impulse, strict=True
    )
    return any(
        is_near(places, np.array([p + k * np.pi, (-1.0) ** k * i, ratio, *more]))
        for p, i in pairs
        for k in (0, 1)
    )


def is_near(places: Array, point: Array) -> bool:
    """Return whether a place (3,) lies close to the polyline through ``places`` (m, 3)."""
    return compute_distance(places, point) <= KNOWN_BRANCH_DISTANCE


def compute_distance(places: Array, point: Array) -> float:
    """Return the distance of a place (3,) from the polyline through ``places`` (m, 3).

    Whole turns of the phase are ignored. The distance is infinite for fewer than two places.
    """
    points = places - point
    points[:, 0] = (points[:, 0] + np.pi) % (2 * np.pi) - np.pi
    begin = points[:-1]
    chord = np.diff(points, axis=0)
    square = np.sum(chord**2, axis=1)
    share = np.clip(-np.sum(begin * chord, axis=1) / np.where(square > 0, square, 1), 0, 1)
    return float(np.min(np.linalg.norm(begin + share[:, None] * chord, axis=1), initial=np.inf))
