"""Bifurcations over two parameters are correct.

They are compared with multipliers of the dense reference, which shares no code, with the closed
form, and with births and mergers.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.orbit_cases import high_orbit, model_of, multipliers_by_reference, paper_case, steel

from impact_env import Beam, beam_scene, impact_absorber, modal_model
from impact_env.checks import ParameterError
from impact_env.periodic.bifurcation_curves import (
    CURVE_KINDS,
    GRAZING_FOLD,
    LOSS_OF_CONTACT,
    MULTIPLIER_KINDS,
    BifurcationCurve,
    bifurcation_curve,
    bifurcation_curves,
)
from impact_env.periodic.bifurcations import (
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    TORUS,
    minus_one_test,
    torus_test,
)
from impact_env.periodic.branch import FOLD, KINK
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.codimension_two import (
    CHENCINER,
    CODIMENSION_TWO,
    DEGENERATE_SYMMETRY_BREAKING,
    FOLD_FLIP,
    FOLD_TORUS,
    R1,
    R2,
    R3,
    R4,
)
from impact_env.periodic.continuation import Steps
from impact_env.periodic.folds import Fold
from impact_env.periodic.green import NoOrbit, make_solution, read_unknowns, residual_and_jacobian
from impact_env.periodic.harmonic_balance import harmonic_balance
from impact_env.periodic.isolas import find_thresholds
from impact_env.periodic.motion import Motion, motion_of, stability_of
from impact_env.periodic.offspring import descendants
from impact_env.periodic.orbit import Orbit, confirm_orbit, orbit_of, unpack_orbits
from impact_env.periodic.orbit_branches import (
    COARSE_STEPS,
    GRAZING,
    PULLING,
    OrbitBranch,
    orbit_branch,
    orbit_branches,
)
from impact_env.periodic.overview import linear_curves, sweep_envelope
from impact_env.periodic.symmetric import closed_folds
from impact_env.scene import InitialState
from impact_env.sweep import simulate
from reference import dense

FIRST = float(model_of(1).omega[0])
RANGE = (0.85 * FIRST, FIRST)


@cache
def one_mode() -> dict[str, list[BifurcationCurve]]:
    """Return bifurcation curves of one mode by kind.

    N_m = 1, e = 0.8, from 1.5 N to forces of 1 to 2.5 N: curves of the symmetric orbits, and of the
    pair that branches off them.
    """
    symmetric = list(orbit_branches(Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.8), *RANGE))
    pairs = [
        branch
        for branch in descendants(symmetric, RANGE, longest=1)
        if isinstance(branch, OrbitBranch)
    ]
    curves = list(
        bifurcation_curves([*symmetric, *pairs], CURVE_KINDS[:3], "force", (1.0, 2.5), RANGE)
    )
    return {kind: [curve for curve in curves if curve.kind == kind] for kind in CURVE_KINDS}


@cache
def high_branch() -> OrbitBranch:
    case = steel()
    first = float(case.model.omega[0])
    return orbit_branch(high_orbit(case).solution, "omega", (0.95 * first, 0.96 * first))


@pytest.mark.parametrize(
    ("kind", "target"), [(FOLD, 1), (SYMMETRY_BREAKING, -1), (PERIOD_DOUBLING, -1)]
)
def test_multipliers_of_an_own_propagation_are_on_the_circle_along_a_curve(
    kind: str, target: int
) -> None:
    curve = one_mode()[kind][0]
    for k in (len(curve.schedules) // 3, 2 * len(curve.schedules) // 3):
        values = multipliers_by_reference(motion_of(curve.solution(k)))
        assert np.min(np.abs(values - target)) < 1e-3
        assert curve.critical(k) == pytest.approx(target, abs=1e-8)


def test_a_torus_over_the_force_has_a_pair_on_the_circle_and_ends_where_it_meets() -> None:
    torus = high_branch().of(TORUS)[0].solution
    first = float(steel().model.omega[0])
    curve = bifurcation_curve(torus, TORUS, "force", (0.1, 0.6), (0.9 * first, 1.1 * first))
    k = len(curve.schedules) // 2
    values = multipliers_by_reference(motion_of(curve.solution(k)))
    pair = values[np.argmin(np.abs(values - curve.critical(k)))]
    assert abs(pair) == pytest.approx(1, abs=2e-3)
    assert abs(pair.imag) > 0.1
    ends = [orbit for kind, orbit in curve.located if kind in (R1, R2)]
    assert ends
    for end in ends:
        assert isinstance(end, Orbit)
        values = end.stability.multipliers
        assert np.sort(np.abs(np.abs(values) - 1))[1] < 1e-4  # two at 1, or at -1


def test_folds_over_the_force_are_the_closed_forms_and_turn_at_birth_and_merger() -> None:
    curve = one_mode()[FOLD][0]
    for k in range(5, len(curve.schedules), 25):
        solution = curve.solution(k)
        ratio = solution.case.omega_ratio
        known = np.array(closed_folds(solution.case, ratio - 0.002, ratio + 0.002)) / FIRST
        assert np.min(np.abs(known - ratio)) < 1e-9
    turns = [orbit.case for kind, orbit in curve.located if kind == FOLD]
    levels = find_thresholds(curve.case, 0.87, 0.99)
    assert len(turns) == len(levels) == 2
    for level in levels:
        assert min(abs(turn.force - level.force) for turn in turns) < 1e-8
    assert curve.branch.ended.endswith(PULLING)


def test_friction_changes_the_order_of_events_along_a_curve() -> None:
    """Friction changes the order of events along a curve.

    N_m = 3, muN = 0.01 N, e = 1: orders of events change along the curve, and the merger with its
    reversals is that of Newton's method.
    """
    case = paper_case(3, 0.95, 1.5, friction=0.01)
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.93 * first, 0.96 * first))
    curves = list(
        bifurcation_curves([branch], (FOLD,), "force", (1.4, 3.0), (0.925 * first, first))
    )
    assert len(branch.of(FOLD)) == 2
    assert all(any(isinstance(orbit, Orbit) for orbit in curve.orbits) for curve in curves)
    curve = curves[0]  # through both ends of the isola
    assert len({schedule.reversals for schedule in curve.schedules}) > 1
    turns = [orbit.case.force for kind, orbit in curve.located if kind == FOLD]
    assert min(abs(turn - 2.37028402) for turn in turns) < 1e-6
    assert np.mean([isinstance(orbit, Orbit) for orbit in curve.orbits]) > 0.9


@cache
def losses() -> list[OrbitBranch]:
    """N_m = 1, e = 0.75, 1.5 N: two of the branches end where the impulse vanishes."""
    case = Case(model_of(1), FIRST, 1.5, restitution=0.75)
    limits = (0.8 * FIRST, 1.06 * FIRST)
    symmetric = list(orbit_branches(case, *limits))
    return [
        *symmetric,
        *(branch for branch in descendants(symmetric, limits) if isinstance(branch, OrbitBranch)),
    ]


def on_the_circle_by_reference(kind: str, motion: Motion) -> bool:
    values = multipliers_by_reference(motion)
    if kind == TORUS:
        return bool(np.any((np.abs(np.abs(values) - 1) < 2e-3) & (values.imag > 1e-2)))
    return bool(np.min(np.abs(values - (1 if kind == FOLD else -1))) < 2e-3)


def test_every_bifurcation_located_has_its_multiplier_in_an_own_propagation() -> None:
    """A vanishing impulse turns the sign of det(M + I): 1.01618 is no broken symmetry."""
    branches = losses()
    assert sum(PULLING in branch.branch.ended for branch in branches) == 2
    located = [
        place for branch in branches for place in branch.places() if place[0] in MULTIPLIER_KINDS
    ]
    assert len(located) >= 8
    for kind, solution in located:
        assert on_the_circle_by_reference(kind, motion_of(solution)), (
            kind,
            solution.case.omega_ratio,
        )
        assert isinstance(confirm_orbit(motion_of(solution)), Orbit)


def test_births_are_the_bifurcations_of_the_orbits_that_are_left() -> None:
    symmetric, *_, pair = losses()
    breaking = sorted(motion.solution.case.omega for motion in symmetric.of(SYMMETRY_BREAKING))
    born = [event for event in pair.branch.located if event.kind == SYMMETRY_BREAKING]
    assert not pair.schedules[0].symmetric
    assert sorted(event.parameter for event in born) == pytest.approx(breaking, rel=1e-10)
    assert pair.of(SYMMETRY_BREAKING) == ()
    folds = [motion.solution.case.omega_ratio for motion in pair.of(FOLD)]
    assert folds == pytest.approx([0.944891285] * 2, abs=1e-8)
    pair_of_two, doubled = one_mode_cascade()
    doubling = [motion.solution.case.omega for motion in pair_of_two.of(PERIOD_DOUBLING)]
    for event in doubled.branch.located:
        assert event.kind != FOLD or min(abs(event.parameter / at - 1) for at in doubling) > 1e-7
    births = [e.parameter for e in doubled.branch.of(PERIOD_DOUBLING)]
    assert any(min(abs(at / x - 1) for x in births) < 1e-9 for at in doubling)


def one_mode_cascade() -> tuple[OrbitBranch, OrbitBranch]:
    """N_m = 1, e = 0.8, 1.5 N: the pair, and the branch of its doubled period."""
    symmetric = list(orbit_branches(Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.8), *RANGE))
    branches = [
        branch
        for branch in descendants(symmetric, RANGE, longest=2)
        if isinstance(branch, OrbitBranch)
    ]
    pair = next(branch for branch in branches if branch.schedules[0].period_multiple == 1)
    doubled = next(branch for branch in branches if branch.schedules[0].period_multiple == 2)
    return pair, doubled


def test_a_fold_has_the_residual_behind_newtons_last_step() -> None:
    branch = losses()[0]
    for fold in branch.folds():
        assert isinstance(fold, Fold)
        solution = fold.motion.solution
        residual, _ = residual_and_jacobian(
            solution.case, solution.schedule, read_unknowns(solution)
        )
        assert solution.error == pytest.approx(np.max(np.abs(residual)), rel=0, abs=3e-15)


def test_the_test_functions_pass_a_vanishing_impulse_without_a_change_of_sign() -> None:
    """Behind it the solution is none that pushes, and the determinant of M + I has another sign."""
    branch = next(
        each for each in losses() if each.of(PULLING) and each.branch.parameters[0] > FIRST
    )
    place = branch.of(PULLING)[0].solution
    z = read_unknowns(place)
    values = []
    for impulse in (1e-7, -1e-7):
        z[1] = impulse
        at = make_solution(place.case, place.schedule, z, 0.0)
        motion = motion_of(at)
        determinant = np.linalg.det(motion.derivative + np.eye(4))
        values.append((determinant, minus_one_test(motion), torus_test(motion)))
    before, behind = np.array(values)
    assert before[0] * behind[0] < 0
    assert np.all(before[1:] * behind[1:] > 0)
    assert before[1:] == pytest.approx(behind[1:], rel=1e-2)


def test_where_friction_would_hold_the_absorber_nothing_is_located() -> None:
    """N_m = 3, muN = 0.01 N, 3 N: 0.966794 and 0.971903 lie in such windows."""
    case = paper_case(3, 1.0, 3.0, friction=0.01)
    first = float(case.model.omega[0])
    places = [
        place
        for branch in orbit_branches(case, 0.95 * first, 0.98 * first)
        for place in branch.places()
        if place[0] in MULTIPLIER_KINDS
    ]
    assert places
    for kind, solution in places:
        assert isinstance(confirm_orbit(motion_of(solution)), Orbit)
        assert on_the_circle_by_reference(kind, motion_of(solution)), (
            kind,
            solution.case.omega_ratio,
        )


def test_behind_grazing_a_curve_is_no_orbits() -> None:
    (curve,) = one_mode()[FOLD][1:]
    grazing = next(orbit.case.force for kind, orbit in curve.located if kind == GRAZING_FOLD)
    beyond = [
        (value, orbit)
        for value, orbit in zip(curve.branch.parameters, curve.orbits, strict=True)
        if value > grazing + 0.01
    ]
    refused = [orbit for _, orbit in beyond if isinstance(orbit, NoOrbit)]
    assert refused
    assert all("passes a wall" in orbit.reason for orbit in refused)


@pytest.mark.parametrize(("first", "most"), [(0.02, 0.2), (0.05, 0.5)])
def test_the_fold_of_a_pair_begins_on_the_curve_of_broken_symmetry(
    first: float, most: float
) -> None:
    """The curve of folds of a pair begins on the curve of broken symmetry.

    With some step sizes the continuation stops there, with others it passes over to the mirror
    images. Rounding decides which of them occurs.
    """
    (known,) = one_mode()[FOLD][1:]
    (broken,) = one_mode()[SYMMETRY_BREAKING]
    start = known.solution(len(known.schedules) // 2)
    steps = Steps(first=first, least=1e-7, most=most, points=600)
    curve = bifurcation_curve(start, FOLD, "force", (1.0, 2.5), RANGE, steps)
    assert curve.branch.ended.startswith(SYMMETRY_BREAKING)
    assert f"{SYMMETRY_BREAKING} at force = " in curve.branch.message
    places = np.column_stack([broken.omega / FIRST, broken.branch.parameters])
    begin = np.array([curve.omega[0] / FIRST, curve.branch.parameters[0]])
    k = int(np.argmin(np.linalg.norm(places - begin, axis=1)))
    near = places[max(k - 1, 0) : k + 2]
    assert np.interp(begin[0], *near[np.argsort(near[:, 0])].T) == pytest.approx(begin[1], abs=2e-4)


def test_a_curve_describes_itself_and_its_orbits_are_read_back() -> None:
    for kind in (SYMMETRY_BREAKING, PERIOD_DOUBLING):
        curve = one_mode()[kind][0]
        plain = curve.to_plain()
        entries = list(unpack_orbits(plain["orbits"]))
        assert len(entries) == sum(written == "yes" for written in plain["orbit"])
        for entry in entries[:: len(entries) // 3]:
            orbit = orbit_of(entry)
            assert isinstance(orbit, Orbit)
            assert orbit.motion.tip_max == pytest.approx(entry["tip_max_m"], rel=1e-7)
            assert np.min(np.abs(orbit.stability.multipliers + 1)) < 1e-5


def test_each_curve_is_followed_once() -> None:
    curves = one_mode()
    assert [len(curves[kind]) for kind in (SYMMETRY_BREAKING, PERIOD_DOUBLING)] == [
        1,
        1,
    ]  # one through both of its places on the branches
    start = curves[FOLD][0].solution(0)
    for kind, parameter, word in ((KINK, "force", "kind"), (FOLD, "omega", "parameter")):
        with pytest.raises(ParameterError, match=word):
            bifurcation_curve(start, kind, parameter, (1.0, 2.0), RANGE)


def _on_own_beam(case: Case) -> Case:
    """Return the case with a model that is computed from the beam with its damping and place."""
    beam = Beam(modes=1, damping_ratio=case.damping_ratio, absorber_position=case.absorber_position)
    return replace(case, model=modal_model(beam))


def test_a_grazing_curve_touches_a_wall_in_an_own_propagation_and_meets_the_fold() -> None:
    """A grazing curve touches a wall in the dense reference and meets the fold.

    N_m = 1, e = 0.8: the pair's grazing at 2.4 N leads to the grazing-fold of its curve of folds.
    """
    (_, known) = one_mode()[FOLD][:2]
    (crossing,) = [event for event in known.branch.located if event.kind == GRAZING_FOLD]
    case = Case(model_of(1), 0.97 * FIRST, 2.4, restitution=0.8)
    limits = (0.965 * FIRST, 0.985 * FIRST)
    symmetric = list(orbit_branches(case, *limits, steps=COARSE_STEPS))
    pairs = [each for each in descendants(symmetric, limits, 1) if isinstance(each, OrbitBranch)]
    (curve,) = bifurcation_curves(pairs, (GRAZING,), "force", (2.25, 2.45), limits)
    (fold,) = [event for event in curve.branch.located if event.kind == GRAZING_FOLD]
    assert fold.parameter == pytest.approx(crossing.parameter, rel=1e-8)
    assert fold.point[-1] == pytest.approx(crossing.point[-1], rel=1e-8)
    assert all(isinstance(orbit, Orbit) for orbit in curve.orbits)
    for orbit in curve.orbits[:: len(curve.orbits) // 2]:
        assert isinstance(orbit, Orbit)
        start, state = orbit.motion.mid_flight()
        times = np.linspace(0, orbit.case.period, 4001)
        begin = InitialState(state[:1], state[2:3], float(state[1]), float(state[3]))
        drive = orbit.case.drive(float(times[-1]), start)
        states = dense.follow(orbit.case.scene, drive, begin, times).states
        relative = (states[:, 1] - states[:, 0] * orbit.case.model.tip_shape[0]) / orbit.case.gap
        rate = states[:, 3] - states[:, 2] * orbit.case.model.tip_shape[0]
        # turns of the relative velocity that are no impacts, whose velocity jumps
        calm = np.abs(np.diff(rate)) < 0.05 * np.max(np.abs(rate))
        turns = np.flatnonzero((rate[:-1] * rate[1:] < 0) & calm)
        assert np.min(1 - np.abs(relative[turns])) == pytest.approx(1e-5, abs=1e-5)


def test_contact_is_lost_where_the_response_without_impacts_reaches_the_wall() -> None:
    """Contact is lost where the response without impacts reaches the wall.

    The orbit has one impact per half period. Its contact is lost at the force gap/|H|, with the
    relative displacement H of a free absorber per newton.
    """
    case = Case(model_of(2), 0.97 * FIRST, 1.5, restitution=0.8)
    limits = (0.97 * FIRST, 1.03 * FIRST)
    branches = list(orbit_branches(case, *limits, steps=COARSE_STEPS))
    curves = list(bifurcation_curves(branches, (LOSS_OF_CONTACT,), "force", (1.2, 1.8), limits))
    assert curves
    model = case.model
    for curve in curves:
        assert all(isinstance(orbit, Orbit) for orbit in curve.orbits)
        stiffness = model.omega**2 - curve.omega[:, None] ** 2
        damping = 2j * model.damping_ratio * model.omega * curve.omega[:, None]
        response = np.sum(model.tip_shape * model.force_shape / (stiffness + damping), axis=1)
        assert curve.branch.parameters == pytest.approx(1e-3 / np.abs(response), rel=1e-9)


def test_special_points_of_a_fold_curve_have_two_critical_multipliers_in_an_own_propagation() -> (
    None
):
    """Special points of a fold curve have two critical multipliers.

    The multipliers are those of the dense reference. N_m = 1, e = 0.8: two fold-flips, a
    fold-Neimark-Sacker point and R1 on the symmetric orbits' folds.
    """
    curve = one_mode()[FOLD][0]
    special = [(kind, orbit) for kind, orbit in curve.located if kind in CODIMENSION_TWO]
    assert sorted(kind for kind, _ in special) == sorted([R1, FOLD_FLIP, FOLD_FLIP, FOLD_TORUS])
    for kind, orbit in special:
        assert isinstance(orbit, Orbit)
        assert isinstance(orbit.motion, Motion)
        values = multipliers_by_reference(orbit.motion)
        apart = np.sort(np.abs(values - 1))
        if kind == R1:  # a double multiplier has the root of a difference's error
            assert apart[1] < 0.1
            continue
        assert apart[0] < 2e-3
        if kind == FOLD_FLIP:
            assert np.min(np.abs(values + 1)) < 2e-3
        else:
            pair = values[np.abs(values.imag) > 0.05]
            assert np.min(np.abs(np.abs(pair) - 1)) < 2e-3


def test_a_chenciner_point_has_a_critical_pair_in_an_own_propagation() -> None:
    """A Chenciner point has a critical pair of multipliers in the dense reference.

    N_m = 1, e = 0.8: the point is on the torus curve of the symmetric orbits, where the coefficient
    changes its sign.
    """
    limits = (0.94 * FIRST, 1.0 * FIRST)
    case = Case(model_of(1), 0.97 * FIRST, 2.39, restitution=0.8)
    branches = [
        branch for branch in orbit_branches(case, *limits, steps=COARSE_STEPS) if branch.of(TORUS)
    ]
    curve = bifurcation_curve(branches[0].of(TORUS)[0].solution, TORUS, "force", (2.3, 2.5), limits)
    (orbit,) = [orbit for kind, orbit in curve.located if kind == CHENCINER]
    assert isinstance(orbit, Orbit)
    assert isinstance(orbit.motion, Motion)
    values = multipliers_by_reference(orbit.motion)
    pair = values[np.abs(values.imag) > 0.05]
    assert np.min(np.abs(np.abs(pair) - 1)) < 2e-3
    coefficients = [point.coefficient for point in curve.critical_points if point is not None]
    assert min(coefficients) < 0 < max(coefficients)


def test_resonances_of_a_torus_have_their_angles_in_an_own_propagation() -> None:
    """Steel beam with friction: R3 over the friction limit, R4 over the force."""
    case = steel()
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.94 * first, 0.956 * first))
    solution = branch.of(TORUS)[0].solution
    limits = (0.9 * first, 1.1 * first)
    for parameter, over, label, angle in (
        ("friction_limit", (0.0015, 0.0062), R3, 2 * np.pi / 3),
        ("force", (0.24, 0.28), R4, np.pi / 2),
    ):
        curve = bifurcation_curve(solution, TORUS, parameter, over, limits)
        (orbit,) = [orbit for kind, orbit in curve.located if kind == label]
        assert isinstance(orbit, Orbit)
        assert isinstance(orbit.motion, Motion)
        values = multipliers_by_reference(orbit.motion)
        assert np.min(np.abs(values - np.exp(1j * angle))) < 5e-3


@pytest.mark.parametrize(
    ("parameter", "limits"),
    [
        ("restitution", (0.7, 1.0)),
        ("gap", (8e-4, 1.2e-3)),
        ("mass_ratio", (0.018, 0.022)),
        ("damping_ratio", (0.009, 0.011)),
        ("absorber_position", (0.95, 1.0)),
    ],
)
def test_a_curve_over_another_parameter_comes_to_its_limits(
    parameter: str, limits: tuple[float, float]
) -> None:
    """A curve over another parameter reaches the limits of the parameter.

    Lengths over the gap depend only on the force over the gap. Without friction the fold's
    frequency at gap g is therefore that at 1 mm, 1.5 N / g.
    """
    start = high_orbit(Case(model_of(1), 0.94 * FIRST, 1.5, restitution=0.8)).solution
    curve = bifurcation_curve(
        orbit_branch(start, "omega", RANGE).of(FOLD)[-1].solution, FOLD, parameter, limits, RANGE
    )
    assert sorted(curve.branch.parameters[[0, -1]]) == pytest.approx(limits, rel=1e-12)
    assert all(isinstance(orbit, Orbit) for orbit in curve.orbits)
    for k in (0, len(curve.schedules) // 3, -1):
        case = curve.solution(k).case
        at = (
            case.changed(gap=1e-3, force=case.force * 1e-3 / case.gap)
            if parameter == "gap"
            else _on_own_beam(case)
        )
        known = np.array(closed_folds(at, case.omega_ratio - 0.01, case.omega_ratio + 0.01)) / FIRST
        assert np.min(np.abs(known - case.omega_ratio)) < 1e-8


def test_a_torus_is_where_a_pair_of_an_own_propagations_multipliers_crosses_the_circle() -> None:
    motion = high_branch().of(TORUS)[0]
    values = multipliers_by_reference(motion)
    pair = values[np.argmin(np.abs(np.abs(values) - 1))]
    assert abs(pair) == pytest.approx(1, abs=2e-3)
    assert abs(pair.imag) > 0.1
    event = min(
        high_branch().branch.located,
        key=lambda one: abs(one.parameter - motion.solution.case.omega),
    )
    inside = [
        stability_of(motion_of(high_branch().solution(k))).multipliers
        for k in (event.after, event.after + 1)
    ]
    before, behind = (int(np.sum(np.abs(multipliers) < 1)) for multipliers in inside)
    assert abs(before - behind) == 2  # a pair, and nothing else, changes sides


def test_the_response_at_a_place_half_way_along_the_beam() -> None:
    """The response at another place than the tip is correct.

    The place is half way along the beam. Exact orbits, harmonic balance, linear curves and sweeps
    are compared with displacements of the modes at this place.
    """
    beam = Beam(modes=2, response_position=0.5)
    scene = beam_scene(beam, impact_absorber())
    shape = np.array(scene.model.response_shape)
    omega = 0.95 * scene.model.resonance_omega(1)
    orbit = high_orbit(case_of(scene, 1.5, omega))
    phases = np.linspace(0, 2 * np.pi, 20001)
    place = orbit.motion.states(phases)[:, :2] @ shape
    assert orbit.motion.tip_max == pytest.approx(np.max(np.abs(place)), rel=1e-5)
    assert orbit.motion.tip_rms == pytest.approx(
        np.sqrt(np.trapezoid(place**2, phases) / (2 * np.pi)), rel=1e-6
    )
    assert orbit.motion.tip_max < 0.5 * np.max(
        np.abs(orbit.motion.states(phases)[:, :2] @ scene.model.tip_shape)
    )
    reference = scene.model.resonance_omega(1)
    linear = linear_curves(scene, 0.05, reference, 0.9, 0.95)
    below = sweep_envelope(scene, 0.05, reference, 0.9, 0.95)  # no impacts
    assert below.tip_max[-5:] == pytest.approx(
        np.interp(below.omega_ratio[-5:], linear.omega_ratio, linear.alone), rel=0.05
    )
    balance = harmonic_balance(scene, omega, 1.5, 20)
    dynamic = np.zeros(21, complex)
    assert abs(balance.linear.tip(dynamic, 0.05, 0.9 * reference)[1]) == pytest.approx(
        linear.alone[0], rel=1e-9
    )


def test_a_branch_in_friction_comes_to_its_limits() -> None:
    case = paper_case(2, 0.95, 3.0, friction=0.002)
    branch = orbit_branch(high_orbit(case).solution, "friction_limit", (0.001, 0.05))
    assert branch.branch.parameters.max() == pytest.approx(0.05, rel=1e-6)
    assert len(branch.schedules) < 500
    end = branch.solution(int(np.argmax(branch.branch.parameters)))
    orbit = confirm_orbit(motion_of(end))
    assert isinstance(orbit, Orbit), orbit.reason
    start, state = orbit.motion.mid_flight()
    initial = InitialState(state[:2], state[3:5], float(state[2]), float(state[5]))
    run = simulate(end.case.scene, end.case.drive(end.case.period, start), initial=initial)
    assert run.end_state == pytest.approx(state, abs=1e-9)


def test_the_folds_of_the_pair_begin_where_broken_symmetry_becomes_subcritical() -> None:
    """The cubic coefficient vanishes at the end of another curve, which knows nothing of it."""
    _, folds = one_mode()[FOLD][:2]
    broken = one_mode()[SYMMETRY_BREAKING][0]
    (degenerate,) = broken.branch.of(DEGENERATE_SYMMETRY_BREAKING)
    ends = [0, len(folds.schedules) - 1]
    begin = min(ends, key=lambda k: float(folds.branch.parameters[k]))
    assert folds.branch.ended.startswith(SYMMETRY_BREAKING)
    assert degenerate.parameter == pytest.approx(folds.branch.parameters[begin], abs=1e-4)
    assert degenerate.point[-1] == pytest.approx(folds.omega[begin], rel=1e-4)
    words = {point.criticality for point in broken.critical_points if point is not None}
    assert words == {"supercritical", "subcritical"}
