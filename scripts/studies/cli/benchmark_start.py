"""Time from a clone in an empty folder with an empty home to the first figure.

The first calls of other scenes and outputs are also timed.

Step by step as a newcomer meets them. The clone holds what is committed. Packages are downloaded
again: the set-up is also a measure of the network.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click

from impact_env.checks import ParameterError
from impact_env.ensemble import available_cores
from optimisation.cli.common import command
from optimisation.executors import Bar
from optimisation.files import ROOT
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    add_table_options,
    format_table,
    make_table_study,
    run,
)
from studies.variants import KernelVariant

NAME = "start"
FIRST_CALL = """
import sys
from impact_env import simulate
from studies.variants import METHODS, RECORDS, KernelVariant
variant = KernelVariant(*sys.argv[1:])
record = RECORDS[variant.record]
simulate(variant.scene(), variant.drive(1.0), METHODS[variant.method], record=record)
"""
FIRST_CALLS = (
    KernelVariant("impact", record="level and events"),
    KernelVariant("impact", record="everything"),
    KernelVariant("impact and friction", record="everything"),
    KernelVariant("two impact absorbers", record="everything"),
    KernelVariant("compliant"),
    KernelVariant("compliant and elastic friction"),
    KernelVariant("impact", "moreau"),
    KernelVariant("impact and friction", "moreau"),
    KernelVariant("no absorber", "runge-kutta"),
    KernelVariant("compliant", "runge-kutta"),
)
FIRST_STEP = """
import gymnasium, impact_env
env = gymnasium.make("ImpactAbsorber/SweepRate-v1")
env.reset(seed=0)
env.step(env.action_space.sample())
"""
ORBITS = (
    "-m",
    "optimisation.cli.group",
    "orbits",
    "--modes",
    "3",
    "--friction-limit",
    "0.01",
    "--at",
    "0.95",
)
OTHERS = {
    "first step of an environment": ("-c", FIRST_STEP),
    "orbits, symmetric": (*ORBITS, "--symmetric"),
    "orbits, all": ORBITS,
}


FORGOTTEN = ("IMPACT_ENV_", "NUMBA_", "PIP_CACHE", "PYTHONPATH", "XDG_", "VIRTUAL_ENV")


def timed(
    what: str,
    command: list[str],
    clone: Path,
    environment: dict[str, str],
) -> Json:
    """Run a step in the clone and return its times in s.

    Raises ClickException with the step's output if the step fails.
    """
    before = os.times()
    began = time.perf_counter()
    done = subprocess.run(
        command,
        cwd=clone,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    wall = time.perf_counter() - began
    after = os.times()
    if done.returncode:
        raise click.ClickException(
            f"{what}: {' '.join(command)} ended with {done.returncode}: "
            f"{done.stderr.strip()[-2000:]}"
        )
    cpu = (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
    return {"what": what, "wall_s": wall, "cpu_s": cpu}


def first_calls(quick: bool) -> dict[str, tuple[str, ...]]:
    """Return all first calls, by name as Python's arguments."""
    scenes = FIRST_CALLS[:1] if quick else FIRST_CALLS
    return {
        variant.name: ("-c", FIRST_CALL, variant.absorber, variant.method, variant.record)
        for variant in scenes
    } | ({} if quick else OTHERS)


def steps(quick: bool, place: Path, advance: Callable[[], object]) -> list[Json]:
    """Do all steps in an empty folder and return their wall and CPU times."""
    clone = place / "clone"
    home = place / "home"
    home.mkdir()
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(FORGOTTEN)
    } | {"HOME": str(home)}  # of a newcomer
    timed("clone", ["git", "clone", "--quiet", str(ROOT), str(clone)], place, os.environ.copy())
    set_up = [
        getattr(sys, "_base_executable", sys.executable),
        str(clone / "scripts" / "lib" / "set_up.py"),
    ]
    comparison = [
        str(clone / "scripts" / "run"),
        "compare_absorbers",
        *(["--quick"] if quick else []),
        "--out",
        str(place / "results"),
    ]
    started = {
        "set-up": [*set_up, "main"],
        "compilation": [*set_up, "main", "kernels"],
        "comparison": comparison,
    }
    result = []
    for what, words in started.items():
        result.append(timed(what, words, clone, environment))
        advance()
    wall, cpu = (sum(step[name] for step in result) for name in ("wall_s", "cpu_s"))
    result.append({"what": "to the table and the figure", "wall_s": wall, "cpu_s": cpu})
    if not quick:
        timed("packages of the environments", [*set_up, "env"], clone, environment)
    for name, arguments in first_calls(quick).items():
        result.append(
            timed(
                f"first call: {name}",
                [str(clone / ".venv" / "bin" / "python"), *arguments],
                clone,
                environment,
            )
        )
        advance()
    return result


def _measure(quick: bool) -> Json:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        raise ParameterError(
            f"{ROOT} is not allowed: a checkout with its history, and git to clone it"
        )
    total = 3 + len(first_calls(quick))
    with (
        tempfile.TemporaryDirectory(prefix="start-") as place,
        Bar(total=total, desc="starting", unit="step", leave=False) as bar,
    ):
        return {"cores": available_cores(), "steps": steps(quick, Path(place), bar.update)}


def table(result: list[Json]) -> str:
    """Return a line for each step."""
    columns = {"step": "{what}", "wall time, s": "{wall_s:.1f}", "CPU time, s": "{cpu_s:.1f}"}
    return format_table(columns, result)


def _summary(measured: Measurement) -> str:
    cores = measured.values["cores"]
    return (
        f"{table(measured.values['steps'])}\n\nOn {cores} core{'s' * (cores != 1)}; one run each; "
        "packages were downloaded."
    )


STUDY = make_table_study(NAME, "from nothing to the first figure", _measure, _summary)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help="The quick comparison and one first call: a look, not a measurement.",
)
@add_table_options(NAME, "docs/internals/cost.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Clone the checkout into an empty folder and time set-up, compilation and comparison.

    First calls of scenes and outputs that are not compiled beforehand are also timed.

    Run it on an otherwise idle machine with a network. It measures what is committed, and leaves
    nothing behind.
    """
    run(STUDY, quick, place)
