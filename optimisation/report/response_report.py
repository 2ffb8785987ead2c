"""Report on periodic responses over the frequency.

It has a line for each curve, a row for each point, and the figure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import CompliantWalls, RigidWalls, SlidingAbsorber
from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.branch import FOLD
from impact_env.periodic.orbit_branches import GRAZING, PULLING
from impact_env.periodic.orbit_table import ORBIT_COLUMNS, branch_rows
from impact_env.periodic.overview import Overview
from impact_env.periodic.response_curve import EXACT, CurvePoint, ResponseCurve
from impact_env.periodic.stationary import QUANTILES, StationaryPoint
from optimisation.measures import format_number, shorten_numbers
from optimisation.report.report import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    Block,
    Report,
    Table,
    draw_grid,
    figure_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ASIDE = 4e-3  # of the curve's height and width: closer than this two of its stretches are one line
MARKS = {
    FOLD: "o",
    TORUS: "^",
    PERIOD_DOUBLING: "s",
    SYMMETRY_BREAKING: "D",
    GRAZING: "v",
    PULLING: "<",
}
MARK_LABELS = {  # of a legend, where they differ from the name of the kind
    PULLING: "loss of contact",
    SYMMETRY_BREAKING: "symmetry breaking (pitchfork)",
    TORUS: "torus (Neimark-Sacker)",
}
MARKED: dict[str, Any] = {"ms": 5.0, "mfc": "white", "mec": "black", "mew": 0.9}
STABLE = BLUE
FAST = SKY
SLOW = ORANGE
BALANCE = "#555555"
UP = GREEN
DOWN = PINK
RUNS = YELLOW
MARK_DISTANCE = 0.02  # of the axes: marks of one kind that are closer are drawn once
LOOKS = {  # exact orbits: colour, dashes, width, label
    "stable": (STABLE, "-", 2.4, "exact orbit, stable"),
    "fast": (FAST, (0, (6, 1.5)), 2.0, "unstable by fast multipliers only"),
    "slow": (SLOW, (0, (2, 1.5)), 1.6, "unstable by the slow pair too"),
}


def make_response_report(overview: Overview) -> Report:
    """Return what `periodic branches` prints and writes."""
    rows = list(branch_rows(curve.to_plain() for curve in overview.curves))
    blocks: list[Block] = [
        [f"{overview.scene}, {format_number(overview.force)} N"],
        [curve_table(overview.curves)],
        curve_notes(overview.curves),
    ]
    if overview.stationary:
        blocks.append([stationary_table(overview.stationary)])
    return Report(
        title="Periodic responses over the frequency",
        text=blocks,
        numbers=overview.to_plain(),
        tables={"branches.csv": Table.of_values(ORBIT_COLUMNS, rows)},
        figures={"branches.png": partial(draw_response, overview)},
    )


def curve_table(curves: Sequence[ResponseCurve]) -> Table:
    """Return a line for each curve."""
    rows = []
    for number, curve in enumerate(curves, 1):
        peak = curve.peak
        folds = sorted(fold.omega_ratio for fold in curve.folds)
        marks = sorted(
            (mark.omega_ratio, mark.kind)
            for mark in curve.located
            if mark.kind in (TORUS, PERIOD_DOUBLING, SYMMETRY_BREAKING)
        )
        rows.append(
            (
                str(number),
                curve.method,
                "closed" if curve.closed else "open",
                str(len(curve.tip_max)),
                "" if peak is None else f"{MM * peak.tip_max:.4f}",
                "" if peak is None else f"{peak.omega_ratio:.4f}",
                ", ".join(f"{ratio:.9g}" for ratio in folds),
                "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}",
                str(curve.period),
                "symmetric" if curve.symmetric else "a pair",
                ", ".join(f"{kind} {ratio:.6g}" for ratio, kind in marks),
            )
        )
    header = (
        "curve",
        "method",
        "",
        "points",
        "peak, mm",
        "at",
        "folds",
        "stable, %",
        "period",
        "",
        "bifurcates at",
    )
    return Table.of_words(header, rows)


def curve_notes(curves: Sequence[ResponseCurve]) -> list[str]:
    """Return why curves end, and how many of their points are no orbit."""
    notes = []
    for number, curve in enumerate(curves, 1):
        if not curve.closed:
            notes.append(f"Curve {number}: {curve.message}.")
        if curve.refused:
            reason, most = max(curve.refused, key=lambda pair: pair[1])
            total = sum(points for _, points in curve.refused)
            more = "" if total == most else f", and {len(curve.refused) - 1} more reasons"
            notes.append(f"Curve {number}: {total} points are no orbit: {reason}{more}.")
    return notes


def stationary_table(stationary: Sequence[StationaryPoint]) -> Table:
    """Return a line for each frequency of the stationary runs."""
    rows = [
        (
            f"{at.omega_ratio:.5f}",
            *(f"{MM * tip:.4f}" for tip in at.tip_max),
            f"{at.impacts:.2f}",
        )
        for at in stationary
    ]
    header = ("runs at", *(f"{100 * q:g} %, mm" for q in QUANTILES), "impacts a period")
    return Table.of_words(header, rows)


def draw_response(overview: Overview) -> Figure:
    """Draw a frequency response: the largest displacement of the tip over the frequency."""
    figure, axes = figure_of(8.6, 6.4)
    _sweeps(axes, overview)
    _stationary(axes, overview)
    _linear(axes, overview)
    for curve in overview.curves:
        if curve.method == EXACT:
            _exact(axes, curve)
        else:
            unstable = (
                np.zeros(len(curve.tip_max), dtype=np.bool_)
                if curve.stable is None
                else ~curve.stable
            )
            axes.plot(
                curve.omega_ratio,
                np.where(unstable, np.nan, MM * curve.tip_max),
                color=BALANCE,
                lw=1.0,
                zorder=3,
            )
            axes.plot(
                curve.omega_ratio,
                np.where(unstable, MM * curve.tip_max, np.nan),
                color=BALANCE,
                lw=1.0,
                ls="--",
                zorder=3,
            )
    _legend(axes, overview)
    low, high = overview.linear.omega_ratio[[0, -1]]
    tops = [curve.peak.tip_max for curve in overview.curves if curve.peak is not None]
    tops += [float(np.max(sweep.tip_max)) for sweep in overview.sweeps]
    tops += [float(np.max(at.tip_max)) for at in overview.stationary]
    absorber = overview.scene.absorber
    walls = absorber.walls if isinstance(absorber, SlidingAbsorber) else None
    if isinstance(walls, RigidWalls | CompliantWalls):
        tops.append(walls.gap)
    axes.set(
        xlim=(low, high),
        ylim=(0, 1.15 * MM * max(tops, default=float(np.max(overview.linear.alone)))),
    )
    _draw_marks(axes, overview.curves)
    axes.set_xlabel(f"frequency of the force over {overview.reference / (2 * np.pi):.2f} Hz")
    axes.set_ylabel(f"largest displacement {overview.where} in mm")
    scene = shorten_numbers(str(overview.scene))
    axes.set_title(f"{scene}, {format_number(overview.force)} N", fontsize=10)
    draw_grid(axes)
    return figure


def _sweeps(axes: Axes, overview: Overview) -> None:
    for sweep in overview.sweeps:
        up = sweep.omega_ratio[-1] > sweep.omega_ratio[0]
        label = f"sweep {'up' if up else 'down'}, maximum of each period"
        axes.plot(
            sweep.omega_ratio,
            MM * sweep.tip_max,
            color=UP if up else DOWN,
            lw=0.7,
            alpha=0.8,
            zorder=1,
            label=label,
        )


def _stationary(axes: Axes, overview: Overview) -> None:
    """Draw the median of the stationary responses, and a band of their quantiles.

    The band extends from the lowest to the highest quantile.
    """
    if not overview.stationary:
        return
    ratio = np.array([at.omega_ratio for at in overview.stationary])
    rows = MM * np.array([at.tip_max for at in overview.stationary]).T
    percent = [f"{100 * q:g}" for q in QUANTILES]
    axes.fill_between(
        ratio,
        rows[0],
        rows[-1],
        color=RUNS,
        alpha=0.3,
        lw=0,
        zorder=1.5,
        label=f"stationary runs, {percent[0]} to {percent[-1]} %",
    )
    axes.plot(
        ratio,
        rows[len(rows) // 2],
        color=RUNS,
        lw=1.4,
        marker=".",
        ms=4,
        zorder=3.5,
        label="stationary runs, median",
    )


def _linear(axes: Axes, overview: Overview) -> None:
    linear = overview.linear
    axes.plot(
        linear.omega_ratio,
        MM * linear.alone,
        color="black",
        lw=0.9,
        ls=":",
        zorder=2,
        label="no absorber",
    )
    axes.plot(
        linear.omega_ratio,
        MM * linear.stuck,
        color="black",
        lw=0.9,
        ls="-.",
        zorder=2,
        label="absorber stuck",
    )


def _kinds(curve: ResponseCurve) -> NDArray[np.str_]:
    assert curve.stable is not None
    assert curve.slowly_stable is not None
    return np.where(curve.stable, "stable", np.where(curve.slowly_stable, "fast", "slow"))


def _exact(axes: Axes, curve: ResponseCurve) -> None:
    """Draw each section of a branch with the line style of its stability.

    Neighbouring sections share the point between them, so that the line has no gap.
    """
    kinds = _kinds(curve)
    tip_max = MM * np.where(_drawn_already(curve), np.nan, curve.tip_max)
    ends = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    for begin, end in zip([0, *ends], [*ends, len(kinds)], strict=True):
        colour, dashes, width, _ = LOOKS[str(kinds[begin])]
        part = slice(begin, min(end + 1, len(kinds)))
        order = (
            4.5 if kinds[begin] == "stable" else 4
        )  # two orbits may have the same largest displacement: the stable one is seen
        thinner = 1.0 if curve.symmetric else 0.6
        axes.plot(
            curve.omega_ratio[part],
            tip_max[part],
            color=colour,
            ls=dashes,
            lw=thinner * width,
            zorder=order,
        )


def _draw_marks(axes: Axes, curves: Iterable[ResponseCurve]) -> None:
    """Draw the places located on exact orbits, within the limits of the axes."""
    marks = [mark for curve in curves if curve.method == EXACT for mark in curve.located]
    size = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()) / MM
    for mark in thin_marks(marks, *size):
        axes.plot(
            mark.omega_ratio, MM * mark.tip_max, MARKS.get(mark.kind, "x"), **MARKED, zorder=5
        )


def thin_marks(marks: Iterable[CurvePoint], width: float, height: float) -> list[CurvePoint]:
    """Return the marks without those of a kind that would lie on one another.

    Of marks of one kind that are closer than `MARK_DISTANCE` of the axes' ``width`` (frequency
    ratio) and ``height`` (m), the first is taken.
    """
    drawn: list[CurvePoint] = []
    for mark in marks:
        near = (
            np.hypot(
                (mark.omega_ratio - other.omega_ratio) / width,
                (mark.tip_max - other.tip_max) / height,
            )
            < MARK_DISTANCE
            for other in drawn
            if other.kind == mark.kind
        )
        if not any(near):
            drawn.append(mark)
    return drawn


def _drawn_already(curve: ResponseCurve) -> NDArray[np.bool_]:
    """Return which points (m,) lie on what was drawn of their own curve before.

    A branch without symmetry leads through its mirror image, whose dashes would fill the gaps
    between the first ones.
    """
    rows = np.column_stack([curve.omega_ratio, curve.tip_max])
    known = np.isfinite(rows).all(axis=1)
    drawn_already = np.zeros(len(rows), dtype=np.bool_)
    if curve.symmetric or not np.any(known):
        return drawn_already
    rows = (rows - np.nanmin(rows, axis=0)) / np.maximum(np.ptp(rows[known], axis=0), 1e-12)
    way = np.append(0, np.cumsum(np.nan_to_num(np.hypot(*np.diff(rows, axis=0).T))))
    for k in np.flatnonzero(known):
        begin = rows[: max(int(np.searchsorted(way, way[k] - 3 * ASIDE)), 1)] - rows[k]
        chord = np.diff(begin, axis=0)
        share = np.clip(
            -np.sum(begin[:-1] * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), 1e-30), 0, 1
        )
        drawn_already[k] = np.any(np.hypot(*(begin[:-1] + share[:, None] * chord).T) < ASIDE)
    return drawn_already


def _legend(axes: Axes, overview: Overview) -> None:
    drawn = {
        str(kind)
        for curve in overview.curves
        if curve.method == EXACT
        for kind in np.unique(_kinds(curve))
    }
    for kind, (colour, dashes, width, label) in LOOKS.items():
        if kind in drawn:
            axes.plot([], [], color=colour, ls=dashes, lw=width, label=label)
    if any(not curve.symmetric for curve in overview.curves):
        axes.plot(
            [],
            [],
            color=STABLE,
            lw=0.6 * LOOKS["stable"][2],
            label="thinner: orbits without symmetry",
        )
    if any(curve.method != EXACT for curve in overview.curves):
        axes.plot([], [], color=BALANCE, lw=1.0, label="harmonic balance")
    if any(curve.method != EXACT and curve.stable is not None for curve in overview.curves):
        axes.plot([], [], color=BALANCE, lw=1.0, ls="--", label="the same, unstable")
    for kind in sorted(
        {mark.kind for curve in overview.curves if curve.method == EXACT for mark in curve.located}
    ):
        axes.plot([], [], MARKS.get(kind, "x"), **MARKED, ls="", label=MARK_LABELS.get(kind, kind))
    axes.figure.legend(loc="outside lower center", ncols=3, fontsize=9)  # not over the curves
