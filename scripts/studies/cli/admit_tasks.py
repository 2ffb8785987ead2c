"""Whether tasks have room above rules of few numbers: constants, schedules, rules by CMA-ES, and planners that look ahead; and the page of tasks."""

# needs: env, optimise

from __future__ import annotations

import csv
import inspect
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

import impact_env
from impact_env.envs import ENVIRONMENTS
from impact_env.envs.evaluation import EPISODES, interval
from impact_env.extras import optional
from impact_env.parameters import ParameterError
from optimisation.cli.common import BadInput, check_target, command
from optimisation.files import read_json, write_csv, write_json
from optimisation.page import DOCS, ROOT, fill, require_markers
from optimisation.progress import Bar
from optimisation.report.markdown import markdown
from optimisation.rl.active_rules import ACTIVE, PAIRS
from optimisation.rl.admission import EFFORTS, EIGHT, QUICK, ROOM, admit, tried
from optimisation.rl.agents import FINAL, TRAINED, find_agents, load_agent
from optimisation.rl.families import Rates, policy_of, task_of
from optimisation.rl.passage_rules import SmallRule
from optimisation.rl.play import PASSAGE
from optimisation.rl.tasks.table import WITH_ROOM
from studies.study import Json

NAMES = (  # in their newest versions
    *("ActiveFriction-v0", "ActiveGap-v0", "Structures-v0", "Passage-v0"),
    *("FrictionChoice-v1", "SweepAndGap-v1", "GapChoice-v1", "SweepRate-v1", "SweepRateHard-v0"),
)
LANES, STEPS, SPAN = 64, 200, (1, 99)  # of random actions; percentiles


def rooms(found: Mapping[str, Json]) -> str:
    """Return the admission table: mean scores with their intervals over the judged seeds, and the room."""
    columns = list(dict.fromkeys(label for one in found.values() for label in one["scores"]))
    rows = []
    for name, one in found.items():
        cells = []
        for label in columns:
            scores = np.array(one["scores"][label]) if label in one["scores"] else None
            cells.append("-" if scores is None else told(scores))
        share, low, high = one[ROOM]
        verdict = "admitted" if one["admitted"] else "no room shown"
        rows.append((f"`{name.split('/')[1]}`", *cells, f"{share:.2f} [{low:.2f}, {high:.2f}]", verdict))
    return markdown(("task", *columns, ROOM, "verdict"), rows)


def told(scores: Any) -> str:
    """Return the mean of scores (runs, seeds) with its interval, and how many runs there are if there are several."""
    low, high = interval(np.mean, scores)
    runs = f" ({len(scores)} runs)" if len(scores) > 1 else ""
    return f"{scores.mean():.3f} [{low:.3f}, {high:.3f}]{runs}"


def searches(found: Mapping[str, Json]) -> str:
    """Return how each rule was found, and which family it is of."""
    rows = []
    for name, one in found.items():
        effort, best = one["effort"], one["rules"]["rule of 8"]
        tried = ", ".join(f"{number:.3f}" for number in best["numbers"])
        spent = f"{effort['searched']} / {effort['judged']}"
        rows.append((f"`{name.split('/')[1]}`", best["family"], tried, spent, f"{effort['horizon']}, {effort['copies']}"))
    return markdown(("task", "best family", "its numbers", "seeds of search / judged", "planner: intervals ahead, copies"), rows)


def parts(kind: type) -> dict[str, str]:
    """Return the sections of an environment's docstring by heading; the text before the first is under an empty one."""
    pieces = re.split(r"^## (.*)$", inspect.getdoc(kind) or "", flags=re.MULTILINE)
    return {"": pieces[0].strip()} | {heading: text.strip() for heading, text in zip(pieces[1::2], pieces[2::2], strict=True)}


def described(names: Sequence[str] = NAMES) -> str:
    """Return a section for each environment, with the ranges of its features under random actions."""
    return "\n\n".join(section(f"ImpactAbsorber/{name}") for name in names)


def section(name: str) -> str:
    """Return the section of one environment."""
    with optional():
        import gymnasium
    env: Any = gymnasium.make_vec(name, num_envs=LANES)
    generator, seen = np.random.default_rng(0), [env.reset(seed=0)[0]]
    seen += [env.step(generator.uniform(-1, 1, env.action_space.shape).astype(np.float32))[0] for _ in range(STEPS)]
    low, high = np.percentile(np.concatenate(seen), SPAN, axis=0)
    text = parts(type(gymnasium.make(name).unwrapped))
    lines = [line for line in text["Observation Space"].splitlines() if re.match(r"\| \d+ \|", line)]
    rows = [[*(cell.strip() for cell in line.strip("| ").split("|")), f"{a:.2g} to {b:.2g}"] for line, a, b in zip(lines, low, high, strict=True)]
    table = markdown(("#", "feature", "unit and scale", f"{SPAN[0]} to {SPAN[1]} % under random actions"), rows)
    flat = {heading: re.sub(r"\s*\n\s*", " ", own) for heading, own in text.items()}
    head = f"## {name.split('/')[1]}\n\n{flat['']} {flat['Description']}\n\n**Action.** {flat['Action Space']}"
    return f"{head}\n\n{table}\n\n**Score.** {flat['Rewards']}"


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


NUMBERS, PAGE, BOARD = DOCS / "tasks.json.gz", DOCS / "tasks.md", DOCS / "leaderboard.csv"
MARKERS = ("admission", "rules", "tasks")


def known(file: Path) -> dict[str, Json]:
    """Return what earlier runs found, by environment; raises ParameterError for a file that is another."""
    if not file.exists():
        return {}
    try:
        found = dict(read_json(file)["tasks"])
        rooms(found)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(f"--json = {file} is not allowed: a file that an earlier run of this command wrote ({error!r})") from error
    return {name: found[name] for name in ENVIRONMENTS if name in found}


@command()
@click.option("--task", "tasks", multiple=True, type=click.Choice(sorted(WITH_ROOM)), help="May be repeated.  [default: all]")
@click.option("--quick", is_flag=True, help="A few seeds and generations: to see that it works.")
@click.option("--judged", type=click.IntRange(min=8), help="Seeds that all are judged on.  [default: 32 to 64, by task]")
@click.option("--agents", type=click.Path(path_type=Path, file_okay=False, exists=True), help="Folder of trained agents to judge beside rules.")
@click.option("--json", "target", type=click.Path(path_type=Path), help="File of the numbers, to which others are added.")
@click.option("--page", type=click.Path(path_type=Path), help=f"Write tables, and what each task is, into a page, as in docs/{PAGE.name}.")
@click.option("--leaderboard", type=click.Path(path_type=Path), help=f"Judge rules and shipped agents on test seeds, as in docs/{BOARD.name}.")
@click.option("--redraw", is_flag=True, help="The page again from the numbers in --json; nothing is computed.")
def main(
    tasks: tuple[str, ...],
    quick: bool,
    judged: int | None,
    agents: Path | None,
    target: Path | None,
    page: Path | None,
    leaderboard: Path | None,
    redraw: bool,
) -> None:
    """Find the best rules of each task, let planners look ahead, and print scores and room."""
    try:
        check_target("--json", target)
        check_target("--page", page)
        check_target("--leaderboard", leaderboard)
        if page is not None:
            require_markers(page, PAGE, MARKERS)
        found = known(target or NUMBERS) if target is not None or redraw else {}
        for task in () if redraw else tasks or tuple(WITH_ROOM):
            name = WITH_ROOM[task]
            effort = QUICK if quick else EFFORTS[name]
            effort = replace(effort, judged=judged or effort.judged)
            trained = [] if agents is None else find_agents(agents, FINAL, name)
            with Bar(total=tried(name, effort), desc=task, unit="candidate", leave=False) as bar:
                found[name] = admit(name, {}, effort, trained, bar.update)
            found = {known_name: found[known_name] for known_name in ENVIRONMENTS if known_name in found}
            if target is not None:
                write_json(target, {"tasks": found})
        click.echo(rooms(found))
        if leaderboard is not None:
            write(leaderboard, found, EPISODES)
        if page is not None:
            fill(page, PAGE, {"admission": rooms(found), "rules": searches(found), "tasks": described()})
    except ParameterError as error:
        raise BadInput(str(error)) from error
