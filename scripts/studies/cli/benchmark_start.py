"""From nothing to the first figure, in an empty folder with an empty home; and the first calls of other scenes and outputs.

Step by step as a newcomer meets them. The clone holds what is committed. Packages are downloaded again: the set-up is also a measure of the network.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import click

from impact_env.ensemble import available_cores
from impact_env.parameters import ParameterError
from optimisation.cli.common import command
from optimisation.page import ROOT, markdown
from optimisation.progress import Bar
from studies.one_table import table_options, table_place, table_study
from studies.runner import run
from studies.study import Json, Measured
from studies.variants import Variant

NAME = "start"
FIRST_CALL = """
import sys
from impact_env import simulate
from studies.variants import METHODS, RECORDS, Variant
variant = Variant(*sys.argv[1:])
simulate(variant.scene(), variant.drive(1.0), METHODS[variant.method], record=RECORDS[variant.record])
"""
FIRST_CALLS = (
    Variant("impact", record="level and events"),
    Variant("impact", record="everything"),
    Variant("impact and friction", record="everything"),
    Variant("two impact absorbers", record="everything"),
    Variant("compliant"),
    Variant("compliant and elastic friction"),
    Variant("impact", "moreau"),
    Variant("impact and friction", "moreau"),
    Variant("no absorber", "runge-kutta"),
    Variant("compliant", "runge-kutta"),
)
FIRST_STEP = """
import gymnasium, impact_env
env = gymnasium.make("ImpactAbsorber/SweepRate-v1")
env.reset(seed=0)
env.step(env.action_space.sample())
"""
ORBITS = ("-m", "optimisation.cli.group", "orbits", "--modes", "3", "--friction-limit", "0.01", "--at", "0.95")
OTHERS = {"first step of an environment": ("-c", FIRST_STEP), "orbits, symmetric": (*ORBITS, "--symmetric"), "orbits, all": ORBITS}
WANTED = {"to the table and the figure": 75.0}  # s
WANTED_CALL = 15.0  # s
STARTED = ("set-up", "compilation", "comparison")
FORGOTTEN = ("IMPACT_ENV_", "NUMBA_", "PIP_CACHE", "PYTHONPATH", "XDG_", "VIRTUAL_ENV")


class Settings(NamedTuple):
    """Options of the comparison, whose first calls are timed, and what other first calls, by name as Python's arguments."""

    comparison: tuple[str, ...]
    first_calls: tuple[Variant, ...]
    others: Mapping[str, tuple[str, ...]]

    @property
    def calls(self) -> dict[str, tuple[str, ...]]:
        """All first calls, by name as Python's arguments."""
        scenes = {variant.name: ("-c", FIRST_CALL, variant.absorber, variant.method, variant.record) for variant in self.first_calls}
        return {**scenes, **self.others}


WHOLE = Settings((), FIRST_CALLS, OTHERS)
QUICK = Settings(("--quick",), FIRST_CALLS[:1], {})


@dataclass(frozen=True)
class Step:
    """One step: times in s by the clock and of all cores together, and what is wanted by the clock, None if nothing is."""

    what: str
    wall_s: float
    cpu_s: float
    wanted_s: float | None = None


def timed(what: str, command: list[str], clone: Path, environment: dict[str, str], wanted: float | None = None) -> Step:
    """Run a step in the clone; raises ClickException with what it said if it fails."""
    before, began = os.times(), time.perf_counter()
    done = subprocess.run(command, cwd=clone, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    wall, after = time.perf_counter() - began, os.times()
    if done.returncode:
        raise click.ClickException(f"{what}: {' '.join(command)} ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Step(what, wall, cpu, wanted)


def steps(settings: Settings, place: Path, advance: Callable[[], object]) -> list[Step]:
    """Do all steps in an empty folder and return their times."""
    clone, home = place / "clone", place / "home"
    home.mkdir()
    environment = {name: value for name, value in os.environ.items() if not name.startswith(FORGOTTEN)} | {"HOME": str(home)}  # of a newcomer
    timed("clone", ["git", "clone", "--quiet", str(ROOT), str(clone)], place, os.environ.copy())
    python = str(clone / ".venv" / "bin" / "python")
    set_up = [getattr(sys, "_base_executable", sys.executable), str(clone / "scripts" / "lib" / "set_up.py")]
    comparison = [str(clone / "scripts" / "run"), "compare_absorbers", *settings.comparison, "--out", str(place / "results")]
    commands = ([*set_up, "main"], [*set_up, "main", "kernels"], comparison)
    found = []
    for what, words in zip(STARTED, commands, strict=True):
        found.append(timed(what, words, clone, environment))
        advance()
    whole = "to the table and the figure"
    found.append(Step(whole, sum(step.wall_s for step in found), sum(step.cpu_s for step in found), WANTED[whole]))
    if settings.others:
        timed("packages of the environments", [*set_up, "env"], clone, environment)
    for name, arguments in settings.calls.items():
        found.append(timed(f"first call: {name}", [python, *arguments], clone, environment, WANTED_CALL))
        advance()
    return found


def _measure(settings: Settings) -> Json:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        raise ParameterError(f"{ROOT} is not allowed: a checkout with its history, and git to clone it")
    total = len(STARTED) + len(settings.calls)
    with tempfile.TemporaryDirectory(prefix="start-") as place, Bar(total=total, desc="starting", unit="step", leave=False) as bar:
        found = steps(settings, Path(place), bar.update)
    return {"cores": available_cores(), "steps": [asdict(step) for step in found]}


def table(found: list[Json]) -> str:
    """Return a line for each step."""
    rows = [
        (step["what"], f"{step['wall_s']:.1f}", f"{step['cpu_s']:.1f}", "" if step["wanted_s"] is None else f"{step['wanted_s']:g}") for step in found
    ]
    return markdown(("step", "by the clock, s", "of all cores, s", "wanted, s"), rows)


def _said(measured: Measured) -> str:
    cores = measured.values["cores"]
    return f"{table(measured.values['steps'])}\n\nOn {cores} core{'s' * (cores != 1)}; one run each, and the packages downloaded anew."


STUDY = table_study(NAME, "from nothing to the first figure", _measure, _said)


@command()
@click.option("--quick", is_flag=True, help="The quick comparison and one first call: a look, not a measurement.")
@table_options(NAME, "docs/internals/cost.md")
def main(quick: bool, target: Path | None, page: Path | None) -> None:
    """Clone the checkout into an empty folder and time set-up, compilation, comparison, and first calls of what is not compiled beforehand.

    Run it on an otherwise idle machine with a network. It measures what is committed, and leaves nothing behind.
    """
    run(STUDY, QUICK if quick else WHOLE, table_place(target, page))
