from __future__ import annotations

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from places import ROOT

from impact_env.parameters import ParameterError
from optimisation.rl.agents import load_agent
from optimisation.rl.play import GAP, SWEEP, play
from optimisation.rl.policies import Constant, Random

RUBBING = {"modes": 2, "absorber_options": {"friction_limit": 0.025}}
SHORT: dict[str, dict[str, Any]] = {
    SWEEP: RUBBING | {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0},
    GAP: RUBBING | {"hold": (10.0, 30.0), "time_budget": 60.0, "force": (1.0, 6.0)},
}


class Observer:
    """Goes faster where the tip moves more, so that what it does depends on what it sees, and counts its calls."""

    name = "observer"

    def start(self, lanes: int) -> None:
        self.lanes, self.calls = lanes, 0

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.calls += 1
        return np.tanh(2 * observations[:, :1] + observations[:, 6:7]).astype(np.float32)


@pytest.mark.parametrize("name", [SWEEP, GAP])
def test_a_lane_is_the_single_environment_of_its_seed(name: str) -> None:
    seeds = [11, 3, 7]
    policy = Observer()
    episodes = play(policy, name, seeds, SHORT[name], record=("action", "score", "time"))
    assert policy.lanes == 3
    assert policy.calls == episodes.steps.max()
    for lane, seed in enumerate(seeds):
        env = gymnasium.make(name, **SHORT[name])
        observation, info = env.reset(seed=seed)
        score, steps, over, times = 0.0, 0, False, []
        while not over:
            observation, reward, end, cut, info = env.step(Observer.act(policy, observation[None])[0])
            score, steps, over = score + reward, steps + 1, end or cut
            times.append(info["time"])
        assert episodes.scores[lane] == score == episodes.last["score"][lane]
        assert episodes.steps[lane] == steps
        np.testing.assert_array_equal(episodes.traces["time"][:steps, lane], times)
        assert np.isnan(episodes.traces["time"][steps:, lane]).all()
        assert {key: values[lane] for key, values in episodes.last.items()} == pytest.approx({key: float(value) for key, value in info.items()})


def test_lanes_end_at_their_own_time() -> None:
    options = SHORT[SWEEP] | {"time_budget": 30.0}
    episodes = play(Random(1), SWEEP, range(6), options, record=("action",))
    assert len(set(episodes.steps)) > 1
    assert np.isfinite(episodes.traces["action"]).sum() == episodes.steps.sum()


def test_random_actions_are_the_same_again_and_constant_ones_constant() -> None:
    first, again = (play(Random(4), SWEEP, [0, 1], SHORT[SWEEP], record=("action",)) for _ in range(2))
    np.testing.assert_array_equal(first.traces["action"], again.traces["action"])
    assert np.nanstd(first.traces["action"]) > 0.3
    constant = play(Constant(0.25), SWEEP, [0, 1], SHORT[SWEEP], record=("action",))
    assert set(constant.traces["action"][np.isfinite(constant.traces["action"])]) == {0.25}


class Crooked:
    name = "crooked"

    def start(self, lanes: int) -> None:
        pass

    def act(self, observations: np.ndarray) -> np.ndarray:
        return np.zeros(len(observations), dtype=np.float32)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: play(Constant(0), "Pendulum-v1", [0]), "environment = 'Pendulum-v1'"),
        (lambda: play(Constant(0), SWEEP, [], SHORT[SWEEP]), "seeds = "),
        (lambda: play(Constant(0), SWEEP, [0], SHORT[SWEEP], record=("gap",)), "record = 'gap'"),
        (lambda: play(Constant(0), SWEEP, [0], {"force": -1}), "force = -1"),
        (lambda: play(Crooked(), SWEEP, [0, 1], SHORT[SWEEP]), "from crooked"),
        (lambda: Constant(1.5), "action = 1.5"),
    ],
)
def test_bad_input_is_named(call: Any, words: str) -> None:
    with pytest.raises(ParameterError, match=words.replace("(", r"\(")):
        call()


def test_how_many_are_played_together_moves_no_mean() -> None:
    """Products of matrices round by the batch, and impacts make much of it: an agent's episodes differ, by chance and no more."""
    agent, seeds = load_agent(ROOT / "docs" / "agents" / "friction" / "ppo" / "final.npz"), range(2_000_000, 2_000_140)
    together = play(agent, agent.env_id, seeds).scores
    by_sevens = np.concatenate([play(agent, agent.env_id, seeds[k : k + 7]).scores for k in range(0, len(seeds), 7)])
    differences = by_sevens - together
    assert abs(differences.mean()) <= 5 * differences.std(ddof=1) / np.sqrt(len(seeds))
    assert differences.std() < 0.5 * together.std()  # a seed says more than chance
