"""Methods of training that are compared: how they start, what is paid, and what a table says of them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from impact_env.envs.evaluation import play
from optimisation.rl.rules import EIGHT, env_of, policies
from studies import training_methods as methods
from studies import training_runs as runs
from studies.cli import compare_training as study
from studies.study import Measurement

GAP = "ActiveGap-v0"
RESIDUAL = [
    name
    for name, method in methods.METHODS.items()
    if method.algorithm not in (methods.ITERATION, methods.PLANNER)
]


@pytest.fixture
def few_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, method in methods.METHODS.items():
        small = replace(method, lanes=16)
        monkeypatch.setitem(methods.METHODS, name, small)


class FixedRewards:
    """Lanes whose rewards and ends of episodes are given, step by step."""

    num_envs = 2
    observation_space = action_space = None

    def __init__(self, rewards: Any, over: Any) -> None:
        self.steps = iter(zip(rewards, over, strict=True))

    def reset(self) -> Any:
        return np.zeros((2, 1), np.float32)

    def step_wait(self) -> Any:
        rewards, over = next(self.steps)
        return np.zeros((2, 1), np.float32), rewards, over, [{}, {}]


def test_rewards_that_are_spread_pay_all_by_the_end_of_the_episode() -> None:
    generator = np.random.default_rng(0)
    rewards = generator.normal(size=(9, 2)).astype(np.float32)
    over = np.zeros((9, 2), bool)
    over[5, 0] = over[8] = True
    lanes = runs.SpreadRewards.__new__(runs.SpreadRewards)
    lanes.venv = FixedRewards(rewards, over)
    lanes._due = np.zeros((4, 2), np.float32)
    lanes.reset()
    paid = np.array([lanes.step_wait()[1] for _ in range(9)])
    np.testing.assert_allclose(paid[3, 1], rewards[:4, 1].mean(), rtol=1e-5)
    np.testing.assert_allclose(paid[4, 1], rewards[1:5, 1].mean(), rtol=1e-5)
    np.testing.assert_allclose(paid[:6, 0].sum(), rewards[:6, 0].sum(), rtol=1e-5)
    np.testing.assert_allclose(paid[6:, 0].sum(), rewards[6:, 0].sum(), rtol=1e-5)
    np.testing.assert_allclose(paid[:, 1].sum(), rewards[:, 1].sum(), rtol=1e-5)


@pytest.mark.usefixtures("few_lanes")
@pytest.mark.parametrize("name", RESIDUAL)
def test_a_method_starts_at_the_rule(name: str) -> None:
    model = runs.make_residual_model(GAP, methods.METHODS[name], 0)
    policy = runs.RuleAndNetwork(model, policies(GAP)[EIGHT], methods.METHODS[name].frames)
    rule = policies(GAP)[EIGHT]
    observed = np.random.default_rng(0).uniform(-1, 1, (3, 11)).astype(np.float32)
    policy.start(3)
    rule.start(3)
    np.testing.assert_allclose(policy.act(observed), rule.act(observed), atol=0.02)
    model.get_env().close()


@pytest.mark.usefixtures("few_lanes")
@pytest.mark.parametrize("name", ["PPO, last 4 observations", "recurrent PPO"])
def test_a_policy_acts_as_its_model_does_in_the_lanes_of_training(name: str) -> None:
    """The lanes add the rule's action to the model's; the policy does both itself, with the memory that the model has."""
    method = methods.METHODS[name]
    model = runs.make_residual_model(GAP, method, 0)
    with runs.torch.no_grad():
        model.policy.action_net.weight *= 100.0  # more than nothing
    lanes: Any = model.get_env()
    ordered = []
    inner = lanes.unwrapped.venv if hasattr(lanes.unwrapped, "venv") else lanes.unwrapped
    step = inner.step

    def note(actions: Any) -> Any:
        ordered.append(np.array(actions))
        return step(actions)

    inner.step = note
    policy = runs.RuleAndNetwork(model, policies(GAP)[EIGHT], method.frames)
    policy.start(16)
    frames = lanes.reset()
    state = None
    fresh = np.ones(16, bool)
    for _ in range(6):
        width = frames.shape[1] // method.frames
        acts = policy.act(frames[:, -width:])
        added, state = model.predict(frames, state, fresh, deterministic=True)
        fresh[:] = False
        frames = lanes.step(added)[0]
        np.testing.assert_allclose(ordered[-1], acts, atol=1e-6)
    assert np.ptp(added) > 0.01
    lanes.close()


@pytest.mark.usefixtures("few_lanes")
@pytest.mark.parametrize("name", ["PPO, last 4 observations", "policy iteration over 12 intervals"])
def test_a_training_is_evaluated_in_its_time_and_after_its_steps(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(map(float, range(1000)))
    monkeypatch.setattr(runs, "time", SimpleNamespace(process_time=lambda: next(clock)))
    monkeypatch.setattr(runs, "apply_start", lambda *_: None)  # a clone takes seconds
    effort = methods.TrainingEffort(seconds=4.0, evaluations=2, episodes=4, steps=1000)
    row = runs.train_method(GAP, name, 0, effort)
    seeds = range(1_000_000, 1_000_004)
    rule = play(policies(GAP)[EIGHT], env_of(GAP), seeds).scores
    assert row["rule"] == pytest.approx(rule.mean(), abs=1e-6)
    scores = [point["score"] for point in row["points"]]
    assert row["over_rule"][0] == pytest.approx(max(scores) - rule.mean(), abs=2e-6)
    assert [p["seconds"] for p in row["points"]] == [2.0, 3.0, 4.0][-len(scores) :]
    assert row["over_rule_steps"] == pytest.approx(scores[0] - rule.mean(), abs=2e-6)
    assert row["points"][0]["at_steps"]


@pytest.mark.usefixtures("few_lanes")
@pytest.mark.parametrize("name", ["CrossQ, 256 lanes", "recurrent PPO"])
def test_the_critic_is_trained_alone_at_first(name: str) -> None:
    model = runs.make_residual_model(GAP, methods.METHODS[name], 0)
    runs.train_actor_too(model, False)
    trained = {n for n, values in model.policy.named_parameters() if values.requires_grad}
    assert trained
    assert all("critic" in name or "value_net" in name for name in trained)
    runs.train_actor_too(model, True)
    assert all(values.requires_grad for values in model.policy.parameters())
    model.get_env().close()


def test_the_planner_is_imitated_where_it_acted(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded: list[Any] = []

    def plan(*_: Any, record: Any) -> None:
        observed = np.random.default_rng(len(recorded)).uniform(-1, 1, (800, 11))
        recorded.append(observed)
        record(observed.astype(np.float32), 0.5 * observed[:, :1])

    monkeypatch.setattr(runs, "plan", plan)
    loop = runs.start_imitation(GAP, methods.METHODS["imitation of the robust planner"], 0)
    for share in (0.0, 0.5, 0.9, 0.95):
        loop.advance(share)
    assert len(recorded) == 2
    assert loop.count_steps() == 1600 * (1 + 11 * 4 * 12)
    observed = np.random.default_rng(9).uniform(-1, 1, (50, 11)).astype(np.float32)
    np.testing.assert_allclose(loop.policy().act(observed), 0.5 * observed[:, :1], atol=0.1)


def test_the_table_has_the_best_and_the_last_of_each_training() -> None:
    row = {
        "task": GAP,
        "method": "PPO",
        "seed": 0,
        "rule": -0.4,
        "points": [{"steps": 10, "seconds": 1.0, "score": -0.37, "at_steps": True}]
        + [{"steps": 2000, "seconds": 2.0, "score": -0.42, "at_steps": False}],
        "over_rule": [0.03, 0.02, 0.04],
        "over_rule_steps": None,
    }
    effort = {"seconds": 2.0, "steps": 10, "evaluations": 2, "episodes": 16}
    text = study.make_table(Measurement({"rows": [row], "effort": effort}))
    (line,) = (line for line in text.splitlines() if GAP in line)
    assert [cell.strip() for cell in line.split("|")][4:8] == [
        "2,000",
        "-",
        "+0.030 [+0.020, +0.040]",
        "-0.020",
    ]
