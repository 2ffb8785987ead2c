"""Benchmarks: what they print, write and put on their pages; times are looked at by a person."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import pytest
from commands import call

from optimisation.files import write_json
from optimisation.machine import conditions
from optimisation.report.markdown import markdown
from studies import load_speed, probe
from studies.cli import benchmark, benchmark_energies, benchmark_periodic, cost_of_exact, reference_levels, specialisation
from studies.study import Measured


def assert_block(page: Path, name: str, table: str, kernels: str) -> None:
    """What a page holds between its markers: the table, what it is, and the sources that it was measured with; and nothing else is changed."""
    head, _, rest = page.read_text().partition(f"<!-- {name} -->\n")
    block, _, tail = rest.partition(f"\n<!-- /{name} -->\n")
    assert (head, tail) == ("before\n", "after\n")
    assert block.startswith(f"{table}\n\n")
    assert "old" not in block.splitlines()
    last = block.splitlines()[-1]
    assert last.startswith("Measured on ")
    assert f"kernels {kernels}." in last


def test_table_is_aligned_markdown() -> None:
    lines = markdown(("a", "bb"), [("long name", "1"), ("b", "22.5")]).splitlines()
    assert lines == ["| a         |   bb |", "| --------- | ---: |", "| long name |    1 |", "| b         | 22.5 |"]


def one_column(values: Any) -> None:
    (case,) = values["cases"]
    assert case["name"] == "3 modes, 1.5 N, e = 1"
    assert (case["pseudo_periods"], case["moreau_pseudo_periods"]) == (benchmark.QUICK, 20)
    assert case["impacts_per_period"] > 0
    assert len(case["exact_us_each"]) == len(case["moreau_us_each"]) == 3
    assert case["ratio"] == pytest.approx(case["moreau_us"] / case["exact_us"])
    assert case["reference_ratio"] == pytest.approx(7 / case["exact_us"])


def prices(values: Any) -> None:
    for case in values["cases"]:
        assert len(case["bare_us_each"]) == len(case["energies_us_each"]) == benchmark_energies.QUICK_REPEATS
        assert case["ratio"] == pytest.approx(case["energies_us"] / case["bare_us"])
        assert 0.0 <= case["balance"] < 1e-12  # in so short a run it may be exact
        assert case["stretches_per_period"] < 1  # windows alone


def levels(values: Any) -> None:
    """The linear columns are quick to compute, and chaos has no part in them; the plateau is stood in for by another linear one."""
    assert len(values["levels"]) == sum(len(column.forces) for column in (*LINEAR, PLATEAU))
    assert len(values["past_plateau_level_m"]) == 2
    for level in values["levels"][:6]:
        low, high = level["level_5_to_95_percent_m"]
        assert 0 < low <= level["level_median_m"] <= high
        assert abs(level["deviation_percent"]) < 2


def parts(values: Any) -> None:
    (case,) = values["cases"]
    assert case["slots"] == 4
    assert all(part["ns"] > 0 and part["calls"] > 0 for part in case["parts"])


def bars(values: Any) -> None:
    """Every line is measured, and those of accuracy keep their bars."""
    lines = values["lines"]
    assert len(lines) == 19
    assert [line["bar"] for line in lines if line["what"].startswith("harmonic balance, 20 harmonics, 250")] == [5.0]
    assert all(line["median"] > 0 and len(line["each"]) >= 2 for line in lines)
    accuracy = [line for line in lines if line["unit"] == ""]
    assert [line["bar"] for line in accuracy] == [1e-10, 3e-10, 1e-9, 1e-6, 1e-4]
    assert all(line["median"] <= line["bar"] for line in accuracy)
    assert len(accuracy[0]["each"]) > 100


LINEAR = tuple(column for column in reference_levels.COLUMNS if column.absorber is None)
PLATEAU = replace(LINEAR[0], resonance=2)
timed = benchmark_periodic.timed  # repeats tell about times alone: two
# module: block of its page, the values of its JSON file that the table shows, options, what is smaller here, and what the file must hold
SMALL: dict[ModuleType, tuple[str, str, list[object], dict[str, object], Callable[[Any], None]]] = {
    benchmark: ("benchmark", "cases", ["--quick", "--repeats", 3], {"CASES": (replace(benchmark.CASES[0], moreau_periods=20.0),)}, one_column),
    benchmark_energies: (
        "benchmark_energies", "cases", ["--quick"], {"CASES": benchmark_energies.CASES[-1:]}, prices
    ),
    reference_levels: (
        "levels", "levels", ["--members", 2], {"PLATEAU": PLATEAU, "COLUMNS": (*LINEAR, PLATEAU), "PAST": LINEAR[0]}, levels
    ),
    cost_of_exact: ("cost", "cases", ["--quick"], {"CASES": benchmark.CASES[:1], "CALLS": 200}, parts),
    benchmark_periodic: (
        "benchmark_periodic", "lines", ["--quick"], {"timed": lambda what, bar, unit, _, *work: timed(what, bar, unit, 2, *work)}, bars
    ),
}  # fmt: skip


@pytest.mark.parametrize("module", [pytest.param(m, marks=pytest.mark.nightly if m is benchmark_energies else (), id=m.__name__) for m in SMALL])
def test_a_benchmark_writes_what_it_prints(module: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    block, shown, options, smaller, check = SMALL[module]
    for name, value in smaller.items():
        monkeypatch.setattr(module, name, value)
    target, page = tmp_path / "numbers.json", tmp_path / "page.md"
    page.write_text(f"before\n<!-- {block} -->\nold\n<!-- /{block} -->\nafter\n")
    result = call(module, *options, "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    table = module.table(values[shown])
    assert table in result.output
    assert_block(page, block, table, values["machine"]["versions"]["kernels"])
    check(values)


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
    median, low, high = numbers
    found = reference_levels.Compared(reference_levels.COLUMNS[0], 1.5, median, (low, high), earlier)
    assert found.inside is inside
    assert found.deviation == (None if " to " in earlier else pytest.approx(100 * (median / float(earlier) - 1)))


def test_a_record_beside_lsim(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where all is linear both give one motion; the table says so."""
    monkeypatch.setattr(load_speed, "CASES", {"no absorber": None})
    page = tmp_path / "page.md"
    page.write_text("<!-- benchmark_loads -->\n<!-- /benchmark_loads -->\n")
    result = call(benchmark.main, "--record", "--quick", "--json", tmp_path / "numbers.json", "--page", page)
    assert result.exit_code == 0, result.output
    (case,) = json.loads((tmp_path / "numbers.json").read_text())["cases"]
    assert case["difference"] < 1e-9
    assert f"{case['lsim_us']:.3g}" in page.read_text()


# What each scene leaves out: absent parts are pruned from the compiled code, and the page says which claims the numbers bear out.


def entry(absorber: str, *functions: tuple[str, int], record: str = "level", growth: float = 1.0) -> dict[str, Any]:
    """Return a variant whose compiled code has these functions and as many arithmetic operations in each."""
    code = {"functions": [{"name": name, "arithmetic": arithmetic} for name, arithmetic in functions], "instructions": 7000}
    times = {"cold_s": 20.0, "cached_s": 0.2, "ns_per_period": 9000.0, "impacts_per_period": 2.0}
    memory = {"memory_mb": 150.0, "peak_kb": [100.0, 100.0 + growth]}
    return {"absorber": absorber, "method": "exact", "record": record} | code | times | memory


def measured(ratio: float = 1.8, **others: Any) -> specialisation.Results:
    good = {
        "no absorber, exact": entry("no absorber", ("linear.linear_lane", 3)),
        "impact, exact": entry("impact", ("search.search", 3), ("rigid_contact.friction_force", 0)),
        "impact and friction, exact": entry("impact and friction", ("rigid_contact.friction_force", 1)),
        "impact, exact, level and samples recorded": entry("impact", ("rigid_contact.turn", 0), record="level and samples", growth=1e4),
    }
    names = {"part": "friction (exact)", "without": "impact, exact", "switched_off": "other, exact"}
    return specialisation.Results(good | others, [names | {"without_ns": 5e3, "switched_off_ns": ratio * 5e3, "ratio": ratio}])


@pytest.mark.parametrize(
    ("name", "found", "broken"),
    [
        ("no absorber, exact", entry("no absorber", ("search.search", 3)), "no absorber, exact, level: searches no events"),
        ("impact, exact", entry("impact", ("rigid_contact.friction_force", 2)), "impact, exact, level: no friction arithmetic"),
        ("impact, exact", entry("impact", growth=1e4), "impact, exact, level: stores no time series"),
    ],
)
def test_claims_hold_or_are_broken_and_the_page_says_so(name: str, found: dict[str, Any], broken: str, tmp_path: Path) -> None:
    def redrawn(values: specialisation.Results) -> Any:
        write_json(
            tmp_path / "specialisation.json.gz", specialisation.STUDY.pack("specialisation", Measured(vars(values), conditions() | {"quick": True}))
        )
        return call(specialisation, "--redraw", "--out", tmp_path)

    assert redrawn(measured()).exit_code == 0
    page = (tmp_path / "specialisation.md").read_text()
    assert "Every part left out saves time." in page
    assert "| friction (exact) |" in page
    again = redrawn(measured(1.0, **{name: found}))
    assert again.exit_code == 1
    assert [line.split("  ")[1].rpartition(":")[0] for line in again.output.splitlines() if line.startswith("BROKEN")] == [broken]
    assert "Left out without a saving of 2 % or more: friction (exact)." in (tmp_path / "specialisation.md").read_text()


@numba.njit
def rub(limit: float | None, x: float) -> float:
    if limit is None:
        return 0.0
    return -limit * x


@numba.njit
def fly(limit: float | None, x: float) -> float:
    return x + rub(limit, x)


@pytest.mark.parametrize(("limit", "operations"), [(None, {"fly": 1, "rub": 0}), (2.0, {"fly": 1, "rub": 2})])
def test_what_is_absent_is_not_in_the_compiled_code(limit: float | None, operations: dict[str, int]) -> None:
    fly(limit, 1.0)
    (signature,) = (args for args in fly.signatures if (args[0] == numba.none) == (limit is None))
    kernel = SimpleNamespace(signatures=[signature], overloads=fly.overloads, py_func=fly.py_func)
    found = probe.functions(kernel)
    assert {entry["name"].partition(".")[2]: entry["arithmetic"] for entry in found} == operations
    assert probe.instructions(kernel) > 2
