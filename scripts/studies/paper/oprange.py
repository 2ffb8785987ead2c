"""The figure `oprange`: a typical performance curve with its operating ranges, and the approach to the linear case.

The paper leaves its parameters open beside one mode; with a conservative contact one mode has no primary range, so impacts lose energy here.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env.methods import Moreau
from impact_env.parameters import Beam, StuckAbsorber, impact_absorber
from impact_env.scene import beam_scene
from optimisation.page import markdown
from studies.paper.claim import INFINITY, LITTLE, SAME, Claim, Verdict, claim, spread, within
from studies.paper.curve import Curve, Ranges, curve_of, curves, force_grid, inset_of, level_axes, ranges_of, slopes, watched_curve
from studies.paper.frame import PaperFigure, Settings, has, in_turn
from studies.paper.style import LOOKS, MM, REFERENCE, STUCK, legends, line, panels
from studies.study import Json, Steps

LABEL = "oprange"
RESTITUTION = 0.75
QUASI_LINEAR = 10.0  # N: up to here the secondary range is asked whether it is a straight line


class Sizes(NamedTuple):
    """Forces in N, and members."""

    forces: tuple[float, ...]
    members: int


def _measure(settings: Settings, size: Sizes, known: Json) -> Steps:
    own = beam_scene(Beam(modes=1), impact_absorber(restitution=RESTITUTION))
    linear = {"none": beam_scene(Beam(modes=1)), "stuck": beam_scene(Beam(modes=1), StuckAbsorber())}
    groups: dict[str, Callable[[], object]] = {
        "absorber": partial(watched_curve, settings, LABEL, own, *size),
        "linear": partial(curves, settings, LABEL, linear, *size),
        "step": lambda: curves(settings, LABEL, {"absorber": own}, size.forces, 1, Moreau())["absorber"],
    }
    return in_turn(groups, known)


def _read(values: Json) -> tuple[Curve, Curve, Curve, Ranges]:
    """Return the absorber's curve, those of no absorber and of a stuck one, and the ranges."""
    own = curve_of(values["absorber"])
    return own, curve_of(values["linear"]["none"]), curve_of(values["linear"]["stuck"]), ranges_of(own)


def _words(values: Json) -> str:
    if not has("absorber", "linear")(values):
        return "Not finished."
    own, none, stuck, found = _read(values)
    first, last = found.first_impacts, found.transition
    step = curve_of(values["step"]) if "step" in values else None
    relative = own.relative(none)
    best = int(np.argmin(np.median(relative, axis=1)))
    rows = [
        (
            f"{own.forces[k]:.3g}",
            spread(MM * own.level[k], "{:.3f}"),
            spread(relative[k]),
            "" if step is None else f"{step.level[k, 0] / none.level[k, 0]:.2f}",
            f"{np.median(own.rate[k]):.1f}",
            f"{own.sustained[k]:.2f}",
        )
        for k in range(0, len(own.forces), max(1, len(own.forces) // 12))
    ]
    borders = ", ".join(
        f"{name} {'not within these forces' if border is None else f'between {border.low:.3g} and {border.high:.3g} N'}"
        for name, border in (("first impacts", first), ("secondary range from", last))
    )
    header = ("force, N", "level, mm", "over no absorber", "at the paper's step", "impacts per pseudo period", "share with sustained impacts")
    return (
        f"One mode, e = {RESTITUTION:g}, no friction, {own.level.shape[1]} members, {len(own.forces)} forces. Marked by what the contacts do in the "
        f"level's window: {borders}.\nThe best point lies at {own.forces[best]:.3g} N. At {own.forces[-1]:g} N the level is "
        f"{spread(own.relative(stuck)[-1], '{:.3f}')} of that with the absorber stuck.\n\n{markdown(header, rows)}"
    )


def _claims(values: Json) -> list[Claim]:
    """Return what the curve says of the operating ranges."""
    own, none, stuck, found = _read(values)
    step = curve_of(values["step"])
    first, last = found.first_impacts, found.transition
    assert first is not None
    assert last is not None
    linear, secondary = own.forces <= first.low, own.forces >= last.high
    primary = (own.forces >= first.high) & (own.forces <= last.low)
    straight = secondary & (own.forces <= QUASI_LINEAR)
    relative = own.relative(none)
    grid = last.high / last.low
    said = partial(claim, LABEL)
    return [
        said("linear_range", "low forces: no impacts, and a linear response", "3.3", relative[linear], within(SAME), "",
             about=f"up to {first.low:.3g} N no impacts; level over no absorber ", form="{:.4f}", definitional=True),
        said("saturation", "in the primary range the level hardly depends on the force", "3.3", slopes(own, primary), (-LITTLE, LITTLE),
             f"Between {first.high:.3g} and {last.low:.3g} N the exponent of the level in the force is not within 0.25 of zero in all members.",
             about=f"{first.high:.3g} to {last.low:.3g} N: level goes with the force to the power ", at_step=float(slopes(step, primary)[0])),
        said("quasi_linear", "in the secondary range the level depends on the force almost linearly", "3.3",
             _straightness(own, straight), (1 - SAME, 1.0),
             f"A straight line explains less than 95 % of the level's variance between {last.high:.3g} and {QUASI_LINEAR:g} N in some members.",
             about=f"{last.high:.3g} to {QUASI_LINEAR:g} N: share of the variance that a straight line explains ", form="{:.4f}"),
        said("sustained", "in the secondary range impacts are sustained, two or more in each pseudo period", "3.3",
             own.rate[secondary], (1.99, INFINITY),
             "The number is counted in the level's window, 20 pseudo periods around the largest displacement; fewer come near the transition.",
             about="impacts in a pseudo period ", form="{:.1f}"),
        said("linear_limit", "at very high forces the level approaches that of the absorber as a fixed mass", "3.3",
             own.relative(stuck)[-1], within(SAME),
             "The clearance still counts at this force.", about=f"at {own.forces[-1]:g} N over the stuck absorber ", form="{:.3f}"),
        said("optimum", "the best operating point is the transition from the primary to the secondary range", "3.3",
             own.forces[np.argmin(relative, axis=0)], (last.low / grid, last.high * grid),
             f"The members' best forces spread beyond the transition, {last.low:.3g} to {last.high:.3g} N, by more than one step of the curve.",
             about=f"transition between {last.low:.3g} and {last.high:.3g} N; best forces of the members ", unit=" N"),
        _steps(own, none, step),
    ]  # fmt: skip


def _steps(own: Curve, none: Curve, step: Curve) -> Claim:
    """Judge the single run at the paper's step, force by force, by the members' band and what it is widened by; the weakest force decides."""
    low, high = own.band
    off = step.level[:, 0] / own.median - 1
    worst = int(np.argmax(np.abs(off)))
    beside = (step.level[:, 0] < (1 - SAME) * low) | (step.level[:, 0] > (1 + SAME) * high)
    exact, stepped = (float(own.forces[np.argmin(curve / none.median)]) for curve in (own.median, step.level[:, 0]))
    return Claim(
        f"{LABEL}_step", "20 steps a period of the highest mode are enough (one mode)", "2.4",
        f"level at that step {100 * off.min():+.0f} to {100 * off.max():+.0f} % from the exact median, at {own.forces[worst]:.3g} N "
        f"{step.level[worst, 0] / none.median[worst]:.3f} of no absorber against {own.median[worst] / none.median[worst]:.3f}; best force "
        f"{stepped:.3g} against {exact:.3g} N", Verdict.NOT if beside.any() else Verdict.HOLDS, LABEL,
        f"With one mode a step is a twentieth of the force's own period: at {np.count_nonzero(beside)} of {len(off)} forces the run lies beside the "
        f"members' band widened by {100 * SAME:g} %.",
    )  # fmt: skip


def _straightness(own: Curve, inside: np.ndarray) -> np.ndarray:
    """Return for each member the share of the level's variance that a straight line in the force explains, (M,)."""
    level = own.level[inside]
    fit = np.polynomial.polynomial.polyfit(own.forces[inside], level, 1)
    rest = level - (fit[0] + np.outer(own.forces[inside], fit[1]))
    return np.asarray(1 - np.var(rest, axis=0) / np.var(level, axis=0))


SHADES = ("0.97", "0.90", "0.95")


def _draw(values: Json) -> Figure:
    """Draw level over force with the ranges shaded; inset: the same relative to no absorber up to the highest force."""
    own, none, stuck, found = _read(values)
    figure, grid = panels(1, 1, 4.2)
    axes = grid[0, 0]
    shown = own.forces <= 12.0
    draw_ranges(axes, found, 0.0, 12.0)
    line(axes, none.forces[shown], MM * none.median[shown], REFERENCE, "no absorber")
    low, high = own.band
    line(
        axes, own.forces[shown], MM * own.median[shown], LOOKS[0], "impact absorber, 1 mode, e = 0.75",
        band=(MM * low[shown], MM * high[shown]), nominal=MM * own.level[shown, 0],
    )  # fmt: skip
    if "step" in values:
        step = curve_of(values["step"])
        axes.plot(step.forces[shown], MM * step.level[shown, 0], "x", color=LOOKS[1].colour, ms=4, label="one run at the paper's step")
    level_axes(axes, none, 12.0)
    axes.legend(loc="upper left")
    small = inset_of(axes, (0.62, 0.12, 0.36, 0.27), none, {LOOKS[0]: own, STUCK: stuck})
    small.legend(small.lines[1:2], ["absorber stuck"], fontsize=6.5, loc="lower right", frameon=False)
    legends(grid)
    return figure


def draw_ranges(axes: Axes, found: Ranges, low: float, high: float) -> None:
    """Shade the linear, the primary and the secondary range between two forces in N."""
    edges = sorted({low, high, *(border.force for border in (found.first_impacts, found.transition) if border is not None)})
    first, last = found.first_impacts, found.transition
    primary = first is not None and (last is None or last.force > first.force)
    words = ["linear"] + (["primary"] if primary else []) + (["secondary"] if last else [])
    for name, begin, end, shade in zip(words, edges, edges[1:], SHADES, strict=False):
        axes.axvspan(begin, end, color=shade, lw=0, zorder=0)
        own, place = axes.get_xaxis_transform(), min((begin + end) / 2, begin + 4.5)
        axes.text(place, 0.16, name, transform=own, ha="center", va="bottom", fontsize=8, color="0.3", rotation=90)


FIGURE = PaperFigure(
    LABEL, "a typical performance curve and its operating ranges", measure=_measure, words=_words, draw=_draw, claims=_claims,
    needs=has("absorber", "linear"),
    sizes=(
        Sizes(force_grid(0.2, 12.0, 31, (18.0, 27.0, 40.0, 60.0, 100.0)), 12),
        Sizes(force_grid(0.3, 100.0, 8, (0.9, 1.1, 1.35, 1.7, 2.0, 2.5)), 3),
    ),
)  # fmt: skip
