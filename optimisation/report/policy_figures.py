"""Figures of judged policies: performance profiles, what they do over the frequency of a passage, what they do over the time of an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from impact_env.envs.evaluation import interval
from optimisation.report.comparison_figure import DPI, MM
from optimisation.report.written_figure import write_figure
from optimisation.rl.judging import Judged
from optimisation.rl.statistics import profile
from optimisation.rl.tasks.baseline import (
    BEST_CONSTANT,
    BEST_GAP,
    BEST_LIMIT,
    BEST_PAIR,
    BEST_SCHEDULE,
    FEEDBACK,
    KNOTTED,
    ORACLE,
    TUNED_ESTIMATE,
    TUNED_TRUE,
    WINDOWED,
)
from optimisation.rl.tasks.task import EPISODE, RESPONSES, SCHEDULES

THRESHOLDS = 200
RATES_SHOWN = (-4.0, -1.0, -0.3, -0.1, 0.0, 0.1, 0.3, 1.0, 2.0, 4.0)  # % per 100 pseudo periods
# what a passage's figure has panels of
ROWS = {
    "rate": "rate, % per 100 pseudo periods\n(below 0: back)",
    "gap": "gap over the design rule's\nfor the true force",
    "friction_limit": "friction limit over the force, N/N",
}
COLOURS = {
    "PPO": "#0072B2",
    "RPPO": "#56B4E9",
    FEEDBACK: "#CC79A7",
    ORACLE: "#E69F00",
    BEST_PAIR: "#000000",
    BEST_LIMIT: "#000000",
    "SAC": "#009E73",
    BEST_SCHEDULE: "#D55E00",
    WINDOWED: "#CC79A7",
    KNOTTED: "#CC79A7",
    BEST_CONSTANT: "#000000",
    TUNED_TRUE: "#D55E00",
    TUNED_ESTIMATE: "#CC79A7",
    BEST_GAP: "#000000",
}
OTHER = "0.65"
DIRECTION_COLOURS, WINDOW_COLOURS = ("#0072B2", "#D55E00"), ("#009E73", "#CC79A7")


def _colour(name: str) -> str:
    return COLOURS.get(name, OTHER)


def _finish(figure: Figure, panels: Sequence[Axes], path: Path, columns: int = 3) -> None:
    for panel in panels:
        panel.grid(True, color="0.9", lw=0.7)
        panel.set_axisbelow(True)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    write_figure(figure, path, DPI)


def save_profiles(path: Path, results: Sequence[Judged], title: str, resamples: int, lines: Mapping[str, float] | None = None) -> None:
    """Draw the share of episodes above each score, with its 95 % band for the policies that have a colour; ``lines``: means to mark, by name."""
    figure = Figure(figsize=(8, 5.4), layout="constrained")
    panel = figure.subplots()
    pooled = np.concatenate([np.ravel(r.scores) for r in results if r.name in COLOURS])
    low, high = np.quantile(pooled, 0.002), pooled.max()
    thresholds = np.linspace(low - 0.03 * (high - low), high + 0.01 * (high - low), THRESHOLDS)
    greys = cycle({"color": grey, "ls": style} for style in ((0, (4, 2)), (0, (1, 1)), (0, (6, 2, 1, 2))) for grey in ("0.35", "0.6"))
    for result in sorted(results, key=lambda r: r.name in COLOURS):
        label = result.name if len(result.runs) == 1 else f"{result.name}, {len(result.runs)} agents"
        if result.name in COLOURS:
            band = interval(partial(profile, thresholds=thresholds), result.scores, resamples=resamples)
            panel.fill_between(thresholds, *band, color=_colour(result.name), alpha=0.15, lw=0)
            style: dict[str, Any] = {"lw": 2.0, "color": _colour(result.name)}
        else:
            style = {"lw": 1.2, **next(greys)}
        panel.plot(thresholds, profile(result.scores, thresholds), label=label, **style)
    for name, value in (lines or {}).items():
        panel.axvline(value, color=_colour(name), lw=1.1, ls=":" if name in COLOURS else "--", label=f"{name}, mean {value:.3f}")
    panel.set(xlim=(thresholds[0], thresholds[-1]), ylim=(0, 1.02), xlabel="score s", ylabel="share of episodes with a score above s", title=title)
    _finish(figure, [panel], path)


def _number(values: Sequence[float | None]) -> Any:
    return np.array([np.nan if value is None else value for value in values])


def save_schedules(path: Path, curves: Mapping[str, Any], title: str) -> None:
    """Draw rate and amplitude over the frequency: median and 5 to 95 % over all passages of each policy. The passage runs as the axis does."""
    figure = Figure(figsize=(8.6, 7), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    ratio = np.array(curves["frequency_ratio"])
    for name, found in curves["policies"].items():
        for panel, key in zip(panels, ("rate", "amplitude"), strict=True):
            low, median, high = map(_number, found[key])
            panel.fill_between(ratio, low, high, color=_colour(name), alpha=0.13, lw=0)
            panel.plot(ratio, median, color=_colour(name), lw=1.9, label=name)
    panels[0].set(yscale="log", ylabel="rate in % per 100 pseudo periods", title=title)
    panels[0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 4)))
    panels[0].yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panels[0].yaxis.set_minor_formatter(NullFormatter())
    panels[1].set(ylabel="amplitude of the tip over the gap", xlabel="frequency over the resonance (the machine runs down: from left to right)")
    panels[1].set_ylim(bottom=0)
    panels[1].set_xlim(float(ratio[-1]), float(ratio[0]))
    _finish(figure, list(panels), path, 4)


def save_responses(path: Path, curves: Mapping[str, Any], title: str) -> None:
    """Draw what policies do over the frequency: median and 5 to 95 % of rate, and of gap where there is one, or of the friction limit; beside each
    other while impacts go on and where there are none. The passage runs as the axis does.
    """  # noqa: D205
    keys = [key for key in ROWS if any(f"{key}, quiet" in found for found in curves["policies"].values())]
    figure = Figure(figsize=(9.6, 3.4 * len(keys) + 0.9), layout="constrained")
    panels = figure.subplots(len(keys), 2, sharex=True, sharey="row", squeeze=False)
    ratio = np.array(curves["frequency_ratio"])
    for name, found in curves["policies"].items():
        for row, key in zip(panels, keys, strict=True):
            for panel, word in zip(row, ("impacting", "quiet"), strict=True):
                low, median, high = map(_number, found[f"{key}, {word}"])
                panel.fill_between(ratio, low, high, color=_colour(name), alpha=0.13, lw=0)
                panel.plot(ratio, median, ".-", color=_colour(name), lw=1.9, ms=4, label=name)  # in haste not every bin is met
    for panel, words in zip(panels[0], ("impacts go on", "no impacts in the interval before"), strict=True):
        panel.set_title(f"{title}: {words}", fontsize=10)
        if keys[0] == "rate":
            panel.set_yscale("symlog", linthresh=0.05)
            low, high = panel.get_ylim()
            shown = [rate for rate in RATES_SHOWN if low <= rate <= high]
            panel.set_yticks(shown, [f"{rate:g}" for rate in shown])
        else:
            panel.set_yscale("log")
        panel.set_xlim(float(ratio[-1]), float(ratio[0]))
    for panel in panels[-1]:
        panel.set_xlabel("frequency over the resonance")
    for row, key in zip(panels, keys, strict=True):
        row[0].set_ylabel(ROWS[key])
    _finish(figure, list(panels.ravel()), path, 4)


def save_gaps(path: Path, curves: Mapping[str, Any], title: str) -> None:
    """Draw the force, the gaps, and the tip's RMS over one episode."""
    figure = Figure(figsize=(8.6, 8), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(0.6, 1, 1))
    time = np.array(curves["time"])
    panels[0].plot(time, curves["force"], color="0.2", lw=1.6, drawstyle="steps-pre")
    panels[0].set_ylim(bottom=0)
    panels[0].set(ylabel="force in N", title=f"{title} at {curves['frequency_ratio']:.3f} times the resonance, seed {curves['seed']}")
    for name, found in curves["policies"].items():
        panels[1].plot(time, MM * np.array(found["gap"]), color=_colour(name), lw=1.5, label=name, drawstyle="steps-pre")
        panels[2].plot(time, MM * np.array(found["rms"]), color=_colour(name), lw=1.3, drawstyle="steps-pre")
    panels[1].set_ylabel("half-clearance in mm")
    panels[2].set(ylabel="RMS of the tip in mm", xlabel="time in pseudo periods", xlim=(0, float(time[-1])))
    panels[2].set_ylim(bottom=0)
    for panel in panels[[0, 2]]:
        panel.grid(True, color="0.9", lw=0.7)
    _finish(figure, [panels[1], panels[0], panels[2]], path)


CURVES = {SCHEDULES: save_schedules, EPISODE: save_gaps, RESPONSES: save_responses}  # by the kinds of figures that tasks have


def _band(panel: Axes, x: Any, found: Mapping[str, Any], colour: str, label: str | None = None) -> None:
    panel.fill_between(x, found["level_low"], found["level_high"], color=colour, alpha=0.18, lw=0)
    panel.plot(x, found["level_median"], "o-", color=colour, lw=1.8, ms=3.5, label=label)


def save_tradeoff(path: Path, result: Mapping[str, Any]) -> None:
    """Draw relative level (median, 5 to 95 %) and mean score over the constant rate, a column a scene, and over the place of a slow window."""
    cases, slow = result["cases"], result["windows"]
    figure = Figure(figsize=(3.1 * (len(cases) + 1) + 0.6, 6.4), layout="constrained")
    rows = figure.subplots(2, len(cases) + 1, sharey="row", squeeze=False)
    for column, case in zip(rows.T, cases, strict=False):
        for direction, colour in zip(case["directions"], DIRECTION_COLOURS, strict=True):
            found = case["directions"][direction]
            _band(column[0], case["rates"], found, colour, f"constant rate, {direction}")
            column[1].plot(case["rates"], found["score"], "o-", color=colour, lw=1.8, ms=3.5)
        column[0].set_title(case["title"], fontsize=9)
        column[1].set_xlabel("rate in % per 100 pseudo periods")
        for panel in column:
            panel.set_xscale("log")
            panel.xaxis.set_major_locator(FixedLocator([0.06, 0.25, 1, 4]))
            panel.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            panel.xaxis.set_minor_formatter(NullFormatter())
    last = rows[:, -1]
    for rate, found, colour in zip(slow["slow"], slow["found"], WINDOW_COLOURS, strict=False):
        _band(last[0], slow["centre"], found, colour)
        last[1].plot(slow["centre"], found["score"], "o-", color=colour, lw=1.8, ms=3.5, label=f"{rate:g} % in the window")
    fastest = slow["fastest"]
    last[1].axhline(fastest["score"], color="0.3", lw=1.2, ls="--", label=f"{fastest['rate']:g} % all the way")
    last[1].legend(loc="lower right", fontsize=8)
    last[0].set_title(slow["title"], fontsize=9)
    last[1].set_xlabel("centre of the window over the resonance")
    rows[0, 0].set_ylabel("level over that without absorber\n(median, 5 to 95 %)")
    rows[1, 0].set_ylabel("mean score")
    rows[0, 0].set_ylim(bottom=0)
    _finish(figure, list(rows.ravel()), path)
