"""The motion between the events of a solution: states at any time, the tip's extremes, and what happens that the schedule does not say."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.kernels.periodic.motion import Flights, flights_of, scan, states_at
from impact_env.kernels.periodic.structure import receptance
from impact_env.parameters import require
from impact_env.periodic.green import Solution

Array = NDArray[np.float64]
PENETRATION = 1e-9  # of the gap: above the rounding of a distance
MOST_TURNS = 4096


@dataclass(frozen=True, eq=False)
class Motion:
    """A solution's motion. ``tip_max``, ``tip_rms`` and ``distance_max`` (largest relative displacement) in m.

    ``turns`` (K,): phases in rad of the force at which the relative velocity changes its sign between impacts, whatever the schedule says.
    ``fits``: whether the signs so found lead from impact to impact.
    """

    solution: Solution
    flights: Flights
    tip_max: float
    tip_rms: float
    distance_max: float
    turns: Array
    fits: bool

    @property
    def penetration(self) -> float:
        """How far a wall is passed, in m; 0 where none is."""
        deep = max(self.distance_max - self.solution.case.gap, -self.clearance)
        return deep if deep > PENETRATION * self.solution.case.gap else 0.0

    @cached_property
    def clearance(self) -> float:
        """Least distance from a wall, in m, where the relative velocity turns between impacts: 0 is grazing, below it a wall is passed."""
        gap, n = self.solution.case.gap, self.solution.case.model.modes
        if len(self.turns) == 0:
            return gap
        states = self.states(self.turns)
        return gap - float(np.max(np.abs(states[:, n] - states[:, :n] @ self.solution.case.model.tip_shape)))

    @cached_property
    def longest_flight(self) -> int:
        """Index of the event that the longest flight follows."""
        return int(np.argmax(np.diff(self.flights.time)))

    def states(self, phases: ArrayLike) -> Array:
        """Return states (S, 2 N_m + 2), as `InitialState.vector`, at phases (S,) of the force in rad, any number of periods ahead or back."""
        solution, turn = self.solution, self.solution.schedule.turn
        given = np.asarray(phases, dtype=float)
        require(given.ndim == 1 and bool(np.all(np.isfinite(given))), "phases", phases, "a row of finite numbers in rad")
        rounds = np.floor((given - solution.phases[0]) / turn)
        within = given - rounds * turn
        order = np.argsort(within, kind="stable")
        case = solution.case
        out = np.empty((len(given), 2 * case.model.modes + 2))
        states_at(case.structure, case.point, self.flights, within[order] / case.omega, out)
        states = np.empty_like(out)
        states[order] = out
        if not solution.schedule.symmetric:
            return states
        return np.where(rounds % 2 == 1, -1.0, 1.0)[:, None] * states

    def state_at(self, phase: float) -> Array:
        """Return the state (2 N_m + 2,) at one phase of the force in rad."""
        return np.asarray(self.states([phase])[0])

    def mid_flight(self) -> tuple[float, Array]:
        """Return the phase (rad) of the force in the middle of the longest flight, where nothing is near, and the state (2 N_m + 2,) there."""
        i = self.longest_flight
        phase = 0.5 * self.solution.case.omega * float(self.flights.time[i] + self.flights.time[i + 1])
        return phase, self.state_at(phase)


def motion_of(solution: Solution) -> Motion:
    """Return the motion of a solution, by its exponentials from event to event; it is sampled several times in a radian of the fastest mode."""
    case, order = solution.case, solution.schedule.order
    structure, point = case.structure, case.point
    flights = flights_of(structure, point, order, solution.phases, solution.impulses)
    turns = np.empty(MOST_TURNS)
    h = receptance(structure, case.omega)[0]
    extremes, found, fits = scan(structure, point, h, flights, order, turns)
    phases = turns[: min(found, MOST_TURNS)] * case.omega
    return Motion(solution, flights, extremes.tip, float(np.sqrt(extremes.square)), extremes.distance, phases, bool(fits))
