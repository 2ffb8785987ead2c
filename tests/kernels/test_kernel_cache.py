"""Compiled kernels are cached in the right folder.

The tests run in new processes that must obey permissions, each with a real kernel.
"""

import ctypes
import os
import shutil
import struct
import subprocess
import sys
import sysconfig
import tempfile
import venv
from collections.abc import Callable
from pathlib import Path

import pytest
from places import ROOT

from impact_env.kernels.compiling import cache
from impact_env.kernels.compiling.cache import (
    HOST_VARIABLE,
    SHIPPED_CPU,
    SHIPPED_CPU_FEATURES,
    Folders,
    choose_folders,
    find_shipping_obstacle,
    hash_sources,
)

DAC_OVERRIDE = 1
DAC_READ_SEARCH = 2
LIBC = ctypes.CDLL(None) if os.name == "posix" else None
RUN = """
import impact_env
from impact_env.kernels.compiling.cache import find_folders
from impact_env.kernels.motion.observers import compute_level, new_level
result, stats = compute_level(new_level(32)), compute_level.stats
print(find_folders().write, find_folders().read, result, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()), sep="|")
"""
OUTSIDE = "import sys; sys.prefix = sys.base_prefix\n"  # of a virtual environment
NOWHERE = """
import tempfile
def refuse():
    raise FileNotFoundError
tempfile.gettempdir = refuse
"""


def obey_permissions() -> None:
    """Let a process that is about to start obey permissions, even as root.

    It loses the right to bypass permissions (prctl's PR_CAPBSET_DROP).
    """
    if os.getuid() == 0:
        for capability in DAC_OVERRIDE, DAC_READ_SEARCH:
            assert LIBC.prctl(24, capability, 0, 0, 0) == 0


def run(before: str = "", **variables: object) -> dict[str, str]:
    variables_left = {
        name: value
        for name, value in os.environ.items()
        if name not in {"IMPACT_ENV_CACHE", "XDG_CACHE_HOME", "HOME", "TMPDIR", "NUMBA_CACHE_DIR"}
    }
    environment = (
        variables_left
        | {"PYTHONPATH": str(ROOT)}
        | {name: str(value) for name, value in variables.items()}
    )
    done = subprocess.run(
        [sys.executable, "-c", before + RUN],
        env=environment,
        cwd="/",
        capture_output=True,
        text=True,
        preexec_fn=obey_permissions,
    )
    assert done.returncode == 0, done.stderr
    words = dict(
        zip(
            ("write", "read", "result", "hits", "misses"),
            done.stdout.strip().split("|"),
            strict=True,
        )
    )
    return words | {"error": done.stderr}


def folder(path: Path, mode: int = 0o755) -> Path:
    path.mkdir(exist_ok=True)
    path.chmod(mode)
    return path


posix = pytest.mark.skipif(os.name != "posix", reason="needs the permissions of POSIX")


@posix
def test_a_named_folder_is_filled_and_then_read_where_nothing_can_be_written(
    tmp_path: Path,
) -> None:
    """A named folder is filled, and is read when it is not writable.

    This is the case of an image with kernels compiled beforehand: first filled, then read only,
    without and with a temporary folder.
    """
    named = folder(tmp_path / "named", 0o777)
    temporary = folder(tmp_path / "tmp", 0o1777)
    first = run(IMPACT_ENV_CACHE=named, TMPDIR=temporary)
    assert (first["write"], first["read"], first["misses"]) == (
        str(named / hash_sources()),
        "None",
        "1",
    )
    for path in [named, *named.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)

    second = run(IMPACT_ENV_CACHE=named, TMPDIR=temporary)
    assert second["read"] == str(named / hash_sources())
    assert second["write"].startswith(str(temporary / "impact_env-"))
    assert (second["hits"], second["misses"]) == ("1", "0")
    assert second["result"] == first["result"]
    assert not list(Path(second["write"]).rglob("*.nbc"))  # nothing was compiled

    third = run(NOWHERE, IMPACT_ENV_CACHE=named)
    assert (third["write"], third["read"], third["result"]) == (
        "None",
        str(named / hash_sources()),
        first["result"],
    )
    assert (third["hits"], third["misses"]) == ("1", "0")
    assert "no folder can be written to" in third["error"]


@posix
def test_a_home_that_cannot_be_written_to_leaves_the_temporary_folder(tmp_path: Path) -> None:
    home = folder(tmp_path / "home", 0o555)
    temporary = folder(tmp_path / "tmp", 0o1777)
    (home / ".cache").mkdir()
    (home / ".cache").chmod(0o555)
    used = run(OUTSIDE, HOME=home, TMPDIR=temporary)
    (private,) = temporary.glob("impact_env-*")
    assert (used["write"], used["read"], used["misses"]) == (
        str(private / hash_sources()),
        "None",
        "1",
    )
    assert private.stat().st_mode & 0o777 == 0o700


@posix
@pytest.mark.parametrize("before", ["", OUTSIDE])
def test_kernels_are_cached_in_the_virtual_environment_or_else_at_home(
    tmp_path: Path, before: str
) -> None:
    place = tmp_path / "environment"
    home = folder(tmp_path / "home")
    venv.create(place, symlinks=True)
    path = os.pathsep.join([str(ROOT), sysconfig.get_path("purelib")])
    code = (
        f"{before}from impact_env.kernels.compiling.cache import cache_folder; "
        "print(cache_folder().parent)"
    )
    printed = subprocess.check_output(
        [place / "bin" / "python", "-c", code],
        env={"HOME": str(home), "PYTHONPATH": path},
        text=True,
    ).strip()
    assert Path(printed) == (home / ".cache" / "impact_env" if before else place / "kernel-cache")
    assert [path.name for path in home.iterdir()] == ([".cache"] if before else [])


@posix
def test_a_folder_of_someone_else_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of another user is not read.

    Files read from the cache are executed, and everyone can make a folder among the temporary
    files.
    """
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    foreign = folder(tmp_path / f"impact_env-{os.getuid()}")
    assert choose_folders(None, "x") == Folders(foreign / "x", None)
    foreign.chmod(0o777)
    chosen = choose_folders(None, "x").write
    assert chosen.parent != foreign
    assert chosen.parent.stat().st_mode & 0o777 == 0o700


def test_the_hash_sees_every_source(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    hashes = {hash_sources(tmp_path)}
    for name, text in (
        ("a.py", ""),
        ("a.py", "1"),
        ("below/b.py", ""),
        ("below/b.py", "1"),
        ("below/c.txt", "1"),
    ):
        (tmp_path / name).write_text(text)
        hashes.add(hash_sources(tmp_path))
    assert len(hashes) == 5  # all but the last, which is no source


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


def start(script: Path, folder: Path, *words: object) -> subprocess.Popen[str]:
    """Start a script whose kernels are kept in a folder."""
    environment = os.environ | {"IMPACT_ENV_CACHE": str(folder), "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, script, *map(str, words)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_two_processes_that_fill_one_folder_lose_nothing(tmp_path: Path) -> None:
    """Two processes that fill one folder lose no kernel.

    numba reads an index, adds to it and writes it back. 10 variants of one function in each process
    make such collisions frequent.
    """
    (script := tmp_path / "filled.py").write_text(FILLED)
    both = [
        start(script, tmp_path / "cache", *variants)
        for variants in (range(0, 20, 2), range(1, 20, 2))
    ]
    assert [process.communicate()[0].split() for process in both] == [["0", "10"]] * 2
    assert start(script, tmp_path / "cache", *range(20)).communicate()[0].split() == ["20", "0"]


# Damaged files of compiled kernels: never run, compiled anew with one warning, and whole again for
# the next process.


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


def run_small(script: Path, folder: Path) -> tuple[str, list[str]]:
    """Return hits and misses of each kernel, and the warnings line by line.

    The results must be correct.
    """
    out, errors = start(script, folder).communicate(timeout=120)
    result, stats = out.splitlines()
    assert result == RESULT
    return stats, errors.splitlines()


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A script, and the folder where its kernels are kept."""
    place = tmp_path_factory.mktemp("kernels")
    (script := place / "small.py").write_text(SMALL)
    assert run_small(script, place / "cache") == ("0 2 0 1", [])
    return script, place / "cache"


@pytest.fixture
def copied_cache(filled: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    """The same with a folder of its own."""
    return filled[0], shutil.copytree(filled[1], tmp_path / "cache")


def one(folder: Path, pattern: str) -> Path:
    (file,) = folder.rglob(pattern)
    return file


def flipped(content: bytes) -> bytes:
    """Flip a bit of the number that is added."""
    at = content.find(struct.pack("<d", CONSTANT)) + 5
    assert at > 4
    return content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :]


@pytest.mark.parametrize(
    ("index", "code"),
    [(b"", flipped), (bytes(range(256)) * 9, lambda content: content[: len(content) // 2])],
)
def test_damage_is_warned_of_once_and_mended(
    copied_cache: tuple[Path, Path], index: bytes, code: Callable[[bytes], bytes]
) -> None:
    """An index of two kernels, and the machine code of another."""
    one(copied_cache[1], "*first*.nbi").write_bytes(index)
    compiled = one(copied_cache[1], "*second*.nbc")
    compiled.write_bytes(code(compiled.read_bytes()))
    assert run_small(*copied_cache) == (
        "0 2 0 1",
        [f"damaged kernels in {copied_cache[1] / hash_sources()} are compiled anew"],
    )
    assert run_small(*copied_cache) == ("2 0 1 0", [])


def test_data_of_other_types_is_not_run(copied_cache: tuple[Path, Path]) -> None:
    """As is left where an index was lost, and a process ended between a new one and its data."""
    one(copied_cache[1], "*first*.2.nbc").write_bytes(
        one(copied_cache[1], "*first*.1.nbc").read_bytes()
    )
    assert run_small(*copied_cache) == ("1 1 1 0", [])


# Kernels that came with the package: found from another folder and by other processes, and by no
# sources or processors that they are not for.


FEATURES = cache.llvmlite.binding.get_host_cpu_features
served = pytest.mark.skipif(
    sys.platform != "linux" or not all(FEATURES().get(name) for name in SHIPPED_CPU_FEATURES),
    reason="needs Linux and AVX2",
)
SIMULATE = """
import sys
import impact_env
from impact_env import Beam, Drive, Record, beam_scene, impact_absorber, linear_sweep, on_compile, simulate
told = []
on_compile(told.append)
found = []
for word in sys.argv[1:]:
    scene = beam_scene(Beam(modes=3), impact_absorber(restitution=0.7, friction_limit=0.1) if word == "friction" else None)
    response = simulate(scene, Drive(3.5, linear_sweep(scene.model.resonance_omega(1), 0.97, 1.0)), record=Record(events=word == "friction"))
    found += [response.level.value, *response.end_state, *([] if response.impacts is None else response.impacts.time)]
print(*(float(x).hex() for x in found), sep=",")
print(len(told) // 2, impact_env.__file__)
"""


def simulated(site: Path, cache: Path, *words: str, **variables: str) -> tuple[str, int, str]:
    """Return the digits of the named scenes, the number of compiled kernels, and the output.

    The output is that on stderr.
    """
    environment = {
        name: text
        for name, text in os.environ.items()
        if not name.startswith(("NUMBA_", "IMPACT_ENV_"))
    }
    environment |= {"PYTHONPATH": str(site), "IMPACT_ENV_CACHE": str(cache)} | variables
    done = subprocess.run(
        [sys.executable, "-P", "-c", SIMULATE, *words],
        env=environment,
        cwd=cache.parent,
        capture_output=True,
        text=True,
        timeout=580,
    )
    assert done.returncode == 0, done.stderr
    digits = done.stdout.splitlines()[0]
    compiled, package = done.stdout.splitlines()[1].split()
    assert package == str(site / "impact_env" / "__init__.py")
    return digits, int(compiled), done.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return a package with kernels that were compiled elsewhere, and their results.

    The kernels are made as by `scripts/build --kernels`. The results are the digits that they gave
    there.
    """
    folder = tmp_path_factory.mktemp("shipped")
    package = folder / "site" / "impact_env"
    shutil.copytree(
        ROOT / "impact_env", package, ignore=shutil.ignore_patterns("__pycache__", "shipped")
    )
    name, features = SHIPPED_CPU
    digits, compiled, _ = simulated(
        ROOT, folder / "made", "none", "friction", NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=features
    )
    assert compiled >= 2
    shutil.copytree(folder / "made", package / "kernels" / "shipped")
    return folder / "site", digits


@pytest.mark.nightly
@served
def test_nothing_is_compiled_and_nothing_cached(made: tuple[Path, str], tmp_path: Path) -> None:
    assert simulated(made[0], tmp_path / "kept", "none", "friction") == (made[1], 0, "")
    assert not list((tmp_path / "kept").rglob("*.nb[ci]"))


@pytest.mark.nightly
@served
def test_kernels_for_the_host_are_preferred_and_give_the_same_digits(
    made: tuple[Path, str], tmp_path: Path
) -> None:
    digits, compiled, _ = simulated(made[0], tmp_path / "kept", "none", **{HOST_VARIABLE: "host"})
    assert made[1].startswith(digits)
    assert compiled >= 1
    shutil.rmtree(
        shutil.copytree(made[0], tmp_path / "site") / "impact_env" / "kernels" / "shipped"
    )
    assert simulated(tmp_path / "site", tmp_path / "kept", "none") == (digits, 0, "")
    assert (
        simulated(ROOT, cache.cache_folder().parent, "none", "friction")[0] == made[1]
    )  # what these tests have compiled for the host


@pytest.mark.nightly
@served
def test_damaged_kernels_and_those_of_other_sources_are_compiled_again(
    made: tuple[Path, str], tmp_path: Path
) -> None:
    site = shutil.copytree(made[0], tmp_path / "another_site")
    for file in site.rglob("linear.linear_lane*.nbc"):
        content = file.read_bytes()
        file.write_bytes(content[:-5000] + bytes(5000))
    digits, compiled, warnings = simulated(site, tmp_path / "kept", "none")
    assert compiled == 1
    assert made[1].startswith(digits)
    assert "damaged kernels in" in warnings
    assert simulated(site, tmp_path / "kept", "none")[:2] == (digits, 0)
    with (site / "impact_env" / "kernels" / "events" / "signals.py").open("a") as file:
        file.write("# another version\n")
    again, compiled, _ = simulated(site, tmp_path / "kept", "none")
    assert (again, compiled > 0) == (digits, True)


@served
def test_the_reason_why_no_kernels_are_used_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "shipped"
    monkeypatch.setattr(cache, "SHIPPED", folder)
    monkeypatch.delenv(HOST_VARIABLE, raising=False)
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(cache.numba.config, name, None)
    why = find_shipping_obstacle.__wrapped__
    python = f"py{sys.version_info[0]}{sys.version_info[1]}"
    assert why() == "none came with this package"
    for sources, name in (
        ("0123456789abcdef", f"f-1.{python}.nbi"),
        (hash_sources(), "f-1.py27.nbi"),
        (hash_sources(), f"f-1.{python}.nbi"),
    ):
        assert why() != ""
        (folder / sources / "kernels").mkdir(parents=True, exist_ok=True)
        (folder / sources / "kernels" / name).touch()
    assert why() == ""
    monkeypatch.setattr(
        cache.llvmlite.binding, "get_host_cpu_features", lambda: FEATURES() | {"fma": False}
    )
    assert why() == "this processor lacks fma"
    monkeypatch.setattr(cache.numba.config, "CPU_NAME", "generic")
    assert "asks for others" in why()
