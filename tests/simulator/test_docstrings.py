"""Examples in docstrings of the public interface run and print what they say.

Public callables describe their parameters.
"""

import doctest
import inspect
import sys

import pytest

import impact_env
from impact_env.ensemble import Lane, Members, run_lanes
from impact_env.sectors import (
    amplification_factor,
    diameter_energies,
    participation_ratio,
    simulate_sectors,
)

PUBLIC = {
    name: value
    for name, value in ((name, getattr(impact_env, name)) for name in impact_env.__all__)
    if callable(value)
} | {
    value.__name__: value
    for value in (
        *(Lane, Members, run_lanes, simulate_sectors),
        *(amplification_factor, diameter_energies, participation_ratio),
    )
}
EXAMPLES = {
    test.name: test
    for value in PUBLIC.values()
    if value.__module__.startswith("impact_env")
    for test in doctest.DocTestFinder(recurse=False).find(value)
    if test.examples
}
# classes whose objects the package makes: their attributes are described, not their parameters
MADE_BY_THE_PACKAGE = {
    "Response",
    "PerformanceCurve",
    "ParameterError",
    "IntegrationError",
    "Compilation",
}
INHERITED = {"Stopped", "StructureWarning"}
DESCRIBED = [
    name
    for name, value in PUBLIC.items()
    if name not in MADE_BY_THE_PACKAGE | INHERITED and inspect.signature(value).parameters
]


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_prints_what_it_says(name: str) -> None:
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(EXAMPLES[name], out=sys.stderr.write)
    assert runner.failures == 0


def test_the_package_begins_with_an_example_that_runs() -> None:
    assert doctest.testmod(impact_env).failed == 0
    assert "simulate(" in impact_env.__doc__.split("\n\n")[1]
    assert dir(impact_env) == sorted(impact_env.__all__)


@pytest.mark.parametrize("name", sorted(MADE_BY_THE_PACKAGE))
def test_attributes_of_results_and_errors_are_described(name: str) -> None:
    assert "Attributes\n----------\n" in inspect.getdoc(PUBLIC[name])


@pytest.mark.parametrize("name", DESCRIBED)
def test_every_parameter_is_described(name: str) -> None:
    text = inspect.getdoc(PUBLIC[name])
    section = text.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    described = {
        word.strip()
        for line in section.splitlines()
        if line and not line.startswith(" ")
        for word in line.partition(" : ")[0].split(",")
    }
    assert described == set(inspect.signature(PUBLIC[name]).parameters)
