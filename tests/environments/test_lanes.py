"""Native vectors: a lane is the single environment, bit for bit, on any number of threads."""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ADAPTIVE, GAP1, SHORT, SWEEP, V1, actions, make, vector
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from impact_env.envs import ENVIRONMENTS

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


NOISE = {"observation_noise": 0.05, "observation_delay": 2, "raw_state": True}
CASES = [(name, AutoresetMode.SAME_STEP, NOISE) for name in ENVIRONMENTS]
CASES += [(name, mode, limit) for name in (V1, ADAPTIVE, GAP1) for mode in AutoresetMode for limit in ({}, {"max_episode_steps": 7})]


@pytest.mark.parametrize(("name", "mode", "extra"), CASES)
def test_native_vector_agrees_with_gymnasiums_own(name: str, mode: AutoresetMode, extra: dict[str, Any]) -> None:
    """SyncVectorEnv steps single environments one after the other, each under a TimeLimit: keys, masks and numbers are the same, bit for bit."""
    lanes, ends = 4, 0
    arguments = SHORT[name] | extra
    own = gymnasium.make_vec(name, num_envs=lanes, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **arguments)
    native = vector(name, lanes, autoreset_mode=mode, **extra)
    assert native.metadata["autoreset_mode"] is mode
    assert native.single_observation_space == own.single_observation_space
    assert native.action_space == own.action_space
    np.testing.assert_array_equal(native.reset(seed=2)[0], own.reset(seed=2)[0])
    for action in actions(name, 40, lanes):
        mine, theirs = native.step(action), own.step(action)
        for a, b in zip(mine[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        if mode is AutoresetMode.SAME_STEP:
            assert_infos(mine[4], theirs[4])
        over = mine[2] | mine[3]
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            with pytest.raises(ResetNeeded, match="reset_mask"):
                native.step(action)
            again, wanted = (env.reset(options={"reset_mask": over})[0] for env in (native, own))
            np.testing.assert_array_equal(again[over], wanted[over])
    assert ends > lanes


def assert_infos(mine: dict[str, Any], theirs: dict[str, Any]) -> None:
    assert set(mine) == set(theirs)
    for key, values in theirs.items():
        if key == "final_info":
            assert_infos(mine[key], values)
        elif key == "final_obs":
            for a, b in zip(mine[key], values, strict=True):
                np.testing.assert_array_equal(a, b)
        else:
            np.testing.assert_array_equal(mine[key], values)
            assert np.asarray(mine[key]).dtype == np.asarray(values).dtype


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
