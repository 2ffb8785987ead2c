"""Structures with several places for absorbers, given as matrices, agree with the same beam.

Their fatigue is tested as well.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import sweep
from design_studies import values_of
from places import EXAMPLES

from impact_env import (
    Beam,
    Drive,
    ModalModel,
    ParameterError,
    Record,
    beam_scene,
    constant_frequency,
    impact_absorber,
    impact_absorbers,
    load_structure,
    modal_model,
    simulate,
)
from impact_env.ensemble import Threads
from impact_env.loads import Loads
from impact_env.methods import Moreau
from impact_env.modes import assemble_matrices, deflection_row, mode_shapes
from impact_env.plain import from_scene, to_scene
from impact_env.plain_loads import to_loads
from optimisation.bounds import design_gap
from optimisation.insight import list_varied, neighbourhood
from optimisation.mounting import model_with_absorber_at
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem
from optimisation.search.find import SearchOptions, find
from optimisation.space import Design, design_space

BEAM = Beam(modes=2, response_position=0.6)
PLACES = (1.0, 0.8)  # nodes of the mesh
THREADS = Threads(1)


def row(position: float) -> int:
    """The row of the matrices that is the deflection at a node."""
    return int(np.argmax(deflection_row(BEAM, position)))


def write(folder: Path, **more: Any) -> Path:
    """Write the paper's beam as matrices with two places for absorbers.

    The file also has the curvature at the clamp of the first Hermite element.
    """
    mass, stiffness = assemble_matrices(BEAM)
    np.savez(folder / "beam.npz", M=mass, K=stiffness)
    strain = [
        {"row": 0, "weight": 6.0},
        {"row": 1, "weight": -2.0},
    ]  # deflection, and rotation times the element's length, of the first node
    keys = {
        "mass": "beam.npz",
        "stiffness": "beam.npz",
        "units": "kg, m, s",
        "modes": 2,
        "damping_ratio": 0.01,
        "mass_kg": BEAM.mass,
    }
    places = {
        "force": row(0.4),
        "absorber": [row(x) for x in PLACES],
        "response": row(0.6),
        "stress": strain,
    }
    path = folder / "structure.json"
    path.write_text(
        json.dumps(
            {"matrices": {k: x for k, x in {**keys, **places, **more}.items() if x is not None}}
        )
    )
    return path


@pytest.fixture
def structure(tmp_path: Path) -> ModalModel:
    return load_structure(write(tmp_path))


def problem(
    structure: Beam | ModalModel,
    concept: str = "impact",
    free: list[str] | None = None,
    **more: Any,
) -> Problem:
    options: dict[str, Any] = {"members": 2, "rate": 100.0} | more
    return Problem(design_space(concept, free), (Condition(1, 3.5),), beam=structure, **options)


@pytest.mark.parametrize("number", [1, 2])
def test_a_place_of_the_file_is_that_of_the_beam(number: int, structure: ModalModel) -> None:
    own = problem(structure, free=["gap", "position"])
    beam = problem(BEAM, free=["gap", "position"])
    design = own.space.decoded({"gap": 1.0, "position": float(number)})
    known = beam.space.decoded({"gap": 1.0, "position": PLACES[number - 1]})
    assert design.values["position"] == number
    assert design.values["gap"] == pytest.approx(
        known.values["gap"], rel=1e-9
    )  # the unit is that of the place
    model = design.scene(structure).model
    truth = known.scene(BEAM).model
    assert model.absorber_shapes is None
    np.testing.assert_allclose(np.abs(model.tip_shape), np.abs(truth.tip_shape), rtol=1e-9)
    np.testing.assert_allclose(np.abs(model.level_shape), np.abs(truth.level_shape), rtol=1e-9)
    # in a cavity so wide that no wall is touched: impacts would amplify the last digits of the
    # shapes
    wide, truth = (
        p.space.decoded({"gap": 4.0, "position": x})
        for p, x in ((own, float(number)), (beam, PLACES[number - 1]))
    )
    np.testing.assert_allclose(values_of(own, wide), values_of(beam, truth), rtol=1e-6)


def test_several_absorbers_are_at_the_chosen_places_and_the_level_where_the_file_says(
    structure: ModalModel,
) -> None:
    values = {"gap_1": 5e-4, "gap_2": 4e-4, "share": 0.5}
    own, beam = (
        problem(s, "several", ["gap_1", "gap_2", "position_2", "share"]) for s in (structure, BEAM)
    )
    responses, known = (
        Design("several", {**p.space.default.values, **values, "position_2": x})
        for p, x in ((own, 2.0), (beam, 0.8))
    )
    scene = responses.scene(structure)
    assert scene.model.response_shape is None
    np.testing.assert_allclose(
        np.abs(scene.model.tip_shape), np.abs(modal_model(BEAM).level_shape), rtol=1e-9
    )
    for k, position in enumerate(PLACES):
        at = np.abs(modal_model(replace(BEAM, absorber_position=position)).tip_shape)
        np.testing.assert_allclose(np.abs(scene.absorber_shapes[k]), at, rtol=1e-9)
    np.testing.assert_allclose(
        values_of(own, responses), values_of(beam, known), rtol=1e-3
    )  # impacts amplify rounding


def test_one_absorber_is_at_the_first_place_and_not_where_the_level_is_read(
    structure: ModalModel, tmp_path: Path
) -> None:
    own = beam_scene(structure, impact_absorber())
    np.testing.assert_allclose(
        np.abs(own.absorber_shapes[0]), np.abs(modal_model(BEAM).tip_shape), rtol=1e-9
    )
    np.testing.assert_allclose(
        np.abs(own.model.level_shape), np.abs(modal_model(BEAM).level_shape), rtol=1e-9
    )
    assert design_gap(model_with_absorber_at(structure), 0.01, 3.5) == pytest.approx(
        design_gap(model_with_absorber_at(BEAM), 0.01, 3.5), rel=1e-9
    )
    again = to_scene(from_scene(beam_scene(structure, impact_absorbers((1e-3, 5e-4), PLACES))))
    np.testing.assert_array_equal(again.model.absorber_shapes, structure.absorber_shapes)
    np.testing.assert_array_equal(again.model.tip_shape, structure.response_shape)
    result = sweep(
        "--structure", str(write(tmp_path)), "--rate", "100", "--json", str(tmp_path / "run.json")
    )
    assert result.exit_code == 0, result.output
    model = json.loads((tmp_path / "run.json").read_text())["scene"]["model"]
    np.testing.assert_array_equal(model["tip_shape_per_sqrt_kg"], structure.tip_shape)


def test_an_environment_has_its_absorber_at_the_first_place(
    structure: ModalModel, tmp_path: Path
) -> None:
    pytest.importorskip("gymnasium")
    from impact_env.envs.settings import TaskSettings

    model = TaskSettings(
        structure=str(write(tmp_path)), absorber_options={"mass_ratio": 0.01}
    ).scene.model
    np.testing.assert_array_equal(model.level_shape, structure.level_shape)
    np.testing.assert_array_equal(model.tip_shape, structure.places[0])
    assert model.absorber_shapes is None


def test_damage_of_the_files_strain_is_that_of_the_moment_at_the_clamp(
    structure: ModalModel,
) -> None:
    objective = (Objective("damage"),)
    own, beam = (problem(s, objectives=objective) for s in (structure, BEAM))
    F, G = (
        p.evaluate(
            [list((p.space.coordinates(p.space.default) | {"gap": 4.0}).values())], executor=THREADS
        ).F
        for p in (own, beam)
    )
    # no wall is touched, since impacts amplify rounding; relative to no absorber: the strain's unit
    # and scale do not matter
    np.testing.assert_allclose(F, G, rtol=1e-6)
    assert F[0, 0] > 0


def test_strain_of_a_universal_file_is_a_weighted_sum_of_its_shapes(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    (tmp_path / "measured.uff").write_bytes((EXAMPLES / "measured.uff").read_bytes())
    at = {"direction": "z"}
    places = [{"node": 5, **at}, {"node": 3, **at}]
    keys = {"file": "measured.uff", "force": {"node": 2, **at}, "absorber": places, "mass_kg": 2.0}
    path = tmp_path / "structure.json"
    path.write_text(
        json.dumps(
            {
                "universal": {
                    **keys,
                    "stress": [{"node": 3, **at, "weight": 2.0}, {"node": 5, **at, "weight": -1.0}],
                }
            }
        )
    )
    model = load_structure(path)
    np.testing.assert_allclose(
        model.stress_shape, 2 * model.places[1] - model.places[0], rtol=1e-12
    )


@pytest.mark.parametrize("sampler", ["cma", "gp"])
def test_a_search_chooses_among_the_places(sampler: str, structure: ModalModel) -> None:
    pytest.importorskip("optuna")
    own = problem(structure, free=["gap", "position"], members=1)
    findings = find(
        own, SearchOptions(10, sampler, seed=1, from_scratch=True, audit=0), None, THREADS
    )
    assert {e.design.values["position"] for e in findings.evaluated} == {1.0, 2.0}
    assert findings.verdict.winner.design.values["position"] in (1.0, 2.0)
    assert all("gap" in line for line in own.space.at_bounds(findings.verdict.winner.design))


def test_a_choice_has_equal_shares_and_no_neighbourhood(structure: ModalModel) -> None:
    own = problem(structure, free=["gap", "position"])
    (position,) = (v for v in own.space.free if v.name == "position")
    assert [position.value_at(x) for x in (0.0, 0.49, 0.5, 1.0)] == [1, 1, 2, 2]
    assert [position.value_at(position.share_of(x)) for x in (1.0, 2.0)] == [1, 2]
    assert [v.name for v in list_varied(own.space)] == ["gap"]
    assert neighbourhood(own.space, own.space.default)[0].shape == (1,)
    assert problem(structure, free=["gap"]).space.default.values["position"] == 1
    fixed = Problem(
        design_space("impact", ["gap"], fixed={"position": 2}),
        (Condition(1, 3.5),),
        beam=structure,
        rate=100.0,
    )
    np.testing.assert_array_equal(
        fixed.space.default.scene(structure).model.tip_shape, structure.places[1]
    )


PINNED: dict[str, Any] = {
    "beam": {
        "ends": "pinned-pinned",
        "modes": 3,
        "length_m": 1.0,
        "bending_stiffness_n_m2": 100.0,
        "mass_per_length_kg_m": 2.0,
        "damping_ratio": 0.02,
        "absorber_position": 0.5,
        "response_position": 0.35,
    },
    "places": {"left": 0.25, "middle": 0.5},
    "force": [
        {"place": "left", "amplitude_n": 2.0},
        {"place": 0.7, "amplitude_n": 1.0, "phase_rad": 1.0},
    ],
}
MODEL: dict[str, Any] = {
    "model": {
        "omega_rad_s": [10.0, 20.0],
        "damping_ratio": [0.01, 0.01],
        "force_shape_per_sqrt_kg": [1.0, 1.0],
        "tip_shape_per_sqrt_kg": [1.0, 2.0],
        "beam_mass_kg": 1.0,
        "absorber_shapes_per_sqrt_kg": [[1.0, 2.0], [1.0, -1.0]],
    },
    "places": {"root": 2},
}
MODE = np.arange(1, 4)


def pinned_shapes(position: float) -> np.ndarray:
    """Return the mass-normalised shapes (3,) of the pinned beam of 2 kg.

    They are closed forms, up to their signs.
    """
    return np.sin(MODE * np.pi * position)


def test_forces_at_places_of_a_beam_are_those_of_the_closed_form(tmp_path: Path) -> None:
    """The stationary level of a sweep, whose force is the first of the file unless one is given."""
    omega = (MODE * np.pi) ** 2 * np.sqrt(100.0 / 2.0)
    pattern = 2.0 * pinned_shapes(0.25) + np.exp(1j) * pinned_shapes(0.7)
    modal = pattern / (omega**2 - omega[0] ** 2 + 0.04j * omega * omega[0])
    level = abs(modal @ pinned_shapes(0.35)) / np.sqrt(2)
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(PINNED))
    constant = ["--from", 1, "--to", 1, "--periods", 25, "--start", "steady"]
    for force, factor in (([], 1.0), (["--force", 3.0], 1.5)):
        target = tmp_path / "a.json"
        result = sweep("--scene", file, *constant, *force, "--json", target)
        assert result.exit_code == 0, result.output
        level_of_run = json.loads(target.read_text())["response_level_m"][0]
        assert level_of_run == pytest.approx(factor * level, rel=6e-3)


def test_absorbers_are_placed_by_name_and_number() -> None:
    several = {"kind": "several", "absorbers": [{"place": "middle"}, {"place": 0.3}]}
    scene = to_scene(PINNED | {"absorber": several})
    wanted = [pinned_shapes(0.5), pinned_shapes(0.3)]
    np.testing.assert_allclose(np.abs(scene.absorber_shapes), np.abs(wanted), atol=2e-5)
    written = to_scene(from_scene(scene))
    np.testing.assert_array_equal(written.model.force_pattern, scene.model.force_pattern)
    np.testing.assert_array_equal(written.absorber_shapes, scene.absorber_shapes)
    beam = {key: value for key, value in PINNED["beam"].items() if key != "absorber_position"}
    single = PINNED | {"beam": beam, "absorber": {"kind": "impact", "place": 0.25}}
    shape = to_scene(single).model.tip_shape
    np.testing.assert_allclose(np.abs(shape), np.abs(pinned_shapes(0.25)), atol=2e-5)
    placed = to_scene(MODEL | {"absorber": {"kind": "impact", "place": "root"}})
    np.testing.assert_array_equal(placed.model.tip_shape, [1.0, -1.0])
    np.testing.assert_array_equal(placed.model.level_shape, [1.0, 2.0])


def test_places_of_matrices_are_rows_or_names(tmp_path: Path) -> None:
    """Places of matrices are rows or names.

    Forces act on two rows, and the absorbers are in another order than in the list of the
    structure. Signs of modes are arbitrary.
    """
    path = write(tmp_path, force=None, absorber=["end", "inside"])
    plain = json.loads(path.read_text())
    plain["places"] = {"end": row(1.0), "inside": row(0.8)}
    plain["force"] = [
        {"place": row(0.4), "amplitude_n": 1.0},
        {"place": "inside", "amplitude_n": 0.5, "phase_rad": 2.0},
    ]
    members = [{"place": "inside"}, {"place": 1}]
    scene = to_scene(plain | {"absorber": {"kind": "several", "absorbers": members}}, tmp_path)
    beam = mode_shapes(BEAM, [0.4, 0.8, 1.0])
    model = scene.model
    force = model.force_pattern * model.absorber_shapes[1]  # free of the modes' signs
    wanted = (beam[0] + 0.5 * np.exp(2j) * beam[1]) * beam[2]
    np.testing.assert_allclose(force, wanted, rtol=1e-9)
    np.testing.assert_allclose(np.abs(model.absorber_shapes), np.abs(beam[[1, 2]]), rtol=1e-9)
    structure = {key: plain[key] for key in ("matrices", "places", "force")}
    path.write_text(json.dumps(structure))
    loaded = load_structure(path)
    np.testing.assert_array_equal(loaded.force_pattern, model.force_pattern)


ONE = {"place": 0.2, "amplitude_n": 1.0}
OPPOSITE = [{"place": 1, "amplitude_n": 1.0}, {"place": 2, "amplitude_n": 1.0, "phase_rad": np.pi}]


@pytest.mark.parametrize(
    ("base", "changes", "message"),
    [
        (PINNED, {"force": [ONE, ONE]}, r"force\[1\].place = 0.2 is not allowed: each place once"),
        (PINNED, {"force": [{**ONE, "place": "tip"}]}, "one of the names in places: left, middle"),
        (PINNED, {"force": []}, "a list of tables with the keys place, amplitude_n and phase_rad"),
        (PINNED, {"force": ONE}, "a list of tables with the keys place, amplitude_n"),
        (PINNED, {"force": [{"place": 0.2}]}, "the key amplitude_n must be given"),
        (PINNED, {"force": [{**ONE, "place": 1.5}]}, r"force\[0\].place = 1.5"),
        (PINNED, {"force": [{**ONE, "amplitude_n": -1.0}]}, r"force\[0\].amplitude_n = -1.0"),
        (PINNED, {"places": 3}, "scene.places = 3 is not allowed: a table of names and places"),
        (PINNED, {"beam": {"force_position": 0.3}}, "left out beside force"),
        (
            PINNED,
            {"absorber": {"kind": "several", "absorbers": [{"place": 0.3}, {"position": 0.4}]}},
            "a place for each of them, or for none",
        ),
        (MODEL, {"absorber": {"kind": "impact", "place": 3}}, "position = 3"),
        (MODEL, {"absorber": {"kind": "impact", "place": "tip"}}, "one of the names in places"),
        (
            MODEL,
            {"absorber": {"kind": "several", "absorbers": [{"place": 1}, {"place": 1}]}},
            r"place \[1\] twice",
        ),
        (MODEL, {"force": [{"place": 3, "amplitude_n": 1.0}]}, r"force\[0\].place = 3"),
        (
            MODEL | {"model": MODEL["model"] | {"absorber_shapes_per_sqrt_kg": [[1.0, 2.0]] * 2}},
            {"force": OPPOSITE},
            "forces that do not cancel on all modes kept",
        ),
    ],
)
def test_places_that_do_not_fit_are_one_error(
    base: dict[str, Any], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        to_scene(base | changes)


PLACED = [{"place": "middle", "amplitude_n": 1.0}, {"place": 0.9, "amplitude_n": 3.0}]


def place_records(folder: Path, *places: object, rows: int = 6) -> dict[str, Any]:
    """Return loads with a record of its own for each place, in files."""
    loads = []
    for k, place in enumerate(places):
        lines = [f"{0.002 * i},{(-1) ** (i // 2) * (i + k + 1)}" for i in range(rows + k % 2)]
        (folder / f"{k}.csv").write_text("\n".join(["time (s),force (N)", *lines]))
        loads.append({"kind": "samples", "file": f"{k}.csv", "place": place})
    return {"load": loads}


def test_a_file_of_loads_has_a_record_for_each_place(tmp_path: Path) -> None:
    """The beam alone under both records is the sum of the beam under each at its place."""
    beam = {"modes": 2, "damping_ratio": 0.1}
    scene = to_scene({"beam": beam, "places": {"middle": 0.55}, "force": PLACED})
    plain = place_records(tmp_path, "middle", "x", 0.9)
    loads = to_loads({"load": [plain["load"][0], plain["load"][2]]}, 252.0, tmp_path)
    assert loads.force_places == ("middle", "0.9")
    record = Record(level=False, series=True)
    both = simulate(scene, loads, record=record).history.modal_displacement
    total = 0.0
    for position, part in zip((0.55, 0.9), loads.parts, strict=True):
        single = beam_scene(Beam(modes=2, damping_ratio=0.1, force_position=position))
        alone = Loads((replace(part, force_place=None),), 252.0)
        total = total + simulate(single, alone, record=record).history.modal_displacement
    np.testing.assert_allclose(both, total, atol=1e-13 * np.max(np.abs(total)))
    again = to_scene(from_scene(scene))
    np.testing.assert_array_equal(again.model.force_places, scene.model.force_places)
    assert again.model.force_place_names == ("middle", "0.9")


@pytest.mark.parametrize(
    ("places", "message"),
    [
        (("middle", "root"), r"^duration = \[0.01, 0.012\] is not allowed: the same for all loads"),
        (("middle", "x", "middle"), "^place = 'middle' is not allowed: the place of one record"),
        (("nowhere",), "^place = 'nowhere' is not allowed: .* structure's forces: middle, 0.9"),
        ((True,), r"^load\[0\].place = True is not allowed: a place, as the scene's table force"),
    ],
)
def test_records_of_places_that_do_not_fit_are_one_error(
    tmp_path: Path, places: tuple[object, ...], message: str
) -> None:
    scene = to_scene({"beam": {"modes": 2}, "places": {"middle": 0.55}, "force": PLACED})
    plain = place_records(tmp_path, *places)
    plain["load"] = plain["load"][:: max(1, len(places) - 1)]
    with pytest.raises(ParameterError, match=message):
        simulate(scene, to_loads(plain, 252.0, tmp_path))


def test_a_base_and_a_drive_by_itself_have_no_place(tmp_path: Path) -> None:
    table = {"kind": "samples", "quantity": "base_acceleration", "file": "0.csv", "place": "tip"}
    (tmp_path / "0.csv").write_text("time (s),acc (m/s^2)\n0,1\n0.1,2\n")
    with pytest.raises(ParameterError, match=r"^load.place = 'tip' .* base that moves"):
        to_loads({"load": table}, 252.0, tmp_path)
    drive = Drive(1.0, constant_frequency(252.0, 1.0, 2.0), force_place="middle")
    scene = to_scene({"beam": {"modes": 2}, "places": {"middle": 0.55}, "force": PLACED})
    with pytest.raises(ParameterError, match="one of Loads"):
        simulate(scene, drive)
    with pytest.raises(ParameterError, match=r"place = .* left out with"):
        simulate(scene, Loads((drive,)), Moreau(100))


STEP_OF_FREQUENCY = {
    "times_s": [0.0, 0.01, 0.0101, 0.02],
    "omegas_rad_s": [220.0, 220.0, 280.0, 280.0],
    "reference_rad_s": 252.0,
}
TONES = [
    {"amplitude_n": 1.0, "frequency_hz": 40.0},
    {"amplitude_n": 2.0, "frequency_hz": 90.0, "phase_rad": 0.4},
]
ORDERS = [{"amplitude_n": 1.0, "order": 1.0}, {"amplitude_n": 1.0, "order": 2.0}]


@pytest.mark.parametrize(
    "load",
    [
        {"kind": "tones", "tones": TONES, "duration_s": 0.02},
        {"kind": "tones", "orders": ORDERS, "schedule": STEP_OF_FREQUENCY},
        {"kind": "unbalance", "unbalance_kg_m": 1e-4, "schedule": STEP_OF_FREQUENCY},
    ],
    ids=["tones", "orders", "unbalance"],
)
def test_loads_at_two_places_superpose(load: dict[str, Any]) -> None:
    """Loads at two places superpose.

    The motion of the beam alone under both is the sum of runs under each. The load's own phase and
    size also change.
    """
    beam = {"modes": 2, "damping_ratio": 0.3}
    places = [
        {"place": 0.3, "amplitude_n": 1.0, "phase_rad": 0.3},
        {"place": 0.8, "amplitude_n": 0.7, "phase_rad": -1.1},
    ]

    def run(plain: dict[str, Any], acting: dict[str, Any]) -> np.ndarray:
        scene = to_scene(plain)
        loads = to_loads({"load": acting}, 252.0)
        record = Record(level=False, series=True)
        return simulate(scene, loads, record=record).history.modal_displacement @ (
            scene.model.tip_shape
        )

    def turned(part: dict[str, Any], force: dict[str, Any]) -> dict[str, Any]:
        sizes = {
            key: force["amplitude_n"] * part[key]
            for key in ("amplitude_n", "unbalance_kg_m")
            if key in part
        }
        return part | sizes | {"phase_rad": part.get("phase_rad", 0.0) + force["phase_rad"]}

    total = 0.0
    for force in places:
        acting = dict(load) if "tones" in load or "orders" in load else turned(load, force)
        for key in {"tones", "orders"} & set(load):
            acting[key] = [turned(tone, force) for tone in load[key]]
        total = total + run({"beam": beam | {"force_position": force["place"]}}, acting)
    both = run({"beam": beam, "force": places}, load)
    np.testing.assert_allclose(both, total, atol=1e-12 * np.max(np.abs(total)))
