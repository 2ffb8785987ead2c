"""Episodes as an offline data set in the format of Minari, and as films.

Other libraries read the format (https://minari.farama.org) as well.

A data set is a folder with Minari's HDF5 file: for each episode ``observations`` (T + 1, features)
float32, ``actions`` (T, A) float32, ``rewards`` (T,) float64, ``terminations`` and ``truncations``
(T,) bool, and the seed; scores are the sums of the rewards.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from numpy.typing import NDArray
from PIL import Image

import impact_env  # noqa: F401 - registers the environments
from impact_env.checks import ParameterError, require
from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional
from optimisation.executors import Bar
from optimisation.files import replacing
from optimisation.rl.agents import Agent

PLACE = "MINARI_DATASETS_PATH"  # where Minari looks for data sets
HDF5 = Path("data") / "main_data.hdf5"


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """Recorded episodes.

    Each has ``observations`` (T + 1, features), ``actions`` (T, A) and ``rewards`` (T,), and
    whether it terminated (or else was truncated).
    """

    env_id: str
    seeds: tuple[int, ...]
    observations: Sequence[NDArray[np.float32]]
    actions: Sequence[NDArray[np.float32]]
    rewards: Sequence[NDArray[np.float64]]
    terminated: Sequence[bool]


def record(
    policy: Any, env_id: str, seeds: Sequence[int], arguments: Mapping[str, Any] | None = None
) -> Demonstrations:
    """Play one episode for each seed and return observations, actions and rewards.

    ``policy``: an object with ``start`` and ``act``.
    """
    lanes = len(seeds)
    with optional():
        import gymnasium
    env: Any = gymnasium.make_vec(
        env_id, num_envs=lanes, vectorization_mode="vector_entry_point", **(arguments or {})
    )
    rows: list[tuple[list[Any], list[Any], list[float]]] = [([], [], []) for _ in seeds]
    going = np.ones(lanes, dtype=np.bool_)
    ended = np.zeros(lanes, dtype=np.bool_)
    try:
        policy.start(lanes)
        observed, _ = env.reset(seed=list(seeds))
        for lane, row in enumerate(observed):
            rows[lane][0].append(row.copy())
        while going.any():
            actions = policy.act(observed)
            observed, rewards, terminated, truncated, info = env.step(actions)
            for lane in np.flatnonzero(going).tolist():
                over = terminated[lane] or truncated[lane]
                rows[lane][0].append((info["final_obs"][lane] if over else observed[lane]).copy())
                rows[lane][1].append(actions[lane].copy())
                rows[lane][2].append(float(rewards[lane]))
            ended |= going & terminated
            going &= ~(terminated | truncated)
            env.unwrapped.rest(~going)
    finally:
        env.close()
    observations, done, earned = ([np.array(row[part]) for row in rows] for part in range(3))
    return Demonstrations(
        env_id, tuple(int(seed) for seed in seeds), observations, done, earned, ended.tolist()
    )


@contextmanager
def _minari(root: Path) -> Iterator[Any]:
    """Give Minari with data sets under a folder."""
    with optional():
        import h5py  # noqa: F401 - the format's own package
        import minari
    before = os.environ.get(PLACE)
    os.environ[PLACE] = str(
        root.resolve()
    )  # the format links a data set to its files by their whole paths
    try:
        yield minari
    finally:
        if before is None:
            del os.environ[PLACE]
        else:
            os.environ[PLACE] = before


def write_demonstrations(
    folder: Path,
    demonstrations: Demonstrations,
    author: str,
    arguments: Mapping[str, Any] | None = None,
) -> None:
    """Write a data set.

    The folder is written completely or not at all, and replaces a data set of the same name. Raises
    ParameterError for an existing folder of another kind.
    """
    replaceable = not folder.exists() or (folder / HDF5).is_file()
    require(replaceable, "folder", str(folder), "a new one, or a data set that is to be replaced")
    require(
        "/" not in folder.name and folder.name.endswith("-v0"),
        "folder",
        str(folder),
        "a data set's name, which ends in -v0",
    )
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as place, _minari(Path(place)) as minari:
        from minari.data_collector import EpisodeBuffer

        with optional():
            import gymnasium
        env = gymnasium.make(demonstrations.env_id, **(arguments or {}))
        episodes = []
        for k, seed in enumerate(demonstrations.seeds):
            last = np.arange(len(demonstrations.actions[k])) == len(demonstrations.actions[k]) - 1
            over = demonstrations.terminated[k]
            own = {
                name: getattr(demonstrations, name)[k]
                for name in ("observations", "actions", "rewards")
            }
            episodes.append(
                EpisodeBuffer(
                    id=k, seed=seed, terminations=last & over, truncations=last & (not over), **own
                )
            )
        words = (
            f"{author} on {demonstrations.env_id}, one episode for each of the seeds "
            f"{demonstrations.seeds[0]} to {demonstrations.seeds[-1]}"
        )
        with (
            warnings.catch_warnings()
        ):  # it asks for an address and a link, which a reader's own data set has none of
            warnings.simplefilter("ignore", UserWarning)
            minari.create_dataset_from_buffers(
                folder.name,
                episodes,
                env=env,
                algorithm_name=author,
                author="scripted",
                description=words,
            )
        env.close()
        if folder.exists():
            shutil.rmtree(folder)
        (Path(place) / folder.name).rename(folder)


def read_demonstrations(folder: Path, env_id: str) -> Demonstrations:
    """Return the episodes of a data set.

    Raises ParameterError if there is none, or if it belongs to another environment.
    """
    require(
        (folder / HDF5).is_file(),
        "demonstrations",
        str(folder),
        "a folder that record_demonstrations has written",
    )
    try:
        with _minari(folder.parent) as minari:
            data = minari.load_dataset(folder.name)
            recorded_env = data.spec.env_spec.id
            episodes = list(data.iterate_episodes())
            seeds = tuple(
                int(row["seed"]) for row in data.storage.get_episode_metadata(range(len(episodes)))
            )
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise ParameterError(
            f"demonstrations = {str(folder)!r} is not allowed: a whole data set ({error})"
        ) from error
    require(
        recorded_env == env_id,
        "demonstrations",
        str(folder),
        f"a data set of {env_id}, not of {recorded_env}",
    )
    observations, actions, rewards = (
        [np.asarray(getattr(e, name)) for e in episodes]
        for name in ("observations", "actions", "rewards")
    )
    return Demonstrations(
        env_id,
        seeds,
        observations,
        actions,
        rewards,
        [bool(episode.terminations[-1]) for episode in episodes],
    )


def dataset_hash(demonstrations: Demonstrations) -> str:
    """Return a data set's identity: the SHA-256 of its observations and actions."""
    digest = hashlib.sha256(repr((demonstrations.env_id, demonstrations.seeds)).encode())
    for values in (*demonstrations.observations, *demonstrations.actions):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


if TYPE_CHECKING:
    import gymnasium

NAMES = {name.split("/")[1].split("-")[0].lower(): name for name in ENVIRONMENTS}
# pseudo periods: frames show a slow motion, as under a stroboscope that is a little slower than the
# machine
INTERVAL = 2.0625
COLOURS = 48


def action_of(env: gymnasium.Env[Any, Any], observation: Any, action: float | Agent | None) -> Any:
    """Return the constant action, an agent's, or a random one."""
    if action is None:
        return env.action_space.sample()
    if isinstance(action, Agent):
        return action.act(np.asarray(observation)[None])[0]
    return 0 if env.action_space.shape == () else np.array([action], dtype=np.float32)


def episode(
    name: str,
    mode: str,
    options: Mapping[str, Any],
    seed: int,
    action: float | Agent | None,
    most: int,
) -> tuple[list[np.ndarray], int]:
    """Return the frames of an episode of an environment, and their number in a second.

    ``action`` None: a random action in each step.
    """
    with optional():
        import gymnasium
    env = gymnasium.make(name, render_mode=mode, **options)
    try:
        return film(env, seed, action, most), int(env.metadata["render_fps"])
    finally:
        env.close()


def film(
    env: gymnasium.Env[Any, Any], seed: int, action: float | Agent | None, most: int
) -> list[np.ndarray]:
    """Return the frames of an episode, at most ``most``; Ctrl-C ends it early."""
    observation, _ = env.reset(seed=seed)
    if isinstance(action, Agent):
        action.start(1)
    env.action_space.seed(seed)
    frames = [env.render()]
    over = False
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
    """Write an animated GIF with one palette for all frames.

    The palette is that of the last frame, which has all colours.
    """
    palette = Image.fromarray(frames[-1]).quantize(COLOURS)
    pictures = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    # a GIF counts in hundredths of a second, and viewers slow down below two of them
    times = [max(20, 10 * round(100 / fps))] * (len(frames) - 1) + [1500]
    with replacing(path) as temporary:
        pictures[0].save(
            temporary,
            save_all=True,
            append_images=pictures[1:],
            duration=times,
            loop=0,
            optimize=True,
        )
