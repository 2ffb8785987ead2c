"""The commands of the frequency domain: contents of their files, and published numbers."""

import csv
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from commands import call, load

from impact_env.frequency import tip_response
from impact_env.modes import modal_model
from impact_env.parameters import Beam, StuckAbsorber
from impact_env.periodic import Orbit, orbit_of, unpacked

PAPER = ("--modes", 3, "--friction-limit", 0.01)


@pytest.fixture
def response(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("frequency_response", monkeypatch)


@pytest.fixture
def isola(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("isola", monkeypatch)


@pytest.fixture
def error(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("balance_error", monkeypatch)


def test_the_papers_isola_by_both_methods_in_all_files(response: ModuleType, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("response.json", "response.csv", "response.png")]
    limits = ("--from", 0.92, "--to", 0.962, "--rate", 20)
    done = call(response, *PAPER, *limits, "--json", files[0], "--csv", files[1], "--plot", files[2])
    assert done.exit_code == 0, done.output
    found = json.loads(files[0].read_text())
    exact = [curve for curve in found["curves"] if curve["method"] == "exact orbits"]
    (closed,) = [curve for curve in exact if curve["closed"]]
    folds = sorted(mark["omega_ratio"] for mark in closed["located"] if mark["kind"] == "fold")
    assert folds[0] == pytest.approx(0.9336128203, abs=1e-9)
    assert folds[-1] == pytest.approx(0.9552754578, abs=1e-9)
    assert closed["peak"]["tip_max_m"] == pytest.approx(1.4743e-3, abs=1e-7)
    assert not any(closed["stable"])
    assert any(closed["slowly_stable"])
    entries = list(unpacked(closed["orbits"]))
    assert len(entries) == sum(tip is not None for tip in closed["tip_max_m"])
    assert all({"scene", "start", "events", "held_rad", "half_multipliers", "period_s", "symmetric"} <= set(entry) for entry in entries)
    assert isinstance(orbit_of(entries[len(entries) // 2]), Orbit)
    balance = [curve for curve in found["curves"] if curve["method"] == "harmonic balance"]
    assert sorted(curve["closed"] for curve in balance) == [False, True]
    model = modal_model(Beam(modes=3))
    ratio = np.array(found["linear"]["omega_ratio"])
    assert found["linear"]["stuck_m"] == pytest.approx(1.5 * np.abs(tip_response(model, StuckAbsorber(), ratio * model.omega[0])))
    assert [sweep["omega_ratio"][0] > sweep["omega_ratio"][-1] for sweep in found["sweeps"]] == [False, True]
    with files[1].open(newline="") as file:
        rows = list(csv.DictReader(file))
    for number, curve in enumerate(found["curves"], 1):
        kept = [x for x in curve["tip_max_m"] if x is not None]
        assert [float(row["tip_max_m"]) for row in rows if row["curve"] == str(number) and not row["located"]] == kept
    assert files[2].stat().st_size > 10_000
    assert sorted(tmp_path.iterdir()) == sorted(files)


@pytest.mark.parametrize(
    "options",
    [
        ("--absorber", "friction", "--friction-limit", 0.5),
        ("--contact-stiffness", 3e4, "--friction-limit", 0.05),
        ("--gap", 2e-3, "--mass-ratio", 0.05),
    ],
)
def test_other_absorbers_have_curves_too(response: ModuleType, tmp_path: Path, options: tuple[object, ...]) -> None:
    file = tmp_path / "response.json"
    done = call(response, "--modes", 2, *options, "--no-sweeps", "--method", "balance", "--from", 0.97, "--to", 1.03, "--force", 1, "--json", file)
    assert done.exit_code == 0, done.output
    found = json.loads(file.read_text())
    assert found["sweeps"] == []
    assert found["curves"][0]["omega_ratio"][0] == pytest.approx(0.97)
    assert "limit" in found["curves"][0]["ended"]


def test_balance_at_springs_loses_its_stability_where_the_absorber_first_touches_them(response: ModuleType, tmp_path: Path) -> None:
    """With a contact stiffness: up to the fold the absorber floats and the beam is that without one, beyond it each solution is a saddle."""
    file, figure = tmp_path / "found.json", tmp_path / "found.png"
    given = ("--modes", 1, "--force", 3, "--from", 0.95, "--to", 0.97, "--no-sweeps", "--method", "balance", "--harmonics", 10, "--hill")
    refused = call(response, *given)
    assert refused.exit_code == 2
    assert "--hill = True is not allowed: with harmonic balance and --contact-stiffness" in refused.output
    done = call(response, *given, "--contact-stiffness", 2e4, "--json", file, "--plot", figure)
    assert done.exit_code == 0, done.output
    curve = json.loads(file.read_text())["curves"][0]
    model = modal_model(Beam(modes=1))
    alone = 3 * np.abs(tip_response(model, None, np.array(curve["omega_ratio"]) * model.omega[0]))
    floats = np.isclose(curve["tip_max_m"], alone, rtol=1e-9)
    assert 5 < np.sum(floats) < len(floats) - 5
    np.testing.assert_array_equal(curve["stable"], floats)
    assert figure.stat().st_size > 10_000


def test_both_commands_list_the_same_folds(response: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """At 3 N the branch folds twice near 0.90321, with 4 reversals and with 8: which of them is met depends on the steps of the continuation."""
    orbits = load("orbits", monkeypatch)
    limits = ("--force", 3, "--from", 0.89, "--to", 0.93)
    assert call(response, *PAPER, *limits, "--method", "exact", "--no-sweeps", "--json", tmp_path / "r.json").exit_code == 0
    assert call(orbits, *PAPER, *limits, "--folds", "--json", tmp_path / "o.json").exit_code == 0
    curves = json.loads((tmp_path / "r.json").read_text())["curves"]
    drawn = sorted(mark["omega_ratio"] for curve in curves for mark in curve["located"] if mark["kind"] == "fold")
    assert drawn == [fold["omega_ratio"] for fold in json.loads((tmp_path / "o.json").read_text())]
    assert drawn == pytest.approx([0.9032099017, 0.9032184151], abs=1e-10)


def test_the_envelope_has_quantiles_of_runs_that_settled(response: ModuleType, tmp_path: Path) -> None:
    """The paper's two-mode case at 0.9 is linear but for sliding friction: all members alike, between the linear curves, without an impact."""
    files = [tmp_path / name for name in ("response.json", "response.png")]
    run = ("--modes", 2, "--friction-limit", 0.025, "--method", "exact", "--no-sweeps", "--from", 0.9, "--to", 0.905)
    runs = ("--envelope", 2, "--members", 3, "--window", 20, "--settle", 200, "--threads", 1)
    done = call(response, *run, *runs, "--json", files[0], "--plot", files[1])
    assert done.exit_code == 0, done.output
    assert "runs at" in done.output
    first, last = json.loads(files[0].read_text())["stationary"]
    assert (first["omega_ratio"], last["omega_ratio"]) == (0.9, 0.905)
    assert first["quantiles"] == [0.05, 0.5, 0.95]
    assert first["impacts_per_period"] == last["impacts_per_period"] == 0
    model = modal_model(Beam(modes=2))
    ends = [1.5 * abs(tip_response(model, absorber, np.array([0.9 * model.omega[0]]))[0]) for absorber in (None, StuckAbsorber())]
    assert all(0.95 * min(ends) < tip < 1.05 * max(ends) for tip in first["tip_max_m"])
    assert first["tip_max_m"][0] == pytest.approx(first["tip_max_m"][2], rel=1e-2)
    assert last["tip_max_m"][1] > 1.02 * first["tip_max_m"][1]
    assert files[1].stat().st_size > 10_000


def test_births_and_mergers_and_their_map(isola: ModuleType, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("isola.json", "isola.csv", "isola.png")]
    given = ("--json", files[0], "--csv", files[1], "--plot", files[2], "--map-modes", "1,3", "--map-restitutions", "0.75,1")
    done = call(isola, "--modes", 3, "--friction-limit", 0.01, "--from", 0.93, *given)
    assert done.exit_code == 0, done.output
    found = json.loads(files[0].read_text())
    assert [row["kind"] for row in found["thresholds"]] == ["birth", "merger"]
    assert [row["force_N"] for row in found["thresholds"]] == pytest.approx([1.221955, 2.370284], abs=1e-6)
    assert all(row["orbit"] == "yes" for row in found["thresholds"])
    same = [row["force_N"] for row in found["map"] if row["modes"] == 3 and row["restitution"] == 1]
    assert same == [row["force_N"] for row in found["thresholds"]]
    births = {row["restitution"]: row["force_N"] for row in found["map"] if row["modes"] == 3 and row["kind"] == "birth"}
    assert births[0.75] > births[1.0] + 0.5
    ratio, force = (np.array(found["fold_force"][name], dtype=float) for name in ("omega_ratio", "force_N"))
    inside = (ratio > 0.94) & (ratio < 0.95)
    assert np.min(force[inside]) == pytest.approx(1.221955, abs=1e-4)
    with files[1].open(newline="") as file:
        assert len(list(csv.DictReader(file))) == len(found["thresholds"]) + len(found["map"])
    assert files[2].stat().st_size > 10_000


def test_error_of_harmonic_balance_falls_with_the_harmonics(error: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "error.json"
    figure = tmp_path / "error.png"
    done = call(error, "--harmonics", "20,40", "--weights", "100", "--growing", "--json", file, "--plot", figure)
    assert done.exit_code == 0, done.output
    first, second = json.loads(file.read_text())["rows"]
    assert (first["weight"], second["weight"]) == (100, 400)
    assert first["closed"]
    assert second["closed"]
    assert 0.08 < first["tip_max_error"] < 0.13
    assert 0 < second["tip_max_error"] < first["tip_max_error"] / 3
    assert first["first_fold_ratio"] == pytest.approx(0.926, abs=6e-4)
    assert abs(second["first_fold_ratio"] - 0.93361) < abs(first["first_fold_ratio"] - 0.93361) / 2
    assert figure.read_bytes()[:4] == b"\x89PNG"
