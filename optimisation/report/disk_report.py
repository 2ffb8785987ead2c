"""Reports on bladed disks: levels by sector of a run, and of the worst sector of an ensemble."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.drive import Drive, Excitation
from impact_env.laws import describe_absorber, describe_modes
from impact_env.plain import from_disk
from impact_env.sectors import SectorResponse
from impact_env.structures.cyclic import BladedDisk
from optimisation.disks import (
    FRICTION,
    IMPACT,
    WITHOUT,
    DiskCase,
    DiskComparisonLevels,
    DiskGapChoice,
)
from optimisation.files import numbers
from optimisation.measures import format_number, prediction_interval, shorten_numbers
from optimisation.report.report import (
    MM,
    Chart,
    Column,
    Curve,
    Group,
    Json,
    Report,
    Row,
    Table,
    draw_charts,
    figure_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LISTED = 12  # sectors that are listed by their numbers


def describe_disk(disk: BladedDisk) -> str:
    """Return sectors, force and mistuning in a line."""
    ring = disk.ring
    mistuning = ring.mistuning
    words = [f"{ring.sectors} sector{'s' * (ring.sectors != 1)}"]
    words.append(f"engine order {disk.engine_order}, {disk.direction}")
    parts = [
        f"{name} by {format_number(100 * value)} %"
        for name, value in (("frequencies", mistuning.frequency), ("gaps", mistuning.gap))
        if value > 0
    ]
    tuned = "no mistuning"
    words.append(f"mistuned {', '.join(parts)}, seed {mistuning.seed}" if parts else tuned)
    return "; ".join(words)


def describe_disk_absorbers(disk: BladedDisk) -> str:
    """Return the absorbers and their sectors in a line; gaps are those before mistuning."""
    every = disk.absorbers
    if not every:
        return "no absorbers"
    sectors = disk.absorber_sectors
    where = "in all sectors"
    if len(sectors) < disk.ring.sectors:
        listed = ", ".join(map(str, sectors[:MOST_LISTED]))
        more = "" if len(sectors) <= MOST_LISTED else " and others"
        where = f"in sector{'s' * (len(sectors) != 1)} {listed}{more}"
    same = "" if len(every) == 1 else "each " if len(set(every)) == 1 else "the first "
    return f"absorber{'s' * (len(every) != 1)} {where}: {same}{describe_absorber(every[0])}"


def describe_disk_run(
    disk: BladedDisk, drive: Excitation, resonance: int, start: str, method: str
) -> str:
    """Return a line that describes the drive of a disk.

    ``resonance`` is that of the tuned disk. ``start`` and ``method`` are texts.
    """
    schedule = drive.schedule
    ratios = schedule.omegas / schedule.reference
    modes = describe_modes(disk.model.modes)
    periods = f"{schedule.periods:.6g} pseudo periods"
    hertz = f"{schedule.reference / (2 * np.pi):.6g} Hz"
    if not isinstance(drive, Drive):
        about = f"{drive.describe()} for {float(schedule.times[-1]):g} s"
        return f"{about}, {periods} of {hertz}, from {start}, {modes}, {method}"
    frequency = (
        f"at {ratios[0]:.4g}"
        if ratios[0] == ratios[-1]
        else f"from {ratios[0]:.4g} to {ratios[-1]:.4g}"
    )
    where = f"{frequency} times resonance {resonance} of the tuned disk ({hertz})"
    return (
        f"{format_number(drive.amplitude)} N on each sector {where}, {periods}, from {start}, "
        f"{modes}, {method}"
    )


def level_lines(responses: Sequence[SectorResponse], periods: float) -> list[str]:
    """Return lines on the worst sector, the mean, localisation and impacts.

    For several disks they include the spread.
    """
    levels = [response.levels for response in responses]
    first = levels[0]
    worst = first.worst_sector
    ratio = first.frequency_ratio[worst]
    rows = [
        (
            "worst sector",
            _mm(first.worst),
            f"sector {worst}, around {ratio:.4f} times the resonance",
        )
    ]
    rows += _spread([level.worst for level in levels])
    rows.append(("mean over the sectors", _mm(first.mean), ""))
    rows += _spread([level.mean for level in levels])
    rows.append(("participation ratio", f"{first.participation:.3f}", "1: all sectors alike"))
    rows.append(("largest displacement", _mm(float(np.max(first.largest))), ""))
    impacts = responses[0].impact_count
    rows.append(("impacts", f"{impacts}", f"{impacts / periods:.3g} a pseudo period"))
    return [f"  {name:<24}{value:>14}   {note}".rstrip() for name, value, note in rows]


def _mm(value: float) -> str:
    return f"{MM * value:.4g} mm"


def _spread(values: list[float]) -> list[tuple[str, str, str]]:
    if len(values) == 1:
        return []
    low, high = prediction_interval(values)
    note = f"median of {len(values)} disks, 90 % of disks: {MM * low:.4g} to {MM * high:.4g} mm"
    return [("", _mm(float(np.median(values))), note)]


def sector_table(responses: Sequence[SectorResponse], absorbers: Sequence[int]) -> Table:
    """Return a row for each sector of the first disk.

    It has the level, the frequency at which it was read, and the largest displacement.
    """
    levels = responses[0].levels
    header = ("sector", "absorber", "level, mm", "read at", "largest, mm")
    rows = [
        (
            str(sector),
            "yes" if sector in absorbers else "no",
            f"{MM * levels.value[sector]:.4g}",
            f"{levels.frequency_ratio[sector]:.4f}",
            f"{MM * levels.largest[sector]:.4g}",
        )
        for sector in range(len(levels.value))
    ]
    return Table.of_words(header, rows)


def levels_to_json(responses: Sequence[SectorResponse]) -> dict[str, Any]:
    """Return the levels of all disks as plain data, a list for each disk."""
    levels = [response.levels for response in responses]
    return {
        "sector_level_m": [level.value.tolist() for level in levels],
        "sector_frequency_ratio": [level.frequency_ratio.tolist() for level in levels],
        "sector_largest_m": [level.largest.tolist() for level in levels],
        "worst_level_m": [level.worst for level in levels],
        "worst_sector": [level.worst_sector for level in levels],
        "mean_level_m": [level.mean for level in levels],
        "participation_ratio": [level.participation for level in levels],
        "impacts": [response.impact_count for response in responses],
    }


def draw_disk_sweep(title: str, responses: Sequence[SectorResponse]) -> Figure:
    """Return the figure of a sweep of disks.

    It shows the sectors of the first disk over the frequency, and each sector's level with the
    worst of all disks.
    """
    figure, axes = figure_of(12, 4.6, 1, 2, width_ratios=[2, 1])
    figure.suptitle(shorten_numbers(title), fontsize=10)
    windows = responses[0].windows
    assert windows is not None
    windows.plot(axes[0])
    levels = responses[0].levels
    axes[1].barh(np.arange(len(levels.value)), MM * levels.value, color="#1f4e79", label="level")
    worst = MM * np.array([response.levels.worst for response in responses])
    axes[1].axvline(worst[0], color="#a0182d", ls="--", label="worst sector")
    if len(worst) > 1:
        low, high = prediction_interval(worst)
        label = f"worst sector, 90 % of disks (n = {len(worst)})"
        axes[1].axvspan(low, high, color="#a0182d", alpha=0.15, lw=0, label=label)
    axes[1].set_xlabel("response level in mm")
    axes[1].set_ylabel("sector")
    axes[1].set_xlim(left=0)
    axes[1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), fontsize=8)
    return figure


# The level of a disk's worst sector, over the clearance and by absorber.

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
