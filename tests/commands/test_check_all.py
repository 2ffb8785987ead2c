"""The suite on other machines: what counts as passed, and which rows of the page stay."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from places import SCRIPTS

FINE, BROKEN = "def test_it():\n    pass\n", "def test_it():\n    assert 0\n"


@pytest.fixture
def checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    spec = importlib.util.spec_from_file_location("check_all", SCRIPTS / "lib" / "check_all.py")
    module: ModuleType = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = tmp_path / "machines.md"
    page.write_text("before\n<!-- machines -->\n<!-- /machines -->\nafter\n")
    python = tmp_path / "check" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    for name, value in (("PAGE", page), ("ROOT", tmp_path), ("packages", lambda _: ("3", "none")), ("environment", lambda *_: python)):
        monkeypatch.setattr(module, name, value)
    return module


@pytest.mark.parametrize(
    ("text", "passed", "failed", "fine"), [(FINE, "1", "0", True), (BROKEN, "0", "1", False), ("", "0", "0, no test ran (code 5)", False)]
)
def test_only_tests_that_ran_and_passed_make_a_machine_fine(checks: Any, tmp_path: Path, text: str, passed: str, failed: str, fine: bool) -> None:
    (tmp_path / "test_one.py").write_text(text)
    row, ok = checks.run("old-processor", checks.MACHINES["old-processor"], ["-n", "0", str(tmp_path / "test_one.py")])
    assert (row[4], row[5], ok) == (passed, failed, fine)
