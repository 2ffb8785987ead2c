"""Where orbits lose stability in a pair, orbits over several periods, and the place of the response: by the dense reference, which shares no code."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from support.orbit_cases import high_orbit, multipliers_by_reference, paper_case, steel

from impact_env import Beam, beam_scene, impact_absorber
from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit, Solution
from impact_env.periodic.harmonic_balance import harmonic_balance
from impact_env.periodic.isolas import IsolaCell, Level
from impact_env.periodic.motion import motion_of, stability_of
from impact_env.periodic.orbit import Orbit, confirmed
from impact_env.periodic.orbit_branches import TORUS, OrbitBranch, orbit_branch
from impact_env.periodic.overview import linear_curves, sweep_envelope
from impact_env.periodic.plain_orbits import orbit_of, plain_orbit
from impact_env.periodic.schedule import EventSchedule
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]


@cache
def high_branch() -> OrbitBranch:
    case = steel()
    first = float(case.model.omega[0])
    return orbit_branch(high_orbit(case).solution, "omega", (0.95 * first, 0.96 * first))


def test_a_torus_is_where_a_pair_of_an_own_propagations_multipliers_crosses_the_circle() -> None:
    found = high_branch().of(TORUS)
    assert found
    for motion in found:
        case = motion.solution.case
        values = multipliers_by_reference(motion)
        pair = values[np.argmin(np.abs(np.abs(values) - 1))]
        assert abs(pair) == pytest.approx(1, abs=2e-3)
        assert abs(pair.imag) > 0.1
        event = min(high_branch().branch.located, key=lambda one: abs(one.parameter - case.omega))
        inside = [stability_of(motion_of(high_branch().solution(k))).multipliers for k in (event.after, event.after + 1)]
        before, behind = (int(np.sum(np.abs(multipliers) < 1)) for multipliers in inside)
        assert abs(before - behind) == 2  # a pair, and nothing else, changes sides


def listed(solution: Solution, times: int) -> Solution:
    """Return one orbit listed over a number of periods."""
    schedule = EventSchedule(solution.schedule.events * times, False, solution.schedule.period_multiple * times)
    phases = np.concatenate([solution.phases + k * solution.schedule.turn for k in range(times)])
    return Solution(solution.case, schedule, phases, np.tile(solution.impulses, times), solution.offset, solution.error, solution.steps)


def over_a_period(solution: Solution) -> Solution:
    """Return a symmetric orbit with its mirrored half listed too."""
    old = solution.schedule
    events = (*old.events, *(event.mirrored for event in old.events))
    phases, impulses = np.concatenate([solution.phases, solution.phases + np.pi]), np.concatenate([solution.impulses, -solution.impulses])
    return Solution(solution.case, EventSchedule(events, False, 1), phases, impulses, solution.offset, solution.error, solution.steps)


def test_an_unstable_orbit_is_one_over_any_number_of_periods() -> None:
    """Run over all of them at once rounding grows with the multipliers to the power of their number, and would refuse it."""
    whole = over_a_period(high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)).solution)
    assert abs(stability_of(motion_of(whole)).multipliers[0]) > 5
    for times in (1, 2, 4, 8):
        found = confirmed(motion_of(listed(whole, times)))
        assert isinstance(found, Orbit), found.reason
        assert found.residual < 1e-10
        assert len(found.impacts) == times * whole.schedule.impacts
        assert isinstance(again := orbit_of(plain_orbit(found)), Orbit)  # as files have it; by shooting over eight periods it would be lost
        assert again.motion.tip_max == pytest.approx(found.motion.tip_max, rel=1e-9)
    shifted = listed(whole, 4)
    moved = shifted.phases.copy()
    moved[-1] += 1e-4
    other = confirmed(motion_of(Solution(shifted.case, shifted.schedule, moved, shifted.impulses, shifted.offset, shifted.error, shifted.steps)))
    assert isinstance(other, NoOrbit)


def test_the_response_is_given_at_one_place() -> None:
    """Half way along the beam: exact orbits, harmonic balance, linear curves and sweeps, each against displacements of the modes there."""
    beam = Beam(modes=2, response_position=0.5)
    scene = beam_scene(beam, impact_absorber())
    shape = np.array(scene.model.response_shape)
    omega = 0.95 * scene.model.resonance_omega(1)
    orbit = high_orbit(case_of(scene, 1.5, omega))
    phases = np.linspace(0, 2 * np.pi, 20001)
    place = orbit.motion.states(phases)[:, :2] @ shape
    assert orbit.motion.tip_max == pytest.approx(np.max(np.abs(place)), rel=1e-5)
    assert orbit.motion.tip_rms == pytest.approx(np.sqrt(np.trapezoid(place**2, phases) / (2 * np.pi)), rel=1e-6)
    assert orbit.motion.tip_max < 0.5 * np.max(np.abs(orbit.motion.states(phases)[:, :2] @ scene.model.tip_shape))
    reference = scene.model.resonance_omega(1)
    linear = linear_curves(scene, 0.05, reference, 0.9, 0.95)
    below = sweep_envelope(scene, 0.05, reference, 0.9, 0.95)  # no impacts
    assert below.tip_max[-5:] == pytest.approx(np.interp(below.omega_ratio[-5:], linear.omega_ratio, linear.alone), rel=0.05)
    balance = harmonic_balance(scene, omega, 1.5, 20)
    dynamic = np.zeros(21, complex)
    assert abs(balance.linear.tip(dynamic, 0.05, 0.9 * reference)[1]) == pytest.approx(linear.alone[0], rel=1e-9)


def test_the_isola_of_a_cell_is_that_below_the_resonance() -> None:
    levels = (Level("birth", 0.453, 0.93), Level("merger", 0.595, 0.96), Level("birth", 0.225, 1.02), Level("merger", 9.79, 1.05))
    assert IsolaCell(3, 1.0, 0.0, levels).pair == levels[:2]
    assert IsolaCell(3, 1.0, 0.0, levels[2:]).pair == levels[2:]


def test_a_branch_in_friction_comes_to_its_limits() -> None:
    case = paper_case(2, 0.95, 3.0, friction=0.002)
    branch = orbit_branch(high_orbit(case).solution, "friction_limit", (0.001, 0.05))
    assert branch.branch.parameters.max() == pytest.approx(0.05, rel=1e-6)
    assert len(branch.schedules) < 500
    end = branch.solution(int(np.argmax(branch.branch.parameters)))
    orbit = confirmed(motion_of(end))
    assert isinstance(orbit, Orbit), orbit.reason
    start, state = orbit.motion.mid_flight()
    initial = InitialState(state[:2], state[3:5], float(state[2]), float(state[5]))
    run = simulate(end.case.scene, end.case.drive(end.case.period, start), initial=initial)
    assert run.end_state == pytest.approx(state, abs=1e-9)
