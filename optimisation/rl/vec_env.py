"""stable-baselines3 with a native vector environment.

There are no processes and no loop over environments. Each step is one kernel call.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.extras import optional

with optional():
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv

Info = dict[str, Any]


def lane_info(infos: Info, lane: int) -> Info:
    """Return one lane's info from a vector's, with Python numbers.

    Values that the mask excludes are left out.
    """
    return {
        name: values[lane].item() if isinstance(values[lane], np.generic) else values[lane]
        for name, values in infos.items()
        if not name.startswith("_") and infos[f"_{name}"][lane]
    }


class NativeVecEnv(VecEnv):
    """A `VecEnv` around a vector environment with autoreset in the same step.

    Put `VecMonitor` around it for episode statistics. Info is given only at the end of an episode,
    unless ``all_info``, because the dicts of thousands of lanes take longer than the simulation. It
    then contains ``terminal_observation``, ``TimeLimit.truncated`` and the environment's own info.
    Rewards are float32, as in stable-baselines3; the float64 sum of an episode is info's ``score``.
    Raises ParameterError if the vector environment resets in another way.
    """

    def __init__(self, venv: VectorEnv[Any, Any, Any], all_info: bool = False) -> None:
        mode = venv.metadata.get("autoreset_mode")
        require(
            mode == AutoresetMode.SAME_STEP,
            "autoreset_mode",
            mode,
            "SAME_STEP, as that of the native vectors of impact_env",
        )
        self.venv = venv
        self.all_info = all_info
        self._actions: NDArray[Any] | None = None
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Start episodes in all lanes.

        The seeds given to `seed` are used if it was called since the last reset.
        """
        seeds: Any = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, infos = self.venv.reset(seed=seeds)
        self.reset_infos = [lane_info(infos, lane) for lane in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], list[Info]]:
        """Advance all lanes; return observations, rewards, ends and infos."""
        require(self._actions is not None, "step_wait", None, "called after step_async")
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        self._actions = None
        over = terminated | truncated
        own = {
            name: values
            for name, values in infos.items()
            if not name.lstrip("_").startswith("final_")
        }
        result: list[Info] = (
            [lane_info(own, lane) for lane in range(self.num_envs)]
            if self.all_info
            else [{} for _ in range(self.num_envs)]
        )
        for lane in np.flatnonzero(over).tolist():
            self.reset_infos[lane] = lane_info(own, lane)
            result[lane] = {
                **lane_info(infos["final_info"], lane),
                "terminal_observation": infos["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane] and not terminated[lane]),
            }
        return np.asarray(observations), rewards.astype(np.float32), over, result

    def close(self) -> None:
        """Close the vector environment."""
        self.venv.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return an image of each lane."""
        images: Any = self.venv.render()
        return [None] * self.num_envs if images is None else list(images)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each requested lane.

        A tuple with one entry for each lane is split into its entries.
        """
        value = getattr(self.venv, attr_name)
        own = isinstance(value, tuple) and len(value) == self.num_envs
        return [value[lane] if own else value for lane in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the lanes share their attributes."""
        raise AttributeError(
            f"{attr_name} cannot be set: the lanes of a native vector environment share their "
            "attributes"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refuse: there are no single environments to call."""
        raise AttributeError(
            f"{method_name} cannot be called: a native vector environment has no single "
            "environments"
        )

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Return False for each lane: there are no single environments that could be wrapped."""
        return [False for _ in self._get_indices(indices)]


def make_native(name: str, lanes: int, all_info: bool = False, **arguments: Any) -> NativeVecEnv:
    """Return the bridge to ``gymnasium.make_vec(name, lanes, **arguments)``.

    ``name`` is one of `impact_env.envs.ENVIRONMENTS`.
    """
    return NativeVecEnv(
        gymnasium.make_vec(
            name, num_envs=lanes, vectorization_mode="vector_entry_point", **arguments
        ),
        all_info,
    )
