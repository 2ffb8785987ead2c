"""The limit of all devices in a cavity: published numbers and properties."""

import numpy as np
import pytest
from core import STEEL
from hypothesis import given, settings
from hypothesis import strategies as st

from impact_env.frequency import receptance, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, StuckAbsorber
from optimisation.absorber_rules import scaled_friction
from optimisation.bounds import (
    NEAR,
    common_gap,
    design_force,
    design_gap,
    expected_factor,
    expected_gap,
    free_amplitude,
    gap_unit,
    lines,
    near_range,
    places,
    reach,
    reduction_share,
    resonance_limit,
    share_reached,
    stroke_limit_rms,
)
from optimisation.tuned import peak

MODEL = modal_model(Beam())
MASS = 0.02 * MODEL.beam_mass
GAP = 1e-3
OMEGA = np.linspace(0.5, 1.6, 111) * MODEL.omega[0]


def test_reference_limits() -> None:
    np.testing.assert_allclose(
        resonance_limit(MODEL, MASS, GAP, [5.0, 10.0, 20.0]), [1.21e-3, 5.91e-3, 15.3e-3], rtol=5e-3
    )
    fine = stroke_limit_rms(
        MODEL, MASS, GAP, 5.0, np.linspace(0.9, 1.06, 20001) * MODEL.omega[0]
    ).max()
    assert resonance_limit(MODEL, MASS, GAP, 5.0) == pytest.approx(fine, rel=1e-7)


@pytest.mark.parametrize(("resonance", "force"), [(1, 3.49), (2, 37.9)])
def test_reference_design_forces(resonance: int, force: float) -> None:
    assert design_force(MODEL, MASS, GAP, resonance) == pytest.approx(
        force, abs=0.005 if resonance == 1 else 0.05
    )
    assert design_gap(MODEL, MASS, force, resonance) == pytest.approx(GAP, rel=2e-3)
    assert design_force(
        MODEL, MASS, design_gap(MODEL, MASS, 12.0, resonance), resonance
    ) == pytest.approx(12.0, rel=1e-12)
    exact = design_force(MODEL, MASS, GAP, resonance)
    below, above = resonance_limit(
        MODEL, MASS, GAP, [exact * (1 - 1e-9), exact * (1 + 1e-6)], resonance, *NEAR
    )
    assert below == 0 < above


def test_no_stroke_is_a_stuck_mass() -> None:
    stuck = np.abs(tip_response(MODEL, StuckAbsorber(0.02), OMEGA)) / np.sqrt(2)
    np.testing.assert_allclose(stroke_limit_rms(MODEL, MASS, 1e-15, 1.0, OMEGA), stuck, rtol=1e-8)


def moved(
    model: ModalModel,
    masses: list[float],
    strokes: list[complex],
    force: float,
    omega: float,
    at: np.ndarray,
) -> complex:
    """Return the line of a place from the free beam's receptances.

    It solves for the lines of the absorbers' places first.
    """
    shapes = places(model)
    inertia = np.array(masses) * omega**2
    between = np.array([[complex(receptance(model, omega, a, b)) for b in shapes] for a in shapes])
    driven = force * np.array(
        [complex(receptance(model, omega, a, model.force_shape)) for a in shapes]
    )
    own = np.linalg.solve(
        np.eye(len(masses)) - between * inertia, driven + between @ (inertia * strokes)
    )
    to_place = np.array([complex(receptance(model, omega, at, b)) for b in shapes])
    return complex(force * receptance(model, omega, at, model.force_shape)) + complex(
        to_place @ (inertia * (own + strokes))
    )


@given(
    st.lists(
        st.tuples(
            st.floats(0.2, 1), st.floats(0.001, 0.3), st.floats(0, 1), st.floats(0, 2 * np.pi)
        ),
        min_size=1,
        max_size=3,
    ),
    st.floats(0.2, 1),
    st.floats(0, 50),
    st.floats(0.3, 8),
)
@pytest.mark.slow
@settings(max_examples=100, deadline=None)
def test_lines_of_several_masses_read_anywhere(
    devices: list[tuple[float, ...]], place: float, force: float, at: float
) -> None:
    """Lines of several masses at any place agree with receptances.

    The line of any admissible strokes follows from receptances too, and its RMS is not below the
    limit.
    """
    beam = Beam(modes=4)
    model = modal_model(beam, [x for x, *_ in devices])
    end = modal_model(Beam(modes=4, absorber_position=place)).tip_shape
    omega = at * model.omega[0]
    masses = [ratio * model.beam_mass for _, ratio, *_ in devices]
    strokes = [size * 4 * GAP / np.pi * np.exp(1j * angle) for *_, size, angle in devices]
    limits = lines(model, np.array(masses), omega, end)
    line = force * complex(limits.force) + complex(limits.strokes @ strokes)
    expected = moved(model, masses, strokes, force, omega, end)
    assert abs(line - expected) <= 1e-9 * (
        abs(expected) + force * abs(complex(limits.force)) + 1e-6
    )
    limit = stroke_limit_rms(model, masses, [GAP] * len(masses), force, omega, end)
    assert abs(line) / np.sqrt(2) >= limit * (1 - 1e-12) - 1e-15


def test_an_undamped_joined_resonance_is_infinite() -> None:
    """The undamped resonance with the mass stuck is unlimited.

    A force at this frequency gives an infinite response, unless the device can cancel it.
    """
    undamped = ModalModel([100.0], [0.0], [1.0], [2.0], 1.0)
    omega = 100.0 / np.sqrt(1 + 0.25 * 4)
    assert stroke_limit_rms(undamped, 0.25, 1e-3, 1e4, omega) == np.inf
    assert stroke_limit_rms(undamped, 0.25, 1e3, 1.0, omega) == 0


# Design rule for any mass and several resonances, and the share of the possible reduction.


def test_range_of_the_rule_follows_a_heavy_mass() -> None:
    for resonance in (1, 2):
        assert near_range(MODEL, MASS, resonance) == pytest.approx(NEAR, rel=1e-12)
    assert near_range(MODEL, MASS / 4)[0] == pytest.approx(1 - 0.07 / 4, abs=2e-3)
    heavy = 0.2 * MODEL.beam_mass
    low, high = near_range(MODEL, heavy)
    assert 0.4 < low < 0.7
    assert high == NEAR[1]
    assert design_force(MODEL, heavy, GAP) == design_force(MODEL, heavy, GAP, low=low, high=high)
    assert (
        resonance_limit(MODEL, heavy, GAP, 0.999 * design_force(MODEL, heavy, GAP), 1, low, high)
        == 0
    )


def test_one_gap_for_two_resonances() -> None:
    gaps = {
        resonance: design_gap(MODEL, MASS, force, resonance)
        for resonance, force in {1: 3.0, 2: 60.0}.items()
    }
    both = common_gap(MODEL, MASS, {1: 3.0, 2: 60.0})
    assert both == gaps[2] > gaps[1]
    for resonance, force in {1: 3.0, 2: 60.0}.items():
        assert resonance_limit(MODEL, MASS, both * (1 + 1e-9), force, resonance, *NEAR) == 0
    assert resonance_limit(MODEL, MASS, 0.99 * both, 60.0, 2, *NEAR) > 0


def test_share_runs_from_no_absorber_to_the_limit() -> None:
    force = 10.0
    without = force * peak(MODEL, None)[0] / np.sqrt(2)
    limit = float(resonance_limit(MODEL, MASS, GAP, force))
    np.testing.assert_allclose(
        share_reached(MODEL, MASS, GAP, force, [without, limit, (without + limit) / 2]),
        [0, 1, 0.5],
        atol=1e-9,
    )
    assert share_reached(MODEL, MASS, GAP, force, 1.1 * without) < 0
    np.testing.assert_allclose(
        reduction_share([[1.0], [2.0]], [4.0, 3.0], 0.0), [[0.75, 2 / 3], [0.5, 1 / 3]]
    )
    # the paper's absorber: levels simulated at 3.5 and 10 N, e = 0.7, muN = 0.1 N
    assert share_reached(MODEL, MASS, GAP, 3.5, 0.64e-3) == pytest.approx(0.80, abs=0.02)
    assert share_reached(MODEL, MASS, GAP, 10.0, 6.9e-3) == pytest.approx(0.68, abs=0.02)


@pytest.mark.parametrize(
    ("beam", "resonance", "mass_ratio", "expected"),
    [
        (Beam(absorber_position=0.9), 2, 0.02, 0.64),
        (Beam(absorber_position=0.8), 2, 0.02, 0.049),
        (Beam(damping_ratio=0.05), 1, 0.02, 0.89),
        (Beam(), 1, 0.002, 0.50),
    ],
)
def test_rule_is_refused_where_the_structure_does_not_fill_the_gap(
    beam: Beam, resonance: int, mass_ratio: float, expected: float
) -> None:
    model = modal_model(beam)
    mass = mass_ratio * model.beam_mass
    assert reach(model, mass, resonance) == pytest.approx(expected, rel=0.02)
    assert (
        gap_unit(model, mass, 7.0, resonance)
        == free_amplitude(model, mass, 7.0, resonance)
        < design_gap(model, mass, 7.0, resonance)
    )


def test_free_amplitude_is_the_receptances_peak() -> None:
    """On a steel beam, with the modal sum written out: a grid finds the peak from below."""
    model = modal_model(STEEL)
    mass = 0.01 * model.beam_mass
    omega = model.omega[0] * np.linspace(*near_range(model, mass), 200_001)
    terms = (
        model.force_shape
        * model.tip_shape
        / (
            model.omega**2
            - omega[:, None] ** 2
            + 2j * model.damping_ratio * model.omega * omega[:, None]
        )
    )
    peak = 2.5 * np.abs(terms.sum(axis=1)).max()
    assert free_amplitude(model, mass, 2.5) == pytest.approx(peak, rel=1e-8)
    assert reach(model, mass) == pytest.approx(peak / design_gap(model, mass, 2.5), rel=1e-8)
    assert gap_unit(model, mass, 2.5) == design_gap(model, mass, 2.5)


def test_the_expected_gap_is_the_rules_where_that_is_good_and_wider_with_light_damping() -> None:
    assert [expected_factor(x, 0.01) for x in (0.01, 3.0, 5.9, 6.1, 30.0)] == [
        0.25,
        1.0,
        1.0,
        1.2,
        1.2,
    ]
    assert expected_factor(0.9, 0.002) == pytest.approx((0.9 / 2.5) ** 0.6)
    assert (expected_factor(5.0, 0.001), expected_factor(7.0, 0.005)) == (1.0, 1.2)
    assert expected_factor(20.0, 0.002) == pytest.approx(1.2 * 2.5**0.2)
    assert (
        expected_factor(40.0, 0.0)
        == expected_factor(40.0, 0.0015)
        == pytest.approx(1.2 * (10 / 3) ** 0.2)
    )
    model = modal_model(STEEL)
    mass = 0.02 * model.beam_mass
    assert expected_gap(model, mass, 3.0, 2) == pytest.approx(
        expected_factor(reach(model, mass, 2), 0.01) * design_gap(model, mass, 3.0, 2)
    )


def test_friction_follows_the_scaling_law() -> None:
    """Friction follows the scaling law.

    With other units of length, mass and time, the paper's absorber has the paper's friction in
    those units.
    """
    assert scaled_friction(MODEL, MASS, GAP) == pytest.approx(0.1, rel=1e-12)
    length = 2.0
    stiffness = 3.0
    density = 0.7
    beam = Beam(
        length=0.5 * length, bending_stiffness=362.88 * stiffness, mass_per_length=1.1275 * density
    )
    other = modal_model(beam)
    force_unit = (
        stiffness / length**2 * 0.5
    )  # of a gap half the paper's share of the length: EI w/l^3
    assert scaled_friction(other, 0.02 * other.beam_mass, GAP * length * 0.5) == pytest.approx(
        0.1 * force_unit, rel=1e-9
    )
