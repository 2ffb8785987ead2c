import numpy as np
import pytest
import scipy.optimize
from core import OMEGA, PERIOD, drive_of, pushed_base, relative_displacement, run, scene_of, steady_base, still
from stepped import golden

from impact_env import (
    Beam,
    Drive,
    FrequencySchedule,
    InitialState,
    ModalModel,
    Scene,
    StuckAbsorber,
    beam_scene,
    friction_damper,
    impact_absorber,
)
from impact_env.kernels.motion.observers import HELD_LOWER, HELD_UPPER, STUCK_INSIDE
from impact_env.response import Response

GAP = 1e-3


def check(response: Response, balance: float = 1e-12) -> Response:
    """Energy is balanced, walls are not passed, and the lists of phases and impacts are consistent."""
    assert response.energy.relative_error < balance
    assert len(response.impacts.time) == response.impact_count
    assert np.all(np.diff(response.impacts.time) >= 0)
    assert np.all(response.phases.end >= response.phases.start)
    assert response.stuck_time == pytest.approx(np.sum(response.phases.end - response.phases.start), rel=1e-9, abs=1e-15)
    walls = getattr(response.scene.absorber, "walls", None)
    if walls is not None:
        assert np.max(np.abs(relative_displacement(response))) <= walls.gap * (1 + 1e-12) + 1e-16
    return response


# --- golden cases ------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rigid_friction_10_modes", "rigid_frictionless_3_modes"])
def test_golden_case(name: str) -> None:
    _, drive, times, velocities = golden(name, 1.0)
    scene, drive, times, velocities = golden(name, float(times[11]))
    response = check(run(scene, drive))
    period = drive.schedule.pseudo_period
    off = np.abs(response.impacts.time[:10] - times[:10]) / period
    assert off[0] < 1e-12
    assert off[9] < 1e-6
    assert np.all(off < 1e-12 * 12.0 ** np.arange(10))
    np.testing.assert_allclose(response.impacts.relative_velocity[:5], velocities[:5], rtol=1e-8)


# --- bouncing ----------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.5])
def test_bouncing_between_fixed_walls(restitution: float) -> None:
    scene, speed = Scene(steady_base(), impact_absorber(GAP, restitution, mass_ratio=1.0)), 0.05
    speeds = speed * restitution ** np.arange(8)
    times = np.cumsum(np.concatenate([[GAP / speed], 2 * GAP / speeds[1:]]))
    response = check(run(scene, still(times[-1] * 1.001), initial=InitialState(absorber_velocity=speed)))
    np.testing.assert_allclose(response.impacts.time, times, rtol=1e-13)
    np.testing.assert_allclose(response.impacts.relative_velocity, speeds * (-1.0) ** np.arange(8), rtol=1e-13)
    np.testing.assert_allclose(response.impacts.impulse, -(1 + restitution) * response.impacts.relative_velocity, rtol=1e-13)
    np.testing.assert_allclose(response.impacts.energy_lost, (1 - restitution**2) * speeds**2 / 2, rtol=1e-12, atol=1e-20)


def test_an_impact_shares_momentum_with_a_free_base() -> None:
    """Two free masses: the law of restitution and the balance of momentum give both velocities."""
    scene = Scene(pushed_base(), impact_absorber(GAP, 0.5, mass_ratio=3.0))
    response = check(run(scene, still(3 * GAP, 2 * np.pi), initial=InitialState(absorber_velocity=1.0)))
    tip_after = 1.5 * 3 / 4
    np.testing.assert_allclose(response.end_state, [2 * GAP * tip_after, GAP + 2 * GAP * (tip_after - 0.5), tip_after, tip_after - 0.5], rtol=1e-9)


def test_without_rebound_a_fixed_wall_keeps_the_absorber() -> None:
    scene = Scene(steady_base(), impact_absorber(GAP, 0.0, mass_ratio=1.0))
    response = check(run(scene, still(1.0), initial=InitialState(absorber_velocity=0.05)))
    assert response.impact_count == 1
    assert response.end_state[1] == pytest.approx(GAP)
    assert response.phases.start[0] == pytest.approx(0.02)
    np.testing.assert_array_equal(response.phases.kind, [HELD_UPPER])


# --- chatter -----------------------------------------------------------------------------------------------------------------------------------


def bounces(restitution: float, until: float) -> tuple[list[float], list[float]]:
    """Times and relative velocities of an absorber that the rising wall -2 cos(t) - GAP throws up until it comes to rest on it."""
    time, place, speed, times, velocities = 0.0, -2.0, 0.0, [], []
    while len(times) < 300:

        def distance(t: float) -> float:
            return place + speed * (t - time) + 2 * np.cos(t) + GAP  # noqa: B023

        flight = 2 * (speed - 2 * np.sin(time)) / (2 * np.cos(time)) if times else 0.06
        if flight < until:
            break
        time_next = scipy.optimize.brentq(distance, time + 0.5 * flight, time + 2 * flight, xtol=1e-16, rtol=1e-15)
        time, before = time_next, speed
        place, speed = -2 * np.cos(time) - GAP, 2 * np.sin(time) - restitution * (before - 2 * np.sin(time))
        times.append(time)
        velocities.append(before - 2 * np.sin(time))
    return times, velocities


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7, 0.9])
def test_complete_chatter_on_an_accelerating_wall(restitution: float, direction: float) -> None:
    """The wall behind throws the absorber up, ever lower, holds it while it accelerates, and lets it fly on to the other wall when it slows down."""
    base = ModalModel([1.0], [0.0], [0.0], [1.0], 1.0)
    scene = Scene(base, impact_absorber(GAP, restitution, mass_ratio=1e-13))
    start = InitialState(np.array([-2.0 * direction]))
    response = check(run(scene, still(1.9, 1.0), initial=start))
    times, velocities = bounces(restitution, 1e-3)
    few = min(len(times), 10)
    np.testing.assert_allclose(response.impacts.time[:few], times[:few], rtol=1e-9)
    np.testing.assert_allclose(response.impacts.relative_velocity[:few] * direction, velocities[:few], rtol=1e-8)
    times, _ = bounces(restitution, 1e-6)
    joined = times[-1] + (times[-1] - times[-2]) * restitution / (1 - restitution) if restitution > 0 else times[0]
    wall = HELD_LOWER if direction > 0 else HELD_UPPER
    assert response.phases.kind[0] == wall
    assert response.phases.start[0] == pytest.approx(joined, abs=2e-6 / (1 - restitution))
    assert response.phases.end[0] == pytest.approx(np.pi / 2, abs=1e-9)
    after = response.impacts.time[response.impacts.time > 1.6]
    crossing = scipy.optimize.brentq(lambda t: 2 * (t - np.sin(t)) - 2 * GAP, 0.1, 0.3)
    assert after[0] == pytest.approx(np.pi / 2 + crossing, rel=1e-8)


@pytest.mark.parametrize("limit", [0.05, 0.4])
def test_chatter_with_friction(limit: float) -> None:
    """Friction slows a bounce on its way out and on its way back, so each bounce returns slower than restitution alone lets it."""
    push, mass = 2.0, 0.5
    base = ModalModel([1e-2], [0.0], [1e3], [1e-6], 1.0)  # does not feel the absorber: 2000 N give a tip acceleration of 2 m/s^2
    out, back = push + limit / mass, push - limit / mass
    ratio, restitution = np.sqrt(back / out), 0.6
    first = np.sqrt(2 * GAP / back)
    speeds = back * first * (restitution * ratio) ** np.arange(300)
    flights = restitution * speeds * (1 / out + ratio / back)
    scene = Scene(base, impact_absorber(GAP, restitution, limit, mass_ratio=mass))
    response = check(run(scene, Drive(push * 1e3, FrequencySchedule(np.array([0.0, 0.5]), np.zeros(2), 2 * np.pi))))
    np.testing.assert_allclose(response.impacts.time[:8], first + np.concatenate([[0], np.cumsum(flights[:7])]), rtol=1e-6)
    np.testing.assert_allclose(-response.impacts.relative_velocity[:8], speeds[:8], rtol=1e-4)
    assert response.phases.start[-1] == pytest.approx(first + np.sum(flights), abs=3e-5)
    assert response.phases.kind[-1] == HELD_LOWER


def test_low_frequency_motion_holds_releases_and_crosses() -> None:
    """Far below the first resonance the absorber rests on the wall behind for half of each period."""
    response = check(run(scene_of(impact_absorber(1e-6, 0.5)), drive_of(100.0, 0.05, periods=100)), 1e-10)
    assert {HELD_LOWER, HELD_UPPER} == set(response.phases.kind)
    assert 0.2 < response.stuck_time / (100 * PERIOD) < 0.99


# --- friction ----------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.02, -0.3])
def test_a_sliding_mass_stops_where_and_when_coulomb_says(speed: float) -> None:
    scene, limit = Scene(steady_base(), friction_damper(0.25, 1.0)), 0.25
    stop = abs(speed) / limit
    response = check(run(scene, still(2 * stop), initial=InitialState(absorber_velocity=speed)))
    assert response.end_state[1] == pytest.approx(np.sign(speed) * speed**2 / limit / 2, rel=1e-13)
    np.testing.assert_allclose(response.phases.start, [stop], rtol=1e-13)
    np.testing.assert_allclose(response.phases.end, [2 * stop], rtol=1e-13)
    np.testing.assert_array_equal(response.phases.kind, [STUCK_INSIDE])
    assert response.energy.friction_loss == pytest.approx(speed**2 / 2, rel=1e-13)


@pytest.mark.parametrize("start", [9.5, -7.9, 4.2, 1.4, 0.6])
def test_coulomb_oscillator(start: float) -> None:
    """A mode that rubs on an immovable mass loses two deflections by friction each half period, and stops within one."""
    model, limit = ModalModel([100.0], [0.0], [0.0], [2.0], 1.0), 0.3
    unit, half = 2.0 * limit / 100.0**2, np.pi / 100
    scene = Scene(model, friction_damper(limit, 1e7))
    halves = int(np.ceil((abs(start) - 1) / 2)) if abs(start) > 1 else 0
    response = check(run(scene, still((halves + 0.01) * half), initial=InitialState(np.array([start * unit]), absorber_displacement=0.0)))
    rest = np.sign(start) * (abs(start) - 2 * halves) * (-1) ** halves * unit
    assert response.end_state[0] == pytest.approx(rest, rel=1e-6)
    np.testing.assert_allclose(response.phases.start, [halves * half], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(response.phases.end, [(halves + 0.01) * half], rtol=1e-12)


def test_friction_on_a_slowly_shaken_base() -> None:
    """The absorber sticks until its inertia exceeds the limit: the base is pushed by a force that rises like a sine."""
    base = ModalModel([1e-6], [0.0], [1e3], [1e-6], 1.0)
    shake, limit, omega = 2.0, 1.2, 30.0
    scene = Scene(base, friction_damper(limit, 1.0))
    response = check(run(scene, Drive(shake * 1e3, FrequencySchedule(np.array([0.0, 0.2]), np.full(2, omega), omega), -np.pi / 2)), 1e-11)
    assert response.phases.kind[0] == STUCK_INSIDE
    assert response.phases.end[0] == pytest.approx(np.arcsin(limit / shake) / omega, rel=1e-8)


def test_friction_that_never_slides_is_a_stuck_absorber() -> None:
    drive = drive_of(5.0, 0.9, 1.1, periods=20)
    stuck = run(scene_of(StuckAbsorber()), drive)
    for absorber in (friction_damper(1e6), impact_absorber(friction_limit=1e6)):
        held = check(run(scene_of(absorber), drive))
        assert held.stuck_time == pytest.approx(20 * PERIOD)
        np.testing.assert_allclose(held.end_state, stuck.end_state, rtol=0, atol=1e-12 * np.max(np.abs(stuck.end_state)))


def test_a_wide_gap_leaves_a_friction_damper_or_nothing() -> None:
    drive = drive_of(5.0, 0.98, 1.02, periods=20)
    for wide, without in ((impact_absorber(1.0, 0.5, 0.1), friction_damper(0.1)), (impact_absorber(1.0, 0.5), None)):
        one, other = check(run(scene_of(wide), drive)), run(scene_of(without), drive)
        assert one.impact_count == 0
        for rows in (slice(0, 3), slice(4, 7)):
            np.testing.assert_allclose(one.end_state[rows], other.end_state[rows], rtol=0, atol=1e-11 * np.max(np.abs(other.end_state[rows])))


def test_vanishing_friction_is_no_friction() -> None:
    drive = drive_of(10.0, 1.0, periods=8)
    without, little = (check(run(scene_of(impact_absorber(GAP, 0.8, limit)), drive)) for limit in (None, 1e-14))
    assert without.impact_count > 0
    few = min(4, without.impact_count)
    np.testing.assert_allclose(little.impacts.time[:few], without.impacts.time[:few], rtol=1e-9)


# --- starts and limits -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("limit", [None, 0.1])
@pytest.mark.parametrize("force", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("speed", [0.0, 0.05, -0.05])
def test_start_on_the_wall(side: float, limit: float | None, force: float, speed: float) -> None:
    scene = scene_of(impact_absorber(GAP, 0.7, limit))
    response = check(run(scene, drive_of(force, 1.0), initial=InitialState(absorber_displacement=side * GAP, absorber_velocity=speed)), 1e-11)
    into = np.any(response.impacts.time == 0)
    assert into == (speed * side > 0)
    if force == speed == 0:
        assert response.end_state[3] == side * GAP
        assert response.impact_count == 0


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("limit", [None, 0.1])
@pytest.mark.parametrize("modes", [1, 3, 10])
def test_rest_stays_at_rest(restitution: float, limit: float | None, modes: int) -> None:
    np.testing.assert_array_equal(run(scene_of(impact_absorber(GAP, restitution, limit), modes=modes), drive_of(0.0, 1.0)).end_state, 0.0)


@pytest.mark.parametrize("side", [1, -1])
def test_grazing(side: int) -> None:
    """A tip that swings a hair less than the gap never touches the resting absorber; a hair more, and it does so where the sine says."""
    omega = 100.0
    scene = Scene(ModalModel([omega], [0.0], [0.0], [1.0], 1.0), impact_absorber(GAP, 1.0, mass_ratio=1e-3))
    for hair in (1e-6, 1e-9, 1e-12):
        missed, touched = (
            check(run(scene, still(0.1), initial=InitialState(modal_velocity=np.array([-side * GAP * omega * (1 + h)]), absorber_displacement=0.0)))
            for h in (-hair, hair)
        )
        assert missed.impact_count == 0
        late = np.arccos(1 / (1 + hair)) / omega  # the quarter period less the time of contact
        assert touched.impacts.time[0] == pytest.approx(np.pi / 2 / omega - late, abs=1e-15 / (omega * np.sqrt(hair)) * 10)
        assert np.sign(touched.impacts.relative_velocity[0]) == side


@pytest.mark.parametrize("modes", [1, 5, 20, 60])
@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_truncations_and_restitutions(modes: int, restitution: float) -> None:
    periods = 4 if modes < 60 else 2
    response = check(run(scene_of(impact_absorber(2e-4, restitution), modes=modes), drive_of(5.0, 1.0, periods=periods)), 1e-9)
    assert response.impact_count > 0
    assert (response.energy.impact_loss == pytest.approx(0, abs=1e-18)) == (restitution == 1.0)


@pytest.mark.parametrize("friction_limit", [None, 0.1])
def test_all_times_of_a_run_do_not_depend_on_its_windows(friction_limit: float | None) -> None:
    """Breaks in a straight schedule cut the run into other windows; the first impacts must not notice."""
    scene, end = scene_of(impact_absorber(GAP, 0.7, friction_limit)), 8 * PERIOD
    times = [np.array([0.0, end]), np.sort(np.concatenate([[0.0, end], np.random.default_rng(1).uniform(0, end, 37)]))]
    runs = [check(run(scene, Drive(3.5, FrequencySchedule(t, OMEGA * (0.98 + 0.02 * t / end), OMEGA)))) for t in times]
    assert all(r.impacts is not None and r.impact_count >= 6 for r in runs)
    np.testing.assert_allclose(runs[1].impacts.time[:6], runs[0].impacts.time[:6], rtol=0, atol=1e-9 * PERIOD)


def test_a_window_that_ends_within_a_tiny_flight() -> None:
    """A fast sweep has short windows; one of them ends between the last bounces of a chatter, and the run must not depend on where."""
    scene = beam_scene(Beam(modes=3), impact_absorber(restitution=0.7))
    reference = scene.model.resonance_omega(1)
    runs = []
    for stretches in (1, 7):
        share = np.linspace(0, 1, stretches + 1)
        drive = Drive(500.0, FrequencySchedule(share * 4 * np.pi / reference, 30 * share * reference, reference))
        runs.append(run(scene, drive))
    for response in runs:
        assert response.energy.relative_error < 1e-12
    assert runs[0].impact_count == runs[1].impact_count
