"""The content of comparisons of absorbers, near resonances and under loads.

Quantities are in SI units unless stated otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import DOWN, UP, Optimum, PerformanceCurve, quantiles
from impact_env.laws import SceneKind, describe_absorber, values
from impact_env.parameters import SlidingAbsorber, TunedAbsorber
from impact_env.scene import Scene
from optimisation.bounds import LEAST_REACH
from optimisation.comparison import (
    IMPACT,
    NONE,
    BandComparison,
    Comparison,
    Concept,
    LoadComparison,
    ResonanceComparison,
)
from optimisation.files import number, numbers
from optimisation.frequency_levels import ResonanceCurves
from optimisation.load_cases import Reading
from optimisation.measures import LABELS, UNITS, prediction_band, prediction_interval
from optimisation.report.design_figures import draw_comparison
from optimisation.report.frequency_report import (
    frequency_charts,
    frequency_figures,
    frequency_tables,
)
from optimisation.report.report import (
    NO_DEVICE,
    Chart,
    Curve,
    Group,
    Json,
    Report,
    Row,
    Table,
    assumed_rows,
    between,
    device_rows,
    draw_charts,
    service_rows,
    with_band,
)
from optimisation.service import EFFECTIVE_RATIO, ImpactLoads, contiguous_range
from optimisation.sweep_range import LEAST_RATIO, find_reading_ratios, is_at_end, reading_in_words
from optimisation.tuned.under_loads import TunedForLoads

Array = NDArray[np.float64]
LIMIT = "limit"
MM = 1e3
DIRECTIONS = {UP: "up", DOWN: "down"}
RUN_COLUMNS = (
    *("resonance", "concept", "force_n", "member", "phase_rad", "force_factor", "direction"),
    *("response_level_m", "level_frequency_ratio", "level_time_s", "max_tip_m", "impacts"),
    "stuck_time_s",
)
CURVE_COLUMNS = (
    *("resonance", "concept", "force_n", "members"),
    *("level_median_m", "level_5_percent_m", "level_95_percent_m"),
    *("level_up_median_m", "level_down_median_m"),
    *("relative_median", "relative_5_percent", "relative_95_percent", "level_frequency_ratio"),
)


def run_table(comparison: Comparison) -> Table:
    """Return a row for each finished run.

    The rows of linear concepts are one run scaled by the force.
    """
    rows = []
    for part in comparison.resonances:
        for key, curve in part.curves.items():
            lanes = curve.lanes
            names = (
                lanes.level,
                lanes.frequency_ratio,
                lanes.time,
                lanes.max_tip,
                lanes.impacts,
                lanes.stuck_time,
            )
            for k, m, d in zip(*np.nonzero(~np.isnan(lanes.level)), strict=True):
                level, ratio, time, tip, impacts, stuck = (float(one[k, m, d]) for one in names)
                member = (int(m), float(curve.members.phases[m]), float(curve.members.factors[m]))
                start = (part.resonance, key, float(part.forces[k]), *member, DIRECTIONS[int(d)])
                rows.append((*start, level, ratio, time, tip, int(impacts), stuck))
    return Table.of_values(RUN_COLUMNS, rows)


def curve_table(comparison: Comparison) -> Table:
    """Return a row for each concept and force, and for the limit.

    The cell of a result that is not finished is empty.
    """
    rows: list[tuple[object, ...]] = []
    for part in comparison.resonances:
        for key, curve in part.curves.items():
            levels = np.vstack([curve.median, prediction_band(curve.combined)])
            ratios = find_reading_ratios(curve)
            directions = quantiles(np.moveaxis(curve.level, 2, 0), (0.5,))[0]
            shares = curve.relative_to(part.curves[NONE])
            relative = np.vstack([quantiles(shares, (0.5,)), prediction_band(shares)])
            members = np.sum(~np.isnan(curve.combined), axis=1)
            for k, force in enumerate(part.forces):
                cells = [*levels[:, k], *directions[:, k], *relative[:, k], ratios[k]]
                start = (part.resonance, key, float(force), int(members[k]))
                rows.append((*start, *map(float, cells)))
        for force, limit in zip(part.forces, part.limit, strict=True):
            rows.append((part.resonance, LIMIT, float(force), None, float(limit), *[None] * 8))
    return Table.of_values(CURVE_COLUMNS, rows)


def _with_intervals(curve: PerformanceCurve, none: PerformanceCurve, point: Optimum) -> Optimum:
    """Return a point of a curve with bands of 90 %.

    The bands of its levels hold 90 % of further runs (`prediction_interval`). The band of its force
    holds 90 % of their best forces.
    """
    k = int(np.flatnonzero(curve.forces == point.force)[0])
    relative = curve.relative_to(none)
    ran = ~np.isnan(relative).all(axis=0)
    best = np.argmin(np.where(np.isnan(relative), np.inf, relative), axis=0)[ran]
    level, share = (
        tuple(prediction_band(values)[:, k].tolist()) for values in (curve.combined, relative)
    )
    low, high = np.clip(prediction_interval(curve.forces[best]), curve.forces[0], curve.forces[-1])
    force = (float(low), float(high))
    return replace(point, force_band=force, level_band=level, relative_band=share)


def _relative(point: Optimum) -> Json:
    return {
        "relative_to_no_absorber": number(point.relative),
        "relative_5_to_95_percent": numbers(point.relative_band),
    }


def _at(point: Optimum) -> Json:
    level = {
        "response_level_m": number(point.level),
        "response_level_5_to_95_percent_m": numbers(point.level_band),
    }
    return {"force_n": point.force, **level, **_relative(point)}


def _at_index(curve: PerformanceCurve, none: PerformanceCurve, k: int) -> Json:
    """Return level, relative level, and where the level was read, at a force."""
    values = _at(_with_intervals(curve, none, curve.at(k, none)))
    return values | {"level_frequency_ratio": number(find_reading_ratios(curve)[k])}


def _linear(comparison: Comparison, concept: Concept) -> bool:
    return Scene(comparison.model, concept.absorber).kind is SceneKind.LINEAR


def _concept_summary(comparison: Comparison, part: ResonanceComparison, concept: Concept) -> Json:
    """Return a concept's results.

    The best force of a linear concept is null, because its relative level does not depend on the
    force.
    """
    curve = part.curves[concept.key]
    none = part.curves[NONE]
    optimum = curve.optimum(none)
    if optimum is not None:
        optimum = _with_intervals(curve, none, optimum)
    parameters = (
        {}
        if concept.absorber is None
        else {name: value for name, value in asdict(concept.absorber).items() if value is not None}
    )
    summary: Json = {
        "label": concept.label,
        "sweep_limits": list(part.limits_of(concept)),
        "absorber": parameters,
        "complete": curve.complete,
    }
    if optimum is not None and _linear(comparison, concept):
        summary["optimum"] = {"force_n": None, **_relative(optimum)}
    elif optimum is not None:
        summary["optimum"] = {
            **_at(optimum),
            "force_5_to_95_percent_n": numbers(optimum.force_band),
        }
    if part.best is not None:
        summary["at_best_force_of_impact_absorber"] = _at_index(curve, none, part.best)
    if part.reported_index is not None and part.own_force is not None:
        summary["at_the_force"] = _at_index(curve, none, part.reported_index)
    return summary


def summary(comparison: Comparison) -> Json:
    """Return the study's result as JSON values."""
    model = comparison.model
    return {
        "complete": comparison.complete,
        "settings": {
            "members": comparison.members,
            "seed": comparison.seed,
            "modes": model.modes,
            "gap_m": comparison.gap,
            "mass_ratio": comparison.mass_ratio,
            "beam_mass_kg": model.beam_mass,
            "damping_ratio": model.damping_ratio.tolist(),
            "percent_per_100_pseudo_periods": comparison.percent_per_100_periods,
            "level": (
                "larger of sweep up and sweep down; median of the members, and the interval that "
                "holds 90 % of further runs"
            ),
        },
        "resonances": {
            str(part.resonance): {
                "omega_rad_s": part.omega,
                "forces_n": part.forces.tolist(),
                "limit_m": part.limit.tolist(),
                "design_force_n": part.design_force,
                "sweep_over_stationary_level": number(part.sweep_ratio),
                "concepts": {
                    one.key: _concept_summary(comparison, part, one)
                    for one in comparison.concepts
                    if one.key in part.curves
                },
            }
            for part in comparison.resonances
        },
    }


def _with_band(value: float, band: tuple[float, float], pattern: str) -> str:
    """Return a value with its band in brackets.

    The band is left out if all members agree to the digits shown.
    """
    if math.isnan(value):
        return "-"
    return with_band(value, *band, pattern)


def _row(comparison: Comparison, part: ResonanceComparison, concept: Concept) -> list[str]:
    curve = part.curves[concept.key]
    none = part.curves[NONE]
    optimum = curve.optimum(none)
    if optimum is None or part.reported_index is None:
        return [concept.label, *["-"] * 5]
    optimum = _with_intervals(curve, none, optimum)
    here = _with_intervals(curve, none, curve.at(part.reported_index, none))
    ratio = float(find_reading_ratios(curve)[part.reported_index])
    at_end = is_at_end(ratio, part.limits_of(concept), comparison.percent_per_100_periods)
    best = (
        "any"
        if _linear(comparison, concept)
        else _with_band(optimum.force, optimum.force_band, "{:.3g}")
    )
    own, level = (
        _with_band(100 * x.relative, (100 * x.relative_band[0], 100 * x.relative_band[1]), "{:.1f}")
        for x in (optimum, here)
    )
    return [
        concept.label,
        best,
        own,
        _with_band(
            1e3 * here.level, (1e3 * here.level_band[0], 1e3 * here.level_band[1]), "{:.3f}"
        ),
        level,
        f"{ratio:.3f}{' (end)' if at_end else ''}",
    ]


def resonance_block(comparison: Comparison, part: ResonanceComparison) -> list[str | Table]:
    """Return the lines and the table of one resonance."""
    finished = int(np.max(np.sum(~np.isnan(part.curves[IMPACT].combined), axis=1)))
    at = "the best force"
    if part.reported_index is not None:
        at = f"{part.forces[part.reported_index]:.3g} N"
    headings = (
        *("concept", "best force, N", "level there, %"),
        *(f"level at {at}, mm", f"level at {at}, %", "read at"),
    )
    rows = [
        _row(comparison, part, concept)
        for concept in comparison.concepts
        if concept.key in part.curves
    ]
    if part.reported_index is not None:
        limit = f"{MM * part.limit[part.reported_index]:.3f}"
        rows.append([f"limit within a cavity of ±{MM * part.gap:.4g} mm", "", "", limit, "", ""])
    title = (
        f"Resonance {part.resonance} ({part.omega / (2 * np.pi):.1f} Hz), {finished} of "
        f"{comparison.members} members"
    )
    lines: list[str | Table] = [title, Table.of_words(headings, rows)]
    if not math.isnan(part.sweep_ratio):
        lines.append(f"sweeps without absorber show {part.sweep_ratio:.3f} of the stationary level")
    where = " at the absorber's place" if comparison.model.response_shape is not None else ""
    rule = (
        f"design rule: {part.design_force:.3g} N is the force at which the limit{where} leaves zero"
    )
    if comparison.own_structure:
        rule += f"; the free amplitude is {part.reach:.3g} gaps there"
        rule += ", so that no wall is touched" if part.reach < LEAST_REACH else ""
    return [*lines, rule]


def text_blocks(comparison: Comparison) -> list[list[str | Table]]:
    """Return the printed text, a block for each resonance.

    Levels in % are relative to the structure without absorber.
    """
    notes: list[str | Table] = [
        (
            "Median; in brackets the interval that holds 90 % of further runs. Levels in % are "
            "relative to no absorber."
        ),
        "Read at: frequency over the resonance at which the level was read.",
    ]
    ends = concepts_read_at_end(comparison)
    if ends:
        notes.append(f"Warning: {END_WARNING}: {'; '.join(ends)}.")
    return [*(resonance_block(comparison, part) for part in comparison.resonances), notes]


def make_report(
    comparison: Comparison,
    impacts: ImpactLoads | None = None,
    frequency: Sequence[ResonanceCurves] = (),
    conditions: Mapping[str, object] | None = None,
) -> Report:
    """Return the content of a comparison.

    ``impacts`` near the first resonance, if known; ``frequency``: levels over the frequency;
    ``conditions``: what else summary.json has.
    """
    labels = {concept.key: concept.label for concept in comparison.concepts}
    charts = (comparison_chart(part, labels) for part in comparison.resonances)
    return Report(
        title="Absorbers of one mass compared",
        verdict=" ".join(lowest_line(comparison, part) for part in comparison.resonances).strip(),
        text=text_blocks(comparison),
        numbers={**(conditions or {}), **summary(comparison)},
        tables={
            "runs.csv": run_table(comparison),
            "curves.csv": curve_table(comparison),
            **frequency_tables(frequency),
        },
        figures={
            "comparison.png": partial(draw_comparison, comparison),
            **frequency_figures(frequency),
        },
        groups=card_groups(comparison, impacts),
        charts=(*charts, *frequency_charts(frequency)),
        warnings=card_warnings(comparison),
    )


def lowest_line(comparison: Comparison, part: ResonanceComparison) -> str:
    """Return a text with the absorber of the lowest level near a resonance.

    It is that at the force of the comparison. The text is empty without finished runs.
    """
    k = part.reported_index
    if k is None:
        return ""
    medians = {key: float(curve.median[k]) for key, curve in part.curves.items()}
    best = min(medians, key=lambda key: np.inf if math.isnan(medians[key]) else medians[key])
    labels = {concept.key: concept.label for concept in comparison.concepts}
    share = 100 * medians[best] / medians[NONE]
    return (
        f"Lowest level at {part.forces[k]:.3g} N near resonance {part.resonance}: {labels[best]}, "
        f"{share:.1f} % of no absorber."
    )


def card_groups(comparison: Comparison, impacts: ImpactLoads | None) -> tuple[Group, ...]:
    """Return the groups of the card of a comparison.

    They are the impact absorber, the levels of all absorbers at one force near each resonance, and
    assumptions.
    """
    own = next(concept.absorber for concept in comparison.concepts if concept.key == IMPACT)
    assert isinstance(own, SlidingAbsorber)
    others = []
    for concept in comparison.concepts:
        if concept.key in (NONE, IMPACT):
            continue
        absorber = concept.absorber
        friction = getattr(absorber, "friction", None)
        parameters = ""
        if isinstance(absorber, TunedAbsorber):
            parameters = f"{absorber.stiffness:.6g} N/m, {absorber.damping:.4g} N s/m"
        elif friction is not None:
            parameters = f"friction limit {friction.limit:.4g} N"
        others.append(Row(concept.label, parameters))
    groups: list[Group] = [
        ("Impact absorber", device_rows(own, comparison.model)),
        ("Others of its mass", tuple(others)),
    ]
    for part in comparison.resonances:
        k = part.reported_index
        if k is None:
            continue
        heading = f"Resonance {part.resonance}, at {part.forces[k]:.3g} N"
        groups.append((heading, _levels(comparison, part, k)))
        if part is comparison.resonances[0] and impacts is not None:
            level = float(part.curves[IMPACT].median[k])
            groups.append(("What it bears there", service_rows(comparison.gap, impacts, level)))
    numbers_of_resonances = [part.resonance for part in comparison.resonances]
    swept = (
        Row(
            f"resonance {part.resonance} swept over",
            f"{part.limits[0]:.3g} to {part.limits[1]:.3g} of it",
        )
        for part in comparison.resonances
    )
    assumed = (
        *assumed_rows(comparison.model, numbers_of_resonances, comparison.percent_per_100_periods),
        *swept,
        Row("in brackets", "the interval that holds 90 % of further runs"),
    )
    return (*groups, ("Assumptions", assumed))


def card_warnings(comparison: Comparison) -> tuple[str, ...]:
    """Return what the card warns of."""
    warnings = []
    for part in comparison.resonances:
        name = f"Resonance {part.resonance}"
        if part.sweep_ratio < LEAST_RATIO:
            warnings.append(
                f"{name}: sweeps show {part.sweep_ratio:.3f} of the stationary level; sweep "
                "more slowly"
            )
        if part.reach < 1:
            warnings.append(
                f"{name}: the structure does not move as far as the rule's gap, and no wall "
                "is touched there"
            )
    ends = concepts_read_at_end(comparison)
    if ends:
        warnings.append(f"{END_WARNING}: {'; '.join(ends)}")
    return tuple(warnings)


def _levels(comparison: Comparison, part: ResonanceComparison, k: int) -> tuple[Row, ...]:
    labels = {concept.key: concept.label for concept in comparison.concepts}
    ranges = {concept.key: part.limits_of(concept) for concept in comparison.concepts}
    none = MM * part.curves[NONE].median[k]
    rows = []
    for key, curve in part.curves.items():
        level = MM * curve.median[k]
        low, high = MM * prediction_band(curve.combined)[:, k]
        ratio = float(find_reading_ratios(curve)[k])
        where = reading_in_words(ratio, ranges[key], comparison.percent_per_100_periods)
        words = f"{with_band(level, low, high, unit='mm')}, {100 * level / none:.3g} %"
        rows.append(Row(labels[key], f"{words}, read at {where}"))
    halves = contiguous_range(
        part.forces, part.curves[IMPACT].median < EFFECTIVE_RATIO * part.curves[NONE].median, k
    )
    return (
        *rows,
        Row(NO_DEVICE, MM * float(part.limit[k]), "mm"),
        Row(f"the {labels[IMPACT]} halves the level", between(*halves)),
    )


def comparison_chart(part: ResonanceComparison, labels: Mapping[str, str]) -> Chart:
    """Return the levels near a resonance over the force."""
    curves = []
    for key, curve in part.curves.items():
        low, high = MM * prediction_band(curve.combined)
        middle = MM * curve.median
        ends = (numbers(low), numbers(high))
        curves.append(Curve(labels[key], numbers(part.forces), numbers(middle), *ends))
    what = "the force" if part.own_force is not None else f"best of the {labels[IMPACT]}"
    best = () if part.reported_index is None else ((what, float(part.forces[part.reported_index])),)
    return Chart(
        f"Resonance {part.resonance}",
        "force in N",
        "level in mm (RMS)",
        tuple(curves),
        best,
        log_x=True,
        log_y=True,
    )


END_WARNING = (
    "read at an end of the sweeps, beyond which the level may be larger (another resonance "
    "decides, or the start of the sweep)"
)


def concepts_read_at_end(comparison: Comparison) -> list[str]:
    """Return texts for the absorbers whose level was read at an end of their sweeps.

    They are those at the force of the comparison.
    """
    values = []
    for part in comparison.resonances:
        if part.reported_index is None:
            continue
        for concept in comparison.concepts:
            if concept.key in part.curves:
                ratio = float(find_reading_ratios(part.curves[concept.key])[part.reported_index])
                limits = part.limits_of(concept)
                if is_at_end(ratio, limits, comparison.percent_per_100_periods):
                    values.append(f"{concept.label} near resonance {part.resonance}")
    return values


LOAD_LABELS = {
    "impact": "impact absorber",
    "friction": "friction damper",
    "tuned": "tuned absorber",
}


def load_run_table(comparison: LoadComparison) -> Table:
    """Return every run under loads."""
    rows = []
    for concept in comparison.concepts:
        bands = np.stack([band.curves[concept.key].combined for band in comparison.bands], axis=2)
        for factor, runs in zip(comparison.factors, bands, strict=True):
            rows += [
                (concept.key, float(factor), *place, float(value))
                for place, value in np.ndenumerate(runs)
            ]
    return Table.of_values(("concept", "factor", "member", "band", "value"), rows)


def load_summary(comparison: LoadComparison) -> dict[str, Any]:
    """Return the comparison's results and the absorbers.

    The results are medians and bands of the measure over that without absorber.
    """
    return {
        "measure": comparison.case.measure,
        "unit": UNITS[comparison.case.measure],
        "band_edges_hz": [band.low for band in comparison.bands],
        "factors": comparison.factors.tolist(),
        "free_size_m": comparison.free_size,
        "level_frequency_hz": {
            name: number(reading.hertz) for name, reading in comparison.readings.items()
        },
        "absorbers": {name: values(absorber) for name, absorber in comparison.absorbers.items()},
        "without_absorber": [
            np.median(band.curves[NONE].combined, axis=1).tolist() for band in comparison.bands
        ],
        "ratio_5_50_95": {
            name: [
                [numbers(point) for point in ratio_interval(band, name)]
                for band in comparison.bands
            ]
            for name in LOAD_LABELS
        },
    }


LOAD_END_WARNING = "a level was read at an end of the schedule, beyond which it may be larger"


def load_reading_in_words(reading: Reading) -> str:
    """Return a text that says where a level under loads was read.

    It follows the level in a sentence, and is empty for other measures.
    """
    return "" if math.isnan(reading.hertz) else f", read at {reading.hertz:.4g} Hz"


def ratio_interval(band: BandComparison, name: str) -> Array:
    """Return an absorber's measure over that without absorber, (F, 3).

    The columns are the lower end, the median and the upper end of the interval of 90 % of further
    runs.
    """
    ratio = band.relative(name)
    low, high = prediction_band(ratio)
    return np.stack([low, np.median(ratio, axis=1), high], axis=1)


def _heads(comparison: LoadComparison) -> list[str]:
    """Return the bands' names; none where there is but one."""
    if len(comparison.bands) == 1:
        return [""]
    return [
        f"{band.low:.3g} Hz and above"
        if np.isinf(band.high)
        else f"{band.low:.3g} to {band.high:.3g} Hz"
        for band in comparison.bands
    ]


def load_text_blocks(comparison: LoadComparison) -> list[list[str | Table]]:
    """Return what is printed: absorbers, and a table for each band of frequencies."""
    runs = len(comparison.bands[0].curves[NONE].members)
    what = f"{LABELS[comparison.case.measure]} under {comparison.case.loads.describe()}"
    lines: list[str | Table] = [
        f"{what}, over that without absorber: median of {runs} runs (90 % of further runs)"
    ]
    lines += [
        f"  {describe_absorber(absorber)}{load_reading_in_words(comparison.readings[name])}"
        for name, absorber in comparison.absorbers.items()
    ]
    blocks = [lines]
    headings = ("intensity", *LOAD_LABELS.values())
    for band, head in zip(comparison.bands, _heads(comparison), strict=True):
        intervals = {name: ratio_interval(band, name) for name in LOAD_LABELS}
        rows = []
        for k, factor in enumerate(comparison.factors):
            cells = (
                f"{middle:.3f}" + (f" ({low:.2f} to {high:.2f})" if high > low else "")
                for low, middle, high in (intervals[name][k] for name in LOAD_LABELS)
            )
            rows.append((f"{factor:.3g}", *cells))
        table = Table.of_words(headings, rows)
        blocks.append([head, table] if head else [table])
    return [*blocks, [f"Warning: {line}." for line in load_warnings(comparison)]]


def load_warnings(comparison: LoadComparison) -> tuple[str, ...]:
    """Return a warning where a level was read at an end of the loads."""
    at_end = any(reading.at_end for reading in comparison.readings.values())
    return (LOAD_END_WARNING,) if at_end else ()


def make_load_report(
    comparison: LoadComparison, conditions: Mapping[str, object] | None = None
) -> Report:
    """Return the content of a comparison under loads.

    ``conditions``: further content of summary.json.
    """
    charts = load_charts(comparison)
    return Report(
        title=f"Absorbers of one mass under {comparison.case.loads.describe()}",
        verdict=least_line(comparison),
        text=load_text_blocks(comparison),
        numbers={**(conditions or {}), **load_summary(comparison)},
        tables={"runs.csv": load_run_table(comparison)},
        figures={"comparison.png": partial(draw_charts, charts)},
        groups=load_card_groups(comparison),
        charts=charts,
        warnings=load_warnings(comparison),
    )


def tuned_summary(tuned: TunedForLoads) -> dict[str, Any]:
    """Return the tunings, and the measure with each of them over that without absorber.

    The measure is the median over the members.
    """
    ratios = np.median(tuned.ratios, axis=1)
    tunings = zip(("best", "least_peak"), (tuned.best, tuned.peak), ratios, strict=True)
    return {"measure": tuned.measure} | {
        name: values(absorber) | {"ratio": float(ratio)} for name, absorber, ratio in tunings
    }


def make_tuned_report(tuned: TunedForLoads) -> Report:
    """Return the content of tunings for loads."""
    ratios = 100 * tuned.ratios
    lines = [
        (
            f"{LABELS[tuned.measure]} under {tuned.loads.describe()}, in % of that without "
            f"absorber: median of {ratios.shape[1]} runs"
        )
    ]
    for name, absorber, row in zip(
        ("best for it", "least peak"), (tuned.best, tuned.peak), ratios, strict=True
    ):
        lines.append(
            f"  {name}: {with_band(np.median(row), row.min(), row.max())}, "
            f"{describe_absorber(absorber)}"
        )
    title = f"Tuned absorber for {tuned.loads.describe()}"
    return Report(title=title, text=[lines], numbers=tuned_summary(tuned))


def load_charts(comparison: LoadComparison) -> tuple[Chart, ...]:
    """Return what each absorber leaves over the loads' intensity, for each band of frequencies."""
    charts = []
    under = f"Under {comparison.case.loads.describe()}"
    for band, head in zip(comparison.bands, _heads(comparison), strict=True):
        factors = numbers(comparison.factors)
        curves = []
        for name, label in LOAD_LABELS.items():
            low, middle, high = ratio_interval(band, name).T
            curves.append(Curve(label, factors, numbers(middle), numbers(low), numbers(high)))
        curves.append(Curve("no absorber", factors, [1.0] * len(factors)))
        charts.append(
            Chart(
                ", ".join(filter(None, (under, head))),
                "intensity of the load, 1: as given",
                f"{LABELS[comparison.case.measure]} over that without absorber",
                tuple(curves),
                log_x=True,
            )
        )
    return tuple(charts)


def least_line(comparison: LoadComparison) -> str:
    """Return a text with the absorber of the lowest measure, at the intensity nearest the given.

    If there are several bands, its measure is that of its worst band.
    """
    k = int(np.argmin(np.abs(np.log(comparison.factors))))
    left = {
        name: max(float(ratio_interval(band, name)[k, 1]) for band in comparison.bands)
        for name in LOAD_LABELS
    }
    best = min(left, key=lambda name: left[name])
    what = LABELS[comparison.case.measure]
    return (
        f"Least {what} at intensity {comparison.factors[k]:.3g}: {LOAD_LABELS[best]}, "
        f"{left[best]:.3f} of that without absorber."
    )


def load_card_groups(comparison: LoadComparison) -> tuple[Group, ...]:
    """Return the absorbers, and what each leaves at the intensity nearest to that given."""
    k = int(np.argmin(np.abs(np.log(comparison.factors))))
    groups: list[Group] = [
        (
            "Absorbers",
            tuple(
                Row(LOAD_LABELS[name], describe_absorber(absorber))
                for name, absorber in comparison.absorbers.items()
            ),
        )
    ]
    measure = LABELS[comparison.case.measure]
    for band, head in zip(comparison.bands, _heads(comparison), strict=True):
        rows = []
        for name, label in LOAD_LABELS.items():
            low, middle, high = ratio_interval(band, name)[k]
            rows.append(Row(label, with_band(middle, low, high, "{:.3f}")))
        heading = f"{measure} over that without absorber, intensity {comparison.factors[k]:.3g}"
        groups.append((", ".join(filter(None, (heading, head))), tuple(rows)))
    assumed = (
        Row("loads", comparison.case.loads.describe()),
        *assumed_rows(comparison.case.model, (), None),
        Row("in brackets", "the interval that holds 90 % of further runs"),
    )
    return (*groups, ("Assumptions", assumed))
