"""A lane of a native vector is equal to the single environment, bit for bit.

Copies and snapshots continue like the original, and scenes can be given as a whole.
"""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ACTIVE_FRICTION,
    ADAPTIVE,
    FRICTION,
    GAP1,
    RUBBING,
    SHAKEN,
    SHORT,
    V1,
    actions,
    make,
    vector,
)
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from impact_env.envs import ENVIRONMENTS
from impact_env.plain import from_scene, to_scene

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*-v0 is out of date"
)  # gymnasium says so of everything with a later version


NOISE = {"observation_noise": 0.05, "observation_delay": 2, "raw_state": True}
NOISE |= {"action_delay": 1, "action_levels": 9}
LOADED = {
    "load": SHAKEN,
    "moves_base": True,
    "force": (1.0, 3.0),
    "raw_state": True,
}  # each lane has a part of the record of its own
CASES = [(name, AutoresetMode.SAME_STEP, NOISE) for name in ENVIRONMENTS]
CASES += [
    (name, mode, limit)
    for name in (V1, GAP1)
    for mode in AutoresetMode
    for limit in ({}, {"max_episode_steps": 7})
]
CASES += [(name, AutoresetMode.SAME_STEP, LOADED) for name in (ACTIVE_FRICTION, ADAPTIVE)]


@pytest.mark.parametrize(("name", "mode", "extra"), CASES)
def test_native_vector_agrees_with_gymnasiums_own(
    name: str, mode: AutoresetMode, extra: dict[str, Any]
) -> None:
    """A native vector agrees with Gymnasium's own vector, bit for bit.

    SyncVectorEnv advances single environments one after the other, each under a TimeLimit. Keys,
    masks and values are the same.
    """
    lanes = 4
    ends = 0
    arguments = SHORT[name] | extra
    own = gymnasium.make_vec(
        name,
        num_envs=lanes,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **arguments,
    )
    native = vector(name, lanes, autoreset_mode=mode, **extra)
    assert native.metadata["autoreset_mode"] is mode
    assert native.single_observation_space == own.single_observation_space
    assert native.action_space == own.action_space
    np.testing.assert_array_equal(native.reset(seed=2)[0], own.reset(seed=2)[0])
    for action in actions(name, 40, lanes):
        mine = native.step(action)
        theirs = own.step(action)
        for a, b in zip(mine[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        if mode is AutoresetMode.SAME_STEP:
            assert_infos(mine[4], theirs[4])
        over = mine[2] | mine[3]
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            with pytest.raises(ResetNeeded, match="reset_mask"):
                native.step(action)
            again, wanted = (
                env.reset(seed=[77] * lanes, options={"reset_mask": over})[0]
                for env in (native, own)
            )
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


WAYS: dict[str, Any] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}


@pytest.mark.parametrize("way", ["snapshot", *WAYS])
@pytest.mark.parametrize(
    ("name", "extra"), [(V1, NOISE), (GAP1, NOISE), (FRICTION, NOISE), (ACTIVE_FRICTION, LOADED)]
)
def test_a_copy_goes_on_bit_for_bit(
    name: str, extra: dict[str, Any], way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A copy of a vector continues bit for bit.

    It continues through ends of episodes, independently of the original. A snapshot is restored in
    another environment.
    """
    monkeypatch.setattr(
        "impact_env.controlled.LANES_PER_THREAD", 4
    )  # so that threads are at work before the copy
    env = vector(name, 8, threads=2, **extra)
    chosen = actions(name, 30, 8)
    env.reset(seed=3)
    for action in chosen[:7]:
        env.step(action)
    if way == "snapshot":
        other = vector(name, 8, **extra)
        other.unwrapped.restore(pickle.loads(pickle.dumps(env.unwrapped.snapshot())))
    else:
        other = WAYS[way](env)
    expected = [env.step(action) for action in chosen[7:]]
    assert sum(int(np.sum(step[2] | step[3])) for step in expected) >= 5
    for action, wanted in zip(chosen[7:], expected, strict=True):
        stepped = other.step(action)
        for a, b in zip(stepped[:4], wanted[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        assert_infos(stepped[4], wanted[4])


def test_a_single_environment_that_has_drawn_can_be_copied() -> None:
    env = make(V1, render_mode="rgb_array")
    env.reset(seed=1)
    env.render()
    others = [copied(env) for copied in WAYS.values()]
    observed = env.step(actions(V1, 1, 1)[0, 0])[0]
    for other in others:
        np.testing.assert_array_equal(other.step(actions(V1, 1, 1)[0, 0])[0], observed)
        assert other.render().shape == (420, 640, 3)


def test_any_structure_can_be_used() -> None:
    """Any structure can be used in an environment.

    A scene object, its plain form, and the arguments for the same scene give the same values. A
    scene that has only its modes can be drawn.
    """
    plain = {"beam": {"modes": 2}, "absorber": {"kind": "impact", "friction_limit": 0.025}}
    scene = to_scene(plain)
    runs = []
    for structure in (
        RUBBING,
        {"whole_scene": plain},
        {"whole_scene": scene},
        {"whole_scene": from_scene(scene)},
    ):
        env = make(V1, render_mode="rgb_array", **structure)
        described = {
            name: value
            for name, value in env.unwrapped.task.describe().items()
            if value is not None
        }
        for one in (env, gymnasium.make(V1, **described)):
            one.reset(seed=2)
            runs.append([one.step(np.array([0.5], np.float32))[0] for _ in range(3)])
        assert env.render().shape == (420, 640, 3)
    for other in runs[1:]:
        np.testing.assert_array_equal(other, runs[0])
