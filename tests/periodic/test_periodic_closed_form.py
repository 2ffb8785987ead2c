"""The symmetric orbit in closed form and by Green's function is correct.

It is compared with dense matrices that share nothing with them.
"""

import numpy as np
import pytest
from orbit_cases import model_of
from periodic_truth import Truth, matched

from impact_env import Beam, ModalModel, modal_model
from impact_env.periodic.case import Case, make_structure
from impact_env.periodic.folds import Fold, find_fold
from impact_env.periodic.green import Conditions, NoOrbit, Solution, residual_and_jacobian, solve
from impact_env.periodic.motion import motion_of, stability_of
from impact_env.periodic.schedule import EventSchedule, flying_schedule
from impact_env.periodic.symmetric import (
    BIRTH,
    MERGER,
    closed_folds,
    closed_form,
    find_level_places,
    fold_force,
    fold_impulse,
    map_frequencies,
    symmetric_schedule,
)
from impact_env.regimes import solve_own_modes

mpmath = pytest.importorskip("mpmath")


def other_model() -> ModalModel:
    """Return a model other than the paper's beam.

    It has few modes close together, damping below, at and above the critical ratio, and shapes of
    both signs.
    """
    return ModalModel(
        [31.0, 40.0, 95.0, 210.0],
        [0.03, 0.004, 1.0, 1.7],
        [0.8, -0.5, 0.4, 0.2],
        [1.1, 0.9, -0.7, 0.5],
        1.4,
    )


CASES = [
    Case(model_of(1), 236.0, 1.5, restitution=0.75),
    Case(
        modal_model(Beam(modes=1, damping_ratio=0.2)),
        300.0,
        9.0,
        restitution=1.0,
        friction_limit=0.02,
    ),
    Case(model_of(3), 239.0, 1.5, friction_limit=0.01),
    Case(model_of(10), 241.0, 3.5, restitution=0.7, friction_limit=0.1),
    Case(
        other_model(), 36.0, 20.0, gap=3e-3, restitution=0.4, friction_limit=0.05, mass_ratio=0.06
    ),
    Case(other_model(), 71.0, -40.0, gap=2e-3, restitution=0.9, mass_ratio=0.3),
]


@pytest.mark.parametrize("case", CASES)
def test_a_fold_at_a_frequency_of_the_map_itself_is_located(case: Case) -> None:
    """There the difference to the case's force is exactly 0, and has no sign."""
    low = 0.99 * case.omega_ratio
    high = 1.01 * case.omega_ratio
    omegas = map_frequencies(case, low, high)
    pushed = [
        k for k in range(1, len(omegas) - 1) if fold_impulse(case.changed(omega=omegas[k])) > 0
    ]
    for k in (pushed[0], pushed[len(pushed) // 2], pushed[-1]):
        folds = closed_folds(case.changed(force=float(fold_force(case, omegas)[k])), low, high)
        assert np.min(np.abs(np.array(folds) - omegas[k])) < 1e-12 * omegas[k]


@pytest.mark.parametrize("case", CASES)
def test_the_fold_force_is_that_of_dense_matrices(case: Case) -> None:
    for omega in case.omega * np.array([0.8, 1.0, 1.3]):
        assert fold_force(case, [omega])[0] == pytest.approx(
            Truth(case.changed(omega=omega)).fold_force(), rel=1e-10
        )


@pytest.mark.parametrize("case", CASES)
def test_both_orbits_with_their_states_and_multipliers_are_those_of_dense_matrices(
    case: Case,
) -> None:
    truth = Truth(case)
    orbits = closed_form(case)
    n = case.model.modes + 1
    assert len(orbits) == len(truth.orbits()) == 2
    for branch, (phase, impulse, state) in zip(orbits, truth.orbits(), strict=True):
        assert branch.impulse == pytest.approx(impulse, rel=1e-9)
        assert abs(np.exp(1j * branch.phase) - np.exp(1j * phase)) < 1e-9
        solution = solve(
            case,
            symmetric_schedule(case.friction_limit > 0),
            [branch.phase, branch.impulse / case.scale.impulse],
        )
        assert isinstance(solution, Solution)
        got = motion_of(solution).state_at(float(solution.phases[0]) + 1e-13)
        assert np.allclose(got[:n], state[:n], rtol=0, atol=1e-9 * case.gap)
        assert np.allclose(
            got[n:], state[n:], rtol=0, atol=1e-8 * case.gap * float(np.max(case.model.omega))
        )
        # by saltation matrices
        stability = stability_of(motion_of(solution))
        multipliers = truth.half_multipliers(phase, state)
        largest = max(1.0, float(np.max(np.abs(multipliers))))
        assert stability.half
        assert matched(stability.multipliers, multipliers) < 1e-8 * largest
        assert matched(stability.full, multipliers**2) < 1e-7 * largest**2


@pytest.mark.parametrize("case", CASES)
def test_greens_function_finds_the_closed_form_again(case: Case) -> None:
    """From the closed form's phase alone, and over a whole period without the symmetry."""
    friction = case.friction_limit > 0
    for branch in closed_form(case):
        if not branch.pushes:
            continue
        half = solve(case, symmetric_schedule(friction), [branch.phase + 1e-4])
        whole = solve(
            case, flying_schedule([-1, 1], friction), [branch.phase, branch.phase + np.pi]
        )
        assert isinstance(half, Solution)
        assert isinstance(whole, Solution)
        for solution in (half, whole):
            assert solution.impulses[0] == pytest.approx(branch.impulse, rel=1e-10)
            assert abs(np.exp(1j * solution.phases[0]) - np.exp(1j * branch.phase)) < 1e-10
        assert whole.impulses[1] == pytest.approx(-branch.impulse, rel=1e-10)
        assert abs(whole.offset) < 1e-10 * case.gap


@pytest.mark.parametrize("excess", [0.0, 1e-12, -1e-12, 1e-9, -1e-7, 1e-6, -1.2e-5, 1e-4])
def test_orbits_and_runs_have_one_response_near_critical_damping(excess: float) -> None:
    """Orbits and runs have the same response close to critical damping.

    The response to an impulse, exp(-D w t) sinh(r t)/r with r^2 = w^2 (D^2 - 1), has 40 digits. It
    is compared with that of the orbits' exponentials and of the regimes' slots.
    """
    omega = 31.0
    model = ModalModel([omega], [1.0 + excess], [0.8], [1.1], 1.4)
    structure = make_structure(model, 0.02)
    slots = solve_own_modes(model, np.array([0]))
    times = np.linspace(0.0, 0.3, 7)
    with mpmath.workdps(40):
        ratio = mpmath.mpf(1.0 + excess)
        rate = omega * mpmath.sqrt(ratio**2 - 1)
        truth = [
            float(
                mpmath.re(
                    mpmath.exp(-ratio * omega * t) * t * mpmath.hyp0f1(1.5, (rate * t) ** 2 / 4)
                )
            )
            for t in map(mpmath.mpf, times.tolist())
        ]
    turning = np.exp(structure.s * times[:, None])
    orbits = np.sum(structure.weight * turning, axis=1).real
    runs = (np.exp(slots.values * times[:, None]) @ (slots.tip * slots.relative)).real
    np.testing.assert_allclose(orbits, truth, rtol=0, atol=2e-13 / omega)
    np.testing.assert_allclose(runs, -(1.1**2) * np.array(truth), rtol=0, atol=4e-13 / omega)


SCHEDULES = [
    flying_schedule([-1], True, symmetric=True),
    flying_schedule([-1, 0, 0], True, symmetric=True, period_multiple=3),
    flying_schedule([-1, 0, 0, 1, 0, 0], True),
    flying_schedule([1, 0, 1, -1, 1, -1], True, period_multiple=2),
]


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_the_jacobian_is_the_derivative_of_the_conditions(schedule: EventSchedule) -> None:
    rng = np.random.default_rng(3)
    case = CASES[4].changed(restitution=0.6)
    n = len(schedule.events)
    z = np.concatenate(
        [np.sort(rng.uniform(0, schedule.turn, n)), rng.normal(size=schedule.unknowns - n)]
    )
    _, jacobian = residual_and_jacobian(case, schedule, z)
    for k in range(len(z)):
        step = 1e-6 * np.eye(len(z))[k]
        slope = (
            residual_and_jacobian(case, schedule, z + step)[0]
            - residual_and_jacobian(case, schedule, z - step)[0]
        ) / 2e-6
        assert np.allclose(jacobian[:, k], slope, rtol=1e-6, atol=1e-6)
    for name, unit in (
        ("omega", case.omega),
        ("force", 1.0),
        ("gap", case.gap),
        ("restitution", 1.0),
        ("friction_limit", 0.05),
    ):
        conditions = Conditions(case, schedule, name)
        value = getattr(case, name)
        step = 1e-6 * unit
        slope = (conditions(z, value + step)[0] - conditions(z, value - step)[0]) / (2 * step)
        assert np.allclose(
            conditions(z, value)[1][:, -1] * unit, slope * unit, rtol=1e-6, atol=1e-6
        )


@pytest.mark.parametrize("case", CASES[2:5])
def test_scaling_gap_friction_and_force_scales_the_orbit(case: Case) -> None:
    factor = 3.7
    scaled = case.changed(
        gap=factor * case.gap,
        friction_limit=factor * case.friction_limit,
        force=factor * case.force,
    )
    for one, other in zip(closed_form(case), closed_form(scaled), strict=True):
        assert other.impulse == pytest.approx(factor * one.impulse, rel=1e-12)
        assert other.phase == pytest.approx(one.phase, rel=1e-12)
    omegas = case.omega * np.linspace(0.9, 1.1, 5)
    assert np.allclose(fold_force(scaled, omegas), factor * fold_force(case, omegas), rtol=1e-12)


def test_the_level_set_of_the_fold_force_has_the_folds_and_its_valleys_the_births() -> None:
    """The level set of the fold force has the folds, and its valleys the births.

    At a fold both branches meet. Below a birth's force there is no orbit close to it, and above a
    merger's force no gap.
    """
    case = CASES[0]
    for omega in closed_folds(case, 0.85, 1.2):
        assert fold_force(case, [omega])[0] == pytest.approx(case.force, rel=1e-12)
        small, large = closed_form(case.changed(omega=omega, force=case.force * (1 + 1e-9)))
        assert large.impulse - small.impulse < 1e-3 * large.impulse
        assert fold_impulse(case.changed(omega=omega)) > 0
    for kind, force, omega in find_level_places(case, 0.85, 1.2):
        neighbours = fold_force(case, omega * np.array([1 - 1e-3, 1 + 1e-3]))
        assert np.all(neighbours > force) if kind == BIRTH else np.all(neighbours < force)
    assert [kind for kind, _, _ in find_level_places(case, 0.85, 1.2)] == [BIRTH, MERGER, BIRTH]


@pytest.mark.parametrize("case", CASES[:3])
def test_the_slope_of_a_fold_is_that_of_the_fold_force_of_dense_matrices(case: Case) -> None:
    force = Truth(case).fold_force()
    near = case.changed(force=1.0001 * force)
    large = closed_form(near)[-1]
    schedule = symmetric_schedule(case.friction_limit > 0)
    solution = solve(near, schedule, [large.phase, large.impulse / near.scale.impulse])
    assert isinstance(solution, Solution)
    fold = find_fold(solution, "force")
    assert isinstance(fold, Fold)
    assert fold.case.force == pytest.approx(force, rel=1e-9)
    step = 1e-5 * case.omega
    low, high = (Truth(case.changed(omega=case.omega + d)).fold_force() for d in (-step, step))
    assert fold.slope == pytest.approx((high - low) / (2 * step), rel=1e-5)


def test_below_the_fold_force_no_orbit_exists_and_newton_reports_it() -> None:
    case = CASES[0]
    low = case.changed(force=0.9 * float(fold_force(case, [case.omega])[0]))
    assert closed_form(low) == ()
    solution = solve(low, symmetric_schedule(False), [1.0])
    assert isinstance(solution, NoOrbit)
    assert solution.reason


def test_a_light_absorber_leaves_the_linear_response() -> None:
    model = model_of(3)
    case = Case(model, 1.02 * float(model.omega[0]), 2.0, mass_ratio=1e-9)
    below = model.omega**2 - case.omega**2 + 2j * model.damping_ratio * model.omega * case.omega
    linear = case.force * abs(np.sum(model.tip_shape * model.force_shape / below))
    for branch in closed_form(case):
        solution = solve(
            case, symmetric_schedule(False), [branch.phase, branch.impulse / case.scale.impulse]
        )
        assert isinstance(solution, Solution)
        motion = motion_of(solution)
        assert motion.tip_max == pytest.approx(linear, rel=1e-6)
        assert motion.tip_rms == pytest.approx(linear / np.sqrt(2), rel=1e-6)
