"""Modes from Ansys: shapes of a .rst file, stiffness and mass of a .full file."""

import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from impact_env.checks import describe_error, require
from impact_env.extras import optional
from impact_env.structures.units import UNIT_SYSTEMS, ConsistentUnits
from impact_env.structures.universal import MeasuredMode, without_repeats

Real = NDArray[np.float64]

ARRAYS = Path(__file__).with_name("ansys_arrays.py")
# systems of units that a .rst file may name
NAMED_UNITS = {
    "SI": "kg, m, s",
    "MKS": "kg, m, s",
    "MPA": "t, mm, s",
    "BFT": "slug, ft, s",
    "BIN": "lbf s2/in, in, s",
}
UNITY_TOL = 1e-6  # of the largest number of a shape that is scaled to 1


def read_arrays(path: Path) -> dict[str, Any]:
    """Return the arrays of an Ansys file.

    Raises ValueError, with one line, if the file cannot be read.
    """
    with optional():
        if importlib.util.find_spec("ansys") is None:
            raise ModuleNotFoundError("No module named 'ansys'", name="ansys")
        if importlib.util.find_spec("ansys.mapdl.reader") is None:
            raise ModuleNotFoundError("No module named 'ansys'", name="ansys")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "arrays.npz"
        command = [sys.executable, "-P", str(ARRAYS), str(path.resolve()), str(target)]
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0 or not target.is_file():
            lines = done.stderr.strip().splitlines() or ["no message"]
            raise ValueError(lines[-1][:200])
        with np.load(target, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


def _results(path: Path, units_name: str) -> dict[str, Any]:
    require(
        path.suffix.lower() == ".rst" and path.is_file(),
        "file",
        str(path),
        "an Ansys file that exists and ends in .rst",
    )
    try:
        result = read_arrays(path)
    except ValueError as error:
        allowed = f"a .rst file with modes that the reader can read ({error})"
        raise describe_error("file", str(path), allowed) from error
    require("shapes" in result, "file", str(path), "a .rst file with modes")
    named = str(result["units"]).strip().upper()
    known = NAMED_UNITS.get(named)
    require(
        known is None or UNIT_SYSTEMS[known] == UNIT_SYSTEMS[units_name],
        "units",
        units_name,
        f"those that {path.name} names, {named}: {known!r}",
    )
    return result


def read_modes(path: Path, units: ConsistentUnits, units_name: str) -> list[MeasuredMode]:
    """Return the modes of a .rst file by rising frequency, in SI units and in global directions.

    The file does not contain the scaling of its shapes. Ansys normalises by mass by default
    (MODOPT, Nrmkey); shapes that are scaled to 1 are refused. Raises ParameterError for a file that
    cannot be read or has no real modes.
    """
    result = _results(path, units_name)
    nodes = result["nodes"].astype(np.int64)
    filled = np.all(np.isfinite(result["shapes"]), axis=(0, 2))
    shapes = result["shapes"][:, filled]
    require(shapes.size > 0, "file", str(path), "a .rst file with modes at one node or more")
    largest = np.max(np.abs(shapes), axis=(1, 2))
    require(
        bool(np.any(np.abs(largest - 1) > UNITY_TOL)),
        "file",
        f"{path}: the largest number of every shape is 1",
        "shapes scaled by the mass (MODOPT with Nrmkey OFF)",
    )
    modes = []
    for k, hertz in enumerate(map(float, result["hertz"])):
        require(
            hertz > 0,
            "file",
            f"{path}, mode {k + 1}, frequency {hertz:.6g}",
            "frequencies above 0: a rigid-body motion needs that of its suspension",
        )
        omega = 2 * np.pi * hertz / units.time
        shape = shapes[k] / np.sqrt(units.mass)
        modes.append(MeasuredMode(omega, None, nodes[filled], shape, True, k + 1))
    return without_repeats(path, sorted(modes, key=lambda mode: mode.omega))


def read_nodes(
    path: Path, units: ConsistentUnits, units_name: str
) -> tuple[NDArray[np.int64], Real]:
    """Return numbers (N,) and coordinates (N, 3) in m of the nodes of a .rst file."""
    result = _results(path, units_name)
    return result["mesh_nodes"].astype(np.int64), result["points"] * units.length


def read_full(path: Path, letter: str) -> tuple[Any, tuple[tuple[int, int], ...]]:
    """Return a matrix of a .full file, M or K, and the freedom of each row.

    A freedom is (node, freedom 1 to 6). Raises ValueError if the file does not have the matrix.
    """
    result = read_arrays(path)
    if letter not in ("M", "K") or letter not in result:
        raise ValueError(f"a .full file with the matrix {letter}")
    freedoms = result["freedoms"]
    if np.any(freedoms[:, 1] > 5):
        raise ValueError("it has freedoms other than displacements and rotations")
    size = int(result["size"])
    entries = (result[letter], (result[f"{letter}_rows"], result[f"{letter}_columns"]))
    matrix = scipy.sparse.coo_matrix(entries, shape=(size, size))
    return matrix, tuple((int(node), int(axis) + 1) for node, axis in freedoms)
