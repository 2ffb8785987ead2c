"""scripts/regimes.py: files, page, going on where it was stopped, and bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from commands import call
from places import ROOT

from impact_env.periodic import residence
from studies.cli import regimes
from studies.regimes import measured
from studies.regimes.cases import PAPER, cases
from studies.regimes.study import JUMP, KINDS
from studies.regimes.tables import hazard_of, kind_table, of_case

OWN = ["--modes", "2", "--friction-limit", "0.025", "--force", "1.5", "--quick", "--members", "6", "--points", "3", "--from", "0.98", "--to", "0.96"]


def rows(folder: Path, part: str) -> list[dict[str, Any]]:
    return json.loads((folder / f"{part}.json").read_text())["rows"]


def test_own_scene(tmp_path: Path) -> None:
    result = call(regimes, *OWN, "--slowness", 50, "--approach", 1.0, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    found = rows(tmp_path, JUMP)
    assert [row["at"] for row in found if row["what"] == measured.STAY] == [0.98, 0.97, 0.96]
    assert [row["at"] for row in found if row["what"] == measured.SWEEP] == [50.0]
    assert sum(row["exits"] for row in found if row["what"] == measured.STAY) > 0
    assert all(row["linear"] + row["periodic"] + row["sustained"] + row["strongly modulated"] == 6 for row in rows(tmp_path, KINDS))
    files = {file.name for file in tmp_path.iterdir()}
    assert {"jump.png", "kinds.png", "jump_stay.csv", "jump_sweep.csv", "kinds_response.csv"} <= files
    assert "P(jump) = exp(-N/" in result.output
    before = (tmp_path / "jump_stay.csv").read_text()
    redrawn = call(regimes, *OWN, "--redraw", "--out", tmp_path)
    assert redrawn.exit_code == 0
    assert (tmp_path / "jump_stay.csv").read_text() == before


def test_stopped_run_goes_on_to_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, parted = tmp_path / "whole", tmp_path / "parted"
    options = [*OWN, "--approach", 1.0, "--only", JUMP]
    assert call(regimes, *options, "--threads", 1, "--out", whole).exit_code == 0
    calls = []

    def stopped(*given: Any, **named: Any) -> residence.Stays:
        calls.append(given)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return residence.stays(*given, **named)

    with monkeypatch.context() as patched:
        patched.setattr(measured, "stays", stopped)
        assert call(regimes, *options, "--out", parted).exit_code == 130
    assert len(rows(parted, JUMP)) == 1
    refused = call(regimes, *options, "--silence", 60, "--resume", "--out", parted)
    assert refused.exit_code == 2
    assert "silence" in refused.output
    assert call(regimes, *options, "--threads", 2, "--resume", "--out", parted).exit_code == 0
    assert rows(parted, JUMP) == rows(whole, JUMP)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--modes", 2], "needs --force"),
        (["--force", 1, "--from", 0.9, "--to", 0.9], "--to = 0.9 is not allowed"),
        (["--force", 1, "--points", 1], "points = 1 is not allowed"),
        (["--force", 1, "--restitution", 2], "restitution = 2.0 is not allowed"),
        (["--force", 1, "--slowness", -1], "slowness = -1.0 is not allowed"),
        (["--force", 1, "--silence", 0], "silence = 0.0 is not allowed"),
        (["--silence", 1e9], "stay_periods = 8000.0 is not allowed"),
        (["--force", 1, "--approach", -1], "approach_ratio = -1.0 is not allowed"),
    ],
)
def test_bad_input(options: list[Any], words: str, tmp_path: Path) -> None:
    result = call(regimes, *options, "--out", tmp_path / "no")
    assert result.exit_code == 2
    assert words in result.output
    assert not (tmp_path / "no").exists()


def test_published_numbers_tell_what_the_page_says() -> None:
    folder = ROOT / "docs" / "regimes"
    found = rows(folder, JUMP)
    for case in cases():
        sweeps = of_case(found, measured.SWEEP, case.name)
        assert [row["at"] for row in sorted(sweeps, key=lambda row: row["at"])] == list(case.slownesses)
        assert all(row["runs"] >= 200 for row in sweeps)
    told = hazard_of(of_case(found, measured.STAY, PAPER))
    assert told is not None
    for row in of_case(found, measured.SWEEP, PAPER):
        value, _, _ = told.probability(row["at"])
        assert row["low"] - 0.05 < value < row["high"] + 0.05
    assert "period 1 100 %" in kind_table(of_case(rows(folder, KINDS), measured.RESPONSE, "recommended"))


def test_a_cluster_measures_the_same(tmp_path: Path) -> None:
    """One worker with one thread, in this process: plain data goes to it and comes back, and no number depends on where it was made."""
    distributed = pytest.importorskip("distributed")
    where, here = tmp_path / "there", tmp_path / "here"
    options = (*OWN, "--slowness", 50, "--approach", 1.0)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50) as local:
        done = call(regimes, *options, "--cluster", local.scheduler_address, "--out", where)
        assert done.exit_code == 0, done.output
    assert call(regimes, *options, "--threads", 1, "--out", here).exit_code == 0
    for part in (JUMP, KINDS):
        assert rows(where, part) == rows(here, part)
    refused = call(regimes, *options, "--cluster", "127.0.0.1:1", "--threads", 2, "--out", where)
    assert refused.exit_code == 2
    assert "--threads = 2" in refused.output
