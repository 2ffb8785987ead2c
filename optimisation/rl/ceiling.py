"""A ceiling: for each seed the best of many schedules that are drawn at random and know nothing. It is made of luck, no target for anyone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from impact_env.parameters import ParameterError
from optimisation.rl.families import Array, policy_of, task_of
from optimisation.rl.play import play
from optimisation.rl.tasks.table import SUITE, task_named
from optimisation.rl.tuning import CHUNK, Progress

DRAWS, SEEDS = 256, 64


def best_by_luck(task: str, seeds: Sequence[int], arguments: Mapping[str, Any], draws: int = DRAWS, advance: Progress | None = None) -> Array:
    """Return for each seed (E,) of a task of the suite the best score of ``draws`` schedules, the same ones for every seed.

    Raises ParameterError for a task that has no such schedules.
    """
    own = task_named(task)
    if own.luck is None:
        raise ParameterError(f"task = {task!r} is not allowed: one of {', '.join(SUITE)}, which have schedules to draw at random")
    family = own.kinds(task_of(own.env_id, arguments))[own.luck.kind]
    low, high = np.array(own.luck.bounds, dtype=np.float64).T
    drawn = np.random.default_rng(0).uniform(low, high, (draws, len(low)))
    best = np.full(len(seeds), -np.inf)
    together = max(1, CHUNK // len(seeds))
    for part in np.array_split(drawn, range(together, draws, together)):
        policy = policy_of("luck", family, np.repeat(part, len(seeds), axis=0))
        scores = play(policy, own.env_id, list(seeds) * len(part), arguments).scores.reshape(len(part), len(seeds))
        best = np.maximum(best, scores.max(axis=0))
        if advance is not None:
            advance(len(part))
    return best
