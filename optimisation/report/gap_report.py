"""The check of the design rule as rows, JSON and a figure. SI units, unless named."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from optimisation.gap_check import GapCheck
from optimisation.report.written_figure import write_figure

Json = dict[str, object]
COLUMNS = (
    "gap_m",
    "gap_over_rule",
    "members",
    "level_median_m",
    "level_5_percent_m",
    "level_95_percent_m",
    "relative_median",
    "limit_m",
    "share_of_possible_reduction",
)
DPI = 160
MM = 1e3
IMPACT, LIMIT = "#0072B2", "0.72"


def rows(check: GapCheck) -> Iterator[tuple[object, ...]]:
    """Yield one row of `COLUMNS` for each gap; an empty cell where nothing is finished."""
    for k, gap in enumerate(check.gaps):
        yield tuple("" if value is None else value for value in _values(check, k, float(gap)).values())


def _values(check: GapCheck, k: int, gap: float) -> dict[str, float | None]:
    members = int(np.sum(~np.isnan(check.curves[k].combined)))
    levels = (check.level[k], *check.band[:, k], check.relative[k])
    numbers = (gap, gap / check.rule, members, *map(float, levels), float(check.limit[k]), float(check.share[k]))
    return {name: None if math.isnan(value) else value for name, value in zip(COLUMNS, numbers, strict=True)}


def summary(check: GapCheck) -> Json:
    """Return settings, the rule and what the simulation says of it as JSON values."""
    best = check.best
    points: Json = {"at_rule": _values(check, check.at_rule, check.rule)}
    if best is not None:
        points["best"] = _values(check, best, float(check.gaps[best]))
    friction = check.absorber.friction
    without = float(check.without.median[0])
    return {
        "complete": check.complete,
        "rule_gap_m": check.rule,
        "free_amplitude_over_gap": check.reach,
        "level_without_absorber_m": None if math.isnan(without) else without,
        "sweep_over_stationary_level": None if math.isnan(without) else check.sweep_ratio,
        **points,
        "settings": {
            "force_n": check.force,
            "resonance": check.resonance,
            "mass_ratio": check.absorber.mass_ratio,
            "restitution": getattr(check.absorber.walls, "restitution", None),
            "friction_limit_n": None if friction is None else friction.limit,
            "modes": check.model.modes,
            "percent_per_100_pseudo_periods": check.rate,
            "sweep_limits": list(check.limits),
            "members": len(check.without.members),
            "level": "larger of sweep up and sweep down; median and 5 to 95 % over the members",
        },
    }


def save_figure(path: Path, check: GapCheck) -> None:
    """Draw level and limit over the gap; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(8, 5.2), layout="constrained")
    axes = figure.subplots()
    gaps, (low, high) = MM * check.gaps, MM * check.band
    fine = np.geomspace(check.gaps[0], check.gaps[-1], 120)
    limit = MM * np.array([check.limit_at(float(gap)) for gap in fine])
    axes.fill_between(MM * fine, 0, limit, facecolor="0.93", edgecolor=LIMIT, hatch="////", lw=0.8, label="out of reach for any device in that gap")
    axes.fill_between(gaps, low, high, color=IMPACT, alpha=0.25, lw=0)
    axes.plot(
        gaps, MM * check.level, "o-", color=IMPACT, lw=2.2, ms=5, label=f"impact absorber, median and 5 to 95 % of {len(check.without.members)} runs"
    )
    axes.axvline(MM * check.rule, color="#D55E00", lw=1.8, ls="--", label=f"design rule: {MM * check.rule:.3g} mm")
    if check.best is not None:
        axes.plot(gaps[check.best], MM * check.level[check.best], "o", ms=10, mfc="white", mec=IMPACT, mew=2.2, zorder=5, label="best simulated gap")
    without = MM * float(check.without.median[0])
    stopped = "" if check.complete else " (stopped early)"
    axes.set_xscale("log")
    top = max(float(np.nanmax(high, initial=0)), float(limit.max()))
    axes.set(xlim=(gaps[0], gaps[-1]), ylim=(0, 1.45 * top if top > 0 else 1))
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("clearance to either wall in mm", fontsize=11)
    axes.set_ylabel("resonant response level of the tip in mm (RMS)", fontsize=11)
    axes.grid(True, color="0.88", lw=0.7)
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", ncols=1, fontsize=9.5, framealpha=0.95)
    absorber = f"absorber of {100 * check.absorber.mass_ratio:g} % of the beam's mass; without absorber: {without:.3g} mm"
    axes.set_title(f"Gap for {check.force:g} N near resonance {check.resonance}{stopped}\n{absorber}", fontsize=11)
    write_figure(figure, path, DPI)
