"""The command sweep reproduces golden cases and works with every kind of load.

Scenes and loads come from files. Wrong files of loads are refused.
"""

import json
import re
import warnings
import wave
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import sweep
from load_cases import (
    FORCE_SHAPE,
    GRAVITY,
    MASS,
    OMEGA,
    PARTICIPATION,
    TIP_SHAPE,
    TONES,
    cantilever,
)

from impact_env.checks import ParameterError
from impact_env.drive import FrequencySchedule, Member
from impact_env.loads import BASE_QUANTITY, Loads, Samples, ShakenBase, Shock, Tone, Tones
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.plain_loads import read_loads
from impact_env.scene import Scene
from optimisation.cli.scene_options import loads_of
from optimisation.measures import check_size
from optimisation.signals import band_edges, of_signal


def model(modes: int, damping: float, **more: float) -> str:
    """Return a file's table of a structure.

    It has the first modes of the closed-form cantilever, or one mode with given values.
    """
    rows = {
        "force_shape_per_sqrt_kg": FORCE_SHAPE[:modes],
        "tip_shape_per_sqrt_kg": TIP_SHAPE[:modes],
    } | {name: [x] for name, x in more.items()}
    rows |= {"omega_rad_s": OMEGA[:modes], "damping_ratio": [damping] * modes}
    return (
        "[model]\n"
        + "".join(f"{name} = {list(row)}\n" for name, row in rows.items())
        + f"beam_mass_kg = {MASS}\n"
    )


HERTZ = [omega / (2 * np.pi) for omega in OMEGA]
TONES_LOAD = f"""[load]
kind = "tones"
tones = [{{ amplitude_n = 2, frequency_hz = {HERTZ[0]} }}, {{ amplitude_n = 20, frequency_hz = {HERTZ[1]}, phase_rad = 0.5 }}]
duration_s = 0.0555"""
SCHEDULE = (
    "schedule = {{ times_s = [0, {0}], omegas_rad_s = [240.0, 265.0], reference_rad_s = 252.3 }}"
)
STILL = (
    "schedule = "
    f"{{ times_s = [0, 0.089], omegas_rad_s = [{OMEGA[0]}, {OMEGA[0]}], reference_rad_s = {OMEGA[0]} }}"
)
GRAVITY_LOAD = f"[load]\nkind = 'force'\namplitude_n = 3.0\n{STILL}"
GOLDEN = {
    "tones": ("restitution = 0.7", TONES_LOAD, TONES),
    "gravity": ("restitution = 0.6\ngravity_m_s2 = 9.81", GRAVITY_LOAD, GRAVITY),
}


def written(folder: Path, absorber: str, load: str, base: bool = False) -> list[object]:
    """Write a scene and a load, and return the options of sweep."""
    known = f"base_participation_sqrt_kg = {[float(x) for x in PARTICIPATION]}\n" if base else ""
    own = f'[absorber]\nkind = "impact"\ngap = 1e-3\n{absorber}\n'
    (folder / "scene.toml").write_text(model(3, 0.01) + known + own)
    (folder / "load.toml").write_text(load)
    return [
        "--scene",
        folder / "scene.toml",
        "--load",
        folder / "load.toml",
        "--method",
        "exact",
        "--json",
        folder / "out.json",
    ]


@pytest.mark.parametrize("case", GOLDEN)
def test_golden_cases_from_files(case: str, tmp_path: Path) -> None:
    absorber, load, golden = GOLDEN[case]
    result = sweep(*written(tmp_path, absorber, load))
    assert result.exit_code == 0, result.output
    output = json.loads((tmp_path / "out.json").read_text())
    times = np.array(output["impact_time_s"])
    speeds = np.array(output["impact_relative_velocity_m_s"])
    assert len(times) == 10
    error = np.abs(times - [time for time, _ in golden])
    assert error[0] < 1e-12
    assert np.max(error) < 1e-10
    np.testing.assert_allclose(speeds, [speed for _, speed in golden], atol=1e-8)


def sound(folder: Path) -> None:
    with wave.open(str(folder / "a.wav"), "wb") as file:
        file.setnchannels(1), file.setsampwidth(2), file.setframerate(1000)
        file.writeframes(np.array([0, 16384, -16384, 0], "<i2").tobytes())


SHOCK = "[[load]]\nkind = 'shock'\npulse = 'triangle'\npeak_n = 1\npulse_s = 1\nduration_s = {}\n"
TABLES = {  # records that lie beside the file of the load, the arrays sampled at 100 Hz
    "even.npy": np.sin(np.arange(50.0)),
    "clipped.npy": np.minimum(np.sin(0.1 * np.arange(100.0)), 0.5),
    "gap.npy": np.array([0.0, 1.0, np.nan, 2.0]),
    "clipped.csv": "t,f\n" + "".join(f"{k},{min(k % 20, 8)}\n" for k in range(60)),
    "gap.csv": "t,f\n0,1\n0.1,\n0.2,3\n",
    "header.csv": "0,1\n0.1,2\n",
    "uneven.csv": "t,f\n0,1\n1,2\n2,3\n3.4,1\n4.4,2\n",
    "back.csv": "t,f\n0,1\n1,2\n0.5,3\n",
}
BAD = {  # a load, or the file of its record, and the message
    "start = 'middle'": "load must be given",
    "[load]\nkind = 'wind'": r"load\.kind = 'wind' is not allowed: one of force, unbalance, base",
    "[load]\nkind = 'shock'\npeak = 3": r"load\.peak = 3 is not allowed: only the keys pulse, peak_n",
    "start = 'above'\n" + SHOCK.format(2): "start = 'above' is not allowed",
    "[load]\nkind = 'samples'\nfile = 'even.npy'": r"sample_rate_hz = None .*given for even\.npy",
    "even.npy'\nresample = 'yes": r"load\.resample = 'yes'",
    "even.npy'\nquantity = 'base_displacement": "quantity = 'base_displacement'",
    "clipped.npy": r"value = 0\.5 .*clipped from row 7 on",
    "clipped.csv": r"clipped\.csv: value = 8 .*clipped from row 10 on",
    "gap.npy": r"gap\.npy: row 3 = nan .*no gap",
    "gap.csv": r"gap\.csv: row 3 = \['0\.1', ''\] .*no gap",
    "header.csv": r"header\.csv: row 1 = .*a header",
    "uneven.csv": r"time in row 5 = 3\.4 .*resample = true",
    "back.csv": r"back\.csv: time in row 4 = 0\.5",
    "a.wav": r"load\.scale = None .*a sound has no unit",
    "large.csv": r"large\.csv: bytes = 1\d+ .*at most 128 MiB",
    "none.csv": r"load\.file = 'none\.csv' .*can be read",
    "b.txt": r"load\.file = 'b\.txt' .*ends in \.csv",
    "[load]\nkind = 'shock'\nvelocity_m_s = 1\nduration_s = 1\nplace = 'base'": r"load\.place = 'base' .*force, absorber",
    "[load]\nkind = 'random'\nspectrum = [[1.1, 1], [1.2, 1]]\nduration_s = 1.0": r"spectrum = .*a multiple of 1 Hz",
    "[load]\nkind = 'random'\nspectrum = [[1, 1], [2, 1]]\nduration_s = 1.0\nunit = 'g^2/Hz'": r"load\.unit = 'g\^2/Hz' .*N\^2/Hz",
    "[load]\nkind = 'base'\nspectrum = [[1, 1], [2, 1]]\nduration_s = 1.0\nunit = 'g'": r"load\.unit = 'g' .*g\^2/Hz",
    "[load]\nkind = 'random'\nspectrum = [[1, 1], [1, 2], [2, 1]]\nduration_s = 1.0": r"spectrum = .*a step, between others",
    (
        "[load]\nkind = 'random'\nspectrum = [[1, 1], [2, 1], [2, 2], [2, 3], [3, 1]]\nduration_s "
        "= 1.0"
    ): r"spectrum = .*a step, between others",
    (
        "[load]\nkind = 'base'\npulse = 'sawtooth'\npeak_g = 'high'\npulse_s = 0.1\nduration_s = "
        "1.0"
    ): r"load\.peak_g = 'high'",
    "[load]\nkind = 'shock'\npulse = 'sawtooth'\npeak_g = 1.0\npulse_s = 0.1\nduration_s = 1.0": r"load\.peak_g = 1\.0 .*peak_n",
    "[load]\nkind = 'base'\nacceleration_g = 1.0\nacceleration_m_s2 = 1.0\n"
    + SCHEDULE.format(1): r"load\.acceleration_m_s2 = 1\.0",
    "[load]\nkind = 'random'\nspectrum = [[2, 1], [1, 1]]\nduration_s = 1.0": r"spectrum = .*strictly rising",
    "[load]\nkind = 'random'\nspectrum = [[1, 0], [2, 1]]\nduration_s = 1.0": r"spectrum = .*above 0",
    "[load]\nkind = 'random'\nspectrum = [[1, 1], [2e3, 1]]\nduration_s = 1e4": r"duration_s = 10000\.0 .*320 MiB",
    SHOCK.format(2).replace("triangle", "sinc"): r"load\[0\]\.pulse = 'sinc' .*half-sine",
    SHOCK.format(2) + "rise_s = 0.1": r"load\[0\]\.rise_s = 0\.1",
    SHOCK.format(2) + SHOCK.format(3): r"duration = \[2\.0, 3\.0\] .*the same",
    "[load]\nkind = 'base'\nacceleration_m_s2 = 1\ndisplacement_m = 1\n"
    + SCHEDULE.format(1): r"load\.acceleration_m_s2 = 1 .*one of the two",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files_are_refused_by_name(text: str, tmp_path: Path) -> None:
    for name, record in TABLES.items():
        np.save(tmp_path / name, record) if name.endswith(".npy") else (tmp_path / name).write_text(
            record
        )
    sound(tmp_path)
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(2**27 + 1)
    rate = "sample_rate_hz = 100\n" if ".npy" in text else ""
    (tmp_path / "load.toml").write_text(
        text
        if "[load]" in text or "start" in text
        else f"[load]\nkind = 'samples'\n{rate}file = '{text}'"
    )
    with pytest.raises(ParameterError, match=BAD[text]):
        read_loads(tmp_path / "load.toml", 250.0)


def record(folder: Path, name: str, more: str = "") -> Samples:
    (folder / "load.toml").write_text(f"[load]\nkind = 'samples'\nfile = '{name}'\n{more}")
    (part,) = read_loads(folder / "load.toml", 250.0).parts
    assert isinstance(part, Samples)
    return part


def test_records_of_each_format(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    values = np.array([0.0, 0.5, -0.5, 0.0])
    times = np.arange(4) / 1000
    (tmp_path / "a.csv").write_text(
        "time_s,force\n" + "".join(f"{t},{v}\n" for t, v in zip(times, values, strict=True))
    )
    np.save(tmp_path / "a.npy", np.column_stack([times, values]))
    sound(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        about = {
            "rsp_ent_name": "NONE",
            "ref_ent_name": "NONE",
            "rsp_node": 1,
            "rsp_dir": 3,
            "ref_node": 1,
            "ref_dir": 3,
            "id1": "record",
        }
        about |= {
            f"{axis}_spec_data_type": code
            for axis, code in (("abscissa", 17), ("ordinate", 13), ("orddenom", 0), ("z_axis", 0))
        }
        part = pyuff.prepare_58(func_type=1, binary=0, data=values, x=times, **about)
        pyuff.UFF(str(tmp_path / "a.uff")).write_sets(part, "overwrite")
    for name in ("a.csv", "a.npy", "a.wav", "a.uff"):
        load = record(tmp_path, name, "scale = 3.0")
        np.testing.assert_allclose(load.values, 3 * values, atol=1e-6)
        np.testing.assert_allclose(load.times, times, atol=1e-9)


def test_base_motion_needs_a_participation_and_walls_a_place_to_rest(tmp_path: Path) -> None:
    base = '[load]\nkind = "base"\nacceleration_m_s2 = 1.0\n' + SCHEDULE.format(0.01)
    assert (
        "participation of the modes" in sweep(*written(tmp_path, "restitution = 0.7", base)).output
    )
    options = written(tmp_path, "contact_stiffness = 1e6", base, base=True)
    assert "for that Exact, and a scene without absorber" in sweep(*options).output
    options = written(tmp_path, "contact_stiffness = 1e6\ngravity_m_s2 = 9.81", TONES_LOAD)
    assert (
        "gravity = 9.81 is not allowed: 0 with Exact() and compliant contact"
        in sweep(*options).output
    )


def test_common_loads_in_short() -> None:
    parts = (
        loads_of(Path(text), cantilever()).parts
        for text in ("base:4", "shock:40:0.0125:2", "random:20:60:0.05:20")
    )
    (base,), (shock,), (random,) = parts
    assert base.acceleration == 4.0
    assert base.schedule.omegas == pytest.approx([0.9 * OMEGA[0], 1.06 * OMEGA[0]])
    assert (shock.pulse, shock.peak, shock.width, shock.length) == ("half-sine", 40.0, 0.0125, 2.0)
    assert random.spectrum.tolist() == [[20.0, 0.05], [60.0, 0.05]]


TONE = "tones = [{{ {} = {}, frequency_hz = 40.0 }}]\nduration_s = 1.0"
G = 9.80665
SAWTOOTH = "pulse = 'sawtooth'\npulse_s = 0.011\nduration_s = 1.0\n{} = {}"
SPECTRUM = "duration_s = 1.0\nunit = '{0}'\nspectrum = [[20, {1}], [40, {2}]]"
SHAKEN = SCHEDULE.format(1.0) + "\n"
IN_G = {  # a load of a base with values in g, and the same in m/s^2
    SAWTOOTH.format("peak_g", 15.0): SAWTOOTH.format("peak_m_s2", 15 * G),
    SHAKEN + "acceleration_g = 2.0": SHAKEN + f"acceleration_m_s2 = {2 * G}",
    TONE.format("amplitude_g", 3.0): TONE.format("amplitude_m_s2", 3 * G),
    SPECTRUM.format("g^2/Hz", 0.01, 0.02): SPECTRUM.format(
        "(m/s^2)^2/Hz", 0.01 * G**2, 0.02 * G**2
    ),
    SPECTRUM.format("g²/Hz", 0.01, 0.02): SPECTRUM.format("(mm/s^2)^2/Hz", 1e4 * G**2, 2e4 * G**2),
}


@pytest.mark.parametrize("text", IN_G)
def test_accelerations_and_spectra_in_g(text: str, tmp_path: Path) -> None:
    loads = []
    for plain in (text, IN_G[text]):
        (tmp_path / "load.toml").write_text("[load]\nkind = 'base'\n" + plain, encoding="utf-8")
        (part,) = read_loads(tmp_path / "load.toml", 250.0).parts
        loads.append([piece.rows for piece in part.pieces()])
    for one, other in zip(*loads, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_what_lies_above_the_modes_of_a_record_and_units_that_must_be_wrong() -> None:
    times = np.arange(2000) / 2000.0
    two = Samples(times, 3 * np.sin(2 * np.pi * 50 * times) + 4 * np.sin(2 * np.pi * 300 * times))
    assert two.share_above(100.0) == pytest.approx(16 / 25, rel=1e-3)
    assert two.share_above(400.0) < 1e-6
    scene = Scene(cantilever(), SlidingAbsorber(0.02, RigidWalls(1e-3, 0.7)))
    loads = Loads((two,), OMEGA[0])
    check_size(scene, loads)
    for factor in (1e-9, 1e12):
        with pytest.raises(ParameterError, match=r"gap = 0\.001 .*look at the load's units"):
            check_size(scene, loads.member(Member(factor=factor)))


def test_an_offset_of_a_base_s_record_is_distinguished_from_oscillations_and_pulses() -> None:
    times = np.linspace(0.0, 4.0, 4001)
    noise = np.convolve(np.random.default_rng(3).standard_normal(4101), np.hanning(101), "valid")
    whole = [np.sin(2 * np.pi * f * times + p) for f in (0.3, 1.7, 40.0) for p in (0.0, 0.7, 1.6)]
    pulse = np.where(times < 0.011, np.sin(np.pi * times / 0.011), 0.0)
    for values in (*whole, noise - np.mean(noise), pulse, np.zeros(4001)):
        assert Samples(times, values, BASE_QUANTITY).drift() is None
    for values in (*whole[6:], np.zeros(4001)):
        offset = Samples(times, values + 0.05, BASE_QUANTITY).drift()
        assert offset == pytest.approx(0.05 + np.trapezoid(values, times) / 4.0)
        assert Samples(times, values + 0.05).drift() is None  # a force


def test_a_drifting_base_and_a_resonance_at_a_node_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = np.linspace(0.0, 4.0, 4001)
    np.save(tmp_path / "a.npy", np.column_stack([times, np.sin(250 * times) + 0.05]))
    text = "[load]\nkind = 'base'\nfile = 'a.npy'\n"
    (tmp_path / "load.toml").write_text(text)
    loads_of(tmp_path / "load.toml", cantilever())
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(r"offset of 0\.05\d* m/s\^2: .* drifts by 0\.40\d m", line)
    np.save(tmp_path / "a.npy", np.column_stack([times, np.sin(250 * times)]))
    loads_of(tmp_path / "load.toml", cantilever())
    assert capsys.readouterr().err == ""
    still = replace(cantilever(), base_participation=np.array([0.5, 0.0, 0.1]))
    loads_of(tmp_path / "load.toml", still, 2)
    assert "resonance 2, at 251.7 Hz, has a node at the base's motion" in capsys.readouterr().err


def test_a_sweep_through_a_resonance_at_nodes_is_warned_of(tmp_path: Path) -> None:
    nodes = model(2, 0.01).replace(str(FORCE_SHAPE[1]), "1e-9").replace(str(TIP_SHAPE[1]), "0.0")
    (tmp_path / "scene.toml").write_text(nodes)
    steady = ("--from", 1, "--to", 1, "--periods", 3, "--force", 1.0)
    places = "the force's place and the absorber's place and the place of the level"
    for resonance in (1, 2):
        result = sweep("--scene", tmp_path / "scene.toml", "--resonance", resonance, *steady)
        warned = f"warning: resonance 2, at 251.7 Hz, has a node at {places}" in result.output
        assert warned == (resonance == 2)


# What sweep --measures tells, against closed forms: sines, Gaussian noise, transfer functions, and
# what an impact loses.


RATE = 1000.0
SIZE = 3.0
PERIODS = 200
UNIT = {
    "force_shape_per_sqrt_kg": 1.0,
    "tip_shape_per_sqrt_kg": MASS**-0.5,
    "stress_shape": 7.0,
    "base_participation_sqrt_kg": MASS**0.5,
}
ONE_MODE = model(1, 0.02, **UNIT)


def measures(
    folder: Path, scene: str, load: str, *options: object
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the measures of the first member, and all that is written."""
    (folder / "scene.toml").write_text(scene)
    (folder / "load.toml").write_text(load)
    result = sweep(
        "--scene",
        folder / "scene.toml",
        "--load",
        folder / "load.toml",
        "--measures",
        *options,
        "--json",
        folder / "out.json",
    )
    assert result.exit_code == 0, result.output
    output = json.loads((folder / "out.json").read_text())
    return output["measures"][0], output


def test_a_sine() -> None:
    """Samples that fall on the crests; 20 of them a period."""
    measures_of_sine = of_signal(SIZE * np.sin(2 * np.pi * np.arange(20 * PERIODS + 1) / 20), RATE)
    assert measures_of_sine["rms"] == pytest.approx(SIZE / np.sqrt(2), rel=1e-3)
    assert measures_of_sine["percentiles"]["100"] == pytest.approx(SIZE)
    assert measures_of_sine["exceedances"]["per_s"][0] == pytest.approx(2 * RATE / 20, rel=0.01)
    assert measures_of_sine["exceedances"]["per_s"][1:] == [0.0, 0.0, 0.0]
    assert (
        sum(measures_of_sine["rainflow"]["cycles"][:-1]) <= 1
    )  # the ends: from 0 to the first crest, and from the last to 0
    assert measures_of_sine["rainflow"]["cycles"][-1] == pytest.approx(PERIODS, abs=1)
    frequency, density = (
        np.array(measures_of_sine["spectrum"][key]) for key in ("frequency_hz", "density")
    )
    assert frequency[np.argmax(density)] == pytest.approx(RATE / 20, abs=frequency[1])
    assert np.trapezoid(density, frequency) == pytest.approx(SIZE**2 / 2, rel=1e-3)


def test_gaussian_noise() -> None:
    """Exceedances of Gaussian noise agree with Rice's formula.

    |x| of a flat band from f1 to f2 rises above k sigma 2 nu exp(-k^2/2) times a second, nu^2 = (f1^2 + f1 f2 + f2^2)/3.
    """
    seconds = 400.0
    drawn = np.random.default_rng(1)
    low = 20.0
    high = 60.0
    lines = np.zeros(int(RATE * seconds) // 2 + 1, complex)
    band = np.arange(len(lines)) / seconds
    inside = (band >= low) & (band <= high)
    lines[inside] = [1, 1j] @ drawn.standard_normal((2, int(np.sum(inside))))
    values = np.fft.irfft(lines)
    measures_of_noise = of_signal(values, RATE)
    nu = np.sqrt((low**2 + low * high + high**2) / 3)
    for k, per_s in zip((1, 2, 3), measures_of_noise["exceedances"]["per_s"], strict=False):
        assert per_s == pytest.approx(2 * nu * np.exp(-(k**2) / 2), rel=0.03 if k < 3 else 0.2)
    assert measures_of_noise["percentiles"]["95"] == pytest.approx(
        1.96 * measures_of_noise["rms"], rel=0.02
    )
    frequency, density = (
        np.array(measures_of_noise["spectrum"][key]) for key in ("frequency_hz", "density")
    )
    flat = density[(frequency > low + 1) & (frequency < high - 1)]
    assert np.mean(flat) == pytest.approx(measures_of_noise["rms"] ** 2 / (high - low), rel=0.03)
    assert np.trapezoid(density, frequency) == pytest.approx(np.mean(values**2), rel=0.03)


TIMES = np.linspace(0, 1.0, 1001)
RUN = FrequencySchedule(np.array([0.0, 1.0]), np.array([40.0, 90.0]), 50.0)
PHASE = 0.4 + 40.0 * TIMES + 25.0 * TIMES**2
CORNERS = np.array([1.0, -2.0, 0.5, 3.0])  # at thirds of the second
MOVED = {  # place and velocity
    "a swept displacement": (
        ShakenBase(RUN, displacement=0.2, phase=0.4),
        0.2 * (np.cos(PHASE) - np.cos(0.4)),
        -0.2 * (40.0 + 50.0 * TIMES) * np.sin(PHASE),
    ),
    "a sawtooth": (
        Shock("sawtooth", 5.0, 0.5, 1.0, quantity=BASE_QUANTITY),
        np.where(TIMES < 0.5, 5 * TIMES**3 / 3, 5 * 0.5**3 / 3 + 5 * 0.5 / 2 * (TIMES - 0.5)),
        np.where(TIMES < 0.5, 5 * TIMES**2, 5 * 0.5 / 2),
    ),
    "a jump": (Shock("trapezoid", 5.0, 1.0, 1.0, 0.0, BASE_QUANTITY), 2.5 * TIMES**2, 5.0 * TIMES),
}


@pytest.mark.parametrize("name", MOVED)
def test_a_base_moves_as_its_acceleration_says(name: str) -> None:
    load, *truth = MOVED[name]
    for measured, expected in zip(
        Loads((load,), 50.0).base_motion(TIMES), reversed(truth), strict=True
    ):
        np.testing.assert_allclose(measured, expected, atol=1e-6 * np.max(np.abs(expected)))


def test_a_record_of_a_base_begins_and_ends_at_one_place() -> None:
    """Its mean velocity is zero; between corners the velocity is the integral of straight lines."""
    velocity, place = Loads(
        (Samples(np.linspace(0, 1, 4), CORNERS, BASE_QUANTITY),), 50.0
    ).base_motion(TIMES)
    assert place[-1] == pytest.approx(0.0, abs=1e-14)
    assert velocity[-1] - velocity[0] == pytest.approx(
        (CORNERS[0] / 2 + CORNERS[1] + CORNERS[2] + CORNERS[3] / 2) / 3
    )


def test_motion_in_space_over_that_of_the_base(tmp_path: Path) -> None:
    """Motion relative to that of the base agrees with the transmissibility of an oscillator.

    The absolute motion is (1 + 2 i D r)/(1 - r^2 + 2 i D r), and that relative to the base has r^2
    as numerator.
    """
    r = 1.3
    acceleration = 2.0
    load = (
        '[load]\nkind = "base"\ntones = '
        f"[{{ amplitude_m_s2 = {acceleration}, frequency_hz = {r * OMEGA[0] / (2 * np.pi)} }}]\nduration_s = 4.0"
    )
    base = acceleration / (r * OMEGA[0]) ** 2 / np.sqrt(2)
    dynamic = 1 - r**2 + 2j * 0.02 * r
    for option, ratio in (
        (("--absolute",), abs((1 + 2j * 0.02 * r) / dynamic)),
        ((), abs(r**2 / dynamic)),
    ):
        measured, _ = measures(tmp_path, ONE_MODE, load, *option)
        assert measured["displacement_m"]["rms"] == pytest.approx(base * ratio, rel=2e-3)
        if option:
            assert measured["acceleration_m_s2"]["rms"] == pytest.approx(
                (r * OMEGA[0]) ** 2 * base * ratio, rel=4e-3
            )
        else:
            assert measured["stress"]["rms"] == pytest.approx(
                7.0 * MASS**0.5 * base * ratio, rel=2e-3
            )


def test_two_tones_have_a_band_each(tmp_path: Path) -> None:
    hertz = 40.0, 250.0
    tones = ", ".join(
        f"{{ amplitude_n = {n}, frequency_hz = {f} }}"
        for n, f in zip((1.0, 4.0), hertz, strict=True)
    )
    measured, _ = measures(
        tmp_path, model(2, 0.02), f'[load]\nkind = "tones"\ntones = [{tones}]\nduration_s = 4.0'
    )
    assert [band.get("to_hz") for band in measured["bands"]] == [pytest.approx(100.0), None]
    for force, frequency, band in zip((1.0, 4.0), hertz, measured["bands"], strict=True):
        omega = 2 * np.pi * frequency
        each = [
            t * f / (w**2 - omega**2 + 0.04j * w * omega)
            for t, f, w in zip(TIP_SHAPE, FORCE_SHAPE, OMEGA[:2], strict=False)
        ]
        assert band["rms_m"] == pytest.approx(force * abs(sum(each)) / np.sqrt(2), rel=0.01)
    orders = Tones((Tone(1.0, order=1.0), Tone(1.0, order=4.0)), schedule=RUN)
    assert band_edges(Loads((orders,)))[1] * 2 * np.pi == pytest.approx(2 * 65.0)


def test_the_energy_after_a_pulse_decays(tmp_path: Path) -> None:
    """As exp(-2 D omega t), about which the energy of a damped swing moves by the damping ratio."""
    load = (
        '[load]\nkind = "shock"\npulse = "half-sine"\npeak_n = 9.0\npulse_s = 0.0125\nduration_s '
        "= 0.5"
    )
    measured, _ = measures(tmp_path, ONE_MODE, load)
    times, energy = (np.array(measured["decay"][key]) for key in ("at_s", "energy_j"))
    assert times[0] == pytest.approx(0.0125, abs=1 / measured["sample_rate_hz"])
    np.testing.assert_allclose(
        energy, energy[0] * np.exp(-2 * 0.02 * OMEGA[0] * (times - times[0])), rtol=0.05
    )
    assert measured["decay"]["decay_s"] == pytest.approx(1 / (2 * 0.02 * OMEGA[0]), rel=0.03)
    assert measured["decay"]["higher_modes"] == [0.0] * len(times)
    assert measured["from_s"] == 0


def test_impacts_lose_what_their_velocities_say(tmp_path: Path) -> None:
    absorber = '\n[absorber]\nkind = "impact"\ngap = 3e-4\nrestitution = 0.7\n'
    load = '[load]\nkind = "random"\nspectrum = [[30.0, 0.05], [50.0, 0.05]]\nduration_s = 6.0'
    measured, written = measures(tmp_path, ONE_MODE + absorber, load, "--members", 2)
    start = measured["from_s"]
    assert start == pytest.approx(5 / (0.02 * OMEGA[0]))
    speeds = np.abs(written["impact_relative_velocity_m_s"])[
        np.array(written["impact_time_s"]) >= start
    ]
    impacts = measured["impacts"]
    assert len(speeds) > 50
    assert impacts["per_s"] == pytest.approx(len(speeds) / (6.0 - start), rel=1e-3)
    mass = 1 / (1 / (0.02 * MASS) + 1 / MASS)
    assert impacts["power_w"] == pytest.approx(
        mass / 2 * (1 - 0.7**2) * np.sum(speeds**2) / (6.0 - start), rel=1e-3
    )
    assert impacts["per_s_above"][-1] == pytest.approx(
        np.sum(speeds > impacts["above_m_s"][-1]) / (6.0 - start), rel=1e-3
    )
    assert measured["displacement_m"]["level"] == pytest.approx(
        written["response_level_m"][0], rel=0.01
    )  # from other samples
    assert written["measures"][1]["displacement_m"]["rms"] != measured["displacement_m"]["rms"]
