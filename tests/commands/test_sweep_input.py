from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT
from sweep_command import SHORT, call

from optimisation.report import sweep_figure

BAD = {
    "--gap -1e-3": "gap = -0.001 is not allowed",
    "--gap nan": "gap = nan is not allowed",
    "--force nan": "force amplitude = nan is not allowed",
    "--force inf": "force amplitude = inf is not allowed",
    "--phase inf": "phase = inf is not allowed",
    "--restitution 2": "restitution = 2.0 is not allowed",
    "--modes 61": "modes = 61 is not allowed",
    "--modes 0": "modes = 0 is not allowed",
    "--modes ten": "'ten' is not a valid integer",
    "--damping -0.1": "damping_ratio = -0.1 is not allowed",
    "--mass-ratio 0": "mass_ratio = 0.0 is not allowed",
    "--friction-limit -1": "friction limit = -1.0 is not allowed",
    "--absorber friction --friction-limit 0": "friction limit = 0.0 is not allowed",
    "--absorber tuned --stiffness 0": "absorber stiffness = 0.0 is not allowed",
    "--absorber tuned --absorber-damping nan": "absorber damping = nan is not allowed",
    "--contact-stiffness 0": "contact stiffness = 0.0 is not allowed",
    "--resonance 3 --modes 2": "resonance = 3 is not allowed",
    "--resonance 0": "resonance = 0 is not allowed",
    "--from -1": "start ratio = -1.0 is not allowed",
    "--to nan": "stop ratio = nan is not allowed",
    "--rate 0": "percent_per_100_periods = 0.0 is not allowed",
    "--from 1 --to 1 --periods -5": "periods = -5.0 is not allowed",
    "--members 0": "members = 0 is not allowed",
    "--seed -1": "seed = -1 is not allowed",
    "--method moreau --steps-per-period 3": "steps_per_period = 3 is not allowed",
    "--method runge-kutta": "for rigid walls or rigid friction Exact or Moreau",
    "--method moreau --contact-stiffness 1e5": "for compliant contact Exact or RungeKutta",
    "--method euler": "'euler' is not one of",
    "--absorber rubber": "'rubber' is not one of",
    "--frobnicate": "--frobnicate",
    "extra": "unexpected extra argument",
    "--absorber tuned --gap 1e-3": "--gap does not go with --absorber tuned",
    "--absorber none --mass-ratio 0.1": "--mass-ratio does not go with --absorber none",
    "--absorber friction --restitution 1": "--restitution does not go with --absorber friction",
    "--absorber friction --contact-stiffness 1": "--contact-stiffness does not go with --absorber friction",
    "--stiffness 700": "--stiffness does not go with --absorber impact",
    "--contact-stiffness 1e5 --restitution 1": "restitution = 1.0 is not allowed: left out with contact_stiffness",
    "--friction-limit 1 --friction-stiffness 1e5": "walls and friction either both rigid or both compliant",
    "--contact-stiffness 1e5 --friction-stiffness 1e5": "friction_stiffness = 100000.0 is not allowed: left out without a friction_limit",
    "--steps-per-period 20": "--steps-per-period does not go with --method exact",
    "--most-events 0": "most_events = 0 is not allowed",
    "--most-events 1.5": "'1.5' is not a valid integer",
    "--most-events 5 --method moreau": "--most-events does not go with --method moreau",
    "--periods 10": "--periods is for a constant frequency",
    "--from 1 --to 1": "it needs --periods",
    "--from 1 --to 1 --periods 5 --rate 1": "--rate does not go with a constant frequency",
    "--from 1 --to 1 --periods 5 --down": "--down swaps --from and --to",
    "--from 1.06 --to 0.9 --down": "--down swaps --from and --to",
}


@pytest.mark.parametrize("arguments", BAD)
def test_bad_input_is_one_clear_error_and_leaves_no_file(arguments: str, tmp_path: Path) -> None:
    files = ["--json", str(tmp_path / "sweep.json"), "--plot", str(tmp_path / "sweep.png")]
    result = call(*arguments.split(), *files)
    assert result.exit_code == 2
    assert BAD[arguments] in result.output
    assert result.output.count("Error:") == 1
    assert list(tmp_path.iterdir()) == []


def test_bad_scene_files_are_one_clear_error(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text("[beam]\nmodes = 2\n")
    bad.write_text("[beam]\nlength = 2\n")
    cases = {
        ("--scene", str(bad)): "scene.beam.length = 2 is not allowed: only the keys length_m",
        ("--scene", str(tmp_path / "none.toml")): "none.toml' is not allowed: TOML that can be read",
        ("--scene", str(tmp_path / "scene.txt")): "a name that ends in .toml or .json",
        ("--scene", str(good), "--modes", "2"): "--modes does not go with --scene",
        ("--scene", str(good), "--absorber", "impact"): "--absorber does not go with --scene",
        ("--scene", str(good), "--gap", "0"): "--gap does not go with --scene",
        ("--scene", str(good), "--damping", "0"): "--damping does not go with --scene",
        ("--scene", str(good), "--steps-per-period", "20"): "--steps-per-period does not go with --method exact",
        ("--scene", str(good), "--resonance", "3"): "resonance = 3 is not allowed",
    }
    for arguments, message in cases.items():
        result = call(*arguments, "--json", str(tmp_path / "sweep.json"))
        assert result.exit_code == 2
        assert message in result.output
        assert result.output.count("Error:") == 1
    assert sorted(tmp_path.iterdir()) == [bad, good]


def test_bad_targets_are_refused_before_the_run(tmp_path: Path) -> None:
    cases = {
        ("--json", str(tmp_path / "nowhere" / "sweep.json")): "a file in a folder that exists",
        ("--json", str(tmp_path)): "is a directory",
        ("--json", "/dev/null"): "a plain file",
        ("--plot", str(tmp_path / "sweep.txt")): "a name that ends in .png, .pdf, .svg",
    }
    for arguments, message in cases.items():
        result = call(*SHORT, *arguments)
        assert result.exit_code == 2
        assert message in result.output
    endless = ["--from", "1", "--to", "1", "--periods", "1e9", "--plot", str(tmp_path / "sweep.png")]
    assert "--plot of 1e+09 pseudo periods needs" in call(*endless).output
    assert list(tmp_path.iterdir()) == []


def test_failure_while_writing_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path, *_: object) -> None:
        path.write_text("half a figure")
        raise OSError("disk full")

    monkeypatch.setattr(sweep_figure, "save_figure", fail)
    old, figure = tmp_path / "sweep.json", tmp_path / "sweep.png"
    old.write_text("older results")
    result = call(*SHORT, "--absorber", "none", "--json", str(old), "--plot", str(figure))
    assert result.exit_code != 0
    assert old.read_text() == "older results"
    assert list(tmp_path.iterdir()) == [old]


def test_the_process_ends_with_code_2(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "optimisation.cli.group", "sweep", "--gap", "-1", "--json", str(tmp_path / "sweep.json")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == "Error: gap = -1.0 is not allowed: a number in m, 0 or above (infinity: no wall)\n"
    assert list(tmp_path.iterdir()) == []
