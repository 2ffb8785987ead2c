"""Text, tables and figures of the levels of a disk's worst sector: over the clearance, and by absorber."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.plain import from_disk
from optimisation.disk_levels import (
    FRICTION,
    IMPACT,
    WITHOUT,
    DiskCase,
    DiskComparisonLevels,
    DiskGapChoice,
)
from optimisation.page import markdown
from optimisation.report.disk_report import describe_disk, describe_disk_absorbers
from optimisation.report.figures import MM, figure_of
from optimisation.statistics import prediction_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAP_COLUMNS = ("gap_m", "disks", "median_level_m", "lowest_level_m", "highest_level_m")
LEVEL_COLUMNS = ("absorber", "force_n", "disk", "worst_level_m")
NO_TUNED_ABSORBERS = (
    "Tuned absorbers are left out: several absorbers on one structure have rigid contact only."
)
COLOURS = {WITHOUT: "#555555", IMPACT: "#1f4e79", FRICTION: "#d1641a"}


def describe_case(case: DiskCase) -> list[str]:
    """Return disk, absorbers and sweeps in lines."""
    low, high = case.limits
    omega = case.disk.tuned().model.resonance_omega(case.resonance)
    run = (
        f"{case.force:g} N on each sector, swept up and down from {low:.4g} to {high:.4g} times resonance {case.resonance} of the tuned "
        f"disk ({omega / (2 * np.pi):.6g} Hz), at {case.rate:.3g} % per 100 pseudo periods"
    )
    return [describe_disk(case.disk), describe_disk_absorbers(case.disk), run]


def _interval(levels: Any) -> str:
    low, high = prediction_interval(levels)
    if not np.isfinite(low):
        return ""
    return f" (90 % of disks: {MM * low:.4g} to {MM * high:.4g} mm, n = {len(levels)})"


def gap_text(choice: DiskGapChoice) -> str:
    """Return what `design gap` prints of a disk."""
    samples = choice.samples
    without = float(np.median(choice.without))
    lines = describe_case(choice.case)
    names = {"Recommended": choice.recommended, "Lowest level": choice.sharp}
    tolerance = 100 * choice.tolerance
    for name, step in names.items():
        levels = samples.levels[step]
        level = float(np.median(levels))
        share = f"{100 * level / without:.1f} % of no absorbers"
        worst = samples.worst(step, choice.tolerance)
        within = f"at most {MM * worst:.4g} mm within {tolerance:g} % of the force"
        lines += [
            f"{name}: a clearance of {MM * choice.gap(step):.4g} mm to either wall in all sectors with an absorber.",
            f"  Level of the worst sector {MM * level:.4g} mm, {share}{_interval(levels)}; {within}.",
        ]
    lines.append(f"No absorbers: {MM * without:.4g} mm{_interval(choice.without)}.")
    lines.append(f"Design rule (no simulation): {MM * choice.reference:.4g} mm.")
    header = ("clearance, mm", "disks", "worst sector, mm", "lowest", "highest")
    rows = [
        (
            f"{MM * choice.gap(step):.4g}",
            f"{len(levels)}",
            *(f"{MM * value:.4g}" for value in (np.median(levels), np.min(levels), np.max(levels))),
        )
        for step, levels in sorted(samples.levels.items())
    ]
    return "\n".join([*lines, "", markdown(header, rows)])


def gap_rows(choice: DiskGapChoice) -> list[dict[str, object]]:
    """Return a row for each gap."""
    return [
        dict(
            zip(
                GAP_COLUMNS,
                (
                    choice.gap(step),
                    len(levels),
                    float(np.median(levels)),
                    float(np.min(levels)),
                    float(np.max(levels)),
                ),
                strict=True,
            )
        )
        for step, levels in sorted(choice.samples.levels.items())
    ]


def gap_summary(choice: DiskGapChoice) -> dict[str, Any]:
    """Return the search as plain data in SI units."""
    answers = {
        name: {
            "gap_m": choice.gap(step),
            "worst_level_m": choice.samples.levels[step].tolist(),
            "worst_over_tolerance_m": choice.samples.worst(step, choice.tolerance),
        }
        for name, step in (("recommended", choice.recommended), ("sharp", choice.sharp))
    }
    return {
        **answers,
        "force_n": choice.case.force,
        "force_tolerance": choice.tolerance,
        "without_absorbers_m": choice.without.tolist(),
        "design_rule_gap_m": choice.reference,
        "gaps": gap_rows(choice),
        **_case_data(choice.case),
    }


def _case_data(case: DiskCase) -> dict[str, Any]:
    return {
        "resonance": case.resonance,
        "limits": list(case.limits),
        "percent_per_100_periods": case.rate,
        "scene": from_disk(case.disk),
    }


def draw_gap_levels(choice: DiskGapChoice) -> Figure:
    """Return the figure of the worst sector's level over the clearance."""
    figure, axes = figure_of(7.5, 4.6)
    steps = sorted(choice.samples.levels)
    gaps = MM * np.array([choice.gap(step) for step in steps])
    medians = MM * np.array([np.median(choice.samples.levels[step]) for step in steps])
    for gap, step in zip(gaps, steps, strict=True):
        levels = MM * choice.samples.levels[step]
        axes.plot(np.full(len(levels), gap), levels, "o", color="0.6", ms=3)
    axes.plot(gaps, medians, color=COLOURS[IMPACT], label="median of the disks")
    axes.axhline(MM * np.median(choice.without), color=COLOURS[WITHOUT], ls="--", label=WITHOUT)
    best = MM * choice.gap(choice.recommended)
    axes.axvline(best, color=COLOURS[FRICTION], lw=1, label=f"recommended, {best:.3g} mm")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("clearance to either wall in mm")
    axes.set_ylabel("level of the worst sector in mm")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure


def comparison_text(levels: DiskComparisonLevels) -> str:
    """Return what `compare` prints of a disk."""
    lines = describe_case(levels.case)
    lines.append(f"{FRICTION}: {describe_disk_absorbers(levels.dampers)}")
    members = levels.levels[WITHOUT].shape[1]
    lines.append(
        f"level of the worst sector in mm, median of {members} disk{'s' * (members != 1)}; share of no absorbers"
    )
    header = ("force, N", *levels.levels)
    base = np.median(levels.levels[WITHOUT], axis=1)
    rows = []
    for k, force in enumerate(levels.forces):
        cells = [f"{MM * base[k]:.4g}"]
        for name in (IMPACT, FRICTION):
            level = float(np.median(levels.levels[name][k]))
            cells.append(f"{MM * level:.4g}, {100 * level / base[k]:.1f} %")
        rows.append((f"{force:.4g}", *cells))
    tuned = levels.tuned / levels.forces[0]
    header_of_factors = ("amplification factor", "median", "90 % of disks")
    factors = []
    for name, values in levels.levels.items():
        scaled = values[len(values) // 2] / levels.forces[len(values) // 2] / tuned
        low, high = prediction_interval(scaled)
        words = f"{low:.3g} to {high:.3g}" if np.isfinite(low) else ""
        factors.append((name, f"{np.median(scaled):.3g}", words))
    note = "Amplification factor: worst sector over that of the tuned disk without absorbers, at the middle force."
    return "\n".join(
        [
            *lines,
            "",
            markdown(header, rows),
            "",
            markdown(header_of_factors, factors),
            "",
            note,
            NO_TUNED_ABSORBERS,
        ]
    )


def comparison_rows(levels: DiskComparisonLevels) -> list[dict[str, object]]:
    """Return a row for each absorber, force and disk."""
    return [
        dict(zip(LEVEL_COLUMNS, (name, float(force), disk, float(value)), strict=True))
        for name, table in levels.levels.items()
        for force, row in zip(levels.forces, table, strict=True)
        for disk, value in enumerate(row)
    ]


def comparison_summary(levels: DiskComparisonLevels) -> dict[str, Any]:
    """Return the comparison as plain data in SI units."""
    return {
        "forces_n": levels.forces.tolist(),
        "worst_level_m": {name: table.tolist() for name, table in levels.levels.items()},
        "tuned_disk_without_absorbers_m_per_n": levels.tuned / float(levels.forces[0]),
        "friction_limits_n": [
            getattr(absorber.friction, "limit", 0.0) for absorber in levels.dampers.absorbers
        ],
        **_case_data(levels.case),
    }


def draw_disk_comparison(levels: DiskComparisonLevels) -> Figure:
    """Return the figure of the worst sector's level over the force, by absorber."""
    figure, axes = figure_of(7.5, 4.6)
    for name, table in levels.levels.items():
        colour = COLOURS[name]
        axes.plot(levels.forces, MM * np.median(table, axis=1), "o-", color=colour, label=name)
        for member in table.T:
            axes.plot(levels.forces, MM * member, "o", color=colour, ms=2.5, alpha=0.5)
    axes.set(xscale="log", yscale="log")
    axes.set_xlabel("force on each sector in N")
    axes.set_ylabel("level of the worst sector in mm")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure
