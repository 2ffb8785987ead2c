"""Commands of design: what their files and tables hold, and what their tables are made of."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner
from commands import FAST, call, done, load, read
from drawing import labelled_lines, saved_figures

from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import Threads
from impact_env.loads import Loads, Shock
from impact_env.modes import modal_model
from impact_env.parameters import Beam, impact_absorber
from impact_env.plain import to_scene
from impact_env.scene import Scene
from optimisation.absorber_rules import scaled_absorber
from optimisation.bounds import design_gap, reach
from optimisation.cli import design_masses as mass_ratios
from optimisation.cli.common import plain_errors
from optimisation.cli.design_options import announce_search
from optimisation.comparison import compare
from optimisation.executors import announce_load_runs, duration_in_words
from optimisation.gap_advice import check_gap
from optimisation.insight import sensitivity, stationary_limit
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.design_report import LEVEL_COLUMNS
from optimisation.space import design_space
from optimisation.sweep_range import find_sweep_range
from optimisation.tuned import den_hartog, undamped_h2

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

MODEL = modal_model(Beam(modes=2))


@pytest.fixture
def tune(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr(
        "optimisation.report.tuning_report.minimax",
        lambda model, mass, resonance, *_range: den_hartog(model, mass, resonance),
    )
    monkeypatch.setattr(
        "optimisation.report.tuning_report.minimum_h2",
        lambda model, mass, resonance, *_range: undamped_h2(model, mass, resonance),
    )
    return load("tune_ltva", monkeypatch)


@pytest.fixture
def gap(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("design_gap", monkeypatch)


def test_tunings_are_proved_and_written(tune: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    result = done(tune, "--modes", 2, "--out", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        "tunings.csv",
        "summary.json",
        "tunings.png",
        "card.html",
        "card.json",
    }
    assert (tmp_path / "tunings.png").read_bytes().startswith(b"\x89PNG")
    table = {row["tuning"]: row for row in read(tmp_path / "tunings.csv")}
    assert float(table["paper"]["stiffness_n_m"]) == 701.8
    assert float(table["none"]["peak_relative"]) == 1.0
    assert table["none"]["stiffness_n_m"] == ""
    for row in table.values():
        assert float(row["certified_amplitude_m_n"]) == pytest.approx(
            float(row["peak_m_n"]), rel=1e-4
        )
        assert float(row["certified_amplitude_m_n"]) >= float(row["peak_m_n"]) * (1 - 1e-9)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["tunings"]["den_hartog"]["stiffness_n_m"] == float(
        table["den_hartog"]["stiffness_n_m"]
    )
    assert "Proved" in result.stdout


def test_card_and_summary_are_of_the_recommended_device(gap: ModuleType, tmp_path: Path) -> None:
    device = tmp_path / "device.json"
    line = ("--force", 3.5, "--modes", 2, "--rate", 40, "--device", device, "--out", tmp_path)
    result = done(gap, *line)
    mass = 0.02 * MODEL.beam_mass
    assert {file.name for file in tmp_path.iterdir()} == {
        "levels.csv",
        "summary.json",
        "levels.png",
        "frequency.csv",
        "frequency.png",
        "device.json",
        "card.html",
        "card.json",
    }
    table = {float(row["gap_m"]): row for row in read(tmp_path / "levels.csv")}
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["rule_gap_m"] == design_gap(MODEL, mass, 3.5)
    assert content["at_rule"]["level_median_m"] == float(
        table[content["rule_gap_m"]]["level_median_m"]
    )
    assert content["settings"]["sweeps"] <= 50
    best = content["recommended"]
    sharp = content["sharp"]
    assert result.stdout.startswith(
        f"Recommended: a clearance of {1e3 * best['gap_m']:.4g} mm to either wall, friction "
        f"limit {best['friction_limit_n']:.4g}"
    )
    for answer in (best, sharp):
        row = table[answer["gap_m"]]
        assert answer["level_m"] == float(row["level_median_m"])
        assert answer["level_5_m"] <= answer["level_m"] <= answer["level_95_m"]
        assert answer["level_worst_m"] >= answer["level_m"]
        assert answer["friction_limit_n"] / answer["gap_m"] == pytest.approx(
            100.0, rel=1e-6
        )  # the paper's 0.1 N at 1 mm
        assert row["share_of_possible_reduction"] == ""  # the test's sweeps are too fast to tell
    assert sharp["level_m"] <= best["level_m"]
    assert best["level_worst_m"] <= sharp["level_worst_m"]
    assert content["settings"]["friction_limit_n"] == best["friction_limit_n"]
    scene = to_scene(json.loads(device.read_text()))
    assert scene.absorber == impact_absorber(
        best["gap_m"], best["restitution"], best["friction_limit_n"], 0.02
    )
    np.testing.assert_array_equal(scene.model.tip_shape, MODEL.tip_shape)
    done(
        gap,
        "--scene",
        device,
        "--force",
        3.5,
        "--rate",
        40,
        "--force-tolerance",
        0,
        "--members",
        1,
        "--out",
        tmp_path,
    )
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["recommended"] == content["sharp"]
    assert (
        content["recommended"]["friction_limit_n"] == best["friction_limit_n"]
    )  # the device's, whatever the gap


def test_free_variables_are_searched_with_the_gap(gap: ModuleType, tmp_path: Path) -> None:
    done(
        gap,
        "--force",
        3.5,
        "--modes",
        2,
        "--rate",
        40,
        "--quick",
        "--free",
        "restitution",
        "--out",
        tmp_path,
    )
    content = json.loads((tmp_path / "summary.json").read_text())
    tried = {
        row["value"]: row["level_m"] for row in content["tried"] if row["name"] == "restitution"
    }
    assert content["recommended"]["restitution"] == min(tried, key=tried.get)
    assert set(tried) == {0.7, 0.5, 0.35, 0.2}


def test_rule_is_warned_of_where_the_structure_hardly_moves(
    gap: ModuleType, tmp_path: Path
) -> None:
    result = done(
        gap,
        "--force",
        3.5,
        "--mass-ratio",
        0.005,
        "--gaps",
        3,
        "--members",
        1,
        "--rate",
        3,
        "--out",
        tmp_path,
    )
    assert "Free amplitude over the rule's gap: 1.23." in result.stdout
    assert {0.4, 1.0, 2.5} <= {
        round(float(row["gap_over_rule"]), 6) for row in read(tmp_path / "levels.csv")
    }
    assert result.stdout.count("Warning:") == 2  # of the gap, and of sweeps that are too fast


def test_a_line_of_the_best_gap_over_the_mass_is_what_the_runs_of_that_mass_show(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mass_ratios, "FACTORS", np.array([0.5, 1.0, 1.5]))
    (row,) = mass_ratios.checks(
        MODEL, [0.05], [1], {"members": 1, "percent_per_100_periods": 50.0, "threads": 1}
    )
    own = check_gap(
        MODEL,
        1.0,
        1,
        scaled_absorber(MODEL, 1.0, 1, 0.05),
        factors=[0.5, 1.0, 1.5],
        members=1,
        percent_per_100_periods=50.0,
    )
    np.testing.assert_array_equal(row.relative, own.relative)
    table = mass_ratios.check_table([row])
    cells = [cell.strip() for cell in table.to_text().splitlines()[-1].strip("|").split("|")]
    (record,) = table.records()
    best = int(np.argmin(row.relative))
    assert cells[0] == "5 %"
    assert float(cells[2]) == pytest.approx(reach(MODEL, 0.05 * MODEL.beam_mass), rel=5e-3)
    assert (
        cells[3].split()[0]
        == f"{row.gaps[best] / design_gap(MODEL, 0.05 * MODEL.beam_mass, 1.0):.2f}"
    )
    assert ("or" in cells[3]) == (best != 1)
    assert record["best_gap_is"] == {0: "narrowest", 1: None, 2: "widest"}[best]
    assert record["rule_over_best"] == row.relative[1] / row.relative[best]
    assert record["level_read_at_end"] == ("(end)" in cells[8])
    assert float(cells[4]) == pytest.approx(100 * row.relative[best], abs=0.06)
    (part,) = mass_ratios.frequency_of([row], None)
    assert [curve.name for curve in part.curves] == ["5 % of the mass", "no absorber"]
    worst = float(np.nanmax(row.curves[best].level))
    assert 0.97 * worst < np.nanmax(part.curves[0].level) < 1.2 * worst
    assert float(cells[6]) == pytest.approx(row.relative[1] / row.relative[best], abs=0.006)


# Searches: all files of a concept and of a front, their limits and their indices.


def test_no_winner_is_exit_code_1_and_the_files_say_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    limit = ["--constraint", "mass_ratio", 0.001, "--no-figures"]  # the absorber has 2 %
    result = call(
        load("optimise_design", monkeypatch),
        *FAST,
        "--concept",
        "friction",
        "--designs",
        5,
        *limit,
        "--out",
        tmp_path,
    )
    assert result.exit_code == 1, result.output
    assert (
        result.stderr
        == "No winner: no design kept all constraints; loosen them, or search longer.\n"
    )
    content = json.loads((tmp_path / "friction" / "summary.json").read_text())
    assert not content["winner"]["feasible"]
    assert content["rule"]["constraints"]["mass_ratio"]["exceeded_by"] == pytest.approx(19.0)
    assert "breaks mass_ratio of 0.02 over 0.001 of the beam's mass by 1.9e+03 %" in result.stdout
    assert "no feasible design" in result.stdout


def test_full_disk_is_one_message_and_exit_code_1() -> None:
    @click.command()
    def command() -> None:
        with plain_errors():
            raise OSError(28, "No space left on device", "results/study.journal")

    result = CliRunner().invoke(command)
    assert result.exit_code == 1
    assert result.output == "Error: results/study.journal: No space left on device\n"


def levels_drawn(rows: list[dict[str, str]], name: str, design: str) -> np.ndarray:
    """Return the values that a figure shows for a design, (2, K), from a table of levels.

    Over the force they are in mm, and over a detuning in % of the level without absorber.
    """
    own = [row for row in rows if row["design"] == design]
    x = np.array([float(row[name]) for row in own])
    level = np.array([float(row["level_median_m"]) for row in own])
    if name == "force_n":
        return np.array([x, 1e3 * level])
    return np.array([100 * x, 100 * level / [float(row["without_m"]) for row in own]])


def same_points(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=1e-12)


def test_concepts_write_all_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("optimisation.service.FREQUENCIES", 2)
    monkeypatch.setattr("optimisation.service.FORCES", np.array([0.5, 1.0, 2.0]))
    optimise = load("optimise_design", monkeypatch)
    monkeypatch.setattr(optimise, "VARIABLES", dict.fromkeys(("impact", "tuned")))
    drawn = saved_figures(monkeypatch)
    before = optimise.design.conditions_of(SimpleNamespace(cluster=None, threads=1))[
        "memory_bytes"
    ]  # of all that these tests have loaded and compiled
    result = done(
        optimise, *FAST, "--concept", "all", "--at", "1:3.5", "--designs", 6, "--out", tmp_path
    )
    assert "winner over paper" in result.stdout
    common = {
        "card.html",
        "card.json",
        "designs.csv",
        "summary.json",
        "frequency.csv",
        "frequency.png",
        "curves.csv",
        "curves.png",
        "detuned.csv",
        "detuned.png",
        "sensitivity.png",
    }
    for concept, own in (("impact", {"map.csv", "map.png"}), ("tuned", set())):
        folder = tmp_path / concept
        assert {file.name for file in folder.iterdir()} == common | own | {"study.journal"} | (
            {"study.journal.optuna"} if concept == "impact" else set()
        )
        content = json.loads((folder / "summary.json").read_text())
        assert content["finished"] is True
        assert before <= content["memory_bytes"] < before + 2**30
        low, high = content["winner_over_paper"]["95_percent"]
        assert 0 < low <= content["winner_over_paper"]["ratio"] <= high
        assert content["with_more_modes"]["modes"] == 4
        assert content["in_service"]["conditions"][0]["level_m"] > 0
        card = {
            heading: {row["label"]: row for row in rows}
            for heading, rows in json.loads((folder / "card.json").read_text())["groups"].items()
        }
        mass = content["winner"]["values"]["mass_ratio"] * MODEL.beam_mass
        assert card["Winner"]["absorber mass"]["value"] == pytest.approx(mass)
        assert len(read(folder / "designs.csv")) == content["designs"]
        assert tuple(read(folder / "curves.csv")[0]) == LEVEL_COLUMNS
        for file, name in (("curves.csv", "force_n"), ("detuned.csv", "detuning")):
            rows = read(folder / file)
            wanted = [levels_drawn(rows, name, design) for design in ("winner", "paper")]
            levels = [
                [points for points, label in labelled if label in ("winner", "paper's design")]
                for figure in drawn
                for labelled in [labelled_lines(figure.axes[0])]
            ]
            assert any(len(own) == 2 and all(map(same_points, own, wanted)) for own in levels), file
    (condition,) = json.loads((tmp_path / "impact" / "summary.json").read_text())["conditions"]
    assert 0 < condition["winner"]["level_m"] < condition["without_m"]
    assert len(read(tmp_path / "impact" / "map.csv")) == 9


def test_front_is_written_and_compared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    result = done(
        load("pareto", monkeypatch), *FAST, "--designs", 13, "--random-seeds", 2, "--out", tmp_path
    )
    folder = tmp_path / "resonances"
    files = {
        "front.csv",
        "front.png",
        "summary.json",
        "study.journal",
        "study.journal.optuna",
        "card.html",
        "card.json",
    }
    assert {file.name for file in folder.iterdir()} == files
    content = json.loads((folder / "summary.json").read_text())
    rows = read(folder / "front.csv")
    assert len(rows) == content["designs"] == 13
    scores = [row["score"] for row in content["front"]]
    assert scores == sorted(scores)
    assert [b for _, b in scores] == sorted((b for _, b in scores), reverse=True)
    assert sum(row["on_front"] == "1" for row in rows) == len(scores)
    won = sum(entry["method"] > entry["random"] for entry in content["against_random"])
    assert content["seeds_won_against_random"] == won
    assert f"in {won} of 2 seeds" in result.stdout


def test_limit_is_that_of_the_free_end_for_any_place_and_any_number_of_cavities() -> None:
    conditions = (Condition(1, 10.0), Condition(1, 10.0, detuning=0.05))
    problem = Problem(design_space("impact", ["gap", "position"]), conditions, beam=Beam(modes=3))
    end, near, inside = (
        problem.space.design({"gap": 1e-3, "position": x}) for x in (1.0, 1 - 1e-9, 0.7)
    )
    both = design_space("several", ["gap_1", "gap_2"]).design({"gap_1": 1e-3, "gap_2": 1e-3})
    own, other = (stationary_limit(problem, end, condition) for condition in conditions)
    assert own > other > 1e-3  # a stiffer beam answers less
    assert stationary_limit(problem, near, conditions[0]) == pytest.approx(own, rel=1e-6)
    assert stationary_limit(problem, both, conditions[0]) == pytest.approx(
        own, rel=1e-9
    )  # two halves of the mass, one place, one gap
    assert stationary_limit(problem, inside, conditions[0]) > 1.2 * own
    assert math.isnan(
        stationary_limit(problem, design_space("friction").default, conditions[0])
    )  # no cavity


def test_sobol_indices_find_what_matters() -> None:
    """Sobol indices find the variables that matter.

    The level of a tuned absorber is smooth. If only the stiffness varies, the damping can explain
    nothing.
    """
    space = design_space("tuned", ["stiffness", "damping"], {"damping": (0.899, 0.901)}, {})
    problem = Problem(
        space, (Condition(1, 1.0, (0.5, 1.6)),), beam=Beam(modes=2), members=1, rate=40.0
    )
    indices = sensitivity(
        problem, space.design({"stiffness": 620.0, "damping": 0.9}), 16, 1, Threads()
    )
    assert indices.names == ("stiffness", "damping")
    assert indices.designs == 16 * 4
    assert indices.total[0] > 0.8
    assert abs(indices.total[1]) < 0.05
    assert (indices.low[0], indices.high[0]) == pytest.approx((496.0, 744.0))


def test_a_long_search_says_how_long_and_answers_coarsely_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A long search reports its duration and prints a coarse result first.

    In the test every run counts as long. The coarse result is the one that the command gives alone
    at ten times the rate.
    """
    command = load("design_gap", monkeypatch)
    monkeypatch.setattr(command, "LONG_S", 0.0)
    monkeypatch.setattr("optimisation.executors.LONG_S", 0.0)
    monkeypatch.setattr(command, "COARSE_PERIODS", 1.0)
    options = ["--force", 3.5, "--modes", 2, "--members", 1, "--no-card"]
    result = done(command, *options, "--rate", 10, "--out", tmp_path / "both")
    assert "About " in result.stderr
    assert "50 runs of up to" in result.stderr
    first_answer = re.search(r"a gap of (\S+) mm, level (\S+) mm", result.stderr)
    assert first_answer is not None
    monkeypatch.setattr(command, "LONG_S", math.inf)
    done(command, *options, "--rate", 100, "--out", tmp_path / "alone")
    alone = json.loads((tmp_path / "alone" / "summary.json").read_text())["recommended"]
    assert float(first_answer[1]) == pytest.approx(1e3 * alone["gap_m"], rel=1e-2)
    assert float(first_answer[2]) == pytest.approx(1e3 * alone["level_m"], rel=1e-2)


def test_masses_are_announced_and_answered_coarsely_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search over masses reports its duration and prints a coarse table first.

    A period counts as 1 s, so the time is that of all sweeps. The coarse table is of one run at ten
    times the rate.
    """
    calls: list[tuple[int, float | None]] = []
    factors = np.array([0.5, 1.0, 1.5])
    original = mass_ratios.checks

    def noted(*arguments: Any) -> Any:
        calls.append((arguments[3]["members"], arguments[3]["percent_per_100_periods"]))
        return original(*arguments)

    for name in ("FACTORS", "LOW_FACTORS"):
        monkeypatch.setattr(mass_ratios, name, factors)
    monkeypatch.setattr(mass_ratios, "checks", noted)
    monkeypatch.setattr("optimisation.executors.seconds_per_period", lambda *_arguments: 1.0)
    options = ("--mass-ratio", 0.02, "--resonances", 1, 1, "--members", 2, "--rate", 50)
    result = done(mass_ratios, *options, "--threads", 1)
    low, high = find_sweep_range(modal_model(Beam()), 0.02, 1)
    seconds = 2 * 3 * 2 * 1e4 * (high - low) / 50
    assert f"About {duration_in_words(seconds)}" in result.stderr
    assert "12 runs of up to" in result.stderr
    assert calls == [(1, 500.0), (2, 50.0)]
    assert "Coarse answer" in result.stderr
    assert result.stderr.count("best gap over the rule's") == 1
    assert "level read at" in result.stdout


def test_a_search_is_announced_with_the_level_of_the_rules_design(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("optimisation.executors.seconds_per_period", lambda *_arguments: 1.0)
    problem = Problem(
        design_space("impact"), (Condition(1, 3.5),), beam=Beam(modes=2), members=2, rate=10.0
    )
    announce_search(problem, 30.0, 1, None, Threads())
    announcement = capsys.readouterr().err
    periods = 1e4 * (1.06 - 0.9) / 10.0
    assert f"About {duration_in_words(30 * 2 * 2 * periods)}" in announcement
    case = CurveCase(
        Scene(problem.model, problem.space.default.absorber()),
        np.array([3.5]),
        1,
        (0.9, 1.06),
        100.0,
        steady_start=True,
    )
    none = replace(case, scene=Scene(problem.model))
    level, free = (curve.median[0] for curve in performance_curves([case, none], 1, 0))
    match = re.search(r"no absorber (\S+)\.\n", announcement)
    assert float(match[1]) == pytest.approx(level / free, rel=2e-2)
    announce_search(problem, 30.0, 1, "host:1", Threads())
    assert not capsys.readouterr().err


def test_a_comparison_is_announced_and_answered_coarsely_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = load("compare_absorbers", monkeypatch)
    calls: list[dict[str, Any]] = []

    def small(_own: Any, **options: Any) -> Any:
        calls.append(options)
        return compare(Beam(modes=2), **options | {"percent_per_100_periods": 200.0})

    monkeypatch.setattr(command, "compare", small)
    monkeypatch.setattr("optimisation.comparison.minimax", den_hartog)
    monkeypatch.setattr("optimisation.executors.seconds_per_period", lambda *_arguments: 1.0)
    options = ("--forces", 2, "--members", 2, "--rate", 5, "--threads", 1)
    result = done(command, *options, "--out", tmp_path)
    assert "About " in result.stderr
    assert "Coarse answer" in result.stderr
    assert "impact absorber " in result.stderr
    rates = [(one["members"], one["percent_per_100_periods"]) for one in calls]
    assert rates == [(1, 50.0), (2, 5.0)]


def test_runs_under_loads_are_announced_by_one_of_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("optimisation.executors.LONG_S", 0.0)
    loads = Loads((Shock("half-sine", 10.0, 0.01, 0.5),), MODEL.resonance_omega(1))
    seconds = announce_load_runs(Scene(MODEL, impact_absorber()), loads, 1000, 1)
    announcement = capsys.readouterr().err
    assert f"About {duration_in_words(seconds)}" in announcement
    assert "1,000 runs of 0.5 s" in announcement


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(20.4, "20 s"), (119.0, "120 s"), (150.0, "2.5 min"), (7300.0, "2 h"), (1e6, "12 days")],
)
def test_a_duration_is_in_words(seconds: float, words: str) -> None:
    assert duration_in_words(seconds) == words
