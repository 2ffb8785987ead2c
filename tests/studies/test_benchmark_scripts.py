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

from optimisation.checkpoint import conditions
from optimisation.files import write_json
from studies import probe
from studies.cli import (
    benchmark,
    benchmark_calibration,
    benchmark_energies,
    benchmark_periodic,
    benchmark_sectors,
    cost_of_exact,
    reference_levels,
    specialisation,
)
from studies.study import Measurement, to_file_content


def one_column(values: Any) -> None:
    (case,) = values["cases"]
    assert case["name"] == "3 modes, 1.5 N, e = 1"
    assert case["impacts_per_period"] > 0
    assert len(case["exact_us_each"]) == len(case["moreau_us_each"]) == 3
    assert case["ratio"] == pytest.approx(case["moreau_us"] / case["exact_us"])


def prices(values: Any) -> None:
    for case in values["cases"]:
        assert case["ratio"] == pytest.approx(case["energies_us"] / case["bare_us"])
        assert 0.0 <= case["balance"] < 1e-12  # in so short a run it may be exact
        assert case["stretches_per_period"] < 1  # windows alone


def levels(values: Any) -> None:
    """Check the levels of the linear columns and of the plateau.

    Linear columns are quick to compute and contain no chaos. Another linear column replaces the
    plateau.
    """
    assert len(values["past_plateau_level_m"]) == 2
    for level in values["levels"][:6]:
        low, high = level["level_5_to_95_percent_m"]
        assert 0 < low <= level["level_median_m"] <= high
        assert abs(level["deviation_percent"]) < 2


def parts(values: Any) -> None:
    (case,) = values["cases"]
    assert all(part["ns"] > 0 and part["calls"] > 0 for part in case["parts"])


def bars(values: Any) -> None:
    """Every line is measured, and those of accuracy keep their bars."""
    assert len(values["lines"]) == 19
    accuracy = [line for line in values["lines"] if line["unit"] == ""]
    assert [line["bar"] for line in accuracy] == [1e-10, 3e-10, 1e-9, 1e-6, 1e-4]
    assert all(line["median"] <= line["bar"] for line in accuracy)
    assert len(accuracy[0]["each"]) > 100


def check_lsim_rows(values: Any) -> None:
    """Where all is linear both give one motion."""
    assert values["cases"][0]["difference"] < 1e-9


def sector_rows(values: Any) -> None:
    """Each absorber of a disk hits its walls."""
    assert [(row["sectors"], row["friction"]) for row in values["rows"]] == [(2, False), (2, True)]
    assert all(row["impacts"] > 0.5 * row["sectors"] for row in values["rows"])


def calibration_rows(values: Any) -> None:
    """One sweep, ten modes and three parameters, as the page says."""
    (row,) = values["rows"]
    assert (row["sweeps"], row["modes"], row["parameters"]) == (1, 10, 3)
    assert row["simulated"] == 32 + 16 + 20


LINEAR = tuple(column for column in reference_levels.COLUMNS if column.absorber is None)
PLATEAU = replace(LINEAR[0], resonance=2)
timed = benchmark_periodic.timed  # repeats tell about times alone: two
# block of its page, module, options, constants that are smaller here, what the values must be, and
# which of them the table shows
SMALL: dict[str, tuple[ModuleType, list[object], dict[str, object], Callable[[Any], None], str]] = {
    "benchmark": (
        benchmark,
        ["--quick", "--repeats", 3],
        {"CASES": (replace(benchmark.CASES[0], moreau_periods=20.0),)},
        one_column,
        "cases",
    ),
    "benchmark_loads": (
        benchmark,
        ["--record", "--quick"],
        {"RECORDED": {"no absorber": None}},
        check_lsim_rows,
        "",
    ),
    "benchmark_energies": (
        benchmark_energies,
        ["--quick"],
        {"CASES": benchmark_energies.CASES[-1:]},
        prices,
        "cases",
    ),
    "levels": (
        reference_levels,
        ["--members", 2],
        {"PLATEAU": PLATEAU, "COLUMNS": (*LINEAR, PLATEAU), "PAST": LINEAR[0]},
        levels,
        "levels",
    ),
    "cost": (
        cost_of_exact,
        ["--quick"],
        {"CASES": benchmark.CASES[:1], "CALLS": 200},
        parts,
        "cases",
    ),
    "benchmark_calibration": (
        benchmark_calibration,
        ["--quick"],
        {"QUICK_RUNS": benchmark_calibration.LEAST_RUNS},
        calibration_rows,
        "rows",
    ),
    "benchmark_sectors": (
        benchmark_sectors,
        ["--quick"],
        {"QUICK_SECTORS": (2,), "QUICK_PERIODS": 40},
        sector_rows,
        "rows",
    ),
    "benchmark_periodic": (
        benchmark_periodic,
        ["--quick"],
        {"timed": lambda *arguments: timed(*arguments[:3], 2, *arguments[4:])},
        bars,
        "lines",
    ),
}


# 6 to 14 s of the processor each
NIGHTLY = ("benchmark_calibration", "benchmark_periodic")


@pytest.mark.parametrize(
    "block", [pytest.param(b, marks=pytest.mark.nightly if b in NIGHTLY else ()) for b in SMALL]
)
def test_a_benchmark_writes_what_it_prints(
    block: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    module, options, smaller, check, printed = SMALL[block]
    for name, value in smaller.items():
        monkeypatch.setattr(module, name, value)
    target = tmp_path / "numbers.json"
    page = tmp_path / "page.md"
    page.write_text(f"before\n<!-- {block} -->\nold\n<!-- /{block} -->\nafter\n")
    result = call(module, *options, "--json", target, "--page", page)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text())
    head, _, rest = page.read_text().partition(f"<!-- {block} -->\n")
    text, _, tail = rest.partition(f"\n<!-- /{block} -->\n")
    assert (head, tail) == ("before\n", "after\n")
    table, _, made = text.rpartition("\n\n")
    assert table in result.output
    assert made.startswith("Measured on ")
    assert f"numba {values['conditions']['versions']['numba']}" in made
    assert not printed or table.startswith(module.table(values[printed]))
    check(values)


@pytest.mark.parametrize(
    ("earlier", "numbers", "inside"),
    [
        ("0.60", (0.62, 0.58, 0.70), True),
        ("0.60", (0.62, 0.6049, 0.70), True),  # 0.6049 is 0.60 to the digits given
        ("0.60", (0.62, 0.61, 0.70), False),
        ("0.60", (0.58, 0.50, 0.594), False),
        ("0.44 to 0.57", (0.5, 0.3, 0.9), True),
        ("0.44 to 0.57", (0.6, 0.5, 0.9), False),
    ],
)
def test_agreement_is_to_the_printed_digits(
    earlier: str, numbers: tuple[float, float, float], inside: bool
) -> None:
    median, low, high = numbers
    off = None if " to " in earlier else pytest.approx(100 * (median / float(earlier) - 1))
    assert reference_levels.compared(median, low, high, earlier) == {
        "deviation_percent": off,
        "inside": inside,
    }


# What each scene leaves out: absent parts are pruned from the compiled code, and the page says
# which claims the numbers bear out.


def entry(
    absorber: str, *functions: str, arithmetic: int = 0, record: str = "level"
) -> dict[str, Any]:
    """Return a variant whose compiled code has the given functions.

    Each function has ``arithmetic`` arithmetic operations.
    """
    code = {
        "functions": [{"name": name, "arithmetic": arithmetic} for name in functions],
        "instructions": 7000,
    }
    times = {
        "cold_s": 20.0,
        "cached_s": 0.2,
        "ns_per_period": 9000.0,
        "impacts_per_period": 2.0,
        "memory_mb": 150.0,
        "peak_kb": [100.0, 101.0],
    }
    return {"absorber": absorber, "method": "exact", "record": record} | code | times


FRICTION = "rigid_contact.friction_force"
SAVING = {
    "part": "friction (exact)",
    "without": "impact, exact",
    "switched_off": "other, exact",
    "without_ns": 5e3,
}


@pytest.mark.parametrize(
    ("name", "measured", "broken"),
    [
        ("no absorber, exact", entry("no absorber", "search.search"), "searches no events"),
        ("impact, exact", entry("impact", FRICTION, arithmetic=2), "no friction arithmetic"),
        ("impact, exact", entry("impact") | {"peak_kb": [100.0, 1e4]}, "stores no time series"),
    ],
)
def test_claims_hold_or_are_broken_and_the_page_says_so(
    name: str, measured: dict[str, Any], broken: str, tmp_path: Path
) -> None:
    good = {
        "no absorber, exact": entry("no absorber", "linear.linear_lane"),
        "impact, exact": entry("impact", "search.search", FRICTION),
        "impact and friction, exact": entry("impact and friction", FRICTION, arithmetic=1),
    }
    for code, words, ratio, scenes in (
        (0, "Every part left out saves time.", 1.8, good),
        (
            1,
            "Left out without a saving of 2 % or more: friction (exact).",
            1.0,
            good | {name: measured},
        ),
    ):
        values = {
            "own": scenes,
            "pairs": [SAVING | {"switched_off_ns": ratio * 5e3, "ratio": ratio}],
        }
        made = Measurement(values, conditions() | {"quick": True})
        write_json(tmp_path / "specialisation.json.gz", to_file_content(made))
        result = call(specialisation, "--redraw", "--out", tmp_path)
        assert result.exit_code == code, result.output
        lines = [
            line.split("  ")[1] for line in result.output.splitlines() if line.startswith("BROKEN")
        ]
        assert [line.partition(f"{name}, level: ")[2].rpartition(":")[0] for line in lines] == [
            broken
        ] * code
        assert words in (tmp_path / "specialisation.md").read_text()


@numba.njit
def rub(limit: float | None, x: float) -> float:
    if limit is None:
        return 0.0
    return -limit * x


@numba.njit
def fly(limit: float | None, x: float) -> float:
    return x + rub(limit, x)


@pytest.mark.parametrize(
    ("limit", "operations"), [(None, {"fly": 1, "rub": 0}), (2.0, {"fly": 1, "rub": 2})]
)
def test_what_is_absent_is_not_in_the_compiled_code(
    limit: float | None, operations: dict[str, int]
) -> None:
    fly(limit, 1.0)
    (signature,) = (args for args in fly.signatures if (args[0] == numba.none) == (limit is None))
    kernel = SimpleNamespace(signatures=[signature], overloads=fly.overloads, py_func=fly.py_func)
    assert {
        entry["name"].partition(".")[2]: entry["arithmetic"] for entry in probe.functions(kernel)
    } == operations
    assert probe.instructions(kernel) > 2
