"""Residual policy learning: the action is a rule's action plus that of a network.

The network's action is 0 before training.

T. Silver, K. Allen, J. Tenenbaum and L. Kaelbling 2018, arXiv:1812.06298. The rule has no memory.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.extras import optional

with optional():
    from stable_baselines3.common.vec_env import VecEnvWrapper

Observations = NDArray[np.float32]


class AddRule(VecEnvWrapper):
    """Lanes that add the action of a rule without memory to the action that is taken.

    The sum is clipped to [-1, 1].
    """

    def __init__(self, venv: Any, rule: Any) -> None:
        super().__init__(venv)
        self.rule = rule
        rule.start(venv.num_envs)

    def reset(self) -> Any:
        """Start episodes in all lanes."""
        self._observed = self.venv.reset()
        return self._observed

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next step."""
        total = np.clip(self.rule.act(self._observed) + actions, -1, 1)
        self.venv.step_async(total.astype(np.float32))

    def step_wait(self) -> Any:
        """Advance all lanes."""
        result = self.venv.step_wait()
        self._observed = result[0]
        return result


class RuleAndNetwork:
    """Policy for `evaluate`: the action of a rule plus the mean action of a model.

    The model acts on the last ``frames`` observations.
    """

    name = "rule and network"

    def __init__(self, model: Any, rule: Any, frames: int) -> None:
        self.model = model
        self.rule = rule
        self.frames = frames

    def start(self, lanes: int) -> None:
        """Begin new episodes: nothing has been observed."""
        self.rule.start(lanes)
        self._fresh = np.ones(lanes, dtype=np.bool_)
        self._state: Any = None
        self._stack: Observations | None = None

    def act(self, observations: Observations) -> Observations:
        """Return the actions for the observations so far."""
        lanes, width = observations.shape
        if self._stack is None:
            self._stack = np.zeros((lanes, self.frames * width), dtype=np.float32)
        self._stack = np.roll(self._stack, -width, axis=1)
        self._stack[:, -width:] = observations
        added, self._state = self.model.predict(
            self._stack, state=self._state, episode_start=self._fresh, deterministic=True
        )
        self._fresh = np.zeros(lanes, dtype=np.bool_)
        return np.clip(self.rule.act(observations) + added, -1, 1).astype(np.float32)
