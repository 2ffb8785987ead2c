"""Statistics of error against run time: intervals, distances between samples, shares between groups."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from studies.accuracy.statistics import (
    between_groups,
    bootstrap,
    clopper_pearson,
    distance_at_size,
    kolmogorov_smirnov,
    mean_difference,
    relative_distance,
    wasserstein,
    wilson,
)


def test_intervals_of_a_share_are_the_published_ones() -> None:
    assert wilson(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert clopper_pearson(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert clopper_pearson(50, 100) == pytest.approx((0.3983, 0.6017), abs=1e-4)


@pytest.mark.parametrize("interval", [wilson, clopper_pearson])
def test_intervals_of_a_share_mirror_and_hold_it(interval) -> None:  # type: ignore[no-untyped-def]
    for hits in range(21):
        low, high = interval(hits, 20)
        assert 0 <= low <= hits / 20 <= high <= 1
        assert (1 - high, 1 - low) == pytest.approx(interval(20 - hits, 20))


def test_exact_interval_covers_at_least_its_level() -> None:
    """The definition, by adding up the binomial distribution."""
    from scipy.stats import binom

    for share in (0.03, 0.2, 0.5, 0.77):
        covered = sum(binom.pmf(k, 15, share) for k in range(16) if clopper_pearson(k, 15)[0] <= share <= clopper_pearson(k, 15)[1])
        assert covered >= 0.95


def test_impossible_counts_are_refused() -> None:
    for hits, runs in ((1, 0), (-1, 5), (6, 5)):
        with pytest.raises(ValueError, match="not allowed"):
            wilson(hits, runs)
    with pytest.raises(ValueError, match="level"):
        clopper_pearson(1, 2, 1.0)


def test_distances_of_shifted_samples() -> None:
    sample = np.random.default_rng(1).normal(3.0, 0.2, 500)
    assert wasserstein(sample + 0.5, sample) == pytest.approx(0.5)
    assert relative_distance(sample + 0.3, sample) == pytest.approx(0.3 / sample.mean())
    assert mean_difference(1.1 * sample, sample) == pytest.approx(0.1)
    low, high = bootstrap(mean_difference, 1.1 * sample, sample)
    assert 0.08 < low < 0.1 < high < 0.12


def test_more_runs_come_closer_to_the_truth_down_to_the_bias() -> None:
    truth = np.random.default_rng(2).normal(1.0, 0.1, 4000)
    right = [distance_at_size(truth, truth, size) for size in (1, 4, 16, 64)]
    wrong = [distance_at_size(truth + 0.2, truth, size) for size in (1, 4, 16, 64)]
    assert all(a > 1.5 * b for a, b in pairwise(right))
    assert wrong[-1] == pytest.approx(0.2, rel=0.05)
    with pytest.raises(ValueError, match="size"):
        distance_at_size(truth, truth, 0)


def test_share_between_groups_is_that_of_the_model() -> None:
    generator = np.random.default_rng(4)
    groups = 0.5 * generator.normal(size=(400, 1)) + generator.normal(size=(400, 20))
    share, low, high = between_groups(groups)
    assert share == pytest.approx(0.2, abs=0.03)  # 0.25 / (0.25 + 1)
    assert low < 0.2 < high
    assert high - low < 0.08
    assert abs(between_groups(generator.normal(size=(400, 20)))[0]) < 0.02
    # six ratings of four judges, table 2 of Shrout and Fleiss: ICC(1,1) = 0.17
    ratings = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
    assert between_groups(ratings)[0] == pytest.approx(0.17, abs=0.005)
    with pytest.raises(ValueError, match="groups"):
        between_groups([[1.0, 2.0]])


def test_samples_of_one_distribution_are_told_from_others() -> None:
    one, other = np.random.default_rng(5).normal(size=(2, 300))
    assert kolmogorov_smirnov(one, other)[1] > 0.05
    distance, chance = kolmogorov_smirnov(one, other + 0.6)
    assert 0.15 < distance < 0.4
    assert chance < 1e-6
    assert kolmogorov_smirnov([1.0, 2.0, 3.0, 4.0], [3.5, 4.5])[0] == pytest.approx(0.75)
