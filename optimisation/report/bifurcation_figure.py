"""The figure of bifurcations over two parameters: where orbits fold, lose their symmetry, double their period, or become tori."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from impact_env.periodic.branch import FOLD
from impact_env.periodic.orbit_branches import GRAZING, PERIOD_DOUBLING, PULLING, SYMMETRY_BREAKING, TORUS
from optimisation.report.written_figure import write_figure

COLOURS = {FOLD: "#0072B2", SYMMETRY_BREAKING: "#D55E00", PERIOD_DOUBLING: "#009E73", TORUS: "#CC79A7"}
MARKS = {FOLD: "o", GRAZING: "v", PULLING: "<"}


def save_figure(path: Path, curves: list[dict[str, Any]], title: str, parameter: str, scale: float) -> None:
    """Draw the plain forms of `BifurcationCurve`, ``scale`` times the parameter's values; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(9, 5.5), layout="constrained")
    axes = figure.subplots()
    for curve in curves:
        ratio, value, colour = np.array(curve["omega_ratio"]), scale * np.array(curve["value"]), COLOURS[curve["kind"]]
        good = np.array([told == "yes" for told in curve["orbit"]])
        beside = good | np.append(good[1:], False) | np.append(False, good[:-1])  # so that no gap is seen
        axes.plot(ratio, np.where(beside, value, np.nan), color=colour, lw=1.8)
        axes.plot(ratio, np.where(good, np.nan, value), color=colour, lw=1.0, ls=":")
        for mark in curve["located"]:
            if mark["kind"] in MARKS:
                axes.plot(mark["omega_ratio"], scale * mark["value"], MARKS[mark["kind"]], color=colour, mfc="white", ms=5)
    for kind in dict.fromkeys(curve["kind"] for curve in curves):
        axes.plot([], [], color=COLOURS[kind], lw=1.8, label=kind)
    for kind in sorted({mark["kind"] for curve in curves for mark in curve["located"]} & set(MARKS)):
        label = f"{parameter} least or greatest" if kind == FOLD else kind
        axes.plot([], [], MARKS[kind], color="black", mfc="white", ms=5, label=label)
    if any(told != "yes" for curve in curves for told in curve["orbit"]):
        axes.plot([], [], color="black", lw=1.0, ls=":", label="no orbit of the true motion")
    axes.set(xlabel="frequency over the first resonance's", ylabel=parameter)
    axes.set_title(title, fontsize=10)
    axes.grid(True, color="0.9", lw=0.6)
    figure.legend(loc="outside right upper", fontsize=8.5)  # beside the curves, not over them
    write_figure(figure, path)
