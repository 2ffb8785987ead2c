"""Calls in a wrong order, and impossible actions, arguments and resets."""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ACTIVE_FRICTION, ACTIVE_GAP, ADAPTIVE, FRICTION, GAP, LIMITED, PASSIVE, STRUCTURES, SWEEP, V1, make, vector
from gymnasium.error import ResetNeeded

from impact_env import ParameterError

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


def test_order_of_calls_is_enforced() -> None:
    env, many = make(SWEEP).unwrapped, vector(SWEEP, 2)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(ResetNeeded):
        many.step(np.zeros((2, 1), np.float32))
    with pytest.raises(ResetNeeded):
        many.reset(options={"reset_mask": np.array([True, False])})
    env.reset(seed=0)
    end = False
    while not end:
        end = env.step(np.ones(1, np.float32))[2]
    with pytest.raises(ResetNeeded, match="over"):
        env.step(np.zeros(1, np.float32))


@pytest.mark.parametrize("bad", [np.array([np.nan], np.float32), np.array([np.inf]), np.zeros(2), 0.5, "up", None, [[0.1]], [0.1 + 0.2j], [0j]])
def test_impossible_actions_are_refused(bad: Any) -> None:
    env = make(SWEEP).unwrapped
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="action"):
        env.step(bad)
    assert env.step(np.zeros(1, np.float32))[4]["time"] == 5.0  # nothing has happened


@pytest.mark.parametrize("bad", [1, -1, 0.5, np.nan, None])
def test_impossible_passive_actions_are_refused(bad: Any) -> None:
    env = make(PASSIVE).unwrapped
    env.reset(seed=0)
    with pytest.raises(ParameterError, match="action"):
        env.step(bad)


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (SWEEP, {"forces": 1.0}, "forces is not an argument"),
        (SWEEP, {"force": 0.0}, "force = 0"),
        (SWEEP, {"beam": {"lenght": 1.0}}, "beam = {'lenght': 1.0}"),
        (V1, {"budget_end": "cut"}, "budget_end = 'cut'"),
        (V1, {"frequency_origin": "left"}, "frequency_origin = 'left'"),
        (V1, {"frequency_unit": 0.0}, "frequency_unit = 0.0"),
        (V1, {"whole_scene": {"beem": {}}}, "beem"),
        (V1, {"whole_scene": {}, "modes": 2}, "modes = 2"),
        (ADAPTIVE, {"gap_limits": (0.0, 1e-3)}, "gap_limits"),
        (ADAPTIVE, {"absorber": "stuck", "absorber_options": {}}, "absorber"),
        (FRICTION, {"friction_range": (0.0, 1.0)}, "friction_range = (0.0, 1.0)"),
        (FRICTION, {"absorber_options": {}}, "rigid friction"),
        (SWEEP, {"method": "runge-kutta"}, "method"),
        (SWEEP, {"steps_per_period": 20}, "steps_per_period = 20"),
        (SWEEP, {"interval": 0.01}, "interval = 0.01"),
        (SWEEP, {"rates": (0.0, 1.0)}, "rates"),
        (SWEEP, {"limits": (1.0, 1.0)}, "limits"),
        (SWEEP, {"limits": (0.5, 20.0)}, "samples_per_period = 32 is not allowed: 80 or more"),
        (SWEEP, {"direction": "left"}, "direction = 'left'"),
        (SWEEP, {"time_budget": 0.0}, "time_budget = 0.0"),
        (SWEEP, {"time_price": -1.0}, "time_price = -1.0"),
        (SWEEP, {"unfinished_price": -1.0}, "unfinished_price = -1.0"),
        (SWEEP, {"backward_rate": -1.0}, "backward_rate = -1.0"),
        (SWEEP, {"objective": "rms"}, "objective = 'rms'"),
        (SWEEP, {"observation_noise": -0.1}, "observation_noise = -0.1"),
        (SWEEP, {"observation_delay": 0.5}, "observation_delay = 0.5"),
        (SWEEP, {"beam": {"modes": 3}}, "beam"),
        (SWEEP, {"render_mode": "ansi"}, "render_mode"),
        (SWEEP, {"threads": 0}, "threads = 0"),
        (GAP, {"absorber": "tuned", "absorber_options": {}}, "absorber = "),
        (GAP, {"hold": (-1.0, 5.0)}, "hold"),
        (ACTIVE_GAP, {"gap_speed": 0.0}, "gap_speed = 0.0"),
        (ACTIVE_GAP, {"gap_lag": -1.0}, "gap_lag = -1.0"),
        (ACTIVE_GAP, {"absorber": "stuck", "absorber_options": {}}, "rigid walls"),
        (ACTIVE_FRICTION, {"price": -1.0}, "price = -1.0"),
        (ACTIVE_FRICTION, {"frequency_ratio": (1.0, 0.9)}, "frequency_ratio"),
        (ACTIVE_FRICTION, {"fatigue_exponent": 0.0}, "fatigue_exponent = 0.0"),
        (ACTIVE_FRICTION, {"vector_reward": 1}, "vector_reward = 1"),
        (ACTIVE_FRICTION, {"absorber": "none", "absorber_options": {}}, "rigid friction"),
        (LIMITED, {"damping": (0.0, 0.1)}, "damping = (0.0, 0.1)"),
        (LIMITED, {"restitution": 1.5}, "restitution = 1.5"),
        (LIMITED, {"start_spread": 0.06}, "start_spread = 0.06"),
        (LIMITED, {"scenes": 0}, "scenes = 0"),
        (LIMITED, {"price": -0.1}, "price = -0.1"),
        (LIMITED, {"fatigue_exponent": 0.0}, "fatigue_exponent = 0.0"),
        (STRUCTURES, {"split": "exam"}, "split = 'exam'"),
        (STRUCTURES, {"structures": 0}, "structures = 0"),
        (STRUCTURES, {"observe_structure": 1}, "observe_structure = 1"),
        (STRUCTURES, {"modes": 3}, "modes = 3"),
        (SWEEP, {"vector_reward": True}, "without a vector of costs"),
        (PASSIVE, {"rate": 0.0}, "rate = 0.0"),
        (PASSIVE, {"rate": 1e9}, "rate = 1000000000.0 is not allowed: in % per 100 pseudo periods, above 0 and at most 1600"),
        (SWEEP, {"limits": (0.9, 1.0), "rates": (1.0, 1e9)}, "rates = (1.0, 1000000000.0) is not allowed"),
        (LIMITED, {"sweep_rates": (1e9, 1e10)}, "sweep_rates = (1000000000.0, 10000000000.0) is not allowed: in % per 100 pseudo periods"),
        (LIMITED, {"sweep_rates": (0.0, 2.0)}, "sweep_rates = (0.0, 2.0)"),
        (LIMITED, {"limits": (1.0, 1.0)}, "start_spread = 0.01 is not allowed: less than half the width of limits"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_impossible_arguments_are_named(name: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        gymnasium.make(name, **arguments)
    assert words in str(error.value)


def test_impossible_resets_are_refused() -> None:
    env, many = make(SWEEP).unwrapped, vector(SWEEP, 2)
    with pytest.raises(ParameterError, match="options"):
        env.reset(options={"speed": 1})
    many.reset(seed=0)
    for mask in (np.array([True]), np.array([False, False]), np.array([1, 0]), [True, False]):
        with pytest.raises(ParameterError, match="reset_mask"):
            many.reset(options={"reset_mask": mask})
    for seed in ([1, 2, 3], 1.5, -1, "1", [1, 1.5], True, [0, -2]):
        with pytest.raises(ParameterError, match="seed"):
            many.reset(seed=seed)
    for seed in (1.5, -1, "1", True):
        with pytest.raises(ParameterError, match="seed"):
            env.reset(seed=seed)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    with pytest.raises(ParameterError, match="num_envs = 0"):
        vector(SWEEP, 0)
