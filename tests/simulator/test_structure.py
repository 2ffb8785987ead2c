"""Structures: beams against closed forms, matrices against dense solutions, and Universal Files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.optimize
import scipy.sparse
from core import drive_of, run
from places import EXAMPLES
from structure_files import MATRICES, chain, written

from impact_env import (
    Beam,
    ModalModel,
    ParameterError,
    Record,
    Scene,
    Section,
    beam_scene,
    impact_absorber,
    load_structure,
    modal_model,
    simulate,
)
from impact_env.beam import matrices
from impact_env.frequency import receptance, tip_response
from impact_env.plain import from_scene, to_scene
from impact_env.plain_files import read_plain
from impact_env.structures.matrices import lowest_modes

# wave numbers times the length of uniform beams, from the characteristic equations of each pair of ends
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
    beam = Beam(ends=ends, absorber_position=0.9, modes=6, elements=60, suspension_frequency=5.0 if loose else None)
    model, first = modal_model(beam), beam.rigid_motions
    wanted = np.array(ROOTS[ends]) ** 2 * np.sqrt(beam.bending_stiffness / beam.mass_per_length) / beam.length**2
    np.testing.assert_allclose(model.omega[first : first + 3], wanted, rtol=1e-6)
    np.testing.assert_allclose(model.omega[:first], 2 * np.pi * np.array([5.0, 5.5][:first]))
    if ends == "pinned-pinned":  # mass-normalised sines
        own = np.sqrt(2 / beam.mass) * np.abs(np.sin(np.pi * 0.9 * np.arange(1, 7)))
        np.testing.assert_allclose(model.tip_shape, own, rtol=1e-4)


def test_rigid_motions_carry_the_whole_mass_and_its_turn() -> None:
    beam = Beam(ends="free-free", absorber_position=1.0, force_position=0.0, suspension_frequency=1.0)
    model = modal_model(beam)
    assert np.sum(model.tip_shape[:2] ** 2) == pytest.approx(1 / beam.mass + (beam.length / 2) ** 2 / (beam.mass * beam.length**2 / 12))
    assert model.tip_shape[:2] @ model.force_shape[:2] == pytest.approx(1 / beam.mass - 3 / beam.mass)


def test_a_tip_mass_is_a_stuck_absorber() -> None:
    heavy = modal_model(Beam(tip_mass=0.2, modes=3, elements=40))
    # the free cantilever's characteristic equation with a mass on its end
    beam = Beam(elements=40)
    ratio = 0.2 / beam.mass

    def equation(x: float) -> float:
        return float(1 + np.cos(x) * np.cosh(x) + ratio * x * (np.cos(x) * np.sinh(x) - np.sin(x) * np.cosh(x)))

    root = scipy.optimize.brentq(equation, 0.5, 1.87)
    assert heavy.omega[0] == pytest.approx(root**2 * np.sqrt(beam.bending_stiffness / beam.mass_per_length) / beam.length**2, rel=1e-7)
    assert heavy.beam_mass == pytest.approx(beam.mass + 0.2)


def test_sections_of_one_kind_are_no_sections() -> None:
    plain = Beam(elements=12, modes=4)
    same = Section(5, 362.88, 1.1275), Section(7, 362.88, 1.1275)
    parted = Beam(elements=12, modes=4, bending_stiffness=1.0, mass_per_length=1.0, sections=same)
    np.testing.assert_allclose(modal_model(parted).omega, modal_model(plain).omega, rtol=1e-10)
    stepped = Beam(elements=12, modes=4, sections=(Section(6, 800.0, 2.0),))
    assert stepped.mass == pytest.approx(0.25 * 2.0 + 0.25 * 1.1275)
    mass, stiffness = matrices(stepped)
    np.testing.assert_allclose(modal_model(stepped).omega ** 2, scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[:4], rtol=1e-7)


def test_level_is_read_where_the_beam_says() -> None:
    beam = Beam(modes=4, absorber_position=0.7, response_position=0.9)
    scene, drive = beam_scene(beam, impact_absorber(restitution=0.7)), drive_of(3.5, 0.95, 1.0, periods=60)
    response = simulate(scene, drive, record=Record(series=True))
    assert response.history is not None
    assert response.level is not None
    row = modal_model(Beam(modes=4, force_position=0.9)).force_shape
    values = response.history.modal_displacement @ row
    at = int(np.argmax(np.abs(values)))
    window = values[max(at - 320, 0) : at + 321]
    assert response.level.max_tip == pytest.approx(np.max(np.abs(values)), rel=5e-3)  # a parabola through the samples
    assert response.level.value == pytest.approx(np.sqrt(np.mean(window**2)), rel=3e-3)
    assert simulate(scene, drive).level == response.level
    assert simulate(scene, drive).history is None


def test_the_paper_beam_as_modal_data_and_as_matrices_has_the_beam_impacts(tmp_path: Path) -> None:
    beam = Beam()
    drive, absorber = drive_of(3.5, 1.0, periods=40), impact_absorber(restitution=0.7)
    own = run(beam_scene(beam, absorber), drive).impacts
    assert own is not None
    (tmp_path / "modal.json").write_text(json.dumps({"model": from_scene(beam_scene(beam))["model"]}))
    mass, stiffness = matrices(beam)
    for name, matrix in (("M", mass), ("K", stiffness)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", scipy.sparse.coo_matrix(matrix), precision=17)
    keys = {"mass": "M.mtx", "stiffness": "K.mtx", "units": "kg, m, s", "force": 22, "absorber": 58, "mass_kg": beam.mass, "damping_ratio": 0.01}
    for path, exactly in ((tmp_path / "modal.json", True), (written(tmp_path, "matrices", **keys), False)):
        found = run(Scene(modal_model(load_structure(path)), absorber), drive).impacts
        assert found is not None
        if exactly:
            np.testing.assert_array_equal(found.time, own.time)
        # impacts amplify what the last digits of the matrices differ by: the first ones, before that shows
        np.testing.assert_allclose(found.time[:7], own.time[:7], rtol=0, atol=1e-9 * drive.schedule.pseudo_period)
        np.testing.assert_allclose(found.relative_velocity[:7], own.relative_velocity[:7], rtol=0, atol=1e-9)


def test_receptances_are_those_of_a_direct_solution(tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    damping = 0.8 * mass + 2e-5 * stiffness
    chain(tmp_path, C=damping)
    model = load_structure(written(tmp_path, "matrices", **MATRICES | {"damping": "m.npz", "damping_ratio": None, "response": 2}))
    assert isinstance(model, ModalModel)
    for omega in (10.0, 55.0, 101.0, 200.0):
        direct = np.linalg.inv(stiffness + 1j * omega * damping - omega**2 * mass)
        assert receptance(model, omega, model.tip_shape, model.force_shape) == pytest.approx(direct[1, 0], rel=1e-10)
        assert tip_response(model, None, omega) == pytest.approx(direct[2, 0], rel=1e-10)


def test_the_frame_answers_as_its_matrices_do() -> None:
    model = load_structure(EXAMPLES / "frame.toml")
    assert isinstance(model, ModalModel)
    mass, stiffness = (scipy.sparse.load_npz(EXAMPLES / f"frame_{name}.npz").toarray() for name in ("mass", "stiffness"))
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    assert np.allclose(np.sqrt(values[:8]), model.omega, rtol=1e-8)
    damping = mass @ vectors @ np.diag(2 * 0.01 * np.sqrt(values)) @ vectors.T @ mass
    load = np.zeros(len(mass))
    load[8] = 1.0
    for omega in model.omega[:3] * 1.002:
        direct = np.linalg.solve(stiffness + 1j * omega * damping - omega**2 * mass, load)
        assert tip_response(model, None, omega) == pytest.approx(direct[20], rel=2e-2)  # eight of 426 modes
        assert receptance(model, omega, model.tip_shape, model.force_shape) == pytest.approx(direct[138], rel=2e-2)


def test_sparse_and_dense_solutions_agree() -> None:
    size = 1500
    ones = np.ones(size)
    stiffness = 1e6 * scipy.sparse.diags([-ones[1:], 2 * ones, -ones[1:]], [-1, 0, 1])
    mass = scipy.sparse.diags(0.01 * ones)
    found = lowest_modes(mass.tocsc(), stiffness.tocsc(), 6)
    wanted = 2 * np.sqrt(1e6 / 0.01) * np.sin(np.pi * np.arange(1, 7) / (2 * (size + 1)))
    np.testing.assert_allclose(found.omega, wanted, rtol=1e-8)
    np.testing.assert_allclose(found.shapes.T @ (mass @ found.shapes), np.eye(6), atol=1e-9)
    again = lowest_modes(mass.tocsc(), stiffness.tocsc(), 6)
    np.testing.assert_array_equal(found.shapes, again.shapes)


def test_a_structure_that_is_not_held_says_what_is_possible(tmp_path: Path) -> None:
    chain(tmp_path, held=False)
    with pytest.raises(ParameterError, match=r"1 motions bend nothing.*suspension_frequency_hz"):
        load_structure(written(tmp_path, "matrices", **MATRICES))
    model = modal_model(load_structure(written(tmp_path, "matrices", **MATRICES | {"suspension_frequency_hz": 0.5})))
    assert model.omega[0] == 2 * np.pi * 0.5
    np.testing.assert_allclose(model.tip_shape[0], 1 / np.sqrt(3.0), rtol=1e-6)
    with pytest.raises(ParameterError, match=r"suspension_frequency.* = 50.0 is not allowed: below half of the first bending frequency"):
        load_structure(written(tmp_path, "matrices", **MATRICES | {"suspension_frequency_hz": 50.0}))


def test_tonnes_and_millimetres_are_the_same_structure(tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    model = modal_model(load_structure(written(tmp_path, "matrices", **MATRICES)))
    np.savez(tmp_path / "m.npz", M=mass * 1e-3, K=stiffness * 1e-3)
    other = modal_model(load_structure(written(tmp_path, "matrices", **MATRICES | {"units": "t, mm, s"})))
    np.testing.assert_allclose(other.omega, model.omega)
    np.testing.assert_allclose(other.tip_shape, model.tip_shape)


def test_a_universal_file_gives_what_a_test_measured() -> None:
    pytest.importorskip("pyuff")
    model = modal_model(load_structure(EXAMPLES / "measured.toml"))
    mode = np.arange(1, 6)
    np.testing.assert_allclose(model.omega, 2 * np.pi * 40.0 * mode**2, rtol=3e-3)
    np.testing.assert_allclose(model.damping_ratio, 0.004, rtol=0.3)
    truth = np.sin(mode * np.pi * 2 / 8) * np.sin(mode * np.pi * 5 / 8)  # twice the product of shapes over the mass: no sign is left
    np.testing.assert_allclose(model.force_shape * model.tip_shape, truth, atol=0.08)
    assert np.all(model.tip_shape >= 0)


def test_modal_mass_and_complex_modes_of_a_universal_file(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    common = {"model_type": 1, "data_ch": 2, "spec_data_type": 8, "n_data_per_node": 3, "load_case": 0, "node_nums": np.array([1, 2]), "mode_n": 1}
    still = np.zeros(2)
    scaled = pyuff.prepare_55(
        **common,
        analysis_type=2,
        data_type=2,
        freq=10.0,
        modal_m=4.0,
        modal_damp_vis=0.01,
        modal_damp_his=0.0,
        r1=still,
        r2=still,
        r3=np.array([1.0, 2.0]),
    )
    omega, ratio = 2 * np.pi * 10, 0.01
    value = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
    turned = np.array([0.5, 1.0]) * np.exp(0.9j)  # mass-normalised [0.5, 1], turned; its modal A follows
    modal_a = 2j * value.imag * np.exp(1.8j)
    turning = pyuff.prepare_55(
        **common, analysis_type=3, data_type=5, eig=value, modal_a=modal_a, modal_b=1.0, r1=still * 1j, r2=still * 1j, r3=turned
    )
    keys = {"force": {"node": 1, "direction": "z"}, "absorber": {"node": 2, "direction": "-z"}, "mass_kg": 3.0, "file": "modes.uff"}
    for dataset in (scaled, turning):
        (tmp_path / "modes.uff").unlink(missing_ok=True)
        pyuff.UFF(str(tmp_path / "modes.uff")).write_sets(dataset, "add")
        model = modal_model(load_structure(written(tmp_path, "universal", **keys)))
        np.testing.assert_allclose(np.abs(model.force_shape), 0.5, rtol=1e-4)
        np.testing.assert_allclose(model.tip_shape, 1.0, rtol=1e-4)
        assert model.force_shape[0] < 0  # the absorber's direction is turned
        np.testing.assert_allclose(model.omega, omega, rtol=1e-4)
        np.testing.assert_allclose(model.damping_ratio, 0.01, rtol=1e-4)


def test_several_absorbers_on_matrices(tmp_path: Path) -> None:
    chain(tmp_path)
    plain = read_plain(written(tmp_path, "matrices", **MATRICES | {"absorber": [1, 2], "response": 0}))
    several = {"kind": "several", "absorbers": [{"position": 0.5}, {"position": 1.0}]}
    scene = to_scene(plain | {"absorber": several}, tmp_path)
    assert scene.absorber_shapes.shape == (2, 3)
    np.testing.assert_allclose(np.abs(scene.model.tip_shape), np.abs(scene.model.force_shape))
    assert to_scene(from_scene(scene)).model.omega.tobytes() == scene.model.omega.tobytes()


def test_a_suspended_beam_runs_and_keeps_its_energy() -> None:
    beam = Beam(ends="free-free", suspension_frequency=2.0, absorber_position=1.0, force_position=0.0)
    scene = beam_scene(beam, impact_absorber(restitution=0.7, friction_limit=0.05))
    drive = drive_of(50.0, 0.97, periods=100, reference=scene.model.resonance_omega(3))
    response = run(scene, drive)
    assert response.energy is not None
    assert response.impact_count > 20
    assert response.energy.relative_error < 1e-9
