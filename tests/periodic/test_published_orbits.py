"""Orbits, folds, births and mergers with friction's reversals: the published cases, and what surveys and maps find of them."""

import numpy as np
import pytest
from orbit_cases import Array, high_orbit, isola, many_reversals, one_sided, paper_case

from impact_env.periodic.folds import beside
from impact_env.periodic.green import NoOrbit, unknowns_of
from impact_env.periodic.isolas import Threshold, folds, lowest_fold, thresholds
from impact_env.periodic.orbit import Orbit, orbit_at
from impact_env.periodic.orbit_branches import PULLING, orbit_branch
from impact_env.periodic.survey import closed_form_orbits, crossings, orbits_over, same
from impact_env.periodic.symmetric import BIRTH, MERGER
from impact_env.periodic.validation import BAR


def test_the_isola_of_three_modes() -> None:
    """Closed, with folds at 0.9336128203 and 0.9552754578 and a peak of 1.4743 mm at 0.9523."""
    branch = isola()
    assert branch.branch.closed
    ratios = [fold.case.omega_ratio for fold in branch.folds() if not isinstance(fold, NoOrbit)]
    assert min(abs(ratio - 0.9552754578) for ratio in ratios) < 1e-9
    assert min(abs(ratio - 0.9336128203) for ratio in ratios) < 1e-9
    orbits = [orbit for orbit in branch.orbits() if isinstance(orbit, Orbit)]
    assert len(orbits) > 0.9 * len(branch.schedules)
    assert max(orbit.residual for orbit in orbits) < BAR
    assert {orbit.schedule.reversals for orbit in orbits} == {0, 2}
    assert max(orbit.motion.tip_max for orbit in orbits) == pytest.approx(1.4743e-3, rel=2e-4)
    assert high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)).motion.tip_max == pytest.approx(1.4743e-3, abs=5e-8)


def test_the_folds_of_three_modes_with_and_without_reversals() -> None:
    located = [fold for fold in folds(paper_case(3, 1.0, 1.5, friction=0.01), 0.9, 1.06) if isinstance(fold.orbit, Orbit)]
    assert [fold.omega_ratio for fold in located] == pytest.approx([0.9336128203, 0.9336233427, 0.9552754578], abs=1e-9)
    for fold in located:
        assert isinstance(fold.orbit, Orbit)
        multipliers = fold.orbit.stability.multipliers
        assert np.min(np.abs(multipliers - 1)) < 1e-7
        assert fold.orbit.residual < BAR


def test_the_merged_branch_of_three_modes() -> None:
    """From an impulse of zero at 0.9625 round the fold at 0.9032184 to the peak of 3.4081 mm at 0.9619, and back at 1.16873."""
    case = paper_case(3, 0.9523, 3.0, friction=0.01)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.2 * first))
    ratios = [fold.case.omega_ratio for fold in branch.folds() if not isinstance(fold, NoOrbit)]
    for wanted, close in ((0.9032184, 1e-7), (1.16873, 5e-6)):
        assert min(abs(ratio - wanted) for ratio in ratios) < close
    assert branch.of(PULLING)[0].solution.case.omega_ratio == pytest.approx(0.9625, abs=5e-5)
    assert high_orbit(paper_case(3, 0.9619, 3.0, friction=0.01)).motion.tip_max == pytest.approx(3.4081e-3, abs=1e-7)


def named(found: tuple[Threshold, ...], kind: str) -> Array:
    return np.array(
        [[threshold.force, threshold.omega_ratio] for threshold in found if threshold.kind == kind and isinstance(threshold.orbit, Orbit)]
    )


def test_birth_and_merger_of_three_modes_with_reversals() -> None:
    found = thresholds(paper_case(3, 1.0, 1.5, friction=0.01), 0.93, 1.0)
    assert named(found, BIRTH)[:, 0] == pytest.approx([1.221955], abs=5e-7)
    assert named(found, MERGER)[:, 0] == pytest.approx([2.370284], abs=5e-7)


def test_birth_and_merger_of_one_mode_with_losses() -> None:
    found = thresholds(paper_case(1, 1.0, 1.5, 0.75), 0.88, 1.0)
    assert named(found, BIRTH) == pytest.approx(np.array([[1.22957, 0.90594]]), abs=5e-6)
    assert named(found, MERGER) == pytest.approx(np.array([[2.41657, 0.96768]]), abs=6e-6)


def test_the_fold_of_ten_modes_with_friction() -> None:
    """Published as 0.951825, where four reversals a half period become six; the folds on both sides of that are 1.3e-6 and 5.4e-5 below it."""
    found = [fold for fold in folds(paper_case(10, 1.0, 3.5, 0.7, 0.1), 0.94, 0.965) if isinstance(fold.orbit, Orbit)]
    assert [fold.omega_ratio for fold in found] == pytest.approx([0.9517714335, 0.9518237122], abs=1e-9)
    assert [fold.orbit.schedule.reversals for fold in found] == [4, 6]
    assert found[1].omega_ratio == pytest.approx(0.951825, abs=2e-6)


def test_one_mode_with_losses_is_stable_on_the_high_branch_without_symmetry() -> None:
    high = high_orbit(paper_case(1, 0.93, 1.5, 0.75))
    assert not high.stability.stable
    assert high.stability.multipliers[0].real < -1  # of half a period: the symmetry is broken, which the period's own multiplier hides
    assert high.stability.full[0].real > 1
    assert one_sided().stability.stable
    assert not one_sided().schedule.symmetric
    first = high_orbit(paper_case(1, 0.9059, 1.5, 0.75))
    assert abs(first.stability.multipliers[0]) == pytest.approx(1, abs=0.1)


def test_the_slow_pair_lives_while_the_fast_pair_does_not() -> None:
    """Unstable by a fast pair of up to about 3, while the beam's own vibration decays by exp(-D omega_1 T/2) = 0.967 in half a period."""
    stability = high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)).stability
    assert not stability.stable
    assert stability.slowly_stable
    assert np.max(np.abs(stability.fast_multipliers)) > 3
    assert np.abs(stability.slow_multipliers) == pytest.approx([0.967, 0.967], abs=0.01)


def test_ten_modes_have_an_orbit_with_dozens_of_reversals_that_attracts() -> None:
    orbit = many_reversals()
    assert orbit.schedule.symmetric
    assert orbit.schedule.reversals == 24
    assert orbit.stability.stable
    assert orbit.residual < BAR


# --- surveys and maps ---------------------------------------------------------------------------------------------------------------


def test_a_branch_crosses_a_frequency_where_the_closed_form_has_its_orbits() -> None:
    case = paper_case(3, 0.945, 1.5, friction=0.01)
    wanted = closed_form_orbits(case).orbits
    found = [orbit for orbit in crossings(isola(), case.omega) if isinstance(orbit, Orbit)]
    assert len(found) == len(wanted) == 2
    assert all(any(same(one, other) for other in wanted) for one in found)


def test_branches_find_orbits_that_the_closed_form_does_not_lead_to() -> None:
    case = paper_case(10, 0.966, 3.5, 0.7, 0.1)
    assert closed_form_orbits(case).orbits == ()
    found = {round(group.case.omega_ratio, 6): group.orbits for group in orbits_over(case, np.array([0.964, 0.965, 0.966]))}
    assert [orbit.schedule.reversals for orbit in found[0.966]] == [26]


@pytest.mark.nightly
def test_thresholds_among_many_reversals_settle_along_branches_over_the_force() -> None:
    """N_m = 5, e = 0.7: Newton's method on the fold's conditions runs from one order of reversals to the other at the outer valley and ridge."""
    case = paper_case(5, 1.0, 1.0, 0.7, 0.01)
    birth, merger = thresholds(case, 0.91, 0.93)
    for threshold, kind, side in ((birth, BIRTH, 1), (merger, MERGER, -1)):
        assert threshold.kind == kind
        assert isinstance(threshold.orbit, Orbit), threshold
        assert threshold.orbit.schedule.reversals >= 4
        assert threshold.orbit.residual < 1e-10
        assert np.min(np.abs(threshold.orbit.stability.multipliers - 1)) < 1e-3  # a fold: half-period multiplier +1
        for share in (-5e-4, 5e-4):
            next_to = lowest_fold(threshold.orbit.case.changed(omega=threshold.orbit.case.omega * (1 + share)))
            assert not isinstance(next_to, NoOrbit)
            assert side * next_to.case.force > side * threshold.force
    assert isinstance(birth.orbit, Orbit)
    case, schedule, z = birth.orbit.case, birth.orbit.schedule, unknowns_of(birth.orbit.solution)
    start = beside(case, schedule, z, 1.001)
    assert isinstance(orbit_at(case.changed(force=1.001 * birth.force), schedule, start), Orbit)
    assert isinstance(orbit_at(case.changed(force=0.999 * birth.force), schedule, start), NoOrbit)
