"""The symmetric orbit with one impact at each wall by dense matrices.

It uses no kernel, no Green's function and no modal exponential.

Physical state y = (q, q', x, x') of modes and absorber, y' = A y + B cos(omega t + phase) + C s
with the friction's sign s. From just after the impact on the lower wall, y0, half a period to just
before the one on the upper wall, y1, and by its impact to -y0: linear in y0, cos and sin of the
phase.
"""

import numpy as np
import scipy.linalg

from impact_env.periodic.case import Case
from reference.contact import Regime
from reference.mechanics import Mechanics

Array = np.ndarray


class Truth:
    """A case as dense matrices.

    The state (2 N_m + 2,) has modal displacements, the absorber's, modal velocities, and the
    absorber's.

    ``push``: change of the state by a unit impulse on the absorber; ``distance``, ``rate``: rows of
    relative displacement and velocity; ``bounce``: the impact; ``flow``: half a period without a
    force; ``constant``: response from rest over that to a unit force on the absorber and its
    reaction; ``wave``: the particular solution Re(wave exp(i (omega t + phase))).
    """

    def __init__(self, case: Case) -> None:
        mechanics = Mechanics(case.scene, np.ones(case.model.modes + 1))
        pushed = mechanics.linear(
            [Regime("free", constant=1.0)]
        )  # apart, under a unit force between absorber and tip
        self.case = case
        self.matrix = pushed.matrix[:-1, :-1]
        self.push = pushed.matrix[:-1, -1]
        self.force = pushed.column[:-1, 0] * case.force
        self.distance = mechanics.gaps[0, :-1]
        self.rate = mechanics.speeds[0, :-1]
        self.compliance, unit = float(self.rate @ self.push), np.eye(len(self.push))
        self.bounce = unit - (1 + case.restitution) / self.compliance * np.outer(
            self.push, self.rate
        )
        after = scipy.linalg.expm(pushed.matrix * np.pi / case.omega)
        self.flow = after[:-1, :-1]
        self.constant = after[:-1, -1]
        self.wave = np.linalg.solve(
            1j * case.omega * unit - self.matrix, self.force.astype(complex)
        )

    def half_turn(self) -> tuple[Array, Array, Array]:
        """Return the state after the lower impact and the distance before the upper wall.

        Both depend on the phase: y0 = constant + Re(wave exp(i phase)), and the distance likewise.
        The result is (y0 constant, y0 wave, distance pair).
        """
        rub = -self.case.friction_limit * self.constant  # the absorber moves up against the tip
        right = np.column_stack(
            [-self.bounce @ rub, self.bounce @ (self.wave + self.flow @ self.wave)]
        )
        solve = np.linalg.solve(np.eye(len(rub)) + self.bounce @ self.flow, right)
        still = solve[:, 0].real
        moving = solve[:, 1]
        return (
            still,
            moving,
            self.distance
            @ np.array([self.flow @ still + rub, self.flow @ (moving - self.wave) - self.wave]).T,
        )

    def orbits(self) -> list[tuple[float, float, Array]]:
        """Return all symmetric orbits, each as (phase, impulse, state).

        They are the phase at the lower wall, the impulse of this impact and the state after it.
        """
        still, moving, (level, wave) = self.half_turn()
        share = (self.case.gap - level.real) / abs(wave)
        if abs(share) > 1:
            return []
        orbits = []
        for angle in (np.arccos(share), -np.arccos(share)):
            phase = float(angle - np.angle(wave)) % (2 * np.pi)
            y0 = still + (moving * np.exp(1j * phase)).real
            gamma = -float(self.rate @ y0) / self.case.restitution  # before the lower wall
            orbits.append((phase, -(1 + self.case.restitution) * gamma / self.compliance, y0))
        return sorted(orbits, key=lambda orbit: orbit[1])

    def fold_force(self) -> float:
        _, _, (level, wave) = self.half_turn()
        return abs(self.case.gap - level.real) / abs(wave) * abs(self.case.force)

    def half_multipliers(self, phase: float, y0: Array) -> Array:
        """Return the eigenvalues of the derivative of the half-period map.

        The map is a flight, the saltation matrix with the vector fields on both sides, and the
        mirror image.
        """
        limit = self.case.friction_limit
        steady = (self.wave * np.exp(1j * phase)).real
        before = self.flow @ (y0 - steady) - steady - limit * self.constant
        forced = -self.force * np.cos(phase)
        field_before = self.matrix @ before + forced - limit * self.push
        field_after = self.matrix @ self.bounce @ before + forced + limit * self.push
        salt = self.bounce + np.outer(field_after - self.bounce @ field_before, self.distance) / (
            self.distance @ field_before
        )
        return np.linalg.eigvals(-salt @ self.flow)


def matched(one: Array, other: Array) -> float:
    """Return the largest distance between two sets of eigenvalues, paired so that it is small."""
    rest = list(other)
    worst = 0.0
    for value in one:
        k = int(np.argmin([abs(value - candidate) for candidate in rest]))
        worst = max(worst, abs(value - rest.pop(k)))
    return worst
