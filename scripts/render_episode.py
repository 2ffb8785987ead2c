"""An episode of an environment as a film: the bent beam, the absorber in its cavity, level and frequency."""

# needs: env, rl

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional
from optimisation.command_line import check_target, plain_errors
from optimisation.files import replacing

with optional():
    import gymnasium
    from PIL import Image

NAMES = {name.split("/")[1].split("-")[0].lower(): name for name in ENVIRONMENTS}
INTERVAL = 2.0625  # pseudo periods: frames show a slow motion, as under a stroboscope that is a little slower than the machine
COLOURS = 48


def action_of(env: gymnasium.Env[Any, Any], action: float | None) -> Any:
    """Return the constant action, or a random one."""
    if action is None:
        return env.action_space.sample()
    return np.array([action], dtype=np.float32) if isinstance(env.action_space, gymnasium.spaces.Box) else 0


def film(env: gymnasium.Env[Any, Any], seed: int, action: float | None, most: int) -> list[np.ndarray]:
    """Return the frames of an episode, at most ``most``; Ctrl-C ends it early."""
    env.reset(seed=seed)
    env.action_space.seed(seed)
    frames, over = [env.render()], False
    with tqdm(total=most, desc="drawing", unit="frame", leave=False, disable=None) as bar:
        try:
            while not over and len(frames) < most:
                _, _, end, cut, _ = env.step(action_of(env, action))
                frames.append(env.render())
                over = end or cut
                bar.update()
        except KeyboardInterrupt:
            click.echo("Stopped early.", err=True)
    return [frame for frame in frames if isinstance(frame, np.ndarray)]


def save(path: Path, frames: list[np.ndarray], fps: int) -> None:
    """Write an animated GIF with one palette for all frames: the last frame's, which has all colours."""
    palette = Image.fromarray(frames[-1]).quantize(COLOURS)
    pictures = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    # a GIF counts in hundredths of a second, and viewers slow down below two of them
    times = [max(20, 10 * round(100 / fps))] * (len(frames) - 1) + [1500]
    with replacing(path) as temporary:
        pictures[0].save(temporary, save_all=True, append_images=pictures[1:], duration=times, loop=0, optimize=True)


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
        env = gymnasium.make(NAMES[name], render_mode=mode, **options)
        pictures = film(env, seed, None if chance else action, frames)
        fps = env.metadata["render_fps"]
        env.close()
    if target is not None:
        save(target, pictures, fps)
        click.echo(f"written: {target}, {len(pictures)} frames, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(prog_name="scripts/run render_episode")
