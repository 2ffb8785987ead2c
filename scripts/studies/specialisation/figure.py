"""The figure of the specialisation report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from optimisation.report.written_figure import write_figure
from studies.specialisation.page import PARTS, counts, name_of
from studies.specialisation.results import Results

COLOURS = {"exact": "#0072B2", "moreau": "#D55E00", "runge-kutta": "#009E73"}


def save_figure(path: Path, results: Results) -> None:
    """Draw the report; the ending of ``path`` chooses the format."""
    entries = list(results.own.values())
    figure = Figure(figsize=(14, 4 + 0.32 * max(len(entries), len(results.pairs))), layout="constrained")
    axes = figure.subplots(1, 3)
    _draw_compile(axes[0], entries)
    _draw_code(axes[1], entries)
    _draw_pairs(axes[2], results.pairs)
    figure.suptitle("What each scene compiles, and what a part costs that is only switched off", fontsize=13)
    write_figure(figure, path, 120)


def _draw_compile(ax: Axes, entries: list[dict[str, Any]]) -> None:
    y = np.arange(len(entries))[::-1]
    ax.barh(y + 0.2, [entry["cold_s"] for entry in entries], 0.38, color="#0072B2", label="cold: compiled")
    ax.barh(y - 0.2, [entry["cached_s"] for entry in entries], 0.38, color="#56B4E9", label="from the cache")
    ax.set_yticks(y, [name_of(entry) for entry in entries], fontsize=8)
    ax.set(xscale="log", xlabel="first run of one pseudo period, s")
    ax.set_title("compile time", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)


def _draw_code(ax: Axes, entries: list[dict[str, Any]]) -> None:
    y = np.arange(len(entries))[::-1]
    left = np.zeros(len(entries))
    colours = (
        "#D55E00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#AA4499", "#332288", "#882255", "#999999", "#E69F00", "#F0E442", "#44AA99", "#117733",
        "#000000", "#BBBBBB",
    )  # fmt: skip
    for part, colour in zip(PARTS, colours, strict=True):
        width = np.array([counts(entry)[part] for entry in entries], dtype=float)
        if width.any():
            ax.barh(y, width, 0.7, left=left, color=colour, label=part.replace("_", " "))
        left += width
    ax.set_yticks(y, [""] * len(entries))
    ax.set(xlabel="arithmetic operations written in its compiled functions")
    ax.set_title("what the compiled code contains, by module", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4, frameon=False)


def _draw_pairs(ax: Axes, pairs: list[dict[str, Any]]) -> None:
    y = np.arange(len(pairs))[::-1]
    for pair, at in zip(pairs, y, strict=True):
        method = next(name for name in COLOURS if f", {name}" in pair["without"])
        ends = pair["without_ns"] / 1e3, pair["switched_off_ns"] / 1e3
        ax.plot(ends, (at, at), color="0.7", lw=2, zorder=1)
        ax.plot(ends[0], at, "o", color=COLOURS[method], ms=7)
        ax.plot(ends[1], at, "D", mfc="white", mec=COLOURS[method], ms=6)
        ax.annotate(f"{pair['ratio']:.2f}", (max(ends), at), xytext=(8, 0), textcoords="offset points", va="center", fontsize=8)
    ax.set_yticks(y, [pair["part"] for pair in pairs], fontsize=8)
    ax.set(xscale="log", xlabel="us per pseudo period")
    if pairs:
        highest = max(max(pair["without_ns"], pair["switched_off_ns"]) for pair in pairs) / 1e3
        ax.set_xlim(None, 3 * highest)
    ax.plot([], [], "o", color="0.3", label="without the part")
    ax.plot([], [], "D", mfc="white", mec="0.3", label="with it, switched off by its value (records: on)")
    ax.set_title("cost of a part that does nothing", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=1, frameon=False)
