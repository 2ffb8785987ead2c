"""What gymnasium asks for around a task: the single environment is a vector of one lane without autoreset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.observation import LIMIT
from impact_env.envs.task import Task
from impact_env.extras import optional
from impact_env.parameters import ParameterError, count, require

with optional():
    import gymnasium
    from gymnasium import spaces
    from gymnasium.error import ResetNeeded
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

RENDER_MODES = ("rgb_array", "human")
METADATA: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 30}
Info = dict[str, Any]
Observation = NDArray[np.float32]


def observation_space(task: Task) -> spaces.Box:
    """Return the space of one lane's observations."""
    return spaces.Box(-LIMIT, LIMIT, (len(task.features),), np.float32)


def choice() -> spaces.Box:
    """Return the action space of one number from -1 to 1."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


def checked_actions(space: spaces.Space[Any], actions: Any) -> NDArray[Any]:
    """Return actions as an array of the space's shape; numbers are cut to the space's limits, but must be numbers.

    Raises ParameterError for a wrong shape, for NaN and infinity, and for a discrete action that does not exist.
    """
    try:
        values = np.asarray(actions)
        numeric = np.issubdtype(values.dtype, np.number)
    except ValueError:
        values, numeric = np.empty(0), False
    require(numeric and values.shape == space.shape, "action", actions, f"numbers of shape {space.shape}")
    if isinstance(space, spaces.Box):
        require(bool(np.all(np.isfinite(values))), "action", actions, "finite numbers")
        return np.clip(values, space.low, space.high)
    if not (np.issubdtype(values.dtype, np.integer) and space.contains(values.astype(space.dtype))):
        require(False, "action", actions, f"in {space}")  # to write down a large space takes longer than to check it
    return values


def check_render_mode(mode: str | None) -> None:
    """Raise ParameterError unless a render mode is known."""
    require(mode is None or mode in RENDER_MODES, "render_mode", mode, f"None or one of {', '.join(RENDER_MODES)}")


def check_options(options: dict[str, Any] | None, allowed: Sequence[str] = ()) -> dict[str, Any]:
    """Return the options of a reset; raise ParameterError for unknown ones."""
    strange = sorted(set(options or {}) - set(allowed))
    require(not strange, "options", options, f"only {', '.join(allowed)}" if allowed else "no options")
    return dict(options or {})


class TaskEnv(gymnasium.Env[Observation, Any]):
    """A single environment around a task of one lane."""

    metadata: dict[str, Any] = METADATA

    def __init__(self, task: Task, action_space: spaces.Space[Any], render_mode: str | None) -> None:
        check_render_mode(render_mode)
        self.task, self.render_mode = task, render_mode
        self.action_space = action_space
        self.observation_space = observation_space(task)  # type: ignore[assignment]
        self._over: bool | None = None
        self._screen: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Start an episode at rest; there are no options."""
        check_options(options)
        super().reset(seed=seed)
        observation = self.task.reset(np.ones(1, dtype=np.bool_), [self.np_random])[0]
        self._over = False
        if self.render_mode == "human":
            self.render()
        return observation, self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Advance by one control interval."""
        if self._over is not False:
            raise ResetNeeded("the episode is over: call reset() before step()" if self._over else "call reset() before step()")
        rewards, terminated, truncated = self.task.step(checked_actions(self.action_space, action)[None])
        observation = self.task.observe([self.np_random])[0]
        self._over = bool(terminated[0] or truncated[0])
        if self.render_mode == "human":
            self.render()
        return observation, float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self._info()

    def _info(self) -> Info:
        return {name: values[0].item() if values.ndim == 1 else values[0].copy() for name, values in self.task.info().items()}

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image (height, width, 3), or show it in a window."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without a render_mode: give one to gymnasium.make")
            return None
        if self._over is None:
            raise ResetNeeded("call reset() before render()")
        from impact_env.envs.drawing import Screen

        if self._screen is None:
            self._screen = Screen(self.task, self.render_mode == "human", self.metadata["render_fps"])
        image: NDArray[np.uint8] | None = self._screen.show(0)
        return image

    def close(self) -> None:
        """Close the window and end the threads."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None
        self.task.close()


class TaskVectorEnv(VectorEnv[Observation, Any, NDArray[Any]]):
    """All lanes of a task in one call, with autoreset in the same step; lane i is the single environment with seed + i."""

    metadata: dict[str, Any] = {**METADATA, "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 - as gymnasium declares it

    def __init__(self, task: Task, action_space: spaces.Space[Any], render_mode: str | None) -> None:
        check_render_mode(render_mode)
        self.task, self.render_mode, self.num_envs = task, render_mode, task.lanes
        self.single_action_space, self.single_observation_space = action_space, observation_space(task)
        self.action_space = batch_space(action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._observations: Observation | None = None
        self._screen: Any = None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The lanes' random generators."""
        self._seed([None] * self.num_envs, np.ones(self.num_envs, dtype=np.bool_))
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The lanes' seeds."""
        self._seed([None] * self.num_envs, np.ones(self.num_envs, dtype=np.bool_))
        return tuple(self._seeds)

    def _seed(self, seeds: Sequence[int | None], which: NDArray[np.bool_]) -> None:
        """Give lanes of a mask new generators where a seed is given, and all lanes one if they have none yet."""
        if not self._generators:
            made = [seeding.np_random(seed if wanted else None) for seed, wanted in zip(seeds, which, strict=True)]
            self._generators, self._seeds = [m[0] for m in made], [m[1] for m in made]
            return
        for lane in np.flatnonzero(which).tolist():
            if seeds[lane] is not None:
                self._generators[lane], self._seeds[lane] = seeding.np_random(seeds[lane])

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Start episodes at rest, in all lanes or in those of ``options["reset_mask"]`` (num_envs,), bool.

        ``seed``: a number from which lane i gets seed + i, or one seed (or None) for each lane.
        """
        mask = check_options(options, ("reset_mask",)).get("reset_mask")
        which = np.ones(self.num_envs, dtype=np.bool_) if mask is None else self._checked_mask(mask)
        self._seed(self._lane_seeds(seed), which)
        observations = self.task.reset(which, self._generators)
        if self._observations is not None:
            observations[~which] = self._observations[~which]
        self._observations = observations
        return observations.copy(), self._masked(self.task.info(), which)

    def _lane_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        require(len(seed) == self.num_envs, "seed", seed, f"a number, or a list of {self.num_envs}")
        return [None if value is None else int(value) for value in seed]

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        ok = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,) and bool(mask.any())
        require(ok, "reset_mask", mask, f"a bool array of shape ({self.num_envs},) with at least one True")
        if self._observations is None and not mask.all():
            raise ResetNeeded("the first reset() must be one of all lanes: leave reset_mask out")
        return np.asarray(mask)

    def step(self, actions: Any) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], Info]:
        """Advance all lanes by one control interval and start those that ended again; their last observation and info are in ``final_obs``,
        ``final_info`` of info, with the mask ``_final_obs``, ``_final_info``.
        """  # noqa: D205
        if self._observations is None:
            raise ResetNeeded("call reset() before step()")
        rewards, terminated, truncated = self.task.step(checked_actions(self.action_space, actions))
        observations = self.task.observe(self._generators)
        info = self.task.info()
        over = terminated | truncated
        final: Info = {}
        if over.any():
            final = self._final(observations, info, over)
            observations = np.where(over[:, None], self.task.reset(over, self._generators), observations)
            info = self.task.info()
        self._observations = observations
        return observations.copy(), rewards, terminated, truncated, {**final, **self._masked(info, np.ones(self.num_envs, dtype=np.bool_))}

    def _final(self, observations: Observation, info: Info, over: NDArray[np.bool_]) -> Info:
        last = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(over).tolist():
            last[lane] = observations[lane].copy()
        return {"final_obs": last, "_final_obs": over.copy(), "final_info": self._masked(info, over), "_final_info": over.copy()}

    def _masked(self, info: Info, which: NDArray[np.bool_]) -> Info:
        """Return info with its masks, zeros where it does not apply, as gymnasium's own vectors have it."""
        masked: Info = {}
        for name, values in info.items():
            if not which.all():
                values[~which] = 0
            masked[name], masked[f"_{name}"] = values, which.copy()
        return masked

    def snapshot(self) -> dict[str, Any]:
        """Return all that the next steps depend on, for `restore`: plain values and arrays, which can be pickled."""
        if self._observations is None:
            raise ResetNeeded("call reset() before snapshot()")
        generators = [generator.bit_generator.state for generator in self._generators]
        return {"task": self.task.snapshot(), "generators": generators, "seeds": list(self._seeds), "observations": self._observations.copy()}

    def restore(self, snapshot: dict[str, Any]) -> Observation:
        """Go on from the snapshot of an environment with the same arguments, bit for bit; return the observations (num_envs, features)."""
        require(len(snapshot["seeds"]) == self.num_envs, "lanes of the snapshot", len(snapshot["seeds"]), f"num_envs = {self.num_envs}")
        self._seed(snapshot["seeds"], np.ones(self.num_envs, dtype=np.bool_))
        for generator, state in zip(self._generators, snapshot["generators"], strict=True):
            generator.bit_generator.state = state
        self.task.restore(snapshot["task"])
        self._observations = snapshot["observations"].copy()
        return self._observations.copy()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return an image of each lane."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() does nothing without a render_mode: give one to gymnasium.make_vec")
            return None
        if self._observations is None:
            raise ResetNeeded("call reset() before render()")
        from impact_env.envs.drawing import Screen

        if self._screen is None:
            self._screen = Screen(self.task, self.render_mode == "human", self.metadata["render_fps"])
        if self.render_mode == "human":
            self._screen.show(0)
            return None
        return tuple(self._screen.show(lane) for lane in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002 - gymnasium passes on what close() was given
        """Close the window and end the threads."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None
        self.task.close()


def lanes_of(num_envs: int) -> int:
    """Return the number of lanes; raises ParameterError unless it is 1 or more."""
    return count("num_envs", num_envs, 1)


def split(arguments: dict[str, Any], *groups: type) -> list[dict[str, Any]]:
    """Return keyword arguments as one dict for each dataclass that has them; raise ParameterError for one that none has."""
    names = [tuple(getattr(group, "__dataclass_fields__")) for group in groups]  # noqa: B009
    strange = sorted(set(arguments) - {name for group in names for name in group})
    if strange:
        raise ParameterError(f"{strange[0]} is not an argument of this environment: it has {', '.join(sorted({n for g in names for n in g}))}")
    return [{name: value for name, value in arguments.items() if name in group} for group in names]
