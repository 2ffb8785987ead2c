"""Amplitudes far above the gap, on structures nobody chose: every flight is replayed by formulas that share nothing with the search."""

from __future__ import annotations

import numpy as np
import pytest
from replay import replay

from impact_env import (
    Drive,
    IntegrationError,
    ModalModel,
    Record,
    Response,
    Scene,
    SeveralAbsorbers,
    constant_frequency,
    impact_absorber,
    linear_sweep,
    simulate,
)

SCENES = 50


def random_run(seed: int) -> tuple[Response, float]:
    """Return a run of at most 2,000 events and its scale, the amplitude without absorber over the gap, 3e3 to 1e8."""
    rng = np.random.default_rng(seed)
    modes, several = int(rng.integers(1, 5)), rng.random() < 0.3
    omega = np.sort(10 ** rng.uniform(-1, 1.5, modes)) * 10 ** rng.uniform(-1, 3)
    damping = [10 ** rng.uniform(-4, -1, modes), np.zeros(modes), 1 + rng.choice([0, 1e-6, -1e-6, 1e-3], modes)][rng.integers(3 - several)]
    if rng.random() < 0.3 and not several:
        omega[:2] = omega[0]
    drive_omega = omega[0] * rng.choice([0.9, 1.1])
    shapes, places = rng.normal(size=(2, modes)), rng.normal(size=(2, modes))
    force, scale = 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(3.5, 8)
    gap = float(abs(np.sum(force * shapes[0] * shapes[1] / (omega**2 - drive_omega**2 + 2j * damping * omega * drive_omega))) / scale)
    e = float(rng.choice([1.0, 1.0, 0.9, 0.5]))
    absorber = impact_absorber(gap, e, None, float(10 ** rng.uniform(-3, -1)))
    scene = Scene(ModalModel(omega, damping, *shapes, 1.0), absorber)
    if several:  # near critical damping these are refused
        other = impact_absorber(gap * float(rng.uniform(0.1, 10)), e, None, 0.01)
        scene = Scene(ModalModel(omega, damping, *shapes, 1.0, places), SeveralAbsorbers((absorber, other), (1.0, 1.0)))
    drive = Drive(force, constant_frequency(float(omega[0]), drive_omega / float(omega[0]), float(rng.uniform(1, 4))), float(rng.uniform(0, 6)))
    try:
        return simulate(scene, drive, record=Record(events=True), most_events=2000), scale
    except IntegrationError as error:
        if "more events than its budget" not in str(error) or error.response is None:
            raise
        return error.response, scale


def test_no_wall_is_passed_and_every_impact_is_newtons() -> None:
    """Rounding is 1e-16 of the amplitudes, a thousand times that where eigenvectors almost coincide: so much of the gap may be lost."""
    flights = 0
    for seed in range(SCENES):
        response, scale = random_run(seed)
        seen = replay(response)
        assert max(seen.beyond, seen.missed) < 1e-9 + 1e-11 * scale, seed
        assert seen.law < 1e-7, seed
        flights += seen.flights
    assert flights > 30_000


def test_the_replay_sees_a_wall_that_was_passed() -> None:
    """An impact that is told a thousandth of its flight late lies beyond the wall."""
    response, _ = random_run(1)
    assert replay(response).missed < 1e-5
    times = response.impacts.time
    times[5] += 1e-3 * (times[5] - times[4])
    assert replay(response).missed > 1e-5


def test_a_sweep_through_sixty_thousand_gaps() -> None:
    """Its walls were passed 55 times while only the wall of the start was looked for."""
    model = ModalModel([0.0817], [1e-4], [1.33], [1.33], 0.564)
    scene = Scene(model, impact_absorber(1e-3))
    response = simulate(scene, Drive(3.5, linear_sweep(0.0817, 0.1, 1.58, 1.48e4 / 5.1)), record=Record(check=True))
    assert response.check.searches > 10_000
    assert response.check.misses == 0


@pytest.mark.parametrize(("seed", "case"), [(1, 31), (1, 37), (2, 171)])
def test_a_release_near_critical_damping_is_no_storm(seed: int, case: int) -> None:
    """Twenty modes whose eigenvectors almost coincide: an absorber that has just left its wall does not hit it again for ever."""
    rng = np.random.default_rng(seed)
    for k in range(case + 1):
        omega = np.sort(0.28 * 10 ** np.concatenate([[0], rng.uniform(0, 3, 19)])) if k % 2 else 0.28 * np.arange(1, 21) ** 2.0
        damping, shapes = float(rng.choice([0.999999, 0.99, 1.000001])), rng.normal(size=(2, 20))
        still = abs(np.sum(shapes[0] * shapes[1] / (omega**2 - 0.28**2 + 2j * damping * omega * 0.28)))
        force, ratio = 10 ** rng.uniform(0, 4) * 23.5e-6 / still, float(10 ** rng.uniform(-3, -1))
    scene = Scene(ModalModel(omega, np.full(20, damping), *shapes, 1.0), impact_absorber(23.5e-6, 0.7, None, ratio))
    response = simulate(scene, Drive(force, linear_sweep(0.28, 0.9, 1.06, 40)), record=Record(events=True), most_events=20_000)
    assert response.impact_count > 100
    assert len(np.unique(response.impacts.time)) > 0.99 * response.impact_count
