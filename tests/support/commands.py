"""Commands, called in this process."""

from __future__ import annotations

from types import ModuleType

import pytest
from click import Command
from click.testing import CliRunner, Result

from optimisation.cli.group import imported

FAST = ["--modes", 2, "--rate", 40, "--members", 2, "--batch", 4]  # the numbers do not matter here
SMALL = {"MAP": 3, "SOBOL": 2, "QUICK_SOBOL": 2, "FORCES": 3, "DETUNINGS": 3, "DRAWS": 2}


def load(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the script, whose maps and draws are small for the time of a test."""
    module = imported(name)
    for constant in SMALL.keys() & vars(module).keys():
        monkeypatch.setattr(module, constant, SMALL[constant])
    return module


def call(script: ModuleType | Command, *arguments: object) -> Result:
    """Call the command, or that of a script; the result has exit code and output."""
    command = script if isinstance(script, Command) else script.main
    return CliRunner().invoke(command, [str(argument) for argument in arguments])
