"""A Pareto study as numbers: rows for a CSV file, a summary for JSON, and a text to read."""

import numpy as np
from numpy.typing import NDArray

from optimisation.files import Table, numbers
from optimisation.measures import LABELS, LEVEL
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.design_tables import END_WARNING, is_any_at_end, limit, name_of
from optimisation.search.pareto import Front

Json = dict[str, object]


def front_table(front: Front) -> Table:
    """Return a table with a row for each design, by number; an empty cell where it did not run on fresh members."""
    fresh = {} if front.fresh is None else dict(zip(front.index, front.fresh, strict=True))
    free = [v.name for v in front.problem.space.free]
    names = [name_of(objective) for objective in front.problem.objectives]
    rows = []
    for k, e in enumerate(front.evaluated):
        again = fresh[k].score.values if k in fresh else [""] * len(names)
        rows.append(
            [
                e.number,
                *(e.design.values[name] for name in free),
                *e.score.values,
                int(k in front.index),
                *again,
            ]
        )
    return ["number", *free, *names, "on_front", *(f"{name}_fresh" for name in names)], rows


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


def front_text(front: Front) -> str:
    """Return the study's result as a text to read."""
    problem = front.problem
    cost = front.cost
    lines = [f"{problem.space.concept}: " + " against ".join(o.label for o in problem.objectives)]
    lines.append(
        f"  {cost.designs} designs, {cost.runs} runs, {cost.seconds:.0f} s, {100 * cost.overhead:.1f} % of it outside the runs"
    )
    for k, condition in enumerate(problem.conditions):
        ratio = problem.sweep_ratio(condition)
        if condition.loads is not None:
            lines.append(
                f"  under {condition.words}; the level is the {LABELS[condition.measure_and_unit[0]]}"
            )
            continue
        low, high = condition.limits
        lines.append(
            f"  resonance {condition.resonance}: sweeps from {low:.3g} to {high:.3g} of it show {ratio:.3f} of the stationary level without absorber"
        )
        if front.fresh:
            lines[-1] += f"; levels of the front {front_reading(front, k)}"
    if front.fresh and is_any_at_end(problem, front.fresh):
        lines.append(f"  Warning: {END_WARNING}.")
    names = [name_of(objective) for objective in problem.objectives]
    header = [*(v.name for v in problem.space.free), *names, *(f"{name} fresh" for name in names)]
    lines.append("  " + "  ".join(f"{name:>14}" for name in header))
    for k, e in enumerate(front.members):
        again = [] if front.fresh is None else list(front.fresh[k].score.values)
        values = [*(e.design.values[v.name] for v in problem.space.free), *e.score.values, *again]
        lines.append("  " + "  ".join(f"{value:14.4g}" for value in values))
    if front.paper is not None:
        lines.append(
            "  paper's design on fresh members: "
            + ", ".join(f"{x:.4g}" for x in front.paper.score.values)
        )
    fresh = "" if front.fresh_volume is None else f", {front.fresh_volume:.4g} on fresh members"
    lines.append(
        f"  hypervolume {front.volume:.4g}{fresh} up to the corner {front.corner[0]:g}, {front.corner[1]:g}"
    )
    for seed, mine, random in front.against:
        lines.append(
            f"  seed {seed}: {mine:.4g}, random search {random:.4g}, {100 * (mine / random - 1):+.1f} %"
            if random > 0
            else f"  seed {seed}"
        )
    if front.against:
        lines.append(
            f"  larger hypervolume than a random search with the same budget in {front.won} of {len(front.against)} seeds"
        )
    return "\n".join(lines)


def bounds_of(front: Front) -> NDArray[np.float64]:
    """Return the stationary limits of the designs on the front, (designs, 2), as relative levels; NaN where the closed form does not apply."""
    problem = front.problem
    without = problem.reference(problem.ensemble[:1], problem.rate)[
        0, :, :, problem.measures.index(LEVEL)
    ].max(axis=1)
    rows = []
    for judge in front.fresh or []:
        relative = [
            limit(problem, judge.design, c) / float(w)
            for c, w in zip(problem.conditions, without, strict=True)
        ]
        own = [
            max(relative[k] for k in o.chosen(problem.conditions)) if o.kind == "level" else x
            for o, x in zip(problem.objectives, judge.score.values, strict=True)
        ]
        rows.append(own)
    return np.array(rows)
