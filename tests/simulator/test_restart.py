"""Runs continue where others ended.

Parts of a drive, final states as starts, and parts of a response that were not recorded are tested.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from impact_env import (
    Beam,
    Drive,
    FrequencySchedule,
    InitialState,
    ParameterError,
    Record,
    Scene,
    beam_scene,
    impact_absorber,
    impact_absorbers,
    linear_sweep,
    simulate,
)
from impact_env.parameters import Absorber, TunedAbsorber
from impact_env.results import RECORDING

BEAM = Beam(modes=3)
OMEGA = beam_scene(BEAM).model.resonance_omega(1)


def sweep(force: float = 3.0) -> Drive:
    times = np.array([0.0, 4.0, 9.0]) * 2 * np.pi / OMEGA
    return Drive(force, FrequencySchedule(times, OMEGA * np.array([1.06, 0.9, 1.0]), OMEGA), 0.4)


def test_a_part_of_a_drive_has_its_frequency_and_phase() -> None:
    drive = sweep()
    schedule = drive.schedule
    start = 0.2 * schedule.times[-1]
    stop = 0.7 * schedule.times[-1]
    part = drive.between(start, stop)
    times = np.linspace(start, stop, 7)
    omega = np.interp(times, schedule.times, schedule.omegas)
    assert part.schedule.omega_at(times - start) == pytest.approx(omega, rel=1e-12)
    assert part.schedule.times[-1] == pytest.approx(stop - start, rel=1e-12)
    for time in times:
        turned, _ = quad(
            lambda t: np.interp(t, schedule.times, schedule.omegas),
            0.0,
            time,
            points=[schedule.times[1]],
            epsabs=1e-10,
        )
        phase = part.phase + part.schedule.phase_at(time - start)
        assert phase == pytest.approx(0.4 + turned, rel=1e-9)


def test_a_drive_that_follows_goes_on_with_its_phase() -> None:
    drive = sweep()
    end = float(drive.schedule.times[-1])
    half = drive.schedule.times[1]
    rest = drive.between(0.0, half).followed_by(drive.between(half, end).schedule)
    assert rest.phase == pytest.approx(drive.between(half, end).phase, rel=1e-12)
    assert rest.amplitude == drive.amplitude


@pytest.mark.parametrize(
    ("start", "stop", "named"),
    [
        (-0.1, 0.1, "start of the part"),
        (0.1, 0.1, "end of the part"),
        (0.0, 9.0, "end of the part"),
        (9.0, 9.5, "start of the part"),
        (np.nan, 0.1, "start of the part"),
    ],
)
def test_parts_outside_of_a_drive_are_refused(start: float, stop: float, named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        sweep().between(start, stop)


@pytest.mark.parametrize(
    "absorber", [None, TunedAbsorber(0.02, 700.0, 0.4), impact_absorber(5e-5, 0.7)], ids=str
)
def test_a_run_in_two_parts_is_the_whole_run(absorber: Absorber | None) -> None:
    """Over few impacts: each of them makes what rounding has changed several times as large."""
    scene = beam_scene(BEAM, absorber)
    drive = sweep(0.5 if absorber is None else 3.0)
    end = float(drive.schedule.times[-1])
    whole = simulate(scene, drive)
    cut = 0.41 * end
    first = simulate(scene, drive.between(0.0, cut))
    second = simulate(scene, drive.between(cut, end), initial=first.final_state)
    assert whole.impact_count == first.impact_count + second.impact_count
    scale = np.max(np.abs(whole.end_state))
    np.testing.assert_allclose(second.end_state, whole.end_state, rtol=0, atol=1e-5 * scale)
    if isinstance(absorber, type(impact_absorber())):
        assert first.impact_count > 2


def scenes() -> list[Scene]:
    several = impact_absorbers((1e-4, 1e-4), (1.0, 0.6), mass_ratio=0.02)
    return [beam_scene(BEAM), beam_scene(BEAM, impact_absorber(1e-4)), beam_scene(BEAM, several)]


@pytest.mark.parametrize("scene", scenes(), ids=str)
def test_states_and_vectors_are_inverse(scene: Scene) -> None:
    generator = np.random.default_rng(3)
    n = scene.model.modes
    places = scene.places
    vector = generator.uniform(-1e-5, 1e-5, 2 * (n + places))
    np.testing.assert_array_equal(InitialState.from_vector(scene, vector).vector(scene), vector)
    with pytest.raises(ParameterError, match="state vector"):
        InitialState.from_vector(scene, vector[:-1])
    with pytest.raises(ParameterError, match="state vector"):
        InitialState.from_vector(scene, np.where(np.arange(len(vector)) == 1, np.nan, vector))


def test_an_absorber_that_rounding_put_beyond_its_wall_is_put_on_it() -> None:
    for scene in scenes()[1:]:
        n = scene.model.modes
        vector = np.zeros(2 * (n + scene.places))
        vector[n] = 1e-4 * (1 + 1e-9)
        state = InitialState.from_vector(scene, vector)
        assert np.ravel(state.absorber_displacement)[0] == 1e-4
        assert state.vector(scene)[n] == 1e-4


def test_parts_that_were_not_recorded_are_refused_with_the_record_that_has_them() -> None:
    scene = beam_scene(Beam(modes=2), impact_absorber())
    drive = Drive(1.0, linear_sweep(scene.model.resonance_omega(1), 1.0, 1.0005))
    bare = replace(simulate(scene, drive), level=None)
    for name, how in RECORDING.items():
        with pytest.raises(ParameterError) as raised:
            getattr(bare.recorded, name)
        assert how in str(raised.value)
        assert name in str(raised.value)
        record = eval(how.partition(",")[0], {"Record": Record})
        if name != "check":  # a kernel of its own, tested in tests/kernels/test_check.py
            response = simulate(scene, drive, record=record)
            assert getattr(response.recorded, name) is getattr(response, name)
