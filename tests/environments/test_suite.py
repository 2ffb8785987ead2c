"""The suite in which feedback pays: rules, demonstrations, agents with memory, clones and short trainings that beat haste."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("cmaes")

from impact_env.envs import ENVIRONMENTS
from impact_env.parameters import ParameterError
from optimisation.rl.agents import Agent, Memory, load_agent, save_agent
from optimisation.rl.baselines import TUNED, families, load, policy
from optimisation.rl.ceiling import best_by_luck
from optimisation.rl.demonstrations import fingerprint, read_demonstrations, record, write_demonstrations
from optimisation.rl.families import Rates, policy_of
from optimisation.rl.friction_rules import LimitByLook, LimitScale
from optimisation.rl.passage_rules import BlindTries, TryAgain
from optimisation.rl.play import ADAPTIVE, DELAYED, FRICTION, PASSAGE, play
from optimisation.rl.policies import Constant
from optimisation.rl.tasks.baseline import BEST_LIMIT, BEST_PAIR, BEST_SCHEDULE, FEEDBACK, KNOTTED, ORACLE, WINDOWED, Baseline
from optimisation.rl.tasks.table import FIRST, SUITE, TASKS
from optimisation.rl.tasks.task import Task

FRESH = range(7_000_000, 7_000_192)  # neither trained, tuned nor judged on
RATES = Rates(0.05, 4.0, 0.93, 1.03, 4.0, 0.98, 0.0125)
WAY = [0.9, 0.8, 0.5, 0.5, 0.1, 0.35, -0.6]  # entry 1.02 to 1.01, slow from 0.98, back at 0.965
# Bounds on means over seeds lie six of their standard deviations off, as found with six eigenbases that differ by rounding.
pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")


def seen(ratio: float, impacts: float, left: float = 1.0) -> np.ndarray:
    row = np.zeros((1, 10), dtype=np.float32)
    row[0, 6], row[0, 4], row[0, 7] = (ratio - 0.98) / 0.0125, impacts, left
    return row


def test_the_feedback_rule_waits_goes_back_and_leaves_when_impacts_have_stopped() -> None:
    rule = policy_of("rule", TryAgain(RATES), [*WAY, 2.0, 0.1])
    rule.start(1)
    way = [(1.025, 1.0, 1.0), (1.015, 0.5, 1.0), (1.0, 1.0, 1.0), (0.975, 0.1, 1.0), (0.96, -0.6, 1.0), (0.96, 1.0, 0.05)]
    for ratio, expected, left in way:
        assert rule.act(seen(ratio, 0.8, left))[0, 0] == pytest.approx(expected)
    assert rule.act(seen(0.975, 0.0))[0, 0] == pytest.approx(0.1)  # one interval without impacts is not enough
    assert rule.act(seen(0.974, 0.0))[0, 0] == 1.0
    assert rule.act(seen(0.973, 0.9))[0, 0] == pytest.approx(0.1)
    rule.start(1)
    assert rule.act(seen(0.975, 0.0))[0, 0] == pytest.approx(0.1)  # what was seen before is forgotten


def test_blind_tries_count_and_do_not_look() -> None:
    rule = policy_of("rule", BlindTries(RATES), [*WAY, 2.0])
    rule.start(1)
    acts = [float(rule.act(seen(ratio, impacts))[0, 0]) for impacts in (0.0, 1.0) for ratio in (0.975, 0.96, 0.96, 0.972)]
    np.testing.assert_allclose(acts, [0.1, -0.6, -0.6, 0.1, 0.1, -0.6, 1.0, 1.0], rtol=1e-6)


def test_rates_that_go_back_belong_to_their_actions() -> None:
    np.testing.assert_allclose(RATES.rate(np.array([-1.0, -0.25, 0.0, 0.5, 1.0])), [-4.0, -1.0, 0.05, np.sqrt(0.2), 4.0])
    np.testing.assert_allclose(RATES.action(np.array([0.05, 4.0])), [0.0, 1.0], atol=1e-12)
    env = gymnasium.make(PASSAGE, direction="up")
    start = env.reset(seed=0)[1]["frequency_ratio"]
    ratios = [start, *(env.step(np.array([a], np.float32))[-1]["frequency_ratio"] for a in (0.5, -0.25))]
    np.testing.assert_allclose(np.diff(ratios) / 25e-4, [np.sqrt(0.2), -np.sqrt(0.2)], rtol=1e-6)  # no further back than to the start


def stored(task: str) -> dict[str, Any]:
    baselines, arguments = load(TUNED / f"{task}_baselines.json", task)
    kinds = families(task, arguments)
    return {baseline.name: policy(baseline, kinds) for baseline in baselines}


def test_on_the_passage_the_stored_rule_beats_the_schedule_which_beats_haste() -> None:
    rules = stored("passage")
    scores = {name: play(rules[name], PASSAGE, FRESH).scores for name in (FEEDBACK, BEST_SCHEDULE)}
    haste = play(Constant(1.0), PASSAGE, FRESH).scores
    assert -0.637 < haste.mean() < -0.597  # 1,024 seeds: -0.617
    assert 0.0 < (scores[FEEDBACK] - scores[BEST_SCHEDULE]).mean() < 0.12
    assert 0.04 < (scores[BEST_SCHEDULE] - haste).mean() < 0.16


def test_with_rate_and_gap_looking_beats_the_schedule_which_beats_constants() -> None:
    rules = stored("adaptive")
    names = (ORACLE, FEEDBACK, BEST_SCHEDULE, BEST_PAIR)
    means = {name: play(rules[name], ADAPTIVE, FRESH).scores.mean() for name in names}
    for name, low, high in ((ORACLE, -0.19, -0.14), (FEEDBACK, -0.185, -0.16), (BEST_SCHEDULE, -0.265, -0.22), (BEST_PAIR, -0.52, -0.41)):
        assert low < means[name] < high, name
    assert means[FEEDBACK] > means[BEST_SCHEDULE] > means[BEST_PAIR]


def test_the_rule_of_the_friction_limit_looks_once_and_remembers() -> None:
    behind = gymnasium.make(FRICTION).unwrapped.task
    scale = LimitScale(behind)
    low, high = behind.limits
    rule = policy_of("rule", LimitByLook(scale), [0.9, 0.5, 0.0, 1.0, 0.0])
    rule.start(2)
    way = [(1.03, 0.0, 0.0), (0.99, 0.1, 0.2), (0.979, 0.3, 0.6), (0.95, 5.0, 7.0)]
    acts = []
    for ratio, *amplitudes in way:
        rows = np.zeros((2, 11), np.float32)
        rows[:, 6], rows[:, 0], rows[:, 1] = (ratio - 1) / 0.1, 0.6 * np.array(amplitudes), 0.8 * np.array(amplitudes)
        acts.append(rule.act(rows)[:, 0])
    np.testing.assert_allclose(acts[:2], 0.9, rtol=1e-6)
    np.testing.assert_array_equal(acts[3], acts[2])
    limits = low * (high / low) ** (0.5 * (acts[2].astype(np.float64) + 1))
    np.testing.assert_allclose(limits, np.sqrt(low * high) * np.array([0.3, 0.6]), rtol=1e-5)  # in proportion to what was seen
    rule.start(2)
    rows[:, 6], rows[:, :2] = 0.3, 0.0
    np.testing.assert_allclose(rule.act(rows), 0.9, rtol=1e-6)  # what was seen before is forgotten


def test_with_the_friction_limit_looking_beats_the_schedule_which_hardly_beats_a_constant() -> None:
    rules = stored("friction")
    names = (FEEDBACK, BEST_SCHEDULE, BEST_LIMIT)
    scores = {name: play(rules[name], FRICTION, FRESH).scores for name in names}
    for name, low, high in ((FEEDBACK, -0.46, -0.41), (BEST_SCHEDULE, -0.64, -0.56), (BEST_LIMIT, -0.65, -0.58)):
        assert low < scores[name].mean() < high, name
    assert (scores[FEEDBACK] - scores[BEST_SCHEDULE]).mean() > 0.1


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_the_table_names_what_a_task_has(task: Task) -> None:
    assert set(TASKS) == set(SUITE) | set(FIRST)
    assert TASKS[task.name] is task
    names = stored(task.name)
    assert set(task.yardsticks) | set(task.marked) <= set(names)
    assert set(task.figure.shown) <= {*names, WINDOWED, KNOTTED}  # of these two schedules the better one has another name
    if task.luck is None:
        with pytest.raises(ParameterError, match=f"task = '{task.name}' is not allowed"):
            best_by_luck(task.name, range(2), {})
    else:
        assert len(task.luck.bounds) == len(families(task.name, {})[task.luck.kind].names)


def test_luck_grows_with_the_number_of_schedules() -> None:
    for task in ("adaptive", "friction"):
        few, more = (best_by_luck(task, range(4), {}, draws) for draws in (2, 12))
        assert few.shape == (4,)
        assert more.mean() > few.mean()


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_the_other_checker_and_another_library_take_every_name(name: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(name).unwrapped, warn=False)
    wrappers = pytest.importorskip("skrl.envs.wrappers.torch")
    torch = pytest.importorskip("torch")
    env = wrappers.wrap_env(gymnasium.make_vec(name, num_envs=3), wrapper="gymnasium")
    env.reset()
    for _ in range(3):
        actions = np.stack([np.atleast_1d(env.action_space.sample()) for _ in range(3)])
        observations, rewards, *_ = env.step(torch.as_tensor(actions))
        assert observations.shape == (3, env.observation_space.shape[0])
        assert bool(torch.isfinite(rewards).all())


def test_demonstrations_are_what_was_played_and_come_back_from_their_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    monkeypatch.chdir(tmp_path)
    rule = policy(Baseline("rule", "feedback", (*WAY, 2.0, 0.1)), families("passage", {"time_budget": 600.0}))
    brief = {"time_budget": 600.0}
    shown = record(rule, PASSAGE, range(5), brief)
    np.testing.assert_allclose([r.sum() for r in shown.rewards], play(rule, PASSAGE, range(5), brief).scores, rtol=1e-12)
    env = gymnasium.make(PASSAGE, **brief)
    for seed in range(5):  # each is the single environment's episode
        np.testing.assert_array_equal(env.reset(seed=seed)[0], shown.observations[seed][0])
        for observation, action, reward in zip(shown.observations[seed][1:], shown.actions[seed], shown.rewards[seed], strict=True):
            found, earned, terminated, truncated, _ = env.step(action)
            np.testing.assert_array_equal(found, observation)
            assert earned == reward
        assert terminated == shown.terminated[seed]
        assert terminated or truncated
    write_demonstrations(Path("sets/rule-v0"), shown, "rule", brief)  # a relative path, as that of the command
    assert fingerprint(read_demonstrations(Path("sets/rule-v0"), PASSAGE)) == fingerprint(shown)
    write_demonstrations(tmp_path / "rule-v0", shown, "rule", brief)
    again = read_demonstrations(tmp_path / "rule-v0", PASSAGE)
    assert fingerprint(again) == fingerprint(shown)
    assert again.terminated == shown.terminated
    with pytest.raises(ParameterError, match="a data set of"):
        read_demonstrations(tmp_path / "rule-v0", ADAPTIVE)
    with pytest.raises(ParameterError, match="record_demonstrations"):
        read_demonstrations(tmp_path / "none-v0", PASSAGE)
    with pytest.raises(ParameterError, match="which ends in -v0"):
        write_demonstrations(tmp_path / "rule", shown, "rule", brief)
    with pytest.raises(ParameterError, match="one that sees what an agent sees"):
        record(stored("adaptive")[ORACLE], ADAPTIVE, range(2))


def trained(algorithm: str, env_id: str, seed: int = 0, **given: Any) -> tuple[Any, Any]:
    from optimisation.rl.hyperparameters import settings_for
    from optimisation.rl.models import begin_leg, make_lanes, make_model

    chosen = settings_for(env_id, algorithm, None, **given)
    env = make_lanes(env_id, chosen, {}, 1)
    model = make_model(chosen, env, seed)
    begin_leg(model, seed, 0, chosen.learning_rate)
    return model, chosen


def test_an_agent_with_memory_acts_as_its_model_does(tmp_path: Path) -> None:
    pytest.importorskip("sb3_contrib")
    from optimisation.rl.agents import actor_of

    model, _ = trained("rppo", DELAYED, lanes=4, n_steps=32, batch_size=64)
    model.learn(128)
    save_agent(tmp_path / "agent.npz", actor_of(model, DELAYED, 0, {}))
    agent = load_agent(tmp_path / "agent.npz")
    agent.start(3)
    observations = np.random.default_rng(0).normal(size=(6, 3, 10)).astype(np.float32)
    states, start = None, np.ones(3, dtype=bool)
    for row in observations:
        expected, states = model.predict(row, state=states, episode_start=start, deterministic=True)
        start[:] = False
        np.testing.assert_allclose(agent.act(row), expected, atol=2e-6)
    agent.start(3)
    first = agent.act(observations[-1])
    agent.start(3)
    np.testing.assert_array_equal(agent.act(observations[-1]), first)  # nothing is left of what was seen before
    with pytest.raises(ParameterError, match="a memory that fits"):
        Agent(PASSAGE, "rppo", 0, 1, {}, "tanh", "clip", [(np.zeros((1, 3), np.float32), np.zeros(1, np.float32))], Memory(agent.cells).cells)


def test_imitation_does_in_each_situation_what_was_shown() -> None:
    pytest.importorskip("stable_baselines3")
    from optimisation.rl.agents import actor_of
    from optimisation.rl.cloning import imitate

    shown = record(stored("adaptive")[FEEDBACK], ADAPTIVE, range(1000, 1024))
    for algorithm in ("ppo", "sac"):
        model, _ = trained(algorithm, ADAPTIVE, **({"lanes": 8, "batch_size": 64} if algorithm == "ppo" else {"lanes": 8, "buffer_size": 1000}))
        error = imitate(model, shown, seed=0, epochs=15)
        assert error < 0.25 * np.var(np.concatenate(shown.actions), axis=0).mean()
        score = play(actor_of(model, ADAPTIVE, 0, {}), ADAPTIVE, range(40)).scores.mean()
        assert score > -0.38  # the best constant pair: -0.465; the rule remembers, so one step of it cannot be copied exactly


def test_a_clone_of_the_rule_beats_haste_and_updates_improve_what_they_are_to_improve() -> None:
    """On one batch: PPO's clipped objective, which begins at zero, and the error of the values."""
    pytest.importorskip("stable_baselines3")
    import torch

    from optimisation.rl.agents import actor_of
    from optimisation.rl.cloning import imitate

    model, chosen = trained("ppo", PASSAGE, learning_rate=1e-4)
    imitate(model, record(stored("passage")[FEEDBACK], PASSAGE, range(1000, 1256)), seed=0, epochs=15)
    gain = play(actor_of(model, PASSAGE, 0, {}), PASSAGE, FRESH).scores - play(Constant(1.0), PASSAGE, FRESH).scores
    assert gain.mean() > 0.06  # 0.130 to 0.153 over four ways to shuffle; the rule: 0.16
    model.learn(1)  # collects the batch, and updates once
    for _ in range(2):
        model.train()
    batch = next(model.rollout_buffer.get(None))
    advantages = (batch.advantages - batch.advantages.mean()) / batch.advantages.std()
    with torch.no_grad():
        values, probability, _ = model.policy.evaluate_actions(batch.observations, batch.actions)
    ratio = torch.exp(probability - batch.old_log_prob)
    objective = torch.min(ratio * advantages, torch.clamp(ratio, 1 - chosen.clip_range, 1 + chosen.clip_range) * advantages).mean()
    errors = [float(((some - batch.returns) ** 2).mean()) for some in (batch.old_values, values[:, 0])]
    assert objective > 4e-4  # 0.0020 to 0.0027 over four seeds
    assert errors[1] < 0.85 * errors[0]  # 0.58 to 0.63


@pytest.mark.nightly
def test_short_trainings_beat_haste() -> None:
    """PPO from scratch, a third of its steps: most of the way from haste to the feedback rule, on seeds that nobody saw.

    One of three seeds gains 0.14, give or take 0.025 by how soon it turns: a false alarm is seven standard deviations away.
    """
    pytest.importorskip("stable_baselines3")
    from optimisation.rl.agents import actor_of

    haste, gains = play(Constant(1.0), PASSAGE, FRESH).scores.mean(), []
    for seed in range(3):
        model, _ = trained("ppo", PASSAGE, seed, steps=200000)
        model.learn(200000)
        gains.append(play(actor_of(model, PASSAGE, seed, {}), PASSAGE, FRESH).scores.mean() - haste)
    assert np.mean(gains) > 0.03
