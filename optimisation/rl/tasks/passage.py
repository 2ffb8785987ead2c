"""The passages of the suite (plain, noisy, delayed): schedules that may go back blindly, and the rule that tries again where it has to."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from optimisation.rl.families import Array, ConstantAction, Family, FrequencyWindow, Rates
from optimisation.rl.passage_rules import BlindTries, SmallRule, TryAgain
from optimisation.rl.play import ACTION, DELAYED, NOISY, PASSAGE
from optimisation.rl.tasks.baseline import BEST_CONSTANT, BEST_SCHEDULE, BLIND, FEEDBACK, WINDOW, Baseline
from optimisation.rl.tasks.effort import Effort, grid, spent
from optimisation.rl.tasks.task import RESPONSES, Figure, Kinds, Luck, Rest, Task
from optimisation.rl.traces import response_curves
from optimisation.rl.tuning import Progress, best_of, evolve

# numbers of a passage's way, and where they may lie
WAY_BOUNDS = [(0, 1), (0, 1), (0, 1), (0.3, 0.7), (0, 1), (0.2, 0.6), (-1, 0)]
STARTS = ((0.9, 0.77, 0.5, 0.5, 0.0, 0.38, -0.3), (0.9, 0.9, 1.0, 0.47, 0.1, 0.4, -0.4))
TRY_ENDS, BLIND_ENDS = ((2.5, 0.05), [(0.5, 8.5), (0.0, 0.5)]), ((3.0,), [(-0.4, 8.4)])
WINDOW_STARTS = ((0.35, 0.5, 0.05, 1.0), (0.33, 0.47, 0.1, 1.0))


def kinds(behind: Any) -> dict[str, Family]:
    """Return the kinds of policies by name."""
    rates = Rates.of(behind)
    return {
        "constant": ConstantAction(),
        "window": FrequencyWindow(rates),
        "blind": BlindTries(rates),
        "feedback": TryAgain(rates),
        "small": SmallRule(rates),
    }


def search(kinds: Kinds, rest: Rest, effort: Effort, advance: Progress | None) -> list[Baseline]:
    """Return the best constant rate, the best window, blind tries, and the feedback rule.

    Of the two schedules the one with the better score on the seeds that no search saw is the best open-loop schedule.
    """
    constant = best_of(kinds["constant"], grid(effort, 0.0), *rest, advance)
    window = evolve(kinds["window"], WINDOW_STARTS, np.array([(0, 1), (0, 1), (0, 1), (0, 1)]), *rest, effort.suite, advance)
    found = {}
    for kind, (end, bounds) in (("blind", BLIND_ENDS), ("feedback", TRY_ENDS)):
        starts = [(*start, *end) for start in STARTS]
        found[kind] = evolve(kinds[kind], starts, np.array(WAY_BOUNDS + bounds, dtype=np.float64), *rest, effort.suite, advance)
    simple = window.score >= found["blind"].score
    return [
        Baseline.tuned(BEST_CONSTANT, "constant", constant),
        Baseline.tuned(BEST_SCHEDULE if simple else WINDOW, "window", window),
        Baseline.tuned(BLIND if simple else BEST_SCHEDULE, "blind", found["blind"]),
        Baseline.tuned(FEEDBACK, "feedback", found["feedback"]),
    ]


def tried(effort: Effort) -> int:
    """Return how many candidates a search is going to try."""
    return effort.grid + spent(effort.suite, 6)


def responses(behind: Any, taken: Mapping[str, Array]) -> dict[str, Array]:
    """Return the rates (% per 100 pseudo periods) of what was done in intervals."""
    return {"rate": Rates.of(behind).rate(taken[ACTION])}


def _passage(name: str, env_id: str, words: str) -> Task:
    return Task(
        name=name,
        env_id=env_id,
        words=words,
        kinds=kinds,
        search=search,
        tried=tried,
        curves=partial(response_curves, env_id, (ACTION,), responses),
        figure=Figure(RESPONSES, words.capitalize(), (BEST_CONSTANT, FEEDBACK, BEST_SCHEDULE)),
        zero=BEST_CONSTANT,
        luck=Luck("blind", WAY_BOUNDS + BLIND_ENDS[1]),
    )


TASKS = (
    _passage("passage", PASSAGE, "passage (v1)"),
    _passage("noisy", NOISY, "noisy passage"),
    _passage("delayed", DELAYED, "delayed passage"),
)
