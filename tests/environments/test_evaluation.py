"""Evaluation of policies is the same for all.

Seeds are the same for all policies and splits are disjoint. Scores are those of a loop over single
environments, and lanes stay at rest until they are reset.
"""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ACTIVE_FRICTION, SHORT, V1, actions, played, vector

import impact_env
from impact_env import ParameterError
from impact_env.envs.evaluation import bootstrap_interval, interquartile_mean, play

BRIEF: dict[str, Any] = {"time_budget": 5.0}


def by_velocity(observations: np.ndarray) -> np.ndarray:
    return np.clip(observations[:, 1:2] * observations[:, 3:4], -1, 1)


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, V1])
def test_scores_are_those_of_single_environments(name: str) -> None:
    evaluation = impact_env.evaluate(
        by_velocity, name, "validation", episodes=5, arguments=SHORT[name]
    )
    lengths = play(by_velocity, name, evaluation.seeds, SHORT[name]).steps
    assert evaluation.seeds == tuple(range(1_000_000, 1_000_005))
    env = gymnasium.make(name, **SHORT[name])
    for seed, score, steps in zip(evaluation.seeds, evaluation.scores, lengths, strict=True):
        own = played(env, lambda observed: by_velocity(observed[None])[0], seed=seed)
        assert (score, steps) == (sum(step[1] for step in own), len(own))


def test_differences_are_paired_and_the_table_says_all() -> None:
    evaluation = impact_env.evaluate(
        by_velocity,
        ACTIVE_FRICTION,
        against={"held": 1.0, "free": [-1.0]},
        episodes=32,
        arguments=BRIEF,
    )
    better, low, high = evaluation.differences["held"]
    apart = evaluation.scores - evaluation.others["held"].scores
    assert better == pytest.approx(apart.mean())
    assert (high - low) / 2 == pytest.approx(1.96 * apart.std() / np.sqrt(32), rel=0.2)
    assert low < better < high
    text = str(evaluation)
    assert "test: 32 episodes, seeds 2000000 to 2000031" in text
    for row in (evaluation.policy, *evaluation.others.values()):
        assert f"{row.mean:.4f}" in text
        assert row.name in text
        assert row.interval[0] < row.mean < row.interval[1]


def test_a_model_of_another_library_acts_deterministically() -> None:
    class Model:
        """Remembers how often it was asked, as a recurrent policy would."""

        def predict(
            self,
            observation: Any,
            state: Any = None,
            episode_start: Any = None,
            deterministic: bool = False,
        ) -> tuple[Any, Any]:
            assert deterministic
            assert episode_start.all() == (state is None)
            calls = (state or 0) + 1
            return np.full((len(observation), 1), 0.01 * calls, np.float32), calls

    def rising(observations: np.ndarray) -> np.ndarray:
        return np.float32(0.01) * np.rint((1 - observations[:, 8:9]) * 20 + 1)

    models, own = (
        impact_env.evaluate(policy, ACTIVE_FRICTION, episodes=3, arguments=BRIEF).scores
        for policy in (Model(), rising)
    )
    np.testing.assert_allclose(models, own, rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ((0.0, "ImpactAbsorber/Nothing-v0"), "env_id = 'ImpactAbsorber/Nothing-v0'"),
        ((0.0, ACTIVE_FRICTION, "exam"), "split = 'exam'"),
        (("up", ACTIVE_FRICTION), "policy = 'up'"),
        (([0.0, 0.0, 0.0], ACTIVE_FRICTION), "actions"),
    ],
)
def test_what_cannot_be_judged_is_refused(call: tuple[Any, ...], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        impact_env.evaluate(*call, episodes=2)
    assert words in str(error.value)


def test_lanes_rest_until_they_are_reset() -> None:
    rested, free = (vector(ACTIVE_FRICTION, 4, autoreset_mode="DISABLED") for _ in range(2))
    observed = rested.reset(seed=0)[0]
    free.reset(seed=0)
    mask = np.array([False, True, False, True])
    rested.rest(mask)
    for action in actions(ACTIVE_FRICTION, 12, 4):
        (now, rewards, *_) = rested.step(action)
        (other, wanted, *_) = free.step(action)
        np.testing.assert_array_equal(now, np.where(mask[:, None], observed, other))
        np.testing.assert_array_equal(rewards, np.where(mask, 0, wanted))
    rested.reset(seed=7, options={"reset_mask": mask})
    assert np.all(rested.step(actions(ACTIVE_FRICTION, 1, 4)[0])[1] != 0)
    with pytest.raises(ParameterError, match="mask"):
        rested.rest(np.array([True]))


def test_interquartile_mean_leaves_the_outer_quarters_out() -> None:
    assert interquartile_mean(np.array([[-100.0, 0.0, 2.0, 3.0], [4.0, 5.0, 60.0, 900.0]])) == 3.5


def test_interval_of_a_mean_covers_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    intervals = np.array(
        [
            bootstrap_interval(np.mean, generator.normal(0.0, 1.0, (1, 40)), resamples=200)
            for _ in range(200)
        ]
    )
    assert 0.88 <= np.mean((intervals[:, 0] <= 0.0) & (intervals[:, 1] >= 0.0)) <= 0.99


def test_runs_and_seeds_both_count_and_policies_share_the_drawn_seeds() -> None:
    """Runs and seeds both count, and policies share the drawn seeds.

    Scores that differ only by run have an uncertainty that follows from the number of runs,
    whatever the number of episodes. The same holds for seeds.
    """
    runs = np.repeat(np.arange(4.0)[:, None], 1000, axis=1)
    for scores in (runs, runs.T):
        low, high = bootstrap_interval(np.mean, scores)
        assert high - low > 1.0
    np.testing.assert_array_equal(bootstrap_interval(np.mean, np.full((3, 5), 2.0)), [2.0, 2.0])
    scores = np.random.default_rng(0).normal(0.0, 1.0, (1, 30))
    # a difference on every seed is certain, though each score is not
    assert bootstrap_interval(
        lambda a, b: a.mean() - b.mean(), scores + 0.1, scores
    ) == pytest.approx((0.1, 0.1))
