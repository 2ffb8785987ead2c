"""Commands at their limits: one message and the right exit code, from fresh processes where that is what counts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

import click
from click.testing import CliRunner
from commands import FAST, call, load

from optimisation.cli.common import end_early, json_option, name_files, plain_errors
from optimisation.extremes import usable_force, usable_mass_ratio, usable_rate
from optimisation.files import write_json


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


def test_quick_and_full_studies_lie_side_by_side(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script, small = (
        load("optimise_design", monkeypatch),
        ["--modes", 2, "--members", 2, "--batch", 4, "--concept", "friction", "--designs", 5, "--no-figures", "--out", tmp_path],
    )
    for look in (["--quick", "--rate", 4], ["--rate", 40], ["--quick", "--rate", 4], ["--rate", 40]):
        result = call(script, *small, *look)
        assert result.exit_code == 0, result.output
    assert {file.name for file in (tmp_path / "friction").glob("*.journal")} == {"study.journal", "quick.journal"}


def test_full_disk_is_one_message_and_exit_code_1() -> None:
    @click.command()
    def command() -> None:
        with plain_errors():
            raise OSError(28, "No space left on device", "results/study.journal")

    result = CliRunner().invoke(command)
    assert result.exit_code == 1
    assert result.output == "Error: results/study.journal: No space left on device\n"


def test_certificate_that_is_not_optimal_leaves_its_cell_empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    from optimisation.convex import NotOptimalError
    from optimisation.tuned.certificate import certify

    calls: list[object] = []

    def once(*given: object) -> object:
        calls.append(given)
        if len(calls) == 2:
            raise NotOptimalError("largest amplitude: the solver ended with status 'optimal_inaccurate'")
        return certify(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("optimisation.tuned.certificate.certify", once)
    result = call(load("tune_ltva", monkeypatch), "--modes", 2, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "Not proved, paper's values: largest amplitude: the solver ended with status 'optimal_inaccurate'" in result.stderr
    assert sum(line.endswith(",") for line in (tmp_path / "tunings.csv").read_text().splitlines()) == 1


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
