from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from commands import call

from optimisation.report.markdown import markdown
from studies.cli import benchmark, benchmark_energies, cost_of_exact, reference_levels


def assert_block(page: Path, name: str, table: str, kernels: str) -> None:
    """What a page holds between its markers: the table, what it is, and the sources that it was measured with; and nothing else is changed."""
    head, _, rest = page.read_text().partition(f"<!-- {name} -->\n")
    block, _, tail = rest.partition(f"\n<!-- /{name} -->\n")
    assert (head, tail) == ("before\n", "after\n")
    assert block.startswith(f"{table}\n\n")
    assert "old" not in block
    last = block.splitlines()[-1]
    assert last.startswith("Measured on ")
    assert f"kernels {kernels}." in last


def test_table_is_aligned_markdown() -> None:
    lines = markdown(("a", "bb"), [("long name", "1"), ("b", "22.5")]).splitlines()
    assert lines == ["| a         |   bb |", "| --------- | ---: |", "| long name |    1 |", "| b         | 22.5 |"]


# --- benchmark ---------------------------------------------------------------------------------------------------------------------------------


def test_quick_benchmark_writes_what_it_prints(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    few = replace(benchmark.CASES[0], moreau_periods=20.0)
    monkeypatch.setattr(benchmark, "CASES", (few,))
    target, page = tmp_path / "benchmark.json", tmp_path / "page.md"
    page.write_text("before\n<!-- benchmark -->\nold\n<!-- /benchmark -->\nafter\n")
    result = call(benchmark.main, "--quick", "--repeats", 3, "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    assert set(values) == {"machine", "repeats", "cases"}
    (case,) = values["cases"]
    assert case["name"] == few.name == "3 modes, 1.5 N, e = 1"
    assert case["pseudo_periods"] == benchmark.QUICK
    assert case["moreau_pseudo_periods"] == 20
    assert case["impacts_per_period"] > 0
    assert len(case["exact_us_each"]) == len(case["moreau_us_each"]) == 3
    assert case["ratio"] == pytest.approx(case["moreau_us"] / case["exact_us"])
    assert case["reference_ratio"] == pytest.approx(7 / case["exact_us"])
    assert few.name in result.output
    assert_block(page, "benchmark", benchmark.table(values["cases"]), values["machine"]["versions"]["kernels"])
    assert "given, not measured here" in result.output


def test_a_line_has_the_times_of_a_pseudo_period_and_their_ratios() -> None:
    counts = {"impacts_per_period": 2.0, "events_per_period": 3.0, "evaluations_per_period": 20.0}
    times = {"exact_us": 5.0, "moreau_us": 150.0, "ratio": 30.0, "reference_ratio": 34.0}
    row = benchmark.table([{"name": benchmark.CASES[1].name, "case": {"reference_us": 170.0}, **counts, **times}]).splitlines()[-1]
    assert [cell.strip() for cell in row.strip("|").split("|")] == ["10 modes, 5 N, e = 1", "5", "2.00", "3.0", "20", "150", "30.0", "170", "34.0"]


# --- price of an energy account ------------------------------------------------------------------------------------------------------------------


def test_quick_price_of_energies_writes_what_it_prints(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    few = (benchmark_energies.CASES[0], benchmark_energies.CASES[-1])
    monkeypatch.setattr(benchmark_energies, "CASES", few)
    target, page = tmp_path / "energies.json", tmp_path / "page.md"
    page.write_text("before\n<!-- benchmark_energies -->\nold\n<!-- /benchmark_energies -->\nafter\n")
    result = call(benchmark_energies.main, "--quick", "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    assert [case["name"] for case in values["cases"]] == [case.name for case in few]
    for case in values["cases"]:
        assert len(case["bare_us_each"]) == len(case["energies_us_each"]) == benchmark_energies.QUICK_REPEATS
        assert case["ratio"] == pytest.approx(case["energies_us"] / case["bare_us"])
        assert 0.0 < case["balance"] < 1e-12
        assert case["name"] in result.output
    events, windows = (case["stretches_per_period"] for case in values["cases"])
    assert events > 1 > windows
    assert_block(page, "benchmark_energies", benchmark_energies.table(values["cases"]), values["machine"]["versions"]["kernels"])


# --- reference levels --------------------------------------------------------------------------------------------------------------------------


def compared(earlier: str, median: float, low: float, high: float) -> reference_levels.Compared:
    return reference_levels.Compared(reference_levels.COLUMNS[0], 1.5, median, (low, high), earlier)


@pytest.mark.parametrize(
    ("earlier", "numbers", "inside"),
    [
        ("0.60", (0.62, 0.58, 0.70), True),
        ("0.60", (0.62, 0.6049, 0.70), True),  # 0.6049 is 0.60 to the digits given
        ("0.60", (0.62, 0.61, 0.70), False),
        ("0.60", (0.58, 0.50, 0.594), False),
        ("16.7", (16.8, 16.74, 16.9), True),
        ("0.44 to 0.57", (0.5, 0.3, 0.9), True),
        ("0.44 to 0.57", (0.6, 0.5, 0.9), False),
    ],
)
def test_agreement_is_to_the_digits_given(earlier: str, numbers: tuple[float, float, float], inside: bool) -> None:
    assert compared(earlier, *numbers).inside is inside


def test_deviation_is_relative_to_a_number_and_absent_for_a_span() -> None:
    assert compared("0.50", 0.6, 0.5, 0.7).deviation == pytest.approx(20)
    assert compared("0.44 to 0.57", 0.6, 0.5, 0.7).deviation is None


def test_levels_without_absorber_agree(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The linear columns are quick to compute, and chaos has no part in them; the plateau is stood in for by another linear one."""
    linear = tuple(column for column in reference_levels.COLUMNS if column.absorber is None)
    plateau = replace(linear[0], resonance=2)
    monkeypatch.setattr(reference_levels, "PLATEAU", plateau)
    monkeypatch.setattr(reference_levels, "COLUMNS", (*linear, plateau))
    monkeypatch.setattr(reference_levels, "PAST", linear[0])
    target, page = tmp_path / "levels.json", tmp_path / "page.md"
    page.write_text("before\n<!-- levels -->\nold\n<!-- /levels -->\nafter\n")
    result = call(reference_levels.main, "--members", 2, "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    assert set(values) == {"members", "seed", "levels", "past_plateau_level_m", "machine"}
    assert len(values["levels"]) == sum(len(column.forces) for column in (*linear, plateau))
    assert len(values["past_plateau_level_m"]) == 2
    for level in values["levels"][:6]:
        assert level["scene"] == "no absorber"
        low, high = level["level_5_to_95_percent_m"]
        assert 0 < low <= level["level_median_m"] <= high
        assert abs(level["deviation_percent"]) < 2
    assert "members lie above the plateau's" in result.output
    assert_block(page, "levels", reference_levels.table(values["levels"]), values["machine"]["versions"]["kernels"])


# --- cost of the exact method -----------------------------------------------------------------------------------------------------------------


def test_cost_names_its_parts_and_what_is_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cost_of_exact, "CASES", benchmark.CASES[:1])
    monkeypatch.setattr(cost_of_exact, "CALLS", 200)
    target, page = tmp_path / "cost.json", tmp_path / "page.md"
    page.write_text("before\n<!-- cost -->\nold\n<!-- /cost -->\nafter\n")
    result = call(cost_of_exact.main, "--quick", "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    assert_block(page, "cost", cost_of_exact.table(values["cases"]), values["machine"]["versions"]["kernels"])
    (case,) = values["cases"]
    assert case["slots"] == 4
    assert all(part["ns"] > 0 and part["calls"] > 0 for part in case["parts"])
    assert "all else" in result.output
    assert "least" in result.output
