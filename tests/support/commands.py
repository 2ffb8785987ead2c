"""Commands, called in this process."""

import csv
from pathlib import Path
from types import ModuleType

import pytest
from click import Command
from click.testing import CliRunner, Result

from optimisation.answers.design import ExplanationSizes
from optimisation.cli.names import imported
from optimisation.tuned import den_hartog

FAST = ["--modes", 2, "--rate", 40, "--members", 2, "--batch", 4]  # the numbers do not matter here
SHORT = ["--modes", 2, "--from", 0.98, "--to", 1, "--rate", 10]  # of sweep: 20 pseudo periods
SIZES = ExplanationSizes(forces=3, detunings=3, gap_map=3, samples=2, draws=2)
SMALL = {"SIZES": SIZES, "QUICK_SIZES": SIZES, "SOBOL": 2, "QUICK_SOBOL": 2}
SEARCHED = (
    "absorber_rules",
    "comparison",
)  # modules that search for a tuned absorber's best tuning


def load(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the script, whose maps and draws are small for the time of a test, and tuned absorbers those of the closed form."""
    module = imported(name)
    for searching in SEARCHED:
        monkeypatch.setattr(
            f"optimisation.{searching}.smallest_amplitude",
            lambda model, mass_ratio, resonance, *_range: den_hartog(model, mass_ratio, resonance),
        )
    for constant in SMALL.keys() & vars(module).keys():
        monkeypatch.setattr(module, constant, SMALL[constant])
    return module


def call(script: ModuleType | Command, *arguments: object) -> Result:
    """Call the command, or that of a script; the result has exit code and output."""
    command = script if isinstance(script, Command) else script.main
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def done(script: ModuleType | Command, *arguments: object) -> Result:
    """Call the command as `call` does, which must succeed."""
    result = call(script, *arguments)
    assert result.exit_code == 0, result.output
    return result


def sweep(*arguments: object) -> Result:
    """Call the command sweep."""
    return call(imported("sweep"), *arguments)


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
