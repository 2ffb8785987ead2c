"""The suite on other machines: what is asked for, what counts as passed, and which rows of the page stay."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from places import SCRIPTS

SETTINGS = ("MKL_CBWR=COMPATIBLE", "MKL_CBWR=AVX2,STRICT", "ATEN_CPU_CAPABILITY=default", "OPENBLAS_CORETYPE=Nehalem", "OPENBLAS_CORETYPE=Haswell")
FINE, BROKEN = "def test_it():\n    pass\n", "def test_it():\n    assert 0\n"


@pytest.fixture
def checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    spec = importlib.util.spec_from_file_location("check_all", SCRIPTS / "lib" / "check_all.py")
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = tmp_path / "machines.md"
    page.write_text("before\n<!-- machines -->\n<!-- /machines -->\nafter\n")
    python = tmp_path / "check" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    for name, value in (("PAGE", page), ("packages", lambda _: ("3", "none")), ("environment", lambda *_: python)):
        monkeypatch.setattr(module, name, value)
    return module


def test_every_setting_and_version_is_on_some_machine(checks: Any) -> None:
    given = {f"{key}={value}" for machine in checks.MACHINES.values() for key, value in machine.settings.items()}
    assert {*SETTINGS, "NUMBA_CPU_NAME=generic", "NUMBA_CPU_FEATURES="} <= given
    assert {machine.python for machine in checks.MACHINES.values()} == {"3.11", "3.13"}
    asked = {name: set(checks.requirements(machine)) for name, machine in checks.MACHINES.items()}
    assert {"numpy==2.1", "scipy==1.14", "numba==0.65", "gymnasium==1.2"} < asked["oldest-versions"]
    assert {"numpy>=2.1,<3", "scipy>=1.14,<2", "numba>=0.65,<0.70", "gymnasium>=1.2,<2"} < asked["newest-versions"]
    assert not [line for line in asked["newest-versions"] if line.startswith(("torch", "llvmlite", "stable"))]
    assert any(machine.wheel for machine in checks.MACHINES.values())


@pytest.mark.parametrize(
    ("text", "passed", "failed", "fine"), [(FINE, "1", "0", True), (BROKEN, "0", "1", False), ("", "0", "no test ran (code 5)", False)]
)
def test_only_tests_that_ran_and_passed_make_a_machine_fine(checks: Any, tmp_path: Path, text: str, passed: str, failed: str, fine: bool) -> None:
    (tmp_path / "test_one.py").write_text(text)
    row, ok = checks.run("old-processor", checks.MACHINES["old-processor"], ["-n", "0", str(tmp_path / "test_one.py")])
    assert (row[4], row[5], ok) == (passed, failed, fine)


def test_a_machine_without_its_python_is_told_and_other_rows_stay(checks: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(*_: object) -> Path:
        raise FileNotFoundError("no python3.13 was found")

    first = ["old-processor", *map(str, range(8))]
    checks.fill(checks.PAGE, checks.PAGE, {"machines": checks.table({"old-processor": first})})
    monkeypatch.setattr(checks, "environment", absent)
    monkeypatch.setattr(sys, "argv", ["check_all", "--only", "newest-versions"])
    assert checks.main() == 1
    rows = checks.kept()
    assert rows["old-processor"] == first
    assert rows["newest-versions"][4] == "not run: no python3.13 was found"
    assert rows["oldest-versions"][4] == "not run"


def test_after_ctrl_c_finished_rows_are_kept(checks: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(name: str, *_: object) -> tuple[list[str], bool]:
        if name == "oldest-versions":
            raise KeyboardInterrupt
        return [name, *["1"] * 8], True

    monkeypatch.setattr(checks, "run", run)
    monkeypatch.setattr(sys, "argv", ["check_all"])
    assert checks.main() == 130
    assert checks.kept()["old-processor"][1] == "1"
    assert checks.kept()["oldest-versions"][4] == "not run"
