"""The figure of the level over the number of modes at both resonances."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studies.paper.modes_needed import OPTIMUM, at, forces_of, numbers
from studies.paper.style import LOOKS, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the relative level over the number of modes: the paper's best force at each resonance, and the second one's other forces."""
    figure, axes = panels(1, 2, 3.0)
    own, forces = axes[0]
    modes = numbers(values)
    for resonance, look, name in ((1, LOOKS[1], "first"), (2, LOOKS[0], "second")):
        middle, low, high, nominal = 100 * np.array([at(values, n, resonance) for n in modes]).T
        line(own, modes, middle, look, f"{name} resonance, {OPTIMUM[resonance]:g} N", band=(low, high), nominal=nominal)
    for force, look in zip(forces_of(values, 2), LOOKS, strict=False):
        middle, low, high, nominal = 100 * np.array([at(values, n, 2, force) for n in modes]).T
        line(forces, modes, middle, look, f"{force:g} N", band=(low, high), nominal=nominal)
    for panel in (own, forces):
        panel.set(xlabel="modes $N_m$", ylabel="level in % of no absorber", ylim=(0, None), xticks=modes)
    forces.set_title("second resonance")
    finish(axes, path, figure)
