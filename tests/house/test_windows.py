"""What differs on Windows, with its system calls faked: nobody has run this project there."""

import ast
import importlib.util
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from places import ROOT, SCRIPTS

from impact_env.kernels.compiling import cache
from impact_env.parameters import ParameterError
from optimisation.files import held

POSIX_ONLY = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "termios", "tty"}


@pytest.fixture
def set_up(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module scripts/lib/set_up.py as Windows would load it; its locks are a set of files."""
    locked: set[int] = set()

    def locking(file: int, mode: int, count: int) -> None:
        assert (mode, count) == (2, 1)
        if locked & {os.fstat(file).st_ino}:
            raise PermissionError("locked")
        locked.add(os.fstat(file).st_ino)

    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setattr(sys, "platform", "win32")
    spec = importlib.util.spec_from_file_location("windows_set_up", SCRIPTS / "lib" / "set_up.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.locked = locked
    return module


def test_the_set_up_waits_for_another_one(set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    waited = []

    def sleep(seconds: float) -> None:
        waited.append(seconds)
        set_up.locked.clear()  # the other one is ready

    monkeypatch.setattr(time, "sleep", sleep)
    with set_up.lock(tmp_path):
        assert waited == []
        with set_up.lock(tmp_path):
            assert len(waited) == 1
    assert capsys.readouterr().err.count("waiting for it") == 1


def test_the_shell_finds_that_python_and_the_same_stamp(set_up: ModuleType, tmp_path: Path) -> None:
    root = tmp_path.resolve()
    for folder in ("requirements", "scripts/lib"):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "scripts/run"):
        shutil.copy2(ROOT / file, root / file)
    programs = {"tools/cygpath": 'echo "$2"', ".venv/Scripts/python.exe": 'echo "$MPLBACKEND|$*"'}
    for name, line in programs.items():
        (root / name).parent.mkdir(parents=True)
        (root / name).write_text(f"#!/bin/sh\n{line}\n")
        (root / name).chmod(0o755)
    (root / ".venv" / "stamps").mkdir()
    (root / ".venv" / "stamps" / "main").write_bytes(set_up.stamp_text(root, "main"))
    variables = os.environ | {"OSTYPE": "msys", "PATH": f"{root / 'tools'}{os.pathsep}{os.environ['PATH']}"}
    variables.pop("IMPACT_ENV_CACHE", None)
    done = subprocess.run([root / "scripts" / "run", "sweep", "a b"], env=variables, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert (done.stderr, done.returncode) == ("", 0)
    assert done.stdout == 'Agg|-P -c from optimisation.cli.start import main; main("scripts/run") sweep a b\n'


def test_a_file_that_is_held_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lock there keeps others from reading, so it is on a file beside."""
    import filelock

    locked = []
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(filelock, "lock_descriptor", lambda file, **_: locked.append(os.fstat(file).st_ino) is None)
    (path := tmp_path / "study.journal").write_text("kept")
    with held(path, ParameterError("held")):
        assert locked == [(tmp_path / "study.journal.lock").stat().st_ino]
        assert path.read_text() == "kept"


def test_without_users_by_number_the_temporary_folder_is_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "getuid")
    monkeypatch.setenv("USERNAME", "somebody")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache._private_folder() == tmp_path / "impact_env-somebody"
    assert cache._private_folder() == tmp_path / "impact_env-somebody"


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
