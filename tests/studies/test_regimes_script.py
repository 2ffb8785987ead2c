"""scripts/regimes.py: files, page, and a cluster."""

from pathlib import Path
from typing import Any

import pytest
from commands import call
from places import ROOT

from optimisation.files import read_json
from studies.cli import regimes
from studies.cli.regimes import JUMP, KINDS, hazard_of, kind_table, of_case
from studies.regimes import measured
from studies.regimes.measured import PAPER, cases

OWN = [
    "--modes",
    "2",
    "--friction-limit",
    "0.025",
    "--force",
    "1.5",
    "--quick",
    "--members",
    "6",
    "--points",
    "3",
    "--from",
    "0.98",
    "--to",
    "0.96",
]


def rows(folder: Path, part: str) -> list[dict[str, Any]]:
    return read_json(folder / f"{part}.json.gz")["rows"]


def test_own_scene(tmp_path: Path) -> None:
    result = call(regimes, *OWN, "--slowness", 50, "--approach", 1.0, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    table = rows(tmp_path, JUMP)
    assert [row["at"] for row in table if row["what"] == measured.STAY] == [0.98, 0.97, 0.96]
    assert [row["at"] for row in table if row["what"] == measured.SWEEP] == [50.0]
    for row in table:  # how many of six leave, if any, is chance and rounding
        if row["what"] == measured.STAY:
            assert 0 <= row["exits"] <= row["runs"] - row["absent"] <= 6
            assert row["rate"] == pytest.approx(row["exits"] / row["exposure"])
    assert all(
        row["linear"] + row["periodic"] + row["sustained"] + row["strongly modulated"] == 6
        for row in rows(tmp_path, KINDS)
    )
    files = {file.name for file in tmp_path.iterdir()}
    assert {
        "jump.png",
        "kinds.png",
        "jump_stay.csv",
        "jump_sweep.csv",
        "kinds_response.csv",
    } <= files
    assert "Integral of the rate from 0.98 to 0.96" in result.output
    before = (tmp_path / "jump_stay.csv").read_text()
    redrawn = call(regimes, *OWN, "--redraw", "--out", tmp_path)
    assert redrawn.exit_code == 0
    assert (tmp_path / "jump_stay.csv").read_text() == before


def test_published_numbers_tell_what_the_page_says() -> None:
    folder = ROOT / "docs" / "regimes"
    table = rows(folder, JUMP)
    for case in cases():
        sweeps = of_case(table, measured.SWEEP, case.name)
        assert [row["at"] for row in sorted(sweeps, key=lambda row: row["at"])] == list(
            case.slownesses
        )
        assert all(row["runs"] >= 200 for row in sweeps)
    predicted = hazard_of(of_case(table, measured.STAY, PAPER))
    for row in of_case(table, measured.SWEEP, PAPER):
        value, _, _ = predicted.probability(row["at"])
        assert row["low"] - 0.05 < value < row["high"] + 0.05
    assert "period 1 100 %" in kind_table(
        of_case(rows(folder, KINDS), measured.RESPONSE, "recommended")
    )
