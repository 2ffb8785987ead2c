"""Amplitudes far above the gap, on structures nobody chose: every flight is replayed by formulas that share nothing with the search."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from core import ALL
from numpy.typing import NDArray

from impact_env import (
    Drive,
    IntegrationError,
    ModalModel,
    Record,
    Response,
    Scene,
    SeveralAbsorbers,
    constant_frequency,
    impact_absorber,
    linear_sweep,
    simulate,
)
from impact_env.parameters import RigidWalls, SlidingAbsorber

# Replay a run from its impacts alone: between them beam and absorbers move as textbook formulas say, in extended precision.
#
# Nothing of the package but its input and the list of impacts is used. Motion between impacts is linear, so that errors do not grow from one to the
# next; a frequency that is constant and absorbers without friction keep the formulas short.


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


SCENES = 50


def random_run(seed: int) -> tuple[Response, float]:
    """Return a run of at most 2,000 events and its scale, the amplitude without absorber over the gap, 3e3 to 1e8."""
    rng = np.random.default_rng(seed)
    modes, several = int(rng.integers(1, 5)), rng.random() < 0.3
    omega = np.sort(10 ** rng.uniform(-1, 1.5, modes)) * 10 ** rng.uniform(-1, 3)
    damping = [10 ** rng.uniform(-4, -1, modes), np.zeros(modes), 1 + rng.choice([0, 1e-6, -1e-6, 1e-3], modes)][rng.integers(3 - several)]
    if rng.random() < 0.3 and not several:
        omega[:2] = omega[0]
    drive_omega = omega[0] * rng.choice([0.9, 1.1])
    shapes, places = rng.normal(size=(2, modes)), rng.normal(size=(2, modes))
    force, scale = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(3.5, 8)
    gap = float(abs(np.sum(force * shapes[0] * shapes[1] / (omega**2 - drive_omega**2 + 2j * damping * omega * drive_omega))) / scale)
    e = float(rng.choice([1.0, 1.0, 0.9, 0.5]))
    absorber = impact_absorber(gap, e, None, float(10 ** rng.uniform(-3, -1)))
    scene = Scene(ModalModel(omega, damping, *shapes, 1.0), absorber)
    if several:  # near critical damping these are refused
        other = impact_absorber(gap * float(rng.uniform(0.1, 10)), e, None, 0.01)
        scene = Scene(ModalModel(omega, damping, *shapes, 1.0, places), SeveralAbsorbers((absorber, other), (1.0, 1.0)))
    drive = Drive(force, constant_frequency(float(omega[0]), drive_omega / float(omega[0]), float(rng.uniform(1, 4))), float(rng.uniform(0, 6)))
    try:
        record = ALL if several else Record(events=True)  # kernels that others use
        return simulate(scene, drive, record=record, most_events=2000), scale
    except IntegrationError as error:
        if "more events than its budget" not in str(error) or error.response is None:
            raise
        return error.response, scale


def test_no_wall_is_passed_and_every_impact_is_newtons() -> None:
    """Rounding is 1e-16 of the amplitudes, a thousand times that where eigenvectors almost coincide: so much of the gap may be lost."""
    flights = 0
    for seed in range(SCENES):
        response, scale = random_run(seed)
        seen = replay(response)
        assert max(seen.beyond, seen.missed) < 1e-9 + 1e-11 * scale, seed
        assert seen.law < 1e-7, seed
        flights += seen.flights
    assert flights > 30_000


def test_the_replay_sees_a_wall_that_was_passed() -> None:
    """An impact that is told a thousandth of its flight late lies beyond the wall."""
    response, _ = random_run(1)
    assert replay(response).missed < 1e-5
    times = response.impacts.time
    times[5] += 1e-3 * (times[5] - times[4])
    assert replay(response).missed > 1e-5


def test_a_sweep_through_sixty_thousand_gaps() -> None:
    """Its walls were passed 55 times while only the wall of the start was looked for."""
    model = ModalModel([0.0817], [1e-4], [1.33], [1.33], 0.564)
    scene = Scene(model, impact_absorber(1e-3))
    response = simulate(scene, Drive(3.5, linear_sweep(0.0817, 0.1, 1.58, 1.48e4 / 5.1)), record=ALL)
    assert response.check.searches > 10_000
    assert response.check.misses == 0


@pytest.mark.parametrize(("seed", "case"), [(1, 31), (1, 37), (2, 171)])
def test_a_release_near_critical_damping_is_no_storm(seed: int, case: int) -> None:
    """Twenty modes whose eigenvectors almost coincide: an absorber that has just left its wall does not hit it again for ever."""
    rng = np.random.default_rng(seed)
    for k in range(case + 1):
        omega = np.sort(0.28 * 10 ** np.concatenate([[0], rng.uniform(0, 3, 19)])) if k % 2 else 0.28 * np.arange(1, 21) ** 2.0
        damping, shapes = float(rng.choice([0.999999, 0.99, 1.000001])), rng.normal(size=(2, 20))
        still = abs(np.sum(shapes[0] * shapes[1] / (omega**2 - 0.28**2 + 2j * damping * omega * 0.28)))
        force, ratio = 10 ** rng.uniform(0, 4) * 23.5e-6 / still, float(10 ** rng.uniform(-3, -1))
    scene = Scene(ModalModel(omega, np.full(20, damping), *shapes, 1.0), impact_absorber(23.5e-6, 0.7, None, ratio))
    response = simulate(scene, Drive(force, linear_sweep(0.28, 0.9, 1.06, 40)), record=Record(events=True), most_events=20_000)
    assert response.impact_count > 100
    assert len(np.unique(response.impacts.time)) > 0.99 * response.impact_count
