"""PPO and SAC of stable-baselines3 on a native vector environment.

They are made from hyperparameters, written to files and read from them.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import shutil
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union, cast

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.envs.vector_shell import TaskVectorEnv
from impact_env.extras import optional
from optimisation.files import write_json
from optimisation.rl.agents import CHECKPOINT_AGENT, Agent, TrainingEvaluation, save_agent
from optimisation.rl.hyperparameters import (
    PolicyIterationSettings,
    PPOSettings,
    RecurrentPPOSettings,
    Settings,
    settings_for,
)
from optimisation.rl.policy_iteration import RolloutPolicyIteration
from optimisation.rl.vec_env import NativeVecEnv, make_native

with optional():
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.utils import set_random_seed
    from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvStepReturn

if TYPE_CHECKING:
    from sb3_contrib import RecurrentPPO

Model = Union["PPO", "SAC", "RecurrentPPO"]
# hyperparameters that stable-baselines3 takes by their names
OF_BOTH = (
    "learning_rate",
    "gamma",
    "batch_size",
    "n_steps",
    "ent_coef",
    "use_sde",
    "sde_sample_freq",
)
OF_ITERATION = ("learning_rate", "gamma", "n_steps", "n_epochs")
TRIALS = (
    "batch_size",
    "candidates",
    "reach",
    "hold",
    "horizon",
    "trial_interval",
    "width",
    "rounds_in_memory",
)
OF_PPO = ("n_epochs", "gae_lambda", "clip_range")
OF_SAC = ("buffer_size", "learning_starts", "train_freq", "gradient_steps", "tau", "target_entropy")
REPLAY = "replay.pkl"  # experience that later updates use
KINDS: dict[str, Any] = {"ppo": PPO, "sac": SAC, "rpi": RolloutPolicyIteration}


class ScaledRewards(VecEnvWrapper):
    """Rewards times a factor, for algorithms whose step sizes suit rewards of order one."""

    def __init__(self, venv: VecEnv, factor: float) -> None:
        super().__init__(venv)
        self.factor = factor

    def reset(self) -> NDArray[Any]:
        """Start episodes in all lanes."""
        return np.asarray(self.venv.reset())

    def step_wait(self) -> VecEnvStepReturn:
        """Advance all lanes."""
        observations, rewards, done, infos = self.venv.step_wait()
        return observations, rewards * np.float32(self.factor), done, infos

    def snapshot(self) -> dict[str, Any]:
        """Return all that the next steps depend on."""
        monitor, lanes = self._parts()
        return {
            "returns": monitor.episode_returns.copy(),
            "lengths": monitor.episode_lengths.copy(),
            "lanes": lanes.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot."""
        monitor, lanes = self._parts()
        monitor.episode_returns = snapshot["returns"].copy()
        monitor.episode_lengths = snapshot["lengths"].copy()
        lanes.restore(snapshot["lanes"])

    @property
    def task_lanes(self) -> TaskVectorEnv:
        """The native vector environment below."""
        return self._parts()[1]

    def _parts(self) -> tuple[VecMonitor, TaskVectorEnv]:
        assert isinstance(self.venv, VecMonitor)
        assert isinstance(self.venv.venv, NativeVecEnv)
        assert isinstance(self.venv.venv.venv, TaskVectorEnv)
        return self.venv, self.venv.venv.venv


def make_lanes(
    env_id: str,
    chosen: Settings | str,
    arguments: Mapping[str, Any] | None = None,
    threads: int | None = None,
) -> ScaledRewards:
    """Return the environment to train on.

    It is made for hyperparameters or, for an algorithm's name, for those of the package.

    `VecMonitor` lies inside, so episode statistics are in units of the score, while a critic's
    values are in that of the scaled rewards.
    """
    chosen = settings_for(env_id, chosen) if isinstance(chosen, str) else chosen
    native = make_native(env_id, chosen.lanes, **{"threads": threads, **(arguments or {})})
    return ScaledRewards(VecMonitor(native), chosen.reward_scale)


def make_model(chosen: Settings, env: VecEnv, seed: int) -> Model:
    """Return a fresh model."""
    net: dict[str, Any] = {"net_arch": list(chosen.hidden), "log_std_init": chosen.log_std_init}
    if isinstance(chosen, PolicyIterationSettings):
        iteration = RolloutPolicyIteration(
            "MlpPolicy",
            env,
            policy_kwargs=net,
            seed=seed,
            device="cpu",
            batch_size=chosen.n_steps * chosen.lanes,  # of PPO's own updates
            **{name: getattr(chosen, name) for name in OF_ITERATION},
        )
        for name in TRIALS:
            setattr(iteration, name, getattr(chosen, name))
        _start_at(iteration.policy.action_net, chosen.initial_action)
        return cast("Model", iteration)
    names = (*OF_BOTH, *(OF_PPO if isinstance(chosen, PPOSettings) else OF_SAC))
    own: dict[str, Any] = {name: getattr(chosen, name) for name in names} | {
        "seed": seed,
        "device": "cpu",
    }
    if isinstance(chosen, PPOSettings):
        kind: Any = PPO
        policy = "MlpPolicy"
        if isinstance(chosen, RecurrentPPOSettings):
            kind = recurrent()
            policy = "MlpLstmPolicy"
            net = net | {"lstm_hidden_size": chosen.lstm}
        ppo = kind(policy, env, policy_kwargs=net, **own)
        _start_at(ppo.policy.action_net, chosen.initial_action)
        return cast("Model", ppo)
    sac = SAC("MlpPolicy", env, policy_kwargs=net | {"clip_mean": 0.0}, **own)
    _start_at(sac.actor.mu, math.atanh(chosen.initial_action))
    with torch.no_grad():
        networks: list[Any] = [*sac.critic.q_networks, *sac.critic_target.q_networks]
        for layers in networks:
            layers[-1].bias += chosen.initial_value
    return sac


def recurrent() -> Any:
    """Return the recurrent PPO of sb3-contrib, which nothing else needs."""
    with optional():
        from sb3_contrib import RecurrentPPO
    return RecurrentPPO


def _start_at(layer: Any, action: float) -> None:
    """Set the last layer of an actor so that its first actions are close to ``action``.

    If an action has several numbers, the first is close to ``action`` and the others are close to
    0.
    """
    torch.nn.init.constant_(layer.bias, 0.0)
    with torch.no_grad():
        layer.bias[0] = action


def begin_leg(model: Model, seed: int, leg: int, learning_rate: float) -> None:
    """Seed all generators, and set the leg's learning rate.

    Further training then depends only on the model and its lanes.
    """
    own = int(np.random.SeedSequence((seed, leg)).generate_state(1)[0] >> 1)
    if leg == 0:
        model.set_random_seed(own)  # the lanes' seeds, too
    else:
        set_random_seed(own)
        model.action_space.seed(own)
    model.learning_rate = learning_rate
    model._setup_lr_schedule()


def save_model(folder: Path, model: Model, env: ScaledRewards) -> None:
    """Write networks, optimisers, counters, and the lanes' places in their episodes.

    For SAC the replay buffer is written as well, and for rollout policy iteration its memory.
    """
    model.save(folder / "model.zip")
    (folder / "lanes.pickle").write_bytes(
        pickle.dumps((env.snapshot(), getattr(model, "_last_lstm_states", None)))
    )
    if isinstance(model, SAC):
        model.save_replay_buffer(folder / REPLAY)
    if isinstance(model, RolloutPolicyIteration):
        (folder / REPLAY).write_bytes(pickle.dumps(model.memory))


def load_model(folder: Path, algorithm: str, env: ScaledRewards) -> Model:
    """Return the model of `save_model`, with its lanes at their places in their episodes.

    Raises ParameterError for files that are damaged or missing.
    """
    try:
        kind: Any = recurrent() if algorithm == "rppo" else KINDS[algorithm]
        with warnings.catch_warnings():  # the library warns of the memory that it chose itself
            warnings.filterwarnings("ignore", message="`n_steps=")
            model: Model = kind.load(folder / "model.zip", env=env, device="cpu", force_reset=False)
        env.reset()
        lanes, states = pickle.loads((folder / "lanes.pickle").read_bytes())
        env.restore(lanes)
        if isinstance(model, SAC):
            model.load_replay_buffer(folder / REPLAY)
        if isinstance(model, RolloutPolicyIteration):
            model.memory = pickle.loads((folder / REPLAY).read_bytes())
        if states is not None:
            cast("RecurrentPPO", model)._last_lstm_states = states
    except Exception as error:  # whatever a torn zip file, pickle or array makes the readers raise
        reason = f"a folder whose files are whole ({type(error).__name__}: {error})"
        raise ParameterError(f"checkpoint = {str(folder)!r} is not allowed: {reason}") from error
    return model


LAST_CHECKPOINTS = 2  # checkpoints of a training run: folders that are whole or absent


def save_checkpoint(
    folder: Path,
    leg: int,
    model: Model,
    env: ScaledRewards,
    evaluations: list[TrainingEvaluation],
    agent: Agent,
) -> None:
    """Write the checkpoint at the end of a leg, and remove old ones.

    The last two checkpoints and the best one remain.
    """
    target = folder / f"leg-{leg:03d}"
    temporary = folder / f".{target.name}-{os.getpid()}"
    temporary.mkdir(parents=True)
    save_model(temporary, model, env)
    write_json(temporary / "evaluations.json", [asdict(evaluation) for evaluation in evaluations])
    save_agent(temporary / CHECKPOINT_AGENT, agent)
    temporary.rename(target)
    best = best_checkpoint(folder)
    for old in checkpoints(folder)[:-LAST_CHECKPOINTS]:
        (old / REPLAY).unlink(missing_ok=True)  # large, and of use for the last ones alone
        if old != best:
            shutil.rmtree(old)


def checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints from first to last."""
    return sorted(folder.glob("leg-*"))


def best_checkpoint(folder: Path) -> Path:
    """Return the checkpoint of the leg with the best evaluation, the first of equal ones.

    If no evaluation can be read, it is that of the last leg.
    """
    known = checkpoints(folder)
    scores = []
    for checkpoint in known:
        evaluations = read_evaluations_of(checkpoint)
        scores.append(evaluations[-1].score if evaluations else -math.inf)
    return known[-1] if max(scores) == -math.inf else known[int(np.argmax(scores))]


def read_evaluations_of(checkpoint: Path) -> list[TrainingEvaluation]:
    """Return the evaluations up to a checkpoint, none if they cannot be read."""
    try:
        text = (checkpoint / "evaluations.json").read_text(encoding="utf-8")
        return [TrainingEvaluation(**values) for values in json.loads(text)]
    except (OSError, ValueError, TypeError):
        return []


def last_checkpoint(
    folder: Path, algorithm: str, env: ScaledRewards
) -> tuple[Model, list[TrainingEvaluation]] | None:
    """Return model and evaluations of the last complete checkpoint, or None.

    Incomplete checkpoints are removed.
    """
    for half_made in folder.glob(".leg-*"):
        shutil.rmtree(half_made)
    for checkpoint in reversed(checkpoints(folder)):
        evaluations = read_evaluations_of(checkpoint)
        try:
            require(len(evaluations) > 0, "checkpoint", str(checkpoint), "one with evaluations")
            return load_model(checkpoint, algorithm, env), evaluations
        except ParameterError:
            shutil.rmtree(checkpoint)
    return None


def forget_replay(folder: Path) -> None:
    """Remove the replay buffers of a run.

    They are by far the largest part of a finished run, and nothing needs them.
    """
    for file in folder.glob(f"leg-*/{REPLAY}"):
        file.unlink()
