"""Calls in a wrong order, and impossible actions, arguments and resets."""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ACTIVE_FRICTION, ACTIVE_GAP, ADAPTIVE, LIMITED, PASSIVE, SHAKEN, STRUCTURES, SWEEP, V1, make, vector
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

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
    with pytest.raises(ResetNeeded, match="snapshot"):
        many.unwrapped.snapshot()
    many.reset(seed=0)
    with pytest.raises(ParameterError, match="lanes of the snapshot = 2 is not allowed: num_envs = 3"):
        vector(SWEEP, 3).unwrapped.restore(many.unwrapped.snapshot())
    env.reset(seed=0)
    end = False
    while not end:
        end = env.step(np.ones(1, np.float32))[2]
    with pytest.raises(ResetNeeded, match="over"):
        env.step(np.zeros(1, np.float32))


WRONG_ACTIONS = (np.array([np.nan], np.float32), np.array([np.inf]), np.zeros(2), 0.5, "up", None, [[0.1]], [0.1 + 0.2j], [0j])


@pytest.mark.parametrize(("name", "wrong"), [(SWEEP, WRONG_ACTIONS), (PASSIVE, (1, -1, 0.5, np.nan, None))])
def test_impossible_actions_are_refused(name: str, wrong: tuple[Any, ...]) -> None:
    env = make(name).unwrapped
    env.reset(seed=0)
    for bad in wrong:
        with pytest.raises(ParameterError, match="action"):
            env.step(bad)
    assert env.step(np.zeros(1, np.float32) if name == SWEEP else 0)[4]["time"] == 5.0  # nothing has happened


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (SWEEP, {"forces": 1.0}, "forces is not an argument"),
        (SWEEP, {"beam": {"lenght": 1.0}}, "beam = {'lenght': 1.0}"),
        (V1, {"budget_end": "cut"}, "budget_end = 'cut'"),
        (V1, {"whole_scene": {"beem": {}}}, "beem"),
        (V1, {"whole_scene": {}, "modes": 2}, "modes = 2"),
        (ADAPTIVE, {"gap_limits": (0.0, 1e-3)}, "gap_limits"),
        (ADAPTIVE, {"absorber": "stuck", "absorber_options": {}}, "absorber"),
        (SWEEP, {"method": "runge-kutta"}, "method"),
        (SWEEP, {"limits": (0.5, 20.0)}, "samples_per_period = 32 is not allowed: 80 or more"),
        (SWEEP, {"direction": "left"}, "direction = 'left'"),
        (SWEEP, {"objective": "rms"}, "objective = 'rms'"),
        (SWEEP, {"observation_noise": -0.1}, "observation_noise = -0.1"),
        (SWEEP, {"observation_delay": 0.5}, "observation_delay = 0.5"),
        (SWEEP, {"render_mode": "ansi"}, "render_mode"),
        (SWEEP, {"threads": 0}, "threads = 0"),
        (ACTIVE_GAP, {"gap_speed": 0.0}, "gap_speed = 0.0"),
        (ACTIVE_FRICTION, {"frequency_ratio": (1.0, 0.9)}, "frequency_ratio"),
        (ACTIVE_FRICTION, {"vector_reward": 1}, "vector_reward = 1"),
        (LIMITED, {"start_spread": 0.06}, "start_spread = 0.06"),
        (STRUCTURES, {"split": "exam"}, "split = 'exam'"),
        (STRUCTURES, {"observe_structure": 1}, "observe_structure = 1"),
        (STRUCTURES, {"modes": 3}, "modes = 3"),
        (STRUCTURES, {"moves_base": True}, "base_participation"),
        (ACTIVE_FRICTION, {"load": SHAKEN | {"kind": "shock"}}, "load"),
        (ACTIVE_FRICTION, {"load": SHAKEN | {"seed": 10**5000}}, "load = dict with a whole number of very many digits"),
        (ACTIVE_FRICTION, {"load": SHAKEN, "method": "moreau"}, "forces with Moreau"),
        (SWEEP, {"vector_reward": True}, "without a vector of costs"),
        (PASSIVE, {"rate": 1e9}, "rate = 1000000000.0 is not allowed: in % per 100 pseudo periods, above 0 and at most 1600"),
        (SWEEP, {"limits": (0.9, 1.0), "rates": (1.0, 1e9)}, "rates = (1.0, 1000000000.0) is not allowed"),
        (LIMITED, {"sweep_rates": (1e9, 1e10)}, "sweep_rates = (1000000000.0, 10000000000.0) is not allowed: in % per 100 pseudo periods"),
        (LIMITED, {"limits": (1.0, 1.0)}, "start_spread = 0.01 is not allowed: less than half the width of limits"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_impossible_arguments_are_named(name: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        gymnasium.make(name, **arguments)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (SWEEP, {"speed": 1}, "options"),
        (ACTIVE_FRICTION, {"force": 0.0}, "options['force'] = 0"),
        (ACTIVE_FRICTION, {"frequency_ratio": 2.0}, "0.96 to 1.02"),
        (ACTIVE_FRICTION, {"force": "much"}, "force"),
        (ACTIVE_FRICTION, {"structure": 1}, "only force"),
        (STRUCTURES, {"structure": 0.5}, "options['structure'] = 0.5 is not allowed: a whole number from 0 to 4"),
    ],
)
def test_what_no_reset_can_choose_is_refused(name: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        make(name).reset(options=options)
    assert words in str(error.value)


def test_impossible_masks_seeds_and_vectors_are_refused() -> None:
    env, many = make(SWEEP).unwrapped, vector(SWEEP, 2)
    many.reset(seed=0)
    for mask in (np.array([True]), np.array([False, False]), np.array([1, 0]), [True, False]):
        with pytest.raises(ParameterError, match="reset_mask"):
            many.reset(options={"reset_mask": mask})
    for one, seeds in ((env, (1.5, -1, "1", True)), (many, (1.5, -1, "1", True, [1, 2, 3], [1, 1.5], [0, -2]))):
        for seed in seeds:
            with pytest.raises(ParameterError, match="seed"):
                one.reset(seed=seed)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    for name, values in (("num_envs", (0,)), ("autoreset_mode", ("next", None, 1)), ("max_episode_steps", (0, 2.5, "3"))):
        for value in values:
            with pytest.raises(ParameterError, match=name):
                gymnasium.make_vec(SWEEP, **({"num_envs": 1} | {name: value}))
    for mode in ("NEXT_STEP", "NextStep"):
        assert vector(SWEEP, 1, autoreset_mode=mode).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert vector(SWEEP, 1, max_episode_steps=-1).unwrapped.task.limit is None
