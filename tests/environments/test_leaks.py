"""Observations do not reveal the force that is drawn.

The score's reference does not reveal it, and features predict it no better than amplitudes do.
"""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ACTIVE_FRICTION,
    ACTIVE_GAP,
    ADAPTIVE,
    FRICTION,
    GAP1,
    LIMITED,
    OPEN_ADAPTIVE,
    OPEN_FRICTION,
    STRUCTURES,
)

IN_CYCLE = (ACTIVE_FRICTION, ACTIVE_GAP, STRUCTURES)
HIDDEN = (ADAPTIVE, FRICTION, GAP1, LIMITED, *IN_CYCLE)
# columns of lengths and velocities over the gap: the tip in two phases; within a period tip,
# absorber and the tip's RMS
AMPLITUDES = dict.fromkeys(HIDDEN, (0, 1)) | dict.fromkeys(IN_CYCLE, (0, 1, 2, 3, 9))
OPEN = (OPEN_ADAPTIVE, OPEN_FRICTION)
LEARNT = 2000
HELD_OUT = 2000
SMALL = 1e-6
TREES = 5
TRIED = 16
LEAF = 20
pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")


def record_features(env: Any, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the force (L,) and the observations (L, steps, features) of random actions."""
    _, info = env.reset(seed=0)
    generator = np.random.default_rng(1)
    rows = [
        env.step(generator.uniform(-1, 1, env.action_space.shape).astype(np.float32))[0]
        for _ in range(steps)
    ]
    return info["force"], np.stack(rows, axis=1).astype(np.float64)


def linear(inputs: np.ndarray, wanted: np.ndarray, rest: np.ndarray) -> np.ndarray:
    weights = np.linalg.solve(inputs.T @ inputs + 1e-3 * np.eye(inputs.shape[1]), inputs.T @ wanted)
    return rest @ weights


def tree(
    inputs: np.ndarray, wanted: np.ndarray, rest: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    """Return the prediction of an extremely randomised tree.

    It uses the best of a few random cuts at each node (P. Geurts, D. Ernst, L. Wehenkel 2006).
    """
    columns = generator.integers(inputs.shape[1], size=TRIED)
    cuts = generator.uniform(inputs[:, columns].min(axis=0), inputs[:, columns].max(axis=0))
    below = inputs[:, columns] < cuts
    number = below.sum(axis=0)
    total = wanted @ below
    gain = total**2 / np.maximum(number, 1) + (wanted.sum() - total) ** 2 / np.maximum(
        len(wanted) - number, 1
    )
    best = int(np.argmax(gain))
    if len(wanted) < LEAF or number[best] in (0, len(wanted)):
        return np.full(len(rest), wanted.mean())
    predicted = np.empty(len(rest))
    side = rest[:, columns[best]] < cuts[best]
    for own, others in ((below[:, best], side), (~below[:, best], ~side)):
        predicted[others] = tree(inputs[own], wanted[own], rest[others], generator)
    return predicted


def forest(inputs: np.ndarray, wanted: np.ndarray, rest: np.ndarray) -> np.ndarray:
    return np.mean(
        [tree(inputs, wanted, rest, np.random.default_rng(k)) for k in range(TREES)], axis=0
    )


def explained(inputs: np.ndarray, wanted: np.ndarray, probe: Any) -> float:
    """Return R^2 of a probe on held-out episodes, from inputs and their logarithms."""
    inputs = np.column_stack([inputs, np.log(np.abs(inputs) + SMALL)])
    inputs = np.column_stack(
        [np.ones(len(inputs)), (inputs - inputs.mean(axis=0)) / (inputs.std(axis=0) + 1e-9)]
    )
    predicted = probe(inputs[:LEARNT], wanted[:LEARNT], inputs[LEARNT:])
    return 1 - float(np.mean((wanted[LEARNT:] - predicted) ** 2) / wanted[LEARNT:].var())


@pytest.mark.parametrize("name", HIDDEN)
def test_features_predict_the_force_no_better_than_amplitudes_and_what_the_control_knows(
    name: str,
) -> None:
    env = gymnasium.make_vec(name, num_envs=LEARNT + HELD_OUT)
    force, rows = record_features(env, 10)
    known = [*np.flatnonzero(~env.unwrapped.task.sensors.measured), *AMPLITUDES[name]]
    for steps, probe in ((1, forest), (10, linear)):
        amplitude = np.hypot(*rows[:, :steps, :2].T).T[..., None]
        every, some = (
            np.concatenate([rows[:, :steps, columns], amplitude], axis=2)
            for columns in (slice(None), known)
        )
        shares = [
            explained(values.reshape(len(values), -1), np.log(force), probe)
            for values in (every, some)
        ]
        assert (
            0.5 < shares[1] <= 1
        )  # amplitudes in units of the gap speak for the force: that is to be looked at
        assert shares[0] < shares[1] + 0.02


@pytest.mark.parametrize("name", [*OPEN, *HIDDEN])
def test_only_first_versions_observe_the_scores_reference(name: str) -> None:
    env = gymnasium.make_vec(name, num_envs=8)
    usual = record_features(env, 3)[1]
    task = env.unwrapped.task
    start = task.reward.start
    scale = "_scale" if hasattr(task.reward, "_scale") else "level_scale"

    def start_with_another_scale(lane: int, generator: np.random.Generator) -> None:
        start(lane, generator)
        getattr(task.reward, scale)[lane] *= 3

    task.reward.start = start_with_another_scale
    np.testing.assert_equal(np.array_equal(record_features(env, 3)[1], usual), name in HIDDEN)


@pytest.mark.parametrize("name", HIDDEN)
def test_chatter_stays_of_order_one(name: str) -> None:
    without = record_features(gymnasium.make_vec(name, num_envs=256, impacts_limit=100.0), 40)[1]
    assert without[..., 4].max() > 4  # 18 to 58, by the path
    assert record_features(gymnasium.make_vec(name, num_envs=256), 40)[1][..., 4].max() == 4
