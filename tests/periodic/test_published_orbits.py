"""Orbits, folds, births and mergers with slip reversals agree with published cases.

Results of surveys, and branches at a multiplier of -1, are tested too.
"""

from functools import cache
from itertools import islice, pairwise

import numpy as np
import pytest
from orbit_cases import high_orbit, model_of, one_sided, paper_case

from impact_env.checks import ParameterError
from impact_env.periodic import offspring
from impact_env.periodic.case import Case
from impact_env.periodic.folds import shift_from_fold
from impact_env.periodic.green import NoOrbit, read_unknowns
from impact_env.periodic.isolas import find_folds, find_lowest_fold, find_thresholds
from impact_env.periodic.offspring import all_orbits_over, descendants, switch_branch
from impact_env.periodic.orbit import Orbit, find_orbit_at, mirror_orbit
from impact_env.periodic.orbit_branches import (
    PERIOD_DOUBLING,
    PULLING,
    SYMMETRY_BREAKING,
    OrbitBranch,
    orbit_branch,
    orbit_branches,
)
from impact_env.periodic.survey import closed_form_orbits, is_same_orbit, orbits_over
from impact_env.periodic.symmetric import BIRTH, MERGER
from impact_env.periodic.validation import RESIDUAL_BAR


def test_the_isola_of_three_modes() -> None:
    """Closed, with folds at 0.9336128203 and 0.9552754578 and a peak of 1.4743 mm at 0.9523."""
    case = paper_case(3, 0.9523, 1.5, friction=0.01)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.2 * first))
    assert branch.branch.closed
    ratios = [fold.case.omega_ratio for fold in branch.folds() if not isinstance(fold, NoOrbit)]
    assert min(abs(ratio - 0.9552754578) for ratio in ratios) < 1e-9
    assert min(abs(ratio - 0.9336128203) for ratio in ratios) < 1e-9
    orbits = [orbit for orbit in branch.orbits() if isinstance(orbit, Orbit)]
    assert len(orbits) > 0.9 * len(branch.schedules)
    assert max(orbit.residual for orbit in orbits) < RESIDUAL_BAR
    assert {orbit.schedule.reversals for orbit in orbits} == {0, 2}
    assert max(orbit.motion.tip_max for orbit in orbits) == pytest.approx(1.4743e-3, rel=2e-4)
    assert high_orbit(case).motion.tip_max == pytest.approx(1.4743e-3, abs=5e-8)


def test_the_folds_of_three_modes_with_and_without_reversals() -> None:
    located = [
        fold
        for fold in find_folds(paper_case(3, 1.0, 1.5, friction=0.01), 0.9, 1.06)
        if isinstance(fold.orbit, Orbit)
    ]
    assert [fold.omega_ratio for fold in located] == pytest.approx(
        [0.9336128203, 0.9336233427, 0.9552754578], abs=1e-9
    )
    for fold in located:
        assert isinstance(fold.orbit, Orbit)
        multipliers = fold.orbit.stability.multipliers
        assert np.min(np.abs(multipliers - 1)) < 1e-7
        assert fold.orbit.residual < RESIDUAL_BAR


def test_the_merged_branch_of_three_modes() -> None:
    """The merged branch of three modes agrees with published values.

    It goes from an impulse of zero at 0.9625 round the fold at 0.9032184 to the peak of 3.4081 mm
    at 0.9619, and back at 1.16873.
    """
    case = paper_case(3, 0.9523, 3.0, friction=0.01)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.2 * first))
    ratios = [fold.case.omega_ratio for fold in branch.folds() if not isinstance(fold, NoOrbit)]
    for wanted, close in ((0.9032184, 1e-7), (1.16873, 5e-6)):
        assert min(abs(ratio - wanted) for ratio in ratios) < close
    assert branch.of(PULLING)[0].solution.case.omega_ratio == pytest.approx(0.9625, abs=5e-5)
    assert high_orbit(paper_case(3, 0.9619, 3.0, friction=0.01)).motion.tip_max == pytest.approx(
        3.4081e-3, abs=1e-7
    )


def test_birth_and_merger_of_one_mode_with_losses() -> None:
    birth, merger = (
        one
        for one in find_thresholds(paper_case(1, 1.0, 1.5, 0.75), 0.88, 1.0)
        if isinstance(one.orbit, Orbit)
    )
    assert (birth.kind, birth.force, birth.omega_ratio) == (
        BIRTH,
        pytest.approx(1.22957, abs=5e-6),
        pytest.approx(0.90594, abs=5e-6),
    )
    assert (merger.kind, merger.force, merger.omega_ratio) == (
        MERGER,
        pytest.approx(2.41657, abs=6e-6),
        pytest.approx(0.96768, abs=6e-6),
    )


@pytest.mark.nightly
def test_thresholds_among_many_reversals_settle_along_branches_over_the_force() -> None:
    """Thresholds with many reversals are found along branches over the force.

    N_m = 5, e = 0.7: at the outer valley and ridge, Newton's method on the fold's conditions
    alternates between two orders of reversals.
    """
    birth, merger = find_thresholds(paper_case(5, 1.0, 1.0, 0.7, 0.01), 0.91, 0.93)
    assert (birth.kind, merger.kind) == (BIRTH, MERGER)
    for threshold, side in ((birth, 1), (merger, -1)):
        orbit = threshold.orbit
        assert isinstance(orbit, Orbit), threshold
        assert orbit.schedule.reversals >= 4
        assert orbit.residual < RESIDUAL_BAR
        assert (
            np.min(np.abs(orbit.stability.multipliers - 1)) < 1e-3
        )  # a fold: half-period multiplier +1
        for share in (-5e-4, 5e-4):
            next_to = find_lowest_fold(orbit.case.changed(omega=orbit.case.omega * (1 + share)))
            assert not isinstance(next_to, NoOrbit)
            assert side * next_to.case.force > side * threshold.force
    case = birth.orbit.case
    schedule = birth.orbit.schedule
    start = shift_from_fold(case, schedule, read_unknowns(birth.orbit.solution), 1.001)
    assert isinstance(
        find_orbit_at(case.changed(force=1.001 * birth.force), schedule, start), Orbit
    )
    assert isinstance(
        find_orbit_at(case.changed(force=0.999 * birth.force), schedule, start), NoOrbit
    )


def test_the_fold_of_ten_modes_with_friction() -> None:
    """The fold of ten modes with friction agrees with the published value.

    It is published as 0.951825, where four reversals a half period become six. The folds on both
    sides of that are 1.3e-6 and 5.4e-5 below it.
    """
    folds = [
        fold
        for fold in find_folds(paper_case(10, 1.0, 3.5, 0.7, 0.1), 0.94, 0.965)
        if isinstance(fold.orbit, Orbit)
    ]
    assert [fold.omega_ratio for fold in folds] == pytest.approx(
        [0.9517714335, 0.9518237122], abs=1e-9
    )
    assert [fold.orbit.schedule.reversals for fold in folds] == [4, 6]
    assert folds[1].omega_ratio == pytest.approx(0.951825, abs=2e-6)


def test_one_mode_with_losses_is_stable_on_the_high_branch_without_symmetry() -> None:
    high = high_orbit(paper_case(1, 0.93, 1.5, 0.75))
    assert not high.stability.stable
    assert (
        high.stability.multipliers[0].real < -1
    )  # of half a period: the symmetry is broken, which the period's own multiplier hides
    assert high.stability.full[0].real > 1
    assert one_sided().stability.stable
    assert not one_sided().schedule.symmetric
    first = high_orbit(paper_case(1, 0.9059, 1.5, 0.75))
    assert abs(first.stability.multipliers[0]) == pytest.approx(1, abs=0.1)


def test_the_slow_pair_lives_while_the_fast_pair_does_not() -> None:
    """The slow pair of multipliers is stable while the fast pair is not.

    The orbit is unstable by a fast pair of up to about 3. The beam's own vibration decays by exp(-D
    omega_1 T/2) = 0.967 in half a period.
    """
    stability = high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)).stability
    assert not stability.stable
    assert stability.slowly_stable
    assert np.max(np.abs(stability.fast_multipliers)) > 3
    assert np.abs(stability.slow_multipliers) == pytest.approx([0.967, 0.967], abs=0.01)


# --- surveys and maps


def test_branches_find_orbits_that_the_closed_form_does_not_lead_to() -> None:
    case = paper_case(10, 0.966, 3.5, 0.7, 0.1)
    assert closed_form_orbits(case).orbits == ()
    amplitudes = {
        round(group.case.omega_ratio, 6): group.orbits
        for group in orbits_over(case, np.array([0.964, 0.965, 0.966]))
    }
    assert [orbit.schedule.reversals for orbit in amplitudes[0.966]] == [26]


# --- the pair without symmetry, and doubled periods

MODEL = model_of(1)
FIRST = float(MODEL.omega[0])
LIMITS = (0.8 * FIRST, 0.96 * FIRST)


def test_the_high_branch_of_one_dissipative_mode_hands_over_to_a_pair() -> None:
    """The high branch of one dissipative mode is replaced by a pair of orbits.

    N_m = 1, e = 0.75, 1.5 N: at 0.93 runs of the exact method end on orbits of 0.714381 mm, one the
    mirror image of the other.
    """
    case = Case(MODEL, 0.9 * FIRST, 1.5, restitution=0.75)
    (branch,) = orbit_branches(case, *LIMITS)
    breaking = branch.of(SYMMETRY_BREAKING)
    for motion in breaking:
        values = np.linalg.eigvals(motion.derivative)
        assert np.min(np.abs(values + 1)) < 1e-7
    left, right = sorted(motion.solution.case.omega_ratio for motion in breaking)
    assert left < 0.91 < 0.93 < right
    (pair,) = (
        descendant
        for descendant in descendants([branch], LIMITS, longest=1)
        if isinstance(descendant, OrbitBranch)
    )
    assert pair.branch.closed
    orbits = list(pair.orbits())
    assert all(isinstance(orbit, Orbit) for orbit in orbits)
    near = [
        (a, b)
        for a, b in pairwise(orbits)
        if (a.case.omega_ratio - 0.93) * (b.case.omega_ratio - 0.93) <= 0
    ]
    assert len(near) == 2  # one of each
    for a, b in near:
        assert a.stability.stable
        share = (0.93 - a.case.omega_ratio) / (b.case.omega_ratio - a.case.omega_ratio)
        assert (1 - share) * a.motion.tip_max + share * b.motion.tip_max == pytest.approx(
            7.14381e-4, rel=2e-4
        )
    phases = [np.diff([impact.phase for impact in a.impacts])[0] for a, _ in near]
    assert phases[0] != pytest.approx(np.pi, abs=1e-2)


@cache
def doubling() -> tuple[OrbitBranch, OrbitBranch]:
    """N_m = 1, e = 0.8, 1.5 N: the pair, and what leaves it where its period doubles."""
    case = Case(MODEL, 0.9 * FIRST, 1.5, restitution=0.8)
    (branch,) = orbit_branches(case, *LIMITS)
    pair, doubled = islice(descendants([branch], LIMITS, longest=2), 2)
    assert isinstance(pair, OrbitBranch)
    assert isinstance(doubled, OrbitBranch)
    return pair, doubled


def test_a_multiplier_of_minus_one_leads_to_twice_the_period() -> None:
    pair, doubled = doubling()
    places = pair.of(PERIOD_DOUBLING)
    assert len(places) >= 2
    for motion in places:
        values = np.linalg.eigvals(motion.derivative)
        assert np.min(np.abs(values + 1)) < 1e-6
    where = min(motion.solution.case.omega_ratio for motion in places)
    orbits = [orbit for orbit in doubled.orbits() if isinstance(orbit, Orbit)]
    assert len(orbits) > 30
    assert {orbit.schedule.period_multiple for orbit in orbits} == {2}
    assert all(orbit.residual < 1e-10 for orbit in orbits)
    assert min(orbit.case.omega_ratio for orbit in orbits) == pytest.approx(where, abs=2e-5)
    stable = [orbit for orbit in orbits if orbit.stability.stable]
    assert stable
    with pytest.raises(ParameterError, match="kind = 'fold'"):
        next(switch_branch(pair, "fold"))


def test_all_orbits_over_a_range_have_pairs_doubled_periods_and_their_mirror_images() -> None:
    case = Case(MODEL, FIRST, 1.5, restitution=0.8)
    ratios = np.array([0.93, 0.934, 0.936, 0.94])
    messages: list[str] = []
    groups = list(all_orbits_over(case, ratios, lambda what, _done, _total: messages.append(what)))
    assert [group.case.omega_ratio for group in groups] == pytest.approx(ratios)
    assert {"closed form", "branches"} <= set(messages)
    symmetric = list(orbits_over(case, ratios))
    for group, plain in zip(groups, symmetric, strict=True):
        assert [o.motion.tip_max for o in group.orbits if o.schedule.symmetric] == pytest.approx(
            [o.motion.tip_max for o in plain.orbits]
        )
        sided = [orbit for orbit in group.orbits if not orbit.schedule.symmetric]
        assert len(sided) % 2 == 0
        for orbit in sided:
            image = mirror_orbit(orbit)
            assert isinstance(image, Orbit)
            assert sum(is_same_orbit(image, other) for other in sided) == 1
            assert orbit.residual < 1e-10
    multiples = [{orbit.schedule.period_multiple for orbit in group.orbits} for group in groups]
    assert multiples[0] == {1}
    assert multiples[1] == {1, 2}
    assert {1, 2, 4} <= multiples[2]
    assert any(
        orbit.stability.stable and orbit.schedule.period_multiple == 4 for orbit in groups[2].orbits
    )
    assert {
        orbit.schedule.period_multiple
        for group in all_orbits_over(case, ratios, longest=2)
        for orbit in group.orbits
    } == {1, 2}


def test_branches_without_end_are_left_with_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(offspring, "MOST_BRANCHES", 2)
    case = Case(MODEL, FIRST, 1.5, restitution=0.8)
    groups = list(all_orbits_over(case, np.array([0.93, 0.936]), settle=False))
    assert any("there are more" in refused.reason for group in groups for refused in group.refused)
    assert any(not orbit.schedule.symmetric for group in groups for orbit in group.orbits)
