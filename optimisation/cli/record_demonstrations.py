"""Episodes of the feedback rules as an offline data set in Minari's format."""

# needs: env, offline

from __future__ import annotations

from pathlib import Path

import click

from impact_env.parameters import ParameterError
from optimisation.cli.common import BadInput, command
from optimisation.files import require_writable
from optimisation.rl.baselines import FIRST_TRAINING_SEED, TUNED, families, load, policy
from optimisation.rl.demonstrations import record, write_demonstrations
from optimisation.rl.tasks.baseline import FEEDBACK
from optimisation.rl.tasks.table import SUITE, task_named

EPISODES = 256


@command()
@click.option("--task", type=click.Choice([*SUITE, "suite"]), default="suite", show_default=True)
@click.option("--episodes", type=click.IntRange(min=1), default=EPISODES, show_default=True, help="Episodes a task, on training seeds.")
@click.option(
    "--baselines",
    type=click.Path(file_okay=False, path_type=Path),
    default=TUNED,
    help="Folder of TASK_baselines.json.  [default: this package's]",
)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("results/demonstrations"), show_default=True)
def main(task: str, episodes: int, baselines: Path, out: Path) -> None:
    """Play the tuned feedback rule of each task and write OUT/TASK-feedback-v0, a data set that Minari reads (MINARI_DATASETS_PATH=OUT)."""
    try:
        require_writable("--out", out)
        for name in SUITE if task == "suite" else (task,):
            stored, arguments = load(baselines / f"{name}_baselines.json", name)
            (rule,) = (policy(baseline, families(name, arguments)) for baseline in stored if baseline.name == FEEDBACK)
            shown = record(rule, task_named(name).env_id, range(FIRST_TRAINING_SEED, FIRST_TRAINING_SEED + episodes), arguments)
            folder = out / f"{name}-feedback-v0"
            write_demonstrations(folder, shown, FEEDBACK, arguments)
            scores = [float(rewards.sum()) for rewards in shown.rewards]
            steps = sum(len(rewards) for rewards in shown.rewards)
            click.echo(f"{folder}: {episodes} episodes, {steps:,} steps, mean score {sum(scores) / episodes:.4f}")
    except ParameterError as error:
        raise BadInput(str(error)) from error
