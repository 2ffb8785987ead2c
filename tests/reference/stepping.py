"""Moreau's scheme with small steps for several absorbers.

Contact laws are projections, without regimes, events or modes of joined sets.
"""

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.parameters import SeveralAbsorbers
from impact_env.scene import Scene

Array = NDArray[np.float64]
SWEEPS = 4  # over all absorbers: what one of them does to another is small


def run_small_steps(scene: Scene, drive: Drive, steps: int) -> Array:
    """Return the end state (2 N_m + 2 n,) of a run from rest, with forces of any phases."""
    model = scene.model
    shapes = scene.absorber_shapes
    masses = scene.absorber_masses
    assert isinstance(scene.absorber, SeveralAbsorbers)
    every = scene.absorber.absorbers
    gaps, restitutions = zip(
        *(
            (np.inf, 0.0) if one.walls is None else (one.walls.gap, one.walls.restitution)
            for one in every
        ),
        strict=True,
    )
    mobility = shapes @ shapes.T + np.diag(1 / masses)
    dt = float(drive.schedule.times[-1]) / steps
    most = dt * np.array([0.0 if one.friction is None else one.friction.limit for one in every])
    phases = (
        drive.schedule.phase_at(np.asarray(dt * (0.5 + np.arange(steps)), dtype=np.float64))
        + drive.phase
    )
    q, u = np.zeros((2, model.modes))
    x, v = np.zeros((2, len(every)))
    for turn in drive.amplitude * np.exp(1j * phases):
        q = q + dt / 2 * u
        x = x + dt / 2 * v
        distance = x - shapes @ q
        before = v - shapes @ u
        u = u + dt * (
            (model.force_pattern * turn).real
            - 2 * model.damping_ratio * model.omega * u
            - model.omega**2 * q
        )
        free = v - shapes @ u
        percussion = np.zeros(len(every))
        for _ in range(SWEEPS):
            for a, own in enumerate(np.diag(mobility)):  # each one's by the others'
                alone = free[a] + mobility[a] @ percussion - own * percussion[a]
                percussion[a] = np.clip(-alone / own, -most[a], most[a])
                rebound = -restitutions[a] * before[a]
                if (
                    abs(distance[a]) >= gaps[a]
                    and np.sign(distance[a]) * (alone + own * percussion[a] - rebound) > 0
                ):
                    percussion[a] = (rebound - alone) / own
        u = u - shapes.T @ percussion
        v = v + percussion / masses
        q = q + dt / 2 * u
        x = x + dt / 2 * v
    return np.concatenate([q, x, u, v])
