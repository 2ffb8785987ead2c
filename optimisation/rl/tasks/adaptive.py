"""Rate and gap together: constant, scheduled, by the true force, and by the estimated one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from optimisation.rl.families import Array, Family, Rates
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.play import ACTION, ADAPTIVE
from optimisation.rl.sweep_gap_rules import ConstantPair, PairByEstimatedForce, PairByTrueForce, PairOverFrequency
from optimisation.rl.tasks.baseline import BEST_PAIR, BEST_SCHEDULE, FEEDBACK, ORACLE, Baseline
from optimisation.rl.tasks.effort import Effort, spent
from optimisation.rl.tasks.gap import MEMORY_BOUNDS, RULE_BOUNDS
from optimisation.rl.tasks.task import RESPONSES, Figure, Kinds, Luck, Rest, Task
from optimisation.rl.traces import response_curves
from optimisation.rl.tuning import Progress, best_of, evolve

PACE_BOUNDS, PARABOLA_BOUNDS = [(-1, 1), (0, 1), (-1, 1)], [(-1, 1), (-2, 2), (-2, 2)]
WORDS = "rate and gap"


def kinds(behind: Any) -> dict[str, Family]:
    """Return the kinds of policies by name."""
    rates, scale = Rates.of(behind), GapScale(behind)
    return {
        "pair": ConstantPair(),
        "schedule": PairOverFrequency(rates),
        "true force": PairByTrueForce(rates, scale),
        "feedback": PairByEstimatedForce(rates, scale),
    }


def _points(effort: Effort) -> int:
    """Return how many values of a rate's range, and of the gap's, constant pairs are made of: twice as many as a grid has."""
    return max(2, round(np.sqrt(4 * effort.grid)))


def search(kinds: Kinds, rest: Rest, effort: Effort, advance: Progress | None) -> list[Baseline]:
    """Return what policies of rate and gap come to: constant, scheduled, by the true force, and by the estimated one."""
    points = np.linspace(-1, 1, _points(effort))
    pairs = np.array([(rate, gap) for rate in points[len(points) // 2 :] for gap in points])
    constant = best_of(kinds["pair"], pairs, *rest, advance)
    rate, gap = constant.parameters
    plan = (
        ("schedule", [(rate, 0.5, rate, gap, 0.0, 0.0)], PACE_BOUNDS + PARABOLA_BOUNDS),
        ("true force", [(rate, 0.5, rate, 1.5, 0.0)], PACE_BOUNDS + RULE_BOUNDS),
        ("feedback", [(rate, 0.5, rate, 1.5, 0.0, 1.0, 0.7), (0.0, 0.9, rate, 1.5, 0.0, 1.0, 0.9)], PACE_BOUNDS + RULE_BOUNDS + MEMORY_BOUNDS),
    )
    found = {kind: evolve(kinds[kind], starts, np.array(bounds, dtype=np.float64), *rest, effort.suite, advance) for kind, starts, bounds in plan}
    return [
        Baseline.tuned(BEST_PAIR, "pair", constant),
        Baseline.tuned(BEST_SCHEDULE, "schedule", found["schedule"]),
        Baseline.tuned(ORACLE, "true force", found["true force"]),
        Baseline.tuned(FEEDBACK, "feedback", found["feedback"]),
    ]


def tried(effort: Effort) -> int:
    """Return how many candidates a search is going to try."""
    points = _points(effort)
    return points * (points - points // 2) + spent(effort.suite, 4)


def responses(behind: Any, taken: Mapping[str, Array]) -> dict[str, Array]:
    """Return rates (% per 100 pseudo periods) and gaps, over the design rule's for the true force, of what was done in intervals."""
    return {"rate": Rates.of(behind).rate(taken[ACTION]), "gap": taken["gap"] / taken["force"] * GapScale(behind).force_per_gap}


TASK = Task(
    name="adaptive",
    env_id=ADAPTIVE,
    words=WORDS,
    kinds=kinds,
    search=search,
    tried=tried,
    curves=partial(response_curves, ADAPTIVE, (ACTION, "gap", "force"), responses),
    figure=Figure(RESPONSES, WORDS.capitalize(), (BEST_PAIR, FEEDBACK, BEST_SCHEDULE)),
    zero=BEST_PAIR,
    luck=Luck("schedule", PACE_BOUNDS + PARABOLA_BOUNDS),
)
