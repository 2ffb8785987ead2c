"""A motion found by shooting: its events, states at any time, and the tip's extremes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.parameters import require
from impact_env.periodic.green import Solution
from impact_env.periodic.passage import Passage
from impact_env.periodic.pieces import Piece
from impact_env.periodic.schedule import Event, EventSchedule

Array = NDArray[np.float64]
PANEL, NODES = 1.0, 6  # rad of the fastest exponential in a panel, and nodes of Gauss and Legendre in it
POINTS, WEIGHTS = (0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(NODES), (1.0, 0.0), strict=True))


@dataclass(frozen=True, eq=False)
class ShotMotion:
    """A solution and the passage over its span, whose first state is at the section: in the middle of a flight.

    It stands where `impact_env.periodic.motion.Motion` stands for orbits that are never joined.
    """

    solution: Solution
    passage: Passage

    @property
    def turns(self) -> Array:
        """Phases in rad of the force at which friction turns its sign while the absorber slides."""
        schedule = self.solution.schedule
        return np.asarray(self.solution.phases[[_turns(schedule, k) for k in range(len(schedule.events))]])

    @property
    def holds(self) -> bool:
        """Whether absorber and beam are joined for a while."""
        return not self.solution.schedule.flies

    @cached_property
    def tip_max(self) -> float:
        """Largest displacement of the tip in m."""
        return self._tip[0]

    @cached_property
    def tip_rms(self) -> float:
        """Root of the mean square of the tip's displacement in m."""
        return self._tip[1]

    @cached_property
    def _tip(self) -> tuple[float, float]:
        largest, square, end = 0.0, 0.0, self.passage.span
        stops = [piece.time for piece in self.passage.pieces[1:]] + [end]
        for piece, stop in zip(self.passage.pieces, stops, strict=True):
            peak, area = tip_of(piece, stop - piece.time)
            largest, square = max(largest, peak), square + area
        return largest, float(np.sqrt(square / end))

    def states(self, phases: ArrayLike) -> Array:
        """Return states (S, 2 N_m + 2), as `InitialState.vector`, at phases (S,) of the force in rad, any number of periods ahead or back."""
        given = np.asarray(phases, dtype=float)
        require(given.ndim == 1 and bool(np.all(np.isfinite(given))), "phases", phases, "a row of finite numbers in rad")
        case, schedule = self.solution.case, self.solution.schedule
        rounds = np.floor((given - self.passage.phase) / schedule.turn)
        times = (given - self.passage.phase - rounds * schedule.turn) / case.omega
        which = np.searchsorted([piece.time for piece in self.passage.pieces], times, side="right") - 1
        states = np.empty((len(given), 2 * case.model.modes + 2))
        for k in np.unique(which):
            piece, here = self.passage.pieces[k], which == k
            states[here] = piece.states(times[here] - piece.time)
        return np.where(rounds % 2 == 1, -1.0, 1.0)[:, None] * states if schedule.symmetric else states

    def state_at(self, phase: float) -> Array:
        """Return the state (2 N_m + 2,) at one phase of the force in rad."""
        return np.asarray(self.states([phase])[0])

    def mid_flight(self) -> tuple[float, Array]:
        """Return the phase (rad) of the force in the middle of the longest flight, where nothing is near, and the state (2 N_m + 2,) there."""
        passage, case = self.passage, self.solution.case
        times = [piece.time for piece in passage.pieces] + [passage.span]
        lengths = np.diff(times) * [not piece.flow.joined for piece in passage.pieces]
        ends = lengths[0] + lengths[-1]  # the flight that the section lies in
        k = int(np.argmax(lengths))
        middle = 0.5 * (times[k] + times[k + 1]) if lengths[k] > ends else 0.5 * (lengths[0] - lengths[-1])
        phase = passage.phase + case.omega * float(middle)
        return phase, self.state_at(phase)


def _turns(schedule: EventSchedule, k: int) -> bool:
    before, event = schedule.events[k - 1], schedule.events[k]
    return event.wall == 0 and event.sign != 0 and before.sign != 0


def tip_of(piece: Piece, length: float) -> tuple[float, float]:
    """Return the largest |tip displacement| (m) in a piece of a ``length`` in s, and the integral of its square (m^2 s)."""
    if length <= 0:
        return 0.0, 0.0
    shape, n = piece.flow.case.model.tip_shape, len(piece.flow.case.model.tip_shape)
    fastest = max(float(np.max(np.abs(piece.flow.modes.values))), piece.flow.case.omega)
    panels = max(1, int(np.ceil(length * fastest / PANEL)))
    step = length / panels
    dts = (step * (np.arange(panels)[:, None] + POINTS)).ravel()
    dts = np.concatenate([[0.0], dts, [length]])
    states = piece.states(dts)
    tip, rate = states[:, :n] @ shape, states[:, n + 1 : -1] @ shape
    area = step * float(np.sum(np.tile(WEIGHTS, panels) * tip[1:-1] ** 2))
    k = int(np.argmax(np.abs(tip)))
    peak = float(abs(tip[k]))
    for j in (k - 1, k):  # by Hermite's cubic over the gap between two nodes
        if 0 <= j < len(dts) - 1 and rate[j] * rate[j + 1] < 0:
            peak = max(peak, _peak(piece, float(dts[j]), float(dts[j + 1]), shape))
    return peak, area


def _peak(piece: Piece, low: float, high: float, shape: Array) -> float:
    """Return |tip displacement| (m) where the tip's velocity turns between two times (s), by the secant method."""
    n, ends = len(shape), [low, high]
    rates = [float(piece.state(dt)[n + 1 : -1] @ shape) for dt in ends]
    for _ in range(8):
        if rates[0] == rates[1]:
            break
        dt = min(max(ends[1] - rates[1] * (ends[1] - ends[0]) / (rates[1] - rates[0]), low), high)
        ends, rates = [ends[1], dt], [rates[1], float(piece.state(dt)[n + 1 : -1] @ shape)]
    return abs(float(piece.state(ends[1])[:n] @ shape))


def rotated(events: list[Event], phases: Array, impulses: Array, turn: float, symmetric: bool) -> tuple[tuple[Event, ...], Array, Array]:
    """Return events, phases (n,) in rad and impulses (n,) in N s counted from the first impact on, as they are where there is none."""
    first = next((k for k, event in enumerate(events) if event.is_impact), 0)
    side = -1.0 if symmetric else 1.0
    turned = [event.mirrored if symmetric else event for event in events[:first]]
    impulses = np.concatenate([impulses[first:], side * impulses[:first]])
    return (*events[first:], *turned), np.concatenate([phases[first:], phases[:first] + turn]), impulses
