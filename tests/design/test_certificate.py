"""The proof of a largest amplitude: against the grid and an eigenvalue test that shares nothing with it, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

cvxpy = pytest.importorskip("cvxpy")

from impact_env.frequency import state_space, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, ParameterError, StuckAbsorber, TunedAbsorber
from optimisation.convex import NotOptimalError
from optimisation.tuned import PAPER, den_hartog, highest_amplitude
from optimisation.tuned.certificate import certify

MODEL = modal_model(Beam(modes=3))


def reaches(model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, amplitude: float) -> bool:
    """Tell whether |H(i w)| = amplitude at some frequency: then the Hamiltonian matrix has an eigenvalue on the imaginary axis."""
    a, b, c = state_space(model, absorber, float(model.omega[0]))
    b, c = b[:, None] / np.sqrt(amplitude), c[None] / np.sqrt(amplitude)
    s = np.linalg.eigvals(np.block([[a, b @ b.T], [-c.T @ c, -a.T]]))
    return bool(np.any(np.abs(s.real) < 1e-7 * np.abs(s)))


@pytest.mark.parametrize("absorber", [None, PAPER, den_hartog(MODEL), StuckAbsorber(0.1), TunedAbsorber(0.02, 600.0, 40.0)])
def test_bound_over_all_frequencies(absorber: TunedAbsorber | StuckAbsorber | None) -> None:
    proof = certify(MODEL, absorber)
    assert proof.everywhere
    assert proof.grid == pytest.approx(highest_amplitude(MODEL, absorber)[0], rel=1e-12)
    assert proof.grid * (1 - 1e-9) <= proof.bound <= proof.grid * (1 + 1e-4)
    assert reaches(MODEL, absorber, 0.999 * proof.bound)
    assert not reaches(MODEL, absorber, 1.0001 * proof.bound)


def test_bound_within_a_range() -> None:
    """At the second resonance the first is higher, but outside; a narrow range may be proved, only not scored."""
    rule = den_hartog(MODEL, resonance=2)
    proof = certify(MODEL, rule, 2)
    assert not proof.everywhere
    fine = np.abs(tip_response(MODEL, rule, np.linspace(0.5, 1.6, 40001) * MODEL.omega[1])).max()
    assert fine <= proof.bound <= fine * (1 + 1e-4)
    assert certify(MODEL, rule, 2, everywhere=True).bound > 5 * proof.bound
    flank = certify(MODEL, PAPER, 1, 0.9, 1.06, everywhere=False)
    assert flank.frequency_ratio == 0.9
    assert flank.bound == pytest.approx(float(abs(tip_response(MODEL, PAPER, 0.9 * MODEL.omega[0]))), rel=1e-4)


def test_small_damping_is_still_proved() -> None:
    model = modal_model(Beam(modes=2, damping_ratio=1e-3))
    proof = certify(model, None)
    assert proof.bound == pytest.approx(proof.grid, rel=1e-4)


@pytest.mark.parametrize("everywhere", [True, False])
def test_a_peak_that_the_grid_missed_is_noticed(monkeypatch: pytest.MonkeyPatch, everywhere: bool) -> None:
    monkeypatch.setattr("optimisation.tuned.certificate.highest_amplitude", lambda *_arguments: (0.99 * highest_amplitude(MODEL, PAPER)[0], 0.87))
    with pytest.raises(NotOptimalError, match="agreement"):
        certify(MODEL, PAPER, everywhere=everywhere)


@pytest.mark.parametrize("status", ["optimal_inaccurate", "infeasible"])
@pytest.mark.parametrize("everywhere", [True, False])
def test_status_that_is_not_optimal_is_refused(monkeypatch: pytest.MonkeyPatch, status: str, everywhere: bool) -> None:
    model = modal_model(Beam(modes=1))
    monkeypatch.setattr(cvxpy.Problem, "status", property(lambda _self: status))
    with pytest.raises(NotOptimalError, match=status):
        certify(model, PAPER, everywhere=everywhere)


@pytest.mark.parametrize("everywhere", [True, False])
def test_matrix_that_proves_nothing_is_refused(monkeypatch: pytest.MonkeyPatch, everywhere: bool) -> None:
    """Whatever the status says, the inequality is checked on the numbers given back."""

    def spoil(problem: cvxpy.Problem, *_arguments: object) -> None:
        for variable in problem.variables():
            variable.value = np.zeros(variable.shape)

    monkeypatch.setattr("optimisation.tuned.certificate.solve", spoil)
    with pytest.raises(NotOptimalError, match="matrix inequality"):
        certify(MODEL, PAPER, everywhere=everywhere)


def test_bad_input() -> None:
    undamped = modal_model(Beam(modes=2, damping_ratio=0.0))
    for call, name in (
        (lambda: certify(MODEL, PAPER, 4), "resonance"),
        (lambda: certify(MODEL, PAPER, low=1.0, high=0.9), "high"),
        (lambda: certify(undamped, None), "damping_ratio"),
        (lambda: certify(ModalModel([1.0, 5.0], [1.0, 0.1], [1.0, 1.0], [1.0, 1.0], 1.0), None), "poles"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()
