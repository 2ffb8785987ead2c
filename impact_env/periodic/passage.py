"""A motion from a section of the force's phase on, event by event, with its derivative: free, sliding, stuck, and held against a wall.

Regimes are propagated in closed form and events found among samples of their guards. Nothing of the exact method's event search is used, so it can
be the judge of what comes out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.case import Case
from impact_env.periodic.crossing import REVERSAL, end_of_flight, end_of_hold
from impact_env.periodic.pieces import Flow, Piece, flows_of, piece_of
from impact_env.periodic.saltation import Mechanics
from impact_env.periodic.schedule import Event, Regime

Array = NDArray[np.float64]
MOST_EVENTS = 20000  # in a passage
ROUNDING = 1e-14  # of a distance's terms: bounces whose heights sum up to less end a chatter
LEAST_LOSS = 0.1  # 1 - e counts as at least this there


class PassageError(RuntimeError):
    """A motion that cannot be followed; the message says why."""


class Happening(NamedTuple):
    """One event: ``time`` in s after the section, what it was and led to, and the ``impulse`` on the absorber in N s (0 if none)."""

    time: float
    event: Event
    impulse: float


@dataclass(eq=False)
class Passage:
    """A motion over ``span`` (s): its pieces, events, the ``end`` state (2 N_m + 2,) and the ``derivative`` of it by the state at the start.

    The derivative (2 N_m + 2,)^2 loses rank by one where friction takes hold of the absorber, and by two where a chatter ends on a wall.
    """

    case: Case
    phase: float
    span: float
    pieces: list[Piece] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    end: Array = field(default_factory=lambda: np.zeros(0))
    derivative: Array = field(default_factory=lambda: np.zeros((0, 0)))


def passage(case: Case, phase: float, state: Array, span: float) -> Passage:
    """Return the motion from a free ``state`` (2 N_m + 2,) at a ``phase`` (rad) of the force over a ``span`` (s); raises PassageError.

    A state that rounding or Newton's method put beyond a wall goes on from there.
    """
    walk = _Walk(case, Passage(case, phase, span))
    walk.start(np.asarray(state, dtype=float))
    while walk.step():
        if len(walk.found.happenings) > MOST_EVENTS:
            raise PassageError(f"more than {MOST_EVENTS} events in a period")
    return walk.found


class _Walk:
    """The piece in use, and the derivative up to its start."""

    def __init__(self, case: Case, found: Passage) -> None:
        self.case, self.found, self.mechanics = case, found, Mechanics(case)
        self.free, self.joined = flows_of(case)
        self.matrix = np.eye(2 * case.model.modes + 2)
        if not (np.all(np.isfinite(self.free.up)) and np.all(np.isfinite(self.joined.up))):
            raise PassageError("a mode without damping is driven at its resonance")

    @property
    def sliding(self) -> Regime:
        return Regime.SLIDING if self.case.friction_limit > 0 else Regime.FREE

    def start(self, state: Array) -> None:
        if not np.all(np.isfinite(state)):
            raise PassageError("the state is not finite")
        self._go_on(self.free, 0.0, state, 1 if float(self.mechanics.speed @ state) > 0 else -1, 0)

    def step(self) -> bool:
        """Advance to the next event and let it happen; return False at the end of the span."""
        piece = self.found.pieces[-1]
        left = self.found.span - piece.time
        crossing = end_of_hold(piece, left) if piece.flow.joined else end_of_flight(piece, left)
        dt = left if crossing is None else crossing.dt
        self.matrix = piece.flow.derivative(dt) @ self.matrix
        state = piece.state(dt)
        if not np.all(np.isfinite(state)):
            raise PassageError("the motion is not finite")
        if crossing is None:
            if not np.all(np.isfinite(self.matrix)):
                raise PassageError("the derivative is not finite")
            self.found.end, self.found.derivative = state, self.matrix
            return False
        time = piece.time + dt
        if piece.flow.joined:
            self._release(time, state, crossing.kind)
        elif crossing.kind == REVERSAL:
            self._turn(piece, time, state)
        else:
            self._hit(piece, time, state, crossing.kind)
        return True

    def _phase(self, time: float) -> float:
        return self.found.phase + self.case.omega * time

    def _go_on(self, flow: Flow, time: float, state: Array, sign: int, wall: int, rested: bool = False) -> None:
        self.found.pieces.append(piece_of(flow, time, self._phase(time), state, sign, wall, rested))

    def _note(self, time: float, event: Event, impulse: float = 0.0) -> None:
        self.found.happenings.append(Happening(time, event, impulse))

    def _release(self, time: float, state: Array, kind: int) -> None:
        """The joint force leaves its bounds without a jump: neither the state nor its rate has one."""
        sign = -kind
        self._note(time, Event(self.sliding, 0, sign))
        self._go_on(self.free, time, state, sign, 0, True)

    def _turn(self, piece: Piece, time: float, state: Array) -> None:
        """The relative velocity is zero: friction holds, or acts the other way from now on."""
        mechanics, limit, phase = self.mechanics, self.case.friction_limit, self._phase(time)
        state = state - mechanics.push * float(mechanics.speed @ state) / self.case.structure.compliance  # of the order of rounding
        before = mechanics.field(state, phase, piece.force)
        needed = mechanics.holding(mechanics.field(state, phase, 0.0))
        if abs(needed) <= limit:
            self._leap(before, mechanics.field(state, phase, None), mechanics.speed)
            self._note(time, Event(Regime.JOINED, 0, 0))
            self._go_on(self.joined, time, state, 0, 0)
            return
        sign = -1 if needed > 0 else 1
        if sign == piece.sign:
            raise PassageError("the relative velocity only touches zero at a reversal")
        self._leap(before, mechanics.field(state, phase, -sign * limit), mechanics.speed)
        self._note(time, Event(self.sliding, 0, sign))
        self._go_on(self.free, time, state, sign, 0)

    def _hit(self, piece: Piece, time: float, state: Array, wall: int) -> None:
        """An impact; where all bounces to come are below the rounding of the distance, it takes the rest of the relative velocity too."""
        mechanics, case, phase = self.mechanics, self.case, self._phase(time)
        state = state.copy()
        state[case.model.modes] += wall * case.gap - float(mechanics.distance @ state)
        before = mechanics.field(state, phase, piece.force)
        rests = self._rests(piece, state, phase, wall)
        restitution = 0.0 if rests else case.restitution
        after, impulse = mechanics.bounced(state, restitution)
        holds = rests and wall * mechanics.holding(mechanics.field(after, phase, 0.0)) <= case.friction_limit
        field_after = mechanics.field(after, phase, None if holds else wall * case.friction_limit)
        self._leap(before, field_after, mechanics.distance, restitution)
        self._note(time, Event(self.sliding, wall, -wall), impulse)
        if holds:
            self._note(time, Event(Regime.JOINED, wall, 0))
            self._go_on(self.joined, time, after, 0, wall)
        else:
            self._go_on(self.free, time, after, -wall, 0, restitution == 0.0)

    def _rests(self, piece: Piece, state: Array, phase: float, wall: int) -> bool:
        """Return whether the heights of all bounces to come add up to less than rounding, as the exact method asks it."""
        case, mechanics = self.case, self.mechanics
        if case.restitution == 0.0:
            return True
        after = case.restitution * float(mechanics.speed @ state)
        pressed = wall * float(mechanics.speed @ mechanics.field(state, phase, -wall * case.friction_limit))
        return pressed >= 0 and after * after <= 2 * pressed * ROUNDING * piece.size * max(1 - case.restitution, LEAST_LOSS)

    def _leap(self, before: Array, after: Array, guard: Array, restitution: float | None = None) -> None:
        """Take the saltation matrix of an event to the derivative."""
        if guard @ before == 0.0:
            raise PassageError("an event is only touched: no derivative")
        self.matrix = self.mechanics.saltation(before, after, guard, restitution) @ self.matrix
