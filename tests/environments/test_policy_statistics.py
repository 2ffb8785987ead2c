from __future__ import annotations

import numpy as np
import pytest

from impact_env.envs.evaluation import interquartile_mean, interval
from impact_env.parameters import ParameterError
from optimisation.rl.statistics import improvement, normalised, profile


def test_interquartile_mean_leaves_the_outer_quarters_out() -> None:
    assert interquartile_mean(np.array([[-100.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 900.0]])) == 3.5


def test_improvement_counts_pairs_and_half_the_ties() -> None:
    assert improvement(np.array([[1.0, 3.0]]), np.array([[2.0, 0.0]])) == 0.75
    assert improvement(np.array([[1.0, 1.0]]), np.array([[1.0, 1.0, 1.0]])) == 0.5
    assert improvement(np.array([[2.0], [1.0]]), np.array([[1.0]])) == 0.75


def test_normalised_score_is_0_and_1_at_its_yardsticks() -> None:
    zero, one = np.array([[0.0, 2.0]]), np.array([[4.0, 6.0]])
    assert normalised(zero, zero, one) == 0
    assert normalised(one, zero, one) == 1
    assert normalised(np.array([[2.0, 2.0]]), zero, one) == 0.25


def test_profile_is_the_share_above() -> None:
    np.testing.assert_allclose(profile(np.array([[1.0, 2.0, 2.0, 5.0]]), np.array([0.0, 1.0, 1.5, 2.0, 5.0])), [1.0, 0.75, 0.75, 0.25, 0.0])


def test_interval_of_a_mean_covers_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    hits = 0
    for _ in range(200):
        low, high = interval(np.mean, generator.normal(0.0, 1.0, (1, 40)), resamples=200)
        hits += low <= 0.0 <= high
    assert 0.88 <= hits / 200 <= 0.99


def test_runs_and_seeds_both_count() -> None:
    """Scores that differ by run only are as uncertain as their runs are few, however many the episodes; the same for seeds."""
    runs = np.repeat(np.arange(4.0)[:, None], 1000, axis=1)
    low, high = interval(np.mean, runs)
    assert high - low > 1.0
    low, high = interval(np.mean, runs.T)
    assert high - low > 1.0
    both = interval(np.mean, np.full((3, 5), 2.0))
    np.testing.assert_array_equal(both, [2.0, 2.0])


def test_policies_share_the_drawn_seeds() -> None:
    """A difference on every seed is certain, though each score is not."""
    scores = np.random.default_rng(0).normal(0.0, 1.0, (1, 30))
    low, high = interval(lambda a, b: a.mean() - b.mean(), scores + 0.1, scores)
    assert low == pytest.approx(0.1)
    assert high == pytest.approx(0.1)


def test_a_statistic_may_have_several_values_and_seeds_must_agree() -> None:
    band = interval(lambda s: profile(s, np.array([0.0, 9.0])), np.array([[1.0, 2.0]]), resamples=20)
    np.testing.assert_array_equal(band, [[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(ParameterError, match="scores"):
        interval(np.mean, np.zeros((1, 3)), np.zeros((1, 4)))
