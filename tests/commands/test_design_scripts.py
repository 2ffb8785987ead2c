"""tune_ltva, design_gap and mass_ratios: files and tables."""

import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from commands import call, load, read

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError, friction_damper, impact_absorber
from impact_env.plain import to_scene
from optimisation.bounds import design_gap, reach
from optimisation.cli import mass_ratios
from optimisation.gap_check import GapCheck, check_gap, gap_factors, scaled_absorber, sweep_limits
from optimisation.tuned import den_hartog, undamped_h2


@pytest.fixture
def tune(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr("optimisation.report.tuning_report.minimax", lambda model, mass, resonance, *_range: den_hartog(model, mass, resonance))
    monkeypatch.setattr("optimisation.report.tuning_report.minimum_h2", lambda model, mass, resonance, *_range: undamped_h2(model, mass, resonance))
    return load("tune_ltva", monkeypatch)


@pytest.fixture
def gap(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("design_gap", monkeypatch)


def test_tunings_are_proved_and_written(tune: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    result = call(tune, "--modes", 2, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert {file.name for file in tmp_path.iterdir()} == {"tunings.csv", "summary.json", "tunings.png", "card.html", "card.json"}
    assert (tmp_path / "tunings.png").read_bytes().startswith(b"\x89PNG")
    table = {row["tuning"]: row for row in read(tmp_path / "tunings.csv")}
    assert float(table["paper"]["stiffness_n_m"]) == 701.8
    assert float(table["none"]["peak_relative"]) == 1.0
    assert table["none"]["stiffness_n_m"] == ""
    for row in table.values():
        assert float(row["certified_amplitude_m_n"]) == pytest.approx(float(row["peak_m_n"]), rel=1e-4)
        assert float(row["certified_amplitude_m_n"]) >= float(row["peak_m_n"]) * (1 - 1e-9)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["tunings"]["den_hartog"]["stiffness_n_m"] == float(table["den_hartog"]["stiffness_n_m"])
    assert content["settings"]["scoring_range"] == [0.5, 1.6]
    assert "times the smallest one" in result.stdout
    assert "Proved" in result.stdout


def test_all_that_is_told_is_of_the_recommended_device(gap: ModuleType, tmp_path: Path) -> None:
    device = tmp_path / "device.json"
    result = call(gap, "--force", 3.5, "--modes", 2, "--rate", 40, "--device", device, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    model = modal_model(Beam(modes=2))
    mass = 0.02 * model.beam_mass
    assert {file.name for file in tmp_path.iterdir()} == {"levels.csv", "summary.json", "levels.png", "device.json", "card.html", "card.json"}
    assert (tmp_path / "levels.png").read_bytes().startswith(b"\x89PNG")
    table = {float(row["gap_m"]): row for row in read(tmp_path / "levels.csv")}
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["complete"] is True
    assert content["rule_gap_m"] == design_gap(model, mass, 3.5)
    assert content["at_rule"]["level_median_m"] == float(table[content["rule_gap_m"]]["level_median_m"])
    assert content["settings"]["sweeps"] <= 40
    best, sharp = content["recommended"], content["sharp"]
    assert result.stdout.startswith(
        f"Recommended: a clearance of {1e3 * best['gap_m']:.4g} mm to either wall, friction limit {best['friction_limit_n']:.4g}"
    )
    for answer in (best, sharp):
        row = table[answer["gap_m"]]
        assert answer["level_m"] == float(row["level_median_m"])
        assert answer["level_5_m"] <= answer["level_m"] <= answer["level_95_m"]
        assert answer["level_worst_m"] >= answer["level_m"]
        assert answer["mass_kg"] == pytest.approx(mass)
        assert answer["friction_limit_n"] / answer["gap_m"] == pytest.approx(100.0, rel=1e-6)  # the paper's 0.1 N at 1 mm
        assert row["share_of_possible_reduction"] == ""  # the test's sweeps are too fast to tell
    assert sharp["level_m"] <= best["level_m"]
    assert best["level_worst_m"] <= sharp["level_worst_m"]
    assert content["settings"]["friction_limit_n"] == best["friction_limit_n"]
    scene = to_scene(json.loads(device.read_text()))
    assert scene.absorber == impact_absorber(best["gap_m"], best["restitution"], best["friction_limit_n"], 0.02)
    np.testing.assert_array_equal(scene.model.tip_shape, model.tip_shape)
    other = call(gap, "--scene", device, "--mass-ratio", 0.01, "--force", 3.5)
    assert other.exit_code == 2
    assert "--mass-ratio does not go with --scene" in other.stderr
    again = call(gap, "--scene", device, "--force", 3.5, "--rate", 40, "--force-tolerance", 0, "--members", 1, "--out", tmp_path)
    assert again.exit_code == 0, again.output
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["recommended"] == content["sharp"]
    assert content["recommended"]["level_worst_m"] == content["recommended"]["level_m"]
    assert content["recommended"]["friction_limit_n"] == best["friction_limit_n"]  # the device's, whatever the gap


def test_free_variables_are_searched_with_the_gap(gap: ModuleType, tmp_path: Path) -> None:
    line = ("--force", 3.5, "--modes", 2, "--rate", 40, "--quick", "--free", "restitution", "--free", "friction_limit", "--out", tmp_path)
    result = call(gap, *line)
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "summary.json").read_text())
    tried = {name: {row["value"]: row["level_m"] for row in content["tried"] if row["name"] == name} for name in ("restitution", "friction_limit")}
    assert content["recommended"]["restitution"] == min(tried["restitution"], key=tried["restitution"].get)
    assert set(tried["restitution"]) == {0.7, 0.5, 0.35, 0.2}
    assert len(tried["friction_limit"]) == 4
    assert "restitution 0.7: 1.00" in result.stdout


def test_rule_is_warned_of_and_refused_where_the_structure_hardly_moves(gap: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = call(gap, "--force", 35, "--resonance", 2, "--position", 0.8, "--quick", "--out", tmp_path)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert all(part in result.stderr for part in ("4.937 is not allowed", "0.2396 mm", "no wall would be touched"))
    result = call(gap, "--force", 3.5, "--mass-ratio", 0.005, "--gaps", 3, "--members", 1, "--rate", 3, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "Free amplitude over the rule's gap: 1.23." in result.stdout
    assert {0.4, 1.0, 2.5} <= {round(float(row["gap_over_rule"]), 6) for row in read(tmp_path / "levels.csv")}
    assert result.stdout.count("Warning:") == 2  # of the gap, and of sweeps that are too fast
    with monkeypatch.context() as patch:
        patch.setattr(gap, "simulated", lambda *given: pytest.fail(f"rate {given[-1]}"))
        with pytest.raises(pytest.fail.Exception, match=r"rate 0\.25"):  # the default, a quarter for half the damping
            gap.main(["--force", "3.5", "--damping", "0.005", "--out", str(tmp_path)], standalone_mode=False)


@pytest.fixture(scope="module")
def check() -> GapCheck:
    return check_gap(modal_model(Beam(modes=3)), 6.0, factors=[0.5, 1.0, 2.0], members=2, percent_per_100_periods=10.0)


def test_check_scales_with_the_force(check: GapCheck) -> None:
    """Twice the force, and twice the friction: the rule's gap and all levels double, the same phases given."""
    absorber = check.absorber
    doubled = check_gap(
        check.model,
        12.0,
        absorber=type(absorber)(absorber.mass_ratio, absorber.walls, type(absorber.friction)(2 * absorber.friction.limit)),
        factors=[0.5, 1.0, 2.0],
        members=2,
        percent_per_100_periods=10.0,
    )
    np.testing.assert_allclose(doubled.gaps, 2 * check.gaps, rtol=1e-12)
    np.testing.assert_allclose(doubled.limit, 2 * check.limit, rtol=1e-9)
    np.testing.assert_allclose(doubled.level, 2 * check.level, rtol=0.1)  # chaos: members differ after some impacts
    np.testing.assert_allclose(doubled.without.level, 2 * check.without.level, rtol=1e-12)


def test_check_knows_rule_best_and_shares(check: GapCheck) -> None:
    assert check.gaps[check.at_rule] == check.rule
    assert check.best is not None
    assert check.level[check.best] == check.level.min()
    assert check.sweep_ratio < 0.95
    assert np.all(np.isnan(check.share))  # sweeps ten times as fast as the paper's tell no share
    slow = check_gap(check.model, 6.0, factors=[1.0], members=1)
    assert slow.rate == 1.0
    assert 0.98 < slow.sweep_ratio < 1.0
    assert 0.4 < slow.share[0] < 1.05
    assert check.limit[0] > check.limit[2] == 0
    assert check.complete
    assert sweep_limits(check.model, check.mass) == (0.9, 1.06)
    assert sweep_limits(check.model, 10 * check.mass)[0] < 0.85


def test_bad_checks() -> None:
    model = modal_model(Beam(modes=2))
    for call_, name in (
        (lambda: check_gap(model, 3.5, absorber=friction_damper()), "rigid walls"),
        (lambda: check_gap(model, 3.5, factors=[0.5, 2.0]), "factors"),
        (lambda: check_gap(model, 3.5, factors=[-1.0, 1.0]), "factors"),
        (lambda: check_gap(model, 0.0), "force"),
        (lambda: gap_factors(1), "gaps"),
    ):
        with pytest.raises(ParameterError, match=name):
            call_()
    factors = gap_factors(7)
    assert factors[3] == 1.0
    np.testing.assert_allclose(factors * factors[::-1], 1.0)


# The table of the best gap over the mass: its numbers are those of the runs, and a page is written whole or not at all.


MODEL = modal_model(Beam(modes=2))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mass_ratios, "FACTORS", np.array([0.5, 1.0, 1.5]))


@pytest.mark.usefixtures("few")
def test_a_line_is_what_the_runs_of_that_mass_show() -> None:
    (found,) = mass_ratios.checks(MODEL, [0.05], [1], {"members": 1, "percent_per_100_periods": 50.0, "threads": 1})
    own = check_gap(MODEL, 1.0, 1, scaled_absorber(MODEL, 1.0, 1, 0.05), factors=[0.5, 1.0, 1.5], members=1, percent_per_100_periods=50.0)
    np.testing.assert_array_equal(found.relative, own.relative)
    cells = [cell.strip() for cell in mass_ratios.text([found]).splitlines()[-1].strip("|").split("|")]
    best = int(np.argmin(found.relative))
    assert cells[0] == "5 %"
    assert float(cells[2]) == pytest.approx(reach(MODEL, 0.05 * MODEL.beam_mass), rel=5e-3)
    assert cells[3].split()[0] == f"{found.gaps[best] / design_gap(MODEL, 0.05 * MODEL.beam_mass, 1.0):.2f}"
    assert ("or" in cells[3]) == (best != 1)
    assert float(cells[4]) == pytest.approx(100 * found.relative[best], abs=0.06)
    assert float(cells[6]) == pytest.approx(found.relative[1] / found.relative[best], abs=0.006)


@pytest.mark.usefixtures("few")
def test_the_page_gets_the_table_between_its_markers(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- masses -->\nold\n<!-- /masses -->\nafter\n")
    line = ["--rate", "100", "--members", "1", "--mass-ratio", "0.02", "--resonances", "1", "1", "--threads", "1"]
    result = call(mass_ratios, *line, "--page", page)
    assert result.exit_code == 0, result.output
    text = page.read_text()
    assert text.startswith("before\n<!-- masses -->\n| mass ratio")
    assert text.endswith("<!-- /masses -->\nafter\n")
    assert "old" not in text
    assert text.count("| 2 %") == 1
    assert "kernels" in text  # where it was measured
