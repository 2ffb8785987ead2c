"""Files of structures are read correctly or refused.

Massless degrees of freedom, damaged and cut files, units, coordinate systems and repeated modes are
tested.
"""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.io
import scipy.optimize
import scipy.sparse
from load_cases import chain

from impact_env import Beam, StructureWarning, modal_model
from impact_env.checks import ParameterError
from impact_env.frequency import receptance
from impact_env.modes import ModalModel
from impact_env.plain import from_scene, load_structure, to_scene
from impact_env.scene import Scene
from impact_env.structures.matrices import lowest_modes
from impact_env.structures.universal import read_modes, read_nodes

KEYS = {"units": "kg, m, s", "force": 0, "absorber": 1, "mass_kg": 3.0, "damping_ratio": 0.01}


def loaded(folder: Path, table: str = "matrices", **keys: Any) -> ModalModel:
    """Return the structure of one table; warnings are not looked at."""
    path = folder / "structure.json"
    path.write_text(json.dumps({table: keys}))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return modal_model(load_structure(path))


def lumped(elements: int) -> tuple[Any, Any]:
    """Return M and K of a cantilever of 1 m, 100 N m^2 and 2 kg.

    It has masses at its nodes, and rotations without inertia.
    """
    h = 1 / elements
    size = 2 * elements + 2
    mass = np.zeros((size, size))
    stiffness = np.zeros((size, size))
    block = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    )
    for e in range(elements):
        s = slice(2 * e, 2 * e + 4)
        stiffness[s, s] += 100 / h**3 * block
        mass[s, s] += np.diag([h, 0.0, h, 0.0])
    return mass[2:, 2:], stiffness[2:, 2:]


# Freedoms without mass, and without anything.


@pytest.mark.parametrize("elements", [1, 4, 6])
def test_freedoms_without_mass_follow_the_others_exactly(elements: int, tmp_path: Path) -> None:
    mass, stiffness = lumped(elements)
    np.savez(tmp_path / "m.npz", M=mass, K=stiffness)
    tip = 2 * elements - 2
    files = {"mass": "m.npz", "stiffness": "m.npz"}
    keys = files | KEYS | {"force": tip, "absorber": tip, "response": tip + 1, "damping_ratio": 0.0}
    model = loaded(tmp_path, **keys)  # modes: 10 by default, more than there are
    assert model.modes == elements
    # the flexibility of the masses, from the inverse of the whole stiffness
    flexible = np.linalg.inv(stiffness)[::2, ::2] @ mass[::2, ::2]
    omega = np.sort(1 / np.sqrt(np.linalg.eigvals(flexible).real))
    np.testing.assert_allclose(model.omega, omega, rtol=1e-10)
    for frequency in (
        0.3,
        0.7,
        5.0,
    ):  # the tip's rotation, which has no mass, under a force at the tip
        square = (frequency * omega[0]) ** 2
        direct = np.linalg.inv(stiffness - square * mass)[tip + 1, tip]
        computed = receptance(model, frequency * omega[0], model.level_shape, model.force_shape)
        assert computed == pytest.approx(direct, rel=1e-9)


def test_many_freedoms_without_mass_follow_too() -> None:
    """Many degrees of freedom without mass follow the others exactly.

    Masses are on a string of 1,600 springs, and every second joint has no mass. Two springs in a
    row are one of half the stiffness.
    """
    joints = 1599
    ones = np.ones(joints)
    stiffness = 2e6 * scipy.sparse.diags([-ones[1:], 2 * ones, -ones[1:]], [-1, 0, 1]).tocsc()
    heavy = np.arange(joints) % 2 == 1
    mass = scipy.sparse.diags(0.01 * heavy).tocsc()
    modes = lowest_modes(mass, stiffness, 6)
    masses = heavy.sum()
    wanted = 2 * np.sqrt(1e6 / 0.01) * np.sin(np.pi * np.arange(1, 7) / (2 * (masses + 1)))
    np.testing.assert_allclose(modes.omega, wanted, rtol=1e-8)
    between = (modes.shapes[1:-3:2] + modes.shapes[3::2]) / 2
    np.testing.assert_allclose(modes.shapes[2:-2:2], between, atol=1e-9)


def test_few_masses_on_many_freedoms_are_condensed() -> None:
    """Few masses on many degrees of freedom are condensed.

    Four masses are on a string of 40,000 springs. The reference has the flexibilities of the string
    between its ends.
    """
    joints = 39_999
    ones = np.ones(joints)
    stiffness = 1e6 * scipy.sparse.diags([-ones[1:], 2 * ones, -ones[1:]], [-1, 0, 1]).tocsc()
    places = np.array([8_000, 16_000, 24_000, 32_000])
    mass = scipy.sparse.coo_matrix((np.full(4, 0.5), (places - 1, places - 1)), (joints, joints))
    modes = lowest_modes(mass.tocsc(), stiffness, 10)
    share = places / 40_000
    flexible = np.minimum.outer(share, share) - np.outer(share, share)
    wanted = np.sort(1 / np.sqrt(np.linalg.eigvalsh(0.5 * flexible * 40_000 / 1e6)))
    np.testing.assert_allclose(modes.omega, wanted, rtol=1e-6)


def test_a_combination_of_freedoms_without_mass_has_no_mode() -> None:
    mass = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])  # u1 - u2 moves no mass
    stiffness = np.array([[3e4, -1e4, 0.0], [-1e4, 2e4, -1e4], [0.0, -1e4, 1e4]])
    modes = lowest_modes(mass, stiffness, 3)
    flexible = np.linalg.eigvals(np.linalg.solve(stiffness, mass)).real
    np.testing.assert_allclose(modes.omega, 1 / np.sqrt(np.sort(flexible)[::-1][:2]), rtol=1e-10)


def test_unused_freedoms_change_nothing(tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    plain = loaded(tmp_path, mass="m.npz", stiffness="m.npz", **KEYS)
    order = [0, 2, 4]
    wide = np.zeros((2, 5, 5))
    wide[0][np.ix_(order, order)] = mass
    wide[1][np.ix_(order, order)] = stiffness
    np.savez(tmp_path / "w.npz", M=wide[0], K=wide[1])
    model = loaded(tmp_path, mass="w.npz", stiffness="w.npz", **KEYS | {"absorber": 2})
    for name in ("omega", "force_shape", "tip_shape"):
        np.testing.assert_allclose(getattr(model, name), getattr(plain, name), rtol=1e-10)


def test_matrices_that_no_structure_has_are_refused() -> None:
    mass = np.diag([1.0, 0.0, 0.0, 1.0])
    loose = 1e4 * np.array([[2.0, 0, 0, -1], [0, 1, -1, 0], [0, -1, 1, 0], [-1.0, 0, 0, 1]])
    with pytest.raises(ParameterError, match="2 freedoms without mass, which it does not hold"):
        lowest_modes(mass, loose, 2)
    stiffness = 1e4 * np.eye(3)
    for wrong in (
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array(
            [[1.0, 0.7, 0.7], [0.7, 1.0, -0.7], [0.7, -0.7, 1.0]]
        ),  # each pair of rows alone is possible
    ):
        with pytest.raises(ParameterError, match=r"mass = 'a matrix with .* semidefinite"):
            lowest_modes(wrong, stiffness, 1)
    # a sparse stiffness with one soft mode and, far from it, one of negative stiffness
    size = 1500
    ones = np.ones(size)
    chained = scipy.sparse.diags([-ones[1:], 2.5 * ones, -ones[1:]], [-1, 0, 1]).tolil()
    for i, j in ((700, 701), (700, 702), (701, 702)):
        chained[i, j] = chained[j, i] = -2.0
    with pytest.raises(ParameterError, match="indefinite"):
        lowest_modes(scipy.sparse.identity(size).tocsc(), chained.tocsc(), 3)


def test_damping_of_freedoms_without_mass_is_refused_unless_it_is_proportional(
    tmp_path: Path,
) -> None:
    mass, stiffness = lumped(3)
    keys = {"mass": "m.npz", "stiffness": "m.npz", "damping": "m.npz"} | KEYS
    keys["damping_ratio"] = None
    keys = {key: value for key, value in keys.items() if value is not None}
    damping = 0.5 * mass + 1e-4 * stiffness
    np.savez(tmp_path / "m.npz", M=mass, K=stiffness, C=damping)
    model = loaded(tmp_path, **keys)
    np.testing.assert_allclose(
        model.damping_ratio, 0.25 / model.omega + 0.5e-4 * model.omega, rtol=1e-9
    )
    damping[5, 5] += 0.1
    np.savez(tmp_path / "m.npz", M=mass, K=stiffness, C=damping)
    with pytest.raises(ParameterError, match="damps freedoms without mass"):
        loaded(tmp_path, **keys)


# Files of matrices.


def labelled(mass: Any) -> str:
    """Return a matrix in Abaqus's format of FORMAT=MATRIX INPUT.

    A line has node, freedom, node, freedom and value of the lower triangle.
    """
    lines = ["** Assembled matrix", "*MATRIX INPUT"]
    for i in range(len(mass)):
        row = [(NODES[j], mass[i, j]) for j in range(i + 1) if mass[i, j]]
        lines += [f"{NODES[i]},3, {node},3, {value:.15e}" for node, value in row]
    return "\n".join(lines) + "\n"


def triplets(matrix: Any, whole: bool = False) -> str:
    """Return row, column (from 1) and value of the upper triangle, or of all."""
    size = len(matrix)
    return "".join(
        f"{i + 1} {j + 1} {matrix[i, j]:.13E}\n"
        for i in range(size)
        for j in range(size)
        if matrix[i, j] and (whole or j >= i)
    )


NODES = (30, 7, 12)  # of the rows of the chain


def write_sparse(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    for name, matrix, kind in (("m", mass, "coo"), ("k", stiffness, "csr")):
        scipy.sparse.save_npz(
            folder / f"{name}.npz", scipy.sparse.coo_matrix(matrix).asformat(kind)
        )
    return {"mass": "m.npz", "stiffness": "k.npz"}


def write_abaqus(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    (folder / "a_MASS1.mtx").write_text(labelled(mass))
    (folder / "a_STIF1.mtx").write_text(labelled(stiffness))
    return {"mass": "a_MASS1.mtx", "stiffness": "a_STIF1.mtx"} | BY_NODE


def write_abaqus_coordinates(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    (folder / "MASS2.mtx").write_text(triplets(mass))
    (folder / "STIF2.mtx").write_text(triplets(stiffness, whole=True))
    return {"mass": "MASS2.mtx", "stiffness": "STIF2.mtx"}


def write_held(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    """Write matrices with a fourth degree of freedom that a boundary condition holds.

    Abaqus writes 1e36 on its diagonal, and its mass.
    """
    wide = np.zeros((2, 4, 4))
    wide[0, :3, :3] = mass
    wide[1, :3, :3] = stiffness
    wide[0, 3, 3] = 0.7
    wide[1, 3, 3] = 1e36
    wide[1, 0, 3] = wide[1, 3, 0] = -1e4
    return write_abaqus_coordinates(folder, wide[0], wide[1])


def write_calculix(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    (folder / "job.mas").write_text(triplets(mass))
    (folder / "job.sti").write_text(triplets(stiffness))
    (folder / "job.dof").write_text("".join(f"{node}.3\n" for node in NODES))
    return {"mass": "job.mas", "stiffness": "job.sti"} | BY_NODE


def write_market(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    scipy.io.mmwrite(folder / "m.mtx", scipy.sparse.coo_matrix(mass), symmetry="symmetric")
    scipy.io.mmwrite(folder / "k.mtx", stiffness.astype(int), field="integer")
    return {"mass": "m.mtx", "stiffness": "k.mtx"}


def write_narrow(folder: Path, mass: Any, stiffness: Any) -> dict[str, Any]:
    np.savez(folder / "n.npz", M=mass.astype(np.float32), K=stiffness.astype(np.int32))
    return {"mass": "n.npz", "stiffness": "n.npz"}


BY_NODE = {
    "force": {"node": NODES[0], "direction": "z"},
    "absorber": {"node": NODES[1], "direction": "z"},
}
WRITERS: list[Callable[..., dict[str, Any]]] = [
    write_sparse,
    write_abaqus,
    write_abaqus_coordinates,
    write_held,
    write_calculix,
    write_market,
    write_narrow,
]


@pytest.mark.parametrize("write", WRITERS)
def test_all_forms_of_matrices_give_one_model(
    write: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    mass, stiffness = chain(tmp_path)
    plain = loaded(tmp_path, mass="m.npz", stiffness="m.npz", **KEYS)
    model = loaded(tmp_path, **KEYS | write(tmp_path, mass, stiffness))
    for name in ("omega", "force_shape", "tip_shape"):
        np.testing.assert_allclose(getattr(model, name), getattr(plain, name), rtol=1e-10)


def test_units_of_matrices_are_those_of_si(tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    plain = loaded(tmp_path, mass="m.npz", stiffness="m.npz", **KEYS)
    pound_inch = 4.4482216152605 / 0.0254
    for units, of_mass, time in (
        ("t, mm, s", 1e3, 1.0),
        ("t, m, s", 1e3, 1.0),
        ("kg, mm, ms", 1.0, 1e-3),
        ("lbf s2/in, in, s", pound_inch, 1.0),
        ("slug, ft, s", 14.593902937206, 1.0),
    ):
        np.savez(tmp_path / "u.npz", M=mass / of_mass, K=stiffness / of_mass * time**2)
        model = loaded(tmp_path, **KEYS | {"mass": "u.npz", "stiffness": "u.npz", "units": units})
        for name in ("omega", "force_shape", "tip_shape"):
            np.testing.assert_allclose(getattr(model, name), getattr(plain, name), rtol=1e-10)


HEADER = "%%MatrixMarket matrix coordinate {} {}\n3 3 {}\n"
K_FILES = {
    "k.mtx pattern": (HEADER.format("pattern", "symmetric", 3) + "1 1\n2 2\n3 3\n", "a pattern"),
    "k.mtx complex": (
        HEADER.format("complex", "symmetric", 3) + "1 1 1 0\n2 2 1 1\n3 3 1 0\n",
        "finite real numbers",
    ),
    "k.mtx cut": (HEADER.format("real", "symmetric", 4) + "1 1 1\n2 2 1\n3 3 1\n", "k.mtx' is not"),
    "k.mtx both triangles": (
        HEADER.format("real", "symmetric", 5) + "1 1 2\n2 2 2\n3 3 1\n1 2 -1\n2 1 -1\n",
        "k.mtx' is not",
    ),
    "k.mtx one triangle": (
        HEADER.format("real", "general", 4) + "1 1 2\n2 2 2\n3 3 1\n2 1 -1\n",
        "a symmetric matrix, both triangles given",
    ),
    "k.mtx not a number": ("1 1 2e4\n2 2 nan\n3 3 1e4\n", "line 2: nan is not finite"),
    "k.mtx a text": ("1 1 2e4\n2 2 x\n3 3 1e4\n", "line 2"),
    "k.mtx columns": ("1 1 2e4\n2 2 1 3\n3 3 1e4\n", "line 2: 4 numbers"),
    "k.mtx end": ("1 1 2e4\n2 2 2e4\n3 3 1e", "ends within a line"),
    "k.mtx row": ("1 1 2e4\n2.5 2 2e4\n3 3 1e4\n", "2.5 is no number of a row"),
    "k.mtx twice": ("1 1 2e4\n1 1 2e4\n2 2 1\n3 3 1e4\n", "an entry is listed twice"),
    "k.mtx size": ("1 1 2e4\n2 2 1\n", "3 by 3, as the mass matrix"),
    "k.mtx multiplier": ("1,1,1,1,2e4\n0,1,1,1,1\n", "nodes below 1"),
    "k.mtx labels": ("1,1,1,1,2e4\n2,1,2,1,1\n3,1,3,1,1\n", "one form for all matrices"),
    "k.mtx empty": ("", "ends within a line or is empty"),
    "k.mtx utf16": ("\ufeff1 1 2e4\n".encode("utf-16"), "k.mtx' is not"),
    "k.sti labels": ("1 1 2e4\n2 2 2e4\n3 3 1e4\n", "'7,3' is no node.freedom"),
}


@pytest.mark.parametrize("case", K_FILES)
def test_a_wrong_matrix_is_one_line_with_the_file(case: str, tmp_path: Path) -> None:
    chain(tmp_path)
    (tmp_path / "k.dof").write_text("7,3\n")
    name = case.split()[0]
    content, message = K_FILES[case]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ParameterError, match=message) as caught:
        loaded(tmp_path, mass="m.npz", stiffness=name, **KEYS)
    assert "matrices.mass = " in str(caught.value) or "matrices.stiffness = " in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"A": np.eye(3), "B": np.eye(3)}, "it has A, B, and no K"),
        ({"M": np.eye(3)}, "it has M, and no K"),
        ({"K": np.array([scipy.sparse.eye(3)], dtype=object)}, "scipy.sparse.save_npz"),
        ({"K": np.eye(3, dtype=complex)}, "finite real numbers"),
        ({"K": np.eye(3, dtype=bool)}, "finite real numbers"),
        ({"K": np.eye(3).astype("m8[s]")}, "finite real numbers"),
        ({"K": np.diag([1.0, np.nan, 1.0])}, "nan in row 1, column 1"),
        ({"K": np.eye(3)[:2]}, "3 by 3"),
        ({"K": np.ones(3)}, "3 by 3"),
        ({"K": 1e200 * np.eye(3)}, "a largest entry from"),
        ({"K": np.array(1.0)}, "3 by 3"),
        ({"K": np.array([["1", "2"]])}, "3 by 3"),
    ],
)
def test_a_wrong_array_is_one_line_with_the_file(
    arrays: dict[str, Any], message: str, tmp_path: Path
) -> None:
    chain(tmp_path)
    np.savez(tmp_path / "k.npz", **arrays)
    with pytest.raises(ParameterError, match=message):
        loaded(tmp_path, mass="m.npz", stiffness="k.npz", **KEYS)


def test_a_damaged_archive_is_refused_or_read_as_it_was(tmp_path: Path) -> None:
    matrices = {"M": np.diag(np.arange(1.0, 30)), "K": np.diag(np.arange(2.0, 60, 2) ** 2)}
    np.savez_compressed(tmp_path / "m.npz", **matrices)
    whole = (tmp_path / "m.npz").read_bytes()
    keys = KEYS | {"mass": "m.npz", "stiffness": "m.npz", "absorber": 0}
    right = loaded(tmp_path, **keys).omega
    read = 0
    for place in range(0, len(whole), 5):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        (tmp_path / "m.npz").write_bytes(damaged)
        try:
            omega = loaded(tmp_path, **keys).omega
        except ParameterError:
            continue
        np.testing.assert_array_equal(omega, right)
        read += 1
    assert read < len(whole) / 10  # bytes that mean nothing, as a time of change


def test_coordinates_are_those_of_the_rows(tmp_path: Path) -> None:
    chain(tmp_path)
    (tmp_path / "nodes.csv").write_text("x_m,y_m,z_m\n0,0,0\n1,0,0\n")
    with pytest.raises(ParameterError, match=r"2 lines' is not allowed: 3, one for each row"):
        loaded(tmp_path, mass="m.npz", stiffness="m.npz", coordinates="nodes.csv", **KEYS)


# Universal Files.


def set_55(
    values: list[tuple[int, list[float]]],
    header: tuple[float, ...] = (30.0, 1.0, 0.01, 0.0),
    mode: int = 1,
    load_case: int = 0,
    about: tuple[int, ...] = (1, 2, 2, 8, 2, 3),
) -> str:
    """Return a dataset 55.

    ``about`` has the fields of its sixth record, and ``values`` the numbers by node.
    """
    lines = ["    -1", "    55", "a test", *["NONE"] * 4]
    lines.append("".join(f"{k:10d}" for k in about))
    lines.append(f"{2:10d}{len(header):10d}{load_case:10d}{mode:10d}")
    lines.append("".join(f"{x:13.5e}" for x in header))
    for node, numbers in values:
        lines.append(f"{node:10d}")
        parts = [numbers[k : k + 6] for k in range(0, len(numbers), 6)]
        lines += ["".join(f"{x:13.5e}" for x in part) for part in parts]
    return "\n".join([*lines, "    -1", ""])


def set_of(kind: int, *lines: str) -> str:
    return "\n".join(["    -1", f"{kind:6d}", *lines, "    -1", ""])


def units_set(code: int, length: float, force: float) -> str:
    return set_of(
        164,
        f"{code:10d}{'some units':20s}{2:10d}",
        f"{length:25.17E}{force:25.17E}{1.0:25.17E}",
        f"{0.0:25.17E}",
    )


def nodes_2411(system: int = 0, x: float = 1.0) -> str:
    lines = []
    for node in (1, 2):
        lines.append(f"{node:10d}{0:10d}{system:10d}{11:10d}")
        lines.append(f"{x * node:25.16E}{0.0:25.16E}{0.0:25.16E}")
    return set_of(2411, *lines)


def system_2420(label: int, rows: Any) -> str:
    lines = [f"{1:10d}{0:10d}", "part", f"{label:10d}{0:10d}{8:10d}", "system"]
    lines += ["".join(f"{x:25.16E}" for x in row) for row in rows]
    return set_of(2420, *lines)


FIRST = [(1, [0.0, 0.0, 0.5]), (2, [0.0, 0.0, 1.0])]
SECOND = [(1, [0.0, 0.0, 0.8]), (2, [0.0, 0.0, -0.6])]
PLACES = {
    "force": {"node": 1, "direction": "z"},
    "absorber": {"node": 2, "direction": "z"},
    "mass_kg": 3.0,
    "file": "a.uff",
}
PLAIN = set_55(FIRST) + set_55(SECOND, (90.0, 1.0, 0.01, 0.0), mode=2)


def universal(folder: Path, text: str, **keys: Any) -> ModalModel:
    (folder / "a.uff").write_text(text)
    return loaded(folder, "universal", **PLACES | keys)


def test_a_cut_universal_file_is_refused_wherever_it_is_cut(tmp_path: Path) -> None:
    assert universal(tmp_path, PLAIN).modes == 2
    between = len(set_55(FIRST))  # the whole first dataset, with or without the last newline
    for end in range(len(PLAIN) - 1):
        if end >= between - 1 and not PLAIN[between - 1 : end].strip():
            continue
        (tmp_path / "a.uff").write_text(PLAIN[:end])
        with pytest.raises(ParameterError, match=r"a\.uff"):
            read_modes(tmp_path / "a.uff")


def test_universal_files_in_other_units_give_the_same_model(tmp_path: Path) -> None:
    plain = universal(tmp_path, PLAIN)
    # mm and N: the unit of mass is t, and mass-normalised shapes are in 1/sqrt(t)
    scaled = [
        [(node, [0.0, 0.0, x[2] * np.sqrt(1e3)]) for node, x in part] for part in (FIRST, SECOND)
    ]
    text = units_set(10, 1e3, 1.0) + set_55(scaled[0])
    text += set_55(scaled[1], (90.0, 1.0, 0.01, 0.0), mode=2) + nodes_2411(x=500.0)
    model = universal(tmp_path, text)
    np.testing.assert_allclose(model.tip_shape, plain.tip_shape, rtol=1e-5)
    np.testing.assert_allclose(read_nodes(tmp_path / "a.uff")[1][:, 0], [0.5, 1.0])
    # mm and mN: the unit of mass is kg
    model = universal(tmp_path, units_set(5, 1e3, 1e3) + PLAIN)
    np.testing.assert_allclose(model.tip_shape, plain.tip_shape, rtol=1e-12)
    # a modal mass of 4 scales shapes by a half
    double = [(node, [0.0, 0.0, 2 * x[2]]) for node, x in FIRST]
    model = universal(tmp_path, set_55(double, (30.0, 4.0, 0.01, 0.0)))
    np.testing.assert_allclose(model.tip_shape, plain.tip_shape[:1], rtol=1e-5)


def test_rotations_and_left_out_zeros_of_a_universal_file(tmp_path: Path) -> None:
    turned = [(node, [*x, 0.1, 0.2, 0.3]) for node, x in FIRST]
    plain = universal(tmp_path, PLAIN)
    text = set_55(turned, about=(1, 2, 3, 8, 2, 6)) + set_55(
        SECOND[1:], (90.0, 1.0, 0.01, 0.0), mode=2
    )
    model = universal(tmp_path, text)
    np.testing.assert_allclose(model.tip_shape, plain.tip_shape, rtol=1e-12)
    np.testing.assert_allclose(np.abs(model.force_shape), [0.5, 0.0], rtol=1e-12)


def test_forms_of_numbers_and_binary_datasets_of_a_universal_file(tmp_path: Path) -> None:
    plain = universal(tmp_path, PLAIN)
    assert universal(tmp_path, PLAIN.replace("\n", "\r\n")).modes == 2
    touching = PLAIN.replace("  0.00000e+00  0.00000e+00", " -0.00000D+00 -0.00000D+00")
    touching = touching.replace(" -0.00000D+00 -0.00000D+00 ", "-10.00000D+00-10.00000D+00 ")
    loaded_model = universal(tmp_path, touching)
    np.testing.assert_array_equal(loaded_model.tip_shape, plain.tip_shape)
    # six complex values a node, on two lines
    rows = [(node, [0.0] * 4 + [x[2], 0.0] + [0.1] * 6) for node, x in FIRST]
    value = complex(-2.0, 200.0)
    header = (value.real, value.imag, 0.0, 2 * value.imag, 0.0, 0.0)
    model = universal(tmp_path, set_55(rows, header, about=(1, 3, 3, 8, 5, 6)))
    np.testing.assert_allclose(model.tip_shape, [1.0], rtol=1e-5)
    # a record in bytes, among them line feeds and an end mark, is passed over
    record = b"".join([b"\n    -1\n", bytes(range(256)), b"    -1"])
    head = f"    58b{1:6d}{2:6d}{11:12d}{len(record):12d}{0:6d}{0:6d}{0:12d}{0:12d}\n"
    binary = b"    -1\n" + head.encode() + b"NONE\n" * 11 + record + b"    -1\n"
    (tmp_path / "a.uff").write_bytes(binary + PLAIN.encode() + binary)
    assert len(read_modes(tmp_path / "a.uff")) == 2
    (tmp_path / "a.uff").write_bytes(PLAIN.encode() + binary[:-100])
    with pytest.raises(ParameterError, match="complete Universal File"):
        read_modes(tmp_path / "a.uff")


@pytest.mark.parametrize(("viscous", "hysteretic"), [(0.015, 0.0), (0.0, 0.03), (0.015, 0.03)])
def test_a_loss_factor_of_a_universal_file_is_twice_the_damping_ratio(
    viscous: float, hysteretic: float, tmp_path: Path
) -> None:
    model = universal(tmp_path, set_55(FIRST, (30.0, 1.0, viscous, hysteretic)))
    np.testing.assert_allclose(model.damping_ratio, [0.015])


def complex_mode(sign: int, load_case: int = 0, scale: float = 1.0) -> str:
    """Return a lightly damped mode of shape 0.5, 1.

    It is given by its eigenvalue or the conjugate, and scaled by modal A.
    """
    omega = 200.0
    ratio = 0.01
    value = complex(-ratio * omega, sign * omega * np.sqrt(1 - ratio**2))
    factor = scale * np.exp(0.7j * sign)
    modal_a = 2j * value.imag * factor**2
    rows = []
    for node, x in ((1, 0.5), (2, 1.0)):
        shape = x * factor
        rows.append((node, [0.0, 0.0, 0.0, 0.0, shape.real, shape.imag]))
    header = (value.real, value.imag, modal_a.real, modal_a.imag, 0.0, 0.0)
    return set_55(rows, header, 1, load_case, (1, 3, 2, 8, 5, 3))


@pytest.mark.parametrize(
    "text",
    [
        complex_mode(1),
        complex_mode(-1),
        complex_mode(1) + complex_mode(-1),
        complex_mode(1) + complex_mode(1, load_case=2, scale=-3.0),
    ],
)
def test_a_mode_and_its_conjugate_or_repetition_count_once(text: str, tmp_path: Path) -> None:
    model = universal(tmp_path, text)
    np.testing.assert_allclose(model.omega, [200.0], rtol=1e-5)
    np.testing.assert_allclose(model.damping_ratio, [0.01], rtol=1e-4)
    np.testing.assert_allclose(np.abs(model.tip_shape), [1.0], rtol=1e-4)
    np.testing.assert_allclose(model.force_shape * model.tip_shape, [0.5], rtol=1e-4)


def test_two_estimates_of_a_mode_are_chosen_by_load_case(tmp_path: Path) -> None:
    other = [(1, [0.0, 0.0, 0.52]), (2, [0.0, 0.0, 0.98])]
    text = PLAIN + set_55(other, (30.1, 1.0, 0.012, 0.0), load_case=2)
    with pytest.raises(ParameterError, match=r"each mode once: choose one listing by load_case"):
        universal(tmp_path, text)
    np.testing.assert_allclose(universal(tmp_path, text, load_case=2).tip_shape, [0.98])
    assert universal(tmp_path, text, load_case=0).modes == 2
    # two modes of one frequency with shapes of their own are two modes
    assert universal(tmp_path, set_55(FIRST) + set_55(SECOND, mode=2)).modes == 2


TURNED = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
LEVEL = [*np.eye(3).tolist(), [0.2, 0.0, 0.0]]
WRONG = {
    "one value a node": (
        set_55([(1, [0.5]), (2, [1.0])], about=(1, 2, 1, 8, 2, 1)),
        "3 or 6 values a node",
    ),
    "a tensor": (
        set_55([(n, [*x, 0.0, 0.0, 0.0]) for n, x in FIRST], about=(1, 2, 4, 8, 2, 6)),
        "no scalar or tensor",
    ),
    "three values of a vector of six": (
        set_55(FIRST, about=(1, 2, 3, 8, 2, 3)),
        "no scalar or tensor",
    ),
    "heat": (set_55(FIRST, about=(2, 2, 2, 8, 2, 3)), "modes of a structure"),
    "acceleration": (set_55(FIRST, about=(1, 2, 2, 12, 2, 3)), "not acceleration"),
    "stress only": (set_55(FIRST, about=(1, 2, 2, 2, 2, 3)), "with modes in datasets 55"),
    "static only": (set_55(FIRST, about=(1, 1, 2, 8, 2, 3)), "with modes in datasets 55"),
    "double precision": (set_55(FIRST, about=(1, 2, 2, 8, 4, 3)), "real .2. or complex .5."),
    "not a number": (PLAIN.replace("8.00000e-01", "        nan"), "3 finite numbers"),
    "a node twice": (set_55([*FIRST, FIRST[0]]), "each node once"),
    "a huge node": (PLAIN.replace(f"{2:10d}\n", "9" * 30 + "\n", 1), "10 columns each"),
    "no nodes": (set_55([]), "values at one node or more"),
    "some modal masses": (
        set_55(FIRST) + set_55(SECOND, (90.0, 0.0, 0.01, 0.0), mode=2),
        "a modal mass for all modes",
    ),
    "negative modal mass": (set_55(FIRST, (30.0, -1.0, 0.01, 0.0)), "a modal mass of 0"),
    "negative damping": (set_55(FIRST, (30.0, 1.0, -0.01, 0.0)), "damping of 0"),
    "both dampings": (set_55(FIRST, (30.0, 1.0, 0.01, 0.01)), "damping_ratio"),
    "a rigid motion": (set_55(FIRST, (0.0, 1.0, 0.01, 0.0)), "a frequency above 0"),
    "overdamped": (
        set_55(
            [(1, [0.0] * 4 + [0.5, 0.0]), (2, [0.0] * 4 + [1.0, 0.0])],
            (-20.0, 0.0, 1.0, 0.0, 0.0, 0.0),
            about=(1, 3, 2, 8, 5, 3),
        ),
        "a mode that oscillates",
    ),
    "growing": (complex_mode(1).replace(" -2.00000e+00", "  2.00000e+00"), "does not grow"),
    "local directions": (PLAIN + nodes_2411(system=5), "in the coordinate system 5"),
    "local directions by 2420": (
        PLAIN + system_2420(1, TURNED) + nodes_2411(system=1),
        "in the coordinate system 1",
    ),
    "two systems of units": (units_set(1, 1, 1) + units_set(5, 1e3, 1e3) + PLAIN, "one system"),
    "no factors": (units_set(9, 0.0, 1.0) + PLAIN, "factors above 0"),
    "text outside": ("a test\n" + PLAIN, "a Universal File: datasets"),
    "a lost end mark": (PLAIN.replace("    -1\n    -1\n", "    -1\n", 1), r"a\.uff, "),
    "modes of one number": (
        set_55(FIRST) + set_55(SECOND, (90.0, 1.0, 0.01, 0.0), mode=1),
        "each mode once",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_field_that_does_not_fit_is_refused_with_the_file(case: str, tmp_path: Path) -> None:
    text, message = WRONG[case]
    with pytest.raises(ParameterError, match=message) as caught:
        universal(tmp_path, text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["file", "force", "absorber", "mass_kg"])
def test_a_missing_key_without_default_is_named(key: str, tmp_path: Path) -> None:
    (tmp_path / "a.uff").write_text(PLAIN)
    keys = {name: value for name, value in PLACES.items() if name != key}
    with pytest.raises(ParameterError, match=f"the key {key} must be given"):
        loaded(tmp_path, "universal", **keys)
    matrices = {"mass": "m.npz", "stiffness": "m.npz", **KEYS}
    chain(tmp_path)
    present = {name: value for name, value in matrices.items() if name != key}
    if key != "file":
        with pytest.raises(ParameterError, match=f"the key {key} must be given"):
            loaded(tmp_path, **present)


def test_coordinate_systems_that_are_the_global_one_are_read(tmp_path: Path) -> None:
    plain = universal(tmp_path, PLAIN)
    text = PLAIN + system_2420(7, LEVEL) + nodes_2411(system=7)
    np.testing.assert_array_equal(universal(tmp_path, text).tip_shape, plain.tip_shape)
    elsewhere = set_of(
        15, *(f"{n:10d}{7:10d}{0:10d}{1:10d}{n:13.5e}{0:13.5e}{0:13.5e}" for n in (1, 2))
    )
    (tmp_path / "a.uff").write_text(system_2420(7, LEVEL) + elsewhere)
    with pytest.raises(ParameterError, match="coordinates in the global coordinate system"):
        read_nodes(tmp_path / "a.uff")  # its origin is elsewhere


def test_a_damping_option_needs_no_damping_in_the_file(tmp_path: Path) -> None:
    text = set_55(FIRST, (30.0, 1.0, 0.01, 0.01))
    assert universal(tmp_path, text, damping_ratio=0.02).damping_ratio == [0.02]
    assert universal(tmp_path, set_55(FIRST, (30.0, 1.0, 0.0, 0.03))).damping_ratio == [0.015]


# Modes as numbers, and checks.


MODEL = {
    "frequencies_hz": [250.0, 40.0, 90.0],
    "damping_ratio": [0.03, 0.01, 0.02],
    "force_shape_per_sqrt_kg": [-1.8, 0.6, 0.7],
    "tip_shape_per_sqrt_kg": [2.6, 2.5, -2.4],
    "absorber_shapes_per_sqrt_kg": [[2.6, 2.5, -2.4], [1.0, 2.0, 3.0]],
    "base_participation_sqrt_kg": [0.1, 0.5, 0.3],
    "beam_mass_kg": 0.56,
}


@pytest.mark.parametrize("key", ["frequencies_hz", "omega_rad_s", "modes_csv"])
def test_resonance_1_is_the_lowest_however_the_modes_are_listed(key: str, tmp_path: Path) -> None:
    table = dict(MODEL)
    hertz = table.pop("frequencies_hz")
    if key == "omega_rad_s":
        table[key] = [2 * np.pi * f for f in hertz]
    elif key == "modes_csv":
        rows = zip(hertz, table.pop("force_shape_per_sqrt_kg"), strict=True)
        lines = ["frequencies_hz,force_shape_per_sqrt_kg", *(f"{f},{x}" for f, x in rows)]
        (tmp_path / "modes.csv").write_text("\ufeff" + "\n".join(lines) + "\n")
        table[key] = "modes.csv"
    else:
        table[key] = hertz
    path = tmp_path / "structure.json"
    path.write_text(json.dumps({"model": table}))
    with pytest.warns(StructureWarning, match="they are sorted: 2, 3, 1"):
        model = load_structure(path)
    np.testing.assert_allclose(model.omega / (2 * np.pi), [40.0, 90.0, 250.0])
    np.testing.assert_array_equal(model.damping_ratio, [0.01, 0.02, 0.03])
    np.testing.assert_array_equal(model.force_shape, [0.6, 0.7, -1.8])
    np.testing.assert_array_equal(model.absorber_shapes, [[2.5, -2.4, 2.6], [2.0, 3.0, 1.0]])
    np.testing.assert_array_equal(model.base_participation, [0.5, 0.3, 0.1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_mode_that_is_listed_twice_as_numbers_is_refused(sign: float, tmp_path: Path) -> None:
    keys = {
        "frequencies_hz": [40.0, 90.0, 40.0],
        "damping_ratio": 0.01,
        "force_shape_per_sqrt_kg": [0.6, 0.7, sign * 0.6],
        "tip_shape_per_sqrt_kg": [2.5, 2.4, sign * 2.5],
        "beam_mass_kg": 0.56,
    }
    with pytest.raises(ParameterError, match="the mode of 40 Hz twice with the same shapes"):
        loaded(tmp_path, "model", **keys)
    other = keys | {"force_shape_per_sqrt_kg": [0.6, 0.7, 0.5]}  # two modes of one frequency
    assert loaded(tmp_path, "model", **other).modes == 3


def test_a_scene_is_written_and_read_in_its_own_order() -> None:
    model = ModalModel([20.0, 10.0], [0.01, 0.02], [0.5, 0.7], [1.0, 0.8], 2.0)
    again = to_scene(from_scene(Scene(model, None))).model
    np.testing.assert_array_equal(again.omega, model.omega)


def test_a_resonance_that_moves_no_place_in_use_is_a_warning(tmp_path: Path) -> None:
    still = {
        "force_shape_per_sqrt_kg": [-1.8, 1e-5, 0.7],
        "tip_shape_per_sqrt_kg": [2.6, 0.0, -2.4],
    }
    table = {key: value for key, value in MODEL.items() if not key.startswith("absorber")}
    path = tmp_path / "structure.json"
    path.write_text(json.dumps({"model": table | still}))
    with pytest.warns(StructureWarning, match="resonance 1 at 40 Hz moves none of the places"):
        load_structure(path)


# A base that moves.


def test_base_participation_of_a_beam_with_a_tip_mass_is_that_of_the_closed_form() -> None:
    """The base participation of a beam with a tip mass agrees with its closed form.

    Shapes of the clamped beam with a mass at its end are integrated: phi_k is their mass under a
    unit motion of the base.
    """
    beam = Beam(tip_mass=0.2, modes=3, elements=60)
    line = beam.mass_per_length
    ratio = beam.tip_mass / (line * beam.length)

    def equation(x: float) -> float:
        bent = np.cos(x) * np.sinh(x) - np.sin(x) * np.cosh(x)
        return float(1 + np.cos(x) * np.cosh(x) + ratio * x * bent)

    participation = modal_model(beam).base_participation
    assert participation is not None
    for k, bracket in enumerate(((0.5, 1.87), (3.93, 4.69), (7.07, 7.85))):
        root = scipy.optimize.brentq(equation, *bracket, xtol=1e-14)
        share = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))

        def shape(s: float, root: float = root, share: float = share) -> float:
            y = root * s
            return float(np.cosh(y) - np.cos(y) - share * (np.sinh(y) - np.sin(y)))

        def integral(power: int, shape: Callable[[float], float] = shape) -> float:
            area = scipy.integrate.quad(lambda s: shape(s) ** power, 0, 1, epsabs=1e-13)[0]
            return float(line * beam.length * area + beam.tip_mass * shape(1.0) ** power)

        wanted = integral(1) / np.sqrt(integral(2)) * np.sign(shape(1.0))
        assert participation[k] == pytest.approx(wanted, rel=2e-5)
