"""The rates that nobody gives go with the structure's damping, as everywhere else."""

from typing import Any

import pytest
from places import EXAMPLES

gymnasium = pytest.importorskip("gymnasium")

from impact_env import Drive, linear_sweep, load_structure, simulate
from impact_env.envs.reference import passage
from impact_env.modes import modal_model
from impact_env.scene import Scene

QUARTER = 0.25  # of the paper's rate: half of its damping, squared


def test_the_yardstick_is_a_sweep_that_shows_the_resonance() -> None:
    scene = Scene(modal_model(load_structure(EXAMPLES / "steel_beam.toml")))
    omega = scene.model.resonance_omega(1)
    ratio = float(scene.model.damping_ratio[0])
    assert ratio < 0.009, "the example has to differ from the paper's beam"
    swept = simulate(scene, Drive(1.0, linear_sweep(omega, 0.9, 1.06, (ratio / 0.01) ** 2)))
    level, _ = passage(scene, 1, 0.9, 1.06, 40, 0.0, 1.0)
    assert level == pytest.approx(swept.level.value, rel=1e-3)  # sampled otherwise
    fast = simulate(scene, Drive(1.0, linear_sweep(omega, 0.9, 1.06, 1.0)))
    assert level > 1.03 * fast.level.value


@pytest.mark.parametrize(("arguments", "rate"), [({"beam": {"damping_ratio": 0.005}}, QUARTER), ({}, 1.0), ({"rate": 2.0}, 2.0)])
def test_a_passive_passage_takes_it(arguments: dict[str, Any], rate: float) -> None:
    env = gymnasium.make("impact_env:ImpactAbsorber/Passive-v0", limits=(0.99, 1.01), interval=20.0, **arguments)
    env.reset(seed=0)
    steps, ended = 0, False
    while not ended:
        *_, ended, stopped, _ = env.step(0)
        assert not stopped
        steps += 1
    assert steps == pytest.approx(0.02 * 1e4 / rate / 20, abs=1)
