"""scripts/orbits.py: its JSON contract, and what it prints."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from places import EXAMPLES

from impact_env import Drive, InitialState, constant_frequency, simulate
from impact_env.periodic import Orbit, orbit_of, unpacked
from impact_env.plain import to_scene
from optimisation.cli import orbits

KEYS = {"omega_ratio", "period_multiple", "symmetric", "impacts", "tip_max_m", "tip_rms_m", "stable", "residual"}
KEYS |= {"scene", "force_N", "omega_rad_s", "period_s", "events", "held_rad", "start"}
PAPER = ["--modes", "3", "--friction-limit", "0.01", "--restitution", "1", "--force", "1.5"]
ONE_MODE = ["--modes", "1", "--restitution", "0.75", "--force", "1.5"]


def call(*arguments: str) -> Result:
    return CliRunner().invoke(orbits.main, list(arguments))


def listed(tmp_path: Path, *arguments: str) -> tuple[str, list[dict[str, Any]]]:
    target = tmp_path / "orbits.json"
    result = call(*arguments, "--json", str(target))
    assert result.exit_code == 0, result.output
    content = json.loads(target.read_text(encoding="utf-8"))
    assert isinstance(content, list)
    return result.output, content


def test_the_orbits_over_a_range_have_exactly_the_promised_keys(tmp_path: Path) -> None:
    output, found = listed(tmp_path, *PAPER, "--from", "0.93", "--to", "0.96", "--points", "4")
    assert [orbit["omega_ratio"] for orbit in found] == pytest.approx([0.94, 0.94, 0.95, 0.95], abs=1e-12)
    for orbit in found:
        assert set(orbit) == KEYS | {"half_multipliers"}
        assert orbit["symmetric"] is True
        assert [set(impact) for impact in orbit["impacts"]] == [{"phase_rad", "impulse_Ns", "wall"}] * 2
        assert all(impact["impulse_Ns"] * impact["wall"] < 0 and 0 <= impact["phase_rad"] < 2 * np.pi for impact in orbit["impacts"])
        assert orbit["stable"] == (max(np.hypot(*pair) for pair in orbit["half_multipliers"]) < 1)
        assert len(orbit["half_multipliers"]) == 8
        assert orbit["residual"] < 1e-10
        assert 0 < orbit["tip_rms_m"] < orbit["tip_max_m"]
    assert "4 orbits, 0 of them stable." in output


def test_an_orbit_of_a_file_can_be_read_back_and_run_again(tmp_path: Path) -> None:
    _, found = listed(tmp_path, *PAPER, "--at", "0.95", "--symmetric")
    for plain in found:
        orbit = orbit_of(plain)
        assert isinstance(orbit, Orbit)
        assert orbit.motion.tip_max == pytest.approx(plain["tip_max_m"], rel=1e-9)
        struck = [event for event in plain["events"] if event["wall"]]
        assert all(any(abs(event["phase_rad"] - impact["phase_rad"]) < 1e-9 for impact in plain["impacts"]) for event in struck)
        scene, start = to_scene(plain["scene"]), plain["start"]
        run = Drive(plain["force_N"], constant_frequency(plain["omega_rad_s"], 1.0, plain["period_multiple"]), start["phase_rad"])
        first = InitialState(start["modal_displacement"], start["modal_velocity"], start["absorber_displacement_m"], start["absorber_velocity_m_s"])
        end = simulate(scene, run, initial=first).end_state
        assert end == pytest.approx(first.vector(scene), abs=1e-9)


def test_on_a_structure_gap_and_force_follow_from_each_other_by_the_design_rule(tmp_path: Path) -> None:
    """Both are proportional, and so are orbits: those at the rule's gap for the rule's force for 1 mm are those of 1 mm."""
    where = ["--structure", str(EXAMPLES / "steel_beam.toml"), "--at", "0.97", "--symmetric"]
    _, usual = listed(tmp_path, *where)
    assert usual
    force = usual[0]["force_N"]
    _, again = listed(tmp_path, *where, "--force", repr(force / 2))
    for plain, half in zip(usual, again, strict=True):
        assert to_scene(plain["scene"]).absorber.walls.gap == pytest.approx(1e-3)
        assert to_scene(half["scene"]).absorber.walls.gap == pytest.approx(5e-4, rel=1e-9)
        assert half["tip_max_m"] == pytest.approx(plain["tip_max_m"] / 2, rel=1e-6)


def test_branches_over_the_force_hold_both_ends_of_an_s(tmp_path: Path) -> None:
    """Low and high orbits of one frequency lie on one branch over the force, which turns where its fold force is."""
    _, (branch,) = listed(tmp_path, "--modes", "2", "--force", "3", "--at", "0.95", "--along", "force", "--over", "1", "6")
    assert max(branch["force_N"]) == pytest.approx(6, rel=1e-6)
    entries = list(unpacked(branch["orbits"]))
    assert len(entries) == sum(tip is not None for tip in branch["tip_max_m"])
    for entry in entries[:: len(entries) // 4]:
        orbit = orbit_of(entry)
        assert isinstance(orbit, Orbit)
        assert orbit.case.omega_ratio == pytest.approx(0.95)
        assert any(abs(force - orbit.case.force) < 1e-12 for force in branch["force_N"])
        assert orbit.motion.tip_max == pytest.approx(entry["tip_max_m"], rel=1e-7)
    (fold,) = (mark for mark in branch["located"] if mark["kind"] == "fold")
    _, levels = listed(tmp_path, "--modes", "2", "--force", f"{fold['force_N']:.9f}", "--folds", "--from", "0.94", "--to", "0.96")
    assert min(abs(level["omega_ratio"] - 0.95) for level in levels) < 1e-5


def test_one_frequency_has_what_runs_settle_to_as_well(tmp_path: Path) -> None:
    _, found = listed(tmp_path, *ONE_MODE, "--at", "0.93")
    assert {orbit["omega_ratio"] for orbit in found} == {0.93}
    sided = [orbit for orbit in found if not orbit["symmetric"]]
    assert len(sided) == 2
    for orbit in sided:
        assert set(orbit) == KEYS | {"multipliers"}
        assert orbit["stable"] is True
        assert orbit["period_multiple"] == 1
    one, other = (sorted((impact["wall"], impact["phase_rad"], impact["impulse_Ns"]) for impact in orbit["impacts"]) for orbit in sided)
    for (wall, phase, impulse), (_, there, back) in zip(one, other[::-1], strict=True):
        assert back == pytest.approx(-impulse, rel=1e-8), wall
        assert np.exp(1j * there) == pytest.approx(-np.exp(1j * phase), abs=1e-8)


def test_a_range_has_pairs_and_doubled_periods_unless_symmetric_ones_alone_are_wanted(tmp_path: Path) -> None:
    """N_m = 1, e = 0.8: between 0.9307 and 0.9353 a stable orbit has two periods of the force, which runs settle to (test_switching)."""
    arguments = ["--modes", "1", "--restitution", "0.8", "--force", "1.5", "--from", "0.932", "--to", "0.934", "--points", "3"]
    output, found = listed(tmp_path, *arguments)
    assert "one-sided, period 2" in output
    kinds = {(orbit["symmetric"], orbit["period_multiple"]) for orbit in found}
    assert kinds == {(True, 1), (False, 1), (False, 2)}
    doubled = [orbit for orbit in found if orbit["period_multiple"] == 2]
    assert any(orbit["stable"] for orbit in doubled)
    for orbit in doubled:
        assert len(orbit["impacts"]) == 4
        assert set(orbit) == KEYS | {"multipliers"}
        assert all(0 <= impact["phase_rad"] < 4 * np.pi for impact in orbit["impacts"])
    _, symmetric = listed(tmp_path, *arguments, "--symmetric")
    assert {(orbit["symmetric"], orbit["period_multiple"]) for orbit in symmetric} == {(True, 1)}
    assert [orbit["tip_max_m"] for orbit in symmetric] == pytest.approx([orbit["tip_max_m"] for orbit in found if orbit["symmetric"]])


def test_folds_and_thresholds(tmp_path: Path) -> None:
    _, found = listed(tmp_path, *PAPER, "--from", "0.93", "--to", "0.96", "--folds")
    assert all(set(fold) == {"omega_ratio", "force_N", "tip_max_m"} for fold in found)
    assert [fold["omega_ratio"] for fold in found] == pytest.approx([0.9336128203, 0.9336233427, 0.9552754578], abs=1e-9)
    assert {fold["force_N"] for fold in found} == {1.5}
    _, found = listed(tmp_path, *PAPER, "--from", "0.93", "--to", "1", "--thresholds")
    assert all(set(threshold) == {"kind", "force_N", "omega_ratio"} for threshold in found)
    assert [threshold["kind"] for threshold in found] == ["birth", "merger"]
    assert [threshold["force_N"] for threshold in found] == pytest.approx([1.221955, 2.370284], abs=1e-6)


def test_curves_over_two_parameters_are_in_all_files(tmp_path: Path) -> None:
    table, figure = tmp_path / "curves.csv", tmp_path / "curves.png"
    options = ["--curve", "fold", "--with", "force", "--over", "1", "2", "--from", "0.93", "--to", "0.95", "--symmetric"]
    output, curves = listed(tmp_path, *ONE_MODE, *options, "--csv", str(table), "--plot", str(figure))
    (curve,) = curves
    assert curve["kind"] == "fold"
    assert max(abs(real - 1) + abs(imaginary) for real, imaginary in curve["multiplier"]) < 1e-6
    places = [(at, force) for at, force in zip(curve["omega_ratio"], curve["value"], strict=True) if abs(force - 1.5) < 0.2]
    assert min(abs(at - 0.9433449134) for at, _ in places) < 0.005  # the fold at 1.5 N
    rows = table.read_text(encoding="utf-8").splitlines()
    assert rows[0].split(",")[5] == "force_N"
    assert len(rows) == 1 + len(curve["value"]) + len(curve["located"])
    assert figure.stat().st_size > 5000
    assert "Curve 1: " in output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--curve", "fold"], "--curve goes with --with"),
        (["--curve", "fold", "--with", "force", "--over", "2", "3"], "a range around 1.5"),
        (["--curve", "fold", "--with", "friction-limit", "--over", "0", "1"], "friction limits above 0"),
        (["--csv", "curves.csv"], "go with --curve"),
    ],
)
def test_options_of_curves_that_do_not_go_together_are_refused(options: list[str], words: str) -> None:
    result = call(*ONE_MODE, *options)
    assert result.exit_code == 2
    assert words in result.output
