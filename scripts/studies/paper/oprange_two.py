"""The figure `oprangeTWO`: performance with and without loss at the impacts, with one mode and three, and the sweeps at one force f*.

The paper does not say which force f* is. Here it is the one at which the contrast of its four panels is largest: the conservative absorber on one
mode has lost its effect, and the two others are still far below, in 95 % of their members.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_env.curve import BAND, quantiles
from impact_env.drive import PAPER_LIMITS, PAPER_RATE, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.methods import Moreau
from impact_env.parameters import Beam, RigidWalls, impact_absorber
from impact_env.periodic.overview import exact_curves, linear_curves
from impact_env.scene import Scene, beam_scene
from optimisation.page import markdown
from studies.paper.claim import MUCH, PLACE, SAME, Claim, Verdict, claim, spread, within
from studies.paper.curve import Curve, Envelope, curve_of, curves, draw_curve, force_grid, level_axes, ranges_of, watched_curve
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import FAINT, LOOKS, MM, REFERENCE, STUCK, legend_below, legends, line, panels
from studies.study import Json, Steps

LABEL = "oprangeTWO"
NONE, ONE, THREE, LOSSY, BOTH = "none", "1 mode, e = 1", "3 modes, e = 1", "1 mode, e = 0.75", "3 modes, e = 0.75"
SWEPT = (ONE, THREE, LOSSY)  # panels b, c and d
NEAR = 0.0065  # of omega_1: where the paper looks at the response near the resonance itself
ENVELOPE = Envelope()


class Sizes(NamedTuple):
    """How much to compute: forces in N, members of the curves, and of the sweeps at f*."""

    forces: tuple[float, ...]
    members: int
    swept: int


def scenes() -> dict[str, Scene]:
    """Return the scenes of the curves."""
    cases = {ONE: (1, 1.0), THREE: (3, 1.0), LOSSY: (1, 0.75), BOTH: (3, 0.75)}
    return {name: beam_scene(Beam(modes=modes), impact_absorber(restitution=e)) for name, (modes, e) in cases.items()}


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    every = scenes()
    found: Json = dict(known)
    groups: dict[str, Callable[[], object]] = {
        name: partial(watched_curve, settings, LABEL, scene, size.forces, size.members) for name, scene in every.items()
    }
    groups[NONE] = lambda: curves(settings, LABEL, {NONE: beam_scene(Beam(modes=3))}, size.forces, size.members)[NONE]
    groups["step"] = lambda: curves(settings, LABEL, every, size.forces, 1, Moreau())
    for found in in_turn(groups, known):
        yield found
    force = chosen_force({name: curve_of(found[name]) for name in (NONE, *SWEPT)})
    rest: dict[str, Callable[[], object]] = {f"sweeps, {name}": partial(_sweeps, settings, every[name], force, size.swept) for name in SWEPT}
    rest |= {f"orbits, {name}": partial(_orbits, every[name], force) for name in SWEPT}
    for more in in_turn(rest, known):
        yield {**found, "force_n": force, **more}


def chosen_force(read: dict[str, Curve]) -> float:
    """Return f* in N: where one conservative mode is above the two others by most, by its median and their 95 %, relative to no absorber."""
    relative = {name: read[name].relative(read[NONE]) for name in SWEPT}
    others = np.maximum(*(quantiles(relative[name], (BAND[1],))[0] for name in (THREE, LOSSY)))
    return float(read[ONE].forces[np.argmax(np.median(relative[ONE], axis=1) - others)])


def _sweeps(settings: Settings, scene: Scene, force: float, members: int) -> Json:
    """Return envelopes of |q_tip| in m of the sweeps up and down, each member's, over frequency ratios."""
    reference, (low, high), drawn = scene.model.resonance_omega(1), PAPER_LIMITS, draw_members(members, settings.seed)
    result: Json = {}
    for name, (start, stop) in {"up": (low, high), "down": (high, low)}.items():
        schedule = linear_sweep(reference, start, stop, PAPER_RATE)
        own, rows = ENVELOPE.banded(settings, LABEL, scene, drawn.drives(force, schedule))
        near = np.abs(np.array(own["ratio"]) - 1) <= NEAR
        result[name] = own | {"near": np.max(rows[:, near], axis=1).tolist()}
    return result


def _orbits(scene: Scene, force: float) -> Json:
    """Return the branches of symmetric orbits with two impacts a period, and the linear responses, between the sweeps' limits."""
    reference, (low, high) = scene.model.resonance_omega(1), PAPER_LIMITS
    linear = linear_curves(scene, force, reference, low, high)
    branches = [
        {
            "ratio": curve.omega_ratio.tolist(),
            "tip": [float(x) if np.isfinite(x) else None for x in curve.tip_max],
            "stable": curve.stable.tolist() if curve.stable is not None else None,
            "closed": curve.closed,
        }
        for curve in exact_curves(scene, force, reference, low, high)
    ]
    return {"branches": branches, "linear": {"ratio": linear.omega_ratio.tolist(), "alone": linear.alone.tolist(), "stuck": linear.stuck.tolist()}}


def _words(values: Json) -> str:
    if not has(NONE, *scenes())(values):
        return "Not finished."
    none = curve_of(values[NONE])
    rows = []
    for name in scenes():
        own = curve_of(values[name])
        relative, found = own.relative(none), ranges_of(own)
        best = int(np.argmin(np.median(relative, axis=1)))
        marks = [f"{border.low:.3g} to {border.high:.3g}" if border else "" for border in (found.first_impacts, found.transition)]
        at = own.nearest(values.get("force_n", 1.5))
        rows.append((name, *marks, f"{own.forces[best]:.3g}", spread(relative[best]), spread(relative[at]), f"{own.sustained[at]:.2f}"))
    star = f"{values['force_n']:.3g} N" if "force_n" in values else "a force not chosen yet"
    header = ("", "first impacts, N", "secondary from, N", "best force, N", "over no absorber there", "at f*", "sustained at f*")
    return (
        f"{none.level.shape[1]} members, {len(none.forces)} forces. f* = {star}: the force at which the conservative absorber on one mode stands "
        f"highest above the two others.\n\n{markdown(header, rows)}"
    )


def gap_of_isola(orbits: Json) -> float:
    """Return how far in frequency a closed branch is from all others, over omega_1; 0 if no branch is closed."""
    closed = [np.array(branch["ratio"]) for branch in orbits["branches"] if branch["closed"]]
    others = [np.array(branch["ratio"]) for branch in orbits["branches"] if not branch["closed"]]
    if not closed or not others:
        return 0.0
    return max(0.0, float(min(np.min(other) for other in others) - max(np.max(own) for own in closed)))


def _near(values: Json, name: str) -> NDArray[np.float64]:
    """Return each member's largest |q_tip| near omega_1 over that without absorber at the same force, (M,)."""
    sweeps, alone = values[f"sweeps, {name}"], max(values[f"orbits, {name}"]["linear"]["alone"])
    return np.maximum(sweeps["up"]["near"], sweeps["down"]["near"]) / alone


def _claims(values: Json) -> list[Claim]:
    """Return what curves and sweeps say of losses, modes and where the maximum lies."""
    read = {name: curve_of(values[name]) for name in (NONE, *scenes())}
    relative = {name: read[name].relative(read[NONE]) for name in scenes()}
    step = {name: curve_of(values["step"][name]) for name in scenes()}
    force = values["force_n"]
    at = read[ONE].nearest(force)
    impacting = read[ONE].impacting > 0.5
    down = np.where(read[ONE].down[at] > 0, read[ONE].at[at], np.nan)
    said = partial(claim, LABEL)
    star = f"at f* = {force:.3g} N "
    return [
        said("noneffective", "one mode and conservative contact: the level is that without absorber", "4.1", relative[ONE][impacting], within(SAME),
             "The lowest members are those near the first impacts, where the sweep does not always catch the high response.",
             about="over no absorber, all forces with impacts: "),
        said("maximum_at", "one mode, conservative: the largest response lies at 0.95 of omega_1, in the sweep down", "4.1", down,
             (0.95 - PLACE, 0.95 + PLACE),
             "It lies elsewhere, or comes with the sweep up in some members.", about=f"{star}at ", form="{:.3f}",
             at_step=float(step[ONE].at[at, 0])),
        said("resonance_itself", "one mode, conservative: at omega_1 itself the vibration is well suppressed all the same", "4.1", _near(values, ONE),
             (0.0, MUCH), f"Within {NEAR:g} of omega_1, the largest displacement over that without absorber.",
             about=f"{star}largest displacement within {NEAR:g} of omega_1, over no absorber "),
        said("lossy_not_high", "one mode, e = 0.75: the high response is not reached at f*", "4.1", relative[LOSSY][at], (0.0, MUCH),
             f"{100 * read[LOSSY].sustained[at]:.0f} % of the members have sustained impacts around their maximum.",
             about=f"{star}over no absorber ", at_step=float(step[LOSSY].level[at, 0] / read[NONE].level[at, 0])),
        said("lossy_first_impacts", "one mode, e = 0.75: the largest response is that of the first impacts, where |q_tip| reaches the gap", "4.1",
             read[LOSSY].tip[at] / RigidWalls.gap, within(SAME),
             "The largest displacement is not the gap in all members: in some the impacts come first and the response grows after them.",
             about=f"{star}largest displacement over the gap ", form="{:.3f}"),
        said("scattering", "three modes and conservative contact: a similar effect by scattering", "4.1", relative[THREE][at], (0.0, MUCH),
             f"{100 * read[THREE].sustained[at]:.0f} % of the members have sustained impacts around their maximum.",
             about=f"{star}over no absorber ", at_step=float(step[THREE].level[at, 0] / read[NONE].level[at, 0])),
        said("isola", "three modes: the high response is an isola, well apart from the main branch at f*", "4.1",
             [gap_of_isola(values[f"orbits, {THREE}"])], (PLACE, 1.0), "No closed branch of symmetric orbits, or one that reaches the others.",
             about=f"{star}the exact orbits' closed branch ends below the next one by, of omega_1, ", form="{:.3f}"),
        said("reduced_branch", "three modes: scattering lowers the high branch itself", "4.1",
             [_highest(values[f"orbits, {THREE}"]) / _highest(values[f"orbits, {ONE}"])], (0.0, 1.0),
             "The highest orbit of three modes against that of one.", about=f"{star}highest orbit, three modes over one "),
        said("single_frequency", "one frequency, omega_1, underestimates the critical level", "3.3", _near(values, ONE) / relative[ONE][at].mean(),
             (0.0, MUCH), "In some members the largest displacement near omega_1 is nearly that of the whole sweep.",
             about=f"one mode, e = 1, {star}largest displacement near omega_1 over that of the sweeps, both over no absorber "),
        _no_primary(read[ONE]),
    ]  # fmt: skip


def _no_primary(own: Curve) -> Claim:
    """Judge whether the first impacts are the last that pause."""
    found = ranges_of(own)
    first, last = found.first_impacts, found.transition
    holds = first is not None and last is not None and last.low <= first.high
    said = " and ".join("not found" if border is None else f"between {border.low:.3g} and {border.high:.3g} N" for border in (first, last))
    return Claim(
        f"{LABEL}_no_primary", "one mode and conservative contact: practically no primary range", "4.2",
        f"first impacts and secondary range begin {said}", Verdict.HOLDS if holds else Verdict.NOT, LABEL, "There are forces between them.",
    )  # fmt: skip


def _highest(orbits: Json) -> float:
    """Return the largest displacement in m of all orbits."""
    return float(np.nanmax([np.nanmax(np.array(branch["tip"], dtype=float)) for branch in orbits["branches"]]))


def _draw(values: Json) -> Figure:
    """Draw the curves, and below them the sweeps at f* over the exact orbits."""
    figure, grid = panels(2, 2, 6.4)
    _curves(grid[0, 0], values)
    for axes, name in zip(grid.flat[1:], SWEPT, strict=True):
        if f"sweeps, {name}" in values:
            _draw_sweeps(axes, values, name)
    for axes in grid.flat[1:]:
        axes.set_ylim(0, 1.35 * MM * max(values[f"orbits, {ONE}"]["linear"]["stuck"], default=2e-3) if f"orbits, {ONE}" in values else None)
    legend_below(figure, [grid[1, 1]], 5)
    legends([grid[0, 0]])
    return figure


def _curves(axes: Axes, values: Json) -> None:
    none = curve_of(values[NONE])
    line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for look, name in zip(LOOKS, (ONE, THREE, LOSSY, BOTH), strict=False):
        own = curve_of(values[name])
        draw_curve(axes, own, look, name, marked=False)
        border = ranges_of(own).transition
        if border is not None:
            axes.plot(border.force, np.interp(border.force, own.forces, MM * own.median), look.marker, color=look.colour, ms=5, zorder=4)
    if "force_n" in values:
        axes.axvline(values["force_n"], ymax=0.6, color=FAINT, lw=0.9, ls=":")
        axes.text(values["force_n"], 0.5, " f*", transform=axes.get_xaxis_transform(), fontsize=8)
    level_axes(axes, none, 5.0)


def _draw_sweeps(axes: Axes, values: Json, name: str) -> None:
    look = LOOKS[(ONE, THREE, LOSSY).index(name)]
    for direction, shade in (("down", look.colour), ("up", FAINT)):
        own = values[f"sweeps, {name}"][direction]
        ratio, low, middle, high, nominal = (np.array(own[k]) for k in ("ratio", "low", "median", "high", "nominal"))
        axes.fill_between(ratio, MM * low, MM * high, color=shade, alpha=0.25, lw=0)
        axes.plot(ratio, MM * middle, color=shade, lw=1.0, ls="-" if direction == "down" else "--", label=f"swept {direction}")
        axes.plot(ratio, MM * nominal, color=shade, lw=0.4)
    orbits = values.get(f"orbits, {name}")
    if orbits is not None:
        ratio = np.array(orbits["linear"]["ratio"])
        axes.plot(ratio, MM * np.array(orbits["linear"]["alone"]), color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.8, label="no absorber")
        axes.plot(ratio, MM * np.array(orbits["linear"]["stuck"]), color=STUCK.colour, ls=STUCK.dashes, lw=0.8, label="absorber stuck")
        for k, branch in enumerate(orbits["branches"]):
            tip = MM * np.array(branch["tip"], dtype=float)
            axes.plot(branch["ratio"], tip, color="black", lw=0.8, label="periodic, two impacts" if k == 0 else None)
    axes.set(xlim=(0.9, 1.06), xlabel="frequency over $\\omega_1$", ylabel="|tip displacement| in mm")
    axes.set_title(f"    {name}, {values['force_n']:.3g} N", loc="center", fontsize=8.5)


FIGURE = PaperFigure(
    LABEL, "one mode, three modes, and losses at the impacts", measure=_measure, words=_words, draw=_draw, claims=_claims, needs=has(NONE, *scenes()),
    sizes=(Sizes(force_grid(0.5, 12.0, 33, (3.0,)), 12, 24), Sizes(force_grid(0.6, 12.0, 7, (1.2, 1.3, 1.4, 1.7)), 4, 4)),
)  # fmt: skip
