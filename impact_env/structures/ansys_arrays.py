"""Write the content of an Ansys file to a .npz file.

It runs in a separate process, because the reader ends its process on damaged files.

Usage: python -P ansys_arrays.py FILE TARGET. An error is a line on stderr, with exit status 1.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

MODAL = 2  # kind of analysis in a file's header
WORD = 4
TRANSLATIONS = ("UX", "UY", "UZ")


def collect_results(result: Any) -> dict[str, Any]:
    """Return frequencies, shapes, nodes and coordinates of a .rst file.

    Frequencies are in 1/unit of time. Shapes (modes, nodes, 3) are in global directions.
    """
    header = result._resultheader
    if int(header["kan"]) != MODAL:
        raise ValueError(f"the analysis is of kind {int(header['kan'])}, not modal ({MODAL})")
    if int(header["nSector"]) > 1:
        raise ValueError("the model is one sector of a cyclic structure")
    if int(header["cpxrst"]):
        raise ValueError("the modes are complex")
    number = len(result.time_values)
    shapes = []
    nodes = None
    for k in range(number):
        named = result.result_dof(k)
        if any(axis not in named for axis in TRANSLATIONS):
            raise ValueError(f"its degrees of freedom are {', '.join(named)}, not UX, UY, UZ")
        own, values = result.nodal_solution(k)
        if nodes is not None and not np.array_equal(own, nodes):
            raise ValueError(f"mode {k + 1} is listed at other nodes than mode 1")
        nodes = own
        shapes.append(values[:, [list(named).index(axis) for axis in TRANSLATIONS]])
    mesh = result.mesh
    return {
        "hertz": np.asarray(result.time_values, dtype=float),
        "shapes": np.array(shapes),
        "nodes": np.asarray(nodes),
        "mesh_nodes": np.asarray(mesh.nnum),
        "points": np.asarray(mesh.nodes[:, :3]),
        "units": str(header["units"]),
    }


def collect_matrices(full: Any) -> dict[str, Any]:
    """Return the stiffness and mass matrices of a .full file.

    They are rows, columns and values, with the node and freedom of each row.
    """
    freedoms, stiffness, mass = full.load_km(sort=False)
    result = {"freedoms": np.asarray(freedoms), "size": stiffness.shape[0]}
    for name, matrix in (("K", stiffness), ("M", mass)):
        entries = matrix.tocoo()
        result |= {f"{name}_rows": entries.row, f"{name}_columns": entries.col, name: entries.data}
    return result


def main(source: str, target: str) -> None:
    """Read ``source`` and write ``target``."""
    from ansys.mapdl.reader import read_binary

    file = read_binary(source)
    kind = type(file).__name__
    if kind == "FullFile":
        result = collect_matrices(file)
    elif kind == "Result":
        words = int(file._resultheader["ptrend"])  # of four bytes, up to the end of the results
        if WORD * words > Path(source).stat().st_size:
            raise ValueError("the file is cut")
        result = collect_results(file)
    else:
        raise ValueError(f"it is a {kind}, not a .rst file of modes or a .full file")
    np.savez(target, **result)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        lines = str(error).strip().splitlines() or [""]
        print(f"{type(error).__name__}: {lines[0]}", file=sys.stderr)
        raise SystemExit(1) from None
