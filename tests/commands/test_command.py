"""The console command works from a wheel, from the checkout, and with declared packages only.

A wheel needs no checkout.
"""

import functools
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distribution,
    distributions,
    packages_distributions,
)
from pathlib import Path

import pytest
from commands import call
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from places import ROOT

from impact_env.extras import EXTRAS
from impact_env.kernels.compiling.cache import find_folders, hash_sources
from optimisation import executors
from optimisation.cli.group import imported
from optimisation.cli.names import HEADINGS, list_commands
from optimisation.executors import Bar, counting_bar, stages_bar

NAME = "impact-absorber-workbench"
FINDER = """
import os, sys
from importlib.machinery import PathFinder
refused = set(os.environ["REFUSED"].split())
class Declared(PathFinder):
    @classmethod
    def find_spec(cls, fullname, path=None, target=None):
        return None if fullname.partition(".")[0] in refused else super().find_spec(fullname, path, target)
sys.meta_path[sys.meta_path.index(PathFinder)] = Declared
"""


def needed(of: Distribution, extras: Iterable[str]) -> list[Requirement]:
    """Return the requirements of a distribution on this system, with these of its extras."""
    every = [Requirement(line) for line in of.requires or []]
    return [
        r
        for r in every
        if r.marker is None or any(r.marker.evaluate({"extra": extra}) for extra in ("", *extras))
    ]


def closure(project: Distribution, extras: Iterable[str]) -> set[str]:
    """Return the names of all distributions that a project and some extras require.

    Raises PackageNotFoundError if a distribution of an extra is not installed.
    """
    todo = [(project, frozenset(extras))]
    done = set()
    while todo:
        of, wanted = todo.pop()
        for requirement in needed(of, wanted):
            key = (canonicalize_name(requirement.name), frozenset(requirement.extras))
            if key in done:
                continue
            done.add(key)
            try:
                todo.append((project if key[0] == NAME else distribution(key[0]), key[1]))
            except PackageNotFoundError:
                if of is project:
                    raise
    return {name for name, _ in done}


@functools.cache
def refused(installed: Path, extras: tuple[str, ...]) -> str:
    """Return the installed modules that the project and the extras do not require.

    They are separated by blanks. The project is installed in the folder ``installed``.
    """
    (project,) = (
        distribution
        for distribution in distributions(path=[str(installed)])
        if canonicalize_name(distribution.name) == NAME
    )
    allowed = closure(project, extras) | {NAME}
    return " ".join(
        m
        for m, names in packages_distributions().items()
        if not allowed & {canonicalize_name(name) for name in names}
    )


def environment(installed: Path, extras: tuple[str, ...], hook: Path) -> dict[str, str]:
    """Return the environment variables of a process that can import only declared packages.

    The process and all that it starts import from the folder ``installed`` and from the declared
    packages. ``hook`` is a folder for the import hook.
    """
    (hook / "sitecustomize.py").write_text(FINDER)
    paths = os.pathsep.join([str(hook), str(installed)])
    return os.environ | {
        "PYTHONPATH": paths,
        "PYTHONSAFEPATH": "1",
        "COLUMNS": "160",
        "REFUSED": refused(installed, extras),
    }


BALANCE = "--modes 2 --method balance --harmonics 3 --no-sweeps"
STEEP = "--quick --modes 2 --rate 20 --members 2"
QUICK = {  # the shortest form of commands, where it is not --quick
    "periodic balance-error": "--modes 2 --harmonics 10 --weights 50 --no-branches",
    "cache": "info",
    "calibrate": f"{ROOT}/docs/examples/absorber_levels.toml --quick --free restitution",
    "design gap": "--quick --force 3.5",
    "design place": "--quick --force 3.5 --mass-ratio 0.02 --rate 40 --position 1",
    "doctor": "",
    "explore": "--help",  # it serves until Ctrl-C
    "rl evaluate": "--task GapChoice-v1 --episodes 4",
    "periodic branches": BALANCE,
    "periodic basins": "--modes 1 --restitution 0.75 --frequency 0.93 --starts 4",
    "periodic diagram": "--modes 1 --restitution 0.75 --frequency 0.93 --over force 1 1.5 --points 2 --no-branches",
    "periodic section": "--modes 1 --restitution 0.75 --frequency 0.93 --starts 1",
    "periodic curves": "--modes 1 --kind loss-of-contact --symmetric --from 1 --to 1.02 --over force 1.4 1.6",
    "periodic folds": "--modes 1 --from 0.93 --to 0.96",
    "periodic isola": "--modes 1 --from 0.93 --to 1",
    "periodic manifold": "--modes 1 --points 1",
    "design masses": "--rate 100 --members 1 --mass-ratio 0.02 --resonances 1",
    "design search": f"{STEEP} --batch 4 --designs 4 --no-figures",
    "periodic orbits": "--modes 3 --friction-limit 0.01 --frequency 0.95 --symmetric",
    "design pareto": f"{STEEP} --batch 4 --designs 4",
    "prepare": "",
    "rl demonstrations": "--task GapChoice-v1 --episodes 2",
    "rl export": "--task ActiveFriction-v0 --out rule.c",
    "rl render": "--frames 4 --gif film.gif",
    "structure": f"{ROOT}/docs/examples/steel_beam.toml",
    "sweep": "--modes 2 --from 0.98 --to 1 --rate 10 --energy --time --plot sweep.png",
    "rl train": "--quick --steps 512",
    "design tune": "--quick --modes 1",
}


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the built wheel is installed."""
    pytest.importorskip("hatchling")
    pytest.importorskip("pip")
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (wheel,) = folder.glob("*.whl")
    install = [
        "install",
        "-q",
        "--no-deps",
        "--no-compile",
        "--disable-pip-version-check",
        "--target",
        str(folder / "site"),
        str(wheel),
    ]
    subprocess.run([sys.executable, "-m", "pip", *install], check=True, capture_output=True)
    return folder / "site"


def run(
    installed: Path, folder: Path, *arguments: str, extras: tuple[str, ...] = (), **variables: str
) -> subprocess.CompletedProcess[str]:
    """Call the installed command from a folder outside the checkout.

    It can import no more packages than these extras require.
    """
    (folder / "hook").mkdir(exist_ok=True)
    variables = environment(installed, extras, folder / "hook") | variables
    program = next((installed / "bin").glob("impact-absorber*"))
    return subprocess.run(
        [program, *arguments],
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )


def declared(script: Path) -> tuple[str, ...]:
    """Return the extras that a script declares."""
    return tuple(
        re.sub(
            ",", " ", " ".join(re.findall(r"^# needs:(.*)$", script.read_text(), re.MULTILINE))
        ).split()
    )


def shipped() -> dict[str, Path]:
    """Return the modules of the commands that a wheel has."""
    known = list_commands()
    return {name: known[name] for names in HEADINGS.values() for name in names}


def test_a_wheel_lists_its_commands_under_headings(installed: Path, tmp_path: Path) -> None:
    result = run(installed, tmp_path, "--help")
    assert result.returncode == 0, result.stderr
    assert set(QUICK) <= set(shipped())
    headings = "".join(f"{heading}:(?:\\n  .*)*\\n+" for heading in HEADINGS)
    (lines,) = re.findall(headings, result.stdout)
    listed = {line.partition("  ")[0] for line in re.findall(r"^  (\S.*)$", lines, re.MULTILINE)}
    groups = {name for name in listed if name.endswith(" NAME")}
    assert groups == {"periodic NAME", "rl NAME"}
    of_groups = tuple(name.removesuffix("NAME") for name in groups)
    assert listed - groups == {name for name in shipped() if not name.startswith(of_groups)}
    assert "The gap of an impact absorber for a force" in result.stdout
    assert "scripts" not in result.stdout
    assert "reproduce" not in result.stdout
    assert {file.name for file in installed.iterdir() if file.suffix != ".dist-info"} - {"bin"} == {
        "impact_env",
        "optimisation",
    }
    for file in (
        "impact_env/py.typed",
        "optimisation/py.typed",
        "optimisation/rl/hyperparameters.yaml",
    ):
        assert (installed / file).is_file()


def test_another_name_is_one_error(installed: Path, tmp_path: Path) -> None:
    result = run(installed, tmp_path, "../lib/set_up")
    assert result.returncode == 2
    assert "Error: " in result.stderr
    assert "Traceback" not in result.stderr


def test_each_script_prints_its_help_without_any_extra(installed: Path, tmp_path: Path) -> None:
    code = (
        "import json, sys\nfrom click.testing import CliRunner\nfrom optimisation.cli.group "
        "import main\n"
    )
    code += (
        f"names = {sorted(shipped())}\nfound = [CliRunner().invoke(main, [*n.split(), '--help'], "
        "prog_name='impact-absorber') for n in names]\n"
    )
    code += "heavy = {'torch', 'cvxpy', 'optuna', 'gymnasium', 'distributed'} & set(sys.modules)\n"
    code += (
        "print(json.dumps([[[n, f.exit_code, f.output, repr(f.exception)] for n, f in zip(names, "
        "found)], sorted(heavy)]))"
    )
    call = [sys.executable, "-c", code]
    done = subprocess.run(
        call,
        cwd=tmp_path,
        env=environment(installed, (), tmp_path),
        capture_output=True,
        text=True,
        check=True,
    )
    texts, heavy = json.loads(done.stdout)
    assert [name for name, *_ in texts] == sorted(shipped())
    for name, code, output, error in texts:
        assert code == 0, f"{name}: {error} {output}"
        assert output.startswith(f"Usage: impact-absorber {name} [OPTIONS]")
        assert ("--json" in output) == ("--json FILE|-" in output or " --json -" in output)
    assert heavy == []


def test_what_is_not_declared_is_refused(installed: Path, tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    result = run(installed, tmp_path, "design", "search", "--quick")
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.endswith(
        'they come with: pip install "impact-absorber-workbench[optimise]"\n'
    )
    (tmp_path / "record.uff").write_text("    -1\n    58\n    -1\n")
    (tmp_path / "load.toml").write_text(
        '[load]\nkind = "samples"\nquantity = "force"\nfile = "record.uff"\n'
    )
    result = run(installed, tmp_path, "sweep", "--load", str(tmp_path / "load.toml"))
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == (
        "Error: pyuff is not installed; it comes with: pip install "
        '"impact-absorber-workbench[files]"\n'
    )


def test_a_shell_completes_without_any_extra(installed: Path, tmp_path: Path) -> None:
    for words, wanted in (
        ("impact-absorber periodic man", "manifold"),
        ("impact-absorber design search --samp", "--sampler"),
    ):
        typed = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        result = run(installed, tmp_path, _IMPACT_ABSORBER_COMPLETE="bash_complete", **typed)
        assert (result.returncode, result.stderr) == (0, "")
        assert wanted in result.stdout


@pytest.mark.wheel
@pytest.mark.parametrize("name", sorted(shipped()))
def test_a_quick_form_needs_no_more_than_what_is_declared(
    name: str, installed: Path, tmp_path: Path
) -> None:
    """The numbers of --json go to standard output, and nothing else does."""
    writes = "--json" in {name for one in imported(name).main.params for name in one.opts}
    try:
        result = run(
            installed,
            tmp_path,
            *name.split(),
            *QUICK.get(name, "--quick").split(),
            *(("--json", "-") if writes else ()),
            extras=declared(shipped()[name]),
        )
    except PackageNotFoundError as absent:
        pytest.skip(f"{absent} is not installed here")
    assert "Traceback" not in result.stderr
    assert result.returncode == 0, result.stderr
    if writes:
        assert json.loads(result.stdout)


def test_what_scripts_need_are_extras() -> None:
    for name, file in list_commands().items():
        # what tests need is no extra
        assert set(declared(file)) <= {*EXTRAS.values(), "browser", "test"}, name


OTHER = "0123456789abcdef"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kernels: two of today's sources, one of others, and what is none of ours."""
    parent = tmp_path / "kernels"
    for name, count in ((hash_sources(), 2), (OTHER, 1)):
        (parent / name / "kernels_0").mkdir(parents=True)
        for k in range(count):
            (parent / name / "kernels_0" / f"f.{k}.nbc").write_bytes(b"0" * 1000)
    (parent / "thesis").mkdir()
    (parent / "thesis" / "f.0.nbc").write_text("mine")
    (parent / "fedcba9876543210").symlink_to(parent / "thesis")
    monkeypatch.setenv("IMPACT_ENV_CACHE", str(parent))
    monkeypatch.setattr("numba.config.DISABLE_JIT", 0)
    find_folders.cache_clear()
    yield parent
    find_folders.cache_clear()


def test_kernels_are_counted_and_nothing_else_is_removed(cache: Path) -> None:
    result = call(imported("cache"))
    assert f"{cache / hash_sources()}: 2 kernels, 0.0 MB, of today's sources" in result.stdout
    assert f"{cache / OTHER}: 1 kernels" in result.stdout
    report = call(imported("doctor"), "--json", "-")
    kernels = json.loads(report.stdout)["cache"][0]["kept"]
    assert [(one["kernels"], one["size"], one["current"]) for one in kernels] == [
        (2, 2000, True),
        (1, 1000, False),
    ]
    for option, left in ((["--older"], {hash_sources()}), ([], set())):
        result = call(imported("cache"), "clear", *option)
        assert (result.exit_code, result.stdout) == (0, "removed: 1 folders, 0.0 MB\n")
        assert {path.name for path in cache.iterdir()} == {"thesis", "fedcba9876543210"} | left
    assert (cache / "thesis" / "f.0.nbc").read_text() == "mine"


@pytest.mark.parametrize("terminal", [False, True])
def test_without_a_terminal_lines_tell_how_far_it_is_and_what_is_left(
    terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    stderr = io.StringIO()
    stderr.isatty = lambda: terminal
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(executors, "EVERY", 0.0)
    with (
        Bar(total=4, desc="one", unit="run", leave=False, mininterval=0) as bar,
        counting_bar("two", "designs") as show,
        stages_bar("three") as stage,
    ):
        for done in (1, 2):
            bar.update()
            bar.refresh()
            show(done, 5)
            stage("deep", done, 7)
    text = stderr.getvalue()
    if terminal:
        assert {"\r", "|"} < set(text)
        return
    assert text.endswith("\n")
    assert not set(text) & {"\r", "\x1b", "|"}
    assert re.search(r"^one: +50% 2/4 run \[\d\d:\d\d, \d\d:\d\d left\]\n", text, re.M)
    assert "three: deep, 2 of 7 [" in text
