"""compare_absorbers under loads: measures in closed form, and the command from files to files."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import call, read
from load_cases import MASS, OMEGA

from impact_env.ensemble import Lane
from impact_env.loads import Loads, Shock
from impact_env.modes import ModalModel
from impact_env.scene import Scene
from optimisation import load_comparison
from optimisation.cli.group import imported
from optimisation.load_measures import measure_of, measured

STRUCTURE = f"""
[model]
omega_rad_s = [{OMEGA[0]}]
damping_ratio = [0.01]
force_shape_per_sqrt_kg = [0.6]
tip_shape_per_sqrt_kg = [2.6]
beam_mass_kg = {MASS}
"""
LOAD = '[load]\nkind = "shock"\npulse = "triangle"\npeak_n = 30.0\npulse_s = 0.0125\nduration_s = 0.4\n'


def test_the_decay_time_of_one_mode() -> None:
    """The energy swings about its exponential by the damping ratio: a long decay averages that out."""
    shock = Loads((Shock("half-sine", 10.0, 0.0125, 2.0),), OMEGA[0])
    model = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.01, 0.6, 2.6)), MASS)
    assert measure_of(shock) == "decay"
    assert measured(Lane(Scene(model), shock)) == pytest.approx((1 - np.exp(-0.02 * OMEGA[0] * 2.0)) / (0.02 * OMEGA[0]), rel=0.02)


def test_the_command_writes_what_it_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load_comparison, "GAPS", np.array([1.0, 3.0]))
    monkeypatch.setattr(load_comparison, "LIMITS", np.array([0.3]))
    monkeypatch.setattr(load_comparison, "MOST_TRIALS", 20)
    (tmp_path / "structure.toml").write_text(STRUCTURE)
    (tmp_path / "load.toml").write_text(LOAD)
    given = ["--structure", tmp_path / "structure.toml", "--load", tmp_path / "load.toml", "--out", tmp_path / "out"]
    result = call(imported("compare_absorbers"), *given, "--members", 1, "--forces", 3)
    assert result.exit_code == 0, result.output
    found, runs = json.loads((tmp_path / "out" / "summary.json").read_text()), read(tmp_path / "out" / "runs.csv")
    assert found["measure"] == "decay"
    assert len(runs) == 4 * 3
    ratios = {name: [band[1] for band in bands] for name, bands in found["ratio_5_50_95"].items()}
    assert np.ptp(ratios["tuned"]) < 1e-6  # it is linear
    assert min(ratios["tuned"]) < min(ratios["impact"]) < 0.9
    assert f"{ratios['impact'][1]:.3f}" in result.output
    assert (tmp_path / "out" / "comparison.png").stat().st_size > 0
    refused = call(imported("compare_absorbers"), *given, "--rate", 1)
    assert refused.exit_code == 2
    assert "--rate does not go with --load" in refused.output
