"""Python gives what the commands give: text, summary.json, tables and figures of whole answers."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import FAST, SIZES, done, load
from load_cases import file_of_one_mode

import optimisation
from impact_env.checks import ParameterError
from impact_env.loads import Loads, Shock
from impact_env.modes import modal_model
from impact_env.parameters import Beam
from impact_env.plain import load_structure
from impact_env.plain_loads import read_loads
from optimisation.answers.gap import GapAnswer
from optimisation.answers.tuning import TuningAnswer
from optimisation.gap_advice import Limits
from optimisation.report.report import CompleteAnswer
from optimisation.search.find import find
from optimisation.tuned import den_hartog
from optimisation.tuned.under_loads import TunedForLoads

QUICK = {"rate": 40.0, "members": 2}  # the numbers do not matter here


@pytest.fixture(autouse=True)
def quickly_tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tune in closed form, which is as good here."""
    monkeypatch.setattr("optimisation.comparison.minimax", den_hartog)
    for module in ("absorber_rules", "comparison"):
        monkeypatch.setattr(
            f"optimisation.{module}.smallest_amplitude",
            lambda model, mass, resonance, *_range: den_hartog(model, mass, resonance),
        )


def check_files(answer: CompleteAnswer, command: Path, python: Path) -> dict[str, Any]:
    """Check that a result writes the same files as a command.

    Return the content of the command's summary.
    """
    files = {file.relative_to(python) for file in answer.save(python)}
    assert files == {file.relative_to(command) for file in command.iterdir()}
    for file in files:
        if file.suffix in (".csv", ".png") or file.name == "card.json":
            assert (python / file).read_bytes() == (command / file).read_bytes(), file
    content: dict[str, Any] = json.loads((command / "summary.json").read_text())
    assert json.loads((python / "summary.json").read_text()) == answer.to_json()
    return content


def test_advise_gives_what_design_gap_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    line = ("--force", 3.5, "--modes", 2, "--rate", 40, "--members", 2, "--uncertain", "gap", "5%")
    more = ("--contact", "steel", "steel", 0.01, "--limit-level", 1e-3)
    result = done(load("design_gap", monkeypatch), *line, *more, "--out", tmp_path / "command")
    answer = optimisation.advise(
        Beam(modes=2),
        3.5,
        uncertain={"gap": "5%"},
        contact=("steel", "steel", 0.01),
        limit_level=1e-3,
        **QUICK,
    )
    assert result.stdout.startswith(str(answer))
    assert check_files(answer, tmp_path / "command", tmp_path / "python") == answer.to_json()
    assert len(answer.plot().axes) == 1
    assert answer.worst_run() is not None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"uncertain": {"gap": (1e-3, 2e-3)}}, "uncertain gap"),
        ({"contact": ("steel", "cheese", 0.01)}, "cheese"),
        ({"contact": ("steel", "steel", 0.0)}, "radius"),
        ({"tolerances": True}, "limit_level"),
        ({"limit_level": -1.0}, "limit_level"),
    ],
)
def test_advise_refuses_before_it_runs(
    options: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "optimisation.answers.gap.search_gap", lambda *_a, **_b: pytest.fail("it ran")
    )
    with pytest.raises(ParameterError, match=words):
        optimisation.advise(Beam(modes=2), 3.5, **options)


LOAD = (
    '[load]\nkind = "shock"\npulse = "half-sine"\npeak_n = 20.0\npulse_s = 0.0125\nduration_s = '
    "0.5\n"
)


def test_advise_under_loads_gives_what_design_gap_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    structure = tmp_path / "structure.toml"
    load_file = tmp_path / "load.toml"
    structure.write_text(file_of_one_mode(0.02))
    load_file.write_text(LOAD)
    line = ("--structure", structure, "--load", load_file, "--force", 2, "--members", 1)
    result = done(load("design_gap", monkeypatch), *line, "--out", tmp_path / "command")
    model = load_structure(structure)
    loads = read_loads(load_file, model.omega[0])
    answer = optimisation.advise(model, 2.0, loads=loads, members=1)
    assert result.stdout.startswith(str(answer))
    assert check_files(answer, tmp_path / "command", tmp_path / "python") == answer.to_json()
    assert answer.worst_run() is None
    rows = {row.label: row.value for _, rows in answer.report.groups for row in rows}
    best = answer.to_json()["recommended"]
    assert rows["clearance to either wall"] == 1e3 * best["gap_m"]
    assert rows["median of 1 runs"] == best["decay_s"]
    without = optimisation.advise(model, 2.0, loads=loads, members=1, card=False)
    assert without.report.groups == ()
    assert without.to_json() == answer.to_json()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rate": 1.0}, "rate"),
        ({"uncertain": {"gap": "5%"}}, "uncertain"),
        ({"sobol": True}, "sobol"),
        ({"free": ["restitution"]}, "free"),
        ({"limits": Limits(impact_speed=1.0)}, "impact_speed"),
        ({"force": -1.0}, "factor on the loads"),
        ({"loads": "noise"}, "loads"),
    ],
)
def test_advise_refuses_what_does_not_go_with_loads(
    options: dict[str, Any], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("optimisation.gap_advice.search_gaps", lambda *_a: pytest.fail("it ran"))
    shock = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), 250.0)
    with pytest.raises(ParameterError, match=words):
        optimisation.advise(Beam(modes=2), **{"loads": shock} | options)


def test_compare_gives_what_compare_absorbers_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "beam.toml"
    file.write_text(
        "[beam]\nlength_m = 0.9\nbending_stiffness_n_m2 = 40.0\nmass_per_length_kg_m = "
        "0.6\nmodes = 2\n"
    )
    line = ("--structure", file, "--rate", 40, "--forces", 3, "--members", 2, "--resonances", 1, 1)
    command = load("compare_absorbers", monkeypatch)
    result = done(command, *line, "--out", tmp_path / "command")
    answer = optimisation.compare(
        load_structure(file),
        resonances=(1,),
        forces=3,
        members=2,
        percent_per_100_periods=40.0,
    )
    assert result.stdout.startswith(str(answer))
    content = check_files(answer, tmp_path / "command", tmp_path / "python")
    own = answer.to_json()
    assert {name: content[name] for name in own} == own
    assert set(content) - set(own) == {"versions", "threads", "wall_s", "memory_bytes"}
    assert len(answer.plot().axes) == 1


def test_compare_under_loads_gives_what_compare_absorbers_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    few = {"GAPS": np.array([1.0, 3.0]), "LIMITS": np.array([0.3]), "BETWEEN": np.zeros(1)}
    for name, value in few.items():
        monkeypatch.setattr(f"optimisation.comparison.{name}", value)
    monkeypatch.setattr("optimisation.tuned.under_loads.MOST_TRIALS", 5)
    structure = tmp_path / "structure.toml"
    load_file = tmp_path / "load.toml"
    structure.write_text(file_of_one_mode(0.02))
    load_file.write_text(LOAD)
    line = ("--structure", structure, "--load", load_file, "--members", 2, "--forces", 2)
    result = done(load("compare_absorbers", monkeypatch), *line, "--out", tmp_path / "command")
    model = load_structure(structure)
    loads = read_loads(load_file, model.omega[0])
    answer = optimisation.compare(model, loads=loads, forces=2, members=2)
    assert result.stdout.startswith(str(answer))
    assert check_files(answer, tmp_path / "command", tmp_path / "python") == answer.to_json()
    assert len(answer.plot().axes) == 1
    heading, rows = answer.report.groups[1]
    assert heading.endswith("intensity 0.2")
    ratios = [bands[0][0][1] for bands in answer.to_json()["ratio_5_50_95"].values()]
    assert [row.value.split()[0] for row in rows] == [f"{ratio:.3f}" for ratio in ratios]
    assert answer.worst_run() is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"force": 3.5}, "force"),
        ({"resonances": (1,)}, "resonances"),
        ({"forces": 1}, "forces"),
        ({"mass_ratio": 3.0}, "mass_ratio"),
        ({"loads": "noise"}, "loads"),
    ],
)
def test_compare_refuses_what_does_not_go_with_loads(options: dict[str, Any], words: str) -> None:
    shock = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), 250.0)
    with pytest.raises(ParameterError, match=words):
        optimisation.compare(Beam(modes=2), **{"loads": shock} | options)


def test_explain_gives_what_optimise_design_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("optimisation.service.FREQUENCIES", 2)
    command = load("optimise_design", monkeypatch)
    results = []

    def noted(*arguments: Any) -> Any:
        results.append(find(*arguments))
        return results[-1]

    monkeypatch.setattr(command, "find", noted)
    line = (*FAST, "--concept", "tuned", "--at", "1:3.5", "--designs", 6, "--out", tmp_path)
    result = done(command, *line)
    answer = optimisation.explain(results[0], sizes=SIZES)
    assert result.stdout.startswith(str(answer))
    (tmp_path / "tuned" / "study.journal").unlink()
    content = check_files(answer, tmp_path / "tuned", tmp_path / "python")
    own = answer.to_json()
    assert {name: content[name] for name in own} == own
    assert len(answer.plot().axes) == 1


def test_names_of_the_package_are_those_that_it_lists() -> None:
    assert {"advise", "compare", "explain"} <= set(optimisation.__all__)
    assert optimisation.advise.__annotations__["return"] == GapAnswer.__name__
    with pytest.raises(AttributeError, match="nothing"):
        getattr(optimisation, "nothing")  # noqa: B009


def test_tune_gives_what_design_tune_gives(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    name = "optimisation.report.tuning_report"
    monkeypatch.setattr(f"{name}.minimax", lambda model, *case: den_hartog(model, *case[:2]))
    monkeypatch.setattr(f"{name}.minimum_h2", lambda model, *case: den_hartog(model, *case[:2]))
    command = load("design tune", monkeypatch)
    result = done(command, "--modes", 2, "--quick", "--out", tmp_path / "command")
    answer = optimisation.tune(Beam(modes=2))
    assert result.stdout.startswith(str(answer))
    content = check_files(answer, tmp_path / "command", tmp_path / "python")
    assert content == answer.to_json()
    assert (tmp_path / "command" / "card.html").read_text(encoding="utf-8") == answer.to_html()
    assert "| Den Hartog" in answer.to_markdown()
    row = content["tunings"]["den_hartog"]
    own = den_hartog(modal_model(Beam(modes=2)), 0.02, 1)
    assert (row["stiffness_n_m"], row["damping_n_s_m"]) == (own.stiffness, own.damping)


def test_choose_place_gives_what_design_place_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("optimisation.cli.design_place.QUICK_TRIAL_PLACES", 1)
    line = ("--force", 3.5, "--modes", 2, "--rate", 40, "--quick", "--mass-ratio", 0.02)
    out = tmp_path / "command"
    result = done(load("design place", monkeypatch), *line, "--out", out)
    options = {"mass_ratios": (0.02,), "members": 1, "trial_places": 1}
    answer = optimisation.choose_place(
        Beam(modes=2), {1: 3.5}, percent_per_100_periods=40.0, **options
    )
    assert result.stdout.startswith(str(answer))
    assert check_files(answer, out, tmp_path / "python") == answer.to_json()
    assert answer.worst_run() is not None


def test_an_answer_without_card_or_figure_says_so() -> None:
    model = modal_model(Beam(modes=2))
    loads = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), model.omega[0])
    absorber = den_hartog(model, 0.02)
    ratios = np.array([[0.5, 0.6], [0.7, 0.8]])
    answer = TuningAnswer(TunedForLoads(loads, "decay", absorber, absorber, ratios))
    with pytest.raises(ParameterError, match="no card"):
        answer.to_html()
    with pytest.raises(ParameterError, match="no figure"):
        answer.plot()
    assert "best for it: 55 (50 to 60)" in str(answer)
    assert answer.to_json()["best"]["ratio"] == 0.55
