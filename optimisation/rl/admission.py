"""Whether a task has room: how far a planner is above what rules of few numbers do, from constants to rules of eight, on seeds that no search saw.

Room = (robust oracle - best rule of at most eight numbers) / (robust oracle - best constant). A task is admitted from 0.15 on, with its interval
above 0.1. Clairvoyance alone would admit luck.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from impact_env.envs import ENVIRONMENTS
from impact_env.envs.evaluation import interval, play
from optimisation.rl.families import Array, Family, FamilyPolicy, task_of
from optimisation.rl.oracle import Planner, plan
from optimisation.rl.rules import BLIND, CONSTANT, EIGHT, FOUR, TASKS, env_of
from optimisation.rl.tuning import Progress, Search, best_of, evolve

FIRST_SEARCHED, FIRST_JUDGED = 1000, 2_500_000  # seeds; the latter are apart from those that train, validate and test
CLAIRVOYANT, ROBUST = "clairvoyant oracle", "robust oracle"
ROOM, LEAST, SURE = "room", 0.15, 0.1

FOURS = Search(generations=20, population=12, sigma=0.1, finalists=5)
EIGHTS = Search(generations=45, population=14, sigma=0.04, finalists=8)


@dataclass(frozen=True)
class Effort:
    """``searched`` seeds (a third of which CMA-ES sees), ``judged`` ones, points of the grid of constants, searches, and the planner's horizon."""

    searched: int = 72
    judged: int = 64
    grid: int = 17
    four: Search = FOURS
    eight: Search = EIGHTS
    horizon: int = 16
    copies: int = 4
    points: int = 7


LESS = Effort(
    searched=48,
    judged=48,
    four=Search(generations=14, population=10, sigma=0.1, finalists=5),
    eight=Search(generations=25, population=12, sigma=0.04, finalists=5),
)
EFFORTS = {
    **dict.fromkeys(TASKS, LESS),
    "ActiveFriction-v0": Effort(),
    "Structures-v0": replace(LESS, judged=32, horizon=12, points=5),
    "Passage-v0": replace(LESS, horizon=10),
}  # what an hour of one core is enough for
FEW = Search(generations=2, population=6, sigma=0.1, finalists=2)
QUICK = Effort(searched=12, judged=8, grid=5, four=FEW, eight=FEW, horizon=4, points=3)


class Held(Family):
    """A family with its last numbers held at what leaves it a rule of few."""

    def __init__(self, family: Family) -> None:
        self.family, self.names, self.begins = family, family.names[: family.few], family.begins

    def act(self, parameters: Array, observations: Any) -> Array:
        """Return the family's actions."""
        rest = np.broadcast_to(self.family.neutral[self.family.few :], (len(parameters), len(self.family.names) - self.family.few))
        return self.family.act(np.concatenate([parameters, rest], axis=1), observations)


@dataclass(frozen=True)
class Rule:
    """A family, its numbers, and their mean score on the seeds that chose among candidates."""

    family: Any
    numbers: tuple[float, ...]
    score: float

    @property
    def name(self) -> str:
        """The family's name."""
        return type(getattr(self.family, "family", self.family)).__name__


def tried(task: str, effort: Effort) -> int:
    """Return how many candidates, and decisions of planners, an admission is going to try at most."""
    looking = TASKS[task].looking
    spent = sum(effort.four.generations * effort.four.population * len(family.begins) for family in (*looking, TASKS[task].blind))
    return spent + sum(len(family.begins) for family in looking) * effort.eight.generations * effort.eight.population


def rules(task: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None) -> dict[str, Rule]:
    """Return the best constant, blind schedule, rule of at most four and of at most eight numbers: the latter begins at the former.

    There is no rule of four for a task whose families all need more.
    """
    own, behind = TASKS[task], task_of(env_of(task), arguments)
    rest = (env_of(task), range(FIRST_SEARCHED, FIRST_SEARCHED + effort.searched), arguments)

    def found(family: Family, starts: Sequence[Sequence[float]], search: Search) -> Rule:
        tuned = evolve(family, starts, *rest, search, advance)
        return Rule(family, tuned.parameters, tuned.score)

    points, always = np.linspace(-1, 1, effort.grid), own.constant(behind)
    best = best_of(always, np.stack(np.meshgrid(*[points] * len(always.names), indexing="ij"), axis=-1).reshape(-1, len(always.names)), *rest)
    constant = Rule(always, best.parameters, best.score)
    few, many = [], []
    for family in (kind(behind) for kind in own.looking):
        starts = [begin(constant.numbers) for begin in family.begins]
        if family.few:
            few.append(found(Held(family), starts, effort.four))
            start = (*few[-1].numbers, *family.neutral[family.few :])
            many.append(found(family, [start], effort.eight))
        else:
            (few if len(family.names) <= 4 else many).append(found(family, starts, effort.eight))
    blind = own.blind(behind)
    chosen = {CONSTANT: constant, BLIND: found(blind, [begin(constant.numbers) for begin in blind.begins], effort.four)}
    for label, group in ((FOUR, few), (EIGHT, [*few, *many])):
        if group:
            chosen[label] = max(group, key=lambda rule: rule.score)
    return chosen


def room(oracle: Array, rule: Array, constant: Array) -> float:
    """Return the room above a rule, for scores (1, E)."""
    return float((oracle.mean() - rule.mean()) / (oracle.mean() - constant.mean()))


def admit(task: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None) -> dict[str, Any]:
    """Return what an admission finds: rules with their numbers, scores (E,) of all, and room with its interval."""
    chosen, name = rules(task, arguments, effort, advance), env_of(task)
    seeds = range(FIRST_JUDGED, FIRST_JUDGED + effort.judged)
    scores = {label: play(FamilyPolicy(label, rule.family, rule.numbers), name, seeds, arguments).scores[None] for label, rule in chosen.items()}
    if TASKS[task].planned:
        points = np.linspace(-1, 1, effort.points)
        actions = [(a, b) for a in points[::3] for b in points[::3]] if ENVIRONMENTS[name].numbers == 2 else [(a,) for a in points]
        planner = Planner(actions, horizon=effort.horizon, copies=effort.copies)
        best = (chosen[EIGHT].family, np.array(chosen[EIGHT].numbers))
        scores[ROBUST] = plan(name, seeds, arguments, best, planner, advance)[None]
        scores[CLAIRVOYANT] = plan(name, seeds, arguments, best, replace(planner, copies=1, exact=True), advance)[None]
    return {
        "arguments": dict(arguments),
        "effort": asdict(effort),
        "rules": {label: {"family": rule.name, "numbers": list(rule.numbers)} for label, rule in chosen.items()},
        "scores": {label: np.round(values, 6).tolist() for label, values in scores.items()},
        **(verdict(scores) if ROBUST in scores else {}),
    }


def add_agents(task: str, found: dict[str, Any], agents: Sequence[Any]) -> None:
    """Put the scores of agents, by algorithm, beside what an admission has found, in place of those of the same algorithms; its verdict stays."""
    seeds, runs = range(FIRST_JUDGED, FIRST_JUDGED + found["effort"]["judged"]), dict[str, list[Any]]()
    for agent in agents:
        played = play(agent, env_of(task), seeds, found["arguments"])
        runs.setdefault(agent.algorithm.upper(), []).append(np.round(played.scores, 6).tolist())
    found["scores"] |= runs


def verdict(scores: Mapping[str, Array]) -> dict[str, Any]:
    """Return the room with its interval, and whether that admits a task."""
    compared = (scores[ROBUST], scores[EIGHT], scores[CONSTANT])
    low, high = interval(room, *compared)
    share = room(*compared)
    return {ROOM: [share, float(low), float(high)], "admitted": bool(share >= LEAST and low > SURE)}
