"""The picture of a structure: the shapes of its lowest modes, with the places of force, absorber and response."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.parameters import Beam
from optimisation.mounting import mounted, watched
from optimisation.report.written_figure import write_figure

MOST, POINTS = 6, 201
PLACES = (("force", "#D55E00", "v", 7), ("absorber", "#0072B2", "s", 9), ("response", "#F0E442", "o", 5))


def save_figure(path: Path, structure: Structure) -> None:
    """Draw it; a beam over its length, modes at their places alone as points. The ending of ``path`` chooses the format."""
    model = mounted(structure)
    shown = min(model.modes, MOST)
    figure = Figure(figsize=(8, 1.0 + 1.1 * shown), layout="constrained")
    panels = figure.subplots(shown, 1, sharex=True, squeeze=False)[:, 0]
    shapes = (model.force_shape, model.tip_shape, model.level_shape)
    beam = watched(structure) if isinstance(structure, Beam) else None
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
        panel.set_title(_title(model, k), fontsize=9, loc="left")
    panels[0].legend(ncols=3, fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1, 1))
    if isinstance(beam, Beam):
        panels[-1].set_xlabel("place over the length")
    else:
        panels[-1].set_xticks([0, 1, 2], [name for name, *_ in PLACES])
    figure.supylabel("shape in 1/sqrt(kg)", fontsize=9)
    write_figure(figure, path)


def _title(model: ModalModel, k: int) -> str:
    return f"mode {k + 1}, {model.omega[k] / (2 * np.pi):.4g} Hz, damping {100 * model.damping_ratio[k]:.3g} %"
