"""The figure `oprange`: a typical performance curve with its operating ranges.

It also shows how the curve approaches the linear case.

The paper leaves its parameters open beside one mode; with a conservative contact one mode has no
primary range, so impacts lose energy here.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import Beam, Moreau, StuckAbsorber, beam_scene, impact_absorber
from optimisation.files import markdown
from studies.paper.claim import Claim, format_spread, make_claim
from studies.paper.curve import (
    LevelCurve,
    Ranges,
    compute_contact_curve,
    compute_curves,
    compute_slopes,
    draw_inset,
    find_ranges,
    make_force_grid,
    read_curve,
    set_level_axes,
)
from studies.paper.frame import (
    MM,
    REFERENCE,
    SMALL,
    STUCK,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_legends,
    draw_line,
    make_panels,
    measure_groups,
)
from studies.study import Json, Steps, not_none

LABEL = "oprange"
RESTITUTION = 0.75
QUASI_LINEAR = 10.0  # N: up to here a straight line is fitted to the secondary range


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    own = beam_scene(Beam(modes=1), impact_absorber(restitution=RESTITUTION))
    linear = {
        "none": beam_scene(Beam(modes=1)),
        "stuck": beam_scene(Beam(modes=1), StuckAbsorber()),
    }
    groups: dict[str, Callable[[], object]] = {
        "absorber": partial(compute_contact_curve, settings, LABEL, own, size.forces, size.members),
        "linear": partial(compute_curves, settings, LABEL, linear, size.forces, size.members),
        "step": lambda: compute_curves(
            settings, LABEL, {"absorber": own}, size.forces, 1, Moreau()
        )["absorber"],
    }
    return measure_groups(groups, earlier)


def _read(values: Json) -> tuple[LevelCurve, LevelCurve, LevelCurve, Ranges]:
    """Return the absorber's curve, those of no absorber and of a stuck one, and the ranges."""
    own = read_curve(values["absorber"])
    return (
        own,
        read_curve(values["linear"]["none"]),
        read_curve(values["linear"]["stuck"]),
        find_ranges(own),
    )


def _describe(values: Json) -> str:
    own, none, stuck, result = _read(values)
    step = read_curve(values["step"])
    relative = own.relative(none)
    rows = [
        (
            f"{own.forces[k]:.3g}",
            format_spread(MM * own.level[k], "{:.3f}"),
            format_spread(relative[k]),
            f"{step.level[k, 0] / none.level[k, 0]:.2f}",
            f"{np.median(own.rate[k]):.1f}",
            f"{own.sustained[k]:.2f}",
        )
        for k in range(0, len(own.forces), max(1, len(own.forces) // 12))
    ]
    first, last = (border or "not within these forces" for border in result)
    header = (
        "force, N",
        "level, mm",
        "over no absorber",
        "at the paper's step",
        "impacts per pseudo period",
        "share with sustained impacts",
    )
    return (
        f"One mode, e = {RESTITUTION:g}, no friction, {own.level.shape[1]} members, "
        f"{len(own.forces)} forces. Marked by what the contacts do in the "
        f"level's window: first impacts {first}, secondary range from {last}.\nThe best point "
        f"lies at {own.forces[own.best(none)]:.3g} N. At "
        f"{own.forces[-1]:g} N the level is "
        f"{format_spread(own.relative(stuck)[-1], '{:.3f}')} of that with the "
        f"absorber stuck.\n\n{markdown(header, rows)}"
    )


def _claims(values: Json) -> list[Claim]:
    """Return the verdicts on the operating ranges."""
    own, none, stuck, (begin, end) = _read(values)
    step = read_curve(values["step"])
    first = not_none(begin)
    last = not_none(end)
    linear = own.forces <= first.low
    secondary = own.forces >= last.high
    primary = (own.forces >= first.high) & (own.forces <= last.low)
    straight = _straightness(own, secondary & (own.forces <= QUASI_LINEAR))
    relative = own.relative(none)
    grid = last.high / last.low
    judge = partial(make_claim, LABEL)
    return [
        judge("oprange_linear_range", relative[linear], low=first.low),
        judge(
            "oprange_saturation",
            compute_slopes(own, primary),
            first=first.high,
            last=last.low,
            at_step=float(compute_slopes(step, primary)[0]),
        ),
        judge("oprange_quasi_linear", straight, low=last.high, high=QUASI_LINEAR),
        judge("oprange_sustained", own.rate[secondary]),
        judge("oprange_linear_limit", own.relative(stuck)[-1], force=own.forces[-1]),
        judge(
            "oprange_optimum",
            own.forces[np.argmin(relative, axis=0)],
            (last.low / grid, last.high * grid),
            **last._asdict(),
        ),
    ]


def _straightness(own: LevelCurve, inside: np.ndarray) -> np.ndarray:
    """Return how much of the level's variance a straight line in the force explains, (M,).

    It is a share for each member.
    """
    level = own.level[inside]
    fit = np.polynomial.polynomial.polyfit(own.forces[inside], level, 1)
    rest = level - (fit[0] + np.outer(own.forces[inside], fit[1]))
    return np.asarray(1 - np.var(rest, axis=0) / np.var(level, axis=0))


SHADES = ("0.97", "0.90", "0.95")


def _draw(values: Json) -> Figure:
    """Draw level over force with the ranges shaded.

    An inset has the same relative to no absorber, up to the highest force.
    """
    own, none, stuck, result = _read(values)
    figure, grid = make_panels(1, 1, 4.2)
    axes = grid[0, 0]
    step = read_curve(values["step"])
    visible = own.forces <= 12.0
    draw_ranges(axes, result, 0.0, 12.0)
    draw_line(axes, none.forces[visible], MM * none.median[visible], REFERENCE, "no absorber")
    draw_band(
        axes,
        own.forces[visible],
        MM * own.level[visible],
        STYLES[0],
        "impact absorber, 1 mode, e = 0.75",
    )
    axes.plot(
        step.forces[visible],
        MM * step.level[visible, 0],
        "x",
        color=STYLES[1].colour,
        ms=4,
        label="one run at the paper's step",
    )
    set_level_axes(axes, none, 12.0)
    axes.legend(loc="upper left")
    small = draw_inset(axes, (0.62, 0.12, 0.36, 0.27), none, {STYLES[0]: own, STUCK: stuck})
    small.legend(
        small.lines[1:2], ["absorber stuck"], fontsize=SMALL, loc="lower right", frameon=False
    )
    draw_legends(grid)
    return figure


def draw_ranges(axes: Axes, result: Ranges, low: float, high: float) -> None:
    """Shade the linear, the primary and the secondary range between two forces in N."""
    first, last = result
    edges = sorted({low, high, *(border.force for border in result if border is not None)})
    primary = first is not None and (last is None or last.force > first.force)
    names = ["linear"] + (["primary"] if primary else []) + (["secondary"] if last else [])
    for name, begin, end, shade in zip(names, edges, edges[1:], SHADES, strict=False):
        axes.axvspan(begin, end, color=shade, lw=0, zorder=0)
        own = axes.get_xaxis_transform()
        place = min((begin + end) / 2, begin + 4.5)
        axes.text(
            place,
            0.16,
            name,
            transform=own,
            ha="center",
            va="bottom",
            fontsize=8,
            color="0.3",
            rotation=90,
        )


FIGURE = PaperFigure(
    LABEL,
    "a typical performance curve and its operating ranges",
    measure=_measure,
    describe=_describe,
    draw=_draw,
    claims=_claims,
    sizes=(
        Size(forces=make_force_grid(0.2, 12.0, 31, (18.0, 27.0, 40.0, 60.0, 100.0)), members=12),
        Size(forces=make_force_grid(0.3, 100.0, 8, (0.9, 1.1, 1.35, 1.7, 2.0, 2.5)), members=3),
    ),
)
