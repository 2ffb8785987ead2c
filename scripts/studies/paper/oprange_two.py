"""The figure `oprangeTWO`: performance with and without loss at the impacts.

It has curves for one mode and three, and the sweeps at one force f*.

The paper does not say which force f* is. Here it is the one at which the contrast of its four
panels is largest: the conservative absorber on one mode has lost its effect, and the two others are
still far below, in 95 % of their members.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import Beam, Moreau, RigidWalls, Scene, beam_scene, impact_absorber
from impact_env.curve import BAND, quantiles
from impact_env.drive import PAPER_LIMITS
from impact_env.ensemble import draw_members
from impact_env.periodic.overview import exact_curves, linear_curves
from optimisation.files import markdown
from studies.paper import curve as performance
from studies.paper.branches import draw_linear
from studies.paper.claim import Claim, format_spread, make_claim
from studies.paper.curve import LevelCurve
from studies.paper.frame import (
    FAINT,
    MM,
    REFERENCE,
    STYLES,
    LineStyle,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legend_below,
    draw_legends,
    draw_line,
    draw_signal,
    make_panels,
    measure_groups,
)
from studies.study import Array, Json, Steps

LABEL = "oprangeTWO"
NONE = "none"
ONE = "1 mode, e = 1"
THREE = "3 modes, e = 1"
LOSSY = "1 mode, e = 0.75"
BOTH = "3 modes, e = 0.75"
SWEPT = (ONE, THREE, LOSSY)  # panels b, c and d
NEAR = 0.0065  # of omega_1: where the paper looks at the response near the resonance itself


def make_scenes() -> dict[str, Scene]:
    """Return the scenes of the curves."""
    cases = {ONE: (1, 1.0), THREE: (3, 1.0), LOSSY: (1, 0.75), BOTH: (3, 0.75)}
    return {
        name: beam_scene(Beam(modes=modes), impact_absorber(restitution=e))
        for name, (modes, e) in cases.items()
    }


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    every = make_scenes()
    result: Json = dict(earlier)
    groups: dict[str, Callable[[], object]] = {
        name: partial(
            performance.compute_contact_curve, settings, LABEL, scene, size.forces, size.members
        )
        for name, scene in every.items()
    }
    groups[NONE] = lambda: performance.compute_curves(
        settings, LABEL, {NONE: beam_scene(Beam(modes=3))}, size.forces, size.members
    )[NONE]
    groups["step"] = lambda: performance.compute_curves(
        settings, LABEL, every, size.forces, 1, Moreau()
    )
    for result in measure_groups(groups, earlier):
        yield result
    force = find_force({name: performance.read_curve(result[name]) for name in (NONE, *SWEPT)})
    rest: dict[str, Callable[[], object]] = {
        f"sweeps, {name}": partial(_sweeps, settings, every[name], force, size.swept)
        for name in SWEPT
    }
    rest |= {f"orbits, {name}": partial(_orbits, every[name], force) for name in SWEPT}
    for more in measure_groups(rest, earlier):
        yield {**result, "force_n": force, **more}


def find_force(read: dict[str, LevelCurve]) -> float:
    """Return f* in N, the force with the largest contrast between the curves.

    There the median of the conservative absorber on one mode exceeds the 95 % quantiles of the two
    others by most, relative to no absorber.
    """
    relative = {name: read[name].relative(read[NONE]) for name in SWEPT}
    others = np.maximum(*(quantiles(relative[name], (BAND[1],))[0] for name in (THREE, LOSSY)))
    return float(read[ONE].forces[np.argmax(np.median(relative[ONE], axis=1) - others)])


def _sweeps(settings: PaperSettings, scene: Scene, force: float, members: int) -> Json:
    """Return each member's envelopes of |q_tip| in m of the sweeps up and down.

    The envelopes are over frequency ratios.
    """
    drawn = draw_members(members, settings.seed)
    result = {}
    for name, schedule in zip(("up", "down"), performance.make_both_sweeps(scene), strict=True):
        own, rows = performance.compute_envelopes(
            settings, LABEL, scene, drawn.drives(force, schedule)
        )
        near = np.abs(np.array(own["ratio"]) - 1) <= NEAR
        result[name] = own | {"near": np.max(rows[:, near], axis=1).tolist()}
    return result


def _orbits(scene: Scene, force: float) -> Json:
    """Return the branches of orbits and the linear responses, between the sweeps' limits.

    The orbits are symmetric with two impacts per period.
    """
    reference = scene.model.resonance_omega(1)
    low, high = PAPER_LIMITS
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
    return {
        "branches": branches,
        "linear": {
            "ratio": linear.omega_ratio.tolist(),
            "alone": linear.alone.tolist(),
            "stuck": linear.stuck.tolist(),
        },
    }


def _describe(values: Json) -> str:
    none = performance.read_curve(values[NONE])
    force = values["force_n"]
    rows = []
    for name in make_scenes():
        own = performance.read_curve(values[name])
        marks = [
            f"{border.low:.3g} to {border.high:.3g}" if border else ""
            for border in performance.find_ranges(own)
        ]
        at = own.nearest(force)
        rows.append(
            (
                name,
                *marks,
                *performance.describe_best(own, none),
                format_spread(own.relative(none)[at]),
                f"{own.sustained[at]:.2f}",
            )
        )
    header = (
        "",
        "first impacts, N",
        "secondary from, N",
        "best force, N",
        "over no absorber there",
        "at f*",
        "sustained at f*",
    )
    return (
        f"{none.level.shape[1]} members, {len(none.forces)} forces. f* = {force:.3g} N: the "
        "force at which the conservative absorber on one mode "
        f"stands highest above the two others.\n\n{markdown(header, rows)}"
    )


def describe_isola_gap(orbits: Json) -> float:
    """Return the distance in frequency of a closed branch from all others, over omega_1.

    It is 0 if no branch is closed.
    """
    closed = [np.array(branch["ratio"]) for branch in orbits["branches"] if branch["closed"]]
    others = [np.array(branch["ratio"]) for branch in orbits["branches"] if not branch["closed"]]
    if not closed or not others:
        return 0.0
    return max(
        0.0, float(min(np.min(other) for other in others) - max(np.max(own) for own in closed))
    )


def _near(values: Json, name: str) -> Array:
    """Return each member's largest |q_tip| near omega_1, (M,).

    It is relative to that without absorber at the same force.
    """
    sweeps = values[f"sweeps, {name}"]
    alone = max(values[f"orbits, {name}"]["linear"]["alone"])
    return np.maximum(sweeps["up"]["near"], sweeps["down"]["near"]) / alone


def _claims(values: Json) -> list[Claim]:
    """Return the verdicts on losses, modes and the maximum's place."""
    read = {name: performance.read_curve(values[name]) for name in (NONE, *make_scenes())}
    relative = {name: read[name].relative(read[NONE]) for name in make_scenes()}
    step = {name: performance.read_curve(values["step"][name]) for name in make_scenes()}
    at = read[ONE].nearest(values["force_n"])
    stepped = {
        name: float(step[name].level[at, 0] / read[NONE].level[at, 0]) for name in (THREE, LOSSY)
    }
    down = np.where(read[ONE].down[at] > 0, read[ONE].at[at], np.nan)
    near = _near(values, ONE)
    one, three = (values[f"orbits, {name}"] for name in (ONE, THREE))
    judge = partial(make_claim, LABEL, star=values["force_n"], near=NEAR)
    first, last = performance.find_ranges(read[ONE])
    borders = " and ".join(
        str(border or "not found") for border in (first, last)
    )  # of the linear and the primary range
    return [
        judge("oprangeTWO_noneffective", relative[ONE][read[ONE].impacting > 0.5]),
        judge("oprangeTWO_maximum_at", down, at_step=float(step[ONE].at[at, 0])),
        judge("oprangeTWO_resonance_itself", near),
        judge(
            "oprangeTWO_lossy_not_high",
            relative[LOSSY][at],
            sustained=read[LOSSY].sustained[at],
            at_step=stepped[LOSSY],
        ),
        judge(
            "oprangeTWO_ceased",
            [_highest(values[f"orbits, {LOSSY}"]) / RigidWalls.gap],
            conservative=_highest(one) / RigidWalls.gap,
        ),
        judge("oprangeTWO_lossy_first_impacts", read[LOSSY].tip[at] / RigidWalls.gap),
        judge(
            "oprangeTWO_scattering",
            relative[THREE][at],
            sustained=read[THREE].sustained[at],
            at_step=stepped[THREE],
        ),
        judge("oprangeTWO_isola", [describe_isola_gap(three)]),
        judge("oprangeTWO_reduced_branch", [_highest(three) / _highest(one)]),
        judge("oprangeTWO_single_frequency", near / relative[ONE][at].mean()),
        judge(
            "oprangeTWO_no_primary",
            first is not None and last is not None and last.low <= first.high,
            borders=borders,
        ),
    ]


def _highest(orbits: Json) -> float:
    """Return the largest displacement in m of all orbits."""
    return float(
        np.nanmax(
            [np.nanmax(np.array(branch["tip"], dtype=float)) for branch in orbits["branches"]]
        )
    )


def _draw(values: Json) -> Figure:
    """Draw the curves, and below them the sweeps at f* over the exact orbits."""
    figure, grid = make_panels(2, 2, 6.4)
    _curves(grid[0, 0], values)
    top = 1.35 * MM * max(values[f"orbits, {ONE}"]["linear"]["stuck"])
    for axes, name, style in zip(grid.flat[1:], SWEPT, STYLES, strict=False):
        _draw_sweeps(axes, values, name, style)
        axes.set_ylim(0, top)
    for axes in grid.flat[1:]:  # each panel has its own colour
        down = axes.get_lines()[0]
        axes.legend(handles=[down], loc="upper left")
        down.set_label("_nolegend_")
    draw_legend_below(figure, [grid[1, 1]], 4)
    draw_legends([grid[0, 0]])
    return figure


def _curves(axes: Axes, values: Json) -> None:
    none = performance.read_curve(values[NONE])
    force = values["force_n"]
    draw_line(axes, none.forces, MM * none.median, REFERENCE, "no absorber", marked=False)
    for style, name in zip(STYLES, (*SWEPT, BOTH), strict=False):
        own = performance.read_curve(values[name])
        performance.draw_curve(axes, own, style, name, marked=False)
        border = performance.find_ranges(own).transition
        if border is not None:
            axes.plot(
                border.force,
                np.interp(border.force, own.forces, MM * own.median),
                style.marker,
                color=style.colour,
                ms=5,
                zorder=4,
            )
    axes.axvline(force, ymax=0.6, color=FAINT, lw=0.9, ls=":")
    axes.text(force, 0.5, " f*", transform=axes.get_xaxis_transform(), fontsize=8)
    performance.set_level_axes(axes, none, 5.0)


def _draw_sweeps(axes: Axes, values: Json, name: str, style: LineStyle) -> None:
    for direction, shade in (("down", style.colour), ("up", FAINT)):
        own = values[f"sweeps, {name}"][direction]
        ratio = own["ratio"]
        low, middle, high, nominal = (
            MM * np.array(own[k]) for k in ("low", "median", "high", "nominal")
        )
        axes.fill_between(ratio, low, high, color=shade, alpha=0.25, lw=0)
        draw_signal(
            axes,
            ratio,
            middle,
            LineStyle(shade, "-" if direction == "down" else "--"),
            f"swept {direction}",
            1.0,
        )
        draw_signal(axes, ratio, nominal, LineStyle(shade), width=0.4)
    orbits = values[f"orbits, {name}"]
    draw_linear(axes, orbits["linear"]["ratio"], orbits["linear"], 0.8)
    for k, branch in enumerate(orbits["branches"]):
        draw_signal(
            axes,
            branch["ratio"],
            MM * np.array(branch["tip"], dtype=float),
            LineStyle("black"),
            None if k else "periodic, two impacts",
            0.8,
        )
    axes.set(
        xlim=(0.9, 1.06), xlabel="frequency over $\\omega_1$", ylabel="|tip displacement| in mm"
    )
    axes.set_title(f"    {name}, {values['force_n']:.3g} N", loc="center", fontsize=8.5)


FIGURE = PaperFigure(
    LABEL,
    "one mode, three modes, and losses at the impacts",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    sizes=(  # swept: members of the sweeps at f*
        Size(forces=performance.make_force_grid(0.5, 12.0, 33, (3.0,)), members=12, swept=24),
        Size(
            forces=performance.make_force_grid(0.6, 12.0, 7, (1.2, 1.3, 1.4, 1.7)),
            members=4,
            swept=4,
        ),
    ),
)
