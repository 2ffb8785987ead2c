"""The answers of `design gap --load` in words, as JSON, rows and a figure."""

from __future__ import annotations

import math
from functools import partial

from optimisation.files import number, numbers
from optimisation.gap_advice import Advice, Answer
from optimisation.load_cases import AppliedLoads
from optimisation.measures import DECAY, DISPLAY_UNITS, LABELS, START, UNITS
from optimisation.report.comparison_report import LOAD_END_WARNING, load_reading_in_words
from optimisation.report.gap_report import answer_values, band_in_words, device
from optimisation.report.report import (
    MM,
    Chart,
    Curve,
    Group,
    Json,
    Report,
    Row,
    Table,
    assumed_rows,
    device_rows,
    draw_charts,
)


def run_table(advice: Advice) -> Table:
    """Return every run with an absorber: its measure in SI units."""
    rows = [
        (float(gap), member, float(value))
        for gap, curve in zip(advice.check.gaps, advice.check.curves, strict=True)
        for member, value in enumerate(curve.combined[0])
    ]
    return Table.of_values(("gap_m", "member", "value"), rows)


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


def lines_of(advice: Advice) -> list[str]:
    """Return the lines that are printed."""
    case = loads_of(advice)
    check = advice.check
    factor, unit = DISPLAY_UNITS[UNITS[case.measure]]
    best = advice.recommended
    sharp = advice.sharp
    if best is None or sharp is None:
        return ["No gap was simulated in full."]
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
        return (
            f"{band}, {runs}, {100 * answer.level / without:.1f} % of no absorber; {worst} from "
            f"{1 - t:.4g} to {1 + t:.4g} times the load"
        )

    lines = [
        f"Recommended: {device(best, check.mass)}, under {case.loads.describe()}.",
        f"  {what[0].upper()}{what[1:]} {level(best)}{load_reading_in_words(advice.reading)}.",
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
    lines += [f"Warning: {line}." for line in warnings(advice)]
    return lines


def make_report(advice: Advice, card: bool = True) -> Report:
    """Return the content of the answer; ``card``: with the recommended device's card."""
    chart = gap_chart(advice)
    best = advice.recommended
    lines = lines_of(advice)
    return Report(
        verdict=lines[0],
        title=f"Gap of an impact absorber under {loads_of(advice).loads.describe()}",
        text=[lines],
        numbers=summary(advice),
        tables={"runs.csv": run_table(advice)},
        figures={"levels.png": partial(draw_charts, [chart])},
        groups=card_groups(advice, best) if card and best is not None else (),
        charts=(chart,),
        warnings=tuple(warnings(advice)),
    )


def card_groups(advice: Advice, best: Answer) -> tuple[Group, ...]:
    """Return the recommended device, what is measured, and assumptions."""
    case = loads_of(advice)
    check = advice.check
    factor, unit = DISPLAY_UNITS[UNITS[case.measure]]
    without = float(check.without.median[0])
    interval = None
    if best.prediction is not None:
        interval = f"{factor * best.low:.4g} to {factor * best.high:.4g} {unit}"
    t = advice.tolerance
    measured = (
        Row(f"median of {best.members} runs", factor * best.level, unit),
        Row("90 % of further runs", interval),
        Row(f"at most, {1 - t:.4g} to {1 + t:.4g} times the load", factor * best.worst, unit),
        Row("of no absorber", 100 * best.level / without, "%"),
        Row("no absorber", factor * without, unit),
    )
    assumed = (
        Row("loads", case.loads.describe()),
        *assumed_rows(case.model, (), None),
        Row("runs", str(sum(len(curve.members) for curve in check.curves))),
    )
    what = LABELS[case.measure]
    return (
        ("Device", device_rows(best.absorber, case.model)),
        (what[0].upper() + what[1:], measured),
        ("Assumptions", assumed),
    )


def gap_chart(advice: Advice) -> Chart:
    """Return the measure over the gap, with the answers."""
    case = loads_of(advice)
    check = advice.check
    factor, unit = DISPLAY_UNITS[UNITS[case.measure]]
    low, high = factor * advice.band
    gaps = MM * check.gaps
    most = max((len(curve.members) for curve in check.curves), default=0)
    name = f"median of up to {most} runs, 90 % of further runs"
    levels = numbers(factor * check.level)
    ends = [float(min(gaps)), float(max(gaps))] if len(gaps) else []
    without = factor * float(check.without.median[0])
    marks = []
    if advice.sharp is not None:
        marks.append((f"lowest {LABELS[case.measure]}", MM * advice.sharp.gap))
    if advice.recommended is not None:
        marks.append(("recommended", MM * advice.recommended.gap))
    if not math.isnan(check.rule):
        marks.append(("design rule", MM * check.rule))
    return Chart(
        f"Gap under {case.loads.describe()}",
        "clearance to either wall in mm",
        f"{LABELS[case.measure]} in {unit}",
        (
            Curve(name, numbers(gaps), levels, numbers(low), numbers(high)),
            Curve("no absorber", ends, [without] * len(ends)),
        ),
        tuple(marks),
        log_x=True,
    )


def warnings(advice: Advice) -> list[str]:
    """Return what is to be known before the device is built."""
    best = advice.recommended
    lines = []
    if advice.reading.at_end:
        lines.append(LOAD_END_WARNING)
    if best is not None and best.level >= float(advice.check.without.median[0]):
        what = LABELS[advice.case.measure]
        lines.append(
            f"no gap brings the {what} below that without absorber: another place or mass may "
            "suit better"
        )
    return lines
