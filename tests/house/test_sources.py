import shutil
from pathlib import Path

import pytest

from optimisation.checkpoint import SEARCHING, source_hash
from optimisation.files import ROOT


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for package in ("impact_env", "optimisation"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    return tmp_path


def test_fingerprint_is_that_of_the_sources_wherever_they_lie_and_has_the_versions(
    copy: Path,
) -> None:
    here = source_hash()
    assert source_hash(root=copy) == here
    assert set(here) == {"code", "llvmlite", "numba", "numpy", "scipy"}
    assert {"optuna", "numba"} <= set(source_hash(SEARCHING))
    (file := copy / "impact_env/scene.py").write_bytes(file.read_bytes().replace(b"\n", b"\r\n"))
    source_hash.cache_clear()
    assert source_hash(root=copy) == here


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("impact_env/kernels/exact/rigid_contact.py", True),
        ("impact_env/scene.py", True),
        ("optimisation/measures.py", True),
        ("optimisation/search/study.py", True),
        ("optimisation/report/design_report.py", False),
        ("impact_env/envs/drawing.py", False),
    ],
)
def test_an_edit_of_what_computes_shows_in_the_fingerprint(
    copy: Path, edited: str, counts: bool
) -> None:
    file = copy / edited
    file.write_text(file.read_text() + "\n# edited\n")
    assert (source_hash(root=copy) != source_hash()) is counts
