"""Plant one-line faults and see whether the tests nearest to them notice."""

# needs: test, files, optimise, env

import os
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from impact_env.checks import ParameterError
from impact_env.kernels.compiling.cache import cache_folder
from optimisation.cli.common import check_page, command, fill_page, page_option
from optimisation.files import ROOT
from studies.study import format_table

FAULTS = ROOT / "tests" / "mutations.toml"
COPIED = ("impact_env", "optimisation", "scripts", "tests", "docs", "pyproject.toml", "README.md")
MARKER = "mutations"
MOST_SECONDS = 100  # of one run of the tests: a fault that makes a run endless counts as caught
CAUGHT = "caught"
SURVIVES = "SURVIVES"
EXPECTED = "survives, as explained"


@dataclass(frozen=True)
class Fault:
    """A fault planted in the sources.

    Attributes
    ----------
    name, part : str
        Name and part of the project.
    file, old, new : str
        In the file the text ``old``, which occurs once, is replaced by ``new``.
    tests : str
        Tests that should detect the fault.
    survives : str
        Reason why no test can detect it, if that is so.
    plain : bool
        Whether the tests run in plain Python; all tests of faults below impact_env/kernels do.
    """

    name: str
    part: str
    file: str
    old: str
    new: str
    tests: str
    survives: str = ""
    plain: bool = False


@dataclass(frozen=True)
class FaultOutcome:
    """Result of the tests of a fault.

    ``verdict`` is `CAUGHT`, `SURVIVES` or `EXPECTED`. ``test`` is the first test that failed.
    ``seconds`` is the run time.
    """

    fault: Fault
    verdict: str
    test: str
    seconds: float


def read_faults(file: Path = FAULTS) -> list[Fault]:
    """Return the faults of a TOML file; raises ParameterError if one does not fit the sources."""
    kernels = "impact_env/kernels/"
    try:
        rows = tomllib.loads(file.read_text(encoding="utf-8"))["fault"]
        faults = [Fault(**{"plain": row["file"].startswith(kernels), **row}) for row in rows]
    except (tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise ParameterError(
            f"{file} is not allowed: TOML with the keys of a fault ({error})"
        ) from error
    names = [fault.name for fault in faults]
    if len(set(names)) < len(names):
        raise ParameterError(f"{file} is not allowed: faults with names of their own")
    for fault in faults:
        reason = _misfit(fault)
        if reason:
            raise ParameterError(f"fault {fault.name!r} is not allowed: {reason}")
    return faults


def _misfit(fault: Fault) -> str:
    """Return the reason why a fault does not fit the sources, empty if it fits."""
    source = ROOT / fault.file
    if not source.is_file():
        return f"a file of the checkout, not {fault.file!r}"
    result = source.read_text(encoding="utf-8").count(fault.old)
    if result != 1:
        return f"a text that stands once in {fault.file}, not {result} times"
    return "" if fault.old != fault.new else "a new text other than old"


@contextmanager
def copied_checkout() -> Iterator[Path]:
    """Yield a copy of the checkout's sources and tests in a temporary folder."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        for entry in COPIED:
            source = ROOT / entry
            if source.is_dir():
                skipped = shutil.ignore_patterns("*.gif")  # bytecode saves seconds of each run
                shutil.copytree(source, folder / entry, ignore=skipped)
            else:
                shutil.copy(source, folder / entry)
        yield folder


def run_tests(folder: Path, tests: str, plain: bool) -> tuple[bool, str]:
    """Run pytest on the copy in ``folder``.

    Return whether all tests passed, and the first test that did not.
    """
    path = os.pathsep.join(str(folder / part) for part in ("", "scripts", "tests"))
    environment = os.environ | {
        "PYTHONPATH": path,
        "NUMBA_DISABLE_JIT": str(int(plain)),
        "IMPACT_ENV_CACHE": str((cache_folder() or ROOT).parent),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    words = ["-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *shlex.split(tests)]
    try:
        done = subprocess.run(
            [sys.executable, *words],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=MOST_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False, f"no end within {MOST_SECONDS} s"
    if done.returncode == 0:
        return True, ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if done.returncode != 1 or not failed:
        end = (done.stdout + done.stderr).strip().splitlines()[-1:]
        raise ParameterError(f"tests = {tests} is not allowed: tests that run ({' '.join(end)})")
    return False, failed[0].split()[1].removeprefix("tests/")


def judge_fault(fault: Fault) -> FaultOutcome:
    """Plant a fault in a copy of the checkout and run its tests there."""
    began = time.perf_counter()
    with copied_checkout() as folder:
        file = folder / fault.file
        file.write_text(
            file.read_text(encoding="utf-8").replace(fault.old, fault.new), encoding="utf-8"
        )
        passed, test = run_tests(folder, fault.tests, fault.plain)
    verdict = CAUGHT if not passed else EXPECTED if fault.survives else SURVIVES
    return FaultOutcome(fault, verdict, test or fault.survives, time.perf_counter() - began)


def check_unchanged(faults: Iterable[Fault]) -> None:
    """Raise ParameterError if tests fail without any fault, because they could not detect one."""
    with copied_checkout() as folder:
        for tests, plain in dict.fromkeys((fault.tests, fault.plain) for fault in faults):
            passed, test = run_tests(folder, tests, plain)
            if not passed:
                raise ParameterError(
                    f"tests = {tests} is not allowed: {test} fails without a fault"
                )


@command()
@click.option("--only", metavar="WORD", help="Faults with this word in their part or name.")
@click.option(
    "--processes", type=click.IntRange(min=1), default=2, show_default=True, help="At a time."
)
@page_option(MARKER, "docs/internals/mutations.md")
def main(only: str | None, processes: int, page: Path | None) -> None:
    """Plant each fault of tests/mutations.toml in a copy of the sources and run tests.

    The tests are those closest to the fault.

    Faults in compiled code are judged in plain Python (NUMBA_DISABLE_JIT=1). The exit code is 1 if
    a fault survives that is not explained. Ctrl-C ends it early.

    Example: scripts/run reproduce mutation-test --only friction
    """
    check_page(page, MARKER)
    faults = [fault for fault in read_faults() if not only or only in f"{fault.part} {fault.name}"]
    if not faults:
        raise ParameterError(f"--only = {only} is not allowed: a word of a fault's part or name")
    click.echo(f"tests of {len(faults)} faults, first without any", err=True)
    check_unchanged(faults)
    outcomes = []
    with ThreadPoolExecutor(processes) as pool:
        waiting = [pool.submit(judge_fault, fault) for fault in faults]
        try:
            for done in as_completed(waiting):
                outcomes.append(done.result())
                result = outcomes[-1]
                click.echo(f"{result.verdict}: {result.fault.part}, {result.fault.name}", err=True)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    outcomes.sort(key=lambda outcome: faults.index(outcome.fault))
    table = format_table(
        {"part": "{part}", "fault": "{name}", "verdict": "{verdict}", "by, or why": "{test}"},
        (
            {
                "part": result.fault.part,
                "name": result.fault.name,
                "verdict": result.verdict,
                "test": result.test,
            }
            for result in outcomes
        ),
    )
    caught = sum(result.verdict == CAUGHT for result in outcomes)
    summary = f"{caught} of {len(outcomes)} faults are caught."
    click.echo(f"{table}\n\n{summary}")
    fill_page(page, MARKER, f"{summary}\n\n{table}")
    if any(result.verdict == SURVIVES for result in outcomes):
        raise SystemExit(1)
