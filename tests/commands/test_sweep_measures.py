"""What `sweep --measures` tells, against closed forms: sines, Gaussian noise, transfer functions, and what an impact loses."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import sweep
from load_cases import FORCE_SHAPE, MASS, OMEGA, TIP_SHAPE
from numpy.typing import NDArray

from impact_env.drive import FrequencySchedule
from impact_env.loads import BASE, Load, Loads, Samples, ShakenBase, Shock, Tone, Tones
from optimisation.signals import band_edges, of_signal

Array = NDArray[np.float64]
RATE, SIZE, PERIODS = 1000.0, 3.0, 200
ONE_MODE = f"""
[model]
omega_rad_s = [{OMEGA[0]}]
damping_ratio = [0.02]
force_shape_per_sqrt_kg = [1.0]
tip_shape_per_sqrt_kg = [{MASS**-0.5}]
stress_shape = [7.0]
base_participation_sqrt_kg = [{MASS**0.5}]
beam_mass_kg = {MASS}
"""
ROWS = {"force_shape_per_sqrt_kg": FORCE_SHAPE[:2], "tip_shape_per_sqrt_kg": TIP_SHAPE[:2]}
TWO_MODES = f"[model]\nomega_rad_s = {list(OMEGA[:2])}\ndamping_ratio = [0.02, 0.02]\nbeam_mass_kg = {MASS}\n" + "".join(
    f"{key} = {list(row)}\n" for key, row in ROWS.items()
)


def measures(folder: Path, scene: str, load: str, *options: object) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the measures of the first member, and all that is written."""
    (folder / "scene.toml").write_text(scene)
    (folder / "load.toml").write_text(load)
    result = sweep("--scene", folder / "scene.toml", "--load", folder / "load.toml", "--measures", *options, "--json", folder / "out.json")
    assert result.exit_code == 0, result.output
    found = json.loads((folder / "out.json").read_text())
    return found["measures"][0], found


def test_a_sine() -> None:
    """Samples that fall on the crests; 20 of them a period."""
    found = of_signal(SIZE * np.sin(2 * np.pi * np.arange(20 * PERIODS + 1) / 20), RATE)
    assert found["rms"] == pytest.approx(SIZE / np.sqrt(2), rel=1e-3)
    assert found["percentiles"]["100"] == pytest.approx(SIZE)
    assert found["exceedances"]["per_s"][0] == pytest.approx(2 * RATE / 20, rel=0.01)
    assert found["exceedances"]["per_s"][1:] == [0.0, 0.0, 0.0]
    assert sum(found["rainflow"]["cycles"][:-1]) <= 1  # the ends: from 0 to the first crest, and from the last to 0
    assert found["rainflow"]["cycles"][-1] == pytest.approx(PERIODS, abs=1)
    frequency, density = (np.array(found["spectrum"][key]) for key in ("frequency_hz", "density"))
    assert frequency[np.argmax(density)] == pytest.approx(RATE / 20, abs=frequency[1])
    assert np.trapezoid(density, frequency) == pytest.approx(SIZE**2 / 2, rel=1e-3)


def test_gaussian_noise() -> None:
    """Rice: |x| of a flat band from f1 to f2 rises above k sigma 2 nu exp(-k^2/2) times a second, nu^2 = (f1^2 + f1 f2 + f2^2)/3."""
    seconds, drawn, (low, high) = 400.0, np.random.default_rng(1), (20.0, 60.0)
    lines = np.zeros(int(RATE * seconds) // 2 + 1, complex)
    band = np.arange(len(lines)) / seconds
    inside = (band >= low) & (band <= high)
    lines[inside] = [1, 1j] @ drawn.standard_normal((2, int(np.sum(inside))))
    values = np.fft.irfft(lines)
    found, nu = of_signal(values, RATE), np.sqrt((low**2 + low * high + high**2) / 3)
    for k, per_s in zip((1, 2, 3), found["exceedances"]["per_s"], strict=False):
        assert per_s == pytest.approx(2 * nu * np.exp(-(k**2) / 2), rel=0.03 if k < 3 else 0.2)
    assert found["percentiles"]["95"] == pytest.approx(1.96 * found["rms"], rel=0.02)
    frequency, density = (np.array(found["spectrum"][key]) for key in ("frequency_hz", "density"))
    flat = density[(frequency > low + 1) & (frequency < high - 1)]
    assert np.mean(flat) == pytest.approx(found["rms"] ** 2 / (high - low), rel=0.03)
    assert np.trapezoid(density, frequency) == pytest.approx(np.mean(values**2), rel=0.03)


TIMES = np.linspace(0, 1.0, 1001)
RUN = FrequencySchedule(np.array([0.0, 1.0]), np.array([40.0, 90.0]), 50.0)
PHASE = 0.4 + 40.0 * TIMES + 25.0 * TIMES**2
CORNERS = np.array([1.0, -2.0, 0.5, 3.0])  # at thirds of the second
TONE = Tones((Tone(2.0, frequency=300.0, phase=0.4),), 1.0, quantity=BASE)
FAST = 600 * np.pi
MOVED: dict[str, tuple[Load, Array, Array]] = {  # place and velocity
    "a swept displacement": (
        ShakenBase(RUN, displacement=0.2, phase=0.4),
        0.2 * (np.cos(PHASE) - np.cos(0.4)),
        -0.2 * (40.0 + 50.0 * TIMES) * np.sin(PHASE),
    ),
    "a fast tone": (TONE, 2.0 / FAST**2 * (np.cos(0.4) - np.cos(FAST * TIMES + 0.4)), 2.0 / FAST * np.sin(FAST * TIMES + 0.4)),
    "a jump": (Shock("trapezoid", 5.0, 1.0, 1.0, 0.0, BASE), 2.5 * TIMES**2, 5.0 * TIMES),
}


@pytest.mark.parametrize("name", MOVED)
def test_a_base_moves_as_its_acceleration_says(name: str) -> None:
    load, *truth = MOVED[name]
    for found, expected in zip(Loads((load,), 50.0).base_motion(TIMES), reversed(truth), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_a_record_of_a_base_begins_and_ends_at_one_place() -> None:
    """Its mean velocity is zero; between corners the velocity is the integral of straight lines."""
    velocity, place = Loads((Samples(np.linspace(0, 1, 4), CORNERS, BASE),), 50.0).base_motion(TIMES)
    assert place[-1] == pytest.approx(0.0, abs=1e-14)
    assert velocity[-1] - velocity[0] == pytest.approx((CORNERS[0] / 2 + CORNERS[1] + CORNERS[2] + CORNERS[3] / 2) / 3)


def test_motion_in_space_over_that_of_the_base(tmp_path: Path) -> None:
    """Transmissibility of an oscillator: (1 + 2 i D r)/(1 - r^2 + 2 i D r); relative to the base r^2 over the same."""
    r, acceleration = 1.3, 2.0
    load = f'[load]\nkind = "base"\ntones = [{{ amplitude_m_s2 = {acceleration}, frequency_hz = {r * OMEGA[0] / (2 * np.pi)} }}]\nduration_s = 4.0'
    base = acceleration / (r * OMEGA[0]) ** 2 / np.sqrt(2)
    dynamic = 1 - r**2 + 2j * 0.02 * r
    for option, ratio in ((("--absolute",), abs((1 + 2j * 0.02 * r) / dynamic)), ((), abs(r**2 / dynamic))):
        found, _ = measures(tmp_path, ONE_MODE, load, *option)
        assert found["displacement_m"]["rms"] == pytest.approx(base * ratio, rel=2e-3)
        assert found["displacement_m"]["level"] > found["displacement_m"]["rms"]  # around the peak of the start
        if option:
            assert found["acceleration_m_s2"]["rms"] == pytest.approx((r * OMEGA[0]) ** 2 * base * ratio, rel=4e-3)
        else:
            assert found["stress"]["rms"] == pytest.approx(7.0 * MASS**0.5 * base * ratio, rel=2e-3)


def test_two_tones_have_a_band_each(tmp_path: Path) -> None:
    hertz = 40.0, 250.0
    tones = ", ".join(f"{{ amplitude_n = {n}, frequency_hz = {f} }}" for n, f in zip((1.0, 4.0), hertz, strict=True))
    found, _ = measures(tmp_path, TWO_MODES, f'[load]\nkind = "tones"\ntones = [{tones}]\nduration_s = 4.0')
    assert [band.get("to_hz") for band in found["bands"]] == [pytest.approx(100.0), None]
    for force, frequency, band in zip((1.0, 4.0), hertz, found["bands"], strict=True):
        omega = 2 * np.pi * frequency
        each = [t * f / (w**2 - omega**2 + 0.04j * w * omega) for t, f, w in zip(TIP_SHAPE, FORCE_SHAPE, OMEGA[:2], strict=False)]
        assert band["rms_m"] == pytest.approx(force * abs(sum(each)) / np.sqrt(2), rel=0.01)
    orders = Tones((Tone(1.0, order=1.0), Tone(1.0, order=4.0)), schedule=RUN)
    assert band_edges(Loads((orders,)))[1] * 2 * np.pi == pytest.approx(2 * 65.0)


def test_the_energy_after_a_pulse_decays(tmp_path: Path) -> None:
    """As exp(-2 D omega t), about which the energy of a damped swing moves by the damping ratio."""
    load = '[load]\nkind = "shock"\npulse = "half-sine"\npeak_n = 9.0\npulse_s = 0.0125\nduration_s = 0.5'
    found, _ = measures(tmp_path, ONE_MODE, load)
    times, energy = (np.array(found["decay"][key]) for key in ("at_s", "energy_j"))
    assert times[0] == pytest.approx(0.0125, abs=1 / found["sample_rate_hz"])
    np.testing.assert_allclose(energy, energy[0] * np.exp(-2 * 0.02 * OMEGA[0] * (times - times[0])), rtol=0.05)
    assert found["decay"]["decay_s"] == pytest.approx(1 / (2 * 0.02 * OMEGA[0]), rel=0.03)
    assert found["decay"]["higher_modes"] == [0.0] * len(times)
    assert found["from_s"] == 0


def test_impacts_lose_what_their_velocities_say(tmp_path: Path) -> None:
    absorber = '\n[absorber]\nkind = "impact"\ngap = 3e-4\nrestitution = 0.7\n'
    load = '[load]\nkind = "random"\nspectrum = [[30.0, 0.05], [50.0, 0.05]]\nduration_s = 6.0'
    found, written = measures(tmp_path, ONE_MODE + absorber, load, "--members", 2)
    start = found["from_s"]
    assert start == pytest.approx(5 / (0.02 * OMEGA[0]))
    late = np.array(written["impact_time_s"]) >= start
    speeds = np.abs(written["impact_relative_velocity_m_s"])[late]
    impacts = found["impacts"]
    assert len(speeds) > 50
    assert impacts["per_s"] == pytest.approx(len(speeds) / (6.0 - start), rel=1e-3)
    mass = 1 / (1 / (0.02 * MASS) + 1 / MASS)
    assert impacts["power_w"] == pytest.approx(mass / 2 * (1 - 0.7**2) * np.sum(speeds**2) / (6.0 - start), rel=1e-3)
    assert impacts["per_s_above"][-1] == pytest.approx(np.sum(speeds > impacts["above_m_s"][-1]) / (6.0 - start), rel=1e-3)
    assert found["displacement_m"]["level"] == pytest.approx(written["response_level_m"][0], rel=0.01)  # from other samples
    assert len(written["measures"]) == 2
    assert written["measures"][1]["displacement_m"]["rms"] != found["displacement_m"]["rms"]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--absolute",), "--absolute needs --measures"),
        (("--measures", "--method", "moreau"), "--measures does not go with --method moreau"),
        (("--measures", 2), "measures = 2 is not allowed"),
        (("--measures", "--absolute"), "absolute = True is not allowed: left out where the base does not move"),
    ],
)
def test_what_does_not_go_is_refused(options: tuple[object, ...], word: str) -> None:
    result = sweep("--absorber", "none", "--from", 1, "--to", 1, "--periods", 20, *options)
    assert result.exit_code == 2
    assert word in result.output
