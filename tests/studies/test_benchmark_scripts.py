"""Benchmarks: what they print, write and put on their pages; times are looked at by a person."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from commands import call
from places import ROOT

from optimisation.report.markdown import markdown
from studies.cli import benchmark, benchmark_energies, benchmark_periodic, benchmark_start, cost_of_exact, reference_levels


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


SET_UP = """
import os, sys, time
from pathlib import Path
assert not {name for name in os.environ if name.startswith(("IMPACT_ENV_", "PYTHONPATH", "NUMBA_"))}, os.environ
assert not list(Path(os.environ["HOME"]).iterdir())
python = Path(__file__).parents[2] / ".venv" / "bin" / "python"
if "env" in sys.argv:
    (python.parent / "env").touch()
elif "kernels" in sys.argv:
    assert python.exists()
    while time.process_time() < 0.5:
        pass
else:
    python.parent.mkdir(parents=True)
    python.write_text(COMMAND)
    python.chmod(0o755)
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a committed checkout with a set-up that installs nothing and a comparison that compares nothing."""
    root = tmp_path / "checkout"
    (root / "scripts" / "lib").mkdir(parents=True)
    command = f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n'
    (root / "scripts" / "lib" / "set_up.py").write_text(SET_UP.replace("COMMAND", repr(command)))
    run = root / "scripts" / "run"
    run.write_text('#!/bin/sh\n[ "$*" = "$1 --quick --out $4" ] && [ "$1" = compare_absorbers ] && mkdir "$4"\n')
    run.chmod(0o755)
    git = ["git", "-C", str(root), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "all"]):
        subprocess.run([*git, *words], check=True)
    monkeypatch.setattr(benchmark_start, "ROOT", root)
    monkeypatch.setattr(benchmark_start, "FIRST_CALL", "import sys; sys.exit(sys.argv[1:] != ['impact', 'exact', 'level and events'])")
    monkeypatch.setenv("IMPACT_ENV_CACHE", "somewhere")
    monkeypatch.setenv("PYTHONPATH", "somewhere")
    return root


@pytest.mark.usefixtures("checkout")
def test_every_step_is_timed_and_the_table_goes_to_the_page(tmp_path: Path) -> None:
    page, target = tmp_path / "page.md", tmp_path / "start.json"
    page.write_text("before\n<!-- start -->\n<!-- /start -->\nafter\n")
    result = CliRunner().invoke(benchmark_start.main, ["--quick", "--json", str(target), "--page", str(page)])
    assert result.exit_code == 0, result.output
    steps = json.loads(target.read_text())["steps"]
    assert [step["what"] for step in steps] == [
        *benchmark_start.STARTED,
        "to the table and the figure",
        "first call: impact, exact, level and events recorded",
    ]
    assert steps[1]["cpu_s"] >= 0.4 > steps[0]["cpu_s"]
    assert steps[3]["wall_s"] == pytest.approx(sum(step["wall_s"] for step in steps[:3]))
    assert [step["wanted_s"] for step in steps] == [None, None, None, 75.0, 15.0]
    text = page.read_text()
    assert all(step["what"] in text for step in steps)
    assert text.startswith("before\n")
    assert text.endswith("after\n")
