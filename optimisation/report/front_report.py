"""The content of a Pareto study. SI units, unless named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from optimisation.files import numbers
from optimisation.insight import stationary_limit
from optimisation.measures import LABELS, LEVEL
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.design_figures import draw_front
from optimisation.report.design_report import (
    END_WARNING,
    is_any_at_end,
    load_pairs,
    name_of,
    study_assumptions,
)
from optimisation.report.report import Chart, Column, Curve, Draw, Json, Report, Row, Table
from optimisation.search.pareto import Front

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def front_table(front: Front) -> Table:
    """Return a table with a row for each design, in the order of their numbers.

    A cell is empty if the design was not run on fresh members.
    """
    fresh = {} if front.fresh is None else dict(zip(front.index, front.fresh, strict=True))
    free = [v.name for v in front.problem.space.free]
    names = [name_of(objective) for objective in front.problem.objectives]
    rows = []
    for k, e in enumerate(front.evaluated):
        again = fresh[k].score.values if k in fresh else [None] * len(names)
        rows.append(
            [
                e.number,
                *(e.design.values[name] for name in free),
                *e.score.values,
                int(k in front.index),
                *again,
            ]
        )
    columns = ["number", *free, *names, "on_front", *(f"{name}_fresh" for name in names)]
    return Table.of_values(columns, rows)


def front_summary(front: Front) -> Json:
    """Return the study's result as JSON values."""
    rows: list[Json] = [
        {"number": e.number, "values": dict(e.design.values), "score": numbers(e.score.values)}
        for e in front.members
    ]
    for row, judge in zip(rows, front.fresh or (), strict=False):
        row["score_on_fresh_members"] = numbers(judge.score.values)
        row["level_frequency_ratios"] = [
            float(judge.ratios[k]) for k, _ in swept_conditions(front.problem)
        ]
    return {
        "problem": front.problem.describe(),
        "finished": front.finished,
        **front.cost.describe(),
        "front": rows,
        "paper": None if front.paper is None else numbers(front.paper.score.values),
        "hypervolume": {
            "corner": list(front.corner),
            "front": front.volume,
            "front_on_fresh_members": front.fresh_volume,
        },
        "against_random": [
            {"seed": seed, "method": mine, "random": random} for seed, mine, random in front.against
        ],
        "seeds_won_against_random": front.won if front.against else None,
    }


def swept_conditions(problem: Problem) -> list[tuple[int, Condition]]:
    """Return the conditions with a swept force, with their indices."""
    return [(k, c) for k, c in enumerate(problem.conditions) if c.loads is None]


def front_reading(front: Front, k: int) -> str:
    """Return where the levels of a front under a condition, by its index, were read, in words."""
    assert front.fresh is not None
    ratios = [float(judge.ratios[k]) for judge in front.fresh]
    return f"read at {min(ratios):.4g} to {max(ratios):.4g} of the resonance"


def text_blocks(front: Front) -> list[list[str | Table]]:
    """Return what is printed."""
    problem = front.problem
    cost = front.cost
    lines: list[str | Table] = [
        f"{problem.space.concept}: {title(front)}",
        (
            f"  {cost.designs} designs, {cost.runs} runs, {cost.seconds:.0f} s, "
            f"{100 * cost.overhead:.1f} % of it outside the runs"
        ),
    ]
    for k, condition in enumerate(problem.conditions):
        ratio = problem.sweep_ratio(condition)
        if condition.loads is not None:
            lines.append(
                f"  under {condition.words}; the level is the "
                f"{LABELS[condition.measure_and_unit[0]]}"
            )
            continue
        low, high = condition.limits
        swept = f"  resonance {condition.resonance}: sweeps from {low:.3g} to {high:.3g} of it"
        words = f"{swept} show {ratio:.3f} of the stationary level without absorber"
        if front.fresh:
            words += f"; levels of the front {front_reading(front, k)}"
        lines.append(words)
    if front.fresh and is_any_at_end(problem, front.fresh):
        lines.append(f"  Warning: {END_WARNING}.")
    return [lines, [member_table(front)], list(_volume_lines(front))]


def member_table(front: Front) -> Table:
    """Return the designs of the front with their scores.

    The scores are those with the members of the search and those with fresh members.
    """
    free = [v.name for v in front.problem.space.free]
    names = [name_of(objective) for objective in front.problem.objectives]
    rows = []
    for k, e in enumerate(front.members):
        again = [None] * len(names) if front.fresh is None else front.fresh[k].score.values
        rows.append([*(e.design.values[name] for name in free), *e.score.values, *again])
    headings = [*free, *names, *(f"{name} fresh" for name in names)]
    return Table(tuple(Column(name, name) for name in headings), rows)


def _volume_lines(front: Front) -> Iterator[str]:
    """Yield the lines on the paper's design, and on hypervolumes."""
    if front.paper is not None:
        values = ", ".join(f"{x:.4g}" for x in front.paper.score.values)
        yield f"  paper's design on fresh members: {values}"
    fresh = "" if front.fresh_volume is None else f", {front.fresh_volume:.4g} on fresh members"
    yield (
        f"  hypervolume {front.volume:.4g}{fresh} up to the corner {front.corner[0]:g}, "
        f"{front.corner[1]:g}"
    )
    for seed, mine, random in front.against:
        change = ""
        if random > 0:
            change = f": {mine:.4g}, random search {random:.4g}, {100 * (mine / random - 1):+.1f} %"
        yield f"  seed {seed}{change}"
    if front.against:
        yield (
            f"  larger hypervolume than a random search with the same budget in {front.won} of "
            f"{len(front.against)} seeds"
        )


def bounds_of(front: Front) -> NDArray[np.float64]:
    """Return the stationary limits of the designs on the front, (designs, 2).

    They are relative levels, and NaN if the closed form does not apply.
    """
    problem = front.problem
    without = problem.reference(problem.ensemble[:1], problem.rate)[
        0, :, :, problem.measures.index(LEVEL)
    ].max(axis=1)
    rows = []
    for judge in front.fresh or []:
        relative = [
            stationary_limit(problem, judge.design, c) / float(w)
            for c, w in zip(problem.conditions, without, strict=True)
        ]
        own = [
            max(relative[k] for k in o.chosen(problem.conditions)) if o.kind == "level" else x
            for o, x in zip(problem.objectives, judge.score.values, strict=True)
        ]
        rows.append(own)
    return np.array(rows)


def make_report(front: Front, conditions: Mapping[str, object] | None = None) -> Report:
    """Return the content of a front; ``conditions``: what else summary.json has."""
    problem = front.problem
    names = [objective.label for objective in problem.objectives]
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
        warnings.append(END_WARNING)
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
        *study_assumptions(problem),
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
    figures: dict[str, Draw] = {}
    if front.fresh and front.paper is not None:
        figures["front.png"] = partial(draw, front)
    return Report(
        title=title(front),
        verdict=f"{len(front.members)} of {front.cost.designs} designs are on the front.",
        text=text_blocks(front),
        numbers={**(conditions or {}), **front_summary(front)},
        tables={"front.csv": front_table(front)},
        figures=figures,
        groups=groups,
        charts=(Chart("Front", names[0], names[1], tuple(curves)),),
        warnings=tuple(warnings),
    )


def title(front: Front) -> str:
    """Return the two objectives in words."""
    return " against ".join(objective.label for objective in front.problem.objectives)


def draw(front: Front) -> Figure:
    """Draw the front with all designs of the search, and the stationary limits."""
    assert front.paper is not None
    first, second = (objective.label for objective in front.problem.objectives)
    searched, members = (
        np.array([e.score.values for e in part]) for part in (front.evaluated, front.members)
    )
    fresh = np.array([judge.score.values for judge in front.fresh or ()])
    paper = np.array(front.paper.score.values)
    return draw_front((first, second), searched, members, fresh, paper, bounds_of(front))
