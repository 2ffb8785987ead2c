"""The figure of the stability report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from optimisation.report.written_figure import write_figure
from studies.stability.cells import FAILED, REFUSED
from studies.stability.tasks import Results

COLOURS = {"exact": "#0072B2", "moreau": "#D55E00", "runge-kutta": "#009E73"}
LABELS = {"exact": "exact", "moreau": "Moreau", "runge-kutta": "Runge-Kutta"}
SMALLEST = 1e-16
SOAK_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


def save_figure(path: Path, results: Results) -> None:
    """Draw the report; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(14, 10.5), layout="constrained")
    grid = figure.add_gridspec(2, 6, height_ratios=(1.15, 1))
    _matrix(figure.add_subplot(grid[0, :4]), results)
    _limits(figure.add_subplot(grid[0, 4:]), results)
    _stiffness(figure.add_subplot(grid[1, :2]), results)
    _eigen(figure.add_subplot(grid[1, 2:4]), results)
    _soak(figure.add_subplot(grid[1, 4:]), results)
    figure.suptitle("Stiff and extreme cases, step limits, eigenproblem and very long runs", fontsize=14)
    write_figure(figure, path, 130)


def _matrix(ax: Axes, results: Results) -> None:
    groups = list(dict.fromkeys(cell["group"] for cell in results.cells))
    generator = np.random.default_rng(0)
    offsets = {"exact": 0.25, "moreau": 0.0, "runge-kutta": -0.25}
    for cell in results.cells:
        y = len(groups) - 1 - groups.index(cell["group"]) + offsets[cell["method"]] + generator.uniform(-0.09, 0.09)
        colour = COLOURS[cell["method"]]
        if cell["verdict"] == FAILED:
            ax.plot(1e3 * generator.uniform(0.6, 1.6), y, "X", color="black", ms=8, zorder=4)
        elif cell["verdict"] == REFUSED:
            ax.plot(3e1 * 3 ** generator.uniform(-1, 1), y, "x", color=colour, ms=4, mew=1, alpha=0.8)
        elif cell["deviation"] is not None:
            ax.plot(max(cell["deviation"], SMALLEST), y, "o", color=colour, ms=3.2, alpha=0.7)
    ax.axvspan(6, 2e2, color="0.93", zorder=0)
    ax.set(xscale="log", xlim=(0.5 * SMALLEST, 4e3), ylim=(-1.5, len(groups) - 0.4))
    ax.set_yticks(range(len(groups)), groups[::-1])
    ticks = 10.0 ** np.arange(-16, 1, 2)
    ax.set_xticks([*ticks, 3e1, 1e3], [*(f"$10^{{{int(np.log10(t))}}}$" for t in ticks), "refused", "failed"], fontsize=8)
    ax.minorticks_off()
    ax.set_xlabel("largest distance from an independent reference, relative, up to the first impacts")
    handles = [Line2D([], [], marker="o", ls="", color=colour, label=LABELS[method]) for method, colour in COLOURS.items()]
    ax.legend(handles=handles, loc="lower left", fontsize=9, ncols=3)
    ax.grid(axis="x", color="0.9")
    ax.set_title("each case with each method, its usual step", fontsize=11)


def _limits(ax: Axes, results: Results) -> None:
    for method in ("moreau", "runge-kutta"):
        some = sorted((x for x in results.limits if x["method"] == method and x["what"] == "one mode"), key=lambda x: x["damping_ratio"])
        if not some:
            continue
        ratio = np.maximum([x["damping_ratio"] for x in some], 3e-4)
        ax.plot(ratio, [x["found_s"] * x["omega"] for x in some], "o", color=COLOURS[method], ms=6, label=f"{LABELS[method]}, found")
    ratio = np.geomspace(3e-4, 30, 150)
    ax.plot(ratio, 2 * (np.sqrt(ratio**2 + 1) - ratio), color=COLOURS["moreau"], lw=1.2, label="Moreau, theory")
    ax.plot(ratio, [_runge_kutta_reach(d) for d in ratio], color=COLOURS["runge-kutta"], lw=1.2, label="Runge-Kutta, theory")
    ax.axhline(2 * np.pi / 20, color="0.4", ls="--", lw=1, label="paper's step, 20 a period")
    ax.set(xscale="log", yscale="log", xlabel="damping ratio D (left end: 0)", ylabel=r"largest stable $\omega\,\Delta t$", ylim=(0.02, 6))
    ax.set_title("step limit of one mode", fontsize=11)
    ax.legend(fontsize=8, loc="lower left")
    ax.grid(color="0.92")


def _runge_kutta_reach(ratio: float) -> float:
    """Return the first omega h at which the method grows."""
    s = -(ratio + np.sqrt(complex(ratio**2 - 1)))
    z = s * np.linspace(0, 4, 2001)[1:]
    outside = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) > 1 + 1e-9
    return float(np.abs(z[np.argmax(outside)]) / np.abs(s)) if outside.any() else float("nan")


def _stiffness(ax: Axes, results: Results) -> None:
    for method in ("exact", "runge-kutta"):
        for friction, marker in ((False, "o"), (True, "s")):
            some = [
                (float(cell["case"].split()[0]), cell)
                for cell in results.cells
                if cell["group"] == "contact stiffness" and cell["case"].startswith("1e") and cell["method"] == method
                if "3EI" in cell["case"] and ("friction" in cell["case"]) == friction
            ]
            points = sorted((k, max(cell["deviation"], SMALLEST), cell["wall_s"]) for k, cell in some if cell["deviation"] is not None)
            if points:
                k, deviation, _ = zip(*points, strict=True)
                label = LABELS[method] + (", with elastic friction" if friction else "")
                ax.plot(k, deviation, marker=marker, ms=5, lw=1, ls="--" if friction else "-", color=COLOURS[method], label=label)
    ax.set(
        xscale="log", yscale="log", xlabel="contact stiffness, in $3EI/l^3$", ylabel="largest distance from the reference, relative", ylim=(1e-16, 10)
    )
    ax.set_title("contact stiffness", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, loc="upper left")
    ax.grid(color="0.92")


def _eigen(ax: Axes, results: Results) -> None:
    elements = [x["elements"] for x in results.eigen]
    for mode, colour in (("1", "#0072B2"), ("2", "#D55E00"), ("10", "#009E73")):
        for name, style, what in (("rounding", "o-", "rounding"), ("discretisation", "--", "elements")):
            points = [(n, max(x[name][mode], SMALLEST)) for n, x in zip(elements, results.eigen, strict=True) if mode in x[name]]
            if points:
                ax.plot(*zip(*points, strict=True), style, color=colour, ms=4, lw=1.2, label=f"mode {mode}, {what}")
    ax.set(xscale="log", yscale="log", xlabel="number of elements", ylabel="relative error of the frequency", ylim=(5e-17, 50))
    ax.set_title("eigenproblem", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, ncols=2, loc="upper right")
    ax.grid(color="0.92")


def _soak(ax: Axes, results: Results) -> None:
    other = ax.twinx()
    for soak, style in zip(results.soaks, SOAK_STYLES, strict=False):
        name = next(method for method, label in LABELS.items() if soak["name"].endswith(label))
        ax.plot(soak["lengths"], np.maximum(soak["balance"], SMALLEST), marker="o", ms=4, ls=style, color=COLOURS[name], label=soak["name"])
        other.plot(soak["lengths"], np.array(soak["memory_mb"]) - soak["memory_mb"][0], ls=style, color="0.6", lw=1)
    ax.set(xscale="log", yscale="log", xlabel="pseudo periods", ylabel="energy balance, relative error", ylim=(1e-16, 1e6))
    ax.set_yticks(10.0 ** np.arange(-16, 1, 2))
    other.set(ylabel="memory beyond the shortest run's, MB (grey)", ylim=(-5, 105))
    ax.set_title("very long runs", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, loc="upper left")
    ax.grid(color="0.92")
