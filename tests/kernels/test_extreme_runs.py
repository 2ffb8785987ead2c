"""Runs at the edge of what numbers tell apart: a force at its bound, an impact that pushes another absorber into its wall, a fast force."""

import core
import numpy as np
import pytest
from core import OMEGA, drive_of, still

from impact_env import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    InitialState,
    Response,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    beam_scene,
    constant_frequency,
    friction_damper,
    impact_absorber,
    simulate,
)
from impact_env.drive import Drive

ONE_MODE = Beam(modes=1, damping_ratio=0.0)
START = 1e-3  # m, of the mode
SPRING = 100 * Beam().static_tip_stiffness


def run(scene: Scene, drive: Drive, start: InitialState | None = None) -> Response:
    """Observe all, and find no miss."""
    response = simulate(scene, drive, initial=start, most_events=200_000, record=core.ALL)
    assert response.check.misses == 0
    return response


@pytest.mark.plain
@pytest.mark.parametrize("roundings", [-8, 0, 1, 8])
@pytest.mark.parametrize("angle", [0.0, 0.188, 1.1])
def test_a_joint_force_that_touches_its_bound_lets_the_run_go_on(roundings: int, angle: float) -> None:
    """A stuck absorber on an undamped mode: its joint force swings up to the friction limit, but for roundings, and the motion is a cosine."""
    scene = beam_scene(ONE_MODE, friction_damper(1.0))
    mass, shape, omega = float(scene.absorber_masses[0]), float(scene.model.tip_shape[0]), float(scene.model.omega[0])
    joined = omega / np.sqrt(1 + mass * shape**2)
    limit = mass * abs(shape) * joined**2 * START
    scene = beam_scene(ONE_MODE, friction_damper(limit * (1 + roundings * 1.1e-16)))
    q, v = START * np.cos(angle), START * joined * np.sin(angle)
    drive = still(6 * 2 * np.pi / OMEGA)
    response = run(scene, drive, InitialState(np.array([q]), np.array([v]), None, shape * v))
    phase = joined * float(drive.schedule.times[-1]) - angle
    assert response.steps < 100
    assert response.end_state[0] == pytest.approx(START * np.cos(phase), abs=1e-10 * START)
    assert response.end_state[1] == pytest.approx(START * shape * np.cos(phase), abs=1e-10 * START)


@pytest.mark.plain
def test_an_impact_that_pushes_another_absorber_into_its_wall_makes_it_hit_at_once() -> None:
    """The other one is on its wall and about to leave it: without the hit it would be beyond the wall for a microsecond."""
    scene = beam_scene(ONE_MODE, SeveralAbsorbers((impact_absorber(1e-5, 0.5, None, 0.01), impact_absorber(1e-3, 0.0, None, 1e-3)), (1.0, 1.0)))
    shape, (other, mass) = float(scene.model.tip_shape[0]), scene.absorber_masses
    tip, speed = -abs(shape) * START, 0.025
    start = InitialState(np.array([tip / shape]), None, (tip + 1e-5, tip - 1e-3), (0.0, -speed))
    response = run(scene, still(1e-4), start)
    pushed = shape**2 * speed / (1 / mass + shape**2)
    np.testing.assert_array_equal(response.impacts.absorber[:2], [1, 0])
    np.testing.assert_allclose(response.impacts.time[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(response.impacts.relative_velocity[:2], [-speed, pushed], rtol=1e-9)
    assert response.impacts.impulse[1] == pytest.approx(-1.5 * pushed / (1 / other + shape**2), rel=1e-9)


@pytest.mark.plain
def test_bounces_beside_an_absorber_that_sticks_die_out() -> None:
    """Each impact tears the stuck one loose, and its friction takes energy out, so that even restitution 1 comes to rest on a wall."""
    scene = beam_scene(ONE_MODE, SeveralAbsorbers((impact_absorber(1e-5, 1.0, None, 0.5), friction_damper(7.0, 0.4)), (1.0, 1.0)))
    shape = float(scene.model.tip_shape[0])
    start = InitialState(np.array([START / shape]), None, (START + 1e-5, START), (1e-3, 0.0))
    response = run(scene, still(5e-3), start)
    energy, phases, end = response.energy, response.phases, response.end_state
    assert response.impact_count < 200
    assert set(phases.absorber[phases.end == phases.end.max()].tolist()) == {0, 1}
    np.testing.assert_allclose(end[4:], shape * end[3], rtol=1e-12)
    assert end[1] - shape * end[0] == pytest.approx(1e-5, rel=1e-9)
    assert energy.friction_loss > 0
    assert abs(energy.balance_error) < 1e-12 * energy.stored_at_start


@pytest.mark.parametrize("force", [3.5, 1e4])
def test_energy_is_balanced_under_a_force_far_above_all_modes(force: float) -> None:
    """Work is a small rest of what flows to and fro, so noise of the forced motion shows in it; a large force makes the absorber slide."""
    scene = beam_scene(Beam(modes=10), friction_damper(0.1))
    response = run(scene, drive_of(force, 1e4, periods=2.0))
    energy = response.energy
    assert energy.work > 0
    assert abs(energy.balance_error) < 2e-10 * energy.work
    assert (response.stuck_time < 1e-3) == (force > 1e3)


def test_a_spring_of_friction_that_gives_way_at_once_has_no_effect() -> None:
    """Its limit lies far below the rounding of every number of the run, so that no sum finds the time at which it gives way."""
    walls, drive = CompliantWalls(SPRING), Drive(3.5, constant_frequency(beam_scene(Beam()).model.resonance_omega(1), 0.98, 400.0))
    free, dragged = (
        core.run(beam_scene(Beam(), SlidingAbsorber(walls=walls, friction=friction)), drive)
        for friction in (None, ElasticCoulombFriction(1e-200, SPRING))
    )
    early, tip = free.history.time < 5 * 2 * np.pi / OMEGA, free.history.tip_displacement
    np.testing.assert_allclose(dragged.history.tip_displacement[early], tip[early], atol=1e-12 * np.max(np.abs(tip)))
    whole, other = (np.sqrt(np.mean(response.history.tip_displacement**2)) for response in (free, dragged))  # type: ignore[union-attr]
    assert other == pytest.approx(whole, rel=0.2)  # after many impacts another draw of the same motion
