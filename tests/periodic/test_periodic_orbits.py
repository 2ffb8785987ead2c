"""Orbits with friction's reversals: the exact method's own runs as the judge, schedules read off runs, and what is refused."""

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from core import ALL
from orbit_cases import attractor, high_orbit, many_reversals, one_sided, other_case, paper_case
from periodic_truth import matched

from impact_env.periodic.case import start_from
from impact_env.periodic.green import NoOrbit, unknowns_of
from impact_env.periodic.motion import Motion, ShotMotion
from impact_env.periodic.orbit import Orbit, mirrored, orbit_at, settled
from impact_env.periodic.orbit_branches import GRAZING, orbit_branch
from impact_env.periodic.passage import passage
from impact_env.periodic.schedule import Regime
from impact_env.periodic.shooting import shot
from impact_env.periodic.survey import closed_form_orbits, orbit_of_simulation, same, state_after
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.validation import BAR, map_over, propagated, validate

# --- the exact method as the judge --------------------------------------------------------------------------------------------------


@cache
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
    response, start = propagated(orbit.motion, ALL)
    history = response.history
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


def test_the_events_of_a_run_are_those_of_the_orbit() -> None:
    for orbit in (many_reversals(), one_sided()):
        case, start = orbit.case, float(orbit.solution.phases[0]) - 0.3
        run = passage(case, start, orbit.motion.state_at(start), orbit.schedule.turn / case.omega)
        read = shot(case, run, orbit.schedule.symmetric, orbit.schedule.period_multiple, 0.0, 0)
        assert isinstance(read, ShotMotion)
        assert read.solution.schedule == orbit.schedule
        assert np.allclose(read.solution.phases, orbit.solution.phases, rtol=0, atol=1e-8)
        again = orbit_at(case, read.solution.schedule, read.solution.phases)
        assert isinstance(again, Orbit)
        assert same(orbit, again)


@pytest.mark.slow
def test_joined_phases_of_a_run_are_joined_segments_of_its_schedule() -> None:
    """A run that comes near to itself after five periods, with a stuck phase; rounding decides whether that is near enough for an orbit."""
    case = paper_case(10, 0.975, 3.5, 0.7, 0.1)
    state, phase = state_after(case, 400.0)
    read = passage(case, phase, state, 5 * case.period)
    assert {happening.event.wall for happening in read.happenings if happening.event.regime is Regime.JOINED} == {
        0
    }  # one stuck phase, in some runs two
    found = orbit_of_simulation(case)
    assert found.residual < BAR if isinstance(found, Orbit) else "did not converge" in found.reason or "does not come again" in found.reason


def test_an_orbit_over_three_periods_of_the_force() -> None:
    found = attractor(0.972, 3)
    assert found.schedule.symmetric
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
    found = orbit_of_simulation(case, settle=80, initial=start_from(case.scene, state), phase=phase)
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
    found = orbit_at(case, symmetric_schedule(True), [large.phase, large.impulse / case.scale.impulse], reorder=False)
    assert isinstance(found, NoOrbit)
    assert "turns" in found.reason


def test_a_motion_that_is_no_orbit_fails_its_trial() -> None:
    """Moved off the orbit by a thousandth of a radian, the exact method does not come back."""
    motion = deepcopy(one_sided().motion)
    object.__setattr__(motion.solution, "phases", motion.solution.phases + np.array([0.0, 1e-3]))
    validation = validate(motion)
    assert validation.reason is not None


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
    validation = validate(beyond)
    assert validation.reason is not None
    assert "impacts instead of" in validation.reason
