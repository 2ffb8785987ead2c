"""Design rule for any mass and several resonances, and the share of the possible reduction."""

from __future__ import annotations

import numpy as np
import pytest

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError
from optimisation.bounds import (
    NEAR,
    common_gap,
    design_force,
    design_gap,
    free_amplitude,
    gap_unit,
    near_range,
    reach,
    reduction_share,
    require_reach,
    resonance_limit,
    share_reached,
)
from optimisation.friction_rule import scaled_friction
from optimisation.tuned import peak
from studies.rule import STRUCTURES

MODEL = modal_model(Beam())
MASS, GAP = 0.02 * MODEL.beam_mass, 1e-3


def test_range_of_the_rule_follows_a_heavy_mass() -> None:
    for resonance in (1, 2):
        assert near_range(MODEL, MASS, resonance) == pytest.approx(NEAR, rel=1e-12)
    assert near_range(MODEL, MASS / 4)[0] == pytest.approx(1 - 0.07 / 4, abs=2e-3)
    heavy = 0.2 * MODEL.beam_mass
    low, high = near_range(MODEL, heavy)
    assert 0.4 < low < 0.7
    assert high == NEAR[1]
    assert design_force(MODEL, heavy, GAP) == design_force(MODEL, heavy, GAP, low=low, high=high)
    assert resonance_limit(MODEL, heavy, GAP, 0.999 * design_force(MODEL, heavy, GAP), 1, low, high) == 0


def test_one_gap_for_two_resonances() -> None:
    gaps = {resonance: design_gap(MODEL, MASS, force, resonance) for resonance, force in {1: 3.0, 2: 60.0}.items()}
    both = common_gap(MODEL, MASS, {1: 3.0, 2: 60.0})
    assert both == gaps[2] > gaps[1]
    for resonance, force in {1: 3.0, 2: 60.0}.items():
        assert resonance_limit(MODEL, MASS, both * (1 + 1e-9), force, resonance, *NEAR) == 0
    assert resonance_limit(MODEL, MASS, 0.99 * both, 60.0, 2, *NEAR) > 0
    with pytest.raises(ParameterError, match="forces"):
        common_gap(MODEL, MASS, {})


def test_share_runs_from_no_absorber_to_the_limit() -> None:
    force = 10.0
    without = force * peak(MODEL, None)[0] / np.sqrt(2)
    limit = float(resonance_limit(MODEL, MASS, GAP, force))
    np.testing.assert_allclose(share_reached(MODEL, MASS, GAP, force, [without, limit, (without + limit) / 2]), [0, 1, 0.5], atol=1e-9)
    assert share_reached(MODEL, MASS, GAP, force, 1.1 * without) < 0
    np.testing.assert_allclose(reduction_share([[1.0], [2.0]], [4.0, 3.0], 0.0), [[0.75, 2 / 3], [0.5, 1 / 3]])


def test_share_of_the_papers_absorber() -> None:
    """The levels simulated at 3.5 and 10 N, e = 0.7, muN = 0.1 N, reach four fifths and two thirds of what is possible."""
    assert share_reached(MODEL, MASS, GAP, 3.5, 0.64e-3) == pytest.approx(0.80, abs=0.02)
    assert share_reached(MODEL, MASS, GAP, 10.0, 6.9e-3) == pytest.approx(0.68, abs=0.02)


@pytest.mark.parametrize(
    ("beam", "resonance", "mass_ratio", "expected"),
    [
        (Beam(absorber_position=0.9), 2, 0.02, 0.64),
        (Beam(absorber_position=0.85), 2, 0.02, 0.055),
        (Beam(absorber_position=0.8), 2, 0.02, 0.049),
        (Beam(damping_ratio=0.05), 1, 0.02, 0.89),
        (Beam(), 1, 0.002, 0.50),
    ],
)
def test_rule_is_refused_where_the_structure_does_not_fill_the_gap(beam: Beam, resonance: int, mass_ratio: float, expected: float) -> None:
    model = modal_model(beam)
    mass = mass_ratio * model.beam_mass
    assert reach(model, mass, resonance) == pytest.approx(expected, rel=0.02)
    assert gap_unit(model, mass, 7.0, resonance) == free_amplitude(model, mass, 7.0, resonance) < design_gap(model, mass, 7.0, resonance)
    with pytest.raises(ParameterError, match="no wall would be touched"):
        require_reach(model, mass, 7.0, resonance)


def test_free_amplitude_is_the_receptances_peak() -> None:
    """On a steel beam, with the modal sum written out: a grid finds the peak from below."""
    model = modal_model(STRUCTURES["steel"])
    mass = 0.01 * model.beam_mass
    omega = model.omega[0] * np.linspace(*near_range(model, mass), 200_001)
    terms = model.force_shape * model.tip_shape / (model.omega**2 - omega[:, None] ** 2 + 2j * model.damping_ratio * model.omega * omega[:, None])
    peak_found = 2.5 * np.abs(terms.sum(axis=1)).max()
    assert free_amplitude(model, mass, 2.5) == pytest.approx(peak_found, rel=1e-8)
    assert require_reach(model, mass, 2.5) == pytest.approx(peak_found / design_gap(model, mass, 2.5), rel=1e-8)
    assert gap_unit(model, mass, 2.5) == design_gap(model, mass, 2.5)


def test_friction_follows_the_scaling_law() -> None:
    """Another length, mass and time: the paper's absorber has the paper's friction in those units."""
    assert scaled_friction(MODEL, MASS, GAP) == pytest.approx(0.1, rel=1e-12)
    length, stiffness, density = 2.0, 3.0, 0.7
    beam = Beam(length=0.5 * length, bending_stiffness=362.88 * stiffness, mass_per_length=1.1275 * density)
    other = modal_model(beam)
    force_unit = stiffness / length**2 * 0.5  # of a gap half the paper's share of the length: EI w/l^3
    assert scaled_friction(other, 0.02 * other.beam_mass, GAP * length * 0.5) == pytest.approx(0.1 * force_unit, rel=1e-9)


def test_bad_input() -> None:
    undamped = modal_model(Beam(damping_ratio=0.0))
    for call, name in (
        (lambda: share_reached(MODEL, MASS, GAP, 0.0, 1e-3), "force"),
        (lambda: share_reached(MODEL, MASS, GAP, 3.5, -1e-3), "level"),
        (lambda: share_reached(MODEL, MASS, GAP, 3.5, np.nan), "level"),
        (lambda: share_reached(MODEL, MASS, GAP, 3.5, 1e-3, 11), "resonance"),
        (lambda: share_reached(MODEL, MASS, GAP, 3.5, 1e-3, low=1.1), "high"),
        (lambda: share_reached(undamped, MASS, GAP, 3.5, 1e-3), "damping_ratio"),
        (lambda: reduction_share(1.0, 1.0, 1.0), "limit"),
        (lambda: near_range(MODEL, -1.0), "mass"),
        (lambda: reach(MODEL, -1.0), "mass"),
        (lambda: free_amplitude(MODEL, MASS, 0.0), "force"),
        (lambda: require_reach(MODEL, MASS, 3.5, 11), "resonance"),
        (lambda: scaled_friction(MODEL, MASS, -1.0), "gap"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()
