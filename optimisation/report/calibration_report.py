"""The content of the answer of `calibrate`. SI units, unless named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from optimisation.calibration.inference import Inference
from optimisation.calibration.linear_fit import LinearFit
from optimisation.calibration.measurement import (
    DecayMeasurement,
    LevelMeasurement,
    Measurement,
    RecordMeasurement,
)
from optimisation.calibration.parameters import UNITS
from optimisation.calibration.plan import MeasurementPlan
from optimisation.calibration.predictive import LEAST_PROBABILITY, PredictiveCheck
from optimisation.calibration.summaries import list_groups
from optimisation.report.report import (
    BLUE,
    ORANGE,
    Chart,
    Curve,
    Group,
    Json,
    Report,
    Row,
    Table,
    draw_grid,
    figure_of,
    with_band,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Models = Mapping[str, tuple[Inference, PredictiveCheck]]
STRONG_CORRELATION = 0.5
NOT_IDENTIFIED = 0.8  # posterior over prior deviation, above which a measurement says little
AT_END = 0.02  # of the prior's range: a median nearer to its end is at the end
MOST_LISTED = 6  # statistics that are not explained
CLOSE_SCORE = 3.0  # a smaller difference of scores, 20 to 1, does not distinguish two models
UNEQUAL_GAPS = "unequal gaps"
MILLI = {"m": ("mm", 1e3), "kg": ("g", 1e3)}


def in_display_unit(name: str, values: Array | float) -> tuple[Any, str]:
    """Return values of a parameter in the unit in which people read them, and the unit."""
    unit = UNITS[name]
    if unit in MILLI:
        unit, factor = MILLI[unit]
        return values * factor, unit
    return values, unit


def parameter_texts(inference: Inference) -> list[tuple[str, str, str, str]]:
    """Return name, median, 90 % interval and prior of each parameter."""
    lines = []
    for k, prior in enumerate(inference.priors):
        quantiles = np.quantile(inference.values[:, k], [0.05, 0.5, 0.95])
        (low, median, high), unit = in_display_unit(prior.name, quantiles)
        text = f"{median:.4g} {unit}".rstrip()
        lines.append((prior.name, text, f"{low:.4g} to {high:.4g}", prior.words))
    return lines


def correlation_lines(inference: Inference) -> list[str]:
    """Return a line for each pair of parameters that is strongly correlated."""
    lines = []
    correlation = np.atleast_2d(np.corrcoef(inference.values.T))
    names = inference.names
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            value = float(correlation[i, j])
            if abs(value) >= STRONG_CORRELATION:
                way = "rise" if value > 0 else "trade off"
                lines.append(
                    f"{names[i]} and {names[j]} {way} together (correlation {value:+.2f}): "
                    "their intervals do not hold independently"
                )
    return lines


def verdict(check: PredictiveCheck) -> str:
    """Return whether the model explains the measurement, in words."""
    if check.explains:
        return (
            f"The model explains the measurement: of {check.simulations} measurements "
            "simulated near the posterior, "
            f"{100 * check.probability:.0f} % are at least as far from what their fitted "
            "parameters give."
        )
    failing = check.failing
    worst = "; ".join(
        f"{check.statistics[k].words} ({check.deviations[k]:+.1f} deviations)"
        for k in failing[:MOST_LISTED]
    )
    more = len(failing) - MOST_LISTED
    rest = f"; and {more} more" if more > 0 else ""
    return (
        f"The model does not explain the measurement (probability {check.probability:.2g}). "
        f"Not explained: {worst}{rest}."
    )


def contradiction_lines(inference: Inference, check: PredictiveCheck) -> list[str]:
    """Return the parameters' values by each measurement alone, if these contradict each other.

    Each parameter has a line. Without contradiction the list is empty.
    """
    if check.contradiction >= LEAST_PROBABILITY:
        return []
    lines = []
    for k, prior in enumerate(inference.priors):
        parts = []
        for one in check.estimates:
            share = float(one.shares[k])
            ends = np.clip([share, share - one.scatter[k], share + one.scatter[k]], 0.0, 1.0)
            (value, low, high), unit = in_display_unit(prior.name, prior.at(ends))
            parts.append(
                f"{value:.4g} ({low:.4g} to {high:.4g}) {unit}".rstrip() + f" by {one.measurement}"
            )
        lines.append(f"  {prior.name}: {', '.join(parts)}")
    return [
        (
            f"The measurements contradict one another (probability {check.contradiction:.2g}); "
            "each alone gives (one deviation):"
        ),
        *lines,
    ]


def list_warnings(inference: Inference, check: PredictiveCheck) -> list[str]:
    """Return what is not certain of a posterior, in words."""
    lines = []
    if not check.explains:
        lines.append("the intervals hold only if the model is right, and the check refuses it")
    if not inference.settled:
        lines.append(
            "the last two rounds differ by more than their scatter: more rounds may move the "
            "intervals"
        )
    ratios = np.std(inference.shares, axis=0) / np.sqrt(1 / 12)  # deviation over that of the prior
    median = np.median(inference.shares, axis=0)
    for k, prior in enumerate(inference.priors):
        if ratios[k] > NOT_IDENTIFIED:
            lines.append(
                f"the measurement says little about {prior.name}: its interval is that of the prior"
            )
        elif median[k] < AT_END or median[k] > 1 - AT_END:
            end = "lower" if median[k] < AT_END else "upper"
            lines.append(f"{prior.name} is at the {end} end of its range: widen it")
    return lines


def describe_measurement(measurement: Measurement) -> str:
    """Return a measurement in words."""
    if isinstance(measurement, RecordMeasurement):
        seconds = float(measurement.load.times[-1])
        load = "force" if measurement.load.quantity == "force" else "base acceleration"
        words = (
            f"{load} and {measurement.sensor.quantity}, {seconds:.4g} s at {measurement.rate:.4g} "
            "Hz"
        )
    elif isinstance(measurement, LevelMeasurement):
        forces, repeats = measurement.levels.shape
        words = f"levels at {forces} forces, {repeats} repeats"
    else:
        assert isinstance(measurement, DecayMeasurement)
        words = f"free decay of {len(measurement.response) / measurement.rate:.4g} s"
    return f"{measurement.name}: {words}, absorber {measurement.absorber}"


def linear_lines(linear: LinearFit | None) -> list[str]:
    """Return a line for each fitted mode."""
    if linear is None:
        return []
    return [
        f"mode {mode}: {linear.hertz[k]:.5g} +- {linear.hertz_error[k]:.2g} Hz, damping "
        f"{100 * linear.damping[k]:.4g} +- {100 * linear.damping_error[k]:.2g} %"
        for k, mode in enumerate(linear.modes)
    ]


def rank_models(models: Models) -> list[tuple[str, float]]:
    """Return names and predictive scores of models, the best first."""
    scores = [(name, check.score) for name, (_, check) in models.items()]
    return sorted(scores, key=lambda one: -one[1])


def list_close(models: Models) -> list[str]:
    """Return the models that the measurement does not distinguish from the best one.

    Their scores are too near to the best score.
    """
    (_, best), *others = rank_models(models)
    return [name for name, score in others if best - score < CLOSE_SCORE]


def describe_best_model(models: Models) -> str:
    """Return which model has the best score, and whether it explains the measurement, in words."""
    name, score = rank_models(models)[0]
    own, check = next(iter(models.values()))
    explains = models[name][1].explains
    if models[name][0] is own:
        words = "Best score: the model itself; the others predict the measurement worse"
    else:
        words = f"Best score: {name}, {score - check.score:.1f} above the model"
    words += "; it explains the measurement." if explains else "; the check refuses it, too."
    close = list_close(models)
    if close:
        words += f" Within {CLOSE_SCORE:g} of it, not distinguished from it: {', '.join(close)}."
    return words


def model_rows(models: Models) -> list[tuple[str, str, str, str]]:
    """Return a row for each model.

    A row has the model's name, its predictive score, its probability in the check and its
    parameters.
    """
    best = rank_models(models)[0][1]
    rows = []
    for name, (inference, check) in models.items():
        values = ", ".join(
            f"{text[0]} {text[1]} ({text[2]})" for text in parameter_texts(inference)
        )
        rows.append((name, f"{check.score - best:.1f}", f"{check.probability:.2g}", values))
    own = rows[0]
    rows.append((UNEQUAL_GAPS, own[1], own[2], "same response: only the total clearance acts"))
    return rows


def plan_table(plan: MeasurementPlan) -> Table:
    """Return a line for each force: the expected deviation of each parameter over that now."""
    header = ("factor of the load", *(f"{name}, over now" for name in plan.names))
    rows = [
        (f"{factor:g}", *(f"{ratio:.2f}" for ratio in plan.ratios[k]))
        for k, factor in enumerate(plan.factors)
    ]
    return Table.of_words(header, rows)


def plan_lines(plan: MeasurementPlan) -> list[str]:
    """Return which forces to measure at next, and what is expected of them."""
    lines = ["Measure next, in this order; expected deviations of the parameters over those now:"]
    for k, factor in enumerate(plan.next_factors):
        ratios = ", ".join(
            f"{name} {ratio:.2f}"
            for name, ratio in zip(plan.names, plan.together[k] / plan.now, strict=True)
        )
        lines.append(f"  {'then ' if k else ''}at {factor:g} times the load: {ratios}")
    return lines


def text_blocks(
    measurements: Sequence[Measurement],
    models: Models,
    linear: LinearFit | None,
    plan: MeasurementPlan | None,
    warnings: Sequence[str],
) -> list[list[str | Table]]:
    """Return what `calibrate` prints."""
    inference, check = next(iter(models.values()))
    texts = parameter_texts(inference)
    widths = [max(len(text[k]) for text in texts) for k in range(3)]
    values = [
        f"  {name:<{widths[0]}}  {median:>{widths[1]}}  {interval:<{widths[2]}}  prior {prior}"
        for name, median, interval, prior in texts
    ]
    heading = f"Posterior of {inference.runs} simulated measurements: median (90 % interval)"
    blocks: list[list[str | Table]] = [
        [*map(describe_measurement, measurements), *linear_lines(linear)],
        [heading, *values, *correlation_lines(inference)],
        [verdict(check), *contradiction_lines(inference, check)],
    ]
    if len(models) > 1:
        header = ("model", "score, less the best", "probability", "median (90 % interval)")
        table = Table.of_words(header, model_rows(models))
        blocks += [[describe_best_model(models)], [table]]
    if plan is not None:
        blocks += [["Expected after one more sweep:"], [plan_table(plan)], [*plan_lines(plan)]]
    return [*blocks, [f"Warning: {line}" for line in warnings]]


def summarise(
    models: Models, linear: LinearFit | None, plan: MeasurementPlan | None, warnings: Sequence[str]
) -> dict[str, Any]:
    """Return verdict, models, linear part and plan as JSON values."""
    inference, check = next(iter(models.values()))
    content: dict[str, Any] = {
        "runs": inference.runs,
        "settled": inference.settled,
        "model_explains_measurement": check.explains,
        "predictive_probability": check.probability,
        "contradiction_probability": check.contradiction,
        "by_measurement": {
            one.measurement: {
                prior.name: float(prior.at(np.clip(one.shares[k : k + 1], 0, 1))[0])
                for k, prior in enumerate(inference.priors)
            }
            for one in check.estimates
        },
        "not_explained": [check.statistics[k].words for k in check.failing],
        "warnings": list(warnings),
    }
    if linear is not None:
        content["linear"] = {
            "modes": list(linear.modes),
            "frequency_hz": linear.hertz.tolist(),
            "frequency_error_hz": linear.hertz_error.tolist(),
            "damping_ratio": linear.damping.tolist(),
            "damping_error": linear.damping_error.tolist(),
            "gain": None if np.isnan(linear.gain) else linear.gain,
            "explained": linear.explained,
        }
    if len(models) > 1:
        content["models"] = {
            name: {
                "probability": other.probability,
                "score": other.score,
                "log_score": other.log_score,
                "free_parameters": other.parameters,
                "median": dict(zip(own.names, np.median(own.values, axis=0).tolist(), strict=True)),
            }
            for name, (own, other) in models.items()
        }
        content["models"][UNEQUAL_GAPS] = {"same_response_as": next(iter(models))}
        content["best_model"] = rank_models(models)[0][0]
        content["not_distinguished"] = list_close(models)
    if plan is not None:
        content["plan"] = {
            "factors": plan.factors.tolist(),
            "expected_deviation": {
                name: plan.expected[:, k].tolist() for k, name in enumerate(plan.names)
            },
            "next_factors": plan.next_factors.tolist(),
            "expected_deviation_together": {
                name: plan.together[:, k].tolist() for k, name in enumerate(plan.names)
            },
        }
    return content


def statistics_table(inference: Inference, check: PredictiveCheck) -> Table:
    """Return a row for each statistic.

    It has the measured and the predicted logarithm, and the sensitivity to the parameters.
    """
    sensitivity = inference.sensitivity
    rows = [
        (
            one.measurement,
            one.group,
            one.at,
            one.at_unit,
            float(check.observed[k]),
            *(float(value) for value in check.quantiles[:, k]),
            float(check.deviations[k]),
            float(sensitivity.explained[k]),
            bool(sensitivity.used[k]),
            *(float(value) for value in sensitivity.shifts[k]),
        )
        for k, one in enumerate(check.statistics)
    ]
    fixed = ("measurement", "group", "at", "at_unit", "measured_log", "predicted_5_log")
    more = ("predicted_50_log", "predicted_95_log", "deviations", "explained_share", "used")
    shifts = (f"shift_by_{name}" for name in inference.names)
    return Table.of_values((*fixed, *more, *shifts), rows)


def group_columns(check: PredictiveCheck, measurement: str, group: str) -> list[int]:
    """Return the indices of the statistics of a group of a measurement."""
    return [
        k
        for k, one in enumerate(check.statistics)
        if one.measurement == measurement and one.group == group
    ]


def draw_pairs(inference: Inference) -> Figure:
    """Return the figure of the posterior.

    It has a histogram of each parameter, and the draws of each pair of parameters.
    """
    names = inference.names
    count = len(names)
    figure, panels = figure_of(2.4 * count + 1, 2.2 * count + 1, count, count)
    panels = np.reshape(panels, (count, count))
    columns = [in_display_unit(name, inference.values[:, k]) for k, name in enumerate(names)]
    for i in range(count):
        for j in range(count):
            panel = panels[i, j]
            if j > i:
                panel.set_visible(False)
                continue
            if i == j:
                panel.hist(columns[i][0], bins=40, color=BLUE, density=True)
                panel.set_yticks([])
            else:
                panel.plot(columns[j][0], columns[i][0], ".", color=BLUE, ms=1.5, alpha=0.4)
            if i == count - 1:
                panel.set_xlabel(f"{names[j]}, {columns[j][1]}".rstrip(", "))
            if j == 0 and i > 0:
                panel.set_ylabel(f"{names[i]}, {columns[i][1]}".rstrip(", "))
    return figure


def draw_statistics(check: PredictiveCheck) -> Figure:
    """Return the figure of the measured statistics over the predictive bands.

    Each group of statistics has a panel.
    """
    groups = list_groups(check.statistics)
    columns = min(len(groups), 3)
    rows = -(-len(groups) // columns)
    figure, panels = figure_of(4.2 * columns, 3.0 * rows, rows, columns)
    flat = np.ravel(panels)
    for panel, (measurement, group) in zip(flat, groups, strict=False):
        own = group_columns(check, measurement, group)
        x = np.arange(len(own))
        low, median, high = np.exp(check.quantiles[:, own])
        panel.fill_between(x, low, high, color=BLUE, alpha=0.25, lw=0, step="mid")
        panel.plot(x, median, color=BLUE, lw=1.2, drawstyle="steps-mid", label="predicted, 90 %")
        panel.plot(x, np.exp(check.observed[own]), "o", color=ORANGE, ms=4, label="measured")
        panel.set_yscale("log")
        ticks = x[:: max(1, len(x) // 5)]
        panel.set_xticks(ticks, [f"{check.statistics[own[k]].at:.4g}" for k in ticks])
        unit = check.statistics[own[0]].unit
        panel.set_title(f"{group}, {unit}".rstrip(", ") + f" ({measurement})", fontsize=8)
        panel.set_xlabel(check.statistics[own[0]].at_unit, fontsize=8)
        draw_grid(panel)
    for panel in flat[len(groups) :]:
        panel.set_visible(False)
    flat[0].legend(fontsize=7, frameon=False)
    return figure


def make_report(
    measurements: Sequence[Measurement],
    models: Models,
    linear: LinearFit | None,
    plan: MeasurementPlan | None,
    warnings: Sequence[str],
    numbers: Json,
) -> Report:
    """Return the content of a calibration.

    ``numbers``: further content of summary.json, at its beginning.
    """
    inference, check = next(iter(models.values()))
    return Report(
        title="Calibration of an impact absorber",
        verdict=verdict(check)
        if len(models) == 1
        else f"{verdict(check)} {describe_best_model(models)}",
        text=text_blocks(measurements, models, linear, plan, warnings),
        numbers=numbers | summarise(models, linear, plan, warnings),
        tables={"statistics.csv": statistics_table(inference, check)},
        figures={
            "posterior.png": partial(draw_pairs, inference),
            "statistics.png": partial(draw_statistics, check),
        },
        groups=card_groups(measurements, models, linear, plan),
        charts=(*_statistic_charts(check), *_pair_charts(inference)),
        warnings=tuple(warnings),
    )


def card_groups(
    measurements: Sequence[Measurement],
    models: Models,
    linear: LinearFit | None,
    plan: MeasurementPlan | None,
) -> tuple[Group, ...]:
    """Return posterior, verdict, linear part and models."""
    inference, check = next(iter(models.values()))
    rows = []
    for k, prior in enumerate(inference.priors):
        quantiles = np.quantile(inference.values[:, k], [0.05, 0.5, 0.95])
        (low, median, high), unit = in_display_unit(prior.name, quantiles)
        rows.append(Row(prior.name, with_band(median, low, high, unit=unit)))
    groups: list[Group] = [
        ("Posterior, median (90 % interval)", tuple(rows)),
        (
            "Predictive check",
            (
                Row("model explains the measurement", "yes" if check.explains else "no"),
                Row("probability", check.probability),
                *(Row("not explained", check.statistics[k].words) for k in check.failing[:4]),
            ),
        ),
        ("Measurements", tuple(Row(one.name, describe_measurement(one)) for one in measurements)),
    ]
    if linear is not None:
        texts = [line.partition(": ") for line in linear_lines(linear)]
        groups.append(
            ("Linear part (standard error)", tuple(Row(name, text) for name, _, text in texts))
        )
    if len(models) > 1:
        groups.append(
            (
                "Models: score, less the best (probability in the check)",
                tuple(Row(row[0], f"{row[1]} ({row[2]})") for row in model_rows(models)),
            )
        )
    if plan is not None:
        factors = ", then ".join(f"{factor:g}" for factor in plan.next_factors)
        groups.append(("Measure next", (Row("times the load", factors),)))
    return tuple(groups)


def _statistic_charts(check: PredictiveCheck) -> Iterator[Chart]:
    for measurement, group in list_groups(check.statistics):
        own = group_columns(check, measurement, group)
        first = check.statistics[own[0]]
        at = [check.statistics[k].at for k in own]
        number = list(range(1, len(own) + 1))
        rising = all(a < b for a, b in pairwise(at))
        x = at if rising else [float(one) for one in number]
        low, median, high = np.exp(check.quantiles[:, own])
        yield Chart(
            f"{group}, {measurement}",
            first.at_unit if rising else "bin",
            f"{group}, {first.unit}".rstrip(", "),
            (
                Curve("predicted, 90 %", x, median.tolist(), low.tolist(), high.tolist()),
                Curve("measured", x, np.exp(check.observed[own]).tolist(), points=True),
            ),
            log_y=True,
        )


def _pair_charts(inference: Inference) -> Iterator[Chart]:
    thinned = inference.values[:: max(1, len(inference.values) // 400)]
    names = inference.names
    for i in range(len(names)):
        for j in range(i):
            x, x_unit = in_display_unit(names[j], thinned[:, j])
            y, y_unit = in_display_unit(names[i], thinned[:, i])
            yield Chart(
                f"Posterior of {names[j]} and {names[i]}",
                f"{names[j]}, {x_unit}".rstrip(", "),
                f"{names[i]}, {y_unit}".rstrip(", "),
                (Curve("draws", x.tolist(), y.tolist(), points=True),),
            )
