"""The tables of the study as Markdown, from rows alone."""

from __future__ import annotations

from optimisation.machine import sources
from optimisation.report.markdown import markdown
from studies.accuracy.bands import KINDS, bands
from studies.accuracy.cost import LANES, LENGTH, MODES, THREADS
from studies.accuracy.distribution import compared
from studies.accuracy.jumps import shares
from studies.accuracy.settings import Row, unique
from studies.study import Measured

SHOWN_STEPS = (20, 20000)
SHOWN_MODES = 10  # a page shows these alone, where they were measured; figures and files have all
MATCHED_RUNS = 16  # of the exact method: the cost at which methods are compared


def _number(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _exponent(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _named(row: Row) -> str:
    if row["setting"] is None:
        return str(row["method"])
    return f"{row['method']}, {row['setting']:g}" + (" steps" if row["method"] in ("Moreau", "Runge-Kutta") else "")


def _shown(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row["modes"] == SHOWN_MODES] or rows


def trajectory_table(rows: list[Row]) -> str:
    """Return the lines of most interest; all are in the JSON file."""
    failed = [f"- {row['scene']}, {row['modes']} modes, {_named(row)}: {row['note']}" for row in rows if row["note"]]
    rows = _shown(rows)
    own = ("Moreau", "Runge-Kutta")
    tight = {name: min((row["setting"] for row in rows if row["method"] == name), default=None) for name in ("SciPy", "heyoka")}
    shown = [
        row
        for row in rows
        if row["setting"] is None or (row["method"] in own and row["setting"] in SHOWN_STEPS) or row["setting"] == tight.get(row["method"])
    ]
    header = ("scene", "modes", "method", "µs per pseudo period", "state", "first impact", "fifth impact", "energy")
    errors = ("state_error", "first_impact_error_periods", "fifth_impact_error_periods", "balance_error")
    lines = [
        (row["scene"], str(row["modes"]), _named(row), _number(row["us_per_period"], 3), *(_exponent(row[name]) for name in errors)) for row in shown
    ]
    return markdown(header, lines) + ("\n\nNot finished:\n\n" + "\n".join(failed) if failed else "")


def distribution_table(rows: list[Row]) -> str:
    """Return a line for each method of each scene and number of modes."""
    methods = compared(_shown(rows))
    header = ("scene", "modes", "method", "runs", "ms a run", "mean, %", "95 %", "distance, %", "95 %", "at matched cost, %")
    lines = []
    for method in methods:
        exact = next(m for m in methods if (m.scene, m.modes, m.setting) == (method.scene, method.modes, None))
        mean, distance = (tuple(100 * x for x in interval) for interval in (method.mean_interval(), method.distance_interval()))
        lines.append(
            (
                method.scene,
                str(method.modes),
                _named({"method": method.method, "setting": method.setting}),
                str(len(method.levels)),
                _number(1e3 * method.seconds, 3),
                f"{100 * method.mean_difference:+.2f}",
                f"{mean[0]:+.2f} to {mean[1]:+.2f}",
                f"{100 * method.distance:.2f}",
                f"{distance[0]:.2f} to {distance[1]:.2f}",
                f"{100 * method.at_cost(MATCHED_RUNS * exact.seconds):.2f}",
            )
        )
    return markdown(header, lines)


def band_table(rows: list[Row]) -> str:
    """Return a line for each direction and kind of members."""
    header = ("sweep", "members differ in", "runs", "median, mm", "5 to 95 %, mm", *(f"D (p) against {kind}" for kind in KINDS), "between phases")
    lines = []
    for band in bands(rows):
        low, middle, high = (1e3 * x for x in band.quantiles)
        tests = ("" if kind not in band.others else "{:.2f} ({:.1g})".format(*band.against(kind)) for kind in KINDS)
        share = "" if band.between is None else "{:.0f} % ({:.0f} to {:.0f})".format(*(100 * x for x in band.between))
        lines.append((band.direction, band.kind, str(len(band.levels)), f"{middle:.4f}", f"{low:.4f} to {high:.4f}", *tests, share))
    return markdown(header, lines)


def growth_table(rows: list[Row]) -> str:
    """Return a line for each scene and number of modes."""
    header = ("scene", "modes", "exponent per pseudo period", "95 %", "impacts per pseudo period", "factor per impact")
    lines = [
        (
            row["scene"],
            str(row["modes"]),
            f"{row['exponent_per_period']:.2f}",
            f"{row['exponent_low']:.2f} to {row['exponent_high']:.2f}",
            f"{row['impacts_per_period']:.2f}",
            _number(row["factor_per_impact"], 3),
        )
        for row in _shown(rows)
        if row["impact"] is None
    ]
    return markdown(header, lines)


def jump_table(rows: list[Row]) -> str:
    """Return a line for each slowness and method."""
    header = ("pseudo periods per 1 %", "method", "runs", "reach the high branch", "95 %, Wilson", "95 %, Clopper-Pearson", "near the limit")
    lines = [
        (
            f"{share.slowness:g}",
            _named({"method": share.method, "setting": share.setting}),
            str(share.runs),
            f"{share.share:.2f}",
            "{:.2f} to {:.2f}".format(*share.wilson),
            "{:.2f} to {:.2f}".format(*share.clopper_pearson),
            str(share.between),
        )
        for share in shares(rows)
    ]
    return markdown(header, lines)


def cost_table(rows: list[Row]) -> str:
    """Return the costs over modes, lanes, threads and length, a table each."""
    over_modes = [row for row in rows if row["over"] == MODES]
    counts = unique(row["value"] for row in over_modes)
    lines = []
    for scene, method in unique((row["scene"], row["method"]) for row in over_modes):
        found = {row["value"]: row["us_per_period"] for row in over_modes if (row["scene"], row["method"]) == (scene, method)}
        lines.append((f"{scene}: {method}", *(_number(found.get(count), 3) for count in counts)))
    parts = [markdown(("µs per pseudo period at this number of modes", *map(str, counts)), lines)] if lines else []
    names = {LANES: "lanes, one thread", THREADS: "threads, 64 lanes", LENGTH: "pseudo periods in the sweep"}
    for over, name in names.items():
        found = {row["value"]: row["us_per_period"] for row in rows if row["over"] == over}
        if found:
            parts.append(
                markdown((name, *(f"{x:g}" for x in found)), [("µs per pseudo period and lane", *(_number(us, 3) for us in found.values()))])
            )
    return "\n\n".join(parts)


def made_with(measured: Measured) -> str:
    """Say when, where and with what a part was measured."""
    words = f"{sources(measured.conditions)} {measured.conditions['wall_s']:g} s."
    if measured.conditions["quick"]:
        words += " A quick look: few cases and runs."
    return words if measured.complete else words + " Stopped early: what was finished."
