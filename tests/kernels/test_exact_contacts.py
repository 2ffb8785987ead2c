"""Contacts of the exact method, rigid and compliant, are correct.

They are compared with closed forms, golden cases and limits.
"""

from itertools import pairwise

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
from core import (
    PERIOD,
    check,
    drive_of,
    golden,
    pushed_base,
    relative_displacement,
    run,
    scene_of,
    steady_base,
    still,
)

from impact_env import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    Drive,
    ElasticCoulombFriction,
    FrequencySchedule,
    InitialState,
    ModalModel,
    Record,
    RigidWalls,
    RungeKutta,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    simulate,
)
from impact_env.kernels.compiling.jit import COMPILED
from impact_env.kernels.events import search
from impact_env.kernels.motion.observers import HELD_LOWER, HELD_UPPER, STUCK_INSIDE
from impact_env.parameters import Absorber

GAP = 1e-3
BEAM = Beam().static_tip_stiffness  # 3 EI / l^3, the paper's unit of contact stiffness


def walls(stiffness: float = 100 * BEAM, gap: float = GAP) -> SlidingAbsorber:
    return SlidingAbsorber(walls=CompliantWalls(stiffness, gap))


def slider(limit: float, stiffness: float = 10 * BEAM) -> SlidingAbsorber:
    return SlidingAbsorber(friction=ElasticCoulombFriction(limit, stiffness))


@pytest.mark.parametrize("name", ["rigid_friction_10_modes", "rigid_frictionless_3_modes"])
def test_golden_case(name: str) -> None:
    scene, drive, times, velocities = golden(name, float(golden(name, 1.0)[2][11]))
    response = check(run(scene, drive))
    off = np.abs(response.impacts.time[:10] - times[:10]) / drive.schedule.pseudo_period
    assert off[0] < 1e-12
    assert off[9] < 1e-6
    assert np.all(off < 1e-12 * 12.0 ** np.arange(10))
    np.testing.assert_allclose(response.impacts.relative_velocity[:5], velocities[:5], rtol=1e-8)


# --- rigid walls


@pytest.mark.parametrize("restitution", [1.0, 0.9, 0.5])
def test_bouncing_between_fixed_walls(restitution: float) -> None:
    scene = Scene(steady_base(), impact_absorber(GAP, restitution, mass_ratio=1.0))
    speed = 0.05
    speeds = speed * restitution ** np.arange(8)
    times = np.cumsum(np.concatenate([[GAP / speed], 2 * GAP / speeds[1:]]))
    impacts = check(
        run(scene, still(times[-1] * 1.001), initial=InitialState(absorber_velocity=speed))
    ).impacts
    np.testing.assert_allclose(impacts.time, times, rtol=1e-13)
    np.testing.assert_allclose(
        impacts.relative_velocity, speeds * (-1.0) ** np.arange(8), rtol=1e-13
    )
    np.testing.assert_allclose(
        impacts.impulse, -(1 + restitution) * impacts.relative_velocity, rtol=1e-13
    )
    np.testing.assert_allclose(
        impacts.energy_lost, (1 - restitution**2) * speeds**2 / 2, rtol=1e-12, atol=1e-20
    )


def test_a_free_absorber_falls_by_its_weight() -> None:
    absorber = SlidingAbsorber(1.0, RigidWalls(1.0, 0.7), gravity=9.81)
    response = run(Scene(steady_base(), absorber), still(0.1), initial=InitialState())
    assert response.end_state[1] == pytest.approx(-9.81 * 0.1**2 / 2, rel=1e-12)
    assert response.end_state[3] == pytest.approx(-9.81 * 0.1, rel=1e-12)


def test_an_impact_shares_momentum_with_a_free_base() -> None:
    """Two free masses: the law of restitution and the balance of momentum give both velocities."""
    scene = Scene(pushed_base(), impact_absorber(GAP, 0.5, mass_ratio=3.0))
    response = check(
        run(scene, still(3 * GAP, 2 * np.pi), initial=InitialState(absorber_velocity=1.0))
    )
    tip_after = 1.5 * 3 / 4
    np.testing.assert_allclose(
        response.end_state,
        [2 * GAP * tip_after, GAP + 2 * GAP * (tip_after - 0.5), tip_after, tip_after - 0.5],
        rtol=1e-9,
    )


def bounces(restitution: float, until: float) -> tuple[list[float], list[float]]:
    """Return times and relative velocities of the impacts on a rising wall.

    The wall -2 cos(t) - GAP throws the absorber up until it comes to rest on the wall.
    """
    time = 0.0
    place = -2.0
    speed = 0.0
    times = []
    velocities = []
    while len(times) < 300:

        def distance(t: float) -> float:
            return place + speed * (t - time) + 2 * np.cos(t) + GAP  # noqa: B023

        flight = 2 * (speed - 2 * np.sin(time)) / (2 * np.cos(time)) if times else 0.06
        if flight < until:
            break
        time_next = scipy.optimize.brentq(
            distance, time + 0.5 * flight, time + 2 * flight, xtol=1e-16, rtol=1e-15
        )
        time = time_next
        before = speed
        place = -2 * np.cos(time) - GAP
        speed = 2 * np.sin(time) - restitution * (before - 2 * np.sin(time))
        times.append(time)
        velocities.append(before - 2 * np.sin(time))
    return times, velocities


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7, 0.9])
def test_complete_chatter_on_an_accelerating_wall(restitution: float, direction: float) -> None:
    """Complete chatter on an accelerating wall agrees with its closed form.

    The wall throws the absorber up, ever lower, and holds it while the wall accelerates. When the
    wall slows down, the absorber flies to the other wall.

    What the last impact closes is below the bound that docs/method.md gives.
    """
    scene = Scene(
        ModalModel([1.0], [0.0], [0.0], [1.0], 1.0),
        impact_absorber(GAP, restitution, mass_ratio=1e-13),
    )
    response = check(
        run(scene, still(1.9, 1.0), initial=InitialState(np.array([-2.0 * direction])))
    )
    impacts = response.impacts
    phases = response.phases
    times, velocities = bounces(restitution, 1e-3)
    few = min(len(times), 10)
    np.testing.assert_allclose(impacts.time[:few], times[:few], rtol=1e-9)
    np.testing.assert_allclose(
        impacts.relative_velocity[:few] * direction, velocities[:few], rtol=1e-8
    )
    times, _ = bounces(restitution, 1e-6)
    joined = (
        times[-1] + (times[-1] - times[-2]) * restitution / (1 - restitution)
        if restitution > 0
        else times[0]
    )
    assert phases.kind[0] == (HELD_LOWER if direction > 0 else HELD_UPPER)
    assert phases.start[0] == pytest.approx(joined, abs=2e-6 / (1 - restitution))
    assert phases.end[0] == pytest.approx(np.pi / 2, abs=1e-9)
    last = np.abs(impacts.relative_velocity[impacts.time <= phases.start[0]])[-1]
    assert restitution * last < np.sqrt(
        2 * 2.0 * max(1 - restitution, 0.1) * 64 * 2.2e-16 * 8.0
    )  # terms of 2 m each: base, absorber, their rates
    after = impacts.time[impacts.time > 1.6]
    crossing = scipy.optimize.brentq(lambda t: 2 * (t - np.sin(t)) - 2 * GAP, 0.1, 0.3)
    assert after[0] == pytest.approx(np.pi / 2 + crossing, rel=1e-8)


@pytest.mark.parametrize("limit", [0.05, 0.4])
def test_chatter_with_friction(limit: float) -> None:
    """Chatter with friction agrees with its closed form.

    Friction slows a bounce on its way out and on its way back. Each bounce therefore returns slower
    than by restitution alone.
    """
    push = 2.0
    mass = 0.5
    base = ModalModel(
        [1e-2], [0.0], [1e3], [1e-6], 1.0
    )  # does not feel the absorber: 2000 N give a tip acceleration of 2 m/s^2
    out = push + limit / mass
    back = push - limit / mass
    ratio = np.sqrt(back / out)
    restitution = 0.6
    first = np.sqrt(2 * GAP / back)
    speeds = back * first * (restitution * ratio) ** np.arange(300)
    flights = restitution * speeds * (1 / out + ratio / back)
    scene = Scene(base, impact_absorber(GAP, restitution, limit, mass_ratio=mass))
    response = check(
        run(
            scene,
            Drive(push * 1e3, FrequencySchedule(np.array([0.0, 0.5]), np.zeros(2), 2 * np.pi)),
        )
    )
    np.testing.assert_allclose(
        response.impacts.time[:8], first + np.concatenate([[0], np.cumsum(flights[:7])]), rtol=1e-6
    )
    np.testing.assert_allclose(-response.impacts.relative_velocity[:8], speeds[:8], rtol=1e-4)
    assert response.phases.start[-1] == pytest.approx(first + np.sum(flights), abs=3e-5)
    assert response.phases.kind[-1] == HELD_LOWER


@pytest.mark.parametrize("side", [1, -1])
def test_grazing(side: int) -> None:
    """Grazing is resolved.

    A tip that moves slightly less than the gap never touches the resting absorber. If it moves
    slightly more, the contact is at the time given by the sine.
    """
    omega = 100.0
    scene = Scene(
        ModalModel([omega], [0.0], [0.0], [1.0], 1.0), impact_absorber(GAP, 1.0, mass_ratio=1e-3)
    )
    for hair in (1e-6, 1e-9, 1e-12):
        missed, touched = (
            check(
                run(
                    scene,
                    still(0.1),
                    initial=InitialState(
                        modal_velocity=np.array([-side * GAP * omega * (1 + h)]),
                        absorber_displacement=0.0,
                    ),
                )
            )
            for h in (-hair, hair)
        )
        assert missed.impact_count == 0
        late = np.arccos(1 / (1 + hair)) / omega  # the quarter period less the time of contact
        assert touched.impacts.time[0] == pytest.approx(
            np.pi / 2 / omega - late, abs=1e-15 / (omega * np.sqrt(hair)) * 10
        )
        assert np.sign(touched.impacts.relative_velocity[0]) == side


@pytest.mark.parametrize("limit", [None, 0.1])
@pytest.mark.parametrize("force", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("speed", [0.0, 0.05, -0.05])
def test_start_on_the_wall(limit: float | None, force: float, speed: float) -> None:
    scene = scene_of(impact_absorber(GAP, 0.7, limit))
    response = check(
        run(
            scene,
            drive_of(force, 1.0),
            initial=InitialState(absorber_displacement=GAP, absorber_velocity=speed),
        )
    )
    assert np.any(response.impacts.time == 0) == (speed > 0)
    if force == speed == 0:
        assert response.end_state[3] == GAP
        assert response.impact_count == 0


# --- rigid friction


@pytest.mark.parametrize("speed", [0.02, -0.3])
def test_a_sliding_mass_stops_where_and_when_coulomb_says(speed: float) -> None:
    scene = Scene(steady_base(), friction_damper(0.25, 1.0))
    limit = 0.25
    stop = abs(speed) / limit
    response = check(run(scene, still(2 * stop), initial=InitialState(absorber_velocity=speed)))
    assert response.end_state[1] == pytest.approx(np.sign(speed) * speed**2 / limit / 2, rel=1e-13)
    np.testing.assert_allclose(response.phases.start, [stop], rtol=1e-13)
    np.testing.assert_allclose(response.phases.end, [2 * stop], rtol=1e-13)
    np.testing.assert_array_equal(response.phases.kind, [STUCK_INSIDE])
    assert response.energy.friction_loss == pytest.approx(speed**2 / 2, rel=1e-13)


@pytest.mark.parametrize("start", [9.5, -7.9, 0.6])
def test_coulomb_oscillator(start: float) -> None:
    """A Coulomb oscillator agrees with its closed form.

    A mode rubs on an immovable mass. It loses two static deflections of the friction limit in each
    half period, and stops within one.
    """
    model = ModalModel([100.0], [0.0], [0.0], [2.0], 1.0)
    limit = 0.3
    unit = 2.0 * limit / 100.0**2
    half = np.pi / 100
    scene = Scene(model, friction_damper(limit, 1e7))
    halves = int(np.ceil((abs(start) - 1) / 2)) if abs(start) > 1 else 0
    response = check(
        run(
            scene,
            still((halves + 0.01) * half),
            initial=InitialState(np.array([start * unit]), absorber_displacement=0.0),
        )
    )
    rest = np.sign(start) * (abs(start) - 2 * halves) * (-1) ** halves * unit
    assert response.end_state[0] == pytest.approx(rest, rel=1e-6)
    np.testing.assert_allclose(response.phases.start, [halves * half], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(response.phases.end, [(halves + 0.01) * half], rtol=1e-12)


def test_friction_on_a_slowly_shaken_base() -> None:
    """An absorber on a slowly shaken base sticks until its inertia exceeds the limit.

    The force that shakes the base rises like a sine.
    """
    base = ModalModel([1e-6], [0.0], [1e3], [1e-6], 1.0)
    shake = 2.0
    limit = 1.2
    omega = 30.0
    drive = Drive(
        shake * 1e3, FrequencySchedule(np.array([0.0, 0.2]), np.full(2, omega), omega), -np.pi / 2
    )
    phases = check(run(Scene(base, friction_damper(limit, 1.0)), drive)).phases
    assert phases.kind[0] == STUCK_INSIDE
    assert phases.end[0] == pytest.approx(np.arcsin(limit / shake) / omega, rel=1e-8)


@pytest.mark.parametrize("roundings", [-8, 0, 8])
@pytest.mark.parametrize("angle", [0.0, 0.188])
def test_a_joint_force_that_touches_its_bound_lets_the_run_go_on(
    roundings: int, angle: float
) -> None:
    """A joint force that touches its bound does not stop the run.

    A stuck absorber is on an undamped mode. Its joint force reaches the friction limit except for
    rounding errors, and the motion is a cosine.
    """
    scene = scene_of(friction_damper(1.0), modes=1, damping_ratio=0.0)
    mass = float(scene.absorber_masses[0])
    shape = float(scene.model.tip_shape[0])
    omega = float(scene.model.omega[0])
    joined = omega / np.sqrt(1 + mass * shape**2)
    limit = mass * abs(shape) * joined**2 * GAP
    scene = scene_of(friction_damper(limit * (1 + roundings * 1.1e-16)), modes=1, damping_ratio=0.0)
    q = GAP * np.cos(angle)
    v = GAP * joined * np.sin(angle)
    drive = still(6 * PERIOD)
    response = check(
        run(scene, drive, initial=InitialState(np.array([q]), np.array([v]), None, shape * v))
    )
    phase = joined * float(drive.schedule.times[-1]) - angle
    assert response.steps < 100
    assert response.check.misses == 0
    assert response.end_state[0] == pytest.approx(GAP * np.cos(phase), abs=1e-10 * GAP)
    assert response.end_state[1] == pytest.approx(GAP * shape * np.cos(phase), abs=1e-10 * GAP)


# --- springs of walls and of friction


@pytest.mark.parametrize("side", [1, -1])
def test_a_contact_lasts_half_a_period_on_the_wall(side: int) -> None:
    stiffness = 4e4
    mass = 0.25
    speed = 0.05
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, GAP)))
    lasts = np.pi * np.sqrt(mass / stiffness)
    flight = 2 * GAP / speed
    begins = GAP / speed + (lasts + flight) * np.arange(4)
    response = check(
        run(
            scene,
            still(begins[-1] + 1.5 * lasts),
            initial=InitialState(absorber_velocity=side * speed),
            samples=512,
        )
    )
    impacts = response.impacts
    phases = response.phases
    np.testing.assert_allclose(phases.start, begins, rtol=1e-12)
    np.testing.assert_allclose(phases.end, begins + lasts, rtol=1e-12)
    np.testing.assert_array_equal(
        phases.kind, [HELD_UPPER, HELD_LOWER, HELD_UPPER, HELD_LOWER][::side]
    )
    np.testing.assert_allclose(impacts.time, begins, rtol=1e-12)
    np.testing.assert_allclose(
        impacts.relative_velocity, side * speed * np.array([1, -1, 1, -1]), rtol=1e-11
    )
    np.testing.assert_allclose(impacts.impulse, -2 * mass * impacts.relative_velocity, rtol=1e-9)
    deepest = GAP + speed * np.sqrt(mass / stiffness)
    assert (
        deepest * (1 - 1e-3)
        < np.max(np.abs(relative_displacement(response)))
        <= deepest * (1 + 1e-12)
    )


def test_an_elastic_slider_holds_then_slips_then_oscillates() -> None:
    """An elastic slider sticks, then slips, then oscillates.

    A mass is on a spring up to the slider's limit, then uniformly slowed, then on the spring again
    about the position where it stopped.
    """
    stiffness = 4e3
    limit = 0.6
    mass = 0.25
    speed = 0.05
    scene = Scene(
        steady_base(), SlidingAbsorber(mass, None, ElasticCoulombFriction(limit, stiffness))
    )
    omega = np.sqrt(stiffness / mass)
    reach = limit / stiffness
    slip = np.arcsin(reach * omega / speed) / omega
    left = speed * np.cos(omega * slip)
    stick = slip + left * mass / limit
    slid = left**2 * mass / limit / 2
    end = stick + 2.3 / omega
    response = check(
        run(scene, still(end), initial=InitialState(absorber_velocity=speed), samples=512)
    )
    np.testing.assert_allclose(response.phases.start, [0, stick], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(response.phases.end, [slip, end], rtol=1e-10)
    assert response.end_state[1] == pytest.approx(slid + reach * np.cos(2.3), rel=1e-10)
    # what the friction account holds is what slid away and what its spring still holds
    assert response.energy.friction_loss == pytest.approx(
        limit * slid + stiffness * (reach * np.cos(2.3)) ** 2 / 2, rel=1e-9
    )


@pytest.mark.parametrize("place", [1.5 * GAP, -1.5 * GAP, GAP])
def test_a_start_in_the_spring_of_a_wall(place: float) -> None:
    """Overlap at the start is allowed, since the wall is a spring: it throws the absorber back."""
    stiffness = 4e4
    mass = 0.25
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, GAP)))
    omega = np.sqrt(stiffness / mass)
    depth = abs(place) - GAP
    start = InitialState(absorber_displacement=place)
    response = check(run(scene, still(0.01), initial=start))
    expected = (
        np.sign(place) * (GAP - depth * omega * (0.01 - np.pi / 2 / omega)) if depth > 0 else place
    )
    assert response.end_state[1] == pytest.approx(expected, rel=1e-11)
    assert (
        response.impact_count
        == len(response.impacts.time)
        == run(scene, still(0.01), RungeKutta(), start).impact_count
    )


def test_a_spring_of_friction_that_gives_way_at_once_has_no_effect() -> None:
    """A friction spring that yields at once has no effect.

    Its limit is far below the rounding of every number of the run, so that no sum can resolve the
    time at which it yields.
    """
    free, dragged = (
        run(
            scene_of(SlidingAbsorber(walls=walls().walls, friction=friction)),
            drive_of(20.0, 0.98, periods=5.0),
        )
        for friction in (None, ElasticCoulombFriction(1e-200, 100 * BEAM))
    )
    tip = free.history.tip_displacement
    assert free.impact_count > 0
    np.testing.assert_allclose(
        dragged.history.tip_displacement, tip, atol=1e-12 * np.max(np.abs(tip))
    )


# --- limits


@pytest.mark.parametrize(
    ("absorber", "limit", "close"),
    [
        (friction_damper(1e6), StuckAbsorber(), 1e-12),
        (impact_absorber(friction_limit=1e6), StuckAbsorber(), 1e-12),
        (impact_absorber(1.0, 0.5, 0.1), friction_damper(0.1), 1e-11),
        (impact_absorber(1.0, 0.5), None, 1e-11),
        (walls(gap=1.0), None, 1e-11),
        (slider(1e6, 1e6 * BEAM), StuckAbsorber(), 1e-3),
        (slider(1e-12, BEAM), None, 1e-9),
    ],
)
def test_what_never_slides_never_touches_or_pulls_at_nothing(
    absorber: Absorber, limit: Absorber | None, close: float
) -> None:
    drive = drive_of(5.0, 0.9, 1.1, periods=20)
    one = check(run(scene_of(absorber), drive))
    other = run(scene_of(limit), drive)
    assert one.impact_count == 0
    for rows in (slice(0, 3), slice(4, 7)):
        np.testing.assert_allclose(
            one.end_state[rows],
            other.end_state[rows],
            rtol=0,
            atol=close * np.max(np.abs(other.end_state[rows])),
        )
    if close == 1e-12:
        assert one.stuck_time == pytest.approx(20 * PERIOD)


def test_vanishing_friction_is_no_friction() -> None:
    without, little = (
        check(run(scene_of(impact_absorber(GAP, 0.8, limit)), drive_of(10.0, 1.0, periods=8)))
        for limit in (None, 1e-14)
    )
    few = min(4, without.impact_count)
    assert few > 0
    np.testing.assert_allclose(little.impacts.time[:few], without.impacts.time[:few], rtol=1e-9)


def test_stiff_walls_approach_rigid_ones() -> None:
    """Stiff compliant walls approach rigid ones.

    The first contact is the same. Later ones differ by the duration of a contact, which is
    proportional to the inverse root of the stiffness.
    """
    drive = drive_of(20.0, 1.0, periods=2.0)
    rigid = run(scene_of(impact_absorber(GAP), modes=1), drive)
    gaps = []
    for stiffness in (1e4, 1e6, 1e8):
        soft = check(run(scene_of(walls(stiffness * BEAM), modes=1), drive))
        assert soft.impacts.time[0] == pytest.approx(rigid.impacts.time[0], rel=1e-12)
        gaps.append(abs(soft.impacts.time[1] - rigid.impacts.time[1]) / PERIOD)
    assert gaps[2] < 1e-4
    assert all(5 < a / b < 20 for a, b in pairwise(gaps))


def test_stiff_friction_approaches_rigid_friction() -> None:
    drive = drive_of(3.0, 1.0, periods=6)
    rigid = run(scene_of(friction_damper(0.5), modes=1), drive)
    far = [
        np.max(
            np.abs(
                run(scene_of(slider(0.5, k * BEAM), modes=1), drive).end_state - rigid.end_state
            )[:1]
        )
        for k in (1e2, 1e4, 1e6)
    ]
    assert far[2] < 1e-3 * np.abs(rigid.end_state[0])
    assert far[2] < far[1] < far[0]


# --- static friction above sliding friction, and walls with a spring and a damper


def stick_and_slip(sliding: float, static: float, until: float) -> tuple[list[float], list[float]]:
    """Return the start and end times of sticking of a body on a plate, from rest.

    The plate moves as -2 cos(t). ``sliding`` and ``static`` are the accelerations that friction can
    cause, in m/s^2.

    The plate's velocity is 2 sin(t): the body slides at a constant acceleration, and sticks while
    |2 cos(t)| is below ``static``.
    """
    begins: list[float] = []
    ends: list[float] = []
    time = 0.0
    speed = 0.0
    sticks = static >= 2.0
    while time < until:
        if sticks:
            begins.append(time)
            later = np.arange(time, until + 1e-4, 1e-4)[1:]
            beyond = later[np.abs(2 * np.cos(later)) > static]
            if len(beyond) == 0:
                ends.append(until)
                break
            time = scipy.optimize.brentq(
                lambda t: abs(2 * np.cos(t)) - static, beyond[0] - 1e-4, beyond[0], xtol=1e-15
            )
            ends.append(time)
            speed = 2 * np.sin(time)
        push = np.sign(np.cos(time)) * sliding

        def relative(t: float, at: tuple[float, float, float] = (time, speed, push)) -> float:
            return at[1] + at[2] * (t - at[0]) - 2 * np.sin(t)

        later = np.arange(time + 1e-3, until, 1e-4)
        sign = np.sign(relative(later[0])) if len(later) else 0.0
        turned = later[np.sign(relative(later)) == -sign]
        if len(turned) == 0:
            break
        time = scipy.optimize.brentq(relative, turned[0] - 1e-4, turned[0], xtol=1e-15)
        speed = 2 * np.sin(time)
        sticks = abs(2 * np.cos(time)) <= static
    return begins, ends


@pytest.mark.parametrize(
    ("sliding", "ratio"), [(1.2, 1.0), (1.2, 1.5), (1.0, 1.0), (1.0, 1.7), (0.5, 3.0), (0.5, 3.2)]
)
def test_static_friction_holds_up_to_its_own_limit(sliding: float, ratio: float) -> None:
    """Of a light body on a plate: phases of sticking as the plate's motion alone says."""
    mass = 1e-13
    friction = CoulombFriction(sliding * mass, ratio)
    scene = Scene(
        ModalModel([1.0], [0.0], [0.0], [1.0], 1.0), SlidingAbsorber(mass, friction=friction)
    )
    response = check(
        run(scene, still(9.0, 1.0), initial=InitialState(np.array([-2.0]))), scale=1e-11
    )
    begins, ends = stick_and_slip(sliding, sliding * ratio, 9.0)
    assert (
        begins or ratio == 3.0
    )  # there it slides all the time, turning where friction could only just hold it
    np.testing.assert_allclose(response.phases.start, begins, atol=1e-9)
    np.testing.assert_allclose(response.phases.end, ends, atol=1e-9)


def test_a_static_limit_above_the_joint_force_holds_as_long_as_glue() -> None:
    """A static friction limit above the joint force holds the absorber like glue.

    Sliding friction alone could not carry the joint force. With static friction above it the
    absorber never moves.
    """
    drive = drive_of(1.0, 0.98, periods=2.0)
    glued = run(scene_of(StuckAbsorber(), modes=2), drive)
    held, slides = (
        run(scene_of(SlidingAbsorber(friction=CoulombFriction(0.02, ratio)), modes=2), drive)
        for ratio in (100.0, 1.0)
    )
    assert held.stuck_time == pytest.approx(drive.schedule.times[-1], rel=1e-12)
    assert slides.stuck_time < 0.9 * held.stuck_time
    scale = np.max(np.abs(glued.end_state))
    np.testing.assert_allclose(held.end_state[:2], glued.end_state[:2], atol=1e-9 * scale)


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.3, 0.01])
def test_walls_with_a_damper_give_back_their_restitution(restitution: float) -> None:
    """Walls with a damper have their restitution.

    Two free bodies collide. The velocity after contact, the duration (half a damped period), the
    impulse and the loss have closed forms.
    """
    stiffness = 1e5
    mass = 3.0
    speed = 1.0
    reduced = mass / (1 + mass)  # of the absorber and of a base of 1 kg
    rate = -np.log(restitution)
    lasts = np.hypot(np.pi, rate) * np.sqrt(reduced / stiffness)
    absorber = SlidingAbsorber(mass, CompliantWalls(stiffness, GAP, restitution))
    response = check(
        run(
            Scene(ModalModel([1e-3], [0.0], [1.0], [1.0], 1.0), absorber),
            still(GAP / speed + 1.1 * lasts, 2 * np.pi),
            initial=InitialState(absorber_velocity=speed),
        ),
        error=1e-10,
    )
    tip, moving = response.end_state[2:]
    assert moving - tip == pytest.approx(-restitution * speed, rel=1e-7)
    assert mass * moving + tip == pytest.approx(mass * speed, rel=1e-9)
    phases = response.phases
    assert phases.end[0] - phases.start[0] == pytest.approx(lasts, rel=1e-9)
    impacts = response.impacts
    assert impacts.impulse[0] == pytest.approx(-reduced * (1 + restitution) * speed, rel=1e-7)
    lost = 0.5 * reduced * (1 - restitution**2) * speed**2
    assert impacts.energy_lost[0] == pytest.approx(lost, rel=1e-7, abs=1e-12)
    assert response.energy.impact_loss == pytest.approx(lost, rel=1e-7, abs=1e-12)


@pytest.mark.parametrize("friction", [None, ElasticCoulombFriction(0.2, 3e4)])
def test_walls_with_a_damper_against_small_steps(friction: ElasticCoulombFriction | None) -> None:
    """Walls with a damper agree with an integration in small steps.

    Two modes under a force are integrated by DOP853 in steps far shorter than a contact, with
    separate equations of motion.
    """
    absorber = SlidingAbsorber(0.05, CompliantWalls(5e4, 2e-4, 0.6), friction)
    scene = scene_of(absorber, modes=2)
    drive = drive_of(8.0, 0.98, periods=2.5)
    response = check(run(scene, drive), error=1e-9)
    assert response.impact_count > 3
    model = scene.model
    mass = scene.absorber_mass
    reduced = 1 / (1 / mass + float(np.sum(model.tip_shape**2)))
    zeta = -np.log(0.6) / np.hypot(np.pi, np.log(0.6))
    damper = 2 * zeta * np.sqrt(5e4 * reduced)
    omega = drive.schedule.omega_at(np.array([0.0]))[0]

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        q = state[:2]
        a = state[2]
        u = state[3:5]
        v = state[5]
        rest = state[6]
        y = a - model.tip_shape @ q
        gamma = v - model.tip_shape @ u
        push = 0.0
        if abs(y) > 2e-4:
            push = -5e4 * (y - np.sign(y) * 2e-4) - damper * gamma
        moves = 0.0
        if friction is not None:
            stretch = y - rest
            reach = friction.limit / friction.stiffness
            push -= friction.stiffness * np.clip(stretch, -reach, reach)
            if abs(stretch) >= reach and stretch * gamma > 0:
                moves = gamma
        force = 8.0 * np.cos(omega * time)
        bend = model.force_shape * force - model.tip_shape * push
        bend = bend - 2 * model.damping_ratio * model.omega * u - model.omega**2 * q
        return np.concatenate([u, [v], bend, [push / mass], [moves]])

    end = float(drive.schedule.times[-1])
    steps = scipy.integrate.solve_ivp(
        slope, (0, end), np.zeros(7), "DOP853", rtol=1e-9, atol=1e-13, max_step=end / 4e3
    )
    scale = np.max(np.abs(steps.y), axis=1)[[0, 1, 2, 3, 4, 5]]
    np.testing.assert_allclose(
        response.end_state / scale, steps.y[:6, -1] / scale, atol=1e-4 if friction else 2e-5
    )


def test_losses_of_damped_contacts_are_listed_without_an_energy_account() -> None:
    """What an impact lost is known whether or not energies are recorded."""
    absorber = SlidingAbsorber(0.05, CompliantWalls(5e4, 2e-4, 0.6))
    scene = scene_of(absorber, modes=2)
    drive = drive_of(8.0, 0.98, periods=2.5)
    alone = simulate(scene, drive, record=Record(level=False, events=True))
    assert alone.energy is None
    np.testing.assert_array_equal(alone.impacts.energy_lost, run(scene, drive).impacts.energy_lost)


def test_a_slider_that_holds_is_a_spring_about_the_place_where_it_began() -> None:
    """A sticking slider is a spring about the position where it started.

    Elastic friction that never slips moves as a tuned absorber without damper, shifted by its
    start. The forces differ by ten digits.
    """
    stiffness = 3e4
    drive = drive_of(1.0, 0.98, periods=3.0)
    start = 1e-3
    held = run(
        scene_of(SlidingAbsorber(friction=ElasticCoulombFriction(1e6, stiffness)), modes=2),
        drive,
        initial=InitialState(absorber_displacement=start),
    )
    tuned = run(scene_of(TunedAbsorber(stiffness=stiffness, damping=0.0), modes=2), drive)
    shifted = held.end_state - [0, 0, start, 0, 0, 0]
    scale = np.max(np.abs(tuned.end_state[:3]))
    np.testing.assert_allclose(shifted[:3], tuned.end_state[:3], atol=1e-10 * scale)


def test_a_slider_holds_again_where_its_spring_carries_the_limit() -> None:
    """A slider sticks again at the position where its spring carries the limit.

    On a base at rest the body slides until it is at rest, and then oscillates about the position
    where the slider stays (closed form).
    """
    limit = 0.02
    stiffness = 50.0
    speed = 0.05
    rate = np.sqrt(stiffness)  # of a mass of 1 kg
    first = (
        np.arcsin(limit / (stiffness * speed / rate)) / rate
    )  # until the spring carries the limit
    left = speed * np.cos(rate * first)
    slides = left / limit
    rest = speed / rate * np.sin(rate * first) + left * slides / 2  # largest displacement
    anchor = rest - limit / stiffness
    later = 0.3
    response = check(
        run(
            Scene(
                steady_base(),
                SlidingAbsorber(1.0, friction=ElasticCoulombFriction(limit, stiffness)),
            ),
            still(first + slides + later, 2 * np.pi),
            initial=InitialState(absorber_velocity=speed),
        )
    )
    place = anchor + limit / stiffness * np.cos(rate * later)
    assert response.end_state[1] == pytest.approx(place, rel=1e-11)
    assert response.energy.friction_loss == pytest.approx(
        limit * left * slides / 2 + 0.5 * limit**2 / stiffness * np.cos(rate * later) ** 2,
        rel=1e-11,
    )


@pytest.mark.plain
@pytest.mark.skipif(COMPILED, reason="compiled kernels keep the constants")
@pytest.mark.parametrize(("error", "slope"), [(0.0125, 0.05), (0.2, 0.05), (0.05, 0.0125)])
def test_events_do_not_depend_on_when_a_step_is_halved(
    error: float, slope: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(impact_absorber(3e-4, 0.6, 0.1), modes=2)
    drive = drive_of(6.0, 0.98, periods=0.4)
    start = InitialState(absorber_velocity=0.4)
    usual = run(scene, drive, initial=start)
    monkeypatch.setattr(search, "ROOT_ERROR_TOL", error)
    monkeypatch.setattr(search, "ROOT_SLOPE_TOL", slope)
    other = run(scene, drive, initial=start)
    assert len(usual.impacts.time) > 2
    np.testing.assert_allclose(other.impacts.time, usual.impacts.time, rtol=1e-11)
    np.testing.assert_allclose(other.end_state, usual.end_state, rtol=1e-9)
