"""The limit of passive devices by semidefinite programming: against the closed form, brute force and its own multipliers."""

from __future__ import annotations

import numpy as np
import pytest

cvxpy = pytest.importorskip("cvxpy")

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from impact_env.modes import ModalModel, modal_model  # noqa: E402
from impact_env.parameters import Beam, ParameterError  # noqa: E402
from optimisation.bounds import design_force, resonance_limit, stroke_limit_rms  # noqa: E402
from optimisation.bounds.relaxation import dual_bound, passive_limit, passive_resonance_limit  # noqa: E402
from optimisation.convex import NotOptimalError  # noqa: E402
from optimisation.response import receptance  # noqa: E402

MODEL = modal_model(Beam())
MASS = 0.02 * MODEL.beam_mass
GAP = 1e-3
STROKE = 4 * GAP / np.pi


def lines(model: ModalModel, mass: float, force: float, omega: float) -> tuple[complex, complex]:
    """Return A and B of the tip's line q = A + B r, from the receptances."""
    kappa = complex(receptance(model, omega, model.tip_shape, model.tip_shape) * mass * omega**2)
    return complex(force * receptance(model, omega, model.tip_shape, model.force_shape)) / (1 - kappa), kappa / (1 - kappa)


def brute_force(a: complex, b: complex) -> float:
    """Return the smallest RMS over a fine polar grid of admissible strokes, passive ones only."""
    r = (STROKE * np.linspace(0, 1, 401)[:, None] * np.exp(2j * np.pi * np.arange(2880) / 2880)).ravel()
    q = a + b * r
    passive = (r * q.conj()).imag <= 1e-12 * np.abs(r * q)
    return float(np.min(np.abs(q[passive]))) / np.sqrt(2)


@pytest.mark.parametrize("resonance", [1, 2])
@pytest.mark.parametrize("ratio", [0.93, 0.962, 1.0, 1.05])
@pytest.mark.parametrize("force", [1.2, 3.0, 20.0])
def test_brute_force_comes_close_and_never_below(resonance: int, ratio: float, force: float) -> None:
    amplitude, omega = force * design_force(MODEL, MASS, GAP, resonance), ratio * MODEL.omega[resonance - 1]
    a, b = lines(MODEL, MASS, amplitude, omega)
    limit = passive_limit(MODEL, MASS, GAP, amplitude, omega)
    found = brute_force(a, b)
    assert limit.rms <= found * (1 + 1e-12)
    assert found - limit.rms <= 4e-3 * abs(b) * STROKE  # the grid's spacing


@given(
    force=st.floats(-2, 3),
    gap=st.floats(-5, -1),
    mass_ratio=st.floats(-3, 0.5),
    at=st.floats(0.2, 20),
    modes=st.integers(1, 6),
    place=st.floats(0.6, 1),
)
@settings(max_examples=60)
def test_relaxation_is_exact_and_passivity_costs_nothing(force: float, gap: float, mass_ratio: float, at: float, modes: int, place: float) -> None:
    model = modal_model(Beam(modes=modes, absorber_position=place))
    mass, amplitude, omega = 10**mass_ratio * model.beam_mass, 10**force, at * model.omega[0]
    limit = passive_limit(model, mass, 10**gap, amplitude, omega)
    closed = float(stroke_limit_rms(model, mass, 10**gap, amplitude, omega))
    a, b = lines(model, mass, amplitude, omega)
    assert limit.rms == pytest.approx(closed, rel=1e-6, abs=3e-5 * abs(a))
    assert limit.rms <= closed * (1 + 1e-9) + 1e-12 * abs(a)
    q = a + b * limit.stroke
    assert abs(q) / np.sqrt(2) == pytest.approx(limit.rms, abs=2e-4 * abs(a))  # the stroke found is one that comes that low
    assert abs(limit.stroke) <= 4 * 10**gap / np.pi * (1 + 1e-4)


@given(real=st.floats(-3, 3), imag=st.floats(-3, 0), stroke=st.floats(0, 20), power=st.floats(0, 20), largest=st.floats(0.5, 5))
@settings(max_examples=200)
def test_any_multipliers_give_a_lower_bound(real: float, imag: float, stroke: float, power: float, largest: float) -> None:
    b = complex(real, imag)
    r = (largest * np.linspace(0, 1, 61)[:, None] * np.exp(2j * np.pi * np.arange(120) / 120)).ravel()
    admissible = (r * (1 + b * r).conj()).imag <= 0
    smallest = float(np.min(np.abs(1 + b * r[admissible]) ** 2))
    assert dual_bound(b, largest, stroke, power) <= smallest + 1e-9


def test_largest_over_the_sweep() -> None:
    limit = passive_resonance_limit(MODEL, MASS, GAP, 10.0)
    assert limit.rms == pytest.approx(float(resonance_limit(MODEL, MASS, GAP, 10.0)), rel=1e-6)
    assert 0.9 < limit.omega / MODEL.omega[0] < 1.06
    assert abs(limit.slack) < 1e-6


def test_limits_without_a_problem_to_solve() -> None:
    assert passive_limit(MODEL, MASS, GAP, 0.0, 250.0).rms == 0
    undamped = modal_model(Beam(damping_ratio=0.0))
    assert passive_limit(undamped, MASS, GAP, 10.0, undamped.omega[0]).rms == pytest.approx(
        float(stroke_limit_rms(undamped, MASS, GAP, 10.0, undamped.omega[0])), rel=1e-6
    )


@pytest.mark.parametrize("status", ["optimal_inaccurate", "infeasible", "user_limit"])
def test_status_that_is_not_optimal_is_refused(monkeypatch: pytest.MonkeyPatch, status: str) -> None:
    monkeypatch.setattr(cvxpy.Problem, "status", property(lambda _self: status))
    with pytest.raises(NotOptimalError, match=status):
        passive_limit(MODEL, MASS, GAP, 10.0, 242.0)


def test_failure_of_the_solver_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object, **_options: object) -> None:
        raise cvxpy.error.SolverError("no memory")

    monkeypatch.setattr(cvxpy.Problem, "solve", fail)
    with pytest.raises(NotOptimalError, match="no memory"):
        passive_limit(MODEL, MASS, GAP, 10.0, 242.0)


def test_solution_of_another_problem_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A status of "optimal" alone proves nothing: the multipliers must prove what the stroke reaches."""
    assert passive_limit(MODEL, MASS, GAP, 5.0, 250.0).rms > 0  # leaves its solution in the compiled problem
    monkeypatch.setattr("optimisation.bounds.relaxation.solve", lambda *_arguments: None)
    with pytest.raises(NotOptimalError, match="multipliers prove"):
        passive_limit(MODEL, MASS, GAP, 20.0, 240.0)


def test_bad_input() -> None:
    for call, name in (
        (lambda: passive_limit(MODEL, 0.0, GAP, 1.0, 250.0), "mass"),
        (lambda: passive_limit(MODEL, MASS, -1.0, 1.0, 250.0), "gap"),
        (lambda: passive_limit(MODEL, MASS, GAP, -1.0, 250.0), "force"),
        (lambda: passive_limit(MODEL, MASS, GAP, 1.0, 0.0), "omega"),
        (lambda: passive_resonance_limit(MODEL, MASS, GAP, 1.0, 11), "resonance"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()
