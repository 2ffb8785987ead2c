"""An episode of an environment as a film: the bent beam, the absorber in its cavity, level and frequency."""

# needs: env

from pathlib import Path
from typing import Any

import click

from optimisation.cli.common import FILE, BadInput, check_target, command, file_option, plain_errors
from optimisation.cli.scene_options import is_option_set
from optimisation.rl.agents import load_agent
from optimisation.rl.demonstrations import INTERVAL, NAMES, episode, save

OPTIONS = {"name": "env", "action": "action", "chance": "random", "interval": "interval"}


@command()
@click.option(
    "--env",
    "name",
    type=click.Choice(sorted(NAMES), case_sensitive=False),
    default="sweeprate",
    show_default=True,
)
@click.option(
    "--gif", "target", type=FILE, metavar="FILE", help="Write the film instead of showing it."
)
@click.option(
    "--action",
    type=click.FloatRange(-1, 1),
    default=1.0,
    show_default=True,
    help="What is done in every interval.",
)
@click.option(
    "--random", "chance", is_flag=True, help="Do something random in every interval instead."
)
@file_option("--agent", "A trained agent acts, in its own environment.")
@click.option(
    "--interval",
    type=float,
    help=f"Pseudo periods from frame to frame.  [default: {INTERVAL}, an agent's: as it was trained]",
)
@click.option("--force", type=float, help="Force in N.  [default: the environment's]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--frames",
    type=click.IntRange(min=2),
    default=400,
    show_default=True,
    help="Largest number of frames.",
)
def main(name: str, target: Path | None, agent: Path | None, **values: Any) -> None:
    """Run one episode and show it in a window, or write it as an animated GIF.

    By default the machine runs down through the resonance at the fastest rate of the task.
    """
    check_target("--gif", target, (".gif",))
    mode = "human" if target is None else "rgb_array"
    with plain_errors():
        interval = INTERVAL if values["interval"] is None else values["interval"]
        which = NAMES[name.lower()]
        options = {"interval": interval}
        action = None if values["chance"] else values["action"]
        if agent is not None:
            for option, words in OPTIONS.items():
                if is_option_set(option):
                    raise BadInput(
                        f"--{words} does not go with --agent: the agent acts, in the environment that it was trained in"
                    )
            action = load_agent(agent)
            which = action.env_id
            options = dict(action.arguments)
        options |= {} if values["force"] is None else {"force": values["force"]}
        pictures, fps = episode(which, mode, options, values["seed"], action, values["frames"])
    if target is not None:
        save(target, pictures, fps)
        click.echo(
            f"written: {target}, {len(pictures)} frames, {target.stat().st_size / 1e6:.1f} MB"
        )
