"""Whether a task has room: how far a planner is above what rules of few numbers do, from constants to rules of eight, on seeds that no search saw.

Room = (robust oracle - best rule of at most eight numbers) / (robust oracle - best constant). A task is admitted from 0.15 on, with its interval
above 0.1. Clairvoyance alone would admit luck.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from impact_env.envs import ENVIRONMENTS
from impact_env.envs.evaluation import interval
from optimisation.rl.active_rules import ACTIVE, PAIRS, Blind, BlindPair
from optimisation.rl.families import Array, ConstantAction, policy_of
from optimisation.rl.oracle import Planner, plan
from optimisation.rl.play import play
from optimisation.rl.sweep_gap_rules import ConstantPair
from optimisation.rl.tuning import Progress, Search, best_of, evolve

FIRST_SEARCHED, FIRST_JUDGED = 1000, 2_500_000  # seeds; the latter are apart from those that train, validate and test
CONSTANT, BLIND, FOUR, EIGHT, CLAIRVOYANT, ROBUST = "best constant", "blind schedule", "rule of 4", "rule of 8", "clairvoyant oracle", "robust oracle"
ROOM, LEAST, SURE = "room", 0.15, 0.1
LARGEST = 3.0  # of a rule's numbers


FOURS = Search(generations=20, population=12, sigma=0.1, finalists=5, relative=True)
EIGHTS = Search(generations=45, population=14, sigma=0.04, finalists=8, relative=True)


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
    four=Search(generations=14, population=10, sigma=0.1, finalists=5, relative=True),
    eight=Search(generations=25, population=12, sigma=0.04, finalists=5, relative=True),
)
EFFORTS = {
    "ImpactAbsorber/ActiveFriction-v0": Effort(),
    "ImpactAbsorber/ActiveGap-v0": LESS,
    "ImpactAbsorber/Structures-v0": replace(LESS, judged=32, horizon=12, points=5),
    "ImpactAbsorber/Passage-v0": replace(LESS, horizon=10),
}  # what an hour of one core is enough for
FEW = Search(generations=2, population=6, sigma=0.1, finalists=2, relative=True)
QUICK = Effort(searched=12, judged=8, grid=5, four=FEW, eight=FEW, horizon=4, points=3)


class Held:
    """A family with its last numbers held at what leaves it a rule of few."""

    informed = False

    def __init__(self, family: Any) -> None:
        self.family, self.names = family, family.names[: family.few]

    def begin(self, lanes: int) -> None:
        """Forget what was seen."""
        self.family.begin(lanes)

    def act(self, parameters: Array, observations: Any, info: Any) -> Array:
        """Return the family's actions."""
        rest = np.broadcast_to(self.family.neutral[self.family.few :], (len(parameters), len(self.family.names) - self.family.few))
        actions: Array = self.family.act(np.concatenate([parameters, rest], axis=1), observations, info)
        return actions


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


def tried(name: str, effort: Effort) -> int:
    """Return how many candidates, and decisions of planners, an admission is going to try at most."""
    spent = sum(effort.four.generations * effort.four.population * len(family.begins) for family in families(name))
    return spent + (len(families(name)) * effort.eight.generations + effort.four.generations) * effort.eight.population


def families(name: str) -> list[Any]:
    """Return the families of rules for an environment."""
    return [family() for family in (PAIRS if ENVIRONMENTS[name].numbers == 2 else ACTIVE)]


def rules(name: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None) -> dict[str, Rule]:
    """Return the best constant, blind schedule, rule of at most four and of at most eight numbers: the latter begins at the former."""
    pair = ENVIRONMENTS[name].numbers == 2
    rest = (name, range(FIRST_SEARCHED, FIRST_SEARCHED + effort.searched), arguments)

    def found(family: Any, starts: Sequence[Sequence[float]], search: Search) -> Rule:
        tuned = evolve(family, starts, np.array([(-LARGEST, LARGEST)] * len(family.names)), *rest, search, advance)
        return Rule(family, tuned.parameters, tuned.score)

    points = np.linspace(-1, 1, effort.grid)
    grid = np.array([(a, b) for a in points for b in points]) if pair else points[:, None]
    best = best_of(ConstantPair() if pair else ConstantAction(), grid, *rest)
    constant = Rule(ConstantPair() if pair else ConstantAction(), best.parameters, best.score)
    blind = BlindPair() if pair else Blind()
    few, many = [], []
    for family in families(name):
        starts = [begin(constant.numbers) for begin in family.begins]
        few.append(found(Held(family), starts, effort.four))
        many.append(found(family, [(*few[-1].numbers, *family.neutral[family.few :])], effort.eight))
    four = max(few, key=lambda rule: rule.score)
    eight = max([four, *many], key=lambda rule: rule.score)
    return {CONSTANT: constant, BLIND: found(blind, [blind.start(constant.numbers)], effort.four), FOUR: four, EIGHT: eight}


def room(oracle: Array, rule: Array, constant: Array) -> float:
    """Return the room above a rule, for scores (1, E)."""
    return float((oracle.mean() - rule.mean()) / (oracle.mean() - constant.mean()))


def admit(name: str, arguments: Mapping[str, Any], effort: Effort, agents: Sequence[Any] = (), advance: Progress | None = None) -> dict[str, Any]:
    """Return what an admission finds: rules with their numbers, scores (E,) of all, and room with its interval."""
    chosen = rules(name, arguments, effort, advance)
    seeds = range(FIRST_JUDGED, FIRST_JUDGED + effort.judged)
    scores = {label: play(policy_of(label, rule.family, list(rule.numbers)), name, seeds, arguments).scores[None] for label, rule in chosen.items()}
    points = np.linspace(-1, 1, effort.points)
    actions = [(a, b) for a in points[::3] for b in points[::3]] if ENVIRONMENTS[name].numbers == 2 else [(a,) for a in points]
    planner = Planner(actions, horizon=effort.horizon, copies=effort.copies)
    best = (chosen[EIGHT].family, np.array(chosen[EIGHT].numbers))
    scores[ROBUST] = plan(name, seeds, arguments, best, planner, advance)[None]
    scores[CLAIRVOYANT] = plan(name, seeds, arguments, best, replace(planner, copies=1, exact=True), advance)[None]
    by_algorithm: dict[str, list[Array]] = {}
    for agent in agents:
        by_algorithm.setdefault(agent.algorithm.upper(), []).append(play(agent, name, seeds, arguments).scores)
    scores |= {algorithm: np.stack(runs) for algorithm, runs in by_algorithm.items()}
    compared = (scores[ROBUST], scores[EIGHT], scores[CONSTANT])
    low, high = interval(room, *compared)
    share = room(*compared)
    return {
        "env_id": name,
        "arguments": dict(arguments),
        "effort": asdict(effort),
        "rules": {label: {"family": rule.name, "numbers": list(rule.numbers)} for label, rule in chosen.items()},
        "scores": {label: np.round(values, 6).tolist() for label, values in scores.items()},
        ROOM: [share, float(low), float(high)],
        "admitted": bool(share >= LEAST and low > SURE),
    }
