"""Rollout policy iteration: an agent is improved with simulated values of actions.

The actions are simulated on copies of the lanes.

At visited states several candidate actions are each tried for an interval or a few on a copy of the
lane, followed by the present policy over a short horizon. The actor is then moved towards the
candidates that scored higher. This is approximate policy iteration with rollouts (D. Bertsekas,
Dynamic Programming and Optimal Control; M. Lagoudakis and R. Parr 2003, Reinforcement learning as
classification), with a policy gradient in place of the classification. Copies share force and phase
errors, so what the agent learns does not hang on chaos that nobody could predict. The simulator's
state is used in training alone: the agent acts on observations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.task import Task
from impact_env.envs.vector_shell import TaskVectorEnv
from impact_env.extras import optional
from optimisation.rl.agents import Agent, actor_of

with optional():
    import gymnasium
    import torch
    from stable_baselines3 import PPO

# of a copy, as those of the robust planner that admits tasks
FORCE_ERRORS = (0.002, 0.01)  # share of the force
PHASE_ERRORS = (0.02, 0.1)  # rad
Array = NDArray[np.float64]
# observations (n, features), candidate actions (n, C, A), their scores (n, C)
Trials = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]


def draw_candidates(
    means: NDArray[np.float32], count: int, reach: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """Return the mean action of each lane and ``count`` others, (L, count + 1, A).

    The others are within ``reach`` of it. All are in [-1, 1].

    Each number of the action is stratified: one candidate in each of ``count`` equal parts of its
    range, in random order (Latin hypercube).
    """
    lanes, numbers = means.shape
    middle = np.clip(means, -1, 1)
    low = np.maximum(middle - reach, -1)[:, None]
    high = np.minimum(middle + reach, 1)[:, None]
    strata = np.tile(np.arange(count), (lanes, numbers, 1))
    strata = generator.permuted(strata, axis=2).transpose(0, 2, 1)
    shares = (strata + generator.uniform(size=strata.shape)) / count
    others = low + (high - low) * shares
    return np.concatenate([middle[:, None], others], axis=1).astype(np.float32)


def add_errors(task: Task, copies: int, generator: np.random.Generator) -> None:
    """Add random errors to force and phase of all lanes of a task.

    Each group of ``copies`` lanes has the same errors. A disturbance starts at another place of its
    record.
    """
    groups = task.lanes.count // copies

    def draw_errors(low: float, high: float) -> Array:
        errors = generator.choice((-1.0, 1.0), groups) * generator.uniform(low, high, groups)
        return np.repeat(errors, copies)

    task.lanes.force *= 1 + draw_errors(*FORCE_ERRORS)
    task.runs.orders["phase"] += draw_errors(*PHASE_ERRORS)
    record = task.settings.record
    if record is not None:
        places = generator.integers(len(record.values) - 1, size=groups)
        task.runs.orders["place"] = np.repeat(places, copies)


def score_candidates(
    trials: Task,
    candidates: NDArray[np.float32],
    agent: Agent,
    hold: int,
    horizon: int,
    gamma: float,
) -> Array:
    """Return the discounted rewards (L, C) of candidate actions (L, C, A).

    Each action is held for ``hold`` intervals and followed by the actions of an agent, up to
    ``horizon`` intervals. ``trials`` has L times C lanes, C copies of each lane, and is advanced.
    """
    lanes, copies, numbers = candidates.shape
    actions = candidates.reshape(lanes * copies, numbers)
    over = np.zeros(len(actions), dtype=np.bool_)
    scores = np.zeros(len(actions))
    for interval in range(horizon):
        rewards, terminated, truncated = trials.step(actions, over if over.any() else None)
        scores += gamma**interval * rewards
        over = over | terminated | truncated
        if over.all():
            break
        observed = trials.observe([])
        if interval + 1 >= hold:
            actions = agent.act(observed)
    return scores.reshape(lanes, copies)


class RolloutPolicyIteration(PPO):  # type: ignore[misc]
    """Rollout policy iteration within the loop of stable-baselines3.

    Its rounds, files and optimiser are those of PPO.

    A round plays ``n_steps`` intervals of each lane by the actor with its exploration noise. Every
    ``trial_interval`` intervals ``candidates`` actions within ``reach`` of the actor's and the
    actor's own are held for ``hold`` intervals and scored over ``horizon``. The actor then
    maximises

        mean over states of the sum over candidates j of w_j q_j,
        w = softmax(-|mean action - candidate|^2 / (2 width^2)),

    with q the scores less their mean, over the trials of the last ``rounds_in_memory`` rounds. All
    steps of the copies count as steps. The critic is not trained.
    """

    candidates = 5
    reach = 2.0
    hold = 1
    horizon = 12
    trial_interval = 3
    width = 0.2
    rounds_in_memory = 8

    _last_obs: Any

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.memory: list[Trials] = []
        self._trial_env: Any = None

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "memory", "_trial_env"]

    def _make_trials(self, lanes: TaskVectorEnv) -> Task:
        """Return the task of the copies, ``candidates`` + 1 of each lane."""
        if getattr(self, "_trial_env", None) is None:  # a model from a file has no attribute
            assert lanes.spec is not None  # Gymnasium made the lanes
            arguments = {
                **lanes.spec.kwargs,
                "num_envs": lanes.num_envs * (self.candidates + 1),
                "vectorization_mode": "vector_entry_point",
            }
            self._trial_env = gymnasium.make_vec(lanes.spec.id, **arguments)
            self._trial_env.reset(seed=0)
        task: Task = self._trial_env.unwrapped.task
        task.sensors.noise = 0.0  # of the trials alone: without it they differ by the actions
        task.sensors.drift = 0.0
        return task

    def collect_rollouts(
        self,
        env: Any,
        callback: Any,
        rollout_buffer: Any,
        n_rollout_steps: int,
    ) -> bool:
        """Play a round and score candidates; return False if the callback ends the training."""
        lanes: TaskVectorEnv = env.task_lanes
        trials = self._make_trials(lanes)
        assert lanes.spec is not None
        agent = actor_of(self, lanes.spec.id, 0, {})
        seed = int(torch.randint(2**62, (1,)))
        generator = np.random.default_rng(seed)  # of its own: it depends on the leg alone
        noise = float(self.policy.log_std.detach().exp().mean())
        parts: list[Trials] = []
        callback.on_rollout_start()
        for interval in range(n_rollout_steps):
            observed = np.asarray(self._last_obs, dtype=np.float32)
            means = agent.act(observed)
            if interval % self.trial_interval == 0:
                tried = draw_candidates(means, self.candidates, self.reach, generator)
                trials.copy_from(lanes.task, tried.shape[1])
                add_errors(trials, tried.shape[1], generator)
                scores = score_candidates(trials, tried, agent, self.hold, self.horizon, self.gamma)
                parts.append((observed, tried, scores.astype(np.float32)))
                self.num_timesteps += self.horizon * trials.lanes.count
            actions = means + noise * generator.standard_normal(means.shape)
            new, _, done, infos = env.step(np.clip(actions, -1, 1).astype(np.float32))
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, done)
            self._last_obs = new
            self._last_episode_starts = done
        joined: Any = tuple(np.concatenate(column) for column in zip(*parts, strict=True))
        self.memory = [*self.memory, joined][-self.rounds_in_memory :]
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Move the actor towards the candidates that scored higher."""
        tools: Any = torch
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        columns = zip(*self.memory, strict=True)
        observations, candidates, scores = (torch.from_numpy(np.concatenate(c)) for c in columns)
        scores = scores - scores.mean(dim=1, keepdim=True)
        scores = scores / (scores.std() + 1e-12)
        gains = []
        for _ in range(self.n_epochs):
            for part in tools.randperm(len(observations)).split(self.batch_size):
                latent = self.policy.mlp_extractor.forward_actor(observations[part])
                means = self.policy.action_net(latent)
                distances = ((means[:, None] - candidates[part]) ** 2).sum(dim=2)
                weights = torch.softmax(-distances / (2 * self.width**2), dim=1)
                gain = (weights * scores[part]).sum(dim=1).mean()
                outside = torch.relu(means.abs() - 1).pow(2).mean()  # actions there are cut off
                loss: Any = outside - gain
                self.policy.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                self.policy.optimizer.step()
                gains.append(float(gain.detach()))
        self._n_updates += self.n_epochs
        self.logger.record("train/gain", float(np.mean(gains)))
        self.logger.record("train/learning_rate", self.policy.optimizer.param_groups[0]["lr"])
