"""Modes from Nastran: eigenvectors and modal masses of an .op2 file.

The nodes are those of a .bdf file or of the .op2 file itself.
"""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import describe_error, require
from impact_env.extras import optional
from impact_env.structures.units import ConsistentUnits
from impact_env.structures.universal import MeasuredMode, without_repeats

Real = NDArray[np.float64]

GRID_POINT = (
    1  # the second number of a node in a table of eigenvectors: a grid point, not a scalar one
)
TABLES = ("OUGV1", "OUG1", "OUGV2", "BOUGV1")
RECTANGULAR = ("CORD1R", "CORD2R")


@contextlib.contextmanager
def _reader() -> Iterator[None]:
    """Surround imports and calls of pyNastran, which prints.

    Its last version for NumPy 2, 1.3.4, needs the name in1d, which NumPy 2.4 removed; for
    one-dimensional arrays it is isin.
    """
    removed = not hasattr(np, "in1d")
    if removed:
        setattr(np, "in1d", np.isin)  # noqa: B010 - no name that NumPy declares
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        if removed:
            delattr(np, "in1d")


def _load(path: Path, name: str, ending: str) -> Any:
    require(
        path.suffix.lower() == ending and path.is_file(),
        name,
        str(path),
        f"a Nastran file that exists and ends in {ending}",
    )
    with optional(), _reader():
        from cpylog import SimpleLogger
        from pyNastran.bdf.bdf import read_bdf
        from pyNastran.op2.op2_geom import read_op2_geom
    try:
        with _reader():
            if ending == ".op2":
                return read_op2_geom(str(path), log=SimpleLogger("critical"), combine=False)
            return read_bdf(str(path), log=SimpleLogger("critical"))
    except (
        BaseException
    ) as error:  # the library raises many kinds, SystemExit and FatalError among them
        if isinstance(error, KeyboardInterrupt):
            raise
        lines = str(error).strip().splitlines() or [""]
        allowed = f"a file that pyNastran can read ({type(error).__name__}: {lines[0]})"
        raise describe_error(name, str(path), allowed) from error


def read_modes(
    path: Path, bdf: Path | None, units: ConsistentUnits, subcase: int | None = None
) -> list[MeasuredMode]:
    """Return the real modes of an .op2 file by ascending frequency.

    They are in SI units and in the basic coordinate system.

    Parameters
    ----------
    path : Path
        The .op2 file, with eigenvectors and the table of eigenvalues of SOL 103.
    bdf : Path or None
        The .bdf file with the nodes, whose coordinate systems turn the shapes. None: the nodes are
        in the .op2 file.
    units : ConsistentUnits
        The system of units of the model.
    subcase : int or None
        Number of the subcase with the modes. None: the file has only one.

    Raises
    ------
    ParameterError
        For a file that cannot be read, without modes or without nodes, and for shapes in curved
        coordinate systems.
    """
    result = _load(path, "file", ".op2")
    cases = {
        int(key[0] if isinstance(key, tuple) else key): table
        for key, table in result.eigenvectors.items()
    }
    some = ", ".join(map(str, sorted(cases))) or "none"
    if subcase is None:
        require(
            len(cases) == 1,
            "file",
            f"{path}, subcases with eigenvectors: {some}",
            "an .op2 file with the eigenvectors of one subcase, or the key subcase",
        )
        subcase = next(iter(cases))
    require(subcase in cases, "subcase", subcase, f"one with eigenvectors in {path.name}: {some}")
    table = cases[subcase]
    require(
        "Complex" not in type(table).__name__ and table.table_name in TABLES,
        "file",
        f"{path}, table {table.table_name} with {type(table).__name__}",
        f"real eigenvectors in a table {', '.join(TABLES)}",
    )
    masses = _modal_masses(path, result, table)
    grid = table.node_gridtype[:, 1] == GRID_POINT
    nodes = table.node_gridtype[grid, 0].astype(np.int64)
    turned = _node_rotations(path, result if bdf is None else _load(bdf, "bdf", ".bdf"), nodes, bdf)
    modes = []
    for k, number in enumerate(map(int, table.modes)):
        value = float(table.eigns[k])
        require(
            value > 0,
            "file",
            f"{path}, mode {number}, eigenvalue {value:.6g}",
            "eigenvalues above 0: a rigid-body motion needs that of its suspension",
        )
        local = np.asarray(table.data[k, grid, :3], dtype=np.float64)
        require(
            bool(np.all(np.isfinite(local))),
            "file",
            f"{path}, mode {number}",
            "finite numbers in all shapes",
        )
        shape = np.einsum("nij,ni->nj", turned, local) / np.sqrt(masses[number] * units.mass)
        modes.append(MeasuredMode(np.sqrt(value) / units.time, None, nodes, shape, True, number))
    return without_repeats(path, sorted(modes, key=lambda mode: mode.omega))


def _modal_masses(path: Path, result: Any, table: Any) -> dict[int, float]:
    """Return the generalised mass by mode.

    It comes from the table of eigenvalues that has the eigenvalues of the eigenvectors.
    """
    for values in result.eigenvalues.values():
        if not hasattr(values, "generalized_mass"):
            continue
        rows = {int(mode): k for k, mode in enumerate(values.mode)}
        if all(int(mode) in rows for mode in table.modes):
            listed = np.array([values.eigenvalues[rows[int(mode)]] for mode in table.modes])
            if np.allclose(listed, table.eigns, rtol=1e-5):
                masses = {mode: float(values.generalized_mass[k]) for mode, k in rows.items()}
                least = min(masses[int(mode)] for mode in table.modes)
                require(
                    least > 0,
                    "file",
                    f"{path}, generalised mass {least:.6g}",
                    "generalised masses above 0, which scale the shapes",
                )
                return masses
    raise describe_error(
        "file",
        str(path),
        (
            "an .op2 file with the table of eigenvalues (LAMA) of its eigenvectors, whose "
            "generalised masses scale them"
        ),
    )


def _node_rotations(path: Path, geometry: Any, nodes: NDArray[np.int64], bdf: Path | None) -> Real:
    """Return the rows (N, 3, 3) of each node's displacement coordinate system in the basic one."""
    source = path if bdf is None else bdf
    if bdf is None:
        require(
            len(geometry.nodes) > 0,
            "bdf",
            None,
            (
                f"given: {path.name} has no nodes (GEOM1), so the directions of its displacements "
                "are not known"
            ),
        )
    result = np.empty((len(nodes), 3, 3))
    for k, node in enumerate(map(int, nodes)):
        require(
            node in geometry.nodes,
            "file" if bdf is None else "bdf",
            str(source),
            f"the model of {path.name}, with its node {node}",
        )
        system = geometry.nodes[node].cd
        system = int(getattr(system, "cid", system))
        if system == 0:
            result[k] = np.eye(3)
            continue
        coordinates = geometry.coords.get(system)
        kind = type(coordinates).__name__
        require(
            kind in RECTANGULAR,
            "file" if bdf is None else "bdf",
            f"{source}, node {node}: displacement coordinate system {system} ({kind})",
            "basic or rectangular coordinate systems (CORD1R, CORD2R) for displacements",
        )
        require(
            bdf is not None,
            "bdf",
            None,
            (
                f"given: node {node} of {path.name} has its displacements in the coordinate "
                f"system {system}"
            ),
        )
        with _reader():
            result[k] = np.asarray(coordinates.beta(), dtype=np.float64)
    return result


def read_nodes(
    path: Path, bdf: Path | None, units: ConsistentUnits
) -> tuple[NDArray[np.int64], Real]:
    """Return numbers (N,) and coordinates (N, 3) in m of the nodes of a file.

    The file is the .bdf file, or the .op2 file if there is no .bdf file.
    """
    geometry = _load(path, "file", ".op2") if bdf is None else _load(bdf, "bdf", ".bdf")
    require(len(geometry.nodes) > 0, "bdf", None, f"given: {path.name} has no nodes (GEOM1)")
    with _reader():
        points = np.array(
            [
                node.get_position() if bdf is not None else node.get_position_no_xref(geometry)
                for node in geometry.nodes.values()
            ]
        )
    return np.array(list(geometry.nodes), dtype=np.int64), points * units.length
