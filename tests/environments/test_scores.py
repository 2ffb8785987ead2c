"""Rewards add up to what the paper measures: against `simulate` and closed forms."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import GAP, PASSIVE, RUBBING, SWEEP, actions, make

from impact_env import Drive, FrequencySchedule, simulate
from impact_env.envs.reference import passage

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


def test_rewards_add_up_to_the_score_which_is_the_papers_level() -> None:
    """Against `simulate` on the schedule that the actions made, and the closed form of the same passage at the paper's rate."""
    env = gymnasium.make(
        SWEEP, interval=5.0, limits=(0.965, 0.985), rates=(1.0, 10.0), direction="up", force=0.9, time_price=0.03, raw_state=True, **RUBBING
    )
    _, info = env.reset(seed=4)
    phase = env.unwrapped.task.runs.orders["phase"][0]
    times, ratios, rewards, end = [0.0], [info["frequency_ratio"]], [], False
    while not end:
        _, reward, end, cut, info = env.step(env.action_space.sample())
        assert not cut
        times.append(info["time"])
        ratios.append(info["frequency_ratio"])
        rewards.append(reward)
    scene = env.unwrapped.task.settings.scene
    omega = scene.model.resonance_omega(1)
    schedule = FrequencySchedule(np.array(times) * 2 * np.pi / omega, np.array(ratios) * omega, omega)
    response = simulate(scene, Drive(0.9, schedule, phase))
    assert ratios[-1] == 0.985
    assert info["level"] == pytest.approx(response.level.value, rel=1e-9)
    reference, _ = passage(scene, 1, 0.965, 0.985, 32, 0.0, 1e-3)
    score = -response.level.value / (0.9 * reference) - 0.03 * times[-1] / 100
    assert sum(rewards) == pytest.approx(score, rel=1e-9)
    assert info["score"] == pytest.approx(sum(rewards), rel=1e-14)  # from 3.12 on Python sums with less rounding
    assert -info["score"] == pytest.approx(info["relative_level"] + 0.03 * times[-1] / 100, rel=1e-12)
    assert len(rewards) > 5


def test_reference_is_the_beam_without_absorber_at_the_papers_rate() -> None:
    from impact_env import Beam, beam_scene, linear_sweep

    scene = beam_scene(Beam(modes=2))
    for ends in ((0.96, 0.98), (0.98, 0.96)):
        alone = simulate(scene, Drive(1.0, linear_sweep(scene.model.resonance_omega(1), *ends)))
        assert passage(scene, 1, *ends, 32, 0.0, 1e-3)[0] == pytest.approx(alone.level.value, rel=1e-9)


def test_fatigue_adds_up_to_the_damage_of_the_samples() -> None:
    """Without an absorber, at the paper's rate, the passage is its own reference but for the force's phase at the start."""
    env = gymnasium.make(PASSIVE, absorber="none", modes=2, limits=(0.95, 0.96), objective="fatigue", fatigue_exponent=4.0, force=2.0)
    env.reset(seed=0)
    env.unwrapped.task.runs.orders["phase"] = 0.0
    total, end = 0.0, False
    while not end:
        _, reward, end, _, info = env.step(0)
        total += reward
    assert total == pytest.approx(-1.0, rel=1e-9)
    assert info["relative_damage"] == pytest.approx(1.0, rel=1e-9)


def test_gap_score_is_the_mean_relative_response() -> None:
    env = make(GAP, frequency_ratio=0.99, time_budget=100.0)
    env.reset(seed=8)
    model, omega = env.unwrapped.task.settings.scene.model, env.unwrapped.task.settings.omega
    terms = model.force_shape * model.tip_shape / (model.omega**2 - (0.99 * omega) ** 2 + 2j * model.damping_ratio * model.omega * 0.99 * omega)
    amplitude = abs(np.sum(terms))
    total, shares, end, forces = 0.0, [], False, set()
    while not end:
        _, reward, _, end, info = env.step(env.action_space.sample())
        total += reward
        shares.append(info["rms"] / (info["force"] * amplitude / np.sqrt(2)))
        forces.add(info["force"])
    assert total == pytest.approx(-np.mean(shares), rel=1e-9)
    assert len(shares) == 20
    assert len(forces) > 2


def test_cavity_does_not_close_onto_the_absorber() -> None:
    env = make(GAP, force=4.0, interval=0.5, time_budget=50.0, hold=(100, 100), raw_state=True)
    env.reset(seed=0)
    shape = env.unwrapped.task.settings.scene.model.tip_shape
    seen = set()
    for action in actions(GAP, 99, 1)[:, 0]:
        *_, info = env.step(action)
        wanted = 0.1e-3 + 0.5 * (float(action[0]) + 1) * (3e-3 - 0.1e-3)
        distance = abs(info["state"][2] - shape @ info["state"][:2])
        assert distance <= info["gap"] * (1 + 1e-9)
        assert info["gap"] >= wanted
        assert info["gap_limited"] == (info["gap"] > wanted)
        seen.add(info["gap_limited"])
    assert seen == {True, False}
