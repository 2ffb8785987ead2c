"""Commands of studies, called in this process and small enough for tests."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import pytest
from click.testing import CliRunner, Result
from places import SCRIPTS

FAST = ["--modes", 2, "--rate", 40, "--members", 2, "--batch", 4]  # the numbers do not matter here
SMALL = {"MAP": 3, "SOBOL": 2, "QUICK_SOBOL": 2, "FORCES": 3, "DETUNINGS": 3, "DRAWS": 2}


def load(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for constant, value in SMALL.items():
        if hasattr(module, constant):
            monkeypatch.setattr(module, constant, value)
    return module


def call(script: ModuleType, *arguments: object) -> Result:
    return CliRunner().invoke(script.main, [str(argument) for argument in arguments])
