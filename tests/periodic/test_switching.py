"""The pair of orbits without symmetry that leaves a symmetric branch, where runs settle to it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError
from impact_env.periodic.case import Case
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.stability import derivative_of
from impact_env.periodic.switching import asymmetric_branches, whole_period
from impact_env.periodic.tracing import SYMMETRY_BREAKING

MODEL = modal_model(Beam(modes=1))
FIRST = float(MODEL.omega[0])
LIMITS = (0.8 * FIRST, 0.96 * FIRST)


def test_the_high_branch_of_one_dissipative_mode_hands_over_to_a_pair() -> None:
    """N_m = 1, e = 0.75, 1.5 N: at 0.93 runs of the exact method settle to orbits of 0.714381 mm, one the mirror image of the other."""
    case = Case(MODEL, 0.9 * FIRST, 1.5, restitution=0.75)
    (branch,) = orbit_branches(case, *LIMITS)
    breaking = branch.of(SYMMETRY_BREAKING)
    for motion in breaking:
        values = np.linalg.eigvals(derivative_of(motion)[0])
        assert np.min(np.abs(values + 1)) < 1e-7
    left, right = sorted(motion.solution.case.omega_ratio for motion in breaking)
    assert left < 0.91 < 0.93 < right
    (pair,) = asymmetric_branches(branch, LIMITS)
    assert pair.branch.closed
    orbits = list(pair.orbits())
    assert all(isinstance(orbit, Orbit) for orbit in orbits)
    near = [(a, b) for a, b in pairwise(orbits) if (a.case.omega_ratio - 0.93) * (b.case.omega_ratio - 0.93) <= 0]
    assert len(near) == 2  # one of each
    for a, b in near:
        assert a.stability.stable
        share = (0.93 - a.case.omega_ratio) / (b.case.omega_ratio - a.case.omega_ratio)
        assert (1 - share) * a.motion.tip_max + share * b.motion.tip_max == pytest.approx(7.14381e-4, rel=2e-4)
    phases = [np.diff([impact.phase for impact in a.impacts])[0] for a, _ in near]
    assert phases[0] != pytest.approx(np.pi, abs=1e-2)
    with pytest.raises(ParameterError, match="schedule"):
        whole_period(pair.solution(0))
