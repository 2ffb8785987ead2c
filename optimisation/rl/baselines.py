"""What an engineer would do without learning: fixed values, tuned fixed values, rules, and the best schedule that does not look at the response.

Numbers are chosen on training seeds and stored, so that judging does not search again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError, require
from optimisation.files import write_json
from optimisation.rl.families import Family, policy_of, task_of
from optimisation.rl.policies import Policy, Random
from optimisation.rl.tasks.baseline import RANDOM, Baseline
from optimisation.rl.tasks.effort import Effort
from optimisation.rl.tasks.table import task_named
from optimisation.rl.tuning import Progress, Tuned

VERSION = 1
FIRST_TRAINING_SEED = 1000
TUNED = Path(__file__).with_name("tuned")  # what tune_baselines has found, TASK_baselines.json


def families(task: str, arguments: Mapping[str, Any]) -> dict[str, Family]:
    """Return the kinds of policies of a task by name."""
    own = task_named(task)
    return own.kinds(task_of(own.env_id, arguments))


def policy(baseline: Baseline, kinds: Mapping[str, Family]) -> Policy:
    """Return the policy of a baseline; raises ParameterError for an unknown kind."""
    if baseline.kind == RANDOM:
        return Random(name=baseline.name, numbers=2 if "pair" in kinds else 1)
    require(baseline.kind in kinds, "kind", baseline.kind, f"one of {RANDOM}, {', '.join(kinds)}")
    return policy_of(baseline.name, kinds[baseline.kind], list(baseline.parameters))


def tune(task: str, arguments: Mapping[str, Any], effort: Effort, advance: Progress | None = None) -> list[Baseline]:
    """Return the baselines of a task with their numbers chosen on training seeds. ``advance`` is called with the number of candidates tried."""
    own = task_named(task)
    rest = (own.env_id, training_seeds(task, effort), arguments)
    return [Baseline(RANDOM, RANDOM, ()), *own.search(families(task, arguments), rest, effort, advance)]


def training_seeds(task: str, effort: Effort) -> range:
    """Return the seeds on which a task's numbers are chosen."""
    return range(FIRST_TRAINING_SEED, FIRST_TRAINING_SEED + effort.seeds * task_named(task).more_training)


def store(path: Path, task: str, arguments: Mapping[str, Any], effort: Effort, baselines: Sequence[Baseline]) -> None:
    """Write baselines as JSON."""
    seeds = training_seeds(task, effort)
    content = {"version": VERSION, "task": task, "arguments": dict(arguments), "training_seeds": [seeds[0], seeds[-1]], "effort": asdict(effort)}
    write_json(path, content | {"policies": [asdict(baseline) for baseline in baselines]})


def load(path: Path, task: str) -> tuple[list[Baseline], dict[str, Any]]:
    """Return stored baselines and the environment's arguments that they were tuned for.

    Raises ParameterError if there is no such file, or if it is of another task or version.
    """
    require(path.is_file(), "baselines", str(path), "a file that tune_baselines has written")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = content["policies"]
        require(content["task"] == task, "baselines", str(path), f"baselines of the task {task}, not of {content['task']}")
        require(content["version"] == VERSION, "baselines", str(path), f"version {VERSION}, not {content['version']}")
        found = [
            Baseline(row["name"], row["kind"], tuple(row["parameters"]), None if row["training"] is None else _tuned(row["training"])) for row in rows
        ]
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(f"baselines = {path} is not allowed: a whole file that tune_baselines has written ({error})") from error
    return found, dict(content["arguments"])


def _tuned(row: Mapping[str, Any]) -> Tuned:
    return Tuned(tuple(row["parameters"]), float(row["score"]), int(row["candidates"]))
