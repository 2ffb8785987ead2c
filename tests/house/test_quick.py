"""What `scripts/test --quick` runs: some of every kind, without torch, and none that is marked slow."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from choice import LONGEST_FIRST, PARTS, QUICK
from places import ROOT, SUPPORT

TESTS = SUPPORT.parent
KINDS = {folder.name for folder in TESTS.iterdir() if list(folder.glob("test_*.py"))}
ABSENT = ("torch", "stable_baselines3", "sb3_contrib", "distributed", "heyoka", "minari")
COLLECT = f"""
import sys
import pytest

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {ABSENT}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent())
sys.exit(pytest.main(["--quick", "--collect-only", "-q", "-rs", "-n", "0", "-p", "no:cacheprovider"]))
"""


@pytest.mark.parametrize("names", [QUICK, LONGEST_FIRST], ids=["quick", "longest first"])
def test_lists_name_files_that_are_there(names: tuple[str, ...]) -> None:
    assert len(set(names)) == len(names)
    assert not [name for name in names if not (TESTS / name).is_file()]


def test_every_kind_has_a_folder_and_is_in_the_quick_set() -> None:
    assert {"kernels", "simulator", "periodic", "environments", "design", "studies", "commands", "house"} - {"house"} < KINDS
    assert {name.split("/")[0] for name in QUICK} == KINDS
    assert not list(TESTS.glob("test_*.py"))


def test_the_parts_have_every_file_of_tests_once() -> None:
    found = [
        file
        for part in PARTS
        for pattern in part.split()
        for place in ROOT.glob(pattern)
        for file in ([place] if place.is_file() else place.rglob("test_*.py"))
    ]
    assert sorted(found) == sorted(TESTS.rglob("test_*.py"))


def test_the_quick_set_is_collected_whole_without_torch_and_leaves_out_what_is_slow() -> None:
    done = subprocess.run([sys.executable, "-c", COLLECT], cwd=ROOT, env=os.environ, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    found = [line.partition("::") for line in done.stdout.splitlines() if "::" in line]
    assert {file.removeprefix("tests/") for file, _, _ in found} == set(QUICK)
    assert "skipped" not in done.stdout
    assert " deselected" in done.stdout
    assert "test_joined_phases_of_a_run_are_joined_segments_of_its_schedule" not in done.stdout
