"""Commands at their limits: one message and the right exit code, from fresh processes where that is what counts."""

import json
import math
from pathlib import Path
from types import ModuleType

import click
import numpy as np
import pytest
from click.testing import CliRunner
from commands import FAST, call, load, read

from impact_env.ensemble import Threads
from impact_env.modes import modal_model
from impact_env.parameters import Beam
from optimisation.cli.common import end_early, json_option, name_files, plain_errors
from optimisation.designs import design_space
from optimisation.extremes import usable_force, usable_mass_ratio, usable_rate
from optimisation.files import write_json
from optimisation.insight import sensitivity
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.design_tables import LEVEL_COLUMNS, limit

pytest.importorskip("optuna")
pytest.importorskip("cmaes")


def test_bounds_of_what_is_usable() -> None:
    assert usable_force("force", 1e12) == 1e12
    assert usable_mass_ratio("mass", 1) == 1.0
    assert usable_rate("rate", 400, [(0.9, 1.1)]) == 400.0  # 20 % in 5 periods
    assert usable_rate("rate", 1e-4, [(0.9, 1.1), (0.5, 1.6)]) == 1e-4  # the default at the least damping that has one of its own
    for function, value in ((usable_force, 1.1e12), (usable_force, 0.0), (usable_mass_ratio, 1.01), (usable_mass_ratio, -1.0)):
        with pytest.raises(ValueError, match=r"number = .* is not allowed"):
            function("number", value)
    for rate in (401.0, 1.9e-6, float("nan"), 0.0):
        with pytest.raises(ValueError, match=r"rate = .* is not allowed"):
            usable_rate("rate", rate, [(0.9, 1.1)])


@pytest.mark.parametrize("concept", ["impact", "friction"])
def test_no_winner_is_exit_code_1_and_the_files_say_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, concept: str) -> None:
    limit = ["--constraint", "mass_ratio", 0.001, "--no-figures"]  # the absorber has 2 %
    result = call(load("optimise_design", monkeypatch), *FAST, "--concept", concept, "--designs", 5, *limit, "--out", tmp_path)
    assert result.exit_code == 1, result.output
    assert result.stderr == "No winner: no design kept all constraints; loosen them, or search longer.\n"
    content = json.loads((tmp_path / concept / "summary.json").read_text())
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


def test_json_alone_goes_to_standard_output_and_what_is_finished_after_an_early_end() -> None:
    @click.command()
    @json_option("Numbers.", "target")
    def command(target: Path) -> None:
        click.echo("a table")
        write_json(target, [1])
        name_files([target])
        end_early(False)

    result = call(command, "--json", "-")
    assert (result.exit_code, json.loads(result.stdout)) == (130, [1])
    assert "a table\n\nwritten: standard output\nStopped early" in result.stderr


@pytest.fixture
def optimise(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr("optimisation.insight.FREQUENCIES", 2)
    monkeypatch.setattr("optimisation.insight.FORCES", np.array([0.5, 1.0, 2.0]))
    return load("optimise_design", monkeypatch)


@pytest.fixture
def pareto(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return load("pareto", monkeypatch)


def test_all_concepts_write_all_files(optimise: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optimise, "VARIABLES", dict.fromkeys(("impact", "friction", "tuned")))  # several: two kernels more, of half a minute
    before = optimise.design.conditions_of({"cluster": None, "threads": 1})["memory_bytes"]  # of all that these tests have loaded and compiled
    result = call(optimise, *FAST, "--concept", "all", "--at", "1:3.5", "--designs", 6, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    common = {"card.html", "card.json", "designs.csv", "summary.json", "curves.csv", "curves.png", "detuned.csv", "detuned.png"}
    impact = {"map.csv", "map.png", "sensitivity.png", "study.journal"}
    for concept, own in (
        ("impact", impact),
        ("friction", {"study.journal"}),
        ("tuned", {"sensitivity.png", "study.journal"}),
    ):
        folder = tmp_path / concept
        assert {file.name for file in folder.iterdir()} == common | own
        assert all(file.read_bytes().startswith(b"\x89PNG") for file in folder.glob("*.png"))
        content = json.loads((folder / "summary.json").read_text())
        assert content["finished"] is True
        assert before <= content["memory_bytes"] < before + 2**30
        assert content["problem"]["space"]["concept"] == concept
        low, high = content["winner_over_paper"]["95_percent"]
        assert 0 < low <= content["winner_over_paper"]["ratio"] <= high
        assert content["with_more_modes"]["modes"] == 4
        assert content["paper"]["values"]["mass_ratio"] == 0.02
        assert content["in_service"]["conditions"][0]["level_m"] > 0
        card = {heading: {row["label"]: row for row in rows} for heading, rows in json.loads((folder / "card.json").read_text())["groups"].items()}
        mass = content["winner"]["values"]["mass_ratio"] * modal_model(Beam(modes=2)).beam_mass
        assert card["Winner"]["absorber mass"]["value"] == pytest.approx(mass)
        assert {"winner's design", "no absorber", "best tuned absorber of this mass (stationary)"} < set(card["Resonance 1, 3.5 N"])
        assert "with 4" in card["Assumptions"]["modes kept"]["value"]
        assert len(read(folder / "designs.csv")) == content["designs"]
        assert tuple(read(folder / "curves.csv")[0]) == LEVEL_COLUMNS
    (condition,) = json.loads((tmp_path / "impact" / "summary.json").read_text())["conditions"]
    assert 0 < condition["winner"]["level_m"] < condition["without_m"]
    assert condition["sweep_over_stationary_level"] < 0.95
    assert condition["winner"]["share_of_possible_reduction"] is None  # the test's sweeps are too fast to tell
    assert len(read(tmp_path / "impact" / "map.csv")) == 9
    assert "winner over paper" in result.stdout


@pytest.mark.parametrize("against", ["resonances", "severity"])
def test_front_is_written_and_compared(pareto: ModuleType, tmp_path: Path, against: str) -> None:
    compared = ["--random-seeds", 2] if against == "resonances" else []
    result = call(pareto, *FAST, "--against", against, "--designs", 13, *compared, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    folder = tmp_path / against
    assert {file.name for file in folder.iterdir()} == {"front.csv", "front.png", "summary.json", "study.journal", "card.html", "card.json"}
    content, rows = json.loads((folder / "summary.json").read_text()), read(folder / "front.csv")
    assert len(rows) == content["designs"] == 13
    scores = [row["score"] for row in content["front"]]
    assert scores == sorted(scores)
    assert [b for _, b in scores] == sorted((b for _, b in scores), reverse=True)
    assert sum(row["on_front"] == "1" for row in rows) == len(scores)
    assert len(content["against_random"]) == (2 if compared else 0)
    won = sum(entry["method"] > entry["random"] for entry in content["against_random"])
    assert content["seeds_won_against_random"] == (won if compared else None)
    assert (f"in {won} of 2 seeds" in result.stdout) == bool(compared)
    assert all(set(entry) == {"seed", "method", "random"} for entry in content["against_random"])
    groups = json.loads((folder / "card.json").read_text())["groups"]
    borne = [{row["label"]: row["value"] for row in rows} for heading, rows in groups.items() if "bears" in heading]
    assert len(borne) == len({0, len(scores) // 2, len(scores) - 1}) * len(content["problem"]["conditions"])
    assert all({"largest impact speed", "RMS impact speed", "stroke from the middle", "power lost in impacts (wear)"} < set(one) for one in borne)


def test_limit_is_that_of_the_free_end_for_any_place_and_any_number_of_cavities() -> None:
    beam = Beam(modes=3)
    conditions = (Condition(1, 10.0), Condition(1, 10.0, detuning=0.05))
    problem = Problem(design_space("impact", ["gap", "position"]), conditions, beam=beam)
    end, near, inside = (problem.space.design({"gap": 1e-3, "position": x}) for x in (1.0, 1 - 1e-9, 0.7))
    both = design_space("several", ["gap_1", "gap_2"]).design({"gap_1": 1e-3, "gap_2": 1e-3})
    own, other = (limit(problem, end, condition) for condition in conditions)
    assert own > other > 1e-3  # a stiffer beam answers less
    assert limit(problem, near, conditions[0]) == pytest.approx(own, rel=1e-6)
    assert limit(problem, both, conditions[0]) == pytest.approx(own, rel=1e-9)  # two halves of the mass, one place, one gap
    assert limit(problem, inside, conditions[0]) > 1.2 * own
    assert math.isnan(limit(problem, design_space("friction").default, conditions[0]))  # no cavity


def test_sobol_indices_find_what_matters() -> None:
    """A tuned absorber's level is smooth; in a box of stiffness alone, damping can explain nothing."""
    space = design_space("tuned", ["stiffness", "damping"], {"damping": (0.899, 0.901)}, {})
    problem = Problem(space, (Condition(1, 1.0, (0.5, 1.6)),), beam=Beam(modes=2), members=1, rate=40.0)
    found = sensitivity(problem, space.design({"stiffness": 620.0, "damping": 0.9}), 16, 1, Threads())
    assert found.names == ("stiffness", "damping")
    assert found.designs == 16 * 4
    assert found.total[0] > 0.8
    assert abs(found.total[1]) < 0.05
    assert (found.low[0], found.high[0]) == pytest.approx((496.0, 744.0))
