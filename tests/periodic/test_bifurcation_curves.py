"""Bifurcations over two parameters: by multipliers of the dense reference, which shares no code, by the closed form, and by births and mergers."""

from functools import cache

import numpy as np
import pytest
from support.orbit_cases import high_orbit, model_of, multipliers_by_reference, steel

from impact_env.parameters import ParameterError
from impact_env.periodic.bifurcation_curves import KINDS, RESONANCE, BifurcationCurve, bifurcation_curve, bifurcation_curves, compound
from impact_env.periodic.branch import FOLD
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import thresholds
from impact_env.periodic.motion import motion_of
from impact_env.periodic.offspring import descendants
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import GRAZING, PERIOD_DOUBLING, PULLING, SYMMETRY_BREAKING, TORUS, OrbitBranch, orbit_branch, orbit_branches
from impact_env.periodic.plain_orbits import orbit_of, unpacked
from impact_env.periodic.symmetric import closed_folds

FIRST = float(model_of(1).omega[0])
RANGE = (0.85 * FIRST, FIRST)


@cache
def one_mode() -> dict[str, list[BifurcationCurve]]:
    """N_m = 1, e = 0.8, from 1.5 N to forces of 1 to 2.5 N: of the symmetric orbits, and of the pair that leaves them."""
    symmetric = list(orbit_branches(Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.8), *RANGE))
    pairs = [found for found in descendants(symmetric, RANGE, longest=1) if isinstance(found, OrbitBranch)]
    curves = list(bifurcation_curves([*symmetric, *pairs], KINDS[:3], "force", (1.0, 2.5), RANGE))
    return {kind: [curve for curve in curves if curve.kind == kind] for kind in KINDS}


@cache
def torus() -> BifurcationCurve:
    case = steel()
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.95 * first, 0.957 * first))
    return bifurcation_curve(branch.of(TORUS)[0].solution, TORUS, "force", (0.1, 0.6), (0.9 * first, 1.1 * first))


@pytest.mark.parametrize(("kind", "target"), [(FOLD, 1), (SYMMETRY_BREAKING, -1), (PERIOD_DOUBLING, -1)])
def test_multipliers_of_an_own_propagation_are_on_the_circle_along_a_curve(kind: str, target: int) -> None:
    curve = one_mode()[kind][0]
    for k in np.linspace(0, len(curve.schedules) - 1, 5).astype(int)[1:-1]:
        values = multipliers_by_reference(motion_of(curve.solution(int(k))))
        assert np.min(np.abs(values - target)) < 1e-3
        assert curve.critical(int(k)) == pytest.approx(target, abs=1e-8)


def test_a_torus_over_the_force_has_a_pair_on_the_circle_and_ends_where_it_meets() -> None:
    curve = torus()
    for k in np.linspace(0, len(curve.schedules) - 1, 4).astype(int)[1:-1]:
        values = multipliers_by_reference(motion_of(curve.solution(int(k))))
        pair = values[np.argmin(np.abs(values - curve.critical(int(k))))]
        assert abs(pair) == pytest.approx(1, abs=2e-3)
        assert abs(pair.imag) > 0.1
    ends = [orbit for kind, orbit in curve.located if kind == RESONANCE]
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
    levels = thresholds(curve.case, 0.87, 0.99)
    assert len(turns) == len(levels) == 2
    for level in levels:
        assert min(abs(turn.force - level.force) for turn in turns) < 1e-8
    assert curve.branch.ended.endswith(PULLING)


def test_friction_changes_the_order_of_events_along_a_curve() -> None:
    """N_m = 3, muN = 0.01 N, e = 1: orders of events come and go, and birth and merger with their reversals are those of Newton's method."""
    model = model_of(3)
    first = float(model.omega[0])
    case = Case(model, 0.95 * first, 1.5, friction_limit=0.01)
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.93 * first, 0.96 * first))
    curves = list(bifurcation_curves([branch], (FOLD,), "force", (1.0, 3.0), (0.925 * first, first)))
    assert len(curves) < len(branch.of(FOLD)) == 3  # one through both ends of the isola, one through the fold where reversals set in
    curve = curves[0]
    assert len({schedule.reversals for schedule in curve.schedules}) > 1
    turns = [orbit.case.force for kind, orbit in curve.located if kind == FOLD]
    assert min(abs(turn - 1.22195527) for turn in turns) < 1e-6
    assert min(abs(turn - 2.37028402) for turn in turns) < 1e-6
    assert np.mean([isinstance(orbit, Orbit) for orbit in curve.orbits]) > 0.9


def test_behind_grazing_a_curve_is_no_orbits() -> None:
    (curve,) = one_mode()[FOLD][1:]
    grazing = next(orbit.case.force for kind, orbit in curve.located if kind == GRAZING)
    beyond = [(value, orbit) for value, orbit in zip(curve.branch.parameters, curve.orbits, strict=True) if value > grazing + 0.01]
    refused = [orbit for _, orbit in beyond if isinstance(orbit, NoOrbit)]
    assert refused
    assert all("passes a wall" in orbit.reason for orbit in refused)


def test_the_fold_of_a_pair_begins_on_the_curve_of_broken_symmetry() -> None:
    (curve,), (broken,) = one_mode()[FOLD][1:], one_mode()[SYMMETRY_BREAKING]
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
        entries = list(unpacked(plain["orbits"]))
        assert len(entries) == sum(told == "yes" for told in plain["orbit"])
        for entry in entries[:: len(entries) // 3]:
            orbit = orbit_of(entry)
            assert isinstance(orbit, Orbit)
            assert orbit.motion.tip_max == pytest.approx(entry["tip_max_m"], rel=1e-7)
            assert np.min(np.abs(orbit.stability.multipliers + 1)) < 1e-5


def test_each_curve_is_followed_once() -> None:
    found = one_mode()
    assert [len(found[kind]) for kind in (SYMMETRY_BREAKING, PERIOD_DOUBLING)] == [1, 1]  # one through both of its places on the branches
    start = found[FOLD][0].solution(0)
    for kind, parameter, word in ((GRAZING, "force", "kind"), (FOLD, "omega", "parameter")):
        with pytest.raises(ParameterError, match=word):
            bifurcation_curve(start, kind, parameter, (1.0, 2.0), RANGE)


@pytest.mark.parametrize(("parameter", "limits"), [("restitution", (0.7, 1.0)), ("gap", (8e-4, 1.2e-3))])
def test_a_curve_over_another_parameter_comes_to_its_limits(parameter: str, limits: tuple[float, float]) -> None:
    """Lengths over the gap depend on the force over the gap alone, so without friction the fold's frequency at gap g is that at 1 mm, 1.5 N / g."""
    start = high_orbit(Case(model_of(1), 0.94 * FIRST, 1.5, restitution=0.8)).solution
    curve = bifurcation_curve(orbit_branch(start, "omega", RANGE).of(FOLD)[-1].solution, FOLD, parameter, limits, RANGE)
    assert sorted(curve.branch.parameters[[0, -1]]) == pytest.approx(limits, rel=1e-12)
    assert all(isinstance(orbit, Orbit) for orbit in curve.orbits)
    for k in (0, len(curve.schedules) // 3, -1):
        case = curve.solution(k).case
        at = case if parameter == "restitution" else case.changed(gap=1e-3, force=case.force * 1e-3 / case.gap)
        known = np.array(closed_folds(at, case.omega_ratio - 0.01, case.omega_ratio + 0.01)) / FIRST
        assert np.min(np.abs(known - case.omega_ratio)) < 1e-8


def test_the_second_compound_has_the_products_of_eigenvalues() -> None:
    matrix = np.random.default_rng(5).normal(size=(5, 5))
    values = np.linalg.eigvals(matrix)
    products = np.outer(values, values)[np.triu_indices(5, 1)]
    found = np.linalg.eigvals(compound(matrix))
    for product in products:
        assert np.min(np.abs(found - product)) < 1e-10
