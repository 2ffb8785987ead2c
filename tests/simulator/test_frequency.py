"""Linear receptances against dense solutions, poles and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from impact_env.frequency import coupled_receptance, joint_matrices, natural_frequencies, poles, receptance, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, ParameterError, StuckAbsorber, TunedAbsorber


@pytest.fixture(scope="module")
def model() -> ModalModel:
    return modal_model(Beam())


OMEGA = np.array([0.0, 30.0, 200.0, 252.3, 900.0, 1581.0, 5e3, 3e5])
TUNED = TunedAbsorber()
STUCK = StuckAbsorber(0.1)


def _dense(model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, omega: float, a: np.ndarray, b: np.ndarray) -> complex:
    """Solve the equations of motion in modal coordinates, written down on their own, with one absorber freedom where there is a spring."""
    n = model.modes
    beam = np.diag(model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega).astype(complex)
    tip = model.tip_shape
    if absorber is None:
        return complex(a @ np.linalg.solve(beam, b))
    mass = absorber.mass_ratio * model.beam_mass
    if isinstance(absorber, StuckAbsorber):
        return complex(a @ np.linalg.solve(beam - omega**2 * mass * np.outer(tip, tip), b))
    spring = absorber.stiffness + 1j * omega * absorber.damping
    system = np.zeros((n + 1, n + 1), dtype=complex)
    system[:n, :n] = beam + spring * np.outer(tip, tip)
    system[:n, n] = system[n, :n] = -spring * tip
    system[n, n] = spring - omega**2 * mass
    return complex(a @ np.linalg.solve(system, np.append(b, 0))[:n])


@pytest.mark.parametrize("absorber", [None, TUNED, STUCK])
@pytest.mark.parametrize("rows", ["tf", "tt", "ff", "ft"])
def test_receptance_is_the_dense_solution(model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, rows: str) -> None:
    a, b = ({"t": model.tip_shape, "f": model.force_shape}[row] for row in rows)
    dense = np.array([_dense(model, absorber, w, a, b) for w in OMEGA])
    ours = receptance(model, OMEGA, a, b) if absorber is None else coupled_receptance(model, absorber, OMEGA, a, b)
    np.testing.assert_allclose(ours, dense, rtol=1e-9)
    if rows == "tf":
        np.testing.assert_allclose(tip_response(model, absorber, OMEGA), dense, rtol=1e-11)


def test_shapes_follow_omega(model: ModalModel) -> None:
    grid = OMEGA[:6].reshape(2, 3)
    assert tip_response(model, TUNED, grid).shape == receptance(model, grid, model.tip_shape, model.tip_shape).shape == (2, 3)
    assert tip_response(model, TUNED, 100.0).shape == ()
    assert tip_response(model, TUNED, grid)[1, 2] == pytest.approx(complex(tip_response(model, TUNED, float(grid[1, 2]))), rel=1e-14)


def test_static_response_does_not_feel_the_absorber(model: ModalModel) -> None:
    static = np.sum(model.tip_shape * model.force_shape / model.omega**2)
    for absorber in (None, TUNED, STUCK):
        assert tip_response(model, absorber, 0.0) == pytest.approx(static, rel=1e-14)


def test_receptances_are_reciprocal_and_a_stiff_spring_is_a_stuck_mass(model: ModalModel) -> None:
    there = coupled_receptance(model, TUNED, OMEGA, model.tip_shape, model.force_shape)
    np.testing.assert_allclose(there, coupled_receptance(model, TUNED, OMEGA, model.force_shape, model.tip_shape), rtol=1e-14)
    stiff = tip_response(model, TunedAbsorber(STUCK.mass_ratio, 1e16, 0.0), OMEGA)
    np.testing.assert_allclose(stiff, tip_response(model, STUCK, OMEGA), rtol=1e-6)


def test_undamped_absorber_stops_the_tip_at_its_own_frequency(model: ModalModel) -> None:
    absorber = TunedAbsorber(0.02, 0.02 * model.beam_mass * 240.0**2, 0.0)
    assert abs(tip_response(model, absorber, 240.0)) < 1e-12 * abs(tip_response(model, None, 240.0))


def test_finite_at_an_undamped_free_resonance_and_refused_where_infinite() -> None:
    undamped = modal_model(Beam(damping_ratio=0.0))
    at = undamped.omega[1]
    beside = tip_response(undamped, TUNED, at * (1 + 1e-7))
    assert tip_response(undamped, TUNED, at) == pytest.approx(beside, rel=1e-4)
    for call in (
        lambda: tip_response(undamped, None, at),
        lambda: receptance(undamped, at, undamped.tip_shape, undamped.tip_shape),
        lambda: coupled_receptance(undamped, TUNED, at, undamped.force_shape, undamped.force_shape),
    ):
        with pytest.raises(ParameterError, match="omega"):
            call()


def test_natural_frequencies_interlace_and_poles_carry_the_damping(model: ModalModel) -> None:
    split = natural_frequencies(model, TUNED)
    assert len(split) == model.modes + 1
    assert np.all(split[:-1] < model.omega)
    assert np.all(model.omega < split[1:])
    stuck = natural_frequencies(model, STUCK)
    assert np.all(stuck < model.omega)
    assert np.all(stuck[1:] > model.omega[:-1])
    s = poles(model, None)
    s = s[np.argsort(s.imag)]
    np.testing.assert_allclose(s, model.omega * (-0.01 + 1j * np.sqrt(1 - 0.01**2)), rtol=1e-9)
    mass, damping, stiffness = joint_matrices(model, TUNED)
    s = poles(model, TUNED)[3]
    matrix = s**2 * mass + s * damping + stiffness
    assert np.linalg.cond(matrix / np.linalg.norm(matrix)) > 1e9
