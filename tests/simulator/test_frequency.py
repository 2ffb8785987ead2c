"""Linear receptances against dense solutions, poles and closed forms."""

import itertools

import numpy as np
import pytest
from core import ALL

from impact_env import InitialState, beam_scene, constant_frequency, impact_absorber, simulate
from impact_env.checks import ParameterError
from impact_env.drive import Drive
from impact_env.energy import mechanical_energy, stored_energy
from impact_env.frequency import (
    coupled_receptance,
    joint_matrices,
    natural_frequencies,
    poles,
    receptance,
    receptance_slope,
    tip_response,
)
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, StuckAbsorber, TunedAbsorber
from impact_env.phase_lag import phase_lag
from impact_env.results import History


@pytest.fixture(scope="module")
def model() -> ModalModel:
    return modal_model(Beam())


OMEGA = np.array([0.0, 30.0, 200.0, 252.3, 900.0, 1581.0, 5e3, 3e5])
TUNED = TunedAbsorber()
STUCK = StuckAbsorber(0.1)


def _dense(
    model: ModalModel,
    absorber: TunedAbsorber | StuckAbsorber | None,
    omega: float,
    a: np.ndarray,
    b: np.ndarray,
) -> complex:
    """Solve the equations of motion in modal coordinates, written separately.

    With a spring the absorber has one further degree of freedom.
    """
    n = model.modes
    beam = np.diag(
        model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega
    ).astype(complex)
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
def test_receptance_is_the_dense_solution(
    model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None
) -> None:
    tip = model.tip_shape
    force = model.force_shape
    for a, b in itertools.product((tip, force), repeat=2):
        dense = np.array([_dense(model, absorber, w, a, b) for w in OMEGA])
        computed = (
            receptance(model, OMEGA, a, b)
            if absorber is None
            else coupled_receptance(model, absorber, OMEGA, a, b)
        )
        np.testing.assert_allclose(computed, dense, rtol=1e-9)
    dense = np.array([_dense(model, absorber, w, tip, force) for w in OMEGA])
    np.testing.assert_allclose(tip_response(model, absorber, OMEGA), dense, rtol=1e-11)


def test_limits_of_the_tuned_absorber(model: ModalModel) -> None:
    """The tuned absorber has the correct limits.

    A stiff spring is a stuck mass. Without damping the tip does not move at the absorber's own
    frequency (Den Hartog).
    """
    stiff = tip_response(model, TunedAbsorber(STUCK.mass_ratio, 1e16, 0.0), OMEGA)
    np.testing.assert_allclose(stiff, tip_response(model, STUCK, OMEGA), rtol=1e-6)
    absorber = TunedAbsorber(0.02, 0.02 * model.beam_mass * 240.0**2, 0.0)
    assert abs(tip_response(model, absorber, 240.0)) < 1e-12 * abs(tip_response(model, None, 240.0))


def test_finite_at_an_undamped_free_resonance_and_refused_where_infinite() -> None:
    undamped = modal_model(Beam(damping_ratio=0.0))
    at = undamped.omega[1]
    nearby = tip_response(undamped, TUNED, at * (1 + 1e-7))
    assert tip_response(undamped, TUNED, at) == pytest.approx(nearby, rel=1e-4)
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


OMEGA_PHASE = 252.0


def sines(lag: float, periods: int = 20, beat: float = 0.0, offset: float = 0.0) -> History:
    """Return the motion of an oscillating tip and of an absorber that lags behind it.

    The tip's motion is split evenly over two modes. The lag grows by ``beat`` rad/s.
    """
    time = np.arange(64 * periods) * 2 * np.pi / OMEGA_PHASE / 64
    modal = np.cos(OMEGA_PHASE * time)[:, None] * np.array([1e-3, 1e-3])
    absorber = offset + 7e-4 * np.cos(OMEGA_PHASE * time - lag - beat * time)
    return History(
        time, modal, np.zeros_like(modal), absorber, np.zeros_like(time), np.array([2.0, 3.0])
    )


@pytest.mark.parametrize("lag", [0.0, -0.3, np.pi / 2, 3.1, np.pi])
def test_two_sines_have_the_known_lag(lag: float) -> None:
    """At +-pi the sign is chance, but never -pi."""
    for offset in (0.0, 4e-3):
        measured_lag = phase_lag(sines(lag, offset=offset))
        assert np.all((measured_lag > -np.pi) & (measured_lag <= np.pi))
        np.testing.assert_allclose(
            np.abs(measured_lag) if lag == np.pi else measured_lag, lag, atol=1e-9
        )


def test_unwrapped_lag_counts_the_turns() -> None:
    periods = 200
    turns = 5
    duration = periods * 2 * np.pi / OMEGA_PHASE
    history = sines(0.2, periods, beat=2 * np.pi * turns / duration)
    lag = phase_lag(history, wrapped=False)
    np.testing.assert_allclose(lag, 0.2 + 2 * np.pi * turns * history.time / duration, atol=1e-6)
    assert np.max(np.abs(phase_lag(history))) <= np.pi


def test_conservative_run_keeps_the_sum_of_energies() -> None:
    scene = beam_scene(Beam(modes=3, damping_ratio=0.0), impact_absorber())
    start = InitialState(np.array([1e-3, 0.0, 0.0]), np.array([0.0, 0.02, 0.0]))
    drive = Drive(0.0, constant_frequency(float(scene.model.omega[0]), 1.0, 20))
    run = simulate(scene, drive, initial=start, record=ALL)
    assert run.impact_count > 10
    energy = mechanical_energy(scene, run.history)
    assert energy.modal.shape == (len(run.history.time), 3)
    assert energy.absorber.shape == run.history.time.shape
    np.testing.assert_allclose(energy.total, stored_energy(scene, start.vector(scene)), rtol=1e-10)
    assert np.ptp(energy.absorber_share) > 0.01
    assert np.all((energy.absorber_share >= 0) & (energy.absorber_share < 1))


def test_the_slope_of_a_receptance_is_that_of_differences() -> None:
    """Fourth-order central differences of the receptance, beside and at a resonance."""
    model = modal_model(Beam(modes=3, damping_ratio=(0.01, 0.3, 2.0)))
    omegas = model.omega[0] * np.array([0.3, 0.99, 1.0, 5.0])
    step = 1e-4 * omegas

    def at(shift: float) -> np.ndarray:
        return receptance(model, omegas + shift * step, model.tip_shape, model.force_shape)

    wanted = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)
    slope = receptance_slope(model, omegas, model.tip_shape, model.force_shape)
    np.testing.assert_allclose(slope, wanted, rtol=1e-6)
