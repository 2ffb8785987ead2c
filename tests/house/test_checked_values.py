"""The value that a check returns is the one that is used.

No check is called only for its error.
"""

import ast
import inspect
from collections.abc import Iterator
from types import ModuleType

import pytest

from impact_env import checks
from optimisation import sweep_range
from optimisation.files import ROOT


def returning_checks(module: ModuleType, prefix: str = "") -> frozenset[str]:
    """Return the names of a module's public functions that return a value.

    The names begin with ``prefix``.
    """
    return frozenset(
        name
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
        and name.startswith(prefix)
        and not name.startswith("_")
        and inspect.signature(function).return_annotation not in (None, "None")
    )


CHECKS = returning_checks(checks) | returning_checks(sweep_range, "usable_")
CHECKS |= {"check_resonance", "check_restitution", "frequency_range", "gap_factors", "span"}
CHECKS |= {"known", "speeds"}  # of the environments' settings
CHECKS -= {"text"}  # drawing libraries have methods of that name


def name_of(call: ast.expr) -> str:
    """Return the name of the function that an expression calls, "" for another expression."""
    if not isinstance(call, ast.Call):
        return ""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def dropped(value: ast.expr) -> Iterator[ast.expr]:
    """Yield the expressions whose values a statement drops."""
    match value:
        case ast.Tuple() | ast.List() | ast.Set():
            for part in value.elts:
                yield from dropped(part)
        case ast.BoolOp():
            for part in value.values:
                yield from dropped(part)
        case ast.IfExp():
            yield from dropped(value.body)
            yield from dropped(value.orelse)
        case ast.ListComp() | ast.SetComp() | ast.GeneratorExp():
            yield from dropped(value.elt)
        case _:
            yield value


def faults(source: str) -> list[str]:
    """Return the places where the result of a check is dropped, or computed within a condition."""
    problems = []
    for node in ast.walk(ast.parse(source)):
        lost: list[ast.expr] = []
        assigned = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) != "_"
        if isinstance(node, ast.Expr | ast.Assign) and not assigned:
            lost = list(dropped(node.value))
        elif isinstance(node, ast.Call) and name_of(node) == "require" and node.args:
            lost = list(ast.walk(node.args[0]))
        problems += [
            f"line {node.lineno}: {ast.unparse(one)}" for one in lost if name_of(one) in CHECKS
        ]
    return problems


def test_every_checked_value_is_used() -> None:
    assert {"count", "positive", "instance", "row"} <= CHECKS
    assert {"usable_force", "usable_mass_ratio", "usable_rate"} <= CHECKS
    assert not {"require", "check_fields", "usable_gap"} & CHECKS
    files = [
        file
        for package in ("impact_env", "optimisation")
        for file in (ROOT / package).rglob("*.py")
    ]
    assert len(files) > 100
    problems = {
        str(file.relative_to(ROOT)): faults(file.read_text(encoding="utf-8")) for file in files
    }
    assert {
        file: faults_of_file for file, faults_of_file in problems.items() if faults_of_file
    } == {}


@pytest.mark.parametrize(
    "source",
    [
        "count('n', n, 1)",
        "checks.count('n', n, 1)",
        "positive('a', a), positive('b', b)",
        "usable_force('force', force)",
        "_ = count('n', n, 1)",
        "[count('n', n, 1) for n in every]",
        "n is not None and count('n', n, 1)",
        "count('n', n, 1) if n is not None else None",
        "require(0 < number(x) < 1, 'x', x, 'between 0 and 1')",
    ],
)
def test_an_unused_checked_value_is_reported(source: str) -> None:
    assert len(faults(source)) >= 1


def test_a_used_value_is_no_fault() -> None:
    source = "n = count('n', n, 1)\nf(count('n', n, 1))\nrequire(n < 3, 'n', n, 'below 3')"
    assert faults(source) == []


def classes_that_declare(source: str) -> dict[str, str]:
    """Return the code of ``__post_init__`` of each class whose fields have metadata, by class."""
    return {
        node.name: next(
            (ast.unparse(part) for part in node.body if getattr(part, "name", "") == POST_INIT), ""
        )
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ClassDef)
        and any(
            isinstance(part, ast.AnnAssign) and "metadata=" in ast.unparse(part)
            for part in node.body
        )
    }


POST_INIT = "__post_init__"


def test_declared_checks_are_run() -> None:
    """A class whose fields declare checks calls `impact_env.fields.check_fields`."""
    classes = {}
    for file in (ROOT / "impact_env").rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        if "metadata=" in source:
            classes |= classes_that_declare(source)
    assert {"Section", "Beam", "YieldingWalls", "Drive", "Random", "ModalModel"} <= set(classes)
    assert [name for name, code in classes.items() if "check_fields(self)" not in code] == []
