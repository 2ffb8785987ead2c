"""Runs with amplitudes far above the gap, on random structures, are correct.

Every flight is recomputed by formulas that share nothing with the event search.
"""

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

# A run is replayed from its impacts alone: between them beam and absorbers move as textbook
# formulas say, in extended precision. Motion between impacts is linear, so that errors do not grow
# from one to the next; a constant frequency and no friction keep the formulas short.

Array = NDArray[np.longdouble]
ENDS = 2.0 ** -np.arange(40.0, 1.0, -1.0)  # of a flight: samples that crowd at its beginning


class Beam:
    """Modal displacement and velocity (N_m,) under a force of constant frequency.

    Damping may have any value.
    """

    def __init__(self, scene: Scene, drive: Drive) -> None:
        model = scene.model
        wide = np.longdouble
        self.omega = model.omega.astype(wide)
        self.a = model.damping_ratio.astype(wide) * model.omega.astype(wide)
        self.force = drive.amplitude * model.force_shape.astype(wide)
        self.drive_omega = wide(drive.schedule.omegas[0])
        self.phase = wide(drive.phase)
        self.response = self.force / (
            self.omega**2 - self.drive_omega**2 + 2j * self.a * self.drive_omega
        )

    def forced(self, t: Array) -> tuple[Array, Array]:
        swing = self.response * np.exp(1j * (self.drive_omega * t[:, None] + self.phase))
        return swing.real, (1j * self.drive_omega * swing).real

    def move(self, q: Array, v: Array, start: np.longdouble, t: Array) -> tuple[Array, Array]:
        """Return displacement and velocity (T, N_m) a time t (T,) after ``start``."""
        q0, v0 = self.forced(np.array([start]))
        q1, v1 = self.forced(start + t)
        u = q - q0[0]
        w = v - v0[0]
        root = np.sqrt((self.a**2 - self.omega**2).astype(np.clongdouble))
        x = t[:, None] * root
        c = np.cosh(x).real
        s = t[:, None] * np.where(np.abs(x) < 1e-8, 1.0, np.sinh(x) / np.where(x == 0, 1.0, x)).real
        decay = np.exp(-self.a * t[:, None])
        return q1 + decay * (u * c + (w + self.a * u) * s), v1 + decay * (
            w * c - (self.omega**2 * u + self.a * w) * s
        )


def replay(response: Response, dense: int = 100) -> tuple[int, float, float]:
    """Recompute a run from rest, impact by impact, up to its first phase of contact.

    ``dense`` is the number of samples of each flight.

    Return the number of flights; how far an absorber was outside of its cavity, or off its wall at
    an impact, as a share of the gap; and the largest error of the relative velocity before an
    impact, relative to the largest one seen, or of the impulse, relative to Newton's law.
    """
    scene = response.scene
    drive = response.drive
    impacts = response.impacts
    phases = response.phases
    every = getattr(scene.absorber, "absorbers", (scene.absorber,))
    gap = np.array([a.walls.gap for a in every])
    e = np.array([a.walls.restitution for a in every])
    shapes = scene.absorber_shapes.astype(np.longdouble)
    masses = scene.absorber_masses
    compliance = 1 / masses + np.sum(shapes**2, axis=1)
    beam = Beam(scene, drive)
    flights = 0
    off = 0.0
    error = 0.0
    fastest = 0.0
    q, v = np.zeros((2, scene.model.modes), np.longdouble)
    x, y = np.zeros((2, len(gap)), np.longdouble)  # absorbers
    now = np.longdouble(0.0)
    samples = np.unique(np.concatenate([ENDS, np.linspace(0, 1, dense)])).astype(np.longdouble)[1:]
    until = np.min(phases.start, initial=np.inf)
    for time, which, rate, impulse in zip(
        impacts.time, impacts.absorber, impacts.relative_velocity, impacts.impulse, strict=True
    ):
        if time >= until:
            break
        t = (np.longdouble(time) - now) * samples
        if t[-1] > 0:
            qs, vs = beam.move(q, v, now, t)
            relative = x + t[:, None] * y - qs @ shapes.T
            off = max(off, float(np.max(np.abs(relative) / gap)) - 1)
            x = x + t[-1] * y
            q = qs[-1]
            v = vs[-1]
        now = np.longdouble(time)
        tip = shapes[which] @ q
        gamma = y[which] - shapes[which] @ v
        off = max(off, abs(float(np.abs(x[which] - tip) / gap[which]) - 1))
        x[which] = tip + np.copysign(gap[which], x[which] - tip)  # as the list of impacts says
        fastest = max(fastest, abs(float(rate)))
        law = -(1 + e[which]) * gamma / compliance[which]
        error = max(
            error,
            abs(float(gamma - rate)) / fastest,
            abs(float((law - impulse) * compliance[which])) / fastest,
        )
        y[which] += impulse / masses[which]
        v = v - shapes[which] * impulse
        flights += 1
    return flights, off, error


SCENES = 25


def random_run(seed: int) -> tuple[Response, float]:
    """Return a run of at most 2,000 events and its scale.

    The scale is the amplitude without absorber over the gap, 3e3 to 1e8.
    """
    rng = np.random.default_rng(seed)
    modes = int(rng.integers(1, 5))
    several = rng.random() < 0.3
    omega = np.sort(10 ** rng.uniform(-1, 1.5, modes)) * 10 ** rng.uniform(-1, 3)
    damping = [
        10 ** rng.uniform(-4, -1, modes),
        np.zeros(modes),
        1 + rng.choice([0, 1e-6, -1e-6, 1e-3], modes),
    ][rng.integers(3 - several)]
    if rng.random() < 0.3 and not several:
        omega[:2] = omega[0]
    drive_omega = omega[0] * rng.choice([0.9, 1.1])
    shapes = rng.normal(size=(2, modes))
    places = rng.normal(size=(2, modes))
    force = 10 ** rng.uniform(-2, 2)
    scale = 10 ** rng.uniform(3.5, 8)
    gap = float(
        abs(
            np.sum(
                force
                * shapes[0]
                * shapes[1]
                / (omega**2 - drive_omega**2 + 2j * damping * omega * drive_omega)
            )
        )
        / scale
    )
    e = float(rng.choice([1.0, 1.0, 0.9, 0.5]))
    absorber = impact_absorber(gap, e, None, float(10 ** rng.uniform(-3, -1)))
    scene = Scene(ModalModel(omega, damping, *shapes, 1.0), absorber)
    if several:  # near critical damping these are refused
        other = impact_absorber(gap * float(rng.uniform(0.1, 10)), e, None, 0.01)
        scene = Scene(
            ModalModel(omega, damping, *shapes, 1.0, places),
            SeveralAbsorbers((absorber, other), (1.0, 1.0)),
        )
    drive = Drive(
        force,
        constant_frequency(
            float(omega[0]), drive_omega / float(omega[0]), float(rng.uniform(1, 4))
        ),
        float(rng.uniform(0, 6)),
    )
    try:
        record = ALL if several else Record(events=True)  # kernels that others use
        return simulate(scene, drive, record=record, most_events=2000), scale
    except IntegrationError as error:
        if "more events than its budget" not in str(error):
            raise
        return error.response, scale


def test_no_wall_is_passed_and_every_impact_is_newtons() -> None:
    """No wall is passed and every impact obeys Newton's law.

    Rounding is 1e-16 of the amplitudes, and a thousand times as much if eigenvectors almost
    coincide. The allowed error relative to the gap follows from this.
    """
    flights = 0
    for seed in range(SCENES):
        response, scale = random_run(seed)
        impacts, off, error = replay(response)
        assert off < 1e-9 + 1e-11 * scale, seed
        assert error < 1e-7, seed
        flights += impacts
    assert flights > 15_000


@pytest.mark.parametrize(("seed", "case"), [(1, 31), (1, 37), (2, 171)])
def test_a_release_near_critical_damping_is_no_storm(seed: int, case: int) -> None:
    """A release close to critical damping does not cause an endless series of impacts.

    Twenty modes have eigenvectors that almost coincide. An absorber that has just left its wall
    must not hit it again for ever.
    """
    rng = np.random.default_rng(seed)
    for k in range(case + 1):
        omega = (
            np.sort(0.28 * 10 ** np.concatenate([[0], rng.uniform(0, 3, 19)]))
            if k % 2
            else 0.28 * np.arange(1, 21) ** 2.0
        )
        damping = float(rng.choice([0.999999, 0.99, 1.000001]))
        shapes = rng.normal(size=(2, 20))
        still = abs(
            np.sum(shapes[0] * shapes[1] / (omega**2 - 0.28**2 + 2j * damping * omega * 0.28))
        )
        force = 10 ** rng.uniform(0, 4) * 23.5e-6 / still
        ratio = float(10 ** rng.uniform(-3, -1))
    scene = Scene(
        ModalModel(omega, np.full(20, damping), *shapes, 1.0),
        impact_absorber(23.5e-6, 0.7, None, ratio),
    )
    response = simulate(
        scene,
        Drive(force, linear_sweep(0.28, 0.9, 1.06, 40)),
        record=Record(events=True),
        most_events=20_000,
    )
    assert response.impact_count > 100
    assert len(np.unique(response.impacts.time)) > 0.99 * response.impact_count
