"""The motion of a solution.

The module computes states at any time, the tip's extremes, events that the schedule does not list,
and the stability.

Floquet multipliers are the eigenvalues of the return map's derivative, by which a small disturbance
is multiplied in a period, or in half a period with the mirror image.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import require
from impact_env.kernels.periodic.motion import (
    Flights,
    compute_flights,
    compute_monodromy,
    compute_states,
    scan_flights,
)
from impact_env.kernels.periodic.structure import compute_receptance
from impact_env.periodic.case import Case
from impact_env.periodic.green import Solution
from impact_env.periodic.passage import OrbitTrajectory

Array = NDArray[np.float64]
PENETRATION = 1e-9  # of the gap: above the rounding of a distance
MOST_SUBDIVISIONS = 4096
# rad of the fastest exponential in a panel, and nodes of Gauss and Legendre in it
PANEL = 1.0
NODES = 6
POINTS, WEIGHTS = (
    0.5 * (part + shift)
    for part, shift in zip(np.polynomial.legendre.leggauss(NODES), (1.0, 0.0), strict=True)
)
Complex = NDArray[np.complex128]
States = Callable[[Array], Array]  # times (S,) in s -> states (S, 2 N_m + 2)
# times (K,) in s -> displacements (K,) in m and velocities (K,) in m/s where the response is read
Response = Callable[[Array], tuple[Array, Array]]
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Periodic:
    """A periodic motion.

    It is the common base of orbits whose absorber is never joined (`Motion`) and of those found by
    shooting (`ShotMotion`).
    """

    solution: Solution

    @property
    @abstractmethod
    def derivative(self) -> Array:
        """Derivative (2 N_m + 2, 2 N_m + 2) of the map over the schedule's span.

        If the span is half a period, the end is mirrored.
        """

    @property
    @abstractmethod
    def begin(self) -> float:
        """Phase of the force in rad from which the times of `within` count."""

    @abstractmethod
    def within(self, times: Array) -> Array:
        """Return the states (S, 2 N_m + 2) at times (S,) in s after `begin`, within one span."""

    @property
    @abstractmethod
    def level(self) -> tuple[float, float]:
        """Largest |displacement| and RMS in m at the place of the response level.

        This place is the tip unless the model defines another one.
        """

    @property
    def tip_max(self) -> float:
        """Largest |displacement| in m at the place of the response level."""
        return self.level[0]

    @property
    def tip_rms(self) -> float:
        """RMS of the displacement in m at the place of the response level."""
        return self.level[1]

    @abstractmethod
    def middle(self) -> float:
        """Return the time (s) after `begin` of the middle of the longest flight."""

    def states(self, phases: ArrayLike) -> Array:
        """Return states (S, 2 N_m + 2), as `InitialState.vector`, at phases (S,) of the force.

        The phases are in rad and may be outside of one period.
        """
        angles = np.asarray(phases, dtype=float)
        schedule = self.solution.schedule
        require(
            angles.ndim == 1 and bool(np.all(np.isfinite(angles))),
            "phases",
            phases,
            "a row of finite numbers in rad",
        )
        rounds = np.floor((angles - self.begin) / schedule.turn)
        states = self.within(
            (angles - self.begin - rounds * schedule.turn) / self.solution.case.omega
        )
        return (
            np.where(rounds % 2 == 1, -1.0, 1.0)[:, None] * states if schedule.symmetric else states
        )

    def state_at(self, phase: float) -> Array:
        """Return the state (2 N_m + 2,) at one phase of the force in rad."""
        return np.asarray(self.states([phase])[0])

    def mid_flight(self) -> tuple[float, Array]:
        """Return the phase (rad) of the force and the state in the middle of the longest flight.

        The state is (2 N_m + 2,). No event is close to this time.
        """
        phase = self.begin + self.solution.case.omega * self.middle()
        return phase, self.state_at(phase)


@dataclass(frozen=True, eq=False)
class Motion(Periodic):
    """The motion of a solution whose absorber is free or slides.

    Attributes
    ----------
    solution : Solution
        Events of the motion.
    flights : Flights
        Motion between events, for the kernels.
    at_absorber : (float, float)
        Largest |displacement| and RMS in m at the place of the absorber.
    distance_max : float
        Largest relative displacement in m.
    turns : array, (K,)
        Phases (rad) of the force at which the relative velocity changes its sign between impacts,
        whether the schedule has a reversal there or not.
    fits : bool
        Whether the signs of the relative velocity are consistent with the impacts.
    """

    flights: Flights
    at_absorber: tuple[float, float]
    distance_max: float
    turns: Array
    fits: bool

    @property
    def penetration(self) -> float:
        """Largest distance in m by which the absorber passes a wall, 0 if it does not."""
        deep = max(self.distance_max - self.solution.case.gap, -self.clearance)
        return deep if deep > PENETRATION * self.solution.case.gap else 0.0

    @cached_property
    def clearance(self) -> float:
        """Smallest distance from a wall in m at reversals of the relative velocity between impacts.

        It is 0 if the absorber grazes a wall, and negative if it passes a wall.
        """
        gap = self.solution.case.gap
        n = self.solution.case.model.modes
        if len(self.turns) == 0:
            return gap
        states = self.states(self.turns)
        return gap - float(
            np.max(np.abs(states[:, n] - states[:, :n] @ self.solution.case.model.tip_shape))
        )

    @property
    def begin(self) -> float:
        """The first event's phase."""
        return float(self.solution.phases[0])

    def within(self, times: Array) -> Array:
        """See `Periodic`."""
        case = self.solution.case
        order = np.argsort(times, kind="stable")
        out = np.empty((len(times), 2 * case.model.modes + 2))
        compute_states(
            case.structure, case.point, self.flights, times[order] + self.flights.time[0], out
        )
        states = np.empty_like(out)
        states[order] = out
        return states

    def middle(self) -> float:
        """See `Periodic`."""
        k = int(np.argmax(np.diff(self.flights.time)))
        time = self.flights.time
        return 0.5 * float(time[k] + time[k + 1]) - float(time[0])

    @cached_property
    def level(self) -> tuple[float, float]:
        """See `Periodic`."""
        model = self.solution.case.model
        times = self.flights.time - self.flights.time[0]
        if model.response_shape is None:
            return self.at_absorber
        flights = [
            (lambda dts, at=at: self.within(at + dts), float(length))
            for at, length in zip(times[:-1], np.diff(times), strict=True)
        ]
        return level_of(self.solution.case, flights)

    @property
    def derivative(self) -> Array:
        """Derivative of the map that begins just after the first event."""
        return self._monodromy[0]

    @property
    def turning(self) -> Array:
        """Relative acceleration before each reversal over its change by friction, (n,).

        At -1 or below the absorber slides on in the other direction; between -1 and 0 friction
        would hold it; above 0 the relative velocity does not reach zero. It is -inf at impacts.
        """
        return self._monodromy[1]

    @cached_property
    def _monodromy(self) -> tuple[Array, Array]:
        return _monodromy_of(self.solution, self.flights)


def _monodromy_of(solution: Solution, flights: Flights) -> tuple[Array, Array]:
    """Return `Motion.derivative` and `Motion.turning`."""
    case = solution.case
    order = solution.schedule.order
    size = 2 * case.model.modes + 2
    jumps = case.friction_limit * (
        np.append(order.mirror * order.sign[-1], order.sign[:-1]) - order.sign
    )
    matrix = np.empty((size, size))
    turning = np.empty(len(jumps))
    compute_monodromy(
        case.structure, case.point, order, flights, solution.impulses, jumps, matrix, turning
    )
    return matrix, turning


def derivative_of(solution: Solution) -> Array:
    """Return `Motion.derivative` without a check of the motion between events.

    The unknowns of ``solution`` need not satisfy the conditions exactly.
    """
    case = solution.case
    order = solution.schedule.order
    return _monodromy_of(
        solution,
        compute_flights(case.structure, case.point, order, solution.phases, solution.impulses),
    )[0]


def motion_of(solution: Solution) -> Motion:
    """Return the motion of a solution by its exponentials from event to event.

    It is sampled several times in a radian of the fastest mode.
    """
    case = solution.case
    order = solution.schedule.order
    structure = case.structure
    point = case.point
    flights = compute_flights(structure, point, order, solution.phases, solution.impulses)
    turns = np.empty(MOST_SUBDIVISIONS)
    h = compute_receptance(structure, case.omega)[0]
    extremes, result, fits = scan_flights(structure, point, h, flights, order, turns)
    phases = turns[: min(result, MOST_SUBDIVISIONS)] * case.omega
    return Motion(
        solution,
        flights,
        (extremes.tip, float(np.sqrt(extremes.square))),
        extremes.distance,
        phases,
        bool(fits),
    )


@dataclass(frozen=True, eq=False)
class ShotMotion(Periodic):
    """A solution and its trajectory over the span.

    Its first state is at the section, in the middle of a flight.
    """

    passage: OrbitTrajectory

    @property
    def begin(self) -> float:
        """The section's phase."""
        return self.passage.phase

    def within(self, times: Array) -> Array:
        """See `Periodic`."""
        return self.passage.states(times)

    def middle(self) -> float:
        """See `Periodic`; the section lies in a flight of which both ends are in the passage."""
        times, lengths = self.passage.flights
        k = int(np.argmax(lengths))
        around = lengths[k] <= lengths[0] + lengths[-1]
        return float(
            0.5 * (lengths[0] - lengths[-1]) if around else 0.5 * (times[k] + times[k + 1])
        )

    @property
    def derivative(self) -> Array:
        """Derivative of the map that begins at the section."""
        return (-1.0 if self.solution.schedule.symmetric else 1.0) * self.passage.derivative

    @cached_property
    def level(self) -> tuple[float, float]:
        """See `Periodic`."""
        lengths = np.diff(self.passage.flights[0])
        pieces = [
            (piece.states, float(length))
            for piece, length in zip(self.passage.pieces, lengths, strict=True)
        ]
        return level_of(self.solution.case, pieces)


AnyMotion = Motion | ShotMotion


def level_of(case: Case, pieces: Sequence[tuple[States, float]]) -> tuple[float, float]:
    """Return the largest |displacement| and the RMS in m at the place of the response level.

    ``pieces`` are pairs of a function that returns states at times (s), and a duration in s.
    """
    shape = case.model.level_shape
    n = case.model.modes
    fastest = max(float(np.max(np.abs(case.structure.s))), case.omega)

    def response(states_of: States) -> Response:
        def at(dts: Array) -> tuple[Array, Array]:
            states = states_of(dts)
            return states[:, :n] @ shape, states[:, n + 1 : -1] @ shape

        return at

    each = [piece_extremes(response(s), length, fastest) for s, length in pieces if length > 0]
    return max(peak for peak, _ in each), float(
        np.sqrt(sum(area for _, area in each) / sum(length for _, length in pieces))
    )


def piece_extremes(response: Response, length: float, fastest: float) -> tuple[float, float]:
    """Return the largest |displacement| (m) and the integral of its square (m^2 s) over a piece.

    ``response`` returns displacement (m) and velocity (m/s) at times (K,) in s, ``length`` is the
    duration in s, and ``fastest`` the largest exponent (1/s) of the motion.
    """
    panels = max(1, int(np.ceil(length * fastest / PANEL)))
    step = length / panels
    dts = np.concatenate([[0.0], (step * (np.arange(panels)[:, None] + POINTS)).ravel(), [length]])
    place, rate = response(dts)
    area = step * float(np.sum(np.tile(WEIGHTS, panels) * place[1:-1] ** 2))
    k = int(np.argmax(np.abs(place)))
    peak = float(abs(place[k]))
    for j in (k - 1, k):  # between two nodes
        if 0 <= j < len(dts) - 1 and rate[j] * rate[j + 1] < 0:
            peak = max(peak, _peak(response, float(dts[j]), float(dts[j + 1])))
    return peak, area


def _peak(response: Response, low: float, high: float) -> float:
    """Return |displacement| (m) at a reversal of the velocity between two times (s).

    The time is computed by the secant method.
    """
    ends = [low, high]
    rates = [float(response(np.array([dt]))[1][0]) for dt in ends]
    for _ in range(8):
        if rates[0] == rates[1]:
            break
        dt = min(max(ends[1] - rates[1] * (ends[1] - ends[0]) / (rates[1] - rates[0]), low), high)
        ends = [ends[1], dt]
        rates = [rates[1], float(response(np.array([dt]))[1][0])]
    return abs(float(response(np.array([ends[1]]))[0][0]))


@dataclass(frozen=True, eq=False)
class Stability:
    """The stability of an orbit.

    Attributes
    ----------
    multipliers : array, (2 N_m + 2,)
        Multipliers over the schedule's span, the largest first.
    half : bool
        Whether the span is half a period with the mirror image. Then +1 is a fold, and -1 breaks
        the symmetry.
    slow : array of int, (2,)
        Indices of the slow pair: its disturbances lie mostly in the resonant mode and decay as
        slowly as this mode's own vibration. All others are fast.
    """

    multipliers: Complex
    half: bool
    slow: NDArray[np.int64]

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle, so that small disturbances decay."""
        return bool(np.max(np.abs(self.multipliers)) < 1)

    @property
    def slow_multipliers(self) -> Complex:
        """The slow pair, (2,)."""
        return np.asarray(self.multipliers[self.slow])

    @property
    def fast_multipliers(self) -> Complex:
        """All multipliers except the slow pair, the largest first."""
        return np.asarray(np.delete(self.multipliers, self.slow))

    @property
    def slowly_stable(self) -> bool:
        """Whether the disturbances of the slow pair decay.

        A regime may then exist around an orbit that is unstable by a fast pair.
        """
        return bool(np.max(np.abs(self.slow_multipliers)) < 1)

    @property
    def full(self) -> Complex:
        """Multipliers over a whole period."""
        return np.asarray(self.multipliers**2 if self.half else self.multipliers)


def stability_of(motion: AnyMotion) -> Stability:
    """Return the stability of a motion, from its map's derivative."""
    values, vectors = np.linalg.eig(motion.derivative)
    rank = np.argsort(-np.abs(values), kind="stable")
    values = values[rank].astype(complex)
    vectors = vectors[:, rank]
    return Stability(
        values, motion.solution.schedule.symmetric, _slow_pair(motion, values, vectors)
    )


def _slow_pair(motion: AnyMotion, values: Complex, vectors: Complex) -> NDArray[np.int64]:
    """Return the indices (2,) of the multipliers that belong to the beam's own vibration.

    It is the vibration in the mode nearest to the force's frequency: the disturbances have their
    energy in this mode, and decay as the mode alone would over the span. A pair is a complex
    multiplier and its conjugate, or two real ones.
    """
    case = motion.solution.case
    model = case.model
    n = case.model.modes
    nearest = int(np.argmin(np.abs(model.omega - case.omega)))
    energy = (
        np.abs(vectors) ** 2
        * np.concatenate([model.omega**2, [0.0], np.ones(n), [case.structure.mass]])[:, None]
    )
    share = (energy[nearest] + energy[n + 1 + nearest]) / np.maximum(np.sum(energy, axis=0), TINY)
    alone = (
        -min(float(model.damping_ratio[nearest]), 1.0)
        * float(model.omega[nearest])
        * motion.solution.schedule.turn
        / case.omega
    )
    unlike = np.abs(np.log(np.maximum(np.abs(values), TINY)) - alone) - np.log(
        np.maximum(share, TINY)
    )
    upper = np.flatnonzero(values.imag > 0)
    real = np.flatnonzero(values.imag == 0)
    pairs = [
        (2 * float(unlike[k]), int(k), int(np.argmin(np.abs(values - np.conj(values[k])))))
        for k in upper
    ]
    pairs += [(float(unlike[j] + unlike[k]), int(j), int(k)) for j, k in combinations(real, 2)]
    return np.array(sorted(min(pairs)[1:]), dtype=np.int64)
