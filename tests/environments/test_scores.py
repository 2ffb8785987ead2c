"""Actions have the right effect on a passage, and rewards add up to the paper's level.

This holds at the rate of any structure and at any place of the response.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from places import EXAMPLES

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ADAPTIVE,
    FRICTION,
    GAP,
    GAP1,
    PASSIVE,
    RUBBING,
    SWEEP,
    V1,
    actions,
    make,
    played,
)

from impact_env import (
    Beam,
    Drive,
    FrequencySchedule,
    Moreau,
    ParameterError,
    Record,
    Scene,
    TunedAbsorber,
    load_structure,
    simulate,
)
from impact_env.controlled import ControlledRuns
from impact_env.drive import default_rate
from impact_env.envs.reference import simulate_passage, stationary_amplitude
from impact_env.frequency import receptance, tip_response
from impact_env.methods import Method
from impact_env.modes import modal_model
from impact_env.parameters import LinearAbsorber

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*-v0 is out of date"
)  # gymnasium says so of everything with a later version
STEEL = str(
    EXAMPLES / "steel_beam_tip.toml"
)  # its level is read at 0.9 of its length, the absorber is at the tip
MODEL = modal_model(load_structure(STEEL))  # half the paper's damping: a quarter of its rate
OMEGA = MODEL.resonance_omega(1)
WAY = {
    "limits": (0.985, 0.995),
    "rate": 4.0,
    "interval": 5.0,
    "force": 0.3,
    "direction": "up",
}  # short: impacts amplify rounding
IMPACTS = {
    "absorber": "impact",
    "absorber_options": {
        "gap": 0.95e-3,
        "mass_ratio": 0.01,
        "friction_limit": 0.01,
        "restitution": 0.7,
    },
}


def test_rewards_add_up_to_the_score_which_is_the_papers_level() -> None:
    """Rewards add up to the score, which is the paper's level.

    It is compared with `simulate` on the schedule made by the actions, and with the closed form of
    the same passage at the paper's rate.
    """
    env = gymnasium.make(
        SWEEP,
        interval=5.0,
        limits=(0.965, 0.985),
        rates=(1.0, 10.0),
        direction="up",
        force=0.9,
        time_price=0.03,
        **RUBBING,
    )
    env.reset(seed=4)
    phase = env.unwrapped.task.runs.orders["phase"][0]  # at the start; it goes on
    steps = played(env, lambda _: env.action_space.sample(), seed=4)
    rewards = [step[1] for step in steps]
    infos = [step[4] for step in steps]
    times = [0.0, *(i["time"] for i in infos)]
    ratios = [0.965, *(i["frequency_ratio"] for i in infos)]
    info = infos[-1]
    scene = env.unwrapped.task.settings.scene
    omega = scene.model.resonance_omega(1)
    schedule = FrequencySchedule(
        np.array(times) * 2 * np.pi / omega, np.array(ratios) * omega, omega
    )
    response = simulate(scene, Drive(0.9, schedule, phase))
    assert ratios[-1] == 0.985
    assert info["level"] == pytest.approx(response.level.value, rel=1e-9)
    score = (
        -response.level.value / (0.9 * simulate_passage(scene, 1, 0.965, 0.985, 32, 0.0, 1e-3)[0])
        - 0.03 * times[-1] / 100
    )
    assert sum(rewards) == pytest.approx(score, rel=1e-9)
    assert info["score"] == pytest.approx(
        sum(rewards), rel=1e-14
    )  # from 3.12 on Python sums with less rounding
    assert -info["score"] == pytest.approx(
        info["relative_level"] + 0.03 * times[-1] / 100, rel=1e-12
    )
    assert len(rewards) > 5
    assert not any(step[3] for step in steps)


@pytest.mark.parametrize("ends", [(0.96, 0.98), (0.98, 0.96)])
@pytest.mark.parametrize(
    ("model", "slower"),
    [
        (modal_model(Beam(modes=2)), 1),
        (MODEL, 4),
        (modal_model(Beam(modes=1, damping_ratio=0.007)), 1 / 0.49),
    ],
    ids=["paper", "steel", "a rate that gives no whole samples"],
)
def test_the_reference_is_the_beam_without_absorber_at_the_rate_of_its_damping(
    model: Any, slower: float, ends: tuple[float, float]
) -> None:
    omega = model.resonance_omega(1)
    duration = 0.02 / 1e-4 * slower * 2 * np.pi / model.resonance_omega(1)
    drive = Drive(1.0, FrequencySchedule(np.array([0.0, duration]), np.array(ends) * omega, omega))
    assert simulate_passage(Scene(model), 1, *ends, 32, 0.0, 1e-3)[0] == pytest.approx(
        simulate(Scene(model), drive).level.value, rel=1e-9
    )


@pytest.mark.parametrize(("damping", "periods"), [(0.0095, 24.01), (0.007, 42.01)])
def test_the_damage_of_a_reference_has_all_its_samples(damping: float, periods: float) -> None:
    """The damage of a reference includes all its samples.

    The rates of these dampings give intervals that are not a whole number of samples.
    """
    scene = Scene(modal_model(Beam(modes=1, damping_ratio=damping)))
    omega = scene.model.resonance_omega(1)
    ends = np.array([0.97, 0.97 + periods * default_rate(scene.model) / 1e4])
    times = np.array([0.0, periods * 2 * np.pi / omega])
    drive = Drive(1.0, FrequencySchedule(times, ends * omega, omega))
    record = Record(series=True, samples_per_period=32)
    tip = simulate(scene, drive, record=record).history.tip_displacement
    damage = simulate_passage(scene, 1, *ends, 32, 4.0, 1e-3)[1]
    assert damage == pytest.approx(np.sum(np.abs(tip / 1e-3) ** 4), rel=1e-9)


def test_a_reference_at_an_undamped_resonance_is_refused() -> None:
    model = modal_model(Beam(modes=2, damping_ratio=0.0))
    with pytest.raises(ParameterError, match=r"omega = 252\.3.* rad/s off the undamped resonances"):
        stationary_amplitude(model, model.omega[0])
    off = 0.9 * model.omega[0]
    assert stationary_amplitude(model, off) == pytest.approx(
        abs(receptance(model, off, model.level_shape, model.force_shape)), rel=1e-12
    )
    env = make(GAP, beam={"damping_ratio": 0.0}, frequency_ratio=1.0)
    with pytest.raises(ParameterError, match="undamped resonances"):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("arguments", "rate"),
    [({"beam": {"damping_ratio": 0.005}}, 0.25), ({}, 1.0), ({"rate": 2.0}, 2.0)],
)
def test_a_passive_passage_has_the_rate_of_its_damping_or_the_chosen_one(
    arguments: dict[str, Any], rate: float
) -> None:
    env = gymnasium.make(PASSIVE, limits=(0.99, 1.01), interval=20.0, **arguments)
    assert len(played(env, seed=0)) == pytest.approx(0.02 * 1e4 / rate / 20, abs=1)


def test_fatigue_adds_up_to_the_damage_of_the_samples() -> None:
    """Fatigue adds up to the damage of the samples.

    Without an absorber, at the paper's rate, the passage is its own reference except for the
    force's phase at the start.
    """
    env = gymnasium.make(
        PASSIVE,
        absorber="none",
        modes=2,
        limits=(0.95, 0.96),
        objective="fatigue",
        fatigue_exponent=4.0,
        force=2.0,
    )
    env.reset(seed=0)
    env.unwrapped.task.runs.orders["phase"] = 0.0
    total = 0.0
    end = False
    while not end:
        _, reward, end, _, info = env.step(0)
        total += reward
    assert total == pytest.approx(-1.0, rel=1e-9)
    assert info["relative_damage"] == pytest.approx(1.0, rel=1e-9)


def test_gap_score_is_the_mean_relative_response() -> None:
    env = make(GAP, frequency_ratio=0.99, time_budget=100.0)
    env.reset(seed=8)
    model = env.unwrapped.task.settings.scene.model
    omega = env.unwrapped.task.lanes.omega
    slots = (
        model.omega**2 - (0.99 * omega) ** 2 + 2j * model.damping_ratio * model.omega * 0.99 * omega
    )
    amplitude = abs(np.sum(model.force_shape * model.tip_shape / slots))
    total = 0.0
    shares = []
    end = False
    forces = set()
    while not end:
        action = env.action_space.sample()
        _, reward, _, end, info = env.step(action)
        total += reward
        shares.append(info["rms"] / (info["force"] * amplitude / np.sqrt(2)))
        forces.add(info["force"])
        wanted = 0.1e-3 + 0.5 * (float(action[0]) + 1) * (
            3e-3 - 0.1e-3
        )  # the cavity does not close onto the absorber
        assert info["gap"] >= wanted
        assert info["gap_limited"] == (info["gap"] > wanted)
    assert total == pytest.approx(-np.mean(shares), rel=1e-9)
    assert len(shares) == 20
    assert len(forces) > 2


def test_the_gaps_score_is_relative_to_the_place_where_the_level_is_read() -> None:
    options = {"frequency_ratio": 0.99, "absorber_options": IMPACTS["absorber_options"]}
    env = gymnasium.make(
        GAP, structure=STEEL, force=0.3, interval=5.0, time_budget=50.0, **options
    ).unwrapped
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros(1, np.float32))
    still = 0.3 * abs(
        receptance(MODEL, 0.99 * OMEGA, MODEL.response_shape, MODEL.force_shape).item()
    )
    assert reward == pytest.approx(-info["rms"] / (still / np.sqrt(2)) / 10, rel=1e-12)


@pytest.mark.parametrize(
    ("scene", "digits"),
    [({"absorber": "none"}, 1e-9), (IMPACTS, 1e-6)],
)
def test_the_level_is_that_of_a_single_run_at_the_same_frequency(
    scene: dict[str, Any], digits: float
) -> None:
    env = gymnasium.make(PASSIVE, structure=STEEL, **WAY, **scene).unwrapped
    env.reset(seed=1)
    phase = env.task.runs.orders["phase"][0]  # at the start; it goes on
    steps = played(env, seed=1)
    info = steps[-1][4]
    drive = Drive(
        0.3,
        FrequencySchedule(
            np.array([0.0, info["time"]]) * 2 * np.pi / OMEGA,
            np.array([0.985, 0.995]) * OMEGA,
            OMEGA,
        ),
        phase,
    )
    level = simulate(env.task.settings.scene, drive).level
    at_the_tip = simulate(
        Scene(replace(MODEL, response_shape=None), env.task.settings.scene.absorber), drive
    ).level
    assert info["level"] == pytest.approx(level.value, rel=digits)
    assert info["relative_level"] == pytest.approx(
        level.value / (0.3 * simulate_passage(Scene(MODEL), 1, 0.985, 0.995, 32, 0.0, 1e-3)[0]),
        rel=digits,
    )
    assert at_the_tip.value > 1.05 * level.value
    assert (sum(step[4]["impacts"] for step in steps) > 5) is (scene is IMPACTS)


def advanced(
    absorber: LinearAbsorber | None, method: Method | None, ratio: float, intervals: int
) -> Any:
    """Return the last report of a controlled run under one newton.

    The run has ``intervals`` intervals of 20 pseudo periods.
    """
    runs = ControlledRuns(Scene(MODEL, absorber), 1, OMEGA, 20.0, method, samples_per_period=32)
    runs.orders["force"] = 1.0
    runs.orders["omega_start"] = ratio * OMEGA
    runs.orders["omega_stop"] = ratio * OMEGA
    for _ in range(intervals):
        runs.advance()
    return runs.reports[0]


@pytest.mark.parametrize(
    "absorber", [None, TunedAbsorber(mass_ratio=0.01, stiffness=500.0, damping=1.0)]
)
def test_amplitudes_are_those_of_the_linear_response(absorber: LinearAbsorber | None) -> None:
    report = advanced(absorber, None, 0.95, 100)
    observed = complex(report["in_phase"], -report["quadrature"])
    assert observed == pytest.approx(tip_response(MODEL, absorber, 0.95 * OMEGA).item(), rel=2e-3)
    assert observed != pytest.approx(
        receptance(MODEL, 0.95 * OMEGA, MODEL.tip_shape, MODEL.force_shape).item(), rel=0.05
    )


def test_a_stepping_method_reads_the_same_place() -> None:
    exact, steps = (advanced(None, method, 0.98, 3)["level"] for method in (None, Moreau()))
    assert steps == pytest.approx(exact, rel=5e-3)


# What an action does to a passage, and how a passage ends.


def test_backward_rates_go_back_but_not_beyond_the_start() -> None:
    env = make(SWEEP, direction="up", backward_rate=10.0, time_budget=500.0)
    env.reset(seed=0)
    frequencies = [
        env.step(np.array([action], np.float32))[4]["frequency_ratio"]
        for action in (0.0, 0.5, -0.5, -1.0, -1.0, 0.0)
    ]
    assert frequencies[0] == pytest.approx(0.96 + 5 * 2e-4)
    assert frequencies[1] == pytest.approx(frequencies[0] + 5 * 1e-4 * np.sqrt(2 * 20))
    assert frequencies[2] == pytest.approx(max(frequencies[1] - 5 * 5e-4, 0.96))
    assert frequencies[4] == 0.96
    assert frequencies[5] > 0.96


def test_actions_map_to_rates_and_are_cut_to_their_limits() -> None:
    changes = []
    for action in (-5.0, -1.0, 0.0, 1.0, 7.0):
        env = make(SWEEP, direction="down", limits=(0.9, 1.0))
        env.reset(seed=0)
        changes.append(
            (1.0 - env.step(np.array([action], np.float32))[4]["frequency_ratio"]) / 5e-4
        )
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
                steps = played(env, np.full(env.action_space.shape, action, np.float32), seed=0)
                left = [step[0][7] for step in steps]
                scores.append(steps[-1][4]["score"])
            assert np.all(np.diff(left) < 0)
            assert (len(left) == 12 and left[-1] == 0.0) == spent
            assert steps[-1][2:4] == (
                (False, True)
                if spent and arguments.get("budget_end") != "terminated"
                else (True, False)
            )
            assert scores[0] - scores[1] == pytest.approx(0.7 if spent else 0.0, abs=1e-12)


def test_features_of_the_frequency_have_their_zero_and_unit_where_the_arguments_say() -> None:
    for arguments, origin, unit in (
        ({}, 0.97, 0.0125),
        ({"frequency_origin": "resonance", "frequency_unit": 0.1}, 1.0, 0.1),
    ):
        env = make(V1, direction="down", **arguments)
        observation, info = env.reset(seed=0)
        for _ in range(2):
            assert observation[6] == pytest.approx(
                (info["frequency_ratio"] - origin) / unit, rel=1e-5
            )
            assert observation[9] == pytest.approx(
                (0.96 - info["frequency_ratio"]) / unit, rel=1e-5
            )
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


@pytest.mark.filterwarnings("ignore:.*reward returned by")  # gymnasium's checker
@pytest.mark.parametrize("name", [V1, ADAPTIVE, FRICTION, GAP1])
def test_costs_add_up_to_the_score_and_are_what_was_done(name: str) -> None:
    """Costs add up to the score and agree with the actions taken.

    Costs are compared with rewards, and with times, impacts, and gaps or friction limits of info.
    They are also the reward of an environment with vector rewards.
    """
    env = make(name)
    vectors = make(name, vector_reward=True)
    task = env.unwrapped.task
    price = 0.0 if name == GAP1 else task.schedule.passage.time_price / 100
    before = env.reset(seed=3)[1] | {"time": 0.0}
    vectors.reset(seed=3)
    assert vectors.unwrapped.reward_space.shape == (4,)
    for action in actions(name, 6, 1)[:, 0]:
        _, reward, end, cut, info = env.step(action)
        level, time, moved, impacts = info["costs"]
        passed = info["time"] - before["time"]
        assert time == pytest.approx(passed / task.interval / task.schedule.steps)
        late = (end or cut) and name != GAP1 and task.lanes.ratio != task.schedule.far
        fine = task.schedule.passage.unfinished_price if late else 0.0
        assert reward == pytest.approx(-level - price * passed - fine, abs=1e-12)
        assert impacts == info["impacts"] / task.interval
        if name in (ADAPTIVE, GAP1):
            assert moved == pytest.approx(abs(info["gap"] - before["gap"]) / task.lanes.length)
        elif name == FRICTION:
            low, high = task.actuators[0].limits
            ratio = info["friction_limit"] / before["friction_limit"]
            assert moved == pytest.approx(abs(2 * np.log(ratio) / np.log(high / low)))
        else:
            assert moved == 0
        np.testing.assert_array_equal(vectors.step(action)[1], -info["costs"])
        before = info
        if end or cut:
            break
