"""Replay a run from its impacts alone: between them beam and absorbers move as textbook formulas say, in extended precision.

Nothing of the package but its input and the list of impacts is used. Motion between impacts is linear, so that errors do not grow from one to the
next; a frequency that is constant and absorbers without friction keep the formulas short.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impact_env import Drive, Response, Scene
from impact_env.parameters import RigidWalls, SlidingAbsorber

Array = NDArray[np.longdouble]
ENDS = 2.0 ** -np.arange(40.0, 1.0, -1.0)  # of a flight: samples that crowd at its beginning


@dataclass
class Replay:
    """``beyond``: how far outside of its cavity an absorber was, ``missed``: how far off its wall at an impact, as shares of the gap.

    ``law``: largest error of the relative velocity before an impact, relative to the largest one seen, and of the impulse, relative to Newton's law.
    """

    flights: int = 0
    beyond: float = 0.0
    missed: float = 0.0
    law: float = 0.0
    speeds: list[float] = field(default_factory=list)


class Beam:
    """Modal displacement and velocity (N_m,) under a force of constant frequency; damping may be of any size."""

    def __init__(self, scene: Scene, drive: Drive) -> None:
        model, wide = scene.model, np.longdouble
        self.omega, self.a = model.omega.astype(wide), model.damping_ratio.astype(wide) * model.omega.astype(wide)
        self.force = drive.amplitude * model.force_shape.astype(wide)
        self.drive_omega, self.phase = wide(drive.schedule.omegas[0]), wide(drive.phase)
        self.response = self.force / (self.omega**2 - self.drive_omega**2 + 2j * self.a * self.drive_omega)

    def forced(self, t: Array) -> tuple[Array, Array]:
        swing = self.response * np.exp(1j * (self.drive_omega * t[:, None] + self.phase))
        return swing.real, (1j * self.drive_omega * swing).real

    def move(self, q: Array, v: Array, start: np.longdouble, t: Array) -> tuple[Array, Array]:
        """Return displacement and velocity (T, N_m) a time t (T,) after ``start``."""
        q0, v0 = self.forced(np.array([start]))
        q1, v1 = self.forced(start + t)
        u, w = q - q0[0], v - v0[0]
        root = np.sqrt((self.a**2 - self.omega**2).astype(np.clongdouble))
        x = t[:, None] * root
        c = np.cosh(x).real
        s = t[:, None] * np.where(np.abs(x) < 1e-8, 1.0, np.sinh(x) / np.where(x == 0, 1.0, x)).real
        decay = np.exp(-self.a * t[:, None])
        return q1 + decay * (u * c + (w + self.a * u) * s), v1 + decay * (w * c - (self.omega**2 * u + self.a * w) * s)


def replay(response: Response, dense: int = 200) -> Replay:
    """Follow a run that began at rest, impact by impact, up to its first phase of contact; ``dense``: samples of each flight."""
    scene, drive, impacts, phases = response.scene, response.drive, response.impacts, response.phases
    every = getattr(scene.absorber, "absorbers", (scene.absorber,))
    walls = [a.walls for a in every if isinstance(a, SlidingAbsorber) and isinstance(a.walls, RigidWalls)]
    gap, e = np.array([w.gap for w in walls]), np.array([w.restitution for w in walls])
    shapes, masses = scene.absorber_shapes.astype(np.longdouble), scene.absorber_masses
    compliance = 1 / masses + np.sum(shapes**2, axis=1)
    beam, result = Beam(scene, drive), Replay()
    q, v = np.zeros((2, scene.model.modes), np.longdouble)
    x, y = np.zeros((2, len(gap)), np.longdouble)  # absorbers
    now, samples = np.longdouble(0.0), np.unique(np.concatenate([ENDS, np.linspace(0, 1, dense)])).astype(np.longdouble)[1:]
    until = np.min(phases.start, initial=np.inf)
    for time, which, rate, impulse in zip(impacts.time, impacts.absorber, impacts.relative_velocity, impacts.impulse, strict=True):
        if time >= until:
            break
        t = (np.longdouble(time) - now) * samples
        if t[-1] > 0:
            qs, vs = beam.move(q, v, now, t)
            relative = x + t[:, None] * y - qs @ shapes.T
            result.beyond = max(result.beyond, float(np.max(np.abs(relative) / gap)) - 1)
            x, q, v = x + t[-1] * y, qs[-1], vs[-1]
        now = np.longdouble(time)
        tip, gamma = shapes[which] @ q, y[which] - shapes[which] @ v
        result.missed = max(result.missed, abs(float(np.abs(x[which] - tip) / gap[which]) - 1))
        x[which] = tip + np.copysign(gap[which], x[which] - tip)  # as the list of impacts says
        result.speeds.append(abs(float(rate)))
        law = -(1 + e[which]) * gamma / compliance[which]
        wrong = max(abs(float(gamma - rate)), abs(float((law - impulse) * compliance[which])))
        result.law = max(result.law, wrong / max(result.speeds))
        y[which] += impulse / masses[which]
        v = v - shapes[which] * impulse
        result.flights += 1
    return result
