"""Comparisons of absorbers, near resonances and under loads, as numbers: rows for CSV files, a summary for JSON, a table to read. SI units."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import DOWN, UP, Optimum, PerformanceCurve, quantiles
from impact_env.laws import SceneKind, describe_absorber, values
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
from optimisation.load_cases import Reading
from optimisation.measures import LABELS, UNITS
from optimisation.report.card import with_band
from optimisation.report.figures import BLUE, GREEN, ORANGE, figure_of, write_figure
from optimisation.statistics import prediction_band, prediction_interval
from optimisation.sweep_range import find_reading_ratios, is_at_end
from optimisation.tuned.under_loads import TunedUnder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Json = dict[str, object]
LIMIT = "limit"
DIRECTIONS = {UP: "up", DOWN: "down"}
RUN = ("resonance", "concept", "force_n", "member", "phase_rad", "force_factor", "direction")
RUN_COLUMNS = (
    *RUN,
    "response_level_m",
    "level_frequency_ratio",
    "level_time_s",
    "max_tip_m",
    "impacts",
    "stuck_time_s",
)
LEVELS = (
    "level_median_m",
    "level_5_percent_m",
    "level_95_percent_m",
    "level_up_median_m",
    "level_down_median_m",
)
CURVE_COLUMNS = (
    "resonance",
    "concept",
    "force_n",
    "members",
    *LEVELS,
    "relative_median",
    "relative_5_percent",
    "relative_95_percent",
    "level_frequency_ratio",
)


def run_rows(comparison: Comparison) -> Iterator[tuple[object, ...]]:
    """Yield one row of `RUN_COLUMNS` for each finished run; those of linear concepts are one run scaled by the force."""
    for part in comparison.resonances:
        for key, curve in part.curves.items():
            lanes = curve.lanes
            for k, m, d in zip(*np.nonzero(~np.isnan(lanes.level)), strict=True):
                names = (
                    lanes.level,
                    lanes.frequency_ratio,
                    lanes.time,
                    lanes.max_tip,
                    lanes.impacts,
                    lanes.stuck_time,
                )
                level, ratio, time, tip, impacts, stuck = (
                    float(values[k, m, d]) for values in names
                )
                member = (int(m), float(curve.members.phases[m]), float(curve.members.factors[m]))
                start = (part.resonance, key, float(part.forces[k]), *member, DIRECTIONS[int(d)])
                yield (*start, level, ratio, time, tip, int(impacts), stuck)


def curve_rows(comparison: Comparison) -> Iterator[tuple[object, ...]]:
    """Yield one row of `CURVE_COLUMNS` for each concept and force, and for the limit; an empty cell where nothing is finished."""
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
                yield (
                    part.resonance,
                    key,
                    float(force),
                    int(members[k]),
                    *("" if math.isnan(x) else float(x) for x in cells),
                )
        for force, limit in zip(part.forces, part.limit, strict=True):
            yield (part.resonance, LIMIT, float(force), "", float(limit), *[""] * 8)


def _with_intervals(curve: PerformanceCurve, none: PerformanceCurve, point: Optimum) -> Optimum:
    """Return a point of a curve whose bands hold 90 % of further runs (`prediction_interval`), that of the force 90 % of their best forces."""
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
    """Return a concept's results; the best force of a linear one is null, as all forces are alike to it."""
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
            "level": "larger of sweep up and sweep down; median of the members, and the interval that holds 90 % of further runs",
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
    """Return a value with its band in brackets, without it if all members agree to the digits shown."""
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


def _block(comparison: Comparison, part: ResonanceComparison) -> list[str]:
    finished = int(np.max(np.sum(~np.isnan(part.curves[IMPACT].combined), axis=1)))
    at = (
        "the best force"
        if part.reported_index is None
        else f"{part.forces[part.reported_index]:.3g} N"
    )
    rows = [
        [
            "concept",
            "best force, N",
            "level there, %",
            f"level at {at}, mm",
            f"level at {at}, %",
            "read at",
        ]
    ]
    rows += [
        _row(comparison, part, concept)
        for concept in comparison.concepts
        if concept.key in part.curves
    ]
    if part.reported_index is not None:
        rows.append(
            [
                f"limit within a cavity of ±{1e3 * part.gap:.4g} mm",
                "",
                "",
                f"{1e3 * part.limit[part.reported_index]:.3f}",
                "",
                "",
            ]
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    title = f"Resonance {part.resonance} ({part.omega / (2 * np.pi):.1f} Hz), {finished} of {comparison.members} members"
    sweep = (
        f"sweeps without absorber show {part.sweep_ratio:.3f} of the stationary level"
        if not math.isnan(part.sweep_ratio)
        else ""
    )
    where = " at the absorber's place" if comparison.model.response_shape is not None else ""
    rule = (
        f"design rule: {part.design_force:.3g} N is the force at which the limit{where} leaves zero"
    )
    touched = (
        f"; the free amplitude is {part.reach:.3g} gaps there" if comparison.own_structure else ""
    )
    touched += (
        ", so that no wall is touched"
        if comparison.own_structure and part.reach < LEAST_REACH
        else ""
    )
    return [title, *lines, *([sweep] if sweep else []), rule + touched]


def text_table(comparison: Comparison) -> str:
    """Return the results as aligned text, one block a resonance; levels in % are relative to no absorber."""
    notes = [
        "Median; in brackets the interval that holds 90 % of further runs. Levels in % are relative to no absorber.",
        "Read at: frequency over the resonance at which the level was read.",
    ]
    ends = concepts_read_at_end(comparison)
    if ends:
        notes.append(f"Warning: {END_WARNING}: {'; '.join(ends)}.")
    return "\n\n".join(
        ["\n".join(_block(comparison, part)) for part in comparison.resonances] + ["\n".join(notes)]
    )


END_WARNING = "read at an end of the sweeps, beyond which the level may be larger (another resonance decides, or the start of the sweep)"


def concepts_read_at_end(comparison: Comparison) -> list[str]:
    """Return the absorbers, in words, whose level at the force of the comparison was read at an end of their sweeps."""
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


LOAD_COLUMNS = ("concept", "factor", "member", "band", "value")
LOAD_STYLES = {
    "impact": ("impact absorber", BLUE, "-"),
    "friction": ("friction damper", ORANGE, "-"),
    "tuned": ("tuned absorber", GREEN, "--"),
}


def load_rows(comparison: LoadComparison) -> Iterator[tuple[object, ...]]:
    """Yield every run."""
    for concept in comparison.concepts:
        bands = np.stack([band.curves[concept.key].combined for band in comparison.bands], axis=2)
        for factor, runs in zip(comparison.factors, bands, strict=True):
            yield from (
                (concept.key, float(factor), *place, float(value))
                for place, value in np.ndenumerate(runs)
            )


def load_summary(comparison: LoadComparison) -> dict[str, Any]:
    """Return the comparison's medians and bands of what is left of the measure without absorber, and the absorbers."""
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
            for name in LOAD_STYLES
        },
    }


LOAD_END_WARNING = "a level was read at an end of the schedule, beyond which it may be larger"


def reading_in_words(reading: Reading) -> str:
    """Return where a level was read under loads, in words that follow it; nothing for other measures."""
    return "" if math.isnan(reading.hertz) else f", read at {reading.hertz:.4g} Hz"


def ratio_interval(band: BandComparison, name: str) -> Array:
    """Return an absorber's measure over that without absorber, (F, 3): the median between the ends of the interval of 90 % of further runs."""
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


def load_table(comparison: LoadComparison) -> str:
    """Return the lines that are printed."""
    runs = len(comparison.bands[0].curves[NONE].members)
    what = f"{LABELS[comparison.case.measure]} under {comparison.case.loads.describe()}"
    lines = [f"{what}, over that without absorber: median of {runs} runs (90 % of further runs)"]
    lines += [
        f"  {describe_absorber(absorber)}{reading_in_words(comparison.readings[name])}"
        for name, absorber in comparison.absorbers.items()
    ]
    for band, head in zip(comparison.bands, _heads(comparison), strict=True):
        intervals = {name: ratio_interval(band, name) for name in LOAD_STYLES}
        lines += [f"  {head}"] if head else []
        lines.append("  intensity" + "".join(f"{LOAD_STYLES[name][0]:>24}" for name in LOAD_STYLES))
        for k, factor in enumerate(comparison.factors):
            cells = (
                f"{middle:.3f}" + (f" ({low:.2f} to {high:.2f})" if high > low else "")
                for low, middle, high in (intervals[name][k] for name in LOAD_STYLES)
            )
            lines.append(f"  {factor:9.3g}" + "".join(f"{cell:>24}" for cell in cells))
    if any(reading.at_end for reading in comparison.readings.values()):
        lines.append(f"Warning: {LOAD_END_WARNING}.")
    return "\n".join(lines)


def tuned_summary(tuned: TunedUnder) -> dict[str, Any]:
    """Return the tunings and what they leave of the measure without absorber, the median over the members."""
    ratios = np.median(tuned.ratios, axis=1)
    tunings = zip(("best", "least_peak"), (tuned.best, tuned.peak), ratios, strict=True)
    return {"measure": tuned.measure} | {
        name: values(absorber) | {"ratio": float(ratio)} for name, absorber, ratio in tunings
    }


def tuned_text(tuned: TunedUnder) -> str:
    """Return the lines that are printed of tunings."""
    ratios = 100 * tuned.ratios
    lines = [
        f"{LABELS[tuned.measure]} under {tuned.loads.describe()}, in % of that without absorber: median of {ratios.shape[1]} runs"
    ]
    for name, absorber, row in zip(
        ("best for it", "least peak"), (tuned.best, tuned.peak), ratios, strict=True
    ):
        lines.append(
            f"  {name}: {with_band(np.median(row), row.min(), row.max())}, {describe_absorber(absorber)}"
        )
    return "\n".join(lines)


def draw_load_comparison(comparison: LoadComparison) -> Figure:
    """Draw what each absorber leaves over the loads' intensity."""
    heads = _heads(comparison)
    figure, panels = figure_of(5.2 * len(heads) + 1.0, 3.8, 1, len(heads), sharey=True)
    panels = np.atleast_1d(panels)
    for band, axes, head in zip(comparison.bands, panels, heads, strict=True):
        for name, (label, colour, style) in LOAD_STYLES.items():
            low, middle, high = ratio_interval(band, name).T
            axes.fill_between(comparison.factors, low, high, color=colour, alpha=0.18, linewidth=0)
            axes.plot(comparison.factors, middle, style, color=colour, label=label)
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_xticks(comparison.factors, [f"{factor:.3g}" for factor in comparison.factors])
        axes.minorticks_off()
        axes.set_ylim(0, None)
        axes.set_xlabel("intensity of the load, 1: as given")
        axes.set_title(
            ", ".join(filter(None, (f"Under {comparison.case.loads.describe()}", head))),
            fontsize=11,
        )
    panels[0].set_ylabel(f"{LABELS[comparison.case.measure]} over that without absorber")
    panels[0].legend(frameon=False)
    return figure


def save_load_figure(path: Path, comparison: LoadComparison) -> None:
    """Write the figure of `draw_load_comparison`; the ending of ``path`` chooses the format."""
    write_figure(draw_load_comparison(comparison), path)
