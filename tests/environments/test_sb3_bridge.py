from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("stable_baselines3")
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from impact_env.parameters import ParameterError
from optimisation.rl.vec_env import NativeVecEnv, make_native

SWEEP = "ImpactAbsorber/SweepRate-v0"
SHORT: dict[str, Any] = {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0}


def test_bridge_gives_what_the_librarys_own_loop_over_single_environments_gives() -> None:
    lanes = 4
    bridge = make_native(SWEEP, lanes, all_info=True, **SHORT)
    own = DummyVecEnv([lambda: gymnasium.make(SWEEP, **SHORT)] * lanes)
    for env in (bridge, own):
        env.seed(7)
    np.testing.assert_array_equal(bridge.reset(), own.reset())
    assert bridge.reset_infos == own.reset_infos
    generator = np.random.default_rng(0)
    cut = set()
    for _ in range(40):
        actions = (generator.uniform(-1, 0, (lanes, 1)) + [[-0.5], [-0.5], [0.5], [1.0]]).astype(np.float32)
        mine, theirs = bridge.step(actions), own.step(actions)
        for a, b in zip(mine[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype
        for a, b, done in zip(mine[3], theirs[3], mine[2], strict=True):
            # the library gives the last info of an episode, and the flag on every step; the bridge gives it where it means something
            assert {**a, "TimeLimit.truncated": a.get("TimeLimit.truncated", False)}.keys() == b.keys()
            np.testing.assert_equal(a, {k: b[k] for k in a})
            if done:
                cut.add(a["TimeLimit.truncated"])
        assert bridge.reset_infos == own.reset_infos
    assert cut == {True, False}


def test_bridge_keeps_infos_short_and_works_under_the_librarys_wrappers() -> None:
    env = VecNormalize(VecMonitor(make_native(SWEEP, 3, **SHORT)))
    env.reset()
    ended = []
    for _ in range(20):
        _, rewards, done, infos = env.step(np.full((3, 1), 1.0, np.float32))
        assert rewards.dtype == np.float32
        ended += [info for info, over in zip(infos, done, strict=True) if over]
        assert all(info == {} for info, over in zip(infos, done, strict=True) if not over)
    assert len(ended) >= 3
    for info in ended:
        assert info["episode"]["r"] == pytest.approx(info["score"], abs=1e-5)
        assert info["terminal_observation"].shape == (10,)
        assert info["TimeLimit.truncated"] is False


def test_bridge_refuses_what_it_cannot_do() -> None:
    own = gymnasium.make_vec(SWEEP, num_envs=2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": AutoresetMode.NEXT_STEP}, **SHORT)
    with pytest.raises(ParameterError, match="autoreset_mode"):
        NativeVecEnv(own)
    env = make_native(SWEEP, 2, **SHORT)
    with pytest.raises(AttributeError, match="share"):
        env.set_attr("x", 1)
    with pytest.raises(AttributeError, match="single"):
        env.env_method("reset")
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False, False]
    assert env.get_attr("num_envs", [0]) == [2]
