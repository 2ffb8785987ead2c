"""Environment of the checkout, wheel, its page on an index and the host's files work.

Differences on Windows are tested too.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path
from types import ModuleType

import pytest
from places import ROOT, SCRIPTS, fresh, loaded

from impact_env.kernels.compiling import cache

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CALL = 'Agg|-P -c from optimisation.cli.start import main; main("scripts/run")'


def set_up() -> ModuleType:
    return loaded(SCRIPTS / "lib" / "set_up.py")


def test_simulator_imports_no_heavy_library() -> None:
    """The simulator imports no heavy library.

    Gymnasium is imported where it is installed, to register the environments. All other parts work
    without it.
    """
    code = (
        "import sys, pkgutil, importlib\n"
        "sys.modules['gymnasium'] = None\n"
        "import impact_env\n"
        "for m in pkgutil.iter_modules(impact_env.__path__, 'impact_env.'): "
        "importlib.import_module(m.name)\n"
        "heavy = {'matplotlib', 'torch', 'pygame', 'PIL', 'stable_baselines3', 'cvxpy', "
        "'optuna', 'optimisation'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    assert fresh("-c", code).stdout.strip() == "[]"


def test_every_dependency_is_pinned_once() -> None:
    chosen: dict[str, str] = {}
    for file in (ROOT / "requirements").glob("*.txt"):
        pins = dict(
            line.split("==")
            for line in file.read_text().splitlines()
            if line and not line.startswith("#")
        )
        assert file.stem != "main" or {
            dependency.split(">")[0] for dependency in PROJECT["dependencies"]
        } <= set(pins)
        for name, version in pins.items():
            assert chosen.setdefault(name, version) == version, (
                f"{name} has two versions in requirements/"
            )


def checkout_with(root: Path, python: str) -> Path:
    """Return a checkout with the command "show" and a dummy Python in its environment.

    This Python is at the place ``python`` in the environment and only prints how it was called.
    """
    for folder in ("requirements", "scripts/lib"):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "scripts/run"):
        shutil.copy2(ROOT / file, root / file)
    (root / "scripts" / "studies" / "cli").mkdir(parents=True)
    (root / "scripts" / "studies" / "cli" / "show.py").touch()
    program = root / ".venv" / python
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$MPLBACKEND|$*"\nexit 7\n')
    program.chmod(0o755)
    (root / ".venv" / "stamps").mkdir()
    (root / ".venv" / "stamps" / "main").write_bytes(set_up().stamp_text(root, "main"))
    return root


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    return checkout_with(tmp_path.resolve() / "a checkout", "bin/python")


def run(root: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {"IMPACT_ENV_CACHE", "PYTHON"}
    } | variables
    command = [root / "scripts" / "run", *arguments]
    return subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=60,
    )


@pytest.mark.parametrize("name", ["no_such_script", "../lib/set_up", "swep"])
def test_an_unknown_command_of_this_checkout_is_one_error(name: str) -> None:
    result = run(ROOT, name)
    assert (result.returncode, result.stdout) == (2, "")
    assert f"there is no command {name}" in result.stderr
    assert ("did you mean sweep" in result.stderr) == (name == "swep")


def test_a_checkout_lists_what_makes_its_pages() -> None:
    result = run(ROOT, "reproduce", "--help")
    assert result.returncode == 0
    assert all(
        f"  {file.stem.removeprefix('reproduce_').replace('_', '-')} " in result.stdout
        for file in (SCRIPTS / "studies" / "cli").glob("[!_]*.py")
    )


def test_script_runs_without_set_up_when_nothing_changed(checkout: Path) -> None:
    result = run(checkout, "show", "--force", "a b", PYTHON="/nonexistent", PATH="/usr/bin:/bin")
    assert (result.returncode, result.stdout, result.stderr) == (
        7,
        f"{CALL} show --force a b\n",
        "",
    )


def test_the_shell_finds_python_and_stamp_as_windows_has_them(tmp_path: Path) -> None:
    root = checkout_with(tmp_path.resolve(), "Scripts/python.exe")
    (root / "tools").mkdir()
    (root / "tools" / "cygpath").write_text('#!/bin/sh\necho "$2"\n')
    (root / "tools" / "cygpath").chmod(0o755)
    result = run(
        root, "show", "a b", OSTYPE="msys", PATH=f"{root / 'tools'}{os.pathsep}{os.environ['PATH']}"
    )
    assert (result.returncode, result.stdout, result.stderr) == (7, f"{CALL} show a b\n", "")


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
    # the set-up itself is replaced: here it only matters that it is called, and that its failure
    # ends the run
    (checkout / "scripts" / "lib" / "set_up.py").write_text(
        "import sys; print('set-up', *sys.argv[1:]); sys.exit(3)"
    )
    result = run(checkout, "show", PYTHON=sys.executable)
    assert (result.returncode, result.stdout, result.stderr) == (3, "", "set-up main kernels\n")


def test_missing_python_is_a_clear_error(checkout: Path, tmp_path: Path) -> None:
    (checkout / ".venv" / "stamps" / "main").unlink()
    (tools := tmp_path / "tools").mkdir()
    for tool in ("bash", "env", "dirname", "basename", "sed", "cat", "cmp", "find"):
        (tools / tool).symlink_to(str(shutil.which(tool)))
    result = run(checkout, "show", PATH=str(tools))
    assert result.returncode == 1
    assert "no Python 3.11" in result.stderr


def test_one_set_up_at_a_time(tmp_path: Path) -> None:
    with set_up().lock(tmp_path), (tmp_path / ".venv.lock").open("w") as other:
        assert not set_up().hold(other.fileno())
    with (tmp_path / ".venv.lock").open("w") as other:
        assert set_up().hold(other.fileno())


# What differs on Windows, with its system calls faked: nobody has run this project there.


POSIX_ONLY = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "termios", "tty"}


def test_without_user_numbers_the_temporary_folder_is_the_own_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "getuid")
    monkeypatch.setenv("USERNAME", "somebody")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert [cache._private_folder(), cache._private_folder()] == 2 * [
        tmp_path / "impact_env-somebody"
    ]


def test_nothing_imports_what_one_system_has_alone() -> None:
    """But for scripts/lib, which the shell starts, and imports beside ``sys.platform``."""
    for file in (
        file
        for folder in ("impact_env", "optimisation", "scripts/studies")
        for file in (ROOT / folder).rglob("*.py")
    ):
        for node in ast.parse(file.read_text()).body:  # what is imported whatever the system is
            names = (
                {alias.name for alias in node.names}
                if isinstance(node, ast.Import)
                else {getattr(node, "module", None)}
            )
            assert not names & POSIX_ONLY, file


# What strangers meet: the page on a package index, the citation, and the files of a host, whose
# steps are calls of scripts.


ADDRESS = "https://host.example/owner/name"


def built(folder: Path, target: str = "wheel", address: str = "", source: Path = ROOT) -> Path:
    """Return a distribution that is built with an address."""
    pytest.importorskip("hatchling")
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(
        command,
        cwd=source,
        env=os.environ | {"PROJECT_URL": address},
        check=True,
        capture_output=True,
    )
    (made,) = folder.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return made


@pytest.fixture(scope="module")
def plain_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of this checkout, without kernels and address."""
    return built(tmp_path_factory.mktemp("wheel"))


@pytest.mark.parametrize("address", ["", ADDRESS])
def test_the_page_on_an_index_has_no_link_that_leads_nowhere(
    tmp_path: Path, plain_wheel: Path, address: str
) -> None:
    wheel = built(tmp_path, address=address) if address else plain_wheel
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = message_from_bytes(archive.read(name))
    text = metadata.get_payload()
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)\s]+)\)", text)
    assert all(link.startswith("https://") for _, link in links)
    assert "<!--" not in text
    own = [
        (figure, link.removeprefix(f"{ADDRESS}/"))
        for figure, link in links
        if link.startswith(ADDRESS)
    ]
    for figure, link in own:
        kind, tag, path = link.split("/", 2)
        assert (kind, tag) == ("raw" if figure else "blob", f"v{PROJECT['version']}")
        assert (ROOT / path.partition("#")[0]).exists()
    assert (len(own) > 20) == bool(address)
    assert len(metadata.get_all("Project-URL", [])) == (4 if address else 0)
    assert "fifth, in a certain range of forces" in " ".join(text.split())
    assert metadata["Version"] == PROJECT["version"]


def test_the_version_is_one_everywhere() -> None:
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    (first,) = re.findall(
        r"\A.*?^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE | re.DOTALL
    )
    assert first in (version, "Unreleased")


@pytest.mark.parametrize("name", ["tests", "release"])
def test_every_step_of_the_host_is_a_call_of_scripts_and_only_the_releases_last_job_may_publish(
    name: str,
) -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text()
    about = yaml.safe_load(text)
    for job in about["jobs"].values():
        calls = job.get("strategy", {}).get("matrix", {}).get("call", [""])
        for command in (
            step["run"].replace("${{ matrix.call }}", call)
            for step in job["steps"]
            if "run" in step
            for call in calls
        ):
            program = command.split()[0]
            assert program.startswith(("scripts/", ".ci/")) or command.startswith("gh release ")
            assert program == "gh" or os.access(ROOT / program, os.X_OK), command
    assert "secrets." not in text
    assert about["permissions"] == {"contents": "read"}
    assert {
        job: own["permissions"] for job, own in about["jobs"].items() if "permissions" in own
    } == (
        {
            "publish": {"id-token": "write"},
            "github-release": {"contents": "write"},
            "pages": {"pages": "write", "id-token": "write"},
        }
        if name == "release"
        else {}
    )
    assert all(job["timeout-minutes"] <= 90 for job in about["jobs"].values())


def test_nothing_is_published_before_all_tests_have_passed() -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    jobs = yaml.safe_load(text)["jobs"]

    def needs(job: str) -> set[str]:
        named = jobs[job].get("needs", [])
        direct = {named} if isinstance(named, str) else set(named)
        return direct.union(*(needs(before) for before in direct))

    for job in jobs.keys() - {"tests", "build", "notes", "site"}:
        assert {"tests", "build", "notes", "site"} <= needs(job)
    assert [step["run"] for step in jobs["tests"]["steps"] if "run" in step] == [".ci/run"]


def test_the_notes_of_a_release_are_its_section_of_the_changelog() -> None:
    section_of = loaded(SCRIPTS / "lib" / "release_notes.py").section_of
    text = (
        "# Changelog\n\n## [1.1.0] - 2026-12-01\n\nNew.\n\n### Added\n\n- A.\n\n## [1.0.0] - "
        "2026-11-30\n\nOld.\n"
    )
    assert section_of("1.1.0", text) == "New.\n\n### Added\n\n- A."
    assert section_of("1.0.0", text) == "Old."
    with pytest.raises(ValueError, match=r"no section of version 1\.0"):
        section_of("1.0", text)


def test_a_wheel_from_the_source_distribution_is_the_same(
    tmp_path: Path, plain_wheel: Path
) -> None:
    """The hook and the README that it reads are in the source distribution."""
    with tarfile.open(built(tmp_path, "sdist")) as file:
        file.extractall(
            tmp_path / "source", **({"filter": "data"} if hasattr(tarfile, "data_filter") else {})
        )  # from Python 3.11.4 on
    (source,) = (tmp_path / "source").iterdir()
    with (
        zipfile.ZipFile(built(tmp_path, source=source)) as one,
        zipfile.ZipFile(plain_wheel) as two,
    ):
        assert {i.filename: i.CRC for i in one.infolist()} == {
            i.filename: i.CRC for i in two.infolist()
        }


@pytest.mark.parametrize("compiled", [False, True])
def test_a_wheel_says_in_its_name_what_its_kernels_are_for(
    tmp_path: Path, plain_wheel: Path, monkeypatch: pytest.MonkeyPatch, compiled: bool
) -> None:
    kernels = tmp_path / "made" / "digest" / "kernels"
    kernels.mkdir(parents=True)
    for name in ("f-1.py311.nbi", "f-1.py311.1.nbc", "lock"):
        (kernels / name).write_text(name)
    monkeypatch.setenv("KERNELS", str(tmp_path / "made"))
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    wheel = built(tmp_path) if compiled else plain_wheel
    assert wheel.stem.endswith(
        f"-{python}-{python}-manylinux_2_27_x86_64" if compiled else "-py3-none-any"
    )
    with zipfile.ZipFile(wheel) as archive:
        inside = {name.partition("shipped/")[2] for name in archive.namelist() if "shipped" in name}
    assert inside == (
        {"digest/kernels/f-1.py311.nbi", "digest/kernels/f-1.py311.1.nbc"} if compiled else set()
    )
