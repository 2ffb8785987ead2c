"""Text, JSON and figure of what runs of bladed disks show: levels by sector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.drive import Drive, Excitation
from impact_env.laws import describe_absorber, describe_modes
from impact_env.sectors import SectorResponse
from impact_env.structures.cyclic import BladedDisk
from optimisation.measures import format_number
from optimisation.report.figures import MM, figure_of
from optimisation.report.report import Table
from optimisation.statistics import prediction_interval

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
    figure.suptitle(title, fontsize=10)
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
