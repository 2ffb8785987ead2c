import numpy as np
import pytest
from numpy.typing import NDArray
from stepped import integrate, order, still, table

from impact_env.drive import Drive, FrequencySchedule, constant_frequency, linear_sweep
from impact_env.kernels.motion.observers import DONE, HELD_LOWER, HELD_UPPER
from impact_env.methods import Moreau, RungeKutta
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    impact_absorber,
)
from impact_env.scene import InitialState, Scene, beam_scene
from reference import dense

LIGHT = 1e-9  # mass ratio of an absorber that the beam does not feel
OMEGA = beam_scene(Beam(modes=1)).model.omega[0]
Array = NDArray[np.float64]


@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber(0.05, 900.0, 0.5)])
def test_fourth_order_on_linear_scenes(absorber: Absorber | None) -> None:
    present = beam_scene(Beam(modes=3, damping_ratio=(0.0, 0.02, 0.1)), absorber)
    initial = InitialState(np.array([1e-3, -2e-4, 5e-5]), np.array([0.1, 0.2, -0.3]))
    truth = dense.follow(present, still(0.1, OMEGA), initial, np.array([0.0, 0.1])).states[-1]
    modal = [0, 1, 2, 4, 5, 6]
    errors = []
    for steps in (30, 60, 120):
        run = integrate(present, still(0.1, OMEGA), RungeKutta(steps), initial)
        assert run.status == DONE
        errors.append(float(np.max(np.abs(run.end - truth)[modal] * np.repeat([OMEGA, 1], 3))))
    assert 3.8 < order(errors) < 4.6
    if isinstance(absorber, StuckAbsorber):
        tip = present.model.tip_shape
        np.testing.assert_allclose(run.states[:, 3], run.states[:, :3] @ tip, atol=1e-12)
        np.testing.assert_allclose(run.states[:, 7], run.states[:, 4:7] @ tip, atol=1e-12)


def textbook(present: Scene, drive: Drive, steps: int) -> Array:
    """The classical method written out on the equations of motion, the slider moved after each step."""
    model, n, sliding = present.model, present.model.modes, present.absorber
    assert isinstance(sliding, SlidingAbsorber)
    assert isinstance(sliding.walls, CompliantWalls)
    assert isinstance(sliding.friction, ElasticCoulombFriction)
    walls, friction, mass = sliding.walls, sliding.friction, present.absorber_mass
    y, rest, h = np.zeros(2 * n + 2), 0.0, drive.schedule.times[-1] / steps

    def slope(t: float, y: Array) -> Array:
        d = y[n] - model.tip_shape @ y[:n]
        p = -walls.stiffness * np.sign(d) * max(abs(d) - walls.gap, 0.0) - np.clip(friction.stiffness * (d - rest), -friction.limit, friction.limit)
        force = drive.amplitude * np.cos(drive.schedule.phase_at(t) + drive.phase)
        modal = model.force_shape * force - model.tip_shape * p - model.omega**2 * y[:n] - 2 * model.damping_ratio * model.omega * y[n + 1 : -1]
        return np.concatenate([y[n + 1 :], modal, [p / mass]])

    for i in range(steps):
        k1 = slope(i * h, y)
        k2 = slope((i + 0.5) * h, y + h / 2 * k1)
        k3 = slope((i + 0.5) * h, y + h / 2 * k2)
        k4 = slope((i + 1) * h, y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        d, reach = y[n] - model.tip_shape @ y[:n], friction.limit / friction.stiffness
        rest = min(max(rest, d - reach), d + reach)
    return y


def test_the_step_is_the_textbook_step() -> None:
    present = beam_scene(Beam(modes=3), SlidingAbsorber(0.02, CompliantWalls(1e5, 5e-5), ElasticCoulombFriction(0.02, 2e4)))
    schedule = FrequencySchedule(np.array([0.0, 0.011, 0.02, 0.03]), np.array([250.0, 300.0, 90.0, 90.0]), OMEGA)
    drive = Drive(20.0, schedule, 0.4)
    run = integrate(present, drive, RungeKutta())
    assert len(run.impacts) > 1
    np.testing.assert_allclose(run.end, textbook(present, drive, int(run.counters["steps"])), rtol=1e-9, atol=1e-13)


def test_a_contact_lasts_as_long_as_half_a_period_on_the_wall() -> None:
    stiffness, speed, gap = 1e-5, 0.05, 1e-3
    light = Scene(beam_scene(Beam(modes=1)).model, SlidingAbsorber(LIGHT, CompliantWalls(stiffness, gap)))
    mass = light.absorber_mass
    assert mass is not None
    contact = np.pi * np.sqrt(mass / stiffness)
    first = gap / speed
    second = first + contact + 2 * gap / speed
    run = integrate(light, still(second + 2 * contact, OMEGA), RungeKutta(20, 100), InitialState(absorber_velocity=speed))
    assert run.end[3] == pytest.approx(speed, rel=1e-4)
    np.testing.assert_allclose(table(run.phases), [[first, first + contact, HELD_UPPER], [second, second + contact, HELD_LOWER]], rtol=1e-5)
    np.testing.assert_allclose(run.impacts["time"], [first, second], rtol=1e-5)
    np.testing.assert_allclose(run.impacts["relative_velocity"], [speed, -speed], rtol=1e-4)
    np.testing.assert_allclose(run.impacts["impulse"], [-2 * mass * speed, 2 * mass * speed], rtol=1e-4)


def test_elastic_friction_stops_the_absorber() -> None:
    limit, stiffness, speed = 1e-9, 1e-5, 0.02
    light = Scene(beam_scene(Beam(modes=1)).model, SlidingAbsorber(LIGHT, None, ElasticCoulombFriction(limit, stiffness)))
    mass, reach = light.absorber_mass, limit / stiffness
    assert mass is not None
    farthest = mass * speed**2 / 2 / limit + reach / 2  # the spring takes limit * reach / 2 on the way to sliding
    duration = 6 * mass * speed / limit
    run = integrate(light, still(duration, OMEGA), RungeKutta(200, 50), InitialState(absorber_velocity=speed), sample_dt=duration / 20_000)
    assert np.max(run.states[:, 1]) == pytest.approx(farthest, rel=1e-4)
    assert np.min(run.states[:, 1]) == pytest.approx(farthest - 2 * reach, rel=1e-3)
    assert run.balance_error < 1e-4


def test_stiff_contact_approaches_rigid_contact() -> None:
    drive = Drive(3.0, linear_sweep(OMEGA, 0.98, 0.985))
    rigid = integrate(beam_scene(Beam(modes=2), impact_absorber()), drive, Moreau(20_000)).impacts["time"][:3]
    errors = []
    for stiffness in (1e5, 1e7, 1e9):
        run = integrate(beam_scene(Beam(modes=2), SlidingAbsorber(0.02, CompliantWalls(stiffness))), drive, RungeKutta())
        errors.append(np.abs(run.impacts["time"][:3] - rigid) * OMEGA / 2 / np.pi)
    assert np.all(errors[1][1:] < errors[0][1:])
    assert np.all(errors[2][1:] < errors[1][1:])
    assert np.max(errors[2]) < 1e-3


@pytest.mark.parametrize(
    ("absorber", "coarse", "fine"),
    [
        (None, 1e-6, 1e-9),
        (StuckAbsorber(), 1e-6, 1e-9),
        (TunedAbsorber(), 1e-6, 1e-9),
        (SlidingAbsorber(0.02, CompliantWalls(1e6)), 1e-2, 1e-3),
        (SlidingAbsorber(0.02, CompliantWalls(1e6), ElasticCoulombFriction(0.1, 1e5)), 1e-2, 1e-3),
        (SlidingAbsorber(0.02, None, ElasticCoulombFriction(0.5, 1e5)), 1e-5, 1e-7),
    ],
)
def test_energy_balance(absorber: Absorber | None, coarse: float, fine: float) -> None:
    present = beam_scene(Beam(modes=3), absorber)
    drive = Drive(3.0, linear_sweep(OMEGA, 0.98, 0.985))
    assert integrate(present, drive, RungeKutta()).balance_error < coarse
    assert integrate(present, drive, RungeKutta(100, 100)).balance_error < fine


@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber()])
def test_moreau_and_runge_kutta_agree_on_linear_scenes(absorber: Absorber | None) -> None:
    present = beam_scene(Beam(modes=3), absorber)
    drive = Drive(-2.0, constant_frequency(OMEGA, 0.97, 20), 0.3)
    one, other = integrate(present, drive, Moreau(5000)), integrate(present, drive, RungeKutta(40))
    np.testing.assert_allclose(one.states, other.states, atol=2e-3 * np.max(np.abs(other.states)))
    for name in ("work", "absorber_damping"):
        np.testing.assert_allclose(one.energy.totals[name], other.energy.totals[name], rtol=2e-3, atol=1e-15)
    np.testing.assert_allclose(one.energy.modal, other.energy.modal, rtol=5e-3)


@pytest.mark.parametrize("mass_ratio", [1e-6, 0.02, 10.0])
@pytest.mark.parametrize("stiffness", [1e2, 1e9])
def test_stable_for_light_and_heavy_absorbers_on_soft_and_hard_walls(mass_ratio: float, stiffness: float) -> None:
    present = beam_scene(Beam(modes=10), SlidingAbsorber(mass_ratio, CompliantWalls(stiffness, 1e-5)))
    run = integrate(present, Drive(1.0, constant_frequency(OMEGA, 1.0, 0.5)), RungeKutta())
    assert run.status == DONE
    assert np.max(np.abs(run.end)) < 1.0
