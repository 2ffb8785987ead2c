"""SciPy's solve_ivp and heyoka with terminal events, as peers of the exact method.

They are integrators that a user would choose otherwise. They integrate the regimes of
`reference.contact`.

A peer integrates one regime until a guard becomes negative; the changes between regimes are the
same for all peers. Events have a direction, and a run with a violated guard is refused, because a
missed event would give a wrong trajectory without notice.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.integrate import solve_ivp

from impact_env import Drive, InitialState, Scene, SeveralAbsorbers, StuckAbsorber
from reference.contact import Automaton, Contacts, Guard, Regime
from reference.mechanics import Linear
from reference.mechanics import Mechanics as DenseMechanics
from studies.study import Array

REST_SPEED = 1e-11  # m/s: slower bounces end a chatter
MAX_EVENTS = 5000
# m/s: sliding starts with this relative velocity, clear of rounding, so that its reversal is not
# found at once
NUDGE = 1e-13
VIOLATED = 1e-6  # of the gap, or of a typical value: a guard below minus this was missed


class PeerFailedError(RuntimeError):
    """A peer could not follow the scene."""


@dataclass(frozen=True, eq=False)
class PeerRun:
    """Result of a run of a peer.

    Impact times (s), end state (2 N_m + 2,), relative error of the energy balance if it was
    requested, and the time (s) spent in the integrator alone.
    """

    impact_time: Array
    end_state: Array
    balance: float | None
    wall_time: float


class Integrator(Protocol):
    """Integrates a state (2 N_m + 4,) in a regime until a guard or a time ends it.

    It returns the time reached, the state, and the guard that ended the integration (-1: none).
    """

    def __call__(
        self, regime: Regime, start: float, stop: float, state: Array
    ) -> tuple[float, Array, int]:
        """Integrate from ``start`` to ``stop`` (s)."""


class Mechanics(DenseMechanics):
    """The dense right-hand side of a scene's equations of motion.

    The state is q, q_a, q', v_a. With ``energy`` it also has the work of the force and the losses
    in J.
    """

    def __init__(self, scene: Scene, drive: Drive, energy: bool) -> None:
        if (
            isinstance(scene.absorber, StuckAbsorber | SeveralAbsorbers)
            or len(drive.schedule.times) != 2
        ):
            raise ValueError(
                "a stuck absorber, several absorbers and a bent schedule are not covered"
            )
        automaton = Automaton(scene.absorber)
        if automaton.slider is not None or automaton.bonded:
            raise ValueError("elastic friction, and walls without clearance, are not covered")
        super().__init__(scene, np.ones(scene.model.modes + 1))
        self.drive, self.energy, self.mass, self.compliance = (
            drive,
            energy,
            float(self.masses[0]),
            float(self.mobility[0, 0]),
        )
        self.square = self.model.omega**2
        self.rate = 2 * self.model.damping_ratio * self.model.omega
        omegas = drive.schedule.omegas
        self.start_omega = float(omegas[0])
        self.slope = float((omegas[1] - omegas[0]) / drive.schedule.times[1])
        self.made: dict[str, Linear] = {}

    def of(self, regime: Regime) -> Linear:
        """Return the equations in a regime."""
        if regime.name not in self.made:
            self.made[regime.name] = self.linear([regime])
        return self.made[regime.name]

    def force(self, t: float) -> float:
        """Return the force (N) at a time (s)."""
        return self.drive.amplitude * np.cos(
            self.drive.phase + (self.start_omega + 0.5 * self.slope * t) * t
        )

    def motion(self, x: Array) -> Array:
        """Return the dense state of a state with or without energies."""
        return np.append(x[: self.size - 1], 1.0)

    def rates(self, regime: Regime, t: float, x: Array) -> Array:
        """Return the rate of a state, with those of work and losses where energy is asked for."""
        linear = self.of(regime)
        f = self.force(t)
        state = self.motion(x)
        n = self.modes
        result = (linear.matrix @ state + linear.column[:, 0] * f)[:-1]
        if not self.energy:
            return np.asarray(result)
        u = x[n + 1 : 2 * n + 1]
        contact = linear.forces[0] @ state + linear.pushes[0, 0] * f
        return np.append(
            result,
            [
                f * (self.model.force_shape @ u),
                self.rate @ u**2 - contact * (self.speeds[0] @ state),
            ],
        )

    def value(self, regime: Regime, guard: Guard, t: float, x: Array) -> float:
        """Return a guard's value."""
        row, push = self.guard(0, guard, self.of(regime))
        return float(row @ self.motion(x) + push[0] * self.force(t))

    def excite_absorber(self, x: Array, restitution: float) -> None:
        """Apply an impact in place, and account for its loss."""
        state = self.motion(x)
        gamma = self.speeds[0] @ state
        self.impulse(state, [0], np.array([-(1 + restitution) * gamma]))
        x[: self.size - 1] = state[:-1]
        if self.energy:
            x[-1] += 0.5 * (1 - restitution**2) * gamma**2 / self.compliance

    def stored(self, x: Array) -> float:
        """Return the energy of modes and absorber; springs between them are in the losses."""
        n = self.modes
        energy = 0.5 * float(np.sum(self.square * x[:n] ** 2 + x[n + 1 : 2 * n + 1] ** 2))
        return energy + (
            0.0 if self.scene.absorber_mass is None else 0.5 * self.mass * x[2 * n + 1] ** 2
        )


def follow(
    scene: Scene,
    drive: Drive,
    initial: InitialState,
    make: Callable[[Mechanics, Automaton], Integrator],
    energy: bool = False,
) -> PeerRun:
    """Run a scene with a peer over the whole drive, with an account of its energy if wanted.

    Raises PeerFailedError if an event was missed or the peer gives up.
    """
    mechanics = Mechanics(scene, drive, energy)
    n = mechanics.modes
    end = float(drive.schedule.times[1])
    x = np.concatenate([initial.vector(scene), np.zeros(2 if energy else 0)])
    integrate = make(mechanics, Automaton(scene.absorber))
    start = x.copy()
    state = _FlightState(mechanics, x)
    contacts = Contacts(scene, state, REST_SPEED)
    state.nudge(contacts.regimes[0])
    times = [0.0] * len(contacts.struck)
    events = 0
    wall_time = 0.0
    while state.t < end:
        regime = contacts.regimes[0]
        began = time.perf_counter()
        state.t, state.x, hit = integrate(regime, state.t, end, state.x)
        wall_time += time.perf_counter() - began
        _check(mechanics, regime, state.t, state.x)
        if hit < 0:
            break
        events += 1
        if events > MAX_EVENTS:
            raise PeerFailedError(f"more than {MAX_EVENTS} events")
        contacts.jump(0, regime.guards[hit])
        times += [state.t] * len(contacts.struck)
        state.nudge(contacts.regimes[0])
    balance = None
    if energy:  # work less losses less gain of stored energy, relative to the largest of them
        before = mechanics.stored(start)
        after = mechanics.stored(state.x)
        work, losses = state.x[-2:]
        balance = float(
            abs(work - losses - after + before) / max(abs(work), abs(losses), before, after)
        )
    return PeerRun(np.array(times), state.x[: 2 * n + 2].copy(), balance, wall_time)


class _FlightState:
    """The state of a peer's run, as the contacts want to see and to change it."""

    def __init__(self, mechanics: Mechanics, x: Array) -> None:
        self.mechanics = mechanics
        self.x = x
        self.t = 0.0
        self.mobility = mechanics.mobility

    def relative(self, which: int) -> tuple[float, float]:  # noqa: ARG002 - there is one absorber
        m = self.mechanics
        state = self.mechanics.motion(self.x)
        return float(m.gaps[0] @ state), float(m.speeds[0] @ state)

    def pull(self) -> Array:
        m = self.mechanics
        return np.asarray(
            m.shapes @ (m.unforced @ m.motion(self.x) + m.driven[:, 0] * m.force(self.t))
        )

    def strike(self, which: int, restitution: float) -> None:  # noqa: ARG002
        self.mechanics.excite_absorber(self.x, restitution)

    def stop(self, which: Sequence[int]) -> None:  # noqa: ARG002
        self.mechanics.excite_absorber(self.x, 0.0)

    def nudge(self, regime: Regime) -> None:
        """Start sliding from rest with a velocity of its sign."""
        if regime.sliding and abs(self.relative(0)[1]) < NUDGE:
            self.x[2 * self.mechanics.modes + 1] += regime.sliding * NUDGE


def _check(mechanics: Mechanics, regime: Regime, t: float, x: Array) -> None:
    if not np.all(np.isfinite(x)):
        raise PeerFailedError("the state is not finite")
    for guard in regime.guards:
        size = (
            abs(guard.constant)
            if guard.constant
            else abs(x[2 * mechanics.modes + 1]) + abs(x[mechanics.modes + 1])
        )
        if mechanics.value(regime, guard, t, x) < -VIOLATED * max(size, 1e-12):
            raise PeerFailedError(
                f"passed a guard without noticing it ({guard.event} in {regime.name})"
            )


def scipy_integrator(tolerance: float) -> Callable[[Mechanics, Automaton], Integrator]:
    """Return SciPy's DOP853 with terminal events.

    The absolute tolerance is relative to the gap's order of magnitude.
    """

    def make(mechanics: Mechanics, automaton: Automaton) -> Integrator:  # noqa: ARG001 - as all peers
        first = 0.05 / float(np.max(mechanics.model.omega))

        def integrate(
            regime: Regime, start: float, stop: float, state: Array
        ) -> tuple[float, Array, int]:
            events: list[Any] = [
                lambda t, x, guard=guard: mechanics.value(regime, guard, t, x)
                for guard in regime.guards
            ]
            for event in events:
                event.terminal = True
                event.direction = -1
            solution = solve_ivp(
                lambda t, x: mechanics.rates(regime, t, x),
                (start, stop),
                state,
                method="DOP853",
                rtol=max(tolerance, 3e-14),
                atol=tolerance * 1e-3,
                events=events,
                first_step=min(first, stop - start),
            )
            if solution.status < 0:
                raise PeerFailedError(solution.message)
            hit = next((k for k, at in enumerate(solution.t_events or ()) if len(at)), -1)
            if hit >= 0 and solution.t[-1] <= start:
                raise PeerFailedError("an event is found again at its own time")
            return float(solution.t[-1]), np.array(solution.y[:, -1]), hit

        return integrate

    return make
