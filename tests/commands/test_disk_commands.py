"""Commands on bladed disks from files agree with closed forms and refuse wrong files.

Levels by sector and ensembles of mistuned disks are tested.
"""

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from commands import call, done, read
from drawing import saved_figures

from impact_env import Drive, ModalModel, Scene, impact_absorber
from impact_env.ensemble import Lane, draw_members, run_lanes
from impact_env.plain import to_disk
from impact_env.structures.cyclic import BladedDisk
from optimisation import executors
from optimisation.cli import compare as compare_absorbers
from optimisation.cli import design_gap
from optimisation.cli import sweep as sweep_script
from optimisation.disks import (
    disk_case,
    equivalent_sector,
    friction_dampers,
    with_common_gap,
    worst_levels,
)

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


def stationary_levels(
    deviation: float, seed: int, omega: float, force: float, pattern: np.ndarray | None = None
) -> np.ndarray:
    """Return the RMS displacement (3,) in m of three coupled masses.

    It follows from a linear solve with modal damping.

    ``pattern`` (3,): of the force over the sectors; None: a travelling one.
    """
    generator = np.random.default_rng([seed, 0])
    factors = 1 + deviation * generator.standard_normal(3)
    own = MASS * OMEGA**2
    stiffness = np.diag(own * (1 + 2 * COUPLING) * factors**2)
    stiffness -= own * COUPLING * (np.ones((3, 3)) - np.eye(3))
    squares, shapes = np.linalg.eigh(stiffness / MASS)
    pattern = np.exp(-2j * np.pi * np.arange(3) / 3) if pattern is None else pattern
    own_omegas = np.sqrt(squares)
    modal = (shapes.T @ (force * pattern) / MASS) / (
        squares - omega**2 + 2j * DAMPING * own_omegas * omega
    )
    return np.abs(shapes @ modal) / np.sqrt(2)


def test_levels_of_mistuned_disks_are_those_of_a_linear_solve(tmp_path: Path) -> None:
    """Levels of mistuned disks are those of a linear solve.

    The disk is in the steady state at a constant frequency. Members differ in mistuning, in phase,
    and by a millionth in force.
    """
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


def test_a_load_acts_on_the_sector_that_is_its_place(tmp_path: Path) -> None:
    disk = write_disk(tmp_path, mistuning={"frequency": 0.02, "seed": 4})
    tone = [{"amplitude_n": 3.0, "frequency_hz": 107.0}]
    load = {"kind": "tones", "tones": tone, "duration_s": 0.25, "place": 1}
    (tmp_path / "load.json").write_text(json.dumps({"load": load}))
    run = ["--scene", disk, "--load", tmp_path / "load.json", "--start", "steady"]
    plain = results(tmp_path, *run)
    wanted = stationary_levels(0.02, 4, 2 * np.pi * 107.0, 3.0, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(plain["sector_level_m"][0], wanted, rtol=6e-3)
    (tmp_path / "load.json").write_text(json.dumps({"load": load | {"place": 3}}))
    result = call(sweep_script, *run)
    assert result.exit_code == 2
    assert "place = '3' is not allowed: one of the places" in result.output


@pytest.mark.parametrize("script", [compare_absorbers, design_gap])
def test_long_runs_of_disks_are_announced(
    tmp_path: Path, script: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "LONG_S", 0.0)
    disk = write_disk(tmp_path, IMPACT)
    run = ["--scene", disk, "--quick", "--rate", "50", "--out", tmp_path / "out"]
    assert "within a factor of three: " in done(script, *run).output


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


FAST = ["--rate", "60", "--quick"]


def disk_with(absorber: dict[str, Any] | None = None, **changes: Any) -> BladedDisk:
    """Return the disk with some keys changed."""
    plain: dict[str, Any] = {"cyclic": DISK | changes}
    disk = to_disk(plain if absorber is None else plain | {"absorber": absorber})
    assert disk is not None
    return disk


@pytest.mark.parametrize(("order", "direction"), [(1, "forward"), (1, "backward"), (0, "standing")])
def test_a_sector_of_a_travelling_wave_is_one_mass(order: int, direction: str) -> None:
    """A sector of a travelling wave moves as one mass.

    In steady motion at the resonance each mass moves like a single one with the frequency of its
    nodal diameter.
    """
    sector = equivalent_sector(disk_with(IMPACT, engine_order=order, direction=direction))
    omega = OMEGA * np.sqrt(1 + 4 * COUPLING * np.sin(np.pi * order / 3) ** 2)
    assert sector.omega[0] == pytest.approx(omega, rel=1e-12)
    for name in ("force_shape", "tip_shape", "level_shape"):
        assert getattr(sector, name)[0] == pytest.approx(1 / np.sqrt(MASS), rel=1e-12), name
    assert sector.beam_mass == MASS


def test_uncoupled_sectors_have_the_level_of_a_single_absorber() -> None:
    """Uncoupled sectors have the level of a single absorber on a mass and a spring.

    The single absorber uses other kernels. The run is short, so that impacts do not amplify
    rounding errors.
    """
    disk = disk_with(IMPACT | {"gap": 2e-5}, coupling=0.0, engine_order=0)
    case = disk_case(disk, rate=400.0)
    (level,) = worst_levels(case, disk, case.force, range(1))
    model = ModalModel([OMEGA], [DAMPING], [MASS**-0.5], [MASS**-0.5], MASS)
    scene = Scene(model, impact_absorber(2e-5, 0.8, None, 0.02))
    lanes = [Lane(scene, Drive(5.0, one), steady_start=True) for one in case.schedules()]
    single = run_lanes(lanes, threads=1)
    assert level == pytest.approx(float(np.max(single.level)), rel=1e-6)
    assert np.min(single.impacts) >= 3


def test_one_clearance_and_dampers_replace_those_of_the_file() -> None:
    disk = disk_with(IMPACT | {"friction_limit": [0.1, 0.2, 0.4]})
    changed = with_common_gap(disk, 3e-5, 0.5)
    assert [one.walls.gap for one in changed.absorbers] == [3e-5] * 3
    assert [one.friction.limit for one in changed.absorbers] == [0.05, 0.1, 0.2]
    dampers = friction_dampers(disk, 5.0).absorbers
    assert all(one.walls is None and one.mass_ratio == 0.02 for one in dampers)


def test_design_gap_of_a_disk_writes_the_device(tmp_path: Path) -> None:
    disk = write_disk(tmp_path, IMPACT, mistuning={"frequency": 0.01, "seed": 1})
    device = tmp_path / "device.json"
    run = ["--scene", disk, *FAST, "--out", tmp_path / "gap", "--device", device]
    printed = done(design_gap, *run).output
    summary = json.loads((tmp_path / "gap" / "summary.json").read_text())
    gap = summary["recommended"]["gap_m"]
    again = to_disk(json.loads(device.read_text()))
    assert again is not None
    assert {one.walls.gap for one in again.absorbers} == {gap}
    levels = [row["median_level_m"] for row in summary["gaps"]]
    assert np.median(summary["sharp"]["worst_level_m"]) <= 1.0001 * min(levels)
    assert min(levels) < 0.95 * summary["without_absorbers_m"][0]  # so short sweeps build up little
    assert f"Recommended: a clearance of {1e3 * gap:.4g} mm to either wall" in printed
    rows = read(tmp_path / "gap" / "levels.csv")
    assert [float(row["gap_m"]) for row in rows] == [row["gap_m"] for row in summary["gaps"]]
    assert [float(row["median_level_m"]) for row in rows] == levels
    assert (tmp_path / "gap" / "levels.png").is_file()
    groups = json.loads((tmp_path / "gap" / "card.json").read_text())["groups"]
    rows = {row["label"]: row["value"] for rows in groups.values() for row in rows}
    assert rows["clearance to either wall"] == pytest.approx(1e3 * gap)
    level = np.median(summary["recommended"]["worst_level_m"])
    assert rows["of no absorbers"] == pytest.approx(
        100 * level / np.median(summary["without_absorbers_m"])
    )


def test_compare_of_a_disk_has_absorbers_dampers_and_none(tmp_path: Path) -> None:
    disk = write_disk(tmp_path, IMPACT, mistuning={"frequency": 0.02, "seed": 1})
    out = tmp_path / "compared"
    printed = done(compare_absorbers, "--scene", disk, *FAST, "--forces", 2, "--out", out).output
    summary = json.loads((out / "summary.json").read_text())
    forces = np.array(summary["forces_n"])
    np.testing.assert_allclose(forces, [2.5, 10.0])
    levels = {name: np.array(rows) for name, rows in summary["worst_level_m"].items()}
    linear = levels["no absorbers"]
    np.testing.assert_allclose(linear[1] / forces[1], linear[0] / forces[0], rtol=1e-12)
    factor = linear[1, 0] / forces[1] / summary["tuned_disk_without_absorbers_m_per_n"]
    (row,) = [line for line in printed.splitlines() if line.startswith("| no absorbers")]
    assert float(row.split("|")[2]) == pytest.approx(factor, rel=6e-3)
    assert "Tuned absorbers are left out" in printed
    rows = [row for row in read(out / "levels.csv") if row["absorber"] == "no absorbers"]
    assert [float(row["worst_level_m"]) for row in rows] == linear.ravel().tolist()
    assert set(levels) == {"no absorbers", "the file's absorbers", "friction dampers"}
    assert (out / "comparison.png").is_file()
    card = json.loads((out / "card.json").read_text())
    rows = card["groups"]["Level of the worst sector at 10 N on each"]
    for row, table in zip(rows, levels.values(), strict=True):
        assert row["value"].startswith(f"{1e3 * np.median(table[1]):.4g} mm")
    assert "Tuned absorbers are left out" in card["warnings"][0]


@pytest.mark.parametrize(
    ("script", "arguments", "message"),
    [
        (design_gap, ["--free", "restitution"], "--free does not go with a bladed disk"),
        (design_gap, ["--mass-ratio", "0.01"], "--mass-ratio does not go with a bladed disk"),
        (design_gap, ["--force-tolerance", "0.9"], "force_tolerance = 0.9"),
        (compare_absorbers, ["--load", "base:1"], "--load does not go with a bladed disk"),
        (compare_absorbers, ["--gap", "1e-3"], "--gap does not go with a bladed disk"),
    ],
)
def test_options_that_a_disk_has_not_are_one_error(
    tmp_path: Path, script: Any, arguments: list[str], message: str
) -> None:
    out = tmp_path / "out"
    result = call(script, "--scene", write_disk(tmp_path, IMPACT), *arguments, "--out", out)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())


def test_a_disk_without_absorbers_has_nothing_to_choose(tmp_path: Path) -> None:
    for script in (design_gap, compare_absorbers):
        result = call(script, "--scene", write_disk(tmp_path), "--out", tmp_path / "out")
        assert result.exit_code == 2
        assert "absorbers = 0 is not allowed" in result.output
