"""Policies judged on the same held-out seeds: rules and schedules without learning, and trained agents."""


# needs: env

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from impact_env.envs.evaluation import RESAMPLES
from impact_env.parameters import ParameterError, require
from optimisation.cli.common import INTERRUPTED, BadInput, command
from optimisation.files import read_json, require_writable, write_json
from optimisation.page import ROOT, fill, published
from optimisation.progress import Bar
from optimisation.report.policy_tables import short_table, table
from optimisation.rl.agents import Agent
from optimisation.rl.baselines import TUNED, families, load, policy
from optimisation.rl.ceiling import SEEDS as CEILING_SEEDS
from optimisation.rl.ceiling import best_by_luck
from optimisation.rl.judging import FIRST_HELD_OUT_SEED, Judged, Line, agents_for, contenders, judge, read_results, summarise, write_results
from optimisation.rl.policies import Policy
from optimisation.rl.tasks.table import GROUPS, GROUPS_HELP, TASKS, task_named
from optimisation.rl.tasks.task import FEW_SEEDS, MANY_SEEDS

POLICIES, PAGE = ROOT / "docs" / "policies", ROOT / "docs" / "agents.md"
QUICK_OUT = Path("results/evaluate_policies")
OUT = published(POLICIES, QUICK_OUT)
KEPT = ROOT / "docs" / "agents"  # one agent of each algorithm
AGENTS = (Path("results/train_sweep_agent"), KEPT)
QUICK_SEEDS, QUICK_RESAMPLES, SHOWN = 16, 100, 16  # SHOWN: passages a run in the figure of what policies do
CEILING = "best schedule by luck"


def agents_folder(given: Path | None) -> Path:
    """Return the folder with agents: the one given, or the first default that exists."""
    return given if given is not None else next((place for place in AGENTS if place.is_dir()), AGENTS[0])


def chosen(policies: list[Policy], names: Sequence[str]) -> list[Policy]:
    """Return the policies named, all if none is; raises ParameterError for an unknown name."""
    known = [p.name for p in policies]
    for name in names:
        require(name in known, "--policy", name, f"one of {'; '.join(known)}")
    return [p for p in policies if not names or p.name in names]


def played(task: str, policies: list[Policy], agents: list[Agent], arguments: dict[str, Any], seeds: Sequence[int]) -> list[Judged]:
    """Return the results of all contenders."""
    everyone = contenders(policies, agents)
    with Bar(total=sum(len(runs) for _, _, runs in everyone), desc=f"{task}: playing", unit="policy", leave=False) as bar:
        return [judge(task, contender, seeds, arguments, bar.update) for contender in everyone]


def curves_of(task: str, policies: list[Policy], agents: list[Agent], arguments: dict[str, Any], seeds: Sequence[int]) -> dict[str, Any]:
    """Return what the figure of a task shows: some of its baselines, and the agents."""
    own = task_named(task)
    shown: dict[str, list[Policy]] = {p.name: [p] for p in policies if p.name in own.figure.shown}
    for agent in agents:
        shown.setdefault(agent.algorithm.upper(), []).append(agent)
    return own.curves(shown, seeds[:SHOWN], arguments)


def draw(task: str, out: Path, results: list[Judged], curves: dict[str, Any], resamples: int) -> None:
    """Draw the figures of a task."""
    from optimisation.report.policy_figures import CURVES, save_profiles  # matplotlib is slow to import

    own = task_named(task)
    title = f"{own.words.capitalize()}: performance profile, {len(results[0].seeds)} held-out seeds"
    marks = {r.name: float(r.scores.mean()) for r in results if r.name in own.marked}
    if CEILING in curves:
        marks[CEILING] = curves[CEILING]
    save_profiles(out / f"{task}_profile.png", results, title, resamples, marks)
    CURVES[own.figure.kind](out / f"{task}_{own.figure.kind}.png", curves, own.figure.title)


def report(task: str, out: Path, results: list[Judged], curves: dict[str, Any], resamples: int) -> list[Line]:
    """Write the table as JSON, and figures; return the table's lines."""
    with Bar(total=len(results), desc=f"{task}: intervals", unit="policy", leave=False) as bar:
        lines = summarise(task, results, resamples, bar.update)
    zero, one, rival = task_named(task).yardsticks
    about = {"task": task, "evaluation_seeds": len(results[0].seeds), "resamples": resamples, "normalised_0": zero, "normalised_1": one}
    about |= {CEILING: curves[CEILING]} if CEILING in curves else {}
    write_json(out / f"{task}_table.json", {**about, "rival": rival, "policies": [asdict(line) for line in lines]})
    draw(task, out, results, curves, resamples)
    return lines


def play(task: str, given: dict[str, Any], held_out: range) -> tuple[list[Judged], dict[str, Any]]:
    """Play a task's policies and agents on the held-out seeds; return results and curves."""
    baselines: Path = given["baselines"]
    stored, arguments = load(baselines / f"{task}_baselines.json", task)
    kinds = families(task, arguments)
    policies = chosen([policy(baseline, kinds) for baseline in stored], given["names"])
    agents = [] if given["without_agents"] else agents_for(task, agents_folder(given["agents"]), arguments)
    results, curves = played(task, policies, agents, arguments, held_out), curves_of(task, policies, agents, arguments, held_out)
    if given["ceiling"] and task_named(task).luck is not None:
        curves[CEILING] = float(best_by_luck(task, held_out[:CEILING_SEEDS], arguments, given["ceiling"]).mean())
    return results, curves


def evaluate(task: str, given: dict[str, Any], folder: Path) -> list[Line]:
    """Play a task, or read what was played, write its files and return the lines of its table. Raises ParameterError."""
    stored = (folder / f"{task}_results.npz", folder / f"{task}_curves.json.gz")
    if given["redraw"]:
        results, curves = read_results(stored[0]), read_curves(stored[1])
    else:
        count = given["seeds"] or (QUICK_SEEDS if given["quick"] else task_named(task).evaluation_seeds)
        results, curves = play(task, given, range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + count))
        write_results(stored[0], results)
        write_json(stored[1], curves)
    return report(task, folder, results, curves, QUICK_RESAMPLES if given["quick"] else RESAMPLES)


def publish(group: str, tables: Mapping[str, Sequence[Line]], folder: Path) -> None:
    """Write the tables into the page of agents if ``folder`` is where its numbers are kept."""
    if folder.resolve() == POLICIES.resolve():
        short = {"policies": short_table(tables)} if group == "both" else {"suite": short_table(tables)} if group == "suite" else {}
        fill(PAGE, PAGE, short | {f"{name} table": table(name, found) for name, found in tables.items()})


def read_curves(path: Path) -> dict[str, Any]:
    """Return stored curves."""
    require(path.is_file(), "curves", str(path), "a file that evaluate_policies has written")
    return dict(read_json(path))


@command()
@click.option("--task", type=click.Choice([*TASKS, *GROUPS]), default="both", show_default=True, help=GROUPS_HELP)
@click.option("--agents", type=click.Path(path_type=Path), help="Folder with agents, or one file.  [default: those in results, else docs/agents]")
@click.option("--without-agents", is_flag=True, help="Judge only what does not learn.")
@click.option(
    "--baselines",
    type=click.Path(file_okay=False, path_type=Path),
    default=TUNED,
    help="Folder of TASK_baselines.json.  [default: this package's]",
)
@click.option("--policy", "names", multiple=True, metavar="NAME", help="Judge only this one of the baselines; may be given several times.")
@click.option("--seeds", type=click.IntRange(min=2), help=f"Number of evaluation seeds.  [default: {FEW_SEEDS}, suite {MANY_SEEDS}]")
@click.option("--ceiling", type=click.IntRange(min=1), metavar="DRAWS", help="Suite: the best of so many random schedules, too, on 64 seeds.")
@click.option("--quick", is_flag=True, help=f"{QUICK_SEEDS} evaluation seeds, into {QUICK_OUT} unless told otherwise: a look, not a result.")
@click.option("--redraw", is_flag=True, help="Tables and figures again from the files in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for results.  [default: docs/policies, with the page docs/agents.md; without a checkout {QUICK_OUT}]",
)
def main(task: str, out: Path | None, **given: Any) -> None:
    """Play every policy on the same held-out seeds, and say which is better and how sure that is.

    Writes TASK_results.npz (each episode), TASK_table.json, TASK_curves.json.gz, and figures.
    """
    folder, tables = out or (QUICK_OUT if given["quick"] else OUT), {}
    try:
        require_writable("--out", folder)
        if folder.resolve() == POLICIES.resolve() and not (given["redraw"] or given["without_agents"]):
            agents = agents_folder(given["agents"])
            require(agents.resolve() != KEPT.resolve(), "--agents", str(agents), "a folder with all agents that the page tells of; or choose --out")
        for name in GROUPS.get(task, (task,)):
            tables[name] = evaluate(name, given, folder)
            click.echo(f"{name}:\n{table(name, tables[name])}\n")
        publish(task, tables, folder)
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        click.echo("Stopped; the tasks that are finished are written.", err=True)
        sys.exit(INTERRUPTED)
