"""The project's checks as sessions of nox.

``.venv/bin/nox --list`` names them, ``.venv/bin/nox -s NAME -- OPTIONS`` runs one.

``scripts/test``, ``scripts/lint``, ``scripts/docs`` and ``scripts/check_all`` make the checkout's
environment and start these sessions. Most run in that environment; ``oldest-versions`` and
``newest-versions`` make environments of their own in ``.venv-check``.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import nox
from nox.command import CommandFailed

ROOT = Path(__file__).parent
sys.path.insert(0, str(ROOT / "tests" / "support"))
from choice import (  # type: ignore[import-not-found]  # noqa: E402
    ARITHMETIC_GROUPS,
    GROUPS,
    KERNELS,
    OTHERS,
    QUICK_GROUPS,
    plain_files,
)

# programs are those beside the Python that runs nox, unless a session has an environment of its own
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])

# tests start a hundred processes: each would compile the sources to bytecode again, in half a
# second
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

nox.needs_version = ">=2026.4"
nox.options.envdir = ".venv-check"
nox.options.default_venv_backend = "venv"
nox.options.sessions = ["tests"]

# processes of tests share the cores: more threads for small matrices would only wait for one
# another
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
PYTEST = ("python", "-m", "pytest", "-q")
TWO_WORKERS = ("-n", "2", "--dist", "loadfile")
PROCESSES = 2  # run groups of tests at a time

# the arithmetic of older processors, in libraries that have several variants
OLD_LIBRARIES = {
    "MKL_CBWR": "COMPATIBLE",
    "ATEN_CPU_CAPABILITY": "default",
    "OPENBLAS_CORETYPE": "Nehalem",
}
OLD_NUMPY = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
VARIED = ("numpy", "scipy", "numba", "gymnasium")  # their oldest and newest versions are tested
# the files of requirements/ that tests need, but for torch and what comes with it
LAYERS = (
    "main",
    "test",
    "files",
    "dataframe",
    "nastran",
    "ansys",
    "optimise",
    "env",
    "docs",
    "cluster",
    "peers",
    "offline",
    "explore",
    "browser",
)


@nox.session(venv_backend="none", tags=["lint"])
def ruff(session: nox.Session) -> None:
    """Lint with ruff."""
    session.run("ruff", "check", ".")


@nox.session(venv_backend="none", tags=["lint"], name="format")
def check_format(session: nox.Session) -> None:
    """Check that ruff would format nothing."""
    session.run("ruff", "format", "--check", ".")


@nox.session(venv_backend="none", tags=["lint"])
def names(session: nox.Session) -> None:
    """Lint the names of functions, arguments and files."""
    session.run("python", "scripts/lib/lint_names.py")


@nox.session(venv_backend="none", tags=["lint"])
def mypy(session: nox.Session) -> None:
    """Check types."""
    session.run("mypy")


@nox.session(venv_backend="none", tags=["lint"])
def imports(session: nox.Session) -> None:
    """Check which package imports which."""
    session.run("lint-imports", env={"PYTHONPATH": "scripts:tests"})


@nox.session(venv_backend="none")
def docs(session: nox.Session) -> None:
    """Build the site; fail on warnings, broken links and what would be fetched from elsewhere."""
    build = ROOT / "build" / "site"
    shutil.rmtree(build, ignore_errors=True)
    strict = ("--fail-on-warning", "--keep-going", "-q")
    session.run("python", "-m", "sphinx", "-b", "html", *strict, "-c", "docs/site", ".", str(build))
    session.run("python", "scripts/lib/check_site.py", str(build))
    session.log("written: build/site/index.html")


@nox.session(venv_backend="none")
def tests(session: nox.Session) -> None:
    """Run all tests, those of every save with --quick, or what pytest makes of other arguments."""
    if session.posargs == ["--quick"]:
        run_groups(session, QUICK_GROUPS, {}, "--quick")
    elif session.posargs:
        session.run(*PYTEST, *TWO_WORKERS, *session.posargs, env=ONE_THREAD)
    else:
        # each kind of kernel is compiled once; two processes that need one at the same time would
        # both compile it
        session.run("python", "tests/support/kinds.py", env=ONE_THREAD)
        compiled = [(group, {"NUMBA_DISABLE_JIT": "0"}, "--kernels=compiled") for group in GROUPS]
        # to compile these kinds of scenes would take longer than their few events
        plain = (" ".join(plain_files()), {"NUMBA_DISABLE_JIT": "1"}, "--kernels=plain")
        run_jobs(session, [*compiled, plain])


@nox.session(venv_backend="none")
def arithmetic(session: nox.Session) -> None:
    """Run what depends on libraries' arithmetic with that of an old processor."""
    run_groups(
        session, ARITHMETIC_GROUPS, OLD_LIBRARIES, "-m=not wheel and not nightly and not slow"
    )


@nox.session(venv_backend="none", tags=["machines"], name="other-rounding")
def other_rounding(session: nox.Session) -> None:
    """Run with other last bits in every modal model, as another processor has them."""
    run_machine(session, OTHERS, {}, "--rounding=5")


@nox.session(venv_backend="none", tags=["machines"], name="old-libraries")
def old_libraries(session: nox.Session) -> None:
    """Run with libraries' arithmetic for old processors, and every command from the wheel."""
    run_machine(session, GROUPS, OLD_LIBRARIES | OLD_NUMPY, "-m=wheel or not wheel")


@nox.session(venv_backend="none", tags=["machines"], name="old-processor")
def old_processor(session: nox.Session) -> None:
    """Run with kernels that are compiled for no processor in particular."""
    variables = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    groups = (*KERNELS, "tests/simulator/test_*.py tests/periodic/test_*.py")
    run_machine(session, groups, variables | own_cache(session))


@nox.session(python="3.11", tags=["machines"], name="oldest-versions")
def oldest_versions(session: nox.Session) -> None:
    """Run with the oldest versions that pyproject.toml allows, and another arithmetic."""
    oldest = [one.split(",")[0].replace(">=", "==") for one in varied_ranges()]
    install(session, oldest, (*LAYERS, "rl", "clients"))
    variables = {"MKL_CBWR": "AVX2,STRICT", "OPENBLAS_CORETYPE": "Haswell"}
    run_machine(session, GROUPS, variables | own_cache(session))


@nox.session(python="3.13", tags=["machines"], name="newest-versions")
def newest_versions(session: nox.Session) -> None:
    """Run with the newest versions that pyproject.toml allows and another Python, without torch."""
    install(session, varied_ranges(), LAYERS)
    run_machine(session, GROUPS, own_cache(session))


def run_groups(
    session: nox.Session, groups: Sequence[str], variables: dict[str, str], *options: str
) -> None:
    """Run pytest on groups of tests with the same variables and options; see `run_jobs`."""
    run_jobs(session, [(group, variables, *options) for group in groups])


def run_jobs(session: nox.Session, jobs: Sequence[tuple[Any, ...]]) -> None:
    """Run pytest on groups of tests, each in a process of its own, `PROCESSES` at a time.

    Of a process that fails all that it printed is printed, else its last line. The session fails if
    a process does.

    Parameters
    ----------
    session : nox.Session
        The session.
    jobs : sequence of tuple
        For each group its patterns of files, relative to the checkout and separated by spaces, its
        environment variables, and options of pytest.
    """

    def run_job(job: tuple[Any, ...]) -> bool:
        patterns, variables, *options = job
        files = [str(path) for one in patterns.split() for path in sorted(ROOT.glob(one))]
        command = (*PYTEST, *options, *files)
        try:
            printed = session.run(*command, env=ONE_THREAD | variables, silent=True, log=False)
        except CommandFailed:
            return False
        session.log(f"{patterns}: {str(printed).splitlines()[-1]}")
        return True

    with ThreadPoolExecutor(PROCESSES) as executor:
        passed = list(executor.map(run_job, jobs))
    if not all(passed):
        failed = [job[0] for job, ok in zip(jobs, passed, strict=True) if not ok]
        session.error(f"{len(failed)} of {len(jobs)} groups failed: {', '.join(failed)}")


def run_machine(
    session: nox.Session, groups: Sequence[str], variables: dict[str, str], *options: str
) -> None:
    """Run groups with their nightly tests, or what the session's arguments say."""
    options = ("-m=not wheel", *options)
    if session.posargs:
        environment = ONE_THREAD | variables
        session.run(*PYTEST, *TWO_WORKERS, *options, *session.posargs, env=environment)
    else:
        run_groups(session, groups, variables, *options)


def own_cache(session: nox.Session) -> dict[str, str]:
    """Return the variable for kernels of this session alone."""
    return {"IMPACT_ENV_CACHE": str(ROOT / ".venv-check" / "kernels" / session.name)}


def varied_ranges() -> list[str]:
    """Return the ranges of `VARIED` in pyproject.toml, such as ``numpy>=2.1,<3``."""
    project = nox.project.load_toml(ROOT / "pyproject.toml")["project"]
    declared = project["dependencies"] + project["optional-dependencies"]["env"]
    return [one for one in declared if re.split("[<>=]", one)[0] in VARIED]


def install(session: nox.Session, requirements: list[str], layers: Sequence[str]) -> None:
    """Install requirements, all other pinned packages of layers, and the checkout itself."""
    pinned = []
    for layer in layers:
        text = (ROOT / "requirements" / f"{layer}.txt").read_text(encoding="utf-8")
        pinned += [line for line in text.splitlines() if line and not line.startswith("#")]
    others = [line for line in pinned if line.split("==")[0] not in (*VARIED, "llvmlite")]
    session.install(*requirements, *others)
    session.install("--no-deps", "--no-build-isolation", "--editable", ".")
