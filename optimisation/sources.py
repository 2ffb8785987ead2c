"""A fingerprint of the sources behind a number: a module with all that it imports of this project, and the packages that compute.

Two processes with the same fingerprint run the same instructions on one kind of processor. One with another may get other numbers unnoticed: so it
does not go on with a study of the first, and does no work for it as a cluster's worker.
"""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OWN = ("impact_env", "optimisation")
PACKAGES = ("llvmlite", "numba", "numpy", "scipy")
SEARCHING = (*PACKAGES, "optuna", "cmaes")  # a search is proposed by these as well


def _file_of(module: str, root: Path) -> Path | None:
    place = root.joinpath(*module.split("."))
    return next((file for file in (place / "__init__.py", place.with_suffix(".py")) if file.is_file()), None)


def _imported(source: bytes) -> Iterator[str]:
    """Yield the names that a module may import: all of its import statements, those inside of functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)  # some of them are modules


def closure(module: str, root: Path = ROOT) -> dict[str, bytes]:
    """Return the sources of a module and of all modules of this project below ``root`` that it imports, by name."""
    found: dict[str, bytes] = {}
    todo = [module]
    while todo:
        parts = todo.pop().split(".")
        for name in (".".join(parts[:k]) for k in range(1, len(parts) + 1)):  # importing a module imports its packages
            if parts[0] in OWN and name not in found and (file := _file_of(name, root)) is not None:
                found[name] = file.read_bytes().replace(b"\r\n", b"\n")
                todo += _imported(found[name])
    return found


@cache
def fingerprint(module: str, packages: tuple[str, ...] = PACKAGES, root: Path = ROOT) -> dict[str, str]:
    """Return the hash of a module's `closure` as ``code``, and the versions of ``packages`` that are installed, as they are at the first call."""
    known = hashlib.sha256()
    for name, source in sorted(closure(module, root).items()):
        known.update(name.encode() + b"\0" + source + b"\0")
    versions = {}
    for package in packages:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {"code": known.hexdigest()[:16], **versions}


# The first place where two descriptions in plain data differ.


def difference(held: object, wanted: object, path: str = "") -> str:
    """Name the first place where two descriptions of JSON values differ."""
    if isinstance(held, dict) and isinstance(wanted, dict):
        for key in sorted({*held, *wanted}):
            if held.get(key) != wanted.get(key):
                return difference(held.get(key), wanted.get(key), f"{path}.{key}" if path else key)
    if isinstance(held, list) and isinstance(wanted, list) and len(held) == len(wanted):
        for k, (a, b) in enumerate(zip(held, wanted, strict=True)):
            if a != b:
                return difference(a, b, f"{path}[{k}]")
    return f"{path or 'identity'} is {held!r} there and {wanted!r} here"
