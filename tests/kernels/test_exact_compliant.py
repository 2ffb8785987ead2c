from itertools import pairwise

import numpy as np
import pytest
from core import OMEGA, PERIOD, drive_of, relative_displacement, run, scene_of, steady_base, still

from impact_env import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    InitialState,
    RungeKutta,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.kernels.motion.observers import HELD_LOWER, HELD_UPPER, STUCK_INSIDE
from impact_env.response import Response

GAP = 1e-3
BEAM = Beam().static_tip_stiffness  # 3 EI / l^3, the paper's unit of contact stiffness


def walls(stiffness: float = 100 * BEAM, gap: float = GAP) -> SlidingAbsorber:
    return SlidingAbsorber(walls=CompliantWalls(stiffness, gap))


def slider(limit: float, stiffness: float = 10 * BEAM) -> SlidingAbsorber:
    return SlidingAbsorber(friction=ElasticCoulombFriction(limit, stiffness))


def both(limit: float, stiffness: float = 100 * BEAM, gap: float = GAP) -> SlidingAbsorber:
    return SlidingAbsorber(walls=CompliantWalls(stiffness, gap), friction=ElasticCoulombFriction(limit, stiffness))


def balanced(response: Response, error: float = 1e-11) -> Response:
    assert response.impacts is not None
    assert response.energy.relative_error < error
    assert np.all(response.phases.end >= response.phases.start)
    assert response.stuck_time == pytest.approx(np.sum((response.phases.end - response.phases.start)[response.phases.kind == STUCK_INSIDE]))
    return response


@pytest.mark.parametrize("side", [1, -1])
def test_a_contact_lasts_half_a_period_on_the_wall(side: int) -> None:
    stiffness, mass, speed = 4e4, 0.25, 0.05
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, GAP)))
    lasts, flight = np.pi * np.sqrt(mass / stiffness), 2 * GAP / speed
    begins = GAP / speed + (lasts + flight) * np.arange(4)
    response = balanced(run(scene, still(begins[-1] + 1.5 * lasts), initial=InitialState(absorber_velocity=side * speed), samples=512))
    np.testing.assert_allclose(response.phases.start, begins, rtol=1e-12)
    np.testing.assert_allclose(response.phases.end, begins + lasts, rtol=1e-12)
    np.testing.assert_array_equal(response.phases.kind, [HELD_UPPER, HELD_LOWER, HELD_UPPER, HELD_LOWER][::side])
    np.testing.assert_allclose(response.impacts.time, begins, rtol=1e-12)
    np.testing.assert_allclose(response.impacts.relative_velocity, side * speed * np.array([1, -1, 1, -1]), rtol=1e-11)
    np.testing.assert_allclose(response.impacts.impulse, -2 * mass * response.impacts.relative_velocity, rtol=1e-9)
    deepest = GAP + speed * np.sqrt(mass / stiffness)
    assert deepest * (1 - 1e-3) < np.max(np.abs(relative_displacement(response))) <= deepest * (1 + 1e-12)


def test_an_elastic_slider_holds_then_slips_then_oscillates() -> None:
    """A mass on a spring up to the slider's limit, then uniformly slowed, then on the spring again about where it stopped."""
    stiffness, limit, mass, speed = 4e3, 0.6, 0.25, 0.05
    scene = Scene(steady_base(), SlidingAbsorber(mass, None, ElasticCoulombFriction(limit, stiffness)))
    omega, reach = np.sqrt(stiffness / mass), limit / stiffness
    slip = np.arcsin(reach * omega / speed) / omega
    left = speed * np.cos(omega * slip)
    stick, slid = slip + left * mass / limit, left**2 * mass / limit / 2
    end = stick + 2.3 / omega
    response = balanced(run(scene, still(end), initial=InitialState(absorber_velocity=speed), samples=512))
    np.testing.assert_allclose(response.phases.start, [0, stick], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(response.phases.end, [slip, end], rtol=1e-10)
    assert response.end_state[1] == pytest.approx(slid + reach * np.cos(2.3), rel=1e-10)


def test_a_slider_below_its_limit_is_a_spring() -> None:
    """No slip: the energy that the friction account holds is what its spring holds, and the motion is harmonic."""
    stiffness, mass, speed = 4e3, 0.25, 0.01
    scene = Scene(steady_base(), SlidingAbsorber(mass, None, ElasticCoulombFriction(1e3, stiffness)))
    omega, end = np.sqrt(stiffness / mass), 0.123
    response = balanced(run(scene, still(end), initial=InitialState(absorber_velocity=speed)))
    stretch = speed / omega * np.sin(omega * end)
    assert response.end_state[1] == pytest.approx(stretch, rel=1e-11)
    assert response.energy.friction_loss == pytest.approx(stiffness * stretch**2 / 2, rel=1e-10)


SCENES = [walls(), walls(1e-2 * BEAM, 1e-4), slider(0.5), slider(0.05, BEAM), both(0.1), both(0.02, 3 * BEAM, 3e-4), walls(10 * BEAM, 0.0)]


@pytest.mark.parametrize("absorber", SCENES)
def test_fine_runge_kutta_steps_converge_to_it(absorber: SlidingAbsorber) -> None:
    scene, drive = scene_of(absorber, modes=2), drive_of(6.0, 1.0, 0.9, periods=3)
    exact = balanced(run(scene, drive))
    coarse, fine = (run(scene, drive, RungeKutta(steps, steps)) for steps in (100, 400))
    assert coarse.history is not None
    assert fine.history is not None
    scale = np.max(np.abs(exact.history.tip_displacement))
    errors = [np.max(np.abs(run_.history.tip_displacement - exact.history.tip_displacement)) / scale for run_ in (coarse, fine)]
    assert errors[1] < 3e-5
    assert errors[1] < max(errors[0] / 3, 1e-6)
    assert exact.impact_count == fine.impact_count == len(exact.impacts.time)
    np.testing.assert_allclose(exact.impacts.time, fine.impacts.time, rtol=0, atol=1e-4 * PERIOD)


@pytest.mark.parametrize("absorber", SCENES)
@pytest.mark.parametrize("periods", [0.3, 3.3, 30.0])
def test_energy_is_balanced_wherever_a_run_ends(absorber: SlidingAbsorber, periods: float) -> None:
    response = balanced(run(scene_of(absorber), drive_of(3.0, 0.98, 1.0, periods=periods)))
    assert response.history.time[-1] == pytest.approx(periods * PERIOD, abs=PERIOD / 32)


def test_energy_of_the_sweep_with_elastic_friction() -> None:
    response = balanced(run(scene_of(slider(0.5)), drive_of(3.0, 0.98, 1.0, periods=200)), 1e-12)
    assert response.energy.friction_loss > 0


def test_stiff_walls_approach_rigid_ones() -> None:
    """The first contact is the same; what follows differs by the duration of a contact, which goes with the root of the stiffness."""
    drive = drive_of(20.0, 1.0, periods=2.0)
    rigid = run(scene_of(impact_absorber(GAP), modes=1), drive)
    assert rigid.impact_count >= 2
    gaps = []
    for stiffness in (1e4, 1e6, 1e8):
        soft = balanced(run(scene_of(walls(stiffness * BEAM), modes=1), drive))
        assert soft.impacts.time[0] == pytest.approx(rigid.impacts.time[0], rel=1e-12)
        gaps.append(abs(soft.impacts.time[1] - rigid.impacts.time[1]) / PERIOD)
    assert gaps[2] < 1e-4
    assert all(5 < a / b < 20 for a, b in pairwise(gaps))


def test_stiff_friction_approaches_rigid_friction() -> None:
    drive = drive_of(3.0, 1.0, periods=6)
    rigid = run(scene_of(friction_damper(0.5), modes=1), drive)
    far = [np.max(np.abs(run(scene_of(slider(0.5, k * BEAM), modes=1), drive).end_state - rigid.end_state)[:1]) for k in (1e2, 1e4, 1e6)]
    assert far[2] < 1e-3 * np.abs(rigid.end_state[0])
    assert far[2] < far[1] < far[0]


def test_limits_of_the_springs() -> None:
    drive = drive_of(5.0, 0.9, 1.1, periods=10)
    alone, stuck = (run(scene_of(a), drive).end_state[:3] for a in (None, StuckAbsorber()))
    scale = np.max(np.abs(alone))
    far = balanced(run(scene_of(walls(gap=1.0)), drive))
    assert far.impact_count == 0
    np.testing.assert_allclose(far.end_state[:3], alone, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(run(scene_of(slider(1e6, 1e6 * BEAM)), drive).end_state[:3], stuck, rtol=0, atol=1e-3 * scale)
    np.testing.assert_allclose(run(scene_of(slider(1e-12, BEAM)), drive).end_state[:3], alone, rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("place", [1.5 * GAP, -1.5 * GAP, GAP])
def test_a_start_in_the_spring_of_a_wall(place: float) -> None:
    """Overlap at the start is allowed, since the wall is a spring: it throws the absorber back."""
    stiffness, mass = 4e4, 0.25
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, GAP)))
    omega = np.sqrt(stiffness / mass)
    depth = abs(place) - GAP
    start = InitialState(absorber_displacement=place)
    response = balanced(run(scene, still(0.01), initial=start))
    expected = np.sign(place) * (GAP - depth * omega * (0.01 - np.pi / 2 / omega)) if depth > 0 else place
    assert response.end_state[1] == pytest.approx(expected, rel=1e-11)
    assert response.impact_count == len(response.impacts.time) == run(scene, still(0.01), RungeKutta(), start).impact_count


@pytest.mark.parametrize("modes", [1, 10, 20])
@pytest.mark.parametrize("damping", [0.0, 0.01, 1.5])
def test_truncations_and_dampings(modes: int, damping: float) -> None:
    for absorber in (walls(1e3 * BEAM, 2e-4), both(0.1, 10 * BEAM, 2e-4)):
        response = balanced(run(scene_of(absorber, modes=modes, damping_ratio=damping), drive_of(20.0, 1.0, periods=3)), 1e-10)
        assert (response.impact_count > 0) == (damping < 1)  # an overdamped beam does not reach the walls


def test_mirror_symmetry() -> None:
    scene = scene_of(both(0.1))
    one, other = (run(scene, drive_of(force, 1.0, periods=6)) for force in (5.0, -5.0))
    assert one.impact_count > 1
    np.testing.assert_array_equal(one.end_state, -other.end_state)


def test_a_contact_that_lasts_to_the_end_is_counted_and_listed() -> None:
    for method in (None, RungeKutta()):
        scene = Scene(steady_base(), SlidingAbsorber(0.25, CompliantWalls(4e4, GAP)))
        response = run(scene, still(0.021, OMEGA), method, InitialState(absorber_velocity=0.05))
        assert response.impact_count == 1
        assert len(response.impacts.time) == response.impact_count
