"""An episode of an environment as a film."""

# needs: env

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from optimisation.cli.common import BadInput, check_target, command, plain_errors
from optimisation.cli.options import OptionSpec, at_least, file_spec, number, option, switch
from optimisation.cli.scene_options import is_option_set
from optimisation.rl.agents import load_agent
from optimisation.rl.demonstrations import INTERVAL, NAMES, episode, save

OF_AGENT = ("env", "action", "random", "interval")  # what a trained agent brings


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """Options of ``rl render``; None: not given."""

    env: str = option(
        OptionSpec(
            names=("--env",),
            help="Environment",
            more=f"{', '.join(sorted(NAMES))}.",
            type=click.Choice(sorted(NAMES), case_sensitive=False),
            metavar="NAME",
            default="sweeprate",
            usual=True,
        )
    )
    gif: Path | None = option(file_spec("--gif", "Write the film instead of a window", usual=True))
    action: float = option(
        OptionSpec(
            names=("--action",),
            help="Action in every interval",
            allowed="-1 to 1",
            type=click.FloatRange(-1, 1),
            metavar="NUMBER",
            default=1.0,
            usual=True,
        )
    )
    random: bool = option(switch("--random", "A random action in every interval", usual=True))
    agent: Path | None = option(
        file_spec(
            "--agent",
            "A trained agent acts, in its own environment",
            usual=True,
            section="Computation",
        )
    )
    interval: float | None = option(
        number(
            "--interval",
            "Pseudo periods from frame to frame",
            default_text=f"{INTERVAL}, an agent's: as it was trained",
        )
    )
    force: float | None = option("force", default_text="the environment's", usual=False)
    seed: int = option("seed", usual=True)
    frames: int = option(
        number(
            "--frames",
            "Largest number of frames",
            type=at_least(2),
            default=400,
            section="Output",
        )
    )


@command(
    RenderOptions,
    examples=("rl render --frames 40 --gif film.gif", "rl render --env sweeprate --random"),
)
def main(options: RenderOptions) -> None:
    """Run one episode and show it in a window, or write it as an animated GIF.

    By default the machine runs down through the resonance at the fastest rate of the task.
    """
    target = options.gif
    check_target("--gif", target, (".gif",))
    mode = "human" if target is None else "rgb_array"
    with plain_errors():
        arguments: dict[str, Any] = {
            "interval": INTERVAL if options.interval is None else options.interval
        }
        which = NAMES[options.env.lower()]
        action: Any = None if options.random else options.action
        if options.agent is not None:
            for name in OF_AGENT:
                if is_option_set(name):
                    raise BadInput(
                        f"--{name} does not go with --agent: the agent acts, in the "
                        "environment that it was trained in"
                    )
            action = load_agent(options.agent)
            which = action.env_id
            arguments = dict(action.arguments)
        if options.force is not None:
            arguments["force"] = options.force
        pictures, fps = episode(which, mode, arguments, options.seed, action, options.frames)
    if target is not None:
        save(target, pictures, fps)
        click.echo(
            f"written: {target}, {len(pictures)} frames, {target.stat().st_size / 1e6:.1f} MB"
        )
