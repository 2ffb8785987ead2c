"""The content of results on the level of a disk's worst sector.

The level is given over the clearance, and by absorber.
"""

from __future__ import annotations

from functools import partial
from typing import Any

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
from optimisation.files import numbers
from optimisation.measures import format_number
from optimisation.report.disk_report import describe_disk, describe_disk_absorbers
from optimisation.report.figures import MM, draw_charts
from optimisation.report.report import Chart, Column, Curve, Group, Json, Report, Row, Table
from optimisation.statistics import prediction_interval

GAP_COLUMNS = (
    Column("gap_m", "clearance, mm", scale=MM),
    Column("disks", "disks", "{:.0f}"),
    Column("median_level_m", "worst sector, mm", scale=MM),
    Column("lowest_level_m", "lowest", scale=MM),
    Column("highest_level_m", "highest", scale=MM),
)
LEVEL_COLUMNS = ("absorber", "force_n", "disk", "worst_level_m")
NO_TUNED_ABSORBERS = (
    "Tuned absorbers are left out: several absorbers on one structure have rigid contact only."
)


def describe_case(case: DiskCase) -> list[str]:
    """Return disk, absorbers and sweeps in lines."""
    low, high = case.limits
    omega = case.disk.tuned().model.resonance_omega(case.resonance)
    run = (
        f"{format_number(case.force)} N on each sector, swept up and down from {low:.4g} to "
        f"{high:.4g} times resonance {case.resonance} of the tuned disk "
        f"({omega / (2 * np.pi):.6g} Hz), at {case.rate:.3g} % per 100 pseudo periods"
    )
    return [describe_disk(case.disk), describe_disk_absorbers(case.disk), run]


def interval_words(levels: Any) -> str:
    """Return the interval of 90 % of further disks; nothing where it is not known."""
    low, high = prediction_interval(levels)
    return f"{MM * low:.4g} to {MM * high:.4g} mm" if np.isfinite(low) else ""


def _interval(levels: Any) -> str:
    words = interval_words(levels)
    return f" (90 % of disks: {words}, n = {len(levels)})" if words else ""


def recommended_line(
    choice: DiskGapChoice, name: str = "Recommended", step: float | None = None
) -> str:
    """Return a clearance in words, the recommended one unless another ``step`` is given."""
    gap = choice.gap(choice.recommended if step is None else step)
    return (
        f"{name}: a clearance of {MM * gap:.4g} mm to either wall in all sectors with an absorber."
    )


def gap_lines(choice: DiskGapChoice) -> list[str]:
    """Return what `design gap` prints of a disk above the table."""
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
            recommended_line(choice, name, step),
            (
                f"  Level of the worst sector {MM * level:.4g} mm, {share}{_interval(levels)}; "
                f"{within}."
            ),
        ]
    lines.append(f"No absorbers: {MM * without:.4g} mm{_interval(choice.without)}.")
    lines.append(f"Design rule (no simulation): {MM * choice.reference:.4g} mm.")
    return lines


def gap_table(choice: DiskGapChoice) -> Table:
    """Return a row for each gap."""
    rows = [
        (choice.gap(step), len(levels), *map(float, (np.median(levels), min(levels), max(levels))))
        for step, levels in sorted(choice.samples.levels.items())
    ]
    return Table(GAP_COLUMNS, rows)


def make_gap_report(choice: DiskGapChoice) -> Report:
    """Return the content of the search of a clearance."""
    table = gap_table(choice)
    chart = gap_chart(choice)
    return Report(
        title=f"Clearance for all sectors, {format_number(choice.case.force)} N on each",
        verdict=recommended_line(choice),
        text=[gap_lines(choice), [table]],
        numbers=gap_summary(choice) | {"gaps": table.records()} | _case_data(choice.case),
        tables={"levels.csv": table},
        figures={"levels.png": partial(draw_charts, [chart])},
        groups=gap_groups(choice),
        charts=(chart,),
    )


def gap_summary(choice: DiskGapChoice) -> Json:
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
    }


def _case_data(case: DiskCase) -> Json:
    return {
        "resonance": case.resonance,
        "limits": list(case.limits),
        "percent_per_100_periods": case.rate,
        "scene": from_disk(case.disk),
    }


def gap_chart(choice: DiskGapChoice) -> Chart:
    """Return the worst sector's level over the clearance."""
    steps = sorted(choice.samples.levels)
    gaps = [MM * choice.gap(step) for step in steps]
    medians = [MM * float(np.median(choice.samples.levels[step])) for step in steps]
    samples = [choice.samples.levels[step] for step in steps]
    every = numbers(np.repeat(gaps, [len(levels) for levels in samples]))
    without = MM * float(np.median(choice.without))
    worst = [MM * choice.samples.worst(step, choice.tolerance) for step in steps]
    known = [k for k, level in enumerate(worst) if np.isfinite(level)]
    name = f"largest within {format_number(100 * choice.tolerance)} % of the force"
    return Chart(
        "Level of the worst sector",
        "clearance to either wall in mm",
        "level of the worst sector in mm",
        (
            Curve("median of the disks", gaps, medians),
            Curve(name, [gaps[k] for k in known], [worst[k] for k in known]),
            Curve(WITHOUT, [gaps[0], gaps[-1]], [without, without]),
            Curve("each disk", every, numbers(MM * np.concatenate(samples)), points=True),
        ),
        (("recommended", MM * choice.gap(choice.recommended)),),
        log_x=True,
    )


def gap_groups(choice: DiskGapChoice) -> tuple[Group, ...]:
    """Return the recommended clearance, the level of the worst sector, and the disk."""
    step = choice.recommended
    levels = choice.samples.levels[step]
    median = float(np.median(levels))
    without = float(np.median(choice.without))
    tolerance = 100 * choice.tolerance
    worst = choice.samples.worst(step, choice.tolerance)
    measured = (
        Row(f"median of {len(levels)} disk{'s' * (len(levels) != 1)}", MM * median, "mm RMS"),
        Row("90 % of disks", interval_words(levels) or None),
        Row(f"at most, {tolerance:g} % more or less force", MM * worst, "mm"),
        Row("of no absorbers", 100 * median / without, "%"),
        Row(WITHOUT, MM * without, "mm"),
    )
    gaps = (
        Row("clearance to either wall", MM * choice.gap(step), "mm"),
        Row("lowest level at", MM * choice.gap(choice.sharp), "mm"),
        Row("design rule", MM * choice.reference, "mm"),
    )
    return (
        ("Clearance, in all sectors with an absorber", gaps),
        ("Level of the worst sector", measured),
        ("Disk", disk_rows(choice.case)),
    )


def disk_rows(case: DiskCase) -> tuple[Row, ...]:
    """Return disk, absorbers and sweeps."""
    labels = ("disk", "absorbers", "sweeps")
    return tuple(Row(*pair) for pair in zip(labels, describe_case(case), strict=True))


def comparison_blocks(levels: DiskComparisonLevels) -> list[list[str | Table]]:
    """Return what `compare` prints of a disk."""
    lines: list[str | Table] = [*describe_case(levels.case)]
    lines.append(f"{FRICTION}: {describe_disk_absorbers(levels.dampers)}")
    members = levels.levels[WITHOUT].shape[1]
    lines.append(
        f"level of the worst sector in mm, median of {members} disk{'s' * (members != 1)}; "
        "share of no absorbers"
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
    note = (
        "Amplification factor: worst sector over that of the tuned disk without absorbers, at the "
        "middle force."
    )
    return [
        lines,
        [Table.of_words(header, rows)],
        [Table.of_words(header_of_factors, factors)],
        [note, NO_TUNED_ABSORBERS],
    ]


def comparison_table(levels: DiskComparisonLevels) -> Table:
    """Return a row for each absorber, force and disk."""
    rows = [
        (name, float(force), disk, float(value))
        for name, table in levels.levels.items()
        for force, row in zip(levels.forces, table, strict=True)
        for disk, value in enumerate(row)
    ]
    return Table.of_values(LEVEL_COLUMNS, rows)


def make_comparison_report(levels: DiskComparisonLevels) -> Report:
    """Return the content of the comparison of a disk's absorbers."""
    chart = comparison_chart(levels)
    return Report(
        title="Absorbers of a bladed disk compared",
        verdict=lowest_line(levels),
        text=comparison_blocks(levels),
        numbers=comparison_summary(levels),
        tables={"levels.csv": comparison_table(levels)},
        figures={"comparison.png": partial(draw_charts, [chart])},
        groups=comparison_groups(levels),
        charts=(chart,),
        warnings=(NO_TUNED_ABSORBERS.rstrip("."),),
    )


def comparison_summary(levels: DiskComparisonLevels) -> Json:
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


def comparison_chart(levels: DiskComparisonLevels) -> Chart:
    """Return the worst sector's level over the force, by absorber."""
    forces = numbers(levels.forces)
    curves = [
        Curve(name, forces, numbers(MM * np.median(table, axis=1)))
        for name, table in levels.levels.items()
    ]
    for name, table in levels.levels.items():
        if table.shape[1] > 1:
            every = numbers(np.repeat(levels.forces, table.shape[1]))
            curves.append(
                Curve(f"{name}, each disk", every, numbers(MM * table.ravel()), points=True)
            )
    return Chart(
        "Level of the worst sector",
        "force on each sector in N",
        "level of the worst sector in mm",
        tuple(curves),
        log_x=True,
        log_y=True,
    )


def lowest_line(levels: DiskComparisonLevels) -> str:
    """Return a text with the absorbers of the lowest level of the worst sector.

    The level is that at the middle force.
    """
    k = len(levels.forces) // 2
    medians = {name: float(np.median(table[k])) for name, table in levels.levels.items()}
    best = min(medians, key=lambda name: medians[name])
    share = 100 * medians[best] / medians[WITHOUT]
    return (
        f"Lowest level of the worst sector at {levels.forces[k]:.4g} N on each: {best}, "
        f"{share:.1f} % of {WITHOUT}."
    )


def comparison_groups(levels: DiskComparisonLevels) -> tuple[Group, ...]:
    """Return the levels at the middle force, and the disk."""
    k = len(levels.forces) // 2
    base = float(np.median(levels.levels[WITHOUT][k]))
    rows = []
    for name, table in levels.levels.items():
        level = float(np.median(table[k]))
        words = f"{MM * level:.4g} mm, {100 * level / base:.1f} %{_interval(table[k])}"
        rows.append(Row(name, words))
    heading = f"Level of the worst sector at {levels.forces[k]:.4g} N on each"
    dampers = Row(FRICTION, describe_disk_absorbers(levels.dampers))
    return ((heading, tuple(rows)), ("Disk", (*disk_rows(levels.case), dampers)))
