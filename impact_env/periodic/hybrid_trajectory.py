"""A motion with any contact from a section at a phase of the force, and its derivatives.

The derivatives are with respect to state, force and frequency.

The exact method gives the times of events. Between them the motion is in closed form
(`hybrid_flow`);
at each event the derivative is multiplied by the saltation matrix DR + (f+ - DR f-) h'/(h' f-)
with the guard h, the jump R, and the time derivatives f before and after (di Bernardo and others,
Piecewise-smooth Dynamical Systems, 2008, chapter 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.periodic.hybrid_flow import (
    ContactRegime,
    LinearPiece,
    impulse_columns,
    relative_rows,
)
from impact_env.periodic.passage import HOLDING_WALLS, RECORD, TrajectoryError
from impact_env.results import Record, Response
from impact_env.scene import InitialState
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
SAME_TIME_TOL = 1e-10  # rad of the force: marks of the exact method closer than this are one event
# how far the closed form may end from the exact method: of the units times the largest derivative,
# but never more than the second
END_TOL = 1e-9
MOST_END_MISS = 1e-5
COMPLIANT_RECORD = Record(level=False, events=True)
AT_REST_TOL = (
    1e-12  # of the unit of velocities: below it an impulse alone gives an absorber its direction
)


class HybridEvent(NamedTuple):
    """An event of a motion.

    ``time`` is in s after the section, ``kind`` one of `EVENT_KINDS`, ``absorber`` its number from
    0, ``wall`` -1, 1 or 0 (none), and ``impulse`` acts on the absorber in N s.
    """

    time: float
    kind: str
    absorber: int
    wall: int = 0
    impulse: float = 0.0


IMPACT = "impact"
REVERSAL = "slip reversal"
STICK = "stick"
SLIP = "slip"
CONTACT = "wall contact"
SEPARATION = "separation"
EVENT_KINDS = (IMPACT, REVERSAL, STICK, SLIP, CONTACT, SEPARATION)


@dataclass(eq=False)
class HybridTrajectory:
    """A motion over ``span`` (s) from a section at ``phase`` (rad).

    Attributes
    ----------
    pieces : list of LinearPiece
        Motion between events.
    events : list of HybridEvent
        Events in the order of time.
    end : array, (S,)
        State at the end.
    derivative : array, (S, S)
        Derivative of the end with respect to the state at the section.
    columns : array, (S, 2)
        Derivatives of the end with respect to force (N) and frequency (rad/s), at a fixed time.
    exact_end : array, (2 N_m + 2 n,)
        State at the end of the exact method's run.
    """

    case: HybridCase
    phase: float
    span: float
    derivative: Array
    columns: Array
    pieces: list[LinearPiece] = field(default_factory=list)
    events: list[HybridEvent] = field(default_factory=list)
    end: Array = field(default_factory=lambda: np.zeros(0))
    exact_end: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def times(self) -> Array:
        """Times (p + 1,) in s at which the p pieces begin, and the end of the last one."""
        return np.array([*(piece.time for piece in self.pieces), self.span])

    def states(self, times: Array) -> Array:
        """Return the states (K, S) at times (K,) in s after the section, within the span."""
        which = np.searchsorted(self.times[:-1], times, side="right") - 1
        states = np.empty((len(times), len(self.end)))
        for k in np.unique(which):
            chosen = which == k
            states[chosen] = self.pieces[k].states(times[chosen] - self.pieces[k].time)
        return states

    @property
    def end_rate(self) -> Array:
        """Time derivative (S,) of the state at the end."""
        piece = self.pieces[-1]
        return piece.rate(self.span - piece.time, self.end)

    @property
    def start_rate(self) -> Array:
        """Time derivative (S,) of the state at the section."""
        return self.pieces[0].rate(0.0, self.pieces[0].begin)


def record_of(case: HybridCase) -> Record:
    """Return the record of runs of a case: impacts, and with rigid contact also times of rest."""
    return COMPLIANT_RECORD if case.laws.compliant else RECORD


def follow_hybrid(case: HybridCase, phase: float, state: Array, span: float) -> HybridTrajectory:
    """Return the motion from a ``state`` (2 N_m + 2 n,) at a ``phase`` (rad) over a ``span`` (s).

    An elastic slider starts without force. A state beyond a rigid wall, by rounding or by a Newton
    step, is moved onto the wall. Raises `TrajectoryError` if the motion has no derivative.
    """
    if not np.all(np.isfinite(state)):
        raise TrajectoryError("the state is not finite")
    try:
        initial = InitialState.from_vector(case.scene, state)
        run = simulate(case.scene, case.drive(span, phase), initial=initial, record=record_of(case))
    except (IntegrationError, ParameterError) as error:
        raise TrajectoryError(str(error)) from error
    begin = initial.vector(case.scene)
    builder = (_CompliantBuilder if case.laws.compliant else _RigidBuilder)(case, phase, span, run)
    with np.errstate(over="ignore", invalid="ignore"):  # refused below
        result = builder.follow(begin)
    result.exact_end = run.end_state
    whole = (*result.end, *result.derivative.ravel(), *result.columns.ravel())
    if not np.all(np.isfinite(whole)):
        raise TrajectoryError("the motion or its derivative is not finite")
    core = len(run.end_state)
    units = case.units
    growth = np.max(np.abs(result.derivative[:core, :core] * units / units[:, None]))
    miss = float(np.max(np.abs(result.end[:core] - run.end_state) / units))
    if not miss <= min(END_TOL * max(1.0, float(growth)), MOST_END_MISS):
        raise TrajectoryError(f"the events leave the motion of the exact method by {miss:.1e}")
    return result


class _Builder:
    """Builder of a trajectory from the events of a run of the exact method."""

    def __init__(self, case: HybridCase, phase: float, span: float, run: Response) -> None:
        self.case = case
        self.run = run
        n = case.scene.model.modes
        self.places = case.scene.places
        self.half = n + self.places
        size = 2 * self.half + case.laws.has_slider
        self.trajectory = HybridTrajectory(case, phase, span, np.eye(size), np.zeros((size, 2)))
        self.displacement, self.speed = relative_rows(case)
        self.impulses = impulse_columns(case)

    def follow(self, begin: Array) -> HybridTrajectory:
        """Return the trajectory from a state (2 N_m + 2 n,) through all events."""
        raise NotImplementedError

    def begin_piece(self, regime: ContactRegime, time: float, state: Array) -> LinearPiece:
        """Begin a piece in a regime at a time (s) and return it."""
        trajectory = self.trajectory
        piece = LinearPiece(
            self.case, regime, time, trajectory.phase + self.case.omega * time, state
        )
        trajectory.pieces.append(piece)
        return piece

    def advance(self, time: float) -> tuple[LinearPiece, Array, float]:
        """Advance the derivatives to a time (s).

        Returns the present piece, the state (S,) at this time, and the time since the piece began.
        """
        trajectory = self.trajectory
        piece = trajectory.pieces[-1]
        dt = time - piece.time
        matrix = piece.propagator(dt)
        trajectory.derivative = matrix @ trajectory.derivative
        trajectory.columns = matrix @ trajectory.columns + piece.parameter_columns(dt)
        return piece, piece.states(np.array([dt]))[0], dt

    def apply_saltation(
        self, guard: Array, before: Array, after: Array, matrix: Array | None = None
    ) -> None:
        """Multiply the derivatives by a saltation matrix.

        ``guard`` (S,) is the row of the guard function, ``before`` and ``after`` (S,) are the time
        derivatives of the state, and ``matrix`` (S, S) is the jump of the state; None: no jump.
        """
        crossing = float(guard @ before)
        if crossing == 0.0:
            raise TrajectoryError("an event is only touched: no derivative")
        trajectory = self.trajectory
        straight = before if matrix is None else matrix @ before
        shift = np.outer(after - straight, guard) / crossing
        for name in ("derivative", "columns"):
            values = getattr(trajectory, name)
            moved = values if matrix is None else matrix @ values
            setattr(trajectory, name, moved + shift @ values)

    def add_event(self, *event: object) -> None:
        """Append an event."""
        self.trajectory.events.append(HybridEvent(*event))  # type: ignore[arg-type]


class _RigidBuilder(_Builder):
    """Rigid contact of one to four absorbers."""

    def __init__(self, case: HybridCase, phase: float, span: float, run: Response) -> None:
        super().__init__(case, phase, span, run)
        self.tolerance = SAME_TIME_TOL / case.omega
        self.holds = [self._joined_intervals(a) for a in range(self.places)]

    def _joined_intervals(self, absorber: int) -> list[tuple[float, float, int]]:
        """Return begin and end (s) of the joined phases of an absorber, and the wall that holds it.

        Phases that follow each other without a break are merged. The wall is then that of the last
        one.
        """
        phases = self.run.recorded.phases
        rows: list[tuple[float, float, int]] = []
        for k in np.flatnonzero(phases.absorber == absorber):
            wall = HOLDING_WALLS[int(phases.kind[k])]
            begin = float(phases.start[k])
            end = float(phases.end[k])
            if rows and begin <= rows[-1][1]:
                rows[-1] = (rows[-1][0], end, wall)
            elif end > begin:
                rows.append((begin, end, wall))
        return rows

    def _wall_of(self, absorber: int, time: float) -> int | None:
        """Return the wall that holds an absorber from a time (s) on.

        The result is 0 for friction and None if the absorber is not joined.
        """
        last = self.trajectory.span
        for begin, end, wall in self.holds[absorber]:
            open_end = end >= last - self.tolerance
            if begin <= time + self.tolerance and (end > time + self.tolerance or open_end):
                return wall
        return None

    def follow(self, begin: Array) -> HybridTrajectory:
        """See `_Builder`."""
        joined = tuple(self._wall_of(a, 0.0) is not None for a in range(self.places))
        rates = self.speed @ begin
        sign = tuple(self._direction(a, float(rates[a]), joined[a], 1) for a in range(self.places))
        self.begin_piece(ContactRegime(joined, sign), 0.0, begin)
        for marks in self._groups():
            self._handle(marks)
        self.trajectory.end = self.advance(self.trajectory.span)[1]
        return self.trajectory

    def _direction(self, absorber: int, rate: float, joined: bool, otherwise: int) -> int:
        """Return the slip direction of an absorber for its relative velocity (m/s).

        The result is 0 without friction.
        """
        if joined or self.case.laws.limit[absorber] == 0:
            return 0
        return int(np.sign(rate)) or otherwise

    def _groups(self) -> Iterator[list[HybridEvent]]:
        """Yield lists of events of the run that happen at the same instant, in the order of time.

        Two impacts of the same absorber are always separate.
        """
        impacts = self.run.recorded.impacts
        reversals = self.run.recorded.reversals
        marks = [
            HybridEvent(float(t), IMPACT, int(a), int(-np.sign(p)), float(p))
            for t, a, p in zip(impacts.time, impacts.absorber, impacts.impulse, strict=True)
        ]
        marks += [
            HybridEvent(float(t), REVERSAL, int(a))
            for t, a in zip(reversals.time, reversals.absorber, strict=True)
        ]
        for a, holds in enumerate(self.holds):
            marks += [HybridEvent(b, STICK, a, wall) for b, _, wall in holds if b > 0]
            marks += [
                HybridEvent(e, SLIP, a, wall)
                for _, e, wall in holds
                if e < self.trajectory.span - self.tolerance
            ]
        marks.sort(key=lambda mark: (mark.time, EVENT_KINDS.index(mark.kind)))
        group: list[HybridEvent] = []
        for mark in marks:
            apart = group and mark.time - group[0].time > self.tolerance
            again = mark.kind == IMPACT and any(
                known.kind == IMPACT and known.absorber == mark.absorber for known in group
            )
            if apart or again:
                yield group
                group = []
            group.append(mark)
        if group:
            yield group

    def _handle(self, marks: list[HybridEvent]) -> None:
        """Apply the events of one instant."""
        impacts = [mark for mark in marks if mark.kind == IMPACT]
        stops = {mark.absorber for mark in marks if mark.kind in (REVERSAL, STICK)}
        if impacts:
            self._impact(impacts)
            return
        if len(stops) > 1:
            raise TrajectoryError("two absorbers come to rest at one instant: no derivative")
        time = marks[0].time
        piece, state, dt = self.advance(time)
        joined = tuple(self._wall_of(a, time) is not None for a in range(self.places))
        before = piece.rate(dt, state)
        turning = next(iter(stops), None)
        sign = list(piece.regime.sign)
        if turning is not None:
            sign[turning] = 0 if joined[turning] else -sign[turning]
        regime = self._release(piece, dt, state, joined, sign)
        now = self.begin_piece(regime, time, self._at_rest(state, regime))
        if turning is not None and time > 0:
            self.apply_saltation(self.speed[turning], before, now.rate(0.0, now.begin))
        for mark in marks:
            if mark.kind != REVERSAL or not joined[mark.absorber]:
                self.add_event(*mark)

    def _release(
        self, piece: LinearPiece, dt: float, state: Array, joined: tuple[bool, ...], sign: list[int]
    ) -> ContactRegime:
        """Return the regime after an event without impact.

        An absorber that is released slips against the force that held it.
        """
        limit = self.case.laws.limit
        held = piece.regime.joined
        freed = [a for a in range(self.places) if held[a] and not joined[a]]
        if freed:
            still = tuple(h or j for h, j in zip(held, joined, strict=True))
            time = piece.time + dt
            phase = self.trajectory.phase + self.case.omega * time
            trial = LinearPiece(self.case, ContactRegime(still, tuple(sign)), time, phase, state)
            force = trial.contact_forces(0.0, state)
            for a in freed:
                sign[a] = 0 if limit[a] == 0 else -int(np.sign(force[a]))
        for a in range(self.places):
            if joined[a]:
                sign[a] = 0
        return ContactRegime(joined, tuple(sign))

    def _at_rest(self, state: Array, regime: ContactRegime) -> Array:
        """Return a state with zero relative velocities of joined absorbers.

        They are not exactly zero before because of rounding.
        """
        held = [a for a, joined in enumerate(regime.joined) if joined]
        if not held:
            return state
        impulses = np.linalg.solve(
            self.case.compliance[np.ix_(held, held)], -self.speed[held] @ state
        )
        return np.asarray(state + self.impulses[:, held] @ impulses)

    def _impact(self, marks: list[HybridEvent]) -> None:
        """Apply an impact.

        The impact law is applied, joined absorbers that it tears loose are released, and the slip
        directions of all other absorbers are updated. Further ``marks`` are absorbers in wall
        contact that the impact drives against their wall: they rebound at once.
        """
        laws = self.case.laws
        time = marks[0].time
        piece, state, dt = self.advance(time)
        held = piece.regime.joined
        if any(not held[mark.absorber] for mark in marks[1:]):
            raise TrajectoryError("impacts of two absorbers at one instant: no derivative")
        before = piece.rate(dt, state)
        first = marks[0].absorber
        n = self.half - self.places
        shape = self.case.scene.absorber_shapes[first]
        state[n + first] = float(shape @ state[:n]) + marks[0].wall * laws.gap[first]
        matrix = np.eye(len(state))
        after = state
        kicks = np.zeros(self.places)
        for mark in marks:
            a = mark.absorber
            bounce, impulse = self._apply_law(mark, float(self.speed[a] @ after))
            after = after + self.impulses[:, a] * impulse
            kicks += self.case.compliance[:, a] * impulse
            own = np.eye(len(state)) + bounce * np.outer(self.impulses[:, a], self.speed[a])
            matrix = own @ matrix
            self.add_event(time, IMPACT, a, mark.wall, impulse)
        joined = tuple(self._wall_of(b, time) is not None for b in range(self.places))
        rates = self.speed @ after
        still = self.case.units[-1] * AT_REST_TOL
        rates = np.where(held | (np.abs(rates) < still), kicks, rates)
        for mark in marks:
            rates[mark.absorber] = -mark.wall
        sign = tuple(
            self._direction(b, float(rates[b]), joined[b], piece.regime.sign[b])
            for b in range(self.places)
        )
        regime = ContactRegime(joined, sign)
        now = self.begin_piece(regime, time, self._at_rest(after, regime))
        self.apply_saltation(self.displacement[first], before, now.rate(0.0, now.begin), matrix)
        for b in range(self.places):
            if held[b] != joined[b]:
                self.add_event(time, STICK if joined[b] else SLIP, b, self._wall_of(b, time) or 0)

    def _apply_law(self, mark: HybridEvent, rate: float) -> tuple[float, float]:
        """Return impulse over relative velocity (N s^2/m), and the impulse (N s) of an impact.

        ``rate`` (m/s) is the relative velocity before the impact. The last impact of a chatter
        leaves no relative velocity, for any restitution.
        """
        compliance = float(self.case.compliance[mark.absorber, mark.absorber])
        recorded = -mark.impulse * compliance / rate - 1.0 if rate != 0.0 else 0.0
        own = float(self.case.laws.restitution[mark.absorber])
        restitution = own if abs(recorded - own) <= abs(recorded) else 0.0
        bounce = -(1 + restitution) / compliance
        return bounce, bounce * rate


class _CompliantBuilder(_Builder):
    """Builder for one absorber with compliant walls and elastic friction."""

    def follow(self, begin: Array) -> HybridTrajectory:
        """See `_Builder`."""
        laws = self.case.laws
        relative = float(self.displacement[0, : len(begin)] @ begin)
        wall = 0 if abs(relative) <= laws.gap[0] else int(np.sign(relative))
        state = np.append(begin, relative) if laws.has_slider else begin
        self.begin_piece(ContactRegime((False,), (0,), wall, laws.has_slider), 0.0, state)
        for mark in self._marks():
            self._handle(mark)
        self.trajectory.end = self.advance(self.trajectory.span)[1]
        return self.trajectory

    def _marks(self) -> list[HybridEvent]:
        """Return the events of the run in the order of time."""
        phases = self.run.recorded.phases
        marks = []
        last = self.trajectory.span
        for begin, end, kind in zip(phases.start, phases.end, phases.kind, strict=True):
            wall = HOLDING_WALLS[int(kind)]
            first, second = (CONTACT, SEPARATION) if wall else (STICK, SLIP)
            if begin > 0:
                marks.append(HybridEvent(float(begin), first, 0, wall))
            if end < last:
                marks.append(HybridEvent(float(end), second, 0, wall))
        return sorted(marks, key=lambda mark: (mark.time, EVENT_KINDS.index(mark.kind)))

    def _handle(self, mark: HybridEvent) -> None:
        """Apply an event: only the force on the absorber or its rate jumps."""
        piece, state, dt = self.advance(mark.time)
        regime = piece.regime
        guard = self.displacement[0]
        if mark.kind in (CONTACT, SEPARATION):
            regime = regime._replace(wall=mark.wall if mark.kind == CONTACT else 0)
            guard = guard.copy()
            guard[2 * self.half :] = 0.0
        elif mark.kind == STICK:
            regime = regime._replace(sticks=True, sign=(0,))
            guard = self.speed[0]
        else:
            stretch = float(guard @ state) - state[-1]
            regime = regime._replace(sticks=False, sign=(int(np.sign(stretch)),))
            guard = guard.copy()
            guard[-1] = -1.0
        now = self.begin_piece(regime, mark.time, state)
        self.apply_saltation(guard, piece.rate(dt, state), now.rate(0.0, state))
        self.add_event(*mark)


def piece_lengths(trajectory: HybridTrajectory) -> list[tuple[LinearPiece, float]]:
    """Return the pieces of a trajectory with their lengths in s."""
    times = trajectory.times
    return list(zip(trajectory.pieces, (b - a for a, b in pairwise(times)), strict=True))
