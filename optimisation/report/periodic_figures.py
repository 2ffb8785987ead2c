"""Periodic motions as figures and tables: frequency responses, harmonic balance, isola maps, bifurcations over two parameters, lists of orbits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import CompliantWalls, RigidWalls, SlidingAbsorber
from impact_env.periodic.balance_branches import BalanceRow, ReferenceOrbit
from impact_env.periodic.basins import Share
from impact_env.periodic.bifurcation_curves import (
    DOUBLE_GRAZING,
    GRAZING_FOLD,
    LOSS_OF_CONTACT,
)
from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.branch import FOLD
from impact_env.periodic.codimension_two import CODIMENSION_TWO
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.hybrid_orbit import HybridOrbit, count_events
from impact_env.periodic.hybrid_trajectory import REVERSAL, STICK
from impact_env.periodic.isolas import IsolaMap, Threshold
from impact_env.periodic.normal_forms import SUBCRITICAL, SUPERCRITICAL
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import GRAZING, PULLING
from impact_env.periodic.overview import Overview
from impact_env.periodic.response_curve import EXACT, CurvePoint, ResponseCurve
from impact_env.periodic.slow_manifold import ManifoldCheck
from impact_env.periodic.stationary import QUANTILES
from impact_env.periodic.survey import OrbitSearch
from impact_env.periodic.symmetric import BIRTH
from optimisation.page import markdown
from optimisation.report.figures import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    draw_grid,
    figure_of,
    force_axis,
    write_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
MANIFOLD_STYLES: dict[str, dict[str, Any]] = {
    "classical": {"color": YELLOW, "ls": ":", "lw": 2.0},
    "modal": {"color": GREEN, "ls": "--", "lw": 1.8},
    "corrected": {"color": BLUE, "ls": "-", "lw": 1.8},
    "complete": {"color": ORANGE, "ls": "-.", "lw": 1.4},
}
Array = NDArray[np.float64]
RUNS = YELLOW
MARK_DISTANCE = 0.02  # of the axes: marks of one kind that are closer are drawn once
LOOKS = {  # exact orbits: colour, dashes, width, label
    "stable": (STABLE, "-", 2.4, "exact orbit, stable"),
    "fast": (FAST, (0, (6, 1.5)), 2.0, "unstable by fast multipliers only"),
    "slow": (SLOW, (0, (2, 1.5)), 1.6, "unstable by the slow pair too"),
}


def save_figure(path: Path, overview: Overview) -> None:
    """Draw a frequency response: the largest displacement of the tip over the frequency; the ending of ``path`` chooses the format."""
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
    axes.set(
        xlim=(low, high),
        ylim=(
            0,
            1.15 * MM * max([*tops, _gap(overview)], default=float(np.max(overview.linear.alone))),
        ),
    )
    _draw_marks(axes, overview.curves)
    axes.set_xlabel(f"frequency of the force over {overview.reference / (2 * np.pi):.2f} Hz")
    axes.set_ylabel(f"largest displacement {overview.where} in mm")
    axes.set_title(f"{overview.scene}, {overview.force:g} N", fontsize=10)
    draw_grid(axes)
    write_figure(figure, path)


def _gap(overview: Overview) -> float:
    absorber = overview.scene.absorber
    walls = absorber.walls if isinstance(absorber, SlidingAbsorber) else None
    return walls.gap if isinstance(walls, RigidWalls | CompliantWalls) else 0.0


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
    """Draw the median of the stationary responses, and a band between the lowest and the highest of their quantiles."""
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
    """Draw each stretch of one stability with its look; neighbours share the point between, so that no gap is seen."""
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

    Of marks of one kind that are closer than `MARK_DISTANCE` of the axes' ``width`` (frequency ratio) and ``height`` (m), the first is taken.
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

    A branch without symmetry leads through its mirror image, whose dashes would fill the gaps between the first ones.
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


COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, YELLOW)
MARKERS = "osv^Dx"
PAPERS = 20  # harmonics in the paper


def save_balance(
    path: Path, exact: ReferenceOrbit, rows: Sequence[BalanceRow], growing: bool
) -> None:
    """Draw rows that have a solution; ``growing``: weights grow with the square of the harmonics. The ending of ``path`` chooses the format."""
    figure, panels = figure_of(8.6, 7.4, 2, 2)
    error, folds, cost, empty = panels.flat
    empty.remove()
    series: dict[float, list[BalanceRow]] = {}
    for row in rows:
        if row.tip_max_error is not None:
            at_papers = row.weight * (PAPERS / row.harmonics) ** 2 if growing else row.weight
            series.setdefault(round(at_papers, 6), []).append(row)
    for (weight, points), colour, marker in zip(
        sorted(series.items()), COLOURS * 9, MARKERS * 9, strict=False
    ):
        label = f"weight {weight:g}" + (f" (H/{PAPERS})²" if growing else "")
        _line(error, points, "tip_max_error", 100, color=colour, marker=marker, label=label)
        _line(error, points, "peak_error", 100, color=colour, marker=marker, mfc="white", ls="--")
        _line(folds, points, "first_fold_ratio", 1, color=colour, marker=marker, label=label)
        _line(
            folds, points, "last_fold_ratio", 1, color=colour, marker=marker, mfc="white", ls="--"
        )
        _line(
            cost, points, "cpu_seconds_per_250_points", 1, color=colour, marker=marker, label=label
        )
    located = sorted(fold.omega_ratio for fold in exact.curve.folds)
    for ratio, style in zip(located[:1] + located[-1:], ("-", "--"), strict=False):
        folds.axhline(ratio, color="0.4", lw=1.0, ls=style)
    error.set(yscale="log", ylabel="error of the largest tip displacement in %")
    error.set_title(f"solid: at {exact.case.omega_ratio:g}, dashed: at the peak", fontsize=9)
    folds.set(ylabel="frequency of the folds over the first resonance's")
    folds.set_title("solid: first, dashed: last, grey: exact", fontsize=9)
    cost.set(yscale="log", ylabel="processor time of 250 points in s")
    for axes in (error, folds, cost):
        axes.set(xscale="log", xlabel="number of harmonics H")
        ticks = sorted({row.harmonics for row in rows})
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        if axes is not folds:  # a decade or two: more ticks than its powers
            force_axis(axes.yaxis)
        axes.axvline(PAPERS, color="0.8", lw=1.0, zorder=0)
        draw_grid(axes)
    error.legend(fontsize=8)
    figure.suptitle(
        f"{exact.case.scene}, {exact.case.force:g} N\nweights in $m_a\\omega_1^2$; the paper took {PAPERS} harmonics",
        fontsize=10,
    )
    write_figure(figure, path)


def _line(axes: Axes, rows: Sequence[BalanceRow], name: str, scale: float, **style: Any) -> None:
    known = [
        (row.harmonics, scale * abs(value))
        for row in rows
        if (value := getattr(row, name)) is not None
    ]
    if known:
        axes.plot(*zip(*known, strict=True), lw=1.3, ms=5, **style)


SAME = 0.012  # how far an isola's birth may move from one restitution to the next
ALONG = {"restitution": "coefficient of restitution", "friction_limit": "friction limit in N"}
KIND_MARKS = {BIRTH: "v", "merger": "^"}


def save_isolas(path: Path, isola_map: IsolaMap) -> None:
    """Draw the fold force, and a map over each of `ALONG` that has more than one value; the ending of ``path`` chooses the format."""
    maps = [name for name in ALONG if len({getattr(cell, name) for cell in isola_map.cells}) > 1]
    rows = -(-(1 + len(maps)) // 2)
    figure, panels = figure_of(8.6, 4.6 * rows, rows, 2)
    axes = np.ravel(panels)
    for empty in axes[1 + len(maps) :]:
        empty.remove()
    _force(axes[0], isola_map)
    for place, name in zip(axes[1:], maps, strict=False):
        _map(place, isola_map, name)
    figure.suptitle(str(isola_map.case.scene), fontsize=10)
    write_figure(figure, path)


def save_manifold(path: Path, check: ManifoldCheck) -> None:
    """Draw each variant of the slow invariant manifold, and the exact orbits beside it; the ending of ``path`` chooses the format."""
    figure, axes = figure_of(7.4, 5.2)
    gap = check.case.gap
    mass = check.case.mass_ratio * check.case.model.beam_mass

    def swing(impulse: Array, omega: float) -> Array:
        """Return the amplitude of the absorber's motion over the gap, for impulses in N s."""
        return np.asarray(np.pi * impulse / (4 * mass * omega) / gap)

    highest = max(
        [point.impulse / point.case.omega for point in check.points],
        default=3
        * check.manifold("complete").least_impulse
        / check.manifold("complete").case.omega,
    )
    for variant, style in MANIFOLD_STYLES.items():
        manifold = check.manifold(variant)
        omega = manifold.case.omega
        impulses = np.linspace(0.02, 1.08, 400) * highest * omega
        least = manifold.least_impulse
        axes.plot(
            swing(impulses, omega), manifold.amplitude(impulses) / gap, label=variant, **style
        )
        if least > 0:
            axes.plot(
                swing(np.array([least]), omega),
                [manifold.least_amplitude / gap],
                "|",
                ms=14,
                color=style["color"],
            )
    for stable, face, label in ((True, "black", "stable"), (False, "white", "unstable")):
        points = [point for point in check.points if point.stable is stable]
        if points:
            axes.plot(
                [float(swing(np.array(p.impulse), p.case.omega)) for p in points],
                [p.amplitude / gap for p in points],
                "o",
                ms=4,
                mfc=face,
                mec="black",
                mew=0.7,
                ls="none",
                label=f"exact orbits, {label}",
            )
    axes.set(
        xlim=(0, None),
        ylim=(0, None),
        xlabel="amplitude of the absorber over the gap",
        ylabel="amplitude of the resonant mode over the gap",
    )
    axes.set_title(str(check.case.scene), fontsize=9)
    axes.legend(fontsize=9, frameon=False)
    draw_grid(axes)
    write_figure(figure, path)


def _force(axes: Axes, isola_map: IsolaMap) -> None:
    force = isola_map.fold_force
    finite = force[np.isfinite(force)]
    axes.plot(isola_map.omega_ratio, force, color=BLUE, lw=1.8)
    axes.fill_between(
        isola_map.omega_ratio,
        force,
        np.max(finite) * 2,
        color=BLUE,
        alpha=0.08,
        lw=0,
        label="two symmetric orbits",
    )
    for level in isola_map.own.found:
        label = f"{level.kind} {level.force:.4g} N" + (", no orbit" if level.refused else "")
        axes.plot(
            level.omega_ratio,
            level.force,
            KIND_MARKS[level.kind],
            ms=8,
            mfc="white" if level.refused else ORANGE,
            mec="black",
            label=label,
        )
    top = max([level.force for level in isola_map.own.found], default=float(np.median(finite)))
    axes.set(
        xlim=isola_map.omega_ratio[[0, -1]],
        ylim=(0, 1.6 * top),
        xlabel="frequency over the first resonance's",
        ylabel="smallest force in N",
    )
    _below(axes)


def _map(axes: Axes, isola_map: IsolaMap, name: str) -> None:
    """Draw births and mergers over one parameter, the other one as in the case itself, or as in the map's last cell."""
    from matplotlib import colormaps

    (other,) = (one for one in ALONG if one != name)
    own = {getattr(cell, other) for cell in isola_map.cells}
    fixed = (
        getattr(isola_map.own, other)
        if getattr(isola_map.own, other) in own
        else getattr(isola_map.cells[-1], other)
    )
    cells = [cell for cell in isola_map.cells if getattr(cell, other) == fixed]
    numbers = sorted({cell.modes for cell in cells})
    for n, colour in zip(
        numbers, colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), strict=True
    ):
        axes.plot([], [], color=colour, label=f"{n} mode{'s' * (n != 1)}")
        for place, style in ((0, "-"), (1, "--")):
            pairs = [
                (getattr(cell, name), level)
                for cell in cells
                if cell.modes == n and (level := cell.pair[place]) is not None
            ]
            known = sorted((value, level.force, level.omega_ratio) for value, level in pairs)
            rows = np.array(known).reshape(
                -1, 3
            )  # where the ratio jumps another isola is the next one to the resonance
            for part in (
                np.split(rows, np.flatnonzero(np.abs(np.diff(rows[:, 2])) > SAME) + 1)
                if len(rows)
                else ()
            ):
                axes.plot(part[:, 0], part[:, 1], style, marker="v^"[place], ms=4, color=colour)
            refused = np.array(
                [(value, level.force) for value, level in pairs if level.refused]
            ).reshape(-1, 2)
            axes.plot(
                refused[:, 0], refused[:, 1], "v^"[place], ms=4, mfc="white", mec=colour, zorder=3
            )
    for style, label in (("k-", "birth (of the isola next to the resonance)"), ("k--", "merger")):
        axes.plot([], [], style, label=label)
    if any(level is not None and level.refused for cell in cells for level in cell.pair):
        axes.plot([], [], "ks", ms=4, mfc="white", label="open: no orbit, by the exact method")
    axes.set(xlabel=ALONG[name], ylabel="force in N", ylim=(0, None))
    axes.set_title(
        f"{ALONG[other].removesuffix(' in N')} {fixed:g}{' N' if other == 'friction_limit' else ''}",
        fontsize=9,
    )
    _below(axes)


def _below(axes: Axes) -> None:
    axes.legend(
        fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13)
    )  # below the curves, not over them
    draw_grid(axes)


KIND_COLOURS = {
    FOLD: BLUE,
    SYMMETRY_BREAKING: ORANGE,
    PERIOD_DOUBLING: GREEN,
    TORUS: PINK,
    GRAZING: "black",
    LOSS_OF_CONTACT: "#888888",
}
# what is marked along curves of bifurcations
TURNS = {kind: MARKS[kind] for kind in (FOLD, GRAZING, PULLING)}
SAME_SPECIAL_TOL = 1e-6  # of frequency ratio and value: a special point that two curves share
LABEL_SHIFTS = ((6, 4), (6, -10), (-12, 4), (-12, -10))  # in points, in turn
SPECIAL = (*CODIMENSION_TWO, GRAZING_FOLD, DOUBLE_GRAZING)  # marked with their names


def save_curves(
    path: Path, curves: list[dict[str, Any]], title: str, parameter: str, scale: float
) -> None:
    """Draw the plain forms of `BifurcationCurve`, ``scale`` times the parameter's values; the ending of ``path`` chooses the format."""
    figure, axes = figure_of(8.6, 6.0)
    for curve in curves:
        ratio = np.array(curve["omega_ratio"])
        value = scale * np.array(curve["value"])
        colour = KIND_COLOURS[curve["kind"]]
        good = np.array([confirmed == "yes" for confirmed in curve["orbit"]])
        # so that no gap is seen
        next_to = good | np.append(good[1:], False) | np.append(False, good[:-1])
        sub = np.array([word == SUBCRITICAL for word in curve["criticality"]])
        solid = next_to & (~sub | np.append(~sub[1:], False))
        axes.plot(ratio, np.where(solid, value, np.nan), color=colour, lw=1.8)
        axes.plot(ratio, np.where(good, np.nan, value), color=colour, lw=1.0, ls=":")
        if np.any(sub):
            axes.plot(ratio, np.where(next_to & sub, value, np.nan), "--", color=colour, lw=1.8)
        for mark in curve["located"]:
            if _is_turn(mark):
                axes.plot(
                    mark["omega_ratio"],
                    scale * mark["value"],
                    TURNS[mark["kind"]],
                    color=colour,
                    mfc="white",
                    ms=5,
                )
    for kind in dict.fromkeys(curve["kind"] for curve in curves):
        axes.plot([], [], color=KIND_COLOURS[kind], lw=1.8, label=MARK_LABELS.get(kind, kind))
    for kind in sorted(
        {mark["kind"] for curve in curves for mark in curve["located"] if _is_turn(mark)}
    ):
        label = f"{parameter} least or greatest" if kind == FOLD else kind
        axes.plot([], [], TURNS[kind], color="black", mfc="white", ms=5, label=label)
    _draw_special(axes, curves, scale)
    if any(SUBCRITICAL in curve["criticality"] for curve in curves):
        axes.plot([], [], color="black", lw=1.8, ls="--", label=SUBCRITICAL)
    if any(confirmed != "yes" for curve in curves for confirmed in curve["orbit"]):
        axes.plot([], [], color="black", lw=1.0, ls=":", label="no orbit of the true motion")
    axes.set(xlabel="frequency over the first resonance's", ylabel=parameter)
    axes.set_title(title, fontsize=10)
    draw_grid(axes)
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)  # not over the curves
    write_figure(figure, path)


def _draw_special(axes: Axes, curves: list[dict[str, Any]], scale: float) -> None:
    """Mark the special points of curves with numbers, and list their names in the legend; one that several curves have is marked once."""
    marks: list[dict[str, Any]] = []
    for mark in (mark for curve in curves for mark in curve["located"] if mark["kind"] in SPECIAL):
        known = any(
            mark["kind"] == other["kind"]
            and abs(mark["omega_ratio"] - other["omega_ratio"]) < SAME_SPECIAL_TOL
            and abs(mark["value"] - other["value"]) < SAME_SPECIAL_TOL * abs(other["value"])
            for other in marks
        )
        if not known:
            marks.append(mark)
    marks.sort(key=lambda mark: (mark["omega_ratio"], mark["value"]))
    for number, mark in enumerate(marks, 1):
        place = (mark["omega_ratio"], scale * mark["value"])
        face = "black" if mark["orbit"] == "yes" else "white"
        label = f"{number} {mark['kind']}"
        axes.plot(*place, "*", color="black", mfc=face, ms=8, ls="", zorder=5, label=label)
        shift = LABEL_SHIFTS[number % len(LABEL_SHIFTS)]
        axes.annotate(str(number), place, shift, textcoords="offset points", fontsize=8, zorder=6)


def _is_turn(mark: dict[str, Any]) -> bool:
    """Return whether a place located on a curve of bifurcations is marked: an end at a wall, or a least or greatest value at a true orbit."""
    return mark["kind"] in TURNS and (mark["kind"] != FOLD or mark["orbit"] == "yes")


def share_text(share: Share) -> str:
    """Return the number of runs that ended on a motion, and the interval of their share in percent."""
    return f"{share.ended} of {share.runs} ({100 * share.low:.0f}-{100 * share.high:.0f} %)"


def basin_lines(searches: list[OrbitSearch]) -> list[str]:
    """Return a line for each frequency at which runs from random initial states ended on no orbit with impacts; of a single frequency always."""
    lines = []
    for group in searches:
        basins = group.basins
        if basins is None:
            continue
        shares = (
            (basins.share_of_nothing_periodic, "on nothing periodic"),
            (basins.share_without_impacts, "without impacts"),
        )
        parts = [
            f"{share_text(share)} end {where}"
            for share, where in shares
            if share.ended or len(searches) == 1
        ]
        if parts:
            runs = f"runs from random initial states over {basins.periods} periods of the force"
            lines.append(f"At {group.case.omega_ratio:.6f}, {runs}: {', '.join(parts)}.")
    return lines


def orbit_table(searches: list[OrbitSearch]) -> str:
    """Return a line for each orbit."""
    rows = []
    for basins, orbit in ((group.basins, orbit) for group in searches for orbit in group.orbits):
        basin = ""
        if basins is not None and orbit.stability.stable:
            basin = share_text(basins.share_of(orbit))
        slow, fast = (
            float(np.max(np.abs(values)))
            for values in (orbit.stability.slow_multipliers, orbit.stability.fast_multipliers)
        )
        schedule = orbit.schedule
        kind = "symmetric" if schedule.symmetric else "one-sided"
        kind += (
            "" if schedule.period_multiple == 1 else f", period {schedule.period_multiple}"
        ) + ("" if schedule.flies else ", held")
        sides = 2 if schedule.symmetric else 1
        rows.append(
            [
                f"{orbit.case.omega_ratio:.6f}", kind, str(len(orbit.impacts)), str(sides * schedule.reversals), f"{1e3 * orbit.motion.tip_max:.6f}",
                f"{1e3 * orbit.motion.tip_rms:.6f}", f"{slow:.4f}", f"{fast:.4f}", "yes" if orbit.stability.stable else "no", basin,
                f"{orbit.residual:.0e}",
            ]
        )  # fmt: skip
    header = (
        "omega/omega_1",
        "kind",
        "impacts",
        "reversals",
        "tip max, mm",
        "tip RMS, mm",
        "slow",
        "fast",
        "stable",
        "basin",
        "residual",
    )
    return markdown(header, rows)


def refusals(refused: list[NoOrbit], what: str) -> list[str]:
    """Say how many are no orbit, and why, the commonest reasons first; nothing if there are none."""
    return reasons([orbit.reason for orbit in refused], what)


def reasons(refused: list[str], what: str) -> list[str]:
    """Say of how many reasons why something is no orbit there are, the commonest first; nothing if there are none."""
    if not refused:
        return []
    counts = Counter(
        reason.split(" (")[0] for reason in refused
    )  # what is in brackets are numbers, each time others
    lines = [f"  {number} x {reason}" for reason, number in counts.most_common(8)]
    return [f"{len(refused)} {what} no orbit:", *lines, *(["  ..."] if len(counts) > 8 else [])]


def hybrid_table(orbits: list[HybridOrbit]) -> str:
    """Return a line for each orbit of a scene with several absorbers or springs; impacts are counted absorber by absorber."""
    rows = []
    for orbit in orbits:
        places = range(orbit.case.scene.places)
        impacts = [sum(event.absorber == a for event in orbit.impacts) for a in places]
        kind = "symmetric" if orbit.symmetric else "one-sided"
        kind += "" if orbit.period_multiple == 1 else f", period {orbit.period_multiple}"
        rows.append(
            (
                f"{orbit.case.omega_ratio:.6f}",
                kind,
                " + ".join(map(str, impacts)),
                str(count_events(orbit, REVERSAL)),
                str(count_events(orbit, STICK)),
                f"{1e3 * orbit.tip_max:.6f}",
                f"{1e3 * orbit.tip_rms:.6f}",
                f"{abs(orbit.multipliers[0]):.4f}",
                "yes" if orbit.stable else "no",
                f"{orbit.residual:.0e}",
            )
        )
    header = (
        "omega/omega_1",
        "kind",
        "impacts",
        "reversals",
        "sticks",
        "tip max, mm",
        "tip RMS, mm",
        "largest multiplier",
        "stable",
        "residual",
    )
    return markdown(header, rows)


def fold_text(located: tuple[Threshold, ...]) -> str:
    """Return the table of folds, and why others are none."""
    good = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
    rows = [
        [
            f"{f.omega_ratio:.10f}",
            f"{f.force:g}",
            f"{1e3 * o.motion.tip_max:.6f}",
            str(2 * o.schedule.reversals),
        ]
        for f, o in good
    ]
    text = markdown(("omega/omega_1", "force, N", "tip max, mm", "reversals"), rows)
    return "\n".join(
        [
            text,
            *refusals(
                [f.orbit for f in located if isinstance(f.orbit, NoOrbit)],
                "folds of the closed form lead to",
            ),
        ]
    )


def threshold_text(thresholds: tuple[Threshold, ...]) -> str:
    """Return the table of births and mergers, and why others are none."""
    good = [
        (threshold, threshold.orbit)
        for threshold in thresholds
        if isinstance(threshold.orbit, Orbit)
    ]
    rows = [
        [t.kind, f"{t.force:.8f}", f"{t.omega_ratio:.8f}", str(2 * orbit.schedule.reversals)]
        for t, orbit in good
    ]
    text = markdown(("kind", "force, N", "omega/omega_1", "reversals"), rows)
    return "\n".join(
        [
            text,
            *refusals(
                [t.orbit for t in thresholds if isinstance(t.orbit, NoOrbit)],
                "level places of the closed form lead to",
            ),
        ]
    )


def _special_lines(number: int, curve: dict[str, Any], scale: float) -> list[str]:
    """Return lines about where a curve is supercritical, and about its special points."""
    lines = []
    known = [word for word in curve["criticality"] if word is not None]
    if known:
        count = sum(word == SUPERCRITICAL for word in known)
        share = "everywhere" if count == len(known) else f"at {count} of {len(known)} points"
        line = f"{SUPERCRITICAL} {share}" if count else f"{SUBCRITICAL} everywhere"
        lines.append(f"Curve {number}: {line}.")
    places = [
        f"{mark['kind']} {scale * mark['value']:.7g} at {mark['omega_ratio']:.6f}"
        + ("" if mark["orbit"] == "yes" else " (no orbit of the true motion)")
        for mark in curve["located"]
        if mark["kind"] in SPECIAL
    ]
    if places:
        lines.append(f"Curve {number}: {', '.join(places)}.")
    return lines


def curve_text(curves: list[dict[str, Any]], words: str, scale: float) -> str:
    """Return a line for each plain form of a `BifurcationCurve`; values of the second parameter times ``scale``."""
    rows = []
    notes = []
    for number, curve in enumerate(curves, 1):
        ratio = np.array(curve["omega_ratio"])
        value = scale * np.array(curve["value"])
        good = [confirmed == "yes" for confirmed in curve["orbit"]]
        turns = [
            f"{scale * mark['value']:.7g} at {mark['omega_ratio']:.6f}"
            for mark in curve["located"]
            if mark["kind"] == FOLD and _is_turn(mark)
        ]
        ends = [f"{np.min(row):.6g} to {np.max(row):.6g}" for row in (ratio, value)]
        what = ("symmetric" if curve["symmetric"] else "one-sided") + (
            "" if curve["period"] == 1 else f", period {curve['period']}"
        )
        rows.append(
            (
                str(number),
                curve["kind"],
                what,
                f"{sum(good)} of {len(good)}",
                *ends,
                ", ".join(turns),
            )
        )
        notes.append(f"Curve {number}: {curve['ended']}.")
        notes += _special_lines(number, curve, scale)
    header = (
        "curve",
        "of",
        "orbits",
        "points that are orbits",
        "omega/omega_1",
        words,
        f"least or greatest {words}",
    )
    return (
        "\n".join([markdown(header, rows), "", *notes])
        if rows
        else "No such place on the branches over this range of frequencies."
    )
