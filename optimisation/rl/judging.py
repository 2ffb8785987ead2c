"""Policies on the same held-out seeds: raw results, and what the statistics say of them."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.envs.evaluation import RESAMPLES, difference, interquartile_mean, interval
from impact_env.parameters import ParameterError, require
from optimisation.files import replacing
from optimisation.rl.agents import FINAL, Agent, find_agents, load_agent
from optimisation.rl.play import play
from optimisation.rl.policies import Policy
from optimisation.rl.statistics import Array, improvement, normalised
from optimisation.rl.tasks.table import task_named

FIRST_HELD_OUT_SEED = 2_000_000
NO_LEARNING = "without learning"
MEASURES = ("scores", "levels", "times")
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
    """Write all episodes as a compressed npz.

    A row (N) is a policy, or an agent of it: ``policies``, ``kinds``, ``runs``; a column (E) one of the evaluation ``seeds``. ``scores``, ``levels``
    and ``times`` (N, E) are whole numbers of millionths: exact, as `judge` rounds to six digits, and a fifth of the size of floats.
    """
    require(len({r.seeds for r in results}) == 1, "results", [r.name for r in results], "policies that were judged on the same seeds")
    rows = [(r.name, r.kind, run) for r in results for run in r.runs]
    policies, kinds, runs = (np.array(column) for column in zip(*rows, strict=True))
    measured = {name: np.rint(np.concatenate([getattr(r, name) for r in results]) * 10**DIGITS).astype(np.int64) for name in MEASURES}
    with replacing(path) as temporary:
        np.savez_compressed(temporary, policies=policies, kinds=kinds, runs=runs, seeds=np.array(results[0].seeds), **measured)


def read_results(path: Path) -> list[Judged]:
    """Return what `write_results` wrote. Raises ParameterError for another or an incomplete file."""
    require(path.is_file(), "results", str(path), "a file that evaluate_policies has written")
    try:
        with np.load(path, allow_pickle=False) as file:
            policies, kinds, runs, seeds = (file[name].tolist() for name in ("policies", "kinds", "runs", "seeds"))
            measured = [file[name] / 10**DIGITS for name in MEASURES]
    except (OSError, EOFError, KeyError, ValueError, TypeError, zipfile.BadZipFile) as error:
        raise ParameterError(f"results = {path} is not allowed: a whole file that evaluate_policies has written ({error})") from error
    rows: dict[tuple[str, str], list[int]] = {}
    for row, entry in enumerate(zip(policies, kinds, strict=True)):
        rows.setdefault(entry, []).append(row)
    return [Judged(*entry, tuple(runs[row] for row in own), tuple(seeds), *(values[own] for values in measured)) for entry, own in rows.items()]


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
