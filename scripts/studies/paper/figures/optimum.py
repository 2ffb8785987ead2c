"""The figure of the best operating point over mass ratio and restitution."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studies.paper.optimum import rows_of
from studies.paper.style import LOOKS, REFERENCE, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the best force over the rule's, and the level there, over the mass ratio: a line for each restitution."""
    figure, axes = panels(1, 2, 3.0)
    force, level = axes[0]
    rows = rows_of(values)
    for e, look in zip(sorted({row["restitution"] for row in rows}), LOOKS, strict=False):
        own = [row for row in rows if row["restitution"] == e]
        mass, ratio = [100 * row["mass"] for row in own], np.array([row["ratio"] for row in own])
        single = np.array([row["nominal_best"] for row in own])
        line(force, mass, ratio[:, 0], look, f"$e$ = {e:g}", band=(ratio[:, 1], ratio[:, 2]), nominal=single[:, 0])
        band = 100 * np.array([row["level_band"] for row in own])
        line(level, mass, [100 * row["level"] for row in own], look, band=(band[:, 0], band[:, 1]), nominal=100 * single[:, 1])
    force.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=1, label="design rule")
    force.set(xlabel="mass ratio in %", ylabel="best force over the rule's", ylim=(0, None))
    level.set(xlabel="mass ratio in %", ylabel="level there in % of no absorber", ylim=(0, None))
    finish([force], path, figure)
