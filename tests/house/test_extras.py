"""An import names the missing optional package.

The tests run in new processes that cannot import the package.
"""

import os
import sys
import tomllib
from pathlib import Path

import pytest
from places import ROOT, SCRIPTS, fresh

from impact_env.extras import DISTRIBUTION, EXTRAS, how_to_install
from optimisation.cli.group import file_of, modules
from optimisation.cli.names import list_needs

SOLD_AS = {
    "stable_baselines3": "stable-baselines3",
    "sb3_contrib": "sb3-contrib",
    "h5py": "minari[hdf5]",
    "yaml": "PyYAML",
    "PIL": "pillow",
    "pygame": "pygame-ce",
}
IMPORTS = {
    "optuna": "optimisation.search.study",
    "cmaes": "optimisation.search.study",
    "distributed": "optimisation.search.cluster",
    "cvxpy": "optimisation.bounds.relaxation optimisation.tuned.certificate",
    "gymnasium": (
        "optimisation.rl.vec_env optimisation.rl.models optimisation.rl.training "
        "impact_env.envs.choices"
    ),
    "PIL": "impact_env.envs.drawing",
    "uvicorn": "optimisation.explore.server",
    "heyoka": "studies.accuracy.heyoka_peer",
    "mpmath": "reference.digits",
}
TRY = """
import importlib, sys
sys.prefix = "no checkout's own environment"
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {packages}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
for module in {modules}:
    try:
        importlib.import_module(module)
        print(module, "came through")
    except ImportError as error:
        print(module, type(error).__name__, error)
"""


def run_without_extras(code: str) -> list[str]:
    cache = os.environ.get(
        "IMPACT_ENV_CACHE", Path(sys.prefix) / "kernel-cache"
    )  # not in the folder that its sys.prefix names
    return fresh("-c", code, IMPACT_ENV_CACHE=cache).stdout.splitlines()


def expected(package: str) -> str:
    return (
        f"{package} is not installed; it comes with: pip install "
        f'"{DISTRIBUTION}[{EXTRAS[package]}]"'
    )


def test_an_import_names_the_extra() -> None:
    modules = {module: package for package, names in IMPORTS.items() for module in names.split()}
    lines = run_without_extras(TRY.format(packages=list(EXTRAS), modules=list(modules)))
    assert lines == [
        f"{module} MissingExtraError {expected(package)}" for module, package in modules.items()
    ]


def test_the_environments_need_nothing_that_learns() -> None:
    """The environments need no learning library.

    Each environment makes a step in a process that cannot import the packages of other extras.
    """
    pytest.importorskip("gymnasium")
    from impact_env.envs import ENVIRONMENTS

    others = [package for package, extra in EXTRAS.items() if extra != "env"]
    code = (
        TRY.format(packages=others, modules=[])
        + "import gymnasium, impact_env\nfor name in impact_env.envs.ENVIRONMENTS:\n"
    )
    code += (
        "    env = gymnasium.make(name, interval=1.0, render_mode='rgb_array')\n    "
        "env.reset(seed=0)\n"
    )
    code += "    env.step(env.action_space.sample())\n    print(env.render().shape)\n"
    assert run_without_extras(code) == ["(420, 640, 3)"] * len(ENVIRONMENTS)


def test_what_only_one_function_needs_is_named_by_it() -> None:
    pytest.importorskip("stable_baselines3")
    calls = {
        "recurrent()": "sb3_contrib",
        "_minari(Path('.')).__enter__()": "minari",
        "task_of('', {})": "gymnasium",
        "read()": "yaml",
        "evolve(*[None] * 7)": "cmaes",
        "_read_datasets(Path('.'))": "pyuff",
        "find_front(None)": "moocore",
    }
    code = (
        "from pathlib import Path\nfrom optimisation.rl.models import recurrent\nfrom "
        "optimisation.rl.demonstrations import _minari\n"
    )
    code += (
        "from optimisation.rl.families import task_of\nfrom optimisation.rl.hyperparameters "
        "import read\n"
    )
    code += (
        "from studies.admission import evolve\nfrom impact_env.records.from_uff import "
        "_read_datasets\n"
    )
    code += "from optimisation.search.pareto import find_front\n"
    packages = list(calls.values())
    code += (
        TRY.format(packages=packages, modules=[])
        + f"for package in {packages}: sys.modules.pop(package, None)\n"
    )
    code += "".join(
        f"try:\n    {call}\nexcept ImportError as error:\n    print(error)\n" for call in calls
    )
    for line, package in zip(run_without_extras(code), packages, strict=True):
        assert line == expected(package) or "h5py" in line


COMMANDS = """
import importlib.util
own = importlib.util.find_spec
importlib.util.find_spec = lambda name, *given: None if name.partition(".")[0] in {packages} else own(name, *given)
from click.testing import CliRunner
from optimisation.cli.group import file_of, main, missing_extras, modules
for name in modules():
    words = name.split()
    told = CliRunner().invoke(main, [*words, "--help"])
    print(name.replace(" ", "."), told.exit_code, repr(told.exception), "Usage: " in told.output)
    if missing_extras(file_of(name)):
        refused = CliRunner().invoke(main, words)
        print(name.replace(" ", "."), refused.exit_code, repr(refused.exception), " ".join(refused.stderr.split()))
"""


def test_every_command_tells_its_options_and_what_it_lacks() -> None:
    """All packages of extras out of reach, but for Pillow, which matplotlib brings."""
    packages = [package for package in EXTRAS if package != "PIL"]
    lines = run_without_extras(
        TRY.format(packages=packages, modules=[]) + COMMANDS.format(packages=packages)
    )
    helped = [line for line in lines if line.endswith("True")]
    refused = [line for line in lines if line not in helped]
    names = list(modules())
    assert helped == [f"{name.replace(' ', '.')} 0 None True" for name in names]
    assert [line.split()[0].replace(".", " ") for line in refused] == [
        name for name in names if list_needs(file_of(name))
    ]
    for line in refused:
        name = line.split()[0].replace(".", " ")
        error = (
            f"{name.replace(' ', '.')} 1 SystemExit(1) Error: {name} needs packages that are not "
            "installed ("
        )
        assert line.startswith(error)
        assert f'); they come with: pip install "{DISTRIBUTION}[' in line


def test_extras_are_those_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["name"] == DISTRIBUTION
    for package, extra in EXTRAS.items():
        name = SOLD_AS.get(package, package)
        assert any(
            requirement.startswith(name) for requirement in project["optional-dependencies"][extra]
        ), package


def test_in_a_checkouts_own_environment_its_own_set_up_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "prefix", str(ROOT / ".venv"))
    assert how_to_install("files") == f'python3 "{SCRIPTS / "lib" / "set_up.py"}" files'
    assert all((ROOT / "requirements" / f"{extra}.txt").is_file() for extra in EXTRAS.values())
