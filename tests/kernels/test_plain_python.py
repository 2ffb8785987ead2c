"""Kernels in plain Python (NUMBA_DISABLE_JIT=1): the bits of the compiled ones, without compiling."""

import ctypes
import json
import math
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from every_scene import EVERY
from places import fresh

from impact_env.kernels.compiling.plain_code import fused

FOLDER = "kernels"
WHOLE = """
import every_scene, impact_env, inspect, json
from impact_env import warm_up
from impact_env.kernels.exact.rigid import pass_event
assert inspect.isfunction(pass_event)  # what a debugger steps into
told = []
impact_env.on_compile(told.append)
print(json.dumps({name: run() for name, run in every_scene.EVERY.items()}))
assert told == []
assert warm_up.main([], told.append) == 0
assert told == ["NUMBA_DISABLE_JIT is set: kernels run in plain Python, there is nothing to compile"]
"""


@cache
def plain(folder: Path) -> dict[str, dict[str, str]]:
    """Return the bits of a process in which nothing is compiled; kernels would be kept in ``folder``."""
    result = fresh(
        "-W", "error::RuntimeWarning", "-c", WHOLE, NUMBA_DISABLE_JIT=1, IMPACT_ENV_CACHE=folder
    )
    assert not folder.exists()  # nothing is written
    found: dict[str, dict[str, str]] = json.loads(result.stdout)
    return found


@pytest.mark.parametrize("name", EVERY)
def test_plain_python_gives_the_bits_of_compiled_kernels(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    found = plain(tmp_path_factory.getbasetemp() / FOLDER)[name]
    compiled = EVERY[name]()
    assert {
        what: np.frombuffer(bytes.fromhex(bits)).tolist()
        for what, bits in found.items()
        if compiled[what] != bits
    } == {}
    assert found.keys() == compiled.keys()


def rounded_twice(x: float, y: float, z: float) -> float:
    return x * y + z


@pytest.mark.parametrize("library", [SimpleNamespace(), SimpleNamespace(fma=rounded_twice)])
def test_without_a_fused_multiplication_kernels_are_refused(
    library: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The C library has none, or one that rounds twice; nor has Python, before 3.13."""
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    monkeypatch.delattr(math, "fma", raising=False)
    with pytest.raises(
        RuntimeError,
        match=r"need a fused multiplication and addition.*leave NUMBA_DISABLE_JIT unset",
    ):
        fused.__wrapped__()
