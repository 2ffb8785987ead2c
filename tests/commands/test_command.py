"""The console command: from a wheel without a checkout, from the checkout, and without an extra."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from places import ROOT, SCRIPTS

from optimisation import command

POSIX_ONLY = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "termios", "tty"}


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the built wheel is installed."""
    pytest.importorskip("hatchling")
    pytest.importorskip("pip")
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)], cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    install = ["install", "-q", "--no-deps", "--no-compile", "--disable-pip-version-check", "--target", str(folder / "site"), str(wheel)]
    subprocess.run([sys.executable, "-m", "pip", *install], check=True, capture_output=True)
    return folder / "site"


def run(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Call the installed command from a folder that is no checkout."""
    environment = os.environ | {"PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1", "COLUMNS": "160"}
    program = next((installed / "bin").glob("impact-absorber*"))
    return subprocess.run([program, *arguments], cwd=folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300)


def scripts() -> list[Path]:
    return sorted((SCRIPTS).glob("[!_]*.py"))


def test_a_wheel_lists_all_scripts(installed: Path, tmp_path: Path) -> None:
    result = run(installed, tmp_path, "--help")
    assert result.returncode == 0, result.stderr
    assert [line.split()[0] for line in result.stdout.partition("NAME is one of:")[2].splitlines() if line[2:3].strip()] == [
        s.stem for s in scripts()
    ]
    assert "Give the cavity's gap for a force by the design rule" in result.stdout


def test_a_wheel_runs_a_study_without_a_checkout(installed: Path, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    result = run(installed, tmp_path, "tune_ltva", "--quick", "--modes", "1")
    assert result.returncode == 0, result.stderr
    assert "written: results" in result.stdout
    (folder,) = (tmp_path / "results").iterdir()
    assert {file.name for file in folder.iterdir()} == {"tunings.csv", "summary.json", "tunings.png"}
    assert json.loads((folder / "summary.json").read_text())["settings"]["modes"] == 1


@pytest.mark.parametrize("arguments", [("no_such_script",), ("_table",), ("../lib/set_up",), ("design_gap", "--force", "-1")])
def test_bad_input_is_one_error(installed: Path, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    result = run(installed, tmp_path, *arguments)
    assert result.returncode == 2
    assert "Error: " in result.stderr
    assert "Traceback" not in result.stderr


def test_each_script_names_itself_by_the_command() -> None:
    for script in scripts():
        if not command.missing_extras(script):
            result = CliRunner().invoke(command.main, [script.stem, "--help"], prog_name="impact-absorber")
            assert result.exit_code == 0, result.output
            assert result.output.startswith(f"Usage: impact-absorber {script.stem} [OPTIONS]")


def test_whole_studies_go_to_results_without_a_checkout(installed: Path, tmp_path: Path) -> None:
    places = "import findings, stability, specialisation; print(*(m.OUT.as_posix() for m in (findings, stability, specialisation)))"
    pytest.importorskip("optuna")
    pytest.importorskip("distributed")
    paths = os.pathsep.join([str(installed), str(installed / "optimisation" / "shipped" / "scripts")])
    environment = os.environ | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
    result = subprocess.run([sys.executable, "-c", places], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["results/findings", "results/stability", "results/specialisation"]


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "show.py").write_text('"""Show one thing.\n\nMore words.\n"""\n\n# needs: rl, peers\n\nimport no_such_package_a\n')
    monkeypatch.setattr(command, "EXTRAS", {"no_such_package_a": "rl", "no_such_package_b": "peers", "no_such_package_c": "optimise", "json": "rl"})
    monkeypatch.setattr(command, "scripts_folder", lambda: tmp_path)
    listed = CliRunner().invoke(command.main, ["--help"])
    assert "Show one thing." in listed.output
    result = CliRunner().invoke(command.main, ["show"])
    assert result.exit_code == 1
    assert "(no_such_package_a, no_such_package_b)" in result.stderr
    assert 'pip install "impact-absorber-workbench[rl,peers]"' in result.stderr


def test_what_scripts_need_are_extras() -> None:
    for script in scripts():
        head = "\n".join(script.read_text().splitlines()[: command.HEAD_LINES])
        needed = {extra for line in command.NEEDS.findall(head) for extra in line.replace(",", " ").split()}
        assert needed <= set(command.EXTRAS.values()), script.name


def test_nothing_imports_what_one_system_has_alone() -> None:
    """But for scripts/lib, which the shell starts, and imports beside ``sys.platform``."""
    found = []
    for folder in ("impact_env", "optimisation", "scripts"):
        for file in (ROOT / folder).rglob("*.py"):
            if file.parent.name == "lib":
                continue
            for node in ast.parse(file.read_text()).body:  # what is imported whatever the system is
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                found += [(file.name, name) for name in names if name in POSIX_ONLY]
    assert found == []
