"""The references agree with closed forms, golden cases and one another.

The exact method agrees with them in all kinds of contact.
"""

import json
from fractions import Fraction

import numpy as np
import pytest
from core import OMEGA, PERIOD, Array, cut, drive_of, golden, run, scene_of, steady_base, still
from every_scene import SCENES, SEVERAL
from places import TRUTHS

from impact_env import (
    CompliantWalls,
    Drive,
    FrequencySchedule,
    InitialState,
    ModalModel,
    Response,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    impact_absorber,
)
from reference import dense

mpmath = pytest.importorskip("mpmath")
from reference import digits
from reference.contact import RELEASE_DOWN, RELEASE_UP, REVERSAL, WALL, Automaton
from studies.accuracy.event_driven import (
    Integrator,
    Mechanics,
    PeerFailedError,
    follow,
    scipy_integrator,
)

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
    """Return the largest difference of displacements and velocities.

    Each kind is relative to its largest value. A stuck or absent absorber is left out.
    """
    half = len(true) // 2
    chosen = (
        scene.model.modes
        if scene.absorber is None or isinstance(scene.absorber, StuckAbsorber)
        else half
    )
    parts = [(state[at : at + chosen], true[at : at + chosen]) for at in (0, half)]
    return float(max(np.max(np.abs(one - other)) / np.max(np.abs(other)) for one, other in parts))


# --- closed forms


@pytest.mark.parametrize(
    ("name", "first"), [("rigid_friction_10_modes", 1e-18), ("rigid_frictionless_3_modes", 1e-17)]
)
def test_digits_meet_the_golden_case(name: str, first: float) -> None:
    """The reference with many digits reproduces the golden cases.

    Their inputs have only 16 known digits. The error of a time is a part in 1e16, amplified by the
    impacts.
    """
    scene, drive, _, speeds = golden(name, 1.0)
    case = json.loads((TRUTHS / f"golden_{name}.json").read_text())
    trajectory = digits.follow(scene, drive, impacts=12, rate=case["excitation"]["rate_rad_s2"])
    off = [
        float(abs(Fraction(true) - time))
        for true, time in zip(case["impact_time_s"], trajectory.impact_time, strict=False)
    ]
    assert len(off) == 12
    assert np.all(np.array(off) < first * 8.0 ** np.arange(12))
    np.testing.assert_allclose(trajectory.relative_velocity[:5], speeds[:5], rtol=1e-12)


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
    """The motion of a driven oscillator has 40 correct digits.

    A mode at a constant frequency starts from rest. Its closed form has 60 digits, and in double
    precision 12.
    """
    scene = scene_of(modes=1)
    periods = 2.3
    drive = drive_of(5.0, 0.97, periods=periods, phase=0.4)
    trajectory = digits.follow(scene, drive)
    with mpmath.workdps(DIGITS):
        omega, ratio, shape = (
            mpmath.mpf(float(row[0]))
            for row in (scene.model.omega, scene.model.damping_ratio, scene.model.force_shape)
        )
        force = mpmath.mpf(float(drive.schedule.omegas[0]))
        t = mpmath.mpf(float(drive.schedule.times[1]))
        response = (
            shape
            * 5
            * mpmath.expj(mpmath.mpf(0.4))
            / (omega**2 - force**2 + 2j * ratio * omega * force)
        )
        root = omega * mpmath.sqrt(1 - ratio**2)
        q0 = -response.real
        u0 = -(1j * force * response).real
        swing = mpmath.exp(-ratio * omega * t) * (
            q0 * mpmath.cos(root * t) + (u0 + ratio * omega * q0) / root * mpmath.sin(root * t)
        )
        true = (response * mpmath.expj(force * t)).real + swing
        assert abs(number(trajectory.end[0]) - true) < mpmath.mpf(10) ** -40 * abs(response)
    known = dense.follow(scene, drive, None, np.array([0.0, drive.schedule.times[-1]]))
    assert known.tip[-1] == pytest.approx(float(true) * scene.model.tip_shape[0], rel=1e-12)


def test_contacts_with_springs_have_40_digits() -> None:
    """Contacts with springs have 40 correct digits.

    A mass moves between two springs on a fixed base: half a period in a spring, and uniform flight
    between them.
    """
    gap = 1e-3
    speed = 0.05
    stiffness = 4e4
    mass = 0.25
    scene = Scene(steady_base(), SlidingAbsorber(mass, CompliantWalls(stiffness, gap)))
    trajectory = digits.follow(scene, still(0.3, OMEGA), InitialState(absorber_velocity=speed))
    with mpmath.workdps(DIGITS):
        lasts = mpmath.pi * mpmath.sqrt(mpmath.mpf(mass) / stiffness)
        flight = mpmath.mpf(gap) / mpmath.mpf(speed)
        assert len(trajectory.impact_time) == 6
        for k, time in enumerate(trajectory.impact_time):
            assert abs(number(time) - (flight + k * (2 * flight + lasts))) < mpmath.mpf(10) ** -40
    assert len(trajectory.events) == 12


# --- all contacts


@pytest.mark.parametrize("name", [*SCENES, *SEVERAL])
def test_all_agree(name: str) -> None:
    """The exact method and both references agree.

    They share no formula for a motion. Regimes, releases, ends of chatter and the effects of one
    absorber on others are the same.
    """
    scene, drive = scene_and_drive(name)
    end = float(drive.schedule.times[-1])
    trajectory = digits.follow(scene, drive)
    response = run(scene, drive)
    known = dense.follow(scene, drive, None, np.array([0.0, end]), most_events=MOST_EVENTS)
    assert known.complete
    assert far(scene, known.states[-1], trajectory.end_state) < 1e-9
    assert far(scene, response.end_state, trajectory.end_state) < 1e-8
    assert_same_impacts(trajectory, known, response, scene.places > 1)


def assert_same_impacts(
    trajectory: digits.Trajectory, known: dense.Truth, response: Response, several: bool
) -> None:
    same = min(
        len(trajectory.impact_time),
        len(known.impacts),
        len(response.impacts.time),
        12 if several else 4,
    )
    assert same >= (3 if several else 0)
    times = [float(t) for t in trajectory.impact_time[:same]]
    for other in (known.impacts, response.impacts.time):
        np.testing.assert_allclose(other[:same], times, rtol=0, atol=1e-10 * PERIOD)
    for velocity in (known.impact_velocity, response.impacts.relative_velocity):
        np.testing.assert_allclose(
            velocity[:same], trajectory.relative_velocity[:same], rtol=1e-6, atol=1e-12
        )
    for absorber in (known.impact_absorber, response.impacts.absorber):
        np.testing.assert_array_equal(absorber[:same], trajectory.impact_absorber[:same])


def test_breaks_of_the_schedule() -> None:
    scene = scene_of(impact_absorber(5e-4, 0.7, 0.1), modes=2)
    times = np.array([0.0, 0.7, 1.1, 2.0]) * PERIOD
    omegas = np.array([0.9, 1.1, 0.8, 1.0]) * OMEGA
    bent = Drive(15.0, FrequencySchedule(times, omegas, OMEGA))
    trajectory = digits.follow(scene, bent)
    known = dense.follow(scene, bent, None, np.linspace(0, times[-1], 20))
    assert len(trajectory.impact_time) == len(known.impacts) > 2
    assert far(scene, known.states[-1], trajectory.end_state) < 1e-10
    assert far(scene, run(scene, bent).end_state, trajectory.end_state) < 1e-10
    with pytest.raises(ValueError, match="straight"):
        digits.follow(scene, bent, rate=1.0)


# --- the exact method's events with friction, one by one

EVENTS = 40
OTHER = ModalModel(
    [60.0, 61.0, 340.0, 2100.0],
    [0.002, 0.0, 0.3, 0.05],
    [1.1, -0.7, 0.9, 0.4],
    [1.0, 0.8, -1.3, 1.6],
    0.4,
)
CASES: dict[str, tuple[Scene, Drive, InitialState]] = {
    "paper": (
        scene_of(impact_absorber(1e-3, 0.7, 0.3), modes=5),
        drive_of(3.5, 0.98, 0.99, periods=10),
        InitialState(np.array([5e-4, 1e-5, 0.0, 0.0, 0.0])),
    ),
    "other": (
        Scene(OTHER, impact_absorber(4e-4, 0.85, 0.05, 0.05)),
        drive_of(3.0, 0.95, 1.05, periods=12, reference=60.0, phase=0.3),
        InitialState(),
    ),
}


def speed_at(scene: Scene, drive: Drive, initial: InitialState, time: float) -> float:
    """Return the relative velocity of a run that ends at a time."""
    state = run(scene, cut(drive, time), initial=initial, samples=4).end_state
    n = scene.model.modes
    return float(state[-1] - scene.model.tip_shape @ state[n + 1 : -1])


@pytest.mark.parametrize("name", CASES)
def test_impacts_reversals_sticking_and_releases_are_those_of_many_digits(name: str) -> None:
    scene, drive, initial = CASES[name]
    true = digits.follow(scene, drive, initial, events=EVENTS)
    response = run(scene, drive, initial=initial, samples=4)
    first = (
        [(REVERSAL, 0.0, true.start[0])] if true.start[0] == "stuck" else []
    )  # a start that sticks counts as a reversal at 0
    events = [*first, *((event.what, float(event.time), event.regime) for event in true.events)][
        :EVENTS
    ]
    walls = np.cumsum([kind == WALL for kind, _, _ in events])
    slack = np.minimum(1e-12 * 5.0**walls, 1e-8) * drive.schedule.pseudo_period

    def same(recorded: Array, chosen: list[int], least: int) -> None:
        times = np.array([events[k][1] for k in chosen])
        assert len(times) >= least
        assert np.sum(recorded < events[-1][1] + slack[-1]) == len(times)
        assert np.all(np.abs(recorded[: len(times)] - times) < slack[chosen])

    same(response.impacts.time, [k for k, (kind, _, _) in enumerate(events) if kind == WALL], 4)
    same(
        response.phases.start,
        [
            k
            for k, (_, _, regime) in enumerate(events)
            if regime == "stuck" or regime.startswith("held")
        ],
        4,
    )
    same(
        response.phases.end,
        [k for k, (kind, _, _) in enumerate(events) if kind in (RELEASE_UP, RELEASE_DOWN)],
        4,
    )
    turns = [
        k
        for k, (kind, _, regime) in enumerate(events)
        if kind == REVERSAL and regime.startswith("slide")
    ]
    assert len(turns) >= 2
    for k in turns:
        _, time, regime = events[k]
        before, after = (
            speed_at(scene, drive, initial, time + sign * slack[k]) for sign in (-1, 1)
        )
        assert before * after < 0
        assert (after > 0) == (regime == "slide +")


# --- the peers that are measured against the package

REST = InitialState()


@pytest.mark.parametrize(
    "name", ["friction", "impacts", "impacts and friction", "springs", "tuned"]
)
@pytest.mark.parametrize(
    ("peer", "balance", "far"), [("scipy", 1e-8, 1e-5), ("heyoka", 1e-11, 1e-8)]
)
def test_peers_follow_the_reference(peer: str, name: str, balance: float, far: float) -> None:
    """Its impacts are those of the reference, and its end state, relative to the largest entry."""
    integrator = scipy_integrator(1e-10)
    if peer == "heyoka":
        integrator = pytest.importorskip(
            "studies.accuracy.heyoka_peer", exc_type=ImportError
        ).HeyokaRegimes(1e-15)
    scene = scene_of(SCENES[name], modes=2)
    drive = drive_of(12.0, 0.97, 1.0, periods=3.3)
    reference = follow(scene, drive, REST, integrator, energy=True)
    true = digits.follow(scene, drive)
    assert reference.balance < balance
    assert len(reference.impact_time) == len(true.impact_time)
    assert np.max(np.abs(reference.end_state - true.end_state)) < far * np.max(
        np.abs(true.end_state)
    )


def test_a_peer_that_misses_a_wall_is_refused() -> None:
    def blind(mechanics: Mechanics, automaton: Automaton) -> Integrator:
        step = scipy_integrator(1e-6)(mechanics, automaton)

        def integrate(
            _: object, start: float, stop: float, state: np.ndarray
        ) -> tuple[float, np.ndarray, int]:
            return step(automaton.regime("linear"), start, stop, state)

        return integrate

    with pytest.raises(PeerFailedError, match="passed a guard"):
        follow(
            scene_of(SCENES["impacts"], modes=1),
            still(0.1),
            InitialState(absorber_velocity=0.05),
            blind,
        )
