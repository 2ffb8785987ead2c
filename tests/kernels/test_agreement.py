"""All methods on all scenes: the stepping methods come closer to the exact one as their steps shrink."""

import numpy as np
import pytest
from core import PERIOD, drive_of, run, scene_of

from impact_env import (
    CompliantWalls,
    ElasticCoulombFriction,
    Moreau,
    RungeKutta,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.methods import Method
from impact_env.parameters import Absorber
from impact_env.response import Response

LINEAR = [None, StuckAbsorber(), TunedAbsorber()]
RIGID = [impact_absorber(), impact_absorber(restitution=0.7), impact_absorber(5e-4, 0.3, 0.1), friction_damper(0.1)]
COMPLIANT = [
    SlidingAbsorber(walls=CompliantWalls(1e6)),
    SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e5)),
    SlidingAbsorber(0.05, CompliantWalls(1e5, 5e-4), ElasticCoulombFriction(0.1, 1e5)),
]
DRIVE = drive_of(6.0, 0.98, 1.02, periods=3.5, phase=0.4)


def deviation(response: Response, exact: Response) -> float:
    """Largest difference of the modal displacements relative to the largest: over the run, or for linear scenes at the end.

    Samples lie on straight lines between the steps, which hides the order of a linear scene.
    """
    scale, modes = np.max(np.abs(exact.history.modal_displacement)), exact.scene.model.modes
    if not isinstance(exact.scene.absorber, SlidingAbsorber):
        return float(np.max(np.abs(response.end_state - exact.end_state)[:modes]) / scale)
    return float(np.max(np.abs(response.history.modal_displacement - exact.history.modal_displacement)) / scale)


def converge(absorber: Absorber | None, methods: list[Method], close: float) -> tuple[float, float]:
    """Return the finest run's deviation and the order of convergence; the finest run's impacts and energies must be within multiples of ``close``."""
    scene = scene_of(absorber, modes=2)
    exact = run(scene, DRIVE)
    runs = [run(scene, DRIVE, method) for method in methods]
    errors = [deviation(r, exact) for r in runs]
    fine = runs[-1]
    few = min(3, exact.impact_count)
    np.testing.assert_allclose(fine.impacts.time[:few], exact.impacts.time[:few], rtol=0, atol=10 * close * PERIOD)
    for name in ("work", "friction_loss", "impact_loss", "absorber_damping"):
        values = [getattr(r.energy, name) for r in (fine, exact)]
        assert values[0] == pytest.approx(values[1], rel=20 * close, abs=20 * close * abs(exact.energy.work))
    np.testing.assert_allclose(fine.energy.modal_loss, exact.energy.modal_loss, rtol=0, atol=20 * close * abs(exact.energy.work))
    steps = [method.steps_per_period for method in methods]
    return errors[-1], float(np.log(errors[0] / errors[-1]) / np.log(steps[-1] / steps[0]))


@pytest.mark.parametrize("absorber", LINEAR)
def test_linear_scenes(absorber: Absorber | None) -> None:
    error, order = converge(absorber, [RungeKutta(50), RungeKutta(400)], 1e-8)
    assert error < 1e-8
    assert order > 3.7
    error, order = converge(absorber, [Moreau(100), Moreau(10_000)], 1e-4)
    assert error < 1e-4
    assert order > 0.8


@pytest.mark.parametrize("absorber", RIGID)
def test_rigid_scenes(absorber: Absorber) -> None:
    error, order = converge(absorber, [Moreau(200), Moreau(20_000)], 2e-4)
    assert error < 2e-4
    assert order > 0.6


@pytest.mark.parametrize("absorber", COMPLIANT)
def test_compliant_scenes(absorber: Absorber) -> None:
    error, order = converge(absorber, [RungeKutta(50, 50), RungeKutta(500, 500)], 5e-4)
    assert error < 5e-4
    assert order > 1.3
