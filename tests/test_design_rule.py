"""Design rule for any mass and several resonances, and the share of the possible reduction."""

from __future__ import annotations

import numpy as np
import pytest

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError
from optimisation.bounds import NEAR, common_gap, design_force, design_gap, near_range, reduction_share, resonance_limit, share_reached
from optimisation.tuned import peak

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
    ):
        with pytest.raises(ParameterError, match=name):
            call()
