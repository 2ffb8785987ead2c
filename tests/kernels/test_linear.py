"""Linear scenes agree with dense matrix exponentials, closed forms and limits.

Eigenvalues, eigenvectors and responses are tested in test_regimes.py.
"""

import numpy as np
import pytest
from core import Array, drive_of, run, scene_of

from impact_env import InitialState, StuckAbsorber, TunedAbsorber
from impact_env.parameters import Absorber
from reference import dense

LINEAR = [
    None,
    StuckAbsorber(0.5),
    TunedAbsorber(),
    TunedAbsorber(damping=0.0),
    TunedAbsorber(0.1, 1e6, 300.0),
]
SWEEPS = [
    (0.0,),
    (1.0,),
    (300.0,),
    (0.98, 1.02),
    (0.0, 20.0),
    (20.0, 0.0),
    (1.0, 1.0, 3.0, 0.0, 7.0, 6.9),
]
DAMPINGS = [0.0, 1e-6, 0.3, 1.0, 1 + 1e-9, 30.0, (0.0, 1.0, 3.0)]
START = InitialState(np.array([1e-5, -2e-6, 5e-6]), np.array([1e-3, 3e-3, -2e-3]))


def error(
    absorber: Absorber | None,
    ratios: tuple[float, ...],
    initial: InitialState | None = None,
    periods: float = 5.0,
    **beam: object,
) -> float:
    """Return the largest relative deviation from the reference.

    Each modal displacement and velocity is relative to its largest value. If the relative error of
    the energy is larger, it is returned.
    """
    scene = scene_of(absorber, **beam)
    drive = drive_of(1.0, *ratios, phase=0.3, periods=periods)
    response = run(scene, drive, initial=initial, samples=32 if periods > 1 else 1024)
    history = response.history
    n = scene.model.modes
    truth = np.delete(
        dense.follow(scene, drive, initial, history.time, long_steps=True).states,
        [n, 2 * n + 1],
        axis=1,
    )
    states: Array = np.concatenate([history.modal_displacement, history.modal_velocity], axis=1)
    return float(
        max(
            np.max(np.abs(states - truth) / np.max(np.abs(truth), axis=0)),
            response.energy.relative_error,
        )
    )


@pytest.mark.parametrize("absorber", LINEAR)
@pytest.mark.parametrize("ratios", SWEEPS)
def test_sweeps(absorber: Absorber | None, ratios: tuple[float, ...]) -> None:
    assert error(absorber, ratios, START) < 2e-12


@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber()])
@pytest.mark.parametrize("ratios", [(0.9, 1.1), (0.0,)])
def test_damping_from_none_to_overdamped(
    damping: float | tuple[float, ...], absorber: Absorber | None, ratios: tuple[float, ...]
) -> None:
    assert error(absorber, ratios, damping_ratio=damping) < 2e-12


@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber()])
def test_all_modes(absorber: Absorber | None) -> None:
    assert error(absorber, (0.5, 2.0), modes=60, periods=0.125) < 5e-11


@pytest.mark.parametrize("phase", [0.0, 1.0])
def test_undamped_resonance_grows_without_bound(phase: float) -> None:
    scene = scene_of(damping_ratio=0.0, modes=1)
    omega = scene.model.omega[0]
    shape = scene.model.force_shape[0]
    response = run(scene, drive_of(2.0, 1.0, periods=200, reference=omega, phase=phase))
    t = response.history.time
    grown = (
        2.0
        * shape
        / (2 * omega)
        * (t * np.sin(omega * t + phase) - np.sin(phase) * np.sin(omega * t) / omega)
    )
    np.testing.assert_allclose(
        response.history.modal_displacement[:, 0], grown, rtol=0, atol=1e-12 * np.max(np.abs(grown))
    )


def test_tuned_absorber_between_limits_of_its_spring() -> None:
    """A very stiff spring is a stuck mass; the beam does not feel a very soft one."""
    stuck, stiff, alone, soft = (
        run(scene_of(absorber), drive_of(1.0, 0.9, 1.1, periods=3)).end_state[:3]
        for absorber in (
            StuckAbsorber(),
            TunedAbsorber(stiffness=1e9, damping=0.0),
            None,
            TunedAbsorber(stiffness=1e-6, damping=0.0),
        )
    )
    np.testing.assert_allclose(stiff, stuck, rtol=0, atol=1e-3 * np.max(np.abs(stuck)))
    np.testing.assert_allclose(soft, alone, rtol=0, atol=1e-8 * np.max(np.abs(alone)))
