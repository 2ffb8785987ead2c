"""compare_absorbers under loads: measures in closed form, and the command from files to files."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from commands import call, read, sweep
from load_cases import KINDS, MASS, OMEGA, file_of_one_mode, tables_of

from impact_env.ensemble import Lane
from impact_env.loads import Loads, Shock
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam
from impact_env.scene import Scene
from optimisation import load_comparison
from optimisation.cli.group import imported
from optimisation.measures import measure_of, measured

LOAD = '[load]\nkind = "shock"\npulse = "triangle"\npeak_n = 30.0\npulse_s = 0.0125\nduration_s = 0.4\n'


def test_the_decay_time_of_one_mode() -> None:
    """The energy swings about its exponential by the damping ratio: a long decay averages that out."""
    shock = Loads((Shock("half-sine", 10.0, 0.0125, 2.0),), OMEGA[0])
    model = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.01, 0.6, 2.6)), MASS)
    assert measure_of(shock) == "decay"
    assert measured(Lane(Scene(model), shock)) == pytest.approx((1 - np.exp(-0.02 * OMEGA[0] * 2.0)) / (0.02 * OMEGA[0]), rel=0.02)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few designs: their numbers do not matter here."""
    for name, value in {"GAPS": np.array([1.0, 3.0]), "LIMITS": np.array([0.3]), "BETWEEN": np.zeros(1), "MOST_TRIALS": 20}.items():
        monkeypatch.setattr(load_comparison, name, value)


@pytest.mark.usefixtures("few")
def test_the_command_writes_what_it_prints(tmp_path: Path) -> None:
    (tmp_path / "structure.toml").write_text(file_of_one_mode(0.01))
    (tmp_path / "load.toml").write_text(LOAD)
    given = ["--structure", tmp_path / "structure.toml", "--load", tmp_path / "load.toml", "--out", tmp_path / "out"]
    result = call(imported("compare_absorbers"), *given, "--members", 1, "--forces", 3)
    assert result.exit_code == 0, result.output
    found, runs = json.loads((tmp_path / "out" / "summary.json").read_text()), read(tmp_path / "out" / "runs.csv")
    assert found["measure"] == "decay"
    assert len(runs) == 4 * 3
    ratios = {name: [band[1] for band in bands] for name, (bands,) in found["ratio_5_50_95"].items()}
    assert np.ptp(ratios["tuned"]) < 1e-6  # it is linear
    assert min(ratios["tuned"]) < min(ratios["impact"]) < 0.9
    assert f"{ratios['impact'][1]:.3f}" in result.output
    assert (tmp_path / "out" / "comparison.png").stat().st_size > 0
    refused = call(imported("compare_absorbers"), *given, "--rate", 1)
    assert refused.exit_code == 2
    assert "--rate does not go with --load" in refused.output


PAPER = "[beam]\nlength_m = 0.5\nbending_stiffness_n_m2 = 362.88\nmass_per_length_kg_m = 1.1275\nmodes = 2\n"
CHAIN = "[matrices]\nmass = 'm.npz'\nstiffness = 'm.npz'\nunits = 'kg, m, s'\nforce = 0\nabsorber = 1\nmodes = 3\nmass_kg = 3\ndamping_ratio = 0.01\n"


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("kind", [pytest.param(kind, marks=() if kind == "shock" else pytest.mark.nightly) for kind in KINDS])
@pytest.mark.parametrize("structure", ["the paper's beam", "matrices"])
def test_each_kind_goes_through_sweep_and_comparison(kind: str, structure: str, tmp_path: Path) -> None:
    """Linear concepts leave the same at each intensity, and what is left without one grows with it, but for a decay time."""
    own, omegas = tmp_path / "structure.toml", modal_model(Beam(modes=2)).omega
    own.write_text(PAPER)
    if structure == "matrices":
        mass, stiffness = np.diag([1.0, 0.5, 1.5]), 1e4 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
        omegas = np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True))
        np.savez(tmp_path / "m.npz", M=mass, K=stiffness)
        own.write_text(CHAIN + "base_vector = [1.0, 1.0, 1.0]\n")
    omega = float(omegas[0])
    (tmp_path / "load.toml").write_text(tables_of(omega, tmp_path)[kind])
    given = ["--structure", own, "--load", tmp_path / "load.toml"]
    absorber = ("--restitution", 0.7) if kind == "force" else ("--absorber", "none")
    result = sweep(*given, *absorber, "--json", tmp_path / "out.json")
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["response_level_m"][0] > 0
    assert found["pseudo_periods"] == pytest.approx(8, rel=1e-6)
    result = call(imported("compare_absorbers"), *given, "--members", 1, "--forces", 2, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "summary.json").read_text())
    bands = 2 if kind in ("tones", "orders") else np.sum(omegas < 7 * omega) if kind == "base" else 1
    assert len(found["without_absorber"]) == bands
    for band, (low, high) in enumerate(found["without_absorber"]):
        assert high / low == pytest.approx(1.0 if found["measure"] == "decay" else 25.0, rel=1e-6)
        assert np.ptp([bands[1] for bands in found["ratio_5_50_95"]["tuned"][band]]) < 1e-6
