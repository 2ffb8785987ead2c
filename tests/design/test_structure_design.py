"""Design on structures that are not the paper's beam: against closed forms and dense solutions that share no code with the package."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from places import EXAMPLES

from impact_env import Beam, ModalModel, ParameterError, load_structure, modal_model
from impact_env.beam import deflection_row, matrices
from optimisation.bounds import design_force, near_range, resonance_limit
from optimisation.comparison import IMPACT, NONE, compare
from optimisation.designs import design_space
from optimisation.evaluation import Threads, evaluate
from optimisation.friction_rule import best_friction
from optimisation.mounting import detuned, mounted, scene_on
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem
from optimisation.tuned import den_hartog, highest_amplitude, minimax, peak

LENGTH, BENDING, LINE, DAMPING = 1.2, 210e9 * 0.04 * 0.008**3 / 12, 7850 * 0.04 * 0.008, 0.005
MASS = LENGTH * LINE
ADDED = 0.01 * MASS
MODES = 10


def steel() -> Beam:
    beam = load_structure(EXAMPLES / "steel_beam.toml")
    assert isinstance(beam, Beam)
    return beam


def roots() -> np.ndarray:
    """Solutions of cos x = -1/cosh x."""
    middle = (np.arange(MODES) + 0.5) * np.pi
    return np.array([scipy.optimize.brentq(lambda x: np.cos(x) + 1 / np.cosh(x), m - 1.0, m + 1.0) for m in middle])


def deflection(at: float) -> np.ndarray:
    """Mass-normalised deflection of a cantilever's modes, without the cancellation of hyperbolic functions."""
    x = roots()
    denominator = np.sinh(x) + np.sin(x)
    sigma, rest = (np.cosh(x) + np.cos(x)) / denominator, (np.sin(x) - np.cos(x) - np.exp(-x)) / denominator
    shape = rest * np.exp(x * at) / 2 + (1 + sigma) * np.exp(-x * at) / 2 - np.cos(x * at) + sigma * np.sin(x * at)
    return np.asarray(shape / np.sqrt(MASS))


OMEGA = roots() ** 2 * np.sqrt(BENDING / LINE) / LENGTH**2


def receptances(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the absorber's place per force at the force's place, and per force at its own."""
    den = OMEGA**2 - w[:, None] ** 2 + 2j * DAMPING * OMEGA * w[:, None]
    return (deflection(0.9) * deflection(0.25) / den).sum(axis=1), (deflection(0.9) ** 2 / den).sum(axis=1)


def test_the_steel_beam_has_the_modes_of_the_closed_form() -> None:
    model = modal_model(steel())
    np.testing.assert_allclose(model.omega, OMEGA, rtol=1e-3)  # thirty elements; the mesh stiffens the highest modes
    np.testing.assert_allclose(model.omega[:3], OMEGA[:3], rtol=5e-6)
    np.testing.assert_allclose(model.tip_shape[:4] * model.force_shape[:4], (deflection(0.9) * deflection(0.25))[:4], atol=2e-5)


@pytest.mark.parametrize("resonance", [1, 2])
def test_limit_and_rule_of_the_steel_beam_are_those_of_the_closed_form(resonance: int) -> None:
    model, gap = modal_model(steel()), 1e-3
    w = OMEGA[resonance - 1] * np.linspace(0.9, 1.06, 40001)
    g_f, g_t = receptances(w)
    kappa = g_t * ADDED * w**2
    reach = np.abs(kappa / (1 - kappa)) * 4 * gap / np.pi
    for force in (0.3, 1.0, 10.0):
        wanted = np.max(np.maximum(0, force * np.abs(g_f / (1 - kappa)) - reach)) / np.sqrt(2)
        assert float(resonance_limit(model, ADDED, gap, force, resonance)) == pytest.approx(wanted, rel=2e-3, abs=1e-9)
    low, high = near_range(model, ADDED, resonance)
    w = OMEGA[resonance - 1] * np.linspace(low, high, 40001)
    g_f, g_t = receptances(w)
    assert design_force(model, ADDED, gap, resonance) == pytest.approx(np.min(np.abs(g_t) * ADDED * w**2 / np.abs(g_f)) * 4 * gap / np.pi, rel=2e-3)


def test_the_tuned_absorber_of_the_steel_beam_is_the_best_by_dense_solution() -> None:
    beam = steel()
    model = modal_model(beam)
    mu = ADDED * deflection(0.9)[0] ** 2
    rule = den_hartog(model, 0.01)
    assert np.sqrt(rule.stiffness / ADDED) == pytest.approx(OMEGA[0] / (1 + mu), rel=1e-5)
    mass, stiffness = matrices(beam)
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    damping = mass @ vectors @ np.diag(2 * DAMPING * np.sqrt(values)) @ vectors.T @ mass
    load, place = deflection_row(beam, 0.25), deflection_row(beam, 0.9)
    link = np.append(-place, 1.0)
    whole = [np.pad(m, (0, 1)) for m in (mass, damping, stiffness)]
    whole[0][-1, -1] = ADDED
    ratios = np.linspace(0.8, 1.25, 901)

    def largest(k: float, c: float) -> float:
        answers = []
        for w in ratios * OMEGA[0]:
            dynamic = whole[2] + 1j * w * whole[1] - w**2 * whole[0] + (k + 1j * w * c) * np.outer(link, link)
            answers.append(abs(np.append(place, 0.0) @ np.linalg.solve(dynamic, np.append(load, 0.0))))
        return max(answers)

    best = minimax(model, 0.01)
    own = largest(best.stiffness, best.damping)
    assert own == pytest.approx(peak(model, best)[0], rel=1e-3)
    for k, c in ((1.03, 1.0), (0.97, 1.0), (1.0, 1.15), (1.0, 0.85)):
        assert largest(best.stiffness * k, best.damping * c) > 1.005 * own


def small(beam: Beam | ModalModel, **changes: object) -> Problem:
    given = {"space": design_space("impact"), "conditions": (Condition(1, 3.5), Condition(2, 35.0, detuning=0.02)), "members": 2, "rate": 40.0}
    return Problem(beam=beam, **(given | changes))  # type: ignore[arg-type]


def measured(problem: Problem) -> np.ndarray:
    ((_, found),) = evaluate(problem, [problem.space.default], problem.ensemble, problem.rate, Threads(1))
    return found


def test_a_problem_takes_a_modal_model_as_it_takes_its_beam() -> None:
    beam, own = small(Beam(modes=2)), small(modal_model(Beam(modes=2)))
    np.testing.assert_allclose(measured(own)[:, 0], measured(beam)[:, 0], rtol=1e-12)
    assert own.describe() != beam.describe()
    assert mounted(detuned(own.beam, 0.1)).omega[1] == pytest.approx(1.1 * beam.model.omega[1])
    tuned = small(modal_model(Beam(modes=2)), space=design_space("tuned"), conditions=(Condition(1, 1.0, (0.5, 1.6)),))
    np.testing.assert_allclose(measured(tuned), measured(small(Beam(modes=2), space=tuned.space, conditions=tuned.conditions)), rtol=1e-9)


@pytest.mark.same_bits
def test_a_problem_puts_the_absorber_where_the_beam_says() -> None:
    problem = small(Beam(modes=3, absorber_position=0.8))
    assert problem.space.default.values["position"] == 0.8
    scene = problem.chunks(problem.space.default, problem.ensemble, problem.rate)[0].lanes[0].scene
    np.testing.assert_array_equal(scene.model.tip_shape, modal_model(Beam(modes=3, absorber_position=0.8)).tip_shape)
    np.testing.assert_array_equal(scene.model.level_shape, modal_model(Beam(modes=3)).tip_shape)  # the free end is to be quiet
    held = small(Beam(modes=3, ends="clamped-clamped", absorber_position=0.4))
    np.testing.assert_array_equal(held.model.level_shape, held.model.tip_shape)


def test_what_a_structure_cannot_do_is_refused() -> None:
    model = modal_model(Beam(modes=2))
    with pytest.raises(ParameterError, match=r"position = .*left out on a modal model with one place"):
        small(model, space=design_space("impact", ["gap", "position"]))
    with pytest.raises(
        ParameterError, match="objective or constraint = 'damage' is not allowed: for a beam that is clamped at its left end, or a modal model"
    ):
        small(model, objectives=(Objective("damage"),))
    with pytest.raises(ParameterError, match=r"bounds of position = 1\.0 is not allowed"):
        small(Beam(modes=2, ends="clamped-clamped", absorber_position=0.5), space=design_space("impact", ["gap", "position"]))
    with pytest.raises(ParameterError, match="position_2 = 'free' is not allowed: left out on a modal model with one place"):
        small(model, space=design_space("several"))
    with pytest.raises(ParameterError, match="absorber_shapes of the modal model = 0 is not allowed"):
        scene_on(model, design_space("several").default.absorber())


@pytest.mark.slow
def test_a_comparison_scales_with_the_structure() -> None:
    """By the scaling law levels over the gap are the same for a force that is as many times larger as the gap."""
    beam = replace(steel(), modes=2)
    options = {"resonances": (1,), "mass_ratio": 0.01, "forces": 3, "members": 1, "percent_per_100_periods": 20.0, "threads": 1}
    one, four = (compare(beam, gap=gap, **options) for gap in (1e-3, 4 * 1e-3))  # type: ignore[arg-type]
    np.testing.assert_allclose(four.resonances[0].forces, 4 * one.resonances[0].forces, rtol=1e-12)
    for key in (NONE, IMPACT):  # powers of two round as the numbers themselves do, so that no impact amplifies a difference
        np.testing.assert_allclose(four.resonances[0].curves[key].median, 4 * one.resonances[0].curves[key].median, rtol=1e-9)
    by_force = compare(beam, force=one.resonances[0].design_force, **options)  # type: ignore[arg-type]
    assert by_force.gap == pytest.approx(1e-3)
    assert [c.key for c in one.concepts] == ["none", "impact", "friction", "ltva_tuned", "ltva_tuned_wide"]


def test_examples_load_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("steel_beam", "frame"):
            load_structure(EXAMPLES / f"{name}.toml")


def test_the_estimate_of_a_friction_damper_is_read_where_the_level_is() -> None:
    """At its limit a damper on one mode leaves less than no absorber does, in proportion to the shape where the level is read."""
    model = replace(modal_model(Beam(modes=1)), response_shape=0.3 * modal_model(Beam(modes=1)).tip_shape)
    limit, level = best_friction(model, 0.05 * model.beam_mass, 2.0)
    at_tip = best_friction(modal_model(Beam(modes=1)), 0.05 * model.beam_mass, 2.0)
    assert (limit, level) == pytest.approx((at_tip[0], 0.3 * at_tip[1]))
    assert level < 2.0 * highest_amplitude(model, None)[0] / np.sqrt(2)
