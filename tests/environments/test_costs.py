"""Training with vectors of costs: weighted sums, a multiplier that keeps a limit, and MO-Gymnasium's tools on the same rewards."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawing import line, saved_figures

pytest.importorskip("stable_baselines3")
gymnasium = pytest.importorskip("gymnasium")

from impact_env import ParameterError
from impact_env.envs.evaluation import play
from optimisation.rl.costs import (
    LagrangeMultiplier,
    WeightedCosts,
    make_weighted_lanes,
    mean_costs,
)
from optimisation.rl.rules import EIGHT, policies
from studies.cli import constrain_training as study
from studies.study import Measurement

NAME = "ImpactAbsorber/ActiveGap-v0"
WEIGHTS = [1.0, 0.0, 0.5, 0.25, 2.0]


def test_the_reward_is_the_weighted_sum_of_the_costs() -> None:
    lanes = make_weighted_lanes(NAME, 3, WEIGHTS, {"threads": 1})
    single = gymnasium.make(NAME)
    lanes.seed(4)
    lanes.reset()
    single.reset(seed=4)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 1)).astype(np.float32):
        rewards = lanes.step(np.tile(action, (3, 1)))[1]
        costs = single.step(action)[4]["costs"]
        assert rewards.shape == (3,)
        assert rewards[0] == pytest.approx(-costs @ WEIGHTS, rel=1e-5)
    lanes.close()


def test_mean_costs_make_the_score() -> None:
    rule = policies("ActiveGap-v0")[EIGHT]
    seeds = range(3)
    costs = mean_costs(rule, NAME, seeds)
    assert costs.shape == (3, 5)
    aim = np.array(study.aim_of("ActiveGap-v0"))
    scores = play(rule, NAME, seeds).scores
    np.testing.assert_allclose(-(costs @ aim) * study.INTERVALS, scores, rtol=1e-9)


class ReportedCost(LagrangeMultiplier):
    """A multiplier whose cost is a function of itself: that of an agent which has learnt the weighted aim."""

    num_timesteps = 0


def make_multiplier(**changes: Any) -> LagrangeMultiplier:
    lanes = WeightedCosts.__new__(WeightedCosts)
    lanes.set_weights([1.0, 0.0, 0.0])
    options: dict[str, Any] = {"cost": 2, "limit": 0.5, "intervals": 10, "rate": 0.2} | changes
    return ReportedCost(lanes, policy=None, env_id=NAME, seeds=range(2), **options)


def test_the_multiplier_comes_to_where_the_cost_is_the_limit() -> None:
    """An agent that minimises (c - 1)^2 + weight c has c = 1 - weight / 2: with the weight 1 it is the limit 0.5."""
    multiplier = make_multiplier()
    for _ in range(200):
        weight = float(multiplier.lanes.weights[2]) * multiplier.intervals
        multiplier.update(1 - weight / 2)
    assert multiplier.history[-1][1] == pytest.approx(0.5, abs=1e-3)
    assert multiplier.multiplier == pytest.approx(1.0 * multiplier.limit, abs=1e-3)
    for _ in range(200):
        multiplier.update(0.1)
    assert multiplier.multiplier == 0.0
    np.testing.assert_array_equal(multiplier.lanes.weights, [1, 0, 0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"cost": 3}, "cost = 3 is not allowed"),
        ({"limit": 0.0}, "limit = 0"),
        ({"rounds": 0}, "rounds = 0"),
        ({"rate": -1.0}, "rate = -1"),
    ],
)
def test_a_multiplier_refuses_what_makes_no_sense(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make_multiplier(**changes)


def test_a_training_moves_the_multiplier_after_each_round() -> None:
    lanes = make_weighted_lanes(NAME, 4, study.aim_of("ActiveGap-v0"), {"threads": 1})
    model, policy = study.make_ppo(lanes, "ActiveGap-v0", 0)
    multiplier = LagrangeMultiplier(lanes, 4, 0.1, policy, NAME, range(2), study.INTERVALS)
    model.learn(2 * 4 * study.ROUND, callback=multiplier)
    assert [steps for steps, _, _ in multiplier.history] == [320, 640]
    first = multiplier.history[0]
    assert first[2] == pytest.approx(max(0.0, 0.04 * (first[1] / 0.1 - 1)))
    lanes.close()


def test_the_tables_have_limits_and_weights(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = [
        {"task": "ActiveFriction-v0", "kind": kind, "value": value, "multiplier": multiplier}
        | {"scores": [-0.4, -0.2], "costs": [0.1, 0.1]}
        for kind, value, multiplier in (
            (EIGHT, None, None),
            (study.LIMITED, 0.14, 0.5),
            (study.LINEAR, 2.0, None),
        )
    ]
    measured = Measurement({"rows": rows, "settings": {"steps": 10, "episodes": 2}})
    limits = study.make_limit_table(measured)
    assert limits.count("`ActiveFriction-v0`") == 2
    assert "way of the actuator: 0.14 half range" in limits
    front = study.make_front_table(measured)
    assert "weight of the way of the actuator" in front
    assert front.count("-0.300") == 1
    drawn = saved_figures(monkeypatch)
    study.save_front(tmp_path / "front.png", measured)
    panel = drawn[0].axes[list(study.COSTS).index("ActiveFriction-v0")]
    for label in (EIGHT, study.LIMITED, "weights"):
        np.testing.assert_allclose(line(panel, label), [[0.1], [-0.3]])


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped")
@pytest.mark.parametrize("name", [NAME, "ImpactAbsorber/Passage-v0"])
def test_an_environment_with_vectors_is_one_of_mo_gymnasium(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mo_gymnasium = pytest.importorskip("mo_gymnasium")
    from gymnasium.utils import env_checker
    from mo_gymnasium.wrappers import LinearReward, MORecordEpisodeStatistics

    weights = np.array(WEIGHTS)
    env = LinearReward(mo_gymnasium.make(name, vector_reward=True), weight=weights)
    monkeypatch.setattr(
        env_checker, "data_shares_objects", lambda *_: False
    )  # LinearReward's weights
    env_checker.check_env(env, skip_render_check=True)
    recorded = MORecordEpisodeStatistics(mo_gymnasium.make(name, vector_reward=True), gamma=1.0)
    space = env.unwrapped.reward_space
    env.reset(seed=1)
    recorded.reset(seed=1)
    total = np.zeros(5)
    over = False
    action = np.zeros(env.action_space.shape, np.float32)
    while not over:
        reward, info = env.step(action)[1::3]
        _, vector, terminated, truncated, last = recorded.step(action)
        assert vector in space
        assert reward == pytest.approx(vector @ weights)
        np.testing.assert_array_equal(info["vector_reward"], vector)
        np.testing.assert_array_equal(info["costs"], -vector)
        total += vector
        over = terminated or truncated
    np.testing.assert_allclose(last["episode"]["r"], total, rtol=1e-5)


def test_linear_lanes_are_those_of_weighted_costs() -> None:
    pytest.importorskip("mo_gymnasium")
    linear = study.make_linear_lanes("ActiveGap-v0", WEIGHTS, 2)
    weighted = make_weighted_lanes(NAME, 2, WEIGHTS, {"threads": 1})
    for lanes in (linear, weighted):
        lanes.seed(3)
    np.testing.assert_array_equal(linear.reset(), weighted.reset())
    for action in np.random.default_rng(0).uniform(-1, 1, (4, 2, 1)).astype(np.float32):
        observed, rewards, *_ = linear.step(action)
        others, paid, *_ = weighted.step(action)
        np.testing.assert_array_equal(observed, others)
        np.testing.assert_allclose(rewards, paid, rtol=1e-5)
    linear.close()
    weighted.close()
