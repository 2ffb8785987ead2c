"""Harmonic balance is correct.

It is compared with scipy's integration in time, the exact method, a closed form, linear limits and
exact orbits.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.integrate
from core import ALL
from orbit_cases import model_of

from impact_env.drive import Drive, constant_frequency
from impact_env.frequency import tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    SlidingAbsorber,
    StuckAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.periodic.balance_branches import frequency_problem, start_of_orbit
from impact_env.periodic.case import case_of
from impact_env.periodic.contact import ContactForce, elastic_coulomb_force
from impact_env.periodic.continuation import Steps, follow_both_ways
from impact_env.periodic.harmonic_balance import (
    FORCE_PARAMETER,
    OMEGA_PARAMETER,
    PAPER_DAMPER,
    Balance,
    HarmonicResponse,
    harmonic_balance,
    hill_multipliers,
)
from impact_env.periodic.survey import closed_form_orbits
from impact_env.periodic.symmetric import closed_form
from impact_env.periodic.trigonometric import basis, find_roots, negative, share, values, window
from impact_env.results import Window
from impact_env.scene import InitialState, Scene
from impact_env.sweep import simulate

Array = np.ndarray
BEAM = model_of(3)
OTHER = ModalModel(
    np.array([40.0, 95.0]),
    np.array([0.02, 0.005]),
    np.array([0.5, -0.2]),
    np.array([0.9, 0.7]),
    3.0,
)
COMPLIANT = SlidingAbsorber(0.02, CompliantWalls(5e4), ElasticCoulombFriction(0.3, 1e4))
RUBBING = Scene(BEAM, impact_absorber(friction_limit=0.01))


def at_orbit(scene: Scene, balance: Balance) -> Array:
    """Return the solution next to the larger exact orbit."""
    large = closed_form(case_of(scene, balance.force, balance.omega))[-1]
    return balance.solved(start_of_orbit(balance, large.impulse, large.phase))


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize(
    "absorber",
    [impact_absorber(), impact_absorber(friction_limit=0.05), friction_damper(0.5), COMPLIANT],
)
def test_the_jacobian_is_the_derivative(absorber: SlidingAbsorber, symmetric: bool) -> None:
    omega = 0.95 * BEAM.omega[0]
    balance = harmonic_balance(
        Scene(BEAM, absorber), omega, 1.5, 5, symmetric=symmetric, grounded_damper=PAPER_DAMPER
    )
    z = (
        np.random.default_rng(1).normal(size=len(balance.indices))
        * 1e-3
        / (1 + np.arange(len(balance.indices)) % 5)
    )
    law = [name for name, value in vars(balance.law).items() if value is not None]
    for name in (OMEGA_PARAMETER, FORCE_PARAMETER, *law):
        at = getattr(balance.law if name in law else balance, name)
        residual = balance.residual(name)
        jacobian = residual(z, at)[1]
        steps = 1e-9 * np.eye(len(z))
        by_z = np.array(
            [(residual(z + step, at)[0] - residual(z - step, at)[0]) / 2e-9 for step in steps]
        ).T
        by_parameter = (residual(z, at * (1 + 1e-6))[0] - residual(z, at * (1 - 1e-6))[0]) / (
            2e-6 * at
        )
        assert jacobian[:, :-1] == pytest.approx(by_z, abs=1e-7 * np.max(np.abs(by_z)))
        assert jacobian[:, -1] == pytest.approx(
            by_parameter, abs=1e-4 * np.max(np.abs(by_parameter)) + 1e-12
        )


# Oscillators x'' + 0.1 x' + x = force cos(omega t) - pull(x): the tip of one mode; its absorber is
# so heavy that it stays where it is.

OSCILLATOR = ModalModel([1.0], [0.05], [1.0], [1.0], 1.0)
HEAVY = 1e9


@dataclass(frozen=True)
class HardeningSpring:
    """The absorber's force is -r^3/2; so many samples of it have its harmonics without error."""

    def contact(self, motion: Array, dynamic: Array, omega: float, parameter: str) -> ContactForce:  # noqa: ARG002
        n = len(motion)
        rows = np.array([basis(angle, n // 2) for angle in np.arange(4 * n) * 2 * np.pi / (4 * n)])
        back = np.linalg.pinv(rows)
        r = rows @ motion
        zero = np.zeros((n, n))
        return ContactForce(
            -back @ r**3 / 2, -back @ (1.5 * r[:, None] ** 2 * rows), zero, zero[0], zero[0], zero
        )


def assert_integrated(
    response: HarmonicResponse,
    pull: Callable[[float], float],
    omega: float,
    force: float,
    close: float,
) -> None:
    """Settled by DOP853 from a response's own start: half of peak to peak and RMS of a period."""

    def rate(t: float, y: Array) -> list[float]:
        return [y[1], force * np.cos(omega * t) - 0.1 * y[1] - y[0] - pull(y[0])]

    turn = 2 * np.pi / omega
    orders = np.arange(len(response.tip))
    times = turn * np.append(0, np.linspace(99, 100, 4001))
    start = [np.sum(response.tip).real, np.sum(1j * omega * orders * response.tip).real]
    x = scipy.integrate.solve_ivp(
        rate, (0, times[-1]), start, "DOP853", times, rtol=1e-11, atol=1e-13, max_step=turn / 40
    ).y[0, 1:]
    assert response.tip_amplitude == pytest.approx(np.ptp(x) / 2, rel=close)
    assert response.tip_rms == pytest.approx(np.sqrt(np.mean(x[:-1] ** 2)), rel=close)


def test_both_branches_of_a_duffing_oscillator_are_what_integration_settles_to() -> None:
    first = replace(
        harmonic_balance(Scene(OSCILLATOR, impact_absorber(mass_ratio=HEAVY)), 0.5, 0.4, 15),
        law=HardeningSpring(),
    )
    branch = follow_both_ways(
        frequency_problem(first, 0.3, 3.0), first.solved(first.free()), 0.5, Steps(most=0.05)
    )
    upper, lower = sorted((fold.parameter for fold in branch.of("fold")), reverse=True)
    assert lower < 1.6 < upper
    crossings = [
        z
        for z, (p, q) in zip(branch.points, pairwise(branch.parameters), strict=False)
        if (p - 1.6) * (q - 1.6) < 0
    ]
    assert len(crossings) == 3
    at = first.at(OMEGA_PARAMETER, 1.6)
    for z in (crossings[0], crossings[2]):  # the middle one is unstable: integration leaves it
        assert_integrated(at.response(at.solved(z)), lambda x: 0.5 * x**3, 1.6, 0.4, 1e-6)


@pytest.mark.parametrize(("harmonics", "close"), [(15, 3e-5), (39, 2e-6)])
def test_an_oscillator_between_springs_is_what_integration_settles_to(
    harmonics: int, close: float
) -> None:
    scene = Scene(OSCILLATOR, SlidingAbsorber(HEAVY, CompliantWalls(4.0, 0.6)))
    balance = harmonic_balance(scene, 1.3, 0.5, harmonics)
    assert_integrated(
        balance.response(balance.solved(balance.free())),
        lambda x: 4 * (max(0, x - 0.6) - max(0, -0.6 - x)),
        1.3,
        0.5,
        close,
    )


@pytest.mark.parametrize("ratio", [0.9, 0.97])
def test_elastic_friction_is_what_the_exact_method_settles_to(ratio: float) -> None:
    scene = Scene(
        modal_model(Beam(modes=1, damping_ratio=0.05)),
        SlidingAbsorber(friction=ElasticCoulombFriction(0.2, 1e4)),
    )
    omega = ratio * float(scene.model.omega[0])
    force = 5.0
    periods = 100
    last = Window(*(2 * np.pi / omega * np.array([periods - 1, periods])))
    response = simulate(
        scene,
        Drive(force, constant_frequency(omega, 1.0, periods)),
        record=replace(ALL, samples_per_period=1024, series=last),
    )
    assert 0.01 < response.stuck_time / (periods * 2 * np.pi / omega) < 0.9
    tip = response.history.tip_displacement
    balance = harmonic_balance(scene, omega, force, 41)
    balanced = balance.response(balance.solved(balance.free()))
    assert balanced.tip_amplitude == pytest.approx(np.ptp(tip) / 2, rel=1e-5)
    assert balanced.tip_rms == pytest.approx(np.sqrt(np.mean(tip[:-1] ** 2)), rel=1e-5)


def test_rigid_friction_oscillator_is_den_hartogs_closed_form() -> None:
    """A rigid friction oscillator agrees with Den Hartog's closed form.

    It has Coulomb friction to ground, no other damping, and slides continuously: Den Hartog,
    Transactions of ASME 53 (1931).

    Amplitude / (F/k) = sqrt(V^2 - (limit/F U)^2), V = 1/(1 - w^2), U = sin(pi/w)/(w (1 +
    cos(pi/w))).
    """
    omega = 0.7
    force = 1.0
    limit = 0.3
    v = 1 / (1 - omega**2)
    u = np.sin(np.pi / omega) / (omega * (1 + np.cos(np.pi / omega)))
    exact = np.sqrt(v**2 - (limit / force * u) ** 2)
    # an absorber that stays where it is
    scene = Scene(ModalModel([1.0], [0.0], [1.0], [1.0], 1.0), friction_damper(limit, 1e9))
    errors = []
    for h in (11, 41, 161):
        balance = harmonic_balance(scene, omega, force, h, friction_weight=1e-9 * h)
        errors.append(
            abs(balance.response(balance.solved(balance.free())).tip_amplitude / exact - 1)
        )
    assert (
        errors[2] < errors[1] / 3 < errors[0] / 9
    )  # as 1/H: the truncated velocity turns too early or too late
    assert errors[2] < 5e-4


@pytest.mark.parametrize("model", [BEAM, OTHER])
def test_linear_limits(model: ModalModel) -> None:
    """Walls out of reach: the beam alone. Friction that nothing overcomes: a stuck mass."""
    for ratio in (0.8, 1.0, 1.3):
        omega = ratio * model.omega[0]
        far = harmonic_balance(Scene(model, impact_absorber(gap=10.0)), omega, 1.0, 7)
        assert far.response(far.solved(far.free())).tip_amplitude == pytest.approx(
            abs(tip_response(model, None, omega)), rel=1e-11
        )
        stuck = harmonic_balance(Scene(model, friction_damper(50.0)), omega, 1.0, 7)
        response = stuck.response(stuck.solved(0 * stuck.free()))
        assert response.tip_amplitude == pytest.approx(
            abs(tip_response(model, StuckAbsorber(), omega)), rel=1e-9
        )


@pytest.mark.parametrize(("weight", "left"), [(50.0, 0.913), (200.0, 0.929)])
def test_the_papers_isola_is_closed_and_depends_on_the_weight(weight: float, left: float) -> None:
    """The paper's isola is closed and depends on the weight.

    3 modes, 0.01 N, 1.5 N, H = 20: the exact orbit's folds are at 0.93361 and 0.95528, its peak is
    1.4743 mm.
    """
    first = BEAM.omega[0]
    omega = 0.945 * BEAM.omega[0]
    balance = harmonic_balance(RUBBING, omega, 1.5, weight=weight)
    branch = follow_both_ways(
        frequency_problem(balance, 0.8 * first, 1.2 * first),
        at_orbit(RUBBING, balance),
        omega,
        Steps(first=0.02, most=0.2),
    )
    assert branch.closed
    folds = sorted(fold.parameter / first for fold in branch.of("fold"))
    assert folds == [pytest.approx(left, abs=6e-4), pytest.approx(0.954, abs=2e-4)]
    peak = max(
        balance.at(OMEGA_PARAMETER, p).response(z).tip_amplitude
        for z, p in zip(branch.points, branch.parameters, strict=True)
    )
    assert 1.07 < peak / 1.4743e-3 < 1.125


@pytest.mark.parametrize(
    ("model", "ratio", "force", "gap"), [(BEAM, 0.95, 1.5, 1e-3), (OTHER, 0.94, 0.6, 2e-3)]
)
def test_it_converges_to_the_exact_orbit_if_the_weight_grows_with_the_square_of_the_harmonics(
    model: ModalModel, ratio: float, force: float, gap: float
) -> None:
    scene = Scene(model, impact_absorber(gap))
    omega = ratio * float(model.omega[0])
    errors = []
    level = closed_form_orbits(case_of(scene, force, omega)).orbits[0].motion.tip_max
    for h in (10, 20, 40, 60):
        balance = harmonic_balance(scene, omega, force, h, weight=100 * (h / 20) ** 2)
        errors.append(abs(balance.response(at_orbit(scene, balance)).tip_amplitude / level - 1))
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[3] < 0.4 * errors[1]


def test_all_harmonics_and_a_longer_period_give_the_symmetric_orbit_again() -> None:
    omega = 0.95 * BEAM.omega[0]
    odd = harmonic_balance(RUBBING, omega, 1.5, 15)
    solution = odd.polynomial(at_orbit(RUBBING, odd))
    every = harmonic_balance(RUBBING, omega, 1.5, 15, symmetric=False)
    assert every.polynomial(every.solved(solution)) == pytest.approx(solution, abs=1e-12)
    longer = harmonic_balance(RUBBING, omega, 1.5, 45, multiple=3)
    row = np.zeros(91)
    row[3:46:3] = solution[1:16]
    row[48::3] = solution[16:]
    assert np.max(np.abs(longer.evaluated(row[longer.indices], OMEGA_PARAMETER)[0])) < 1e-10 * 1.5


def in_order(values: Array) -> Array:
    return np.array(sorted(values.tolist(), key=lambda value: (round(value.imag, 3), value.real)))


@pytest.mark.parametrize("which", [0, 1])
def test_orbits_between_springs_and_hills_multipliers_are_those_of_the_exact_method(
    which: int,
) -> None:
    """Orbits between springs and Hill's multipliers agree with the exact method.

    With springs as walls, the exact method returns to the orbit. Differences around the orbit give
    the multipliers, for a positive and a negative pair.
    """
    model = model_of(1)
    first = float(model.omega[0])
    mass = 0.02 * model.beam_mass
    omega = 0.95 * first
    rigid = Scene(model, impact_absorber())
    scene = Scene(model, SlidingAbsorber(0.02, CompliantWalls(200 * mass * first**2, 1e-3)))
    orbit = [own for own in closed_form(case_of(rigid, 3.0, omega)) if own.pushes][which]
    at_walls = harmonic_balance(rigid, omega, 3.0, 40, 200.0)
    balance = harmonic_balance(scene, omega, 3.0, 40)
    z = balance.solved(at_walls.solved(start_of_orbit(at_walls, orbit.impulse, orbit.phase)))
    unit = 1e-3 * np.array([1, 1, omega, omega])
    k = np.arange(41)
    response = balance.response(z)
    moves = np.exp(1j * k) * np.array(
        [response.tip / model.tip_shape[0], response.tip + response.relative]
    )  # at a phase in free flight

    def mapped(x: Array) -> Array:
        run = simulate(
            scene,
            Drive(3.0, constant_frequency(omega, 1.0, 0.5), 1.0),
            initial=InitialState(x[:1], x[2:3], float(x[1]), float(x[3])),
        )
        return -run.end_state / unit

    def slopes(x: Array) -> Array:
        return np.array(
            [(mapped(x + step) - mapped(x - step)) / 2e-5 for step in 1e-5 * np.diag(unit)]
        ).T

    start = np.concatenate([moves.sum(axis=1).real, (1j * k * omega * moves).sum(axis=1).real])
    x = start.copy()
    for _ in range(3):
        x -= unit * np.linalg.solve(slopes(x) - np.eye(4), mapped(x) - x / unit)
    assert mapped(x) == pytest.approx(x / unit, abs=1e-9)
    assert x[:2] / unit[:2] == pytest.approx(start[:2] / unit[:2], abs=1e-3)
    multipliers = hill_multipliers(balance, z)
    assert in_order(multipliers) == pytest.approx(
        in_order(np.linalg.eigvals(slopes(x))), rel=0.01, abs=0.005
    )
    every = harmonic_balance(scene, omega, 3.0, 40, symmetric=False)
    assert in_order(hill_multipliers(every, balance.polynomial(z))) == pytest.approx(
        in_order(multipliers**2), abs=1e-6
    )


# Trigonometric polynomials: roots against companion matrices, windows and hysteresis against dense
# quadrature.


def _rows(seed: int, h: int, count: int = 4) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 2 * h + 1)) / (
        1 + np.append(0, np.tile(np.arange(h), 2))
    )


def _companion_roots(row: Array) -> Array:
    h = (len(row) - 1) // 2
    half = (row[1 : h + 1] - 1j * row[h + 1 :]) / 2
    z = np.roots(np.concatenate([half[::-1], [row[0]], np.conj(half)]))
    return np.sort(np.angle(z[np.abs(np.abs(z) - 1) < 1e-8]) % (2 * np.pi))


@pytest.mark.parametrize("h", [1, 7, 45])
def test_roots_are_those_of_the_companion_matrix(h: int) -> None:
    rows = _rows(h, h)
    for row, roots in zip(rows, find_roots(rows), strict=True):
        assert roots == pytest.approx(_companion_roots(row), abs=1e-10)


@pytest.mark.parametrize("depth", [1e-2, 1e-5, 1e-9, 1e-12])
def test_two_roots_close_to_one_another_are_not_missed(depth: float) -> None:
    """Two roots close to one another are not missed.

    Cos(5 (angle - 0.3)) + 1 - depth is below zero by at most depth: it has five pairs of roots that
    can be arbitrarily close.
    """
    row = np.zeros(2 * 20 + 1)
    row[0] = 1 - depth
    row[5] = np.cos(1.5)
    row[25] = np.sin(1.5)
    (roots,) = find_roots(row[None])
    half = np.arccos(1 - depth) / 5
    middle = 0.3 + np.pi / 5 * np.arange(1, 10, 2)
    assert roots == pytest.approx(
        np.sort(np.concatenate([middle - half, middle + half]) % (2 * np.pi)),
        abs=max(1e-12, 1e-15 / half),
    )
    row[0] = 1 + depth
    assert len(find_roots(row[None])[0]) == 0


def _dense(row: Array, points: int = 100_000) -> tuple[Array, Array]:
    angle = (np.arange(points) + 0.5) * 2 * np.pi / points
    return angle, values(row[None], np.zeros(points, dtype=int), angle)[0]


def _coefficients(angle: Array, x: Array, h: int) -> Array:
    cosine = [2 * np.mean(x * np.cos(k * angle)) for k in range(1, h + 1)]
    return np.array(
        [np.mean(x), *cosine, *(2 * np.mean(x * np.sin(k * angle)) for k in range(1, h + 1))]
    )


def test_window_is_the_closed_form_of_a_cut_polynomial() -> None:
    h = 6
    for row in _rows(11, h, 3):
        intervals = negative(row, find_roots(row[None])[0])
        angle, x = _dense(row)
        matrix = window(intervals, h)
        assert matrix @ row == pytest.approx(_coefficients(angle, np.minimum(x, 0), h), abs=1e-7)
        assert share(intervals, h) == pytest.approx(matrix[:, 0], abs=1e-15)
    assert window(np.array([[0.0, 2 * np.pi]]), h) == pytest.approx(np.eye(2 * h + 1), abs=1e-14)
    assert np.all(window(np.empty((0, 2)), h) == 0)


def _jenkins(x: Array, limit: float, stiffness: float) -> Array:
    """A Jenkins element gone through sample by sample, three times round."""
    force = 0.0
    last = x[-1]
    out = np.empty(len(x))
    for _ in range(3):
        for i, now in enumerate(x):
            force = min(limit, max(-limit, force - stiffness * (now - last)))
            last = now
            out[i] = force
    return out


@pytest.mark.parametrize(("limit", "stiffness"), [(0.3, 1.0), (1.2, 2.0), (0.05, 4.0)])
def test_elastic_coulomb_is_what_a_slider_does(limit: float, stiffness: float) -> None:
    h = 5
    for row in _rows(5, h, 2):
        angle, x = _dense(row, 20_000)
        force = elastic_coulomb_force(row, limit, stiffness)
        assert force.force == pytest.approx(
            _coefficients(angle, _jenkins(x, limit, stiffness), h), abs=5e-4 * limit
        )
