"""Report on a structure.

It has masses, a line for each mode, a comparison with the mode shapes of another file, and the
figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.assurance import ModeComparison
from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.parameters import Beam
from optimisation.mounting import model_with_absorber_at, with_response_point
from optimisation.report.report import BLUE, MM, ORANGE, Block, Column, Report, Table, figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_DRAWN = 6  # modes
POINTS = 201  # of a beam's shape
PLACES = (("force", ORANGE, "v", 7), ("absorber", BLUE, "s", 9), ("response", "#F0E442", "o", 5))
COLUMNS = (
    Column("mode", "mode", "{:.0f}"),
    Column("frequency_hz", "Hz", "{:.5g}"),
    Column("damping_ratio", "damping, %", "{:.3g}", 100),
    Column("force_shape_per_sqrt_kg", "force"),
    Column("tip_shape_per_sqrt_kg", "absorber"),
    Column("response_shape_per_sqrt_kg", "response"),
    Column("mass_at_absorber_kg", "mass at the absorber, kg", unknown="inf"),
    Column("free_amplitude_m_per_n", "free amplitude, mm/N", scale=MM, unknown="inf"),
)


def make_structure_report(
    structure: Structure, nearest: Sequence[str] = (), comparison: ModeComparison | None = None
) -> Report:
    """Return what `structure` prints and writes.

    ``nearest``: lines on the nodes nearest to a point; ``comparison``: with the modes of another
    file.
    """
    model = model_with_absorber_at(structure)
    table = mode_table(model)
    note = (
        "Shapes at the places in use, in 1/sqrt(kg); free amplitude: at the response, one mode "
        "alone."
    )
    text: list[Block] = [mass_lines(model, structure), [table], [note], nearest]
    numbers: dict[str, Any] = {"mass_kg": model.beam_mass, "modes": table.records()}
    if comparison is not None:
        note = (
            f"Modal assurance criterion at {comparison.places} places and directions that "
            "move in both files, "
            "1: the same shape; columns: modes of the second file. Last column: its frequency "
            "over that of the first."
        )
        text += [[assurance_table(comparison)], [note]]
        numbers["mac"] = assurance_numbers(comparison)
    return Report(
        title="Structure",
        text=text,
        numbers=numbers,
        figures={"structure.png": partial(draw_structure, structure)},
    )


def mode_table(model: ModalModel) -> Table:
    """Return a row for each mode, in SI units.

    ``free_amplitude_m_per_n``: amplitude at the level's place at the mode's resonance, by this mode
    alone.
    """
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


def mass_lines(model: ModalModel, structure: Structure) -> list[str]:
    """Return mass, places and stiffness in lines."""
    lines = [
        f"mass {model.beam_mass:.4g} kg: an absorber of 1 % has {0.01 * model.beam_mass:.4g} kg"
    ]
    if isinstance(structure, Beam):
        x = [structure.force_position, structure.absorber_position, structure.response_position]
        places = ", ".join(f"{p:g}" for p in x if p is not None)
        lines += [
            f"force, absorber and response at {places} of the length, {structure.length:g} m",
            (
                f"bending stiffness {structure.bending_stiffness:.5g} N m^2, mass per length "
                f"{structure.mass_per_length:.5g} kg/m"
            ),
        ]
    elif len(model.places) > 1:
        lines.append(f"{len(model.places)} places for absorbers; the first is shown")
    return lines


def assurance_table(comparison: ModeComparison) -> Table:
    """Return a table of the modal assurance criterion.

    It has a line for each mode of the first file, with the most similar mode of the second file.
    """
    header = ("mode", "Hz", *(f"{hertz:.5g} Hz" for hertz in comparison.second), "most alike")
    rows = []
    for k, hertz in enumerate(comparison.first):
        row = comparison.assurance[k]
        best = int(np.argmax(row))
        shift = 100 * (comparison.second[best] / hertz - 1)
        alike = f"mode {best + 1}, {shift:+.2f} %"
        rows.append((str(k + 1), f"{hertz:.5g}", *(f"{value:.3f}" for value in row), alike))
    return Table.of_words(header, rows)


def assurance_numbers(comparison: ModeComparison) -> dict[str, object]:
    """Return the comparison as plain data."""
    return {
        "places": comparison.places,
        "first_frequencies_hz": comparison.first.tolist(),
        "second_frequencies_hz": comparison.second.tolist(),
        "assurance": comparison.assurance.tolist(),
    }


def draw_structure(structure: Structure) -> Figure:
    """Draw a structure: a beam over its length, modes at their places alone as points."""
    model = model_with_absorber_at(structure)
    drawn = min(model.modes, MOST_DRAWN)
    figure, panels = figure_of(8, 1.0 + 1.1 * drawn, drawn, sharex=True)
    panels = np.ravel(panels)
    shapes = (model.one_phase_force_shape, model.tip_shape, model.level_shape)
    beam = with_response_point(structure) if isinstance(structure, Beam) else None
    for k, panel in enumerate(panels):
        panel.axhline(0, color="0.8", lw=0.8)
        if isinstance(beam, Beam):
            at = np.linspace(0, 1, POINTS)
            panel.plot(at, mode_shapes(beam, at)[:, k], color="0.35")
            places = [beam.force_position, beam.absorber_position, beam.response_position]
        else:
            places = [0.0, 1.0, 2.0]
        for place, shape, (name, colour, mark, size) in zip(places, shapes, PLACES, strict=True):
            panel.plot([place], [shape[k]], mark, color=colour, label=name, ms=size)
        words = (
            f"mode {k + 1}, {model.omega[k] / (2 * np.pi):.4g} Hz, damping "
            f"{100 * model.damping_ratio[k]:.3g} %"
        )
        panel.set_title(words, fontsize=9, loc="left")
    panels[0].legend(ncols=3, fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1, 1))
    if isinstance(beam, Beam):
        panels[-1].set_xlabel("place over the length")
    else:
        panels[-1].set_xticks([0, 1, 2], [name for name, *_ in PLACES])
    figure.supylabel("shape in 1/sqrt(kg)", fontsize=9)
    return figure
