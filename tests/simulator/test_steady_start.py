"""Runs from the steady state of the linear structure have no transient at any phase.

The closed forms are modal sums.
"""

from dataclasses import replace

import numpy as np
import pytest

from impact_env import Beam, Drive, Record, Scene, modal_model, simulate
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import constant_frequency, linear_sweep
from impact_env.ensemble import Lane, run_lanes
from impact_env.frequency import find_steady_start
from impact_env.loads import BASE_QUANTITY, Loads, ShakenBase, Shock, Tone, Tones
from impact_env.parameters import (
    Absorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)

MODEL = modal_model(Beam(modes=5))


def amplitude(mass: float, omega: float, spring: complex | None = None) -> complex:
    """Return the tip's complex amplitude per newton with an attached mass (kg).

    The mass is attached rigidly, or by a spring and damper (N/m).
    """
    terms = MODEL.omega**2 - omega**2 + 2j * MODEL.damping_ratio * MODEL.omega * omega
    by_force = np.sum(MODEL.tip_shape * MODEL.force_shape / terms)
    own = np.sum(MODEL.tip_shape**2 / terms)
    inertia = mass * omega**2
    reaction = inertia if spring is None else spring * inertia / (spring - inertia)
    return complex(by_force / (1 - own * reaction))


@pytest.mark.parametrize("phase", [0.0, 2.0])
@pytest.mark.parametrize("kind", ["none", "tuned", "stuck", "held by friction"])
def test_motion_is_the_closed_form_from_the_first_instant(kind: str, phase: float) -> None:
    omega = 0.93 * MODEL.resonance_omega(4)
    mass = 0.02 * MODEL.beam_mass
    tuned = TunedAbsorber(0.02, 9000.0, 3.0)
    scenes: dict[str, tuple[Absorber | None, complex]] = {
        "none": (None, amplitude(0.0, omega)),
        "tuned": (tuned, amplitude(mass, omega, 9000.0 + 3j * omega)),
        "stuck": (StuckAbsorber(0.02), amplitude(mass, omega)),
        "held by friction": (friction_damper(1e3, 0.02), amplitude(mass, omega)),
    }
    absorber, expected = scenes[kind]
    drive = Drive(5.0, constant_frequency(MODEL.resonance_omega(4), 0.93, 6.0), phase)
    scene = Scene(MODEL, absorber)
    start = find_steady_start(scene, drive)
    history = simulate(scene, drive, initial=start, record=Record(series=True)).history
    motion = (5.0 * expected * np.exp(1j * (omega * history.time + phase))).real
    np.testing.assert_allclose(
        history.modal_displacement @ MODEL.tip_shape, motion, atol=1e-6 * 5.0 * abs(expected)
    )


@pytest.mark.parametrize("kind", ["none", "tuned", "stuck"])
def test_motion_under_a_shaken_base_and_tones_is_the_closed_form(kind: str) -> None:
    """Motion under a shaken base and tones agrees with its closed form.

    Two orders of the base's acceleration and a force act together. The matrices of structure and
    absorber are solved directly.
    """
    reference = MODEL.resonance_omega(2)
    schedule = constant_frequency(reference, 0.4, 6.0)
    tones = (Tone(3.0, order=1.0, phase=0.7), Tone(5.0, order=2.2, phase=-1.0))
    force = Drive(2.0, schedule, 0.3)
    loads = Loads((Tones(tones, schedule=schedule, quantity=BASE_QUANTITY), force))
    mass = 0.02 * MODEL.beam_mass
    n = MODEL.modes
    tuned = TunedAbsorber(0.02, 9000.0, 3.0)
    absorber = {"none": None, "tuned": tuned, "stuck": StuckAbsorber(0.02)}[kind]
    inertia = np.diag(np.append(np.ones(n), mass))
    stiffness = np.diag(np.append(MODEL.omega**2, 0.0)).astype(complex)
    losses = np.diag(np.append(2 * MODEL.damping_ratio * MODEL.omega, 0.0))
    stretch = np.append(-MODEL.tip_shape, 1.0)
    if kind == "tuned":
        stiffness += 9000.0 * np.outer(stretch, stretch)
        losses += 3.0 * np.outer(stretch, stretch)
    stuck = np.vstack([np.eye(n), MODEL.tip_shape])
    joined = {"none": np.eye(n + 1, n), "tuned": np.eye(n + 1), "stuck": stuck}[kind]
    scene = Scene(MODEL, absorber)
    start = find_steady_start(scene, loads)
    history = simulate(scene, loads, initial=start, record=Record(series=True)).history
    motion = np.zeros((len(history.time), n))
    harmonics = [(0.4 * reference * tone.order, tone.amplitude, tone.phase) for tone in tones]
    for omega, size, phase in [*harmonics, (0.4 * reference, 2.0, 0.3)]:
        on_base = -np.append(MODEL.base_participation, mass)
        load = np.append(MODEL.force_shape, 0.0) if size == 2.0 else on_base
        matrix = joined.T @ (stiffness + 1j * omega * losses - omega**2 * inertia) @ joined
        amplitude_of = np.linalg.solve(matrix, joined.T @ load * size * np.exp(1j * phase))[:n]
        motion += (np.exp(1j * omega * history.time)[:, None] * amplitude_of).real
    tolerance = 1e-6 * np.abs(motion).max()
    np.testing.assert_allclose(history.modal_displacement, motion, atol=tolerance)


def test_free_absorber_rests_in_space_on_a_shaken_base() -> None:
    schedule = constant_frequency(MODEL.resonance_omega(1), 0.9, 6.0)
    omega = 0.9 * MODEL.resonance_omega(1)
    loads = Loads((ShakenBase(schedule, displacement=1e-4, phase=0.4),))
    start = find_steady_start(Scene(MODEL, impact_absorber(1.0, 0.7, 0.0, 0.02)), loads)
    assert start.absorber_displacement == pytest.approx(-1e-4 * np.cos(0.4))
    assert start.absorber_velocity == pytest.approx(1e-4 * omega * np.sin(0.4))


def test_loads_that_have_no_steady_state_start_as_they_say() -> None:
    schedule = constant_frequency(MODEL.resonance_omega(1), 0.9, 6.0)
    seconds = float(schedule.times[-1])
    shock = Loads((Shock("half-sine", 10.0, 0.01, seconds),), MODEL.resonance_omega(1))
    swept = Loads((Drive(1.0, schedule),), start="lower-wall")
    for loads in (shock, swept):
        assert find_steady_start(Scene(MODEL, impact_absorber()), loads) is None
        assert Lane(Scene(MODEL, impact_absorber()), loads, steady_start=True).start is None


def test_free_absorber_rests_between_its_walls() -> None:
    omega = 0.9 * MODEL.resonance_omega(2)
    drive = Drive(5.0, constant_frequency(MODEL.resonance_omega(2), 0.9, 6.0), 1.0)
    free = 5.0 * amplitude(0.0, omega)
    wide = Scene(MODEL, impact_absorber(2 * abs(free), 0.7, 0.0, 0.02))
    start = find_steady_start(wide, drive)
    assert start.absorber_displacement == 0
    assert start.absorber_velocity == 0
    tip = MODEL.tip_shape @ start.modal_displacement
    assert tip == pytest.approx((free * np.exp(1j)).real, rel=1e-9)
    narrow = Scene(MODEL, impact_absorber(0.5 * abs(free), 0.7, 0.0, 0.02))
    start = find_steady_start(narrow, drive)
    assert start.absorber_displacement == pytest.approx(tip)
    assert start.absorber_velocity == pytest.approx(MODEL.tip_shape @ start.modal_velocity)


@pytest.mark.parametrize("share", [1.01, 0.99])
def test_friction_holds_an_absorber_at_the_start_if_it_carries_its_inertia(share: float) -> None:
    """Friction holds an absorber at the start if it can carry its inertia.

    The force of the absorber's mass on the structure is m omega^2 times the displacement of the
    structure with this mass.
    """
    omega = 0.9 * MODEL.resonance_omega(2)
    mass = 0.02 * MODEL.beam_mass
    drive = Drive(5.0, constant_frequency(MODEL.resonance_omega(2), 0.9, 6.0), 1.0)
    joined = 5.0 * amplitude(mass, omega)
    limit = share * mass * omega**2 * abs(joined)
    start = find_steady_start(Scene(MODEL, friction_damper(limit, 0.02)), drive)
    motion = joined * np.exp(1j) if share > 1 else 0.0
    assert start.absorber_displacement == pytest.approx(motion.real, rel=1e-9)
    assert start.absorber_velocity == pytest.approx((1j * omega * motion).real, rel=1e-9)


def test_a_scene_without_steady_state_starts_at_rest() -> None:
    undamped = modal_model(Beam(modes=2, damping_ratio=0.0))
    at_resonance = Drive(1.0, constant_frequency(undamped.resonance_omega(1), 1.0, 5.0))
    start = find_steady_start(Scene(undamped), at_resonance)
    assert start is None or np.abs(start.modal_displacement).max() > 1
    heavy = Scene(MODEL, replace(impact_absorber(), gravity=9.81))
    assert find_steady_start(heavy, at_resonance) is None


def test_levels_at_a_high_resonance_do_not_depend_on_the_phase() -> None:
    """Levels at a high resonance from the steady state do not depend on the phase.

    The sweep is below resonance 4. From rest the transient of the lower modes determines the level,
    which depends on the phase. From the steady state the end of the sweep determines it.
    """
    reference = MODEL.resonance_omega(4)
    schedule = linear_sweep(reference, 0.9, 0.95)
    lanes = [
        Lane(Scene(MODEL), Drive(1.0, schedule, phase), steady)
        for steady in (False, True)
        for phase in (0.0, np.pi / 2)
    ]
    levels = run_lanes(lanes, threads=1)
    expected = abs(amplitude(0.0, 0.95 * reference)) / np.sqrt(2)
    np.testing.assert_allclose(levels.level[2:], expected, rtol=0.02)
    assert levels.level[1] > 1.5 * expected
    np.testing.assert_allclose(levels.frequency_ratio[2:], 0.95, atol=0.002)


def test_curves_start_as_their_case_says() -> None:
    case = CurveCase(Scene(MODEL), np.ones(1), 1, (0.98, 1.02), 10.0, steady_start=True)
    (curve,) = performance_curves([case], 2, 0, threads=1)
    (rest,) = performance_curves([replace(case, steady_start=False)], 2, 0, threads=1)
    lane = Lane(Scene(MODEL), Drive(1.0, case.schedules()[0]), steady_start=True)
    assert curve.level[0, 0, 0] == run_lanes([lane], threads=1).level[0]
    assert curve.level[0, 0, 0] != rest.level[0, 0, 0]
