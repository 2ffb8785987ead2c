"""A planner that may look into the future: what is left above a rule, and how much of it is luck.

Before each decision it tries candidates on copies of the lane, a constant action for a few intervals and the rule after them, and takes what did best
over a horizon (rollout: D. Bertsekas, Dynamic Programming and Optimal Control). With copies that are exact it is clairvoyant, and exploits a chaos
that nobody could. With copies whose force and phase are off it is robust: what it finds must hold for all of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import impact_env  # noqa: F401 - registers the environments
from impact_env.envs.task import Mask, Task
from impact_env.extras import optional
from impact_env.parameters import count, require
from optimisation.rl.families import Array, Family, Observations
from optimisation.rl.tuning import Progress

FORCE_OFF, PHASE_OFF = (0.002, 0.01), (0.02, 0.1)  # of a copy: share of the force, rad


@dataclass(frozen=True)
class Planner:
    """What is tried: constant ``actions`` for each of ``lasting`` intervals, then the rule, over ``horizon`` intervals, on ``copies`` off it."""

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
        return [(self.actions[0], 0), *((action, last) for last in self.lasting for action in self.actions)]


def copy_lanes(source: Task, target: Task, times: int) -> None:
    """Put each lane of a task ``times`` times, one after the other, into a task of as many lanes. There must be no delay and no noise."""
    for name, values in vars(source).items():
        if isinstance(values, np.ndarray) and values.shape[:1] == (source.lanes,):
            setattr(target, name, np.repeat(values, times, axis=0))
    for own, values in zip(target.runs._variables(), source.runs._variables(), strict=True):
        own[...] = np.repeat(values, times, axis=0)


@dataclass(frozen=True)
class Lanes:
    """The lanes of an environment, and what a rule of a number of families does in them."""

    task: Task
    family: Family
    numbers: Array

    def step(self, observations: Observations, given: Array, takes: Mask, over: Mask) -> tuple[Observations, Array, Mask]:
        """Advance lanes that are not over, by the rule or, where ``takes`` (L,), as ``given`` (L, A); return what is seen, rewards, who is over."""
        rows = np.broadcast_to(self.numbers, (len(observations), len(self.numbers)))
        ruled = np.clip(self.family.act(rows, observations), -1, 1).reshape(len(observations), -1)
        actions = np.where(takes[:, None], given, ruled).astype(np.float32)
        rewards, terminated, truncated = self.task.step(actions, over if over.any() else None)
        return self.task.observe([]), rewards, over | terminated | truncated


def disturb(task: Task, copies: int, generator: np.random.Generator) -> None:
    """Put force and phase of all lanes off, each group of so many copies alike, by as much to either side; what disturbs them is drawn anew."""
    groups, sides = task.lanes // copies, np.where(np.arange(copies) % 2 == 0, 1.0, -1.0)
    off = sides * generator.uniform(*FORCE_OFF, copies), sides * generator.permutation(sides) * generator.uniform(*PHASE_OFF, copies)
    task.force = task.force * (1 + np.tile(off[0], groups))
    task.runs.orders["phase"] += np.tile(off[1], groups)
    if task.settings.record is not None:
        task.runs.orders["place"] = np.tile(generator.integers(len(task.settings.record.values) - 1, size=copies), groups)


def plan(
    name: str, seeds: Sequence[int], arguments: Mapping[str, Any], rule: tuple[Family, Array], planner: Planner, advance: Progress | None = None
) -> Array:
    """Return the scores (E,) of a planner over a rule without memory, on the seeds of the environment ``name``, which has neither noise nor delay."""
    with optional():
        import gymnasium
    trials, lanes = planner.trials, len(seeds)
    times = len(trials) * planner.copies
    true: Any
    tried: Any
    true, tried = (gymnasium.make_vec(name, num_envs=n, vectorization_mode="vector_entry_point", **arguments) for n in (lanes, lanes * times))
    try:
        seen, _ = true.reset(seed=list(seeds))
        tried.reset(seed=0)
        own, other = (Lanes(env.unwrapped.task, *rule) for env in (true, tried))
        constants = np.array([action for action, _ in trials], dtype=np.float64)
        first = np.tile(np.repeat(constants, planner.copies, axis=0), (lanes, 1))
        lasts = np.tile(np.repeat([last for _, last in trials], planner.copies), lanes)
        scores, over, generator = np.zeros(lanes), np.zeros(lanes, dtype=np.bool_), np.random.default_rng(0)
        while not over.all():
            copy_lanes(own.task, other.task, times)
            if not planner.exact:
                disturb(other.task, planner.copies, generator)
            gained, ended, looked = np.zeros(lanes * times), np.repeat(over, times), np.repeat(seen, times, axis=0)
            for k in range(planner.horizon):
                if ended.all():
                    break
                looked, rewards, ended = other.step(looked, first, lasts > k, ended)
                gained += rewards
            means = gained.reshape(lanes, len(trials), planner.copies).mean(axis=2)
            best = np.argmax(means, axis=1)
            seen, rewards, over = own.step(seen, constants[best], best > 0, over)
            scores += rewards
            if advance is not None:
                advance(1)
    finally:
        true.close()
        tried.close()
    return scores
