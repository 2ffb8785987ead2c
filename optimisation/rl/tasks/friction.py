"""The friction limit over a passage: constant, scheduled over the frequency, by the true force, and by one look."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from optimisation.rl.families import Array, ConstantAction, Family, OpenLoop, Rates
from optimisation.rl.friction_rules import LimitByLook, LimitByTrueForce, LimitScale
from optimisation.rl.play import FRICTION
from optimisation.rl.tasks.baseline import BEST_LIMIT, BEST_SCHEDULE, FEEDBACK, ORACLE, Baseline
from optimisation.rl.tasks.effort import Effort, grid, spent
from optimisation.rl.tasks.task import RESPONSES, Figure, Kinds, Luck, Rest, Task
from optimisation.rl.traces import response_curves
from optimisation.rl.tuning import Progress, best_of, evolve

KNOTS = 6
KNOT_BOUNDS = [(-1, 1)] * KNOTS
LIMIT_STARTS, LIMIT_BOUNDS = ((1.0, 0.9, 0.5, 1.0, 0.0), (0.5, 0.5, 0.0, 1.0, 0.0)), [(-1, 1), (0.2, 0.98), (-1, 1), (0.0, 2.5), (-1, 1)]
WORDS = "friction limit"


def kinds(behind: Any) -> dict[str, Family]:
    """Return the kinds of policies by name."""
    limits = LimitScale(behind)
    return {
        "constant": ConstantAction(),
        "schedule": OpenLoop(Rates.of(behind), KNOTS),
        "true force": LimitByTrueForce(limits),
        "feedback": LimitByLook(limits),
    }


def search(kinds: Kinds, rest: Rest, effort: Effort, advance: Progress | None) -> list[Baseline]:
    """Return what policies of the friction limit come to: constant, scheduled over the frequency, by the true force, and by one look."""
    constant = best_of(kinds["constant"], grid(effort), *rest, advance)
    (action,), half = constant.parameters, KNOTS // 2  # the schedule begins as a constant, and as the rules do: fast at first
    plan = (
        ("schedule", [(action,) * KNOTS, (action,) * half + (0.5,) * half], KNOT_BOUNDS),
        ("true force", LIMIT_STARTS, LIMIT_BOUNDS),
        ("feedback", LIMIT_STARTS, LIMIT_BOUNDS),
    )
    found = {kind: evolve(kinds[kind], starts, np.array(bounds, dtype=np.float64), *rest, effort.suite, advance) for kind, starts, bounds in plan}
    return [
        Baseline.tuned(BEST_LIMIT, "constant", constant),
        Baseline.tuned(BEST_SCHEDULE, "schedule", found["schedule"]),
        Baseline.tuned(ORACLE, "true force", found["true force"]),
        Baseline.tuned(FEEDBACK, "feedback", found["feedback"]),
    ]


def tried(effort: Effort) -> int:
    """Return how many candidates a search is going to try."""
    return effort.grid + spent(effort.suite, 6)


def responses(behind: Any, taken: Mapping[str, Array]) -> dict[str, Array]:  # noqa: ARG001
    """Return the friction limits over the true force (N/N) of what was done in intervals."""
    return {"friction_limit": taken["friction_limit"] / taken["force"]}


TASK = Task(
    name="friction",
    env_id=FRICTION,
    words=WORDS,
    kinds=kinds,
    search=search,
    tried=tried,
    curves=partial(response_curves, FRICTION, ("friction_limit", "force"), responses),
    figure=Figure(RESPONSES, WORDS.capitalize(), (BEST_LIMIT, FEEDBACK, BEST_SCHEDULE)),
    zero=BEST_LIMIT,
    luck=Luck("schedule", KNOT_BOUNDS),
)
