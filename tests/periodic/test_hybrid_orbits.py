"""Orbits with two absorbers and with compliant walls are correct.

They are compared with dense matrices, limits and closed forms.
"""

from functools import cache

import numpy as np
import pytest
from orbit_cases import model_of
from periodic_truth import matched

from impact_env import (
    Beam,
    CompliantWalls,
    InitialState,
    ParameterError,
    SeveralAbsorbers,
    SlidingAbsorber,
    beam_scene,
    impact_absorber,
)
from impact_env.parameters import ElasticCoulombFriction
from impact_env.periodic.case import Case
from impact_env.periodic.hybrid_branches import (
    COINCIDENT_IMPACTS,
    GRAZE_AT_END,
    HybridBranch,
    hybrid_branch,
)
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.periodic.hybrid_flow import relative_rows
from impact_env.periodic.hybrid_orbit import (
    HybridOrbit,
    NoHybridOrbit,
    hybrid_orbit_of,
    hybrid_orbit_of_simulation,
    mirror_hybrid,
    plain_hybrid_orbit,
    shoot_hybrid,
)
from impact_env.periodic.hybrid_trajectory import follow_hybrid
from impact_env.periodic.survey import closed_form_orbits
from impact_env.periodic.symmetric import closed_folds
from impact_env.scene import Scene
from reference import dense

Array = np.ndarray
FIRST = float(model_of(1).omega[0])
TWO = SeveralAbsorbers(
    (impact_absorber(0.8e-3, 0.7, None, 0.01), impact_absorber(1e-3, 0.8, None, 0.01)), (1.0, 0.75)
)
RUBBING = SeveralAbsorbers(
    (impact_absorber(0.8e-3, 0.7, 0.3, 0.01), impact_absorber(1e-3, 0.8, 0.1, 0.01)), (1.0, 0.75)
)
SPRINGS = SlidingAbsorber(0.02, CompliantWalls(1e6, 1e-3, 0.75))
SLIDER = SlidingAbsorber(0.02, CompliantWalls(1e6, 1e-3, 0.75), ElasticCoulombFriction(0.02, 1e4))
RIGID = impact_absorber(1e-3, 0.75)


def case_with(absorber: object, ratio: float, force: float, modes: int = 1) -> HybridCase:
    return HybridCase(beam_scene(Beam(modes=modes), absorber), ratio * FIRST, force)


@cache
def high_orbit() -> HybridOrbit:
    """The symmetric orbit of one rigid absorber, from the closed form."""
    known = closed_form_orbits(Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.75)).orbits[0]
    phase, state = known.motion.mid_flight()
    orbit = shoot_hybrid(case_with(RIGID, 0.9, 1.5), phase, state, symmetric=True)
    assert isinstance(orbit, HybridOrbit), orbit.reason
    assert orbit.tip_max == pytest.approx(known.motion.tip_max, rel=1e-12)
    assert orbit.tip_rms == pytest.approx(known.motion.tip_rms, rel=1e-9)
    assert matched(orbit.multipliers, known.stability.multipliers) < 1e-9
    return orbit


@cache
def settled(name: str) -> HybridOrbit:
    absorber, ratio, force = {
        "two": (TWO, 1.0, 3.0),
        "two with friction": (RUBBING, 0.97, 5.0),
        "springs": (SPRINGS, 1.0, 3.0),
        "slider": (SLIDER, 1.0, 3.0),
    }[name]
    orbit = hybrid_orbit_of_simulation(case_with(absorber, ratio, force))
    assert isinstance(orbit, HybridOrbit), orbit.reason
    assert orbit.stable
    return orbit


def run_reference(case: HybridCase, phase: float, state: Array, span: float) -> Array:
    """Return where the dense reference takes a state over a span (s)."""
    n = case.scene.model.modes
    half = n + case.scene.places
    places = state[n:half]
    speeds = state[half + n :]
    if case.scene.places == 1:
        initial = InitialState(state[:n], state[half : half + n], places[0], speeds[0])
    else:
        initial = InitialState(state[:n], state[half : half + n], places, speeds)
    times = np.linspace(0, span, 5)
    return dense.follow(case.scene, case.drive(span, phase), initial, times).states[-1]


@pytest.mark.parametrize("name", ["two", "two with friction", "springs"])
def test_orbits_and_multipliers_are_those_of_dense_matrices(name: str) -> None:
    """Orbits and multipliers are those of dense matrices.

    The reference returns to the start, and central differences of its map give the multipliers.
    """
    orbit = settled(name)
    case = orbit.case
    span = orbit.trajectory.span
    units = case.units

    def end(state: Array) -> Array:
        return orbit.mirror * run_reference(case, orbit.phase, state, span)

    assert np.max(np.abs(end(orbit.state) - orbit.state) / units) < 1e-7
    columns = []
    for k, step in enumerate(2e-5 * units):
        change = step * np.eye(len(units))[k]
        columns.append((end(orbit.state + change) - end(orbit.state - change)) / (2 * step * units))
    reference = np.linalg.eigvals(np.array(columns).T * units)
    assert matched(orbit.multipliers, reference) < 1e-4


def test_the_derivative_with_an_elastic_slider_is_that_of_disturbed_runs() -> None:
    """A run starts without force in the slider's spring: its place is that of the absorber then."""
    orbit = settled("slider")
    assert sum(event.kind == "slip" for event in orbit.events) >= 2
    case = orbit.case
    units = case.units
    core = len(units)
    row = relative_rows(case)[0][0]
    whole = orbit.trajectory.derivative
    slaved = whole[:core, :core] + np.outer(whole[:core, -1], row[:core])
    span = orbit.trajectory.span
    for k, step in enumerate(1e-6 * units):
        change = step * np.eye(core)[k]
        ahead, back = (
            run_reference(case, orbit.phase, orbit.state + side * change, span) for side in (1, -1)
        )
        difference = (ahead - back) / (2e-6 * units)
        assert slaved[:, k] * units[k] / units == pytest.approx(difference, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("name", ["two with friction", "springs", "slider"])
def test_derivatives_by_force_and_frequency_are_those_of_other_runs(name: str) -> None:
    orbit = settled(name)
    case = orbit.case
    span = orbit.trajectory.span
    for column, parameter in enumerate(("force", "omega")):
        value = float(getattr(case, parameter))
        step = 1e-5 * value
        ahead, back = (
            follow_hybrid(
                case.changed(**{parameter: value + side * step}), orbit.phase, orbit.state, span
            ).exact_end
            for side in (1, -1)
        )
        difference = (ahead - back) / (2 * step)
        column_of = orbit.trajectory.columns[: len(difference), column]
        assert column_of / case.units == pytest.approx(difference / case.units, rel=1e-4, abs=1e-6)


def test_an_absorber_out_of_reach_leaves_the_orbit_of_the_other() -> None:
    """An absorber without contact does not change the orbit of the other.

    It has almost no mass and a cavity that it never crosses. Orbit and multipliers are those of one
    absorber.
    """
    one = high_orbit()
    light = SeveralAbsorbers((RIGID, impact_absorber(1.0, 0.5, None, 1e-12)), (1.0, 0.5))
    state = np.insert(one.state, (2, 4), (0.0, 0.0))
    both = shoot_hybrid(case_with(light, 0.9, 1.5), one.phase, state, symmetric=True)
    assert isinstance(both, HybridOrbit), both.reason
    assert both.tip_max == pytest.approx(one.tip_max, rel=1e-8)
    assert matched(one.multipliers, both.multipliers) < 1e-6
    assert [event.absorber for event in both.impacts] == [0, 0]


def test_stiff_springs_tend_to_the_rigid_orbit() -> None:
    """Orbits with stiff springs approach the rigid orbit.

    The difference is proportional to the duration of contact, the inverse root of the stiffness: a
    hundred times the stiffness gives a tenth of it.
    """
    rigid = high_orbit()
    misses = []
    for stiffness in (1e6, 1e8, 1e10):
        soft = SlidingAbsorber(0.02, CompliantWalls(stiffness, 1e-3, 0.75))
        orbit = shoot_hybrid(case_with(soft, 0.9, 1.5), rigid.phase, rigid.state, symmetric=True)
        assert isinstance(orbit, HybridOrbit), orbit.reason
        misses.append(orbit.tip_max / rigid.tip_max - 1)
    assert misses[0] / misses[1] == pytest.approx(10, rel=0.1)
    assert misses[1] / misses[2] == pytest.approx(10, rel=0.1)
    assert abs(misses[2]) < 1e-3


@cache
def rigid_branch() -> HybridBranch:
    return hybrid_branch(high_orbit(), "omega", (0.8 * FIRST, FIRST))


def test_folds_of_a_branch_are_those_of_the_closed_form() -> None:
    branch = rigid_branch()
    assert branch.branch.closed
    folds = sorted(place.orbit.case.omega_ratio for place in branch.of("fold"))
    case = Case(model_of(1), FIRST, 1.5, restitution=0.75)
    expected = sorted(omega / FIRST for omega in closed_folds(case, 0.8, 1.0))
    assert folds == pytest.approx(expected, abs=1e-9)
    assert len(branch.of("symmetry breaking")) == 2
    for place in branch.located:
        critical = 1.0 if place.kind == "fold" else -1.0
        assert place.multipliers[0] == pytest.approx(critical, abs=1e-6)
    plain = branch.curve(FIRST).to_plain()
    assert plain["closed"]
    assert len(plain["omega_ratio"]) == len(branch.branch)


def test_a_branch_of_two_absorbers_has_its_fold_where_orbits_end() -> None:
    """A branch of two absorbers has its fold where orbits end.

    On one side of the fold's force there are two orbits close to it, on the other none. The branch
    reports why it ends.
    """
    branch = hybrid_branch(settled("two"), "force", (2.0, 6.0))
    (fold,) = branch.of("fold")
    force = fold.orbit.case.force
    near = [orbit for orbit in branch.orbits() if abs(orbit.case.force / force - 1) < 0.02]
    assert all(orbit.case.force > force * (1 - 1e-9) for orbit in near)
    below = shoot_hybrid(
        fold.orbit.case.changed(force=0.99 * force), fold.orbit.phase, fold.orbit.state
    )
    assert isinstance(below, NoHybridOrbit) or abs(below.tip_max / fold.orbit.tip_max - 1) > 0.05
    ends = branch.branch.ended.split("; ")
    assert set(ends) <= {GRAZE_AT_END, COINCIDENT_IMPACTS}


def test_a_mirror_image_is_an_orbit_half_a_period_later() -> None:
    orbit = settled("two")
    assert not orbit.symmetric
    image = mirror_hybrid(orbit)
    assert isinstance(image, HybridOrbit)
    assert image.tip_rms == pytest.approx(orbit.tip_rms, rel=1e-9)
    phases = np.array([0.3, 2.0, 5.0])
    assert image.states(phases + np.pi) == pytest.approx(-orbit.states(phases), abs=1e-10)


@pytest.mark.parametrize("name", ["two with friction", "slider"])
def test_an_orbit_of_a_file_is_computed_again(name: str) -> None:
    orbit = settled(name)
    again = hybrid_orbit_of(plain_hybrid_orbit(orbit))
    assert isinstance(again, HybridOrbit), again.reason
    assert again.tip_max == pytest.approx(orbit.tip_max, rel=1e-9)


def test_scenes_without_such_contact_are_refused_by_name() -> None:
    for scene, name in (
        (Scene(model_of(1)), "absorber"),
        (beam_scene(Beam(modes=1), SlidingAbsorber(0.02, CompliantWalls(1e6, 0.0))), "gap"),
    ):
        with pytest.raises(ParameterError, match=name):
            HybridCase(scene, FIRST, 1.0)
    with pytest.raises(ParameterError, match="parameter"):
        hybrid_branch(high_orbit(), "gap", (1e-4, 1e-2))
    with pytest.raises(ParameterError, match="state"):
        shoot_hybrid(case_with(TWO, 1.0, 3.0), 0.0, np.zeros(3))
