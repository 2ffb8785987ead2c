"""The figures of docs/findings.md, drawn from the numbers that the studies wrote."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from optimisation.report.design_figures import draw_front
from optimisation.report.report import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    draw_grid,
    draw_legend,
    figure_with,
    force_axis,
    write_figure,
)
from studies.study import Json

COLOURS = {"impact": BLUE, "friction": ORANGE, "tuned": GREEN}
FURTHER = "#CC79A7"  # Okabe and Ito: a concept beyond those
PAPER_STYLE = (0, (4, 2))
NAMES = {1: "first resonance", 2: "second resonance"}


def save_concepts(path: Path, result: Json) -> None:
    """Draw the relative level over the force for each concept.

    The curves are those of the concept's winner and of the paper's choice, with the limit of the
    impact absorber's cavity.
    """
    figure, axes = figure_with(2, 5.0)
    for i, axis in enumerate(axes):
        for concept, results in result.items():
            curve = results["curves"][i]
            colour = COLOURS.get(concept, FURTHER)
            force = np.array(curve["force_n"])
            without = np.array(curve["without"])
            low, middle, high = (
                100 * np.array(curve[name], dtype=float) / without
                for name in ("low", "median", "high")
            )
            axis.fill_between(force, low[0], high[0], color=colour, alpha=0.2, lw=0)
            axis.plot(force, middle[0], color=colour, lw=2.2, label=f"{concept}: found")
            axis.plot(
                force,
                middle[1],
                color=colour,
                lw=1.4,
                ls=PAPER_STYLE,
                label=f"{concept}: paper's choice",
            )
            if concept == "impact":
                _draw_limit(axis, curve)
            axis.axvline(results["conditions"][i]["force_n"], color=GREY, lw=1, ls=":")
        axis.axhline(100, color=BLACK, lw=1)
        axis.set(
            xscale="log",
            yscale="log",
            xlim=(force[0], force[-1]),
            ylim=(8, 130),
            title=NAMES[i + 1],
        )
        axis.set_xlabel("amplitude of the force in N")
        force_axis(axis.xaxis)
        force_axis(axis.yaxis)
        draw_grid(axis)
    axes[0].set_ylabel("response level in % of no absorber")
    draw_legend(figure, axes[0], 4)
    write_figure(figure, path)


def _draw_limit(axis: Axes, curve: Json) -> None:
    """Hatch the levels that no device in the winner's cavity can reach.

    The level without absorber is proportional to the force.
    """
    force = np.array(curve["limit_force_n"])
    limit = np.array(curve["limit_m"], dtype=float)
    relative = 100 * limit / (force * curve["without"][0] / curve["force_n"][0])
    label = "out of stationary reach in that cavity"
    axis.fill_between(
        force,
        1,
        relative,
        facecolor="0.93",
        edgecolor="0.7",
        hatch="////",
        lw=0.6,
        zorder=0.4,
        label=label,
    )


def save_optima(path: Path, result: Json) -> None:
    """Draw the levels of friction damper and impact absorber around their optima.

    The damper's level is over its friction limit, that of the impact absorber over the force in
    units of the design rule's force.
    """
    figure, (left, right) = figure_with(2, 5.0)
    for x, colour in zip(result["friction"], (BLUE, GREEN), strict=True):
        curve = x["curve"]
        label = f"{NAMES[x['resonance']]}, {x['force_n']:g} N"
        left.plot(
            curve["friction_limit_n"],
            100 * np.array(curve["relative"]),
            color=colour,
            lw=2,
            label=label,
        )
        left.plot(
            x["winner"]["values"]["friction_limit"],
            100 * x["winner"]["score"][0],
            "o",
            ms=8,
            mfc="white",
            mec=colour,
            mew=2,
            label="found",
        )
        left.axvline(
            x["argued_n"],
            color=colour,
            lw=1.2,
            ls=":",
            label=f"energy argument, {x['argued_n']:.2g} N",
        )
    left.axvline(
        result["friction"][0]["paper"]["values"]["friction_limit"],
        color=ORANGE,
        lw=1.4,
        ls=PAPER_STYLE,
        label="paper, 0.5 N",
    )
    left.set(
        xscale="log",
        ylim=(0, 112),
        xlabel="friction limit of the damper in N",
        ylabel="response level in % of no absorber",
    )
    for x, colour in zip(result["impact"], (BLUE, GREEN), strict=True):
        curve = x["curve"]
        ratio = np.array(curve["force_n"]) / x["rule_force_n"]
        right.fill_between(
            ratio,
            100 * np.array(curve["low"]),
            100 * np.array(curve["high"]),
            color=colour,
            alpha=0.2,
            lw=0,
        )
        right.plot(
            ratio,
            100 * np.array(curve["median"]),
            color=colour,
            lw=2,
            label=f"{NAMES[x['resonance']]}, f* = {x['rule_force_n']:.3g} N",
        )
        right.axvline(
            x["force_n"] / x["rule_force_n"],
            color=colour,
            lw=1.2,
            ls=PAPER_STYLE,
            label=f"paper's optimum, {x['force_n']:g} N",
        )
    right.axvline(1, color=BLACK, lw=1.2, ls=":", label="design rule")
    right.set(
        ylim=(0, None),
        xlim=(0.5, 1.8),
        xlabel="force over the design rule's, impact absorber with a gap of 1 mm",
    )
    force_axis(left.xaxis)
    left.legend(fontsize=8, loc="lower left")
    right.legend(fontsize=8, loc="lower right")
    for axis in (left, right):
        draw_grid(axis)
    write_figure(figure, path)


def save_place(path: Path, result: Json) -> None:
    """Draw the best levels over the position, and the effective share of the mass.

    The second panel shows the share of the absorber's mass that acts on each mode at a position.
    """
    figure, (left, right) = figure_with(2, 4.8)
    at = np.array(result["positions"])
    relative = 100 * np.array(result["relative"])
    worse = relative.max(axis=2)
    for k, colour in enumerate((BLUE, GREEN)):
        left.plot(
            at,
            relative[:, :, k].min(axis=1),
            "o-",
            color=colour,
            lw=1.6,
            ms=4,
            label=f"{NAMES[k + 1]} alone, best gap for it",
        )
    left.plot(
        at,
        worse.min(axis=1),
        "o-",
        color=BLACK,
        lw=2.2,
        ms=5,
        label="worse of both, best gap for that",
    )
    best = worse.argmin(axis=1)
    limits = 100 * np.array(result["limit"]).max(axis=2)
    reach = limits[np.arange(len(at)), best]
    label = "worse of both: out of stationary reach with that gap"
    left.fill_between(
        at,
        0,
        reach,
        facecolor="0.93",
        edgecolor="0.7",
        hatch="////",
        lw=0.6,
        zorder=0.4,
        label=label,
    )
    results = result["free"]["winner"]
    left.plot(
        results["values"]["position"],
        100 * results["score"][0],
        "*",
        ms=14,
        color=ORANGE,
        label="search with the position free",
    )
    left.set(
        ylim=(0, 108),
        xlabel="position of the absorber over the beam's length",
        ylabel="response level of the free end in % of no absorber",
    )
    shapes = np.array(result["shapes"])
    for k, colour in enumerate((BLUE, GREEN)):
        right.plot(
            at,
            100 * result["mass_kg"] * shapes[:, k] ** 2,
            "o-",
            color=colour,
            ms=4,
            label=f"mode {k + 1}",
        )
    right.set(
        ylim=(0, None),
        xlabel="position of the absorber over the beam's length",
        ylabel="absorber's mass over the mode's, at its place, in %",
    )
    for axis in (left, right):
        draw_grid(axis)
        axis.legend(fontsize=8.5)
    write_figure(figure, path)


def save_robustness(path: Path, result: Json) -> None:
    """Draw the level at the first resonance over a shift of the beam's frequencies."""
    figure, (axis,) = figure_with(1, 5.2)
    figure.set_figwidth(8)
    for x in result["designs"]:
        without = np.array(x["without"])
        style = {"winner": "-", "paper": PAPER_STYLE}.get(x["name"], (0, (1.5, 1.5)))
        shift = 100 * np.array(x["detuning"])
        colour = COLOURS.get(x["concept"], FURTHER)
        axis.fill_between(
            shift,
            100 * np.array(x["low"]) / without,
            100 * np.array(x["high"]) / without,
            color=colour,
            alpha=0.15,
            lw=0,
        )
        axis.plot(
            shift,
            100 * np.array(x["median"]) / without,
            color=colour,
            ls=style,
            lw=2,
            label=f"{x['concept']}, {x['name']}",
        )
    axis.axvline(0, color=GREY, lw=1, ls=":")
    axis.set(
        ylim=(0, None),
        xlabel="shift of the beam's frequencies in %",
        ylabel="response level in % of no absorber, first resonance",
    )
    draw_grid(axis)
    draw_legend(figure, axis, 3)
    write_figure(figure, path)


def save_resonances(path: Path, result: Json) -> None:
    """Draw the front of first against second resonance."""
    searched, front, fresh, paper, bound = (
        np.array(result[name], dtype=float)
        for name in ("searched", "front_scores", "fresh", "paper", "bound")
    )
    first, second = result["labels"]
    write_figure(draw_front((first, second), searched, front, fresh, paper, bound), path)


FIGURES: dict[str, Callable[[Path, Json], None]] = {
    "concepts": save_concepts,
    "optima": save_optima,
    "place": save_place,
    "robustness": save_robustness,
    "front": save_resonances,
}
