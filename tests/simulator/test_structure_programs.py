"""Modes from Nastran and Ansys files are read correctly.

The modal assurance criterion between files of one structure is tested as well.
"""

import importlib.util
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from load_cases import chain

from impact_env import modal_model
from impact_env.assurance import compare_modes, modal_assurance
from impact_env.checks import ParameterError
from impact_env.modes import ModalModel
from impact_env.plain import load_structure


def written(folder: Path, name: str, table: str, **keys: Any) -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps({table: keys}))
    return path


def loaded(path: Path) -> ModalModel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return modal_model(load_structure(path))


def same(model: ModalModel, wanted: ModalModel, tolerance: float) -> None:
    for name in ("omega", "force_shape", "tip_shape", "damping_ratio"):
        np.testing.assert_allclose(getattr(model, name), getattr(wanted, name), rtol=tolerance)


PLACES = {
    "force": {"node": 1, "direction": "z"},
    "absorber": {"node": 3, "direction": "-z"},
    "mass_kg": 3.0,
    "damping_ratio": 0.01,
}
BDF = """SOL 103
CEND
BEGIN BULK
GRID,1,,0.,0.,0.,{system}
GRID,2,,1000.,0.,0.,{system}
GRID,3,,2000.,0.,0.,{system}
{coordinates}
ENDDATA
"""
# local x is global z, local y is global x, local z is global y
TURNED = "CORD2R,7,,0.,0.,0.,0.,1.,0.\n,0.,0.,1."


def lowest(folder: Path) -> tuple[Any, Any]:
    """Return omega and mass-normalised shapes of the chain of three masses.

    Shapes are in columns. Units are kg, m, s.
    """
    import scipy.linalg

    mass, stiffness = chain(folder)
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    return np.sqrt(squares), shapes


def write_op2(
    folder: Path,
    omega: Any,
    shapes: Any,
    masses: Any,
    turned: bool = False,
    nodes: bool = False,
    table: int = 7,
) -> None:
    """Write modes in t and mm by pyNastran's own writer.

    They are scaled to generalised masses in t. Each node moves along z, or along a local x.
    """
    from impact_env.structures.nastran import _reader

    with _reader():
        from pyNastran.op2.op2_geom import OP2Geom
        from pyNastran.op2.tables.lama_eigenvalues.lama_objects import RealEigenvalues
        from pyNastran.op2.tables.oug.oug_eigenvectors import RealEigenvectorArray

        model = OP2Geom(debug=False)
        number = len(omega)
        data = np.zeros((number, 3, 6), dtype="float32")
        # shapes in 1/sqrt(t), times the root of the generalised mass
        data[:, :, 0 if turned else 2] = (shapes * np.sqrt(1e3) * np.sqrt(masses)).T
        kinds = np.array([[1, 1], [2, 1], [3, 1]], dtype="int32")
        modes = np.arange(1, number + 1, dtype="int32")
        squares = (omega**2).astype("float32")
        cycles = (omega / (2 * np.pi)).astype("float32")
        vectors = RealEigenvectorArray.add_modal_case(
            "OUGV1", kinds, data, 1, modes, squares, cycles
        )
        vectors.table_code = table  # 7: eigenvectors; the writer's default says displacements
        model.eigenvectors[1] = vectors
        values = RealEigenvalues("modes", "LAMA", number)
        values.mode[:] = values.extraction_order[:] = modes
        values.eigenvalues[:] = squares
        values.radians[:] = omega
        values.cycles[:] = cycles
        values.generalized_mass[:] = masses
        values.generalized_stiffness[:] = masses * omega**2
        model.eigenvalues["modes"] = values
        if nodes:
            for k in (1, 2, 3):
                model.add_grid(k, [1000.0 * (k - 1), 0.0, 0.0])
        model.get_table_types = lambda *_a, **_k: ["eigenvectors"]
        model.write_op2(str(folder / "job.op2"))


@pytest.mark.parametrize(("turned", "nodes"), [(False, False), (True, False), (False, True)])
def test_nastran_modes_are_scaled_turned_and_in_si_units(
    turned: bool, nodes: bool, tmp_path: Path
) -> None:
    pytest.importorskip("pyNastran")
    omega, shapes = lowest(tmp_path)
    write_op2(tmp_path, omega, shapes, np.array([1.0, 2.0, 0.5]), turned, nodes)
    keys = PLACES | {"file": "job.op2", "units": "t, mm, s"}
    if not nodes:
        system = 7 if turned else ""
        text = BDF.format(system=system, coordinates=TURNED if turned else "")
        (tmp_path / "job.bdf").write_text(text)
        keys["bdf"] = "job.bdf"
    wanted = {"mass": "m.npz", "stiffness": "m.npz", "units": "kg, m, s"}
    wanted |= {"force": 0, "absorber": 2, "mass_kg": 3.0, "damping_ratio": 0.01}
    model = loaded(written(tmp_path, "op2", "nastran", **keys))
    plain = loaded(written(tmp_path, "matrices", "matrices", **wanted))
    same(model, _turned_absorber(plain), 1e-5)


def _turned_absorber(model: ModalModel) -> ModalModel:
    """Return a model whose absorber moves along -z: the signs of the modes follow it."""
    from dataclasses import replace

    return replace(model, force_shape=-model.force_shape)


def test_a_mode_that_a_program_lists_twice_counts_once(tmp_path: Path) -> None:
    pytest.importorskip("pyNastran")
    omega, shapes = lowest(tmp_path)
    twice = [0, 0, 1]
    write_op2(tmp_path, omega[twice], shapes[:, twice], np.ones(3), nodes=True)
    keys = PLACES | {"file": "job.op2", "units": "t, mm, s"}
    model = loaded(written(tmp_path, "op2", "nastran", **keys))
    np.testing.assert_allclose(model.omega, omega[:2], rtol=1e-6)


NASTRAN = {
    "no units": ({"units": None}, r"the key units must be given"),
    "no damping": ({"damping_ratio": None}, r"damping_ratio = None is not allowed: given"),
    "no force": ({"force": None}, r"the key force must be given"),
    "unknown units": ({"units": "mm"}, r"units = 'mm' is not allowed: one of"),
    "no bdf": ({"bdf": None}, r"bdf = None is not allowed: given: job.op2 has no nodes"),
    "another bdf": ({"bdf": "other.bdf"}, r"other.bdf' is not allowed: the model of job.op2"),
    "a bdf that is none": ({"bdf": "bad.bdf"}, r"bdf = .*bad.bdf"),
    "a curved system": ({"bdf": "curved.bdf"}, r"displacement coordinate system 7 .CORD2C"),
    "a file that is none": ({"file": "bad.op2"}, r"bad.op2' is not allowed: a file that pyN"),
    "a missing file": ({"file": "none.op2"}, r"a Nastran file that exists and ends in .op2"),
    "a cut file": ({"file": "cut.op2"}, r"cut.op2"),
    "a node": ({"force": {"node": 9, "direction": "z"}}, r"force = 9 is not allowed: a node of"),
    "a subcase": ({"subcase": 4}, r"subcase = 4 is not allowed: one with eigenvectors in job"),
}


@pytest.mark.parametrize("case", NASTRAN)
def test_a_wrong_nastran_file_is_one_line(case: str, tmp_path: Path) -> None:
    pytest.importorskip("pyNastran")
    omega, shapes = lowest(tmp_path)
    write_op2(tmp_path, omega, shapes, np.ones(3))
    whole = (tmp_path / "job.op2").read_bytes()
    (tmp_path / "cut.op2").write_bytes(whole[: len(whole) * 2 // 3])
    (tmp_path / "bad.op2").write_bytes(b"a text that is no table of Nastran" * 20)
    plain = BDF.format(system="", coordinates="")
    (tmp_path / "job.bdf").write_text(plain)
    (tmp_path / "other.bdf").write_text(plain.replace("GRID,3", "GRID,4"))
    (tmp_path / "bad.bdf").write_text("a text\n")
    curved = BDF.format(system=7, coordinates=TURNED.replace("CORD2R", "CORD2C"))
    (tmp_path / "curved.bdf").write_text(curved)
    changes, message = NASTRAN[case]
    keys = PLACES | {"file": "job.op2", "bdf": "job.bdf", "units": "t, mm, s"} | changes
    keys = {key: value for key, value in keys.items() if value is not None}
    with pytest.raises(ParameterError, match=message) as caught:
        loaded(written(tmp_path, "op2", "nastran", **keys))
    assert "\n" not in str(caught.value)


# Ansys: the examples that the reader's package has.


def example(name: str) -> Path:
    pytest.importorskip("ansys.mapdl.reader._version")
    package = importlib.util.find_spec("ansys.mapdl.reader")
    assert package is not None
    assert package.submodule_search_locations is not None
    return Path(package.submodule_search_locations[0]) / "examples" / name


def test_matrices_of_a_full_file_have_the_frequencies_of_the_reader_page(tmp_path: Path) -> None:
    """Matrices of a full file have the frequencies of the reader's documentation.

    It solves this beam with SciPy: 1283.200, 1283.200, 5781.975 and 6919.399 Hz.
    """
    (tmp_path / "file.full").write_bytes(example("file.full").read_bytes())
    place = {"node": 21, "direction": "x"}
    keys = {"mass": "file.full", "stiffness": "file.full", "units": "kg, m, s", "mass_kg": 1.0}
    keys |= {"force": place, "absorber": place, "damping_ratio": 0.01, "modes": 4}
    model = loaded(written(tmp_path, "full", "matrices", **keys))
    hertz = model.omega / (2 * np.pi)
    np.testing.assert_allclose(hertz, [1283.200, 1283.200, 5781.975, 6919.399], atol=5e-4)


def test_modes_of_a_rst_file_are_those_of_the_reader(tmp_path: Path) -> None:
    path = example("file.rst")
    from ansys.mapdl.reader import read_binary

    result = read_binary(str(path))
    nodes, shape = result.nodal_solution(2)
    (tmp_path / "file.rst").write_bytes(path.read_bytes())
    keys = PLACES | {"file": "file.rst", "units": "t, mm, s"}
    model = loaded(written(tmp_path, "rst", "ansys", **keys))
    np.testing.assert_allclose(model.omega, 2 * np.pi * result.time_values, rtol=1e-12)
    row = int(np.flatnonzero(nodes == 1)[0])
    assert abs(model.force_shape[2]) == pytest.approx(abs(shape[row, 2]) / np.sqrt(1e3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"file": "cut.rst"}, r"cut.rst' is not allowed: a .rst file with modes"),
        ({"file": "late.rst"}, r"late.rst' is not allowed: a .rst file .*the file is cut"),
        ({"file": "text.rst"}, r"text.rst' is not allowed: a .rst file with modes"),
        ({"file": "file.full"}, r"exists and ends in .rst"),
        ({"force": {"node": 9999, "direction": "z"}}, r"force = 9999 is not allowed: a node of"),
    ],
)
def test_a_wrong_ansys_file_is_one_line(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    """A cut file ends the reader's process, not this one."""
    whole = example("file.rst").read_bytes()
    (tmp_path / "file.rst").write_bytes(whole)
    (tmp_path / "cut.rst").write_bytes(whole[:5000])
    (tmp_path / "late.rst").write_bytes(whole[: len(whole) * 9 // 10])
    (tmp_path / "text.rst").write_text("a text\n" * 300)
    keys = PLACES | {"file": "file.rst", "units": "kg, m, s"} | change
    with pytest.raises(ParameterError, match=message) as caught:
        loaded(written(tmp_path, "rst", "ansys", **keys))
    assert "\n" not in str(caught.value)


# The modal assurance criterion.


def test_assurance_of_shapes_is_that_of_the_formula() -> None:
    generator = np.random.default_rng(3)
    a = generator.standard_normal((3, 7))
    b = generator.standard_normal((2, 7))
    wanted = [[(x @ y) ** 2 / ((x @ x) * (y @ y)) for y in b] for x in a]
    np.testing.assert_allclose(modal_assurance(a, b), wanted, rtol=1e-12)
    np.testing.assert_allclose(np.diag(modal_assurance(a, -3 * a)), 1.0, rtol=1e-12)
    assert modal_assurance([[0.0, 0.0]], [[1.0, 0.0]]) == [[0.0]]
    with pytest.raises(ParameterError, match="rows of 7 numbers"):
        modal_assurance(a, b[:, :5])


def test_a_measured_structure_is_compared_with_its_matrices(tmp_path: Path) -> None:
    """A measured structure is compared with its matrices.

    A Universal File has nodes 1 and 3 along z, with other signs of the modes. The matrices name
    their rows by nodes.
    """
    omega, shapes = lowest(tmp_path)
    mass, stiffness = chain(tmp_path)
    for name, matrix in (("mas", mass), ("sti", stiffness)):
        entries = [(i, j) for i in range(3) for j in range(i, 3) if matrix[i, j]]
        text = "".join(f"{i + 1} {j + 1} {matrix[i, j]:.13E}\n" for i, j in entries)
        (tmp_path / f"job.{name}").write_text(text)
    (tmp_path / "job.dof").write_text("1.3\n2.3\n3.3\n")
    lines = []
    for k in range(3):
        head = f"{1:10d}{2:10d}{2:10d}{8:10d}{2:10d}{3:10d}\n{2:10d}{4:10d}{0:10d}{k + 1:10d}\n"
        head += f"{omega[k] / (2 * np.pi):13.5e}{1.0:13.5e}{0.01:13.5e}{0.0:13.5e}\n"
        rows = "".join(
            f"{node:10d}\n{0.0:13.5e}{0.0:13.5e}{-shapes[node - 1, k]:13.5e}\n" for node in (1, 3)
        )
        lines.append("    -1\n    55\n" + "test\n" * 5 + head + rows + "    -1\n")
    (tmp_path / "test.uff").write_text("".join(lines))
    common = {key: PLACES[key] for key in ("force", "absorber", "mass_kg")}
    matrices = {"mass": "job.mas", "stiffness": "job.sti", "units": "kg, m, s"}
    first = written(tmp_path, "fe", "matrices", **common, **matrices, damping_ratio=0.01)
    second = written(tmp_path, "test", "universal", **common, file="test.uff")
    comparison = compare_modes(first, second)
    assert comparison.places == 2
    np.testing.assert_allclose(comparison.first, comparison.second, rtol=1e-5)
    part = shapes[[0, 2]].T
    np.testing.assert_allclose(comparison.assurance, modal_assurance(part, part), atol=1e-5)
    beam = written(tmp_path, "beam", "beam", length_m=1.0)
    with pytest.raises(ParameterError, match="a file with nodes"):
        compare_modes(first, beam)
