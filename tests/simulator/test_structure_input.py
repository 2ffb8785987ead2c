"""Structures in files that are wrong, or that look so: one error or warning with the file and its key."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from places import EXAMPLES
from structure_files import BEAM, MATRICES, chain, written

from impact_env import Beam, ParameterError, StructureWarning, load_structure
from impact_env.structures.checks import warnings_of_matrix

WRONG_BEAM = [
    ("length = 0.5", r"beam.length = 0.5 is not allowed: only the keys length_m"),
    ("ends = 'clamped'", r"beam.ends = 'clamped' is not allowed: one of clamped-free"),
    ("ends = 'free-free'", r"beam.suspension_frequency_hz = None is not allowed: given"),
    ("tip_mass_kg = nan", r"beam.tip_mass_kg = nan"),
    ("ends = 'pinned-pinned'\nabsorber_position = 0.5\ntip_mass_kg = 1.0", r"beam.tip_mass_kg = 1.0 is not allowed: 0 with pinned-pinned ends"),
    ("sections = 3", r"beam.sections = 3 is not allowed: a list of tables"),
    ("sections = [{ elements = 3, bending_stiffness_n_m2 = 1.0 }]", r"beam.sections\[0\] = .*the key mass_per_length_kg_m must be given"),
    ("response_position = 2.0", r"beam.response_position = 2.0"),
    ("[absorber]\nkind = 'stuck'", r"absorber = .* is not allowed: left out: a structure is what an absorber is put on"),
    ("[model]", r"beam = .* is not allowed: left out beside another structure"),
]


@pytest.mark.parametrize(("text", "message"), WRONG_BEAM)
def test_a_wrong_beam_is_one_error_with_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "beam.toml"
    path.write_text(BEAM + text + "\n")
    with pytest.raises(ParameterError, match=r"beam.toml: " + message):
        load_structure(path)


def test_a_structure_must_be_said(tmp_path: Path) -> None:
    path = tmp_path / "beam.toml"
    for text, message in (
        ("", "a file with one of the tables"),
        ("[beam]\nlength_m = 1.0\n", "the keys bending_stiffness_n_m2, mass_per_length_kg_m must"),
    ):
        path.write_text(text)
        with pytest.raises(ParameterError, match=f"beam.toml.*{message}"):
            load_structure(path)


NAN = float("nan")
WRONG_MATRICES = [
    ({"units": None}, r"matrices = .*the key units must be given"),
    ({"units": "mm"}, r"matrices.units = 'mm' is not allowed: one of 'kg, m, s', 't, mm, s'"),
    ({"force": 3}, r"matrices.force = 3 is not allowed: a whole number from 0 to 2"),
    ({"absorber": [0, 7]}, r"matrices.absorber = 7"),
    ({"mass": "none.npz"}, r"matrices.mass = '.*none.npz' is not allowed: a matrix that can be read"),
    ({"mass": "m.txt"}, r"matrices.mass = '.*m.txt' is not allowed: a file that ends in .npz or .mtx"),
    ({"mass": "text.npz"}, r"matrices.mass = '.*text.npz' is not allowed: a matrix that can be read"),
    ({"mass": "text.mtx"}, r"matrices.mass = '.*text.mtx' is not allowed: a matrix that can be read"),
    ({"mass": "other.npz"}, r"matrices.mass = .* is not allowed: a matrix that can be read \(it has a, b, and no M\)"),
    ({"stiffness": "large.npz"}, r"matrices.stiffness = .*3 by 3, as the mass matrix"),
    ({"stiffness": "row.npz"}, r"matrices.stiffness = .*3 by 3, as the mass matrix"),
    ({"stiffness": "nan.npz"}, r"matrices.stiffness = .*finite real numbers"),
    ({"stiffness": "skew.npz"}, r"matrices.stiffness = .*a symmetric matrix"),
    ({"stiffness": "negative.npz"}, r"matrices.stiffness = .*positive semidefinite"),
    (
        {"damping": "coupled.npz", "damping_ratio": None},
        r"matrices.damping = 'a matrix that couples the modes . and . by.*modal or proportional",
    ),
    ({"damping": "coupled.npz"}, r"matrices.damping_ratio = 0.01 is not allowed: left out beside a damping matrix"),
    ({"damping_ratio": None}, r"matrices.damping_ratio = None is not allowed: given"),
    ({"damping_ratio": [0.1, 0.1]}, r"matrices.damping_ratio = .*one number, or one for each of the 3 modes"),
    ({"damping_ratio": -0.1}, r"matrices.damping_ratio = -0.1"),
    ({"mass_kg": 0}, r"matrices.*mass"),
    ({"modes": 0}, r"matrices.modes = 0"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG_MATRICES)
def test_wrong_matrices_are_one_error_with_file_and_key(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    mass, stiffness = chain(tmp_path)
    for name, matrix in (
        ("large", np.eye(4)),
        ("row", np.ones(3)),
        ("nan", np.where(stiffness == 0, NAN, stiffness)),
        ("skew", stiffness + np.triu(stiffness)),
        ("negative", -stiffness),
        ("coupled", np.diag([1.0, 0.0, 0.0])),
    ):
        np.savez(tmp_path / f"{name}.npz", matrix)
    np.savez(tmp_path / "other.npz", a=mass, b=mass)
    for name in ("text.npz", "text.mtx", "m.txt"):
        (tmp_path / name).write_text("a text\n")
    with pytest.raises(ParameterError, match=r"structure.json: " + message):
        load_structure(written(tmp_path, "matrices", **MATRICES | changes))


MODEL = {
    "frequencies_hz": [10.0, 50.0],
    "damping_ratio": [0.01, 0.01],
    "force_shape_per_sqrt_kg": [0.5, -0.7],
    "tip_shape_per_sqrt_kg": [1.0, 0.8],
    "beam_mass_kg": 2.0,
}
WRONG_MODELS = [
    ({"frequencies_hz": [0.0, 50.0]}, r"model.frequencies_hz = .*a motion that bends nothing has the frequency of its suspension"),
    ({"omega_rad_s": [1.0, 2.0]}, r"model.frequencies_hz = .* is not allowed: left out beside omega_rad_s"),
    ({"frequencies_hz": None}, r"model.omega_rad_s = None"),
    ({"tip_shape_per_sqrt_kg": [1.0]}, r"model: modal model = .*arrays of one length"),
    ({"force_shape": [1.0, 1.0]}, r"model.force_shape = .*only the keys"),
    ({"response_shape_per_sqrt_kg": [1.0, NAN]}, r"model.response_shape_per_sqrt_kg\[1\] = nan"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG_MODELS)
def test_wrong_modal_data_are_one_error_with_file_and_key(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=r"structure.json: " + message):
        load_structure(written(tmp_path, "model", **MODEL | changes))


SUSPECT = [
    ({"tip_shape_per_sqrt_kg": [1.0, 1.0]}, "scaled to 1 and not mass-normalised"),
    ({"tip_shape_per_sqrt_kg": [1e3, 8e2]}, "are the shapes mass-normalised"),
    ({"damping_ratio": [1.0, 1.0]}, "was it given in percent"),
    ({"frequencies_hz": [3e4, 5e4]}, "are the units right"),
    ({"frequencies_hz": [10.0, 10.05]}, "modes 1 and 2 are one peak at 10 Hz"),
    ({"tip_shape_per_sqrt_kg": [0.0, 0.0]}, "no mode moves the place of the absorber"),
]


@pytest.mark.parametrize(("changes", "message"), SUSPECT)
def test_what_looks_wrong_is_a_warning_with_the_file(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.warns(StructureWarning, match=f"structure.json: .*{message}"):
        load_structure(written(tmp_path, "model", **MODEL | changes))


def test_what_is_fine_is_no_warning_and_a_wrong_bar_is(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_structure(written(tmp_path, "model", **MODEL))
        load_structure(EXAMPLES / "steel_beam.toml")
        load_structure(EXAMPLES / "frame.toml")
    (tmp_path / "beam.toml").write_text(BEAM.replace("362.88", "362.88e6"))  # N mm^2
    with pytest.warns(StructureWarning, match="a metal bar with this bending stiffness and mass would be"):
        load_structure(tmp_path / "beam.toml")


WRONG_UNIVERSAL = [
    ({"file": "none.uff"}, r"universal.file = '.*none.uff' is not allowed: a Universal File that exists"),
    ({"file": "text.uff"}, r"universal.file = '.*text.uff' is not allowed"),
    ({"force": 3}, r"universal.force = 3 is not allowed: a table"),
    ({"force": {"node": 99, "direction": "z"}}, r"universal.force = 99 is not allowed: a node of measured.uff: 1, 2, 3"),
    ({"force": {"node": 1, "direction": "w"}}, r"universal.force.direction = 'w' is not allowed: one of x, y, z"),
    ({"modes": 9}, r"universal.modes = 9 is not allowed: a whole number from 1 to 5"),
    ({"mass_kg": None}, r"universal = .*the key mass_kg must be given"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG_UNIVERSAL)
def test_a_wrong_universal_file_is_one_error_with_file_and_key(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    pytest.importorskip("pyuff")
    (tmp_path / "measured.uff").write_bytes((EXAMPLES / "measured.uff").read_bytes())
    (tmp_path / "text.uff").write_text("a text\n")
    keys = {"file": "measured.uff", "force": {"node": 2, "direction": "z"}, "absorber": {"node": 5, "direction": "z"}, "mass_kg": 2.0}
    with pytest.raises(ParameterError, match=r"structure.json: " + message):
        load_structure(written(tmp_path, "universal", **keys | changes))


def test_mass_matrices_tell_a_wrong_mass_and_a_rotation() -> None:
    """A row of ten beam elements of 0.1 m: displacements and rotations in turn, consistent masses of 2 kg/m."""
    element = 0.1
    displaced, turned = 2 * 156 / 420 * 2.0 * element, 2 * 4 / 420 * 2.0 * element**3
    diagonal = np.array([displaced, turned] * 10)
    assert warnings_of_matrix(diagonal, 2.0, {"force": 0, "absorber": 18}) == []
    (light,) = warnings_of_matrix(diagonal, 2e-3, {"force": 0})
    assert "mass_kg = 0.002" in light
    assert "1.486 kg" in light
    (rotation,) = warnings_of_matrix(diagonal, 2.0, {"force": 0, "absorber": 3})
    assert rotation.startswith("absorber = 3")
    assert "rotation" in rotation


@pytest.mark.parametrize(
    ("section", "area", "second"),
    [
        ('kind = "rectangle", width_m = 0.04, height_m = 0.008', 0.04 * 0.008, 0.04 * 0.008**3 / 12),
        ('kind = "tube", diameter_m = 0.02, wall_m = 0.01', np.pi * 0.01**2, np.pi * 0.01**4 / 4),
        ('kind = "I", width_m = 0.04, height_m = 0.06, flange_m = 0.005, web_m = 0.004', 0.0006, 3.45e-7),  # by parts, with Steiner's theorem
    ],
)
def test_a_beam_from_material_and_section(tmp_path: Path, section: str, area: float, second: float) -> None:
    path = tmp_path / "beam.toml"
    path.write_text(f"[beam]\nlength_m = 1.2\nyoung_modulus_pa = 210e9\ndensity_kg_m3 = 7850.0\nsection = {{ {section} }}\n")
    beam = load_structure(path)
    assert isinstance(beam, Beam)
    assert beam.bending_stiffness == pytest.approx(210e9 * second)
    assert beam.mass_per_length == pytest.approx(7850 * area)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('section = { kind = "L" }', "section.kind = 'L' is not allowed: one of rectangle, tube, I"),
        ('section = { kind = "tube", diameter_m = 0.02, wall_m = 0.02 }', "wall_m = 0.02 is not allowed: at most half the diameter"),
        ('section = { kind = "rectangle", width_m = 0.02 }', "height_m = 0.0 is not allowed"),
        ('section = { kind = "rectangle", width_m = 0.02, height_m = 0.01 }\nmass_per_length_kg_m = 1.0', "left out beside a section"),
        ("", "beam.section = None is not allowed: given"),
    ],
)
def test_wrong_sections_are_one_error(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "beam.toml"
    path.write_text(f"[beam]\nlength_m = 1.2\nyoung_modulus_pa = 210e9\ndensity_kg_m3 = 7850.0\n{text}\n")
    with pytest.raises(ParameterError, match=re.escape(said)):
        load_structure(path)
