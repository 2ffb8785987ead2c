"""The interface of a task to gymnasium, shared by single and vector environments.

A single environment is a vector of one lane without autoreset.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from inspect import cleandoc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, count, require
from impact_env.envs.arguments import list_own_arguments
from impact_env.envs.observation import FEATURE_LIMIT, FEW_IMPACTS, Feature
from impact_env.envs.settings import SCENE_PARTS
from impact_env.envs.task import FREQUENCY_SCALE, Task
from impact_env.extras import optional
from impact_env.kernels.control.episodes import limit_actions

with optional():
    import gymnasium
    from gymnasium import spaces
    from gymnasium.error import ResetNeeded

RENDER_MODES = ("rgb_array", "human")
METADATA: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 30}
Info = dict[str, Any]
Observation = NDArray[np.float32]


@dataclass(frozen=True)
class TaskSpec:
    """Definition of an environment's task.

    Attributes
    ----------
    compose : callable
        Returns a `Task` composed for an object of each of ``groups`` and the number of lanes.
    groups : tuple of type
        Dataclasses of the arguments.
    defaults : mapping
        Defaults of arguments that differ from those of the dataclasses.
    columns : sequence of Feature
        Columns of observations with these defaults.
    numbers : int
        Number of values in an action, 0 for a single discrete action.
    frequency_unit : float
        Unit of the observed frequency in a task without an argument of this name.
    """

    compose: Callable[..., Task]
    groups: tuple[type, ...]
    defaults: Mapping[str, Any]
    columns: Sequence[Feature]
    numbers: int = 1
    frequency_unit: float = FREQUENCY_SCALE

    def action_space(self) -> spaces.Space[Any]:
        """Return the space of one lane's actions: numbers from -1 to 1."""
        if self.numbers == 0:
            return spaces.Discrete(1)
        return spaces.Box(-1.0, 1.0, (self.numbers,), np.float32)

    def make(self, lanes: int, arguments: Mapping[str, Any]) -> Task:
        """Return the task with these keyword arguments; raise ParameterError for a bad one."""
        left_out = (
            SCENE_PARTS if arguments.get("whole_scene") is not None else ()
        )  # what describes a scene does not apply beside a whole one
        defaults = {name: value for name, value in self.defaults.items() if name not in left_out}
        merged = defaults | dict(arguments)
        names = [{field.name for field in fields(group)} for group in self.groups]
        strange = sorted(set(merged).difference(*names))
        if strange:
            raise ParameterError(
                f"{strange[0]} is not an argument of this environment: it has "
                f"{', '.join(sorted(set().union(*names)))}"
            )
        parts = [{name: value for name, value in merged.items() if name in own} for own in names]
        return self.compose(
            *(group(**part) for group, part in zip(self.groups, parts, strict=True)), lanes
        )


def observation_space(task: Task) -> spaces.Box:
    """Return the space of one lane's observations."""
    return spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (len(task.features),), np.float32)


def reward_space(task: Task, wanted: bool) -> spaces.Box | None:
    """Return the space of vector rewards in the form of MO-Gymnasium.

    The result is None if rewards are scores.
    """
    require(isinstance(wanted, bool), "vector_reward", wanted, "True or False")
    require(
        not wanted or bool(task.reward.cost_names),
        "vector_reward",
        wanted,
        "False in a task without a vector of costs",
    )
    return (
        spaces.Box(-np.inf, 0.0 - task.reward.least_cost, task.reward.costs.shape[1:], np.float64)
        if wanted
        else None
    )


def costs_as_rewards(task: Task, resting: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    """Return minus the costs of the last interval (L, costs), 0 for ``resting`` lanes."""
    return np.where(False if resting is None else resting[:, None], 0.0, -task.reward.costs)


def check_actions(space: spaces.Space[Any], actions: Any) -> NDArray[Any]:
    """Return actions as an array of the space's shape.

    Real numbers become float64 and are limited to [-1, 1], the range of these spaces.

    Raises ParameterError for a wrong shape, for NaN, infinity and complex numbers, and for a
    discrete action that does not exist.
    """
    try:
        values = np.asarray(actions)
    except ValueError:
        values = np.empty(0, dtype=object)
    if values.dtype.kind not in "iuf" or values.shape != space.shape:
        require(False, "action", actions, f"real numbers of shape {space.shape}")
    if isinstance(space, spaces.Box):
        limited = np.array(values, dtype=np.float64, order="C")
        finite = limit_actions(limited.reshape(-1))  # type: ignore[no-untyped-call]
        require(finite, "action", actions, "finite numbers")
        return limited
    assert isinstance(space, spaces.Discrete | spaces.MultiDiscrete)
    whole = values.dtype.kind in "iu"
    if isinstance(space, spaces.Discrete):
        exists = whole and space.start <= int(values) < space.start + space.n
    else:
        exists = whole and bool(
            ((values >= space.start) & (values < space.start + space.nvec)).all()
        )
    if not exists:  # to write down a large space takes longer than to check it
        require(False, "action", actions, f"in {space}")
    return values


def check_render_mode(mode: str | None) -> None:
    """Raise ParameterError unless a render mode is known."""
    require(
        mode is None or mode in RENDER_MODES,
        "render_mode",
        mode,
        f"None or one of {', '.join(RENDER_MODES)}",
    )


def check_options(options: dict[str, Any] | None, allowed: Sequence[str] = ()) -> dict[str, Any]:
    """Return the options of a reset; raise ParameterError for unknown ones."""
    strange = sorted(set(options or {}) - set(allowed))
    require(
        not strange, "options", options, f"only {', '.join(allowed)}" if allowed else "no options"
    )
    return dict(options or {})


def check_seed(seed: Any) -> int | None:
    """Return a seed as Python's int, or None."""
    return None if seed is None else count("seed", seed, 0)


def make_screen(env: Any, is_reset: bool, maker: str) -> Any:
    """Return an environment's screen; it is created for the first image.

    Without a render mode a warning is issued and the result is None. ``maker`` is the name of
    gymnasium's function in the warning.
    """
    if env.render_mode is None:
        gymnasium.logger.warn(
            f"render() does nothing without a render_mode: give one to gymnasium.{maker}"
        )
        return None
    if not is_reset:
        raise ResetNeeded("call reset() before render()")
    from impact_env.envs.drawing import Screen

    if env._screen is None:
        env._screen = Screen(env.task, env.render_mode == "human", env.metadata["render_fps"])
    return env._screen


def list_features(kind: TaskSpec) -> list[tuple[str, str]]:
    """Return (description, unit) of each feature of a task, with default arguments."""
    values = {field.name: field.default for group in kind.groups for field in fields(group)}
    values |= kind.defaults
    from_middle = values.get("frequency_origin") == "middle"
    limited = values["impacts_limit"] == FEW_IMPACTS
    words = {
        "few": f", clipped at {FEW_IMPACTS:g}" if limited else "",
        "origin": "the middle of ``limits``" if from_middle else "1",
        "scale": "``frequency_unit``" if from_middle else kind.frequency_unit,
        "level": "half-clearance of the scene"
        if values.get("level_unit") == "gap"
        else "reference level",
    }
    return [
        (feature.what.format(**words), feature.unit.format(**words)) for feature in kind.columns
    ]


def add_tables(env: Any) -> None:
    """Insert the tables into the docstring of an environment.

    "(features)" is replaced by a table, "(arguments)" by a list.
    """
    kind: TaskSpec = env.kind
    rows = [f"| {k} | {what} | {unit} |" for k, (what, unit) in enumerate(list_features(kind), 1)]
    table = "\n".join(("| # | what | unit and scale |", "| --- | --- | --- |", *rows))
    own, other = list_own_arguments(kind.groups, kind.defaults)
    lines = [f"- ``{one.name}`` (default {one.default}): {one.meaning}" for one in own]
    lines += [f"- ``{one.name}`` (here {one.default})" for one in other]
    lines.append(
        "- those of all environments: `impact_env.envs.settings.TaskSettings`, "
        "``render_mode``, ``vector_reward``"
    )
    text = cleandoc(env.__doc__ or "")
    env.__doc__ = text.replace("(features)", table).replace("(arguments)", "\n".join(lines))


class TaskEnv(gymnasium.Env[Observation, Any]):
    """Single environment of a task, which ``kind`` creates with one lane from the ``arguments``."""

    metadata: dict[str, Any] = METADATA
    kind: TaskSpec

    def __init__(
        self, render_mode: str | None = None, *, vector_reward: bool = False, **arguments: Any
    ) -> None:
        check_render_mode(render_mode)
        self.task = self.kind.make(1, arguments)
        self.render_mode = render_mode
        self.reward_space = reward_space(self.task, vector_reward)
        self.action_space = self.kind.action_space()
        self.observation_space = observation_space(self.task)  # type: ignore[assignment]
        self._over: bool | None = None
        self._screen: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Start an episode at rest and return its first observation and info.

        ``options`` may set quantities that would be drawn, by the names in the task's ``options``.
        """
        chosen = check_options(options, tuple(self.task.options))
        super().reset(seed=check_seed(seed))
        observation = self.task.reset(np.ones(1, dtype=np.bool_), [self.np_random], chosen)[0]
        self._over = False
        if self.render_mode == "human":
            self.render()
        return observation, self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Info]:
        """Advance by one control interval.

        Returns observation, reward, terminated, truncated and info, as in gymnasium.
        """
        if self._over is not False:
            raise ResetNeeded(
                "the episode is over: call reset() before step()"
                if self._over
                else "call reset() before step()"
            )
        rewards, ends, cuts = self.task.step(check_actions(self.action_space, action)[None])
        observation = self.task.observe([self.np_random])[0]
        terminated = ends.item()
        truncated = cuts.item()
        self._over = terminated or truncated
        if self.render_mode == "human":
            self.render()
        reward: Any = (
            rewards.item() if self.reward_space is None else costs_as_rewards(self.task, None)[0]
        )
        return observation, reward, terminated, truncated, self._info()

    def _info(self) -> Info:
        return {
            name: values.item() if values.ndim == 1 else values[0]
            for name, values in self.task.info().items()
        }

    def render(self) -> NDArray[np.uint8] | None:
        """Return an image (height, width, 3), or show it in a window."""
        screen = make_screen(self, self._over is not None, "make")
        if screen is None:
            return None
        image: NDArray[np.uint8] | None = screen.show(0)
        return image

    def close(self) -> None:
        """Close the window and end the threads."""
        if self._screen is not None:
            self._screen.close()
            self._screen = None
        self.task.close()
