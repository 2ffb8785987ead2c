"""What is committed of results stays small, and lists of test files name files that exist."""

import subprocess
import tarfile
from pathlib import Path

import pytest
from choice import ARITHMETIC_GROUPS, GROUPS, QUICK_GROUPS
from kinds import KINDS
from places import ROOT, SUPPORT

# Results are not source: what is committed of them stays small.


FILES_RESULTS = 960
DOCS_BYTES = 8.5e6
SDIST_BYTES = 9e6


def _tracked() -> list[Path]:
    """Return the existing files of the checkout that Git tracks.

    The test is skipped if there is no checkout.
    """
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    return [ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()]


def test_files_are_few_and_docs_small() -> None:
    tracked = _tracked()
    assert len(tracked) < FILES_RESULTS
    docs = {file: file.stat().st_size for file in tracked if (ROOT / "docs") in file.parents}
    assert sum(docs.values()) < DOCS_BYTES, sorted(docs.items(), key=lambda entry: -entry[1])[:10]


def test_a_source_distribution_is_small_and_brings_no_numbers(tmp_path: Path) -> None:
    """A source distribution is small and contains no result files.

    The test packs the files that hatchling would take into its own archive, since a checkout may
    have files that do not belong to it.
    """
    builder = pytest.importorskip("hatchling.builders.sdist").SdistBuilder(str(ROOT))
    tracked = {str(file.relative_to(ROOT)) for file in _tracked()}
    taken = [
        file.relative_path
        for file in builder.recurse_included_files()
        if file.relative_path in tracked
    ]
    assert {"pyproject.toml", "docs/README.md", "docs/paper/m12.png"} <= set(taken)
    assert not [name for name in taken if name.startswith("docs/") and name.endswith(".json.gz")]
    with tarfile.open(tmp_path / "sdist.tar.gz", "w:gz") as archive:
        for name in taken:
            archive.add(ROOT / name, name)
    assert (tmp_path / "sdist.tar.gz").stat().st_size < SDIST_BYTES


# What `scripts/test --quick` runs: some of every kind, without torch, and none that is marked slow.


TESTS = SUPPORT.parent


@pytest.mark.parametrize("groups", [QUICK_GROUPS, ARITHMETIC_GROUPS], ids=["quick", "arithmetic"])
def test_lists_name_existing_files(groups: tuple[str, ...]) -> None:
    names = " ".join(groups).split()
    assert len(set(names)) == len(names)
    assert not [name for name in names if not (ROOT / name).is_file()]


def test_the_suite_needs_few_kinds_of_kernels() -> None:
    """The test suite needs few kinds of kernels.

    There are 30 kinds of runs, and orbits. Each compiles for up to a minute. Parameters that scenes
    can share at no cost are values in the kernels.
    """
    assert len(KINDS) <= 31


def test_the_groups_have_every_file_of_tests_once() -> None:
    files = [file for group in GROUPS for pattern in group.split() for file in ROOT.glob(pattern)]
    assert sorted(files) == sorted(TESTS.rglob("test_*.py"))
