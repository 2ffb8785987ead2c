"""Training methods for agents, compared on the validation seeds.

They are compared at equal numbers of steps and at equal time of one core.

All but one start at the rule of eight. For PPO, recurrent PPO, SAC, TQC and CrossQ the action is
the rule's plus the network's, which is 0 at first (residual policy learning: T. Silver, K. Allen,
J. Tenenbaum and L. Kaelbling 2018, arXiv:1812.06298). Rollout policy iteration starts at a clone of
the rule. The imitation of the planner starts at a network with random weights.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.evaluation import bootstrap_interval, difference_of_means, play
from impact_env.extras import optional
from optimisation.rl.hyperparameters import PolicyIterationSettings, settings_for
from optimisation.rl.models import ScaledRewards, make_lanes, make_model
from optimisation.rl.residual import AddRule, RuleAndNetwork
from optimisation.rl.rules import EIGHT, env_of, policies
from optimisation.rl.starts import apply_start, fit_actor
from optimisation.rl.vec_env import make_native
from studies.admission import Planner, plan
from studies.study import Json
from studies.training_methods import (
    ITERATION,
    METHODS,
    PERIOD,
    PLANNER,
    REPLAYED,
    SCALES,
    TrainingEffort,
    TrainingMethod,
)

with optional():
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.vec_env import VecEnvWrapper, VecFrameStack, VecMonitor

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
CRITIC_SHARE = 0.05  # of the time, in which the critic is trained alone
PLANNING_SHARE = 0.85  # of the time, in which decisions of the planner are made
PLANNED_TOGETHER = 16  # episodes
SEED_OF_TRAINING = 500_000  # first of the training seeds on which the planner acts


class SpreadRewards(VecEnvWrapper):
    """Lanes in which each reward is paid in equal parts over several intervals.

    The parts are paid in the interval of the reward and in those that follow. At the end of an
    episode the remaining parts are paid at once.
    """

    def __init__(self, venv: Any, period: int) -> None:
        super().__init__(venv)
        self._due = np.zeros((period, venv.num_envs), dtype=np.float32)

    def reset(self) -> Any:
        """Start episodes in all lanes."""
        self._due[:] = 0
        return self.venv.reset()

    def step_wait(self) -> Any:
        """Advance all lanes."""
        observations, rewards, over, infos = self.venv.step_wait()
        self._due += rewards / len(self._due)
        paid = np.where(over, self._due.sum(axis=0), self._due[0])
        self._due = np.roll(self._due, -1, axis=0)
        self._due[-1] = 0
        self._due[:, over] = 0
        return observations, paid, over, infos


def make_training_lanes(task: str, method: TrainingMethod) -> Any:
    """Return the lanes in which a method of residual learning trains, with scaled rewards."""
    scales = SCALES[task]
    lanes = VecMonitor(make_native(env_of(task), method.lanes, threads=1))
    env: Any = AddRule(ScaledRewards(lanes, scales.reward_scale), policies(task)[EIGHT])
    if method.period > 1:
        env = SpreadRewards(env, method.period)
    return VecFrameStack(env, method.frames) if method.frames > 1 else env


def make_residual_model(task: str, method: TrainingMethod, seed: int) -> Any:
    """Return an untrained model whose mean action is 0, with its lanes."""
    env = make_training_lanes(task, method)
    env.seed(seed)
    scales = SCALES[task]
    numbers = env.action_space.shape[0]
    options: dict[str, Any] = {
        "gamma": method.gamma or scales.gamma,
        "seed": seed,
        "device": "cpu",
    }
    shape: dict[str, Any] = {"net_arch": list(method.hidden)}
    if method.algorithm in REPLAYED:
        with optional():
            from sb3_contrib import TQC, CrossQ
        kinds: dict[str, Any] = {"sac": SAC, "tqc": TQC, "crossq": CrossQ}
        model = kinds[method.algorithm](
            "MlpPolicy",
            env,
            buffer_size=400_000,
            learning_starts=8 * method.lanes,
            batch_size=512,
            train_freq=1,
            gradient_steps=8,
            n_steps=PERIOD,
            ent_coef="auto_0.01",
            target_entropy=-float(numbers),
            policy_kwargs=shape,
            **options | ({} if method.algorithm == "crossq" else {"tau": 0.01}),
        )
        with torch.no_grad():
            model.actor.mu.weight *= 0.01
            model.actor.mu.bias.zero_()
        return model
    shape["log_std_init"] = -1.2
    length = method.rounds * scales.round
    options |= {"n_steps": length, "n_epochs": 4}
    if method.algorithm == "rppo":
        with optional():
            from sb3_contrib import RecurrentPPO
        shape["lstm_hidden_size"] = 64
        batch = 16 * length  # whole rounds of sixteen lanes
        return RecurrentPPO("MlpLstmPolicy", env, batch_size=batch, policy_kwargs=shape, **options)
    batch = scales.round * method.lanes // 10
    return PPO("MlpPolicy", env, batch_size=batch, policy_kwargs=shape, **options)


def train_actor_too(model: Any, trains: bool) -> None:
    """Enable or disable the training of a model's actor; its critic is always trained."""
    for name, values in model.policy.named_parameters():
        is_critic = name.startswith(
            ("critic", "value_net", "mlp_extractor.value_net", "lstm_critic")
        )
        if not is_critic:
            values.requires_grad_(trains)


@dataclass
class TrainingLoop:
    """A training in progress.

    ``advance(share)`` runs one more round, where ``share`` is the share of the training time
    already spent. ``count_steps`` returns the steps so far, ``policy`` the present policy.
    """

    advance: Callable[[float], None]
    count_steps: Callable[[], int]
    policy: Callable[[], Any]


def start_residual(task: str, method: TrainingMethod, seed: int) -> TrainingLoop:
    """Return the training of a network that adds to the rule's action."""
    model = make_residual_model(task, method, seed)
    off_policy = method.algorithm in REPLAYED
    steps = 40 * method.lanes if off_policy else model.n_steps * method.lanes

    def advance(share: float) -> None:
        train_actor_too(model, share >= CRITIC_SHARE)
        model.learning_rate = 5e-4 * (1 - 0.9 * min(share, 1.0))
        model._setup_lr_schedule()
        model.learn(steps, reset_num_timesteps=False)

    def policy() -> Any:
        return RuleAndNetwork(model, policies(task)[EIGHT], method.frames)

    return TrainingLoop(advance, lambda: model.num_timesteps, policy)


def start_iteration(task: str, method: TrainingMethod, seed: int) -> TrainingLoop:
    """Return rollout policy iteration from a clone of the rule."""
    from optimisation.rl.agents import actor_of

    env_id = env_of(task)
    scales = SCALES[task]
    usual = settings_for(env_of("ActiveGap-v0"), ITERATION)
    assert isinstance(usual, PolicyIterationSettings)
    chosen = replace(
        usual,
        lanes=method.lanes,
        horizon=method.horizon,
        n_steps=scales.round,
        hidden=method.hidden,
        reward_scale=scales.reward_scale,
    )
    env = make_lanes(env_id, chosen, threads=1)
    model = make_model(chosen, env, seed)
    env.seed(seed)
    apply_start(model, chosen, env_id, ITERATION, {}, seed)

    def advance(share: float) -> None:
        model.learning_rate = 1e-3 * (1 - 0.9 * min(share, 1.0))
        model._setup_lr_schedule()
        model.learn(scales.round * method.lanes, reset_num_timesteps=False)

    return TrainingLoop(
        advance, lambda: int(model.num_timesteps), lambda: actor_of(model, env_id, seed, {})
    )


def start_imitation(task: str, method: TrainingMethod, seed: int) -> TrainingLoop:
    """Return the imitation of the robust planner.

    The planner first acts in episodes, and a network is then fitted to its decisions.
    """
    from optimisation.rl.agents import actor_of

    env_id = env_of(task)
    scales = SCALES[task]
    rule = policies(task)[EIGHT]
    planner = Planner(scales.candidates, horizon=method.horizon)
    lanes = make_native(env_id, 1, threads=1)
    model = PPO(
        "MlpPolicy", lanes, policy_kwargs={"net_arch": list(method.hidden)}, seed=seed, device="cpu"
    )
    observations: list[Observations] = []
    actions: list[Observations] = []
    episodes = 0

    def record(observed: Observations, chosen: Array) -> None:
        observations.append(observed)
        actions.append(chosen.astype(np.float32))

    def advance(share: float) -> None:
        nonlocal episodes
        if share < PLANNING_SHARE or not observations:
            first = SEED_OF_TRAINING + 10_000 * seed + episodes
            seeds = range(first, first + PLANNED_TOGETHER)
            own = (rule.family, rule.parameters[0])
            plan(env_id, seeds, {"threads": 1}, own, planner, record=record)
            episodes += PLANNED_TOGETHER
        decisions = (np.concatenate(observations), np.concatenate(actions))
        fit_actor(model, decisions, seed + episodes, 10, 512, 1e-3)

    def count_steps() -> int:
        tried = len(planner.trials) * planner.copies * planner.horizon
        return sum(map(len, actions)) * (1 + tried)

    return TrainingLoop(advance, count_steps, lambda: actor_of(model, env_id, seed, {}))


def train_method(task: str, name: str, seed: int, effort: TrainingEffort) -> Json:
    """Train by a method for the CPU time of an effort, and return its evaluations.

    They are made on validation seeds and compared with the rule of eight.

    ``points`` have steps, seconds and mean score; ``over_rule`` is the mean difference of the best
    evaluation to the rule with its 95 % interval, ``over_rule_steps`` the difference of the best
    one among those with at most the steps of the effort, to the next round.
    """
    from impact_env.envs.evaluation import SEED_SPLITS

    method = METHODS[name]
    starts = {ITERATION: start_iteration, PLANNER: start_imitation}
    seeds = SEED_SPLITS["validation"][: effort.episodes]
    torch.set_num_threads(1)
    began = time.process_time()
    loop = starts.get(method.algorithm, start_residual)(task, method, seed)
    spent = time.process_time() - began
    rule = play(policies(task)[EIGHT], env_of(task), seeds).scores
    points: list[Json] = []
    best: Array | None = None
    has_step_mark = False
    while best is None or spent < effort.seconds:
        began = time.process_time()
        loop.advance(spent / effort.seconds)
        spent += time.process_time() - began
        steps = loop.count_steps()
        is_step_mark = steps >= effort.steps and not has_step_mark
        due = effort.seconds * (len(points) - has_step_mark + 1) / effort.evaluations
        if spent < min(due, effort.seconds) and not is_step_mark:
            continue
        has_step_mark = has_step_mark or is_step_mark
        scores = play(loop.policy(), env_of(task), seeds).scores
        points.append(
            {
                "steps": steps,
                "seconds": round(spent, 1),
                "score": round(float(scores.mean()), 6),
                "at_steps": is_step_mark,
            }
        )
        best = scores if best is None or scores.mean() > best.mean() else best
    assert best is not None
    low, high = bootstrap_interval(difference_of_means, best[None], rule[None])
    marks = [point["at_steps"] for point in points]
    until = points[: marks.index(True) + 1] if True in marks else []
    return {
        "task": task,
        "method": name,
        "seed": seed,
        "rule": round(float(rule.mean()), 6),
        "points": points,
        "over_rule": [float(best.mean() - rule.mean()), float(low), float(high)],
        "over_rule_steps": max(p["score"] for p in until) - float(rule.mean()) if until else None,
    }
