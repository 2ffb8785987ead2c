"""Studies of bladed disks have correct parameters, kinds of response and tables.

Parameters are compared with closed forms, and tables with numbers computed by hand.
"""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from impact_env import Drive
from impact_env.sectors import linear_sector_response
from studies.blades import mistuned
from studies.blades.chain import MASS_RATIO, Chain, Step
from studies.blades.mistuned import BARE, LAYOUTS, Case, add_disks, find_best, summarise
from studies.cli import compare_chain, which_blades
from studies.study import Measurement


@pytest.mark.parametrize("wave_number", [0, 1, 5])
def test_the_chain_has_the_masses_springs_and_dampers_of_the_paper(wave_number: int) -> None:
    """The chain has the masses, springs and dampers of the paper.

    Without absorbers the response is 1/(r_k^2 - (1 - eps) r^2 + 2 i D r_k r). With stuck ones it is
    1/(2 D r_k^2) at r_k.
    """
    chain = Chain(0.05, wave_number, 0.3)
    own = np.sqrt(1 + 0.2 * np.sin(np.pi * wave_number / 10) ** 2)
    assert chain.resonance == pytest.approx(own)
    r = own * np.array([0.99, 1.0, 1.01])
    wanted = 1 / (own**2 - 0.98 * r**2 + 2e-3j * own * r)
    response = linear_sector_response(chain.disk, r, wave_number, "backward")
    np.testing.assert_allclose(np.abs(response), np.abs(wanted)[:, None] * np.ones(10), rtol=1e-9)
    np.testing.assert_allclose(response[:, 0], wanted, rtol=1e-9)
    stuck = 1 / (own**2 - own**2 + 2e-3j * own**2)
    assert chain.linear_amplitude == pytest.approx(abs(stuck))
    np.testing.assert_allclose(chain.scene.absorber_masses, MASS_RATIO, rtol=1e-12)
    assert chain.scene.cavity(3).gap == pytest.approx(0.3 * chain.linear_amplitude)
    assert len(chain.frequencies) == 50
    assert chain.frequencies[-1] == pytest.approx(1.03 * own / np.sqrt(0.98))


@pytest.mark.parametrize(
    ("impacts", "kind"),
    [
        ([2.0, 2.0, 1.99], "synchronised"),
        ([2.0, 1.995, 0.0], "localised"),
        ([2.0, 0.3, 0.0], "solitary"),
        ([1.2, 1.4, 0.0], "modulated"),
        ([0.0, 0.0, 0.0], "without impacts"),
    ],
)
def test_responses_are_named_by_the_impacts_that_turn_absorbers(
    impacts: list[float], kind: str
) -> None:
    assert Step(1.0, np.ones(3), np.zeros(3), np.array(impacts)).kind == kind


def test_the_performance_curve_has_a_row_for_each_wave_number_and_coupling() -> None:
    rows = [
        {"wave_number": 1, "coupling": 0.01, "clearance": c, "amplitude": [a, a], "impacts": i}
        for c, a, i in ((0.1, 0.5, [2.0, 2.0]), (0.2, 0.25, [2.0, 0.5]), (0.3, 0.125, [1.0, 1.0]))
    ]
    rows += [rows[0] | {"coupling": 0.05, "clearance": 0.3}]
    text = compare_chain.make_curve_table(Measurement({"rows": rows})).splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text]
    assert cells[0] == ["wave number", "coupling", "0.1", "0.2", "0.3"]
    assert cells[2] == ["1", "0.01", "0.500 S", "0.250 1", "0.125 M"]
    assert cells[3] == ["1", "0.05", "", "", "0.500 S"]


def test_the_cost_of_the_other_program_is_read_from_what_it_prints(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = []

    def answer(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        calls.append(words)
        return subprocess.CompletedProcess(words, 0, "cpu_s = 5.250000, steps = 1000\n", "")

    monkeypatch.setattr(subprocess, "run", answer)
    assert compare_chain.time_peer(0.2, Path("CC"), 100) == pytest.approx(52.5)
    (words,) = calls
    assert words[-6:] == ["CC", "1", "0.01", "0.2", "100", "0.3"]
    assert Path(words[2]).is_file()
    table = compare_chain.make_cost_table(
        Measurement({"rows": [{"clearance": 0.2, "peer_ms": [50, 40, 60], "exact_ms": [0.5] * 3}]})
    )
    assert [cell.strip() for cell in table.splitlines()[2].split("|")[1:-1]] == [
        "0.2",
        "50",
        "0.50",
        "100",
    ]


def test_layouts_put_absorbers_into_their_blades() -> None:
    assert LAYOUTS["every"].choose_sectors(3) == list(range(10))
    assert LAYOUTS["second"].choose_sectors(3) == [0, 2, 4, 6, 8]
    assert LAYOUTS["one"].choose_sectors(3) == [3]
    disk = mistuned.make_disk(4)
    drive = mistuned.make_drive(disk, 0.0)
    assert isinstance(drive, Drive)
    ends = drive.schedule.omegas
    assert ends[0] < disk.model().omega[0] < disk.model().omega[-1] < ends[1]
    grid = np.linspace(*ends, 5001)
    response = np.abs(linear_sector_response(disk, grid, 1)).max(axis=0)
    assert mistuned.find_worst_blade(disk) == np.argmax(response)
    tuned = mistuned.make_drive(mistuned.make_disk(None), 0.0)
    at = tuned.schedule.reference
    amplitude = tuned.amplitude * np.abs(linear_sector_response(mistuned.make_disk(None), at, 1))
    np.testing.assert_allclose(amplitude, 1e-3, rtol=2e-2)


def row(layout: str, clearance: float, worst: list[float], tuned: list[float]) -> dict[str, object]:
    return {
        "layout": layout,
        "clearance": clearance,
        "drawn": len(worst),
        "worst": worst,
        "mean": worst,
        "participation": [0.5] * len(worst),
        "tuned": tuned,
    }


def test_the_table_has_medians_bands_and_best_clearances(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = row(BARE, 0.0, [2.0, 3.0, 4.0], [2.0])
    rows = [row("every", 0.2, [1.0, 1.0, 4.0], [0.5]), row("every", 0.4, [0.8, 0.8, 5.0], [0.4])]
    assert find_best(rows)["every"]["clearance"] == 0.4
    more_disks = rows[0] | {"worst": [1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1]}
    assert find_best([more_disks, rows[1]])["every"]["clearance"] == 0.4
    summary = summarise(rows[0], bare)
    np.testing.assert_allclose(summary["level"], [0.5, 0.5, 1.85])
    np.testing.assert_allclose(summary["amplification"][0], 2.0)
    text = which_blades.make_table(Measurement({"rows": [bare, *rows]}))
    assert "| every blade | 0.4 | 0.40 (0.40 to 2.29) | 0.20 | 2.00 (2.00 to 11.45) |" in " ".join(
        text.split()
    )
    calls = []

    def measure(case: Case, first: int, disks: int) -> dict[str, object]:
        calls.append((case, first, disks))
        return row(case.layout, case.clearance, [9.0] * (disks - first), [])

    monkeypatch.setattr(mistuned, "measure_case", measure)
    more = add_disks(rows[0], 5)
    assert calls == [(Case("every", 0.2), 3, 5)]
    assert more["worst"] == [1.0, 1.0, 4.0, 9.0, 9.0]
    assert more["tuned"] == [0.5]
    assert more["drawn"] == 5
