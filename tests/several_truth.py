"""Two integrators of several absorbers that share nothing with the exact method: an adaptive one from impact to impact, and small Moreau steps."""

from __future__ import annotations

import numpy as np
import scipy.integrate
from core import Array

from impact_env import Drive, InitialState, Scene, SeveralAbsorbers


class Mechanics:
    """Masses, shapes and laws of a scene, and the right-hand side without contact."""

    def __init__(self, scene: Scene, drive: Drive) -> None:
        assert isinstance(scene.absorber, SeveralAbsorbers)
        assert scene.model.absorber_shapes is not None
        self.model, self.drive, self.shapes = scene.model, drive, scene.model.absorber_shapes
        every = scene.absorber.absorbers
        self.n, self.modes = len(every), scene.model.modes
        self.half = self.modes + self.n
        self.mass = np.array([a.mass_ratio for a in every]) * scene.model.beam_mass
        self.gap = np.array([np.inf if a.walls is None else a.walls.gap for a in every])
        self.restitution = np.array([0.0 if a.walls is None else a.walls.restitution for a in every])  # type: ignore[union-attr]
        self.limit = np.array([0.0 if a.friction is None else a.friction.limit for a in every])
        self.compliance = 1 / self.mass + np.sum(self.shapes**2, axis=1)

    def force(self, t: float) -> float:
        return float(self.drive.amplitude * np.cos(self.drive.schedule.phase_at(t) + self.drive.phase))

    def beam(self, t: float, q: Array, u: Array) -> Array:
        model = self.model
        return np.asarray(model.force_shape * self.force(t) - 2 * model.damping_ratio * model.omega * u - model.omega**2 * q)

    def relative(self, x: Array) -> tuple[Array, Array]:
        n, half = self.modes, self.half
        return x[n:half] - self.shapes @ x[:n], x[half + n :] - self.shapes @ x[half : half + n]


def flights(scene: Scene, drive: Drive, initial: InitialState, duration: float) -> tuple[Array, list[tuple[float, int]]]:
    """Integrate without friction from impact to impact; return the end state and (time, absorber) of each impact."""
    m, x, t, hits = Mechanics(scene, drive), initial.vector(scene), 0.0, []
    n, half = m.modes, m.half

    def rate(t: float, x: Array) -> Array:
        return np.concatenate([x[half:], m.beam(t, x[:n], x[half : half + n]), np.zeros(m.n)])

    def wall(a: int, side: float):  # type: ignore[no-untyped-def]
        def event(_: float, x: Array) -> float:
            return float(m.gap[a] - side * m.relative(x)[0][a])

        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        return event

    walls = [(a, side) for a in range(m.n) for side in (1.0, -1.0)]
    while t < duration:
        found = scipy.integrate.solve_ivp(rate, (t, duration), x, "DOP853", events=[wall(*w) for w in walls], rtol=1e-12, atol=1e-14)
        t, x = float(found.t[-1]), found.y[:, -1]
        for (a, _), times in zip(walls, found.t_events, strict=True):
            if len(times) > 0:
                impulse = -(1 + m.restitution[a]) * m.relative(x)[1][a] / m.compliance[a]
                x[half + n + a] += impulse / m.mass[a]
                x[half : half + n] -= m.shapes[a] * impulse
                hits.append((t, a))
    return x, hits


def percussion(m: Mechanics, a: int, before: Array, free: float, distance: Array, dt: float) -> float:
    """Return what friction and wall give absorber a in a step, the others being known; ``free``: its relative velocity without that."""
    p = float(np.clip(-free / m.compliance[a], -m.limit[a] * dt, m.limit[a] * dt))
    if abs(distance[a]) >= m.gap[a]:
        wanted = -m.restitution[a] * before[a]
        if np.sign(distance[a]) * (free + m.compliance[a] * p - wanted) > 0:
            return float((wanted - free) / m.compliance[a])
    return p


def small_steps(scene: Scene, drive: Drive, initial: InitialState, duration: float, steps: int) -> Array:
    """Integrate by Moreau's scheme, the contacts of a step by Gauss-Seidel; return the end state."""
    m, x, dt = Mechanics(scene, drive), initial.vector(scene), duration / steps
    n, half = m.modes, m.half
    for k in range(steps):
        x[:half] += 0.5 * dt * x[half:]
        distance, before = m.relative(x)
        x[half : half + n] += dt * m.beam((k + 0.5) * dt, x[:n], x[half : half + n])
        given = np.zeros(m.n)
        for _ in range(20):
            old = given.copy()
            for a in range(m.n):
                free = m.relative(x)[1][a] - m.compliance[a] * given[a]
                new = percussion(m, a, before, float(free), distance, dt)
                x[half + n + a] += (new - given[a]) / m.mass[a]
                x[half : half + n] -= m.shapes[a] * (new - given[a])
                given[a] = new
            if np.max(np.abs(given - old)) <= 1e-12 * np.max(np.abs(given)):
                break
        x[:half] += 0.5 * dt * x[half:]
    return x
