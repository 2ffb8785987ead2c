"""Normal forms and special points of known maps and of orbits are correct.

Those of orbits are compared with iterations of the exact method and with doubled orbits.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import scipy.linalg
from support.orbit_cases import high_orbit, model_of, paper_case, steel

from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.branch import FOLD
from impact_env.periodic.case import Case
from impact_env.periodic.codimension_two import (
    CHENCINER,
    CUSP,
    DOUBLE_TORUS,
    FLIP_TORUS,
    FOLD_FLIP,
    FOLD_TORUS,
    GENERALISED_FLIP,
    R1,
    R2,
    R3,
    R4,
    CriticalPoint,
    codimension_two_monitors,
    is_special,
)
from impact_env.periodic.continuation import ContinuationProblem, Steps, follow_branch
from impact_env.periodic.green import NoOrbit, read_unknowns, solve
from impact_env.periodic.motion import Motion, motion_of, stability_of
from impact_env.periodic.normal_forms import SUBCRITICAL, SUPERCRITICAL, MapForms
from impact_env.periodic.offspring import descendants
from impact_env.periodic.orbit_branches import OrbitBranch, orbit_branch, orbit_branches
from impact_env.periodic.orbit_map import critical_point_of
from impact_env.periodic.shooting import units_of
from impact_env.periodic.survey import closed_form_orbits
from impact_env.periodic.validation import iterate_map

Array = np.ndarray
FIRST = float(model_of(1).omega[0])
Polynomial = Callable[[Array], Array]


def forms_of(matrix: Array, second: Array | None = None, third: Array | None = None) -> MapForms:
    """Return the forms of a map with given second and third derivatives.

    Their tensors have the shapes (n, n, n) and (n, n, n, n).
    """
    n = len(matrix)
    b = np.zeros((n, n, n)) if second is None else second
    c = np.zeros((n, n, n, n)) if third is None else third
    return MapForms(
        np.asarray(matrix, dtype=float),
        lambda u, v: np.einsum("ijk,j,k->i", b, u, v),
        lambda u, v, w: np.einsum("ijkl,j,k,l->i", c, u, v, w),
    )


def henon(y: float, beta: float) -> MapForms:
    """Return the forms of (x, y) -> (y, alpha - beta x - y^2) at the fixed point x = y."""
    second = np.zeros((2, 2, 2))
    second[1, 1, 1] = -2
    return forms_of(np.array([[0, 1], [-beta, -2 * y]]), second)


def test_the_ricker_map_doubles_its_period_with_one_sixth() -> None:
    """The Ricker map doubles its period with the coefficient one sixth.

    X -> alpha x exp(-x) at alpha = e^2, x = 2: derivatives -1, 0 and 1 (Kuznetsov, example 4.1: c =
    1/6).
    """
    forms = forms_of(np.array([[-1.0]]), np.zeros((1, 1, 1)), np.ones((1, 1, 1, 1)))
    point = CriticalPoint(PERIOD_DOUBLING, forms)
    assert point.coefficient == pytest.approx(1 / 6, rel=1e-14)
    assert point.criticality == "supercritical"


@pytest.mark.parametrize("beta", [-0.3, 0.5])
def test_doubled_orbits_of_the_henon_map_lie_where_the_coefficient_puts_them(beta: float) -> None:
    """Doubled orbits of the Henon map agree with the coefficient.

    At y = (1 + beta)/2 a 2-cycle y = s +- d is born: s = (1 + beta)/2 and d^2 = alpha - 3 s^2
    exactly.
    """
    s = (1 + beta) / 2
    point = CriticalPoint(PERIOD_DOUBLING, henon(s, beta))
    excess = 1e-8
    y = -s + np.sqrt(s**2 + 3 * s**2 + excess)  # of the fixed point at alpha = 3 s^2 + excess
    trace = -2 * y
    multiplier = trace / 2 - np.sqrt(trace**2 / 4 - beta)
    amplitude = np.sqrt(excess) / abs(point.vectors.right[1])
    assert point.coefficient == pytest.approx((-1 - multiplier) / amplitude**2, rel=1e-6)
    assert point.criticality == "supercritical"


def test_fixed_points_near_a_fold_of_the_henon_map_have_the_multipliers_of_the_coefficient() -> (
    None
):
    """The multiplier at y = y_0 + w q_y is 1 + 2 b w."""
    beta = 0.3
    s = -(1 + beta) / 2
    point = CriticalPoint(FOLD, henon(s, beta))
    w = 1e-6
    trace = -2 * (s + w * point.vectors.right[1])
    root = np.sqrt(trace**2 / 4 - beta)
    multiplier = min(trace / 2 + root, trace / 2 - root, key=lambda m: abs(m - 1))
    assert point.coefficient == pytest.approx((multiplier - 1) / (2 * w), rel=1e-5)


def test_the_delayed_logistic_map_has_the_torus_that_its_iterations_come_to() -> None:
    """The torus of the delayed logistic map is that of its iterations.

    (x, y) -> (r x (1 - y), x) at r = 2: multipliers exp(+-i pi/3); Kuznetsov's q of example 4.2 has
    |q|^2 = 2 and a = -2.
    """
    second = np.zeros((2, 2, 2))
    second[0, 0, 1] = second[0, 1, 0] = -2
    point = CriticalPoint(TORUS, forms_of(np.array([[1.0, -1.0], [1.0, 0.0]]), second))
    assert point.multiplier == pytest.approx(np.exp(1j * np.pi / 3), rel=1e-12)
    assert point.coefficient == pytest.approx(-1, rel=1e-12)
    r = 2.002
    fixed = 1 - 1 / r
    modulus = np.sqrt(r * fixed)  # the determinant at the fixed point
    state = np.array([fixed + 1e-3, fixed])
    squares = []
    for k in range(40000):
        state = np.array([r * state[0] * (1 - state[1]), state[0]])
        if k >= 20000:
            squares.append(abs(np.vdot(point.vectors.left, state - fixed)) ** 2)
    assert np.mean(squares) == pytest.approx((modulus - 1) / -point.coefficient, rel=2e-2)


def located_on(
    kind: str, at: Callable[[float], MapForms], low: float, high: float
) -> dict[str, list[float]]:
    """Return the special points on a curve of a map.

    The map is known in closed form over one parameter.
    """

    def point_at(z: Array, value: float) -> CriticalPoint:
        del z
        reference = np.ones(len(at(value).matrix)) if kind == FOLD else None
        return CriticalPoint(kind, at(value), reference)

    def residual(z: Array, _value: float) -> tuple[Array, Array]:
        return z, np.array([[1.0, 0.0]])

    problem = ContinuationProblem(
        residual, limits=(low, high), monitors=codimension_two_monitors(kind, point_at)
    )
    steps = Steps(first=0.02, least=1e-7, most=0.07, points=1000)
    branch = follow_branch(problem, np.zeros(1), low, 1.0, steps)
    result: dict[str, list[float]] = {}
    for event in branch.located:
        if is_special(point_at(event.point, event.parameter), event.kind):
            result.setdefault(event.kind, []).append(event.parameter)
    return result


def test_resonances_of_the_henon_map_are_at_their_places() -> None:
    """Resonances of the Henon map are at their known places.

    On beta = 1 the multipliers have the sum -2 y: R4 at 0, R3 at 1/2, R2 at 1, R1 at -1. On the
    other curves R2 and R1 are at beta = 1.
    """
    assert located_on(TORUS, lambda y: henon(y, 1.0), -0.97, 0.97) == {  # area-preserving: a = 0
        R4: [pytest.approx(0, abs=1e-9)],
        R3: [pytest.approx(0.5, abs=1e-9)],
    }
    assert located_on(TORUS, lambda y: henon(y, 1.0), 0.6, 1.2)[R2] == [pytest.approx(1, abs=1e-7)]
    assert located_on(TORUS, lambda y: henon(-y, 1.0), 0.6, 1.2)[R1] == [pytest.approx(1, abs=1e-7)]
    flip = located_on(PERIOD_DOUBLING, lambda beta: henon((1 + beta) / 2, beta), 0.2, 1.5)
    assert flip == {R2: [pytest.approx(1, abs=1e-9)]}
    fold = located_on(FOLD, lambda beta: henon(-(1 + beta) / 2, beta), 0.2, 1.5)
    assert fold == {R1: [pytest.approx(1, abs=1e-9)]}


def test_a_cusp_and_a_generalised_doubling_are_where_their_coefficients_vanish() -> None:
    """A cusp and a generalised doubling are where their coefficients vanish.

    X -> x + p_1 + p_2 x - x^3 has folds at p_2 = 3 x^2 with b = -3 x; X -> -x + s x^2 - x^3/4 has c
    = s^2 - 1/4.
    """

    def cubic(x: float) -> MapForms:
        return forms_of(np.array([[1.0]]), np.full((1, 1, 1), -6 * x), np.full((1, 1, 1, 1), -6.0))

    def flip(s: float) -> MapForms:
        return forms_of(np.array([[-1.0]]), np.full((1, 1, 1), 2 * s), np.full((1, 1, 1, 1), -1.5))

    assert located_on(FOLD, cubic, -1.0, 1.3) == {CUSP: [pytest.approx(0, abs=1e-9)]}
    places = located_on(PERIOD_DOUBLING, flip, -1.0, 1.3)
    assert places == {
        GENERALISED_FLIP: [pytest.approx(-0.5, abs=1e-9), pytest.approx(0.5, abs=1e-9)]
    }


def rotation(angle: float, radius: float = 1.0) -> Array:
    return radius * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_a_chenciner_point_is_where_the_cubic_term_of_a_rotation_changes_its_sign() -> None:
    """A Chenciner point is where the cubic term of a rotation changes its sign.

    The map is Z -> exp(i theta) z (1 + s |z|^2) in the plane. It is sheared so that q is not a unit
    vector of the axes.
    """
    third = np.zeros((2, 2, 2, 2))
    for i, j, k, m in np.ndindex(2, 2, 2, 2):  # of x |x|^2
        third[i, j, k, m] = 2 * ((i == j) * (k == m) + (i == k) * (j == m) + (i == m) * (j == k))
    turn = rotation(1.0)
    shear = np.array([[1.0, 0.7], [0.0, 1.5]])
    back = np.linalg.inv(shear)

    def at(s: float) -> MapForms:
        cubic = np.einsum("ai,ib,bjkl,jp,kq,lr->apqr", shear, turn, third, back, back, back)
        return forms_of(shear @ turn @ back, None, (s - 0.2) * cubic)

    assert located_on(TORUS, at, -0.9, 1.1) == {CHENCINER: [pytest.approx(0.2, abs=1e-9)]}


def test_a_second_critical_multiplier_gives_a_point_its_name() -> None:
    """A second critical multiplier determines the name of a point.

    Block maps have one multiplier, or a pair, that crosses the unit circle at 0.1. A real pair
    whose product is 1 gives no name.
    """

    def block(*parts: Array) -> MapForms:
        size = sum(len(part) for part in parts)
        matrix = np.zeros((size, size))
        first = 0
        for part in parts:
            matrix[first : first + len(part), first : first + len(part)] = part
            first += len(part)
        second = np.ones((size, size, size))
        return forms_of(matrix, second, np.ones((size,) * 4))

    def one(value: float) -> Array:
        return np.array([[value]])

    def other_labels(kind: str, at: Callable[[float], MapForms]) -> dict[str, list[float]]:
        own = (CUSP, GENERALISED_FLIP, CHENCINER)
        return {
            label: places
            for label, places in located_on(kind, at, -0.31, 0.42).items()
            if label not in own
        }

    here = [pytest.approx(0.1, abs=1e-7)]
    assert other_labels(FOLD, lambda s: block(one(1), one(-0.9 - s))) == {FOLD_FLIP: here}
    assert other_labels(PERIOD_DOUBLING, lambda s: block(one(-1), one(0.9 + s))) == {
        FOLD_FLIP: here
    }
    pair = [(FOLD, 1.0, FOLD_TORUS), (PERIOD_DOUBLING, -1.0, FLIP_TORUS)]
    for kind, side, label in pair:
        labels = other_labels(kind, lambda s, side=side: block(one(side), rotation(1.1, 0.9 + s)))
        assert labels == {label: here}
        real = other_labels(kind, lambda s, side=side: block(one(side), one(3), one((0.9 + s) / 3)))
        assert real == {}
    unit = rotation(0.7)
    assert other_labels(TORUS, lambda s: block(unit, one(0.9 + s))) == {FOLD_TORUS: here}
    assert other_labels(TORUS, lambda s: block(unit, one(-0.9 - s))) == {FLIP_TORUS: here}
    assert other_labels(TORUS, lambda s: block(unit, rotation(2.0, 0.9 + s))) == {
        DOUBLE_TORUS: here
    }


@cache
def steel_places(kind: str) -> list[Motion]:
    case = steel()
    limits = (0.953 * float(case.model.omega[0]), 0.959 * float(case.model.omega[0]))
    return list(orbit_branch(high_orbit(case).solution, "omega", limits).of(kind))


@cache
def one_mode_places(kind: str, period: int) -> list[Motion]:
    """Return the bifurcations of a kind of one mode with e = 0.8 at 1.5 N.

    They are those of the symmetric orbits, of the pair, and of its doubled orbits. ``period``
    selects the multiple of the force's period.
    """
    case = Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.8)
    limits = (0.85 * FIRST, FIRST)
    branches = list(orbit_branches(case, *limits))
    if kind != SYMMETRY_BREAKING:
        followed = descendants(branches, limits, longest=2)
        branches = [branch for branch in followed if isinstance(branch, OrbitBranch)]
    motions = [motion for branch in branches for motion in branch.of(kind)]
    return [each for each in motions if each.solution.schedule.period_multiple == period]


@cache
def three_mode_torus() -> Motion:
    """Return the torus of three modes at 0.92124.

    N_m = 3, e = 0.9, 3 N. All other multipliers are inside the unit circle.
    """
    case = paper_case(3, 0.921, 3.0, 0.9)
    for orbit in closed_form_orbits(case).orbits:
        limits = (0.919 * FIRST, 0.923 * FIRST)
        for motion in orbit_branch(orbit.solution, "omega", limits).of(TORUS):
            if np.sum(np.abs(stability_of(motion).multipliers) > 1 - 1e-9) == 2:
                return motion
    raise AssertionError("no such torus")


def neighbour(motion: Motion, share: float) -> Motion:
    """Return the orbit with the same events at a frequency that differs by a share."""
    solution = motion.solution
    case = solution.case.changed(omega=solution.case.omega * (1 + share))
    near = solve(case, solution.schedule, read_unknowns(solution))
    assert not isinstance(near, NoOrbit)
    return motion_of(near)


def own_derivative(motion: Motion) -> Array:
    """Return the derivative of the exact method's map by differences.

    The map starts in the middle of the longest flight. The derivative is in units of the gap.
    """
    units = units_of(motion.solution.case)
    start, state = motion.mid_flight()
    columns = []
    for k, step in enumerate(1e-6 * units):
        shift = step * np.eye(len(units))[k]
        ahead, back = (iterate_map(motion, start, state + side * shift) for side in (1, -1))
        columns.append((ahead - back) / units / 2e-6)
    return np.array(columns).T


def critical_pair(matrix: Array, target: complex) -> tuple[complex, Array, Array]:
    """Return the multiplier next to a target, and its eigenvectors.

    The right eigenvector has length 1, and the left one <p, q> = 1.
    """
    values, vectors = scipy.linalg.eig(matrix)
    k = int(np.argmin(np.abs(values - target)))
    right = vectors[:, k] / np.linalg.norm(vectors[:, k])
    values_left, left = scipy.linalg.eig(matrix.T)
    p = left[:, int(np.argmin(np.abs(values_left - values[k])))]
    return complex(values[k]), right, p / (p @ right)


@pytest.mark.parametrize(
    ("kind", "place_of", "criticality"),
    [
        (SYMMETRY_BREAKING, lambda: one_mode_places(SYMMETRY_BREAKING, 1)[1], SUPERCRITICAL),
        (SYMMETRY_BREAKING, lambda: steel_places(SYMMETRY_BREAKING)[0], SUBCRITICAL),
        (PERIOD_DOUBLING, lambda: one_mode_places(PERIOD_DOUBLING, 1)[1], SUPERCRITICAL),
        (PERIOD_DOUBLING, lambda: one_mode_places(PERIOD_DOUBLING, 2)[1], SUPERCRITICAL),
        (TORUS, lambda: steel_places(TORUS)[0], SUPERCRITICAL),
        (TORUS, three_mode_torus, SUBCRITICAL),
    ],
)
def test_what_leaves_a_bifurcation_has_the_side_and_the_size_of_its_coefficient(
    kind: str, place_of: Callable[[], Motion], criticality: str
) -> None:
    """Next to the bifurcation iterations of the exact method come to it or part at it."""
    place = place_of()
    point = critical_point_of(kind, place)
    assert point.criticality == criticality
    growth = 0.004 if criticality == SUPERCRITICAL else -0.004
    trial = 1e-5
    at, _, _ = critical_pair(own_derivative(neighbour(place, trial)), point.multiplier)
    motion = neighbour(place, trial * growth / (abs(at) - 1))
    multiplier, right, left = critical_pair(own_derivative(motion), point.multiplier)
    assert abs(multiplier) - 1 == pytest.approx(growth, rel=0.1)
    size = np.sqrt(abs((abs(multiplier) - 1) / point.coefficient))
    units = units_of(motion.solution.case)
    start, orbit = motion.mid_flight()

    def sizes(share: float, count: int) -> Array:
        shift = share * size * right
        state = orbit + units * (2 * shift.real if kind == TORUS else shift.real)
        result = []
        for _ in range(count):
            state = iterate_map(motion, start, state)
            result.append(abs(left @ ((state - orbit) / units)) ** 2)
        return np.array(result)

    if criticality == SUPERCRITICAL:
        assert np.mean(sizes(1.1, 500)[-100:]) == pytest.approx(size**2, rel=0.15)
        return
    for share, side in ((0.8, -1), (1.25, 1)):
        squares = sizes(share, round(0.6 / abs(growth)))
        quarter = len(squares) // 4
        assert side * np.log(np.mean(squares[-quarter:]) / np.mean(squares[:quarter])) > 0.1


def test_orbits_near_a_fold_have_the_multipliers_of_its_coefficient() -> None:
    """Two folds: the multiplier of an orbit that lies w q away from the fold is 1 + 2 b w."""
    case = Case(model_of(1), 0.9 * FIRST, 1.5, restitution=0.8)
    start = high_orbit(case.changed(omega=0.94 * FIRST)).solution
    symmetric = orbit_branch(start, "omega", (0.85 * FIRST, FIRST))
    pairs = list(descendants([symmetric], (0.85 * FIRST, FIRST), longest=1))
    for branch in (symmetric, *pairs):
        assert isinstance(branch, OrbitBranch)
        place = branch.of(FOLD)[0]
        phase = place.mid_flight()[0]
        point = critical_point_of(FOLD, place)
        z = read_unknowns(place.solution)
        event = next(e for e in branch.branch.located if e.kind == FOLD)
        k = event.after
        steps = []
        for side in (k, k + 1):
            other = branch.solution(side)
            start = z + 0.02 * (read_unknowns(other) - z)
            omega = place.solution.case.omega + 0.02**2 * (
                other.case.omega - place.solution.case.omega
            )
            solution = solve(place.solution.case.changed(omega=omega), other.schedule, start)
            assert not isinstance(solution, NoOrbit)
            motion = motion_of(solution)
            multiplier, _, _ = critical_pair(own_derivative(motion), 1.0)
            steps.append((multiplier.real, motion.state_at(phase) / units_of(solution.case)))
        _, _, left = critical_pair(own_derivative(place), 1.0)
        (above, first), (below, second) = steps
        apart = float((left @ (first - second)).real)
        assert abs((above - below) / (2 * apart)) == pytest.approx(abs(point.coefficient), rel=0.02)
