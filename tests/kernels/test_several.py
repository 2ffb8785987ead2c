"""Runs with several absorbers agree with limits, closed forms and general laws.

test_verification.py compares them with two references.
"""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from core import OMEGA, PERIOD, Array, check, drive_of, relative_displacement, run, still
from every_scene import SEVERAL, ring_scene
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from impact_env import (
    Beam,
    CoulombFriction,
    Drive,
    InitialState,
    IntegrationError,
    ModalModel,
    ParameterError,
    Record,
    RigidWalls,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    YieldingWalls,
    beam_scene,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    linear_sweep,
    regime_sets,
    simulate,
    solvers,
)
from impact_env.kernels.compiling.jit import COMPILED
from impact_env.kernels.exact import joint_forces
from impact_env.kernels.exact.joint_forces import Joints, new_joints, solve_joint_forces
from impact_env.kernels.exact.rigid_contact import new_contact_states
from impact_env.kernels.exact.sets import Absorbers
from impact_env.regime_sets import SetLayout, find_set_layout
from impact_env.structures.cyclic import Mistuning, ring_of_masses
from optimisation.measures import FRICTION_HEAT, STROKE, of_motion
from optimisation.space import design_space
from reference.replay import replay
from reference.stepping import run_small_steps

# m, of the mode
BEAM = Beam(modes=3)
ONE_MODE = Beam(modes=1, damping_ratio=0.0)
START = 1e-3
LISTS = Record(level=False, events=True, reversals=True)


def compare_small_steps(scene: Scene, drive: Drive, end: Array, steps: tuple[int, int]) -> Array:
    """Return the largest differences between an end state and Moreau's scheme.

    The scheme runs with few and with many steps.
    """
    half = len(end) // 2
    scale = np.abs(end) + np.repeat([1e-4, 1e-1], half)
    return np.array([np.max(np.abs(run_small_steps(scene, drive, n) - end) / scale) for n in steps])


@pytest.mark.slow
def test_small_steps_of_another_scheme_converge_to_it() -> None:
    scene, force, ratio, periods = SEVERAL["sticking beside impacts"]
    drive = drive_of(force, ratio, periods=periods)
    response = run(scene, drive)
    assert response.impact_count >= 3
    assert set(response.phases.absorber.tolist()) == {0, 1, 2}
    coarse, fine = compare_small_steps(scene, drive, response.end_state, (1_000, 6_000))
    assert fine < 0.3 * coarse
    assert fine < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("friction_limit", [None, 0.3])
def test_small_steps_converge_to_a_travelling_wave_in_ten_sectors(
    friction_limit: float | None,
) -> None:
    disk = ring_of_masses(10, 0.05, OMEGA / (2 * np.pi), 0.01, mistuning=Mistuning(0.02, 0.1, 3))
    scene = disk.scene(impact_absorber(2e-4, 0.8, friction_limit, 0.02), 2)
    drive = drive_of(40.0, 1.02, periods=1.0)
    response = simulate(scene, drive, record=LISTS)
    assert len(set(response.impacts.absorber.tolist())) == 10
    coarse, fine = compare_small_steps(scene, drive, response.end_state, (1_000, 6_000))
    assert fine < 0.3 * coarse
    assert fine < 0.03


def draw_scene(seed: int) -> Scene:
    """Return 5 to 16 random absorbers on random modes.

    Every second scene has forces that differ in phase.
    """
    generator = np.random.default_rng(seed)
    n = int(generator.integers(5, 17))
    modes = int(generator.integers(n // 2 + 1, n + 3))
    omegas = OMEGA * np.sort(generator.uniform(0.6, 3.0, modes))
    shapes = generator.normal(size=(n, modes)) / np.sqrt(modes)
    damping = generator.uniform(0, 0.05, modes)
    model = ModalModel(omegas, damping, shapes[0], shapes[0], float(n), shapes)
    amplitudes = generator.uniform(0.5, 1, 3)
    phases = generator.uniform(0, 6, 3) if seed % 2 else 0.0
    absorbers = []
    for _ in range(n):
        limit = float(10 ** generator.uniform(-2, 0.3)) if generator.uniform() < 0.5 else None
        gap = float(10 ** generator.uniform(-4, -3))
        restitution = float(generator.choice([0.0, 1.0, generator.uniform()]))
        ratio = float(generator.uniform(0.01, 0.1) / n)
        absorbers.append(impact_absorber(gap, restitution, limit, ratio))
    return Scene(
        model.with_forces(shapes[:3], amplitudes, phases),
        SeveralAbsorbers(tuple(absorbers), (1.0,) * n),
    )


@pytest.mark.parametrize("seed", [5, 6, 8, 12, 13, 15])
def test_random_scenes_are_replayed_from_their_events(seed: int) -> None:
    """Random scenes agree with a reconstruction from their events.

    Matrix exponentials show that contact laws hold between the events of the run, that no event is
    missed, and that the end state is the same.
    """
    scene = draw_scene(seed)
    drive = drive_of(40.0, 1.1, periods=1.0, phase=0.3)
    response = simulate(scene, drive, record=LISTS)
    assert response.impact_count >= 5
    lists = response.impacts, response.phases, response.reversals
    end, worst = replay(scene, drive, *lists)
    scale = np.abs(response.end_state) + 1e-6
    assert np.max(np.abs(end - response.end_state) / scale) < 1e-5
    violations = asdict(worst)
    events = violations.pop("events")
    assert events >= 20
    assert max(violations.values()) < 2e-6, violations
    impacts = response.impacts
    fewer = replace(
        impacts, **{one.name: np.delete(getattr(impacts, one.name), 2) for one in fields(impacts)}
    )
    violations = asdict(replay(scene, drive, fewer, *lists[1:])[1])
    del violations["events"]
    assert max(violations.values()) > 1e-3


@pytest.mark.parametrize("friction", [None, 0.05])
def test_a_second_absorber_without_mass_changes_nothing(friction: float | None) -> None:
    one = impact_absorber(3e-4, 0.7, friction)
    light = (
        impact_absorber(1e-4, 0.7, None, 1e-10)
        if friction is None
        else friction_damper(1e-11, 1e-10)
    )
    drive = drive_of(3.0, 0.97, 1.02, periods=3)
    single = run(beam_scene(BEAM, one), drive)
    both = run(beam_scene(BEAM, SeveralAbsorbers((one, light), (1.0, 0.5))), drive)
    assert single.impact_count >= 4
    own = both.impacts.absorber == 0
    np.testing.assert_allclose(both.impacts.time[own], single.impacts.time, atol=1e-8 * PERIOD)
    state = np.delete(both.end_state, [4, 9])
    np.testing.assert_allclose(
        state, single.end_state, atol=1e-6 * np.max(np.abs(single.end_state))
    )


def test_absorbers_that_never_move_are_a_stuck_one_of_their_mass() -> None:
    stuck = tuple(
        SlidingAbsorber(ratio, RigidWalls(1e-3, 0.5), friction_damper(1e4).friction)
        for ratio in (0.01, 0.03, 0.02)
    )
    drive = drive_of(3.0, 0.9, 1.1, periods=4)
    start = InitialState(np.array([1e-4, 1e-5, 0.0]))
    several = run(beam_scene(BEAM, SeveralAbsorbers(stuck, (1.0, 1.0, 1.0))), drive, initial=start)
    single = run(beam_scene(BEAM, StuckAbsorber(0.06)), drive, initial=start)
    assert several.impact_count == 0
    assert several.stuck_time == pytest.approx(3 * drive.schedule.times[-1], rel=1e-12)
    np.testing.assert_allclose(
        several.end_state[[0, 1, 2, 6, 7, 8]],
        single.end_state[[0, 1, 2, 4, 5, 6]],
        atol=1e-12 * np.max(np.abs(single.end_state)),
    )


def test_an_impact_keeps_momentum_and_obeys_restitution() -> None:
    """An impact conserves momentum and obeys the restitution.

    One impact occurs at 0.6 of the length. The changes of the modes and of the others' relative
    velocities are the impulse's shares.
    """
    scene = beam_scene(
        Beam(modes=4, damping_ratio=0.0),
        impact_absorbers((1e-3, 1e-3), (1.0, 0.6), restitution=0.6),
    )
    start = InitialState(
        absorber_displacement=(0.0, 1e-3 * (1 - 1e-9)), absorber_velocity=(0.0, 0.2)
    )
    response = run(scene, drive_of(0.0, 1.0, periods=1e-6), initial=start)
    impacts = response.impacts
    shapes = scene.absorber_shapes
    mass = scene.absorber_masses[1]
    assert response.impact_count == 1
    assert impacts.absorber[0] == 1
    impulse = -1.6 * 0.2 / (1 / mass + shapes[1] @ shapes[1])
    assert impacts.impulse[0] == pytest.approx(impulse, rel=1e-9)
    np.testing.assert_allclose(response.end_state[6:10], -shapes[1] * impulse, rtol=1e-3)
    assert response.end_state[10] == 0.0
    assert response.end_state[11] == pytest.approx(0.2 + impulse / mass, rel=1e-9)
    check(response, 1e-10)


def test_an_impact_that_pushes_another_absorber_into_its_wall_makes_it_hit_at_once() -> None:
    """An absorber that an impact of another one pushes into its wall hits at once.

    It is on its wall and about to leave it. Without the hit it would be beyond the wall for a
    microsecond.
    """
    scene = beam_scene(
        ONE_MODE,
        SeveralAbsorbers(
            (impact_absorber(1e-5, 0.5, None, 0.01), impact_absorber(1e-3, 0.0, None, 1e-3)),
            (1.0, 1.0),
        ),
    )
    shape = float(scene.model.tip_shape[0])
    other, mass = scene.absorber_masses
    tip = -abs(shape) * START
    speed = 0.025
    start = InitialState(np.array([tip / shape]), None, (tip + 1e-5, tip - 1e-3), (0.0, -speed))
    response = run(scene, still(1e-4), initial=start)
    pushed = shape**2 * speed / (1 / mass + shape**2)
    np.testing.assert_array_equal(response.impacts.absorber[:2], [1, 0])
    np.testing.assert_allclose(response.impacts.time[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(response.impacts.relative_velocity[:2], [-speed, pushed], rtol=1e-9)
    assert response.impacts.impulse[1] == pytest.approx(
        -1.5 * pushed / (1 / other + shape**2), rel=1e-9
    )


def test_bounces_die_out_while_another_absorber_sticks() -> None:
    """Bounces die out while another absorber sticks.

    Each impact tears the stuck absorber loose, and its friction dissipates energy. Even with
    restitution 1 the other absorber therefore comes to rest on a wall.
    """
    scene = beam_scene(
        ONE_MODE,
        SeveralAbsorbers(
            (impact_absorber(1e-5, 1.0, None, 0.5), friction_damper(7.0, 0.4)), (1.0, 1.0)
        ),
    )
    shape = float(scene.model.tip_shape[0])
    start = InitialState(np.array([START / shape]), None, (START + 1e-5, START), (1e-3, 0.0))
    response = run(scene, still(5e-3), initial=start)
    check(response, 1e-10)
    energy = response.energy
    phases = response.phases
    end = response.end_state
    assert response.impact_count < 200
    assert set(phases.absorber[phases.end == phases.end.max()].tolist()) == {0, 1}
    np.testing.assert_allclose(end[4:], shape * end[3], rtol=1e-12)
    assert end[1] - shape * end[0] == pytest.approx(1e-5, rel=1e-9)
    assert energy.friction_loss > 0
    assert abs(energy.balance_error) < 1e-12 * energy.stored_at_start


def test_equal_absorbers_at_one_place_break_loose_at_once() -> None:
    """Equal absorbers at one place break loose at the same time.

    Both stick by friction and reach its limit simultaneously. Rounding errors must not cause an
    endless alternation of stick and slip.
    """
    beam = Beam(bending_stiffness=0.81 * Beam.bending_stiffness)
    scene = beam_scene(beam, impact_absorbers((1e-3, 1e-3), (1.0, 1.0), 0.7, 0.05, 0.02))
    reference = scene.model.resonance_omega(1)
    response = run(scene, Drive(3.5, linear_sweep(reference, 0.9, 0.906)))
    assert set(response.phases.absorber.tolist()) == {0, 1}
    assert response.steps < 2000
    for quantity in (response.end_state[10:12], response.end_state[22:24]):
        assert quantity[0] == pytest.approx(quantity[1], rel=1e-6)


@pytest.mark.parametrize(("share", "sticks"), [(1.001, True), (0.999, False)])
def test_the_modes_damping_counts_where_absorbers_begin_to_stick(
    share: float, sticks: bool
) -> None:
    """The damping of modes matters when absorbers begin to stick.

    Two absorbers rest on a beam that passes its middle position. Its damping alone decelerates them
    (Newton's law of all three masses).
    """
    damping = 0.2
    speed = 0.3
    model = ModalModel(
        [OMEGA], [damping], [1.0], [1.0], 1.0, absorber_shapes=[[1.0], [1.0]]
    )  # a mass of 1 kg
    slowing = 2 * damping * OMEGA * speed / (1 + 0.3 + 0.2)
    absorbers = SeveralAbsorbers(
        (friction_damper(share * 0.3 * slowing, 0.3), friction_damper(share * 0.2 * slowing, 0.2)),
        (1.0, 1.0),
    )
    response = run(
        Scene(model, absorbers),
        still(1e-4 * PERIOD),
        initial=InitialState(
            modal_velocity=np.array([speed]),
            absorber_displacement=[0.0, 0.0],
            absorber_velocity=[speed, speed],
        ),
    )
    assert len(response.phases.start) == (2 if sticks else 0)


unit = st.floats(-1, 1)
positions = st.one_of(st.just(1.0), st.floats(0.2, 1.0))


@st.composite
def several(draw: st.DrawFn) -> SeveralAbsorbers:
    def one() -> SlidingAbsorber:
        mass = draw(st.floats(0.001, 0.5))
        limit = draw(st.one_of(st.none(), st.floats(-3, 1).map(lambda x: float(10**x))))
        if limit is not None and draw(st.integers(0, 3)) == 0:
            return friction_damper(limit, mass)
        restitution = draw(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1)))
        return impact_absorber(
            draw(st.floats(-5, -3).map(lambda x: float(10**x))), restitution, limit, mass
        )

    n = draw(st.integers(2, 3))
    return SeveralAbsorbers(
        tuple(one() for _ in range(n)), tuple(draw(positions) for _ in range(n))
    )


@settings(
    max_examples=30,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    deadline=None,
)
@given(
    st.data(),
    several(),
    st.floats(-1, 1.5).map(lambda x: float(10**x)),
    st.floats(0.3, 8),
    st.integers(1, 8),
)
def test_energy_and_walls(
    data: st.DataObject, absorbers: SeveralAbsorbers, force: float, ratio: float, modes: int
) -> None:
    scene = beam_scene(
        Beam(modes=modes, elements=12, damping_ratio=data.draw(st.sampled_from([0.0, 0.01, 0.1]))),
        absorbers,
    )
    q = np.array([1e-4 * data.draw(unit), *np.zeros(modes - 1)])
    shares = [
        data.draw(st.one_of(st.sampled_from([0.0, 1.0, -1.0]), unit)) for _ in absorbers.absorbers
    ]
    gaps = [getattr(scene.cavity(a), "gap", 1e-3) for a in range(scene.places)]
    start = InitialState(
        q,
        None,
        scene.absorber_shapes @ q + np.array(shares) * np.array(gaps),
        [0.1 * data.draw(unit) for _ in shares],
    )
    response = run(
        scene,
        drive_of(force, ratio, periods=1.5),
        initial=data.draw(st.sampled_from([InitialState(), start])),
    )
    check(response, 1e-9)


def test_starts_are_one_for_each_absorber_and_inside_its_cavity() -> None:
    scene = beam_scene(BEAM, impact_absorbers((1e-3, 3e-4), (1.0, 0.6)))
    for places, message in (
        ((0.0, 0.0, 0.0), "one for each absorber"),
        ((0.0, 1e-3), "inside the cavity"),
    ):
        with pytest.raises(ParameterError, match=message):
            simulate(scene, drive_of(1.0, 1.0), initial=InitialState(absorber_displacement=places))


def test_measures_of_a_design_see_every_absorber() -> None:
    design = design_space("several", fixed={"friction_limit_2": 0}).design(
        {"gap_1": 3e-4, "gap_2": 2.5e-4, "position_2": 0.6, "share": 0.5}
    )
    response = run(design.scene(BEAM), drive_of(3.0, 0.98, periods=3))
    assert np.max(np.abs(relative_displacement(response)), axis=0) == pytest.approx(
        [3e-4, 2.5e-4], rel=0.1
    )
    assert of_motion(STROKE, response) == np.max(np.abs(relative_displacement(response)))
    speed = response.history.absorber_velocity[:, 0] - response.history.tip_velocity
    time = response.history.time
    late = time >= time[-1] / 2  # of so short a run the first half is left out
    assert of_motion(FRICTION_HEAT, response) == pytest.approx(
        0.05 * np.mean(np.abs(speed[late])), rel=1e-12
    )


def at_one_place(
    model: ModalModel, masses: Array, limits: Array, generator: np.random.Generator
) -> tuple[Absorbers, Array, Joints, Array]:
    """Return absorbers at the tip without relative velocity, and their compliance.

    Some of them are on a wall. They have random accelerations.
    """
    n = len(masses)
    shapes = np.tile(model.tip_shape, (n, 1))
    compliance = shapes @ shapes.T + np.diag(1 / masses)
    absorbers = Absorbers(
        masses,
        gap=np.ones(n),
        restitution=np.ones(n),
        yield_velocity=np.full(n, np.inf),
        limit=limits,
        gravity=np.zeros(n),
        shapes=shapes,
        tip_shape=model.tip_shape,
        square=model.omega**2,
    )
    now = new_contact_states(n)
    now["side"] = generator.choice([-1.0, 0.0, 1.0], n)
    joints = new_joints(n)
    joints.undecided[:] = True
    joints.relative_acceleration[:] = compliance @ generator.normal(0, 1.5, n) * limits
    joints.acceleration_slack[:] = np.abs(joints.relative_acceleration)
    return absorbers, compliance, joints, now


@pytest.mark.plain
@pytest.mark.parametrize("ratio", [0.02, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 9, 24])
def test_joint_forces_are_those_of_a_bounded_least_squares_problem(n: int, ratio: float) -> None:
    """Joint forces are those of a bounded least-squares problem.

    The model has 60 modes. SciPy's active-set solver finds the same minimum of f G f/2 + c f
    between bounds.
    """
    model = beam_scene(Beam(modes=60)).model
    generator = np.random.default_rng(n)
    cases = set()
    for _ in range(20):
        masses = ratio * model.beam_mass * generator.uniform(0.5, 1, n)
        limits = generator.uniform(0.1, 1.0, n)
        absorbers, compliance, joints, now = at_one_place(model, masses, limits, generator)
        solve_joint_forces(absorbers, compliance, now, joints)
        assert not joints.unsolved[0]
        root = np.linalg.cholesky(compliance)
        low = np.where(now["side"] > 0, -np.inf, -limits)
        high = np.where(now["side"] < 0, np.inf, limits)
        wanted = lsq_linear(
            root.T,
            -np.linalg.solve(root, joints.relative_acceleration),
            (low, high),
            method="bvls",
            tol=1e-14,
        ).x
        np.testing.assert_allclose(joints.force, wanted, atol=1e-9 * np.max(np.abs(wanted)))
        cases |= set(joints.case.tolist())
    assert cases == {0, 1, 2}


def test_heavy_absorbers_that_never_move_at_one_place_are_a_stuck_one() -> None:
    """Heavy absorbers that never move at one place are equal to a stuck one.

    Each has ten times the beam's mass, with 60 modes. Their forces are a hundredth of a percent of
    the sum that holds them.
    """
    stuck = tuple(
        SlidingAbsorber(10.0, RigidWalls(1e-3, 0.5), friction_damper(1e6).friction)
        for _ in range(2)
    )
    drive = drive_of(3.0, 0.9, periods=0.2)
    beam = Beam(modes=60, elements=60)
    several = run(beam_scene(beam, SeveralAbsorbers(stuck, (1.0, 1.0))), drive)
    single = run(beam_scene(beam, StuckAbsorber(20.0)), drive)
    assert several.stuck_time == pytest.approx(2 * drive.schedule.times[-1], rel=1e-12)
    np.testing.assert_allclose(
        several.end_state[:60],
        single.end_state[:60],
        atol=1e-9 * np.max(np.abs(single.end_state[:60])),
    )


def sector_shapes(scene: Scene) -> Array:
    """Return the displacement of each sector per modal displacement.

    The scene has an absorber in every sector.
    """
    return scene.absorber_shapes


def test_a_light_second_absorber_leaves_weight_and_yielding_walls_as_they_are() -> None:
    """Against the kernels of a single absorber, which have these laws by themselves."""
    one = SlidingAbsorber(
        0.02,
        YieldingWalls(yield_velocity=0.05, gap=2e-4, restitution=0.9),
        CoulombFriction(0.02),
        gravity=9.81,
    )
    light = SlidingAbsorber(1e-10, RigidWalls(1e-4, 0.7), None, gravity=9.81)
    drive = drive_of(3.0, 0.97, 1.02, periods=3)
    start = InitialState(absorber_displacement=-1e-4)
    single = run(beam_scene(BEAM, one), drive, initial=start)
    both = run(
        beam_scene(BEAM, SeveralAbsorbers((one, light), (1.0, 0.5))),
        drive,
        initial=InitialState(absorber_displacement=(-1e-4, 0.0)),
    )
    own = both.impacts.absorber == 0
    assert single.impact_count >= 4
    np.testing.assert_allclose(both.impacts.time[own], single.impacts.time, atol=1e-8 * PERIOD)
    lost = single.impacts.energy_lost
    np.testing.assert_allclose(both.impacts.energy_lost[own], lost, atol=1e-6 * np.max(lost))
    others = np.delete(both.end_state, [4, 9])
    limit = 1e-6 * np.max(np.abs(single.end_state))
    np.testing.assert_allclose(others, single.end_state, atol=limit)
    assert abs(both.energy.relative_error) < 1e-11


def test_sectors_without_coupling_are_single_absorbers_up_to_rounding() -> None:
    """Not to the last digit: their kernels sum over the modes of all sectors."""
    gaps = (2e-4, 3e-4, 2.5e-4, 2.2e-4, 1.5e-4)
    scene = ring_scene(gaps, 0.8, 0.2, coupling=0.0, wave_number=0)
    drive = drive_of(20.0, 1.01, periods=2)
    ring = run(scene, drive)
    shapes = sector_shapes(scene)
    for sector, gap in enumerate(gaps):
        alone = Scene(
            ModalModel([OMEGA], [0.01], [1.0], [1.0], 1.0), impact_absorber(gap, 0.8, 0.2, 0.02)
        )
        single = run(alone, drive)
        assert single.impact_count >= 3
        own = ring.impacts.time[ring.impacts.absorber == sector]
        np.testing.assert_allclose(own, single.impacts.time, atol=1e-9 * PERIOD)
        assert shapes[sector] @ ring.end_state[:5] == pytest.approx(
            single.end_state[0], abs=1e-9 * abs(single.end_state[0])
        )


@pytest.mark.parametrize(("sectors", "friction_limit"), [(10, 0.5), (32, None)])
def test_no_event_of_many_absorbers_is_missed(sectors: int, friction_limit: float | None) -> None:
    """Each search is sampled densely, and the energies balance."""
    generator = np.random.default_rng(sectors)
    scene = ring_scene(generator.uniform(1e-4, 4e-4, sectors), 0.8, friction_limit)
    response = run(scene, drive_of(40.0, 0.99, 1.02, periods=3))
    assert response.impact_count > 3 * sectors
    assert response.check.searches > 50 * sectors
    assert response.check.misses == 0
    assert abs(response.energy.relative_error) < 1e-11


def test_equal_sectors_under_equal_forces_move_alike() -> None:
    """Equal sectors under equal forces move equally.

    They have their impacts one after the other at the same time. With all modes in the model an
    impulse on one mass moves no other mass at once.
    """
    scene = ring_scene((2e-4,) * 8, 0.8, 0.3, wave_number=0)
    response = run(scene, drive_of(40.0, 1.0, periods=3))
    sectors = response.end_state[:8] @ sector_shapes(scene).T
    assert response.impact_count >= 8 * 4
    assert response.impact_count % 8 == 0
    np.testing.assert_allclose(sectors, sectors[0], rtol=1e-9)


def test_places_for_regimes_are_filled_again_without_a_trace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With as few places as there may be the same digits come out as with one for every set."""
    scene = ring_scene((2e-4, 3e-4, 2.5e-4, 2.2e-4, 1.5e-4), 0.7, 0.6)
    drive = drive_of(40.0, 1.02, periods=1.2)
    every = run(scene, drive)
    monkeypatch.setattr(regime_sets, "MOST_PLACE_BYTES", 1)
    few = run(scene, drive)
    assert len(set(every.phases.absorber.tolist())) >= 4
    np.testing.assert_array_equal(few.end_state, every.end_state)
    np.testing.assert_array_equal(few.energy.modal_loss, every.energy.modal_loss)


def test_a_regime_that_cannot_be_made_ends_the_run_in_words(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As a set would whose modes are faster than all that the tables are laid out for."""
    scene = ring_scene((2e-4,) * 5, 0.8, 0.6)

    def narrow(*args: object) -> SetLayout:
        return replace(find_set_layout(*args), speed=1.0)

    drive = drive_of(40.0, 1.02, periods=1.1)
    monkeypatch.setattr(solvers, "find_set_layout", narrow)
    with pytest.raises(ParameterError, match=r"damping_ratio = 0.01 \(the largest\) .* absorbers"):
        run(scene, drive)


@pytest.mark.plain
@pytest.mark.skipif(COMPILED, reason="compiled kernels, and the cache, would keep the constant")
def test_joint_forces_that_meet_no_conditions_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_forces, "COMPLEMENTARITY_TOL", -1.0)
    scene, force, ratio, periods = SEVERAL["sticking beside impacts"]
    with pytest.raises(IntegrationError, match=r"absorbers' joints meet .* lighter absorbers"):
        simulate(scene, drive_of(force, ratio, periods=periods))


def test_a_response_says_which_impacts_of_two_absorbers_are_at_one_instant() -> None:
    """A response reports which impacts of two absorbers are simultaneous.

    Two equal absorbers at one place hit together and are listed in their order. With different gaps
    they hit one after the other.
    """
    start = InitialState(absorber_velocity=(0.1, 0.1))
    for gaps, together in (((1e-4, 1e-4), True), ((1e-4, 1.1e-4), False)):
        scene = beam_scene(ONE_MODE, impact_absorbers(gaps, (1.0, 1.0), 0.7))
        response = run(scene, still(2e-3), initial=start)
        assert response.impacts.absorber[:2].tolist() == [0, 1]
        assert response.impacts.simultaneous[:2].tolist() == [together, together]
        assert ("at one instant" in repr(response)) == together
