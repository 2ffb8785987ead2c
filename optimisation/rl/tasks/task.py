"""A task: everything about it that searching, judging, drawing and bounding its policies goes by."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from optimisation.rl.families import Family
from optimisation.rl.policies import Policy
from optimisation.rl.tasks.baseline import BEST_SCHEDULE, FEEDBACK, Baseline
from optimisation.rl.tasks.effort import Effort
from optimisation.rl.traces import Curves
from optimisation.rl.tuning import Progress

SCHEDULES, EPISODE, RESPONSES = "schedules", "episode", "responses"  # kinds of figures of what policies do
LEVEL, TIME = "level", "pseudo periods"  # columns that a table may have
FEW_SEEDS, MANY_SEEDS = 128, 1024  # of evaluation
Kinds = Mapping[str, Family]
Rest = tuple[str, Sequence[int], Mapping[str, Any]]  # of what a search takes: environment, training seeds, the environment's arguments
Search = Callable[[Kinds, Rest, Effort, Progress | None], list[Baseline]]
Traced = Callable[[Mapping[str, Sequence[Policy]], Sequence[int], Mapping[str, Any]], Curves]


class Figure(NamedTuple):
    """The figure of what policies do, TASK_KIND.png: its kind (one of `SCHEDULES`, `EPISODE`, `RESPONSES`), title, and the baselines in it."""

    kind: str
    title: str
    shown: tuple[str, ...]


class Luck(NamedTuple):
    """What schedules are drawn from at random: a kind of policies, and the bounds of its numbers."""

    kind: str
    bounds: Sequence[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task by its name, environment and ``words`` for tables and titles. What has a default is as the tasks of the suite have it.

    ``kinds(behind)`` returns its kinds of policies by name; ``behind`` is the task behind its environment. ``search(kinds, rest, effort, advance)``
    returns its baselines, all but chance, with their numbers chosen, and ``tried(effort)`` how many candidates that tries; there are
    ``more_training`` times as many training seeds as an effort says.

    ``zero`` and ``one`` are the baselines with the normalised scores 0 and 1; ``rival`` is what agents are compared with episode by episode: the
    best that needs no learning and knows no more, or what does not look at the response. All policies are judged on ``evaluation_seeds`` seeds.

    ``curves(policies, seeds, arguments)`` returns what ``figure`` shows; the profile marks the mean scores of the baselines ``marked``; the table
    has ``columns`` beside those of every table. ``luck`` is what a ceiling is made of, None where there is none.
    """

    name: str
    env_id: str
    words: str
    kinds: Callable[[Any], dict[str, Family]]
    search: Search
    tried: Callable[[Effort], int]
    curves: Traced
    figure: Figure
    zero: str
    one: str = FEEDBACK
    rival: str = BEST_SCHEDULE
    columns: tuple[str, ...] = (LEVEL, TIME)
    marked: tuple[str, ...] = (BEST_SCHEDULE,)
    luck: Luck | None
    more_training: int = 2  # episodes of the suite are short
    evaluation_seeds: int = MANY_SEEDS

    @property
    def yardsticks(self) -> tuple[str, str, str]:
        """The baselines that agents are measured with: ``zero``, ``one`` and ``rival``."""
        return self.zero, self.one, self.rival
