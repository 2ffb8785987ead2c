import ast
import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from places import ROOT, SCRIPTS

from impact_env.kernels.compiling import cache
from impact_env.parameters import ParameterError
from optimisation.files import held

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


# What differs on Windows, with its system calls faked: nobody has run this project there.


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


# What strangers meet: the page on a package index, the citation, and the files of a host, whose steps are calls of scripts.


ADDRESS = "https://host.example/owner/name"


def built(tmp_path: Path, address: str) -> Message:
    """Return the metadata of a wheel that is built with an address."""
    pytest.importorskip("hatchling")
    variables = os.environ | {"PROJECT_URL": address}
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, env=variables, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(name))


@pytest.mark.parametrize("address", ["", ADDRESS])
def test_the_page_on_an_index_has_no_link_that_leads_nowhere(tmp_path: Path, address: str) -> None:
    metadata = built(tmp_path, address)
    text = metadata.get_payload()
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)\s]+)\)", text)
    assert all(link.startswith("https://") for _, link in links)
    assert "<!--" not in text
    own = [(figure, link.removeprefix(f"{ADDRESS}/")) for figure, link in links if link.startswith(ADDRESS)]
    for figure, link in own:
        kind, tag, path = link.split("/", 2)
        assert (kind, tag) == ("raw" if figure else "blob", f"v{PROJECT['version']}")
        assert (ROOT / path.partition("#")[0]).exists()
    assert (len(own) > 20) == bool(address)
    assert len(metadata.get_all("Project-URL", [])) == (4 if address else 0)
    assert "fifth, but only in a certain range of forces" in " ".join(text.split())
    assert metadata["Version"] == PROJECT["version"]


def test_the_version_is_one_everywhere() -> None:
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    (first,) = re.findall(r"\A.*?^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE | re.DOTALL)
    assert first in (version, "Unreleased")


def steps(file: Path) -> list[str]:
    """Return the commands of a host's file, one for each entry of a matrix."""
    yaml = pytest.importorskip("yaml")
    found = []
    for job in yaml.safe_load(file.read_text())["jobs"].values():
        calls = job.get("strategy", {}).get("matrix", {}).get("call", [""])
        found += [step["run"].replace("${{ matrix.call }}", call) for step in job["steps"] if "run" in step for call in calls]
    return found


@pytest.mark.parametrize("name", ["tests", "release"])
def test_every_step_of_the_host_is_a_call_of_scripts(name: str) -> None:
    calls = steps(ROOT / ".github" / "workflows" / f"{name}.yml")
    assert calls
    for call in calls:
        program = call.split()[0]
        assert program.startswith(("scripts/", ".ci/"))
        assert os.access(ROOT / program, os.X_OK), call


def test_the_release_has_no_password_and_only_its_last_job_may_publish() -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    assert "secrets." not in text
    about = yaml.safe_load(text)
    assert about["permissions"] == {"contents": "read"}
    assert [name for name, job in about["jobs"].items() if "permissions" in job] == ["publish"]


def test_a_wheel_from_the_source_distribution_is_the_same(tmp_path: Path) -> None:
    """The hook and the README that it reads are in the source distribution."""
    pytest.importorskip("hatchling")
    build = [sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path)]
    subprocess.run([*build, "-t", "sdist"], cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(tmp_path / "source", **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))  # from Python 3.11.4 on
    (source,) = (tmp_path / "source").iterdir()
    subprocess.run([*build, "-t", "wheel"], cwd=source, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    (direct := tmp_path / "direct").mkdir()
    built(direct, "")
    (other,) = direct.glob("*.whl")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(other) as two:
        assert {i.filename: i.CRC for i in one.infolist()} == {i.filename: i.CRC for i in two.infolist()}
