"""The figure of levels from random starts."""

from __future__ import annotations

from pathlib import Path

from studies.paper.starts import CHOICES, bands, relative
from studies.paper.style import LOOKS, finish, line, panels
from studies.study import Json


def save(path: Path, values: Json) -> None:
    """Draw the level over that of the paper's start, over the force, in a panel for each absorber."""
    figure, axes = panels(1, len(values), 2.9, sharey=True)
    for panel, (absorber, group) in zip(axes[0], values.items(), strict=True):
        for choice, look in zip(CHOICES, LOOKS, strict=False):
            low, middle, high = bands(group, choice)
            name = f"{choice} start" if choice == CHOICES[0] else f"random: {choice}"
            own = relative(group, choice)[:, 0] if choice == CHOICES[0] else None  # the paper's run: others are drawn
            line(panel, group["forces_n"], middle, look, name, band=(low, high), nominal=own)
        panel.set(xscale="log", xlabel="force in N")
        shown = [x for k, x in enumerate(group["forces_n"]) if x >= 1.4 * group["forces_n"][k - 1] or k % 2 == 0]  # others would overlap
        panel.set_xticks(group["forces_n"], [f"{x:g}" if x in shown else "" for x in group["forces_n"]])
        panel.minorticks_off()
        panel.set_title(absorber, loc="right")
    axes[0, 0].set(ylabel="level over the paper's start", ylim=(0, None))
    finish([axes[0, 0]], path, figure)
