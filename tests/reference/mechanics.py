"""The equations of motion of a scene as dense matrices.

They follow from the modal model and the regimes of `contact` alone.

Modes: u' = -omega^2 q - 2 D omega u + force_shape f - Gamma a_b - sum_a shape_a lambda_a;
absorbers: m_a q_a'' = lambda_a - m_a (r a_b + g) (paper, Eq. eqmmod; a base with acceleration a_b,
to which all is relative, and gravity g along the absorbers' motion).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.scene import Scene
from reference.contact import Guard, Regime

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Linear:
    """x' = matrix x + column u for a state x (S,) and inputs u (I,).

    The absorbers' forces in N are forces x + pushes u.

    ``matrix`` (S, S), ``column`` (S, I), ``forces`` (n, S), ``pushes`` (n, I). Inputs are the force
    in N, the base's acceleration in m/s^2, and further forces in N.
    """

    matrix: Array
    column: Array
    forces: Array
    pushes: Array


class Mechanics:
    """Masses, shapes and rows of a scene with n places.

    Without absorber there is one place: a mass of 1 kg without contact.

    The state (S,) = (2 N_m + 2 n + 1,) is omega_i q_i, omega_1 q_a, u_i, v_a, 1: the scaling keeps
    exponentials accurate, the 1 carries constants. Another ``scale`` (N_m + n,) of displacements
    may be given, and mode shapes (N_m,) of ``further`` forces. ``gaps`` (n, S) and ``speeds`` (n,
    S) are the rows of relative displacement (m) and velocity (m/s), ``tip`` (S,) that of the tip's
    displacement.
    """

    def __init__(
        self, scene: Scene, scale: Array | None = None, further: Sequence[Array] = ()
    ) -> None:
        model = scene.model
        self.scene = scene
        self.model = model
        self.modes = model.modes
        self.places = scene.places
        self.shapes = np.array(scene.absorber_shapes)
        self.masses = np.ones(1) if scene.absorber is None else scene.absorber_masses
        self.mobility = self.shapes @ self.shapes.T + np.diag(1 / self.masses)
        self.half = self.modes + self.places
        self.size = 2 * self.half + 1
        self.scale = (
            np.append(model.omega, np.full(self.places, model.omega[0])) if scale is None else scale
        )
        rows = np.concatenate([-self.shapes, np.eye(self.places)], axis=1)
        self.gaps, self.speeds = np.zeros((2, self.places, self.size))
        self.gaps[:, : self.half] = rows / self.scale
        self.speeds[:, self.half : -1] = rows
        self.tip = np.zeros(self.size)
        self.tip[: self.modes] = model.tip_shape / self.scale[: self.modes]
        self.unforced = np.zeros((self.modes, self.size))  # of the modes, by stiffness and damping
        self.unforced[:, : self.modes] = -np.diag(model.omega**2 / self.scale[: self.modes])
        self.unforced[:, self.half : self.half + self.modes] = -np.diag(
            2 * model.damping_ratio * model.omega
        )

        base = (
            np.zeros(self.modes) if model.base_participation is None else -model.base_participation
        )
        self.driven = np.stack([model.force_shape, base, *further], axis=1)
        self.carried = np.zeros((self.places, 2 + len(further)))
        self.carried[:, 1] = 0.0 if scene.absorber is None else -model.base_at_absorber
        every = getattr(scene.absorber, "absorbers", (scene.absorber,))
        self.falling = -np.array([getattr(one, "gravity", 0.0) for one in every])

    def state(self, vector: Array) -> Array:
        """Return the state (S,) of displacements and velocities (2 N_m + 2 n,)."""
        return np.concatenate([vector[: self.half] * self.scale, vector[self.half :], [1.0]])

    def vector(self, states: Array) -> Array:
        """Return displacements and velocities (..., 2 N_m + 2 n) of states (..., S)."""
        return np.concatenate(
            [states[..., : self.half] / self.scale, states[..., self.half : -1]], axis=-1
        )

    def linear(self, regimes: Sequence[Regime]) -> Linear:
        """Return the equations while each absorber is in a regime."""
        forces = np.zeros((self.places, self.size))
        pushes = np.zeros(self.carried.shape)
        for a, regime in enumerate(regimes):
            if not regime.joined:
                forces[a] = (
                    -(regime.stiffness + regime.slider) * self.gaps[a]
                    - regime.damping * self.speeds[a]
                )
                forces[a, -1] = (
                    regime.constant
                    + regime.stiffness * regime.rest
                    + regime.slider * float(regime.slider_rest)
                )
        joined = [a for a, regime in enumerate(regimes) if regime.joined]
        if joined:
            # the places' accelerations under the others' forces; in the mobility places and masses
            # are side by side
            pull = self.shapes[joined] @ (self.unforced - self.shapes.T @ forces)
            pull[:, -1] -= self.falling[joined]
            coupling = self.mobility[np.ix_(joined, joined)]
            forces[joined] = np.linalg.solve(coupling, pull)
            pushes[joined] = np.linalg.solve(
                coupling, self.shapes[joined] @ self.driven - self.carried[joined]
            )
        matrix = np.zeros((self.size, self.size))
        column = np.zeros((self.size, self.carried.shape[1]))
        matrix[: self.half, self.half : -1] = np.diag(self.scale)
        matrix[self.half : -1] = np.concatenate(
            [self.unforced - self.shapes.T @ forces, forces / self.masses[:, None]]
        )
        matrix[self.half + self.modes : -1, -1] += self.falling
        column[self.half : -1] = np.concatenate(
            [self.driven - self.shapes.T @ pushes, pushes / self.masses[:, None] + self.carried]
        )
        return Linear(matrix, column, forces, pushes)

    def guard(self, which: int, guard: Guard, linear: Linear) -> tuple[Array, Array]:
        """Return the row (S,) and the factors (I,) of the inputs that make a guard's value."""
        row = (
            guard.y_weight * self.gaps[which]
            + guard.gamma_weight * self.speeds[which]
            + guard.force_weight * linear.forces[which]
        )
        row[-1] += guard.constant - guard.y_weight * float(guard.rest)
        return row, guard.force_weight * linear.pushes[which]

    def impulse(self, state: Array, which: Sequence[int], changes: Array) -> None:
        """Change relative velocities (m/s) by impulses on the absorbers, in place."""
        chosen = list(which)
        impulses = np.zeros(self.places)
        impulses[chosen] = np.linalg.solve(self.mobility[np.ix_(chosen, chosen)], changes)
        state[self.half : self.half + self.modes] -= self.shapes.T @ impulses
        state[self.half + self.modes : -1] += impulses / self.masses
