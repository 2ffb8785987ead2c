"""The figure `m12`: absorber concepts near two resonances, with a well-tuned LTVA and the limit."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env import CurveCase, Moreau, Scene, beam_scene, modal_model
from impact_env.drive import PAPER_LIMITS
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, friction_damper
from optimisation.bounds import design_force, resonance_limit
from optimisation.comparison import (
    FRICTION,
    IMPACT,
    LTVA_PAPER,
    LTVA_PAPER_WIDE,
    LTVA_TUNED_WIDE,
    NONE,
    RESONANCES,
    concepts,
    force_grid,
)
from optimisation.files import markdown
from optimisation.report.design_figures import ORDINALS
from optimisation.tuned import highest_amplitude
from studies.paper.claim import (
    INFINITY,
    LITTLE,
    MAJORITY,
    MUCH,
    WIDE,
    Claim,
    ClaimVerdict,
    format_range,
    format_spread,
    judge_cases,
    judge_interval,
    make_claim,
    range_within,
)
from studies.paper.curve import (
    LevelCurve,
    compute_curves,
    draw_curve,
    draw_inset,
    find_best_forces,
    make_force_grid,
    read_curve,
    set_level_axes,
    to_plain_curve,
)
from studies.paper.frame import (
    MM,
    REFERENCE,
    SMALL,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_line,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import Array, CsvTable, Json, Steps

LABEL = "m12"
PAPERS_BEST = {1: 3.5, 2: 35.0}  # N, by resonance
PAPER_LIMIT = 0.5  # N, the paper's friction damper
SAME_LEVEL_TOL = 0.01  # of a level: curves that differ by less would be drawn on one another


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {
        f"resonance {r}": partial(_resonance, settings, r, size) for r in RESONANCES
    }
    groups["low"] = partial(
        _near, settings, 2, size.low, (NONE, IMPACT, FRICTION, LTVA_PAPER), size.members
    )
    groups["friction"] = partial(_limits, settings, size)
    groups |= {f"around {r}": partial(_around, settings, r, size) for r in RESONANCES}
    return measure_groups(groups, earlier)


def _resonance(settings: PaperSettings, resonance: int, size: Size) -> Json:
    """Return curves of all concepts near a resonance, from rest as in the paper.

    The passive limit, and single runs at the paper's step, are also given.
    """
    model = modal_model(Beam())
    mass = DEFAULT_MASS_RATIO * model.beam_mass
    gap = RigidWalls.gap
    force = design_force(model, mass, gap, resonance)
    forces = tuple(force_grid(force, size.forces).tolist())
    keys = tuple(concept.key for concept in concepts(model))
    dense = np.geomspace(forces[0], forces[-1], 120)
    limit = resonance_limit(model, mass, gap, dense, resonance, *PAPER_LIMITS)
    return {
        "curves": _near(settings, resonance, forces, keys, size.members),
        "design_force": force,
        "gap": gap,
        "limit": {"force": dense.tolist(), "level": limit.tolist()},
        "step": _near(settings, resonance, forces, (IMPACT, FRICTION), 1, Moreau()),
    }


def _near(
    settings: PaperSettings,
    resonance: int,
    forces: tuple[float, ...],
    keys: tuple[str, ...],
    members: int,
    method: Moreau | None = None,
) -> Json:
    """Return plain curves of the paper's concepts near a resonance."""
    model = modal_model(Beam())
    cases = {
        own.key: CurveCase(Scene(model, own.absorber), np.array(forces), resonance, own.limits)
        for own in concepts(model)
        if own.key in keys
    }
    result = settings.curves(
        f"{LABEL}, resonance {resonance}", list(cases.values()), members, method
    )
    return {key: to_plain_curve(curve) for key, curve in zip(cases, result, strict=True)}


def _around(settings: PaperSettings, resonance: int, size: Size) -> Json:
    """Return the curves with and without the absorber around the paper's best force.

    ``step`` has a single run at the paper's step.
    """
    forces = tuple(PAPERS_BEST[resonance] * ratio for ratio in size.around)
    step = _near(settings, resonance, forces, (IMPACT,), 1, Moreau())
    return {
        "curves": _near(settings, resonance, forces, (NONE, IMPACT), size.members),
        "step": step,
    }


def _limits(settings: PaperSettings, size: Size) -> Json:
    """Return friction limits in N, and the damper's levels with each of them.

    Levels are those of the members in m, at the paper's best force.
    """
    scenes = {f"{limit:g}": beam_scene(Beam(), friction_damper(limit)) for limit in size.limits}
    result = compute_curves(
        settings, f"{LABEL}, friction limits", scenes, (PAPERS_BEST[1],), size.members
    )
    return {
        "limit": list(size.limits),
        "level": [read_curve(result[name]).level[0].tolist() for name in scenes],
    }


def read_curves(part: Json) -> dict[str, LevelCurve]:
    """Return the curves of a resonance, or of the low forces, by the concepts' keys."""
    return {key: read_curve(plain) for key, plain in part.get("curves", part).items()}


def compute_longest_span(forces: Array, inside: NDArray[np.bool_]) -> float:
    """Return the ratio of the ends of the longest unbroken range of forces.

    The range is in the forces (F,) that are ``inside``. It is 1 if no force is inside.
    """
    at = np.flatnonzero(inside)
    return max(
        (
            float(forces[run[-1]] / forces[run[0]])
            for run in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
            if len(run)
        ),
        default=1.0,
    )


def _describe(values: Json) -> str:
    rows = []
    names = [f"resonance {r}" for r in RESONANCES]
    low = read_curves(values["low"])
    labels = {concept.key: concept.label for concept in concepts(modal_model(Beam()))}
    for resonance, name in zip(RESONANCES, names, strict=True):
        result = read_curves(values[name])
        none = result[NONE]
        for key in (
            key
            for key in (IMPACT, FRICTION, LTVA_PAPER, LTVA_PAPER_WIDE, LTVA_TUNED_WIDE)
            if key in result
        ):
            relative = result[key].relative(none)
            best = result[key].best(none)
            linear = key not in (IMPACT, FRICTION)
            force = none.forces[best]
            present = relative[best]
            if (
                best == 0 and not linear
            ):  # the least force of the range: the damper's own lies below it
                k = low[key].best(low[NONE])
                force = low[NONE].forces[k]
                present = low[key].relative(low[NONE])[k]
            at = format_spread(relative[none.nearest(PAPERS_BEST[resonance])], "{:.3f}")
            rows.append(
                (
                    f"{resonance}: {labels[key]}",
                    "any" if linear else f"{force:.3g}",
                    format_spread(present, "{:.3f}"),
                    at,
                )
            )
    none = read_curves(values[names[0]])[NONE]
    limits = ", ".join(f"{values[name]['design_force']:.3g} N" for name in names)
    blocks = [
        (
            f"Ten modes, {none.level.shape[1]} members, {len(none.forces)} forces a resonance. "
            f"The limit leaves zero at {limits}."
        ),
        markdown(
            ("resonance, concept", "best force, N", "over no absorber there", "at 3.5 N and 35 N"),
            rows,
        ),
        _compare_with_limit(values, names),
        shorten_table(_limits_table(values)),
    ]
    return "\n\n".join(blocks)


def _limits_table(values: Json) -> CsvTable:
    """Return a row for each friction limit tried."""
    tried = values["friction"]
    none = read_curves(values["resonance 1"])[NONE]
    alone = float(np.interp(PAPERS_BEST[1], none.forces, none.median))
    lines = [
        (f"{x:.3g}", format_spread(np.array(row) / alone, "{:.3f}"))
        for x, row in zip(tried["limit"], tried["level"], strict=True)
    ]
    return CsvTable(
        f"{LABEL}_limits",
        (f"friction limit of the damper at {PAPERS_BEST[1]:g} N, N", "level over no absorber"),
        lines,
    )


def _compare_with_limit(values: Json, names: list[str]) -> str:
    texts = []
    model = modal_model(Beam())
    for resonance, name in zip(RESONANCES, names, strict=True):
        own = read_curves(values[name])[IMPACT]
        gap = values[name]["gap"]
        limit = resonance_limit(
            model, DEFAULT_MASS_RATIO * model.beam_mass, gap, own.forces, resonance
        )
        above = limit > 0.1 * gap
        if above.any():
            ratio = own.median[above] / limit[above]
            texts.append(
                f"resonance {resonance}, from {own.forces[above][0]:.3g} N: "
                f"{np.max(ratio):.2f} falling to {np.min(ratio):.2f}"
            )
    return (
        "The impact absorber's median over the stationary limit of its mass and gap: "
        f"{'; '.join(texts)}."
    )


def _best(part: Json) -> tuple[Array, float]:
    """Return the members' best forces in N around the paper's, (M,).

    The best force of the single runs at the paper's step is also returned.
    """
    own, none = (read_curve(part["curves"][key]) for key in (IMPACT, NONE))
    step = read_curve(part["step"][IMPACT])
    return find_best_forces(own, none), float(
        step.forces[np.argmin(step.level[:, 0] / none.level[:, 0])]
    )


def _first(values: Json) -> list[Claim]:
    part = values["resonance 1"]
    tried = values["friction"]
    result = read_curves(part)
    none, impact, friction, ltva, tuned = (
        result[key] for key in (NONE, IMPACT, FRICTION, LTVA_PAPER, LTVA_TUNED_WIDE)
    )
    best, at_step = _best(values["around 1"])
    at = none.nearest(float(np.median(best)))
    others = np.minimum(impact.level, friction.level)
    touched = np.median(none.tip, axis=1) > part["gap"]
    level = np.array(tried["level"])
    own = np.array(tried["limit"])[np.argmin(level, axis=0)]
    paper = level[tried["limit"].index(PAPER_LIMIT)] / np.min(level, axis=0)
    judge = partial(make_claim, LABEL)
    return [
        judge("m12_ltva_first", (ltva.level / others)[touched].ravel()),
        judge("m12_ltva_tuned", (tuned.level / others)[touched].ravel()),
        judge(
            "m12_almost_ltva",
            impact.level[at] / ltva.level[at],
            force=none.forces[at],
            tuned=impact.level[at] / tuned.level[at],
        ),
        judge("m12_optimum_first", best, at_step=at_step),
        judge("m12_best_friction", own, tried=len(tried["limit"]), paper=paper),
        judge("m12_wide_first", [_much_better(result)]),
    ]


def _much_better(result: dict[str, LevelCurve]) -> float:
    """Return the width of the range in which the absorber is much better than the damper.

    The width is the ratio of the forces at its ends. In this range the absorber's level is much
    lower than the damper's.
    """
    impact = result[IMPACT]
    friction = result[FRICTION]
    return compute_longest_span(
        impact.forces, (impact.median < MUCH * friction.median) & (impact.impacting > 0.5)
    )


def _second(values: Json) -> list[Claim]:
    part = values["resonance 2"]
    result = read_curves(part)
    low = read_curves(values["low"])
    none = result[NONE]
    best, at_step = _best(values["around 2"])
    damper = find_best_forces(low[FRICTION], low[NONE])
    near = none.nearest(PAPERS_BEST[2])
    at = low[NONE].nearest(float(np.median(damper)))
    other = np.minimum(low[IMPACT].level[at], low[LTVA_PAPER].level[at])
    level = result[IMPACT].relative(none)[near]
    judge = partial(make_claim, LABEL)
    return [
        judge(
            "m12_optimum_second",
            best,
            force=none.forces[near],
            level=level,
            rule=part["design_force"],
            at_step=at_step,
        ),
        judge("m12_wide_second", [_much_better(result)]),
        judge(
            "m12_damper_below_ltva",
            [
                compute_longest_span(
                    none.forces, result[FRICTION].median > result[LTVA_PAPER].median
                )
            ],
        ),
        judge("m12_damper_low", damper / np.median(best), force=np.median(damper)),
        judge("m12_damper_beats", low[FRICTION].level[at] / other),
    ]


def _both(values: Json) -> list[Claim]:
    low = read_curves(values["low"])
    each = [read_curves(values[f"resonance {r}"]) for r in RESONANCES]
    best = np.concatenate(
        [np.min(result[IMPACT].relative(result[NONE]), axis=0) for result in each]
    )
    first, second = (_best(values[f"around {r}"])[0] for r in RESONANCES)
    at = low[NONE].nearest(PAPERS_BEST[1])
    judge = partial(make_claim, LABEL)
    return [
        judge("m12_both", best),
        judge("m12_not_at_once", low[IMPACT].relative(low[NONE])[at], force=low[NONE].forces[at]),
        judge("m12_ten_times", second / np.median(first)),
        _judge_reason(values, second / np.median(first)),
        _judge_range(values),
    ]


def _judge_reason(values: Json, ratios: Array) -> Claim:
    """Judge the ratio of the members' best forces at both resonances, (M,).

    It is compared with the ratio of the forces at which the tip without absorber reaches the gap.
    """
    model = modal_model(Beam())
    one, two = (
        values[f"resonance {r}"]["gap"] / highest_amplitude(model, None, r, *PAPER_LIMITS)[0]
        for r in RESONANCES
    )
    forces = [values[f"resonance {r}"]["design_force"] for r in RESONANCES]
    return make_claim(
        LABEL,
        "m12_reason",
        ratios,
        range_within(LITTLE, two / one),
        one=one,
        two=two,
        later=two / one,
        rule=forces[1] / forces[0],
    )


def _judge_range(values: Json) -> Claim:
    """Judge the longest range of forces in which the absorber is effective, at both resonances.

    In this range there are impacts, and the level is much lower than without absorber.
    """
    cases = []
    texts = []
    for r in RESONANCES:
        result = read_curves(values[f"resonance {r}"])
        impact = result[IMPACT]
        relative = np.median(impact.relative(result[NONE]), axis=1)
        effective = (relative < MUCH) & (impact.impacting > MAJORITY)
        span = compute_longest_span(impact.forces, effective)
        ends = bool(effective.any()) and not effective[0] and not effective[-1]
        cases += [
            judge_interval(span, span, WIDE, INFINITY),
            ClaimVerdict.HOLDS if ends else ClaimVerdict.NOT,
        ]
        ends_at = format_range(impact.forces[effective]) if effective.any() else "no force"
        texts.append(f"{ends_at} N ({ORDINALS[r].lower()} resonance)")
    return make_claim(LABEL, "m12_limited", judge_cases(cases), each=", ".join(texts))


DRAWN = {
    FRICTION: (STYLES[1], "friction damper, 0.5 N"),
    LTVA_PAPER: (STYLES[4], "LTVA, the paper's"),
    LTVA_PAPER_WIDE: (STYLES[3], "LTVA, the paper's, wide sweep"),
    LTVA_TUNED_WIDE: (STYLES[2], "LTVA, well tuned, wide sweep"),
    IMPACT: (STYLES[0], "impact absorber"),
}


DRAWN_TO = {1: 8.0, 2: 80.0}  # N: the largest force drawn at each resonance


def _draw(values: Json) -> Figure:
    """Draw the curves of both resonances, with the damper's own range at the second as an inset."""
    figure, grid = make_panels(1, 2, 4.6)
    for axes, resonance in zip(grid[0], RESONANCES, strict=True):
        part = values[f"resonance {resonance}"]
        _curves(axes, read_curves(part), DRAWN_TO[resonance])
        force = part["limit"]["force"]
        level = np.maximum(MM * np.array(part["limit"]["level"]), 1e-9)
        style: Any = {
            "facecolor": "0.93",
            "edgecolor": "0.7",
            "hatch": "////",
            "lw": 0.5,
            "zorder": 0.4,
        }
        axes.fill_between(
            force, 1e-9, level, label="out of reach of any mass in this cavity, stationary", **style
        )
        for key in (IMPACT, FRICTION):
            own = read_curve(part["step"][key])
            axes.plot(
                own.forces,
                MM * own.level[:, 0],
                "x",
                color=DRAWN[key][0].colour,
                ms=3.5,
                mew=0.7,
                zorder=4,
            )
        axes.set_title(f"{ORDINALS[resonance]} resonance", fontsize=8.5)
    low = read_curves(values["low"])
    draw_inset(
        grid[0, 1],
        (0.12, 0.6, 0.38, 0.3),
        low[NONE],
        {DRAWN[key][0]: low[key] for key in (FRICTION, LTVA_PAPER, IMPACT)},
    )
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=3, fontsize=SMALL, frameon=False
    )
    return figure


def _is_same(result: dict[str, LevelCurve]) -> bool:
    """Return whether a wide sweep gives the paper's tuned absorber the same levels.

    The levels are compared with those of the paper's sweep.
    """
    wide, own = (result[key].median for key in (LTVA_PAPER_WIDE, LTVA_PAPER))
    return bool(np.allclose(wide, own, rtol=SAME_LEVEL_TOL))


def _curves(axes: Axes, result: dict[str, LevelCurve], most: float) -> None:
    none = result[NONE]
    draw_line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for key, (style, label) in DRAWN.items():
        if key in result and not (key == LTVA_PAPER_WIDE and _is_same(result)):
            draw_curve(axes, result[key], style, label)
    axes.axvline(none.forces[result[IMPACT].best(none)], color="0.55", lw=0.8, ls=":")
    set_level_axes(axes, none, most)


FIGURE = PaperFigure(
    LABEL,
    "the comparison of concepts",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=lambda values: [*_first(values), *_second(values), *_both(values)],
    tables=lambda values: (_limits_table(values),),
    # number of forces of each resonance, those around the paper's best one over it, the damper's at
    # the second, and friction limits in N
    sizes=(
        Size(
            forces=24,
            around=np.linspace(0.7, 1.3, 13).round(3).tolist(),
            members=12,
            low=make_force_grid(0.1, 3.5, 12),
            limits=make_force_grid(0.2, 1.25, 14, (PAPER_LIMIT,)),
        ),
        Size(
            forces=8,
            around=(0.75, 0.85, 0.95, 1.0, 1.05, 1.15, 1.25),
            members=2,
            low=make_force_grid(0.2, 3.5, 4),
            limits=(0.3, 0.4, 0.5, 0.6, 0.8),
        ),
    ),
)
