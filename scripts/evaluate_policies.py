"""Policies judged on the same held-out seeds: rules and schedules without learning, and trained agents."""

# needs: env, rl, optimise

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from _policy_tables import TASK_WORDS, short_table, table
from tqdm import tqdm

from impact_env.parameters import ParameterError, require
from optimisation.command_line import BadInput
from optimisation.files import replacing, require_writable, write_json
from optimisation.report.policy_figures import save_gaps, save_profiles, save_responses, save_schedules
from optimisation.rl.agents import Agent
from optimisation.rl.baselines import (
    BEST_GAP,
    BEST_SCHEDULE,
    GROUPS,
    GROUPS_HELP,
    KNOTTED,
    RIVAL,
    TASKS,
    WINDOWED,
    ZERO_AND_ONE,
    families,
    load,
    policy,
)
from optimisation.rl.ceiling import SEEDS as CEILING_SEEDS
from optimisation.rl.ceiling import best_by_luck
from optimisation.rl.judging import FIRST_HELD_OUT_SEED, Judged, Line, agents_for, contenders, judge, read_results, summarise, write_results
from optimisation.rl.policies import Policy
from optimisation.rl.statistics import RESAMPLES
from optimisation.rl.suite import SUITE
from optimisation.rl.traces import gap_curves, passage_curves, response_curves
from optimisation.studies.page import ROOT, fill, published

POLICIES, PAGE = ROOT / "docs" / "policies", ROOT / "docs" / "agents.md"
QUICK_OUT = Path("results/evaluate_policies")
OUT = published(POLICIES, QUICK_OUT)
AGENTS = (ROOT / "docs" / "agents", Path("results/train_sweep_agent"))
SEEDS, SUITE_SEEDS, QUICK_SEEDS, QUICK_RESAMPLES, SHOWN = 128, 1024, 16, 100, 16  # SHOWN: passages a run in the figure of schedules
CEILING = "best schedule by luck"
INTERRUPTED = 130


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
    with tqdm(total=sum(len(runs) for _, _, runs in everyone), desc=f"{task}: playing", unit="policy", leave=False, disable=None) as bar:
        return [judge(task, contender, seeds, arguments, bar.update) for contender in everyone]


def curves_of(task: str, policies: list[Policy], agents: list[Agent], arguments: dict[str, Any], seeds: Sequence[int]) -> dict[str, Any]:
    """Return what the figure of schedules shows: the yardsticks, the rival and the agents."""
    wanted = (*ZERO_AND_ONE[task], RIVAL[task], *(() if task == "gap" else (WINDOWED, KNOTTED)))
    shown: dict[str, list[Policy]] = {p.name: [p] for p in policies if p.name in wanted}
    for agent in agents:
        shown.setdefault(agent.algorithm.upper(), []).append(agent)
    if task in SUITE:
        return response_curves(task, shown, seeds[:SHOWN], arguments)
    if task == "sweep":
        return passage_curves(shown, seeds[:SHOWN], arguments)
    return gap_curves({name: runs[0] for name, runs in shown.items() if name != BEST_GAP}, seeds[0], arguments)


def draw(task: str, out: Path, results: list[Judged], curves: dict[str, Any], resamples: int) -> None:
    """Draw the figures of a task."""
    title = f"{TASK_WORDS[task].capitalize()}: performance profile, {len(results[0].seeds)} held-out seeds"
    marks = {r.name: float(r.scores.mean()) for r in results if r.name == BEST_SCHEDULE} if task in SUITE else {}
    if CEILING in curves:
        marks[CEILING] = curves[CEILING]
    save_profiles(out / f"{task}_profile.png", results, title, resamples, marks)
    if task in SUITE:
        save_responses(out / f"{task}_responses.png", curves, TASK_WORDS[task].capitalize())
    elif task == "sweep":
        save_schedules(out / "sweep_schedules.png", curves, "What the policies do (median and 5 to 95 % over passages and agents)")
    else:
        save_gaps(out / "gap_episode.png", curves)


def report(task: str, out: Path, results: list[Judged], curves: dict[str, Any], resamples: int) -> list[Line]:
    """Write table and figures; return the table's lines."""
    with tqdm(total=len(results), desc=f"{task}: intervals", unit="policy", leave=False, disable=None) as bar:
        lines = summarise(task, results, resamples, bar.update)
    zero, one = ZERO_AND_ONE[task]
    about = {"task": task, "evaluation_seeds": len(results[0].seeds), "resamples": resamples, "normalised_0": zero, "normalised_1": one}
    about |= {CEILING: curves[CEILING]} if CEILING in curves else {}
    write_json(out / f"{task}_table.json", {**about, "rival": RIVAL[task], "policies": [asdict(line) for line in lines]})
    with replacing(out / f"{task}_table.md") as temporary:
        temporary.write_text(table(task, lines) + "\n", encoding="utf-8")
    draw(task, out, results, curves, resamples)
    return lines


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--task", type=click.Choice([*TASKS, *GROUPS]), default="both", show_default=True, help=GROUPS_HELP)
@click.option("--agents", type=click.Path(path_type=Path), help="Folder with agents, or one agent's file.  [default: docs/agents, else results]")
@click.option("--without-agents", is_flag=True, help="Judge only what does not learn.")
@click.option(
    "--baselines", type=click.Path(file_okay=False, path_type=Path), default=POLICIES, help="Folder of TASK_baselines.json.  [default: docs/policies]"
)
@click.option("--policy", "names", multiple=True, metavar="NAME", help="Judge only this one of the baselines; may be given several times.")
@click.option("--seeds", type=click.IntRange(min=2), help=f"Number of evaluation seeds.  [default: {SEEDS}, suite {SUITE_SEEDS}]")
@click.option("--ceiling", type=click.IntRange(min=1), metavar="DRAWS", help="Suite: the best of so many random schedules, too, on 64 seeds.")
@click.option("--quick", is_flag=True, help=f"{QUICK_SEEDS} evaluation seeds, into {QUICK_OUT} unless told otherwise: a look, not a result.")
@click.option("--redraw", is_flag=True, help="Tables and figures again from the files in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for results.  [default: docs/policies, with the page docs/agents.md; without a checkout {QUICK_OUT}]",
)
def main(
    task: str,
    agents: Path | None,
    without_agents: bool,
    baselines: Path,
    names: tuple[str, ...],
    seeds: int | None,
    ceiling: int | None,
    quick: bool,
    redraw: bool,
    out: Path | None,
) -> None:
    """Play every policy on the same held-out seeds, and say which is better and how sure that is.

    Writes TASK_results.csv (each episode), TASK_table.json and .md, TASK_curves.json, and figures.
    """
    folder = out or (QUICK_OUT if quick else OUT)
    resamples = QUICK_RESAMPLES if quick else RESAMPLES
    lines = {}
    try:
        require_writable("--out", folder)
        for name in GROUPS.get(task, (task,)):
            if redraw:
                results, curves = read_results(folder / f"{name}_results.csv"), read_curves(folder / f"{name}_curves.json")
            else:
                count = seeds or (QUICK_SEEDS if quick else SUITE_SEEDS if name in SUITE else SEEDS)
                held_out = range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + count)
                results, curves = _judged(name, agents, without_agents, baselines, names, held_out)
                if ceiling and name in SUITE:
                    stored = load(baselines / f"{name}_baselines.json", name)[1]
                    curves[CEILING] = float(best_by_luck(name, held_out[:CEILING_SEEDS], stored, ceiling).mean())
                write_results(folder / f"{name}_results.csv", results)
                write_json(folder / f"{name}_curves.json", curves)
            lines[name] = report(name, folder, results, curves, resamples)
            click.echo(f"{name}:\n{table(name, lines[name])}\n")
        if folder.resolve() == POLICIES.resolve():
            short = {"policies": short_table(lines)} if task == "both" else {"suite": short_table(lines)} if task == "suite" else {}
            fill(PAGE, PAGE, short | {f"{name} table": table(name, found) for name, found in lines.items()})
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        click.echo("Stopped; the tasks that are finished are written.", err=True)
        sys.exit(INTERRUPTED)


def _judged(
    task: str, place: Path | None, without_agents: bool, baselines: Path, names: Sequence[str], seeds: Sequence[int]
) -> tuple[list[Judged], dict[str, Any]]:
    stored, arguments = load(baselines / f"{task}_baselines.json", task)
    kinds = families(task, arguments)
    policies = chosen([policy(baseline, kinds) for baseline in stored], names)
    agents = [] if without_agents else agents_for(task, agents_folder(place), arguments)
    return played(task, policies, agents, arguments, seeds), curves_of(task, policies, agents, arguments, seeds)


def read_curves(path: Path) -> dict[str, Any]:
    """Return stored curves."""
    require(path.is_file(), "curves", str(path), "a file that evaluate_policies has written")
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


if __name__ == "__main__":
    main(prog_name="scripts/run evaluate_policies")
