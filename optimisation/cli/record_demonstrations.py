"""Episodes of a rule, of an agent or of chance as an offline data set in Minari's format."""

# needs: env, offline

from pathlib import Path
from typing import Any

import click

from impact_env.envs.evaluation import SEED_SPLITS
from optimisation.cli.common import command, plain_errors
from optimisation.files import require_writable
from optimisation.rl.agents import load_agent
from optimisation.rl.demonstrations import record, write_demonstrations
from optimisation.rl.families import RandomPolicy
from optimisation.rl.rules import EIGHT, TASKS, env_of, policies

EPISODES = 256
POLICIES = ("rule", "ppo", "sac", "random")


@command()
@click.option(
    "--task",
    "tasks",
    multiple=True,
    type=click.Choice(list(TASKS)),
    help="May be repeated.  [default: all]",
)
@click.option(
    "--policy",
    "words",
    multiple=True,
    type=click.Choice(POLICIES),
    default=("rule",),
    show_default=True,
    help="May be repeated.",
)
@click.option(
    "--episodes",
    type=click.IntRange(min=1),
    default=EPISODES,
    show_default=True,
    help="Episodes a set, on training seeds.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("results/demonstrations"),
    show_default=True,
)
def main(tasks: tuple[str, ...], words: tuple[str, ...], episodes: int, out: Path) -> None:
    """Play episodes of each task and write OUT/TASK-POLICY-v0, a data set that Minari reads (MINARI_DATASETS_PATH=OUT)."""
    with plain_errors():
        require_writable("--out", out)
        for task in tasks or TASKS:
            for word in words:
                chance = RandomPolicy(numbers=TASKS[task].numbers) if word == "random" else None
                plays: Any = chance or (
                    policies(task)[EIGHT] if word == "rule" else load_agent(task, word)
                )
                demonstrations = record(plays, env_of(task), SEED_SPLITS["train"][:episodes])
                folder = out / f"{task.rpartition('-')[0]}-{word}-v0"
                write_demonstrations(folder, demonstrations, word)
                scores = sum(float(rewards.sum()) for rewards in demonstrations.rewards)
                steps = sum(map(len, demonstrations.rewards))
                click.echo(
                    f"{folder}: {episodes} episodes of {word}, {steps:,} steps, mean score {scores / episodes:.3f}"
                )
