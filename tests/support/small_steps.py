"""Several absorbers by small Moreau steps, the contacts of a step by Gauss-Seidel: contact laws without regimes, guards and events."""

from dataclasses import dataclass

import numpy as np
from core import Array

from impact_env import Drive, InitialState, Scene, SeveralAbsorbers
from reference.mechanics import Mechanics


@dataclass
class Laws:
    """Gap in m, restitution, friction limit in N and mobility in 1/kg of each absorber, (n,)."""

    gap: Array
    restitution: Array
    limit: Array
    mobility: Array


def laws_of(scene: Scene, mobility: Array) -> Laws:
    assert isinstance(scene.absorber, SeveralAbsorbers)
    every = scene.absorber.absorbers
    gap = np.array([np.inf if a.walls is None else a.walls.gap for a in every])
    restitution = np.array([0.0 if a.walls is None else a.walls.restitution for a in every])
    return Laws(gap, restitution, np.array([0.0 if a.friction is None else a.friction.limit for a in every]), np.diag(mobility))


def percussion(laws: Laws, a: int, before: Array, free: float, distance: Array, dt: float) -> float:
    """Return the percussion by friction and wall on absorber a in a step, the others being known; ``free``: its relative velocity without that."""
    p = float(np.clip(-free / laws.mobility[a], -laws.limit[a] * dt, laws.limit[a] * dt))
    if abs(distance[a]) >= laws.gap[a]:
        wanted = -laws.restitution[a] * before[a]
        if np.sign(distance[a]) * (free + laws.mobility[a] * p - wanted) > 0:
            return float((wanted - free) / laws.mobility[a])
    return p


def small_steps(scene: Scene, drive: Drive, initial: InitialState, duration: float, steps: int) -> Array:
    """Integrate by Moreau's scheme; return the end state."""
    m, x, dt = Mechanics(scene), initial.vector(scene), duration / steps
    laws, model, n, half = laws_of(scene, m.mobility), scene.model, m.modes, m.half
    forces = drive.amplitude * np.cos(drive.schedule.phase_at(dt * (0.5 + np.arange(steps))) + drive.phase)
    for force in forces:
        x[:half] += 0.5 * dt * x[half:]
        distance, before = (x[at + n : at + half] - m.shapes @ x[at : at + n] for at in (0, half))
        x[half : half + n] += dt * (model.force_shape * force - 2 * model.damping_ratio * model.omega * x[half : half + n] - model.omega**2 * x[:n])
        given = np.zeros(m.places)
        for _ in range(20):
            old = given.copy()
            for a in range(m.places):
                free = x[half + n + a] - m.shapes[a] @ x[half : half + n] - laws.mobility[a] * given[a]
                new = percussion(laws, a, before, float(free), distance, dt)
                x[half + n + a] += (new - given[a]) / m.masses[a]
                x[half : half + n] -= m.shapes[a] * (new - given[a])
                given[a] = new
            if np.max(np.abs(given - old)) <= 1e-12 * np.max(np.abs(given)):
                break
        x[:half] += 0.5 * dt * x[half:]
    return x
