"""Branches of orbits with any contact over the frequency or the force.

Pseudo-arclength continuation of the condition that the state returns to its start.

The section is moved if an event comes near it. The order of events may change: where a reversal
appears or disappears the map has a kink, and where an impact grazes a wall its derivative is
unbounded, so that branches end there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import describe_error, require
from impact_env.periodic.bifurcations import (
    CRITICAL_MULTIPLIERS,
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    TORUS,
    critical_multipliers,
)
from impact_env.periodic.branch import (
    FOLD,
    KINK,
    MINIMUM_STEP,
    Branch,
    Monitor,
    NoConvergenceError,
    ReturnGate,
    SpecialPoint,
)
from impact_env.periodic.continuation import (
    ContinuationChart,
    ContinuationProblem,
    PointProgress,
    Steps,
    follow_branch,
    start_branch,
)
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.periodic.hybrid_flow import relative_rows
from impact_env.periodic.hybrid_orbit import (
    HybridOrbit,
    NoHybridOrbit,
    ReturnCondition,
    confirm_hybrid,
    find_section,
    plain_hybrid_orbit,
)
from impact_env.periodic.hybrid_trajectory import (
    CONTACT,
    IMPACT,
    HybridTrajectory,
    follow_hybrid,
    piece_lengths,
)
from impact_env.periodic.orbit import pack_plain_orbits
from impact_env.periodic.orbit_branches import (
    PARAMETER_SHARE,
    compute_size,
    follow_to_both_sides,
)
from impact_env.periodic.passage import TrajectoryError
from impact_env.periodic.response_curve import EXACT, CurvePoint, ResponseCurve

Array = NDArray[np.float64]
HYBRID_PARAMETERS = {"force": 0, "omega": 1}  # to the columns of `HybridTrajectory.columns`
HYBRID_STEPS = Steps(first=0.01, least=1e-6, most=0.2, points=400, tolerance=1e-10)
SECTION_SHARE = 0.2  # of the way between two events: how near to one of them the section may lie
SHORT_SECTION = 0.4  # of the longest way between two events: the section's own is no shorter
# in a period of the force, that sections are moved to: a closed branch comes back to the same
SECTION_PHASES = 64
# of the unit of velocities, or of the clearance: an impact as slow, or a miss as close, is a graze
GRAZING_SHARE = 0.02
SAME_PLACE_TOL = (
    1e-6  # of parameter and displacement: two places of one kind closer than this are one
)
SAMPLES = 200  # of a piece, for the closest miss
NEAR_FOLD = 1e-4  # of a multiplier from 1 at a fold that the root search located
COINCIDENCE = 0.01  # rad of the force between impacts of two absorbers: nearly at one instant
GRAZE_AT_END = "grazing"
COINCIDENT_IMPACTS = "impacts at one instant"


@dataclass(frozen=True, eq=False)
class LocatedOrbit:
    """A special point of a branch: ``kind``, ``orbit``, and multipliers on the unit circle."""

    kind: str
    orbit: HybridOrbit
    multipliers: tuple[complex, ...]


@dataclass(frozen=True, eq=False)
class HybridBranch:
    """A branch of orbits with any contact, in ``branch.parameter`` (``omega`` or ``force``).

    Attributes
    ----------
    case : HybridCase
        Scene, and the values of the parameters that do not change.
    branch : Branch
        Points, in the units of the continuation.
    conditions : tuple of ReturnCondition
        Condition of each point, with its section.
    located : tuple of LocatedOrbit
        Folds and bifurcations, each confirmed by the exact method and a multiplier on the unit
        circle.
    unconfirmed : tuple of (str, str)
        Kind of each special point that was not confirmed, and the reason.
    """

    case: HybridCase
    branch: Branch
    conditions: tuple[ReturnCondition, ...]
    located: tuple[LocatedOrbit, ...]
    unconfirmed: tuple[tuple[str, str], ...]

    @property
    def parameters(self) -> Array:
        """Values (m,) of the parameter, in rad/s or N."""
        return self.branch.parameters

    def of(self, kind: str) -> tuple[LocatedOrbit, ...]:
        """Return the special points of a kind, such as ``fold``."""
        return tuple(place for place in self.located if place.kind == kind)

    def orbits(self) -> Iterator[HybridOrbit | NoHybridOrbit]:
        """Yield the orbit of each point, or the reason why there is none."""
        for condition, point, value in zip(
            self.conditions, self.branch.points, self.parameters, strict=True
        ):
            yield orbit_at(condition, self.branch.parameter, point, float(value))

    def curve(self, reference: float = 1.0) -> ResponseCurve:
        """Return the branch as a response curve with its parameter over ``reference``.

        Tables, figures and files of the branch are made from this curve.
        """
        orbits = list(self.orbits())
        good = [orbit if isinstance(orbit, HybridOrbit) else None for orbit in orbits]
        refused: dict[str, int] = {}
        for orbit in orbits:
            if isinstance(orbit, NoHybridOrbit):
                refused[orbit.reason] = refused.get(orbit.reason, 0) + 1
        name = self.branch.parameter
        marks = tuple(
            CurvePoint(
                place.kind,
                float(getattr(place.orbit.case, name)) / reference,
                place.orbit.tip_max,
                place.multipliers,
            )
            for place in self.located
        )
        first = self.conditions[0]
        return ResponseCurve(
            EXACT,
            self.parameters / reference,
            np.array([np.nan if orbit is None else orbit.tip_max for orbit in good]),
            np.array([np.nan if orbit is None else orbit.tip_rms for orbit in good]),
            marks,
            self.branch.closed,
            self.branch.message,
            np.array([orbit is not None and orbit.stable for orbit in good]),
            None,
            tuple(refused.items()),
            first.period_multiple,
            first.symmetric,
            pack_plain_orbits(
                [None if orbit is None else plain_hybrid_orbit(orbit) for orbit in good]
            ),
        )


def orbit_at(
    condition: ReturnCondition, parameter: str, point: Array, value: float
) -> HybridOrbit | NoHybridOrbit:
    """Return the orbit at a point of a branch, or why there is none."""
    case = condition.case.changed(**{parameter: value})
    try:
        trajectory = condition.follow(point, case)
    except TrajectoryError as error:
        return NoHybridOrbit(case, str(error))
    return confirm_hybrid(condition, point, trajectory)


@dataclass(eq=False)
class _HybridContinuation:
    """State of a continuation: present condition, conditions of the points passed, trajectory."""

    condition: ReturnCondition
    parameter: str
    passed: list[ReturnCondition] = field(default_factory=list)
    last: tuple[tuple[float, float, bytes], HybridTrajectory] | None = None
    gate: ReturnGate | None = None
    first: ReturnCondition | None = None

    def trajectory(self, z: Array, value: float) -> HybridTrajectory:
        """Return the trajectory at a point; the last one is stored for residual and monitors.

        Raises NoConvergenceError.
        """
        key = (self.condition.phase, value, z.tobytes())
        if self.last is None or self.last[0] != key:
            if not value > 0:
                raise NoConvergenceError(f"{self.parameter} = {value:g} is not above 0")
            case = self.condition.case.changed(**{self.parameter: value})
            try:
                self.last = (key, self.condition.follow(z, case))
            except TrajectoryError as error:
                raise NoConvergenceError(str(error)) from error
        return self.last[1]

    def residual(self, z: Array, value: float) -> tuple[Array, Array]:
        """Return the residual (m,) and its derivatives (m, m + 1)."""
        trajectory = self.trajectory(z, value)
        whole = self.condition.jacobian(trajectory)
        m = len(z)
        columns = [*range(m), m + HYBRID_PARAMETERS[self.parameter]]
        return self.condition.residual(z, trajectory), whole[:, columns]

    def multipliers(self, z: Array, value: float) -> NDArray[np.complex128]:
        """Return the multipliers at a point."""
        matrix = self.condition.mirror * self.trajectory(z, value).derivative
        return np.linalg.eigvals(matrix).astype(complex)

    def period_doubling_monitor(self, z: Array, value: float) -> float:
        """Return a monitor that is zero where a multiplier is -1."""
        values = self.multipliers(z, value)
        return float(np.prod((values + 1) / (1 + np.abs(values))).real)

    def on_circle(self, z: Array, value: float) -> float:
        """Return a monitor that is zero where the product of two multipliers is 1."""
        values = self.multipliers(z, value)
        first, second = np.triu_indices(len(values), 1)
        products = values[first] * values[second]
        return float(np.prod((products - 1) / (1 + np.abs(products))).real)

    def monitors(self) -> tuple[Monitor, ...]:
        """Return the monitors of a branch."""
        kind = SYMMETRY_BREAKING if self.condition.symmetric else PERIOD_DOUBLING
        return Monitor(kind, self.period_doubling_monitor), Monitor(TORUS, self.on_circle)

    def set_gate(
        self, z: Array, value: float, steps: Steps, scale: float, direction: float
    ) -> None:
        """Store the first point of the branch, in the unknowns of its section."""
        problem = ContinuationProblem(self.residual, self.parameter, 1.0, scale)
        system, state = start_branch(problem, z, value, direction, steps)
        start = _HybridContinuation(self.condition, self.parameter)
        self.first = self.condition
        self.gate = ReturnGate(0, replace(system, residual=start.residual), state)

    def closes(self, z: Array, value: float, new: Array, new_value: float) -> bool:
        """Return whether a step between two points passes the first point of the branch.

        The points may be at another section than the first point.
        """
        if self.gate is None or self.condition.free_phase:
            return False
        try:
            before, after = (
                self.gate.system.scaled(self._at_first_section(*point), point[1])
                for point in ((z, value), (new, new_value))
            )
        except NoConvergenceError:
            return False
        place = self.gate.place
        return self.gate.returned(replace(place, x=before), replace(place, x=after))

    def _at_first_section(self, z: Array, value: float) -> Array:
        """Return the unknowns of a point at the first section."""
        assert self.first is not None
        trajectory = self.trajectory(z, value)
        turns = (self.first.phase - self.condition.phase) / self.condition.turn
        rounds = math.floor(turns)
        state = trajectory.states(np.array([(turns - rounds) * trajectory.span]))[0]
        mirror = self.condition.mirror if rounds % 2 else 1.0
        return mirror * state[: len(self.first.units)] / self.first.units

    def conditions(self, first: ReturnCondition, number: int) -> list[ReturnCondition]:
        """Return the condition of each of ``number`` points.

        Point k > 0 was computed with the condition before the section was moved at this point.
        """
        passed = [first, *self.passed]
        return [*passed, *[self.condition] * (number - len(passed))][:number]

    def recentre(self, z: Array, value: float, along: Array) -> ContinuationChart | None:
        """Return the unknowns at another section if an event is near the present one, else None."""
        self.passed.append(self.condition)
        trajectory = self.trajectory(z, value)
        if self.condition.free_phase or not is_section_near_event(trajectory):
            return None
        time = find_section(trajectory)
        case = trajectory.case
        old = self.condition
        grid = 2 * math.pi / SECTION_PHASES
        phase = round((old.phase + case.omega * time) / grid) * grid
        near = (phase - old.phase) / case.omega
        start, state = old.plain(z)
        if 0 < near < trajectory.span:
            time = near
        else:
            phase = old.phase + case.omega * time
        try:
            part = follow_hybrid(case, start, state, time)
        except TrajectoryError as error:
            raise NoConvergenceError(str(error)) from error
        column = part.columns[:, HYBRID_PARAMETERS[self.parameter]]
        if self.parameter == "omega":
            column = column - part.end_rate * time / case.omega
        direction = part.derivative @ (along[:-1] * old.units) + column * along[-1]
        self.condition = replace(old, phase=phase)
        point = self.condition.unknowns(phase, part.end)
        tangent = np.append(direction / old.units, along[-1])
        return ContinuationChart(self.residual, point, tangent, 1.0, self.monitors())


def is_section_near_event(trajectory: HybridTrajectory) -> bool:
    """Return whether an event is so near to the section that the section should be moved."""
    if not trajectory.events:
        return False
    first = trajectory.events[0].time
    last = trajectory.span - trajectory.events[-1].time
    own = first + last
    times = [event.time for event in trajectory.events]
    longest = max([own, *np.diff(times)])
    return min(first, last) < SECTION_SHARE * own or own < SHORT_SECTION * longest


def hybrid_branch(
    orbit: HybridOrbit,
    parameter: str,
    limits: tuple[float, float],
    steps: Steps = HYBRID_STEPS,
    progress: PointProgress | None = None,
) -> HybridBranch:
    """Return the branch through an orbit, to both sides.

    Parameters
    ----------
    orbit : HybridOrbit
        Start.
    parameter : str
        ``omega`` (rad/s) or ``force`` (N).
    limits : tuple of float
        Least and largest value of the parameter.
    steps : Steps, optional
        Steps of the continuation.
    progress : callable, optional
        Called with the number of points and the parameter.

    Returns
    -------
    HybridBranch
        The branch ends at its limits, where no step is possible (mostly because an impact grazes a
        wall; its message says so), or where it returns to its start. After Ctrl-C it ends at the
        last point.

    Raises
    ------
    ParameterError
        Another parameter, limits that do not enclose the orbit's value, or an orbit that is not
        isolated.
    """
    require(
        parameter in HYBRID_PARAMETERS,
        "parameter",
        parameter,
        f"one of {', '.join(HYBRID_PARAMETERS)}",
    )
    start = ReturnCondition(
        orbit.case, orbit.phase, orbit.symmetric, orbit.period_multiple, orbit.case.units
    )
    try:
        branch, conditions, located = follow_to_both_sides(
            partial(_follow_one_way, start, orbit, parameter, limits, steps, progress)
        )
    except NoConvergenceError as error:
        allowed = (
            "an isolated orbit: no absorber that touches nothing and no slider that never slips, "
            f"whose places are free ({error})"
        )
        place = f"{orbit.case.force:g} N and {orbit.case.omega_ratio:.6g} of the first resonance"
        raise describe_error("orbit", f"that at {place}", allowed) from error
    confirmed: list[LocatedOrbit] = []
    refused: list[tuple[str, str]] = []
    for event, condition in zip(branch.located, located, strict=True):
        if event.kind == KINK:
            continue
        result = _confirm_place(condition, parameter, event)
        if isinstance(result, LocatedOrbit):
            if not any(is_same_place(result, other, parameter) for other in confirmed):
                confirmed.append(result)
        else:
            refused.append((event.kind, result))
    return HybridBranch(orbit.case, branch, conditions, tuple(confirmed), tuple(refused))


def _follow_one_way(
    start: ReturnCondition,
    orbit: HybridOrbit,
    parameter: str,
    limits: tuple[float, float],
    steps: Steps,
    progress: PointProgress | None,
    direction: float,
) -> tuple[Branch, list[ReturnCondition]]:
    walk = _HybridContinuation(start, parameter)
    value = float(getattr(orbit.case, parameter))
    scale = PARAMETER_SHARE * compute_size(parameter, value, limits)
    problem = ContinuationProblem(
        walk.residual, parameter, 1.0, scale, limits, walk.monitors(), walk.recentre, walk.closes
    )
    z = start.unknowns(orbit.phase, orbit.state)
    walk.set_gate(z, value, steps, scale, direction)
    branch = follow_branch(problem, z, value, direction, steps, progress)
    conditions = walk.conditions(start, len(branch))
    if branch.ended == MINIMUM_STEP:
        last = orbit_at(conditions[-1], parameter, branch.points[-1], float(branch.parameters[-1]))
        if isinstance(last, HybridOrbit):
            branch = _explain_end(branch, last.trajectory)
    return branch, conditions


def _explain_end(branch: Branch, trajectory: HybridTrajectory) -> Branch:
    """Return a branch with the reason for its end, if the motion at its end shows one.

    ``branch`` has ended because no step was possible.
    """
    at = f"{branch.parameter} = {branch.parameters[-1]:.6g}"
    if compute_graze(trajectory) < GRAZING_SHARE:
        return replace(branch, ended=GRAZE_AT_END, message=f"an impact grazes a wall next to {at}")
    impacts = [event for event in trajectory.events if event.kind == IMPACT]
    times = [b.time - a.time for a, b in pairwise(impacts) if a.absorber != b.absorber]
    if trajectory.case.omega * min(times, default=math.inf) < COINCIDENCE:
        message = f"impacts of two absorbers come to one instant next to {at}"
        return replace(branch, ended=COINCIDENT_IMPACTS, message=message)
    return branch


def is_same_place(one: LocatedOrbit, other: LocatedOrbit, parameter: str) -> bool:
    """Return whether two special points are the same point.

    A point is located twice if it is at the beginning of a closed branch and again at its end.
    """
    values = [float(getattr(place.orbit.case, parameter)) for place in (one, other)]
    return (
        one.kind == other.kind
        and abs(values[0] - values[1]) <= SAME_PLACE_TOL * values[0]
        and abs(one.orbit.tip_max / other.orbit.tip_max - 1) <= SAME_PLACE_TOL
    )


def _confirm_place(
    condition: ReturnCondition, parameter: str, event: SpecialPoint
) -> LocatedOrbit | str:
    """Return a special point if it is confirmed, or else the reason why it is not.

    It must be an orbit with a multiplier on the unit circle.
    """
    orbit = orbit_at(condition, parameter, event.point, event.parameter)
    if isinstance(orbit, NoHybridOrbit):
        return orbit.reason
    near = NEAR_FOLD if event.kind == FOLD else 1e-6
    critical = critical_multipliers(event.kind, orbit.multipliers, near)
    if len(critical) == 0:
        wanted = CRITICAL_MULTIPLIERS.get(event.kind)
        return (
            "no pair of complex multipliers lies on the unit circle"
            if wanted is None
            else f"no multiplier is {wanted:g}"
        )
    return LocatedOrbit(event.kind, orbit, tuple(complex(m) for m in critical))


def compute_graze(trajectory: HybridTrajectory) -> float:
    """Return how near a motion is to a graze, 0 at a graze.

    The result is the smallest of the impact velocities over their unit, and of the distances from
    missed walls over the clearance.
    """
    case = trajectory.case
    displacement, speed = relative_rows(case)
    unit = case.length * case.omega
    gap = case.laws.gap
    least = math.inf
    for event, piece in zip(trajectory.events, trajectory.pieces[1:], strict=False):
        if event.kind in (IMPACT, CONTACT):
            least = min(least, abs(float(speed[event.absorber] @ piece.begin)) / unit)
    for piece, length in piece_lengths(trajectory):
        if length <= 0:
            continue
        states = piece.states(np.linspace(0.0, length, SAMPLES))
        relative = np.abs(states @ displacement.T)
        rates = states @ speed.T
        turns = (rates[:-1] * rates[1:] < 0) & (relative[1:] < gap)
        missed = np.where(turns, gap - relative[1:], math.inf)
        least = min(least, float(np.min(missed / np.where(np.isfinite(gap), gap, 1.0))))
    return least
