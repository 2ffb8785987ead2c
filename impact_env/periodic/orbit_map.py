"""The return map of an orbit as a Taylor polynomial.

It gives the map's second and third derivatives without differences.

States are truncated polynomials in three small numbers e_1, e_2, e_3 with e_k^2 = 0, eight
coefficients each. From a start x + e_1 u + e_2 v + e_3 w the coefficient of e_1 e_2 of the map is
B(u, v), and that of e_1 e_2 e_3 is C(u, v, w), to rounding. An event moves in time with the state,
so its time is such a polynomial as well. The map is smooth as long as the order of events stays the
same. Where an impact has no speed, or friction begins to hold at a reversal, that order changes and
the derivatives do not exist.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.codimension_two import CriticalPoint
from impact_env.periodic.green import Solution
from impact_env.periodic.motion import Motion
from impact_env.periodic.normal_forms import MapForms, Vector, euclidean
from impact_env.periodic.shooting import units_of

Polynomial = NDArray[np.complex128]  # (..., 8): coefficients of the products of e_1, e_2, e_3
_PAIRS = [(i, j) for i in range(8) for j in range(8) if i & j == 0]
_FIRST, _SECOND = np.array(_PAIRS).T
_COLLECT = np.zeros((len(_PAIRS), 8))
_COLLECT[np.arange(len(_PAIRS)), _FIRST | _SECOND] = 1.0
ORDERS = 4  # of a Taylor series: 1, t, t^2/2, t^3/6, as the fourth power of a small number is zero
EVENT_CORRECTIONS = 3  # each adds one exact order to an event's time


def multiply(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return the product of polynomials (..., 8)."""
    return np.asarray((a[..., _FIRST] * b[..., _SECOND]) @ _COLLECT)


def powers_of(shift: Polynomial) -> Polynomial:
    """Return 1, t, t^2/2, t^3/6 (4, 8) of a polynomial t (8,) without constant."""
    square = multiply(shift, shift)
    one = np.zeros(8, complex)
    one[0] = 1.0
    return np.array([one, shift, square / 2, multiply(square, shift) / 6])


def _real_if(result: Vector, *directions: Vector) -> Vector:
    """Return the real part of a result if all directions are real, else the result."""
    return result if any(np.iscomplexobj(each) for each in directions) else result.real


def critical_point_of(kind: str, motion: Motion, reference: Vector | None = None) -> CriticalPoint:
    """Return multipliers and normal form of a motion at a bifurcation of a ``kind``.

    See `CriticalPoint`.
    """
    return CriticalPoint(kind, OrbitMap(motion).forms(), reference)


class OrbitMap:
    """The map over the span of an orbit's schedule.

    It begins just after the first event of the orbit. If the span is half a period, the map is
    mirrored back.

    States are in units of the gap, and of the gap times the force's frequency. The derivative is
    that of `impact_env.periodic.motion.Motion`. Coefficients are those of a critical vector that
    has the length 1 in the middle of the longest flight, whichever event is the first.
    """

    def __init__(self, motion: Motion) -> None:
        solution = motion.solution
        case = solution.case
        self.solution: Solution = solution
        self.units = units_of(case)
        self.modes = case.model.modes
        self.state = motion.state_at(float(solution.phases[0])) / self.units
        self.matrix = motion.derivative * self.units / self.units[:, None]
        structure = case.structure
        own = structure.omega**2 - case.omega**2 + 1j * structure.rate * case.omega
        self.forced = case.force * structure.push / own
        self.structure = structure
        self.case = case

    def forms(self) -> MapForms:
        """Return the map's derivatives."""
        return MapForms(self.matrix, self.second, self.third, self.norm)

    def second(self, u: Vector, v: Vector) -> Vector:
        """Return B(u, v) (2 N_m + 2,)."""
        return _real_if(self.propagate((u, v))[:, 3], u, v)

    def third(self, u: Vector, v: Vector, w: Vector) -> Vector:
        """Return C(u, v, w) (2 N_m + 2,)."""
        return _real_if(self.propagate((u, v, w))[:, 7], u, v, w)

    def norm(self, vector: Vector) -> float:
        """Return the length of a small disturbance in the middle of the longest flight.

        The disturbance has the shape (2 N_m + 2,).
        """
        return euclidean(self.propagate((vector,), to_middle=True)[:, 1])

    def propagate(self, directions: tuple[Vector, ...], to_middle: bool = False) -> Polynomial:
        """Return the map's polynomial (2 N_m + 2, 8) for a disturbed start.

        The disturbed start is the orbit's start plus e_k times the k-th direction.

        ``to_middle``: to the middle of the longest flight, instead of over the whole span.
        """
        order = self.solution.schedule.order
        n = len(order.wall)
        omega = self.case.omega
        state = np.zeros((len(self.units), 8), complex)
        state[:, 0] = self.state * self.units
        for k, direction in enumerate(directions):
            state[:, 1 << k] = direction * self.units
        times = np.append(self.solution.phases, self.solution.phases[0] + order.turn) / omega
        shift = np.zeros(8, complex)
        longest = int(np.argmax(np.diff(times))) if to_middle else n
        for k in range(1, n + 1):
            i, mirror = (k, 1.0) if k < n else (0, order.mirror)
            friction = -self.case.friction_limit * order.sign[k - 1]
            begin = (times[k - 1], shift)
            if k - 1 == longest:
                middle = (0.5 * (times[k - 1] + times[k]), np.zeros(8, complex))
                return self._fly(state, begin, middle, friction) / self.units[:, None]
            wall = mirror * order.wall[i]
            state, shift = self._reach_event(state, begin, times[k], friction, wall)
            if wall != 0:
                state = self._bounce(state)
        friction = -self.case.friction_limit * order.mirror * order.sign[0]
        state = self._fly(state, (times[n], shift), (times[n], np.zeros(8, complex)), friction)
        return order.mirror * state / self.units[:, None]

    def _reach_event(
        self,
        state: Polynomial,
        begin: tuple[float, Polynomial],
        time: float,
        friction: float,
        wall: float,
    ) -> tuple[Polynomial, Polynomial]:
        """Return the state just before the event next to a ``time`` (s), and the event's delay.

        The delay has the shape (8,).
        """
        shift = np.zeros(8, complex)
        n = self.modes
        row = slice(n, n + 1) if wall != 0 else slice(2 * n + 1, 2 * n + 2)
        first = 0 if wall != 0 else n + 1
        rate = 0.0
        for step in range(EVENT_CORRECTIONS + 1):
            end = self._fly(state, begin, (time, shift), friction)
            if step == EVENT_CORRECTIONS:
                break
            gap = (end[row] - self.structure.tip @ end[first : first + n])[0]
            if step == 0:
                rate = self._rate(end[:, 0].real, time, friction, wall)
            gap[0] = 0.0
            shift = shift - gap / rate
        return end, shift

    def _rate(self, state: NDArray[np.float64], time: float, friction: float, wall: float) -> float:
        """Return the time derivative of an event's condition: of the relative position or velocity.

        It is the relative velocity in m/s at a wall, and the relative acceleration in m/s^2 at a
        reversal.
        """
        n = self.modes
        tip = self.structure.tip
        if wall != 0:
            return float(state[2 * n + 1] - tip @ state[n + 1 : 2 * n + 1])
        own = (
            -(self.structure.omega**2) * state[:n] - self.structure.rate * state[n + 1 : 2 * n + 1]
        )
        force = self.case.force * np.cos(self.case.omega * time) * self.structure.push
        modal = own + force - tip * friction
        return float(friction / self.structure.mass - tip @ modal)

    def _bounce(self, state: Polynomial) -> Polynomial:
        """Return the state after an impact."""
        n = self.modes
        structure = self.structure
        approach = state[2 * n + 1] - structure.tip @ state[n + 1 : 2 * n + 1]
        impulse = -(1 + self.case.restitution) / structure.compliance * approach
        state = state.copy()
        state[2 * n + 1] += impulse / structure.mass
        state[n + 1 : 2 * n + 1] -= structure.tip[:, None] * impulse
        return state

    def _fly(
        self,
        state: Polynomial,
        begin: tuple[float, Polynomial],
        end: tuple[float, Polynomial],
        friction: float,
    ) -> Polynomial:
        """Return the state after a flight between two times.

        Each time is given in s with its delay. The friction force (N) on the absorber is constant.
        """
        n = self.modes
        structure = self.structure
        span = end[0] - begin[0]
        late = end[1] - begin[1]
        powers = powers_of(late)
        length = powers[1].copy()
        length[0] = span
        response = np.zeros((n, ORDERS + 1))
        growth = structure.weight * np.exp(structure.s * span)
        for k in range(ORDERS + 1):
            np.add.at(response[:, k], structure.mode, (growth * structure.s**k).real)
        h = response[:, :ORDERS] @ powers
        rate = response[:, 1:] @ powers
        own = rate + structure.rate[:, None] * h
        before = self._particular(begin, friction)
        after = self._particular(end, friction)
        q = state[:n] - before[0]
        v = state[n + 1 : 2 * n + 1] - before[1]
        result = np.empty_like(state)
        result[:n] = multiply(own, q) + multiply(h, v) + after[0]
        result[n + 1 : 2 * n + 1] = (
            multiply(rate, v) - structure.omega[:, None] ** 2 * multiply(h, q) + after[1]
        )
        push = friction / structure.mass
        speed = state[2 * n + 1]
        result[n] = state[n] + multiply(length, speed + 0.5 * push * length)
        result[2 * n + 1] = speed + push * length
        return result

    def _particular(self, at: tuple[float, Polynomial], friction: float) -> Polynomial:
        """Return the modes' forced displacements and velocities (2, N_m, 8) at a time.

        They include the static deflection due to friction.
        """
        omega = self.case.omega
        turning = self.forced * np.exp(1j * omega * at[0])
        series = np.array([(turning * (1j * omega) ** k).real for k in range(ORDERS + 1)]).T
        powers = powers_of(at[1])
        place = series[:, :ORDERS] @ powers
        place[:, 0] -= self.structure.tip * friction / self.structure.omega**2
        return np.array([place, series[:, 1:] @ powers])
