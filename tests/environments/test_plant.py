"""A machine can differ from the model of its control.

Its actuators have steps and delay, and its friction and damping have other values.
"""

from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ACTIVE_FRICTION,
    ACTIVE_GAP,
    ADAPTIVE,
    GAP1,
    LIMITED,
    RAW,
    STRUCTURES,
    actions,
    make,
    vector,
)

from impact_env.checks import ParameterError
from impact_env.envs.signals import ActionDelay, Sensors

DELAY = 2
DELAYED = [ACTIVE_FRICTION, ACTIVE_GAP, STRUCTURES, LIMITED, GAP1, ADAPTIVE]


def play(env: Any, chosen: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return observations and rewards of the first steps of an episode.

    The steps stop at the end of the episode if it comes earlier.
    """
    env.reset(seed=7)
    steps: list[Any] = []
    for action in chosen:
        if not steps or not (steps[-1][2] or steps[-1][3]):
            steps.append(env.step(action))
    return np.array([step[0] for step in steps]), np.array([step[1] for step in steps])


def test_steps_and_delay_are_those_of_a_queue_of_rounded_actions() -> None:
    generator = np.random.default_rng(0)
    start = np.array([0.3, -1.0])
    actuator = ActionDelay(3, 4, 5, start)
    queue = [np.tile(start, (3, 1))] * 4
    for _ in range(20):
        chosen = generator.uniform(-1, 1, (3, 2))
        queue.append(np.array([-1.0, -0.5, 0.0, 0.5, 1.0])[np.round(2 * chosen + 2).astype(int)])
        np.testing.assert_array_equal(actuator.apply(chosen), queue.pop(0))
    actuator.restart(np.array([False, True, False]))
    many = ActionDelay(6, 4, 5, start)
    many.copy_from(actuator, 2)
    for _ in range(4):
        applied = actuator.apply(np.zeros((3, 2)))
        np.testing.assert_array_equal(applied[1], start)
        assert not (applied[0] == start).all()
        np.testing.assert_array_equal(many.apply(np.zeros((6, 2))), np.repeat(applied, 2, axis=0))


@pytest.mark.parametrize("name", DELAYED)
def test_a_delay_is_a_shift_of_the_actions(name: str) -> None:
    late = make(name, action_delay=DELAY)
    ideal = make(name)
    chosen = actions(name, 12, 1)[:, 0].astype(np.float64)
    start = ideal.unwrapped.task.starting_action()
    shifted = np.concatenate([np.tile(start, (DELAY, 1)), chosen[:-DELAY]])
    for own, other in zip(play(late, chosen), play(ideal, shifted), strict=True):
        np.testing.assert_array_equal(own, other)


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, ACTIVE_GAP, LIMITED])
def test_the_action_at_the_start_leaves_the_actuator_where_the_scene_has_it(name: str) -> None:
    env = make(
        name, **({"gap_starts": 1e-3, "gap_limits": (0.5e-3, 3e-3)} if name == LIMITED else {})
    )
    before = env.reset(seed=1)[1]
    task = env.unwrapped.task
    after = env.step(task.starting_action())[4]
    for key in ("friction_limit", "gap"):
        if key in after:
            assert after[key] == pytest.approx(before[key], rel=1e-12)
    assert after["costs"][3] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("levels", [2, 9])
def test_an_action_is_one_of_equidistant_levels(levels: int) -> None:
    coarse = make(ACTIVE_FRICTION, action_levels=levels)
    ideal = make(ACTIVE_FRICTION)
    chosen = actions(ACTIVE_FRICTION, 12, 1)[:, 0].astype(np.float64)
    grid = np.linspace(-1, 1, levels)
    nearest = grid[np.abs(chosen - grid).argmin(axis=1)][:, None]
    for own, other in zip(play(coarse, chosen), play(ideal, nearest), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-9)


def test_a_friction_that_is_off_is_that_of_another_action_or_scene() -> None:
    off = make(ACTIVE_FRICTION, friction_error=0.2, price=0.0)
    exact = make(ACTIVE_FRICTION, price=0.0)
    low, high = exact.unwrapped.task.actuators[0].limits
    shift = 2 * np.log(1.2) / np.log(high / low)
    chosen = actions(ACTIVE_FRICTION, 12, 1)[:, 0] * 0.9
    rewards, others = (
        play(env, taken)[1] for env, taken in ((off, chosen), (exact, chosen + shift))
    )
    np.testing.assert_allclose(rewards, others, rtol=1e-9)
    off = make(ACTIVE_GAP, friction_error=0.2)
    exact = make(ACTIVE_GAP, absorber_options={"friction_limit": 0.12})
    rewards, others = (play(env, chosen)[1] for env in (off, exact))
    np.testing.assert_allclose(rewards, others, rtol=1e-9)


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, ACTIVE_GAP])
def test_a_damping_that_is_off_is_that_of_another_beam(name: str) -> None:
    nominal = make(name).unwrapped.task.settings.scene.model.damping_ratio
    off = make(name, damping_error=0.5)
    other = make(name, beam={"damping_ratio": tuple((1.5 * nominal).tolist())})
    chosen = actions(name, 12, 1)[:, 0]
    np.testing.assert_allclose(play(off, chosen)[1], play(other, chosen)[1], rtol=1e-9)


def test_errors_are_drawn_from_their_ranges() -> None:
    env = vector(ACTIVE_FRICTION, 200, friction_error=(-0.2, 0.1), damping_error=(-0.3, 0.3))
    env.reset(seed=3)
    task = env.unwrapped.task
    assert -0.2 < task.machine[0].friction_factor.min() - 1 < -0.15
    assert 0.05 < task.machine[0].friction_factor.max() - 1 < 0.1
    assert set(task.lanes.which) == set(range(16))
    nominal = task.settings.scene.model.damping_ratio
    factors = np.array([scene.model.damping_ratio / nominal for scene in task.lanes.scenes])
    np.testing.assert_allclose(factors, factors[:, :1].repeat(2, axis=1))
    np.testing.assert_allclose(
        np.sort(factors[:, 0]), 0.7 + 0.6 * (np.arange(16) + 0.5) / 16, rtol=1e-12
    )
    places = actions(ACTIVE_FRICTION, 1, 200)[0]
    info = env.step(places)[4]
    np.testing.assert_allclose(
        task.runs.orders["limit"],
        info["friction_limit"] * task.machine[0].friction_factor,
        rtol=1e-15,
    )
    exact, structures = (
        make(STRUCTURES, damping_error=error).unwrapped.task for error in (0.0, (0.1, 0.4))
    )
    nominal = [scene.model for scene in exact.lanes.scenes]
    ratios = [
        scene.model.damping_ratio[0] / model.damping_ratio[0]
        for scene, model in zip(structures.lanes.scenes, nominal, strict=True)
    ]
    np.testing.assert_allclose(np.sort(ratios), 1.1 + 0.3 * (np.arange(5) + 0.5) / 5, rtol=1e-12)


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, ACTIVE_GAP, STRUCTURES])
def test_a_seed_has_the_same_episode_on_every_machine(name: str) -> None:
    ideal = make(name)
    other = make(name, friction_error=(-0.5, 0.5), damping_error=(0.1, 0.4), action_levels=3)
    for seed in range(5):
        infos = [env.reset(seed=seed)[1] for env in (ideal, other)]
        for key, value in infos[0].items():
            np.testing.assert_array_equal(infos[1][key], value)
        phases = [env.unwrapped.task.runs.orders["phase"][0] for env in (ideal, other)]
        assert phases[0] == phases[1]


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (ACTIVE_FRICTION, {"friction_error": -1.0}, "friction_error"),
        (ACTIVE_FRICTION, {"damping_error": (-2.0, 0.0)}, "damping_error"),
        (ACTIVE_FRICTION, {"damping_error": "much"}, "damping_error"),
        (ACTIVE_GAP, {"friction_error": 0.1, "absorber_options": {"friction_limit": 0.0}}, "error"),
        (ACTIVE_GAP, {"action_levels": 1}, "action_levels"),
        (ACTIVE_GAP, {"action_delay": -1}, "action_delay"),
    ],
)
def test_impossible_machines_are_refused(name: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make(name, **arguments)


def test_accelerometers_give_the_change_of_the_velocities() -> None:
    """Against the state in info: what is summed up is the velocity, in the features' unit."""
    env = make(RAW, observation_noise=0.0, observation_drift=0.0, raw_state=True)
    env.reset(seed=2)
    task = env.unwrapped.task
    duration = 0.25 * 2 * np.pi / task.lanes.omega
    total = np.zeros(2)
    for action in actions(ACTIVE_FRICTION, 15, 1)[:, 0]:
        observed, _, _, _, info = env.step(action)
        total += observed[:2] * 1e-3 * task.lanes.omega**2 * duration
        rates = info["state"][3:]
        velocities = (task.settings.scene.model.tip_shape @ rates[:2], rates[2])
        np.testing.assert_allclose(total, velocities, rtol=1e-4, atol=1e-7)
    assert np.abs(total).max() > 1e-3
    known = make(ACTIVE_FRICTION)
    known.reset(seed=2)
    for action in actions(ACTIVE_FRICTION, 15, 1)[:, 0]:
        wanted = known.step(action)[0]
    np.testing.assert_array_equal(observed[2:], wanted[[5, 6, 7, 8, 10]])


def test_a_bias_drifts_from_zero_at_the_start_of_each_episode() -> None:
    lanes = 500
    features = make(RAW).unwrapped.task.features
    sensors = Sensors(features, lanes, 0.0, 0, drift=0.1)
    generators = [np.random.default_rng(k) for k in range(lanes)]
    every = np.ones(lanes, dtype=np.bool_)
    values = np.zeros((lanes, len(features)))
    for _ in range(2):
        readings = [sensors.see(values, generators, every)]
        readings += [sensors.see(values, generators) for _ in range(9)]
        assert not readings[0].any()
        assert not np.array(readings)[:, :, ~sensors.measured].any()
        steps = np.diff(np.array(readings)[:, :, sensors.measured], axis=0)
        assert steps.std() == pytest.approx(0.1, rel=0.05)
        assert np.array(readings)[-1][:, sensors.measured].std() == pytest.approx(0.3, rel=0.1)
