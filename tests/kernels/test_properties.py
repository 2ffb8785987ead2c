"""What must hold for every scene, start and drive, whatever the chaos."""

import dataclasses

import numpy as np
import pytest
from core import check, drive_of, run
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from impact_env import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    Drive,
    ElasticCoulombFriction,
    InitialState,
    Response,
    RigidWalls,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
)
from impact_env.checks import ParameterError
from impact_env.parameters import Absorber

few = settings(
    max_examples=50, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda x: float(10**x))


masses = powers(-6, 1)
dampings = st.one_of(st.sampled_from([0.0, 1.0]), powers(-4, 0.3))
gaps = st.one_of(powers(-5, 0), st.just(1e-3))
restitutions = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0, 1))
limits = powers(-5, 2)
rigid_frictions = st.none() | st.builds(CoulombFriction, limits)
rigid = st.builds(
    SlidingAbsorber, masses, st.builds(RigidWalls, gaps, restitutions), rigid_frictions
)
dampers = st.builds(SlidingAbsorber, masses, st.none(), st.builds(CoulombFriction, limits))
stiffnesses = powers(2, 8)
sliders = st.builds(ElasticCoulombFriction, limits, stiffnesses)
compliant = st.builds(
    SlidingAbsorber, masses, st.builds(CompliantWalls, stiffnesses, gaps), st.none() | sliders
)
elastic = st.builds(SlidingAbsorber, masses, st.none(), sliders)
linear = st.one_of(
    st.none(),
    st.builds(StuckAbsorber, masses),
    st.builds(TunedAbsorber, masses, stiffnesses, st.one_of(st.just(0.0), powers(-3, 3))),
)
absorbers = st.one_of(rigid, rigid, dampers, compliant, elastic, linear)
forces = st.one_of(st.just(0.0), powers(-3, 3))
drives = st.builds(
    lambda force, ratios, periods, phase: drive_of(force, *ratios, periods=periods, phase=phase),
    forces,
    st.lists(st.one_of(st.just(1.0), st.floats(0, 3)), min_size=1, max_size=3),
    st.floats(0.2, 3),
    st.floats(0, 6.3),
)


@st.composite
def scenes(
    draw: st.DrawFn, kinds: st.SearchStrategy[Absorber | None] = absorbers, most: int = 20
) -> Scene:
    modes = draw(st.integers(1, most))
    return beam_scene(
        Beam(modes=modes, elements=draw(st.integers(10, 30)), damping_ratio=draw(dampings)),
        draw(kinds),
    )


@st.composite
def starts(draw: st.DrawFn, scene: Scene) -> InitialState:
    """Rest, or a start anywhere in the cavity with beam and absorber in motion."""
    if draw(st.booleans()):
        return InitialState()
    n = scene.model.modes
    sliding = scene.absorber
    unit = st.floats(-1, 1)
    q = 1e-4 * np.array(draw(st.lists(unit, min_size=n, max_size=n))) / (1 + np.arange(n)) ** 3
    u = 1e-2 * np.array(draw(st.lists(unit, min_size=n, max_size=n))) / (1 + np.arange(n)) ** 2
    gap = (
        sliding.walls.gap
        if isinstance(sliding, SlidingAbsorber) and sliding.walls is not None
        else 1e-3
    )
    share = draw(st.one_of(st.sampled_from([0.0, 1.0, -1.0]), unit))
    return InitialState(q, u, float(scene.model.tip_shape @ q) + share * gap, 0.1 * draw(unit))


@few
@given(st.data(), scenes(), drives)
def test_energy_and_walls(data: st.DataObject, scene: Scene, drive: Drive) -> None:
    initial = data.draw(starts(scene))
    try:
        response = run(scene, drive, initial=initial)
    except ParameterError as refusal:
        if "modal basis off" not in str(refusal):
            raise
        # eigenvalues that (almost) coincide, or lie many decades apart, have no modal basis
        reject()
    # what passes through the run: without damping and friction the work can cancel almost to
    # nothing
    scale = max(
        float(np.sum(response.energy.impact_loss)),
        abs(drive.amplitude) * float(np.max(np.abs(response.history.tip_displacement))),
    )
    # friction's loss is its limit times a difference of displacements, whose terms are as large as
    # the beam's deflection under that limit
    friction = getattr(scene.absorber, "friction", None)
    scale += 1e-6 * friction.limit**2 / Beam().static_tip_stiffness if friction is not None else 0.0
    # two equal eigenvalues have no modal form: near critical damping four digits of the rounding
    # are lost
    check(
        response,
        1e-9,
        scale,
        1e-11 if np.any(np.abs(scene.model.damping_ratio - 1) < 1e-6) else 1e-13,
    )
    if drive.amplitude == 0 and response.energy.stored_at_start == 0:
        assert not np.any(response.end_state)  # rest stays at rest


def scaled(absorber: SlidingAbsorber, factor: float) -> SlidingAbsorber:
    walls, friction = (
        None if part is None else dataclasses.replace(part, **{name: getattr(part, name) * factor})
        for part, name in ((absorber.walls, "gap"), (absorber.friction, "limit"))
    )
    return dataclasses.replace(absorber, walls=walls, friction=friction)


def assert_same_beginning(one: Response, other: Response, factor: float) -> None:
    """The first three impacts, and the motion up to the third, agree but for the factor."""
    known = min(3, one.impact_count, other.impact_count)
    end = one.drive.schedule.times[-1]
    np.testing.assert_allclose(
        other.impacts.time[:known], one.impacts.time[:known], rtol=0, atol=1e-6 * end
    )
    until = one.impacts.time[known - 1] if one.impact_count > 2 else end
    rows = one.history.time < until - 1e-5 * end
    tip = one.history.tip_displacement[rows]
    largest = np.max(np.abs(tip), initial=0.0)
    np.testing.assert_allclose(
        other.history.tip_displacement[rows],
        factor * tip,
        rtol=0,
        atol=1e-6 * abs(factor) * largest,
    )


@pytest.mark.slow
@few
@given(scenes(st.one_of(rigid, dampers, compliant, elastic), 10), drives, powers(-3, 3))
def test_scaling_law(scene: Scene, drive: Drive, factor: float) -> None:
    larger = Scene(scene.model, scaled(scene.absorber, factor))
    assert_same_beginning(
        run(scene, drive),
        run(larger, dataclasses.replace(drive, amplitude=factor * drive.amplitude)),
        factor,
    )


@few
@given(scenes(most=10), drives)
def test_mirror_symmetry(scene: Scene, drive: Drive) -> None:
    one = run(scene, drive)
    other = run(scene, dataclasses.replace(drive, amplitude=-drive.amplitude))
    np.testing.assert_array_equal(one.end_state, -other.end_state)
    assert one.impact_count == other.impact_count


@few
@given(scenes(st.one_of(rigid, dampers), 5), drives)
def test_impulses_balance_the_absorbers_momentum(scene: Scene, drive: Drive) -> None:
    """Impulses balance the absorber's momentum.

    Without friction, only walls change the absorber's velocity: in impacts, and while they hold it.
    """
    response = run(scene, drive)
    if scene.absorber.friction is None and response.stuck_time == 0:
        momentum = scene.absorber_mass * response.end_state[-1]
        assert momentum == pytest.approx(
            np.sum(response.impacts.impulse),
            rel=1e-9,
            abs=1e-10 * np.sum(np.abs(response.impacts.impulse)),
        )
    assert np.all(response.impacts.impulse * response.impacts.relative_velocity <= 0)
