"""The figure `m12`: absorber concepts near two resonances, from the main study's comparison, with a well-tuned LTVA and the limit."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.curve import CurveCase
from impact_env.methods import Moreau
from impact_env.modes import modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, friction_damper
from impact_env.scene import Scene, beam_scene
from optimisation.bounds import resonance_limit
from optimisation.comparison import FRICTION, IMPACT, LTVA_PAPER, LTVA_PAPER_WIDE, LTVA_TUNED_WIDE, NONE, RESONANCES, compare, concepts
from optimisation.page import markdown
from optimisation.progress import sweeps_bar
from optimisation.report.design_figures import ORDINALS
from studies.paper.claim import INFINITY, LITTLE, MUCH, WIDE, Claim, about, claim, spread
from studies.paper.curve import Curve, best_forces, curve_of, curves, draw_curve, force_grid, inset_of, level_axes, plain_curve
from studies.paper.frame import PaperFigure, Settings, has, in_turn, shortened
from studies.paper.style import LOOKS, MM, REFERENCE, Look, line, panels
from studies.study import Json, Steps, Table

LABEL = "m12"
Array = NDArray[np.float64]
PAPERS_BEST = {1: 3.5, 2: 35.0}  # N, by resonance
PAPER_LIMIT = 0.5  # N, the paper's friction damper
SHOWN = (NONE, FRICTION, LTVA_PAPER_WIDE, LTVA_TUNED_WIDE, IMPACT)


class Sizes(NamedTuple):
    """Forces of each resonance, and of those around the paper's best one over it; members; the rest in N.

    ``low``: forces of the damper's own range at the second resonance, ``limits``: friction limits tried.
    """

    forces: int
    around: tuple[float, ...]
    members: int
    low: tuple[float, ...]
    limits: tuple[float, ...]


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    groups: dict[str, Callable[[], object]] = {f"resonance {r}": partial(_resonance, settings, r, size) for r in RESONANCES}
    groups |= {
        "low": partial(_near, settings, 2, size.low, (NONE, IMPACT, FRICTION, LTVA_PAPER), size.members),
        "friction": partial(_limits, settings, size),
    }
    groups |= {f"around {r}": partial(_around, settings, r, size) for r in RESONANCES}
    return in_turn(groups, known)


def _resonance(settings: Settings, resonance: int, size: Sizes) -> Json:
    """Return the main study's curves near a resonance, the limit, and single runs at the paper's step."""
    with sweeps_bar(f"{LABEL}, resonance {resonance}", leave=False) as show:
        found = compare(
            resonances=(resonance,), forces=size.forces, members=size.members, seed=settings.seed,
            threads=settings.threads, progress=show, executor=settings.executor,
        )  # fmt: skip
    if not found.complete:
        raise KeyboardInterrupt
    (part,) = found.resonances
    dense = np.geomspace(part.forces[0], part.forces[-1], 120)
    forces = tuple(part.forces.tolist())
    return {
        "curves": {key: plain_curve(curve) for key, curve in part.curves.items()},
        "design_force": part.design_force,
        "gap": part.gap,
        "limit": {"force": dense.tolist(), "level": part.limit_at(dense).tolist()},
        "step": _near(settings, resonance, forces, (IMPACT, FRICTION), 1, Moreau()),
    }


def _near(settings: Settings, resonance: int, forces: tuple[float, ...], keys: tuple[str, ...], members: int, method: Moreau | None = None) -> Json:
    """Return plain curves of the paper's concepts near a resonance."""
    model = modal_model(Beam())
    cases = {own.key: CurveCase(Scene(model, own.absorber), np.array(forces), resonance, own.limits) for own in concepts(model) if own.key in keys}
    found = settings.curves(f"{LABEL}, resonance {resonance}", list(cases.values()), members, method)
    return {key: plain_curve(curve) for key, curve in zip(cases, found, strict=True)}


def _around(settings: Settings, resonance: int, size: Sizes) -> Json:
    """Return the absorber's curve and that of no absorber around the paper's best force; ``step``: a single run at the paper's step."""
    forces = tuple(PAPERS_BEST[resonance] * ratio for ratio in size.around)
    step = _near(settings, resonance, forces, (IMPACT,), 1, Moreau())
    return {"curves": _near(settings, resonance, forces, (NONE, IMPACT), size.members), "step": step}


def _limits(settings: Settings, size: Sizes) -> Json:
    """Return friction limits in N, and the members' levels in m of the damper with each of them at the paper's best force."""
    scenes = {f"{limit:g}": beam_scene(Beam(), friction_damper(limit)) for limit in size.limits}
    found = curves(settings, f"{LABEL}, friction limits", scenes, (PAPERS_BEST[1],), size.members)
    return {"limit": list(size.limits), "level": [curve_of(found[name]).level[0].tolist() for name in scenes]}


def read(part: Json) -> dict[str, Curve]:
    """Return the curves of a resonance, or of the low forces, by the concepts' keys."""
    return {key: curve_of(plain) for key, plain in part.get("curves", part).items()}


def span(forces: Array, inside: NDArray[np.bool_]) -> float:
    """Return the ratio of the ends of the longest unbroken range of forces (F,) that are ``inside``; 1 if there are none."""
    best, start = 1.0, None
    for k, here in enumerate([*inside.tolist(), False]):
        if here and start is None:
            start = k
        elif not here and start is not None:
            best, start = max(best, float(forces[k - 1] / forces[start])), None
    return best


def _words(values: Json) -> str:
    names = [f"resonance {r}" for r in RESONANCES]
    if not has(*names)(values):
        return "Not finished."
    rows = []
    labels = {concept.key: concept.label for concept in concepts(modal_model(Beam()))}
    for resonance, name in zip(RESONANCES, names, strict=True):
        found = read(values[name])
        none = found[NONE]
        for key in (IMPACT, FRICTION, LTVA_PAPER, LTVA_PAPER_WIDE, LTVA_TUNED_WIDE):
            if key not in found:
                continue
            relative = found[key].relative(found[NONE])
            best, at = int(np.argmin(np.median(relative, axis=1))), none.nearest(PAPERS_BEST[resonance])
            linear = key not in (IMPACT, FRICTION)
            force, there = none.forces[best], relative[best]
            if best == 0 and not linear and "low" in values:  # the least force of the range: the damper's own lies below it
                near = read(values["low"])
                lower = near[key].relative(near[NONE])
                force, there = near[NONE].forces[(k := int(np.argmin(np.median(lower, axis=1))))], lower[k]
            cells = "any" if linear else f"{force:.3g}", spread(there, "{:.3f}"), spread(relative[at], "{:.3f}")
            rows.append((f"{resonance}: {labels[key]}", *cells))
    first = values[names[0]]
    members = len(first["curves"][NONE]["level"][0])
    limits = ", ".join(f"{values[name]['design_force']:.3g} N" for name in names)
    blocks = [
        f"Ten modes, {members} members, {len(first['curves'][NONE]['forces'])} forces a resonance. The limit leaves zero at {limits}.",
        markdown(("resonance, concept", "best force, N", "over no absorber there", "at 3.5 N and 35 N"), rows),
        _beside_limit(values, names),
    ]
    if "friction" in values:
        blocks.append(shortened(_limits_table(values)))
    return "\n\n".join(blocks)


def _limits_table(values: Json) -> Table:
    """Return a row for each friction limit tried."""
    tried, none = values["friction"], read(values["resonance 1"])[NONE]
    alone = float(np.interp(PAPERS_BEST[1], none.forces, none.median))
    lines = [(f"{x:.3g}", spread(np.array(row) / alone, "{:.3f}")) for x, row in zip(tried["limit"], tried["level"], strict=True)]
    return Table(f"{LABEL}_limits", (f"friction limit of the damper at {PAPERS_BEST[1]:g} N, N", "level over no absorber"), lines)


def _beside_limit(values: Json, names: list[str]) -> str:
    words = []
    for resonance, name in zip(RESONANCES, names, strict=True):
        own, part = read(values[name])[IMPACT], values[name]
        model = modal_model(Beam())
        mass = DEFAULT_MASS_RATIO * model.beam_mass
        limit = resonance_limit(model, mass, part["gap"], own.forces, resonance)
        above = limit > 0.1 * part["gap"]
        if above.any():
            ratio = own.median[above] / limit[above]
            words.append(f"resonance {resonance}, from {own.forces[above][0]:.3g} N: {np.max(ratio):.2f} falling to {np.min(ratio):.2f}")
    return f"The impact absorber's median over the stationary limit of its mass and gap: {'; '.join(words)}."


def _best(part: Json) -> tuple[Array, float]:
    """Return the best forces in N of the members around the paper's, (M,), and that of the single runs at the paper's step."""
    own, none = (curve_of(part["curves"][key]) for key in (IMPACT, NONE))
    step = curve_of(part["step"][IMPACT])
    return best_forces(own, none), float(step.forces[np.argmin(step.level[:, 0] / none.level[:, 0])])


def _first(values: Json) -> list[Claim]:
    part = values["resonance 1"]
    found = read(part)
    none, impact, friction = (found[key] for key in (NONE, IMPACT, FRICTION))
    best, at_step = _best(values["around 1"])
    at = none.nearest(float(np.median(best)))
    ltva = found[LTVA_PAPER]
    others = np.minimum(impact.level, friction.level)
    touched = np.median(none.tip, axis=1) > part["gap"]
    tried = values["friction"]
    level = np.array(tried["level"])
    own = np.array(tried["limit"])[np.argmin(level, axis=0)]
    paper = level[tried["limit"].index(PAPER_LIMIT)] / np.min(level, axis=0)
    said = partial(claim, LABEL)
    return [
        said("ltva_first", "first resonance: the LTVA outperforms absorber and friction damper", "6",
             (found[LTVA_PAPER].level / others)[touched].ravel(), (0.0, 1.0),
             "Single members and forces where the free tip reaches the gap; the LTVA with the paper's values, over the better of both others.",
             about="LTVA over the better of both "),
        said("ltva_tuned", "a perfectly tuned LTVA is not outperformed in its range", "7",
             (found[LTVA_TUNED_WIDE].level / others)[touched].ravel(), (0.0, 1.0), "The well-tuned LTVA, swept over all of its two peaks.",
             about="well-tuned LTVA, wide sweep, over the better of both "),
        said("almost_ltva", "near its optimum the absorber is almost as good as the LTVA", "6",
             impact.level[at] / ltva.level[at], (0.0, 1 + LITTLE),
             f"Its level is {spread(impact.level[at] / found[LTVA_TUNED_WIDE].level[at])} times that of a well-tuned one.",
             about=f"at {none.forces[at]:.3g} N, level over that of the paper's LTVA "),
        said("optimum_first", "first resonance: the best operating point lies at about 3.5 N", "6", best, about(PAPERS_BEST[1]),
             "The best forces of single members.", unit=" N", at_step=at_step),
        said("best_friction", "0.5 N is the best friction limit of a damper at 3.5 N", "6", own, about(PAPER_LIMIT),
             f"The best limits of the members; the optimum is flat: at 0.5 N the level is {spread(paper, '{:.3f}')} of the best one.",
             about=f"best limit of {len(tried['limit'])} tried ", unit=" N"),
        said("wide_first", "first resonance: over a wide range the absorber is much better than the damper", "6",
             [span(none.forces, (impact.median < MUCH * friction.median) & (impact.impacting > 0.5))], (WIDE, INFINITY),
             f"Much better: less than {MUCH:g} of the damper's level; wide: forces of a ratio of {WIDE:g}.",
             about=f"less than {MUCH:g} of the damper's level over forces with a ratio of "),
    ]  # fmt: skip


def _second(values: Json) -> list[Claim]:
    part = values["resonance 2"]
    found, low = read(part), read(values["low"])
    none, impact, friction, ltva = (found[key] for key in (NONE, IMPACT, FRICTION, LTVA_PAPER))
    best, at_step = _best(values["around 2"])
    damper = best_forces(low[FRICTION], low[NONE])
    at = low[NONE].nearest(float(np.median(damper)))
    other = np.minimum(low[IMPACT].level[at], low[LTVA_PAPER].level[at])
    said, near = partial(claim, LABEL), none.nearest(PAPERS_BEST[2])
    return [
        said("optimum_second", "second resonance: the best operating point lies at about 35 N", "6", best, about(PAPERS_BEST[2]),
             f"The best forces of single members; near them the curve is flat: at "
             f"{none.forces[near]:.3g} N the level over no absorber is {spread(impact.relative(none)[near])}. The design rule, "
             f"which needs no run, says {part['design_force']:.3g} N.",
             unit=" N", form="{:.1f}", at_step=at_step),
        said("wide_second", "second resonance: over a wide range the absorber is much better than the damper", "6",
             [span(none.forces, (impact.median < MUCH * friction.median) & (impact.impacting > 0.5))], (WIDE, INFINITY),
             f"Much better: less than {MUCH:g} of the damper's level; wide: forces of a ratio of {WIDE:g}.",
             about=f"less than {MUCH:g} of the damper's level over forces with a ratio of "),
        said("damper_below_ltva", "second resonance: the damper is worse than the detuned LTVA over a wide range", "6",
             [span(none.forces, friction.median > ltva.median)], (WIDE, INFINITY), f"Wide: forces of a ratio of {WIDE:g}.",
             about="worse over forces with a ratio of "),
        said("damper_low", "second resonance: the damper's optimum lies at much lower forces", "6", damper / np.median(best), (0.0, MUCH),
             "It lies nearer.", about=f"at {np.median(damper):.2g} N; over the absorber's best ", form="{:.3f}"),
        said("damper_beats", "there the damper outperforms LTVA and absorber", "6", low[FRICTION].level[at] / other, (0.0, 1.0),
             "The better of both others at the damper's best force.", about="damper over the better of both "),
    ]  # fmt: skip


def _both(values: Json) -> list[Claim]:
    first, second = (read(values[f"resonance {r}"]) for r in RESONANCES)
    low = read(values["low"])
    best = np.concatenate([np.min(found[IMPACT].relative(found[NONE]), axis=0) for found in (first, second)])
    at = low[NONE].nearest(PAPERS_BEST[1])
    said = partial(claim, LABEL)
    return [
        said("both", "the same absorber is effective at both resonances", "6", best, (0.0, MUCH), "A fifth less than no absorber is asked for.",
             about="best level over no absorber, both resonances "),
        said("not_at_once", "but not at one force: the first one's best is far from the second's", "6",
             low[IMPACT].relative(low[NONE])[at], (MUCH, 1.1), "Friction alone acts there.",
             about=f"second resonance at {low[NONE].forces[at]:.3g} N, over no absorber "),
        said("ten_times", "the second resonance's best force is about ten times the first one's", "6",
             _best(values["around 2"])[0] / np.median(_best(values["around 1"])[0]), about(10), "The best forces of single members.", form="{:.1f}",
             about="best forces of the members over the first one's median "),
    ]  # fmt: skip


DRAWN = {
    FRICTION: (LOOKS[1], "friction damper, 0.5 N"),
    LTVA_PAPER: (Look(LOOKS[4].colour, LOOKS[4].dashes), "LTVA, the paper's"),
    LTVA_PAPER_WIDE: (Look(LOOKS[4].colour, ":"), "LTVA, the paper's, wide sweep"),
    LTVA_TUNED_WIDE: (Look(LOOKS[2].colour, LOOKS[2].dashes), "LTVA, well tuned, wide sweep"),
    IMPACT: (LOOKS[0], "impact absorber"),
}


DRAWN_TO = {1: 8.0, 2: 80.0}  # N: the largest force drawn at each resonance


def _draw(values: Json) -> Figure:
    """Draw the curves of both resonances, with the damper's own range at the second as an inset."""
    figure, grid = panels(1, 2, 4.6)
    for axes, resonance in zip(grid[0], RESONANCES, strict=True):
        part = values[f"resonance {resonance}"]
        _curves(axes, read(part), DRAWN_TO[resonance])
        _limit(axes, part)
        for key in (IMPACT, FRICTION):
            own = curve_of(part["step"][key])
            axes.plot(own.forces, MM * own.level[:, 0], "x", color=DRAWN[key][0].colour, ms=3.5, mew=0.7, zorder=4)
        axes.set_title(f"{ORDINALS[resonance]} resonance", fontsize=8.5)
    if "low" in values:
        low = read(values["low"])
        inset_of(grid[0, 1], (0.09, 0.62, 0.38, 0.3), low[NONE], {DRAWN[key][0]: low[key] for key in (FRICTION, LTVA_PAPER, IMPACT)})
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure


def _curves(axes: Axes, found: dict[str, Curve], most: float) -> None:
    none = found[NONE]
    line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for key, (look, label) in DRAWN.items():
        if key in found:
            draw_curve(axes, found[key], look, label)
    best = int(np.argmin(np.median(found[IMPACT].relative(none), axis=1)))
    axes.axvline(none.forces[best], color="0.55", lw=0.8, ls=":")
    level_axes(axes, none, most)


def _limit(axes: Axes, part: Json) -> None:
    force, level = np.array(part["limit"]["force"]), MM * np.array(part["limit"]["level"])
    style: Any = {"facecolor": "0.93", "edgecolor": "0.7", "hatch": "////", "lw": 0.5, "zorder": 0.4}
    axes.fill_between(force, 1e-9, np.maximum(level, 1e-9), label="out of reach of any mass in this cavity, stationary", **style)


FIGURE = PaperFigure(
    LABEL, "the comparison of concepts", measure=_measure, words=_words, draw=_draw,
    claims=lambda values: [*_first(values), *_second(values), *_both(values)],
    needs=has(*(f"resonance {r}" for r in RESONANCES)), tables=lambda values: (_limits_table(values),),
    sizes=(
        Sizes(24, tuple(np.round(np.linspace(0.7, 1.3, 13), 3).tolist()), 12, force_grid(0.1, 3.5, 12), force_grid(0.2, 1.25, 14, (PAPER_LIMIT,))),
        Sizes(8, (0.75, 0.85, 0.95, 1.0, 1.05, 1.15, 1.25), 2, force_grid(0.2, 3.5, 4), (0.3, 0.4, PAPER_LIMIT, 0.6, 0.8)),
    ),
)  # fmt: skip
