"""Modes, shapes and masses of a structure from a file."""

from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.assurance import ModeComparison, compare_modes
from impact_env.modes import ModalModel
from impact_env.parameters import Beam
from impact_env.plain_files import read_plain
from impact_env.plain_structures import read_structure_nodes
from impact_env.structures.matrix_files import read_coordinates
from optimisation.cli.common import (
    BadInput,
    check_targets,
    command,
    name_files,
    plain_errors,
)
from optimisation.cli.options import FILE, OptionSpec, file_spec, option
from optimisation.cli.scene_options import read_structure
from optimisation.files import markdown, write_files
from optimisation.mounting import model_with_absorber_at
from optimisation.report.figures import save_structure
from optimisation.report.report import Column, Table

Array = NDArray[np.float64]
NEAREST = 3  # nodes told


COLUMNS = (
    Column("mode", "mode", "{:.0f}"),
    Column("frequency_hz", "Hz", "{:.5g}"),
    Column("damping_ratio", "damping, %", "{:.3g}", 100),
    Column("force_shape_per_sqrt_kg", "force"),
    Column("tip_shape_per_sqrt_kg", "absorber"),
    Column("response_shape_per_sqrt_kg", "response"),
    Column("mass_at_absorber_kg", "mass at the absorber, kg", unknown="inf"),
    Column("free_amplitude_m_per_n", "free amplitude, mm/N", scale=1e3, unknown="inf"),
)


def mode_table(model: ModalModel) -> Table:
    """Return a row for each mode, SI units; ``free_amplitude_m_per_n``: of the level's place at its resonance, by this mode alone."""
    rows = []
    for k in range(model.modes):
        omega = float(model.omega[k])
        damping = float(model.damping_ratio[k])
        force, tip, level = (
            float(row[k])
            for row in (model.one_phase_force_shape, model.tip_shape, model.level_shape)
        )
        mass = 1 / tip**2 if tip else np.inf
        free = abs(force * level) / (2 * damping * omega**2) if damping else np.inf
        rows.append((k + 1, omega / (2 * np.pi), damping, force, tip, level, mass, free))
    return Table(COLUMNS, rows)


def text(model: ModalModel, structure: Beam | ModalModel) -> str:
    """Return mass, places and a line for each mode."""
    printed = [
        f"mass {model.beam_mass:.4g} kg: an absorber of 1 % has {0.01 * model.beam_mass:.4g} kg"
    ]
    if isinstance(structure, Beam):
        x = [structure.force_position, structure.absorber_position, structure.response_position]
        places = ", ".join(f"{p:g}" for p in x if p is not None)
        printed.append(
            f"force, absorber and response at {places} of the length, {structure.length:g} m"
        )
        printed.append(
            f"bending stiffness {structure.bending_stiffness:.5g} N m^2, mass per length {structure.mass_per_length:.5g} kg/m"
        )
    elif len(model.places) > 1:
        printed.append(f"{len(model.places)} places for absorbers; the first is shown")
    note = "Shapes at the places in use, in 1/sqrt(kg); free amplitude: at the response, one mode alone."
    return "\n".join([*printed, "", mode_table(model).to_text(), "", note])


def coordinates(path: Path) -> tuple[str, NDArray[np.int64], Array]:
    """Return the word for rows or nodes, their numbers (N,) and their places (N, 3) in m; raises BadInput if the file has none."""
    plain = read_plain(path)
    nodes = read_structure_nodes(path.parent, plain)
    if nodes is not None:
        return ("node", *nodes)
    name = plain.get("matrices", {}).get("coordinates")
    if name is None:
        raise BadInput(
            "--near is for files with nodes (universal, nastran, ansys), or matrices with the key coordinates"
        )
    places = read_coordinates(path.parent / name)
    return "row", np.arange(len(places)), places


def nearest(path: Path, point: tuple[float, float, float]) -> str:
    """Return the nodes of a file, or the rows of its matrices, nearest to a point in m; rows of one node are listed together."""
    what, numbers, places = coordinates(path)
    distances = np.linalg.norm(places - np.array(point), axis=1)
    lines = []
    for distance in np.unique(distances.round(12))[:NEAREST]:
        nearest_nodes = numbers[np.isclose(distances, distance, atol=1e-12, rtol=0)]
        lines.append(f"{what} {', '.join(map(str, nearest_nodes))}: {1e3 * distance:.4g} mm away")
    return "\n".join(lines)


def assurance_text(comparison: ModeComparison) -> str:
    """Return a table of the modal assurance criterion, a line for each mode of the first file, and the mode of the second that is most alike."""
    header = ("mode", "Hz", *(f"{hertz:.5g} Hz" for hertz in comparison.second), "most alike")
    lines = []
    for k, hertz in enumerate(comparison.first):
        row = comparison.assurance[k]
        best = int(np.argmax(row))
        shift = 100 * (comparison.second[best] / hertz - 1)
        alike = f"mode {best + 1}, {shift:+.2f} %"
        lines.append((str(k + 1), f"{hertz:.5g}", *(f"{value:.3f}" for value in row), alike))
    note = (
        f"Modal assurance criterion at {comparison.places} places and directions that move in both files, "
        "1: the same shape; columns: modes of the second file. Last column: its frequency over that of the first."
    )
    return "\n".join([markdown(header, lines), "", note])


def assurance_data(comparison: ModeComparison) -> dict[str, object]:
    """Return the comparison as plain data."""
    return {
        "places": comparison.places,
        "first_frequencies_hz": comparison.first.tolist(),
        "second_frequencies_hz": comparison.second.tolist(),
        "assurance": comparison.assurance.tolist(),
    }


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
    """Show the structure of FILE: modes, shapes at force, absorber and response, masses; and the node nearest to a point."""
    with plain_errors():
        check_targets({"json": options.json, "plot": options.plot})
        structure = read_structure(options.file)
        model = model_with_absorber_at(structure)
        printed = [
            text(model, structure),
            *(["", nearest(options.file, options.near)] if options.near is not None else []),
        ]
        comparison = None
        if options.second is not None:
            comparison = compare_modes(options.file, options.second)
        if comparison is not None:
            printed += ["", assurance_text(comparison)]
        click.echo("\n".join(printed))
        files = write_files(
            {
                options.json: {
                    "mass_kg": model.beam_mass,
                    "modes": mode_table(model).records(),
                    **({} if comparison is None else {"mac": assurance_data(comparison)}),
                },
                options.plot: lambda path: save_structure(path, structure),
            }
        )
    name_files(files)
