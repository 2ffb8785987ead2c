"""The symmetric orbit with one impact a wall by dense matrices: no kernel, no Green's function, no modal exponential.

Physical state y = (q, q', x, x') of modes and absorber, y' = A y + B cos(omega t + phase) + C s with the friction's sign s. From just after the
impact on the lower wall, y0, half a period to just before the one on the upper wall, y1, and by its impact to -y0: linear in y0, cos and sin of the
phase.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from impact_env.periodic.case import Case

Array = np.ndarray


@dataclass(frozen=True)
class Truth:
    """A case as dense matrices; state (2 N_m + 2,): modal displacements, absorber's, modal velocities, absorber's."""

    case: Case

    @property
    def size(self) -> int:
        return 2 * self.case.model.modes + 2

    @property
    def mass(self) -> float:
        return self.case.mass_ratio * self.case.model.beam_mass

    @property
    def matrix(self) -> Array:
        model, n = self.case.model, self.case.model.modes
        a = np.zeros((self.size, self.size))
        a[: n + 1, n + 1 :] = np.eye(n + 1)
        a[n + 1 : -1, :n] = -np.diag(model.omega**2)
        a[n + 1 : -1, n + 1 : -1] = -np.diag(2 * model.damping_ratio * model.omega)
        return a

    @property
    def force(self) -> Array:
        n = self.case.model.modes
        return np.concatenate([np.zeros(n + 1), self.case.model.force_shape, [0.0]]) * self.case.force

    @property
    def push(self) -> Array:
        """Change of the state by a unit impulse on the absorber."""
        n = self.case.model.modes
        return np.concatenate([np.zeros(n + 1), -self.case.model.tip_shape, [1 / self.mass]])

    @property
    def distance(self) -> Array:
        n = self.case.model.modes
        return np.concatenate([-self.case.model.tip_shape, [1.0], np.zeros(n + 1)])

    @property
    def rate(self) -> Array:
        return np.roll(self.distance, self.case.model.modes + 1)

    @property
    def compliance(self) -> float:
        return float(self.rate @ self.push)

    @property
    def bounce(self) -> Array:
        """The impact as a matrix."""
        return np.eye(self.size) - (1 + self.case.restitution) / self.compliance * np.outer(self.push, self.rate)

    def flow(self, dt: float) -> Array:
        return scipy.linalg.expm(self.matrix * dt)

    def constant(self, dt: float) -> Array:
        """Response from rest over dt to a unit force on the absorber and its reaction."""
        whole = np.zeros((self.size + 1, self.size + 1))
        whole[:-1, :-1], whole[:-1, -1] = self.matrix, self.push
        return scipy.linalg.expm(whole * dt)[:-1, -1]

    def harmonic(self) -> Array:
        """Particular solution z (complex): y = Re(z exp(i (omega t + phase)))."""
        return np.linalg.solve(1j * self.case.omega * np.eye(self.size) - self.matrix, self.force.astype(complex))

    def half_turn(self) -> tuple[Array, Array, Array]:
        """Return y0 = constant + Re(wave exp(i phase)) and the same of the distance before the upper wall: (y0 constant, y0 wave, distance pair)."""
        dt = np.pi / self.case.omega
        flow, wave = self.flow(dt), self.harmonic()
        rub = -self.case.friction_limit * self.constant(dt)  # the absorber moves up against the tip
        bounce = self.bounce
        solve = np.linalg.solve(np.eye(self.size) + bounce @ flow, np.column_stack([-bounce @ rub, -bounce @ (-wave - flow @ wave)]))
        still, moving = solve[:, 0].real, solve[:, 1]
        before = (flow @ still + rub, flow @ (moving - wave) - wave)
        return still, moving, np.array([self.distance @ before[0], self.distance @ before[1]])

    def orbits(self) -> list[tuple[float, float, Array]]:
        """Return (phase at the lower wall, impulse there, state after it) of all symmetric orbits."""
        still, moving, (level, wave) = self.half_turn()
        share = (self.case.gap - level.real) / abs(wave)
        if abs(share) > 1:
            return []
        found = []
        for angle in (np.arccos(share), -np.arccos(share)):
            phase = float(angle - np.angle(wave)) % (2 * np.pi)
            y0 = still + (moving * np.exp(1j * phase)).real
            gamma = -float(self.rate @ y0) / self.case.restitution  # before the lower wall
            found.append((phase, -(1 + self.case.restitution) * gamma / self.compliance, y0))
        return sorted(found, key=lambda orbit: orbit[1])

    def fold_force(self) -> float:
        _, _, (level, wave) = self.half_turn()
        return abs(self.case.gap - level.real) / abs(wave) * abs(self.case.force)

    def half_multipliers(self, phase: float, y0: Array) -> Array:
        """Eigenvalues of the half map's derivative: a flight, the saltation matrix with the vector fields on both sides, and the mirror image."""
        dt = np.pi / self.case.omega
        wave, limit = self.harmonic(), self.case.friction_limit
        before = self.flow(dt) @ (y0 - (wave * np.exp(1j * phase)).real) - (wave * np.exp(1j * phase)).real - limit * self.constant(dt)
        after = self.bounce @ before
        forced = -self.force * np.cos(phase)
        field_before = self.matrix @ before + forced - limit * self.push
        field_after = self.matrix @ after + forced + limit * self.push
        bounce = self.bounce
        salt = bounce + np.outer(field_after - bounce @ field_before, self.distance) / (self.distance @ field_before)
        return np.linalg.eigvals(-salt @ self.flow(dt))


def matched(one: Array, other: Array) -> float:
    """Return the largest distance between two sets of eigenvalues, paired so that it is small."""
    rest, worst = list(other), 0.0
    for value in one:
        k = int(np.argmin([abs(value - candidate) for candidate in rest]))
        worst = max(worst, abs(value - rest.pop(k)))
    return worst
