"""Films of episodes: the frames of one, and an animated GIF of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from PIL import Image

from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional
from optimisation.files import replacing
from optimisation.progress import Bar
from optimisation.rl.agents import Agent

if TYPE_CHECKING:
    import gymnasium

NAMES = {name.split("/")[1].split("-")[0].lower(): name for name in ENVIRONMENTS}
INTERVAL = 2.0625  # pseudo periods: frames show a slow motion, as under a stroboscope that is a little slower than the machine
COLOURS = 48


def action_of(env: gymnasium.Env[Any, Any], observation: Any, action: float | Agent | None) -> Any:
    """Return the constant action, an agent's, or a random one."""
    if action is None:
        return env.action_space.sample()
    if isinstance(action, Agent):
        return action.act(np.asarray(observation)[None])[0]
    return 0 if env.action_space.shape == () else np.array([action], dtype=np.float32)


def episode(name: str, mode: str, options: Mapping[str, Any], seed: int, action: float | Agent | None, most: int) -> tuple[list[np.ndarray], int]:
    """Return the frames of an episode of an environment, and how many of them are shown in a second; ``action`` None: a random one each time."""
    with optional():
        import gymnasium
    env = gymnasium.make(name, render_mode=mode, **options)
    try:
        return film(env, seed, action, most), int(env.metadata["render_fps"])
    finally:
        env.close()


def film(env: gymnasium.Env[Any, Any], seed: int, action: float | Agent | None, most: int) -> list[np.ndarray]:
    """Return the frames of an episode, at most ``most``; Ctrl-C ends it early."""
    observation, _ = env.reset(seed=seed)
    if isinstance(action, Agent):
        action.start(1)
    env.action_space.seed(seed)
    frames, over = [env.render()], False
    with Bar(total=most, desc="drawing", unit="frame", leave=False) as bar:
        try:
            while not over and len(frames) < most:
                observation, _, end, cut, _ = env.step(action_of(env, observation, action))
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
