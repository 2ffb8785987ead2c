"""Kernels in plain Python give the bits of the compiled ones.

With NUMBA_DISABLE_JIT=1 nothing is compiled.
"""

import ctypes
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import golden
import numpy as np
import pytest
from core import EVERYTHING
from every_scene import EVERY, bits
from golden import CASES, NUMBERS, agree, numbers
from places import fresh

from impact_env.kernels.compiling.plain_code import fused

# impacts without friction on a moving base or under loads: nothing else in the suite needs their
# energies compiled, so that two run in plain Python, the others without energies
UNCOMPILED = ("unbalance", "moving base")
WITHOUT_ENERGIES = (
    "moving base about a mean at rest",
    "orders",
    "record of the base",
    "shock",
    "strike",
)
ENERGIES = {"work", "modal_loss", "friction_loss", "impact_loss", "absorber_damping"}
FOLDER = "kernels"
WHOLE = """
import golden, impact_env, inspect, json
from every_scene import bits
from impact_env import warm_up
from impact_env.kernels.exact.rigid import handle_event
assert inspect.isfunction(handle_event)  # what a debugger steps into
told = []
impact_env.on_compile(told.append)
values = {{name: golden.CASES[name]() for name in (*golden.EVERY, *{uncompiled})}}
result = {{
    "bits": {{name: bits(values[name]) for name in golden.EVERY}},
    "numbers": {{name: golden.numbers(values[name]) for name in {uncompiled}}},
}}
print(json.dumps(result))
assert told == []
assert warm_up.main([], told.append) == 0
assert told == ["NUMBA_DISABLE_JIT is set: kernels run in plain Python, there is nothing to compile"]
"""


@cache
def plain(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Return bits and numbers of golden cases in a process in which nothing is compiled; its cache would be ``folder``."""
    code = WHOLE.format(uncompiled=UNCOMPILED)
    result = fresh(
        "-W", "error::RuntimeWarning", "-c", code, NUMBA_DISABLE_JIT=1, IMPACT_ENV_CACHE=folder
    )
    assert not folder.exists()  # nothing is written
    results: dict[str, dict[str, dict[str, Any]]] = json.loads(result.stdout)
    return results


@pytest.mark.parametrize("name", EVERY)
def test_plain_python_gives_the_bits_of_compiled_kernels(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    plain_bits = plain(tmp_path_factory.getbasetemp() / FOLDER)["bits"][name]
    compiled = EVERY[name]()
    hexadecimal = bits(compiled)
    assert {
        part: (np.frombuffer(bytes.fromhex(digits)).tolist(), compiled[part].tolist())
        for part, digits in plain_bits.items()
        if hexadecimal[part] != digits
    } == {}
    assert plain_bits.keys() == compiled.keys()


@pytest.mark.parametrize("name", CASES)
def test_golden_cases_give_the_committed_numbers(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    stored = json.loads(NUMBERS.read_text())[name]
    if name in WITHOUT_ENERGIES:
        monkeypatch.setattr(golden, "EVERYTHING", replace(EVERYTHING, energy=False))
        stored = {part: values for part, values in stored.items() if part not in ENERGIES}
    computed = (
        plain(tmp_path_factory.getbasetemp() / FOLDER)["numbers"][name]
        if name in UNCOMPILED
        else numbers(CASES[name]())
    )
    assert computed.keys() == stored.keys()
    assert {
        part: (computed[part], stored[part])
        for part in stored
        if not agree(computed[part], stored[part])
    } == {}


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
