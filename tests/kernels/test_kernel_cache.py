"""Where compiled kernels are kept, in fresh processes that must obey permissions, each with a real run."""

import ctypes
import os
import shutil
import struct
import subprocess
import sys
import sysconfig
import tempfile
import venv
from pathlib import Path

import pytest
from places import ROOT

from impact_env.kernels.compiling import cache
from impact_env.kernels.compiling.cache import Folders, choose, digest

DAC_OVERRIDE, DAC_READ_SEARCH = 1, 2
LIBC = ctypes.CDLL(None) if os.name == "posix" else None
RUN = """
import impact_env
from impact_env import Beam, Drive, beam_scene, constant_frequency, simulate
from impact_env.kernels.compiling.cache import folders
from impact_env.kernels.exact.linear import linear_lane as kernel
scene = beam_scene(Beam(modes=2))
level = simulate(scene, Drive(1.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0))).level.value
stats = kernel.stats
print(folders().write, folders().read, level, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()), sep="|")
"""
OUTSIDE = "import sys; sys.prefix = sys.base_prefix\n"  # of a virtual environment
NOWHERE = """
import tempfile
def refuse():
    raise FileNotFoundError
tempfile.gettempdir = refuse
"""


def obey_permissions() -> None:
    """Take from root, in a process that is about to start, the right to pass over permissions (prctl's PR_CAPBSET_DROP)."""
    if os.getuid() == 0:
        for capability in DAC_OVERRIDE, DAC_READ_SEARCH:
            assert LIBC.prctl(24, capability, 0, 0, 0) == 0


def run(before: str = "", **variables: object) -> dict[str, str]:
    kept = {
        name: value for name, value in os.environ.items() if name not in {"IMPACT_ENV_CACHE", "XDG_CACHE_HOME", "HOME", "TMPDIR", "NUMBA_CACHE_DIR"}
    }
    environment = kept | {"PYTHONPATH": str(ROOT)} | {name: str(value) for name, value in variables.items()}
    done = subprocess.run([sys.executable, "-c", before + RUN], env=environment, cwd="/", capture_output=True, text=True, preexec_fn=obey_permissions)
    assert done.returncode == 0, done.stderr
    words = dict(zip(("write", "read", "level", "hits", "misses"), done.stdout.strip().split("|"), strict=True))
    return words | {"error": done.stderr}


def folder(path: Path, mode: int = 0o755) -> Path:
    path.mkdir(exist_ok=True)
    path.chmod(mode)
    return path


posix = pytest.mark.skipif(os.name != "posix", reason="needs the permissions of POSIX")


@posix
def test_a_named_folder_is_filled_and_then_read_where_nothing_can_be_written(tmp_path: Path) -> None:
    """An image with kernels compiled beforehand: first filled, then read only, without and with a temporary folder."""
    named, temporary = folder(tmp_path / "named", 0o777), folder(tmp_path / "tmp", 0o1777)
    first = run(IMPACT_ENV_CACHE=named, TMPDIR=temporary)
    assert (first["write"], first["read"], first["misses"]) == (str(named / digest()), "None", "1")
    for path in [named, *named.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)

    second = run(IMPACT_ENV_CACHE=named, TMPDIR=temporary)
    assert second["read"] == str(named / digest())
    assert second["write"].startswith(str(temporary / "impact_env-"))
    assert (second["hits"], second["misses"]) == ("1", "0")
    assert second["level"] == first["level"]
    assert not list(Path(second["write"]).rglob("*.nbc"))  # nothing was compiled

    third = run(NOWHERE, IMPACT_ENV_CACHE=named)
    assert (third["write"], third["read"], third["level"]) == ("None", str(named / digest()), first["level"])
    assert (third["hits"], third["misses"]) == ("1", "0")
    assert "no folder can be written to" in third["error"]


@posix
def test_a_home_that_cannot_be_written_to_leaves_the_temporary_folder(tmp_path: Path) -> None:
    home, temporary = folder(tmp_path / "home", 0o555), folder(tmp_path / "tmp", 0o1777)
    (home / ".cache").mkdir()
    (home / ".cache").chmod(0o555)
    first = run(OUTSIDE, HOME=home, TMPDIR=temporary)
    (private,) = temporary.glob("impact_env-*")
    assert (first["write"], first["read"], first["misses"]) == (str(private / digest()), "None", "1")
    assert private.stat().st_mode & 0o777 == 0o700
    second = run(OUTSIDE, HOME=home, TMPDIR=temporary)
    assert (second["hits"], second["misses"], second["level"]) == ("1", "0", first["level"])


@posix
@pytest.mark.parametrize("before", ["", OUTSIDE])
def test_kernels_are_kept_in_the_virtual_environment_or_else_at_home(tmp_path: Path, before: str) -> None:
    place, home = tmp_path / "environment", folder(tmp_path / "home")
    venv.create(place, symlinks=True)
    path = os.pathsep.join([str(ROOT), sysconfig.get_path("purelib")])
    code = f"{before}from impact_env.kernels.compiling.cache import cache_folder; print(cache_folder().parent)"
    found = subprocess.check_output([place / "bin" / "python", "-c", code], env={"HOME": str(home), "PYTHONPATH": path}, text=True).strip()
    assert Path(found) == (home / ".cache" / "impact_env" if before else place / "kernel-cache")
    assert [path.name for path in home.iterdir()] == ([".cache"] if before else [])


@posix
def test_a_folder_of_someone_else_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is read from the cache is run, and everyone can make a folder among the temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    foreign = folder(tmp_path / f"impact_env-{os.getuid()}")
    assert choose(None, "x") == Folders(foreign / "x", None)
    foreign.chmod(0o777)
    chosen = choose(None, "x").write
    assert chosen.parent != foreign
    assert chosen.parent.stat().st_mode & 0o777 == 0o700


@posix
def test_nothing_can_be_written_at_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse(*_arguments: object, **_options: object) -> None:
        raise PermissionError

    monkeypatch.setattr(cache.Path, "mkdir", refuse)
    monkeypatch.setattr(cache.tempfile, "gettempdir", refuse)
    assert choose(tmp_path, "x") == Folders(None, None)


def test_the_hash_sees_every_source(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    seen = {digest(tmp_path)}
    for name, text in (("a.py", ""), ("a.py", "1"), ("below/b.py", ""), ("below/b.py", "1"), ("below/c.txt", "1")):
        (tmp_path / name).write_text(text)
        seen.add(digest(tmp_path))
    assert len(seen) == 5  # all but the last, which is no source


FILLED = """
import sys
import numpy as np
from impact_env.kernels.compiling.jit import jit

@jit
def size(a, b):
    return a.ndim + b.ndim

for k in map(int, sys.argv[1:]):
    assert size(np.zeros((1,) * (1 + k % 6)), np.zeros((1,) * (1 + k // 6))) == 2 + k % 6 + k // 6
print(sum(size.stats.cache_hits.values()), sum(size.stats.cache_misses.values()))
"""


def test_two_processes_that_fill_one_folder_lose_nothing(tmp_path: Path) -> None:
    """numba reads an index, adds to it and writes it back; 18 variants each of one function make the two meet in that again and again."""
    script = tmp_path / "filled.py"
    script.write_text(FILLED)
    environment = os.environ | {"IMPACT_ENV_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def start(variants: range) -> subprocess.Popen[str]:
        return subprocess.Popen([sys.executable, script, *map(str, variants)], env=environment, stdout=subprocess.PIPE, text=True)

    both = [start(range(0, 36, 2)), start(range(1, 36, 2))]
    assert [process.communicate()[0].split() for process in both] == [["0", "18"]] * 2
    assert start(range(36)).communicate()[0].split() == ["36", "0"]


# Damaged files of compiled kernels: never run, compiled anew with one warning, and whole again for the next process.


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


def run_small(script: Path, folder: Path) -> tuple[str, str, list[str]]:
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
    assert run_small(script, place / "cache") == (RESULT, "0 2 0 1", [])
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
    result, stats, (line,) = run_small(*kept)
    assert (result, stats) == (RESULT, "0 2 0 1")
    assert line == f"damaged kernels in {kept[1] / digest()} are compiled anew"
    assert run_small(*kept) == (RESULT, "2 0 1 0", [])


def test_flipping_reaches_what_would_be_run(filled: tuple[Path, Path]) -> None:
    assert struct.pack("<d", CONSTANT) in one(filled[1], "*second*.nbc").read_bytes()


def test_data_of_other_types_is_not_run(kept: tuple[Path, Path]) -> None:
    """As is left where an index was lost, and a process ended between a new one and its data."""
    one(kept[1], "*first*.2.nbc").write_bytes(one(kept[1], "*first*.1.nbc").read_bytes())
    assert run_small(*kept) == (RESULT, "1 1 1 0", [])
    assert run_small(*kept) == (RESULT, "2 0 1 0", [])
