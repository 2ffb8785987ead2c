"""Kernels that came with the package: found from another folder and by other processes, and by no sources or processors that they are not for."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from places import ROOT

from impact_env.kernels.compiling import cache
from impact_env.kernels.compiling.cache import HOST, NEEDED, SHIPPED_FOR, digest, why_not_shipped

FEATURES = cache.llvmlite.binding.get_host_cpu_features
pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(sys.platform != "linux" or not all(FEATURES().get(name) for name in NEEDED), reason="a Linux machine with AVX2 is needed"),
]
RUN = """
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


def run(site: Path, kept: Path, *words: str, **variables: str) -> tuple[str, int, str]:
    """Return the digits of the scenes that are named, how many kernels were compiled, and what was said."""
    ours = {name: text for name, text in os.environ.items() if not name.startswith(("NUMBA_", "IMPACT_ENV_"))}
    ours |= {"PYTHONPATH": str(site), "IMPACT_ENV_CACHE": str(kept)} | variables
    done = subprocess.run([sys.executable, "-P", "-c", RUN, *words], env=ours, cwd=kept.parent, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    digits, (compiled, package) = done.stdout.splitlines()[0], done.stdout.splitlines()[1].split()
    assert package == str(site / "impact_env" / "__init__.py")
    return digits, int(compiled), done.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A package with kernels that were compiled elsewhere, as `scripts/build --kernels` does, and the digits that they gave there."""
    folder = tmp_path_factory.mktemp("shipped")
    package = folder / "site" / "impact_env"
    shutil.copytree(ROOT / "impact_env", package, ignore=shutil.ignore_patterns("__pycache__", "shipped"))
    name, features = SHIPPED_FOR
    digits, compiled, _ = run(ROOT, folder / "made", "none", "friction", NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=features)
    assert compiled >= 2
    shutil.copytree(folder / "made", package / "kernels" / "shipped")
    return folder / "site", digits


@pytest.fixture
def site(made: tuple[Path, str], tmp_path: Path) -> Path:
    """A copy of that package."""
    return shutil.copytree(made[0], tmp_path / "another_site")


def test_nothing_is_compiled_and_nothing_kept(made: tuple[Path, str], tmp_path: Path) -> None:
    assert run(made[0], tmp_path / "kept", "none", "friction") == (made[1], 0, "")
    assert not list((tmp_path / "kept").rglob("*.nb[ci]"))


def test_kernels_for_the_host_are_preferred_and_give_the_same_digits(made: tuple[Path, str], tmp_path: Path) -> None:
    digits, compiled, _ = run(made[0], tmp_path / "kept", "none", **{HOST: "host"})
    assert made[1].startswith(digits)
    assert compiled >= 1
    shutil.rmtree(shutil.copytree(made[0], tmp_path / "site") / "impact_env" / "kernels" / "shipped")
    assert run(tmp_path / "site", tmp_path / "kept", "none") == (digits, 0, "")
    folder = cache.cache_folder()  # what these tests have compiled for the host
    assert folder is not None
    assert run(ROOT, folder.parent, "none", "friction")[0] == made[1]


def test_other_sources_find_nothing(site: Path, tmp_path: Path) -> None:
    digits, compiled, _ = run(site, tmp_path / "kept", "none")
    assert compiled == 0
    with (site / "impact_env" / "kernels" / "signals.py").open("a") as file:
        file.write("# another version\n")
    again, compiled, _ = run(site, tmp_path / "kept", "none")
    assert (again, compiled > 0) == (digits, True)


def test_a_damaged_one_is_compiled_anew(site: Path, tmp_path: Path) -> None:
    for file in site.rglob("linear.linear_lane*.nbc"):
        content = file.read_bytes()
        file.write_bytes(content[:-5000] + bytes(5000))
    digits, compiled, said = run(site, tmp_path / "kept", "none")
    assert compiled == 1
    assert "damaged kernels in" in said
    assert run(site, tmp_path / "kept", "none")[:2] == (digits, 0)


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of kernels that came with the package, here: without any yet; and no processor is asked for."""
    monkeypatch.setattr(cache, "SHIPPED", tmp_path / "shipped")
    monkeypatch.delenv(HOST, raising=False)
    for name in ("CPU_NAME", "CPU_FEATURES"):
        monkeypatch.setattr(cache.numba.config, name, None)
    return tmp_path / "shipped"


def test_why_none_are_used_is_told(told: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    why = why_not_shipped.__wrapped__
    assert why() == "none came with this package"
    python = f"py{sys.version_info[0]}{sys.version_info[1]}"
    for folder, name in (("0123456789abcdef", f"f-1.{python}.nbi"), (digest(), "f-1.py27.nbi"), (digest(), f"f-1.{python}.nbi")):
        assert why() != ""
        (told / folder / "kernels").mkdir(parents=True, exist_ok=True)
        (told / folder / "kernels" / name).touch()
    assert why() == ""
    monkeypatch.setattr(cache.llvmlite.binding, "get_host_cpu_features", lambda: FEATURES() | {"fma": False})
    assert why() == "this processor lacks fma"
    monkeypatch.setattr(cache.numba.config, "CPU_NAME", "generic")
    assert "asks for others" in why()


def test_a_wheel_says_what_its_kernels_are_for(tmp_path: Path) -> None:
    pytest.importorskip("hatchling")
    (tmp_path / "made" / digest() / "kernels").mkdir(parents=True)
    for name in ("kernels/f-1.py311.nbi", "kernels/f-1.py311.1.nbc", "lock"):
        (tmp_path / "made" / digest() / name).write_text(name)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, env=os.environ | {"KERNELS": str(tmp_path / "made")})
    (wheel,) = tmp_path.glob("*.whl")
    python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    assert wheel.stem.endswith(f"-{python}-{python}-manylinux_2_27_x86_64")
    names = [name.partition("shipped/")[2] for name in zipfile.ZipFile(wheel).namelist() if "shipped" in name]
    assert sorted(names) == [f"{digest()}/kernels/f-1.py311.1.nbc", f"{digest()}/kernels/f-1.py311.nbi"]
