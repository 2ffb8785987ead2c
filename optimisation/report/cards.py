"""The cards of the comparison, the tunings, a search and a front: what `optimisation.report.card` writes of them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Threads
from impact_env.frequency import coupled_receptance, tip_response
from impact_env.parameters import Absorber, SlidingAbsorber, TunedAbsorber
from optimisation.baselines import simulate_baselines
from optimisation.comparison import IMPACT, NONE, Comparison, ResonanceComparison
from optimisation.extremes import LEAST_RATIO
from optimisation.files import numbers
from optimisation.frequency_levels import ResonanceCurves
from optimisation.insight import Levels
from optimisation.measures import DISPLAY_UNITS, LABELS
from optimisation.problem import Problem
from optimisation.report.card import (
    NO_DEVICE,
    Card,
    Chart,
    Curve,
    Row,
    assumed_rows,
    baseline_rows,
    between,
    device_rows,
    mass_rows,
    service_rows,
    with_band,
)
from optimisation.report.comparison_tables import END_WARNING, concepts_read_at_end
from optimisation.report.design_tables import END_WARNING as END_OF_DESIGN
from optimisation.report.design_tables import (
    PAPER,
    WINNER,
    compared,
    condition_values,
    constraint_words,
    is_any_at_end,
    limit,
    load_pairs,
    reading,
    service_pairs,
)
from optimisation.report.frequency_report import frequency_charts
from optimisation.report.front_report import front_reading, swept_conditions
from optimisation.report.tuning_report import MINIMAX, TuningTable
from optimisation.search.judge import SearchResult
from optimisation.search.pareto import Front
from optimisation.service import (
    EFFECTIVE_RATIO,
    ImpactLoads,
    contiguous_range,
)
from optimisation.space import MASS_RATIO, VARIABLES
from optimisation.statistics import prediction_band
from optimisation.sweep_range import find_reading_ratios, reading_in_words

Array = NDArray[np.float64]
MM = 1e3
POINTS = 601  # of a curve over the frequency


def comparison_card(
    comparison: Comparison,
    impacts: ImpactLoads | None = None,
    frequency: Sequence[ResonanceCurves] = (),
) -> Card:
    """Return the impact absorber, the levels of all at one force near each resonance, and all curves.

    ``impacts`` near the first resonance, if known; ``frequency``: levels over the frequency.
    """
    labels = {concept.key: concept.label for concept in comparison.concepts}
    own = next(concept.absorber for concept in comparison.concepts if concept.key == IMPACT)
    assert isinstance(own, SlidingAbsorber)
    groups: list[tuple[str, tuple[Row, ...]]] = [
        ("Impact absorber", device_rows(own, comparison.model))
    ]
    groups.append(
        (
            "Others of its mass",
            tuple(
                Row(one.label, _parameters(one.absorber))
                for one in comparison.concepts
                if one.key not in (NONE, IMPACT)
            ),
        )
    )
    warnings = []
    charts = []
    for part in comparison.resonances:
        name = f"Resonance {part.resonance}"
        if part.reported_index is not None:
            groups.append(
                (
                    f"{name}, at {part.forces[part.reported_index]:.3g} N",
                    _levels(comparison, part, part.reported_index),
                )
            )
        if (
            part.reported_index is not None
            and part is comparison.resonances[0]
            and impacts is not None
        ):
            groups.append(
                (
                    "What it bears there",
                    service_rows(
                        comparison.gap,
                        impacts,
                        float(part.curves[IMPACT].median[part.reported_index]),
                    ),
                )
            )
        charts.append(_comparison_chart(part, labels, name))
        if part.sweep_ratio < LEAST_RATIO:
            warnings.append(
                f"{name}: sweeps show {part.sweep_ratio:.3f} of the stationary level; sweep more slowly"
            )
        if part.reach < 1:
            warnings.append(
                f"{name}: the structure does not move as far as the rule's gap, and no wall is touched there"
            )
    ends = concepts_read_at_end(comparison)
    if ends:
        warnings.append(f"{END_WARNING}: {'; '.join(ends)}")
    assumed = (
        *assumed_rows(
            comparison.model,
            [part.resonance for part in comparison.resonances],
            comparison.percent_per_100_periods,
        ),
        *(
            Row(
                f"resonance {part.resonance} swept over",
                f"{part.limits[0]:.3g} to {part.limits[1]:.3g} of it",
            )
            for part in comparison.resonances
        ),
        Row("in brackets", "the interval that holds 90 % of further runs"),
    )
    return Card(
        "Absorbers of one mass compared",
        (*groups, ("Assumptions", assumed)),
        (*charts, *frequency_charts(frequency)),
        tuple(warnings),
    )


def _parameters(absorber: Absorber | None) -> str:
    if isinstance(absorber, TunedAbsorber):
        return f"{absorber.stiffness:.6g} N/m, {absorber.damping:.4g} N s/m"
    return (
        ""
        if absorber is None or absorber.friction is None  # type: ignore[union-attr]
        else f"friction limit {absorber.friction.limit:.4g} N"  # type: ignore[union-attr]
    )


def _levels(comparison: Comparison, part: ResonanceComparison, k: int) -> tuple[Row, ...]:
    labels = {concept.key: concept.label for concept in comparison.concepts}
    ranges = {concept.key: part.limits_of(concept) for concept in comparison.concepts}
    rows = []
    for key, curve in part.curves.items():
        level = MM * curve.median[k]
        low, high = MM * prediction_band(curve.combined)[:, k]
        none = MM * part.curves[NONE].median[k]
        rows.append(
            Row(
                labels[key],
                f"{with_band(level, low, high, unit='mm')}, {100 * level / none:.3g} %, read at "
                + reading_in_words(
                    float(find_reading_ratios(curve)[k]),
                    ranges[key],
                    comparison.percent_per_100_periods,
                ),
            )
        )
    halves = contiguous_range(
        part.forces, part.curves[IMPACT].median < EFFECTIVE_RATIO * part.curves[NONE].median, k
    )
    return (
        *rows,
        Row(NO_DEVICE, MM * float(part.limit[k]), "mm"),
        Row(f"the {labels[IMPACT]} halves the level", between(*halves)),
    )


def _comparison_chart(part: ResonanceComparison, labels: dict[str, str], name: str) -> Chart:
    curves = []
    for key, curve in part.curves.items():
        low, high = MM * prediction_band(curve.combined)
        curves.append(
            Curve(
                labels[key],
                numbers(part.forces),
                numbers(MM * curve.median),
                numbers(low),
                numbers(high),
            )
        )
    what = "the force" if part.own_force is not None else f"best of the {labels[IMPACT]}"
    best = () if part.reported_index is None else ((what, float(part.forces[part.reported_index])),)
    return Chart(
        name, "force in N", "level in mm (RMS)", tuple(curves), best, log_x=True, log_y=True
    )


def tuning_card(table: TuningTable, bounds: dict[str, float]) -> Card:
    """Return all tunings with their peaks, what the one with the smallest peak bears, and the amplitude over the frequency."""
    rows = []
    curves = []
    ratios = table.ratios_drawn(POINTS)
    for tuning in table.tunings:
        own = tuning.absorber
        what = "" if own is None else f", {own.stiffness:.6g} N/m, {own.damping:.4g} N s/m"
        proved = (
            f", proved {100 * bounds[tuning.key] / table.reference:.4g} %"
            if tuning.key in bounds
            else ""
        )
        rows.append(
            Row(
                tuning.label,
                f"peak {100 * table.relative_peak(tuning):.4g} % at {tuning.peak_ratio:.4g}{proved}{what}",
            )
        )
        amplitude = (
            100 * np.abs(tip_response(table.model, own, ratios * table.omega)) / table.reference
        )
        curves.append(Curve(tuning.label, numbers(ratios), numbers(amplitude)))
    assumed = (
        *mass_rows(table.mass_ratio, table.model),
        *assumed_rows(table.model, (table.resonance,), None),
    )
    chart = Chart(
        "Amplitude",
        "frequency over the resonance's",
        f"% of {table.of_what}",
        tuple(curves),
        log_y=True,
    )
    best = [
        tuning.absorber for tuning in table.tunings if tuning.key == MINIMAX and tuning.absorber
    ]
    loads = [
        (
            "What the tuning of the smallest peak bears under 1 N",
            _tuned_loads(table, absorber, ratios),
        )
        for absorber in best
    ]
    return Card(
        "Tuned absorbers of one mass",
        (("Tunings", tuple(rows)), *loads, ("Assumptions", assumed)),
        (chart,),
    )


def _tuned_loads(table: TuningTable, absorber: TunedAbsorber, ratios: Array) -> tuple[Row, ...]:
    """Return the largest stationary stroke, speed, accelerations and loss of a tuned absorber under 1 N at frequencies over the resonance's."""
    model = table.model
    omega = ratios * table.omega
    mass = absorber.mass_ratio * table.model.beam_mass
    place = coupled_receptance(model, absorber, omega, model.tip_shape, model.one_phase_force_shape)
    stroke = (
        place
        * mass
        * omega**2
        / (absorber.stiffness + 1j * omega * absorber.damping - mass * omega**2)
    )
    speed = omega * np.abs(stroke)
    accelerations = (
        np.abs(omega**2 * q) for q in (place + stroke, tip_response(model, absorber, omega))
    )
    absorbers, structures = (float(values.max()) for values in accelerations)
    return (
        Row("stroke of the absorber, to either side", MM * float(np.abs(stroke).max()), "mm"),
        Row("largest relative speed", float(speed.max()), "m/s"),
        Row("RMS relative speed", float(speed.max()) / math.sqrt(2), "m/s"),
        Row("power lost in the damper", 1e3 * absorber.damping * float(speed.max()) ** 2 / 2, "mW"),
        Row("largest acceleration of the absorber", absorbers, "m/s^2"),
        Row("largest acceleration of the structure", structures, "m/s^2"),
        Row("under other forces", "in proportion to the force, the power to its square"),
    )


def findings_card(result: SearchResult, frequency: Sequence[ResonanceCurves] = ()) -> Card:
    """Return a search's winner, its level under each condition beside its rivals, what it bears, and what it rests on.

    ``frequency``: levels over the frequency.
    """
    problem = result.problem
    verdict = result.verdict
    groups: list[tuple[str, tuple[Row, ...]]] = []
    warnings = [] if result.finished else ["stopped early"]
    if verdict is not None:
        values = verdict.winner.design.values
        own = [
            Row(v.name.replace("_", " "), values[v.name], v.si)
            for v in VARIABLES[problem.space.concept]
            if v.name != MASS_RATIO
        ]
        groups.append(("Winner", (*mass_rows(values[MASS_RATIO], problem.model), *own)))
        judged = [
            Row(
                f"{name}'s design",
                with_band(one.score.values[0], *one.bands[0])
                + constraint_words(problem, one.score),
            )
            for name, one in compared(verdict).items()
        ]
        groups.append((f"{problem.objectives[0].label}, on fresh members", tuple(judged)))
        groups += [
            (c.words[0].upper() + c.words[1:], _condition_rows(result, k))
            for k, c in enumerate(problem.conditions)
        ]
        if is_any_at_end(problem, (verdict.winner,)):
            warnings.append(END_OF_DESIGN)
        if not verdict.feasible:
            warnings.append("no feasible design: the winner breaks the constraints least")
        warnings += [
            f"the winner lies at a bound: {line}"
            for line in problem.space.at_bounds(verdict.winner.design)
        ]
    more = (
        ""
        if result.wider is None
        else f"; with {result.wider.modes} {result.wider.change} of its value"
    )
    groups.append(
        (
            "Assumptions",
            (
                *_assumed(problem, more),
                Row("searched", f"{result.cost.designs} designs, {result.cost.runs} runs"),
            ),
        )
    )
    charts = [_over_force(part) for part in result.curves or ()]
    return Card(
        f"Search for the best design: {problem.space.concept}",
        tuple(groups),
        (*charts, *frequency_charts(frequency)),
        tuple(warnings),
    )


def _assumed(problem: Problem, more: str = "") -> tuple[Row, ...]:
    resonances = () if problem.under_loads else tuple(c.resonance for c in problem.conditions)
    return assumed_rows(
        problem.model, resonances, None if problem.under_loads else problem.rate, more
    )


def _condition_rows(result: SearchResult, k: int) -> tuple[Row, ...]:
    """Return levels under a condition, and what the winner bears there."""
    assert result.own is not None
    values = condition_values(result, k)
    condition = result.own.conditions[k]
    name, unit = condition.measure_and_unit
    scale, display_unit = DISPLAY_UNITS[condition.measure_and_unit[1]]
    rows = []
    for who in (WINNER, PAPER):
        one: dict[str, Any] = values[who]  # type: ignore[assignment]
        low, high = (
            math.nan if x is None else scale * x for x in one[f"{name}_5_to_95_percent_{unit}"]
        )
        level = with_band(scale * one[f"{name}_{unit}"], low, high, unit=display_unit)
        level += f", {100 * one['relative']:.3g} % of no absorber"
        level += reading(result.problem, condition, one["level_frequency_ratio"])
        rows.append(Row(f"{who}'s design", level))
    rows.append(Row("no absorber", scale * float(result.own.without[k]), display_unit))
    if condition.loads is None:
        assert result.verdict is not None
        design = result.verdict.winner.design
        rows += baseline_rows(
            simulate_baselines(
                result.problem.model,
                design.values[MASS_RATIO],
                (condition.force, condition.resonance),
                condition.limits,
                result.problem.rate,
                Threads(),
            )
        )
        bound = limit(result.problem, design, condition)
        rows += [] if math.isnan(bound) else [Row(NO_DEVICE, MM * bound, "mm")]
    if result.service is not None:
        rows += [Row(*pair) for pair in service_pairs(result.service, k)]
    return tuple(rows)


def _over_force(part: Levels) -> Chart:
    forces = [condition.force for condition in part.conditions]
    own = part.conditions[0]
    name = own.measure_and_unit[0]
    scale, unit = DISPLAY_UNITS[own.measure_and_unit[1]]
    curves = [
        Curve(
            who,
            numbers(forces),
            numbers(scale * part.median[d]),
            numbers(scale * part.low[d]),
            numbers(scale * part.high[d]),
        )
        for d, who in enumerate(("winner", "paper"))
    ]
    curves.append(Curve("no absorber", numbers(forces), numbers(scale * part.without)))
    x, y = (
        ("force in N", "level in mm (RMS)")
        if own.loads is None
        else ("factor on the loads", f"{LABELS[name]} in {unit}")
    )
    return Chart(own.place[0].upper() + own.place[1:], x, y, tuple(curves), log_x=True, log_y=True)


def front_card(front: Front) -> Card:
    """Return the designs of a front, what some of them bear, and all that were tried."""
    problem = front.problem
    names = [o.label for o in front.problem.objectives]
    rows = []
    for e in front.members:
        values = ", ".join(f"{v.name} {e.design.values[v.name]:.4g}" for v in problem.space.free)
        rows.append(
            Row(f"design {e.number}", values + ": {:.4g} and {:.4g}".format(*e.score.values))
        )
    if front.fresh:
        rows += [
            Row(f"{c.words}: levels", front_reading(front, k)) for k, c in swept_conditions(problem)
        ]
    warnings = [] if front.members else ["no design kept all constraints"]
    if front.fresh and is_any_at_end(problem, front.fresh):
        warnings.append(END_OF_DESIGN)
    parts = [("tried", front.evaluated), ("on the front", front.members)]
    curves = [
        Curve(
            name,
            numbers(e.score.values[0] for e in part),
            numbers(e.score.values[1] for e in part),
            points=True,
        )
        for name, part in parts
    ]
    assumed = (
        *_assumed(problem),
        Row("searched", f"{front.cost.designs} designs, {front.cost.runs} runs"),
    )
    service_rows_of = [
        (
            f"What design {number} bears, {condition.words}",
            tuple(Row(*pair) for pair in load_pairs(measures, c)),
        )
        for number, measures in front.service
        for c, condition in enumerate(problem.conditions)
    ]
    groups = (("Front", tuple(rows)), *service_rows_of, ("Assumptions", assumed))
    return Card(
        " against ".join(names),
        groups,
        (Chart("Front", names[0], names[1], tuple(curves)),),
        tuple(warnings),
    )
