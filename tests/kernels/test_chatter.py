"""A chatter against the bouncing ball: a base that a steady force accelerates, and an absorber so light that the base does not feel it."""

import numpy as np
import pytest
from core import Array, run
from scipy.optimize import brentq

from impact_env import Drive, ModalModel, Scene, constant_frequency, impact_absorber

FORCE, OMEGA, GAP = 1.0, 0.1, 1e-3
TERMS = 2 * FORCE / OMEGA**2  # m: what the base's displacement is the difference of
ROUNDING = 64 * 2.2e-16 * TERMS  # as docs/method.md has it


def bounces(e: float, count: int) -> tuple[Array, Array]:
    """Return times (s) and relative speeds (m/s) before the impacts; the base moves as FORCE/OMEGA^2 (1 - cos OMEGA t)."""

    def fallen(start: float, t: float) -> float:
        """Distance that the base makes from ``start`` on beside its motion at constant speed, without differences of near numbers."""
        half = OMEGA * t / 2
        return FORCE / OMEGA**2 * (2 * np.cos(OMEGA * start) * np.sin(half) ** 2 + np.sin(OMEGA * start) * (np.sin(2 * half) - 2 * half))

    times, speeds, speed = [0.0], list[float](), 0.0
    for _ in range(count):
        start = times[-1]
        guess = np.sqrt(2 * GAP / FORCE) if speed == 0 else 2 * speed / (FORCE * np.cos(OMEGA * start))
        room = GAP if speed == 0 else 0.0
        t = brentq(lambda t: (fallen(start, t) - room) / t - speed, 0.5 * guess, 2 * guess, xtol=1e-16, rtol=1e-14)  # noqa: B023
        times.append(start + t)
        speeds.append(FORCE / OMEGA * (np.sin(OMEGA * (start + t)) - np.sin(OMEGA * start)) - speed)
        speed = e * speeds[-1]
    return np.array(times[1:]), np.array(speeds)


@pytest.mark.parametrize("e", [0.5, 0.9, 0.99])
def test_a_chatter_is_a_bouncing_ball_down_to_rounding(e: float) -> None:
    """Each bounce is computed, and what the last impact closes is below what docs/method.md says."""
    scene, period = Scene(ModalModel([OMEGA], [0.0], [1.0], [1.0], 1.0), impact_absorber(GAP, e, mass_ratio=1e-9)), 0.1
    end = np.sqrt(2 * GAP / FORCE) * (1 + 2 * e / (1 - e))
    response = run(scene, Drive(FORCE, constant_frequency(2 * np.pi / period, 0.0, 1.2 * end / period)), samples=4)
    impacts, phases = response.impacts, response.phases
    assert len(phases.start) == 1
    closed = e * abs(impacts.relative_velocity[-1])
    share = closed / abs(impacts.relative_velocity[0])
    print(f"e = {e}: {len(impacts.time)} impacts, the last closes {share:.1e} of the first one's speed")
    assert closed < np.sqrt(2 * FORCE * max(1 - e, 0.1) * ROUNDING)
    assert share < 2e-5
    times, speeds = bounces(e, len(impacts.time))
    early = speeds > 1e3 * closed
    assert np.sum(early) > 0.3 * len(times)
    np.testing.assert_allclose(impacts.time[early], times[early], rtol=1e-6)
    np.testing.assert_allclose(-impacts.relative_velocity[early], speeds[early], rtol=1e-4)
