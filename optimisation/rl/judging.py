"""Policies on the same held-out seeds: raw results, and what the statistics say of them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.parameters import ParameterError, require
from optimisation.files import write_csv
from optimisation.rl.agents import FINAL, Agent, find_agents, load_agent
from optimisation.rl.play import play
from optimisation.rl.policies import Policy
from optimisation.rl.statistics import RESAMPLES, Array, difference, improvement, interquartile_mean, interval, normalised
from optimisation.rl.tasks.table import task_named

FIRST_HELD_OUT_SEED = 2_000_000
NO_LEARNING = "without learning"
COLUMNS = ("policy", "kind", "training_seed", "evaluation_seed", "score", "relative_level", "pseudo_periods")
DIGITS = 6


@dataclass(frozen=True)
class Judged:
    """A policy, or all agents of an algorithm: ``runs`` training seeds (-1 without training); arrays (R, E) over ``seeds`` of evaluation.

    ``scores``; ``levels`` relative to no absorber (the score's main part), ``times`` in pseudo periods.
    """

    name: str
    kind: str
    runs: tuple[int, ...]
    seeds: tuple[int, ...]
    scores: Array
    levels: Array
    times: Array


Contender = tuple[str, str, Sequence[tuple[int, Policy]]]


def contenders(baselines: Iterable[Policy], agents: Iterable[Agent]) -> list[Contender]:
    """Return (name, kind, runs) of all policies: each baseline, and the agents by algorithm."""
    found: list[Contender] = [(policy.name, NO_LEARNING, [(-1, policy)]) for policy in baselines]
    groups: dict[str, list[tuple[int, Policy]]] = {}
    for agent in agents:
        groups.setdefault(agent.algorithm.upper(), []).append((agent.seed, agent))
    return found + [(name, "agent", runs) for name, runs in groups.items()]


def agents_for(task: str, place: Path, arguments: Mapping[str, Any]) -> list[Agent]:
    """Return the agents of a task in a folder, or the one in a file.

    Raises ParameterError if there is none, if a file's agent belongs to another task, or if one was trained with other arguments of the environment.
    """
    env_id = task_named(task).env_id
    if place.is_file():
        agents = [load_agent(place)]
        require(agents[0].env_id == env_id, "--agents", str(place), f"an agent for {env_id}, not for {agents[0].env_id}")
    else:
        agents = find_agents(place, FINAL, env_id) if place.is_dir() else []
        require(len(agents) > 0, "--agents", str(place), f"a folder with agents for {env_id} ({FINAL}), as train_sweep_agent writes them")
    for agent in agents:
        require(
            dict(agent.arguments) == dict(arguments), f"arguments of {agent.name}", dict(agent.arguments), f"those of the task: {dict(arguments)}"
        )
    return agents


def judge(task: str, contender: Contender, seeds: Sequence[int], arguments: Mapping[str, Any], advance: Callable[[], object] | None = None) -> Judged:
    """Play all runs of a contender on the seeds."""
    name, kind, runs = contender
    scores, levels, times = [], [], []
    for _, policy in runs:
        episodes = play(policy, task_named(task).env_id, seeds, arguments)
        scores.append(episodes.scores)
        levels.append(episodes.last.get("relative_level", -episodes.scores))
        times.append(episodes.last["time"])
        if advance is not None:
            advance()
    kept = [np.round(np.stack(values), DIGITS).astype(np.float64) for values in (scores, levels, times)]
    return Judged(name, kind, tuple(run for run, _ in runs), tuple(seeds), kept[0], kept[1], kept[2])


def write_results(path: Path, results: Sequence[Judged]) -> None:
    """Write one row for each episode."""
    write_csv(
        path,
        COLUMNS,
        (
            (r.name, r.kind, "" if run < 0 else run, seed, float(r.scores[i, j]), float(r.levels[i, j]), float(r.times[i, j]))
            for r in results
            for i, run in enumerate(r.runs)
            for j, seed in enumerate(r.seeds)
        ),
    )


def read_results(path: Path) -> list[Judged]:
    """Return what `write_results` wrote. Raises ParameterError for another or an incomplete file."""
    require(path.is_file(), "results", str(path), "a file that evaluate_policies has written")
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    groups: dict[tuple[str, str], dict[int, dict[int, tuple[float, ...]]]] = {}
    try:
        for row in rows:
            run = int(row["training_seed"] or -1)
            numbers = tuple(float(row[name]) for name in COLUMNS[4:])
            groups.setdefault((row["policy"], row["kind"]), {}).setdefault(run, {})[int(row["evaluation_seed"])] = numbers
        results = []
        for (name, kind), runs in groups.items():
            seeds = tuple(next(iter(runs.values())))
            values = np.array([[run[seed] for seed in seeds] for run in runs.values()])
            results.append(Judged(name, kind, tuple(runs), seeds, *np.moveaxis(values, 2, 0)))
    except (KeyError, ValueError, TypeError) as error:
        raise ParameterError(f"results = {path} is not allowed: a whole file that evaluate_policies has written ({error})") from error
    return results


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Line:
    """What the statistics say of one policy.

    ``normalised`` and ``improvement`` are None where what they refer to was not judged, or (a quick look) the yardsticks came out in the wrong order.
    ``over_rival`` and ``over_one``: how much higher the mean score is than that of the rival, and of the policy whose normalised score is 1, episode
    by episode on the same seeds.
    """

    name: str
    kind: str
    runs: int
    mean: Estimate
    middle: Estimate
    normalised: Estimate | None
    improvement: Estimate | None
    level: float
    time: float
    over_rival: Estimate | None = None
    over_one: Estimate | None = None


def _estimate(statistic: Callable[..., float], *scores: Array, resamples: int) -> Estimate:
    low, high = interval(statistic, *scores, resamples=resamples)
    return Estimate(float(statistic(*scores)), float(low), float(high))


def summarise(task: str, results: Sequence[Judged], resamples: int = RESAMPLES, advance: Callable[[], object] | None = None) -> list[Line]:
    """Return a line for each policy: mean and interquartile mean of the score, normalised score, chance of a better score than the rival's."""
    scores = {r.name: r.scores for r in results}
    zero, one, rival = (scores.get(name) for name in task_named(task).yardsticks)
    lines = []
    for r in results:
        scaled = None if zero is None or one is None or one.mean() <= zero.mean() else _estimate(normalised, r.scores, zero, one, resamples=resamples)
        better = None if rival is None else _estimate(improvement, r.scores, rival, resamples=resamples)
        mean = _estimate(lambda x: float(x.mean()), r.scores, resamples=resamples)
        middle = _estimate(interquartile_mean, r.scores, resamples=resamples)
        paired = [None if other is None else _estimate(difference, r.scores, other, resamples=resamples) for other in (rival, one)]
        lines.append(Line(r.name, r.kind, len(r.runs), mean, middle, scaled, better, float(r.levels.mean()), float(r.times.mean()), *paired))
        if advance is not None:
            advance()
    return lines
