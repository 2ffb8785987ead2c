"""Episodes as an offline data set in Minari's format."""

# needs: env, offline

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from impact_env.envs.evaluation import SEED_SPLITS
from optimisation.cli.common import command, plain_errors
from optimisation.cli.options import FOLDER, OptionSpec, option
from optimisation.files import require_writable
from optimisation.rl.agents import load_agent
from optimisation.rl.demonstrations import record, write_demonstrations
from optimisation.rl.families import RandomPolicy
from optimisation.rl.rules import EIGHT, TASKS, env_of, policies

EPISODES = 256
POLICIES = ("rule", "ppo", "sac", "rpi", "random")


@dataclass(frozen=True, kw_only=True)
class DemonstrationOptions:
    """Options of ``rl demonstrations``."""

    tasks: tuple[str, ...] = option(
        "tasks",
        type=click.Choice(list(TASKS)),
        more=f"{', '.join(TASKS)}.",
        default_text="all",
    )
    words: tuple[str, ...] = option(
        OptionSpec(
            names=("--policy",),
            help=f"What acts: {', '.join(POLICIES)}; may be repeated",
            type=click.Choice(POLICIES),
            metavar="NAME",
            multiple=True,
            default=("rule",),
            usual=True,
        )
    )
    episodes: int = option(
        "episodes", help="Episodes of each set, on training seeds", default=EPISODES
    )
    out: Path = option(
        "out",
        help="Folder of the data sets",
        type=FOLDER,
        default=Path("results/demonstrations"),
    )


@command(DemonstrationOptions, examples=("rl demonstrations --task GapChoice-v1 --episodes 2",))
def main(options: DemonstrationOptions) -> None:
    """Play episodes of each task and write the data set OUT/TASK-POLICY-v0.

    Minari reads it (MINARI_DATASETS_PATH=OUT).
    """
    with plain_errors():
        require_writable("--out", options.out)
        for task in options.tasks or TASKS:
            for word in options.words:
                chance = RandomPolicy(numbers=TASKS[task].numbers) if word == "random" else None
                plays: Any = chance or (
                    policies(task)[EIGHT] if word == "rule" else load_agent(task, word)
                )
                demonstrations = record(
                    plays, env_of(task), SEED_SPLITS["train"][: options.episodes]
                )
                folder = options.out / f"{task.rpartition('-')[0]}-{word}-v0"
                write_demonstrations(folder, demonstrations, word)
                scores = sum(float(rewards.sum()) for rewards in demonstrations.rewards)
                steps = sum(map(len, demonstrations.rewards))
                click.echo(
                    f"{folder}: {options.episodes} episodes of {word}, {steps:,} steps, mean "
                    f"score {scores / options.episodes:.3f}"
                )
