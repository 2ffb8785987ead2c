"""The leaderboard: policies on the test split of each task, by `impact_env.evaluate`; lines of others stay as they are."""

from __future__ import annotations

import csv
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import impact_env
from optimisation.files import write_csv
from optimisation.page import ROOT
from optimisation.rl.active_rules import ACTIVE, PAIRS
from optimisation.rl.admission import EIGHT
from optimisation.rl.agents import TRAINED, load_agent
from optimisation.rl.families import Rates, policy_of, task_of
from optimisation.rl.passage_rules import SmallRule
from optimisation.rl.play import PASSAGE
from studies.study import Json

COLUMNS = ("task", "policy", "who", "commit", "split", "episodes", "score", "low", "high")
OURS = "this project"
FAMILIES = {family.__name__: family for family in (*ACTIVE, *PAIRS)}


def commit() -> str:
    """Return the checkout's commit, shortened; nothing where there is none."""
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def policies(found: Mapping[str, Json]) -> Iterator[tuple[str, str, Any]]:
    """Yield task, name and policy: of what an admission found, of the small rule, and of agents that ship."""
    for name, one in found.items():
        rules = one["rules"]
        yield name, "best constant", rules["best constant"]["numbers"]
        best = rules[EIGHT]
        numbers = [*best["numbers"], *FAMILIES[best["family"]].neutral[len(best["numbers"]) :]]
        yield name, f"rule of {len(best['numbers'])}, {best['family']}", policy_of("rule", FAMILIES[best["family"]](), numbers)
    yield PASSAGE, "small rule", policy_of("small rule", SmallRule(Rates.of(task_of(PASSAGE, {}))), list(SmallRule.start))
    for file in sorted(TRAINED.glob("*.zip")):
        task, _, algorithm = file.stem.rpartition("_")
        agent = load_agent(task, algorithm)
        yield agent.env_id, f"{algorithm.upper()}, one agent, {agent.steps:,} steps", agent


def write(path: Path, found: Mapping[str, Json], episodes: int) -> None:
    """Judge all policies and write the file; lines whose ``who`` is another stay."""
    rows: list[list[str]] = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as lines:
            rows = [[row[name] for name in COLUMNS] for row in csv.DictReader(lines) if row["who"] != OURS]
    version = commit()
    for task, name, policy in policies(found):
        judged = impact_env.evaluate(policy, task, episodes=episodes)
        low, high = judged.policy.interval
        numbers = (f"{value:.4f}" for value in (judged.policy.mean, low, high))
        rows.append([task.split("/")[1], name, OURS, version, judged.split, str(episodes), *numbers])
    write_csv(path, COLUMNS, sorted(rows, key=lambda row: (row[0], -float(str(row[6])))))
