"""Environments on a structure whose level is read elsewhere than at the absorber: a steel beam that is not the paper's, read at 0.9 of its length."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from places import EXAMPLES

gymnasium = pytest.importorskip("gymnasium")

from impact_env import Drive, FrequencySchedule, Scene, StuckAbsorber, TunedAbsorber, load_structure, simulate
from impact_env.controlled import ControlledRuns
from impact_env.envs import ENVIRONMENTS
from impact_env.envs.reference import passage
from impact_env.frequency import LinearAbsorber, receptance, tip_response
from impact_env.methods import Method, Moreau
from impact_env.modes import modal_model

GAP, PASSIVE = list(ENVIRONMENTS)[1:3]
STEEL = str(EXAMPLES / "steel_beam_tip.toml")
MODEL = modal_model(load_structure(STEEL))
WAY = {"limits": (0.985, 0.995), "rate": 4.0, "interval": 5.0, "force": 0.3, "direction": "up"}  # short: impacts amplify rounding
IMPACTS = {"absorber": "impact", "absorber_options": {"gap": 0.95e-3, "mass_ratio": 0.01, "friction_limit": 0.01, "restitution": 0.7}}


@pytest.mark.parametrize(("scene", "digits"), [({"absorber": "none"}, 1e-9), pytest.param(IMPACTS, 1e-6, marks=pytest.mark.nightly)])
def test_the_level_is_the_one_that_a_single_run_reads_there(scene: dict[str, Any], digits: float) -> None:
    env = gymnasium.make(PASSIVE, structure=STEEL, **WAY, **scene).unwrapped
    env.reset(seed=1)
    phase, end, impacts = env.task.runs.orders["phase"][0], False, 0
    while not end:
        _, _, end, cut, info = env.step(0)
        impacts += info["impacts"]
        assert not cut
    omega = MODEL.resonance_omega(1)
    schedule = FrequencySchedule(np.array([0.0, info["time"]]) * 2 * np.pi / omega, np.array([0.985, 0.995]) * omega, omega)
    found = simulate(env.task.settings.scene, Drive(0.3, schedule, phase)).level
    alone = simulate(
        Scene(MODEL), Drive(1.0, FrequencySchedule(16 * schedule.times, schedule.omegas, omega))
    ).level  # a quarter of 1 %: half the paper's damping
    at_the_tip = simulate(Scene(replace(MODEL, response_shape=None), env.task.settings.scene.absorber), Drive(0.3, schedule, phase)).level
    assert info["level"] == pytest.approx(found.value, rel=digits)
    assert passage(Scene(MODEL), 1, 0.985, 0.995, 32, 0.0, 1e-3)[0] == pytest.approx(alone.value, rel=1e-9)
    assert info["relative_level"] == pytest.approx(found.value / (0.3 * alone.value), rel=digits)
    assert at_the_tip.value > 1.05 * found.value
    assert (impacts > 5) is (scene is IMPACTS)


@pytest.mark.parametrize("absorber", [None, StuckAbsorber(mass_ratio=0.01), TunedAbsorber(mass_ratio=0.01, stiffness=500.0, damping=1.0)])
def test_amplitudes_are_those_of_the_linear_response_there(absorber: LinearAbsorber | None) -> None:
    omega = MODEL.resonance_omega(1)
    runs = ControlledRuns(Scene(MODEL, absorber), 1, omega, 20.0 / 0.95, samples_per_period=32)
    runs.orders["force"], runs.orders["omega_start"], runs.orders["omega_stop"] = 1.0, 0.95 * omega, 0.95 * omega
    for _ in range(100):
        runs.advance()
    seen = complex(runs.reports["in_phase"][0], -runs.reports["quadrature"][0])
    assert seen == pytest.approx(tip_response(MODEL, absorber, 0.95 * omega).item(), rel=2e-3)
    assert seen != pytest.approx(receptance(MODEL, 0.95 * omega, MODEL.tip_shape, MODEL.force_shape).item(), rel=0.05)


def test_a_stepping_method_reads_the_same_place() -> None:
    levels = []
    method: Method | None
    for method in (None, Moreau()):
        omega = MODEL.resonance_omega(1)
        runs = ControlledRuns(Scene(replace(MODEL)), 1, omega, 10.0, method, samples_per_period=32)
        runs.orders["force"], runs.orders["omega_start"], runs.orders["omega_stop"] = 1.0, 0.98 * omega, 0.98 * omega
        for _ in range(5):
            runs.advance()
        levels.append(runs.reports["level"][0])
    assert levels[1] == pytest.approx(levels[0], rel=5e-3)


@pytest.mark.plain
def test_the_gaps_score_is_relative_to_the_same_place() -> None:
    env = gymnasium.make(
        GAP, structure=STEEL, force=0.3, interval=5.0, time_budget=50.0, frequency_ratio=0.99, absorber_options=IMPACTS["absorber_options"]
    ).unwrapped
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros(1, np.float32))
    still = 0.3 * abs(receptance(MODEL, 0.99 * MODEL.resonance_omega(1), MODEL.response_shape, MODEL.force_shape).item())
    assert reward == pytest.approx(-info["rms"] / (still / np.sqrt(2)) / 10, rel=1e-12)
