"""Work and losses of runs agree with integrals of splines through their velocities.

The splines go through the recorded velocities and share nothing with the closed forms of the
kernels.
"""

from itertools import pairwise

import numpy as np
import pytest
import scipy.interpolate
from core import OMEGA, PERIOD, Array, drive_of, run, scene_of

from impact_env import (
    CompliantWalls,
    Drive,
    ElasticCoulombFriction,
    InitialState,
    ModalModel,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    solvers,
)
from impact_env.parameters import Absorber
from impact_env.results import Response
from impact_env.solvers import compute_window_length

DEGREE = 5
# in a pseudo period: where friction changes there is a kink, which costs a spline the square of the
# distance
SAMPLES = 40_000


def own_beam(*damping: float) -> ModalModel:
    """Return a base unlike the paper's.

    It has frequencies close to each other, a mode with a node at the tip, and any damping.
    """
    omega = np.array([1.0, 1.3, 2.9, 7.7])[: len(damping)] * OMEGA
    return ModalModel(
        omega,
        np.array(damping),
        [0.9, -1.3, 0.4, 0.7][: len(damping)],
        [1.6, 1.1, 0.0, -1.9][: len(damping)],
        0.6,
    )


def rows_of(response: Response) -> Array:
    """Return the integrands of the energies, (S, N_m + 2).

    They are the modal velocities squared, the power of the force, and the damper's relative
    velocity squared.
    """
    history = response.history
    model = response.scene.model
    drive = response.drive
    force = drive.amplitude * np.cos(drive.schedule.phase_at(history.time) + drive.phase)
    relative = np.zeros_like(history.time)
    if isinstance(response.scene.absorber, TunedAbsorber):
        relative = history.absorber_velocity - history.modal_velocity @ model.tip_shape
    return np.column_stack(
        [
            history.modal_velocity**2,
            force * (history.modal_velocity @ model.force_shape),
            relative**2,
        ]
    )


def integrals(response: Response) -> Array:
    """Return the integrals over a run, (N_m + 2,).

    Splines go from one impact or breakpoint of the drive to the next and are extrapolated to these
    times.
    """
    times = response.history.time
    rows = rows_of(response)
    edges = np.unique(np.concatenate([response.impacts.time, response.drive.schedule.times]))
    edges = edges[np.append(True, np.diff(edges) > 1e-9 * PERIOD)]
    total = np.zeros(rows.shape[1])
    for begin, end in pairwise(edges):
        inside = (times >= begin - 1e-12 * PERIOD) & (times <= end + 1e-12 * PERIOD)
        if begin in response.impacts.time:
            inside &= times > begin
        if end in response.impacts.time:
            inside &= times < end
        assert np.sum(inside) > DEGREE
        primitive = scipy.interpolate.make_interp_spline(
            times[inside], rows[inside], k=DEGREE
        ).antiderivative()
        total += primitive(end) - primitive(begin)
    return total


def assert_account(
    scene: Scene,
    drive: Drive,
    initial: InitialState | None = None,
    samples: int = SAMPLES,
    error: float = 1e-10,
) -> Response:
    """Compare a run's account with splines, relative to the largest term, and check its balance."""
    response = run(scene, drive, initial=initial, samples=samples)
    account = response.energy
    model = scene.model
    truth = integrals(response)
    damper = scene.absorber.damping if isinstance(scene.absorber, TunedAbsorber) else 0.0
    loss = 2 * np.array(model.damping_ratio) * model.omega * truth[: model.modes]
    largest = max(
        abs(account.work),
        float(np.max(account.modal_loss)),
        account.stored_at_start,
        account.stored_at_end,
    )
    np.testing.assert_allclose(account.modal_loss, loss, rtol=0, atol=error * largest)
    assert account.work == pytest.approx(truth[model.modes], abs=error * largest)
    assert account.absorber_damping == pytest.approx(
        damper * truth[model.modes + 1], abs=error * largest
    )
    assert account.relative_error < 1e-11
    return response


ABSORBERS = {
    "impacts": impact_absorber(gap=3e-4, restitution=0.9),
    "impacts and friction": impact_absorber(gap=3e-4, restitution=0.9, friction_limit=0.05),
    "stuck by friction": friction_damper(3.0),
    "none": None,
    "stuck": StuckAbsorber(0.05),
    "tuned": TunedAbsorber(),
    "springs": SlidingAbsorber(walls=CompliantWalls(1e5, 2e-4)),
    "springs and elastic friction": SlidingAbsorber(
        walls=CompliantWalls(1e5, 2e-4), friction=ElasticCoulombFriction(0.2, 3e3)
    ),
    "impacts of two": impact_absorbers(
        (3e-4, 1e-4), (1.0, 0.6), restitution=(0.9, 1.0), shares=(0.6, 0.4)
    ),
}


@pytest.mark.parametrize("name", ABSORBERS)
def test_all_absorbers(name: str) -> None:
    response = assert_account(
        scene_of(ABSORBERS[name], modes=10 if name == "impacts and friction" else 3),
        drive_of(3.5, 0.97, 1.03, periods=4),
    )
    assert response.impact_count > 1 or not name.startswith(("impacts", "springs"))
    assert response.stuck_time > PERIOD or not name.startswith("stuck")


@pytest.mark.parametrize(
    "damping",
    [(0.0, 0.0, 0.0, 0.0), (0.02, 1.7, 0.1, 0.003), (1.0, 0.01, 0.0, 0.2), (0.05, 0.02, 4.0, 0.3)],
)
@pytest.mark.parametrize(
    "absorber",
    [
        impact_absorber(mass_ratio=0.1, restitution=0.8, gap=3e-4),
        friction_damper(0.4, mass_ratio=0.1),
        TunedAbsorber(0.1),
    ],
)
def test_any_damping(damping: tuple[float, ...], absorber: Absorber) -> None:
    """Also modes that share slots, and two slots that almost coincide (damping ratio 1)."""
    assert_account(Scene(own_beam(*damping), absorber), drive_of(6.0, 0.8, 1.5, periods=3))


@pytest.mark.parametrize("periods", [0.02, 1.5, 6.0])
@pytest.mark.parametrize(
    "absorber",
    [
        TunedAbsorber(0.1),
        friction_damper(0.4, mass_ratio=0.1),
        SlidingAbsorber(walls=CompliantWalls(1e5, 2e-4), mass_ratio=0.1),
    ],
)
def test_modes_side_by_side(absorber: Absorber, periods: float) -> None:
    """Energies are correct for modes with close frequencies.

    The frequencies are closer than a twentieth. If their difference causes almost no change of
    phase, the integral of a pair is a series.
    """
    model = ModalModel(
        np.array([1.0, 1.01, 1.03]) * OMEGA,
        np.array([0.01, 0.0, 0.02]),
        [0.9, -1.3, 0.4],
        [1.6, 1.1, -0.7],
        0.6,
    )
    initial = InitialState(np.array([1e-3, -5e-4, 2e-4]), np.array([0.1, 0.2, -0.1]))
    assert_account(
        Scene(model, absorber),
        drive_of(6.0, 0.95, 1.1, periods=periods, phase=0.3),
        initial,
        samples=max(SAMPLES, int(200 / periods)),
    )


@pytest.mark.parametrize("ratios", [(0.0, 0.02), (0.3, 0.0), (5.0, 9.0), (1.0, 1.0), (0.9, 1.1)])
@pytest.mark.parametrize("periods", [0.02, 0.4, 3.0])
@pytest.mark.parametrize("absorber", [None, TunedAbsorber()])
def test_any_drive_and_length(
    ratios: tuple[float, ...], periods: float, absorber: Absorber | None
) -> None:
    """Energies are correct for any drive and length of the run.

    This includes a force whose phase hardly changes, and windows so short that no phase changes. In
    these cases the closed forms are series.
    """
    scene = Scene(own_beam(0.0, 0.01, 0.1), absorber)
    drive = drive_of(3.0, *ratios, periods=periods, phase=0.3)
    assert_account(
        scene,
        drive,
        InitialState(np.array([1e-3, -5e-4, 2e-4]), np.array([0.1, 0.2, -0.1])),
        samples=max(400, int(200 / periods)),
    )


def test_the_balance_notices_a_wrong_propagation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The energy balance detects a wrong propagation.

    The balance must not follow from the motion that it checks. Slots that decay a little too
    slowly, or a forced part that is too large, give a balance error.
    """
    scene = scene_of(None)
    drive = drive_of(3.5, 0.97, 1.03, periods=40)
    start = InitialState(modal_velocity=np.array([0.1, 0.0, 0.0]))
    exact = run(scene, drive, initial=start).energy
    regime, reach = solvers.linear_regime(scene, compute_window_length(drive))
    assert exact.relative_error < 1e-13
    system = regime.system
    table = system.table.copy()
    rows = system.rows.copy()
    table[:, 0, 1:] *= 1 + 1e-8
    rows[4:6] *= 1 + 1e-8  # DRIVE
    for spoiled in (system._replace(table=table), system._replace(rows=rows)):
        monkeypatch.setattr(
            solvers,
            "linear_regime",
            lambda *_, spoiled=spoiled: (regime._replace(system=spoiled), reach),
        )
        account = run(scene, drive, initial=start).energy
        assert account.relative_error > 1e-10
