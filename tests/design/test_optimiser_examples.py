"""The worked examples with other people's optimisers run, where those are installed, and find better designs than they begin with."""

import importlib.util
from types import ModuleType

import numpy as np
import pytest
from places import EXAMPLES


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pymoo_finds_a_front(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pymoo")
    front = load("optimise_with_pymoo").main(8, 3, 2, rate=40.0)
    assert np.all(np.isfinite(front))
    assert 0.05 < front[:, 0].min() < 0.6
    assert capsys.readouterr().out.count("mW lost in impacts") == len(front)


def test_botorch_finds_a_quiet_design(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("botorch")
    level = load("optimise_with_botorch").main(6, 1, 2, 2, rate=40.0)
    assert 0.05 < level < 0.6
    assert "on fresh members" in capsys.readouterr().out
