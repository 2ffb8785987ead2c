"""Kernels in plain Python (NUMBA_DISABLE_JIT=1): the bits of the compiled ones, without compiling."""

import ctypes
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from every_scene import EVERY
from places import ROOT, SUPPORT

from impact_env.kernels.compiling.plain_code import PlainNumber, fused

FOLDER = "kernels"
WHOLE = """
import sys
import every_scene, impact_env, inspect
from impact_env.kernels.exact.rigid import pass_event
assert inspect.isfunction(pass_event)  # what a debugger steps into
told = []
impact_env.on_compile(told.append)
print(every_scene.main(sys.argv[1:]))
assert told == []
"""
WARM_UP = "from impact_env import warm_up; print(warm_up.main([], print))"


def in_plain_python(code: str, folder: Path, *words: str) -> str:
    """Return what a process prints in which nothing is compiled; kernels would be kept in ``folder``."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), str(ROOT)]), "NUMBA_DISABLE_JIT": "1", "IMPACT_ENV_CACHE": str(folder)}
    command = [sys.executable, "-W", "error::RuntimeWarning", "-c", code, *words]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=580)
    assert result.returncode == 0, result.stderr
    assert not folder.exists()  # nothing is written
    return result.stdout.strip()


@cache
def plain(folder: Path) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = json.loads(in_plain_python(WHOLE, folder))
    return found


@pytest.mark.parametrize("name", EVERY)
def test_plain_python_gives_the_bits_of_compiled_kernels(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    found, compiled = plain(tmp_path_factory.getbasetemp() / FOLDER)[name], EVERY[name]()
    assert {what: np.frombuffer(bytes.fromhex(bits)).tolist() for what, bits in found.items() if compiled[what] != bits} == {}
    assert found.keys() == compiled.keys()


def test_there_is_nothing_to_warm_up(tmp_path: Path) -> None:
    lines = in_plain_python(WARM_UP, tmp_path / FOLDER).splitlines()
    assert lines == ["NUMBA_DISABLE_JIT is set: kernels run in plain Python, there is nothing to compile", "0"]


@pytest.fixture
def anew() -> Iterator[None]:
    """Let the fused multiplication be looked for once more, and after the test again."""
    fused.cache_clear()
    yield
    fused.cache_clear()


def rounded_twice(x: float, y: float, z: float) -> float:
    return x * y + z


@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("library", [SimpleNamespace(), SimpleNamespace(fma=rounded_twice)])
def test_without_a_fused_multiplication_kernels_are_refused(library: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """The C library has none, or one that rounds twice; nor has Python, before 3.13."""
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    monkeypatch.delattr(math, "fma", raising=False)
    two = PlainNumber(np.float64(2.0))
    with pytest.raises(RuntimeError, match=r"need a fused multiplication and addition.*leave NUMBA_DISABLE_JIT unset"):
        two.fma(two, two)


@pytest.mark.usefixtures("anew")
def test_python_s_own_fused_multiplication_serves_where_the_library_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def own(x: float, y: float, z: float) -> float:
        return float(Fraction(x) * Fraction(y) + Fraction(z))

    monkeypatch.setattr(ctypes, "CDLL", lambda _: SimpleNamespace())
    monkeypatch.setattr(math, "fma", own, raising=False)
    assert fused() is own
