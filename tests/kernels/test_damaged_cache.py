"""Damaged files of compiled kernels: never run, compiled anew with one warning, and whole again for the next process. All in fresh processes."""

import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

from impact_env.kernels.compiling.cache import digest

CONSTANT = 12345.678  # stands as it is in the machine code
SMALL = f"""
from impact_env.kernels.compiling.jit import jit

@jit
def first(x):
    return x + {CONSTANT}

@jit
def second(x):
    return 2 * x + {CONSTANT}

print(first(1), first(1.5), second(1))
print(*(sum(kept.values()) for kernel in (first, second) for kept in (kernel.stats.cache_hits, kernel.stats.cache_misses)))
"""
RESULT = f"{1 + CONSTANT} {1.5 + CONSTANT} {2 + CONSTANT}"


def run(script: Path, folder: Path) -> tuple[str, str, list[str]]:
    """Return the results, hits and misses of each kernel, and what was warned of, line by line."""
    environment = os.environ | {"IMPACT_ENV_CACHE": str(folder), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    result, stats = done.stdout.splitlines()
    return result, stats, done.stderr.splitlines()


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A script, and the folder where its kernels are kept."""
    place = tmp_path_factory.mktemp("kernels")
    (script := place / "small.py").write_text(SMALL)
    assert run(script, place / "cache") == (RESULT, "0 2 0 1", [])
    return script, place / "cache"


@pytest.fixture
def kept(filled: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """The same with a folder of its own."""
    return filled[0], shutil.copytree(filled[1], tmp_path / "cache")


def one(folder: Path, pattern: str) -> Path:
    (found,) = folder.rglob(pattern)
    return found


def flipped(content: bytes) -> bytes:
    """Flip a bit of the number that is added, or of what is in the middle."""
    at = content.find(struct.pack("<d", CONSTANT)) + 5 or len(content) // 2
    return content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :]


DAMAGES = {
    "empty": lambda _: b"",
    "cut": lambda content: content[: len(content) // 2],
    "garbage": lambda _: bytes(range(256)) * 9,
    "flipped": flipped,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_warned_of_once_and_mended(kept: tuple[Path, Path], damage: str) -> None:
    """An index of two kernels, and the machine code of another."""
    for path in (one(kept[1], "*first*.nbi"), one(kept[1], "*second*.nbc")):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    result, stats, (line,) = run(*kept)
    assert (result, stats) == (RESULT, "0 2 0 1")
    assert line == f"damaged kernels in {kept[1] / digest()} are compiled anew"
    assert run(*kept) == (RESULT, "2 0 1 0", [])


def test_flipping_reaches_what_would_be_run(filled: tuple[Path, Path]) -> None:
    assert struct.pack("<d", CONSTANT) in one(filled[1], "*second*.nbc").read_bytes()


def test_data_of_other_types_is_not_run(kept: tuple[Path, Path]) -> None:
    """As is left where an index was lost, and a process ended between a new one and its data."""
    one(kept[1], "*first*.2.nbc").write_bytes(one(kept[1], "*first*.1.nbc").read_bytes())
    assert run(*kept) == (RESULT, "1 1 1 0", [])
    assert run(*kept) == (RESULT, "2 0 1 0", [])
