"""Measures by sector agree with closed forms.

The cases are waves, sectors that move alone, a mistuned pair, and runs in parts.
"""

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from core import OMEGA, drive_of

from impact_env import (
    ParameterError,
    Record,
    Scene,
    constant_frequency,
    impact_absorber,
    sectors,
    simulate,
)
from impact_env.drive import Drive
from impact_env.frequency import find_steady_start
from impact_env.sectors import (
    SectorLevels,
    SectorResponse,
    amplification_factor,
    diameter_energies,
    linear_sector_response,
    participation_ratio,
    simulate_sectors,
)
from impact_env.structures.cyclic import CyclicStructure, Mistuning, ring_of_masses

HERTZ = OMEGA / (2 * np.pi)
BLADE = CyclicStructure(
    6,
    np.diag([1.0, 0.2]),
    [[3e4, -1e4], [-1e4, 1e4]],
    [[-2e3, 300.0], [-150.0, 0.0]],
    response=1,
    sector_mass=1.2,
)


def test_the_participation_ratio_is_the_share_of_sectors_that_move() -> None:
    amplitudes = np.zeros((3, 8))
    amplitudes[0] = 2e-200
    amplitudes[1, :3] = -5e190
    amplitudes[2, 5] = 1.0
    np.testing.assert_allclose(participation_ratio(amplitudes), [1, 3 / 8, 1 / 8], rtol=1e-14)
    assert participation_ratio([3.0, 1.0]) == pytest.approx(100 / (2 * 82), rel=1e-14)
    assert np.isnan(participation_ratio([0.0, 0.0]))


def modal(disk: CyclicStructure, values: np.ndarray) -> np.ndarray:
    """Return the modal coordinates (1, N_m) of a motion of all freedoms (N d,)."""
    return (disk.all_shapes().T @ disk.assemble()[0] @ values)[None, :]


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_waves_have_the_energy_of_their_nodal_diameter_and_direction(order: int) -> None:
    """Waves have the energy of their nodal diameter and direction.

    A wave of amplitude a on N masses m has N m (omega a)^2/2, and a standing one half of it, in
    closed form.
    """
    disk = ring_of_masses(6, 0.1, HERTZ, mass=1.5)
    omega = OMEGA * np.sqrt(1 + 0.4 * np.sin(np.pi * order / 6) ** 2)
    angle = 2 * np.pi * order * np.arange(6) / 6
    for direction, sign in (("forward", -1), ("backward", 1)):
        at = 0.7 + sign * angle
        energies = diameter_energies(
            disk, modal(disk, 1e-3 * np.cos(at)), modal(disk, -1e-3 * omega * np.sin(at))
        )
        whole = 6 * 1.5 * (1e-3 * omega) ** 2 / 2
        wanted = np.zeros((1, 4))
        wanted[0, order] = whole
        np.testing.assert_allclose(energies.total, wanted, atol=1e-12 * whole)
        travels = order in (1, 2)
        np.testing.assert_allclose(energies.travelling, wanted * travels, atol=1e-12 * whole)
        np.testing.assert_allclose(
            getattr(energies, direction), wanted * (1 if travels else 0.5), atol=1e-12 * whole
        )
    standing = diameter_energies(
        disk, modal(disk, 1e-3 * np.cos(angle)), modal(disk, np.zeros(6))
    ).mean()
    assert standing.standing[order] == pytest.approx(np.sum(standing.total), rel=1e-12)


def test_energies_by_nodal_diameter_add_up_to_that_of_the_matrices() -> None:
    """Energies by nodal diameter add up to that of the matrices.

    The test has two degrees of freedom per sector and a coupling that is not symmetric. The
    energies of the mistuned disk are those in modes of the tuned one.
    """
    mass, stiffness = BLADE.assemble()
    x, u = np.random.default_rng(1).standard_normal((2, 12))
    energies = diameter_energies(BLADE, modal(BLADE, x), modal(BLADE, u))
    assert np.sum(energies.total) == pytest.approx(
        0.5 * (u @ mass @ u + x @ stiffness @ x), rel=1e-12
    )
    mistuned = replace(BLADE, mistuning=Mistuning(0.05, seed=3))
    same = diameter_energies(mistuned, modal(mistuned, x), modal(mistuned, u))
    np.testing.assert_allclose(same.forward, energies.forward, rtol=1e-10)


def test_two_mistuned_sectors_have_the_response_of_their_closed_form() -> None:
    """Two mistuned sectors have the response of their closed form.

    A symmetric matrix of two rows has the eigenvalues m +- sqrt(d^2 + c^2) and the angle atan2(c,
    d)/2. Damping is modal.
    """
    coupling = 0.01
    mistuning = Mistuning(0.02, seed=5)
    disk = ring_of_masses(2, coupling, HERTZ, 2e-3, mistuning=mistuning)
    own = OMEGA**2 * (1 + 2 * coupling) * mistuning.factors("frequency", 2) ** 2
    link = -2 * coupling * OMEGA**2
    middle = np.mean(own)
    half = (own[0] - own[1]) / 2
    root = np.hypot(half, link)
    angle = np.arctan2(link, half) / 2
    shapes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    squares = middle + root * np.array([1, -1])
    w = OMEGA * np.linspace(0.95, 1.05, 1001)[:, None]
    for order, force in ((0, [1, 1]), (1, [1, -1])):
        receptances = 1 / (squares - w**2 + 4e-3j * np.sqrt(squares) * w)
        wanted = (receptances * (shapes.T @ force)) @ shapes.T
        response = linear_sector_response(disk, w[:, 0], order)
        np.testing.assert_allclose(response, wanted, rtol=1e-9, atol=1e-9 * np.max(np.abs(wanted)))
    assert np.max(np.abs(response), axis=0)[0] != pytest.approx(np.max(np.abs(response), axis=0)[1])


def test_levels_without_absorbers_are_those_of_the_linear_response() -> None:
    """Levels without absorbers are those of the linear response.

    From the steady state at a constant frequency, each sector's RMS is its amplitude over sqrt(2),
    in every window.

    The level's window is ten periods to either side of one of the equal maxima, and shorter at the
    ends of the run: there the closed form of the mean square of a cosine over that window is the
    truth.
    """
    disk = ring_of_masses(5, 0.02, HERTZ, 5e-3, mistuning=Mistuning(0.01, seed=2))
    scene = Scene(disk.model(1))
    drive = Drive(3.0, constant_frequency(OMEGA, 1.05, 40.0))
    start = find_steady_start(scene, drive)
    result = simulate_sectors(disk, scene, drive, windows=4, initial=start, samples_per_period=64)
    amplitude = np.abs(3.0 * linear_sector_response(disk, 1.05 * OMEGA, 1)[0])
    period = 2 * np.pi / OMEGA
    before = np.minimum(10 * period, result.levels.time)
    after = np.minimum(10 * period, 40 * period - result.levels.time)
    turn = 2 * 1.05 * OMEGA
    share = (np.sin(turn * before) + np.sin(turn * after)) / (turn * (before + after))
    levels = amplitude * np.sqrt(0.5 + 0.5 * share)
    np.testing.assert_allclose(result.levels.value, levels, rtol=2e-3)
    np.testing.assert_allclose(result.levels.largest, amplitude, rtol=1e-4)
    np.testing.assert_allclose(
        result.windows.rms, np.tile(amplitude / np.sqrt(2), (4, 1)), rtol=2e-3
    )
    np.testing.assert_allclose(result.windows.amplitude, np.tile(amplitude, (4, 1)), rtol=2e-3)
    assert result.levels.worst_sector == np.argmax(amplitude)
    assert result.levels.worst == np.max(result.levels.value)
    assert result.levels.mean == pytest.approx(np.mean(levels), rel=2e-3)
    assert result.levels.participation == pytest.approx(
        np.sum(levels**2) ** 2 / (5 * np.sum(levels**4)), rel=1e-3
    )


@pytest.mark.same_bits
def test_runs_in_parts_have_the_levels_of_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs in parts have the levels of one run.

    Sector 0 has the level that a run computes itself. With parts of a pseudo period all measures
    stay the same except for rounding.
    """
    disk = ring_of_masses(5, 0.05, HERTZ, 0.01)
    scene = disk.scene(impact_absorber(2e-4, 0.8, mass_ratio=0.02), 1)
    drive = drive_of(25.0, 1.0, 1.02, periods=5.3)
    one = simulate(scene, drive, record=Record(events=True))
    whole = simulate_sectors(disk, scene, drive, windows=7)
    monkeypatch.setattr(sectors, "PART_BYTES", 1)
    parts = simulate_sectors(disk, scene, drive, windows=7)
    assert whole.levels.value[0] == one.level.value
    assert whole.levels.time[0] == one.level.time
    assert whole.impact_count == one.impact_count >= 15
    for name in ("value", "time", "frequency_ratio", "largest"):
        np.testing.assert_allclose(
            getattr(parts.levels, name), getattr(whole.levels, name), rtol=1e-7
        )
    for name in ("rms", "low", "high"):
        np.testing.assert_allclose(
            getattr(parts.windows, name), getattr(whole.windows, name), rtol=1e-6, atol=1e-10
        )
    np.testing.assert_allclose(
        parts.windows.energies.forward, whole.windows.energies.forward, rtol=1e-6, atol=1e-12
    )
    np.testing.assert_array_equal(parts.windows.impacts, whole.windows.impacts)
    counts = np.histogram(one.impacts.time, whole.windows.edges)[0]
    np.testing.assert_array_equal(whole.windows.impacts.sum(axis=1), counts)
    np.testing.assert_allclose(
        parts.final_state.vector(scene), whole.final_state.vector(scene), rtol=1e-6, atol=1e-9
    )


def test_windows_are_drawn_by_sector_and_written(tmp_path: Path) -> None:
    mpl.use("Agg")
    disk = ring_of_masses(3, 0.05, HERTZ, 0.01)
    drive = drive_of(25.0, 1.0, 1.02, periods=4)
    result = simulate_sectors(disk, Scene(disk.model()), drive, windows=2)
    axes = result.windows.plot()
    np.testing.assert_allclose(axes.collections[0].get_array(), 1e3 * result.windows.rms.T)
    assert axes.get_xlabel() == "frequency over the resonance's"
    result.save(tmp_path / "disk.npz")
    again = SectorResponse.load(tmp_path / "disk.npz")
    np.testing.assert_array_equal(again.windows.rms, result.windows.rms)
    np.testing.assert_array_equal(again.levels.value, result.levels.value)


def test_the_amplification_factor_compares_worst_sectors() -> None:
    zero = np.zeros(2)
    tuned, mistuned = (
        SectorLevels(np.array(value), zero, zero, zero) for value in ([2.0, 2.0], [0.5, 3.0])
    )
    assert amplification_factor(mistuned, tuned) == 1.5
    with pytest.raises(ParameterError, match="worst level of the tuned disk = 0"):
        amplification_factor(mistuned, SectorLevels(zero, zero, zero, zero))


def test_modes_that_the_disk_lacks_are_refused() -> None:
    disk = ring_of_masses(2, 0.05, HERTZ)
    drive = drive_of(1.0, 1.0)
    other = Scene(ring_of_masses(3, 0.05, HERTZ).model())
    with pytest.raises(ParameterError, match="scene = '3 modes' is not allowed: 1 to 2 modes"):
        simulate_sectors(disk, other, drive)
    with pytest.raises(ParameterError, match="windows = 0"):
        simulate_sectors(disk, Scene(disk.model()), drive, windows=0)
    with pytest.raises(ParameterError, match=r"velocity = \(1, 1\)"):
        diameter_energies(disk, np.zeros((1, 2)), np.zeros((1, 1)))
