"""The figures of the study, drawn from its rows alone: error, balance and distribution against run time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from studies.accuracy import distribution, trajectory
from studies.accuracy.distribution import Compared, compared
from studies.accuracy.settings import Row, unique

# Okabe and Ito's colours, and a marker as well
LOOKS = {
    "Exact": ("#0072B2", "o"),
    "closed form": ("#0072B2", "o"),
    "Moreau": ("#D55E00", "s"),
    "Runge-Kutta": ("#009E73", "^"),
    "SciPy": ("#CC79A7", "v"),
    "heyoka": ("#E69F00", "D"),
}
FLOOR = 1e-17  # errors below are drawn there
CEILING = 3.0
LABELS = {
    "state_error": "error of the state",
    "balance_error": "error of the energy balance",
    "first_impact_error_periods": "error of the first impact, pseudo periods",
}
MAIN = ("impact, e = 1", "impact, e = 0.7, with friction")


def grid(all_rows: list[Row], value: str, scenes: list[str], title: str) -> Figure:
    """Draw a panel for each scene and number of modes: a value against the time of a pseudo period."""
    modes = unique(row["modes"] for row in all_rows)
    scenes = [scene for scene in scenes if any(row["scene"] == scene for row in all_rows)]
    all_rows = [row for row in all_rows if row["scene"] in scenes]
    figure = Figure(figsize=(2.6 + 2.9 * len(modes), 1.6 + 2.35 * len(scenes)), layout="constrained")
    panels = figure.subplots(len(scenes), len(modes), squeeze=False, sharex=True, sharey=True)
    for line, scene in zip(panels, scenes, strict=True):
        for panel, count in zip(line, modes, strict=True):
            _panel(panel, [row for row in all_rows if row["scene"] == scene and row["modes"] == count], value)
            panel.set_title(f"{scene}, {count} mode{'s' * (count > 1)}", fontsize=9)
    for panel in panels[-1]:
        panel.set_xlabel("time of a pseudo period, µs")
    for panel in panels[:, 0]:
        panel.set_ylabel(LABELS[value], fontsize=9)
    shown = [name for name in LOOKS if any(row["method"] == name for row in all_rows) and (name != "closed form" or len(scenes) == 1)]
    names = {"Exact": "Exact (closed form where there are no events)"}
    handles = [Line2D([], [], color=LOOKS[name][0], marker=LOOKS[name][1], lw=1, ls=_line(name), label=names.get(name, name)) for name in shown]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(shown), frameon=False)
    figure.suptitle(title, fontsize=12)
    return figure


def _panel(panel: Axes, cell: list[Row], value: str) -> None:
    for name in unique(row["method"] for row in cell):
        points = [(row["us_per_period"], row[value]) for row in cell if row["method"] == name and row[value] is not None and row["us_per_period"]]
        if points:
            x, y = np.array(sorted(points)).T
            colour, marker = LOOKS[name]
            panel.plot(
                x,
                np.clip(y, FLOOR, CEILING),
                marker=marker,
                ls=_line(name),
                color=colour,
                ms=7 if name in ("Exact", "closed form") else 4.5,
                lw=1,
                clip_on=False,
            )
    _log(panel)
    panel.set_ylim(FLOOR, CEILING)


def _line(name: str) -> str:
    """Return the style of the line that joins the settings of a method."""
    return "" if name in ("Exact", "closed form") else "-"


def _log(panel: Axes) -> None:
    panel.set(xscale="log", yscale="log")
    panel.yaxis.set_major_locator(LogLocator(numticks=7))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.grid(True, color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def trajectory_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw errors of the state and of the energy balance over all scenes, and the errors of the main ones."""
    scenes = unique(row["scene"] for row in all_rows)
    without = f"(without impacts: after {trajectory.WITHOUT_IMPACTS} pseudo periods)"
    error = f"Error of the state after {trajectory.IMPACTS} to {trajectory.LATEST - 1} impacts {without}, against run time"
    figures = {
        "trajectory_error": grid(all_rows, "state_error", scenes, error),
        "energy_balance": grid(all_rows, "balance_error", scenes, "Relative error of the energy balance over the same stretch, against run time"),
    }
    main = [scene for scene in MAIN if scene in scenes]
    if main:
        title = f"Error of the state after {trajectory.IMPACTS} to {trajectory.LATEST - 1} impacts against run time"
        figures["main"] = grid(all_rows, "state_error", main, title)
    return figures


def distribution_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the distance from the truth to expect against the time spent, for ensembles of growing size."""
    scenes, modes = distribution.cells_of(all_rows)
    methods = compared(all_rows)
    figure = Figure(figsize=(2.6 + 2.9 * len(modes), 1.6 + 2.35 * len(scenes)), layout="constrained")
    panels = figure.subplots(len(scenes), len(modes), squeeze=False)
    settings = sorted({m.setting for m in methods if m.setting is not None})
    for line, scene in zip(panels, scenes, strict=True):
        for panel, count in zip(line, modes, strict=True):
            for method in methods:
                if (method.scene, method.modes) == (scene, count):
                    _ensemble_line(panel, method, settings)
            _few_ticks(panel)
            panel.set_title(f"{scene}, {count} mode{'s' * (count > 1)}", fontsize=9)
    for panel in panels[-1]:
        panel.set_xlabel("time of the ensemble, s")
    for panel in panels[:, 0]:
        panel.set_ylabel("distance of the distributions, %", fontsize=9)
    named = {f"{m.method}, {m.setting:g} steps" if m.setting else m.method: _style(m, settings) for m in methods}
    handles = [Line2D([], [], color=colour, marker=marker, alpha=alpha, label=name) for name, (colour, marker, alpha) in named.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle("Distance of the response level's distribution from the exact one, against the time spent on runs", fontsize=12)
    return {"distribution": figure}


def _few_ticks(panel: Axes) -> None:
    panel.set(xscale="log", yscale="log")
    low, high = panel.get_ylim()
    if high < 10 * low:
        panel.set_ylim(np.sqrt(low * high) / np.sqrt(10), np.sqrt(low * high) * np.sqrt(10))
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 3)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_locator(NullLocator())
    panel.grid(True, color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def _style(method: Compared, settings: list[float]) -> tuple[str, str, float]:
    colour, marker = LOOKS[method.method]
    if method.setting is None:
        return colour, marker, 1.0
    at = settings.index(method.setting)
    return colour, ("sPX*h" if method.method == "Moreau" else "^<>vd")[at % 5], 0.45 + 0.55 * (at + 1) / len(settings)


def _ensemble_line(panel: Axes, method: Compared, settings: list[float]) -> None:
    sizes = np.unique(np.round(np.geomspace(1, len(method.levels), 6)).astype(int))
    values = [100 * method.at_cost(method.seconds * size * (1 + 1e-9)) for size in sizes]
    colour, marker, alpha = _style(method, settings)
    panel.plot(method.seconds * sizes, np.maximum(values, 1e-4), marker=marker, color=colour, alpha=alpha, ms=5, lw=1)
