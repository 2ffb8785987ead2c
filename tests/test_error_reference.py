"""The high-precision reference and the peers that are measured against it."""

from __future__ import annotations

import json
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from core import OMEGA, PERIOD, drive_of, run, scene_of, steady_base, still
from stepped import TRUTHS, golden

from impact_env import CompliantWalls, InitialState, Scene, SlidingAbsorber, StuckAbsorber, TunedAbsorber, friction_damper, impact_absorber

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))

mpmath = pytest.importorskip("mpmath")
from accuracy import taylor  # noqa: E402 - the scripts' folder is known only now
from accuracy.contact_automaton import Automaton  # noqa: E402
from accuracy.event_driven import Integrator, Mechanics, PeerFailedError, PeerRun, follow, scipy_integrator  # noqa: E402
from accuracy.reference import reference  # noqa: E402

DIGITS = 45
REST = InitialState()
SCENES = {
    "friction": friction_damper(0.3),
    "impacts": impact_absorber(restitution=0.8),
    "impacts and friction": impact_absorber(restitution=0.6, friction_limit=0.1),
    "chatter": impact_absorber(restitution=0.3),
    "no rebound": impact_absorber(restitution=0.0, friction_limit=0.05),
    "springs": SlidingAbsorber(walls=CompliantWalls(3e5)),
    "tuned": TunedAbsorber(),
    "stuck": StuckAbsorber(),
}


def number(value: Fraction) -> mpmath.mpf:
    return mpmath.mpf(value.numerator) / value.denominator


@pytest.mark.parametrize(("name", "first"), [("rigid_friction_10_modes", 1e-18), ("rigid_frictionless_3_modes", 1e-17)])
def test_reference_meets_the_golden_case(name: str, first: float) -> None:
    """The golden times hang on inputs of which 16 digits are known: a part in 1e16 of the time, and what the impacts make of it."""
    scene, drive, _, speeds = golden(name, 1.0)
    case = json.loads((TRUTHS / f"golden_{name}.json").read_text())
    found = reference(scene, drive, impacts=12, rate=case["excitation"]["rate_rad_s2"])
    off = [float(abs(Fraction(true) - time)) for true, time in zip(case["impact_time_s"], found.impact_time, strict=False)]
    assert len(off) == 12
    assert np.all(np.array(off) < first * 8.0 ** np.arange(12))
    np.testing.assert_allclose(found.relative_velocity[:5], speeds[:5], rtol=1e-12)


def test_reference_does_not_depend_on_its_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, drive, *_ = golden("rigid_friction_10_modes", 1.0)
    times = []
    for reach in (2.0, 1.3):
        monkeypatch.setattr(taylor, "REACH", reach)
        times.append(reference(scene, drive, impacts=5).impact_time)
    off = [float(abs(one - other)) for one, other in zip(*times, strict=True)]
    assert off[0] < 1e-30
    assert max(off) < 1e-26


def test_reference_of_a_driven_oscillator_has_28_digits() -> None:
    """A mode at a constant frequency from rest, in closed form with 45 digits."""
    scene, periods = scene_of(modes=1), 2.3
    drive = drive_of(5.0, 0.97, periods=periods, phase=0.4)
    found = reference(scene, drive)
    with mpmath.workdps(DIGITS):
        omega, ratio, shape = (mpmath.mpf(float(row[0])) for row in (scene.model.omega, scene.model.damping_ratio, scene.model.force_shape))
        force, t = mpmath.mpf(float(drive.schedule.omegas[0])), mpmath.mpf(float(drive.schedule.times[1]))
        response = shape * 5 * mpmath.expj(0.4) / (omega**2 - force**2 + 2j * ratio * omega * force)
        root = omega * mpmath.sqrt(1 - ratio**2)
        q0, u0 = -response.real, -(1j * force * response).real
        swing = mpmath.exp(-ratio * omega * t) * (q0 * mpmath.cos(root * t) + (u0 + ratio * omega * q0) / root * mpmath.sin(root * t))
        true = (response * mpmath.expj(force * t)).real + swing
        assert abs(number(found.end[0]) - true) < mpmath.mpf(10) ** -28 * abs(response)


def test_contacts_with_springs_have_28_digits() -> None:
    """A mass between two springs on a fixed base: half a period in a spring, and uniform flight between them."""
    gap, speed, stiffness, mass = 1e-3, 0.05, 4e4, 0.25
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, gap)))
    found = reference(scene, still(0.3, OMEGA), InitialState(absorber_velocity=speed))
    with mpmath.workdps(DIGITS):
        lasts = mpmath.pi * mpmath.sqrt(mpmath.mpf(mass) / stiffness)
        flight = mpmath.mpf(gap) / mpmath.mpf(speed)
        assert len(found.impact_time) == 6
        for k, time in enumerate(found.impact_time):
            assert abs(number(time) - (flight + k * (2 * flight + lasts))) < mpmath.mpf(10) ** -29
    assert found.events == 12


@pytest.mark.parametrize("name", SCENES)
def test_exact_method_agrees(name: str) -> None:
    """Two methods that share no formula: regimes, releases and ends of chatter are the same."""
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    found, response = reference(scene, drive), run(scene, drive)
    assert response.impacts is not None
    n, scale = scene.model.modes, np.max(np.abs(found.end_state))
    kept = np.delete(np.arange(2 * n + 2), [n, 2 * n + 1]) if name == "stuck" else np.arange(2 * n + 2)
    np.testing.assert_allclose(response.end_state[kept], found.end_state[kept], rtol=0, atol=1e-8 * scale)
    same = min(len(found.impact_time), len(response.impacts.time), 4)
    assert same > 0 or name in ("friction", "tuned", "stuck")
    np.testing.assert_allclose(response.impacts.time[:same], [float(t) for t in found.impact_time[:same]], rtol=0, atol=1e-11 * PERIOD)


def test_reference_refuses_what_it_does_not_cover() -> None:
    from impact_env import ElasticCoulombFriction

    with pytest.raises(ValueError, match="elastic friction"):
        reference(scene_of(SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e4))), drive_of(1.0, 1.0))
    with pytest.raises(ValueError, match="straight"):
        reference(scene_of(), drive_of(1.0, 0.9, 1.0, 0.9))


# --- peers -------------------------------------------------------------------------------------------------------------------------------------


def distance(name: str, found: PeerRun) -> float:
    """Return a peer's largest error of the end state, relative to its largest entry; its impacts must be those of the reference."""
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    true = reference(scene, drive)
    assert len(found.impact_time) == len(true.impact_time) or name == "chatter"
    return float(np.max(np.abs(found.end_state - true.end_state)) / np.max(np.abs(true.end_state)))


@pytest.mark.parametrize("name", ["friction", "impacts", "springs", "tuned"])
def test_scipy_follows_the_reference(name: str) -> None:
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    found = follow(scene, drive, REST, scipy_integrator(1e-10), energy=True)
    assert found.balance is not None
    assert found.balance < 1e-8
    assert distance(name, found) < 1e-5


@pytest.mark.parametrize("name", ["friction", "impacts", "impacts and friction", "springs", "tuned"])
def test_heyoka_follows_the_reference(name: str) -> None:
    heyoka_peer = pytest.importorskip("optimisation.studies.accuracy.heyoka_peer", exc_type=ImportError)
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    found = follow(scene, drive, REST, heyoka_peer.heyoka_integrator(1e-15), energy=True)
    assert found.balance is not None
    assert found.balance < 1e-11
    assert distance(name, found) < 1e-8


def test_a_peer_that_misses_a_wall_is_refused() -> None:
    def blind(mechanics: Mechanics, automaton: Automaton) -> Integrator:
        step = scipy_integrator(1e-6)(mechanics, automaton)

        def integrate(_: object, start: float, stop: float, state: np.ndarray) -> tuple[float, np.ndarray, int]:
            return step(automaton.regime("linear"), start, stop, state)

        return integrate

    with pytest.raises(PeerFailedError, match="passed a guard"):
        follow(scene_of(SCENES["impacts"], modes=1), still(0.1), InitialState(absorber_velocity=0.05), blind)
