"""Figures of comparisons and design studies.

They show levels over the force and over gap and force, sensitivity to the design variables,
robustness against detuning, and Pareto fronts. Levels have the units of their measure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from optimisation.bounds import design_gap
from optimisation.comparison import (
    FRICTION,
    IMPACT,
    LTVA_PAPER_WIDE,
    LTVA_TUNED,
    LTVA_TUNED_WIDE,
    NONE,
    Comparison,
    ResonanceComparison,
)
from optimisation.insight import Levels, Sensitivity, over_force, stationary_limit
from optimisation.measures import DISPLAY_UNITS, LABELS, format_number, prediction_band
from optimisation.mounting import model_with_absorber_at
from optimisation.objectives import Condition
from optimisation.report.report import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    HATCHED,
    MM,
    ORANGE,
    PINK,
    draw_grid,
    draw_legend,
    figure_of,
    figure_with,
    force_axis,
)
from optimisation.search.judge import SearchResult
from optimisation.space import GAP, MASS_RATIO, POSITION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_LEVEL = 0.04  # lower end of the level axis over the gap
ORDINALS = {1: "First", 2: "Second", 3: "Third"}


@dataclass(frozen=True)
class LineStyle:
    """Line style of a concept; ``width`` in points.

    The colours are those of Okabe and Ito, which colour-blind readers can distinguish. The dashes
    differ as well.
    """

    label: str
    colour: str
    style: str | tuple[int, tuple[float, ...]] = "-"
    width: float = 1.8


LINE_STYLES = {
    NONE: LineStyle("no absorber", BLACK, "-", 1.3),
    FRICTION: LineStyle("friction damper", ORANGE),
    LTVA_PAPER_WIDE: LineStyle("tuned absorber, paper's values", PINK, (0, (4, 2))),
    LTVA_TUNED_WIDE: LineStyle("tuned absorber, well tuned", GREEN, (0, (6, 2, 1.5, 2))),
    IMPACT: LineStyle("impact absorber", BLUE, "-", 2.4),
}


def draw_comparison(comparison: Comparison) -> Figure:
    """Draw response levels over the force near each resonance, as in the paper's last figure."""
    figure, panels = figure_of(10, 6.4, 1, len(comparison.resonances), sharey=True)
    panels = np.atleast_1d(panels)
    top = 0.0
    for panel, part in zip(panels, comparison.resonances, strict=True):
        _draw(panel, part)
        top = max(top, float(np.nanmax(MM * part.curves[NONE].median, initial=0)))
    panels[0].set_ylim(MM * LEAST_LEVEL * comparison.gap, 1.3 * top if top > 0 else None)
    panels[0].set_ylabel(
        "resonant response level in mm (RMS)"
        if comparison.own_structure
        else "resonant response level of the tip in mm (RMS)",
        fontsize=11,
    )
    runs = (
        "one run"
        if comparison.members == 1
        else (
            f"{comparison.members} runs that differ in when the force begins and by a millionth "
            "of it"
        )
    )
    band = (
        "lines: median, bands: 90 % of further runs, by "
        f"{runs}{'' if comparison.complete else ' (stopped early)'}"
    )
    caption = (
        "level: RMS around the largest displacement, the larger of a sweep up and a sweep "
        f"down\n{band}"
    )
    legend = draw_legend(figure, panels[0], 3, fontsize=10, title=caption, alignment="center")
    legend.get_title().set(fontsize=9, color="0.35", ha="center")
    what, whose = (
        ("the structure", "its") if comparison.own_structure else ("the beam's tip", "the beam's")
    )
    title = (
        f"Response of {what} at resonance, with absorbers of {100 * comparison.mass_ratio:.3g} % "
        f"of {whose} mass"
    )
    figure.suptitle(title, fontsize=13)
    return figure


def _draw(panel: Axes, part: ResonanceComparison) -> None:
    """Draw the concepts' levels near a resonance, with the passive limit and the best force."""
    for key, line_style in LINE_STYLES.items():
        # without a wide sweep, the tuned absorber's other curve takes its place
        curve = part.curves.get(
            key, part.curves.get(LTVA_TUNED) if key == LTVA_TUNED_WIDE else None
        )
        if curve is None:
            continue
        low, high = MM * prediction_band(curve.combined)
        panel.fill_between(part.forces, low, high, color=line_style.colour, alpha=0.25, lw=0)
        panel.plot(
            part.forces,
            MM * curve.median,
            color=line_style.colour,
            ls=line_style.style,
            lw=line_style.width,
            label=line_style.label,
        )
    panel.set(xscale="log", yscale="log", xlim=(part.forces[0], part.forces[-1]))
    _draw_limit(panel, part)
    _mark_optimum(panel, part)
    if part.own_force is not None:
        panel.axvline(
            part.own_force,
            color="0.4",
            lw=1.2,
            ls=":",
            label=f"the force, {format_number(part.own_force)} N",
        )
    panel.set_title(
        (
            f"{ORDINALS.get(part.resonance, part.resonance)} resonance, "
            f"{part.omega / (2 * np.pi):.1f} Hz"
        ),
        fontsize=12,
    )
    panel.set_xlabel("amplitude of the force in N", fontsize=11)
    force_axis(panel.xaxis)
    force_axis(panel.yaxis)
    draw_grid(panel)


def _draw_limit(panel: Axes, part: ResonanceComparison) -> None:
    """Shade the levels below the passive limit for this mass and gap."""
    forces = np.geomspace(part.forces[0], part.forces[-1], 200)
    limit = np.maximum(MM * part.limit_at(forces), 1e-9)
    label = f"out of reach for the impact absorber: cavity of ±{MM * part.gap:.4g} mm"
    panel.fill_between(forces, 1e-9, limit, **HATCHED, zorder=0.4, label=label)


def _mark_optimum(panel: Axes, part: ResonanceComparison) -> None:
    """Mark the force at which the impact absorber's relative level is lowest, if known."""
    optimum = part.curves[IMPACT].optimum(part.curves[NONE])
    if optimum is None:
        return
    colour = LINE_STYLES[IMPACT].colour
    panel.plot(
        optimum.force,
        MM * optimum.level,
        "o",
        ms=9,
        mfc="white",
        mec=colour,
        mew=2.2,
        zorder=5,
    )
    panel.plot(0.05, 0.925, "o", ms=9, mfc="white", mec=colour, mew=2.2, transform=panel.transAxes)
    text = f"best point: {optimum.force:.3g} N,\n{100 * optimum.relative:.0f} % of no absorber"
    panel.text(
        0.085, 0.95, text, fontsize=11, color=colour, ha="left", va="top", transform=panel.transAxes
    )


Array = NDArray[np.float64]
DESIGN_STYLES = (
    ("winner", BLUE, "-", 2.2),
    ("paper's design", ORANGE, (0, (5, 2)), 1.8),
)


def _title(condition: Condition) -> str:
    """Return the title of a condition's panel: its resonance or its loads."""
    return (
        f"{ORDINALS.get(condition.resonance, condition.resonance)} resonance"
        if condition.loads is None
        else f"under {condition.place}"
    )


def _axis(condition: Condition) -> str:
    """Return the label of a condition's axis of amplitudes."""
    return "amplitude of the force in N" if condition.loads is None else "factor on the loads"


def _lines(panel: Axes, x: Array, levels: Levels, scale: Array) -> None:
    """Draw bands and medians of winner and paper's design over ``x``, times ``scale`` (X,)."""
    for d, (label, colour, style, width) in enumerate(DESIGN_STYLES[: len(levels.median)]):
        panel.fill_between(
            x, levels.low[d] * scale, levels.high[d] * scale, color=colour, alpha=0.2, lw=0
        )
        panel.plot(x, levels.median[d] * scale, color=colour, ls=style, lw=width, label=label)


def draw_curves(findings: SearchResult) -> Figure:
    """Draw the response level over the force, a panel for each condition of the search.

    The curves are the winner, the paper's design and the structure without absorber. Levels below
    the winner's passive limit are shaded.
    """
    assert findings.curves is not None
    assert findings.verdict is not None
    figure, panels = figure_with(len(findings.curves))
    for panel, levels, own in zip(
        panels, findings.curves, findings.problem.conditions, strict=True
    ):
        forces = np.array([condition.force for condition in levels.conditions])
        scale, display_unit = DISPLAY_UNITS[own.measure_and_unit[1]]
        panel.plot(forces, scale * levels.without, color=BLACK, lw=1.2, label="no absorber")
        _lines(panel, forces, levels, np.full(len(forces), scale))
        panel.set(xscale="log", yscale="log", xlim=(forces[0], forces[-1]), xlabel=_axis(own))
        bottom = 0.5 * scale * float(np.nanmin([levels.low, levels.median]))
        dense = over_force(own, np.geomspace(forces[0], forces[-1], 60))
        bound = np.array(
            [
                stationary_limit(findings.problem, findings.verdict.winner.design, condition)
                for condition in dense
            ]
        )
        if np.isfinite(bound).all():
            top = np.maximum(scale * bound, bottom)
            label = "out of stationary reach"
            panel.fill_between(
                [c.force for c in dense], bottom, top, **HATCHED, zorder=0.4, label=label
            )
        panel.axvline(
            own.force,
            color=GREY,
            lw=1,
            ls=":",
            label="force of the study" if own.loads is None else "the loads as they are",
        )
        panel.set_ylim(bottom, 1.3 * scale * float(np.max(levels.without)))
        panel.set_title(_title(own))
        force_axis(panel.xaxis)
        force_axis(panel.yaxis)
        draw_grid(panel)
    panels[0].set_ylabel(
        "response level of the free end in mm (RMS)"
        if own.loads is None
        else f"{LABELS[own.measure_and_unit[0]]} in {display_unit}"
    )
    draw_legend(figure, panels[0])
    return figure


def draw_map(findings: SearchResult) -> Figure:
    """Draw the level relative to no absorber over gap and force, with the winner and the rule.

    Thin lines have a constant ratio of gap to force. If friction is scaled as well, the relative
    level is constant on them (the scaling law).
    """
    from matplotlib.colors import LogNorm
    from matplotlib.font_manager import FontProperties

    assert findings.gap_map is not None
    assert findings.verdict is not None
    figure, panels = figure_with(len(findings.gap_map), 5.0)
    winner = findings.verdict.winner.design
    problem = findings.problem
    gaps = MM * np.array(findings.gaps)
    for panel, levels, own in zip(panels, findings.gap_map, problem.conditions, strict=True):
        forces = np.array([condition.force for condition in levels.conditions])
        mesh = panel.pcolormesh(
            forces,
            gaps,
            100 * levels.relative,
            norm=LogNorm(vmin=10, vmax=125),
            cmap="viridis_r",
            shading="nearest",
            rasterized=True,
        )
        rule = [
            _rule(findings, own.resonance, force) if own.loads is None else None for force in forces
        ]
        if rule[0] is not None:
            panel.plot(
                forces,
                MM * np.array(rule, dtype=float),
                color="white",
                lw=1.8,
                ls="--",
                label="design rule: gap = force / f* · 1 mm",
            )
        low = np.log10(gaps[0] / forces[-1])
        high = np.log10(gaps[-1] / forces[0])
        for slope in 10 ** np.arange(np.ceil(low * 4) / 4, high, 0.25):
            panel.plot(forces, slope * forces, color="white", lw=0.5, alpha=0.6)
        panel.plot(
            own.force,
            MM * winner.values[GAP],
            "o",
            ms=9,
            mfc=ORANGE,
            mec="white",
            mew=1.5,
            label="winner",
        )
        panel.set(
            xscale="log",
            yscale="log",
            xlim=(forces[0], forces[-1]),
            ylim=(gaps[0], gaps[-1]),
            xlabel=_axis(own),
        )
        panel.set_title(_title(own))
        force_axis(panel.xaxis)
        force_axis(panel.yaxis)
    bar = figure.colorbar(
        mesh,
        ax=panels,
        label="response level in % of no absorber",
        ticks=[10, 20, 50, 100],
        shrink=0.9,
    )
    bar.ax.set_yticklabels(["10", "20", "50", "100"])
    bar.ax.minorticks_off()
    panels[0].set_ylabel("gap in mm (clearance to either wall)")
    legend = draw_legend(figure, panels[0], 2, frameon=True, facecolor="0.75", edgecolor="none")
    legend.set_title("thin lines: force over gap constant", prop=FontProperties(size=8))
    return figure


def _rule(findings: SearchResult, resonance: int, force: float) -> float | None:
    """Return the design rule's gap in m for the winner's mass at a force in N, None without one."""
    winner = findings.verdict.winner.design if findings.verdict else None
    if winner is None:
        return None
    model = model_with_absorber_at(findings.problem.beam, winner.values[POSITION])
    try:
        return design_gap(model, winner.values[MASS_RATIO] * model.beam_mass, force, resonance)
    except ParameterError:  # a heavy absorber moves the resonance out of the rule's range
        return None


def draw_robustness(findings: SearchResult) -> Figure:
    """Draw the level relative to no absorber over a shift of the structure's frequencies.

    The search for the design did not include this detuning.
    """
    assert findings.detuned is not None
    figure, panels = figure_with(len(findings.detuned))
    for panel, levels, own in zip(
        panels, findings.detuned, findings.problem.conditions, strict=True
    ):
        _lines(
            panel,
            100 * np.array([condition.detuning for condition in levels.conditions]),
            levels,
            100 / levels.without,
        )
        panel.axvline(0, color=GREY, lw=1, ls=":")
        panel.set_title(
            f"{_title(own)}, {format_number(own.force)} N" if own.loads is None else _title(own)
        )
        panel.set_xlabel("shift of the beam's frequencies in %")
        panel.set_ylim(bottom=0)
        draw_grid(panel)
    panels[0].set_ylabel("response level in % of no absorber")
    draw_legend(figure, panels[0])
    return figure


def draw_sensitivity(sensitivity: Sensitivity, of: str = "the winner") -> Figure:
    """Draw first-order and total Sobol indices of the design variables, with 95 % intervals.

    ``of``: name of the design around which the variables were varied, for the title.
    """
    at = np.arange(len(sensitivity.names))
    figure, panel = figure_of(max(6.4, 1.5 * len(at)), 4.2)
    for shift, colour, label, values, band in (
        (-0.19, BLUE, "alone (first order)", sensitivity.first, sensitivity.first_band),
        (
            0.19,
            ORANGE,
            "with the others (total)",
            sensitivity.total,
            sensitivity.total_band,
        ),
    ):
        error = np.maximum(np.abs(band.T - values), 0)
        panel.bar(
            at + shift,
            values,
            0.36,
            color=colour,
            label=label,
            yerr=error,
            capsize=4,
            error_kw={"lw": 1},
        )
    panel.set_xticks(
        at,
        [
            f"{n.replace('_', ' ')}\n{a:.3g} to {b:.3g}"
            for n, a, b in zip(sensitivity.names, sensitivity.low, sensitivity.high, strict=True)
        ],
    )
    panel.set_ylabel("share of the variance")
    panel.axhline(0, color=BLACK, lw=0.8)
    panel.set_title(
        f"Sobol indices around {of}, standard deviation {sensitivity.spread:.3g}", fontsize=10
    )
    draw_grid(panel)
    draw_legend(figure, panel)
    return figure


def draw_front(
    labels: tuple[str, str],
    searched: Array,
    front: Array,
    fresh: Array,
    paper: Array,
    bound: Array | None = None,
) -> Figure:
    """Draw a Pareto front of two objectives, with the axis ``labels``.

    ``searched`` (N, 2): all N designs of the search. ``front`` (K, 2): the K designs that are not
    dominated, in ascending order of the first objective. ``fresh`` (K, 2): the same designs with
    ensemble members that the search has not used.

    ``paper`` (2,): the paper's design. ``bound`` (K, 2): passive limits of the designs on the
    front, NaN for a design without limit.
    """
    figure, (panel,) = figure_with(1, 5.6)
    figure.set_figwidth(7.6)
    panel.plot(*searched.T, ".", color="0.75", ms=4, label="designs of the search")
    if bound is not None and np.isfinite(bound).any():
        panel.plot(
            *bound.T,
            "x",
            color=BLACK,
            ms=6,
            mew=1.4,
            label="stationary limits of these designs' cavities",
            clip_on=False,
        )
    panel.plot(
        *front.T,
        color=BLUE,
        lw=1.2,
        drawstyle="steps-post",
        label="front, as the search saw it",
    )
    panel.plot(
        *fresh.T,
        "o",
        ms=6,
        color=BLUE,
        mfc="white",
        mew=1.6,
        label="the same designs on fresh members",
    )
    panel.plot(*paper, "s", ms=8, color=ORANGE, label="paper's design")
    high = 1.05 * np.max([np.quantile(searched, 0.98, axis=0), paper, fresh.max(axis=0)], axis=0)
    panel.set(xlabel=labels[0], ylabel=labels[1], xlim=(0, high[0]), ylim=(0, high[1]))
    draw_grid(panel)
    draw_legend(figure, panel, 2)
    return figure
