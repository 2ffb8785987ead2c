"""The command `structure`: modes and places of a file, beside closed forms, and nodes near a point."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from click.testing import CliRunner
from matplotlib.figure import Figure

from impact_env import Beam, ModalModel
from optimisation.cli.structure import main
from optimisation.report.structure_figure import save_figure

PINNED = """[beam]
length_m = 1.0
young_modulus_pa = 210e9
density_kg_m3 = 7850
section = { kind = "rectangle", width_m = 0.04, height_m = 0.01 }
ends = "pinned-pinned"
damping_ratio = 0.004
force_position = 0.5
absorber_position = 0.25
"""


def shown(*arguments: object) -> str:
    found = CliRunner().invoke(main, [str(a) for a in arguments])
    assert found.exit_code == 0, found.output
    return found.output


def test_a_beam_of_material_and_section_has_the_modes_of_the_closed_form(tmp_path: Path) -> None:
    file, target, picture = tmp_path / "beam.toml", tmp_path / "a.json", tmp_path / "a.svg"
    file.write_text(PINNED)
    output = shown(file, "--json", target, "--plot", picture)
    assert "mass 3.14 kg: an absorber of 1 % has 0.0314 kg" in output
    assert "force, absorber and response at 0.5, 0.25, 0.25 of the length, 1 m" in output
    found = json.loads(target.read_text())
    stiffness, per_length = 210e9 * 0.04 * 0.01**3 / 12, 7850 * 0.04 * 0.01
    for n, row in enumerate(found["modes"][:3], 1):
        omega = (n * np.pi) ** 2 * np.sqrt(stiffness / per_length)
        force, tip = (np.sqrt(2 / 3.14) * np.sin(n * np.pi * x) for x in (0.5, 0.25))
        assert row["frequency_hz"] == pytest.approx(omega / (2 * np.pi), rel=1e-4)
        assert abs(row["tip_shape_per_sqrt_kg"]) == pytest.approx(abs(tip), rel=1e-3)
        assert row["mass_at_absorber_kg"] == pytest.approx(1 / tip**2, rel=2e-3)
        assert row["free_amplitude_m_per_n"] == pytest.approx(abs(force * tip) / (2 * 0.004 * omega**2), rel=2e-3, abs=1e-12)
    assert picture.read_bytes().startswith(b"<?xml")


def test_rows_of_matrices_near_a_point(tmp_path: Path) -> None:
    chain = scipy.sparse.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(6, 6))
    scipy.sparse.save_npz(tmp_path / "K.npz", scipy.sparse.csr_matrix(1e4 * chain))
    scipy.sparse.save_npz(tmp_path / "M.npz", scipy.sparse.eye(6, format="csr"))
    (tmp_path / "nodes.csv").write_text("x_m,y_m,z_m\n" + "".join(f"{0.1 * (k // 2)},0,0\n" for k in range(6)))  # two rows a node
    keys = 'mass = "M.npz"\nstiffness = "K.npz"\nunits = "kg, m, s"\nforce = 1\nabsorber = 4\nmass_kg = 6\ndamping_ratio = 0.01\n'
    (tmp_path / "chain.toml").write_text(f'[matrices]\n{keys}coordinates = "nodes.csv"\n')
    assert "row 2, 3: 20 mm away\nrow 4, 5: 80 mm away\nrow 0, 1: 120 mm away" in shown(tmp_path / "chain.toml", "--near", 0.12, 0, 0)


def test_nodes_of_a_universal_file_near_a_point(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    n, zero = np.arange(11, 14), np.zeros(3)
    places = {"x": np.array([0.0, 0.5, 1.0]), "y": zero, "z": zero}
    file.write_sets({"type": 15, "node_nums": n, "def_cs": n * 0, "disp_cs": n * 0, "color": n * 0, **places}, "add")
    at = {"node_nums": n, "r1": zero, "r2": zero, "r3": np.array([0.5, 1.0, 0.5])}
    numbers = {"analysis_type": 2, "data_ch": 2, "spec_data_type": 8, "data_type": 2, "n_data_per_node": 3, "load_case": 0, "mode_n": 1}
    damping = {"modal_m": 1.0, "modal_damp_vis": 0.01, "modal_damp_his": 0.0}
    file.write_sets(pyuff.prepare_55(id1="a", model_type=1, freq=40.0, **numbers, **damping, **at), "add")
    place = '{ node = 12, direction = "z" }'
    (tmp_path / "a.toml").write_text(f'[universal]\nfile = "a.uff"\nforce = {place}\nabsorber = {place}\nmass_kg = 2\n')
    assert "node 12: 100 mm away\nnode 13: 400 mm away" in shown(tmp_path / "a.toml", "--near", 0.6, 0, 0)


@pytest.mark.same_bits
@pytest.mark.parametrize("structure", [Beam(modes=2, force_position=0.3), ModalModel([1.0, 3.0], [0.1, 0.1], [1.0, -2.0], [1.0, 2.0], 1.0)])
def test_marks_lie_at_the_places_and_on_the_shapes(structure: Beam | ModalModel, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr("optimisation.report.structure_figure.write_figure", lambda figure, _: drawn.append(figure))
    save_figure(tmp_path / "a.png", structure)
    panel = drawn[0].axes[1]
    marks = {line.get_label(): (line.get_xdata()[0], line.get_ydata()[0]) for line in panel.lines if len(line.get_xdata()) == 1}
    assert set(marks) == {"force", "absorber", "response"}
    if isinstance(structure, ModalModel):
        assert [marks[name][1] for name in ("force", "absorber", "response")] == [-2.0, 2.0, 2.0]
        return
    (curve,) = [line for line in panel.lines if len(line.get_xdata()) > 100]
    assert marks["force"][0] == 0.3
    for x, y in marks.values():
        assert np.interp(x, curve.get_xdata(), curve.get_ydata()) == pytest.approx(y, abs=1e-3)
