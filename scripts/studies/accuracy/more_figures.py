"""The figures of growth, jumps and cost, drawn from rows alone."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from studies.accuracy.cost import LANES, LENGTH, MODES, THREADS
from studies.accuracy.jumps import shares
from studies.accuracy.settings import Row, unique

COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#777777")
MARKERS = "osD^vPX*"


def growth_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw how twins drift apart, and the growth per impact over the number of modes."""
    exponents, twins = [row for row in all_rows if row["impact"] is None], [row for row in all_rows if row["impact"] is not None]
    scenes, modes = unique(row["scene"] for row in exponents), unique(row["modes"] for row in exponents)
    most = 10 if 10 in modes else modes[-1]
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for scene, colour, marker in zip(scenes, COLOURS, MARKERS, strict=False):
        line = [row for row in twins if row["scene"] == scene and row["modes"] == most]
        if line:
            y = np.maximum([row["difference_periods"] for row in line], 1e-17)
            left.plot([row["impact"] for row in line], y, color=colour, marker=marker, ms=3.5, lw=1)
        points = [row for row in exponents if row["scene"] == scene and row["factor_per_impact"] is not None]
        if points:
            right.plot(
                [row["modes"] for row in points], [row["factor_per_impact"] for row in points], color=colour, marker=marker, ms=6, lw=1, label=scene
            )
    left.axhline(1.0, color="0.6", lw=0.8, ls=":")
    left.set(
        yscale="log", xlabel="impact", ylabel="difference of its time, pseudo periods", title=f"Twins that differ by rounding, {most} modes: median"
    )
    right.set(xscale="log", xlabel="number of modes", ylabel="factor by which errors grow per impact", title="From the largest Lyapunov exponent")
    _plain(right, modes)
    right.axhline(1.0, color="0.6", lw=0.8, ls=":")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    for panel in (left, right):
        panel.grid(True, color="0.9", lw=0.6)
    return {"growth": figure}


def _plain(panel: Axes, ticks: list[float]) -> None:
    panel.set_xticks(ticks)
    panel.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.minorticks_off()


def jump_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the share of runs that reach the high branch over the slowness."""
    found = shares(all_rows)
    figure = Figure(figsize=(8, 4.8), layout="constrained")
    panel = figure.subplots()
    lines = unique((share.method, share.setting) for share in found)
    for k, (method, setting) in enumerate(lines):
        line = [share for share in found if (share.method, share.setting) == (method, setting)]
        at = np.array([share.slowness for share in line]) * 1.03 ** (k - (len(lines) - 1) / 2)  # side by side
        y = np.array([share.share for share in line])
        bars = np.abs(np.array([share.wilson for share in line]).T - y)
        label = method if setting is None else f"{method}, {setting:g} steps per highest period"
        colour = "#0072B2" if setting is None else ("#D55E00", "#E69F00", "#CC79A7", "#777777")[(k - 1) % 4]
        panel.errorbar(at, y, bars, color=colour, marker=MARKERS[k % len(MARKERS)], ms=6, lw=1.4, capsize=3, label=label)
    panel.set(xscale="log", ylim=(-0.03, 1.03), xlabel="slowness of the sweep, pseudo periods per 1 % of the resonance frequency")
    panel.set(ylabel="share of runs that reach the high branch", title="Jump of the two-mode absorber: share of runs, with 95 % intervals (Wilson)")
    _plain(panel, unique(share.slowness for share in found))
    panel.grid(True, color="0.9", lw=0.6)
    panel.legend(frameon=True, fontsize=9)
    return {"jumps": figure}


def cost_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the cost over modes, lanes, threads and length."""
    figure = Figure(figsize=(11, 8.6), layout="constrained")
    panels = figure.subplots(2, 2)
    titles = {
        MODES: ("number of modes", "Number of modes"),
        LANES: ("lanes, one thread", "Number of lanes: impact, e = 1, 10 modes"),
        THREADS: ("threads", "Number of threads: impact, e = 1, 10 modes, 64 lanes"),
        LENGTH: ("pseudo periods in the sweep", "Length of the sweep: impact, e = 1, 3 modes"),
    }
    for panel, (over, (label, title)) in zip(panels.flat, titles.items(), strict=True):
        rows = [row for row in all_rows if row["over"] == over]
        for k, (scene, method) in enumerate(unique((row["scene"], row["method"]) for row in rows)):
            line = [row for row in rows if (row["scene"], row["method"]) == (scene, method)]
            at, us = [row["value"] for row in line], [row["us_per_period"] for row in line]
            panel.plot(at, us, color=COLOURS[k], marker=MARKERS[k], ms=5, lw=1.2, label=f"{scene}: {method}")
        panel.set(xscale="log", yscale="log", xlabel=label, ylabel="µs per pseudo period and lane")
        panel.set_title(title, fontsize=10)
        panel.grid(True, which="both", color="0.92", lw=0.6)
        if over in (THREADS, MODES) and rows:
            _plain(panel, [value for value in unique(row["value"] for row in rows) if over == THREADS or value in (1, 2, 3, 5, 10, 20, 30, 60)])
        _room(panel, rows)
    figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, title="first panel", fontsize=9)
    return {"cost": figure}


def _room(panel: Axes, rows: list[Row]) -> None:
    """Show a decade at least, so that what is constant looks so."""
    values = [row["us_per_period"] for row in rows]
    if values and max(values) < 10 * min(values):
        middle = float(np.sqrt(min(values) * max(values)))
        panel.set_ylim(middle / 4, middle * 4)
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        panel.yaxis.set_minor_locator(NullLocator())
