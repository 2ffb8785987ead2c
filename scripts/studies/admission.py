"""Admission of a task: how far a planner scores above simple feedback rules.

The rules range from constants to rules of eight parameters. All are compared on seeds that no
search used. The relative advantage of the planner is called the room of the task.

Room = (robust oracle - best rule of at most eight numbers) / (robust oracle - best constant). A
task is admitted from 0.15 on, with its interval above 0.1. Clairvoyance alone would admit luck.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.checks import count, require
from impact_env.envs import ENVIRONMENTS
from impact_env.envs.evaluation import bootstrap_interval, play
from impact_env.envs.task import Mask, Task
from impact_env.extras import optional
from optimisation.rl.families import Array, Family, FamilyPolicy, Observations, task_of
from optimisation.rl.rules import BLIND, CONSTANT, EIGHT, FOUR, TASKS, env_of

# Choosing a family's numbers on training seeds: a grid for one number, CMA-ES for several. All
# candidates see the same seeds.
#
# CMA-ES: N. Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772; the implementation is
# the package cmaes.


CHUNK = 512  # lanes that are played together: candidates times seeds
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Tuned:
    """Parameters chosen for a family of rules.

    ``score`` is the mean score over the training seeds, ``candidates`` the number of candidates
    that were tried.
    """

    parameters: tuple[float, ...]
    score: float
    candidates: int


def mean_scores(
    family: Family,
    candidates: NDArray[Any],
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
) -> Array:
    """Return the mean score (C,) of each candidate (C, P) over the seeds."""
    require(len(candidates) > 0, "candidates", candidates, "at least one")
    together = max(1, CHUNK // len(seeds))
    means = []
    for part in np.array_split(candidates, range(together, len(candidates), together)):
        policy = FamilyPolicy("candidates", family, np.repeat(part, len(seeds), axis=0))
        means.append(
            play(policy, name, list(seeds) * len(part), arguments)
            .scores.reshape(len(part), len(seeds))
            .mean(axis=1)
        )
    return np.concatenate(means)


def best_of(
    family: Family,
    candidates: NDArray[Any],
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
) -> Tuned:
    """Return the candidate (C, P) with the largest mean score."""
    scores = mean_scores(family, candidates, name, seeds, arguments)
    best = int(np.argmax(scores))
    return Tuned(tuple(candidates[best].tolist()), float(scores[best]), len(candidates))


@dataclass(frozen=True)
class Search:
    """Effort of the CMA-ES search from each start.

    A search has ``generations`` of ``population`` candidates. The first standard deviation is
    ``sigma``, in units of the width of the parameters' bounds.
    """

    generations: int = 50
    population: int = 16
    sigma: float = 0.1
    finalists: int = 8


def searched(seeds: Sequence[int]) -> Sequence[int]:
    """Return the seeds that a search sees: the first third."""
    require(len(seeds) >= 3, "seeds", seeds, "at least three")
    return seeds[: len(seeds) // 3]


def evolve(
    family: Family,
    starts: Sequence[Sequence[float]],
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    search: Search,
    progress: Progress | None = None,
) -> Tuned:
    """Return the best parameters that CMA-ES finds within the family's bounds.

    The search runs from each of several ``starts`` (P,).

    It sees a third of the seeds; the means of the distributions, the starts, and the best
    candidates of all generations (``finalists`` a start) are then compared on the others, which
    were not searched on, so that the luckiest candidate has no advantage.
    """
    with optional():
        from cmaes import CMA
    visible = searched(seeds)
    selection = seeds[len(visible) :]
    finalists: list[Array] = []
    tried = 0
    bounds = family.bounds
    shape = np.diag((bounds[:, 1] - bounds[:, 0]) ** 2)
    for number, start in enumerate(starts):
        mean = np.asarray(start, dtype=np.float64)
        optimiser = CMA(
            mean=mean,
            sigma=search.sigma,
            bounds=bounds,
            seed=number + 1,
            population_size=search.population,
            cov=shape,
        )
        scored: list[tuple[float, Array]] = []
        for _ in range(search.generations):
            candidates = np.array([optimiser.ask() for _ in range(search.population)])
            scores = mean_scores(family, candidates, name, visible, arguments)
            optimiser.tell(
                [
                    (candidate, -float(score))
                    for candidate, score in zip(candidates, scores, strict=True)
                ]
            )
            scored += zip(scores.tolist(), candidates, strict=True)
            tried += len(candidates)
            if progress is not None:
                progress(len(candidates))
        scored.sort(key=lambda pair: -pair[0])
        finalists += [
            mean,
            np.clip(optimiser.mean, *bounds.T),
            *(candidate for _, candidate in scored[: search.finalists]),
        ]
    best = best_of(family, np.array(finalists), name, selection, arguments)
    return Tuned(best.parameters, best.score, tried + best.candidates)


# A planner that may look into the future: what is left above a rule, and how much of it is luck.
#
# Before each decision it tries candidates on copies of the lane, a constant action for a few
# intervals and the rule after them, and takes what did best over a horizon (rollout: D. Bertsekas,
# Dynamic Programming and Optimal Control). With copies that are exact it is clairvoyant, and
# exploits a chaos that nobody could. With copies whose force and phase are off it is robust: what
# it finds must hold for all of them.


# of a copy: share of the force, rad
FORCE_OFF = (0.002, 0.01)
PHASE_OFF = (0.02, 0.1)


@dataclass(frozen=True)
class Planner:
    """The action sequences that a planner tries.

    Each of the constant ``actions`` is applied for each of ``lasting`` numbers of intervals,
    followed by the rule, over ``horizon`` intervals in all. Each trial runs on ``copies`` copies of
    the environment with different disturbances.
    """

    actions: Sequence[Sequence[float]]
    lasting: Sequence[int] = (1, 3)
    horizon: int = 16
    copies: int = 4
    exact: bool = False

    def __post_init__(self) -> None:
        count("horizon", self.horizon, max(self.lasting))
        count("copies", self.copies, 1)
        require(len(self.actions) > 0, "actions", self.actions, "at least one")

    @property
    def trials(self) -> list[tuple[Sequence[float], int]]:
        """Candidates as (action, intervals); the first is the rule alone."""
        return [
            (self.actions[0], 0),
            *((action, last) for last in self.lasting for action in self.actions),
        ]


@dataclass(frozen=True)
class RuledLanes:
    """The lanes of an environment, and the actions of a rule in them.

    ``numbers`` (L, P) are the parameters of the rule's ``family`` in each lane.
    """

    task: Task
    family: Family
    numbers: Array

    def act(self, observations: Observations) -> Array:
        """Return the actions (L, A) of the rule."""
        rows = np.broadcast_to(self.numbers, (len(observations), len(self.numbers)))
        return np.clip(self.family.act(rows, observations), -1, 1).reshape(len(observations), -1)

    def step(
        self, observations: Observations, constants: Array, takes: Mask, over: Mask
    ) -> tuple[Observations, Array, Mask]:
        """Advance the lanes that are not over by the rule or by given actions.

        The actions ``constants`` (L, A) apply to the lanes in the mask ``takes`` (L,).

        Return observations, rewards (L,), and the mask of the lanes whose episode is over.
        """
        actions = np.where(takes[:, None], constants, self.act(observations)).astype(np.float32)
        rewards, terminated, truncated = self.task.step(actions, over if over.any() else None)
        return self.task.observe([]), rewards, over | terminated | truncated


def disturb(task: Task, copies: int, generator: np.random.Generator) -> None:
    """Disturb force and phase of all lanes, and redraw the random disturbances.

    Each group of ``copies`` lanes gets the same offsets, as many to one side as to the other.
    """
    groups = task.lanes.count // copies
    sides = np.where(np.arange(copies) % 2 == 0, 1.0, -1.0)
    off = (
        sides * generator.uniform(*FORCE_OFF, copies),
        sides * generator.permutation(sides) * generator.uniform(*PHASE_OFF, copies),
    )
    task.lanes.force *= 1 + np.tile(off[0], groups)
    task.runs.orders["phase"] += np.tile(off[1], groups)
    if task.settings.record is not None:
        task.runs.orders["place"] = np.tile(
            generator.integers(len(task.settings.record.values) - 1, size=copies), groups
        )


def plan(
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    rule: tuple[Family, Array],
    planner: Planner,
    advance: Progress | None = None,
    record: Callable[[Observations, Array], None] | None = None,
) -> Array:
    """Return the scores (E,) of a planner over a rule without memory.

    The episodes are those of the ``seeds`` of the environment ``name``, which has neither noise nor
    delay.

    ``record`` is called before each step with the observations (L, features) of the episodes that
    are not over and the planner's actions (L, A).
    """
    with optional():
        import gymnasium
    trials = planner.trials
    lanes = len(seeds)
    times = len(trials) * planner.copies
    true: Any
    tried: Any
    true, tried = (
        gymnasium.make_vec(name, num_envs=n, vectorization_mode="vector_entry_point", **arguments)
        for n in (lanes, lanes * times)
    )
    try:
        observations, _ = true.reset(seed=list(seeds))
        tried.reset(seed=0)
        own, other = (RuledLanes(env.unwrapped.task, *rule) for env in (true, tried))
        constants = np.array([action for action, _ in trials], dtype=np.float64)
        first = np.tile(np.repeat(constants, planner.copies, axis=0), (lanes, 1))
        lasts = np.tile(np.repeat([last for _, last in trials], planner.copies), lanes)
        scores = np.zeros(lanes)
        over = np.zeros(lanes, dtype=np.bool_)
        generator = np.random.default_rng(0)
        while not over.all():
            other.task.copy_from(own.task, times)
            if not planner.exact:
                disturb(other.task, planner.copies, generator)
            gained = np.zeros(lanes * times)
            ended = np.repeat(over, times)
            looked = np.repeat(observations, times, axis=0)
            for k in range(planner.horizon):
                if ended.all():
                    break
                looked, rewards, ended = other.step(looked, first, lasts > k, ended)
                gained += rewards
            means = gained.reshape(lanes, len(trials), planner.copies).mean(axis=2)
            best = np.argmax(means, axis=1)
            if record is not None:
                chosen = np.where((best > 0)[:, None], constants[best], own.act(observations))
                record(observations[~over], chosen[~over])
            observations, rewards, over = own.step(observations, constants[best], best > 0, over)
            scores += rewards
            if advance is not None:
                advance(1)
    finally:
        true.close()
        tried.close()
    return scores


# seeds; the latter are apart from those that train, validate and test
FIRST_SEARCHED = 1000
FIRST_JUDGED = 2_500_000
CLAIRVOYANT = "clairvoyant oracle"
ROBUST = "robust oracle"
HEADROOM = "room"
LEAST = 0.15
SURE = 0.1

FOURS = Search(generations=20, population=12, sigma=0.1, finalists=5)
EIGHTS = Search(generations=45, population=14, sigma=0.04, finalists=8)


@dataclass(frozen=True)
class Effort:
    """Effort of an admission.

    ``searched`` seeds for the search (CMA-ES uses a third of them), ``judged`` seeds for the
    scores, points of the ``grid`` of constants, settings of the two searches, and the planner's
    horizon, copies and action points.
    """

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
    """A family whose last parameters are fixed, which leaves a rule with few parameters."""

    def __init__(self, family: Family) -> None:
        self.family = family
        self.names = family.names[: family.few]
        self.begins = family.begins

    def act(self, parameters: Array, observations: Any) -> Array:
        """Return the family's actions."""
        rest = np.broadcast_to(
            self.family.neutral[self.family.few :],
            (len(parameters), len(self.family.names) - self.family.few),
        )
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
    """Return the largest number of candidates and planner decisions of an admission."""
    looking = TASKS[task].feedback
    spent = sum(
        effort.four.generations * effort.four.population * len(family.begins)
        for family in (*looking, TASKS[task].blind)
    )
    return (
        spent
        + sum(len(family.begins) for family in looking)
        * effort.eight.generations
        * effort.eight.population
    )


def rules(
    task: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None
) -> dict[str, Rule]:
    """Return the best constant, open-loop schedule and rules of at most four and eight parameters.

    The search for the rule of eight starts from the rule of four.

    There is no rule of four for a task whose families all need more.
    """
    own = TASKS[task]
    behind = task_of(env_of(task), arguments)
    rest = (env_of(task), range(FIRST_SEARCHED, FIRST_SEARCHED + effort.searched), arguments)

    def result(family: Family, starts: Sequence[Sequence[float]], search: Search) -> Rule:
        tuned = evolve(family, starts, *rest, search, advance)
        return Rule(family, tuned.parameters, tuned.score)

    points = np.linspace(-1, 1, effort.grid)
    always = own.constant(behind)
    best = best_of(
        always,
        np.stack(np.meshgrid(*[points] * len(always.names), indexing="ij"), axis=-1).reshape(
            -1, len(always.names)
        ),
        *rest,
    )
    constant = Rule(always, best.parameters, best.score)
    few = []
    many = []
    for family in (kind(behind) for kind in own.feedback):
        starts = [begin(constant.numbers) for begin in family.begins]
        if family.few:
            few.append(result(Held(family), starts, effort.four))
            start = (*few[-1].numbers, *family.neutral[family.few :])
            many.append(result(family, [start], effort.eight))
        else:
            (few if len(family.names) <= 4 else many).append(result(family, starts, effort.eight))
    blind = own.blind(behind)
    chosen = {
        CONSTANT: constant,
        BLIND: result(blind, [begin(constant.numbers) for begin in blind.begins], effort.four),
    }
    for label, group in ((FOUR, few), (EIGHT, [*few, *many])):
        if group:
            chosen[label] = max(group, key=lambda rule: rule.score)
    return chosen


def headroom(oracle: Array, rule: Array, constant: Array) -> float:
    """Return the room above a rule, for scores (1, E)."""
    return float((oracle.mean() - rule.mean()) / (oracle.mean() - constant.mean()))


def admit(
    task: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None
) -> dict[str, Any]:
    """Return the result of an admission.

    It has the rules with their parameters, the scores (E,) of all policies, and the room with its
    interval.
    """
    chosen = rules(task, arguments, effort, advance)
    name = env_of(task)
    seeds = range(FIRST_JUDGED, FIRST_JUDGED + effort.judged)
    scores = {
        label: play(FamilyPolicy(label, rule.family, rule.numbers), name, seeds, arguments).scores[
            None
        ]
        for label, rule in chosen.items()
    }
    if TASKS[task].planned:
        points = np.linspace(-1, 1, effort.points)
        actions = (
            [(a, b) for a in points[::3] for b in points[::3]]
            if ENVIRONMENTS[name].numbers == 2
            else [(a,) for a in points]
        )
        planner = Planner(actions, horizon=effort.horizon, copies=effort.copies)
        best = (chosen[EIGHT].family, np.array(chosen[EIGHT].numbers))
        scores[ROBUST] = plan(name, seeds, arguments, best, planner, advance)[None]
        scores[CLAIRVOYANT] = plan(
            name, seeds, arguments, best, replace(planner, copies=1, exact=True), advance
        )[None]
    return {
        "arguments": dict(arguments),
        "effort": asdict(effort),
        "rules": {
            label: {"family": rule.name, "numbers": list(rule.numbers)}
            for label, rule in chosen.items()
        },
        "scores": {label: np.round(values, 6).tolist() for label, values in scores.items()},
        **(verdict(scores) if ROBUST in scores else {}),
    }


def add_agents(task: str, result: dict[str, Any], agents: Sequence[Any]) -> None:
    """Add the scores of agents to the result of an admission, by algorithm.

    They replace earlier scores of the same algorithms. The verdict of the admission does not
    change.
    """
    seeds = range(FIRST_JUDGED, FIRST_JUDGED + result["effort"]["judged"])
    runs = dict[str, list[Any]]()
    for agent in agents:
        played = play(agent, env_of(task), seeds, result["arguments"])
        runs.setdefault(agent.algorithm.upper(), []).append(np.round(played.scores, 6).tolist())
    result["scores"] |= runs


def verdict(scores: Mapping[str, Array]) -> dict[str, Any]:
    """Return the room with its interval, and whether that admits a task."""
    compared = (scores[ROBUST], scores[EIGHT], scores[CONSTANT])
    low, high = bootstrap_interval(headroom, *compared)
    share = headroom(*compared)
    return {
        HEADROOM: [share, float(low), float(high)],
        "admitted": bool(share >= LEAST and low > SURE),
    }
