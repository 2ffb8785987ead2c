"""Active tasks have correct scores, actuators, costs and resets.

Their actions vary within a period.
"""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ACTIVE_FRICTION,
    ACTIVE_GAP,
    FRICTION,
    GAP1,
    LIMITED,
    PASSIVE,
    SHAKEN,
    STRUCTURES,
    actions,
    make,
    played,
    vector,
)

from impact_env import (
    Beam,
    CoulombFriction,
    Drive,
    FrequencySchedule,
    Record,
    Scene,
    linear_sweep,
    modal_model,
    simulate,
)
from impact_env.drive import default_rate
from optimisation.absorber_rules import PAPER_FRICTION, paper_share

SCENE: dict[str, Any] = {
    "modes": 2,
    "absorber_options": {"friction_limit": 0.1},
    "interval": 0.25,
    "time_budget": 10.0,
}


def models(task: Any) -> list[Any]:
    return [scene.model for scene in task.lanes.scenes]


def walls(gap: float) -> float:
    """Return the action of a target from 0.1 mm to 3 mm."""
    return 2 * math.log(gap / 1e-4) / math.log(30) - 1


def test_walls_that_stay_score_as_those_of_the_choice_of_the_gap() -> None:
    """The same motion, looked at by a task with its own reference."""
    own = gymnasium.make(ACTIVE_GAP, **SCENE)
    other = gymnasium.make(GAP1, force=2.0, frequency_ratio=0.985, hold=1e4, **SCENE)
    own.reset(seed=0, options={"force": 2.0, "frequency_ratio": 0.985})
    other.reset(seed=0)
    own.unwrapped.task.runs.orders["phase"] = other.unwrapped.task.runs.orders["phase"] = 1.0
    for _ in range(40):
        info, wanted = (
            env.step(np.array([action]))[4]
            for env, action in ((own, walls(1e-3)), (other, 2 * 0.9 / 2.9 - 1))
        )
    assert info["impacts"] >= 0
    assert info["score"] == pytest.approx(wanted["score"], rel=1e-6)
    assert info["score"] < -0.1


@pytest.mark.parametrize("lag", [0.0, 0.5])
def test_walls_move_no_faster_than_they_can(lag: float) -> None:
    env = gymnasium.make(ACTIVE_GAP, gap_lag=lag, time_budget=40.0)
    env.reset(seed=1)
    gaps = np.array([1e-3] + [env.step(np.ones(1))[4]["gap"] for _ in range(60)])
    assert np.abs(np.diff(gaps)).max() == pytest.approx(0.075e-3)
    if lag == 0:
        assert gaps[-1] == 3e-3
    else:
        left = 3e-3 - gaps[-20:]
        np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-0.5), rtol=1e-6)


@pytest.mark.parametrize(("name", "price"), [(ACTIVE_FRICTION, 1e-3), (ACTIVE_GAP, 1e-2)])
@pytest.mark.filterwarnings(
    "ignore:.*reward returned by"
)  # gymnasium's checker knows rewards that are numbers
def test_the_score_is_what_level_and_actuator_cost(name: str, price: float) -> None:
    generator = np.random.default_rng(0)
    env = make(name)
    priced = make(name, price=price)
    costly = make(name, vector_reward=True)
    for one in (env, priced, costly):
        one.reset(seed=2)
    total = np.zeros(5)
    for _ in range(20):
        action = generator.uniform(-1, 1, 1).astype(np.float32)
        costs = env.step(action)[4]["costs"]
        paid = priced.step(action)[1]
        rewards = costly.step(action)[1]
        total += costs
        np.testing.assert_array_equal(rewards, -costs)
        assert paid == pytest.approx(-costs[0] - price * costs[3], rel=1e-12)
        assert costly.unwrapped.reward_space.contains(rewards)
    assert total[1] == pytest.approx(1.0)
    assert total[3] > 1
    assert np.all(total > 0)


def test_the_contact_force_is_what_a_held_absorber_needs() -> None:
    """Held to the beam, the absorber is moved by m_a times the beam's acceleration alone."""
    env = gymnasium.make(ACTIVE_FRICTION, raw_state=True, time_budget=5.0)
    _, info = env.reset(seed=0)
    scene = env.unwrapped.task.settings.scene
    speeds = [0.0]
    forces = []
    for _ in range(20):
        info = env.step(np.ones(1))[4]
        speeds.append(float(info["state"][3:5] @ scene.model.tip_shape))
        forces.append(info["costs"][4])
    period = 0.25 * scene.model.pseudo_period()
    np.testing.assert_allclose(
        forces, np.abs(np.diff(speeds)) * scene.absorber_mass / period / info["force"], rtol=1e-9
    )


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, FRICTION])
def test_the_papers_friction_is_its_share_of_the_unit(name: str) -> None:
    env = gymnasium.make(name, friction_range=(paper_share(), 10 * paper_share()))
    env.reset(seed=0)
    for action, limit in ((-1.0, PAPER_FRICTION), (1.0, 10 * PAPER_FRICTION)):
        assert env.step(np.array([action]))[4]["friction_limit"] == pytest.approx(limit, rel=1e-12)


def test_a_reset_may_choose_what_would_be_drawn() -> None:
    env = make(ACTIVE_FRICTION)
    many = gymnasium.make_vec(ACTIVE_FRICTION, num_envs=3)
    drawn = env.reset(seed=4)[1]
    chosen = env.reset(seed=4, options={"force": 3.0})[1]
    assert chosen["force"] == 3.0
    assert chosen["frequency_ratio"] == drawn["frequency_ratio"]
    info = many.reset(seed=4, options={"force": [1.0, 2.0, 3.0], "frequency_ratio": 1.0})[1]
    np.testing.assert_array_equal(info["force"], [1, 2, 3])
    np.testing.assert_array_equal(info["frequency_ratio"], 1.0)
    assert many.reset(seed=4)[1]["force"][0] == drawn["force"]


def test_lanes_of_a_pool_do_what_each_scene_does_by_itself() -> None:
    """Lanes with different structures behave like single environments.

    Each structure is chosen by a reset and compared with an environment that has only this
    structure.
    """
    many = gymnasium.make_vec(STRUCTURES, num_envs=6, time_budget=5.0, structures=3)
    task = many.unwrapped.task
    numbers = [2, 0, 1, 2, 0, 1]
    many.reset(seed=0, options={"structure": numbers, "force": 2.0, "frequency_ratio": 0.99})
    phases = task.runs.orders["phase"].copy()
    total = np.zeros(6)
    for action in actions(STRUCTURES, 19, 6):
        total += many.step(action)[1]
    for lane, number in enumerate(numbers):
        scene = dataclasses.replace(task.settings.scene, model=task.lanes.scenes[number].model)
        one = gymnasium.make(ACTIVE_FRICTION, whole_scene=scene, time_budget=5.0)
        one.reset(seed=0, options={"force": task.lanes.force[lane], "frequency_ratio": 0.99})
        one.unwrapped.task.runs.orders["phase"] = phases[lane]
        score = sum(one.step(action[lane])[1] for action in actions(STRUCTURES, 19, 6))
        assert total[lane] == pytest.approx(score, rel=1e-9)


@pytest.mark.parametrize("name", [STRUCTURES, LIMITED])
def test_threads_that_share_a_pool_change_no_number(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("impact_env.controlled.LANES_PER_THREAD", 2)
    one, three = (vector(name, 12, threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(one.reset(seed=5)[0], three.reset(seed=5)[0])
    for action in actions(name, 24, 12):
        for own, other in zip(one.step(action)[:4], three.step(action)[:4], strict=True):
            np.testing.assert_array_equal(own, other)
    pool = three.unwrapped.task.runs
    assert pool._threads is not None
    assert 0 < pool.wall_time < 60
    three.close()
    three.step(actions(name, 1, 12)[0])  # threads start again
    three.close()


def test_structures_are_in_units_of_the_default_beam_and_splits_have_others() -> None:
    drawn = {
        split: gymnasium.make(STRUCTURES, split=split).unwrapped.task
        for split in ("train", "validation", "test")
    }
    for task in drawn.values():
        scene = task.settings.scene
        for model in models(task):
            assert model.omega[0] == pytest.approx(scene.model.omega[0], rel=1e-12)
            assert model.beam_mass == scene.model.beam_mass
            assert np.all((model.damping_ratio >= 0.005) & (model.damping_ratio <= 0.02))
    ratios = {
        split: {round(model.omega[1] / model.omega[0], 3) for model in models(task)}
        for split, task in drawn.items()
    }
    # R. D. Blevins 1979
    cantilever = 6.267
    hinged = 4.0
    clamped = 2.757
    assert cantilever in ratios["train"]
    assert hinged in ratios["validation"]
    assert ratios["test"] & {cantilever, hinged, clamped} == {clamped}
    assert clamped not in ratios["train"] | ratios["validation"]


def test_the_force_moves_every_structure_as_far() -> None:
    many = gymnasium.make_vec(STRUCTURES, num_envs=5, structures=5)
    many.reset(seed=0, options={"structure": [0, 1, 2, 3, 4], "force": 1.5, "frequency_ratio": 1.0})
    task = many.unwrapped.task
    reached = []
    for model in models(task):
        omega = model.omega[0]
        slots = model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega
        reached.append(abs(np.sum(model.tip_shape * model.force_shape / slots)))
    np.testing.assert_allclose(
        task.reward.expected_amplitude(), reached * task.lanes.force, rtol=1e-9
    )
    np.testing.assert_allclose(
        task.reward.expected_amplitude(), task.reward.expected_amplitude()[0], rtol=1e-9
    )


def test_a_passage_draws_what_it_says_and_its_walls_have_a_speed_and_a_price() -> None:
    many, free = (gymnasium.make_vec(LIMITED, num_envs=400, price=price) for price in (0.01, 0.0))
    for env in (many, free):
        _, info = env.reset(seed=0)
    task = many.unwrapped.task
    walls = [scene.absorber.walls.restitution for scene in task.lanes.scenes]
    damping = [scene.model.damping_ratio[0] for scene in task.lanes.scenes]
    assert set(info["scene"]) == set(range(12))
    ranges = (
        (task.schedule.rates, 2, 6),
        (info["gap"], 0.3e-3, 2e-3),
        (info["force"], 0.5, 6),
        (damping, 0.005, 0.02),
        (walls, 0.6, 1),
    )
    for values, low, high in ranges:
        assert low <= np.min(values) < low + 0.1 * (high - low)
        assert high - 0.15 * (high - low) < np.max(values) <= high
    before = info["gap"]
    fastest = 0.0
    for action in actions(LIMITED, 5, 400):
        _, rewards, _, _, info = many.step(action)
        wanted = free.step(action)[1]
        moved = np.abs(info["gap"] - before)
        fastest = max(fastest, float(moved[moved < 0.1e-3].max()))
        np.testing.assert_allclose(wanted - rewards, 0.01 * moved / 1e-3, atol=1e-12)
        np.testing.assert_allclose(info["costs"][:, 3], moved / 1e-3, atol=1e-12)
        before = info["gap"]
    assert fastest == pytest.approx(0.05e-3)
    assert many.reset(seed=1, options={"scene": 3})[1]["scene"].tolist() == [3] * 400


@pytest.mark.filterwarnings("ignore:.*reward returned by")
def test_a_passage_costs_what_simulate_says() -> None:
    """The costs of a passage agree with those from `simulate`.

    With constant walls and friction, response level, fatigue and impacts are computed from samples
    and events of one run. Seed 2: the level also falls.

    Walls that take most of an impact's energy do not let rounding grow.
    """
    gap = 0.7e-3
    force = 3.0
    action = np.array([walls(0.7e-3), -0.6])
    arguments: dict[str, Any] = {
        "gap_starts": (gap, gap),
        "restitution": (0.1, 0.3),
        "fatigue_exponent": 3.0,
        "vector_reward": True,
    }
    env = make(LIMITED, **arguments)
    many = vector(LIMITED, 2, **arguments)
    info = env.reset(seed=2, options={"force": force})[1]
    many.reset(seed=2, options={"force": force})
    task = env.unwrapped.task
    phase = env.unwrapped.task.runs.orders["phase"][0]
    times = [0.0]
    ratios = [info["frequency_ratio"]]
    costs = []
    end = False
    while not end:
        _, rewards, end, _, info = env.step(action)
        np.testing.assert_array_equal(many.step(np.array([action, action]))[1][0], rewards)
        np.testing.assert_array_equal(rewards, -info["costs"])
        assert env.unwrapped.reward_space.contains(rewards)
        times.append(info["time"])
        ratios.append(info["frequency_ratio"])
        costs.append(info["costs"])
    scene = task.lanes.scenes[info["scene"]]
    omega = task.lanes.omega
    absorber = dataclasses.replace(
        scene.absorber,
        walls=dataclasses.replace(scene.absorber.walls, gap=gap),
        friction=CoulombFriction(info["friction_limit"]),
    )
    edges = np.array(times) * 2 * np.pi / omega
    ends = (ratios[-1], 0.97 + 0.99 - ratios[-1])
    drive = Drive(force, FrequencySchedule(edges, np.array(ratios) * omega, omega), phase)
    run = simulate(Scene(scene.model, absorber), drive, record=Record(series=True, events=True))
    alone = simulate(
        Scene(scene.model),
        Drive(force, linear_sweep(omega, *ends[::-1], default_rate(scene.model))),
    ).level.value
    tip = run.history.tip_displacement
    cuts = [*(160 * np.arange(len(costs))), None]
    levels = [0.0]
    for cut in cuts[1:]:
        at = int(np.argmax(np.abs(tip[:cut])))
        levels.append(np.sqrt(np.mean(tip[:cut][max(0, at - 320) + 1 : at + 321] ** 2)) / alone)
    fatigue = [
        np.sum(np.abs(tip[low:high] / 1e-3) ** 3) / 160 for low, high in itertools.pairwise(cuts)
    ]
    impacts = np.histogram(run.impacts.time, edges)[0] / 5
    expected = (
        np.diff(levels),
        np.diff(times) / 5 / task.schedule.steps,
        fatigue,
        np.zeros(len(costs)),
        impacts,
    )
    np.testing.assert_allclose(costs, np.column_stack(expected), rtol=1e-6, atol=1e-9)
    assert impacts.min() > 0
    assert np.diff(levels).min() < 0 < np.diff(levels).max()


# The choice of the friction limit: a choice that stays is the scene's own friction, and what the
# limit is on other scenes.


WAY: dict[str, Any] = {"limits": (0.98, 1.01), "rate": 4.0}


def passage(
    name: str, chosen: Any, seed: int, **arguments: Any
) -> tuple[list[Any], list[float], list[dict[str, Any]]]:
    """Return observations, rewards and info of a whole passage."""
    env = gymnasium.make(name, **(WAY | arguments))
    left = iter(chosen)
    steps = played(env, lambda _: next(left), seed=seed)
    return [step[0] for step in steps], [step[1] for step in steps], [step[4] for step in steps]


@pytest.mark.parametrize("action", [-1.0, 0.6])
def test_a_choice_that_stays_is_a_passage_with_that_friction(action: float) -> None:
    _, rewards, infos = passage(FRICTION, np.full((20, 1), action, np.float32), 5, time_price=0.0)
    scene = {
        "modes": 2,
        "absorber_options": {"friction_limit": infos[0]["friction_limit"]},
        "force": (0.5, 6.0),
    }
    _, own, others = passage(PASSIVE, [0] * 20, 5, **scene)
    np.testing.assert_array_equal(rewards, own)
    assert infos[-1]["force"] == others[-1]["force"]
    assert infos[-1]["level"] == others[-1]["level"]


def test_mass_gap_and_time_are_the_units_of_friction() -> None:
    """Mass, gap and time are the units of friction.

    Twice the force, gap and friction give the same observations from the same actions.
    """
    actions = np.random.default_rng(1).uniform(-1, 1, (20, 1)).astype(np.float32)
    (observed, rewards, infos), (other, others, other_infos) = (
        passage(
            FRICTION,
            actions,
            2,
            force=3 * k,
            absorber_options={"gap": k * 1e-3, "restitution": 0.6, "friction_limit": k * 0.1},
        )
        for k in (1, 2)
    )
    np.testing.assert_allclose(other, observed, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(others, rewards, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(
        [i["friction_limit"] for i in other_infos],
        [2 * i["friction_limit"] for i in infos],
        rtol=1e-12,
    )
    assert sum(i["impacts"] for i in infos) > 3


# A base that moves in the place of the force, with a disturbance beside it.


def test_without_absorber_the_base_is_answered_in_closed_form() -> None:
    """RMS of the last period, of an absorber that weighs nothing; a disturbance changes it."""
    model = modal_model(Beam(modes=2, damping_ratio=0.1))
    slots = (
        model.omega**2
        - model.omega[0] ** 2
        + 2j * model.damping_ratio * model.omega * model.omega[0]
    )
    expected = abs(np.sum(model.level_shape * model.base_participation / slots)) / np.sqrt(2)
    amplitudes = []
    light: dict[str, Any] = {
        "absorber_options": {"mass_ratio": 1e-9, "gap": 1.0, "friction_limit": 1e-8},
        "friction_range": (1e-9, 1e-8),
    }
    arguments = light | {
        "beam": {"damping_ratio": 0.1},
        "frequency_ratio": 1.0,
        "time_budget": 11.0,
        "force": 1.0,
        "moves_base": True,
    }
    for load in (None, SHAKEN):
        env = make(ACTIVE_FRICTION, load=load, **arguments)
        env.reset(seed=0)
        amplitudes.append(
            np.sqrt(
                np.mean([env.step(np.zeros(1, np.float32))[4]["rms"] ** 2 for _ in range(40)][-4:])
            )
            / expected
        )
    assert amplitudes[0] == pytest.approx(1.0, abs=0.01)
    assert abs(amplitudes[1] - 1.0) > 0.05
