"""The answers of `design gap --load` in words, as JSON, rows and a figure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from optimisation.files import number
from optimisation.gap_advice import Advice, Answer
from optimisation.load_cases import AppliedLoads
from optimisation.measures import DECAY, DISPLAY_UNITS, LABELS, START, UNITS
from optimisation.report.comparison_tables import LOAD_END_WARNING, reading_in_words
from optimisation.report.figures import BLUE, GREEN, ORANGE, figure_of, force_axis, write_figure
from optimisation.report.gap_report import SUBS, answer_values, band_in_words, device

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Json = dict[str, object]
COLUMNS = ("gap_m", "member", "value")


def rows(advice: Advice) -> Iterator[tuple[object, ...]]:
    """Yield every run with an absorber: its measure in SI units."""
    for gap, curve in zip(advice.check.gaps, advice.check.curves, strict=True):
        values = curve.combined[0]
        yield from ((float(gap), member, float(value)) for member, value in enumerate(values))


def loads_of(advice: Advice) -> AppliedLoads:
    """Return the loads of a search."""
    assert isinstance(advice.case, AppliedLoads)
    return advice.case


def summary(advice: Advice) -> Json:
    """Return answers and settings as JSON values; measures under their own names, as ``rms_m``."""
    check = advice.check
    measure = advice.case.measure
    unit = UNITS[measure]
    return {
        "complete": advice.complete,
        "recommended": answer_values(advice.recommended, check.mass, measure, unit),
        "sharp": answer_values(advice.sharp, check.mass, measure, unit),
        "rule_gap_m": number(check.rule),
        "free_rms_m": loads_of(advice).free_size,
        "measure": measure,
        f"{measure}_without_absorber_{unit}": number(check.without.median[0]),
        "settings": {
            "force_tolerance": advice.tolerance,
            "members": advice.members,
            "level_frequency_hz": number(advice.reading.hertz),
            "runs": sum(len(curve.members) for curve in check.curves),
        },
    }


def text(advice: Advice) -> str:
    """Return the lines that are printed."""
    case = loads_of(advice)
    check = advice.check
    factor, unit = DISPLAY_UNITS[UNITS[case.measure]]
    best = advice.recommended
    sharp = advice.sharp
    if best is None or sharp is None:
        return "No gap was simulated in full."
    t = advice.tolerance
    without = float(check.without.median[0])
    what = LABELS[case.measure]

    def level(answer: Answer) -> str:
        band = f"{factor * answer.level:.4g} {unit}{band_in_words(answer, factor)}"
        worst = (
            "not known"
            if math.isnan(answer.worst)
            else f"at most {factor * answer.worst:.4g} {unit}"
        )
        runs = f"median of {answer.members} runs" if answer.members > 1 else "one run"
        return f"{band}, {runs}, {100 * answer.level / without:.1f} % of no absorber; {worst} from {1 - t:.4g} to {1 + t:.4g} times the load"

    lines = [
        f"Recommended: {device(best, check.mass)}, under {case.loads.describe()}.",
        f"  {what[0].upper()}{what[1:]} {level(best)}{reading_in_words(advice.reading)}.",
    ]
    if sharp.gap != best.gap:
        lines.append(f"Lowest {what}: {1e3 * sharp.gap:.4g} mm, {level(sharp)}.")
    if math.isnan(check.rule):
        size_of = "largest displacement over the root of two" if case.measure == DECAY else "RMS"
        size = f"{size_of} at the absorber, {1e3 * case.free_size:.4g} mm"
        lines.append(
            f"No rule for this load: the search began at {START:g} times the free motion's {size}."
        )
    else:
        lines.append(f"Design rule (no simulation): {1e3 * check.rule:.4g} mm.")
    if advice.reading.at_end:
        lines.append(f"Warning: {LOAD_END_WARNING}.")
    if best.level >= without:
        lines.append(
            f"Warning: no gap brings the {what} below that without absorber: another place or mass may suit better."
        )
    return "\n".join(lines)


def draw_measures(advice: Advice) -> Figure:
    """Draw the measure over the gap, with the answers."""
    case = loads_of(advice)
    check = advice.check
    factor, unit = DISPLAY_UNITS[UNITS[case.measure]]
    figure, axes = figure_of(6.4, 4.4)
    low, high = factor * advice.band
    middle = factor * check.level
    gaps = 1e3 * check.gaps
    most = max((len(curve.members) for curve in check.curves), default=0)
    axes.fill_between(gaps, low, high, color=BLUE, alpha=0.25, lw=0)
    axes.plot(
        gaps,
        middle,
        "o-",
        color=BLUE,
        ms=5,
        label=f"median of up to {most} runs, 90 % of further runs",
    )
    axes.axhline(
        factor * float(check.without.median[0]), color="black", lw=0.8, label="no absorber"
    )
    for answer, colour, word in (
        (advice.sharp, "black", f"lowest {LABELS[case.measure]}"),
        (advice.recommended, GREEN, "recommended"),
    ):
        if answer is None:
            continue
        axes.axvline(
            1e3 * answer.gap,
            color=colour,
            lw=1.6,
            ls="--" if colour == "black" else "-",
            label=f"{word}: {1e3 * answer.gap:.3g} mm",
        )
    if not math.isnan(check.rule):
        axes.axvline(
            1e3 * check.rule,
            color=ORANGE,
            lw=1.4,
            ls="--",
            label=f"design rule: {1e3 * check.rule:.3g} mm",
        )
    axes.set_xscale("log")
    force_axis(axes.xaxis, SUBS)
    axes.set_ylim(0, None)
    axes.set_xlabel("clearance to either wall in mm")
    axes.set_ylabel(f"{LABELS[case.measure]} in {unit}")
    axes.set_title(f"Gap under {case.loads.describe()}", fontsize=11)
    axes.legend(frameon=False, fontsize=9)
    return figure


def save_figure(path: Path, advice: Advice) -> None:
    """Write the figure of `draw_measures`; the ending of ``path`` chooses the format."""
    write_figure(draw_measures(advice), path)
