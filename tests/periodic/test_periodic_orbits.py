"""Orbits with slip reversals, stuck phases and chatter are correct.

They are compared with the exact method's own runs and with shooting. Motions that are not orbits
are refused.
"""

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from core import ALL
from orbit_cases import (
    attractor,
    high_orbit,
    many_reversals,
    model_of,
    one_sided,
    other_case,
    paper_case,
)
from periodic_truth import matched

from impact_env import InitialState, ModalModel
from impact_env.periodic.bifurcations import SYMMETRY_BREAKING, TORUS
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps
from impact_env.periodic.green import NoOrbit, read_unknowns
from impact_env.periodic.motion import Motion, ShotMotion, motion_of
from impact_env.periodic.orbit import (
    Orbit,
    find_orbit_at,
    mirror_orbit,
    reorder_events,
    settle_order,
    shoot_orbit,
)
from impact_env.periodic.orbit_branches import (
    GRAZING,
    orbit_branch,
    shows_schedule,
)
from impact_env.periodic.passage import RECORD, follow_trajectory
from impact_env.periodic.schedule import Regime
from impact_env.periodic.shooting import shoot, shoot_from
from impact_env.periodic.survey import (
    closed_form_orbits,
    crossings,
    is_same_orbit,
    orbit_of_simulation,
    state_after,
)
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.validation import (
    CHATTER_BAR,
    RESIDUAL_BAR,
    iterate_map,
    propagate_orbit,
    validate,
)
from impact_env.sweep import simulate

# --- the exact method as the judge

FLYING = {
    "isola": lambda: high_orbit(paper_case(3, 0.9523, 1.5, friction=0.01)),
    "merged": lambda: high_orbit(paper_case(3, 0.91, 3.0, friction=0.01)),
    "one-sided": one_sided,
    "many reversals": many_reversals,
    "another structure": lambda: high_orbit(other_case()),
}
HELD = {
    "chatter": paper_case(3, 0.9, 20.0, 0.1),
    "chatter with friction": paper_case(1, 0.9, 20.0, 0.3, 0.05),
    "without rebound": paper_case(3, 0.9, 8.0, 0.0, 0.05),
    "held on another structure": Case(other_case().model, 33.0, 6.0, 1e-3, 0.2, 0.02, 0.05),
    "friction damper": Case(
        model_of(1), 1.02 * float(model_of(1).omega[0]), 2.0, 5e-3, 0.7, 0.3
    ),  # the walls are out of reach
}


@cache
def orbit_of(name: str) -> Orbit:
    orbit = FLYING[name]() if name in FLYING else orbit_of_simulation(HELD[name], settle=300)
    assert isinstance(orbit, Orbit), orbit.reason
    return orbit


@pytest.mark.parametrize("rounding", [-1e-16, -3e-17, 0.0, 3e-17, 1e-16])
def test_a_motion_may_start_where_the_relative_velocity_is_zero_but_for_rounding(
    rounding: float,
) -> None:
    case = HELD["held on another structure"]
    state, phase = state_after(case, 300)
    period = 2 * np.pi / case.omega
    run = follow_trajectory(case, phase, state, period)
    reversals = [each.time for each in run.events if each.event.wall == 0]
    assert len(reversals) > 15  # in two accumulations of impacts
    n = case.model.modes
    for time in reversals:
        start = run.states(np.array([time]))[0]
        start[-1] = case.model.tip_shape @ start[n + 1 : -1] + rounding
        again = follow_trajectory(case, phase + case.omega * time, start, period)
        assert np.max(np.abs(again.end[: n + 1] - start[: n + 1])) < 1e-6 * case.gap
        assert all(each.event.sign in (-1, 1) for each in again.events if each.impulse != 0)


@pytest.mark.parametrize("name", [*FLYING, *HELD])
def test_the_motion_is_the_exact_methods_and_its_measures_those_of_samples(name: str) -> None:
    orbit = orbit_of(name)
    case = orbit_of(name).case
    assert orbit.schedule.flies == (name in FLYING)
    assert orbit.residual < (
        CHATTER_BAR if name in HELD and name != "friction damper" else RESIDUAL_BAR
    )
    response, start = propagate_orbit(orbit.motion, ALL)
    history = response.history
    n = case.model.modes
    truth = np.column_stack(
        [
            history.modal_displacement,
            history.absorber_displacement,
            history.modal_velocity,
            history.absorber_velocity,
        ]
    )
    states = orbit.motion.states(start + case.omega * history.time)
    assert np.max(np.abs(states[:, : n + 1] - truth[:, : n + 1])) < 1e-9 * case.gap
    if name in FLYING:  # in a chatter velocities jump, so that none is told at an impact
        assert np.max(np.abs(states[:, n + 1 :] - truth[:, n + 1 :])) < 1e-9 * case.gap * case.omega
    tip = (
        orbit.motion.states(
            start + np.linspace(0, 2 * np.pi * orbit.schedule.period_multiple, 100_001)[:-1]
        )[:, :n]
        @ case.model.tip_shape
    )
    assert np.max(np.abs(tip)) == pytest.approx(orbit.motion.tip_max, rel=1e-6)
    assert np.sqrt(np.mean(tip**2)) == pytest.approx(orbit.motion.tip_rms, rel=1e-6)


@pytest.mark.parametrize("name", [*FLYING, *HELD])
def test_multipliers_are_those_of_disturbed_runs(name: str) -> None:
    """Multipliers are those of disturbed runs.

    They follow from central differences of the exact method's map, in units that give all
    coordinates equal weight. Each joined phase reduces the rank of the map by one.
    """
    orbit = orbit_of(name)
    case = orbit_of(name).case
    n = orbit_of(name).case.model.modes
    start, state = orbit.motion.mid_flight()
    unit = case.gap * np.concatenate(
        [case.omega / case.model.omega, [1.0], np.full(n, case.omega), [case.omega]]
    )
    size = 2e-7 if name in FLYING else 1e-6
    columns = [
        (
            iterate_map(orbit.motion, start, state + step)
            - iterate_map(orbit.motion, start, state - step)
        )
        for step in size * np.diag(unit)
    ]
    truth = np.linalg.eigvals(np.array(columns).T / unit[:, None] / (2 * size))
    multipliers = orbit.stability.multipliers
    assert matched(multipliers, truth) < (1e-6 if name in FLYING else 1e-4) * max(
        1.0, float(np.max(np.abs(truth)))
    )
    if (
        name == "friction damper"
    ):  # its place of rest is free: over half a period it turns to the other side
        assert np.min(np.abs(multipliers + 1)) < 1e-10
    elif name in HELD:
        assert np.sum(np.abs(multipliers) < 1e-3) >= 2


@pytest.mark.parametrize("name", HELD)
def test_held_phases_and_slip_are_those_of_forty_digits(name: str) -> None:
    """Held phases and slip agree with a reference of forty digits.

    Taylor series in whole numbers return to an orbit's start over its span. They join and release
    the absorber at the same times as the orbit.
    """
    digits = pytest.importorskip("reference.digits", exc_type=ImportError)
    orbit = orbit_of(name)
    case = orbit_of(name).case
    start, state = orbit.motion.mid_flight()
    true = digits.follow(
        case.scene,
        case.drive(orbit.schedule.turn / case.omega, start),
        InitialState.from_vector(case.scene, state),
    )
    half = len(state) // 2
    for end, begin in zip(
        np.split(-true.end_state if orbit.schedule.symmetric else true.end_state, [half]),
        np.split(state, [half]),
        strict=True,
    ):
        assert end == pytest.approx(begin, abs=1e-8 * np.max(np.abs(begin)))
    wanted = [
        (start + case.omega * float(event.time)) % orbit.schedule.turn for event in true.events
    ]
    joined = [False, *(event.regime.startswith(("stuck", "held")) for event in true.events)]
    changes = sorted(
        (phase, now)
        for phase, before, now in zip(wanted, joined, joined[1:], strict=False)
        if now != before
    )
    regimes = [event.regime is Regime.JOINED for event in orbit.schedule.events]
    phases = orbit.solution.phases % orbit.schedule.turn
    release_phases = sorted(
        (phase, regimes[k]) for k, phase in enumerate(phases) if regimes[k] != regimes[k - 1]
    )
    assert len(release_phases) >= 2
    np.testing.assert_allclose(
        release_phases, changes, rtol=0, atol=1e-6
    )  # the last of a chatter's bounces end sooner in 16 digits than in 40


def test_mirrored_orbits_are_a_pair_and_a_symmetric_one_its_own() -> None:
    orbit = orbit_of("one-sided")
    other = mirror_orbit(orbit)
    assert isinstance(other, Orbit)
    assert not is_same_orbit(orbit, other)
    assert matched(other.stability.multipliers, orbit.stability.multipliers) < 1e-7
    phase = float(orbit.solution.phases[0]) + 0.4
    assert np.allclose(
        other.motion.state_at(phase + np.pi), -orbit.motion.state_at(phase), rtol=0, atol=1e-9
    )
    for name in ("isola", "chatter", "without rebound"):
        image = mirror_orbit(orbit_of(name))
        assert isinstance(image, Orbit)
        assert is_same_orbit(orbit_of(name), image)


def test_a_chatter_lists_the_impacts_of_the_recorded_run() -> None:
    orbit = orbit_of("chatter")
    response, start = propagate_orbit(orbit.motion, ALL)
    assert orbit.schedule.symmetric
    assert len(orbit.impacts) == 2 * len(response.impacts.time)
    sizes = np.abs([impact.impulse for impact in orbit.impacts])
    assert np.min(sizes) < 1e-5 * np.max(sizes)
    phases = np.sort((start + orbit.case.omega * response.impacts.time) % np.pi)
    assert np.allclose(
        np.sort([impact.phase % np.pi for impact in orbit.impacts])[::2], phases, rtol=0, atol=1e-12
    )


# --- shooting, and schedules from runs


@pytest.mark.parametrize(
    "case",
    [
        paper_case(3, 0.9523, 1.5, 1.0),
        paper_case(3, 0.9523, 1.5, 1.0, 0.01),
        paper_case(1, 0.93, 1.5, 0.75),
        paper_case(10, 0.97, 3.5, 0.7, 0.1),
        other_case(),
    ],
)
def test_closed_form_greens_function_and_shooting_agree(case: Case) -> None:
    for orbit in closed_form_orbits(case).orbits:
        phase, state = orbit.motion.mid_flight()
        start = state * (1 + 1e-4 * np.cos(np.arange(len(state))))
        again = shoot_orbit(
            case, phase, start, orbit.schedule.symmetric, orbit.schedule.period_multiple
        )
        assert isinstance(again, Orbit)
        assert (
            np.max(np.abs(again.motion.state_at(phase) - state)[: len(state) // 2])
            < 1e-10 * case.gap
        )
        assert [i.phase for i in again.impacts] == pytest.approx(
            [i.phase for i in orbit.impacts], abs=1e-10
        )
        assert [i.impulse for i in again.impacts] == pytest.approx(
            [i.impulse for i in orbit.impacts], rel=1e-10
        )
        assert again.motion.tip_max == pytest.approx(orbit.motion.tip_max, rel=1e-10)
        assert again.schedule.reversals == orbit.schedule.reversals
        assert matched(again.stability.multipliers, orbit.stability.multipliers) < 1e-10 * max(
            1.0, abs(orbit.stability.multipliers[0])
        )


def test_a_passage_repeats_the_exact_methods_run_from_any_state() -> None:
    """A passage agrees with the exact method's run from any state.

    It covers two periods with impacts, sticking and chatter, not on an orbit. The end state, and
    its derivative by central differences, are compared.
    """
    case = paper_case(3, 0.95, 6.0, 0.4, 0.05)
    rng = np.random.default_rng(5)
    unit = np.concatenate([np.full(4, case.gap), np.full(4, case.gap * case.omega)])
    # where a run was after 40 periods: another processor's run is elsewhere by then
    orbit_like = np.array([3.96e-4, 1.48e-7, 3.23e-6, 2.44e-4, 0.311, -1.39e-2, 2.68e-3, 0.969])

    def run(state: np.ndarray) -> np.ndarray:
        return (
            simulate(
                case.scene,
                case.drive(2 * case.period, 0.3),
                initial=InitialState.from_vector(case.scene, state),
                record=RECORD,
            ).end_state
            / unit
        )

    for _ in range(5):
        state = orbit_like * (1 + 0.1 * rng.uniform(-1, 1, 8))
        state[3] = model_of(3).tip_shape @ state[:3] + 0.2e-3 * rng.uniform(-1, 1)
        passage = follow_trajectory(case, 0.3, state, 2 * case.period)
        assert np.max(np.abs(passage.end / unit - run(state))) < 1e-10
        steps = 1e-7 * np.diag(unit)
        truth = np.array([(run(state + step) - run(state - step)) / 2e-7 for step in steps]).T
        assert np.max(np.abs(passage.derivative * unit / unit[:, None] - truth)) < 1e-4 * np.max(
            np.abs(truth)
        )
        assert sum(happening.event.is_impact for happening in passage.events) > 2


@pytest.mark.parametrize("name", ["many reversals", "one-sided"])
def test_the_events_of_a_run_are_those_of_the_orbit(name: str) -> None:
    orbit = orbit_of(name)
    case = orbit_of(name).case
    start = float(orbit.solution.phases[0]) - 0.3
    run = follow_trajectory(
        case, start, orbit.motion.state_at(start), orbit.schedule.turn / case.omega
    )
    read = shoot_from(case, run, orbit.schedule.symmetric, orbit.schedule.period_multiple, 0.0, 0)
    assert isinstance(read, ShotMotion)
    assert read.solution.schedule == orbit.schedule
    assert np.allclose(read.solution.phases, orbit.solution.phases, rtol=0, atol=1e-8)


def test_an_orbit_over_three_periods_of_the_force() -> None:
    orbit = attractor(0.972, 3)
    assert orbit.schedule.symmetric
    assert len(orbit.impacts) == 6
    assert orbit.stability.stable
    assert orbit.residual < RESIDUAL_BAR
    phase = float(orbit.solution.phases[0]) + 0.2
    first = orbit.motion.state_at(phase)
    later = orbit.motion.state_at(phase + 2 * np.pi)
    assert np.max(np.abs(later - first)) > 1e-3 * np.max(np.abs(first))
    assert np.allclose(orbit.motion.state_at(phase + 6 * np.pi), first, rtol=0, atol=1e-9)


def test_a_slow_approach_is_not_taken_for_a_long_period() -> None:
    case = paper_case(1, 0.912, 1.5, 0.75)
    phase, state = high_orbit(case).motion.mid_flight()
    state[-1] *= 1.001
    orbit = orbit_of_simulation(
        case, settle=80, initial=InitialState.from_vector(case.scene, state), phase=phase
    )
    assert isinstance(orbit, Orbit)
    assert orbit.schedule.period_multiple == 1
    assert not orbit.schedule.symmetric


def test_a_branch_has_orbits_in_the_window_of_a_stuck_phase() -> None:
    """A branch has orbits in the frequency range of a stuck phase.

    Between two numbers of reversals friction holds the absorber. There the branch's own solutions
    are not orbits, but those of shooting are.
    """
    start = many_reversals()
    first = float(start.case.model.omega[0])
    branch = orbit_branch(
        start.solution,
        "omega",
        (0.9695 * first, 0.973 * first),
        Steps(first=0.002, least=1e-8, most=0.01),
    )
    orbits = list(branch.orbits())
    assert all(isinstance(point, Orbit) for point in orbits), [
        point.reason for point in orbits if isinstance(point, NoOrbit)
    ]
    (crossing,) = crossings(branch, 0.9715 * first)
    held = [point for point in (*orbits, crossing) if not point.schedule.flies]
    assert crossing in held[-1:]
    assert len(held) > 1
    assert all(point.residual < RESIDUAL_BAR for point in held)
    assert {
        event.wall
        for point in held
        for event in point.schedule.events
        if event.regime is Regime.JOINED
    } == {0}


# --- what is refused


def test_what_does_not_come_back_never_touches_or_meets_a_resonance_says_so() -> None:
    refused = {
        "did not converge": shoot(
            paper_case(3, 1.0, 3.0, 0.9), 0.0, np.array([1e-3, 0, 0, 0, 0.1, 0, 0, 2.0])
        ),
        "do not touch": shoot(paper_case(1, 0.9, 0.1, 0.75), 0.0, np.zeros(4)),
        "holds the absorber all the time": orbit_of_simulation(
            paper_case(1, 0.9, 0.01, 0.75, 5.0), settle=20
        ),
        "resonance": shoot(
            Case(ModalModel([30.0], [0.0], [1.0], [1.0], 1.0), 30.0, 1.0), 0.0, np.zeros(4)
        ),
        "does not come again": orbit_of_simulation(paper_case(3, 1.0, 3.0), settle=50),
    }
    for message, result in refused.items():
        assert isinstance(result, NoOrbit)
        assert message in result.reason


def test_what_passes_a_wall_is_pulled_or_turns_is_no_orbit() -> None:
    pulled = paper_case(10, 0.96, 3.5, 0.7)
    wrong = [
        find_orbit_at(
            pulled, symmetric_schedule(False), [b.phase, b.impulse / pulled.scale.impulse]
        )
        for b in closed_form(pulled)
        if not b.pushes
    ]
    assert {orbit.reason for orbit in wrong} == {"a wall would have to pull"}
    assert [
        "passes a wall" in orbit.reason
        for orbit in closed_form_orbits(paper_case(1, 0.96, 10.0, 0.6)).refused
    ] == [True]
    case = paper_case(3, 0.9523, 1.5, friction=0.01)
    large = closed_form(case)[1]
    assert (
        "turns"
        in find_orbit_at(
            case,
            symmetric_schedule(True),
            [large.phase, large.impulse / case.scale.impulse],
            reorder=False,
        ).reason
    )


def test_a_motion_that_is_no_orbit_fails_its_validation() -> None:
    """Moved off the orbit by a thousandth of a radian, the exact method does not come back."""
    motion = deepcopy(one_sided().motion)
    object.__setattr__(motion.solution, "phases", motion.solution.phases + np.array([0.0, 1e-3]))
    assert validate(motion).reason is not None


def test_a_branch_ends_where_the_absorber_grazes_a_wall() -> None:
    """Just before it orbits are confirmed, just behind it the exact method finds more impacts."""
    case = paper_case(1, 0.9, 10.0, 0.6)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.85 * first, 1.3 * first))
    (motion,) = branch.of(GRAZING)
    assert GRAZING in branch.branch.ended
    assert abs(motion.clearance) < 1e-12 * case.gap
    at = motion.solution
    before, behind = (
        find_orbit_at(at.case.changed(omega=at.case.omega * share), at.schedule, read_unknowns(at))
        for share in (1 - 1e-6, 1 + 1e-6)
    )
    assert isinstance(before, Orbit)
    assert isinstance(behind, NoOrbit)
    assert "passes a wall" in behind.reason
    beyond = settle_order(behind.case, at.schedule, read_unknowns(at))
    assert isinstance(beyond, Motion)
    assert "impacts instead of" in validate(beyond).reason


def test_a_search_leaves_a_branch_after_so_many_points_that_are_no_orbits() -> None:
    """A search stops a branch after a number of points that are not orbits.

    With much friction the closed form's branch continues over solutions that friction would hold.
    No bifurcation is located between those.
    """
    case = paper_case(8, 0.97, 3.5, 0.7, 0.3)
    first = float(case.model.omega[0])
    starts = [start for start in closed_form(case) if start.pushes]
    motions = [reorder_events(case, symmetric_schedule(True), [start.phase]) for start in starts]
    (motion,) = (motion for motion in motions if isinstance(motion, Motion))

    def follow(most_wrong: int | None) -> tuple[list[bool], set[float]]:
        """Return which points are orbits, and the places located next to one that is."""
        branch = orbit_branch(
            motion.solution, "omega", (0.96 * first, 0.98 * first), most_wrong=most_wrong
        )
        points = range(len(branch.schedules))
        right = [shows_schedule(motion_of(branch.solution(k))) for k in points]
        kinds = (TORUS, SYMMETRY_BREAKING)
        located = [event for event in branch.branch.located if event.kind in kinds]
        places = {round(event.parameter, 6) for event in located}
        if most_wrong is not None:
            assert all(any(right[event.after : event.after + 2]) for event in located)
        return right, places

    whole, places = follow(None)
    assert longest_run(whole) > 12
    part, fewer = follow(3)
    assert 3 < longest_run(part) <= 4
    assert part == whole[-len(part) :]
    assert fewer <= places


def longest_run(right: list[bool]) -> int:
    """Return the largest number of False in a row."""
    return max(len(run) for run in "".join("x" if each else " " for each in right).split("x"))
