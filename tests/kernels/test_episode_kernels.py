"""The loops over lanes before and after a control interval, against the same formulas for one lane in Python's own numbers."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from impact_env.kernels.control.episodes import Units, Way, fill_features, go_on, order_intervals, pay_for_damage, pay_for_level
from impact_env.kernels.control.interval import ORDER, REPORT

LANES = 200


@pytest.fixture
def lanes() -> Any:
    """Reports of random numbers, and random arrays of lanes."""
    generator = np.random.default_rng(4)
    reports = np.zeros(LANES, REPORT)
    for name in REPORT.names or ():
        reports[name] = generator.integers(0, 40, LANES) if name == "impact_count" else generator.normal(0, 1e-3, LANES)
    arrays = {name: generator.uniform(0.5, 1.5, LANES) for name in ("ratio", "far", "scale", "duration", "force", "level", "change")}
    sign, elapsed, late = (
        np.where(generator.integers(2, size=LANES), 1.0, -1.0),
        generator.integers(0, 90, LANES),
        generator.integers(2, size=LANES) == 1,
    )
    return SimpleNamespace(reports=reports, sign=sign, elapsed=elapsed, late=late, **arrays)


def test_features_are_the_reports_in_their_units(lanes: Any) -> None:
    units = Units(1.1e-3, 2.7, 3.3, 0.98, 0.0125, 80)
    values = np.full((LANES, 11), 7.0)
    fill_features(lanes.reports, units, lanes.ratio, lanes.elapsed, lanes.level, values)
    for i, row in enumerate(values.tolist()):
        report = dict(zip(REPORT.names or (), lanes.reports[i].tolist(), strict=True))
        motion = [report["in_phase"] / 1.1e-3, report["quadrature"] / 1.1e-3, report["distance"] / 1.1e-3, report["relative_velocity"] * 2.7]
        rest = [report["impact_count"] / 3.3, report["absorber_share"], (float(lanes.ratio[i]) - 0.98) / 0.0125, 1 - int(lanes.elapsed[i]) / 80]
        assert row == [*motion, *rest, float(lanes.level[i]), 7.0, 7.0]


def test_a_passage_goes_on_to_its_far_end_and_back_to_its_start(lanes: Any) -> None:
    change = np.where(lanes.change > 1.2, -lanes.change, lanes.change) * 0.3
    duration, after, ended = np.empty(LANES), np.empty(LANES), np.empty(LANES, dtype=np.bool_)
    go_on(Way(2.5, 0.4, lanes.far, lanes.sign), change, lanes.ratio, duration, after, ended)
    for i in range(LANES):
        far, ratio, sign, rate = (float(values[i]) for values in (lanes.far, lanes.ratio, lanes.sign, change))
        left = (far - ratio) * sign
        rest = left - rate * 2.5
        expected = (min(left / rate, 2.5), far, True) if rest <= 1e-12 else (2.5, far - sign * min(rest, 0.4), False)
        assert (duration[i], after[i], ended[i]) == expected
    assert 10 < ended.sum() < LANES - 10


def test_orders_are_in_si_units(lanes: Any) -> None:
    orders = np.zeros(LANES, ORDER)
    orders["phase"], orders["gap"], orders["limit"], orders["place"], orders["fresh"] = 1.5, 2e-3, 0.3, 7.0, True
    order_intervals(orders, 61.0, 0.103, lanes.duration, lanes.ratio, lanes.far, lanes.force, lanes.late)
    for i, order in enumerate(orders):
        duration, ratio, far = float(lanes.duration[i]), float(lanes.ratio[i]), float(lanes.far[i])
        assert order.tolist() == (duration * 0.103, ratio * 61.0, far * 61.0, float(lanes.force[i]), 1.5, 2e-3, 0.3, 7.0, True, bool(lanes.late[i]))


@pytest.mark.parametrize("fatigue", [False, True])
def test_rewards_are_falls_of_the_score_less_prices(lanes: Any, fatigue: bool) -> None:
    potential, rewards = lanes.force.copy(), np.empty(LANES)
    pay = pay_for_damage if fatigue else pay_for_level
    pay(lanes.reports, lanes.scale, 2e-5, lanes.duration, 1.0, lanes.late, potential, rewards)
    for i in range(LANES):
        before, part = float(lanes.force[i]), float(lanes.reports["damage" if fatigue else "level"][i]) / float(lanes.scale[i])
        gain = part if fatigue else part - before
        assert rewards[i] == -gain - (float(lanes.duration[i]) * 2e-5 + int(lanes.late[i]) * 1.0)
        assert potential[i] == (before + part if fatigue else part)
