"""Structures: beams against closed forms, matrices against dense solutions, and Universal Files."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.optimize
import scipy.sparse
from core import EVERYTHING, drive_of, run
from load_cases import chain
from places import EXAMPLES

from impact_env import Beam, Section, StructureWarning, beam_scene, modal_model
from impact_env.checks import ParameterError
from impact_env.frequency import receptance, tip_response
from impact_env.loads import BASE_QUANTITY, Loads, Samples
from impact_env.modes import ModalModel, assemble_matrices
from impact_env.parameters import impact_absorber
from impact_env.plain import from_scene, load_structure
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.structures.checks import list_matrix_warnings
from impact_env.structures.matrices import lowest_modes
from impact_env.sweep import simulate

MATRICES = {
    "mass": "m.npz",
    "stiffness": "m.npz",
    "units": "kg, m, s",
    "force": 0,
    "absorber": 1,
    "mass_kg": 3.0,
    "modes": 3,
    "damping_ratio": 0.01,
}


def written(folder: Path, table: str, **keys: object) -> Path:
    """Write a structure of one table, as JSON, which TOML's reader shares all checks with."""
    path = folder / "structure.json"
    path.write_text(
        json.dumps({table: {key: value for key, value in keys.items() if value is not None}})
    )
    return path


# wave numbers times the length of uniform beams, from the characteristic equations of each pair of
# ends
ROOTS = {
    "clamped-free": (1.87510406871196, 4.69409113297417, 7.85475743823761),
    "clamped-pinned": (3.92660231204792, 7.06858274562873, 10.2101761228130),
    "clamped-clamped": (4.73004074486270, 7.85320462409584, 10.9956078380017),
    "pinned-pinned": (np.pi, 2 * np.pi, 3 * np.pi),
    "pinned-free": (3.92660231204792, 7.06858274562873, 10.2101761228130),
    "free-free": (4.73004074486270, 7.85320462409584, 10.9956078380017),
}


@pytest.mark.parametrize("ends", ROOTS)
def test_frequencies_of_all_ends_are_those_of_the_closed_forms(ends: str) -> None:
    loose = ends in ("pinned-free", "free-free")
    beam = Beam(
        ends=ends,
        absorber_position=0.9,
        modes=6,
        elements=60,
        suspension_frequency=5.0 if loose else None,
    )
    model = modal_model(beam)
    first = beam.rigid_motions
    wanted = (
        np.array(ROOTS[ends]) ** 2
        * np.sqrt(beam.bending_stiffness / beam.mass_per_length)
        / beam.length**2
    )
    np.testing.assert_allclose(model.omega[first : first + 3], wanted, rtol=1e-6)
    np.testing.assert_allclose(model.omega[:first], 2 * np.pi * np.array([5.0, 5.5][:first]))
    if ends == "pinned-pinned":  # mass-normalised sines
        own = np.sqrt(2 / beam.mass) * np.abs(np.sin(np.pi * 0.9 * np.arange(1, 7)))
        np.testing.assert_allclose(model.tip_shape, own, rtol=1e-4)


def test_rigid_motions_carry_the_whole_mass_and_its_turn() -> None:
    beam = Beam(
        ends="free-free", absorber_position=1.0, force_position=0.0, suspension_frequency=1.0
    )
    model = modal_model(beam)
    assert np.sum(model.tip_shape[:2] ** 2) == pytest.approx(
        1 / beam.mass + (beam.length / 2) ** 2 / (beam.mass * beam.length**2 / 12)
    )
    assert model.tip_shape[:2] @ model.force_shape[:2] == pytest.approx(
        1 / beam.mass - 3 / beam.mass
    )


def test_a_tip_mass_is_a_stuck_absorber() -> None:
    heavy = modal_model(Beam(tip_mass=0.2, modes=3, elements=40))
    # the free cantilever's characteristic equation with a mass on its end
    beam = Beam(elements=40)
    ratio = 0.2 / beam.mass

    def equation(x: float) -> float:
        return float(
            1
            + np.cos(x) * np.cosh(x)
            + ratio * x * (np.cos(x) * np.sinh(x) - np.sin(x) * np.cosh(x))
        )

    root = scipy.optimize.brentq(equation, 0.5, 1.87)
    assert heavy.omega[0] == pytest.approx(
        root**2 * np.sqrt(beam.bending_stiffness / beam.mass_per_length) / beam.length**2, rel=1e-7
    )
    assert heavy.beam_mass == pytest.approx(beam.mass + 0.2)


def test_sections_of_one_kind_are_no_sections() -> None:
    plain = Beam(elements=12, modes=4)
    same = Section(5, 362.88, 1.1275), Section(7, 362.88, 1.1275)
    parted = Beam(elements=12, modes=4, bending_stiffness=1.0, mass_per_length=1.0, sections=same)
    np.testing.assert_allclose(modal_model(parted).omega, modal_model(plain).omega, rtol=1e-10)
    stepped = Beam(elements=12, modes=4, sections=(Section(6, 800.0, 2.0),))
    assert stepped.mass == pytest.approx(0.25 * 2.0 + 0.25 * 1.1275)
    mass, stiffness = assemble_matrices(stepped)
    np.testing.assert_allclose(
        modal_model(stepped).omega ** 2,
        scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[:4],
        rtol=1e-7,
    )


def test_level_is_read_where_the_beam_says() -> None:
    beam = Beam(modes=4, absorber_position=0.7, response_position=0.9)
    scene = beam_scene(beam, impact_absorber(restitution=0.7, friction_limit=0.1))
    drive = drive_of(3.5, 0.95, 1.0, periods=60)
    response = simulate(scene, drive, record=EVERYTHING)
    row = modal_model(Beam(modes=4, force_position=0.9)).force_shape
    values = response.history.modal_displacement @ row
    at = int(np.argmax(np.abs(values)))
    window = values[max(at - 320, 0) : at + 321]
    assert response.level.max_tip == pytest.approx(
        np.max(np.abs(values)), rel=5e-3
    )  # a parabola through the samples
    assert response.level.value == pytest.approx(np.sqrt(np.mean(window**2)), rel=3e-3)
    assert simulate(scene, drive).level == response.level
    assert simulate(scene, drive).history is None


def test_the_paper_beam_as_modal_data_and_as_matrices_has_the_beam_impacts(tmp_path: Path) -> None:
    beam = Beam()
    drive = drive_of(3.5, 1.0, periods=40)
    absorber = impact_absorber(restitution=0.7)
    own = run(beam_scene(beam, absorber), drive).impacts
    (tmp_path / "modal.json").write_text(
        json.dumps({"model": from_scene(beam_scene(beam))["model"]})
    )
    mass, stiffness = assemble_matrices(beam)
    for name, matrix in (("M", mass), ("K", stiffness)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", scipy.sparse.coo_matrix(matrix), precision=17)
    keys = {
        "mass": "M.mtx",
        "stiffness": "K.mtx",
        "units": "kg, m, s",
        "force": 22,
        "absorber": 58,
        "mass_kg": beam.mass,
        "damping_ratio": 0.01,
    }
    for path, exactly in (
        (tmp_path / "modal.json", True),
        (written(tmp_path, "matrices", **keys), False),
    ):
        impacts = run(Scene(modal_model(load_structure(path)), absorber), drive).impacts
        if exactly:
            np.testing.assert_array_equal(impacts.time, own.time)
        # impacts amplify what the last digits of the matrices differ by: the first ones, before
        # that shows
        np.testing.assert_allclose(
            impacts.time[:7], own.time[:7], rtol=0, atol=1e-9 * drive.schedule.pseudo_period
        )
        np.testing.assert_allclose(
            impacts.relative_velocity[:7], own.relative_velocity[:7], rtol=0, atol=1e-9
        )


def test_receptances_are_those_of_a_direct_solution(tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    damping = 0.8 * mass + 2e-5 * stiffness
    chain(tmp_path, C=damping)
    model = load_structure(
        written(
            tmp_path,
            "matrices",
            **MATRICES | {"damping": "m.npz", "damping_ratio": None, "response": 2},
        )
    )
    for omega in (10.0, 55.0, 101.0, 200.0):
        direct = np.linalg.inv(stiffness + 1j * omega * damping - omega**2 * mass)
        assert receptance(model, omega, model.tip_shape, model.force_shape) == pytest.approx(
            direct[1, 0], rel=1e-10
        )
        assert tip_response(model, None, omega) == pytest.approx(direct[2, 0], rel=1e-10)


def test_sparse_and_dense_solutions_agree() -> None:
    size = 1500
    ones = np.ones(size)
    stiffness = 1e6 * scipy.sparse.diags([-ones[1:], 2 * ones, -ones[1:]], [-1, 0, 1])
    mass = scipy.sparse.diags(0.01 * ones)
    modes = lowest_modes(mass.tocsc(), stiffness.tocsc(), 6)
    wanted = 2 * np.sqrt(1e6 / 0.01) * np.sin(np.pi * np.arange(1, 7) / (2 * (size + 1)))
    np.testing.assert_allclose(modes.omega, wanted, rtol=1e-8)
    np.testing.assert_allclose(modes.shapes.T @ (mass @ modes.shapes), np.eye(6), atol=1e-9)
    np.testing.assert_array_equal(
        lowest_modes(mass.tocsc(), stiffness.tocsc(), 6).shapes, modes.shapes
    )


def test_a_structure_that_is_not_held_says_what_is_possible(tmp_path: Path) -> None:
    chain(tmp_path, held=False)
    with pytest.raises(ParameterError, match=r"1 motions bend nothing.*suspension_frequency_hz"):
        load_structure(written(tmp_path, "matrices", **MATRICES))
    model = modal_model(
        load_structure(written(tmp_path, "matrices", **MATRICES | {"suspension_frequency_hz": 0.5}))
    )
    assert model.omega[0] == 2 * np.pi * 0.5
    np.testing.assert_allclose(model.tip_shape[0], 1 / np.sqrt(3.0), rtol=1e-6)
    with pytest.raises(
        ParameterError,
        match=(
            r"suspension_frequency.* = 50.0 is not allowed: below half of the first bending "
            r"frequency"
        ),
    ):
        load_structure(
            written(tmp_path, "matrices", **MATRICES | {"suspension_frequency_hz": 50.0})
        )


def test_a_universal_file_gives_what_a_test_measured() -> None:
    pytest.importorskip("pyuff")
    model = modal_model(load_structure(EXAMPLES / "measured.toml"))
    mode = np.arange(1, 6)
    np.testing.assert_allclose(model.omega, 2 * np.pi * 40.0 * mode**2, rtol=3e-3)
    np.testing.assert_allclose(model.damping_ratio, 0.004, rtol=0.3)
    truth = np.sin(mode * np.pi * 2 / 8) * np.sin(
        mode * np.pi * 5 / 8
    )  # twice the product of shapes over the mass: no sign is left
    np.testing.assert_allclose(model.force_shape * model.tip_shape, truth, atol=0.08)
    assert np.all(model.tip_shape >= 0)


def test_modal_mass_and_complex_modes_of_a_universal_file(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    common = {
        "model_type": 1,
        "data_ch": 2,
        "spec_data_type": 8,
        "n_data_per_node": 3,
        "load_case": 0,
        "node_nums": np.array([1, 2]),
        "mode_n": 1,
    }
    still = np.zeros(2)
    damping = {"modal_damp_vis": 0.01, "modal_damp_his": 0.0}
    scaled = pyuff.prepare_55(
        **common,
        **damping,
        analysis_type=2,
        data_type=2,
        freq=10.0,
        modal_m=4.0,
        r1=still,
        r2=still,
        r3=np.array([1.0, 2.0]),
    )
    omega = 2 * np.pi * 10
    ratio = 0.01
    value = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
    turned = np.array([0.5, 1.0]) * np.exp(
        0.9j
    )  # mass-normalised [0.5, 1], turned; its modal A follows
    modal_a = 2j * value.imag * np.exp(1.8j)
    turning = pyuff.prepare_55(
        **common,
        analysis_type=3,
        data_type=5,
        eig=value,
        modal_a=modal_a,
        modal_b=1.0,
        r1=still * 1j,
        r2=still * 1j,
        r3=turned,
    )
    keys = {
        "force": {"node": 1, "direction": "z"},
        "absorber": {"node": 2, "direction": "-z"},
        "mass_kg": 3.0,
        "file": "modes.uff",
    }
    for dataset in (scaled, turning):
        (tmp_path / "modes.uff").unlink(missing_ok=True)
        pyuff.UFF(str(tmp_path / "modes.uff")).write_sets(dataset, "add")
        model = modal_model(load_structure(written(tmp_path, "universal", **keys)))
        np.testing.assert_allclose(np.abs(model.force_shape), 0.5, rtol=1e-4)
        np.testing.assert_allclose(model.tip_shape, 1.0, rtol=1e-4)
        assert model.force_shape[0] < 0  # the absorber's direction is turned
        np.testing.assert_allclose(model.omega, omega, rtol=1e-4)
        np.testing.assert_allclose(model.damping_ratio, 0.01, rtol=1e-4)


# Structures in files that are wrong, or that look so: one error or warning with the file and its
# key.


NAN = float("nan")
BEAM = {"length_m": 0.5, "bending_stiffness_n_m2": 362.88, "mass_per_length_kg_m": 1.1275}
STEEL = dict.fromkeys(BEAM) | {"length_m": 1.2, "young_modulus_pa": 210e9, "density_kg_m3": 7850.0}
RECTANGLE = {"kind": "rectangle", "width_m": 0.04, "height_m": 0.008}
MODEL = {
    "frequencies_hz": [10.0, 50.0],
    "damping_ratio": [0.01, 0.01],
    "force_shape_per_sqrt_kg": [0.5, -0.7],
    "tip_shape_per_sqrt_kg": [1.0, 0.8],
    "beam_mass_kg": 2.0,
}
UNIVERSAL = {
    "file": "measured.uff",
    "force": {"node": 2, "direction": "z"},
    "absorber": {"node": 5, "direction": "z"},
    "mass_kg": 2.0,
}
GOOD = {"beam": BEAM, "matrices": MATRICES, "model": MODEL, "universal": UNIVERSAL}
SHARES = [
    1.0,
    0.5,
    1.0,
]  # by which a base moves the masses of the chain: the middle one, which the absorber is on, at 60 degrees to the base
WRONG = [
    ("beam", {"length": 0.5}, r"beam.length = 0.5 is not allowed: only the keys length_m"),
    ("beam", {"ends": "clamped"}, r"beam.ends = 'clamped' is not allowed: one of clamped-free"),
    ("beam", {"ends": "free-free"}, r"beam.suspension_frequency_hz = None is not allowed: given"),
    (
        "beam",
        {"ends": "pinned-pinned", "absorber_position": 0.5, "tip_mass_kg": 1.0},
        r"beam.tip_mass_kg = 1.0 is not allowed: 0 with pinned",
    ),
    (
        "beam",
        {"sections": [{"elements": 3, "bending_stiffness_n_m2": 1.0}]},
        r"beam.sections\[0\] = .*the key mass_per_length_kg_m must be given",
    ),
    (
        "beam",
        STEEL | {"section": {"kind": "L"}},
        r"beam.section.kind = 'L' is not allowed: one of rectangle, tube, I",
    ),
    (
        "beam",
        STEEL | {"section": {"kind": "tube", "diameter_m": 0.02, "wall_m": 0.02}},
        r"beam.section.*wall_m = 0.02 is not allowed: at most half",
    ),
    (
        "beam",
        STEEL | {"section": {"kind": "rectangle", "width_m": 0.02}},
        r".*height_m = 0.0 is not allowed",
    ),
    (
        "beam",
        STEEL | {"section": RECTANGLE, "mass_per_length_kg_m": 1.0},
        r".*left out beside a section",
    ),
    ("beam", STEEL, r"beam.section = None is not allowed: given"),
    (
        "matrices",
        {"units": "mm"},
        r"matrices.units = 'mm' is not allowed: one of 'kg, m, s', 't, mm, s'",
    ),
    ("matrices", {"force": 3}, r"matrices.force = 3 is not allowed: a whole number from 0 to 2"),
    ("matrices", {"absorber": [0, 7]}, r"matrices.absorber = 7"),
    (
        "matrices",
        {"mass": "none.npz"},
        r"matrices.mass = '.*none.npz' is not allowed: a matrix that can be read",
    ),
    (
        "matrices",
        {"mass": "text.mtx"},
        r"matrices.mass = '.*text.mtx' is not allowed: a matrix that can be read",
    ),
    ("matrices", {"stiffness": "large.npz"}, r"matrices.stiffness = .*3 by 3, as the mass matrix"),
    ("matrices", {"stiffness": "nan.npz"}, r"matrices.stiffness = .*finite real numbers"),
    ("matrices", {"stiffness": "negative.npz"}, r"matrices.stiffness = .*positive semidefinite"),
    (
        "matrices",
        {"damping": "coupled.npz", "damping_ratio": None},
        r"matrices.damping = 'a matrix that couples the modes . and . by",
    ),
    (
        "matrices",
        {"damping": "coupled.npz"},
        r"matrices.damping_ratio = 0.01 is not allowed: left out beside a damping matrix",
    ),
    (
        "matrices",
        {"base_vector": [1.0, 1.0]},
        r".*base_vector = '2 numbers' is not allowed: a list or a file with 3 finite numbers",
    ),
    ("matrices", {"base_vector": "nan.txt"}, r".*base_vector = .*nan.* is not allowed"),
    (
        "matrices",
        {"base_vector": SHARES, "absorber": [1, 2]},
        r".*base_vector = \[0\.5, 1\.0\] is not allowed: the same displacement at all places",
    ),
    (
        "model",
        {"frequencies_hz": [0.0, 50.0]},
        r"model.frequencies_hz = .*a motion that bends nothing has the frequency of its suspension",
    ),
    (
        "model",
        {"tip_shape_per_sqrt_kg": [1.0]},
        r"model\.tip_shape_per_sqrt_kg = \[1\.0\] .*2 numbers, one for each mode",
    ),
    (
        "universal",
        {"file": "none.uff"},
        r"universal.file = '.*none.uff' is not allowed: a Universal File that exists",
    ),
    (
        "universal",
        {"force": {"node": 99, "direction": "z"}},
        r"universal.force = 99 is not allowed: a node of measured.uff: 1, 2, 3",
    ),
]


@pytest.mark.parametrize(("table", "changes", "message"), WRONG)
def test_a_wrong_structure_is_one_error_with_file_and_key(
    tmp_path: Path, table: str, changes: dict[str, object], message: str
) -> None:
    _, stiffness = chain(tmp_path)
    for name, matrix in (
        ("large", np.eye(4)),
        ("nan", np.where(stiffness == 0, NAN, stiffness)),
        ("negative", -stiffness),
        ("coupled", np.diag([1.0, 0.0, 0.0])),
    ):
        np.savez(tmp_path / f"{name}.npz", matrix)
    for name, text in (("text.mtx", "a text\n"), ("nan.txt", "1\nnan\n1\n")):
        (tmp_path / name).write_text(text)
    if table == "universal":
        pytest.importorskip("pyuff")
        (tmp_path / "measured.uff").write_bytes((EXAMPLES / "measured.uff").read_bytes())
    with pytest.raises(ParameterError, match=r"structure.json: " + message):
        load_structure(written(tmp_path, table, **GOOD[table] | changes))


def test_an_absorber_is_no_part_of_a_structure(tmp_path: Path) -> None:
    (tmp_path / "beam.json").write_text(json.dumps({"beam": BEAM, "absorber": {"kind": "stuck"}}))
    with pytest.raises(
        ParameterError,
        match=r"absorber = .* is not allowed: left out: a structure is what an absorber is put on",
    ):
        load_structure(tmp_path / "beam.json")


SUSPECT = [
    ("model", {"tip_shape_per_sqrt_kg": [1.0, 1.0]}, "scaled to 1 and not mass-normalised"),
    ("model", {"tip_shape_per_sqrt_kg": [1e3, 8e2]}, "are the shapes mass-normalised"),
    ("model", {"damping_ratio": [1.0, 1.0]}, "was it given in percent"),
    ("model", {"frequencies_hz": [3e4, 5e4]}, "are the units right"),
    ("model", {"frequencies_hz": [10.0, 10.05]}, "modes 1 and 2 are one peak at 10 Hz"),
    ("model", {"tip_shape_per_sqrt_kg": [0.0, 0.0]}, "no mode moves the place of the absorber"),
    (
        "beam",
        {"bending_stiffness_n_m2": 362.88e6},
        "a metal bar with this bending stiffness and mass would be",
    ),  # N mm^2
]


@pytest.mark.parametrize(("table", "changes", "message"), SUSPECT)
def test_what_looks_wrong_is_a_warning_with_the_file(
    tmp_path: Path, table: str, changes: dict[str, object], message: str
) -> None:
    with pytest.warns(StructureWarning, match=f"structure.json: .*{message}"):
        load_structure(written(tmp_path, table, **GOOD[table] | changes))


def test_what_is_fine_is_no_warning(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_structure(written(tmp_path, "model", **MODEL))
        load_structure(EXAMPLES / "steel_beam.toml")
        load_structure(EXAMPLES / "frame.toml")


def test_mass_matrices_tell_a_wrong_mass_and_a_rotation() -> None:
    """Warnings about mass matrices find a wrong mass and a rotation.

    A row of ten beam elements of 0.1 m has displacements and rotations in turn, and consistent
    masses of 2 kg/m.
    """
    element = 0.1
    displaced = 2 * 156 / 420 * 2.0 * element
    turned = 2 * 4 / 420 * 2.0 * element**3
    diagonal = np.array([displaced, turned] * 10)
    assert list_matrix_warnings(diagonal, 2.0, {"force": 0, "absorber": 18}) == []
    (light,) = list_matrix_warnings(diagonal, 2e-3, {"force": 0})
    assert "mass_kg = 0.002" in light
    assert "1.486 kg" in light
    (rotation,) = list_matrix_warnings(diagonal, 2.0, {"force": 0, "absorber": 3})
    assert rotation.startswith("absorber = 3")
    assert "rotation" in rotation


@pytest.mark.parametrize(
    ("section", "area", "second"),
    [
        (RECTANGLE, 0.04 * 0.008, 0.04 * 0.008**3 / 12),
        (
            {"kind": "tube", "diameter_m": 0.02, "wall_m": 0.01},
            np.pi * 0.01**2,
            np.pi * 0.01**4 / 4,
        ),
        (
            {"kind": "I", "width_m": 0.04, "height_m": 0.06, "flange_m": 0.005, "web_m": 0.004},
            0.0006,
            3.45e-7,
        ),  # by parts, with Steiner's theorem
    ],
)
def test_a_beam_from_material_and_section(
    tmp_path: Path, section: dict[str, object], area: float, second: float
) -> None:
    beam = load_structure(written(tmp_path, "beam", **STEEL, section=section))
    assert beam.bending_stiffness == pytest.approx(210e9 * second)
    assert beam.mass_per_length == pytest.approx(7850 * area)


# Modes from a CSV file, and one damping ratio for all of them.


TABLE = (
    "frequencies_hz, force_shape_per_sqrt_kg, tip_shape_per_sqrt_kg, "
    "response_shape_per_sqrt_kg\n31.2,0.21,0.9,0.5\n74.6,0.34,-0.8,0.4\n"
)


def bracket(folder: Path, table: str = TABLE, more: str = "damping_ratio = 0.01") -> Path:
    (folder / "modes.csv").write_text(table)
    (folder / "bracket.toml").write_text(
        f'[model]\nmodes_csv = "modes.csv"\nbeam_mass_kg = 6.5\n{more}\n'
    )
    return folder / "bracket.toml"


def test_columns_are_the_rows_of_a_model(tmp_path: Path) -> None:
    structure = load_structure(bracket(tmp_path))
    np.testing.assert_allclose(structure.omega, 2 * np.pi * np.array([31.2, 74.6]), rtol=1e-15)
    np.testing.assert_array_equal(
        [structure.tip_shape, structure.level_shape, structure.damping_ratio],
        [[0.9, -0.8], [0.5, 0.4], [0.01, 0.01]],
    )
    own = load_structure(
        bracket(
            tmp_path,
            TABLE.replace("hz,", "hz, damping_ratio,")
            .replace(".2,", ".2,0.01,")
            .replace(".6,", ".6,0.02,"),
            "",
        )
    )
    np.testing.assert_array_equal(own.damping_ratio, [0.01, 0.02])


@pytest.mark.parametrize("name", ["semicolons and decimal commas", "tabs", "UTF-16", "Latin-1"])
def test_columns_are_read_as_records_are(name: str, tmp_path: Path) -> None:
    expected = load_structure(bracket(tmp_path))
    european = TABLE.replace(",", ";").replace(".", ",")
    content = {
        "semicolons and decimal commas": european.encode(),
        "tabs": TABLE.replace(",", "\t").encode(),
        "UTF-16": european.encode("utf-16"),
        "Latin-1": TABLE.replace("\n", "\r\n").encode("latin-1"),
    }[name]
    file = bracket(tmp_path)
    (tmp_path / "modes.csv").write_bytes(content)
    structure = load_structure(file)
    np.testing.assert_array_equal(structure.omega, expected.omega)
    np.testing.assert_array_equal(structure.tip_shape, expected.tip_shape)


@pytest.mark.parametrize(
    ("table", "more", "message"),
    [
        (
            TABLE.replace("0.9", "high"),
            "damping_ratio = 0.01",
            "mode 1' is not allowed: a .csv file",
        ),
        (TABLE.replace("tip", "top"), "damping_ratio = 0.01", "top_shape_per_sqrt_kg"),
        (
            TABLE,
            "damping_ratio = 0.01\nfrequencies_hz = [1, 2]",
            "without the columns frequencies_hz",
        ),
        (TABLE, "", "damping_ratio must be given"),
    ],
)
def test_a_wrong_file_is_one_error(tmp_path: Path, table: str, more: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        load_structure(bracket(tmp_path, table, more))


# Structures from matrices on a base that moves: static sag under a constant acceleration, and an
# absorber that stays behind.


ACCELERATION = 3.0
SECONDS = 4.0


def read(folder: Path, base_vector: Any, **more: Any) -> ModalModel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_structure(
            written(
                folder,
                "matrices",
                **MATRICES | {"damping_ratio": 0.1, "base_vector": base_vector} | more,
            )
        )


def pushed(model: ModalModel, gap: float | None = None) -> tuple[float, float]:
    """Return the positions of structure and absorber after `SECONDS` of acceleration of the base.

    The positions are those at the absorber's place, and the acceleration is constant. The
    absorber's position is divided by the square of the time.
    """
    load = Loads(
        (Samples(np.array([0.0, SECONDS]), np.full(2, ACCELERATION), BASE_QUANTITY),),
        float(model.omega[0]),
    )
    scene = Scene(model, None if gap is None else impact_absorber(gap, 0.7, 0.0, 0.02))
    history = simulate(scene, load, record=Record(series=True)).history
    late = history.time[-1] if gap is not None else 0.0
    return float(history.tip_displacement[-1]), float(
        history.absorber_displacement[-1] / late**2
    ) if gap is not None else 0.0


@pytest.mark.parametrize("form", ["list", "file", "units"])
def test_a_constant_acceleration_bends_as_a_weight_does(form: str, tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    np.savetxt(tmp_path / "r.txt", SHARES)
    more = {}
    if form == "units":  # t, mm, s: N/mm and t are thousandths of N/m and kg
        np.savez(tmp_path / "t.npz", M=mass / 1e3, K=stiffness / 1e3)
        more = {"mass": "t.npz", "stiffness": "t.npz", "units": "t, mm, s"}
    model = read(tmp_path, "r.txt" if form == "file" else SHARES, **more)
    assert np.sum(model.base_participation**2) == pytest.approx(
        np.array(SHARES) @ mass @ SHARES
    )  # all modes are kept
    assert model.base_at_absorber == 0.5
    sag = -ACCELERATION * np.linalg.solve(stiffness, mass @ SHARES)[1]
    assert pushed(model)[0] == pytest.approx(sag, rel=1e-6)


def test_a_free_absorber_stays_behind_by_its_share(tmp_path: Path) -> None:
    chain(tmp_path)
    assert pushed(read(tmp_path, SHARES), gap=100.0)[1] == pytest.approx(
        -0.5 * ACCELERATION / 2, rel=1e-9
    )
