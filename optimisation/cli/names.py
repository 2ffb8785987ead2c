"""Names of the commands, with headings, modules, older names and needed extras.

The module of ``design gap`` is ``design_gap.py``: its words with underscores. ``scripts/run`` reads
`OLDER_NAMES` line by line, before there is an environment.
"""

import importlib
import re
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
STUDIES = Path(__file__).resolve().parents[2] / "scripts" / "studies" / "cli"  # of a checkout
REPRODUCE = "reproduce"  # group of the studies that make a checkout's pages
HEADINGS = {
    "Simulate": ("sweep", "compare", "calibrate", "structure", "explore"),
    "Design an absorber": (
        "design gap",
        "design place",
        "design search",
        "design pareto",
        "design masses",
        "design tune",
    ),
    "Periodic responses": (
        "periodic orbits",
        "periodic branches",
        "periodic folds",
        "periodic curves",
        "periodic isola",
        "periodic manifold",
        "periodic basins",
        "periodic diagram",
        "periodic section",
        "periodic balance-error",
    ),
    "Reinforcement learning": (
        "rl train",
        "rl evaluate",
        "rl export",
        "rl render",
        "rl demonstrations",
    ),
    "This installation": ("doctor", "prepare", "cache"),
}
GROUPS = {
    "design": "Gap, place, mass or every parameter of an absorber",
    "periodic": "Periodic orbits, bifurcations and attractors",
    "rl": "Agents for the environments",
    REPRODUCE: "Numbers, tables and figures of this checkout's pages",
}
# names of the version before, which no help lists, and those of now
OLDER_NAMES = {
    "compare_absorbers": "compare",
    "design_gap": "design gap",
    "design_place": "design place",
    "optimise_design": "design search",
    "pareto": "design pareto",
    "mass_ratios": "design masses",
    "tune_ltva": "design tune",
    "frequency_response": "periodic branches",
    "balance_error": "periodic balance-error",
    "orbits": "periodic orbits",
    "isola": "periodic isola",
    "manifold": "periodic manifold",
    "train": "rl train",
    "judge": "rl evaluate",
    "record_demonstrations": "rl demonstrations",
    "render_episode": "rl render",
}
# defaults of the older names that differ, by the parameters that they set
OLDER_DEFAULTS: dict[str, dict[str, object]] = {
    "compare_absorbers": {"out": "results/compare_absorbers"},
    "optimise_design": {"out": "results/optimise_design"},
    "pareto": {"out": "results/pareto"},
    "tune_ltva": {"out": "results/tune_ltva"},
    "frequency_response": {"start": 0.88},
    "balance_error": {"start": 0.85, "stop": 1.1},
    "isola": {"stop": 1.0},
    "manifold": {"start": 0.92, "stop": 1.04},
}
NEEDS = re.compile(r"^# needs: *(.*)$", re.MULTILINE)
HEAD_LINES = 40  # a command says near its top what it needs


def list_studies() -> dict[str, Path]:
    """Return the modules of a checkout's studies by their names; empty without a checkout."""
    return {
        f"{REPRODUCE} {file.stem.removeprefix('reproduce_').replace('_', '-')}": file
        for file in sorted(STUDIES.glob("[!_]*.py"))
    }


def list_commands() -> dict[str, Path]:
    """Return the modules of all commands by their names."""
    shipped = {
        name: HERE / f"{name.replace(' ', '_').replace('-', '_')}.py"
        for names in HEADINGS.values()
        for name in names
    }
    return shipped | list_studies()


def list_other_names() -> dict[str, str]:
    """Return the names of now by the other names of commands.

    These are the names of the version before, and those of studies without ``reproduce``, with
    underscores or dashes.
    """
    studies = {file.stem: name for name, file in list_studies().items()}
    dashed = {stem.replace("_", "-"): name for stem, name in studies.items()}
    return OLDER_NAMES | studies | dashed


def name_of(name: str) -> str:
    """Return the name of now of a command, which may be called by the one of the version before."""
    return list_other_names().get(name, name)


def imported(name: str) -> ModuleType:
    """Return the module of a command that there is, by its name of now or of the version before."""
    file = list_commands()[name_of(name)]
    package = "optimisation.cli" if file.parent == HERE else "studies.cli"
    return importlib.import_module(f"{package}.{file.stem}")


def find_command(words: Sequence[str]) -> tuple[str, int]:
    """Return the name of the called command, and how many of the words belong to it.

    The name is empty if there is no such command.
    """
    commands = list_commands()
    if words and (name := list_other_names().get(words[0])) is not None:
        return name, 1
    for length in (2, 1):
        name = " ".join(words[:length])
        if len(words) >= length and name in commands:
            return name, length
    return "", 0


def list_needs(file: Path) -> list[str]:
    """Return the extras that the module of a command says it needs."""
    head = "\n".join(file.read_text(encoding="utf-8").splitlines()[:HEAD_LINES])
    return [extra for line in NEEDS.findall(head) for extra in line.replace(",", " ").split()]
