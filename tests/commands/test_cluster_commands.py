"""Commands with --cluster give what they give without: the same numbers from the workers of a scheduler in this process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import SHORT, call, sweep

pytest.importorskip("distributed")
pytest.importorskip("optuna")

import distributed

from optimisation.cli import design_gap, frequency_response, mass_ratios
from optimisation.evaluation import Threads
from optimisation.search.cluster import Workers
from studies import rule
from studies.cli import search_methods


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50) as local:
        yield local.scheduler_address


def test_members_of_a_sweep(address: str, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("here.json", "there.json")]
    for file, where in zip(files, ([], ["--cluster", address]), strict=True):
        result = sweep(*SHORT, "--absorber", "impact", "--force", "20", "--members", "3", "--json", str(file), *where)
        assert result.exit_code == 0, result.output
    here, there = (json.loads(file.read_text()) for file in files)
    assert len(there["response_level_m"]) == 3
    assert {k: x for k, x in here.items() if k != "wall_s"} == {k: x for k, x in there.items() if k != "wall_s"}


def test_gaps_around_the_rule(address: str, tmp_path: Path) -> None:
    line = ["--force", "3.5", "--modes", "2", "--rate", "100", "--gaps", "3", "--members", "2"]
    for name, where in (("here", ["--threads", "1"]), ("there", ["--cluster", address])):
        result = call(design_gap, *line, *where, "--out", str(tmp_path / name))
        assert result.exit_code == 0, result.output
    assert (tmp_path / "here" / "levels.csv").read_text() == (tmp_path / "there" / "levels.csv").read_text()


def test_best_gaps_over_the_mass(address: str) -> None:
    line = ["--mass-ratio", "0.05", "--resonances", "1", "1", "--rate", "100", "--members", "2"]
    here, there = (call(mass_ratios, *line, *where) for where in (["--threads", "1"], ["--cluster", address]))
    assert there.exit_code == 0, there.output
    tables = [[row for row in result.output.splitlines() if row.startswith("|")] for result in (here, there)]
    assert tables[0] == tables[1]
    assert "5 %" in tables[1][2]


def test_stationary_responses_over_the_frequency(address: str, tmp_path: Path) -> None:
    line = ["--modes", "2", "--no-sweeps", "--method", "balance", "--friction-limit", "0.02", "--from", "1.02", "--to", "1.04"]
    runs, files = ["--envelope", "2", "--members", "2", "--settle", "50", "--window", "20"], [tmp_path / name for name in ("a.json", "b.json")]
    for file, where in zip(files, (["--threads", "1"], ["--cluster", address]), strict=True):
        result = call(frequency_response, *line, *runs, *where, "--json", str(file))
        assert result.exit_code == 0, result.output
    here, there = (json.loads(file.read_text()) for file in files)
    assert here == there
    assert [point["omega_ratio"] for point in here["stationary"]] == [1.02, 1.04]
    alone = call(frequency_response, *line, "--cluster", address)
    assert alone.exit_code == 2
    assert "--cluster does not go without --envelope" in alone.output


def test_a_case_of_the_rule_study_and_a_search(address: str) -> None:
    case = next(case for case in rule.cases() if case.varied == rule.DAMPING and case.value == 0.05)
    with Workers(address) as workers:
        here, there = (rule.row_of(case, rule.run_case(case, 1, 1, **where)) for where in ({"threads": 1}, {"threads": None, "executor": workers}))
        assert here == there
        first, second = (search_methods.trial("paper, first", "random", 0, 4, 1, where, 100.0) for where in (Threads(1), workers))
    assert first is not None
    assert first == second
