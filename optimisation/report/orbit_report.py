"""Reports on periodic orbits and their bifurcations.

The reports are lists of orbits, of folds, and of births and mergers of isolas, branches over a
parameter, and curves of bifurcations over two parameters.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.periodic.basins import Share
from impact_env.periodic.bifurcation_curves import DOUBLE_GRAZING, GRAZING_FOLD, LOSS_OF_CONTACT
from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.branch import FOLD
from impact_env.periodic.codimension_two import CODIMENSION_TWO
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.hybrid_orbit import HybridOrbit, count_events
from impact_env.periodic.hybrid_trajectory import REVERSAL, STICK
from impact_env.periodic.isolas import Threshold
from impact_env.periodic.normal_forms import SUBCRITICAL, SUPERCRITICAL
from impact_env.periodic.orbit import Orbit, plain_orbit
from impact_env.periodic.orbit_branches import GRAZING, PULLING
from impact_env.periodic.orbit_table import (
    ORBIT,
    ORBIT_COLUMNS,
    bifurcation_rows,
    branch_rows,
    make_row,
    read_orbit,
)
from impact_env.periodic.response_curve import ResponseCurve
from impact_env.periodic.survey import OrbitSearch
from optimisation.measures import shorten_numbers
from optimisation.report.report import (
    BLUE,
    GREEN,
    MM,
    ORANGE,
    PINK,
    Block,
    Json,
    Report,
    Table,
    draw_grid,
    figure_of,
)
from optimisation.report.response_report import MARK_LABELS, MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KIND_COLOURS = {
    FOLD: BLUE,
    SYMMETRY_BREAKING: ORANGE,
    PERIOD_DOUBLING: GREEN,
    TORUS: PINK,
    GRAZING: "black",
    LOSS_OF_CONTACT: "#888888",
}
# marks of turning points and ends of curves of bifurcations
TURNS = {kind: MARKS[kind] for kind in (FOLD, GRAZING, PULLING)}
SAME_SPECIAL_TOL = 1e-6  # of frequency ratio and value, within which two special points are one
LABEL_SHIFTS = ((6, 4), (6, -10), (-12, 4), (-12, -10))  # in points, in turn
SPECIAL = (*CODIMENSION_TWO, GRAZING_FOLD, DOUBLE_GRAZING)  # marked with their names


@dataclass(frozen=True)
class CurveParameter:
    """The second parameter of bifurcation curves.

    ``key`` is its name in files, ``label`` its name in text and figures, and ``scale`` the factor
    to the label's unit.
    """

    key: str
    label: str
    scale: float = 1.0


def make_orbit_table_report(title: str, text: Sequence[Block], plain: list[Json]) -> Report:
    """Return a report with a table of orbits, folds, births or mergers in their plain forms."""
    rows = []
    for number, entry in enumerate(plain, 1):
        # an orbit, or a fold, birth or merger with its kind and its orbit
        head = {"number": number, "kind": entry.get("kind", ORBIT)}
        rows.append(make_row({**read_orbit(entry.get(ORBIT, entry)), **head}))
    return Report(
        title=title,
        text=text,
        numbers=plain,
        tables={"orbits.csv": Table.of_values(ORBIT_COLUMNS, rows)},
    )


def make_orbit_report(searches: Sequence[OrbitSearch]) -> Report:
    """Return what `periodic orbits` prints and writes.

    The report has the orbits at each frequency, their basins, and the reasons why other candidates
    (solutions of the conditions, or ends of runs) are no orbits.
    """
    orbits = [(group, orbit) for group in searches for orbit in group.orbits]
    refused = [orbit for group in searches for orbit in group.refused]
    stable = sum(orbit.stability.stable for _, orbit in orbits)
    lines = [
        f"{len(orbits)} orbits, {stable} of them stable.",
        *basin_lines(searches),
        *refusals(refused, "solutions or runs are"),
    ]
    plain = [
        {
            **plain_orbit(orbit),
            "basin": None if group.basins is None else group.basins.to_plain(orbit),
        }
        for group, orbit in orbits
    ]
    return make_orbit_table_report("Periodic orbits", [[orbit_table(searches)], lines], plain)


def orbit_table(searches: Sequence[OrbitSearch]) -> Table:
    """Return a table with a row for each orbit."""
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
                f"{orbit.case.omega_ratio:.6f}", kind, str(len(orbit.impacts)),
                str(sides * schedule.reversals), f"{MM * orbit.motion.tip_max:.6f}",
                f"{MM * orbit.motion.tip_rms:.6f}", f"{slow:.4f}", f"{fast:.4f}",
                "yes" if orbit.stability.stable else "no", basin,
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
    return Table.of_words(header, rows)


def share_text(share: Share) -> str:
    """Return the number of runs that ended on a motion, and the interval of their share in %."""
    return f"{share.ended} of {share.runs} ({100 * share.low:.0f}-{100 * share.high:.0f} %)"


def basin_lines(searches: Sequence[OrbitSearch]) -> list[str]:
    """Return lines on runs from random initial states that did not end on an orbit with impacts.

    A line has the share of runs that ended without impacts, and of those not periodic, at a
    frequency. Frequencies without such runs have no line if there are several frequencies.
    """
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


def hybrid_table(orbits: Sequence[HybridOrbit]) -> Table:
    """Return a table with a row for each orbit of a scene with several absorbers or springs.

    Impacts are counted for each absorber.
    """
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
                f"{MM * orbit.tip_max:.6f}",
                f"{MM * orbit.tip_rms:.6f}",
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
    return Table.of_words(header, rows)


def refusals(refused: list[NoOrbit], what: str) -> list[str]:
    """Return the lines of `count_reasons` for candidates that are no orbits."""
    return count_reasons([orbit.reason for orbit in refused], what)


def count_reasons(refused: list[str], what: str) -> list[str]:
    """Return lines with the number of candidates that are no orbits, by reason.

    ``refused``: the reason of each candidate; numbers in brackets are ignored. ``what``: subject
    and verb of the first line. The eight most frequent reasons are listed; without candidates the
    list is empty.
    """
    if not refused:
        return []
    # numbers in brackets differ from candidate to candidate
    counts = Counter(reason.split(" (")[0] for reason in refused)
    lines = [f"  {number} x {reason}" for reason, number in counts.most_common(8)]
    return [f"{len(refused)} {what} no orbit:", *lines, *(["  ..."] if len(counts) > 8 else [])]


def make_fold_report(located: Sequence[Threshold]) -> Report:
    """Return what `periodic folds` prints and writes.

    The report has the folds with a confirmed orbit, and the reasons why others have no orbit.
    """
    good = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
    rows = [
        (
            f"{fold.omega_ratio:.10f}",
            f"{fold.force:g}",
            f"{MM * orbit.motion.tip_max:.6f}",
            str(2 * orbit.schedule.reversals),
        )
        for fold, orbit in good
    ]
    table = Table.of_words(("omega/omega_1", "force, N", "tip max, mm", "reversals"), rows)
    plain = [
        {
            "kind": FOLD,
            "omega_ratio": fold.omega_ratio,
            "force_N": fold.force,
            "tip_max_m": orbit.motion.tip_max,
            "orbit": plain_orbit(orbit),
        }
        for fold, orbit in good
    ]
    refused = [fold.orbit for fold in located if isinstance(fold.orbit, NoOrbit)]
    notes = refusals(refused, "folds of the closed form lead to")
    return make_orbit_table_report("Folds of periodic orbits", [[table, *notes]], plain)


def make_threshold_report(thresholds: Sequence[Threshold]) -> Report:
    """Return what `periodic folds --thresholds` prints and writes.

    The report has the births and mergers of isolas with a confirmed orbit, and the reasons why
    others have no orbit.
    """
    good = [(level, level.orbit) for level in thresholds if isinstance(level.orbit, Orbit)]
    rows = [
        (
            level.kind,
            f"{level.force:.8f}",
            f"{level.omega_ratio:.8f}",
            str(2 * orbit.schedule.reversals),
        )
        for level, orbit in good
    ]
    table = Table.of_words(("kind", "force, N", "omega/omega_1", "reversals"), rows)
    plain = [
        {
            "kind": level.kind,
            "force_N": level.force,
            "omega_ratio": level.omega_ratio,
            "tip_max_m": orbit.motion.tip_max,
            "orbit": plain_orbit(orbit),
        }
        for level, orbit in good
    ]
    refused = [level.orbit for level in thresholds if isinstance(level.orbit, NoOrbit)]
    notes = refusals(refused, "level places of the closed form lead to")
    return make_orbit_table_report("Births and mergers of isolas", [[table, *notes]], plain)


def make_branch_report(
    curves: Sequence[ResponseCurve],
    key: str,
    shared: Json | None = None,
    ends: Sequence[str] = (),
) -> Report:
    """Return what `periodic orbits --over` prints and writes: branches over a parameter.

    ``key``: name of the parameter in files; ``shared``: values of all branches; ``ends``: lines
    below the table.
    """
    plain = [{**(shared or {}), **rename_parameter(curve.to_plain(), key)} for curve in curves]
    rows = list(branch_rows(plain, key))
    return Report(
        title="Branches of periodic orbits",
        text=[[branch_table(curves, key)], ends],
        numbers=plain,
        tables={"branches.csv": Table.of_values(ORBIT_COLUMNS, rows)},
    )


def branch_table(curves: Sequence[ResponseCurve], name: str) -> Table:
    """Return a table with a row for each branch over the parameter ``name``."""
    rows = []
    for number, curve in enumerate(curves, 1):
        places = ", ".join(
            f"{mark.kind} {mark.omega_ratio:.6g}"
            + ("" if mark.criticality is None else f" ({mark.criticality})")
            for mark in sorted(curve.located, key=lambda mark: mark.omega_ratio)
        )
        peak = curve.peak
        rows.append(
            (
                str(number),
                str(len(curve.tip_max)),
                f"{curve.omega_ratio.min():.5g} to {curve.omega_ratio.max():.5g}",
                "" if peak is None else f"{MM * peak.tip_max:.4f} at {peak.omega_ratio:.5g}",
                "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}",
                places,
            )
        )
    return Table.of_words(("branch", "points", name, "peak, mm", "stable, %", "located"), rows)


def rename_parameter(plain: Any, key: str) -> Any:
    """Return a curve's plain data with each key ``omega_ratio`` renamed to ``key``.

    A branch over another parameter stores the parameter's values under ``omega_ratio``. The entry
    ``orbits`` is left as it is, since an orbit has its frequency and its parameter.
    """
    if isinstance(plain, list):
        return [rename_parameter(value, key) for value in plain]
    if not isinstance(plain, dict):
        return plain
    return {
        key if name == "omega_ratio" else name: value
        if name == "orbits"
        else rename_parameter(value, key)
        for name, value in plain.items()
    }


def make_curve_report(curves: Sequence[Json], title: str, parameter: CurveParameter) -> Report:
    """Return what `periodic curves` prints and writes.

    ``curves`` are the plain data of `BifurcationCurve`. ``title`` is the title of the figure.
    """
    text: list[Block] = [
        [curve_table(curves, parameter)],
        [
            line
            for number, curve in enumerate(curves, 1)
            for line in curve_lines(number, curve, parameter.scale)
        ],
    ]
    if not curves:
        text = [["No such place on the branches over this range of frequencies."]]
    rows = list(bifurcation_rows(curves, parameter.key))
    return Report(
        title="Curves of bifurcations",
        text=text,
        numbers=list(curves),
        tables={"curves.csv": Table.of_values(ORBIT_COLUMNS, rows)},
        figures={"curves.png": partial(draw_curves, curves, title, parameter)},
    )


def curve_table(curves: Sequence[Json], parameter: CurveParameter) -> Table:
    """Return a table with a row for each curve of bifurcations."""
    rows = []
    for number, curve in enumerate(curves, 1):
        ratio = np.array(curve["omega_ratio"])
        value = parameter.scale * np.array(curve["value"])
        good = [confirmed == "yes" for confirmed in curve["orbit"]]
        turns = [
            f"{parameter.scale * mark['value']:.7g} at {mark['omega_ratio']:.6f}"
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
    header = (
        "curve",
        "of",
        "orbits",
        "points that are orbits",
        "omega/omega_1",
        parameter.label,
        f"least or greatest {parameter.label}",
    )
    return Table.of_words(header, rows)


def curve_lines(number: int, curve: Json, scale: float) -> list[str]:
    """Return lines on a curve's end, the share of supercritical points, and its special points.

    ``number``: number of the curve in the table; ``scale``: factor to the parameter's unit.
    """
    lines = [f"Curve {number}: {curve['ended']}."]
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


def draw_curves(curves: Sequence[Json], title: str, parameter: CurveParameter) -> Figure:
    """Draw curves of bifurcations (plain data of `BifurcationCurve`) over frequency and parameter.

    Subcritical parts are dashed; parts without a confirmed orbit are dotted.
    """
    figure, axes = figure_of(8.6, 6.0)
    scale = parameter.scale
    for curve in curves:
        ratio = np.array(curve["omega_ratio"])
        value = scale * np.array(curve["value"])
        colour = KIND_COLOURS[curve["kind"]]
        good = np.array([confirmed == "yes" for confirmed in curve["orbit"]])
        # confirmed points and their neighbours, so that the line has no gaps
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
        label = f"{parameter.label} least or greatest" if kind == FOLD else kind
        axes.plot([], [], TURNS[kind], color="black", mfc="white", ms=5, label=label)
    _draw_special(axes, curves, scale)
    if any(SUBCRITICAL in curve["criticality"] for curve in curves):
        axes.plot([], [], color="black", lw=1.8, ls="--", label=SUBCRITICAL)
    if any(confirmed != "yes" for curve in curves for confirmed in curve["orbit"]):
        axes.plot([], [], color="black", lw=1.0, ls=":", label="no orbit of the true motion")
    axes.set(xlabel="frequency over the first resonance's", ylabel=parameter.label)
    axes.set_title(shorten_numbers(title), fontsize=10)
    draw_grid(axes)
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)  # not over the curves
    return figure


def _draw_special(axes: Axes, curves: Sequence[Json], scale: float) -> None:
    """Mark the special points of curves with numbers, and list their names in the legend.

    A point that several curves share is marked once.
    """
    marks: list[Json] = []
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


def _is_turn(mark: Json) -> bool:
    """Return whether a located point of a curve of bifurcations gets a mark of `TURNS`.

    These are the ends of the curve by grazing or pulling at a wall, and its extrema over the
    parameter (folds) if their orbit is confirmed.
    """
    return mark["kind"] in TURNS and (mark["kind"] != FOLD or mark["orbit"] == "yes")
