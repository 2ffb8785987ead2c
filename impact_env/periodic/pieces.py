"""Pieces of motion between two events in closed form, the free or sliding regime and the joined one; and where friction turns within a flight."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from impact_env.periodic.case import Case
from impact_env.regimes import Modes, checked_modes, own_modes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
GRID = 0.15  # rad of the fastest exponential from sample to sample
CHUNK = 256  # samples looked at together
ITERATIONS = 60
FROM_REST = 1e-6  # rad of the force


@dataclass(frozen=True, eq=False)
class Flow:
    """One regime of a case: its exponentials, and the constant answer to the force.

    ``up``, ``down`` (J,): slots of the forced motion that turn with the force and against it. ``weights`` (J,): of the signal that is watched, the
    relative displacement without the absorber's own share (free), or the tip displacement (joined). ``grid`` (CHUNK + 1, J): exponentials at samples
    ``step`` (s) apart.
    """

    case: Case
    joined: bool
    modes: Modes
    up: Complex
    down: Complex
    weights: Complex
    step: float
    grid: Complex

    def forced(self, phase: float) -> Complex:
        """Return the slots (J,) of the forced motion at a phase of the force in rad."""
        return np.asarray(self.up * np.exp(1j * phase) + self.down * np.exp(-1j * phase))

    def harmonic(self, weights: Complex) -> complex:
        """Return the amplitude a of the forced part Re(a exp(i phase)) of a signal with ``weights`` (J,)."""
        return complex(weights @ self.up + np.conj(weights @ self.down))

    @cached_property
    def watched(self) -> complex:
        """The forced part of the signal that is watched."""
        return self.harmonic(self.weights)

    def derivative(self, dt: float) -> Array:
        """Return the derivative (2 N_m + 2,)^2 of the state after ``dt`` (s) by the state before."""
        n, modes = self.case.model.modes, self.modes
        matrix = np.real((modes.out * np.exp(modes.values * dt)) @ modes.into)
        if self.joined:  # the absorber keeps its place against the tip
            tip = self.case.model.tip_shape
            matrix[n], matrix[2 * n + 1] = tip @ matrix[:n], tip @ matrix[n + 1 : -1]
            matrix[n, n] += 1.0
            matrix[n, :n] -= tip
        else:
            matrix[n, n], matrix[n, -1], matrix[-1, -1] = 1.0, dt, 1.0
        return matrix


@lru_cache(maxsize=32)
def _modes(model: ModalModel, mass: float, joined: bool) -> tuple[Modes, float, Complex]:
    """Return a regime's modes, the distance of samples in s, and the exponentials at them."""
    both = own_modes(model, np.arange(model.modes)), checked_modes(model, mass, None, 0.0)
    step = GRID / max(float(np.max(np.abs(modes.values))) for modes in both)
    return both[joined], step, np.exp(np.outer(np.arange(CHUNK + 1) * step, both[joined].values))


def flows_of(case: Case) -> tuple[Flow, Flow]:
    """Return the free (or sliding) and the joined regime of a case. A mode without damping at resonance has no steady answer: it is infinite."""
    return _flow(case, False), _flow(case, True)


def _flow(case: Case, joined: bool) -> Flow:
    modes, step, grid = _modes(case.model, case.structure.mass, joined)
    turn = 1j * case.omega
    with np.errstate(divide="ignore", invalid="ignore"):
        up, down = (0.5 * case.force * modes.drive / (side * turn - modes.values) for side in (1, -1))
    weights = modes.tip if joined else -modes.tip
    if step * case.omega > GRID:  # the force is faster than all modes
        step = GRID / case.omega
        grid = np.exp(np.outer(np.arange(CHUNK + 1) * step, modes.values))
    return Flow(case, joined, modes, up, down, np.asarray(weights, complex), step, grid)


@dataclass(frozen=True, eq=False)
class Piece:
    """The motion from ``time`` (s after the section) on, ``phase`` (rad) of the force there, with a constant ``force`` (N) on a sliding absorber.

    ``free`` (J,): slots without forced and constant part. ``place``, ``velocity`` of a free absorber (m, m/s); of a joined one, its place against the
    tip. ``sign`` of the relative velocity, ``wall`` that holds a joined absorber (0: friction does). ``rested``: a flight that begins without
    relative velocity, whatever rounding says.
    """

    flow: Flow
    time: float
    phase: float
    force: float
    free: Complex
    place: float
    velocity: float
    sign: int
    wall: int
    rested: bool = False

    @property
    def acceleration(self) -> float:
        """Of a free absorber, in m/s^2."""
        return 0.0 if self.flow.joined else self.force / self.flow.case.structure.mass

    @cached_property
    def rest(self) -> Complex:
        """Slots of the constant force."""
        modes = self.flow.modes
        return np.asarray(-modes.relative * self.force / modes.values)

    @cached_property
    def _loaded(self) -> Complex:
        """Shares (3, J) of the exponentials in the signal that is watched and its derivatives, times a power of s: 0 to 3."""
        share = self.flow.weights * self.free
        return np.array([share * self.flow.modes.values**k for k in range(4)])

    @cached_property
    def _level(self) -> float:
        return float(np.real(self.flow.weights @ self.rest))

    def states(self, dts: Array) -> Array:
        """Return the states (S, 2 N_m + 2) at times ``dts`` (S,) in s after the piece's start."""
        flow, modes, n = self.flow, self.flow.modes, self.flow.case.model.modes
        turned = np.exp(1j * (self.phase + flow.case.omega * dts))
        slots = np.exp(np.outer(dts, modes.values)) * self.free + np.outer(turned, flow.up) + np.outer(np.conj(turned), flow.down) + self.rest
        states = np.real(slots @ modes.out.T)
        if flow.joined:
            tip = flow.case.model.tip_shape
            states[:, n], states[:, -1] = states[:, :n] @ tip + self.place, states[:, n + 1 : -1] @ tip
        else:
            states[:, n] = self.place + dts * (self.velocity + 0.5 * dts * self.acceleration)
            states[:, -1] = self.velocity + dts * self.acceleration
        return np.asarray(states)

    def state(self, dt: float) -> Array:
        """Return the state (2 N_m + 2,) at ``dt`` (s) after the piece's start."""
        return np.asarray(self.states(np.array([dt]))[0])

    def relative(self, dt: float) -> Array:
        """Return relative displacement, velocity, acceleration and jerk (4,) of a free piece at ``dt`` (s)."""
        omega, turn = self.flow.case.omega, 1j * self.flow.case.omega
        wave = self.flow.watched * np.exp(1j * (self.phase + omega * dt))
        own = np.array(
            [self.place + dt * (self.velocity + 0.5 * dt * self.acceleration), self.velocity + dt * self.acceleration, self.acceleration, 0.0]
        )
        values = np.real(self._loaded @ np.exp(self.flow.modes.values * dt)) + np.real(wave * turn ** np.arange(4)) + own
        values[0] += self._level
        return np.asarray(values)

    @property
    def joint_force(self) -> float:
        """Force (N) on a joined absorber at the piece's start."""
        wave = self.flow.watched * np.exp(1j * self.phase) * (1j * self.flow.case.omega) ** 2
        return self.flow.case.structure.mass * float(np.real(np.sum(self._loaded[2])) + wave.real)

    def samples(self, start: float) -> tuple[Array, Array]:
        """Return times (CHUNK + 1,) in s from ``start`` on, and relative velocity and acceleration (2, CHUNK + 1) of a free piece there."""
        flow, turn = self.flow, 1j * self.flow.case.omega
        dts: Array = np.asarray(start + flow.step * np.arange(CHUNK + 1), dtype=np.float64)
        wave = flow.watched * np.exp(1j * (self.phase + flow.case.omega * dts))
        loaded = self._loaded[1:3] * np.exp(flow.modes.values * start)
        values = np.real(flow.grid @ loaded.T + wave[:, None] * turn ** np.arange(1, 3)).T
        values[0] += self.velocity + dts * self.acceleration
        values[1] += self.acceleration
        return dts, np.asarray(values)

    def turn(self, length: float) -> float | None:
        """Return when (s) the relative velocity of a free piece first leaves the piece's sign within a ``length`` (s), None if it does not.

        It is sampled; between two samples it may also dip below zero and come back, where its derivative turns. A flight from rest is looked at
        from `FROM_REST` on: before, its velocity is below rounding.
        """
        start = FROM_REST / self.flow.case.omega if self.rested else 0.0
        while start < length:
            dts, values = self.samples(start)
            dts = np.append(dts[dts < length], length) if dts[-1] >= length else dts
            speed, rise = self.sign * values[:, : len(dts)]
            speed[-1], rise[-1] = self.sign * self.relative(float(dts[-1]))[1:3]
            near = (rise[:-1] < 0) & (rise[1:] > 0) & (np.minimum(speed[:-1], speed[1:]) < 0.5 * self.flow.step * np.maximum(-rise[:-1], rise[1:]))
            for k in np.flatnonzero((speed[1:] < 0) | near):
                found = self._turn_between(float(dts[k]), float(dts[k + 1]), (rise[k], rise[k + 1]))
                if found is not None:
                    return found
            start = float(dts[-1])
        return None

    def _turn_between(self, low: float, high: float, rise: tuple[float, float]) -> float | None:
        """Return the first turn between two times (s), where the relative acceleration along the sign is ``rise``; it has one zero at most there."""
        places = [low, high]
        if rise[0] * rise[1] < 0:
            places.insert(1, root(lambda dt: (self.relative(dt)[2], self.relative(dt)[3]), low, high))
        for one, other in pairwise(places):  # the relative velocity is monotonous between
            if self.sign * self.relative(other)[1] < 0:
                if self.sign * self.relative(one)[1] > 0:
                    return root(lambda dt: (self.relative(dt)[1], self.relative(dt)[2]), one, other)
                return one
        return None


def piece_of(flow: Flow, time: float, phase: float, state: Array, sign: int, wall: int = 0, rested: bool = False) -> Piece:
    """Return the piece that begins with a ``state`` (2 N_m + 2,); friction acts against ``sign``."""
    case, n = flow.case, flow.case.model.modes
    force = 0.0 if flow.joined else -sign * case.friction_limit
    modes = flow.modes
    free = modes.into @ state - flow.forced(phase) + modes.relative * force / modes.values
    place = float(state[n] - case.model.tip_shape @ state[:n]) if flow.joined else float(state[n])
    return Piece(flow, time, phase, force, free, place, 0.0 if flow.joined else float(state[-1]), sign, wall, rested)


def root(f: Callable[[float], tuple[float, float]], low: float, high: float) -> float:
    """Return where a function, given with its derivative, is zero between two places at which its signs differ: Newton's method, else halving."""
    at_low, x = f(low)[0], 0.5 * (low + high)
    for _ in range(ITERATIONS):
        value, slope = f(x)
        if value == 0.0:
            return x
        if (value > 0) == (at_low > 0):
            low = x
        else:
            high = x
        new = x - value / slope if slope != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * abs(new) or new in (low, high):
            return new
        x = new
    return x
