"""Processes that can import what a set of extras brings, and nothing else that happens to be installed here."""

import os
from collections.abc import Iterable
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution, distributions, packages_distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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
    return [r for r in every if r.marker is None or any(r.marker.evaluate({"extra": extra}) for extra in ("", *extras))]


def closure(project: Distribution, extras: Iterable[str]) -> set[str]:
    """Return the names of all distributions that come with a project and some of its extras; raises PackageNotFoundError if an extra's is absent."""
    todo, done = [(project, frozenset(extras))], set()
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


@cache
def refused(installed: Path, extras: tuple[str, ...]) -> str:
    """Return the modules, with blanks between, of what is installed here but does not come with the project in a folder and these extras."""
    (project,) = (found for found in distributions(path=[str(installed)]) if canonicalize_name(found.name) == NAME)
    allowed = closure(project, extras) | {NAME}
    return " ".join(m for m, names in packages_distributions().items() if not allowed & {canonicalize_name(name) for name in names})


def environment(installed: Path, extras: tuple[str, ...], hook: Path) -> dict[str, str]:
    """Return the variables of a process that imports from a folder and from what is declared, as all that it starts; ``hook``: a folder for it."""
    (hook / "sitecustomize.py").write_text(FINDER)
    paths = os.pathsep.join([str(hook), str(installed)])
    return os.environ | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1", "COLUMNS": "160", "REFUSED": refused(installed, extras)}
