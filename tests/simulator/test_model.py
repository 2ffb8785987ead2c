import itertools
import math
from dataclasses import replace
from functools import partial
from typing import Any

import numba
import numpy as np
import pytest
from cantilever import roots, shapes
from core import run
from every_scene import SCENES

from impact_env import (
    FrequencySchedule,
    InitialState,
    friction_damper,
    impact_absorber,
    linear_sweep,
    modal_model,
)
from impact_env.checks import ParameterError
from impact_env.controlled import ControlledRuns
from impact_env.drive import Drive, Excitation, constant_frequency
from impact_env.kernels.motion.observers import DONE
from impact_env.laws import SceneKind
from impact_env.loads import BASE_QUANTITY, Loads, Samples
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.modes import assemble_matrices, deflection_row
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    CoulombFriction,
    NonlinearSink,
    RigidWalls,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    impact_absorbers,
)
from impact_env.scene import Scene, beam_scene
from impact_env.solvers import CAPABILITIES, find_solver, kernel_key
from impact_env.sweep import simulate

INF = math.inf


def test_numbers_of_the_paper() -> None:
    model = modal_model(Beam())
    assert model.omega[0] == pytest.approx(252.3097245382703, rel=1e-10)
    np.testing.assert_allclose(
        model.omega[[1, 2, 9]] / model.omega[0], [6.26690, 17.54754, 253.50], rtol=1e-5
    )
    np.testing.assert_allclose(model.tip_shape[:3], 2 / np.sqrt(0.56375), rtol=1e-5)
    assert model.beam_mass == 0.56375
    assert Beam().static_tip_stiffness == pytest.approx(8709.12)
    assert model.pseudo_period(2) == pytest.approx(2 * np.pi / model.omega[1])


def test_frequencies_converge_with_the_fourth_power_of_the_elements() -> None:
    exact = (
        roots(3)[2] ** 2
        * np.sqrt(Beam().bending_stiffness / Beam().mass_per_length)
        / Beam().length ** 2
    )
    errors = [modal_model(Beam(elements=n, modes=3)).omega[2] / exact - 1 for n in (4, 8, 16)]
    assert all(3.5 < order < 4.5 for order in np.diff(-np.log2(errors)))


def test_all_modes_are_normalised_and_ordered() -> None:
    beam = Beam(modes=60)
    mass, stiffness = assemble_matrices(beam)
    model = modal_model(beam)
    assert np.all(np.diff(model.omega) > 0)
    assert np.all(model.tip_shape > 0)
    # completeness: sum of phi phi^T is the inverse mass matrix, sum of phi phi^T / omega^2 the
    # inverse stiffness matrix
    tip = deflection_row(beam, 1.0)
    force = deflection_row(beam, 0.4)
    assert model.tip_shape @ model.tip_shape == pytest.approx(
        tip @ np.linalg.solve(mass, tip), rel=1e-9
    )
    assert model.force_shape @ model.tip_shape == pytest.approx(
        force @ np.linalg.solve(mass, tip), rel=1e-6, abs=1e-6
    )
    assert np.sum((model.tip_shape / model.omega) ** 2) == pytest.approx(
        1 / beam.static_tip_stiffness, rel=1e-9
    )
    assert tip @ np.linalg.solve(stiffness, tip) == pytest.approx(
        1 / beam.static_tip_stiffness, rel=1e-9
    )


@pytest.mark.parametrize("position", [0.01, 0.333, 0.4, 0.5, 0.777, 1.0])
def test_shapes_at_any_position(position: float) -> None:
    force = modal_model(Beam(modes=4, force_position=position)).force_shape
    absorber = modal_model(Beam(modes=4, absorber_position=position)).tip_shape
    np.testing.assert_allclose(force, shapes(4, position) / np.sqrt(Beam().mass), atol=2e-4)
    np.testing.assert_array_equal(force, absorber)


def test_overrides() -> None:
    plain = modal_model(Beam(modes=3))
    changed = modal_model(
        Beam(modes=3, modal_frequency_ratio={2: 2.5, 3: 0.5}, damping_ratio=(0.0, 0.1, 2.0))
    )
    np.testing.assert_allclose(changed.omega / plain.omega[0], [1, 2.5, 0.5], rtol=1e-14)
    np.testing.assert_array_equal(changed.damping_ratio, [0.0, 0.1, 2.0])
    np.testing.assert_array_equal(changed.tip_shape, plain.tip_shape)


def test_a_cavity_without_clearance_is_a_stuck_absorber_and_an_infinite_one_is_none() -> None:
    model = modal_model(Beam(modes=1))
    assert Scene(model, impact_absorber(0.0, mass_ratio=0.3)).absorber == StuckAbsorber(0.3)
    assert Scene(model, impact_absorber(INF)).absorber is None
    assert Scene(model, impact_absorber(INF, friction_limit=0.2)).absorber == friction_damper(0.2)
    assert Scene(model, StuckAbsorber(0.5)).absorber_mass == pytest.approx(0.281875)


def test_initial_states() -> None:
    scene = beam_scene(Beam(modes=2), impact_absorber())
    q = np.array([1e-3, 2e-3])
    tip = scene.model.tip_shape @ q
    np.testing.assert_allclose(
        InitialState(q, absorber_velocity=0.3).vector(scene), [1e-3, 2e-3, tip, 0, 0, 0.3]
    )
    np.testing.assert_allclose(
        InitialState(q, q, tip - 1e-3, 0.3).vector(scene), [1e-3, 2e-3, tip - 1e-3, 1e-3, 2e-3, 0.3]
    )
    stuck = beam_scene(Beam(modes=2), StuckAbsorber())
    assert InitialState(modal_velocity=q, absorber_velocity=9.0).vector(stuck)[-1] == pytest.approx(
        tip
    )


def test_schedules() -> None:
    sweep = linear_sweep(100.0)
    np.testing.assert_allclose(sweep.omegas, [90, 106])
    assert sweep.periods == pytest.approx(1600)
    assert linear_sweep(100.0, 1.06, 0.9, 2.0).periods == pytest.approx(800)
    assert constant_frequency(100.0, 1.5, 7).phase_at(7 * 2 * np.pi / 100) == pytest.approx(
        1.5 * 7 * 2 * np.pi
    )
    broken = FrequencySchedule(np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 0.0]), 1.0)
    np.testing.assert_allclose(
        broken.phase_at(np.array([0.0, 0.5, 1.0, 2.0, 3.0])), [0, 1.25, 3, 6, 7]
    )
    np.testing.assert_allclose(broken.omega_at(np.array([0.5, 2.0])), [3, 2])


# The table of families: every kind of scene with every method is either simulated or refused, and
# its key tells compiled kernels apart.


ABSORBERS: dict[str, Absorber | None] = {
    **SCENES,
    "none": None,
    "yielding": SlidingAbsorber(walls=YieldingWalls(0.5, 1e-3)),
    "sink": NonlinearSink(1e8),
    "several": impact_absorbers((1e-3, 1e-3), (0.8, 1.0), mass_ratio=0.01),
}
METHODS: tuple[Method, ...] = (Exact(), Moreau(), RungeKutta())
# with one record: of the exact method without and with loads beside one force, for linear scenes
# and for several absorbers, and, each without and with friction, for rigid and compliant walls
MOST_KERNELS: dict[type[Method], int] = {Exact: 12, Moreau: 1, RungeKutta: 1}


def scene(name: str) -> Scene:
    return beam_scene(Beam(modes=2), ABSORBERS[name])


def drive(of: Scene, force: float = 1e-3, periods: float = 1.0) -> Drive:
    return Drive(force, constant_frequency(of.model.resonance_omega(1), 1.0, periods))


# scenes whose arguments of the kernels are None where those of `ABSORBERS` are not, or the other
# way round
HEAVY: dict[str, Absorber] = {
    f"{name}, gravity": replace(absorber, gravity=9.81)
    for name, absorber in ABSORBERS.items()
    if isinstance(absorber, SlidingAbsorber | StuckAbsorber | TunedAbsorber)
}
RUBBING = SlidingAbsorber(walls=RigidWalls(1e-3), friction=CoulombFriction(0.1, 1.5))
OTHERS = HEAVY | {
    "static friction": RUBBING,
    "static friction, gravity": replace(RUBBING, gravity=9.81),
    "springs and dampers": SlidingAbsorber(walls=CompliantWalls(3e5, restitution=0.7)),
}


def every_scene() -> dict[str, Scene]:
    """Return the table's scenes, and some with the level at another place.

    In the latter the level is not read at the absorber's place.
    """
    scenes = {name: scene(name) for name in ABSORBERS}
    scenes |= {name: beam_scene(Beam(modes=2), absorber) for name, absorber in OTHERS.items()}
    model = replace(modal_model(Beam(modes=2)), response_shape=[1.0, -0.5])
    absorbers = {
        "none": None,
        "impacts": ABSORBERS["impacts"],
        "heavy": HEAVY["impacts, gravity"],
        "springs": ABSORBERS["springs"],
    }
    return scenes | {
        f"{name}, level elsewhere": Scene(model, own) for name, own in absorbers.items()
    }


def drives(of: Scene) -> tuple[Excitation, ...]:
    """Return a force, the same as a load, and a base that moves."""
    force = drive(of)
    base = Samples(force.schedule.times[[0, -1]], np.array([1.0, 1.0]), BASE_QUANTITY)
    loads = ((force,), (force, base))
    return force, *(Loads(parts, force.schedule.reference) for parts in loads)


def refusal(of: Scene, load: Excitation, method: Method) -> str | None:
    """Return the name of the argument that a run is refused for, None if it is made."""
    try:
        simulate(of, load, method)
    except ParameterError as error:
        return error.name
    return None


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_each_pair_is_in_the_table_or_refused_and_has_one_key_exactly_where_it_shares_kernels(
    method: Method, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each pair of scene and method is in the table or refused, with one key for each kernel.

    Runs have the same key exactly if they share kernels. The types of a lane's arguments are those
    by which numba finds the compiled variant. Nothing is compiled here.
    """
    calls: list[tuple[object, ...]] = []
    keys = []

    def record_call(name: str, *arguments: Any) -> int:
        calls.append((name, *map(numba.typeof, arguments)))
        return DONE

    for pair, own in CAPABILITIES.items():
        if (solver := own.solver) is not None:
            recorded = replace(solver, lane=partial(record_call, solver.name))
            monkeypatch.setitem(CAPABILITIES, pair, replace(own, solver=recorded))
    for name, present in every_scene().items():
        if CAPABILITIES[present.kind, type(method)].solver is None:
            with pytest.raises(ParameterError, match=r"(method|gravity) = .* is not allowed"):
                simulate(present, drive(present), method)
            continue
        for load in drives(present):
            refused = refusal(present, load, method)
            if refused is not None:
                assert refused in {"gravity", "loads", "method"}
                assert name not in ABSORBERS or isinstance(load, Loads)
                continue
            assert CAPABILITIES[present.kind, type(method)].solver is find_solver(present, method)
            assert (find_solver(present, method).lanes is None) == (
                present.kind is SceneKind.SEVERAL
            )
            keys.append((kernel_key(present, method, load), calls[-1]))
    assert len(calls) == len(keys) > 15
    for (key, call), (other_key, other_call) in itertools.combinations(keys, 2):
        assert (key == other_key) == (call == other_call), (key, other_key)
    assert len({key for key, _ in keys}) == MOST_KERNELS[type(method)]


def test_every_kind_of_scene_is_in_the_table_and_linear_ones_go_with_the_force() -> None:
    assert (
        {scene(name).kind for name in ABSORBERS}
        == set(SceneKind)
        == {kind for kind, _ in CAPABILITIES}
    )
    for name in ABSORBERS:
        present = scene(name)
        method = RungeKutta() if present.kind is SceneKind.SMOOTH else Exact()
        sizes = [
            np.std(run(present, drive(present, force, 30.0), method).history.tip_displacement)
            for force in (1.0, 10.0)
        ]
        goes_with_force = sizes[1] == pytest.approx(10 * sizes[0], rel=1e-6)
        assert goes_with_force == (present.kind is SceneKind.LINEAR), name


def test_control_of_what_it_cannot_do_is_refused() -> None:
    with pytest.raises(ParameterError, match="one absorber"):
        ControlledRuns(scene("several"), 1, 250.0, 1.0, samples_per_period=16)
    with pytest.raises(ParameterError, match="elastic friction"):
        ControlledRuns(
            scene("springs and elastic friction"),
            1,
            250.0,
            1.0,
            RungeKutta(),
            samples_per_period=16,
        )


def test_an_absorber_in_the_beam_s_place_and_a_gap_in_mm_are_noticed() -> None:
    with pytest.raises(ParameterError, match=r"^beam = .* absorber is given as absorber=\.\.\."):
        beam_scene(impact_absorber())
    with pytest.warns(UserWarning, match=r"gap = 1 m is wide for a beam of 0\.5 m: gaps are in m"):
        beam_scene(absorber=impact_absorber(gap=1.0))
    pair = impact_absorbers([1e-3, 0.2], [0.7, 1.0])
    with pytest.warns(UserWarning, match=r"gap = 0\.2 m"):
        beam_scene(absorber=pair)
