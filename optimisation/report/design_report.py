"""The report of a search for a design: tables, figures, text and JSON values.

Numbers are in SI units unless a name or a text has another unit. *Winner*, *paper* and *rule* are
the three designs that are compared at the end of a search, see `Verdict`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optimisation.bounds import reduction_share
from optimisation.files import number, numbers
from optimisation.frequency_levels import ResonanceCurves
from optimisation.insight import Levels, stationary_limit
from optimisation.measures import (
    ACCELERATION,
    COVERED,
    DISPLAY_UNITS,
    FRICTION_HEAT,
    IMPACT_POWER,
    IMPACT_RATE,
    IMPACT_RMS,
    IMPACT_SPEED,
    LABELS,
    PREDICTED,
    STROKE,
    Branches,
    Gain,
    branches,
)
from optimisation.objectives import Condition, Objective, Score
from optimisation.problem import Problem
from optimisation.report.design_figures import (
    draw_curves,
    draw_map,
    draw_robustness,
    draw_sensitivity,
)
from optimisation.report.frequency_report import (
    frequency_charts,
    frequency_figures,
    frequency_tables,
)
from optimisation.report.report import (
    NO_DEVICE,
    Chart,
    Curve,
    Draw,
    Group,
    Json,
    Report,
    Row,
    Table,
    assumed_rows,
    baseline_rows,
    mass_rows,
    with_band,
)
from optimisation.search.judge import JudgedDesign, SearchResult, Verdict
from optimisation.search.settings import EvaluatedDesign
from optimisation.service import BEAM_TOLERANCES, QUANTILES, TOLERANCES, Service
from optimisation.space import MASS_RATIO, VARIABLES, parts_of
from optimisation.sweep_range import LEAST_RATIO, is_at_end, reading_in_words

MM = 1e3
WINNER = "winner"
PAPER = "paper"
RULE = "rule"


def name_of(objective: Objective) -> str:
    """Return the name of an objective's column in a table."""
    return (
        objective.kind if objective.resonance is None else f"{objective.kind}_{objective.resonance}"
    )


def design_table(problem: Problem, evaluated: Sequence[EvaluatedDesign]) -> Table:
    """Return a table with a row for each design of a search, in the order of ``evaluated``.

    The columns are its number, its free variables, its scores, the number of stages of successive
    halving in which it was run (``rungs``), and whether it is feasible.
    """
    free = [v.name for v in problem.space.free]
    rows = [
        [
            e.number,
            *(e.design.values[name] for name in free),
            *e.score.values,
            e.rungs,
            int(e.score.feasible),
        ]
        for e in evaluated
    ]
    names = ["number", *free, *map(name_of, problem.objectives), "rungs", "feasible"]
    return Table.of_values(names, rows)


LEVEL_COLUMNS = (
    "resonance",
    "force_n",
    "detuning",
    "design",
    "gap_m",
    "level_median_m",
    "level_5_percent_m",
    "level_95_percent_m",
    "without_m",
)


def level_table(parts: Sequence[Levels], names: Sequence[str], gaps: Sequence[float] = ()) -> Table:
    """Return a table with a row for each condition and design of each of the ``parts``.

    The columns are `LEVEL_COLUMNS`. Under loads, the factor on the loads replaces the force, and
    the measure of the loads the level. ``names`` are the designs' names. If they are empty, the
    designs are the winner with other ``gaps`` (m).
    """
    columns: tuple[str, ...] = LEVEL_COLUMNS
    rows = list[list[object]]()
    first = parts[0].conditions[0]
    if first.loads is not None:
        name, unit = first.measure_and_unit
        measured = (
            f"{name}_{part}_{unit}" for part in ("median", "5_percent", "95_percent", "without")
        )
        columns = ("load", "factor", "detuning", "design", "gap_m", *measured)
    for part in parts:
        for k, condition in enumerate(part.conditions):
            for d in range(len(part.median)):
                who = [names[d], ""] if names else [WINNER, gaps[d]]
                values = [float(x[d, k]) for x in (part.median, part.low, part.high)]
                place = condition.resonance if condition.loads is None else condition.place
                rows.append(
                    [
                        place,
                        condition.force,
                        condition.detuning,
                        *who,
                        *values,
                        float(part.without[k]),
                    ]
                )
    return Table.of_values(columns, rows)


def constraint_words(problem: Problem, score: Score) -> str:
    """Return a text, with a comma in front, on how a design satisfies the constraints.

    It says that a run failed, which constraints are violated and by how much, or how far the value
    next to its limit is from it. The text is empty without constraints.
    """
    if score.failed:
        return ", a run failed"
    broken = [(c, v) for c, v in zip(problem.constraints, score.violations, strict=True) if v > 0]
    words = [
        f"{c.name} of {c.limit * (1 + v):.4g} over {c.limit:g} {c.unit} by {100 * v:.3g} %"
        for c, v in broken
    ]
    spare = min((-v for v in score.violations), default=0.0)
    return (
        ", breaks " + ", ".join(words)
        if words
        else f", keeps all constraints, {100 * spare:.3g} % to spare"
        if problem.constraints
        else ""
    )


def constraints(problem: Problem, score: Score) -> Json:
    """Return whether a design is feasible, and its constraints, as JSON values.

    For each constraint they are its limit, the design's value and the share of the limit by which
    the value exceeds it, negative if it does not.
    """
    pairs = zip(problem.constraints, score.violations, strict=True)
    rows = {
        c.name: {"limit": c.limit, "value": number(c.limit * (1 + v)), "exceeded_by": number(v)}
        for c, v in pairs
    }
    return {"feasible": score.feasible, "constraints": rows}


def _judged(judged: JudgedDesign, problem: Problem) -> Json:
    """Return variables, score with bands, and constraints of a design as JSON values."""
    return constraints(problem, judged.score) | {
        "values": dict(judged.design.values),
        "score": numbers(judged.score.values),
        "score_5_to_95_percent": [numbers(band) for band in judged.bands],
        "violations": numbers(judged.score.violations),
    }


def compared(verdict: Verdict) -> dict[str, JudgedDesign]:
    """Return the designs that are compared, by name: winner, paper and rule."""
    return {WINNER: verdict.winner, PAPER: verdict.paper, RULE: verdict.rule}


def _gain(gain: Gain) -> Json:
    """Return a ratio with its bootstrap interval as JSON values."""
    return {
        "ratio": number(gain.ratio),
        f"{100 * COVERED:g}_percent": [number(gain.low), number(gain.high)],
    }


def _branches(branches: Branches | None, without: float) -> Json | None:
    """Return the two branches of an ensemble's levels as JSON values; None: a single branch.

    The levels are divided by ``without``, the level without absorber. The shares are those of the
    ensemble members on either branch.
    """
    return (
        None
        if branches is None
        else {
            "relative": [level / without for level in branches.levels],
            "shares_of_members": list(branches.shares),
        }
    )


def summary(findings: SearchResult) -> Json:
    """Return the result of a search as JSON values, for summary.json.

    Parts that the search has not reached are left out.
    """
    problem = findings.problem
    verdict = findings.verdict
    audit = findings.audit
    content: Json = {
        "problem": problem.describe(),
        "finished": findings.finished,
        **findings.cost.describe(),
    }
    if verdict is not None:
        content["found"] = {
            "number": verdict.search_best.number,
            "score": numbers(verdict.search_best.score.values),
        }
        content |= {name: _judged(judged, problem) for name, judged in compared(verdict).items()}
        content["winner_over_paper"] = _gain(verdict.gain)
        content["winner_over_rule"] = _gain(verdict.gain_over(verdict.rule))
        content["winner_at_bounds"] = problem.space.at_bounds(verdict.winner.design)
    if findings.wider is not None:
        wider = findings.wider
        content["with_more_modes"] = {
            "modes": wider.modes,
            **_judged(wider.judged, problem),
            "change": _gain(wider.change),
        }
    if findings.service is not None:
        content["in_service"] = service_summary(findings.service)
    if audit is not None and audit.designs:
        missed = audit.missed
        correlation = number(audit.rank_correlation)
        content["left_behind"] = {
            "run_in_full": audit.designs,
            "better_than_best_found": missed,
            "rank_correlation": correlation,
        }
    if findings.own is not None and verdict is not None:
        content["conditions"] = [
            condition_values(findings, k) for k in range(len(findings.own.conditions))
        ]
    if findings.sensitivity is not None:
        s = findings.sensitivity
        content["sensitivity"] = {
            name: {
                "low": s.low[k],
                "high": s.high[k],
                "first": s.first[k],
                "total": s.total[k],
                "total_95_percent": s.total_band[k].tolist(),
            }
            for k, name in enumerate(s.names)
        }
    return content


def condition_values(findings: SearchResult, k: int) -> Json:
    """Return the levels of winner and paper's design under condition ``k`` as JSON values.

    ``limit_m`` is the stationary limit: the passive limit of the design's gap. The share of the
    possible reduction is (without - level)/(without - limit). It is None if the limit is not below
    the level without absorber, or if the sweep is too fast (`LEAST_RATIO`).
    """
    own = findings.own
    verdict = findings.verdict
    problem = findings.problem
    assert own is not None
    assert verdict is not None
    condition = own.conditions[k]
    without = float(own.without[k])
    sweep = problem.sweep_ratio(condition)
    name, unit = condition.measure_and_unit
    rows: Json = (
        {"resonance": condition.resonance, "force_n": condition.force}
        if condition.loads is None
        else {"factor": condition.force}
    )
    rows |= {
        "detuning": condition.detuning,
        f"without_{unit}": without,
        "sweep_over_stationary_level": number(sweep),
    }
    for d, (who, judged) in enumerate(((WINNER, verdict.winner), (PAPER, verdict.paper))):
        level = float(own.median[d, k])
        bound = stationary_limit(problem, judged.design, condition)
        share = (
            float(reduction_share(level, without, bound))
            if bound < without and sweep >= LEAST_RATIO
            else math.nan
        )
        rows[who] = {
            f"{name}_{unit}": number(level),
            "level_frequency_ratio": _ratio(own, d, k),
            f"{name}_5_to_95_percent_{unit}": [number(own.low[d, k]), number(own.high[d, k])],
            "relative": number(level / without),
            "branches": _branches(branches(judged.levels[:, k]), without),
            "limit_m": number(bound),
            "share_of_possible_reduction": number(share),
        }
    return rows


def _ratio(levels: Levels, d: int, k: int) -> float | None:
    """Return the frequency, over the resonance, of the maximum of design ``d``'s level.

    The level is that under condition ``k``. The result is None under loads, or if not recorded.
    """
    if levels.ratios is None or levels.conditions[k].loads is not None:
        return None
    return number(float(levels.ratios[d, k]))


def reading(problem: Problem, condition: Condition, ratio: float | None) -> str:
    """Return the frequency ratio at which a level was read, as a text with a comma in front.

    The text is empty for None, that is under loads.
    """
    if ratio is None:
        return ""
    return f", read at {reading_in_words(ratio, condition.limits, problem.rate)}"


END_WARNING = (
    "a level was read at an end of the sweeps, where it may be that of another resonance or of "
    "the sweep's start"
)


def is_any_at_end(problem: Problem, judged: Sequence[JudgedDesign]) -> bool:
    """Return whether a level of any of the designs was read at an end of its sweep."""
    return any(
        is_at_end(float(ratio), condition.limits, problem.rate)
        for one in judged
        for condition, ratio in zip(problem.conditions, one.ratios, strict=True)
        if condition.loads is None
    )


def lines_of(findings: SearchResult) -> list[str]:
    """Return the lines that a search prints about its result."""
    problem = findings.problem
    verdict = findings.verdict
    cost = findings.cost
    title = (
        f"{problem.space.concept}: {problem.objectives[0].label}, "
        f"{'larger' if problem.objectives[0].maximise else 'smaller'} is better"
    )
    loads = [
        f"  under {one.words}; the level is the {LABELS[one.measure_and_unit[0]]}"
        for one in problem.conditions
        if one.loads is not None
    ]
    outside = f", {100 * cost.overhead:.1f} % of it outside the runs" if cost.overhead > 0 else ""
    lines = [
        title,
        *loads,
        f"  {cost.designs} designs, {cost.runs} runs, {cost.seconds:.0f} s{outside}",
    ]
    if verdict is None:
        return [*lines, _so_far(findings)]
    if not findings.finished:
        lines.append("  stopped early: figures are missing")
    lines += _design_lines(problem, verdict)
    audit = findings.audit
    if audit is not None and audit.designs:
        what = (
            f"of {audit.designs} designs left behind and now run in full, {audit.missed} beat the "
            "best found"
        )
        lines.append(f"  {what}; rank correlation {audit.rank_correlation:.2f}")
    lines += _condition_lines(findings)
    if findings.wider is not None:
        had = problem.model.modes
        wider = findings.wider
        lines.append(
            f"  winner with {wider.modes} modes: {wider.judged.score.values[0]:.4g}, "
            f"{wider.change} of its value with {had}"
        )
    if findings.service is not None:
        lines += service_lines(findings.service)
    if findings.sensitivity is not None:
        parts = ", ".join(
            f"{name} {total:.2f}"
            for name, total in zip(
                findings.sensitivity.names, findings.sensitivity.total, strict=True
            )
        )
        lines.append(f"  total Sobol indices within +-20 %: {parts}")
    return lines


def _design_lines(problem: Problem, verdict: Verdict) -> Iterator[str]:
    """Yield lines on winner, paper and rule.

    First come their variables, then their objectives for new ensemble members, the winner's ratio
    to the other two, and the bounds of the variables at which the winner lies.
    """
    free = {v.name for v in problem.space.free}
    every = compared(verdict)
    display_unit = [
        v
        for v in VARIABLES[problem.space.concept]
        if v.name in free or len({j.design.values[v.name] for j in every.values()}) > 1
    ]
    width = max(len(v.name) for v in display_unit)
    for v in display_unit:
        mine, paper, rule = (judged.design.values[v.name] for judged in every.values())
        values = f"{mine:10.4g}  (paper {paper:.4g}, rule {rule:.4g}) {v.si}"
        yield f"  {v.name:<{width}}  {values}".rstrip()
    for name, judged in every.items():
        (low, high), *_ = judged.bands
        members = f"{len(judged.members[0])} fresh members"
        level = with_band(judged.score.values[0], low, high)
        yield f"  {name} on {members}: {level}{constraint_words(problem, judged.score)}"
    if not verdict.feasible:
        yield (
            "  no feasible design: the winner is the one that breaks the constraints least; "
            "loosen them, or search longer"
        )
    elif verdict.winner in (verdict.paper, verdict.rule):
        yield (
            f"  the winner is the {PAPER if verdict.winner is verdict.paper else RULE}'s design: "
            "the search found none better on fresh members"
        )
    over = (
        f"winner over paper {verdict.gain}, over the rule's design "
        f"{verdict.gain_over(verdict.rule)}"
    )
    yield (
        f"  in brackets behind a design: the interval that holds {100 * PREDICTED:g} % of further "
        "runs"
    )
    yield (
        f"  the search thought {verdict.search_best.score.values[0]:.4g}; {over}, with "
        f"{100 * COVERED:g} % bootstrap intervals"
    )
    for line in problem.space.at_bounds(verdict.winner.design):
        yield f"  the winner lies at a bound: {line}"


def _so_far(findings: SearchResult) -> str:
    """Return a line on the best design so far of a search that has not been finished."""
    last = max((e.rungs for e in findings.evaluated), default=0)
    best = min(
        (e for e in findings.evaluated if e.score.feasible and e.rungs == last),
        key=lambda e: findings.problem.cost(e.score),
        default=None,
    )
    if best is None:
        return "  no design yet that kept all constraints"
    free = ", ".join(
        f"{v.name} {best.design.values[v.name]:.4g}" for v in findings.problem.space.free
    )
    return f"  best so far, on the search's own members: {best.score.values[0]:.4g} with {free}"


def _condition_lines(findings: SearchResult) -> Iterator[str]:
    """Yield lines on the levels of winner and paper's design, condition by condition."""
    assert findings.own is not None
    for k in range(len(findings.own.conditions)):
        row = condition_values(findings, k)
        mine = row[WINNER]
        paper = row[PAPER]
        sweep = row["sweep_over_stationary_level"]
        assert isinstance(mine, dict)
        assert isinstance(paper, dict)
        assert isinstance(sweep, float | None)
        share = mine["share_of_possible_reduction"]
        reached = (
            ""
            if share is None
            else f", {100 * share:.0f} % of the reduction that the stationary limit leaves room for"
        )
        condition = findings.own.conditions[k]
        name, unit = condition.measure_and_unit
        scale, display_unit = DISPLAY_UNITS[condition.measure_and_unit[1]]
        ends = [
            math.nan if x is None else scale * x for x in mine[f"{name}_5_to_95_percent_{unit}"]
        ]
        level = with_band(scale * mine[f"{name}_{unit}"], ends[0], ends[1], "{:.3f}", display_unit)
        levels = f"{level}, {100 * mine['relative']:.1f} % of no absorber"
        where = reading(findings.problem, condition, mine["level_frequency_ratio"])
        yield (
            f"  {condition.words}: {levels}{where} (paper {100 * paper['relative']:.1f} %){reached}"
        )
        for name, part in ((WINNER, mine), (PAPER, paper)):
            if part["branches"] is not None:
                low, high = (
                    f"{100 * x:.1f} % ({100 * share:.0f} % of the members)"
                    for x, share in zip(
                        part["branches"]["relative"],
                        part["branches"]["shares_of_members"],
                        strict=True,
                    )
                )
                yield f"    {name} has two branches: {low} and {high}"
        if sweep is not None:
            fast = ": too fast to tell the share of the possible" if sweep < LEAST_RATIO else ""
            first, last = condition.limits
            yield (
                f"    the sweeps, {first:.3g} to {last:.3g} of the resonance, show {sweep:.3f} of "
                f"the stationary level without absorber{fast}"
            )
    assert findings.verdict is not None
    if is_any_at_end(findings.problem, (findings.verdict.winner,)):
        yield f"  Warning: {END_WARNING}."


# label, display unit and factor from the SI unit to it of each of the service loads
WORDS = {
    IMPACT_SPEED: ("largest impact speed", "m/s", 1.0),
    IMPACT_RMS: ("RMS impact speed", "m/s", 1.0),
    IMPACT_RATE: ("impacts", "1/s", 1.0),
    IMPACT_POWER: ("power lost in impacts (wear)", "mW", 1e3),
    FRICTION_HEAT: ("friction heat", "mW", 1e3),
    STROKE: ("stroke from the middle", "mm", 1e3),
    ACCELERATION: ("largest acceleration of the structure", "m/s^2", 1.0),
}


def _range_of(name: str) -> str:
    """Return the tolerance of the quantity ``name`` as a text, such as "-+10 %"."""
    kind, size = (BEAM_TOLERANCES | TOLERANCES)[
        name if name in BEAM_TOLERANCES else parts_of(name)[0]
    ]
    return {
        "share": f"-+{100 * size:g} %",
        "factor": f"over and times {size:g}",
        "difference": f"-+{size:g}",
    }[kind]


def service_summary(service: Service) -> Json:
    """Return a design's service loads, and its levels with tolerances, as JSON values.

    They are in SI units and listed by condition.
    """
    rows = [
        {
            "resonance": condition.resonance,
            "force_n": condition.force,
            "watched_5_50_95_percent": {
                name: numbers(values[:, c]) for name, values in service.measures.items()
            },
            "forces_that_it_halves_n": numbers(service.forces[:, c]),
            "level_m": float(service.level[c]),
            "level_with_one_number_off_m": {
                name: numbers(values[:, c]) for name, values in service.single.items()
            },
            "draws_with_all_off": service.draws,
            "level_with_all_off_m": {
                f"{100 * q:g} %": x
                for q, x in zip(QUANTILES, numbers(service.joint[:, c]), strict=True)
            },
            "lasting_level_m": number(service.lasting[c]),
        }
        for c, condition in enumerate(service.conditions)
    ]
    return {"tolerances": {name: _range_of(name) for name in service.single}, "conditions": rows}


def load_pairs(measures: dict[str, NDArray[np.float64]], c: int) -> Iterator[tuple[str, str]]:
    """Yield the service loads of a design under condition ``c``.

    Each is a pair: a label, and the median with its band and unit as a text. ``measures`` are those
    of `Service.measures`.
    """
    for name, values in measures.items():
        word, unit, scale = WORDS[name]
        low, middle, high = (scale * x for x in values[:, c])
        yield word, with_band(middle, low, high, "{:.3g}", unit)


def service_pairs(service: Service, c: int) -> Iterator[tuple[str, str]]:
    """Yield a design's service loads and levels with tolerances under condition ``c``.

    Each is a pair of texts: a label, and the value with its unit.
    """
    yield from load_pairs(service.measures, c)
    low, high = service.forces[:, c]
    yield (
        "halves the level at least from",
        "no force: not at this one" if math.isnan(low) else f"{low:.3g} to {high:.3g} N",
    )
    for name, values in service.single.items():
        small, large = (f"{100 * (x / service.level[c] - 1):+.0f} %" for x in values[:, c])
        yield f"{name.replace('_', ' ')} off by {_range_of(name)}: level", f"{small} and {large}"
    parts = ", ".join(
        f"{100 * q:g} %: {1e3 * x:.3g} mm"
        for q, x in zip(QUANTILES, service.joint[:, c], strict=True)
    )
    yield f"all of them off at once, quantiles of {service.draws} draws", parts
    over = service.lasting[c] / service.level[c]
    yield (
        "a lasting vibration at the worst frequency:",
        f"{1e3 * service.lasting[c]:.3g} mm, {over:.2f} of the sweep's level",
    )


def service_lines(service: Service) -> Iterator[str]:
    """Yield `service_pairs` as lines of text, condition by condition."""
    for c, condition in enumerate(service.conditions):
        yield f"  in service at resonance {condition.resonance}, {condition.force:g} N:"
        yield from (f"    {name} {value}" for name, value in service_pairs(service, c))


def make_report(
    result: SearchResult,
    frequency: Sequence[ResonanceCurves] = (),
    conditions: Mapping[str, object] | None = None,
) -> Report:
    """Return the report of a search.

    ``frequency``: levels of the winner over the frequency; ``conditions``: further values for
    summary.json.
    """
    tables = {"designs.csv": design_table(result.problem, result.evaluated)}
    figures: dict[str, Draw] = {}
    drawn = (
        ("curves", result.curves, draw_curves),
        ("detuned", result.detuned, draw_robustness),
        ("map", result.gap_map, draw_map),
    )
    for name, levels, draw in drawn:
        if levels is None:
            continue
        of_map = name == "map"
        table = level_table(levels, () if of_map else (WINNER, PAPER), result.gaps)
        tables[f"{name}.csv"] = table
        figures[f"{name}.png"] = partial(draw, result)
    figures |= frequency_figures(frequency)
    if result.sensitivity is not None:
        figures["sensitivity.png"] = partial(draw_sensitivity, result.sensitivity)
    groups, warnings = card_groups(result)
    return Report(
        title=f"Search for the best design: {result.problem.space.concept}",
        verdict=winner_line(result),
        text=[lines_of(result)],
        numbers={**(conditions or {}), **summary(result)},
        tables=tables | frequency_tables(frequency),
        figures=figures,
        groups=groups,
        charts=(*map(_over_force, result.curves or ()), *frequency_charts(frequency)),
        warnings=warnings,
    )


def winner_line(result: SearchResult) -> str:
    """Return a text with the winner's first objective, and its ratio to that of the paper's design.

    The text is empty before there is a winner.
    """
    verdict = result.verdict
    if verdict is None:
        return ""
    value = f"{result.problem.objectives[0].label} {verdict.winner.score.values[0]:.4g}"
    return (
        f"Winner: {value}, over the paper's design "
        f"{verdict.gain}{constraint_words(result.problem, verdict.winner.score)}."
    )


def card_groups(result: SearchResult) -> tuple[tuple[Group, ...], tuple[str, ...]]:
    """Return the groups of rows of the winner's card, and warnings.

    The groups are the winner's variables, the objectives of the three designs, one group for each
    condition (`_condition_rows`), and the assumptions.
    """
    problem = result.problem
    verdict = result.verdict
    groups: list[Group] = []
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
            warnings.append(END_WARNING)
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
                *study_assumptions(problem, more),
                Row("searched", f"{result.cost.designs} designs, {result.cost.runs} runs"),
            ),
        )
    )
    return tuple(groups), tuple(warnings)


def study_assumptions(problem: Problem, more: str = "") -> tuple[Row, ...]:
    """Return the rows on the assumptions of the runs: model, resonances and sweep rate.

    ``more`` is a text that is appended to the row on the modes.
    """
    resonances = () if problem.under_loads else tuple(c.resonance for c in problem.conditions)
    return assumed_rows(
        problem.model, resonances, None if problem.under_loads else problem.rate, more
    )


def _condition_rows(result: SearchResult, k: int) -> tuple[Row, ...]:
    """Return the rows on condition ``k``: levels of designs and baselines, and service loads.

    The designs are the winner and the paper's; the service loads are the winner's.
    """
    assert result.own is not None
    values = condition_values(result, k)
    condition = result.own.conditions[k]
    name, unit = condition.measure_and_unit
    scale, display_unit = DISPLAY_UNITS[condition.measure_and_unit[1]]
    rows = []
    for who in (WINNER, PAPER):
        one: dict[str, Any] = values[who]
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
        if result.baselines:
            baselines = result.baselines[k]
            assert baselines is not None
            rows += baseline_rows(baselines)
        bound = stationary_limit(result.problem, design, condition)
        rows += [] if math.isnan(bound) else [Row(NO_DEVICE, MM * bound, "mm")]
    if result.service is not None:
        rows += [Row(*pair) for pair in service_pairs(result.service, k)]
    return tuple(rows)


def _over_force(part: Levels) -> Chart:
    """Return the chart of the levels of winner and paper's design over the force.

    Under loads the abscissa is the factor on the loads.
    """
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
