"""Tasks within a period: what they score, what their actuators can do, what a step costs, and what a reset may choose."""

import dataclasses
import itertools
import math
import pickle
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ACTIVE_FRICTION, ACTIVE_GAP, ADAPTIVE, GAP1, LIMITED, STRUCTURES, actions, make, vector

from impact_env import Beam, CoulombFriction, Drive, FrequencySchedule, ParameterError, Record, Scene, linear_sweep, modal_model, simulate
from impact_env.drive import default_rate
from optimisation.friction_rule import PAPER_FRICTION, paper_share

SCENE: dict[str, Any] = {"modes": 2, "absorber_options": {"friction_limit": 0.1}, "interval": 0.25, "time_budget": 10.0}


def walls(gap: float) -> float:
    """Return the action of a target from 0.1 mm to 3 mm."""
    return 2 * math.log(gap / 1e-4) / math.log(30) - 1


def test_walls_that_stay_score_as_those_of_the_choice_of_the_gap() -> None:
    """The same motion, looked at by a task with its own reference."""
    own, other = gymnasium.make(ACTIVE_GAP, **SCENE), gymnasium.make(GAP1, force=2.0, frequency_ratio=0.985, hold=1e4, **SCENE)
    own.reset(seed=0, options={"force": 2.0, "frequency_ratio": 0.985})
    other.reset(seed=0)
    own.unwrapped.task.runs.orders["phase"] = other.unwrapped.task.runs.orders["phase"] = 1.0
    for _ in range(40):
        info, wanted = (env.step(np.array([action]))[4] for env, action in ((own, walls(1e-3)), (other, 2 * 0.9 / 2.9 - 1)))
    assert info["impacts"] >= 0
    assert info["score"] == pytest.approx(wanted["score"], rel=1e-6)
    assert info["score"] < -0.1


@pytest.mark.parametrize("lag", [0.0, 0.5])
def test_walls_move_no_faster_than_they_can(lag: float) -> None:
    env = gymnasium.make(ACTIVE_GAP, gap_lag=lag, time_budget=40.0)
    env.reset(seed=1)
    gaps = [1e-3] + [env.step(np.ones(1))[4]["gap"] for _ in range(60)]
    steps = np.diff(gaps)
    assert steps.max() == pytest.approx(0.075e-3)
    assert np.all(np.abs(steps) <= 0.075e-3 * (1 + 1e-12))
    if lag == 0:
        assert gaps[-1] == 3e-3
    else:
        left = 3e-3 - np.array(gaps[-20:])
        np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-0.5), rtol=1e-6)


@pytest.mark.parametrize(("name", "price"), [(ACTIVE_FRICTION, 1e-3), (ACTIVE_GAP, 1e-2)])
@pytest.mark.filterwarnings("ignore:.*reward returned by")  # gymnasium's checker knows rewards that are numbers
def test_the_score_is_what_level_and_actuator_cost(name: str, price: float) -> None:
    generator = np.random.default_rng(0)
    env, priced, vector = make(name), make(name, price=price), make(name, vector_reward=True)
    for one in (env, priced, vector):
        one.reset(seed=2)
    total = np.zeros(5)
    for _ in range(20):
        action = generator.uniform(-1, 1, 1).astype(np.float32)
        info, other = env.step(action)[4], priced.step(action)
        _, rewards, _, _, same = vector.step(action)
        total += info["costs"]
        np.testing.assert_array_equal(rewards, -info["costs"])
        np.testing.assert_array_equal(same["costs"], info["costs"])
        assert other[1] == pytest.approx(-info["costs"][0] - price * info["costs"][3], rel=1e-12)
        assert vector.unwrapped.reward_space.contains(rewards)
    assert total[1] == pytest.approx(1.0)
    assert total[3] > 1
    assert np.all(total > 0)


def test_the_contact_force_is_what_a_held_absorber_needs() -> None:
    """Held to the beam, the absorber is moved by m_a times the beam's acceleration alone."""
    env = gymnasium.make(ACTIVE_FRICTION, raw_state=True, time_budget=5.0)
    _, info = env.reset(seed=0)
    scene, speeds, forces = env.unwrapped.task.settings.scene, [0.0], []
    for _ in range(20):
        info = env.step(np.ones(1))[4]
        speeds.append(float(info["state"][3:5] @ scene.model.tip_shape))
        forces.append(info["costs"][4])
    period = 0.25 * scene.model.pseudo_period()
    np.testing.assert_allclose(forces, np.abs(np.diff(speeds)) * scene.absorber_mass / period / info["force"], rtol=1e-9)


def test_friction_is_in_units_of_any_structure() -> None:
    env = gymnasium.make(ACTIVE_FRICTION, friction_range=(paper_share(), 10 * paper_share()))
    env.reset(seed=0)
    assert env.step(-np.ones(1))[4]["friction_limit"] == pytest.approx(PAPER_FRICTION, rel=1e-12)


def test_a_reset_may_choose_what_would_be_drawn() -> None:
    env, many = make(ACTIVE_FRICTION), gymnasium.make_vec(ACTIVE_FRICTION, num_envs=3)
    drawn = env.reset(seed=4)[1]
    chosen = env.reset(seed=4, options={"force": 3.0})[1]
    assert chosen["force"] == 3.0
    assert chosen["frequency_ratio"] == drawn["frequency_ratio"]
    info = many.reset(seed=4, options={"force": [1.0, 2.0, 3.0], "frequency_ratio": 1.0})[1]
    np.testing.assert_array_equal(info["force"], [1, 2, 3])
    np.testing.assert_array_equal(info["frequency_ratio"], 1.0)
    assert many.reset(seed=4)[1]["force"][0] == drawn["force"]


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (ACTIVE_FRICTION, {"force": 0.0}, "options['force'] = 0"),
        (ACTIVE_FRICTION, {"frequency_ratio": 2.0}, "0.96 to 1.02"),
        (ACTIVE_FRICTION, {"force": "much"}, "force"),
        (ACTIVE_FRICTION, {"structure": 1}, "only force"),
        (STRUCTURES, {"structure": 0.5}, "options['structure'] = 0.5 is not allowed: a whole number from 0 to 4"),
        (LIMITED, {"scene": 3}, "options['scene'] = 3 is not allowed: a whole number from 0 to 2"),
    ],
)
def test_what_no_reset_can_choose_is_refused(name: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        make(name).reset(options=options)
    assert words in str(error.value)


def test_lanes_of_a_pool_do_what_each_scene_does_by_itself() -> None:
    """Structure by structure, chosen by a reset, against an environment whose only structure it is."""
    many = gymnasium.make_vec(STRUCTURES, num_envs=6, time_budget=5.0, structures=3)
    task, numbers = many.unwrapped.task, [2, 0, 1, 2, 0, 1]
    many.reset(seed=0, options={"structure": numbers, "force": 2.0, "frequency_ratio": 0.99})
    phases = task.runs.orders["phase"].copy()
    total = np.zeros(6)
    for action in actions(STRUCTURES, 19, 6):
        total += many.step(action)[1]
    for lane, number in enumerate(numbers):
        scene = dataclasses.replace(task.settings.scene, model=task.models[number])
        one = gymnasium.make(ACTIVE_FRICTION, whole_scene=scene, time_budget=5.0)
        one.reset(seed=0, options={"force": task.force[lane], "frequency_ratio": 0.99})
        one.unwrapped.task.runs.orders["phase"] = phases[lane]
        score = sum(one.step(action[lane])[1] for action in actions(STRUCTURES, 19, 6))
        assert total[lane] == pytest.approx(score, rel=1e-9)


def test_structures_are_in_units_of_the_default_beam_and_splits_have_others() -> None:
    drawn = {split: gymnasium.make(STRUCTURES, split=split).unwrapped.task for split in ("train", "validation", "test")}
    for task in drawn.values():
        scene = task.settings.scene
        for model in task.models:
            assert model.omega[0] == pytest.approx(scene.model.omega[0], rel=1e-12)
            assert model.beam_mass == scene.model.beam_mass
            assert np.all((model.damping_ratio >= 0.005) & (model.damping_ratio <= 0.02))
    ratios = {split: {round(model.omega[1] / model.omega[0], 3) for model in task.models} for split, task in drawn.items()}
    cantilever, hinged, clamped = 6.267, 4.0, 2.757  # R. D. Blevins 1979
    assert cantilever in ratios["train"]
    assert hinged in ratios["validation"]
    assert clamped in ratios["test"]
    assert not {cantilever, hinged} & ratios["test"]
    assert clamped not in ratios["train"] | ratios["validation"]


def test_the_force_moves_every_structure_as_far() -> None:
    many = gymnasium.make_vec(STRUCTURES, num_envs=5, structures=5)
    many.reset(seed=0, options={"structure": [0, 1, 2, 3, 4], "force": 1.5, "frequency_ratio": 1.0})
    task = many.unwrapped.task
    np.testing.assert_allclose(task.expected_amplitude(), task.expected_amplitude()[0], rtol=1e-9)
    for lane, model in enumerate(task.models):
        omega = model.omega[0]
        reached = abs(sum(model.tip_shape * model.force_shape / (model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega)))
        assert task.expected_amplitude()[lane] == pytest.approx(reached * task.force[lane], rel=1e-9)


def test_a_passage_draws_what_it_says_and_its_walls_have_a_price() -> None:
    many, free = gymnasium.make_vec(LIMITED, num_envs=400), gymnasium.make_vec(LIMITED, num_envs=400, price=0.0)
    _, info = many.reset(seed=0)
    free.reset(seed=0)
    task = many.unwrapped.task
    assert set(info["scene"]) == set(range(12))
    assert set(task.sign) == {-1.0, 1.0}
    starts = np.abs(info["frequency_ratio"] - np.where(task.sign > 0, 0.93, 1.03))
    for values, low, high in ((starts, 0, 0.01), (task.rates, 2, 6), (info["gap"], 0.3e-3, 2e-3), (info["force"], 0.5, 6)):
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high
    damping = [scene.model.damping_ratio[0] for scene in task.scenes]
    restitution = [scene.absorber.walls.restitution for scene in task.scenes]
    assert 0.005 < min(damping) < 0.006 < 0.018 < max(damping) < 0.02
    assert 0.6 < min(restitution) < 0.65 < 0.95 < max(restitution) < 1
    before, fastest = info["gap"], 0.0
    for action in actions(LIMITED, 5, 400):
        (_, rewards, _, _, info), wanted = many.step(action), free.step(action)[1]
        moved = np.abs(info["gap"] - before)
        fastest = max(fastest, float(moved[moved < 0.1e-3].max()))
        np.testing.assert_allclose(wanted - rewards, 0.01 * moved / 1e-3, atol=1e-12)
        np.testing.assert_allclose(info["costs"][:, 3], moved / 1e-3, atol=1e-12)
        np.testing.assert_allclose(rewards, -info["costs"][:, 0] - 0.01 * info["costs"][:, 3], atol=1e-12)
        before = info["gap"]
    assert fastest == pytest.approx(0.05e-3)
    assert many.reset(seed=1, options={"scene": 3})[1]["scene"].tolist() == [3] * 400


@pytest.mark.filterwarnings("ignore:.*reward returned by")
def test_a_passage_costs_what_simulate_says() -> None:
    """With walls and friction that stay: response level, fatigue and impacts from samples and events of one run. Seed 2: the level also falls.

    Walls that take most of an impact's energy do not let rounding grow.
    """
    gap, force, action = 0.7e-3, 3.0, np.array([walls(0.7e-3), -0.6])
    arguments: dict[str, Any] = {"gap_starts": (gap, gap), "restitution": (0.1, 0.3), "fatigue_exponent": 3.0, "vector_reward": True}
    env, many = make(LIMITED, **arguments), vector(LIMITED, 2, **arguments)
    info = env.reset(seed=2, options={"force": force})[1]
    many.reset(seed=2, options={"force": force})
    task, phase = env.unwrapped.task, env.unwrapped.task.runs.orders["phase"][0]
    times, ratios, costs, end = [0.0], [info["frequency_ratio"]], [], False
    while not end:
        _, rewards, end, _, info = env.step(action)
        np.testing.assert_array_equal(many.step(np.array([action, action]))[1][0], rewards)
        np.testing.assert_array_equal(rewards, -info["costs"])
        assert env.unwrapped.reward_space.contains(rewards)
        times.append(info["time"])
        ratios.append(info["frequency_ratio"])
        costs.append(info["costs"])
    scene, omega = task.scenes[info["scene"]], task.settings.omega
    absorber = dataclasses.replace(
        scene.absorber, walls=dataclasses.replace(scene.absorber.walls, gap=gap), friction=CoulombFriction(info["friction_limit"])
    )
    edges, ends = np.array(times) * 2 * np.pi / omega, (ratios[-1], 0.97 + 0.99 - ratios[-1])
    drive = Drive(force, FrequencySchedule(edges, np.array(ratios) * omega, omega), phase)
    run = simulate(Scene(scene.model, absorber), drive, record=Record(series=True, events=True))
    alone = simulate(Scene(scene.model), Drive(force, linear_sweep(omega, *ends[::-1], default_rate(scene.model)))).level.value
    tip, cuts = run.history.tip_displacement, [*(160 * np.arange(len(costs))), None]
    levels = [0.0]
    for cut in cuts[1:]:
        at = int(np.argmax(np.abs(tip[:cut])))
        levels.append(np.sqrt(np.mean(tip[:cut][max(0, at - 320) + 1 : at + 321] ** 2)) / alone)
    fatigue = [np.sum(np.abs(tip[low:high] / 1e-3) ** 3) / 160 for low, high in itertools.pairwise(cuts)]
    impacts = np.histogram(run.impacts.time, edges)[0] / 5
    expected = np.diff(levels), np.diff(times) / 5 / task.steps, fatigue, np.zeros(len(costs)), impacts
    np.testing.assert_allclose(costs, np.column_stack(expected), rtol=1e-6, atol=1e-9)
    assert impacts.min() > 0
    assert np.diff(levels).min() < 0 < np.diff(levels).max()


# The choice of the friction limit: its unit, what it is on other scenes, and that a choice which stays is the scene's own friction.


FRICTION, PASSIVE = "ImpactAbsorber/FrictionChoice-v1", "ImpactAbsorber/Passive-v0"
WAY: dict[str, Any] = {"limits": (0.98, 1.01), "rate": 4.0}


def made(arguments: dict[str, Any]) -> Any:
    return gymnasium.make(FRICTION, **(WAY | arguments)).unwrapped


def episode(env: Any, actions: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Return observations, rewards and info of a whole passage."""
    rows, rewards, infos = [env.reset(seed=seed)[0]], [], []
    for action in actions:
        observation, reward, over, _, info = env.step(np.array([action], np.float32))
        rows.append(observation)
        rewards.append(reward)
        infos.append(info)
        if over:
            return np.array(rows), np.array(rewards), infos
    raise AssertionError("the passage did not end")


def test_the_papers_friction_is_its_share_of_the_unit() -> None:
    env = made({"friction_range": (paper_share(), 10 * paper_share())})
    _, _, infos = episode(env, np.full(20, -1.0))
    assert infos[0]["friction_limit"] == pytest.approx(PAPER_FRICTION, rel=1e-12)
    np.testing.assert_allclose(env.task.limits, [PAPER_FRICTION, 10 * PAPER_FRICTION], rtol=1e-12)


@pytest.mark.parametrize("action", [-1.0, -0.25, 0.6])
def test_a_choice_that_stays_is_a_passage_with_that_friction(action: float) -> None:
    _, rewards, infos = episode(made({"time_price": 0.0}), np.full(20, action), seed=5)
    scene = {"modes": 2, "absorber_options": {"friction_limit": infos[0]["friction_limit"]}, "force": (0.5, 6.0)}
    env = gymnasium.make(PASSIVE, **WAY, **scene)
    env.reset(seed=5)
    own, over, info = [], False, {}
    while not over:
        _, reward, over, _, info = env.step(0)
        own.append(reward)
    np.testing.assert_array_equal(rewards, own)
    assert infos[-1]["force"] == info["force"]
    assert infos[-1]["level"] == info["level"]


def test_mass_gap_and_time_are_the_units_of_friction() -> None:
    """Twice the force and twice the gap: the same observations from the same actions, from twice the friction."""
    actions = np.random.default_rng(1).uniform(-1, 1, 20)
    one, two = (
        made({"force": size * 3.0, "absorber_options": {"gap": size * 1e-3, "restitution": 0.6, "friction_limit": size * 0.1}}) for size in (1, 2)
    )
    (seen, rewards, infos), (other, others, told) = (episode(env, actions, seed=2) for env in (one, two))
    np.testing.assert_allclose(other, seen, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(others, rewards, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose([i["friction_limit"] for i in told], [2 * i["friction_limit"] for i in infos], rtol=1e-12)
    assert sum(i["impacts"] for i in infos) > 3


# A disturbance beside the sweep, and a base that moves in the place of the force.


SHAKEN = {"kind": "random", "quantity": "base_acceleration", "spectrum": [[20.0, 0.5], [60.0, 0.5]], "duration_s": 2.0, "seed": 4}


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, ADAPTIVE])
def test_lanes_are_single_environments_and_snapshots_go_on(name: str) -> None:
    """Bit for bit, each lane with a part of the record of its own; no episode ends in these steps."""
    extra: dict[str, Any] = {"load": SHAKEN, "moves_base": True, "force": (1.0, 3.0), "raw_state": True}
    many, singles = vector(name, 3, **extra), [make(name, **extra) for _ in range(3)]
    many.reset(seed=7)
    for lane, env in enumerate(singles):
        env.reset(seed=7 + lane)
    kept, seen = b"", []
    for k, action in enumerate(actions(name, 4, 3)):
        if k == 2:
            kept = pickle.dumps(many.unwrapped.snapshot())
        seen.append(many.step(action))
        for lane, env in enumerate(singles):
            observation, reward, _, _, info = env.step(action[lane])
            np.testing.assert_array_equal(seen[-1][0][lane], observation)
            np.testing.assert_array_equal(seen[-1][4]["state"][lane], info["state"])
            assert seen[-1][1][lane] == reward
    assert len({float(state[0]) for state in seen[-1][4]["state"]}) == 3
    other = vector(name, 3, **extra)
    other.reset(seed=1)
    other.unwrapped.restore(pickle.loads(kept))
    for action, expected in zip(actions(name, 4, 3)[2:], seen[2:], strict=True):
        np.testing.assert_array_equal(other.step(action)[4]["state"], expected[4]["state"])


@pytest.mark.plain
def test_without_absorber_the_base_is_answered_in_closed_form() -> None:
    """RMS of the last period, of an absorber that weighs nothing; a disturbance changes it."""
    model = modal_model(Beam(modes=2, damping_ratio=0.05))
    slots = model.omega**2 - model.omega[0] ** 2 + 2j * model.damping_ratio * model.omega * model.omega[0]
    expected, found = abs(np.sum(model.level_shape * model.base_participation / slots)) / np.sqrt(2), []
    light: dict[str, Any] = {"absorber_options": {"mass_ratio": 1e-9, "gap": 1.0, "friction_limit": 1e-8}, "friction_range": (1e-9, 1e-8)}
    arguments = light | {"beam": {"damping_ratio": 0.05}, "frequency_ratio": 1.0, "time_budget": 21.0, "force": 1.0, "moves_base": True}
    for load in (None, SHAKEN):
        env = make(ACTIVE_FRICTION, load=load, **arguments)
        env.reset(seed=0)
        found.append(np.sqrt(np.mean([env.step(np.zeros(1, np.float32))[4]["rms"] ** 2 for _ in range(80)][-4:])) / expected)
    assert found[0] == pytest.approx(1.0, abs=0.01)
    assert abs(found[1] - 1.0) > 0.05


def test_what_cannot_be_is_refused_by_name() -> None:
    shock = {"kind": "shock", "pulse": "triangle", "peak_n": 1.0, "pulse_s": 0.1, "duration_s": 0.2}
    cases: list[tuple[str, dict[str, Any], str]] = [
        (ACTIVE_FRICTION, {"load": shock}, "one load of the kind random or samples"),
        (ACTIVE_FRICTION, {"load": {"kind": "random"}}, "spectrum"),
        (ACTIVE_FRICTION, {"load": SHAKEN | {"seed": 10**5000}}, "load = dict with a whole number of very many digits"),
        (ACTIVE_FRICTION, {"load": SHAKEN, "method": "moreau"}, "forces with Moreau"),
        (ACTIVE_FRICTION, {"moves_base": 1}, "moves_base = 1"),
        (STRUCTURES, {"moves_base": True}, "base_participation"),
    ]
    for name, arguments, words in cases:
        with pytest.raises(ParameterError, match=words):
            make(name, **arguments)
