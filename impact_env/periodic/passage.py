"""A motion from a section at a phase of the force, with the derivative of its end.

The times of impacts, reversals and joined phases are those of the exact method. The pieces between
them are in closed form, and saltation matrices connect their derivatives.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.kernels.periodic.motion import apply_saltation
from impact_env.modes import ModalModel
from impact_env.periodic.case import Case
from impact_env.periodic.schedule import Event, Regime
from impact_env.regimes import RegimeModes, checked_modes, solve_own_modes
from impact_env.results import Record, Response
from impact_env.scene import InitialState
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
RECORD = Record(
    level=False, events=True, reversals=True
)  # of all runs here, so that few kernels are compiled
JOINED_PHASE_TOL = 1e-10  # rad: a joined phase that begins so shortly after an impact begins at it
HOLDING_WALLS = (0, -1, 1)  # that holds the absorber in each kind of `ContactPhases`


class TrajectoryError(RuntimeError):
    """A motion that cannot be followed; the message says why."""


class OrbitEvent(NamedTuple):
    """One event of a motion.

    It has the ``time`` in s after the section, the ``event`` with the regime that follows it, and
    the ``impulse`` on the absorber in N s (0 if none).
    """

    time: float
    event: Event
    impulse: float


@dataclass(frozen=True, eq=False)
class Flow:
    """One regime of a case: its exponentials, and the forced response.

    ``up`` and ``down`` (J,) are the modal amplitudes of the forced response that rotate with the
    force and against it.
    """

    case: Case
    joined: bool
    modes: RegimeModes
    up: Complex
    down: Complex

    def forced(self, phase: float) -> Complex:
        """Return the modal amplitudes (J,) of the forced response at a phase (rad) of the force."""
        return np.asarray(self.up * np.exp(1j * phase) + self.down * np.exp(-1j * phase))

    def derivative(self, dt: float) -> Array:
        """Return the derivative of the state after ``dt`` (s) with respect to the state before.

        It has the shape (2 N_m + 2, 2 N_m + 2).
        """
        n = self.case.model.modes
        modes = self.modes
        matrix = np.real((modes.out * np.exp(modes.values * dt)) @ modes.into)
        if self.joined:  # the absorber keeps its place against the tip
            tip = self.case.model.tip_shape
            matrix[n], matrix[2 * n + 1] = tip @ matrix[:n], tip @ matrix[n + 1 : -1]
            matrix[n, n] += 1.0
            matrix[n, :n] -= tip
        else:
            matrix[n, n] = 1.0
            matrix[n, -1] = dt
            matrix[-1, -1] = 1.0
        return matrix


@lru_cache(maxsize=32)
def _modes(model: ModalModel, mass: float, joined: bool) -> RegimeModes:
    return (
        checked_modes(model, mass, None, 0.0)
        if joined
        else solve_own_modes(model, np.arange(model.modes))
    )


def _flow(case: Case, joined: bool) -> Flow:
    """Return a regime of a case.

    The steady response of a mode without damping at resonance is infinite.
    """
    modes = _modes(case.model, case.structure.mass, joined)
    with np.errstate(divide="ignore", invalid="ignore"):
        up, down = (
            0.5 * case.force * modes.drive / (side * 1j * case.omega - modes.values)
            for side in (1, -1)
        )
    return Flow(case, joined, modes, up, down)


@dataclass(frozen=True, eq=False)
class Piece:
    """The motion in one regime, from ``time`` (s after the section).

    Attributes
    ----------
    flow : Flow
        The regime.
    time : float
        Start of the piece in s.
    phase : float
        Phase of the force at the start in rad.
    force : float
        Constant friction force on a sliding absorber in N.
    begin : array, (2 N_m + 2,)
        State at the start.
    sign : int
        Sign of the relative velocity.
    wall : int
        Wall that holds a joined absorber, 0 for friction.
    """

    flow: Flow
    time: float
    phase: float
    force: float
    begin: Array
    sign: int
    wall: int

    @cached_property
    def rest(self) -> Complex:
        """Modal amplitudes (J,) of the response to the constant force."""
        modes = self.flow.modes
        return np.asarray(-modes.relative * self.force / modes.values)

    @cached_property
    def free(self) -> Complex:
        """Modal amplitudes (J,) at the start without forced and constant parts."""
        return np.asarray(
            self.flow.modes.into @ self.begin - self.flow.forced(self.phase) - self.rest
        )

    def states(self, dts: Array) -> Array:
        """Return the states (S, 2 N_m + 2) at times ``dts`` (S,) in s after the piece's start."""
        flow = self.flow
        modes = self.flow.modes
        n = self.flow.case.model.modes
        turned = np.exp(1j * (self.phase + flow.case.omega * dts))
        slots = (
            np.exp(np.outer(dts, modes.values)) * self.free
            + np.outer(turned, flow.up)
            + np.outer(np.conj(turned), flow.down)
            + self.rest
        )
        states = np.real(slots @ modes.out.T)
        if flow.joined:
            tip = flow.case.model.tip_shape
            states[:, n] = states[:, :n] @ tip + float(self.begin[n] - tip @ self.begin[:n])
            states[:, -1] = states[:, n + 1 : -1] @ tip
        else:
            acceleration = self.force / flow.case.structure.mass
            states[:, n] = self.begin[n] + dts * (self.begin[-1] + 0.5 * dts * acceleration)
            states[:, -1] = self.begin[-1] + dts * acceleration
        return np.asarray(states)

    def bend(self, dt: float, state: Array) -> float:
        """Return the relative acceleration (m/s^2) at ``dt`` (s), for a ``state`` at this time.

        The constant force of the piece acts.
        """
        structure = self.flow.case.structure
        n = self.flow.case.model.modes
        pull = self.flow.case.force * np.cos(self.phase + self.flow.case.omega * dt)
        modal = (
            structure.push * pull
            - structure.rate * state[n + 1 : -1]
            - structure.omega**2 * state[:n]
        )
        return float(self.force * structure.compliance - structure.tip @ modal)

    @property
    def force_on(self) -> float:
        """Force (N) on the absorber at the piece's start.

        On a joined absorber it is the force for which the relative acceleration is zero.
        """
        return (
            -self.bend(0.0, self.begin) / self.flow.case.structure.compliance
            if self.flow.joined
            else self.force
        )


@dataclass(eq=False)
class OrbitTrajectory:
    """A motion over ``span`` (s) from a section at ``phase`` (rad).

    ``end`` is its last state (2 N_m + 2,), and ``derivative`` (2 N_m + 2, 2 N_m + 2) the derivative
    of the end with respect to the state at the start. It loses one rank where friction begins to
    hold the absorber, and two where a chatter ends in wall contact.
    """

    case: Case
    phase: float
    span: float
    derivative: Array
    pieces: list[Piece] = field(default_factory=list)
    events: list[OrbitEvent] = field(default_factory=list)
    end: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def flights(self) -> tuple[Array, Array]:
        """Times (p + 1,) of the pieces in s, and durations of flight (p,) in s.

        The times are the starts of all p pieces and the end of the last one.
        """
        times = np.array([piece.time for piece in self.pieces] + [self.span])
        return times, np.diff(times) * [not piece.flow.joined for piece in self.pieces]

    def states(self, times: Array) -> Array:
        """Return the states (S, 2 N_m + 2) at times (S,) in s after the section.

        The times must be within the span.
        """
        which = np.searchsorted([piece.time for piece in self.pieces], times, side="right") - 1
        states = np.empty((len(times), 2 * self.case.model.modes + 2))
        for k in np.unique(which):
            states[which == k] = self.pieces[k].states(times[which == k] - self.pieces[k].time)
        return states


def follow_trajectory(case: Case, phase: float, state: Array, span: float) -> OrbitTrajectory:
    """Return the motion from a ``state`` (2 N_m + 2,) over a ``span`` (s).

    The state is that at a ``phase`` (rad) of the force. A state beyond a wall, by rounding or by a
    Newton step, is moved onto the wall. Raises TrajectoryError if the motion has no derivative.
    """
    if not np.all(np.isfinite(state)):
        raise TrajectoryError("the state is not finite")
    walk = _TrajectoryBuilder(case, phase, span)
    if not (np.all(np.isfinite(walk.free.up)) and np.all(np.isfinite(walk.joined.up))):
        raise TrajectoryError("a mode without damping is driven at its resonance")
    initial = InitialState.from_vector(case.scene, state)
    try:
        run = simulate(case.scene, case.drive(span, phase), initial=initial, record=RECORD)
    except (IntegrationError, ParameterError) as error:
        raise TrajectoryError(str(error)) from error
    walk.follow(initial.vector(case.scene), run)
    if not (
        np.all(np.isfinite(walk.trajectory.end)) and np.all(np.isfinite(walk.trajectory.derivative))
    ):
        raise TrajectoryError("the motion or its derivative is not finite")
    return walk.trajectory


class _RunEventKind(IntEnum):
    """Kinds of events of a run, in the order in which simultaneous events are applied."""

    IMPACT = 0
    REVERSAL = 1
    JOINING = 2
    PARTING = 3


class _RunEvent(NamedTuple):
    """An event of the exact method at a ``time`` (s).

    ``wall`` is the wall that is hit or that holds the absorber, ``restitution`` that of an impact,
    and ``holds`` says whether the wall holds the absorber afterwards.
    """

    time: float
    kind: _RunEventKind
    wall: int = 0
    restitution: float = 0.0
    holds: bool = False


def _list_run_events(case: Case, run: Response) -> list[_RunEvent]:
    """Return the events of a run in the order of time.

    An impact or reversal that leads to a joined phase is a single event with this phase.
    """
    assert run.impacts is not None
    assert run.phases is not None
    assert run.reversals is not None
    begins = run.phases.start
    ends = run.phases.end
    effective = run.impacts.impulse != 0  # one of zero, by rounding, changes nothing
    at = run.impacts.time[effective]
    impulse = run.impacts.impulse[effective]
    velocity = run.impacts.relative_velocity[effective]
    same = np.append(False, begins[1:] <= ends[:-1])[
        : len(begins)
    ]  # as the phase before, but for what holds
    rest = impulse + velocity / case.structure.compliance
    marks = []
    holds = set()
    for begin, kind in zip(begins[~same], run.phases.kind[~same], strict=True):
        before = int(np.searchsorted(at, begin, side="right")) - 1
        if before >= 0 and begin - at[before] <= JOINED_PHASE_TOL / case.omega:
            holds.add(before)
        else:
            marks.append(_RunEvent(float(begin), _RunEventKind.JOINING, HOLDING_WALLS[int(kind)]))
    for k, time in enumerate(at):
        whole = abs(rest[k]) > abs(
            rest[k] + case.restitution * velocity[k] / case.structure.compliance
        )
        marks.append(
            _RunEvent(
                float(time),
                _RunEventKind.IMPACT,
                int(-np.sign(impulse[k])),
                case.restitution if whole else 0.0,
                k in holds,
            )
        )
    marks += [
        _RunEvent(float(end), _RunEventKind.PARTING)
        for end in ends[~np.append(same[1:], False)[: len(ends)]]
        if end < run.drive.schedule.times[-1]
    ]
    marks += [
        _RunEvent(float(time), _RunEventKind.REVERSAL)
        for time in run.reversals.time
        if time not in begins
    ]
    return sorted(marks)


class _TrajectoryBuilder:
    """Builder of a trajectory from the events of a run."""

    def __init__(self, case: Case, phase: float, span: float) -> None:
        n = case.model.modes
        self.case = case
        self.trajectory = OrbitTrajectory(case, phase, span, np.eye(2 * n + 2))
        self.free = _flow(case, joined=False)
        self.joined = _flow(case, joined=True)
        self.sliding = Regime.SLIDING if case.friction_limit > 0 else Regime.FREE
        self.speed = np.concatenate(
            [np.zeros(n + 1), -case.model.tip_shape, [1.0]]
        )  # row of the relative velocity
        self.push = np.concatenate(
            [np.zeros(n + 1), -case.model.tip_shape, [1 / case.structure.mass]]
        )  # of a unit impulse on the absorber

    def follow(self, state: Array, run: Response) -> None:
        """Go through the events of the exact method's run from a ``state`` at its start."""
        # sign of the relative velocity just after the start, or else of the relative acceleration
        direction = int(np.sign(self.speed @ state))
        if direction == 0:
            bend = self._piece(self.free, 0.0, state, 1).bend(0.0, state)
            direction = 1 if bend > 0 else -1
        self._begin_piece(self.free, 0.0, state, direction)
        for mark in _list_run_events(self.case, run):
            self._follow_event(mark)
        self.trajectory.end = self._advance(self.trajectory.span)[1]

    def _follow_event(self, mark: _RunEvent) -> None:
        piece, state, bend = self._advance(mark.time)
        if mark.kind is _RunEventKind.IMPACT:
            self._apply_impact(piece, mark, state, bend)
        elif mark.kind is _RunEventKind.REVERSAL:
            self._apply_reversal(piece, mark.time, state, bend)
        elif mark.kind is _RunEventKind.JOINING:
            self._join(piece, mark, state, bend)
        else:
            self._release(piece, mark.time, state)

    def _advance(self, time: float) -> tuple[Piece, Array, float]:
        """Advance the present piece to a time (s).

        Returns the piece, the state at this time, and the relative acceleration of a flight.
        """
        piece = self.trajectory.pieces[-1]
        dt = time - piece.time
        self.trajectory.derivative = piece.flow.derivative(dt) @ self.trajectory.derivative
        state = piece.states(np.array([dt]))[0]
        return piece, state, 0.0 if piece.flow.joined else piece.bend(dt, state)

    def _at_rest(self, state: Array) -> Array:
        """Return a state with zero relative velocity, without the errors of rounding."""
        return np.asarray(
            state - self.push * float(self.speed @ state) / self.case.structure.compliance
        )

    def _piece(self, flow: Flow, time: float, state: Array, sign: int, wall: int = 0) -> Piece:
        force = 0.0 if flow.joined else -sign * self.case.friction_limit
        return Piece(
            flow, time, self.trajectory.phase + self.case.omega * time, force, state, sign, wall
        )

    def _begin_piece(
        self, flow: Flow, time: float, state: Array, sign: int, wall: int = 0
    ) -> Piece:
        self.trajectory.pieces.append(self._piece(flow, time, state, sign, wall))
        return self.trajectory.pieces[-1]

    def _add_event(self, time: float, event: Event, impulse: float = 0.0) -> None:
        self.trajectory.events.append(OrbitEvent(time, event, impulse))

    def _apply_saltation(
        self, wall: int, restitution: float, impulse: float, jump: float, rate: float, bend: float
    ) -> None:
        """Apply an event's saltation matrix to the derivative.

        ``jump`` (N) is the change of the force on the absorber.
        """
        if (bend if wall == 0 else rate) == 0.0:
            raise TrajectoryError("an event is only touched: no derivative")
        apply_saltation(
            self.case.structure,
            wall,
            restitution,
            impulse,
            jump,
            rate,
            bend,
            self.trajectory.derivative,
        )

    def _apply_reversal(self, piece: Piece, time: float, state: Array, bend: float) -> None:
        """Apply a slip reversal: the absorber continues to slide in the other direction."""
        if piece.sign * bend >= 0:
            if time == 0.0:  # the motion starts after the reversal, at rest but for rounding
                return
            raise TrajectoryError("the relative velocity only touches zero at a reversal")
        self._apply_saltation(0, 0.0, 0.0, 2 * piece.sign * self.case.friction_limit, 0.0, bend)
        self._add_event(time, Event(self.sliding, 0, -piece.sign))
        self._begin_piece(self.free, time, self._at_rest(state), -piece.sign)

    def _release(self, piece: Piece, time: float, state: Array) -> None:
        """Release the absorber when the joint force leaves its bounds.

        Neither the state nor its rate has a jump.
        """
        sign = (
            -piece.wall
            if piece.wall != 0
            else -int(np.sign(self._piece(self.joined, time, state, 0).force_on))
        )
        self._add_event(time, Event(self.sliding, 0, sign))
        self._begin_piece(self.free, time, state, sign)

    def _join(self, piece: Piece, mark: _RunEvent, state: Array, bend: float) -> None:
        """Apply the start of stick or wall contact: the relative velocity stays zero."""
        now = self._begin_piece(self.joined, mark.time, self._at_rest(state), 0, mark.wall)
        if mark.time > 0:  # else it is held from the start
            self._apply_saltation(0, 0.0, 0.0, now.force_on - piece.force, 0.0, bend)
        self._add_event(mark.time, Event(Regime.JOINED, mark.wall, 0))

    def _apply_impact(self, piece: Piece, mark: _RunEvent, state: Array, bend: float) -> None:
        """Apply an impact, after which the wall may hold the absorber.

        The wall holds it if all further bounces are below the rounding of the distance.
        """
        n = self.case.model.modes
        rate = float(self.speed @ state)
        wall = mark.wall
        state[n] = float(self.case.model.tip_shape @ state[:n]) + wall * self.case.gap
        impulse = -(1 + mark.restitution) * rate / self.case.structure.compliance
        after = np.asarray(state + impulse * self.push)
        self._add_event(mark.time, Event(self.sliding, wall, -wall), impulse)
        if mark.holds:
            self._add_event(mark.time, Event(Regime.JOINED, wall, 0))
        now = (
            self._begin_piece(self.joined, mark.time, after, 0, wall)
            if mark.holds
            else self._begin_piece(self.free, mark.time, after, -wall)
        )
        self._apply_saltation(
            wall, mark.restitution, impulse, now.force_on - piece.force, rate, bend
        )
