"""Training with a vector of costs.

The reward is a weighted sum of the costs. A Lagrange multiplier limits one cost.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    non_negative,
    positive,
    require,
)
from impact_env.envs.evaluation import play
from impact_env.extras import optional
from impact_env.fields import check_fields
from optimisation.rl.vec_env import make_native

with optional():
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnvWrapper

Array = NDArray[np.float64]


class WeightedCosts(VecEnvWrapper):
    """Lanes with ``vector_reward=True`` whose reward is minus a weighted sum of their costs.

    Parameters
    ----------
    venv : VecEnv
        Lanes of `make_native` with ``vector_reward=True``, whose rewards are minus the costs (L,
        C).
    weights : sequence of float
        Weights (C,) of the costs in the order of ``info["costs"]``; `set_weights` changes them.
    """

    def __init__(self, venv: Any, weights: Sequence[float]) -> None:
        super().__init__(venv)
        self.set_weights(weights)

    def set_weights(self, weights: Sequence[float]) -> None:
        """Take other weights (C,) from the next step on."""
        self.weights = np.asarray(weights, dtype=np.float32)

    def reset(self) -> NDArray[Any]:
        """Start episodes in all lanes."""
        return np.asarray(self.venv.reset())

    def step_wait(self) -> Any:
        """Advance all lanes."""
        observations, rewards, over, infos = self.venv.step_wait()
        return observations, rewards @ self.weights, over, infos


def make_weighted_lanes(
    env_id: str,
    lanes: int,
    weights: Sequence[float],
    arguments: Mapping[str, Any] | None = None,
) -> WeightedCosts:
    """Return ``lanes`` lanes of a task whose reward is minus its weighted costs.

    The reward is minus the sum of the costs times ``weights`` (C,).
    """
    native = make_native(env_id, lanes, vector_reward=True, **(arguments or {}))
    return WeightedCosts(native, weights)


def mean_costs(
    policy: Any, env_id: str, seeds: Sequence[int], arguments: Mapping[str, Any] | None = None
) -> Array:
    """Return the mean costs (E, C) of a control interval in one episode for each seed.

    The means are over the intervals of the episode. ``policy`` is of any kind that `evaluate`
    accepts.
    """
    played = play(policy, env_id, seeds, {"vector_reward": True, **(arguments or {})})
    costs: Array = -played.scores / played.steps[:, None]
    return costs


class LagrangeMultiplier(BaseCallback):  # type: ignore[misc]
    """Limit the mean of one cost in training by dual ascent on a Lagrange multiplier.

    The lanes' reward is minus the weighted costs, plus ``multiplier`` times the cost over its
    limit. After every ``rounds`` rounds the mean action plays one episode on each of ``seeds``. The
    multiplier then grows by ``rate`` times the relative violation, cost / limit - 1, and falls
    where the cost is below the limit; it is never below 0 (D. Bertsekas, Nonlinear Programming; A.
    Ray, J. Achiam and D. Amodei 2019, Benchmarking safe exploration in deep reinforcement
    learning).

    Parameters
    ----------
    lanes : WeightedCosts
        Lanes whose weights are those of the aim alone.
    cost : int
        Column of the costs.
    limit : float
        Largest mean of the cost over the intervals of an episode.
    policy : object
        Policy of the present model as `evaluate` takes it.
    env_id : str
        Registered name of the task.
    seeds : sequence of int
        Training seeds of the episodes that measure the cost.
    intervals : int
        Control intervals of an episode: the multiplier's part of the reward is a mean over them, as
        the level is.
    rate : float, optional
        Step of the multiplier.
    rounds : int, optional
        Rounds of the algorithm between two steps of the multiplier.
    """

    def __init__(
        self,
        lanes: WeightedCosts,
        cost: int,
        limit: float,
        policy: Any,
        env_id: str,
        seeds: Sequence[int],
        intervals: int,
        rate: float = 0.04,
        rounds: int = 1,
    ) -> None:
        super().__init__()
        self.lanes = lanes
        self.aim = lanes.weights.astype(np.float64)
        require(0 <= cost < len(self.aim), "cost", cost, f"a column from 0 to {len(self.aim) - 1}")
        self.cost = cost
        self.policy = policy
        self.env_id = env_id
        self.seeds = seeds
        self.limit = limit
        self.intervals = intervals
        self.rate = rate
        self.rounds = rounds
        check_fields(
            self,
            limit=positive,
            intervals=count_from(1),
            rate=non_negative,
            rounds=count_from(1),
        )
        self.multiplier = 0.0
        self.history: list[tuple[int, float, float]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._rounds = getattr(self, "_rounds", 0) + 1
        if self._rounds % self.rounds == 0:
            cost = float(mean_costs(self.policy, self.env_id, self.seeds)[:, self.cost].mean())
            self.update(cost)

    def update(self, cost: float) -> None:
        """Move the multiplier by the violation of the limit, and set the weights of the lanes.

        ``cost`` is the mean cost.
        """
        self.multiplier = max(0.0, self.multiplier + self.rate * (cost / self.limit - 1))
        weights = self.aim.copy()
        weights[self.cost] += self.multiplier / (self.limit * self.intervals)
        self.lanes.set_weights(weights.tolist())
        self.history.append((self.num_timesteps, cost, self.multiplier))
