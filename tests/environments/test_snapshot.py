import pickle
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

import impact_env.envs  # noqa: F401
from impact_env.parameters import ParameterError

SEEN: dict[str, Any] = {"modes": 2, "absorber_options": {"friction_limit": 0.025}, "observation_noise": 0.1, "observation_delay": 2}
SWEEP, GAP, FRICTION = (f"ImpactAbsorber/{name}" for name in ("SweepRate-v0", "GapChoice-v0", "FrictionChoice-v0"))
OWN: dict[str, dict[str, Any]] = {
    SWEEP: {"limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0},
    FRICTION: {"limits": (0.97, 0.98), "rate": 20.0},
    GAP: {"hold": (10.0, 30.0), "time_budget": 60.0, "frequency_ratio": (0.98, 1.0)},
}


def make(name: str, lanes: int = 5) -> Any:
    return gymnasium.make_vec(name, num_envs=lanes, vectorization_mode="vector_entry_point", **SEEN, **OWN[name])


@pytest.mark.parametrize("name", OWN)
def test_environment_goes_on_from_a_snapshot_bit_for_bit(name: str) -> None:
    """Also in another environment, after a pickle, through ends of episodes, with noise and delay."""
    env, other = make(name), make(name)
    actions = np.random.default_rng(0).uniform(-1, 1, (30, 5, 1)).astype(np.float32)
    env.reset(seed=3)
    for action in actions[:7]:
        env.step(action)
    kept = pickle.dumps(env.unwrapped.snapshot())
    expected = [env.step(action) for action in actions[7:]]
    assert sum(int(np.sum(step[2] | step[3])) for step in expected) > 5
    for target in (other, env):
        target.unwrapped.restore(pickle.loads(kept))
        for action, (observations, rewards, terminated, truncated, info) in zip(actions[7:], expected, strict=True):
            seen = target.step(action)
            for a, b in zip(seen[:4], (observations, rewards, terminated, truncated), strict=True):
                np.testing.assert_array_equal(a, b)
            np.testing.assert_array_equal(seen[4]["score"], info["score"])


def test_snapshot_needs_a_reset_and_as_many_lanes() -> None:
    env = make(GAP)
    with pytest.raises(gymnasium.error.ResetNeeded, match="snapshot"):
        env.unwrapped.snapshot()
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="lanes of the snapshot = 5 is not allowed: num_envs = 4"):
        make(GAP, 4).unwrapped.restore(env.unwrapped.snapshot())
