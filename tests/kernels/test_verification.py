"""The references themselves: against closed forms and golden cases, one another, and the exact method."""

import json
from fractions import Fraction

import numpy as np
import pytest
from core import OMEGA, PERIOD, drive_of, run, scene_of, steady_base, still
from every_scene import SCENES, SEVERAL
from places import TRUTHS
from stepped import golden

from impact_env import CompliantWalls, Drive, FrequencySchedule, InitialState, Response, Scene, SlidingAbsorber, StuckAbsorber, impact_absorber
from reference import dense

mpmath = pytest.importorskip("mpmath")
from reference import digits

DIGITS = 60
MOST_EVENTS = 1000


def number(value: Fraction) -> mpmath.mpf:
    return mpmath.mpf(value.numerator) / value.denominator


def scene_and_drive(name: str) -> tuple[Scene, Drive]:
    if name in SCENES:
        return scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    scene, force, ratio, periods = SEVERAL[name]
    return scene, drive_of(force, ratio, periods=periods)


def far(scene: Scene, state: np.ndarray, true: np.ndarray) -> float:
    """Largest difference of displacements and velocities, each kind relative to its largest; an absorber that is stuck or absent is left out."""
    half = len(true) // 2
    kept = scene.model.modes if scene.absorber is None or isinstance(scene.absorber, StuckAbsorber) else half
    parts = [(state[at : at + kept], true[at : at + kept]) for at in (0, half)]
    return float(max(np.max(np.abs(one - other)) / np.max(np.abs(other)) for one, other in parts))


# --- closed forms ------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "first"), [("rigid_friction_10_modes", 1e-18), ("rigid_frictionless_3_modes", 1e-17)])
def test_digits_meet_the_golden_case(name: str, first: float) -> None:
    """The golden times hang on inputs of which 16 digits are known: a part in 1e16 of the time, and what the impacts make of it."""
    scene, drive, _, speeds = golden(name, 1.0)
    case = json.loads((TRUTHS / f"golden_{name}.json").read_text())
    found = digits.follow(scene, drive, impacts=12, rate=case["excitation"]["rate_rad_s2"])
    off = [float(abs(Fraction(true) - time)) for true, time in zip(case["impact_time_s"], found.impact_time, strict=False)]
    assert len(off) == 12
    assert np.all(np.array(off) < first * 8.0 ** np.arange(12))
    np.testing.assert_allclose(found.relative_velocity[:5], speeds[:5], rtol=1e-12)


def test_digits_do_not_depend_on_their_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, drive, *_ = golden("rigid_frictionless_3_modes", 1.0)
    times = []
    for reach in (6.0, 4.1):
        monkeypatch.setattr(digits, "REACH", reach)
        times.append(digits.follow(scene, drive, impacts=3).impact_time)
    off = [float(abs(one - other)) for one, other in zip(*times, strict=True)]
    assert off[0] < 1e-42
    assert max(off) < 1e-38


def test_a_driven_oscillator_has_40_digits() -> None:
    """A mode at a constant frequency from rest, in closed form with 60 digits; in double precision it has 12."""
    scene, periods = scene_of(modes=1), 2.3
    drive = drive_of(5.0, 0.97, periods=periods, phase=0.4)
    found = digits.follow(scene, drive)
    with mpmath.workdps(DIGITS):
        omega, ratio, shape = (mpmath.mpf(float(row[0])) for row in (scene.model.omega, scene.model.damping_ratio, scene.model.force_shape))
        force, t = mpmath.mpf(float(drive.schedule.omegas[0])), mpmath.mpf(float(drive.schedule.times[1]))
        response = shape * 5 * mpmath.expj(mpmath.mpf(0.4)) / (omega**2 - force**2 + 2j * ratio * omega * force)
        root = omega * mpmath.sqrt(1 - ratio**2)
        q0, u0 = -response.real, -(1j * force * response).real
        swing = mpmath.exp(-ratio * omega * t) * (q0 * mpmath.cos(root * t) + (u0 + ratio * omega * q0) / root * mpmath.sin(root * t))
        true = (response * mpmath.expj(force * t)).real + swing
        assert abs(number(found.end[0]) - true) < mpmath.mpf(10) ** -40 * abs(response)
    known = dense.follow(scene, drive, None, np.array([0.0, drive.schedule.times[-1]]))
    assert known.tip[-1] == pytest.approx(float(true) * scene.model.tip_shape[0], rel=1e-12)


def test_contacts_with_springs_have_40_digits() -> None:
    """A mass between two springs on a fixed base: half a period in a spring, and uniform flight between them."""
    gap, speed, stiffness, mass = 1e-3, 0.05, 4e4, 0.25
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, gap)))
    found = digits.follow(scene, still(0.3, OMEGA), InitialState(absorber_velocity=speed))
    with mpmath.workdps(DIGITS):
        lasts = mpmath.pi * mpmath.sqrt(mpmath.mpf(mass) / stiffness)
        flight = mpmath.mpf(gap) / mpmath.mpf(speed)
        assert len(found.impact_time) == 6
        for k, time in enumerate(found.impact_time):
            assert abs(number(time) - (flight + k * (2 * flight + lasts))) < mpmath.mpf(10) ** -40
    assert len(found.events) == 12


def test_a_free_flight_of_the_dense_reference() -> None:
    """An absorber that flies from a wall to the other over a beam at rest: the impact is at distance over speed."""
    scene = scene_of(impact_absorber(1e-3, 1.0), modes=2)
    known = dense.follow(scene, still(PERIOD), InitialState(absorber_displacement=-1e-3, absorber_velocity=0.25), np.linspace(0, PERIOD, 33), 1)
    np.testing.assert_allclose(known.impacts[:1], [2e-3 / 0.25], rtol=1e-12)
    before = known.time < known.impacts[0]
    np.testing.assert_allclose(known.relative[before], -1e-3 + 0.25 * known.time[before], rtol=0, atol=1e-16)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_an_absorber_that_starts_on_a_wall_and_into_it_hits_at_once(restitution: float) -> None:
    scene = Scene(steady_base(), impact_absorber(1e-3, restitution, mass_ratio=1.0))
    start, end = InitialState(absorber_displacement=1e-3, absorber_velocity=0.05), 1e-3
    known, found = dense.follow(scene, still(end), start, np.array([0.0, end])), digits.follow(scene, still(end), start)
    for times, speeds in ((known.impacts, known.impact_velocity), (found.impact_time, found.relative_velocity)):
        assert list(times) == [0.0]
        assert list(speeds) == [0.05]
    for state in (known.states[-1], found.end_state):
        np.testing.assert_allclose(state[[1, 3]], [1e-3 - restitution * 0.05 * end, -restitution * 0.05], rtol=1e-12, atol=1e-18)


# --- all contacts ------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*SCENES, *SEVERAL])
def test_all_agree(name: str) -> None:
    """Three methods that share no formula for a motion: regimes, releases, ends of chatter and what one absorber does to others are the same."""
    scene, drive = scene_and_drive(name)
    end = float(drive.schedule.times[-1])
    found, response = digits.follow(scene, drive), run(scene, drive)
    known = dense.follow(scene, drive, None, np.array([0.0, end]), most_events=MOST_EVENTS)
    assert known.complete
    assert far(scene, known.states[-1], found.end_state) < 1e-9
    assert far(scene, response.end_state, found.end_state) < 1e-8
    assert_same_impacts(found, known, response, scene.places > 1)


def assert_same_impacts(found: digits.Trajectory, known: dense.Truth, response: Response, several: bool) -> None:
    same = min(len(found.impact_time), len(known.impacts), len(response.impacts.time), 12 if several else 4)
    assert same >= (3 if several else 0)
    times = [float(t) for t in found.impact_time[:same]]
    for other in (known.impacts, response.impacts.time):
        np.testing.assert_allclose(other[:same], times, rtol=0, atol=1e-10 * PERIOD)
    for velocity in (known.impact_velocity, response.impacts.relative_velocity):
        np.testing.assert_allclose(velocity[:same], found.relative_velocity[:same], rtol=1e-6, atol=1e-12)
    for absorber in (known.impact_absorber, response.impacts.absorber):
        np.testing.assert_array_equal(absorber[:same], found.impact_absorber[:same])


def test_breaks_of_the_schedule() -> None:
    """A bent schedule; and breaks in a straight one change nothing, to the last digits."""
    scene = scene_of(impact_absorber(5e-4, 0.7, 0.1), modes=2)
    times, omegas = np.array([0.0, 0.7, 1.1, 2.0]) * PERIOD, np.array([0.9, 1.1, 0.8, 1.0]) * OMEGA
    bent = Drive(15.0, FrequencySchedule(times, omegas, OMEGA))
    found, known = digits.follow(scene, bent), dense.follow(scene, bent, None, np.linspace(0, times[-1], 20))
    assert len(found.impact_time) == len(known.impacts) > 2
    assert far(scene, known.states[-1], found.end_state) < 1e-10
    assert far(scene, run(scene, bent).end_state, found.end_state) < 1e-10
    halves = Drive(15.0, FrequencySchedule(np.array([0.0, 0.5, 1.0]), np.array([200.0, 250.0, 300.0]), OMEGA))
    whole = Drive(15.0, FrequencySchedule(np.array([0.0, 1.0]), np.array([200.0, 300.0]), OMEGA))
    one, other = (digits.follow(scene, drive, impacts=2, until=0.6) for drive in (halves, whole))
    assert abs(one.impact_time[-1] - other.impact_time[-1]) < 1e-38
    with pytest.raises(ValueError, match="straight"):
        digits.follow(scene, bent, rate=1.0)


def test_a_reference_that_cannot_go_on_says_so() -> None:
    scene, drive = scene_and_drive("springs and elastic friction")
    known = dense.follow(scene, drive, None, np.array([0.0, float(drive.schedule.times[-1])]), most_events=5)
    assert not known.complete
    assert len(known.time) == 1


def test_a_spoiled_motion_is_noticed() -> None:
    """A friction limit that is wrong by a millionth shows: the comparisons above do not pass by themselves."""
    scene, drive = scene_and_drive("impacts and friction")
    spoiled = scene_of(impact_absorber(restitution=0.6, friction_limit=0.1 * (1 + 1e-6)), modes=2)
    found = digits.follow(scene, drive)
    end = np.array([0.0, float(drive.schedule.times[-1])])
    assert far(scene, dense.follow(spoiled, drive, None, end).states[-1], found.end_state) > 1e-8
