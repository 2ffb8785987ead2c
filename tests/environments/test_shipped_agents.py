"""Agents that ship: they act without torch as stable-baselines3 makes them act, do better than constants, go on learning, and are small."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC

import impact_env
from impact_env import ParameterError
from impact_env.envs import ENVIRONMENTS
from impact_env.envs.evaluation import play
from optimisation.rl.agents import load_agent, packaged_file, shipped
from optimisation.rl.models import make_lanes

SHIPPED = [(task, algorithm) for task, own in shipped().items() for algorithm in own]
KINDS = {"ppo": PPO, "sac": SAC}
pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date", "ignore:`n_steps=4` is ignored")


@pytest.mark.parametrize(("task", "algorithm"), SHIPPED)
def test_the_small_file_acts_as_the_model(task: str, algorithm: str) -> None:
    agent, model = load_agent(task, algorithm), KINDS[algorithm].load(packaged_file(task, algorithm), device="cpu")
    seen = np.random.default_rng(0).normal(size=(50, model.observation_space.shape[0])).astype(np.float32)
    np.testing.assert_allclose(agent.act(seen), model.predict(seen, deterministic=True)[0], atol=1e-5)


@pytest.mark.parametrize(("task", "algorithm"), SHIPPED)
def test_an_agent_does_better_than_constants(task: str, algorithm: str) -> None:
    agent = load_agent(task, algorithm)
    constants = {str(action): [action] * ENVIRONMENTS[agent.env_id].numbers for action in (-0.4, 0.0, 0.4, 0.8)}
    found = impact_env.evaluate(agent, agent.env_id, "validation", constants, episodes=64)
    assert min(better[0] for better in found.differences.values()) > 0.01


def test_an_agent_goes_on_learning() -> None:
    env = make_lanes("ImpactAbsorber/ActiveGap-v0", "ppo")
    model = PPO.load(packaged_file("ActiveGap-v0"), env=env, device="cpu")
    model.set_random_seed(0)  # the lanes' seeds, too
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(5120, reset_num_timesteps=False)
    assert model.num_timesteps >= 400_000 + 5120
    assert all(not bool((a == b.detach()).all()) for a, b in zip(before, model.policy.parameters(), strict=True))
    seen = model.rollout_buffer  # the critic that came along knows these rewards: what they add up to for ever; without their scale it is off by 50
    assert 0.2 < seen.values.mean() * (1 - model.gamma) / seen.rewards.mean() < 5


def test_what_does_not_ship_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="task = 'nothing' is not allowed"):
        load_agent("nothing")
    with pytest.raises(ParameterError, match="algorithm = 'sac'"):
        load_agent("GapChoice-v1", "sac")
    (tmp_path / "a.zip").write_bytes(b"no archive")
    with pytest.raises(ParameterError, match="a file that train wrote"):
        load_agent(tmp_path / "a.zip")


def test_how_many_are_played_together_moves_no_mean() -> None:
    """Products of matrices round by the batch, and impacts make much of it: an agent's episodes differ, by chance and no more."""
    agent, seeds = load_agent("FrictionChoice-v1"), range(2_000_000, 2_000_140)
    together = play(agent, agent.env_id, seeds).scores
    by_sevens = np.concatenate([play(agent, agent.env_id, seeds[k : k + 7]).scores for k in range(0, len(seeds), 7)])
    differences = by_sevens - together
    assert abs(differences.mean()) <= 5 * differences.std(ddof=1) / np.sqrt(len(seeds))
    assert differences.std() < 0.5 * together.std()  # a seed says more than chance
