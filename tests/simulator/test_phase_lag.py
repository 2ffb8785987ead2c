from __future__ import annotations

import numpy as np
import pytest

from impact_env import Beam, InitialState, Record, beam_scene, constant_frequency, impact_absorber, simulate
from impact_env.drive import Drive
from impact_env.energy import mechanical_energy, stored_energy
from impact_env.parameters import ParameterError, TunedAbsorber
from impact_env.phase_lag import phase_lag
from impact_env.response import History

OMEGA = 252.0
ALL = Record(level=False, events=True, series=True, energy=True)


def sines(lag: float, periods: int = 20, beat: float = 0.0, offset: float = 0.0) -> History:
    """A tip that oscillates, split evenly over two modes, and an absorber that lags behind it; the lag grows by ``beat`` rad/s."""
    time = np.arange(64 * periods) * 2 * np.pi / OMEGA / 64
    modal = np.cos(OMEGA * time)[:, None] * np.array([1e-3, 1e-3])
    absorber = offset + 7e-4 * np.cos(OMEGA * time - lag - beat * time)
    return History(time, modal, np.zeros_like(modal), absorber, np.zeros_like(time), np.array([2.0, 3.0]))


@pytest.mark.parametrize("lag", [0.0, 0.3, -0.3, np.pi / 2, -2.0, 3.1])
@pytest.mark.parametrize("offset", [0.0, 4e-3])
def test_two_sines_have_the_known_lag(lag: float, offset: float) -> None:
    np.testing.assert_allclose(phase_lag(sines(lag, offset=offset)), lag, atol=1e-9)


def test_opposite_motion_is_plus_pi() -> None:
    lag = phase_lag(sines(np.pi))
    assert np.all((lag > -np.pi) & (lag <= np.pi))
    np.testing.assert_allclose(np.abs(lag), np.pi, atol=1e-9)
    still = sines(0.0)
    mirrored = History(still.time, still.modal_displacement, still.modal_velocity, -still.tip_displacement, still.absorber_velocity, still.tip_shape)
    np.testing.assert_array_equal(phase_lag(mirrored), np.pi)


def test_unwrapped_lag_counts_the_turns() -> None:
    periods, turns = 200, 5
    duration = periods * 2 * np.pi / OMEGA
    history = sines(0.2, periods, beat=2 * np.pi * turns / duration)
    lag = phase_lag(history, wrapped=False)
    np.testing.assert_allclose(lag, 0.2 + 2 * np.pi * turns * history.time / duration, atol=1e-6)
    assert np.max(np.abs(phase_lag(history))) <= np.pi


def test_rest_has_no_phase() -> None:
    still = sines(0.0)
    rest = History(
        still.time, still.modal_displacement, still.modal_velocity, np.full_like(still.time, 2e-3), still.absorber_velocity, still.tip_shape
    )
    with pytest.raises(ParameterError, match="absorber_displacement"):
        phase_lag(rest)


def test_tuned_absorber_lags_by_its_transfer_function() -> None:
    scene = beam_scene(Beam(modes=2, damping_ratio=0.1), TunedAbsorber())
    absorber, mass = scene.absorber, scene.absorber_mass
    assert isinstance(absorber, TunedAbsorber)
    assert mass is not None
    drive = Drive(1.0, constant_frequency(float(scene.model.omega[0]), 0.9, 120))
    history = simulate(scene, drive, record=ALL).history
    assert history is not None
    omega = 0.9 * scene.model.omega[0]
    force = absorber.stiffness + 1j * omega * absorber.damping
    transfer = force / (force - mass * omega**2)
    middle = slice(40 * 32, 80 * 32)
    np.testing.assert_allclose(phase_lag(history)[middle], -np.angle(transfer), atol=2e-3)


def test_conservative_run_keeps_the_sum_of_energies() -> None:
    scene = beam_scene(Beam(modes=3, damping_ratio=0.0), impact_absorber())
    start = InitialState(np.array([1e-3, 0.0, 0.0]), np.array([0.0, 0.02, 0.0]))
    drive = Drive(0.0, constant_frequency(float(scene.model.omega[0]), 1.0, 20))
    run = simulate(scene, drive, initial=start, record=ALL)
    assert run.history is not None
    assert run.impact_count > 10
    energy = mechanical_energy(scene, run.history)
    assert energy.modal.shape == (len(run.history.time), 3)
    assert energy.absorber.shape == run.history.time.shape
    np.testing.assert_allclose(energy.total, stored_energy(scene, start.vector(scene)), rtol=1e-10)
    assert np.ptp(energy.absorber_share) > 0.01
    assert np.all((energy.absorber_share >= 0) & (energy.absorber_share < 1))


def test_resting_scene_without_absorber_has_no_energy() -> None:
    scene = beam_scene(Beam(modes=2))
    drive = Drive(0.0, constant_frequency(float(scene.model.omega[0]), 1.0, 3))
    history = simulate(scene, drive, record=ALL).history
    assert history is not None
    energy = mechanical_energy(scene, history)
    np.testing.assert_array_equal(energy.total, 0)
    np.testing.assert_array_equal(energy.absorber_share, 0)
