"""The figure `dissinf`: friction and restitution, as performance curves and as sweeps down at 5 N, with ten modes."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.curve import BAND, quantiles
from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.methods import Moreau
from impact_env.parameters import Absorber, Beam, RigidWalls, friction_damper, impact_absorber
from impact_env.scene import Scene, beam_scene
from optimisation.page import markdown
from studies.paper.claim import INFINITY, LITTLE, MUCH, SAME, Claim, claim, judged, spread, within
from studies.paper.curve import Curve, Envelope, best_forces, curve_of, curves, draw_curve, force_grid, inset_of, level_axes
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import LOOKS, MM, REFERENCE, Look, line, panels
from studies.study import Json, Steps

LABEL = "dissinf"
Array = NDArray[np.float64]
LIMITS = (0.1, 0.5, 1.0)  # N; the paper's own ones but for 0.1 N are not in its text
RESTITUTION = 0.7
SWEPT, SWEPT_LIMIT = 5.0, 0.5  # N: force and friction limit of the sweeps
NONE, CONSERVATIVE, DISSIPATIVE = "no absorber", "muN = 0, e = 1", f"muN = {LIMITS[0]:g} N, e = {RESTITUTION:g}"
SCATTERING, FRICTION, BOTH, ALL = "scattering", "friction", "friction and scattering", "friction, scattering and e = 0.7"
PRIMARY, SECONDARY = (1.0, 3.0), (4.0, 8.0)  # N: well inside of the ranges without friction, whose border is the paper's 3.5 N
ENVELOPE = Envelope(8)


class Sizes(NamedTuple):
    """Forces in N, members of the curves, and of the sweeps."""

    forces: tuple[float, ...]
    members: int
    swept: int


def impacting(limit: float) -> str:
    """Return the name of the absorber with friction and conservative impacts."""
    return f"muN = {limit:g} N, e = 1"


def sliding(limit: float) -> str:
    """Return the name of the pure damper."""
    return f"damper, muN = {limit:g} N"


def _scenes() -> dict[str, Scene]:
    absorbers: dict[str, Absorber | None] = {NONE: None, CONSERVATIVE: impact_absorber()}
    absorbers |= {impacting(limit): impact_absorber(friction_limit=limit) for limit in LIMITS}
    absorbers |= {sliding(limit): friction_damper(limit) for limit in LIMITS}
    absorbers[DISSIPATIVE] = impact_absorber(restitution=RESTITUTION, friction_limit=LIMITS[0])
    return {name: beam_scene(Beam(), absorber) for name, absorber in absorbers.items()}


def swept_scenes() -> dict[str, Scene]:
    """Return the scenes of the sweeps: what there is beside the first mode's own damping."""
    absorbers = {
        FRICTION: friction_damper(SWEPT_LIMIT),
        SCATTERING: impact_absorber(),
        BOTH: impact_absorber(friction_limit=SWEPT_LIMIT),
        ALL: impact_absorber(restitution=RESTITUTION, friction_limit=SWEPT_LIMIT),
    }
    return {name: beam_scene(Beam(), absorber) for name, absorber in absorbers.items()}


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    scenes = _scenes()
    groups: dict[str, Callable[[], object]] = {
        name: partial(_curve, settings, name, scene, size.forces, size.members) for name, scene in scenes.items()
    }
    stepped = (CONSERVATIVE, impacting(LIMITS[0]), DISSIPATIVE)
    groups |= {f"step, {name}": partial(_curve, settings, name, scenes[name], size.forces, 1, Moreau()) for name in stepped}
    groups |= {f"sweep, {name}": partial(_sweep, settings, scene, size.swept) for name, scene in swept_scenes().items()}
    return in_turn(groups, known)


def _curve(settings: Settings, name: str, scene: Scene, forces: tuple[float, ...], members: int, method: Moreau | None = None) -> Json:
    return curves(settings, f"{LABEL}, {name}", {name: scene}, forces, members, method)[name]


def _sweep(settings: Settings, scene: Scene, members: int) -> Json:
    """Return the envelope of |q_tip| in m of the sweeps down over frequency ratios, and each member's largest."""
    schedule = linear_sweep(scene.model.resonance_omega(1), PAPER_LIMITS[1], PAPER_LIMITS[0])
    own, rows = ENVELOPE.banded(settings, f"{LABEL}, sweeps", scene, draw_members(members, settings.seed).drives(SWEPT, schedule))
    return own | {"largest": np.max(rows, axis=1).tolist()}


def first_impacts(own: Curve) -> Array:
    """Return each member's lowest force in N with an impact, (M,); infinite if there is none."""
    found = own.impacts > 0
    return np.where(found.any(axis=0), own.forces[np.argmax(found, axis=0)], np.inf)


def forces_at(own: Curve, level: float) -> Array:
    """Return the highest force in N at which each member's curve rises through a ``level`` in m, between forces on a logarithmic axis, (M,).

    NaN where it does not.
    """
    x, y = np.log(own.forces), np.log(own.level / level)
    found = np.full(y.shape[1], np.nan)
    for m, row in enumerate(y.T):
        rising = np.flatnonzero((row[:-1] < 0) & (row[1:] >= 0))
        if len(rising):
            k = int(rising[-1])
            found[m] = np.exp(x[k] - row[k] * (x[k + 1] - x[k]) / (row[k + 1] - row[k]))
    return found


def _words(values: Json) -> str:
    if not has(*_scenes())(values):
        return "Not finished."
    none = curve_of(values[NONE])
    at = none.nearest(SWEPT)
    rows = []
    for name in values:
        if name not in _scenes() or name == NONE:
            continue
        own = curve_of(values[name])
        relative, first = own.relative(none), float(np.median(first_impacts(own)))
        best = int(np.argmin(np.median(relative, axis=1)))
        met = f"{first:.2f}" if np.isfinite(first) else "none"
        rows.append((name, met, f"{own.forces[best]:.3g}", spread(relative[best]), spread(relative[at])))
    header = ("", "first impacts from, N", "best force, N", "over no absorber there", f"at {SWEPT:g} N")
    blocks = [f"Ten modes, {none.level.shape[1]} members, {len(none.forces)} forces.", markdown(header, rows)]
    if has(*(f"sweep, {name}" for name in swept_scenes()))(values):
        lines = [(name, spread(1e3 * np.array(values[f"sweep, {name}"]["largest"]))) for name in swept_scenes()]
        blocks.append(markdown((f"down at {SWEPT:g} N, muN = {SWEPT_LIMIT:g} N", "largest displacement, mm"), lines))
    return "\n\n".join(blocks)


def _within(own: Curve, other: Curve, span: tuple[float, float]) -> Array:
    """Return level over another curve's at the forces of a span in N, by member, as one row."""
    inside = (own.forces >= span[0]) & (own.forces <= span[1])
    return (own.level[inside] / other.level[inside]).ravel()


def _dampers(values: Json) -> list[Claim]:
    read = {name: curve_of(values[name]) for name in _scenes()}
    none = read[NONE]
    relative = {limit: read[sliding(limit)].relative(none) for limit in LIMITS}
    small, large = LIMITS[0], LIMITS[-1]
    ends = np.concatenate([relative[large][0], relative[small][-1]])
    least = np.concatenate([np.min(one, axis=0) for one in relative.values()])
    best = np.array([best_forces(read[sliding(limit)], none) for limit in LIMITS])
    first = np.array([first_impacts(read[name]) for name in (CONSERVATIVE, *map(impacting, LIMITS))])
    own = best_forces(read[impacting(small)], none)
    said = partial(claim, LABEL)
    return [
        said("damper_ends", "a friction damper is linear at low and at high forces", "5", ends, within(SAME),
             "The friction still acts at the end of the curve.",
             about=f"over no absorber, {large:g} N at {none.forces[0]:g} N and {small:g} N at {none.forces[-1]:g} N: "),
        said("damper_best", "between them it has an optimum", "5", least, (0.0, MUCH), "A fifth less than no absorber is asked for.",
             about="best level over no absorber "),
        said("damper_moves", "a higher friction limit has its optimum at a higher force", "5", (best[1:] / best[:-1]).ravel(), (1.0, INFINITY),
             "Neighbouring friction limits share a force of the curve in some members.",
             about=f"best forces {', '.join(f'{np.median(row):.2g}' for row in best)} N; ratio of neighbours "),
        said("first_impacts", "with a higher friction limit the first impacts come at a higher force", "5", (first[1:] / first[:-1]).ravel(),
             (1.0, INFINITY), "Neighbouring friction limits share a force of the curve in some members.",
             about=f"from {', '.join(f'{np.median(row):.2g}' for row in first)} N; ratio of neighbours "),
        said("damper_before", f"small friction ({small:g} N): the damper's optimum lies well before the absorber's", "5", best[0] / own, (0.0, MUCH),
             "The best forces of single members.", about="damper's best force over the absorber's "),
    ]  # fmt: skip


def _absorbers(values: Json) -> list[Claim]:
    read = {name: curve_of(values[name]) for name in _scenes()}
    step = {name: curve_of(values[f"step, {name}"]) for name in (CONSERVATIVE, impacting(LIMITS[0]), DISSIPATIVE)}
    none = read[NONE]
    plain, small, large = read[CONSERVATIVE], read[impacting(LIMITS[0])], read[impacting(LIMITS[-1])]
    first, last = (f"{low:g} to {high:g} N" for low, high in (PRIMARY, SECONDARY))
    ends = [forces_at(curve, RigidWalls.gap) for curve in (plain, small)]
    begins = [np.median(first_impacts(curve)) for curve in (plain, small)]
    said = partial(claim, LABEL)

    def at_step(one: str, other: str, span: tuple[float, float]) -> float:
        return float(np.median(_within(step[one], step[other], span)))

    return [
        said("small_primary", f"primary range: {LIMITS[0]:g} N of friction leaves the level almost as without", "5", _within(small, plain, PRIMARY),
             within(LITTLE), "The members of both spread by several per cent in this range.", about=f"{first}: with over without ",
             at_step=at_step(impacting(LIMITS[0]), CONSERVATIVE, PRIMARY)),
        said("shifted", "with it the primary range is shifted to higher forces", "5", ends[1] / np.median(ends[0]), (1.0, INFINITY),
             "Single members over the median without friction. The range begins later by far more than it ends later.",
             about=f"begins at {begins[1]:.2g} N, not {begins[0]:.2g} N; ends, where the level comes to the gap, at {np.median(ends[1]):.3g} N, not "
             f"{np.median(ends[0]):.3g} N: ratio ", form="{:.3f}"),
        said("large_primary", "primary range: a higher friction limit is worse", "5", _within(large, plain, PRIMARY), (1.0, INFINITY),
             "Single members and forces; some gain where friction keeps the absorber from its first impacts.",
             about=f"{LIMITS[-1]:g} N over none, {first}: "),
        said("large_secondary", "secondary range (above 3.5 N): a higher friction limit is better", "5", _within(large, plain, SECONDARY), (0.0, 1.0),
             f"Single members and forces. With {LIMITS[-1]:g} N the first impacts come at {np.median(first_impacts(large)):.2g} N only; below and "
             "just above, it is still a friction damper in its own primary range.", about=f"{LIMITS[-1]:g} N over none, {last}: "),
        said("restitution_secondary", "secondary range: losses at the impacts (e = 0.7) improve it further", "5",
             _within(read[DISSIPATIVE], small, SECONDARY), (0.0, 1.0), "Single members and forces.", about=f"e = 0.7 over e = 1, {last}: ",
             at_step=at_step(DISSIPATIVE, impacting(LIMITS[0]), SECONDARY)),
        said("restitution_primary", "primary range: they cannot reduce the level further", "5", _within(read[DISSIPATIVE], small, PRIMARY),
             (1 - SAME, INFINITY), "Single members and forces. Where the level is that of the first impacts no loss can lower it.",
             about=f"e = 0.7 over e = 1, {first}: ",
             at_step=at_step(DISSIPATIVE, impacting(LIMITS[0]), PRIMARY)),
        said("robust_small", f"the level is rather robust against friction in the main ranges ({LIMITS[0]:g} N)", "5",
             _within(small, plain, (PRIMARY[0], SECONDARY[1])), within(LITTLE), "Single members and forces; most of it is the shift of the optimum.",
             about=f"{LIMITS[0]:g} N over none, {PRIMARY[0]:g} to {SECONDARY[1]:g} N: ",
             at_step=at_step(impacting(LIMITS[0]), CONSERVATIVE, (PRIMARY[0], SECONDARY[1]))),
        *(said(f"robust_{limit:g}", f"the level is rather robust against friction in the main ranges ({limit:g} N)", "5",
               _within(read[impacting(limit)], plain, PRIMARY), within(LITTLE),
               "In the primary range friction keeps the absorber from its first impacts, the longer the more of it there is.",
               about=f"{limit:g} N over none, {first}: ") for limit in LIMITS[1:]),
        _neither(read, none),
    ]  # fmt: skip


def _neither(read: dict[str, Curve], none: Curve) -> Claim:
    """Judge what friction does to the best level, by the least favourable of its limits."""
    best = {name: np.min(read[name].relative(none), axis=0) for name in (CONSERVATIVE, *map(impacting, LIMITS))}
    over = [best[impacting(limit)] / np.median(best[CONSERVATIVE]) for limit in LIMITS]
    low, high = (float(each(quantiles(row, BAND)[k] for row in over)) for k, each in ((0, min), (1, max)))
    said = ", ".join(f"{spread(row)} at {limit:g} N" for row, limit in zip(over, LIMITS, strict=True))
    return Claim(f"{LABEL}_neither", "friction neither impedes nor significantly improves the performance", "7",
                 f"best level over that without friction {said}", judged(low, high, *within(LITTLE)), LABEL,
                 f"So it is at {LIMITS[0]:g} N; more friction makes the best level worse, and moves it to a higher force.")  # fmt: skip


def _swept(values: Json) -> list[Claim]:
    largest = {name: np.array(values[f"sweep, {name}"]["largest"]) for name in swept_scenes()}
    said = partial(claim, LABEL)
    alone = np.minimum(np.median(largest[SCATTERING]), np.median(largest[FRICTION]))
    return [
        said("added", f"{SWEPT:g} N, down: friction adds to scattering", "5", largest[BOTH] / alone, (0.0, 1.0),
             "The largest displacement of single members over the median of the better one alone.", about="both over the better one alone "),
        said("added_losses", f"{SWEPT:g} N, down: losses at the impacts add to both", "5", largest[ALL] / np.median(largest[BOTH]), (0.0, 1.0),
             "The largest displacement of single members over the median without those losses.", about="all over friction and scattering "),
    ]  # fmt: skip


def _draw(values: Json) -> Figure:
    """Draw the curves, and the sweeps below them."""
    figure, grid = panels(2, 1, 7.6)
    _curves(grid[0, 0], values)
    _sweeps(grid[1, 0], values)
    return figure


DAMPER = (0, (4, 2))  # dashes of its curves


def _curves(axes: Axes, values: Json) -> None:
    none = curve_of(values[NONE])
    line(axes, none.forces, MM * none.median, REFERENCE, NONE, marked=False)
    looks = (LOOKS[5], *(Look(look.colour, "-", look.marker) for look in (*LOOKS[: len(LIMITS)], LOOKS[4])))
    names = dict(zip((CONSERVATIVE, *map(impacting, LIMITS), DISSIPATIVE), looks, strict=True))
    for name, look in names.items():
        draw_curve(axes, curve_of(values[name]), look, name, marked=name != CONSERVATIVE)
    for limit, look in zip(LIMITS, LOOKS, strict=False):
        own = curve_of(values[sliding(limit)])
        axes.plot(own.forces, MM * own.median, color=look.colour, ls=DAMPER, lw=1.0, label=sliding(limit))
    drawn = {look: curve_of(values[name]) for name, look in names.items()}
    drawn |= {Look(look.colour, DAMPER): curve_of(values[sliding(limit)]) for limit, look in zip(LIMITS, LOOKS, strict=False)}
    inset_of(axes, (0.05, 0.57, 0.4, 0.36), none, drawn)
    level_axes(axes, none, SECONDARY[1])
    axes.legend(fontsize=7, frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.12))


def _sweeps(axes: Axes, values: Json) -> None:
    for look, name in zip(LOOKS, swept_scenes(), strict=False):
        if f"sweep, {name}" in values:
            own = values[f"sweep, {name}"]
            whole = slice(None, -1)  # but the last stretch, which is short
            ratio, low, middle, high, nominal = (np.array(own[key])[whole] for key in ("ratio", "low", "median", "high", "nominal"))
            look = Look(look.colour, look.dashes)
            line(axes, ratio, MM * middle, look, name, band=(MM * low, MM * high), nominal=MM * nominal)
    axes.set(xlim=(0.9, 1.06), ylim=(0, None), xlabel="frequency over $\\omega_1$", ylabel=f"|tip displacement| in mm, down at {SWEPT:g} N")
    axes.legend(fontsize=7, frameon=False)


FIGURE = PaperFigure(
    LABEL, "friction and restitution", measure=_measure, words=_words, draw=_draw,
    claims=lambda values: [*_dampers(values), *_absorbers(values), *_swept(values)], needs=has(*_scenes()),
    sizes=(
        Sizes(force_grid(0.1, 20.0, 28, (3.5, SWEPT)), 12, 16),
        Sizes((0.1, 0.4, 0.8, 1.2, 2.0, 2.8, 3.5, 4.2, SWEPT, 8.0, 20.0), 2, 2),
    ),
)  # fmt: skip
