import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from places import ROOT, SCRIPTS

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def _pins(name: str) -> dict[str, str]:
    lines = (ROOT / "requirements" / f"{name}.txt").read_text().splitlines()
    return dict(line.split("==") for line in lines if line and not line.startswith("#"))


def _set_up_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("set_up", SCRIPTS / "lib" / "set_up.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_simulator_imports_no_heavy_library() -> None:
    """Gymnasium is imported where it is installed, to register the environments, and everything else works without it."""
    code = (
        "import sys, pkgutil, importlib\n"
        "sys.modules['gymnasium'] = None\n"
        "import impact_env\n"
        "for m in pkgutil.iter_modules(impact_env.__path__, 'impact_env.'): importlib.import_module(m.name)\n"
        "heavy = {'matplotlib', 'torch', 'pygame', 'PIL', 'stable_baselines3', 'cvxpy', 'optuna', 'optimisation'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_every_dependency_is_pinned_once() -> None:
    main = _pins("main")
    for dependency in PROJECT["dependencies"]:
        assert dependency.split(">")[0] in main
    layers = [file.stem for file in (ROOT / "requirements").glob("*.txt")]
    chosen: dict[str, str] = {}
    for layer in layers:
        for name, version in _pins(layer).items():
            assert chosen.setdefault(name, version) == version, f"{name} has two versions in requirements/"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one script and an environment whose python only tells how it was called."""
    root = tmp_path.resolve() / "a checkout"
    shutil.copytree(ROOT / "requirements", root / "requirements")
    shutil.copytree(SCRIPTS / "lib", root / "scripts" / "lib", ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "scripts/run"):
        shutil.copy2(ROOT / file, root / file)
    (root / "scripts" / "studies" / "cli").mkdir(parents=True)
    (root / "scripts" / "studies" / "cli" / "show.py").write_text('"""Show one thing.\n\nMore words.\n"""\n')
    stub = root / ".venv" / "bin" / "python"
    stub.parent.mkdir(parents=True)
    stub.write_text('#!/bin/sh\necho "$MPLBACKEND|$*"\nexit 7\n')
    stub.chmod(0o755)
    stamps = root / ".venv" / "stamps"
    stamps.mkdir()
    set_up = _set_up_module()
    for layer in ("main", "rl"):
        (stamps / layer).write_bytes(set_up.stamp_text(root, layer))
    return root


def _run(root: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in {"IMPACT_ENV_CACHE", "PYTHON"}} | variables
    return subprocess.run(
        [root / "scripts" / "run", *arguments], env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60
    )


@pytest.mark.parametrize("arguments", [("no_such_script",), ("../lib/set_up",), ("swep",)])
def test_an_unknown_command_of_this_checkout_is_one_error(arguments: tuple[str, ...]) -> None:
    result = _run(ROOT, *arguments)
    assert (result.returncode, result.stdout) == (2, "")
    assert f"there is no command {arguments[0]}" in result.stderr
    assert ("did you mean sweep" in result.stderr) == (arguments == ("swep",))


def test_a_checkout_lists_what_makes_its_pages() -> None:
    result = _run(ROOT, "--help")
    assert result.returncode == 0
    for file in (SCRIPTS / "studies" / "cli").glob("[!_]*.py"):
        assert f"  {file.stem} " in result.stdout


def test_script_runs_without_set_up_when_nothing_changed(checkout: Path) -> None:
    result = _run(checkout, "show", "--force", "a b", PYTHON="/nonexistent", PATH="/usr/bin:/bin")
    assert result.returncode == 7
    assert result.stdout == 'Agg|-P -c from optimisation.cli.start import main; main("scripts/run") show --force a b\n'
    assert result.stderr == ""


@pytest.mark.parametrize("change", ["requirements", "project", "interrupted", "moved", "no stamp"])
def test_set_up_is_due_again(checkout: Path, change: str) -> None:
    if change == "requirements":
        (checkout / "requirements" / "main.txt").open("a").write("# changed\n")
    elif change == "project":
        (checkout / "pyproject.toml").open("a").write("# changed\n")
    elif change == "interrupted":
        (checkout / ".venv" / "incomplete").touch()
    elif change == "moved":
        checkout = checkout.rename(checkout.with_name("elsewhere"))
    else:
        (checkout / ".venv" / "stamps" / "main").unlink()
    # the set-up itself is replaced: here it only matters that it is called, and that its failure ends the run
    (checkout / "scripts" / "lib" / "set_up.py").write_text("import sys; print('set-up', *sys.argv[1:]); sys.exit(3)")
    result = _run(checkout, "show", PYTHON=sys.executable)
    assert result.returncode == 3
    assert result.stdout == ""
    assert result.stderr == "set-up main kernels\n"


def test_missing_python_is_a_clear_error(checkout: Path, tmp_path: Path) -> None:
    (checkout / ".venv" / "stamps" / "main").unlink()
    tools = tmp_path / "tools"
    tools.mkdir()
    for tool in ("bash", "env", "dirname", "basename", "sed", "cat", "cmp", "find"):
        (tools / tool).symlink_to(str(shutil.which(tool)))
    result = _run(checkout, "show", PATH=str(tools))
    assert result.returncode == 1
    assert "no Python 3.11" in result.stderr
