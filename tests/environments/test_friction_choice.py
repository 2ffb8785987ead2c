"""The choice of the friction limit: its unit, what it is on other scenes, and that a choice which stays is the scene's own friction."""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from optimisation.friction_rule import PAPER_FRICTION, paper_share

FRICTION, PASSIVE = "ImpactAbsorber/FrictionChoice-v1", "ImpactAbsorber/Passive-v0"
WAY: dict[str, Any] = {"limits": (0.98, 1.01), "rate": 4.0}


def made(arguments: dict[str, Any]) -> Any:
    return gymnasium.make(FRICTION, **(WAY | arguments)).unwrapped


def episode(env: Any, actions: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Return observations, rewards and info of a whole passage."""
    rows, rewards, infos = [env.reset(seed=seed)[0]], [], []
    for action in actions:
        observation, reward, over, _, info = env.step(np.array([action], np.float32))
        rows.append(observation)
        rewards.append(reward)
        infos.append(info)
        if over:
            return np.array(rows), np.array(rewards), infos
    raise AssertionError("the passage did not end")


def test_the_papers_friction_is_its_share_of_the_unit() -> None:
    env = made({"friction_range": (paper_share(), 10 * paper_share())})
    _, _, infos = episode(env, np.full(20, -1.0))
    assert infos[0]["friction_limit"] == pytest.approx(PAPER_FRICTION, rel=1e-12)
    np.testing.assert_allclose(env.task.limits, [PAPER_FRICTION, 10 * PAPER_FRICTION], rtol=1e-12)


@pytest.mark.parametrize("action", [-1.0, -0.25, 0.6])
def test_a_choice_that_stays_is_a_passage_with_that_friction(action: float) -> None:
    _, rewards, infos = episode(made({"time_price": 0.0}), np.full(20, action), seed=5)
    scene = {"modes": 2, "absorber_options": {"friction_limit": infos[0]["friction_limit"]}, "force": (0.5, 6.0)}
    env = gymnasium.make(PASSIVE, **WAY, **scene)
    env.reset(seed=5)
    own, over, info = [], False, {}
    while not over:
        _, reward, over, _, info = env.step(0)
        own.append(reward)
    np.testing.assert_array_equal(rewards, own)
    assert infos[-1]["force"] == info["force"]
    assert infos[-1]["level"] == info["level"]


def test_mass_gap_and_time_are_the_units_of_friction() -> None:
    """Twice the force and twice the gap: the same observations from the same actions, from twice the friction."""
    actions = np.random.default_rng(1).uniform(-1, 1, 20)
    one, two = (
        made({"force": size * 3.0, "absorber_options": {"gap": size * 1e-3, "restitution": 0.6, "friction_limit": size * 0.1}}) for size in (1, 2)
    )
    (seen, rewards, infos), (other, others, told) = (episode(env, actions, seed=2) for env in (one, two))
    np.testing.assert_allclose(other, seen, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(others, rewards, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose([i["friction_limit"] for i in told], [2 * i["friction_limit"] for i in infos], rtol=1e-12)
    assert sum(i["impacts"] for i in infos) > 3
