"""One design as a picture: where each of its free numbers lies within its bounds."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from optimisation.designs import Design, DesignSpace
from optimisation.files import replacing


def save_card(path: Path, space: DesignSpace, design: Design) -> None:
    """Draw a line from bound to bound for each free variable, with the design and the start of a search on it; the ending chooses the format."""
    figure = Figure(figsize=(7, 0.8 + 0.55 * len(space.free)), layout="constrained")
    axes = figure.subplots()
    axes.plot(space.shares(space.default), range(len(space.free)), "|", ms=16, color="0.4")
    axes.plot(space.shares(design), range(len(space.free)), "o", ms=9)
    labels = [f"{v.name.replace('_', ' ')} {design.values[v.name]:.4g} {v.si}".rstrip() for v in space.free]
    axes.set_yticks(range(len(labels)), labels)
    axes.set_xticks([0, 1], ["lower bound", "upper bound"])
    axes.set(xlim=(-0.03, 1.03), ylim=(len(labels) - 0.5, -0.5), title=f"{design.concept} absorber; line: start of a search")
    axes.grid(axis="y", color="0.85")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=160, format=path.suffix[1:])
