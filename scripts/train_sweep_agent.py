"""Train agents for the environments with PPO and SAC: learning curves, checkpoints that resume, one small file an agent."""

# needs: env, rl

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import available_cores
from impact_env.parameters import ParameterError
from optimisation.command_line import INTERRUPTED, BadInput
from optimisation.commands.agent_training import BOTH, OUT, POLICIES, QUICK_SHARE, SEEDS, environment_arguments, train_task
from optimisation.files import require_writable
from optimisation.rl.hyperparameters import ALGORITHMS
from optimisation.rl.runs import collect, find_runs
from optimisation.rl.tasks.table import GROUPS, GROUPS_HELP, TASKS


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--task", type=click.Choice([*TASKS, *GROUPS]), default="sweep", show_default=True, help=GROUPS_HELP)
@click.option(
    "--algorithm",
    type=click.Choice([*ALGORITHMS, BOTH]),
    default=BOTH,
    show_default=True,
    help="Both: all that the task has.",
)
@click.option("--seeds", type=click.IntRange(min=1), help=f"Agents of each algorithm.  [default: {SEEDS}, with --quick 1]")
@click.option("--steps", type=click.IntRange(min=1), help="Steps of the environment for each agent.  [default: as in the hyperparameters]")
@click.option("--quick", is_flag=True, help=f"A look: one seed, {100 * QUICK_SHARE:g} % of the steps, and a line for every evaluation.")
@click.option("--hyperparameters", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="YAML; replaces those it names.")
@click.option("--argument", "arguments", multiple=True, type=(str, str), metavar="NAME VALUE", help="Argument of the environment; may be repeated.")
@click.option("--demonstrations", type=click.Path(path_type=Path), metavar="FOLDER", help="Data set of record_demonstrations to begin by imitating.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes to train in, each on one core.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder.  [default: {OUT}, with --quick {OUT}_quick]")
@click.option("--baselines", type=click.Path(path_type=Path), default=POLICIES, show_default=True, help="Folder of tune_baselines to compare with.")
@click.option("--collect", "target", type=click.Path(path_type=Path), metavar="FOLDER", help="Copy agents and evaluations there in the end.")
def main(**given: Any) -> None:
    """Train agents, seed by seed, and draw their learning curves.

    Each agent has a folder TASK/ALGORITHM/seed-N with settings.json, evaluations.csv, final.npz, best.npz (best on the evaluation seeds), its
    last two checkpoints and TensorBoard's files. Ctrl-C, or kill -9, ends training early, and the same command goes on from the last
    checkpoint; agents that are finished are not trained again.
    """
    quick = given["quick"]
    given["seeds"] = given["seeds"] or (1 if quick else SEEDS)
    given["workers"] = given["workers"] or available_cores()
    given["out"] = given["out"] or (OUT.with_name(f"{OUT.name}_quick") if quick else OUT)
    given["arguments"] = environment_arguments(given["arguments"])
    finished = True
    try:
        require_writable("--out", given["out"])
        if given["target"] is not None:
            require_writable("--collect", given["target"])
        for task in GROUPS.get(given["task"], (given["task"],)):
            finished = finished and train_task(task, given)
        if finished and given["target"] is not None:
            click.echo(f"{collect(find_runs(given['out']), given['out'], given['target'])} agents copied to {given['target']}")
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        finished = False
    if not finished:
        click.echo("Stopped early: the same command goes on from the last checkpoints.", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main(prog_name="scripts/run train_sweep_agent")
