"""Orbits, folds, births and mergers with friction's reversals: the published cases, and the exact method's own runs as the judge."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from periodic_truth import matched

from impact_env import Beam, ModalModel, ParameterError, Record, modal_model
from impact_env.periodic.case import Case
from impact_env.periodic.fold_map import BIRTH, MERGER
from impact_env.periodic.folds import beside
from impact_env.periodic.green import NoOrbit, unknowns_of
from impact_env.periodic.isolas import Threshold, folds, threshold_map, thresholds
from impact_env.periodic.lowest_fold import lowest_fold
from impact_env.periodic.motion import Motion
from impact_env.periodic.orbit import Orbit, mirrored, orbit_at, settled
from impact_env.periodic.schedule import Regime, flying_schedule
from impact_env.periodic.starts import initial_of, orbit_of_simulation, read_schedule, recorded, state_after
from impact_env.periodic.survey import attractors, closed_form_orbits, crossings, orbits_over, same
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.tracing import GRAZING, PULLING, OrbitBranch, orbit_branch
from impact_env.periodic.validation import BAR, map_over, propagated, residual_of, trial_of

Array = np.ndarray


@cache
def model_of(modes: int) -> ModalModel:
    return modal_model(Beam(modes=modes))


def paper_case(modes: int, ratio: float, force: float, restitution: float = 1.0, friction: float = 0.0) -> Case:
    model = model_of(modes)
    return Case(model, ratio * float(model.omega[0]), force, restitution=restitution, friction_limit=friction)


def high_orbit(case: Case) -> Orbit:
    return closed_form_orbits(case).orbits[0]


@cache
def isola() -> OrbitBranch:
    case = paper_case(3, 0.9523, 1.5, friction=0.01)
    first = float(case.model.omega[0])
    return orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.2 * first))


@cache
def one_sided() -> Orbit:
    """The orbit without symmetry that takes over where the symmetric high branch of one mode, e = 0.75, loses its stability."""
    case = paper_case(1, 0.93, 1.5, 0.75)
    found = [orbit for orbit in attractors(case, [high_orbit(case)]) if isinstance(orbit, Orbit)]
    assert len(found) == 2
    return found[0]


@cache
def many_reversals() -> Orbit:
    found = orbit_of_simulation(paper_case(10, 0.97, 3.5, 0.7, 0.1))
    assert isinstance(found, Orbit)
    return found


def other_case() -> Case:
    """Not the paper's beam."""
    model = ModalModel([31.0, 95.0, 210.0], [0.02, 0.01, 1.3], [0.8, 0.4, 0.2], [1.1, -0.7, 0.5], 1.4)
    return Case(model, 33.0, 1.0, gap=3e-3, restitution=0.6, friction_limit=0.02, mass_ratio=0.05)


# --- published numbers -----------------------------------------------------------------------------------------------------------


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
    assert [fold.orbit.schedule.reversals for fold in found] == [4, 6]  # type: ignore[union-attr]
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


# --- the exact method as the judge --------------------------------------------------------------------------------------------------


def judged() -> list[Orbit]:
    return [
        high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)),
        high_orbit(paper_case(3, 0.91, 3.0, friction=0.01)),
        one_sided(),
        many_reversals(),
        high_orbit(other_case()),
    ]


@pytest.mark.parametrize("k", range(5))
def test_the_motion_between_events_is_the_exact_methods(k: int) -> None:
    orbit = judged()[k]
    response, start = propagated(orbit.motion, Record(level=False, events=True, series=True))
    history = response.history
    assert history is not None
    truth = np.column_stack([history.modal_displacement, history.absorber_displacement, history.modal_velocity, history.absorber_velocity])
    states = orbit.motion.states(start + orbit.case.omega * history.time)
    half = truth.shape[1] // 2
    assert np.max(np.abs(states[:, :half] - truth[:, :half])) < 1e-10 * orbit.case.gap
    assert np.max(np.abs(states[:, half:] - truth[:, half:])) < 1e-9 * orbit.case.gap * orbit.case.omega
    assert np.max(np.abs(history.tip_displacement)) <= orbit.motion.tip_max * (1 + 1e-12)


@pytest.mark.parametrize("k", range(5))
def test_tip_extremes_and_rms_are_those_of_dense_samples(k: int) -> None:
    orbit = judged()[k]
    phases = orbit.solution.phases[0] + np.linspace(0, 2 * np.pi * orbit.schedule.period_multiple, 200001)[:-1]
    n = orbit.case.model.modes
    tip = orbit.motion.states(phases)[:, :n] @ orbit.case.model.tip_shape
    assert np.max(np.abs(tip)) == pytest.approx(orbit.motion.tip_max, rel=1e-7)
    assert np.sqrt(np.mean(tip**2)) == pytest.approx(orbit.motion.tip_rms, rel=1e-8)


@pytest.mark.parametrize("k", range(5))
def test_multipliers_are_those_of_disturbed_runs(k: int) -> None:
    """The exact method's map, differentiated by central differences in units in which all coordinates count alike."""
    orbit = judged()[k]
    case, n = orbit.case, orbit.case.model.modes
    start, state = orbit.motion.mid_flight()
    unit = case.gap * np.concatenate([case.omega / case.model.omega, [1.0], np.full(n, case.omega), [case.omega]])
    columns = []
    for k_unit in range(len(state)):
        step = 2e-7 * unit[k_unit] * np.eye(len(state))[k_unit]
        columns.append((map_over(orbit.motion, start, state + step) - map_over(orbit.motion, start, state - step)) / (4e-7 * unit))
    truth = np.linalg.eigvals(np.array(columns).T)
    assert matched(orbit.stability.multipliers, truth) < 1e-6 * max(1.0, float(np.max(np.abs(truth))))


def test_a_disturbance_of_an_orbit_dies_or_grows_as_its_multipliers_say() -> None:
    """Over a hundred spans beside a stable orbit, and over six beside one that is unstable; the largest multiplier of both is real."""
    for orbit, spans in ((many_reversals(), 100), (high_orbit(paper_case(1, 0.93, 1.5, 0.75)), 6)):
        largest = abs(orbit.stability.multipliers[0])
        start, first = orbit.motion.mid_flight()
        state = first.copy()
        state[-1] += 1e-7 * orbit.case.gap * orbit.case.omega
        sizes = []
        for _ in range(spans):
            state = map_over(orbit.motion, start, state)
            sizes.append(float(np.linalg.norm(state - first)))
        rate = (sizes[-1] / sizes[len(sizes) // 2 - 1]) ** (1 / (len(sizes) - len(sizes) // 2))
        assert rate == pytest.approx(largest, rel=0.02)
        assert (rate < 1) == orbit.stability.stable


def test_mirrored_orbits_are_a_pair_and_a_symmetric_one_its_own() -> None:
    orbit = one_sided()
    other = mirrored(orbit)
    assert isinstance(other, Orbit)
    assert not same(orbit, other)
    assert other.motion.tip_max == pytest.approx(orbit.motion.tip_max, rel=1e-9)
    assert matched(other.stability.multipliers, orbit.stability.multipliers) < 1e-7
    phase = float(orbit.solution.phases[0]) + 0.4
    assert np.allclose(other.motion.state_at(phase + np.pi), -orbit.motion.state_at(phase), rtol=0, atol=1e-9)
    own = high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01))
    image = mirrored(own)
    assert isinstance(image, Orbit)
    assert same(own, image)


def test_scaling_gap_friction_and_force_scales_an_orbit_with_reversals() -> None:
    case, factor = paper_case(3, 0.91, 3.0, friction=0.01), 2.5
    scaled = case.changed(gap=factor * case.gap, friction_limit=factor * case.friction_limit, force=factor * case.force)
    one, other = high_orbit(case), high_orbit(scaled)
    assert one.schedule == other.schedule
    assert one.schedule.reversals > 0
    assert other.motion.tip_max == pytest.approx(factor * one.motion.tip_max, rel=1e-10)
    assert matched(one.stability.multipliers, other.stability.multipliers) < 1e-8


# --- schedules from runs --------------------------------------------------------------------------------------------------------


def test_a_schedule_is_read_off_a_recorded_run() -> None:
    for orbit in (many_reversals(), one_sided()):
        case, start = orbit.case, float(orbit.solution.phases[0]) - 0.3
        run = recorded(case, orbit.motion.state_at(start), start, orbit.schedule.period_multiple)
        schedule, phases = read_schedule(case, run, start, orbit.schedule.period_multiple, orbit.schedule.symmetric)
        assert schedule == orbit.schedule
        assert np.allclose(phases, orbit.solution.phases, rtol=0, atol=2e-3)
        again = orbit_at(case, schedule, phases)
        assert isinstance(again, Orbit)
        assert same(orbit, again)


def test_joined_phases_of_a_run_are_joined_segments_of_its_schedule() -> None:
    """A run that comes near to itself after five periods, with a stuck phase; no orbit is found there, and what was tried is told."""
    case = paper_case(10, 0.975, 3.5, 0.7, 0.1)
    state, phase = state_after(case, 400.0)
    schedule, phases = read_schedule(case, recorded(case, state, phase, 5), phase, 5)
    assert [event.wall for event in schedule.events if event.regime is Regime.JOINED] == [0]
    assert len(phases) == len(schedule.events)
    found = orbit_of_simulation(case)
    assert isinstance(found, NoOrbit)
    assert "shooting did not converge" in found.reason


def test_an_orbit_over_three_periods_of_the_force() -> None:
    found = orbit_of_simulation(paper_case(10, 0.972, 3.5, 0.7, 0.1))
    assert isinstance(found, Orbit)
    assert found.schedule.symmetric
    assert found.schedule.period_multiple == 3
    assert len(found.impacts) == 6
    assert found.stability.stable
    assert found.residual < BAR
    phase = float(found.solution.phases[0]) + 0.2
    first, later = found.motion.state_at(phase), found.motion.state_at(phase + 2 * np.pi)
    assert np.max(np.abs(later - first)) > 1e-3 * np.max(np.abs(first))
    assert np.allclose(found.motion.state_at(phase + 6 * np.pi), first, rtol=0, atol=1e-9)


def test_a_slow_approach_is_not_taken_for_a_long_period() -> None:
    case = paper_case(1, 0.912, 1.5, 0.75)
    phase, state = high_orbit(case).motion.mid_flight()
    state[-1] *= 1.001
    found = orbit_of_simulation(case, settle=80, initial=initial_of(case, state), phase=phase)
    assert isinstance(found, Orbit)
    assert found.schedule.period_multiple == 1
    assert not found.schedule.symmetric


def test_runs_without_impacts_or_return_are_no_orbits() -> None:
    silent = orbit_of_simulation(paper_case(1, 0.9, 0.1, 0.75), settle=20)
    assert isinstance(silent, NoOrbit)
    restless = orbit_of_simulation(paper_case(3, 1.0, 3.0), settle=50)
    assert isinstance(restless, NoOrbit)
    assert "does not come again" in restless.reason


# --- what is refused -------------------------------------------------------------------------------------------------------------


def test_what_passes_a_wall_or_is_pulled_is_no_orbit() -> None:
    pulled = paper_case(10, 0.96, 3.5, 0.7)
    wrong = [orbit_at(pulled, symmetric_schedule(False), [b.phase, b.impulse / pulled.scale.impulse]) for b in closed_form(pulled) if not b.pushes]
    assert [orbit.reason for orbit in wrong if isinstance(orbit, NoOrbit)] == ["a wall would have to pull"] * len(wrong)
    assert wrong
    assert ["passes a wall" in orbit.reason for orbit in closed_form_orbits(paper_case(1, 0.96, 10.0, 0.6)).refused] == [True]


def test_a_schedule_that_leaves_reversals_out_is_not_confirmed() -> None:
    case = paper_case(3, 0.9523, 1.5, friction=0.01)
    large = closed_form(case)[1]
    found = orbit_at(case, symmetric_schedule(True), [large.phase, large.impulse / case.scale.impulse], mend=False)
    assert isinstance(found, NoOrbit)
    assert "turns" in found.reason


def test_a_motion_that_is_no_orbit_fails_its_trial() -> None:
    """Moved off the orbit by a thousandth of a radian, the exact method does not come back."""
    orbit = one_sided()
    moved = orbit.solution.phases + np.array([0.0, 1e-3])
    object.__setattr__(orbit.motion.solution, "phases", moved)
    try:
        trial = trial_of(orbit.motion)
    finally:
        one_sided.cache_clear()
    assert trial.reason is not None


def test_the_residual_is_measured_where_nothing_happens() -> None:
    orbit = many_reversals()
    response, start = propagated(orbit.motion, Record(level=False, events=True))
    assert residual_of(orbit.motion, response, start) == orbit.residual
    assert np.min(np.abs(np.mod(orbit.solution.phases - start, np.pi))) > 1e-3


def test_bad_input_is_named() -> None:
    case = paper_case(1, 0.93, 1.5, 0.75)
    with pytest.raises(ParameterError, match=r"^frequency range = "):
        folds(case, 1.0, 0.9)
    with pytest.raises(ParameterError, match=r"^ratios = "):
        list(orbits_over(case, np.array([1.0, 0.9])))
    with pytest.raises(ParameterError, match=r"^parameter = "):
        list(threshold_map(case, "omega", [1.0], 0.9, 1.0))
    with pytest.raises(ParameterError, match=r"^most_multiple = "):
        orbit_of_simulation(case, most_multiple=0)
    with pytest.raises(ParameterError, match=r"^periods = "):
        orbit_of_simulation(case, settle=0)
    with pytest.raises(ParameterError, match=r"^start = "):
        orbit_at(case, flying_schedule([-1, 1], False), [0.0, 1.0, 2.0])


def test_a_branch_ends_where_the_absorber_grazes_a_wall() -> None:
    """Just before it orbits are confirmed, just behind it the exact method finds more impacts."""
    case = paper_case(1, 0.9, 10.0, 0.6)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.3 * first))
    (motion,) = branch.of(GRAZING)
    assert GRAZING in branch.branch.ended
    assert abs(motion.clearance) < 1e-12 * case.gap
    at = motion.solution
    before, behind = (orbit_at(at.case.changed(omega=at.case.omega * share), at.schedule, unknowns_of(at)) for share in (1 - 1e-6, 1 + 1e-6))
    assert isinstance(before, Orbit)
    assert isinstance(behind, NoOrbit)
    assert "passes a wall" in behind.reason
    beyond = settled(behind.case, at.schedule, unknowns_of(at))
    assert isinstance(beyond, Motion)
    trial = trial_of(beyond)
    assert trial.reason is not None
    assert "impacts instead of" in trial.reason


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


def test_a_map_over_restitution_repeats_single_thresholds() -> None:
    case = paper_case(1, 1.0, 1.5, 0.75)
    for value, found in threshold_map(case, "restitution", [0.75, 1.0], 0.88, 1.0):
        single = thresholds(case.changed(restitution=value), 0.88, 1.0)
        assert [(t.kind, t.force, t.omega_ratio) for t in found] == [(t.kind, t.force, t.omega_ratio) for t in single]
        assert np.all((named(found, MERGER)[:, 0] > 2.34) & (named(found, MERGER)[:, 0] < 2.53))


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
