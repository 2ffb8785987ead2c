"""Vectors of environments: names of the modes of autoreset, copies, and scenes handed in whole (episodes against SyncVectorEnv: test_lanes.py)."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.vector import AutoresetMode

import impact_env
from impact_env import ParameterError
from impact_env.plain import from_scene, to_scene

V1, ADAPTIVE, GAP = "ImpactAbsorber/SweepRate-v1", "ImpactAbsorber/SweepAndGap-v1", "ImpactAbsorber/GapChoice-v1"
RUBBING = {"modes": 2, "absorber_options": {"friction_limit": 0.025}}
PASSAGE = {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0, "observation_noise": 0.1}
SHORT: dict[str, Any] = {
    V1: PASSAGE | {"observation_delay": 2, "force": (1.0, 2.0)},
    ADAPTIVE: PASSAGE | RUBBING,
    GAP: {"hold": (10.0, 30.0), "time_budget": 60.0, "observation_noise": 0.1, "frequency_ratio": (0.97, 1.03)} | RUBBING,
}


def test_modes_go_by_name_value_or_enum_and_nothing_else() -> None:
    for mode in ("NEXT_STEP", "NextStep", AutoresetMode.NEXT_STEP):
        assert gymnasium.make_vec(V1, num_envs=1, autoreset_mode=mode).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    for bad in ("next", None, 1):
        with pytest.raises(ParameterError, match="autoreset_mode"):
            gymnasium.make_vec(V1, num_envs=1, autoreset_mode=bad)
    for bad in (0, 2.5, "3"):
        with pytest.raises(ParameterError, match="max_episode_steps"):
            gymnasium.make_vec(V1, num_envs=1, max_episode_steps=bad)
    assert gymnasium.make_vec(V1, num_envs=1, max_episode_steps=-1).unwrapped.task.limit is None


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deepcopy", "pickle"])
@pytest.mark.parametrize("name", SHORT)
def test_copies_go_on_like_the_original_and_apart_from_it(name: str, copied: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impact_env.controlled.FEWEST", 1)  # so that threads are at work before the copy
    single = gymnasium.make(name, render_mode="rgb_array", **SHORT[name])
    single.reset(seed=1)
    many = gymnasium.make_vec(name, num_envs=3, threads=2, autoreset_mode="NextStep", **SHORT[name])
    many.reset(seed=1)
    single.render()
    for _ in range(3):
        single.step(np.zeros(single.action_space.shape, np.float32))
        many.step(np.zeros(many.action_space.shape, np.float32))
    for env in (single, many):
        before = env.unwrapped.task.runs.state.copy()
        other = copied(env)
        action = np.full(env.action_space.shape, 0.3, np.float32)
        a = [env.step(action)[:2] for _ in range(2)]
        assert not np.array_equal(env.unwrapped.task.runs.state, before)
        np.testing.assert_array_equal(other.unwrapped.task.runs.state, before)
        b = [other.step(action)[:2] for _ in range(2)]
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x[0], y[0])
            np.testing.assert_array_equal(x[1], y[1])
        other.close()
    np.testing.assert_array_equal(single.render().shape, (420, 640, 3))


def test_any_structure_can_be_used() -> None:
    """A scene object, its plain form, and the arguments for the same scene give the same numbers; one that knows only its modes can be drawn."""
    plain = {"beam": {"modes": 2}, "absorber": {"kind": "impact", "friction": {"kind": "coulomb", "limit_n": 0.025}}}
    scene = to_scene(plain)
    runs = []
    for given in (RUBBING, {"whole_scene": plain}, {"whole_scene": scene}, {"whole_scene": from_scene(scene)}):
        env = gymnasium.make(V1, render_mode="rgb_array", **PASSAGE, **given)
        env.reset(seed=2)
        runs.append([env.step(np.array([0.5], np.float32))[:2] for _ in range(3)])
        assert env.render().shape == (420, 640, 3)
        described = env.unwrapped.task.describe()
        again = gymnasium.make(V1, **{name: value for name, value in described.items() if value is not None})
        again.reset(seed=2)
        np.testing.assert_array_equal(again.step(np.array([0.5], np.float32))[0], runs[-1][0][0])
    for other in runs[1:]:
        for x, y in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(x[0], y[0])
            assert x[1] == y[1]
    assert impact_env.Scene is type(scene)
