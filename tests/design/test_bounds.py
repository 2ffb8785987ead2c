"""The limit of all devices in a cavity: published numbers and properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impact_env.frequency import receptance, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, ParameterError, StuckAbsorber
from optimisation.bounds import NEAR, design_force, design_gap, resonance_limit, stroke_limit_rms
from optimisation.bounds.lines import lines, places

MODEL = modal_model(Beam())
MASS = 0.02 * MODEL.beam_mass
GAP = 1e-3
OMEGA = np.linspace(0.5, 1.6, 111) * MODEL.omega[0]


def test_reference_limits() -> None:
    np.testing.assert_allclose(resonance_limit(MODEL, MASS, GAP, [5.0, 10.0, 20.0]), [1.21e-3, 5.91e-3, 15.3e-3], rtol=5e-3)


@pytest.mark.parametrize(("resonance", "force"), [(1, 3.49), (2, 37.9)])
def test_reference_design_forces(resonance: int, force: float) -> None:
    assert design_force(MODEL, MASS, GAP, resonance) == pytest.approx(force, abs=0.005 if resonance == 1 else 0.05)
    assert design_gap(MODEL, MASS, force, resonance) == pytest.approx(GAP, rel=2e-3)


def test_the_formula_itself() -> None:
    omega, force = OMEGA[47], 10.0
    by_force = receptance(MODEL, omega, MODEL.tip_shape, MODEL.force_shape)
    kappa = receptance(MODEL, omega, MODEL.tip_shape, MODEL.tip_shape) * MASS * omega**2
    expected = max(0.0, force * abs(by_force) - abs(kappa) * 4 * GAP / np.pi) / abs(1 - kappa) / np.sqrt(2)
    assert expected > 0
    assert stroke_limit_rms(MODEL, MASS, GAP, force, omega) == pytest.approx(expected, rel=1e-12)


def test_no_stroke_is_a_stuck_mass() -> None:
    stuck = np.abs(tip_response(MODEL, StuckAbsorber(0.02), OMEGA)) / np.sqrt(2)
    np.testing.assert_allclose(stroke_limit_rms(MODEL, MASS, 1e-15, 1.0, OMEGA), stuck, rtol=1e-8)


@given(angle=st.floats(0, 2 * np.pi), size=st.floats(0, 1), force=st.floats(0, 50), at=st.floats(0.5, 1.6))
@settings(max_examples=100, deadline=None)
def test_every_admissible_line_obeys_the_limit(angle: float, size: float, force: float, at: float) -> None:
    omega = at * MODEL.omega[0]
    stroke = size * 4 * GAP / np.pi * np.exp(1j * angle)
    kappa = receptance(MODEL, omega, MODEL.tip_shape, MODEL.tip_shape) * MASS * omega**2
    tip = (force * receptance(MODEL, omega, MODEL.tip_shape, MODEL.force_shape) + kappa * stroke) / (1 - kappa)
    assert abs(tip) / np.sqrt(2) >= stroke_limit_rms(MODEL, MASS, GAP, force, omega) * (1 - 1e-12) - 1e-18


def moved(model: ModalModel, masses: list[float], strokes: list[complex], force: float, omega: float, at: np.ndarray) -> complex:
    """Return the line of a place by solving for the places' own lines, with the free beam's receptances."""
    shapes, inertia = places(model), np.array(masses) * omega**2
    between = np.array([[complex(receptance(model, omega, a, b)) for b in shapes] for a in shapes])
    driven = force * np.array([complex(receptance(model, omega, a, model.force_shape)) for a in shapes])
    own = np.linalg.solve(np.eye(len(masses)) - between * inertia, driven + between @ (inertia * strokes))
    to_place = np.array([complex(receptance(model, omega, at, b)) for b in shapes])
    return complex(force * receptance(model, omega, at, model.force_shape)) + complex(to_place @ (inertia * (own + strokes)))


@given(
    st.lists(st.tuples(st.floats(0.2, 1), st.floats(0.001, 0.3), st.floats(0, 1), st.floats(0, 2 * np.pi)), min_size=1, max_size=3),
    st.floats(0.2, 1),
    st.floats(0, 50),
    st.floats(0.3, 8),
)
@pytest.mark.slow
@settings(max_examples=100, deadline=None)
def test_lines_of_several_masses_read_anywhere(devices: list[tuple[float, ...]], place: float, force: float, at: float) -> None:
    """The line of any admissible strokes follows from receptances too, and its RMS is not below the limit."""
    beam = Beam(modes=4)
    model = modal_model(beam, [x for x, *_ in devices])
    end = modal_model(Beam(modes=4, absorber_position=place)).tip_shape
    omega, masses = at * model.omega[0], [ratio * model.beam_mass for _, ratio, *_ in devices]
    strokes = [size * 4 * GAP / np.pi * np.exp(1j * angle) for *_, size, angle in devices]
    found = lines(model, np.array(masses), omega, end)
    line = force * complex(found.force) + complex(found.strokes @ strokes)
    expected = moved(model, masses, strokes, force, omega, end)
    assert abs(line - expected) <= 1e-9 * (abs(expected) + force * abs(complex(found.force)) + 1e-6)
    limit = stroke_limit_rms(model, masses, [GAP] * len(masses), force, omega, end)
    assert abs(line) / np.sqrt(2) >= limit * (1 - 1e-12) - 1e-15


def test_two_halves_at_one_place_are_one_mass() -> None:
    both = modal_model(Beam(), [1.0, 1.0])
    halves = stroke_limit_rms(both, [MASS / 2, MASS / 2], [GAP, GAP], 10.0, OMEGA, MODEL.tip_shape)
    np.testing.assert_allclose(halves, stroke_limit_rms(MODEL, MASS, GAP, 10.0, OMEGA), rtol=1e-9, atol=1e-12)


def test_an_undamped_joined_resonance_is_infinite() -> None:
    """At the resonance with the mass stuck a force is answered without bound, unless the device can cancel it."""
    undamped = ModalModel([100.0], [0.0], [1.0], [2.0], 1.0)
    omega = 100.0 / np.sqrt(1 + 0.25 * 4)
    assert stroke_limit_rms(undamped, 0.25, 1e-3, 1e4, omega) == np.inf
    assert stroke_limit_rms(undamped, 0.25, 1e3, 1.0, omega) == 0


@given(factor=st.floats(1e-3, 1e3), force=st.floats(0, 50))
@settings(max_examples=50, deadline=None)
def test_scaling_law(factor: float, force: float) -> None:
    scaled = stroke_limit_rms(MODEL, MASS, factor * GAP, factor * force, OMEGA)
    np.testing.assert_allclose(scaled, factor * stroke_limit_rms(MODEL, MASS, GAP, force, OMEGA), rtol=1e-9, atol=1e-12 * factor * GAP)


def test_monotone_in_the_force_and_in_the_gap() -> None:
    forces = np.linspace(0, 40, 81)
    limits = resonance_limit(MODEL, MASS, GAP, forces)
    assert limits[0] == 0
    assert np.all(np.diff(limits) >= 0)
    assert limits[-1] > 0
    wider = stroke_limit_rms(MODEL, MASS, 2 * GAP, 10.0, OMEGA)
    assert np.all(wider <= stroke_limit_rms(MODEL, MASS, GAP, 10.0, OMEGA))


@pytest.mark.parametrize("resonance", [1, 2])
def test_zero_up_to_the_design_force(resonance: int) -> None:
    force = design_force(MODEL, MASS, GAP, resonance)
    below, above = resonance_limit(MODEL, MASS, GAP, [force * (1 - 1e-9), force * (1 + 1e-6)], resonance, *NEAR)
    assert below == 0 < above


def test_design_gap_inverts_the_design_force() -> None:
    gap = design_gap(MODEL, MASS, 12.0)
    assert design_force(MODEL, MASS, gap) == pytest.approx(12.0, rel=1e-12)
    assert design_force(MODEL, MASS, 2 * GAP) == pytest.approx(2 * design_force(MODEL, MASS, GAP), rel=1e-12)


def test_design_force_depends_on_where_near_begins() -> None:
    """The minimum sits at the lower end of the range for the paper's beam: a wider range needs less force."""
    assert design_force(MODEL, MASS, GAP, low=0.9) < 0.95 * design_force(MODEL, MASS, GAP)


@pytest.mark.slow
def test_shapes_and_refinement() -> None:
    assert stroke_limit_rms(MODEL, MASS, GAP, np.ones((4, 1)), OMEGA).shape == (4, 111)
    assert resonance_limit(MODEL, MASS, GAP, 5.0).shape == ()
    fine = stroke_limit_rms(MODEL, MASS, GAP, 5.0, np.linspace(0.9, 1.06, 200001) * MODEL.omega[0]).max()
    assert resonance_limit(MODEL, MASS, GAP, 5.0) == pytest.approx(fine, rel=1e-9)


def test_undamped_models_are_finite_off_the_joined_resonance() -> None:
    undamped = modal_model(Beam(damping_ratio=0.0))
    at, beside = stroke_limit_rms(undamped, MASS, GAP, 10.0, undamped.omega[0] * np.array([1.0, 1 + 1e-8]))
    assert at == pytest.approx(beside, rel=1e-5)
    assert resonance_limit(undamped, MASS, GAP, 10.0) > 1e3


def test_bad_input() -> None:
    bare = ModalModel([1.0], [0.01], [0.0], [1.0], 1.0)
    for call, name in (
        (lambda: stroke_limit_rms(MODEL, 0.0, GAP, 1.0, OMEGA), "mass"),
        (lambda: stroke_limit_rms(MODEL, MASS, -GAP, 1.0, OMEGA), "gap"),
        (lambda: stroke_limit_rms(MODEL, MASS, np.inf, 1.0, OMEGA), "gap"),
        (lambda: stroke_limit_rms(MODEL, MASS, GAP, [1.0, -1.0], OMEGA[:2]), "force_amplitude"),
        (lambda: stroke_limit_rms(MODEL, MASS, GAP, 1.0, -1.0), "omega"),
        (lambda: resonance_limit(MODEL, MASS, GAP, np.nan), "force"),
        (lambda: resonance_limit(MODEL, -MASS, GAP, 1.0), "mass"),
        (lambda: resonance_limit(MODEL, MASS, GAP, 1.0, 11), "resonance"),
        (lambda: resonance_limit(MODEL, MASS, GAP, 1.0, low=1.1), "high"),
        (lambda: design_force(MODEL, MASS, GAP, low=0.98), "range"),
        (lambda: design_force(MODEL, 10 * MASS, GAP, low=0.93), "range"),
        (lambda: design_gap(MODEL, MASS, 0.0), "force"),
        (lambda: design_force(bare, 0.01, GAP), "force_shape"),
        (lambda: stroke_limit_rms(MODEL, [MASS, MASS], GAP, 1.0, OMEGA), "mass"),
        (lambda: stroke_limit_rms(modal_model(Beam(), [1.0, 0.5]), [MASS, MASS], GAP, 1.0, OMEGA), "gap"),
        (lambda: stroke_limit_rms(MODEL, MASS, GAP, 1.0, OMEGA, [1.0]), "tip_shape"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()
