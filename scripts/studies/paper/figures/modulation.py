"""The figure of the modulation over the number of modes, and of the energy that leaves the resonant mode."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studies.paper.style import FAINT, LOOKS, finish, line, panels
from studies.study import Json

NAMED = (1, 2, 3, 4, 5, 7, 10, 12, 30)  # numbers of modes that stand beside their points


def save(path: Path, values: Json) -> None:
    """Draw depth and energies over the number of modes, beside one mode with the equivalent restitution; and the depth over that."""
    figure, axes = panels(1, 3, 2.9)
    depth, energy, over = axes[0]
    many, other, one = values["modes"], values["equivalent"], values["one mode"]
    modes = [row["modes"] for row in many]
    for rows, look, label in ((many, LOOKS[0], "$N_m$ modes, $e$ = 1"), (other, LOOKS[1], "one mode, $e_1$")):
        low, high = _edges(rows, "depth")
        line(depth, modes, _middle(rows, "depth"), look, label, band=(low, high), nominal=_nominal(rows, "depth"))
    line(energy, modes, 100 * _middle(many, "taken"), LOOKS[0], "taken, $N_m$ modes")
    line(energy, modes, 100 * _middle(other, "taken"), LOOKS[1], "taken, one mode, $e_1$")
    line(energy, modes, 100 * _middle(many, "absorber"), LOOKS[2], "in the absorber")
    for panel in (depth, energy):
        panel.set(xscale="log", xlabel="modes $N_m$")
        panel.set_xticks(modes, [f"{n}" if n in (1, 2, 3, 5, 10, 20, 30) else "" for n in modes], minor=False)
        panel.minorticks_off()
    line(over, [row["restitution"] for row in one], _middle(one, "depth"), LOOKS[1], "one mode over $e$", band=_edges(one, "depth"))
    line(over, [row["restitution"] for row in many], _middle(many, "depth"), LOOKS[0], marked=False)
    over.lines[-1].set(ls="", marker=LOOKS[0].marker, label="$N_m$ modes at their $e_1$")
    for e in dict.fromkeys(row["restitution"] for row in many):
        own = [row for row in many if row["restitution"] == e]  # several that are set to 0
        words, height = ", ".join(str(row["modes"]) for row in own if row["modes"] in NAMED), max(row["depth"][0] for row in own)
        over.annotate(words, (e, height), xytext=(2, 4), textcoords="offset points", fontsize=6.5, color=FAINT)
    depth.set(ylabel="depth of the modulation", ylim=(0, 0.95))
    energy.set(ylabel="share in %", ylim=(0, 125), yticks=range(0, 101, 20))
    over.set(xlabel="restitution of one mode, $e_1$", ylabel="depth of the modulation", ylim=(0, None))
    depth.legend(loc="upper right")
    over.legend(loc="lower right", fontsize=6.5)
    finish(axes, path, figure)


def _middle(rows: list[Json], name: str) -> np.ndarray:
    return np.array([row[name][0] for row in rows])


def _nominal(rows: list[Json], name: str) -> np.ndarray:
    return np.array([row[name][3] for row in rows])


def _edges(rows: list[Json], name: str) -> tuple[np.ndarray, np.ndarray]:
    return np.array([row[name][1] for row in rows]), np.array([row[name][2] for row in rows])
