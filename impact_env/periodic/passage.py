"""A motion from a section of the force's phase on, with its derivative: the exact method's events, and flights and saltation matrices between.

The times of impacts and joined phases are the exact method's. The pieces between are in closed form; reversals of friction, which that method does
not list, are located in them.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.periodic.monodromy import leap_over
from impact_env.parameters import ParameterError
from impact_env.periodic.case import Case, start_from
from impact_env.periodic.pieces import Flow, Piece, flows_of, piece_of
from impact_env.periodic.schedule import Event, Regime
from impact_env.response import Record, Response
from impact_env.sweep import IntegrationError, simulate

Array = NDArray[np.float64]
RECORD = Record(level=False, events=True)
SLIVER = 1e-10  # rad: what turns so shortly before another event is that event
WALLS = (0, -1, 1)  # that holds the absorber in each kind of `ContactPhases`


class PassageError(RuntimeError):
    """A motion that cannot be followed; the message says why."""


class Happening(NamedTuple):
    """One event: ``time`` in s after the section, what it was and led to, and the ``impulse`` on the absorber in N s (0 if none)."""

    time: float
    event: Event
    impulse: float


MOST_TURNS = 100  # reversals in a flight between two events of the exact method


@dataclass(eq=False)
class Passage:
    """A motion over ``span`` (s): its pieces, events, the ``end`` state (2 N_m + 2,) and the ``derivative`` of it by the state at the start.

    The derivative (2 N_m + 2,)^2 loses rank by one where friction takes hold of the absorber, and by two where a chatter ends on a wall.
    """

    case: Case
    phase: float
    span: float
    derivative: Array
    pieces: list[Piece] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    end: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def flights(self) -> tuple[Array, Array]:
        """When each piece begins and the last one ends, (p + 1,) in s, and how long the absorber flies in each, (p,) in s."""
        times = np.array([piece.time for piece in self.pieces] + [self.span])
        return times, np.diff(times) * [not piece.flow.joined for piece in self.pieces]

    def states(self, times: Array) -> Array:
        """Return the states (S, 2 N_m + 2) at times (S,) in s after the section, within the span."""
        which = np.searchsorted([piece.time for piece in self.pieces], times, side="right") - 1
        states = np.empty((len(times), 2 * self.case.model.modes + 2))
        for k in np.unique(which):
            states[which == k] = self.pieces[k].states(times[which == k] - self.pieces[k].time)
        return states


def passage(case: Case, phase: float, state: Array, span: float) -> Passage:
    """Return the motion from a ``state`` (2 N_m + 2,) at a ``phase`` (rad) of the force over a ``span`` (s); raises PassageError.

    A state that rounding or Newton's method put beyond a wall is put on it.
    """
    if not np.all(np.isfinite(state)):
        raise PassageError("the state is not finite")
    walk = _Walk(case, phase, span)
    if not (np.all(np.isfinite(walk.free.up)) and np.all(np.isfinite(walk.joined.up))):
        raise PassageError("a mode without damping is driven at its resonance")
    initial = start_from(case.scene, state)
    try:
        run = simulate(case.scene, case.drive(span, phase), initial=initial, record=RECORD)
    except (IntegrationError, ParameterError) as error:
        raise PassageError(str(error)) from error
    walk.follow(initial.vector(case.scene), run)
    if not (np.all(np.isfinite(walk.found.end)) and np.all(np.isfinite(walk.found.derivative))):
        raise PassageError("the motion or its derivative is not finite")
    return walk.found


class _Walk:
    """A passage on its way."""

    def __init__(self, case: Case, phase: float, span: float) -> None:
        n = case.model.modes
        self.case, self.found = case, Passage(case, phase, span, np.eye(2 * n + 2))
        self.free, self.joined = flows_of(case)
        self.sliding = Regime.SLIDING if case.friction_limit > 0 else Regime.FREE
        self.speed = np.concatenate([np.zeros(n + 1), -case.model.tip_shape, [1.0]])  # row of the relative velocity
        self.push = np.concatenate([np.zeros(n + 1), -case.model.tip_shape, [1 / case.structure.mass]])  # of a unit impulse on the absorber

    def follow(self, state: Array, run: Response) -> None:
        """Go through the events of the exact method's run from a ``state`` at its start."""
        assert run.impacts is not None
        assert run.phases is not None
        marks = [
            (float(t), 0, int(-np.sign(p)), float(r)) for t, p, r in zip(run.impacts.time, run.impacts.impulse, self._restitutions(run), strict=True)
        ]
        begins, ends = run.phases.start, run.phases.end
        for k in range(len(begins)):
            if k == 0 or begins[k] > ends[k - 1]:  # what holds may change on the spot
                marks.append((float(begins[k]), 1, WALLS[int(run.phases.kind[k])], 0.0))
            if ends[k] < self.found.span and (k + 1 == len(begins) or begins[k + 1] > ends[k]):
                marks.append((float(ends[k]), 2, 0, 0.0))
        self._go_on(self.free, 0.0, state, 1 if float(self.speed @ state) > 0 else -1)
        marks.sort()
        for k, (time, what, wall, restitution) in enumerate(marks):
            if what == 1 and k > 0 and marks[k - 1][1] == 0 and time - marks[k - 1][0] <= SLIVER / self.case.omega:
                continue  # the impact before has seen to it
            piece, state, bend = self._advance(time)
            if what == 0:
                after = marks[k + 1] if k + 1 < len(marks) else (np.inf, 0, 0, 0.0)
                self._hit(piece, time, state, bend, wall, restitution, after[1] == 1 and after[0] - time <= SLIVER / self.case.omega)
            elif what == 1:
                self._hold(piece, time, state, bend, wall)
            else:
                self._release(piece, time, state)
        self.found.end = self._advance(self.found.span)[1]

    def _restitutions(self, run: Response) -> Array:
        """Return the restitution of each impact: 0 of one that completes a chatter."""
        assert run.impacts is not None
        speed, impulse = run.impacts.relative_velocity, run.impacts.impulse
        whole = np.abs(impulse + (1 + self.case.restitution) * speed / self.case.structure.compliance)
        return np.where(whole < np.abs(impulse + speed / self.case.structure.compliance), self.case.restitution, 0.0)

    def _advance(self, time: float) -> tuple[Piece, Array, float]:
        """Fly, reversals included, or be held until a time (s); return the piece then, the state, and the relative acceleration of a flight."""
        for _ in range(MOST_TURNS):
            piece = self.found.pieces[-1]
            dt, turn = time - piece.time, None
            if self.case.friction_limit > 0 and not piece.flow.joined:
                turn = piece.turn(dt - SLIVER / self.case.omega)
            dt = dt if turn is None else turn
            self.found.derivative = piece.flow.derivative(dt) @ self.found.derivative
            state, bend = piece.state(dt), 0.0 if piece.flow.joined else float(piece.relative(dt)[2])
            if turn is None:
                return piece, state, bend
            if piece.sign * bend >= 0:
                raise PassageError("the relative velocity only touches zero at a reversal")
            state = self._at_rest(state)
            self._leap(0, 0.0, 0.0, 2 * piece.sign * self.case.friction_limit, 0.0, bend)
            self._note(piece.time + dt, Event(self.sliding, 0, -piece.sign))
            self._go_on(self.free, piece.time + dt, state, -piece.sign, rested=True)
        raise PassageError("reversals without end")

    def _at_rest(self, state: Array) -> Array:
        """Return a state without what rounding left of the relative velocity."""
        return np.asarray(state - self.push * float(self.speed @ state) / self.case.structure.compliance)

    def _go_on(self, flow: Flow, time: float, state: Array, sign: int, wall: int = 0, rested: bool = False) -> None:
        self.found.pieces.append(piece_of(flow, time, self.found.phase + self.case.omega * time, state, sign, wall, rested))

    def _note(self, time: float, event: Event, impulse: float = 0.0) -> None:
        self.found.happenings.append(Happening(time, event, impulse))

    def _leap(self, wall: int, restitution: float, impulse: float, jump: float, rate: float, bend: float) -> None:
        """Take an event's saltation matrix to the derivative; ``jump`` (N) of the force on the absorber."""
        if (bend if wall == 0 else rate) == 0.0:
            raise PassageError("an event is only touched: no derivative")
        leap_over(self.case.structure, wall, restitution, impulse, jump, rate, bend, self.found.derivative)

    def _release(self, piece: Piece, time: float, state: Array) -> None:
        """The joint force leaves its bounds without a jump: neither the state nor its rate has one."""
        here = piece_of(self.joined, time, self.found.phase + self.case.omega * time, state, 0)
        sign = -piece.wall if piece.wall != 0 else -int(np.sign(here.joint_force))
        self._note(time, Event(self.sliding, 0, sign))
        self._go_on(self.free, time, state, sign, rested=True)

    def _hold(self, piece: Piece, time: float, state: Array, bend: float, wall: int) -> None:
        """The relative velocity is zero, and friction or a wall holds the absorber from now on."""
        self._go_on(self.joined, time, self._at_rest(state), 0, wall)
        if time > 0:  # else it is held from the start
            self._leap(0, 0.0, 0.0, self.found.pieces[-1].joint_force - piece.force, 0.0, bend)
        self._note(time, Event(Regime.JOINED, wall, 0))

    def _hit(self, piece: Piece, time: float, state: Array, bend: float, wall: int, restitution: float, holds: bool) -> None:
        """An impact, after which the wall may hold the absorber: where all bounces to come are below the rounding of the distance."""
        n, rate = self.case.model.modes, float(self.speed @ state)
        state[n] = float(self.case.model.tip_shape @ state[:n]) + wall * self.case.gap
        impulse = -(1 + restitution) * rate / self.case.structure.compliance
        after = np.asarray(state + impulse * self.push)
        self._note(time, Event(self.sliding, wall, -wall), impulse)
        if holds:
            self._note(time, Event(Regime.JOINED, wall, 0))
            self._go_on(self.joined, time, after, 0, wall)
        else:
            self._go_on(self.free, time, after, -wall, 0, restitution == 0.0)
        now = self.found.pieces[-1]
        self._leap(wall, restitution, impulse, (now.joint_force if holds else now.force) - piece.force, rate, bend)
