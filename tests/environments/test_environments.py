from __future__ import annotations

import json
import pickle
import subprocess
import sys
import warnings
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

from impact_env import Drive, FrequencySchedule, ParameterError, simulate  # noqa: E402
from impact_env.envs import ENVIRONMENTS, register_environments  # noqa: E402
from impact_env.envs.reference import passage  # noqa: E402

SWEEP, GAP, PASSIVE, V1, NOISY, DELAYED, ADAPTIVE, FRICTION = ENVIRONMENTS
pytestmark = pytest.mark.filterwarnings("ignore:.*SweepRate-v0 is out of date")  # gymnasium says so of everything with a later version
RUBBING = {"modes": 2, "absorber_options": {"friction_limit": 0.025}}  # one kind of scene for most tests: one kernel to compile
SHORT = {
    SWEEP: RUBBING | {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "force": (1.0, 2.0), "time_budget": 60.0},
    GAP: {"hold": (10.0, 30.0), "time_budget": 60.0, "force": (1.0, 6.0), "frequency_ratio": (0.97, 1.03)} | RUBBING,
    PASSIVE: {"limits": (0.96, 0.98), "rate": 4.0, "direction": "random", "force": (1.0, 2.0)} | RUBBING,
}
BRIEF = {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0}
SHORT |= dict.fromkeys((V1, NOISY, DELAYED), BRIEF) | {ADAPTIVE: BRIEF | RUBBING}
SHORT |= {FRICTION: {"limits": (0.96, 0.98), "direction": "random", "friction_range": (0.01, 5.0)}}
SCENES = list(SHORT.items())


def make(name: str, **arguments: Any) -> Any:
    return gymnasium.make(name, **(SHORT[name] | arguments))


def vector(name: str, lanes: int, **arguments: Any) -> Any:
    return gymnasium.make_vec(name, num_envs=lanes, **(SHORT[name] | arguments))


def actions(name: str, steps: int, lanes: int) -> np.ndarray:
    if name == PASSIVE:
        return np.zeros((steps, lanes), dtype=np.int64)
    return np.random.default_rng(5).uniform(-1, 1, (steps, lanes, 2 if name == ADAPTIVE else 1)).astype(np.float32)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_has_nothing_to_say(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*SweepRate-v0 is out of date")
        check_env(make(name).unwrapped, skip_render_check=True)
        check_env(make(name, render_mode="rgb_array", raw_state=True, observation_noise=0.1, observation_delay=2).unwrapped)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_spec_and_environment_can_be_written_and_read(name: str) -> None:
    first = make(name)
    spec = gymnasium.envs.registration.EnvSpec.from_json(first.spec.to_json())
    again = [gymnasium.make(spec), gymnasium.make(pickle.loads(pickle.dumps(first.spec)))]
    first.reset(seed=3)
    expected = [first.step(action[0]) for action in actions(name, 4, 1)]
    for env in again:
        env.reset(seed=3)
        for action, result in zip(actions(name, 4, 1), expected, strict=True):
            np.testing.assert_array_equal(env.step(action[0])[0], result[0])


def test_a_running_environment_can_be_pickled() -> None:
    env = make(SWEEP).unwrapped
    env.reset(seed=1)
    env.step(np.zeros(1, np.float32))
    copy = pickle.loads(pickle.dumps(env))
    a, b = env.step(np.ones(1, np.float32)), copy.step(np.ones(1, np.float32))
    np.testing.assert_array_equal(a[0], b[0])
    assert a[1:] == b[1:]


@pytest.mark.parametrize("extra", [{}, {"observation_noise": 0.05, "observation_delay": 2, "raw_state": True}])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_lane_is_the_single_environment_bit_for_bit(name: str, extra: dict[str, Any]) -> None:
    """Through several episodes, with autoreset: observations, rewards, ends, final observations and all info."""
    lanes, steps = 5, 40
    many, singles = vector(name, lanes, **extra), [make(name, **extra) for _ in range(lanes)]
    observations, infos = many.reset(seed=11)
    for lane, env in enumerate(singles):
        observation, info = env.reset(seed=11 + lane)
        np.testing.assert_array_equal(observations[lane], observation)
        assert_info(infos, lane, info)
    ends = 0
    for action in actions(name, steps, lanes):
        observations, rewards, terminated, truncated, infos = many.step(action)
        for lane, env in enumerate(singles):
            observation, reward, end, cut, info = env.step(action[lane])
            assert (rewards[lane], terminated[lane], truncated[lane]) == (reward, end, cut)
            if end or cut:
                ends += 1
                assert infos["_final_obs"][lane]
                assert infos["_final_info"][lane]
                np.testing.assert_array_equal(infos["final_obs"][lane], observation)
                assert_info(infos["final_info"], lane, info)
                observation, info = env.reset()
            elif "final_obs" in infos:
                assert not infos["_final_obs"][lane]
                assert infos["final_obs"][lane] is None
                assert not infos["final_info"]["_score"][lane]
            np.testing.assert_array_equal(observations[lane], observation)
            assert_info(infos, lane, info)
    assert ends > lanes


def assert_info(infos: dict[str, Any], lane: int, info: dict[str, Any]) -> None:
    for name, value in info.items():
        assert infos[f"_{name}"][lane]
        np.testing.assert_array_equal(infos[name][lane], value)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_native_vector_agrees_with_gymnasiums_own(name: str) -> None:
    """The same keys, masks and numbers as SyncVectorEnv with the same autoreset."""
    lanes = 3
    own = gymnasium.make_vec(
        name, num_envs=lanes, vectorization_mode="sync", vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}, **SHORT[name]
    )
    native = vector(name, lanes)
    assert native.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert native.single_observation_space == own.single_observation_space
    assert native.action_space == own.action_space
    np.testing.assert_array_equal(native.reset(seed=2)[0], own.reset(seed=2)[0])
    for action in actions(name, 20, lanes):
        a, b = native.step(action), own.step(action)
        for mine, theirs in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(mine, theirs)
        assert set(a[4]) == set(b[4])
        for key, values in b[4].items():
            if key == "final_info":
                assert set(a[4][key]) == set(values)
            elif key == "final_obs":
                assert [row is None for row in a[4][key]] == [row is None for row in values]
            else:
                np.testing.assert_array_equal(a[4][key], values)
                assert np.asarray(a[4][key]).dtype == np.asarray(values).dtype


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
    assert response.level is not None
    assert ratios[-1] == 0.985
    assert info["level"] == pytest.approx(response.level.value, rel=1e-9)
    reference, _ = passage(scene, 1, 0.965, 0.985, 32, 0.0, 1e-3)
    score = -response.level.value / (0.9 * reference) - 0.03 * times[-1] / 100
    assert sum(rewards) == pytest.approx(score, rel=1e-9)
    assert info["score"] == sum(rewards)
    assert -info["score"] == pytest.approx(info["relative_level"] + 0.03 * times[-1] / 100, rel=1e-12)
    assert len(rewards) > 5


def test_reference_is_the_beam_without_absorber_at_the_papers_rate() -> None:
    from impact_env import Beam, beam_scene, linear_sweep

    scene = beam_scene(Beam(modes=2))
    for ends in ((0.96, 0.98), (0.98, 0.96)):
        alone = simulate(scene, Drive(1.0, linear_sweep(scene.model.resonance_omega(1), *ends)))
        assert alone.level is not None
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


def test_backward_rates_go_back_but_not_beyond_the_start() -> None:
    env = make(SWEEP, direction="up", backward_rate=10.0, time_budget=500.0)
    env.reset(seed=0)
    there = [env.step(np.array([action], np.float32))[4]["frequency_ratio"] for action in (0.0, 0.5, -0.5, -1.0, -1.0, 0.0)]
    assert there[0] == pytest.approx(0.96 + 5 * 2e-4)
    assert there[1] == pytest.approx(there[0] + 5 * 1e-4 * np.sqrt(2 * 20))
    assert there[2] == pytest.approx(max(there[1] - 5 * 5e-4, 0.96))
    assert there[4] == 0.96
    assert there[5] > 0.96


def test_actions_map_to_rates_and_are_cut_to_their_limits() -> None:
    changes = []
    for action in (-5.0, -1.0, 0.0, 1.0, 7.0):
        env = make(SWEEP, direction="down", limits=(0.9, 1.0))
        env.reset(seed=0)
        changes.append((1.0 - env.step(np.array([action], np.float32))[4]["frequency_ratio"]) / 5e-4)
    np.testing.assert_allclose(changes, [2.0, 2.0, np.sqrt(40), 20.0, 20.0], rtol=1e-9)


def test_time_budget_truncates_and_the_far_end_terminates() -> None:
    slow, quick = make(SWEEP), make(SWEEP)
    for env, action in ((slow, -1.0), (quick, 1.0)):
        env.reset(seed=0)
        flags, left = (False, False), []
        while not any(flags):
            observation, _, *rest = env.step(np.array([action], np.float32))
            flags = (rest[0], rest[1])
            left.append(observation[7])
        assert flags == ((False, True) if env is slow else (True, False))
        assert np.all(np.diff(left) < 0)
        if env is slow:
            assert len(left) == 12
            assert left[-1] == 0.0


def test_a_passage_that_is_cut_off_pays_for_it_and_one_that_ends_does_not() -> None:
    for action, paid in ((-1.0, True), (1.0, False)):
        scores = []
        for price in (0.0, 0.7):
            env = make(SWEEP, unfinished_price=price)
            env.reset(seed=0)
            over = False
            while not over:
                *_, end, cut, info = env.step(np.array([action], np.float32))
                over = end or cut
            scores.append(info["score"])
        assert scores[0] - scores[1] == pytest.approx(0.7 if paid else 0.0, abs=1e-12)


def test_reset_mask_restarts_some_lanes_only() -> None:
    plain, masked = vector(SWEEP, 4), vector(SWEEP, 4)
    for env in (plain, masked):
        env.reset(seed=9)
    choice = actions(SWEEP, 6, 4)
    for action in choice[:2]:
        plain.step(action)
        before = masked.step(action)[0]
    mask = np.array([False, True, False, True])
    observations, infos = masked.reset(seed=[None, 77, None, None], options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[~mask], before[~mask])
    assert np.all(observations[mask][:, 7] == 1.0)
    np.testing.assert_array_equal(infos["_time"], mask)
    fresh = make(SWEEP)
    np.testing.assert_array_equal(fresh.reset(seed=77)[0], observations[1])
    for action in choice[2:4]:
        a, b, c = plain.step(action), masked.step(action), fresh.step(action[1])
        np.testing.assert_array_equal(a[0][~mask], b[0][~mask])
        np.testing.assert_array_equal(a[1][~mask], b[1][~mask])
        np.testing.assert_array_equal(b[0][1], c[0])


@pytest.mark.parametrize("name", [V1, ADAPTIVE])
def test_a_spent_budget_ends_the_suites_passages_and_costs(name: str) -> None:
    scores = []
    for end, price in (("terminated", 0.7), ("truncated", 0.7), ("terminated", 0.0)):
        env = make(name, budget_end=end, unfinished_price=price)
        env.reset(seed=0)
        flags, steps = (False, False), 0
        while not any(flags):
            *_, terminated, truncated, info = env.step(np.full(env.action_space.shape, -1.0, np.float32))
            flags, steps = (terminated, truncated), steps + 1
        assert flags == (end == "terminated", end == "truncated")
        assert steps == 12
        scores.append(info["score"])
    assert scores[0] == scores[1] == pytest.approx(scores[2] - 0.7)


def test_features_of_the_frequency_have_their_zero_and_unit_where_the_arguments_say() -> None:
    for arguments, origin, unit in (({}, 0.97, 0.0125), ({"frequency_origin": "resonance", "frequency_unit": 0.1}, 1.0, 0.1)):
        env = make(V1, direction="down", **arguments)
        observation, info = env.reset(seed=0)
        for _ in range(2):
            assert observation[6] == pytest.approx((info["frequency_ratio"] - origin) / unit, rel=1e-5)
            assert observation[9] == pytest.approx((0.96 - info["frequency_ratio"]) / unit, rel=1e-5)
            observation, *_, info = env.step(np.ones(1, np.float32))


def test_rate_and_gap_are_what_the_two_numbers_say() -> None:
    env = make(ADAPTIVE, direction="down", gap_limits=(0.5e-3, 2e-3), raw_state=True)
    env.reset(seed=0)
    *_, info = env.step(np.array([0.0, 0.5], np.float32))
    assert (0.98 - info["frequency_ratio"]) / 5e-4 == pytest.approx(np.sqrt(40))
    assert info["gap"] == pytest.approx(0.5e-3 * 4**0.75)
    rows = [env.step(np.array([-1.0, -1.0], np.float32)) for _ in range(6)]
    assert {row[-1]["gap_limited"] for row in rows} == {True, False} or rows[-1][-1]["gap"] == pytest.approx(0.5e-3)
    assert rows[-1][0][10] == pytest.approx(rows[-1][-1]["gap"] / 1e-3, rel=1e-6)


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impact_env.controlled.FEWEST", 1)
    results = []
    for threads in (1, 2, 7):
        env = vector(SWEEP, 9, threads=threads)
        env.reset(seed=0)
        results.append([env.step(action) for action in actions(SWEEP, 15, 9)])
        env.close()
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a[0], b[0])
            np.testing.assert_array_equal(a[1], b[1])


def test_seeds_decide_all_draws() -> None:
    env = make(SWEEP)
    draws = {}
    for seed in (0, 1, 0):
        _, info = env.reset(seed=seed)
        drawn = (info["force"], info["frequency_ratio"], env.unwrapped.task.runs.orders["phase"][0])
        assert draws.setdefault(seed, drawn) == drawn
    assert draws[0] != draws[1]
    starts = {vector(SWEEP, 16).reset(seed=0)[1]["frequency_ratio"][lane] for lane in range(16)}
    assert starts == {0.96, 0.98}


def test_noise_and_delay_touch_measured_features_only() -> None:
    clean, noisy, late = make(PASSIVE), make(PASSIVE, observation_noise=0.1), make(PASSIVE, observation_delay=2)
    seen = [[env.reset(seed=5)[0]] + [env.step(0)[0] for _ in range(5)] for env in (clean, noisy, late)]
    a, b, c = np.array(seen)
    measured = np.array([0, 1, 2, 3, 4, 5, 8])
    known = np.array([6, 7, 9])
    np.testing.assert_array_equal(a[:, known], b[:, known])
    np.testing.assert_array_equal(a[:, known], c[:, known])
    assert np.all(a[:, measured] != b[:, measured])
    assert np.std((b - a)[:, measured]) == pytest.approx(0.1, rel=0.4)
    np.testing.assert_array_equal(c[2:, measured], a[:-2, measured])
    np.testing.assert_array_equal(c[:2, measured], a[[0, 0]][:, measured])


def test_order_of_calls_is_enforced() -> None:
    env, many = make(SWEEP).unwrapped, vector(SWEEP, 2)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(ResetNeeded):
        many.step(np.zeros((2, 1), np.float32))
    with pytest.raises(ResetNeeded):
        many.reset(options={"reset_mask": np.array([True, False])})
    env.reset(seed=0)
    end = False
    while not end:
        end = env.step(np.ones(1, np.float32))[2]
    with pytest.raises(ResetNeeded, match="over"):
        env.step(np.zeros(1, np.float32))


@pytest.mark.parametrize("bad", [np.array([np.nan], np.float32), np.array([np.inf]), np.zeros(2), 0.5, "up", None, [[0.1]], [0.1 + 0.2j], [0j]])
def test_impossible_actions_are_refused(bad: Any) -> None:
    env = make(SWEEP).unwrapped
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="action"):
        env.step(bad)
    assert env.step(np.zeros(1, np.float32))[4]["time"] == 5.0  # nothing has happened


@pytest.mark.parametrize("bad", [1, -1, 0.5, np.nan, None])
def test_impossible_passive_actions_are_refused(bad: Any) -> None:
    env = make(PASSIVE).unwrapped
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="action"):
        env.step(bad)


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (SWEEP, {"forces": 1.0}, "forces is not an argument"),
        (SWEEP, {"force": 0.0}, "force = 0"),
        (SWEEP, {"force": (2.0, 1.0)}, "force"),
        (SWEEP, {"force": np.nan}, "force = nan"),
        (SWEEP, {"force": 1e300}, "force = 1e+300"),
        (SWEEP, {"force": (1.0, 1e31)}, "force = (1.0, 1e+31)"),
        (GAP, {"force": 1e-300}, "force = 1e-300"),
        (SWEEP, {"beam": 3}, "beam = 3"),
        (SWEEP, {"beam": {"lenght": 1.0}}, "beam = {'lenght': 1.0}"),
        (V1, {"budget_end": "cut"}, "budget_end = 'cut'"),
        (V1, {"frequency_origin": "left"}, "frequency_origin = 'left'"),
        (V1, {"frequency_unit": 0.0}, "frequency_unit = 0.0"),
        (V1, {"whole_scene": 3}, "whole_scene = 3"),
        (V1, {"whole_scene": {"beem": {}}}, "beem"),
        (V1, {"whole_scene": {}, "modes": 2}, "modes = 2"),
        (ADAPTIVE, {"gap_limits": (0.0, 1e-3)}, "gap_limits"),
        (ADAPTIVE, {"absorber": "stuck", "absorber_options": {}}, "absorber"),
        (FRICTION, {"friction_range": (0.0, 1.0)}, "friction_range = (0.0, 1.0)"),
        (FRICTION, {"friction_range": (1.0, 1.0)}, "friction_range = (1.0, 1.0)"),
        (FRICTION, {"friction_range": (2.0, 1.0)}, "friction_range = (2.0, 1.0)"),
        (FRICTION, {"friction_range": (1e-200, 1e200)}, "friction_range"),
        (FRICTION, {"friction_range": (0.1, np.nan)}, "friction_range"),
        (FRICTION, {"absorber_options": {}}, "rigid friction"),
        (FRICTION, {"absorber_options": {"friction_limit": 0.1, "friction_stiffness": 1e5, "contact_stiffness": 1e5}}, "rigid friction"),
        (FRICTION, {"absorber": "stuck", "absorber_options": {}}, "rigid friction"),
        (FRICTION, {"absorber": "none", "absorber_options": {}}, "rigid friction"),
        (FRICTION, {"rate": 0.0}, "rate = 0.0"),
        (FRICTION, {"rates": (1.0, 2.0)}, "rates is not an argument"),
        (SWEEP, {"absorber": "magic"}, "absorber = 'magic'"),
        (SWEEP, {"absorber_options": {"mass": 1}}, "absorber_options"),
        (SWEEP, {"absorber_options": {"gap": -1.0}}, "gap = -1.0"),
        (SWEEP, {"absorber_options": {"contact_stiffness": 1e5, "restitution": 0.5}}, "restitution"),
        (SWEEP, {"modes": 0}, "modes = 0"),
        (SWEEP, {"resonance": 3, "modes": 2}, "resonance = 3"),
        (SWEEP, {"method": "euler"}, "method = 'euler'"),
        (SWEEP, {"method": "runge-kutta"}, "method"),
        (SWEEP, {"steps_per_period": 20}, "steps_per_period = 20"),
        (SWEEP, {"interval": 0.01}, "interval = 0.01"),
        (SWEEP, {"interval": -1.0}, "interval = -1.0"),
        (SWEEP, {"rates": (0.0, 1.0)}, "rates"),
        (SWEEP, {"limits": (1.0, 1.0)}, "limits"),
        (SWEEP, {"direction": "left"}, "direction = 'left'"),
        (SWEEP, {"time_budget": 0.0}, "time_budget = 0.0"),
        (SWEEP, {"time_price": -1.0}, "time_price = -1.0"),
        (SWEEP, {"unfinished_price": -1.0}, "unfinished_price = -1.0"),
        (SWEEP, {"backward_rate": -1.0}, "backward_rate = -1.0"),
        (SWEEP, {"objective": "rms"}, "objective = 'rms'"),
        (SWEEP, {"observation_noise": -0.1}, "observation_noise = -0.1"),
        (SWEEP, {"observation_delay": 0.5}, "observation_delay = 0.5"),
        (SWEEP, {"beam": {"modes": 3}}, "beam"),
        (SWEEP, {"render_mode": "ansi"}, "render_mode"),
        (SWEEP, {"threads": 0}, "threads = 0"),
        (GAP, {"absorber": "tuned", "absorber_options": {}}, "absorber = 'tuned'"),
        (GAP, {"absorber_options": {"contact_stiffness": 1e5}}, "absorber"),
        (GAP, {"gap_limits": (0.0, 1e-3)}, "gap_limits"),
        (GAP, {"hold": (-1.0, 5.0)}, "hold"),
        (PASSIVE, {"rate": 0.0}, "rate = 0.0"),
        (PASSIVE, {"rates": (1.0, 2.0)}, "rates is not an argument"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_impossible_arguments_are_named(name: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        gymnasium.make(name, **arguments)
    assert words in str(error.value)


def test_impossible_resets_are_refused() -> None:
    env, many = make(SWEEP).unwrapped, vector(SWEEP, 2)
    with pytest.raises(ParameterError, match="options"):
        env.reset(options={"speed": 1})
    many.reset(seed=0)
    for mask in (np.array([True]), np.array([False, False]), np.array([1, 0]), [True, False]):
        with pytest.raises(ParameterError, match="reset_mask"):
            many.reset(options={"reset_mask": mask})
    for seed in ([1, 2, 3], 1.5, -1, "1", [1, 1.5], True, [0, -2]):
        with pytest.raises(ParameterError, match="seed"):
            many.reset(seed=seed)
    for seed in (1.5, -1, "1", True):
        with pytest.raises(ParameterError, match="seed"):
            env.reset(seed=seed)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    with pytest.raises(ParameterError, match="num_envs = 0"):
        vector(SWEEP, 0)


def test_import_registers_and_does_so_only_once() -> None:
    before = {name: gymnasium.registry[name] for name in ENVIRONMENTS}
    register_environments()
    assert all(gymnasium.registry[name] is before[name] for name in ENVIRONMENTS)
    code = "import gymnasium; e = gymnasium.make('impact_env:ImpactAbsorber/Passive-v0', interval=1.0); print(e.spec.id)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == PASSIVE, done.stderr


def test_import_does_not_need_gymnasium() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import impact_env; print('ok')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "ok", done.stderr


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_docstring_has_gymnasiums_sections_and_all_arguments(name: str) -> None:
    env = make(name).unwrapped
    text = type(env).__doc__ or ""
    for section in ("Description", "Action Space", "Observation Space", "Rewards", "Starting State", "Episode End", "Arguments", "Version History"):
        assert f"## {section}" in text
    if name != PASSIVE:  # and of the suite's names: those with noise and delay are arguments of v1
        assert len(env.task.features) == sum(line.strip().startswith("| ") for line in text.splitlines()) - 2


def test_frames_show_the_motion() -> None:
    env = make(GAP, render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for action in actions(GAP, 3, 1)[:, 0]:
        env.step(action)
        frames.append(env.render())
    for frame in frames:
        assert frame.dtype == np.uint8
        assert frame.ndim == 3
        assert frame.shape[2] == 3
        assert frame.min() < 60 < 250 < frame.max()
    assert env.metadata["render_fps"] == 30
    assert all(np.mean(a != b) > 0.001 for a, b in pairwise(frames))
    many = vector(GAP, 2, render_mode="rgb_array")
    many.reset(seed=0)
    pictures = many.render()
    assert len(pictures) == 2
    np.testing.assert_array_equal(pictures[0], frames[0])


def test_arguments_are_plain_values() -> None:
    spec = make(GAP).spec
    assert json.loads(spec.to_json())["kwargs"]["hold"] == [10.0, 30.0]


@pytest.mark.parametrize(("name", "arguments"), SCENES)
def test_defaults_and_short_cases_end_within_their_budget(name: str, arguments: dict[str, Any]) -> None:
    env = gymnasium.make(name, **arguments)
    env.reset(seed=0)
    steps, over = 0, False
    while not over:
        _, _, end, cut, _ = env.step(env.action_space.sample())
        steps, over = steps + 1, end or cut
    assert 1 < steps <= 60


def test_a_window_shows_what_rgb_array_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window, picture = make(GAP, render_mode="human"), make(GAP, render_mode="rgb_array")
    for env in (window, picture):
        env.reset(seed=0)
        env.render()  # the strips have a point for each picture; a window draws one by itself after each step
        env.step(actions(GAP, 1, 1)[0, 0])
    shown = np.swapaxes(pygame.surfarray.array3d(pygame.display.get_surface()), 0, 1)
    np.testing.assert_array_equal(shown, picture.render())
    window.close()
    assert pygame.display.get_surface() is None
