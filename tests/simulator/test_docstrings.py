"""Examples in docstrings of the public interface run and print what they say; public callables describe their parameters."""

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
DESCRIBED = (
    "simulate performance_curve evaluate linear_sweep constant_frequency FrequencySchedule Drive impact_absorber friction_damper Beam "
    "Section RigidWalls ElasticCoulombFriction InitialState beam_scene Record RungeKutta Moreau CurveCase Pass Window Scene ModalModel "
    "SlidingAbsorber SeveralAbsorbers Lane Members run_lanes curve_passes prepare "
    "simulate_sectors diameter_energies"
)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_prints_what_it_says(name: str) -> None:
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(EXAMPLES[name], out=sys.stderr.write)
    assert runner.failures == 0


@pytest.mark.parametrize("name", DESCRIBED.split())
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
