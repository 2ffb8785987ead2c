"""Agents for the environments, by PPO and SAC."""

# needs: env, rl

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import available_cores
from optimisation.cli.common import command, end_early, plain_errors
from optimisation.cli.options import FOLDER, OptionSpec, at_least, file_spec, number, option
from optimisation.executors import Bar
from optimisation.files import markdown, replacing, require_writable, write_csv, write_json
from optimisation.rl.agents import Run, TrainingEvaluation, find_runs, run_folder, ship
from optimisation.rl.families import RandomPolicy
from optimisation.rl.hyperparameters import (
    AGENT,
    ALGORITHMS,
    FRESH,
    RULE,
    recipes,
    settings_for,
    write_zoo,
)
from optimisation.rl.rules import TASKS, env_of, policies

# a task that is learnt in minutes
BOTH = "both"
DEFAULT = "ActiveFriction-v0"
SEEDS = 10
STARTS = (RULE, AGENT, FRESH)
QUICK_SHARE = 0.1
QUICK_LEGS = 10
OUT = Path("results/rl_train")
TASKS_MORE = f"{', '.join(TASKS)}."


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Options of ``rl train``; None: not given."""

    tasks: tuple[str, ...] = option(
        "tasks", type=click.Choice(list(TASKS)), more=TASKS_MORE, default=(DEFAULT,)
    )
    algorithm: str = option(
        OptionSpec(
            names=("--algorithm",),
            help=f"Algorithm: {', '.join([*ALGORITHMS, BOTH])}",
            more="both: all that the task has.",
            type=click.Choice([*ALGORITHMS, BOTH]),
            metavar="NAME",
            default=BOTH,
            usual=True,
        )
    )
    seeds: int | None = option(
        number(
            "--seeds",
            "Agents of each algorithm",
            type=at_least(1),
            default_text=f"{SEEDS}, with --quick 1",
            usual=True,
        )
    )
    steps: int | None = option(
        number(
            "--steps",
            "Steps of the environment for each agent",
            type=at_least(1),
            default_text="as in the hyperparameters",
            usual=True,
        )
    )
    quick: bool = option(
        "quick",
        help=f"A first answer: one seed and {100 * QUICK_SHARE:g} % of the steps",
        more="With a line for every evaluation.",
    )
    hyperparameters: Path | None = option(
        file_spec("--hyperparameters", "YAML file; replaces those it names", section="Computation")
    )
    arguments: tuple[tuple[str, str], ...] = option(
        OptionSpec(
            names=("--argument",),
            help="Argument of the environment; may be repeated",
            type=(str, str),
            metavar="NAME VALUE",
            multiple=True,
        )
    )
    start: str | None = option(
        OptionSpec(
            names=("--from",),
            help=f"Policy that the actor imitates before training: {', '.join(STARTS)} or a path",
            more=(
                "rule: the best rule of the task; agent: the agent that ships; the path of an "
                "agent's file, or of a data set of rl demonstrations."
            ),
            type=str,
            metavar="START",
            default_text="as in the hyperparameters",
            usual=True,
            older=("--demonstrations",),
        )
    )
    workers: int | None = option(
        number(
            "--workers",
            "Processes to train in, each on one core",
            type=at_least(1),
            default_text="all cores",
            section="Runs",
        )
    )
    out: Path | None = option("out", default_text=f"{OUT}, with --quick {OUT}_quick")
    zoo: Path | None = option(
        OptionSpec(
            names=("--zoo",),
            help="Only write all recipes there, as rl-zoo3 has them",
            type=FOLDER,
            metavar="FOLDER",
            section="Output",
        )
    )
    ship: Path | None = option(
        OptionSpec(
            names=("--ship",),
            help="Write typical agents there, each as the one file that ships",
            type=click.Path(path_type=Path),
            metavar="FOLDER",
            section="Output",
        )
    )

    @property
    def folder(self) -> Path:
        """Return the folder of the results."""
        return self.out or (OUT.with_name(f"{OUT.name}_quick") if self.quick else OUT)


def plan(task: str, options: TrainOptions) -> list[Any]:
    """Return the runs of a task.

    Raises ParameterError before any training if a run cannot be started or continued.
    """
    from optimisation.rl.starts import describe_start  # torch is slow to import
    from optimisation.rl.training import Job, PlannedTraining, check_folder

    env_id = env_of(task)
    algorithms = recipes(env_id) if options.algorithm == BOTH else [options.algorithm]
    arguments = environment_arguments(options.arguments)
    runs = []
    for seed in range(options.seeds or (1 if options.quick else SEEDS)):
        for algorithm in algorithms:
            chosen = settings_for(env_id, algorithm, options.hyperparameters)
            steps = options.steps or (
                round(QUICK_SHARE * chosen.steps) if options.quick else chosen.steps
            )
            legs = max(1, min(QUICK_LEGS if options.quick else chosen.legs, steps // chosen.round))
            chosen = settings_for(
                env_id,
                algorithm,
                options.hyperparameters,
                steps=steps,
                legs=legs,
                **({} if options.start is None else {"start": options.start}),
            )
            describe_start(chosen, env_id, algorithm)
            job = Job(env_id, algorithm, seed, chosen, arguments)
            folder = run_folder(options.folder, task, algorithm, seed)
            check_folder(job, folder)
            runs.append(PlannedTraining(job, folder))
    return runs


def baseline_scores(task: str, job: Any) -> dict[str, float]:
    """Return the baselines' mean scores on the evaluation seeds.

    The baselines are random actions and the policies that were chosen without learning.
    """
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
    """Return keyword arguments of the environment from names and JSON values.

    A value that is not JSON is a string.
    """
    arguments: dict[str, Any] = {}
    for name, text in pairs:
        try:
            arguments[name] = json.loads(text)
        except ValueError:
            arguments[name] = text
    return arguments


def train_task(task: str, options: TrainOptions) -> bool:
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
        return (
            f"{planned.label}: score {evaluation.score:.4f} after {evaluation.steps:,} steps   "
            f"({known})"
        )

    try:
        failures = train_all(
            runs, options.workers or available_cores(), format_line if options.quick else None
        )
    except KeyboardInterrupt:
        finished = False
    write(options.folder, task, baselines, find_runs(options.folder / task))
    if failures:
        raise click.ClickException("\n".join(failures))
    return finished


@command(
    TrainOptions,
    examples=(
        "rl train --quick --steps 512",
        "rl train --task ActiveGap-v0 --algorithm ppo --seeds 3",
    ),
)
def main(options: TrainOptions) -> None:
    """Train agents, seed by seed, and draw their learning curves.

    Each agent has a folder TASK/ALGORITHM/seed-N with settings.json, evaluations.csv, final.npz
    (the agent of the best evaluation), its best and its last two checkpoints and TensorBoard's
    files. Ctrl-C, or kill -9, ends training early, and the same command goes on from the last
    checkpoint; agents that are finished are not trained again.
    """
    if options.zoo is not None:
        click.echo("written: " + ", ".join(map(str, write_zoo(options.zoo))))
        return
    out = options.folder
    finished = True
    goes_on = "the same command goes on from the last checkpoints."
    with plain_errors(f"Stopped early: {goes_on}"):
        require_writable("--out", out)
        if options.ship is not None:
            require_writable("--ship", options.ship)
        for task in options.tasks:
            finished = finished and train_task(task, options)
        if finished and options.ship is not None:
            click.echo(f"{len(ship(out, options.ship))} agents written to {options.ship}")
    end_early(finished, goes_on)
