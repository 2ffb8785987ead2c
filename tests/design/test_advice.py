"""What is said of noisy values: ratios with intervals, two branches, a design in service."""

from dataclasses import replace

import numpy as np
import pytest
from core import STEEL

from impact_env import Drive, Scene
from impact_env.drive import constant_frequency
from impact_env.ensemble import Lane, Threads
from optimisation.insight import REPORT_SEEDS
from optimisation.measures import (
    RMS,
    Chunk,
    branches,
    ratio_of_quantiles,
    standard_error,
    stress_shape,
)
from optimisation.objectives import Condition
from optimisation.problem import Problem, measured_chunks
from optimisation.report.design_report import service_lines, service_summary
from optimisation.service import FORCES, FREQUENCIES, lasting_levels, service
from optimisation.space import design_space
from reference import dense

STRIP = replace(STEEL, modes=2)


def steel(concept: str = "impact", **changes: object) -> Problem:
    options = {
        "space": design_space(concept),
        "conditions": (Condition(1, 0.5),),
        "beam": STRIP,
        "members": 3,
        "rate": 40.0,
    }
    return Problem(**(options | changes))


def test_interval_covers_the_ratio_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    covered = 0
    for _ in range(200):
        first = np.exp(generator.normal(np.log(0.8), 0.1, 16))
        second = np.exp(generator.normal(0.0, 0.1, 16))
        gain = ratio_of_quantiles(first, second)
        covered += gain.low <= 0.8 <= gain.high
    assert 0.90 * 200 <= covered <= 200


def test_ratio_of_medians_pairs_nothing() -> None:
    """The interval of a ratio of medians does not depend on pairs of members.

    Members in another order are the same members. Here each pair would have the ratio 2, which must
    not narrow the interval.
    """
    second = np.arange(1.0, 17.0)
    gain = ratio_of_quantiles(2 * second, second)
    shuffled = ratio_of_quantiles(2 * second, second[::-1])
    assert gain.ratio == shuffled.ratio == 2
    assert gain.low < 1.5 < 2.5 < gain.high
    assert ratio_of_quantiles([1.0], [2.0]).low == 0.5
    assert np.isnan(ratio_of_quantiles([1.0, np.nan], [2.0, 1.0]).ratio)
    assert np.isnan(ratio_of_quantiles([1.0, 1.0], [0.0, 0.0]).ratio)


def test_standard_error_of_a_median() -> None:
    sample = np.random.default_rng(0).normal(size=400)
    assert standard_error(sample) == pytest.approx(np.sqrt(np.pi / 2 / 400), rel=0.25)
    assert np.isnan(standard_error([1.0]))


def test_two_branches_are_reported_and_one_is_not() -> None:
    generator = np.random.default_rng(0)
    reported = 0
    for _ in range(40):
        upper = generator.random(16) < 0.4
        members = np.where(upper, 0.19, 0.14) * np.exp(generator.normal(0, 0.03, 16))
        split = branches(members)
        if split is not None:
            reported += 1
            assert split.levels[0] == pytest.approx(0.14, rel=0.05)
            assert split.levels[1] == pytest.approx(0.19, rel=0.05)
            assert split.shares[1] == pytest.approx(upper.mean(), abs=0.07)
            assert sum(split.shares) == pytest.approx(1)
    assert reported >= 36
    single = sum(branches(np.exp(generator.normal(0, 0.05, 16))) is not None for _ in range(100))
    assert single <= 3
    assert branches([0.1, 0.105] * 8) is None  # two levels that no one can tell apart in use
    assert branches([0.1, 0.2] * 3) is None  # too few members
    assert branches([0.1, np.nan] * 8) is None
    assert "14 % (50 % of the members)" in branches([0.14, 0.19] * 8).text(100, " %")


def test_lasting_vibration_of_a_linear_absorber_is_its_receptance() -> None:
    """The stationary level of a tuned absorber agrees with its receptance.

    It is the largest level over the tested frequencies, from the modal sum with the force of the
    absorber.
    """
    problem = steel("tuned", conditions=(Condition(1, 0.5, (0.5, 1.6)),))
    design = problem.space.default
    (level,) = lasting_levels(problem, design, Threads(1))
    scene = design.scene(STRIP)
    model = scene.model
    absorber = scene.absorber
    best = 0.0
    for omega in model.omega[0] * np.linspace(0.5, 1.6, FREQUENCIES):
        terms = model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega
        spring = absorber.stiffness + 1j * omega * absorber.damping
        inertia = scene.absorber_masses[0] * omega**2
        force = spring * inertia / (spring - inertia)
        matrix = np.diag(terms) - force * np.outer(model.tip_shape, model.tip_shape)
        best = max(
            best,
            abs(model.tip_shape @ np.linalg.solve(matrix, 0.5 * model.force_shape)) / np.sqrt(2),
        )
    assert level == pytest.approx(best, rel=2e-3)


def test_service_of_an_impact_absorber_on_another_beam() -> None:
    problem = steel(rate=2.5)  # slow enough that the level is halved with something to spare
    design = problem.space.default
    loads = service(problem, design, Threads(), members=2, draws=6)
    without = np.median(
        problem.reference(problem.fresh_ensemble(3, REPORT_SEEDS), problem.rate)[..., 0].max(axis=2)
    )
    assert 0.05 * without < loads.level[0] < 0.7 * without
    assert set(loads.single) == {
        "gap",
        "restitution",
        "friction_limit",
        "damping ratio",
        "frequency",
    }
    assert np.all(np.diff(loads.joint[:, 0]) >= 0)
    low, high = loads.forces[:, 0]
    assert 0.5 * FORCES[0] <= low < 0.5 <= high <= 0.5 * FORCES[-1]
    half = {name: values[1, 0] for name, values in loads.measures.items()}
    assert half["stroke"] == pytest.approx(design.values["gap"], rel=1e-3)
    # an impact loses at most half the reduced mass times (1 - e^2) times the fastest speed squared
    mass = 0.02 * problem.model.beam_mass
    assert 0 < half["impact_rms_speed"] < half["impact_speed"]
    assert (
        half["acceleration"] > 0.8 * np.sqrt(2) * loads.level[0] * problem.model.omega[0] ** 2
    )  # the harmonic part, at 0.9 of omega or above
    assert (
        half["impact_power"]
        < half["impact_rate"] * 0.5 * mass * (1 - 0.7**2) * half["impact_speed"] ** 2
    )
    assert 0.3 * without < loads.lasting[0] / loads.level[0] * without < 3 * without
    lines = "\n".join(service_lines(loads))
    assert "gap off by -+10 %" in lines
    assert "all of them off at once, quantiles of 6 draws" in lines
    assert set(service_summary(loads)["tolerances"]) == set(loads.single)


def test_uncertain_numbers_are_drawn_within_their_tolerances() -> None:
    """Uncertain parameters are drawn within their tolerances.

    The draws differ in frequency by twice the tolerance's factor. The sweep follows the beam's
    frequency, and displacements are proportional to the inverse square of the factor.
    """
    problem = steel("friction", conditions=(Condition(1, 0.5),), members=2, rate=20.0)
    loads = service(problem, problem.space.default, Threads(), members=1, draws=2)
    low, high = loads.single["frequency"][:, 0]
    # a friction damper under the same force: frequencies times s mean displacements over s^2,
    # exactly
    assert low * 0.95**2 == pytest.approx(high * 1.05**2, rel=1e-4)
    assert "gap" not in loads.single
    assert set(loads.measures) == {"friction_heat", "stroke", "acceleration"}


def test_constant_force_settles_before_it_is_measured() -> None:
    """Under a constant force the start-up is not part of the level.

    The root mean square of the second half of a linear run agrees with Duhamel's integral.
    """
    problem = steel("tuned", conditions=(Condition(1, 0.5, (0.5, 1.6)),))
    scene = Scene(problem.model)
    drive = Drive(0.5, constant_frequency(float(scene.model.omega[0]), 0.97, 60.0))
    times = np.linspace(0, 60 * 2 * np.pi / scene.model.omega[0], 60 * 32 + 1)
    motion = dense.follow(scene, drive, None, times, long_steps=True).tip
    chunk = Chunk((Lane(scene, drive),), (RMS,), stress_shape(STRIP), 5.0)
    (measured,) = measured_chunks([chunk], Threads(1))
    assert measured[0, 0] == pytest.approx(
        np.sqrt(np.mean(motion[len(motion) // 2 :] ** 2)), rel=1e-3
    )
