"""What `doctor` and `cache` say of an installation, and what `cache clear` removes and leaves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import call
from filelock import FileLock
from places import ROOT

from impact_env.kernels.compiling.cache import digest, folders
from optimisation import kept_kernels
from optimisation.cli.group import imported

OTHER = "0123456789abcdef"
COMPILE = """
from impact_env.kernels.compiling.jit import jit
@jit
def f(x):
    return x + 1
print(f(1))
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kernels: two of today's sources, one of others, and what is none of ours."""
    parent = tmp_path / "kernels"
    for name, count in ((digest(), 2), (OTHER, 1)):
        (parent / name / "kernels_0").mkdir(parents=True)
        for k in range(count):
            (parent / name / "kernels_0" / f"f.{k}.nbc").write_bytes(b"0" * 1000)
    (parent / "thesis").mkdir()
    (parent / "thesis" / "f.0.nbc").write_text("mine")
    (parent / "notes.txt").write_text("mine")
    (parent / "fedcba9876543210").symlink_to(parent / "thesis")
    (parent / "warm").touch()
    monkeypatch.setenv("IMPACT_ENV_CACHE", str(parent))
    monkeypatch.setattr("numba.config.DISABLE_JIT", 0)
    folders.cache_clear()
    yield parent
    folders.cache_clear()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_kernels_are_counted_by_their_sources(cache: Path) -> None:
    result = call(imported("cache"))
    assert result.exit_code == 0, result.output
    assert f"{cache / digest()}: 2 kernels, 0.0 MB, of today's sources" in result.stdout
    assert f"{cache / OTHER}: 1 kernels" in result.stdout
    assert "thesis" not in result.stdout
    told = call(imported("doctor"), "--json", "-")
    kept = json.loads(told.stdout)["cache"][0]["kept"]
    assert [(one["kernels"], one["size"], one["current"]) for one in kept] == [(2, 2000, True), (1, 1000, False)]


@pytest.mark.parametrize("older", [False, True])
def test_only_kernels_are_removed(cache: Path, older: bool) -> None:
    result = call(imported("cache"), "clear", *["--older"] * older)
    assert (result.exit_code, result.stdout) == (0, f"removed: {2 - older} folders, 0.0 MB\n")
    assert names(cache) == {"thesis", "notes.txt", "fedcba9876543210"} | ({digest(), "warm"} if older else set())
    assert (cache / "thesis" / "f.0.nbc").read_text() == "mine"


def test_what_another_process_writes_into_is_not_removed(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_kernels, "PATIENCE", 0.1)
    with FileLock(cache / digest() / "lock"):
        result = call(imported("cache"), "clear")
    assert result.exit_code == 1
    assert str(cache / digest() / "lock") in result.stderr
    assert len(names(cache / digest() / "kernels_0")) == 2


def test_kernels_are_compiled_again_after_that(cache: Path, tmp_path: Path) -> None:
    (script := tmp_path / "script.py").write_text(COMPILE)
    variables = os.environ | {"PYTHONPATH": str(ROOT)}
    for found in (3, 1):
        assert subprocess.run([sys.executable, script], env=variables, capture_output=True, text=True, check=True).stdout == "2\n"
        assert f"{cache / digest()}: {found} kernels" in call(imported("cache")).stdout
        assert call(imported("cache"), "clear").exit_code == 0


def test_nothing_is_kept_where_nothing_is_compiled(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)
    folders.cache_clear()
    assert "No kernels are kept" in call(imported("cache"), "clear").stdout
    assert "NUMBA_DISABLE_JIT is set" in call(imported("doctor")).stdout
    assert len(names(cache / OTHER / "kernels_0")) == 1


def test_an_extra_that_is_absent_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    doctor = imported("doctor")
    monkeypatch.setattr(doctor, "EXTRAS", {"no_such_package": "files", "numpy": "env"})
    lines = call(doctor).stdout.splitlines()
    assert next(line for line in lines if line.startswith("extras")).split() == ["extras", "env"]
    assert "lacks no_such_package; it comes with: " in next(line for line in lines if line.startswith("no files"))
