"""Results are not source: what is committed of them stays small."""

from __future__ import annotations

import subprocess
import tarfile
from pathlib import Path

import pytest
from places import ROOT

FILES, DOCS_BYTES, SDIST_BYTES = 870, 8e6, 8e6


def _tracked() -> list[Path]:
    """Return the files of the checkout that Git knows and that are there; skips the test where there is no checkout."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()]


def test_files_are_few_and_docs_small() -> None:
    tracked = _tracked()
    assert len(tracked) < FILES
    docs = {file: file.stat().st_size for file in tracked if (ROOT / "docs") in file.parents}
    assert sum(docs.values()) < DOCS_BYTES, sorted(docs.items(), key=lambda entry: -entry[1])[:10]


def test_a_source_distribution_is_small_and_brings_no_numbers(tmp_path: Path) -> None:
    """It has the files that hatchling takes, in an archive of its own, since a checkout may hold files that are no part of it."""
    builder = pytest.importorskip("hatchling.builders.sdist").SdistBuilder(str(ROOT))
    tracked = {str(file.relative_to(ROOT)) for file in _tracked()}
    taken = [file.relative_path for file in builder.recurse_included_files() if file.relative_path in tracked]
    assert {"pyproject.toml", "docs/README.md", "docs/paper/m12.png"} <= set(taken)
    assert not [name for name in taken if name.startswith("docs/") and name.endswith(".json.gz")]
    with tarfile.open(tmp_path / "sdist.tar.gz", "w:gz") as archive:
        for name in taken:
            archive.add(ROOT / name, name)
    assert (tmp_path / "sdist.tar.gz").stat().st_size < SDIST_BYTES
