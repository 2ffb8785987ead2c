"""Modes, shapes and masses of a structure from a file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.assurance import compare_modes
from impact_env.plain_files import read_plain
from impact_env.plain_structures import read_structure_nodes
from impact_env.structures.matrix_files import read_coordinates
from optimisation.cli.common import (
    BadInput,
    check_targets,
    command,
    plain_errors,
    write_report,
)
from optimisation.cli.options import FILE, OptionSpec, file_spec, option
from optimisation.cli.scene_options import read_structure
from optimisation.report.structure_report import make_structure_report

Array = NDArray[np.float64]
NEAREST = 3  # distances that are listed


def coordinates(path: Path) -> tuple[str, NDArray[np.int64], Array]:
    """Return the word "rows" or "nodes", their numbers (N,) and coordinates (N, 3) in m.

    Raises BadInput if the file has none.
    """
    plain = read_plain(path)
    nodes = read_structure_nodes(path.parent, plain)
    if nodes is not None:
        return ("node", *nodes)
    name = plain.get("matrices", {}).get("coordinates")
    if name is None:
        raise BadInput(
            "--near is for files with nodes (universal, nastran, ansys), or matrices with the "
            "key coordinates"
        )
    places = read_coordinates(path.parent / name)
    return "row", np.arange(len(places)), places


def find_nearest(path: Path, point: tuple[float, float, float]) -> list[str]:
    """Return lines with the nodes of a file that are nearest to a point in m.

    For a file of matrices the lines have the rows of its matrices. Rows of one node are listed
    together.
    """
    what, numbers, places = coordinates(path)
    distances = np.linalg.norm(places - np.array(point), axis=1)
    lines = []
    for distance in np.unique(distances.round(12))[:NEAREST]:
        nearest_nodes = numbers[np.isclose(distances, distance, atol=1e-12, rtol=0)]
        lines.append(f"{what} {', '.join(map(str, nearest_nodes))}: {1e3 * distance:.4g} mm away")
    return lines


@dataclass(frozen=True, kw_only=True)
class StructureOptions:
    """Options of ``structure``; None: not given."""

    file: Path = option(
        OptionSpec(names=("file",), help="Structure file", type=FILE, required=True)
    )
    near: tuple[float, float, float] | None = option(
        OptionSpec(
            names=("--near",),
            help="Name the nodes, or rows of matrices, nearest to this point in m",
            type=(float, float, float),
            metavar="X Y Z",
            usual=True,
        )
    )
    second: Path | None = option(
        file_spec(
            "--mac",
            "Compare the mode shapes with those of this structure file",
            more="By the modal assurance criterion.",
            usual=True,
            section="Computation",
        )
    )
    json: Path | None = option("json", help="Write mass and modes")
    plot: Path | None = option("plot", help="Draw the shapes and the places")


@command(StructureOptions, examples=("structure arm.toml", "structure arm.toml --plot arm.png"))
def main(options: StructureOptions) -> None:
    """Show the structure of FILE: modes, masses, and shapes at force, absorber and response.

    The node nearest to a given point is shown as well.
    """
    with plain_errors():
        check_targets({"json": options.json, "plot": options.plot})
        structure = read_structure(options.file)
        nearest = find_nearest(options.file, options.near) if options.near is not None else []
        comparison = None
        if options.second is not None:
            comparison = compare_modes(options.file, options.second)
        write_report(make_structure_report(structure, nearest, comparison), options)
