"""Runs that start from the steady state of the linear structure: no transient, whatever the phase; closed forms by modal sums."""

from dataclasses import replace

import numpy as np
import pytest

from impact_env import Beam, Drive, Record, Scene, modal_model, simulate
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import constant_frequency, linear_sweep
from impact_env.ensemble import Lane, run_lanes
from impact_env.parameters import (
    Absorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.steady_start import find_steady_start

MODEL = modal_model(Beam(modes=5))


def amplitude(mass: float, omega: float, spring: complex | None = None) -> complex:
    """Return the tip's complex amplitude per newton with an attached mass (kg), rigidly or by a spring and damper (N/m)."""
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
    """The force that the absorber's mass takes along the structure is m omega^2 times the displacement of the structure with this mass."""
    omega = 0.9 * MODEL.resonance_omega(2)
    mass = 0.02 * MODEL.beam_mass
    drive = Drive(5.0, constant_frequency(MODEL.resonance_omega(2), 0.9, 6.0), 1.0)
    joined = 5.0 * amplitude(mass, omega)
    limit = share * mass * omega**2 * abs(joined)
    start = find_steady_start(Scene(MODEL, friction_damper(limit, 0.02)), drive)
    motion = joined * np.exp(1j) if share > 1 else 0.0
    assert start.absorber_displacement == pytest.approx(motion.real, rel=1e-9)
    assert start.absorber_velocity == pytest.approx((1j * omega * motion).real, rel=1e-9)


def test_rest_where_there_is_no_steady_state() -> None:
    undamped = modal_model(Beam(modes=2, damping_ratio=0.0))
    at_resonance = Drive(1.0, constant_frequency(undamped.resonance_omega(1), 1.0, 5.0))
    found = find_steady_start(Scene(undamped), at_resonance)
    assert found is None or np.abs(found.modal_displacement).max() > 1
    heavy = Scene(MODEL, replace(impact_absorber(), gravity=9.81))
    assert find_steady_start(heavy, at_resonance) is None


def test_levels_at_a_high_resonance_do_not_depend_on_the_phase() -> None:
    """A sweep below resonance 4: from rest the transient of the lower modes counts, and by phase; from the steady state the end of the sweep does."""
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
