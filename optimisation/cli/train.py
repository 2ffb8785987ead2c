"""Train agents for the environments with PPO and SAC: learning curves, checkpoints that resume, one small file an agent."""

# needs: env, rl

import json
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import available_cores
from optimisation.cli.common import command, end_early, plain_errors
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.page import markdown
from optimisation.progress import Bar
from optimisation.rl.agents import Run, TrainingEvaluation, find_runs, run_folder, ship
from optimisation.rl.families import RandomPolicy
from optimisation.rl.hyperparameters import ALGORITHMS, recipes, settings_for, write_zoo
from optimisation.rl.rules import TASKS, env_of, policies

# a task that is learnt in minutes
BOTH = "both"
DEFAULT = "ActiveFriction-v0"
SEEDS = 10
QUICK_SHARE = 0.25
QUICK_LEGS = 10
OUT = Path("results/train")


def plan(task: str, options: dict[str, Any]) -> list[Any]:
    """Return the runs of a task; raise ParameterError before anything is trained if one cannot be made or gone on with."""
    from optimisation.rl.training import Job, Planned, check_folder  # torch is slow to import

    env_id = env_of(task)
    algorithms = recipes(env_id) if options["algorithm"] == BOTH else [options["algorithm"]]
    runs = []
    for seed in range(options["seeds"]):
        for algorithm in algorithms:
            chosen = settings_for(env_id, algorithm, options["hyperparameters"])
            steps = options["steps"] or (
                round(QUICK_SHARE * chosen.steps) if options["quick"] else chosen.steps
            )
            legs = max(
                1, min(QUICK_LEGS if options["quick"] else chosen.legs, steps // chosen.round)
            )
            chosen = settings_for(
                env_id, algorithm, options["hyperparameters"], steps=steps, legs=legs
            )
            job = Job(
                env_id,
                algorithm,
                seed,
                chosen,
                options["arguments"],
                demonstrations=options["demonstrations"],
            )
            folder = run_folder(options["out"], task, algorithm, seed)
            check_folder(job, folder)
            runs.append(Planned(job, folder))
    return runs


def baseline_scores(task: str, job: Any) -> dict[str, float]:
    """Return mean scores on the evaluation seeds of chance and of what was chosen without learning."""
    from optimisation.rl.training import evaluate

    chosen = {"random": RandomPolicy(numbers=TASKS[task].numbers), **policies(task, job.arguments)}
    return {
        name: evaluate(policy, job, 0, 0).score
        for name, policy in Bar(chosen.items(), desc="without learning", leave=False)
    }


def write(out: Path, task: str, baselines: dict[str, float], runs: list[Run]) -> None:
    """Write figure and tables of a task's runs, and print the table."""
    from optimisation.report.learning_report import (
        COLUMNS,
        HEADER,
        learning_rows,
        save_learning_curve,
        table_rows,
    )  # matplotlib is slow to import

    unfinished = sum(not run.finished for run in runs)
    click.echo(markdown(HEADER, table_rows(runs, baselines)))
    click.echo(
        f"\n{task}; mean scores on the evaluation seeds"
        + (f"; {unfinished} of {len(runs)} runs are not finished" if unfinished else "")
    )
    write_csv(out / f"learning_{task}.csv", COLUMNS, learning_rows(runs))
    write_json(
        out / f"learning_{task}.json", {"baselines": baselines, "agents": table_rows(runs, {})}
    )
    with replacing(out / f"learning_{task}.png") as temporary:
        save_learning_curve(temporary, task, runs, baselines)
    click.echo(f"written: {out / f'learning_{task}.png'}, .csv, .json\n")


def environment_arguments(pairs: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    """Return keyword arguments of the environment from names and JSON values; what is no JSON is text."""
    arguments: dict[str, Any] = {}
    for name, text in pairs:
        try:
            arguments[name] = json.loads(text)
        except ValueError:
            arguments[name] = text
    return arguments


def train_task(task: str, options: dict[str, Any]) -> bool:
    """Train all runs of a task and report; return False if Ctrl-C ended it early."""
    from optimisation.rl.training import train_all

    runs = plan(task, options)
    finished = True
    failures = []
    baselines = baseline_scores(task, runs[0].job)
    for name, score in baselines.items():
        click.echo(f"{task}, {name}: score {score:.4f}")
    known = ", ".join(
        f"{name} {score:.4f}" for name, score in baselines.items()
    )  # beside how an agent does

    def format_line(planned: Any, evaluation: TrainingEvaluation) -> str:
        return f"{planned.label}: score {evaluation.score:.4f} after {evaluation.steps:,} steps   ({known})"

    try:
        failures = train_all(runs, options["workers"], format_line if options["quick"] else None)
    except KeyboardInterrupt:
        finished = False
    write(options["out"], task, baselines, find_runs(options["out"] / task))
    if failures:
        raise click.ClickException("\n".join(failures))
    return finished


@command()
@click.option(
    "--task",
    "tasks",
    multiple=True,
    type=click.Choice(list(TASKS)),
    default=(DEFAULT,),
    show_default=True,
    help="May be repeated.",
)
@click.option(
    "--algorithm",
    type=click.Choice([*ALGORITHMS, BOTH]),
    default=BOTH,
    show_default=True,
    help="Both: all that the task has.",
)
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    help=f"Agents of each algorithm.  [default: {SEEDS}, with --quick 1]",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    help="Steps of the environment for each agent.  [default: as in the hyperparameters]",
)
@click.option(
    "--quick",
    is_flag=True,
    help=f"A look: one seed, {100 * QUICK_SHARE:g} % of the steps, and a line for every evaluation.",
)
@click.option(
    "--hyperparameters",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="YAML; replaces those it names.",
)
@click.option(
    "--argument",
    "arguments",
    multiple=True,
    type=(str, str),
    metavar="NAME VALUE",
    help="Argument of the environment; may be repeated.",
)
@click.option(
    "--demonstrations",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Data set of record_demonstrations to begin by imitating.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes to train in, each on one core.  [default: all cores]",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder.  [default: {OUT}, with --quick {OUT}_quick]",
)
@click.option(
    "--zoo",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Only write all recipes there, as rl-zoo3 has them.",
)
@click.option(
    "--ship",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Write typical agents there, each as the one file that ships.",
)
def main(**options: Any) -> None:
    """Train agents, seed by seed, and draw their learning curves.

    Each agent has a folder TASK/ALGORITHM/seed-N with settings.json, evaluations.csv, final.npz, its last two checkpoints and
    TensorBoard's files. Ctrl-C, or kill -9, ends training early, and the same command goes on from the last
    checkpoint; agents that are finished are not trained again.
    """
    if options["zoo"] is not None:
        click.echo("written: " + ", ".join(map(str, write_zoo(options["zoo"]))))
        return
    quick = options["quick"]
    options["seeds"] = options["seeds"] or (1 if quick else SEEDS)
    options["workers"] = options["workers"] or available_cores()
    options["out"] = options["out"] or (OUT.with_name(f"{OUT.name}_quick") if quick else OUT)
    options["arguments"] = environment_arguments(options["arguments"])
    finished = True
    goes_on = "the same command goes on from the last checkpoints."
    with plain_errors(f"Stopped early: {goes_on}"):
        require_writable("--out", options["out"])
        if options["ship"] is not None:
            require_writable("--ship", options["ship"])
        for task in options["tasks"]:
            finished = finished and train_task(task, options)
        if finished and options["ship"] is not None:
            click.echo(
                f"{len(ship(options['out'], options['ship']))} agents written to {options['ship']}"
            )
    end_early(finished, goes_on)
