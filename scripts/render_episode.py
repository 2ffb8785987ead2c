"""An episode of an environment as a film: the bent beam, the absorber in its cavity, level and frequency."""

# needs: env, rl

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from optimisation.command_line import check_target, plain_errors
from optimisation.rl.films import INTERVAL, NAMES, episode, save


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--env", "name", type=click.Choice(sorted(NAMES), case_sensitive=False), default="sweeprate", show_default=True)
@click.option("--gif", "target", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the film instead of showing it.")
@click.option("--action", type=click.FloatRange(-1, 1), default=1.0, show_default=True, help="What is done in every interval.")
@click.option("--random", "chance", is_flag=True, help="Do something random in every interval instead.")
@click.option("--interval", type=float, default=INTERVAL, show_default=True, help="Pseudo periods from frame to frame.")
@click.option("--force", type=float, help="Force in N.  [default: the environment's]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--frames", type=click.IntRange(min=2), default=400, show_default=True, help="Largest number of frames.")
def main(name: str, target: Path | None, action: float, chance: bool, interval: float, force: float | None, seed: int, frames: int) -> None:
    """Run one episode and show it in a window, or write it as an animated GIF.

    By default the machine runs down through the resonance at the fastest rate of the task.
    """
    check_target("--gif", target, (".gif",))
    mode = "human" if target is None else "rgb_array"
    options: dict[str, Any] = {"interval": interval} | ({} if force is None else {"force": force})
    with plain_errors():
        pictures, fps = episode(name, mode, options, seed, None if chance else action, frames)
    if target is not None:
        save(target, pictures, fps)
        click.echo(f"written: {target}, {len(pictures)} frames, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(prog_name="scripts/run render_episode")
