"""Native vectors: a lane is the single environment, bit for bit, on any number of threads."""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import SHORT, SWEEP, actions, make, vector
from gymnasium.vector import AutoresetMode

from impact_env.envs import ENVIRONMENTS

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


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
