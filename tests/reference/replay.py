"""Reconstruction of a run with rigid contacts from its list of events alone.

It uses matrix exponentials of the equations of motion.

Times and kinds of the events are those of the run; all else follows from mass, damping, stiffness
and contact laws: a missed event, or one at a wrong time, violates a condition of contact.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.parameters import SeveralAbsorbers
from impact_env.scene import Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SUBSTEPS = 6  # samples between two events
REST_SHARE = 1e-9  # of the fastest impact: relative velocities below it are those of rest
WALL_TOL = 1e-6  # of the clearance: an absorber on a wall


@dataclass
class Violations:
    """Largest violations of the contact conditions in a reconstruction.

    Lengths are relative to the clearance, velocities to the largest relative velocity, and joint
    forces to the friction limit.

    Attributes
    ----------
    distance : float
        Distance beyond a wall.
    touch : float
        Distance from the wall at an impact.
    sense : float
        Relative velocity against the direction of sliding.
    rest : float
        Relative velocity when an absorber begins to stick or reverses.
    force : float
        Joint force beyond its limit.
    release : float
        Difference of the joint force from its limit at a release.
    events : int
        Number of events.
    """

    distance: float = 0.0
    touch: float = 0.0
    sense: float = 0.0
    rest: float = 0.0
    force: float = 0.0
    release: float = 0.0
    events: int = field(default=0)

    def note(self, name: str, value: float) -> None:
        """Note the size of a violation."""
        setattr(self, name, max(getattr(self, name), value))


class Replay:
    """State and regime of a replay, at a constant frequency of the force and without gravity."""

    def __init__(self, scene: Scene, drive: Drive) -> None:
        self.model = scene.model
        self.shapes = scene.absorber_shapes
        self.masses = scene.absorber_masses
        assert isinstance(scene.absorber, SeveralAbsorbers)
        every = scene.absorber.absorbers
        self.gaps = np.array([np.inf if one.walls is None else one.walls.gap for one in every])
        self.restitutions = np.array(
            [0.0 if one.walls is None else one.walls.restitution for one in every]
        )
        self.limits = np.array(
            [0.0 if one.friction is None else one.friction.limit for one in every]
        )
        self.omega = float(drive.schedule.omegas[0])
        n = self.model.modes
        self.n = n
        self.count = len(every)
        self.half = n + self.count
        self.state = np.zeros(2 * self.half + 3)
        self.state[-3:] = np.cos(drive.phase), np.sin(drive.phase), 1.0
        self.force = drive.amplitude * self.model.force_pattern
        self.senses = np.zeros(self.count)

    @property
    def distance(self) -> Array:
        """Displacement (n,) of the absorbers relative to the structure in m."""
        return np.asarray(self.state[self.n : self.half] - self.shapes @ self.state[: self.n])

    @property
    def speed(self) -> Array:
        """Relative velocity (n,) in m/s."""
        n = self.n
        half = self.half
        return np.asarray(
            self.state[half + n : 2 * half] - self.shapes @ self.state[half : half + n]
        )

    def matrix(self, joined: Mask) -> Array:
        """Return the matrix of the linear motion with a set of joined absorbers.

        ``joined`` is the mask of the absorbers that are joined to the structure.
        """
        n = self.n
        half = self.half
        size = len(self.state)
        held = self.shapes[joined]
        mass = np.eye(n) + (held.T * self.masses[joined]) @ held
        rows = np.zeros((n, size))
        rows[:, :n] = -np.diag(self.model.omega**2)
        rows[:, half : half + n] = -np.diag(2 * self.model.damping_ratio * self.model.omega)
        rows[:, -3] = self.force.real
        rows[:, -2] = -self.force.imag
        friction = np.where(joined, 0.0, -self.limits * self.senses)  # on the absorbers
        rows[:, -1] = -self.shapes.T @ friction
        result = np.zeros((size, size))
        result[:half, half : 2 * half] = np.eye(half)
        result[half : half + n] = np.linalg.solve(mass, rows)
        result[half + n : 2 * half, -1] = friction / self.masses
        result[half + n : 2 * half][joined] = held @ result[half : half + n]
        result[-3, -2] = -self.omega
        result[-2, -3] = self.omega
        return result

    def joint_force(self, matrix: Array) -> Array:
        """Return the force (n,) on each absorber in N."""
        rates = matrix @ self.state
        return np.asarray(self.masses * rates[self.half + self.n : 2 * self.half])

    def hit(self, which: int) -> None:
        """Apply the law of an impact to one absorber."""
        shape = self.shapes[which]
        n = self.n
        half = self.half
        speed = self.speed[which]
        compliance = 1 / self.masses[which] + shape @ shape
        impulse = -(1 + self.restitutions[which]) * speed / compliance
        self.state[half : half + n] -= shape * impulse
        self.state[half + n + which] += impulse / self.masses[which]


def replay(
    scene: Scene, drive: Drive, impacts: Any, phases: Any, reversals: Any
) -> tuple[Array, Violations]:
    """Return the end state (2 N_m + 2 n,) and the violations of a run from rest.

    The run is reconstructed from its impacts, contact phases and reversals.
    """
    run = Replay(scene, drive)
    end = float(drive.schedule.times[-1])
    fastest = max(float(np.max(np.abs(impacts.relative_velocity), initial=0.0)), 1e-30)
    worst = Violations()
    times = np.unique(
        np.concatenate([[0.0, end], impacts.time, phases.start, phases.end, reversals.time])
    )
    joined = np.zeros(run.count, dtype=bool)
    joined[phases.absorber[phases.start == 0]] = True
    matrix = _start(run, joined)
    for start, stop in pairwise(times):
        middle = (start + stop) / 2
        force = run.joint_force(matrix)
        for which in impacts.absorber[impacts.time == start]:
            worst.note("touch", abs(abs(run.distance[which]) / run.gaps[which] - 1))
            run.hit(which)
            speed = run.speed[which]
            leaves = abs(speed) < REST_SHARE * fastest  # without rebound: it can only go inwards
            run.senses[which] = np.sign(-run.distance[which] if leaves else speed)
        now = np.zeros(run.count, dtype=bool)
        sides = np.zeros(run.count)
        active = (phases.start <= middle) & (middle <= phases.end)
        now[phases.absorber[active]] = True
        sides[phases.absorber[active]] = np.array([0, -1, 1])[phases.kind[active]]
        alone = np.sum(phases.start == start) + np.sum(impacts.time == start) == 0
        for which in range(run.count):
            turns = np.any((reversals.time == start) & (reversals.absorber == which))
            turns &= not np.any((impacts.time == start) & (impacts.absorber == which))
            if now[which]:
                _stick(run, worst, which, joined[which], fastest)
            elif joined[which] and abs(run.speed[which]) < REST_SHARE * fastest:
                _release(run, worst, which, force[which], alone)
            elif turns:
                worst.note("rest", abs(run.speed[which]) / fastest)
                run.senses[which] *= -1
            elif abs(run.speed[which]) > REST_SHARE * fastest:
                run.senses[which] = np.sign(run.speed[which])
        joined = now
        matrix = run.matrix(joined)
        step = scipy.linalg.expm(matrix * ((stop - start) / SUBSTEPS))
        for _ in range(SUBSTEPS):
            run.state = step @ run.state
            _check(run, worst, joined, sides, matrix, fastest)
        worst.events += 1
    return run.state[: 2 * run.half], worst


def _start(run: Replay, joined: Mask) -> Array:
    """Let absorbers that do not stick slide against their relative acceleration at time 0.

    Return the matrix of the motion.
    """
    for _ in range(10):  # the friction of one acts on the others
        matrix = run.matrix(joined)
        rates = matrix @ run.state
        n = run.n
        half = run.half
        relative = rates[half + n : 2 * half] - run.shapes @ rates[half : half + n]
        senses = np.where(joined, 0.0, np.sign(relative))
        if np.array_equal(senses, run.senses):
            break
        run.senses = senses
    return matrix


def _stick(run: Replay, worst: Violations, which: int, before: bool, fastest: float) -> None:
    """Let an absorber move with the structure."""
    speed = run.speed[which]
    if not before:
        worst.note("rest", abs(speed) / fastest)
    run.state[run.half + run.n + which] -= speed


def _release(run: Replay, worst: Violations, which: int, force: float, alone: bool) -> None:
    """Let an absorber slide against its joint force (N), or leave its wall.

    With ``alone`` no other event occurs at this time, so the force must be at its limit.
    """
    if abs(run.distance[which]) > run.gaps[which] * (1 - WALL_TOL):
        run.senses[which] = -np.sign(run.distance[which])
        return
    run.senses[which] = -np.sign(force)
    if alone and run.limits[which] > 0:
        worst.note("release", abs(abs(force) / run.limits[which] - 1))


def _check(
    run: Replay, worst: Violations, joined: Mask, sides: Array, matrix: Array, fastest: float
) -> None:
    """Record the largest violations of the contact conditions."""
    worst.note("distance", float(np.max(np.abs(run.distance) / run.gaps - 1, initial=0.0)))
    sliding = ~joined & (run.limits > 0)
    against = -run.senses[sliding] * run.speed[sliding] / fastest
    worst.note("sense", float(np.max(against, initial=0.0)))
    force = run.joint_force(matrix)
    scale = np.where(run.limits > 0, run.limits, np.max(np.abs(force), initial=1e-30))
    above = np.where(sides < 0, -np.inf, force - run.limits) / scale
    below = np.where(sides > 0, -np.inf, -force - run.limits) / scale
    worst.note("force", float(np.max(np.maximum(above, below)[joined], initial=0.0)))
