"""What an action does to a passage, and how a passage ends."""

import numpy as np
import pytest

pytest.importorskip("gymnasium")
from environment_cases import ADAPTIVE, SWEEP, V1, make

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


def test_backward_rates_go_back_but_not_beyond_the_start() -> None:
    env = make(SWEEP, direction="up", backward_rate=10.0, time_budget=500.0)
    env.reset(seed=0)
    there = [env.step(np.array([action], np.float32))[4]["frequency_ratio"] for action in (0.0, 0.5, -0.5, -1.0, -1.0, 0.0)]
    assert there[0] == pytest.approx(0.96 + 5 * 2e-4)
    assert there[1] == pytest.approx(there[0] + 5 * 1e-4 * np.sqrt(2 * 20))
    assert there[2] == pytest.approx(max(there[1] - 5 * 5e-4, 0.96))
    assert there[4] == 0.96
    assert there[5] > 0.96


def test_actions_map_to_rates_and_are_cut_to_their_limits() -> None:
    changes = []
    for action in (-5.0, -1.0, 0.0, 1.0, 7.0):
        env = make(SWEEP, direction="down", limits=(0.9, 1.0))
        env.reset(seed=0)
        changes.append((1.0 - env.step(np.array([action], np.float32))[4]["frequency_ratio"]) / 5e-4)
    np.testing.assert_allclose(changes, [2.0, 2.0, np.sqrt(40), 20.0, 20.0], rtol=1e-9)


@pytest.mark.parametrize("name", [SWEEP, V1, ADAPTIVE])
def test_the_far_end_terminates_and_a_spent_budget_ends_the_passage_and_costs(name: str) -> None:
    """A spent budget truncates a first version; of the others its argument says what it does."""
    choices = [{}] if name == SWEEP else [{"budget_end": "terminated"}, {"budget_end": "truncated"}]
    for action, spent in ((-1.0, True), (1.0, False)):
        for arguments in choices:
            scores = []
            for price in (0.0, 0.7):
                env = make(name, unfinished_price=price, **arguments)
                env.reset(seed=0)
                flags, left = (False, False), []
                while not any(flags):
                    observation, _, *flags, info = env.step(np.full(env.action_space.shape, action, np.float32))
                    left.append(observation[7])
                scores.append(info["score"])
            assert np.all(np.diff(left) < 0)
            assert (len(left) == 12 and left[-1] == 0.0) == spent
            assert flags == ([False, True] if spent and arguments.get("budget_end") != "terminated" else [True, False])
            assert scores[0] - scores[1] == pytest.approx(0.7 if spent else 0.0, abs=1e-12)


def test_features_of_the_frequency_have_their_zero_and_unit_where_the_arguments_say() -> None:
    for arguments, origin, unit in (({}, 0.97, 0.0125), ({"frequency_origin": "resonance", "frequency_unit": 0.1}, 1.0, 0.1)):
        env = make(V1, direction="down", **arguments)
        observation, info = env.reset(seed=0)
        for _ in range(2):
            assert observation[6] == pytest.approx((info["frequency_ratio"] - origin) / unit, rel=1e-5)
            assert observation[9] == pytest.approx((0.96 - info["frequency_ratio"]) / unit, rel=1e-5)
            observation, *_, info = env.step(np.ones(1, np.float32))


def test_rate_and_gap_are_what_the_two_numbers_say() -> None:
    env = make(ADAPTIVE, direction="down", gap_limits=(0.5e-3, 2e-3), raw_state=True)
    env.reset(seed=0)
    *_, info = env.step(np.array([0.0, 0.5], np.float32))
    assert (0.98 - info["frequency_ratio"]) / 5e-4 == pytest.approx(np.sqrt(40))
    assert info["gap"] == pytest.approx(0.5e-3 * 4**0.75)
    for _ in range(6):
        row, *_, info = env.step(np.array([-1.0, -1.0], np.float32))
        assert info["gap_limited"] == (info["gap"] > 0.5e-3)
    assert row[10] == pytest.approx(info["gap"] / 1e-3, rel=1e-6)
