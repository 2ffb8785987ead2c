import shutil
from pathlib import Path

import pytest

from optimisation.machine import ROOT, SEARCHING, closure, fingerprint

MEASURES, STUDY = "optimisation.measures", "optimisation.search.study"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for package in ("impact_env", "optimisation"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_fingerprint_is_that_of_the_sources_wherever_they_lie_and_has_the_versions(copy: Path) -> None:
    here = fingerprint(MEASURES)
    assert fingerprint(MEASURES, root=copy) == here
    assert set(here) == {"code", "llvmlite", "numba", "numpy", "scipy"}
    assert {"optuna", "numba"} <= set(fingerprint(STUDY, SEARCHING))
    assert fingerprint(STUDY)["code"] != here["code"]


@pytest.mark.parametrize(
    ("edited", "measures", "study"),
    [
        ("impact_env/kernels/exact/rigid_contact.py", True, True),
        ("impact_env/scene.py", True, True),
        ("impact_env/level.py", True, True),
        ("optimisation/measures.py", True, True),
        ("optimisation/problem.py", False, True),
        ("optimisation/objectives.py", False, True),
        ("optimisation/search/study.py", False, True),
        ("optimisation/report/design_tables.py", False, False),
        ("impact_env/envs/drawing.py", False, False),
    ],
)
def test_an_edit_shows_in_the_fingerprint_of_what_it_is_part_of_alone(copy: Path, edited: str, measures: bool, study: bool) -> None:
    file = copy / edited
    file.write_text(file.read_text() + "\n# edited\n")
    assert (fingerprint(MEASURES, root=copy) != fingerprint(MEASURES)) is measures
    assert (fingerprint(STUDY, root=copy) != fingerprint(STUDY)) is study


def test_all_that_is_imported_counts_and_line_ends_do_not(tmp_path: Path) -> None:
    package = tmp_path / "impact_env"
    package.mkdir()
    (package / "__init__.py").write_bytes(b"")
    (package / "a.py").write_bytes(b"import os\n\ndef f():\n    from impact_env import b\n    return b\n")
    (package / "b.py").write_bytes(b"import impact_env.c\nx = 1\n")
    (package / "c.py").write_bytes(b"import impact_env.a\n")
    (package / "d.py").write_bytes(b"")
    assert set(closure("impact_env.a", tmp_path)) == {"impact_env", *(f"impact_env.{name}" for name in "abc")}
    before = closure("impact_env.a", tmp_path)
    (package / "b.py").write_bytes(b"import impact_env.c\r\nx = 1\r\n")
    assert closure("impact_env.a", tmp_path) == before
