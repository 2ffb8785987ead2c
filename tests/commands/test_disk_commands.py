"""Commands on bladed disks from files: levels by sector against closed forms, ensembles of mistuned disks, and refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import call, done
from drawing import saved_figures

from impact_env.ensemble import draw_members
from optimisation.cli import sweep as sweep_script

OMEGA = 200 * np.pi
DAMPING = 0.01
COUPLING = 0.05
MASS = 2.0
DISK = {
    "sectors": 3,
    "coupling": COUPLING,
    "frequency_hz": 100.0,
    "mass_kg": MASS,
    "damping_ratio": DAMPING,
    "engine_order": 1,
    "amplitude_n": 5.0,
}
IMPACT = {"kind": "impact", "gap": 1e-5, "restitution": 0.8}
AT_RATIO = ["--from", "1.01", "--to", "1.01", "--periods", "25"]


def write_disk(folder: Path, absorber: dict[str, Any] | None = None, **changes: Any) -> Path:
    """Write a disk's file; values of None are left out."""
    keys = {key: value for key, value in (DISK | changes).items() if value is not None}
    plain = {"cyclic": keys} | ({} if absorber is None else {"absorber": absorber})
    path = folder / "disk.json"
    path.write_text(json.dumps(plain))
    return path


def results(folder: Path, *arguments: object) -> dict[str, Any]:
    """Return the JSON of a sweep."""
    target = folder / "sweep.json"
    done(sweep_script, *arguments, "--json", target)
    return json.loads(target.read_text())


def stationary_levels(deviation: float, seed: int, omega: float, force: float) -> np.ndarray:
    """Return the RMS displacement (3,) in m of three coupled masses under a travelling force, by a linear solve with modal damping."""
    generator = np.random.default_rng([seed, 0])
    factors = 1 + deviation * generator.standard_normal(3)
    own = MASS * OMEGA**2
    stiffness = np.diag(own * (1 + 2 * COUPLING) * factors**2)
    stiffness -= own * COUPLING * (np.ones((3, 3)) - np.eye(3))
    squares, shapes = np.linalg.eigh(stiffness / MASS)
    pattern = force * np.exp(-2j * np.pi * np.arange(3) / 3)
    own_omegas = np.sqrt(squares)
    modal = (shapes.T @ pattern / MASS) / (squares - omega**2 + 2j * DAMPING * own_omegas * omega)
    return np.abs(shapes @ modal) / np.sqrt(2)


def test_levels_of_mistuned_disks_are_those_of_a_linear_solve(tmp_path: Path) -> None:
    """In the steady state at a constant frequency; members differ in mistuning, phase, and by a millionth in force."""
    disk = write_disk(tmp_path, mistuning={"frequency": 0.02, "seed": 4})
    plain = results(tmp_path, "--scene", disk, *AT_RATIO, "--start", "steady", "--members", 3)
    resonance = OMEGA * np.sqrt(1 + 4 * COUPLING * np.sin(np.pi / 3) ** 2)
    assert plain["reference_rad_s"] == pytest.approx(resonance, rel=1e-12)
    factors = draw_members(3, 0).factors
    for member in range(3):
        wanted = stationary_levels(0.02, 4 + member, 1.01 * resonance, 5.0 * factors[member])
        # the mean over 25 periods of 32 samples, whose first half window is cut
        np.testing.assert_allclose(plain["sector_level_m"][member], wanted, rtol=6e-3)
        assert plain["worst_sector"][member] == np.argmax(wanted)
        assert plain["worst_level_m"][member] == max(plain["sector_level_m"][member])
    assert plain["impacts"] == [0, 0, 0]


@pytest.mark.parametrize("options", [[], ["--members", "2"]])
def test_absorbers_of_a_disk_hit_and_are_drawn(
    tmp_path: Path, options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = write_disk(tmp_path, IMPACT, absorber_sectors=[0, 2])
    run = ["--scene", disk, *AT_RATIO, *options]
    figures = saved_figures(monkeypatch)
    printed = done(sweep_script, *run, "--plot", tmp_path / "a.png").output
    plain = results(tmp_path, *run)
    assert plain["impacts"][0] > 10
    assert "absorbers in sectors 0, 2: each impact absorber" in printed
    assert "3 sectors; engine order 1, forward; no mistuning" in printed
    worst = plain["worst_sector"][0]
    assert f"sector {worst}, around 1.0100 times the resonance" in printed
    assert ("median of 2 disks" in printed) == bool(options)
    rows = [line.split("|")[1:3] for line in printed.splitlines() if line.startswith("| ")][2:]
    assert [(int(sector), flag.strip()) for sector, flag in rows] == [
        (0, "yes"),
        (1, "no"),
        (2, "yes"),
    ]
    (figure,) = figures
    bars = figure.axes[1].patches[:3]
    levels = plain["sector_level_m"][0]
    np.testing.assert_allclose([bar.get_width() for bar in bars], 1e3 * np.array(levels))
    assert plain["scene"]["cyclic"]["absorber_sectors"] == [0, 2]


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, ["--energy"], "--energy does not go with a bladed disk"),
        ({}, ["--measures"], "--measures does not go with a bladed disk"),
        ({"amplitude_n": None}, [], "force = None is not allowed: given in N, or amplitude_n"),
        ({}, ["--resonance", "4"], "resonance = 4 is not allowed: a mode of the model, 1 to 3"),
        ({"coupling": -1.0}, [], "scene.cyclic.coupling = -1.0"),
        ({}, ["--load", "shock:1:0.001:0.1"], "forces of one phase"),
        ({}, ["--method", "moreau"], "forces of one phase"),
    ],
)
def test_what_a_disk_cannot_do_is_one_error(
    tmp_path: Path, changes: dict[str, Any], arguments: list[str], message: str
) -> None:
    target = tmp_path / "a.json"
    disk = write_disk(tmp_path, IMPACT, **changes)
    result = call(sweep_script, "--scene", disk, *arguments, "--json", target)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert not target.exists()


def test_a_disk_is_no_structure_of_other_commands(tmp_path: Path) -> None:
    result = call(sweep_script, "--structure", write_disk(tmp_path))
    assert result.exit_code == 2
    assert "a bladed disk is given with its absorbers" in result.output
