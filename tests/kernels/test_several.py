"""Several absorbers: against independent integrators, closed forms and the single absorber, and what must hold for every scene."""

from dataclasses import dataclass

import numpy as np
import pytest
from core import OMEGA, PERIOD, Array, drive_of, relative_displacement, run, scene_of
from every_scene import SEVERAL
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from impact_env import (
    Beam,
    CompliantWalls,
    Drive,
    ElasticCoulombFriction,
    InitialState,
    Moreau,
    ParameterError,
    Response,
    RigidWalls,
    RungeKutta,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    beam_scene,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    linear_sweep,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.energy import stored_energy
from impact_env.ensemble import Lane, run_lanes
from impact_env.families import Observers
from impact_env.families.exact import SEVERAL as ANY_NUMBER
from impact_env.kernels.motion.observers import DONE, Series, new_check, new_counters, new_energy, new_events
from impact_env.methods import Exact
from optimisation.designs import design_space
from optimisation.measures import FRICTION_HEAT, STROKE, of_motion
from reference.mechanics import Mechanics


@dataclass
class Laws:
    """Gap in m, restitution, friction limit in N and mobility in 1/kg of each absorber, (n,)."""

    gap: Array
    restitution: Array
    limit: Array
    mobility: Array


def laws_of(scene: Scene, mobility: Array) -> Laws:
    assert isinstance(scene.absorber, SeveralAbsorbers)
    every = scene.absorber.absorbers
    gap = np.array([np.inf if a.walls is None else a.walls.gap for a in every])
    restitution = np.array([0.0 if a.walls is None else a.walls.restitution for a in every])
    return Laws(gap, restitution, np.array([0.0 if a.friction is None else a.friction.limit for a in every]), np.diag(mobility))


def percussion(laws: Laws, a: int, before: Array, free: float, distance: Array, dt: float) -> float:
    """Return the percussion by friction and wall on absorber a in a step, the others being known; ``free``: its relative velocity without that."""
    p = float(np.clip(-free / laws.mobility[a], -laws.limit[a] * dt, laws.limit[a] * dt))
    if abs(distance[a]) >= laws.gap[a]:
        wanted = -laws.restitution[a] * before[a]
        if np.sign(distance[a]) * (free + laws.mobility[a] * p - wanted) > 0:
            return float((wanted - free) / laws.mobility[a])
    return p


def small_steps(scene: Scene, drive: Drive, initial: InitialState, duration: float, steps: int) -> Array:
    """Integrate by Moreau's scheme; return the end state."""
    m, x, dt = Mechanics(scene), initial.vector(scene), duration / steps
    laws, model, n, half = laws_of(scene, m.mobility), scene.model, m.modes, m.half
    forces = drive.amplitude * np.cos(drive.schedule.phase_at(dt * (0.5 + np.arange(steps))) + drive.phase)
    for force in forces:
        x[:half] += 0.5 * dt * x[half:]
        distance, before = (x[at + n : at + half] - m.shapes @ x[at : at + n] for at in (0, half))
        x[half : half + n] += dt * (model.force_shape * force - 2 * model.damping_ratio * model.omega * x[half : half + n] - model.omega**2 * x[:n])
        given = np.zeros(m.places)
        for _ in range(20):
            old = given.copy()
            for a in range(m.places):
                free = x[half + n + a] - m.shapes[a] @ x[half : half + n] - laws.mobility[a] * given[a]
                new = percussion(laws, a, before, float(free), distance, dt)
                x[half + n + a] += (new - given[a]) / m.masses[a]
                x[half : half + n] -= m.shapes[a] * (new - given[a])
                given[a] = new
            if np.max(np.abs(given - old)) <= 1e-12 * np.max(np.abs(given)):
                break
        x[:half] += 0.5 * dt * x[half:]
    return x


BEAM = Beam(modes=3)
GAPS, LIGHT = (0.00042526125170046344, 0.0006163855559120178), 0.14864217036644486  # no round numbers: what went wrong was rounding


def relative(response: Response) -> Array:
    assert response.history is not None
    history = response.history
    return np.asarray(history.absorber_displacement - history.modal_displacement @ response.scene.absorber_shapes.T)


def check(response: Response, error: float = 1e-10) -> float:
    """Energy is balanced, losses are losses, and no wall is penetrated; return the largest of what may be 1 at most."""
    energy, impacts, phases = response.energy, response.impacts, response.phases
    scale = max(abs(energy.work), float(np.sum(energy.modal_loss)), energy.stored_at_start, energy.stored_at_end)
    shares = [abs(energy.balance_error) / (error * scale + 1e-25)]
    assert shares[0] <= 1
    assert energy.friction_loss >= -1e-15 * scale
    assert np.all(impacts.energy_lost >= 0)
    assert len(impacts.time) == response.impact_count
    assert np.all(np.diff(impacts.time) >= -1e-13 * PERIOD)  # impacts at one time, within the resolution of time
    assert np.all(phases.end >= phases.start)
    assert np.sum(phases.end - phases.start) == pytest.approx(response.stuck_time, rel=1e-9, abs=1e-15)
    assert isinstance(response.scene.absorber, SeveralAbsorbers)
    size = np.max(np.abs(response.history.absorber_displacement)) + np.max(np.abs(response.history.tip_displacement))
    for a, distance in enumerate(relative(response).T):
        walls = response.scene.cavity(a)
        if walls is not None:
            shares.append(float(np.max(np.abs(distance)) - walls.gap) / (1e-13 * (walls.gap + size)))
            assert shares[-1] <= 1
    return max(shares)


@pytest.mark.slow
def test_small_moreau_steps_converge_to_it() -> None:
    """Contact laws in another form, without regimes and events: what the references take for granted is checked too."""
    scene, force, ratio, periods = SEVERAL["sticking beside impacts"]
    drive = drive_of(force, ratio, periods=periods)
    response = run(scene, drive)
    assert response.impact_count >= 3
    assert set(response.phases.absorber.tolist()) == {0, 1, 2}
    scale = np.abs(response.end_state) + np.repeat([1e-4, 1e-1], 5)
    duration = float(drive.schedule.times[-1])
    coarse, fine = (
        float(np.max(np.abs(small_steps(scene, drive, InitialState(), duration, steps) - response.end_state) / scale)) for steps in (2_000, 12_000)
    )
    assert fine < 0.4 * coarse
    assert fine < 6e-3


@pytest.mark.parametrize("friction", [None, 0.05])
def test_a_second_absorber_without_mass_changes_nothing(friction: float | None) -> None:
    one = impact_absorber(3e-4, 0.7, friction)
    light = impact_absorber(1e-4, 0.7, None, 1e-10) if friction is None else friction_damper(1e-11, 1e-10)
    drive = drive_of(3.0, 0.97, 1.02, periods=3)
    single = run(beam_scene(BEAM, one), drive)
    both = run(beam_scene(BEAM, SeveralAbsorbers((one, light), (1.0, 0.5))), drive)
    assert single.impact_count >= 4
    own = both.impacts.absorber == 0
    np.testing.assert_allclose(both.impacts.time[own], single.impacts.time, atol=1e-8 * PERIOD)
    kept = np.delete(both.end_state, [4, 9])
    np.testing.assert_allclose(kept, single.end_state, atol=1e-6 * np.max(np.abs(single.end_state)))


def test_order_of_the_absorbers_does_not_matter() -> None:
    first, second, third = impact_absorber(3e-4, 0.7, 0.05, 0.01), impact_absorber(2e-4, 0.9, None, 0.02), friction_damper(0.2, 0.005)
    drive = drive_of(3.0, 0.98, 1.0, periods=3)
    runs = [
        run(beam_scene(BEAM, SeveralAbsorbers(absorbers, positions)), drive)
        for absorbers, positions in (((first, second, third), (1.0, 0.7, 0.4)), ((third, first, second), (0.4, 1.0, 0.7)))
    ]
    check(runs[0])
    assert runs[0].impact_count == runs[1].impact_count >= 3
    order = [0, 1, 2, 4, 5, 3, 6, 7, 8, 10, 11, 9]
    np.testing.assert_allclose(runs[1].end_state[order], runs[0].end_state, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    ("restitution", "friction"), [(0.0, None), (0.0, 0.05), (0.0, 0.15), (0.6, None), (0.6, 0.05), (0.6, 0.15), (1.0, None), (1.0, 0.05)]
)
def test_a_single_absorber_is_the_same_in_the_lane_of_several(friction: float | None, restitution: float) -> None:
    """Two lanes of their own, by different regimes and ways from one to another, and no truth that they share but the search."""
    scene, drive = beam_scene(BEAM, impact_absorber(3e-4, restitution, friction)), drive_of(3.0, 0.97, 1.02, periods=3)
    single, start = run(scene, drive), InitialState().vector(scene)
    series = Series(np.zeros((len(single.history.time), len(start))))  # as `run` has it, for one kernel fewer
    seen, end = Observers(new_counters(check=new_check()), events=new_events(1000), series=series, energy=new_energy(3)), start.copy()
    assert ANY_NUMBER.run(scene, drive, Exact(), end, drive.schedule.pseudo_period / 32, seen) == DONE
    assert seen.counters.counts["impacts"] == single.impact_count >= 3
    assert seen.counters.counts["stuck_time"] == pytest.approx(single.stuck_time, rel=1e-6, abs=1e-9 * PERIOD)
    impacts = seen.events.impacts[: single.impact_count]
    np.testing.assert_allclose(impacts["time"], single.impacts.time, atol=1e-8 * PERIOD)
    np.testing.assert_allclose(impacts["impulse"], single.impacts.impulse, rtol=1e-6, atol=1e-9 * np.max(np.abs(single.impacts.impulse)))
    np.testing.assert_allclose(end, single.end_state, atol=1e-7 * np.max(np.abs(single.end_state)))
    assert seen.energy.totals["friction_loss"][0] == pytest.approx(single.energy.friction_loss, rel=1e-7)


def test_absorbers_that_never_move_are_a_stuck_one_of_their_mass() -> None:
    stuck = tuple(SlidingAbsorber(ratio, RigidWalls(1e-3, 0.5), friction_damper(1e4).friction) for ratio in (0.01, 0.03, 0.02))
    drive, start = drive_of(3.0, 0.9, 1.1, periods=4), InitialState(np.array([1e-4, 1e-5, 0.0]))
    several = run(beam_scene(BEAM, SeveralAbsorbers(stuck, (1.0, 1.0, 1.0))), drive, initial=start)
    single = run(beam_scene(BEAM, StuckAbsorber(0.06)), drive, initial=start)
    assert several.impact_count == 0
    assert several.stuck_time == pytest.approx(3 * drive.schedule.times[-1], rel=1e-12)
    np.testing.assert_allclose(
        several.end_state[[0, 1, 2, 6, 7, 8]], single.end_state[[0, 1, 2, 4, 5, 6]], atol=1e-12 * np.max(np.abs(single.end_state))
    )
    assert several.level is None


def test_an_impact_keeps_momentum_and_obeys_restitution() -> None:
    """One impact at 0.6 of the length; what the modes and the others' relative velocities change by is the impulse's share."""
    scene = beam_scene(Beam(modes=4, damping_ratio=0.0), impact_absorbers((1e-3, 1e-3), (1.0, 0.6), restitution=0.6))
    start = InitialState(absorber_displacement=(0.0, 1e-3 * (1 - 1e-9)), absorber_velocity=(0.0, 0.2))
    response = run(scene, drive_of(0.0, 1.0, periods=1e-6), initial=start)
    impacts, shapes, mass = response.impacts, scene.absorber_shapes, scene.absorber_masses[1]
    assert response.impact_count == 1
    assert impacts.absorber[0] == 1
    impulse = -1.6 * 0.2 / (1 / mass + shapes[1] @ shapes[1])
    assert impacts.impulse[0] == pytest.approx(impulse, rel=1e-9)
    np.testing.assert_allclose(response.end_state[6:10], -shapes[1] * impulse, rtol=1e-3)
    assert response.end_state[10] == 0.0
    assert response.end_state[11] == pytest.approx(0.2 + impulse / mass, rel=1e-9)
    check(response)


def test_simultaneous_events_of_equal_absorbers() -> None:
    """Two equal absorbers at one place, in step: every event of one is an event of the other."""
    scene = beam_scene(BEAM, impact_absorbers((3e-4, 3e-4), (1.0, 1.0), restitution=0.7, friction_limit=0.04))
    response = run(scene, drive_of(3.0, 0.98, periods=4))
    check(response)
    assert np.min(np.bincount(response.impacts.absorber)) >= 2


def test_an_impact_turns_the_sliding_of_another_absorber() -> None:
    """An impact that reverses another absorber's relative velocity must not let it stick for that: its kinetic energy would be lost."""
    absorbers = (impact_absorber(1e-3, 0.0, None, 0.5), impact_absorber(1e-4, 0.0, None, 0.5), friction_damper(1.0, 0.25))
    scene = beam_scene(Beam(modes=1, damping_ratio=0.0), SeveralAbsorbers(absorbers, (1.0, 1.0, 1.0)))
    response = run(scene, drive_of(10.0, 1.0, periods=1.5))
    check(response)
    assert response.impact_count >= 2


def test_absorbers_held_by_walls_set_each_other_free_only_finitely_often() -> None:
    """Both are pressed to their walls by a constant pull of the beam while they chatter; plastic contact is the hardest case."""
    for restitution in (0.0, 0.5):
        scene = beam_scene(Beam(modes=2, damping_ratio=0.05), impact_absorbers((1e-5, 1e-5), (1.0, 0.8), restitution=restitution, mass_ratio=0.2))
        response = run(scene, drive_of(5.0, 0.3, periods=3))
        check(response)
        assert set(response.phases.absorber[response.phases.kind > 0].tolist()) == {0, 1}
        assert response.steps < 20_000


def test_bounces_of_one_die_out_beside_one_that_is_held() -> None:
    """A light absorber chatters with friction while a heavy one rests on its wall: each event must leave the bounces smaller, down to rounding."""
    scene = beam_scene(Beam(), impact_absorbers(GAPS, (1.0, 0.7736825462817463), 0.7, 0.05, 0.02, (LIGHT, 1 - LIGHT)))
    reference = scene.model.resonance_omega(1)
    schedule = linear_sweep(reference, 0.9, 0.98, percent_per_100_periods=10.0)
    response = run(scene, Drive(17.5, schedule, 4.698951511487796))
    assert response.steps < 100_000
    assert abs(response.energy.balance_error) < 1e-11 * response.energy.work


def test_equal_absorbers_at_one_place_break_loose_at_once() -> None:
    """Both stick by friction and reach its limit at the same time; what rounding makes of that must not be stick and slip without end."""
    beam = Beam(bending_stiffness=0.81 * Beam.bending_stiffness)
    scene = beam_scene(beam, impact_absorbers((1e-3, 1e-3), (1.0, 1.0), 0.7, 0.05, 0.02))
    reference = scene.model.resonance_omega(1)
    response = run(scene, Drive(3.5, linear_sweep(reference, 0.9, 0.906)))
    assert set(response.phases.absorber.tolist()) == {0, 1}
    assert response.steps < 2000
    for quantity in (response.end_state[10:12], response.end_state[22:24]):
        assert quantity[0] == pytest.approx(quantity[1], rel=1e-6)


unit = st.floats(-1, 1)
positions = st.one_of(st.just(1.0), st.floats(0.2, 1.0))


@st.composite
def several(draw: st.DrawFn) -> SeveralAbsorbers:
    def one() -> SlidingAbsorber:
        mass, limit = draw(st.floats(0.001, 0.5)), draw(st.one_of(st.none(), st.floats(-3, 1).map(lambda x: float(10**x))))
        if limit is not None and draw(st.integers(0, 3)) == 0:
            return friction_damper(limit, mass)
        restitution = draw(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1)))
        return impact_absorber(draw(st.floats(-5, -3).map(lambda x: float(10**x))), restitution, limit, mass)

    n = draw(st.integers(2, 3))
    return SeveralAbsorbers(tuple(one() for _ in range(n)), tuple(draw(positions) for _ in range(n)))


@settings(max_examples=30, derandomize=True, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large], deadline=None)
@given(st.data(), several(), st.floats(-1, 1.5).map(lambda x: float(10**x)), st.floats(0.3, 8), st.integers(1, 8))
def test_energy_and_walls(data: st.DataObject, absorbers: SeveralAbsorbers, force: float, ratio: float, modes: int) -> None:
    scene = beam_scene(Beam(modes=modes, elements=12, damping_ratio=data.draw(st.sampled_from([0.0, 0.01, 0.1]))), absorbers)
    q = np.array([1e-4 * data.draw(unit), *np.zeros(modes - 1)])
    shares = [data.draw(st.one_of(st.sampled_from([0.0, 1.0, -1.0]), unit)) for _ in absorbers.absorbers]
    gaps = [getattr(scene.cavity(a), "gap", 1e-3) for a in range(scene.places)]
    start = InitialState(q, None, scene.absorber_shapes @ q + np.array(shares) * np.array(gaps), [0.1 * data.draw(unit) for _ in shares])
    response = run(scene, drive_of(force, ratio, periods=1.5), initial=data.draw(st.sampled_from([InitialState(), start])))
    assert check(response, 1e-9) <= 1


@pytest.mark.nightly
def test_lanes_and_level() -> None:
    scene = beam_scene(BEAM, impact_absorbers((1e-3, 3e-4), (1.0, 0.6), restitution=0.7, friction_limit=0.05))
    drive = drive_of(3.0, 0.98, 1.02, periods=30)
    single = simulate(scene, drive)
    lanes = run_lanes([Lane(scene, drive), Lane(scene, Drive(3.0, drive.schedule, 1.0))], threads=2)
    assert lanes.level[0] == single.level.value
    assert lanes.level[0] != lanes.level[1]
    assert lanes.impacts[0] == single.impact_count > 0
    recorded = run(scene, drive)
    assert np.max(np.abs(recorded.history.tip_displacement)) == pytest.approx(single.level.max_tip, rel=0.02)
    assert recorded.history.tip_shape is scene.model.tip_shape
    assert recorded.energy.stored_at_end == pytest.approx(stored_energy(scene, recorded.end_state))


def refusals() -> dict[str, tuple[object, ...]]:
    ok = impact_absorber()
    return {
        "number of absorbers": (SeveralAbsorbers, (ok,), (1.0,)),
        "position": (SeveralAbsorbers, (ok, ok), (1.0, 1.5)),
        "positions": (impact_absorbers, (1e-3, 1e-3), (1.0,)),
        "shares": (lambda: impact_absorbers((1e-3, 1e-3), (1.0, 0.5), shares=(0.5, 0.6)),),
        "share": (lambda: impact_absorbers((1e-3, 1e-3), (1.0, 0.5), shares=(1.0, 0.0)),),
        "restitution": (lambda: impact_absorbers((1e-3, 1e-3), (1.0, 0.5), restitution=(0.5, 0.5, 0.5)),),
        "gap": (impact_absorbers, (1e-3, 0.0), (1.0, 0.5)),
        "gap = inf": (impact_absorbers, (1e-3, float("inf")), (1.0, 0.5)),
        "absorber": (SeveralAbsorbers, (ok, SlidingAbsorber(walls=CompliantWalls(1e5))), (1.0, 0.5)),
        "absorber = Sliding": (SeveralAbsorbers, (ok, SlidingAbsorber(friction=ElasticCoulombFriction(1.0, 1e4))), (1.0, 0.5)),
        "absorber_position": (beam_scene, Beam(absorber_position=0.5), impact_absorbers((1e-3, 1e-3), (1.0, 0.5))),
        "absorber_shapes": (lambda: Scene(scene_of().model, impact_absorbers((1e-3, 1e-3), (1.0, 0.5))),),
    }


@pytest.mark.parametrize("name", list(refusals()))
def test_what_is_not_possible_is_refused_by_name(name: str) -> None:
    act, *arguments = refusals()[name]
    with pytest.raises(ParameterError, match=name):
        act(*arguments)


def test_what_does_one_absorber_only_says_so() -> None:
    scene, drive = beam_scene(BEAM, impact_absorbers((1e-3, 3e-4), (1.0, 0.6))), drive_of(1.0, 1.0)
    for method in (Moreau(), RungeKutta()):
        with pytest.raises(ParameterError, match="Exact for several absorbers"):
            simulate(scene, drive, method)
    with pytest.raises(ParameterError, match="one absorber"):
        ControlledRuns(scene, 2, OMEGA, 1.0, samples_per_period=32)
    with pytest.raises(ParameterError, match="one for each absorber"):
        simulate(scene, drive, initial=InitialState(absorber_displacement=(0.0, 0.0, 0.0)))
    with pytest.raises(ParameterError, match="inside the cavity"):
        simulate(scene, drive, initial=InitialState(absorber_displacement=(0.0, 1e-3)))


def test_budget_and_shares() -> None:
    absorbers = impact_absorbers((1e-3, 2e-3, 3e-3), (1.0, 0.5, 0.7), (0.5, 0.6, 0.7), (0.1, None, 0.2), 0.03, (0.5, 0.3, 0.2))
    assert absorbers.mass_ratio == pytest.approx(0.03, rel=1e-14)
    assert absorbers.absorbers[1] == impact_absorber(2e-3, 0.6, None, 0.03 * 0.3)
    scene = beam_scene(BEAM, absorbers)
    assert scene.absorber_mass == pytest.approx(np.sum(scene.absorber_masses), rel=1e-14)
    np.testing.assert_allclose(scene.absorber_shapes[0], scene.model.tip_shape, rtol=1e-14)
    assert relative_displacement(run(beam_scene(BEAM, impact_absorber()), drive_of(1.0, 1.0, periods=0.1))).ndim == 1


def test_measures_of_a_design_see_every_absorber() -> None:
    design = design_space("several", fixed={"friction_limit_2": 0}).design({"gap_1": 3e-4, "gap_2": 2.5e-4, "position_2": 0.6, "share": 0.5})
    response = run(design.scene(BEAM), drive_of(3.0, 0.98, periods=3))
    assert np.max(np.abs(relative(response)), axis=0) == pytest.approx([3e-4, 2.5e-4], rel=0.1)
    assert of_motion(STROKE, response) == np.max(np.abs(relative(response)))
    speed = response.history.absorber_velocity[:, 0] - response.history.tip_velocity
    assert of_motion(FRICTION_HEAT, response) == pytest.approx(0.05 * np.mean(np.abs(speed)), rel=1e-12)
