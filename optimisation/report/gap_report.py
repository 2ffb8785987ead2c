"""The answers of `design_gap` and what they rest on as rows, JSON and a figure. SI units, unless named."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from optimisation.gap_advice import Advice, Answer
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


def rows(found: Advice) -> Iterator[tuple[object, ...]]:
    """Yield one row of `COLUMNS` for each gap that was run in full; an empty cell where nothing is known."""
    for k, gap in enumerate(found.check.gaps):
        yield tuple("" if value is None else value for value in _values(found.check, k, float(gap)).values())


def _values(check: GapCheck, k: int, gap: float) -> dict[str, float | None]:
    members = int(np.sum(~np.isnan(check.curves[k].combined)))
    levels = (check.level[k], *check.band[:, k], check.relative[k])
    numbers = (gap, gap / check.rule, members, *map(float, levels), float(check.limit[k]), float(check.share[k]))
    return {name: None if math.isnan(value) else value for name, value in zip(COLUMNS, numbers, strict=True)}


def answer_values(answer: Answer | None, mass: float) -> Json | None:
    """Return a device and its levels as JSON values, mass in kg; None for none."""
    if answer is None:
        return None
    return {
        "gap_m": answer.gap,
        "friction_limit_n": answer.friction_limit,
        "restitution": answer.absorber.walls.restitution,  # type: ignore[union-attr]
        "mass_kg": mass,
        "level_m": answer.level,
        "level_5_m": answer.low,
        "level_95_m": answer.high,
        "level_worst_m": answer.worst if math.isfinite(answer.worst) else None,
    }


def summary(found: Advice) -> Json:
    """Return answers, settings, the rule and what the simulation says of it as JSON values."""
    check, points = found.check, {}
    if check.gaps.size:
        points["at_rule"] = _values(check, check.at_rule, check.rule) if check.gaps[check.at_rule] == check.rule else None
    if found.sharp is not None:
        points["best"] = _values(check, int(np.argmin(np.abs(check.gaps - found.sharp.gap))), found.sharp.gap)
    device = found.recommended.absorber if found.recommended is not None else check.absorber
    without = float(check.without.median[0])
    return {
        "complete": found.complete,
        "recommended": answer_values(found.recommended, check.mass),
        "sharp": answer_values(found.sharp, check.mass),
        "rule_gap_m": check.rule,
        "free_amplitude_over_gap": check.reach,
        "level_without_absorber_m": None if math.isnan(without) else without,
        "sweep_over_stationary_level": None if math.isnan(without) else check.sweep_ratio,
        **points,
        "looks": [{"gap_m": gap, "level_m": level} for gap, level in found.looks],
        "tried": [dict(zip(("name", "value", "level_m", "gap_m"), one, strict=True)) for one in found.tried],
        "settings": {
            "force_n": check.force,
            "force_tolerance": found.tolerance,
            "resonance": check.resonance,
            "mass_ratio": device.mass_ratio,
            "restitution": getattr(device.walls, "restitution", None),
            "friction_limit_n": None if device.friction is None else device.friction.limit,
            "modes": check.model.modes,
            "percent_per_100_pseudo_periods": check.rate,
            "sweep_limits": list(check.limits),
            "members": found.members,
            "sweeps": found.sweeps,
            "level": "larger of sweep up and sweep down; median and 5 to 95 % over the members",
        },
    }


def save_figure(path: Path, found: Advice) -> None:
    """Draw level and limit over the gap, with the answers; the ending of ``path`` chooses the format."""
    check = found.check
    figure = Figure(figsize=(8, 5.2), layout="constrained")
    axes = figure.subplots()
    gaps, (low, high) = MM * check.gaps, MM * check.band.reshape(2, -1)
    every = [*check.gaps] or [check.rule]
    fine = np.geomspace(0.95 * min(every), 1.05 * max(every), 120)
    limit = MM * np.array([check.limit_at(float(gap)) for gap in fine])
    axes.fill_between(MM * fine, 0, limit, facecolor="0.93", edgecolor=LIMIT, hatch="////", lw=0.8, label="out of reach for any device in that gap")
    axes.fill_between(gaps, low, high, color=IMPACT, alpha=0.25, lw=0)
    axes.plot(gaps, MM * check.level, "o-", color=IMPACT, lw=2.2, ms=5, label=f"median and 5 to 95 % of up to {found.members} runs")
    if found.looks:
        at, level = MM * np.array(found.looks).T
        axes.plot(at, level, "o", ms=5, mfc="white", mec=IMPACT, ls="", label="one run")
    axes.axvline(MM * check.rule, color="#D55E00", lw=1.4, ls="--", label=f"design rule: {MM * check.rule:.3g} mm")
    for answer, colour, word in ((found.sharp, "black", "lowest level"), (found.recommended, "#009E73", "recommended")):
        if answer is not None:
            axes.axvline(MM * answer.gap, color=colour, lw=1.8, label=f"{word}: {MM * answer.gap:.3g} mm")
    if found.recommended is not None and np.isfinite(found.recommended.worst):
        best = found.recommended
        words = f"at most, {100 * found.tolerance:g} % more or less force"
        axes.plot(MM * best.gap, MM * best.worst, "v", color="#009E73", ms=9, label=words)
    without = MM * float(check.without.median[0])
    stopped = "" if found.complete else " (stopped early)"
    axes.set_xscale("log")
    top = max(float(np.nanmax(high, initial=0)), float(limit.max()))
    axes.set(xlim=(MM * fine[0], MM * fine[-1]), ylim=(0, 1.6 * top if top > 0 else 1))
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("clearance to either wall in mm", fontsize=11)
    axes.set_ylabel("resonant response level in mm (RMS)", fontsize=11)
    axes.grid(True, color="0.88", lw=0.7)
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", ncols=2, fontsize=8.5, framealpha=0.95)
    absorber = f"absorber of {100 * check.absorber.mass_ratio:g} % of the structure's mass; without absorber: {without:.3g} mm"
    axes.set_title(f"Gap for {check.force:g} N near resonance {check.resonance}{stopped}\n{absorber}", fontsize=11)
    write_figure(figure, path, DPI)
