"""The suite as other machines would run it, with its results in docs/internals/machines.md. Environments of other versions are in .venv-check."""

from __future__ import annotations

import argparse
import datetime
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

from impact_env import __version__
from optimisation.machine import processor
from optimisation.page import fill

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
from choice import PARTS  # type: ignore[import-not-found]  # noqa: E402 - what tests share is found there

PAGE = ROOT / "docs" / "internals" / "machines.md"
HEADER = (
    "machine",
    "Python",
    "packages",
    "settings",
    "passed",
    "failed",
    "skipped",
    "largest process",
    "run",
)
VARIED = ("numpy", "scipy", "numba", "gymnasium")
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
    "rl",
    "clients",
    "explore",
    "browser",
)
TORCH = ("rl", "clients")


class Machine(NamedTuple):
    """Variables that make the processor another one, and which tests run, as `PARTS`.

    ``options``: of pytest; ``wheel``: commands run from the wheel, too, which takes long. ``python``, ``versions``: an environment of its own, with
    the oldest or newest of `VARIED`; without, it is the checkout's.
    """

    settings: dict[str, str]
    parts: tuple[str, ...] = PARTS
    options: tuple[str, ...] = ()
    wheel: bool = False
    python: str = ""
    versions: str = "pinned"
    layers: tuple[str, ...] = LAYERS


OLD_LIBRARIES = {
    "MKL_CBWR": "COMPATIBLE",
    "ATEN_CPU_CAPABILITY": "default",
    "OPENBLAS_CORETYPE": "Nehalem",
}
OLD_LIBRARIES["NPY_DISABLE_CPU_FEATURES"] = "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"
MACHINES = {
    "other-rounding": Machine({}, PARTS[3:], ("--rounding", "5")),
    "old-libraries": Machine(OLD_LIBRARIES, wheel=True),
    "old-processor": Machine({"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}, PARTS[:3]),
    "oldest-versions": Machine(
        {"MKL_CBWR": "AVX2,STRICT", "OPENBLAS_CORETYPE": "Haswell"},
        python="3.11",
        versions="oldest",
    ),
    "newest-versions": Machine(
        {},
        python="3.13",
        versions="newest",
        layers=tuple(layer for layer in LAYERS if layer not in TORCH),
    ),
}


def requirements(machine: Machine) -> list[str]:
    """Return the requirements for pip: pinned versions, but the varied packages' oldest or newest that pyproject.toml allows."""
    texts = ((ROOT / "requirements" / f"{layer}.txt").read_text() for layer in machine.layers)
    lines = [line for text in texts for line in text.splitlines() if not line.startswith("#")]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    ranges = [
        one
        for one in project["dependencies"] + project["optional-dependencies"]["env"]
        if re.split("[<>=]", one)[0] in VARIED
    ]
    extras = (
        ranges
        if machine.versions == "newest"
        else [one.split(",")[0].replace(">=", "==") for one in ranges]
    )
    return extras + [line for line in lines if line.partition("==")[0] not in (*VARIED, "llvmlite")]


def environment(name: str, machine: Machine) -> Path:
    """Return the machine's Python, in an environment that is made if it is not as asked for; raises FileNotFoundError without that Python."""
    if not machine.python:
        return Path(sys.executable)
    folder = ROOT / ".venv-check" / name
    python = folder / "bin" / "python"
    stamp = folder / "made"
    request = "\n".join([machine.python, *requirements(machine)])
    if stamp.exists() and stamp.read_text() == request:
        return python
    base = shutil.which(f"python{machine.python}")
    if base is None or subprocess.run([base, "-c", ""], capture_output=True).returncode:
        raise FileNotFoundError(f"no python{machine.python} was found")
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([base, "-m", "venv", str(folder)], check=True)
    pip = [str(python), "-m", "pip", "install", "-qq", "--no-input", "--disable-pip-version-check"]
    subprocess.run([*pip, *requirements(machine)], check=True)
    subprocess.run([*pip, "--no-deps", "--no-build-isolation", "--editable", str(ROOT)], check=True)
    stamp.write_text(request)
    return python


def packages(python: Path) -> tuple[str, str]:
    """Return an environment's Python, and the versions of what was varied in it and of torch."""
    code = "import sys, importlib.metadata as m; print(sys.version.split()[0], *(f'{d.name} {d.version},' for d in m.distributions()))"
    version, *rest = subprocess.run(
        [str(python), "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()
    versions = dict(zip(rest[::2], rest[1::2], strict=True))
    return version, " ".join(
        f"{name} {versions[name]}" for name in (*VARIED, "torch") if name in versions
    ).rstrip(",") + ("" if "torch" in versions else ", no torch")


def run(name: str, machine: Machine, options: list[str]) -> tuple[list[str], bool]:
    """Run the suite on a machine; return its row of the table, and whether tests ran and none failed."""
    printed = " ".join(
        f"`{word}`"
        for word in (
            *(f"{key}={value}" for key, value in machine.settings.items()),
            shlex.join(machine.options),
        )
        if word
    )
    made = f"{datetime.datetime.now(datetime.UTC).date().isoformat()}, version {__version__}"
    began = time.monotonic()
    try:
        python = environment(name, machine)
    except FileNotFoundError as error:
        return [
            name,
            machine.python,
            machine.versions,
            printed,
            f"not run: {error}",
            "",
            "",
            "",
            made,
        ], False
    own = ROOT / ".venv-check" / name
    own.mkdir(parents=True, exist_ok=True)
    variables = {
        "MPLBACKEND": "Agg",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    } | machine.settings
    if (
        machine.python or "NUMBA_CPU_NAME" in machine.settings
    ):  # others compile the same kernels as the checkout
        variables["IMPACT_ENV_CACHE"] = str(own / "kernel-cache")
    passed = failed = skipped = peak = 0
    stops = set[int]()
    missing = set[str]()
    for part in (
        [options]
        if options
        else [
            [str(path) for pattern in part.split() for path in sorted(ROOT.glob(pattern))]
            for part in machine.parts
        ]
    ):
        report = own / "report.xml"
        report.unlink(missing_ok=True)
        command = [
            str(python),
            "-m",
            "pytest",
            "-n",
            "2",
            "--dist",
            "loadfile",
            "--no-loadscope-reorder",
            "-q",
            f"--junitxml={report}",
        ]
        command += [
            "-m",
            "wheel or not wheel" if machine.wheel else "not wheel",
            *machine.options,
            *part,
        ]
        process = subprocess.Popen(command, cwd=ROOT, env=os.environ | variables)
        _, status, usage = os.wait4(process.pid, 0)  # the usage is that of its children, too
        process.returncode = os.waitstatus_to_exitcode(status)
        stops |= {process.returncode} - {0, 1}
        counts, lacked = read(report)
        passed = passed + counts[0]
        failed = failed + counts[1]
        skipped = skipped + counts[2]
        missing = missing | lacked
        peak = max(peak, usage.ru_maxrss)
    ended = "no test ran" if stops == {5} else "did not end"
    verdict = (
        f"{failed}, {ended} (code {', '.join(map(str, sorted(stops)))})" if stops else str(failed)
    )
    without = f" (no {', '.join(sorted(missing))})" if missing else ""
    size = f"{peak * (1 if sys.platform == 'darwin' else 1024) / 1e9:.1f} GB"
    row = [
        name,
        *packages(python),
        printed,
        str(passed),
        verdict,
        f"{skipped}{without}",
        size,
        f"{made}, {(time.monotonic() - began) / 60:.0f} min",
    ]
    return row, not stops and passed > 0 == failed


def read(report: Path) -> tuple[tuple[int, int, int], set[str]]:
    """Return how many tests of a report passed, failed and were skipped, and for want of which modules; none where there is no report."""
    if not report.exists():
        return (0, 0, 0), set()
    suite = ET.parse(report).getroot()[0]
    total = int(suite.get("tests", 0))
    failed = int(suite.get("failures", 0)) + int(suite.get("errors", 0))
    skipped = int(suite.get("skipped", 0))
    missing = set(
        re.findall(
            r"could not import '(\w+)",
            " ".join(one.get("message", "") for one in suite.iter("skipped")),
        )
    )
    return (total - failed - skipped, failed, skipped), missing


def table(rows: dict[str, list[str]]) -> str:
    """Return the page's table, with the machines in their order."""
    lines = [
        HEADER,
        ("---",) * len(HEADER),
        *(
            rows.get(name, [name, *[""] * 3, "not run", *[""] * (len(HEADER) - 5)])
            for name in MACHINES
        ),
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + f"\n\nOn {processor()}."


def read_results() -> dict[str, list[str]]:
    """Return the rows that the page has."""
    cells = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    )
    return {row[0]: row for row in cells if row[0] in MACHINES and len(row) == len(HEADER)}


def main() -> int:
    """Run each machine; write its row as soon as it is there, so that Ctrl-C keeps those of others."""
    further = "Further options go to pytest; the page is then left as it is."
    parser = argparse.ArgumentParser(prog="scripts/check_all", description=__doc__, epilog=further)
    parser.add_argument(
        "--only",
        choices=MACHINES,
        action="append",
        help="this machine alone; can be given several times",
    )
    chosen, options = parser.parse_known_args()
    rows = read_results()
    fine = True
    try:
        for name in chosen.only or MACHINES:
            print(f"== {name} {shlex.join(options)}", flush=True)
            rows[name], ok = run(name, MACHINES[name], options)
            fine = fine and ok
            print(" | ".join(rows[name]), flush=True)
            if not options:
                fill(PAGE, PAGE, {"machines": table(rows)})
    except KeyboardInterrupt:
        print("Broken off; finished machines are kept.", file=sys.stderr)
        return 130
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
