"""scripts/benchmark_periodic.py: its accuracy lines keep their bars on any machine; times are looked at by a person."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from places import ROOT

from studies.cli import benchmark_periodic


def test_every_line_is_measured_and_the_accuracy_lines_keep_their_bars(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    timed = benchmark_periodic.timed
    monkeypatch.setattr(
        benchmark_periodic, "timed", lambda what, bar, unit, _, *work: timed(what, bar, unit, 2, *work)
    )  # repeats tell about times alone
    target = tmp_path / "periodic.json"
    result = CliRunner().invoke(benchmark_periodic.main, ["--quick", "--json", str(target)])
    assert result.exit_code == 0, result.output
    lines = json.loads(target.read_text(encoding="utf-8"))["lines"]
    assert len(lines) == 19
    assert [line["bar"] for line in lines if line["what"].startswith("harmonic balance, 20 harmonics, 250")] == [5.0]
    assert all(line["what"] in result.output and line["median"] > 0 and len(line["each"]) >= 2 for line in lines)
    accuracy = [line for line in lines if line["unit"] == ""]
    assert [line["bar"] for line in accuracy] == [1e-10, 3e-10, 1e-9, 1e-6, 1e-4]
    assert all(line["median"] <= line["bar"] for line in accuracy)
    assert [line["what"].split(",")[0] for line in lines if line["bar"] is None] == [
        "orbit with complete chatter by shooting",
        "orbit with a stuck phase by shooting",
    ]
    assert len(accuracy[0]["each"]) > 100


def test_the_page_has_a_place_for_the_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    lines = [{"what": "closed form", "bar": 2.0, "median": 1.5, "unit": "us", "each": (1.5,)}]
    monkeypatch.setattr(benchmark_periodic, "measure", lambda _repeats: [benchmark_periodic.Line(**lines[0])])
    page = tmp_path / "frequency_domain.md"
    page.write_text((ROOT / "docs" / "frequency_domain.md").read_text(encoding="utf-8"), encoding="utf-8")
    result = CliRunner().invoke(benchmark_periodic.main, ["--page", str(page)])
    assert result.exit_code == 0, result.output
    begin, end = (page.read_text(encoding="utf-8").index(f"<!-- {mark}benchmark_periodic -->") for mark in ("", "/"))
    assert "| closed form | 1.5 us | 2 us |     yes |" in page.read_text(encoding="utf-8")[begin:end]
