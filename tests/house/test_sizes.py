"""Files stay short enough to be read, and functions take few enough arguments to be called without counting places."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from places import ROOT

KERNELS = Path("impact_env", "kernels")  # compiled: their arguments decide what is compiled, their files what is compiled together
LINES, KERNEL_LINES = 400, 450
PLACES = 8  # arguments that can be given by place
# more than that: commands, whose options come by name, what is told place, range, phases and judgement in a row, and a model's fields
MORE = {
    "optimisation/cli/tune_ltva.py main": 14,
    "optimisation/cli/mass_ratios.py main": 9,
    "impact_env/periodic/jump.py jumps": 9,
    "impact_env/plain_structures.py _placed": 9,
}
FOLDERS = ("impact_env", "optimisation", "scripts", "tests/reference")
FILES = sorted(file.relative_to(ROOT) for folder in FOLDERS for file in (ROOT / folder).rglob("*.py"))


def too_long(text: str, file: Path) -> bool:
    return text.count("\n") > (KERNEL_LINES if file.is_relative_to(KERNELS) else LINES)


def functions(text: str) -> Iterator[tuple[str, int]]:
    """Yield the name of each function, methods and inner ones too, and how many arguments it takes by place."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, len(node.args.posonlyargs) + len(node.args.args)


def test_files_are_short() -> None:
    assert len(FILES) > 300
    assert not [str(file) for file in FILES if too_long((ROOT / file).read_text(encoding="utf-8"), file)]


def test_functions_outside_of_kernels_take_few_arguments_by_place() -> None:
    found: dict[str, int] = {}
    for file in FILES:
        if not file.is_relative_to(KERNELS):
            for name, places in functions((ROOT / file).read_text(encoding="utf-8")):
                if places > PLACES:
                    found[f"{file.as_posix()} {name}"] = places
    assert found == MORE  # an exception that is mended leaves the list


def test_kernels_take_few_arguments() -> None:
    """Where vector code is written into the caller, what is passed is in registers: that is not counted."""
    found = [
        f"{file.as_posix()} {node.name}"
        for file in FILES
        if file.is_relative_to(KERNELS)
        for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and len(node.args.args) > PLACES and node.args.args[0].arg != "code"
    ]
    assert found == []
