"""The lint of names reports what it should.

The numbers of findings in files that are not converted can only become smaller. scripts/lint runs
it on the sources.
"""

from pathlib import Path
from typing import Any

import pytest
from places import ROOT, loaded

lint = loaded(ROOT / "scripts/lib/lint_names.py")
NOTHING_KNOWN: dict[str, Any] = {"packages": [], "classes": [], "files": {}}
CLEAN = '''"""A module."""


def compute_level(samples):
    first, last = samples
    first, last = last, first
    return last
'''


def messages(root: Path, text: str, known: dict[str, Any] = NOTHING_KNOWN) -> list[str]:
    """Return what the lint says of a package with one file of a text."""
    (root / "impact_env").mkdir(exist_ok=True)
    (root / "impact_env" / "level.py").write_text(text)
    return lint.check_names(root, known)[0]


@pytest.mark.parametrize(
    ("added", "message"),
    [
        ("def level_told():\n    pass\n", "name 'level_told' has the word 'told'"),
        ("def f(there):\n    return there\n", "name 'there' has the word 'there'"),
        ("class EventRoom:\n    pass\n", "name 'EventRoom' has the word 'room'"),
        ("KEPT = 1\n", "name 'KEPT' has the word 'kept'"),
        ("import math as ours\n", "name 'ours' has the word 'ours'"),
        ("a, b = 1, 2\n", "a tuple assignment that unpacks nothing"),
    ],
)
def test_a_banned_word_and_a_tuple_assignment_are_named_with_their_line(
    tmp_path: Path, added: str, message: str
) -> None:
    assert messages(tmp_path, CLEAN) == []
    line = CLEAN.count("\n") + 1
    first, *_ = messages(tmp_path, CLEAN + added)
    assert first.startswith(f"impact_env/level.py:{line}: {message}")


@pytest.mark.parametrize("folder", ["optimisation", "scripts/lib", "tests"])
def test_names_are_checked_in_every_folder(tmp_path: Path, folder: str) -> None:
    (tmp_path / folder / "part").mkdir(parents=True)
    (tmp_path / folder / "part" / "level.py").write_text("kept = 1\n")
    first, *_ = lint.check_names(tmp_path, NOTHING_KNOWN)[0]
    assert first == f"{folder}/part/level.py:1: name 'kept' has the word 'kept'"


def test_a_class_name_that_is_defined_twice_is_named(tmp_path: Path) -> None:
    (tmp_path / "optimisation").mkdir()
    (tmp_path / "optimisation" / "case.py").write_text("class Case:\n    pass\n")
    text = CLEAN + "\n\nclass Case:\n    pass\n"
    assert messages(tmp_path, text) == ["class Case is defined more than once"]
    known = NOTHING_KNOWN | {"classes": ["Case"]}
    assert messages(tmp_path, text, known) == []
    assert messages(tmp_path, CLEAN, known) == ["class Case is defined once now: --write"]


def test_numbers_of_files_that_are_not_converted_only_become_smaller(tmp_path: Path) -> None:
    known = NOTHING_KNOWN | {"files": {"impact_env/level.py": 1}}
    assert messages(tmp_path, CLEAN + "KEPT = 1\n", known) == []
    assert messages(tmp_path, CLEAN + "KEPT = 1\nTOLD = 1\n", known)[-1].endswith(
        "2 findings, 1 allowed"
    )
    assert messages(tmp_path, CLEAN, known) == [
        "impact_env/level.py: 0 findings are left of 1: --write"
    ]
    written = lint.write_known(known, {"impact_env/level.py": 2})
    assert '"impact_env/level.py" = 1' in written
