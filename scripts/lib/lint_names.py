"""Lint of names: forbidden words, class names defined twice, needless tuple assignments.

A tuple assignment is needless if it unpacks nothing.

The rules are in CONTRIBUTING.md. ``scripts/lib/names_not_converted.toml`` has what older files
still contain: the number of findings of each file, packages that are left out altogether, and class
names that stand twice. The numbers may only become smaller. The lint fails where a file has more
findings than its number; where it has fewer it says so, and ``python scripts/lib/lint_names.py
--write`` writes the smaller numbers.
"""

import argparse
import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
NOT_CONVERTED = Path(__file__).with_name("names_not_converted.toml")
PACKAGES = ("impact_env", "optimisation")
CHECKED = (*PACKAGES, "scripts", "tests")  # folders whose names are checked
# participles, adverbs, pronouns and metaphors: a name says what a quantity is, or what a function
# does
WORDS = frozenset(
    [
        "told",
        "said",
        "shown",
        "asked",
        "kept",
        "watched",
        "found",
        "seen",
        "given",
        "borne",
        "heard",
        "met",
        "anew",
        "beside",
        "there",
        "ours",
        "onwards",
        "look",
        "room",
        "desk",
        "board",
        "crew",
    ]
)
Finding = tuple[int, str]  # line, message
SMALLER = ": --write"  # ends a line about something that has become better


def defined_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and name of each definition in a module.

    Definitions are functions, classes, arguments, variables and attributes.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.alias) and node.asname:
            yield node.lineno, node.asname


def split_name(name: str) -> list[str]:
    """Return the words of a name in lower case, of ``CamelCase`` and of ``snake_case``."""
    spaced = "".join(f"_{c}" if c.isupper() and not name.isupper() else c for c in name)
    return [word for word in spaced.lower().split("_") if word]


def find_words(tree: ast.Module) -> list[Finding]:
    """Return the names that have one of `WORDS`."""
    return [
        (line, f"name {name!r} has the word {word!r}")
        for line, name in defined_names(tree)
        for word in split_name(name)
        if word in WORDS
    ]


def _parallel(node: ast.AST) -> bool:
    """Return whether a statement assigns a tuple of values to as many names.

    A swap of two names is such an assignment too, but is allowed: the result is then false.
    """
    if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
        return False
    target = node.targets[0]
    if len(node.targets) > 1 or not isinstance(target, ast.Tuple):
        return False
    if any(isinstance(item, ast.Starred) for item in (*target.elts, *node.value.elts)):
        return False
    names = {item.id for item in ast.walk(target) if isinstance(item, ast.Name)}
    read = {item.id for item in ast.walk(node.value) if isinstance(item, ast.Name)}
    return not names & read


def find_parallel_assignments(tree: ast.Module) -> list[Finding]:
    """Return the tuple assignments that unpack nothing: each is several statements in one line."""
    return [
        (node.lineno, "a tuple assignment that unpacks nothing: one statement a line")
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt) and _parallel(node)
    ]


def find_in_file(file: Path) -> list[Finding]:
    """Return all findings of a file."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return sorted(find_words(tree) + find_parallel_assignments(tree))


def find_repeated_classes(root: Path) -> list[str]:
    """Return the class names that are defined more than once in the packages."""
    names = Counter(
        node.name
        for package in PACKAGES
        for file in (root / package).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    return sorted(name for name, number in names.items() if number > 1)


def check_names(root: Path, known: dict[str, Any]) -> tuple[list[str], dict[str, int]]:
    """Return messages about differences from ``known``, and each file's number of findings."""
    lines = []
    numbers = {}
    for package in CHECKED:
        if package in known["packages"]:
            continue
        for file in sorted((root / package).rglob("*.py")):
            findings = find_in_file(file)
            name = file.relative_to(root).as_posix()
            if findings:
                numbers[name] = len(findings)
            allowed = known["files"].get(name, 0)
            if len(findings) > allowed:
                lines += [f"{name}:{line}: {message}" for line, message in findings]
                lines.append(f"{name}: {len(findings)} findings, {allowed} allowed")
            elif len(findings) < allowed:
                lines.append(f"{name}: {len(findings)} findings are left of {allowed}{SMALLER}")
    repeated = find_repeated_classes(root)
    lines += [
        f"class {name} is defined more than once"
        for name in repeated
        if name not in known["classes"]
    ]
    lines += [
        f"class {name} is defined once now{SMALLER}"
        for name in known["classes"]
        if name not in repeated
    ]
    lines += [
        f"{name} is no file{SMALLER}" for name in known["files"] if not (root / name).is_file()
    ]
    return lines, numbers


def write_known(known: dict[str, Any], numbers: dict[str, int]) -> str:
    """Return the text of the file of what is not converted, with no number above the known one."""
    files = {
        name: min(number, known["files"].get(name, number)) for name, number in numbers.items()
    }
    classes = [name for name in find_repeated_classes(ROOT) if name in known["classes"]]
    return "\n".join(
        [
            "# What scripts/lib/lint_names.py still allows; it may only become less.",
            "# packages that are left out",
            f"packages = {known['packages']!r}".replace("'", '"'),
            "# class names that are defined more than once",
            f"classes = {classes!r}".replace("'", '"'),
            "",
            "[files] # findings of a file",
            *(f'"{name}" = {number}' for name, number in files.items()),
            "",
        ]
    )


def main() -> int:
    """Print what is new and return 1 if there is any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write smaller numbers")
    options = parser.parse_args()
    known = tomllib.loads(NOT_CONVERTED.read_text(encoding="utf-8"))
    lines, numbers = check_names(ROOT, known)
    if options.write:
        NOT_CONVERTED.write_text(write_known(known, numbers), encoding="utf-8")
        known = tomllib.loads(NOT_CONVERTED.read_text(encoding="utf-8"))
        lines, _ = check_names(ROOT, known)
    print("\n".join(lines) or "names: nothing new")
    return int(any(not line.endswith(SMALLER) for line in lines))


if __name__ == "__main__":
    sys.exit(main())
