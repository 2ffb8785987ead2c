"""Harmonic balance against time integration, closed forms, linear limits and exact orbits."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
import scipy.integrate

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
from impact_env.periodic.balance_branches import start_of_orbit
from impact_env.periodic.case import case_of
from impact_env.periodic.contact import CompliantContact, Contact, RigidContact, elastic_coulomb
from impact_env.periodic.continuation import Problem, Steps, both_ways, continuation
from impact_env.periodic.harmonic_balance import FORCE, OMEGA, PAPER_DAMPER, Balance, Dynamics, harmonic_balance, hill_multipliers
from impact_env.periodic.symmetric import closed_form
from impact_env.periodic.trigonometric import basis, derivative, largest, negative, roots, share, values, window
from impact_env.scene import InitialState, Scene
from impact_env.sweep import simulate

# Oscillators on one coordinate for harmonic balance, and their steady motion by time integration: nothing is shared but the equations.


Array = np.ndarray
Rate = Callable[[float, Array], list[float]]


@dataclass(frozen=True)
class Oscillator:
    """x'' + 2 damping x' + x = drive + contact force: what the coordinate asks of the contact is its own dynamic force."""

    harmonics: int
    damping: float = 0.05
    multiple: int = 1

    def dynamics(self, omega: float) -> Dynamics:
        k = np.arange(self.harmonics + 1)
        drive = np.zeros(self.harmonics + 1, dtype=complex)
        drive[1] = -1.0
        stiffness = 1 - (k * omega) ** 2 + 2j * self.damping * k * omega
        return Dynamics(stiffness, drive, -2 * k**2 * omega + 2j * self.damping * k, 0 * drive)

    def tip(self, dynamic: Array, force: float, omega: float) -> Array:
        d = self.dynamics(omega)
        return (dynamic - force * d.drive) / d.stiffness


@dataclass(frozen=True)
class Cubic:
    """A hardening spring: contact force -strength x^3, its harmonics by convolution of Fourier coefficients."""

    strength: float

    def contact(self, motion: Array, dynamic: Array, omega: float, parameter: str) -> Contact:  # noqa: ARG002
        h, n = (len(motion) - 1) // 2, len(motion)

        def two_sided(row: Array) -> Array:
            half = (row[1 : h + 1] - 1j * row[h + 1 :]) / 2
            return np.concatenate([np.conj(half[::-1]), [row[0]], half])

        def one_sided(values: Array, middle: int) -> Array:
            half = 2 * values[middle + 1 : middle + 1 + h]
            return np.concatenate([[values[middle].real], half.real, -half.imag])

        x = two_sided(motion)
        square = np.convolve(x, x)
        force = -self.strength * one_sided(np.convolve(square, x), 3 * h)
        columns = [one_sided(np.convolve(square, two_sided(unit)), 3 * h) for unit in np.eye(n)]
        return Contact(force, -3 * self.strength * np.array(columns).T, np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros((n, n)))


def settled(rate: Rate, start: list[float], omega: float, periods: int) -> tuple[float, float, Array]:
    """Return half of peak to peak and RMS of the first coordinate in the last of many periods, and its state, by DOP853 at 1e-11."""
    turn = 2 * np.pi / omega
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": turn / 40}
    before = scipy.integrate.solve_ivp(rate, (0, periods * turn), start, **options)
    t = np.linspace(0, turn, 4001)
    x = scipy.integrate.solve_ivp(rate, (0, turn), before.y[:, -1], t_eval=t, **options).y[0]
    return float(np.ptp(x)) / 2, float(np.sqrt(np.mean(x[:-1] ** 2))), before.y[:, -1]


def elastic_friction_settled(omega: float, force: float, damping: float, limit: float, stiffness: float, periods: int) -> tuple[float, float]:
    """Return half of peak to peak and RMS of an oscillator on an elastic Coulomb joint: stretch by stretch, each ended by its event."""
    turn, t, now, state = 2 * np.pi / omega, 0.0, [0.0, 0.0, 0.0], "stick"
    times, values = [], []

    def rate(t: float, y: Array) -> list[float]:
        slope = -stiffness * y[1] if state == "stick" else 0.0
        return [y[1], force * np.cos(omega * t) - y[0] - 2 * damping * y[1] + y[2], slope]

    def at_limit(t: float, y: Array) -> float:  # noqa: ARG001
        return limit - abs(y[2])

    def turns(t: float, y: Array) -> float:  # noqa: ARG001
        return y[1] * -np.sign(y[2])  # falls to zero while it slides against the force

    at_limit.terminal, at_limit.direction = True, -1
    turns.terminal, turns.direction = True, -1
    while t < periods * turn:
        event = at_limit if state == "stick" else turns
        run = scipy.integrate.solve_ivp(
            rate, (t, periods * turn), now, events=event, method="DOP853", rtol=1e-11, atol=1e-13, max_step=turn / 60, dense_output=True
        )
        grid = np.linspace(run.t[0], run.t[-1], max(3, int(2000 * (run.t[-1] - run.t[0]) / turn)))
        times.append(grid)
        values.append(run.sol(grid)[0])
        t, now = float(run.t[-1]), [float(v) for v in run.y[:, -1]]
        if run.status == 1:
            if state == "stick":
                now[2] = limit * np.sign(now[2])
            else:
                now[1] = 0.0
            state = "slip" if state == "stick" else "stick"
    time, x = np.concatenate(times), np.concatenate(values)
    last = np.interp(np.linspace(periods - 1, periods, 20001) * turn, time, x)
    return float(np.ptp(last)) / 2, float(np.sqrt(np.mean(last[:-1] ** 2)))


def symmetric_orbit(model, mass: float, omega: float, force: float, gap: float, limit: float = 0.0) -> tuple[float, float, float]:
    """Return impulse (N s), phase of the force (rad) at the lower wall's impact, and half of peak to peak of the tip (m); larger impulse, e = 1.

    The two conditions at the impact, with all responses summed over 2e5 harmonics: a check of closed forms and of harmonic balance alike.
    """
    k = np.arange(1, 200001, 2)
    w = k * omega

    def receptance(a: Array, b: Array, w: Array) -> Array:
        return sum(x * y / (o**2 - w**2 + 2j * d * o * w) for x, y, o, d in zip(a, b, model.omega, model.damping_ratio, strict=True))

    tip = model.tip_shape
    own = receptance(tip, tip, w)
    relative = own - 1 / (mass * w**2)
    beat, square = 2 * omega / np.pi * np.ones_like(w), 4j * limit / (np.pi * k)  # impulses +1, -1 half a period apart; friction against the motion
    driven = force * complex(receptance(tip, model.force_shape, np.array(omega)))
    tail = 2 * omega / np.pi / mass * (np.pi**2 / 8 - np.sum(1.0 / k**2)) / omega**2  # of the absorber's own part, which falls as 1/k^2
    a, a0 = np.sum((relative * beat).real) - tail, np.sum((relative * square).real) + gap
    # velocity as the mean of both sides: the sum of its harmonics at the jump is just that
    b, b0 = np.sum((1j * w * relative * beat).real) / omega, np.sum((1j * w * relative * square).real) / omega
    p = np.max(np.roots([a * a + b * b, 2 * (a * a0 + b * b0), a0 * a0 + b0 * b0 - abs(driven) ** 2]).real)
    phase = float(np.angle(((a * p + a0) - 1j * (b * p + b0)) / driven))
    angle = np.linspace(0, 2 * np.pi, 40001)
    pushed = -own * (p * beat + square)
    x = (driven * np.exp(1j * (angle + phase))).real
    for part, order in zip(pushed[:300], k[:300], strict=True):
        x = x + (part * np.exp(1j * order * angle)).real
    return float(p), phase, float(np.ptp(x)) / 2


BEAM = modal_model(Beam(modes=3))
OTHER = ModalModel(np.array([40.0, 95.0]), np.array([0.02, 0.005]), np.array([0.5, -0.2]), np.array([0.9, 0.7]), 3.0)
COMPLIANT = SlidingAbsorber(0.02, CompliantWalls(5e4), ElasticCoulombFriction(0.3, 1e4))


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("absorber", [impact_absorber(), impact_absorber(friction_limit=0.05), friction_damper(0.5), COMPLIANT])
def test_the_jacobian_is_the_derivative(absorber: SlidingAbsorber, symmetric: bool) -> None:
    omega = 0.95 * BEAM.omega[0]
    balance = harmonic_balance(Scene(BEAM, absorber), omega, 1.5, 9, symmetric=symmetric, grounded_damper=PAPER_DAMPER)
    z = np.random.default_rng(1).normal(size=len(balance.kept)) * 1e-3 / (1 + np.arange(len(balance.kept)) % 9)
    law = [name for name, value in vars(balance.law).items() if value is not None]
    for name in (OMEGA, FORCE, *law):
        at = getattr(balance.law if name in law else balance, name)
        residual = balance.residual(name)
        jacobian = residual(z, at)[1]
        steps = 1e-9 * np.eye(len(z))
        by_z = np.array([(residual(z + step, at)[0] - residual(z - step, at)[0]) / 2e-9 for step in steps]).T
        by_parameter = (residual(z, at * (1 + 1e-6))[0] - residual(z, at * (1 - 1e-6))[0]) / (2e-6 * at)
        assert jacobian[:, :-1] == pytest.approx(by_z, abs=1e-7 * np.max(np.abs(by_z)))
        assert jacobian[:, -1] == pytest.approx(by_parameter, abs=1e-4 * np.max(np.abs(by_parameter)) + 1e-12)


def _duffing(omega: float) -> Balance:
    return Balance(Oscillator(15), Cubic(0.5), omega, 0.4)


def test_duffing_oscillator_on_both_branches_is_what_integration_gives() -> None:
    first = _duffing(0.5)
    problem = Problem(first.residual(OMEGA), OMEGA, limits=(0.3, 3.0))
    branch = continuation(problem, first.solved(first.free()), 0.5, 1.0, Steps(most=0.05))
    assert branch.ended == "limit"
    upper, lower = (fold.parameter for fold in branch.of("fold"))
    assert lower < 1.6 < upper

    def rate(t: float, y: Array, omega: float = 1.6) -> list[float]:
        return [y[1], 0.4 * np.cos(omega * t) - 0.1 * y[1] - y[0] - 0.5 * y[0] ** 3]

    at = _duffing(1.6)
    crossings = [z for z, (p, q) in zip(branch.points, pairwise(branch.parameters), strict=False) if (p - 1.6) * (q - 1.6) < 0]
    assert len(crossings) == 3
    for z in (crossings[0], crossings[2]):  # the middle one is unstable: integration leaves it
        solution = at.solved(z)
        row = at.polynomial(solution)
        rate_row = 1.6 * np.arange(1, 16) @ row[16:]
        level, rms, _ = settled(rate, [float(np.sum(row[:16])), float(rate_row)], 1.6, 60)
        assert at.response(solution).tip_amplitude == pytest.approx(level, rel=1e-6)
        assert at.response(solution).tip_rms == pytest.approx(rms, rel=1e-6)


def test_piecewise_linear_oscillator_is_what_integration_gives() -> None:
    omega, force, gap, stiffness = 1.3, 0.5, 0.6, 4.0

    def rate(t: float, y: Array) -> list[float]:
        wall = -stiffness * max(0.0, y[0] - gap) + stiffness * max(0.0, -gap - y[0])
        return [y[1], force * np.cos(omega * t) - 0.1 * y[1] - y[0] + wall]

    level, rms, state = settled(rate, [0.5, 0.0], omega, 150)
    errors = []
    for h in (9, 19, 39):
        balance = Balance(Oscillator(h), CompliantContact(gap, stiffness, None, None), omega, force)
        z = np.zeros(len(balance.kept))
        z[0], z[len(z) // 2] = state[0], state[1] / omega
        found = balance.response(balance.solved(z))
        errors.append(max(abs(found.tip_amplitude / level - 1), abs(found.tip_rms / rms - 1)))
    assert errors[-1] < 3e-6
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("omega", [0.6, 0.9])
def test_elastic_friction_oscillator_is_what_integration_gives(omega: float) -> None:
    force, limit, stiffness = 0.5, 0.2, 0.8
    level, rms = elastic_friction_settled(omega, force, 0.05, limit, stiffness, 60)
    balance = Balance(Oscillator(41), CompliantContact(None, None, limit, stiffness), omega, force)
    found = balance.response(balance.solved(balance.free()))
    assert found.tip_amplitude == pytest.approx(level, rel=1e-5)
    assert found.tip_rms == pytest.approx(rms, rel=1e-5)


def test_rigid_friction_oscillator_is_den_hartogs_closed_form() -> None:
    """Coulomb friction to ground, no other damping, continuous sliding: Den Hartog, Transactions of ASME 53 (1931).

    Amplitude / (F/k) = sqrt(V^2 - (limit/F U)^2), V = 1/(1 - w^2), U = sin(pi/w)/(w (1 + cos(pi/w))).
    """
    omega, force, limit = 0.7, 1.0, 0.3
    v, u = 1 / (1 - omega**2), np.sin(np.pi / omega) / (omega * (1 + np.cos(np.pi / omega)))
    exact = np.sqrt(v**2 - (limit / force * u) ** 2)
    errors = []
    for h in (11, 41, 161):
        balance = Balance(Oscillator(h, 0.0), RigidContact(None, limit, 1.0, float(h)), omega, force)
        errors.append(abs(balance.response(balance.solved(balance.free())).tip_amplitude / exact - 1))
    assert errors[2] < errors[1] / 3 < errors[0] / 9  # as 1/H: the truncated velocity turns too early or too late
    assert errors[2] < 5e-4


@pytest.mark.parametrize("model", [BEAM, OTHER])
def test_linear_limits(model: ModalModel) -> None:
    """Walls out of reach: the beam alone. Friction that nothing overcomes: a stuck mass."""
    for ratio in (0.8, 1.0, 1.3):
        omega = ratio * model.omega[0]
        far = harmonic_balance(Scene(model, impact_absorber(gap=10.0)), omega, 1.0, 7)
        assert far.response(far.solved(far.free())).tip_amplitude == pytest.approx(abs(tip_response(model, None, omega)), rel=1e-11)
        stuck = harmonic_balance(Scene(model, friction_damper(50.0)), omega, 1.0, 7)
        found = stuck.response(stuck.solved(0 * stuck.free()))
        assert found.tip_amplitude == pytest.approx(abs(tip_response(model, StuckAbsorber(), omega)), rel=1e-9)


def _isola_start(model: ModalModel, ratio: float, force: float, limit: float, balance: Balance, gap: float = 1e-3) -> tuple[Array, float]:
    omega, mass = ratio * model.omega[0], 0.02 * model.beam_mass
    impulse, phase, level = symmetric_orbit(model, mass, omega, force, gap, limit)

    def friction(k: Array) -> Array:
        return np.where(k % 2 == 1, 4j * limit / (np.pi * k), 0) * np.exp(-1j * k * phase)

    return balance.at_impacts(np.array([phase, phase + np.pi]), np.array([impulse, -impulse]), friction), level


@pytest.mark.parametrize(("weight", "left"), [(50.0, 0.913), (100.0, 0.926), (200.0, 0.929)])
def test_the_papers_isola_is_closed_and_depends_on_the_weight(weight: float, left: float) -> None:
    """3 modes, 0.01 N, 1.5 N, H = 20; the exact orbit's folds are at 0.93361 and 0.95528, its peak is 1.4743 mm."""
    first, omega = BEAM.omega[0], 0.945 * BEAM.omega[0]
    balance = harmonic_balance(Scene(BEAM, impact_absorber(friction_limit=0.01)), omega, 1.5, weight=weight)
    z, _ = _isola_start(BEAM, 0.945, 1.5, 0.01, balance)
    problem = Problem(balance.residual(OMEGA), OMEGA, 1e-3, 0.05 * first, (0.8 * first, 1.2 * first))
    branch = both_ways(problem, balance.solved(z), omega, Steps(first=0.02, most=0.2))
    assert branch.closed
    folds = sorted(fold.parameter / first for fold in branch.of("fold"))
    assert folds == [pytest.approx(left, abs=6e-4), pytest.approx(0.954, abs=2e-4)]
    peak = max(balance.at(OMEGA, p).response(z).tip_amplitude for z, p in zip(branch.points, branch.parameters, strict=True))
    assert 1.07 < peak / 1.4743e-3 < 1.125


@pytest.mark.parametrize(("model", "ratio", "force", "gap"), [(BEAM, 0.95, 1.5, 1e-3), (OTHER, 0.94, 0.6, 2e-3)])
def test_it_converges_to_the_exact_orbit_if_the_weight_grows_with_the_square_of_the_harmonics(
    model: ModalModel, ratio: float, force: float, gap: float
) -> None:
    errors = []
    for h in (10, 20, 40, 60):
        balance = harmonic_balance(Scene(model, impact_absorber(gap)), ratio * model.omega[0], force, h, weight=100 * (h / 20) ** 2)
        z, level = _isola_start(model, ratio, force, 0.0, balance, gap)
        errors.append(abs(balance.response(balance.solved(z)).tip_amplitude / level - 1))
    assert errors[0] > errors[1] > errors[2] > errors[3]
    assert errors[3] < 0.4 * errors[1]


def test_all_harmonics_and_a_longer_period_give_the_symmetric_orbit_again() -> None:
    scene, omega = Scene(BEAM, impact_absorber(friction_limit=0.01)), 0.95 * BEAM.omega[0]
    odd = harmonic_balance(scene, omega, 1.5, 15)
    solution = odd.polynomial(odd.solved(_isola_start(BEAM, 0.95, 1.5, 0.01, odd)[0]))
    every = harmonic_balance(scene, omega, 1.5, 15, symmetric=False)
    assert every.polynomial(every.solved(solution)) == pytest.approx(solution, abs=1e-12)
    longer = harmonic_balance(scene, omega, 1.5, 45, multiple=3)
    row = np.zeros(91)
    row[3:46:3], row[48::3] = solution[1:16], solution[16:]
    assert np.max(np.abs(longer.evaluated(row[longer.kept], OMEGA)[0])) < 1e-10 * 1.5


def in_order(values: Array) -> Array:
    return np.array(sorted(values.tolist(), key=lambda value: (round(value.imag, 3), value.real)))


@pytest.mark.parametrize("which", [0, 1])
def test_hills_multipliers_are_those_of_an_own_propagation(which: int) -> None:
    """Walls as springs: differences of the exact method around the orbit that it comes back to, for a positive and a negative pair."""
    model = modal_model(Beam(modes=1))
    first, mass = float(model.omega[0]), 0.02 * model.beam_mass
    omega, rigid = 0.95 * first, Scene(model, impact_absorber())
    scene = Scene(model, SlidingAbsorber(0.02, CompliantWalls(200 * mass * first**2, 1e-3)))
    orbit = [own for own in closed_form(case_of(rigid, 3.0, omega)) if own.pushes][which]
    at_walls, balance = harmonic_balance(rigid, omega, 3.0, 40, 200.0), harmonic_balance(scene, omega, 3.0, 40)
    z = balance.solved(at_walls.solved(start_of_orbit(at_walls, orbit.impulse, orbit.phase)))
    unit, k, response = 1e-3 * np.array([1, 1, omega, omega]), np.arange(41), balance.response(z)
    moves = np.exp(1j * k) * np.array([response.tip / model.tip_shape[0], response.tip + response.relative])  # at a phase in free flight

    def mapped(x: Array) -> Array:
        run = simulate(scene, Drive(3.0, constant_frequency(omega, 1.0, 0.5), 1.0), initial=InitialState(x[:1], x[2:3], float(x[1]), float(x[3])))
        return -run.end_state / unit

    def slopes(x: Array) -> Array:
        return np.array([(mapped(x + step) - mapped(x - step)) / 2e-5 for step in 1e-5 * np.diag(unit)]).T

    x = np.concatenate([moves.sum(axis=1).real, (1j * k * omega * moves).sum(axis=1).real])
    for _ in range(3):
        x -= unit * np.linalg.solve(slopes(x) - np.eye(4), mapped(x) - x / unit)
    assert mapped(x) == pytest.approx(x / unit, abs=1e-9)
    found = hill_multipliers(balance, z)
    assert in_order(found) == pytest.approx(in_order(np.linalg.eigvals(slopes(x))), rel=0.01, abs=0.005)
    every = harmonic_balance(scene, omega, 3.0, 40, symmetric=False)
    assert in_order(hill_multipliers(every, balance.polynomial(z))) == pytest.approx(in_order(found**2), abs=1e-6)


def test_scaling_law() -> None:
    """Gap, friction limit and force times 3: displacements times 3."""
    results = []
    for alpha in (1.0, 3.0):
        balance = harmonic_balance(Scene(BEAM, impact_absorber(1e-3 * alpha, friction_limit=0.02 * alpha)), 0.95 * BEAM.omega[0], 1.5 * alpha)
        z, _ = _isola_start(BEAM, 0.95, 1.5 * alpha, 0.02 * alpha, balance, 1e-3 * alpha)
        results.append(balance.response(balance.solved(z)).tip_amplitude / alpha)
    assert results[0] == pytest.approx(results[1], rel=1e-9)


# Trigonometric polynomials: roots against companion matrices, windows and hysteresis against dense quadrature.


def _rows(seed: int, h: int, count: int = 4) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 2 * h + 1)) / (1 + np.append(0, np.tile(np.arange(h), 2)))


def _companion_roots(row: Array) -> Array:
    h = (len(row) - 1) // 2
    half = (row[1 : h + 1] - 1j * row[h + 1 :]) / 2
    z = np.roots(np.concatenate([half[::-1], [row[0]], np.conj(half)]))
    return np.sort(np.angle(z[np.abs(np.abs(z) - 1) < 1e-8]) % (2 * np.pi))


@pytest.mark.parametrize("h", [1, 2, 7, 20, 45])
def test_roots_are_those_of_the_companion_matrix(h: int) -> None:
    rows = _rows(h, h)
    for row, found in zip(rows, roots(rows), strict=True):
        assert found == pytest.approx(_companion_roots(row), abs=1e-10)


@pytest.mark.parametrize("depth", [1e-2, 1e-5, 1e-9, 1e-12])
def test_two_roots_close_to_one_another_are_not_missed(depth: float) -> None:
    """Cos(5 (angle - 0.3)) + 1 - depth dips below zero by depth: five pairs of roots that come arbitrarily close."""
    row = np.zeros(2 * 20 + 1)
    row[0], row[5], row[25] = 1 - depth, np.cos(1.5), np.sin(1.5)
    (found,) = roots(row[None])
    half = np.arccos(1 - depth) / 5
    middle = 0.3 + np.pi / 5 * np.arange(1, 10, 2)
    assert found == pytest.approx(np.sort(np.concatenate([middle - half, middle + half]) % (2 * np.pi)), abs=max(1e-12, 1e-15 / half))
    row[0] = 1 + depth
    assert len(roots(row[None])[0]) == 0


def test_derivative_extremes_and_single_values() -> None:
    (row,) = _rows(3, 9, 1)
    angle = np.linspace(0, 2 * np.pi, 100001)
    value, slope = values(row[None], np.zeros(len(angle), dtype=int), angle)
    assert largest(row) == (pytest.approx(value.min(), abs=1e-7), pytest.approx(value.max(), abs=1e-7))
    assert values(derivative(row)[None], np.zeros(len(angle), dtype=int), angle)[0] == pytest.approx(slope, abs=1e-12)
    assert basis(1.234, 9) @ row == pytest.approx(values(row[None], np.array([0]), np.array([1.234]))[0][0], abs=1e-14)


def _dense(row: Array, points: int = 400000) -> tuple[Array, Array]:
    angle = (np.arange(points) + 0.5) * 2 * np.pi / points
    return angle, values(row[None], np.zeros(points, dtype=int), angle)[0]


def _coefficients(angle: Array, x: Array, h: int) -> Array:
    cosine = [2 * np.mean(x * np.cos(k * angle)) for k in range(1, h + 1)]
    return np.array([np.mean(x), *cosine, *(2 * np.mean(x * np.sin(k * angle)) for k in range(1, h + 1))])


def test_window_is_the_closed_form_of_a_cut_polynomial() -> None:
    h = 6
    for row in _rows(11, h, 3):
        intervals = negative(row, roots(row[None])[0])
        angle, x = _dense(row)
        matrix = window(intervals, h)
        assert matrix @ row == pytest.approx(_coefficients(angle, np.minimum(x, 0), h), abs=1e-8)
        assert share(intervals, h) == pytest.approx(matrix[:, 0], abs=1e-15)
    whole, nothing = np.array([[0.0, 2 * np.pi]]), np.empty((0, 2))
    assert window(whole, h) == pytest.approx(np.eye(2 * h + 1), abs=1e-14)
    assert np.all(window(nothing, h) == 0)


def _jenkins(x: Array, limit: float, stiffness: float) -> Array:
    """A Jenkins element gone through sample by sample, three times round."""
    force, last, out = 0.0, x[-1], np.empty(len(x))
    for _ in range(3):
        for i, now in enumerate(x):
            force = min(limit, max(-limit, force - stiffness * (now - last)))
            last, out[i] = now, force
    return out


@pytest.mark.parametrize(("limit", "stiffness"), [(0.3, 1.0), (1.2, 2.0), (0.05, 4.0)])
def test_elastic_coulomb_is_what_a_slider_does(limit: float, stiffness: float) -> None:
    h = 5
    for row in _rows(5, h, 3):
        angle, x = _dense(row, 100000)
        found = elastic_coulomb(row, limit, stiffness)
        assert found.force == pytest.approx(_coefficients(angle, _jenkins(x, limit, stiffness), h), abs=2e-4 * limit)


def test_elastic_coulomb_sticks_without_slip() -> None:
    (row,) = _rows(2, 4, 1)
    found = elastic_coulomb(row, 1e3, 2.0)
    assert found.force[1:] == pytest.approx(-2 * row[1:])
    assert found.force[0] == 0
