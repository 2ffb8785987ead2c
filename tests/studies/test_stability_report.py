"""The stability report judges its results correctly.

Cells, limits, modes and long runs, tasks in processes, and the page are tested.
"""

import math
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from commands import call

from impact_env import Beam, modal_model
from optimisation import checkpoint, executors
from optimisation.files import DOCS, write_json
from studies.cli import stability
from studies.stability import cases, cells, checks, eigen, limits, tasks
from studies.stability import soak as soaks
from studies.study import Measurement, to_file_content


def case(group: str, name: str) -> cases.StabilityCase:
    (match,) = [c for c in cases.cases() if (c.group, c.name) == (group, name)]
    return match


def test_an_exact_cell_agrees_with_the_reference_and_a_wrong_number_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = case("ordinary", "impact and friction")
    cell = cells.measure(own, cases.EXACT)
    assert (cell.verdict, cell.reason) == (cells.GOOD, "")
    assert cell.deviation < 1e-11
    assert cell.impacts > 3
    known = cells._truth(own)
    monkeypatch.setattr(cells, "_truth", lambda _: replace(known, tip=known.tip * (1 + 1e-4)))
    cell = cells.measure(own, cases.EXACT)
    assert cell.verdict == cells.FAILED
    assert "from the reference" in cell.reason


def test_refusals_are_distinguished_from_failures() -> None:
    outside = case("start", "outside the cavity")
    cell = cells.measure(outside, cases.EXACT)
    assert cell.verdict == cells.REFUSED
    assert "absorber_displacement" in cell.reason
    fine = replace(outside, build=case("ordinary", "impact").build)
    assert "no right answer" in cells.measure(fine, cases.EXACT).reason

    def broken() -> Any:
        raise IndexError("17")

    cell = cells.measure(replace(outside, build=broken), cases.EXACT)
    assert (cell.verdict, cell.reason) == (cells.FAILED, "not a clear refusal: IndexError: 17")


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ({}, cells.GOOD),
        *(
            ({name: value}, cells.FAILED)
            for name, value in (("finer", 0.09), ("finer", 1.0), ("identity", 1e-3))
        ),
    ],
)
def test_a_stepping_method_must_converge(values: dict[str, float], verdict: str) -> None:
    cell = cells.Cell(
        "g",
        "c",
        cases.MOREAU,
        cells.FAILED,
        balance=1e-3,
        deviation=0.1,
        finer=0.01,
        identity=1e-14,
    )
    assert cells._judge_steps(replace(cell, **values))[0] == verdict


@pytest.mark.parametrize("ratio", [0.0, 0.01, 1.0, 20.0])
def test_theory_of_one_mode(ratio: float) -> None:
    moreau, runge_kutta = (
        limits.LimitCase(method, "one mode", ratio).scene()
        for method in (limits.MOREAU, limits.RUNGE_KUTTA)
    )
    omega = float(moreau.model.omega[0])
    x = omega * limits.moreau_theory(moreau)
    y = omega * limits.runge_kutta_theory(runge_kutta)
    assert x**2 + 4 * ratio * x == pytest.approx(4)  # where z = -1 solves the scheme's quadratic
    if ratio == 0:
        assert y == pytest.approx(2 * math.sqrt(2), rel=1e-6)
    if ratio >= 1:
        assert y * (ratio + math.sqrt(ratio**2 - 1)) == pytest.approx(2.785293563405282, rel=1e-6)


def test_estimated_limit_is_the_theorys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "STEPS", 5000)
    monkeypatch.setattr(limits, "HALVINGS", 16)
    case = limits.LimitCase(limits.MOREAU, "one mode", 0.3)
    limit = limits.find_limit(case)
    assert limit["agrees"]
    assert limit["found_s"] == pytest.approx(limit["theory_s"], rel=2e-4)
    monkeypatch.setattr(limits, "moreau_theory", lambda _: 1.01 * limit["theory_s"])
    assert not limits.find_limit(case)["agrees"]


def test_one_element_by_hand() -> None:
    """The frequencies of one element agree with a calculation by hand.

    One element: det [[12 - 156 m, -6 + 22 m], [-6 + 22 m, 4 - 4 m]] = 140 m^2 - 408 m + 12, with m
    = omega^2/420.
    """
    square = 420 * (408 - math.sqrt(408**2 - 4 * 140 * 12)) / (2 * 140)
    assert float(eigen.exact_frequency(1, math.sqrt(square) * 1.001)) ** 2 == pytest.approx(
        square, rel=1e-12
    )


@pytest.mark.parametrize("elements", [2, 30])
def test_modes_have_all_digits(elements: int, monkeypatch: pytest.MonkeyPatch) -> None:
    accuracy = eigen.accuracy(elements)
    assert not accuracy["wrong"]
    assert max(accuracy["rounding"].values()) < 1e-14
    assert modal_model(Beam(elements=elements, modes=2)).modes == 2
    monkeypatch.setattr(eigen, "exact_frequency", lambda _, near: near * (1 + 1e-3))
    assert eigen.accuracy(elements)["wrong"]


SOAK = {
    "name": "one, exact",
    "lengths": [10, 100],
    "balance": [1e-13, 1e-13],
    "memory_mb": [100.0, 101.0],
    "us_per_period": [5.0, 5.0],
    "impacts_per_period": [2.0, 2.0],
    "passed": True,
    "reason": "",
}


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("name", "x", ""),
        ("memory_mb", [100.0, 150.0], "memory"),
        ("balance", [1e-12, 1e-6], "balance"),
        ("impacts_per_period", [0.0, 0.0], "no impacts"),
    ],
)
def test_soaks_are_judged(name: str, value: Any, word: str) -> None:
    reason = soaks.wrong_with(SOAK | {name: value}, exact=True)
    assert bool(reason) is bool(word)
    assert word in reason


def test_searches_are_checked_until_enough_events_were_counted() -> None:
    row = checks.check("random structures, 1e4 gaps", 100, 0)
    assert row["searches"] >= 100
    assert row["passed"] == (row["misses"] == 0) == (row["first"] == "")


def test_tasks_in_processes() -> None:
    order = [
        executors.PoolTask(abs, (-6,), "a", 60.0),
        executors.PoolTask(int, ("four",), "a", 60.0),
        executors.PoolTask(time.sleep, (60,), "a", 0.2),
    ]
    outcomes = {o.task.function: o for o in executors.Pool(1, 30.0).run(order)}
    assert outcomes[abs].value == 6
    assert "four" in outcomes[int].error
    assert "not finished" in outcomes[time.sleep].error


def test_lost_tasks_are_failures() -> None:
    order = [
        executors.PoolTask(tasks.run_cell, ("gap", "0 m", "exact"), "k", 1.0),
        executors.PoolTask(eigen.accuracy, (2,), "k", 1.0),
    ]
    gathered = tasks.gather(
        [executors.PoolOutcome(task, None, "the process died", 1.0) for task in order], order
    )
    assert len(list(tasks.failures(gathered))) == 2
    assert [outcome.task for outcome in tasks.finished(order, gathered)] == order[
        :1
    ]  # the other is asked again


def test_redraw_writes_figure_and_page(tmp_path: Path) -> None:
    bad = tasks.asdict(
        cells.Cell(
            "gap",
            "0 m",
            "exact",
            cells.FAILED,
            "off | by much",
            balance=1e-3,
            deviation=0.5,
            wall_s=0.1,
        )
    )
    good = tasks.asdict(
        cells.Cell(
            "contact stiffness",
            "1e2 x 3EI/l^3",
            "exact",
            cells.GOOD,
            balance=1e-15,
            deviation=1e-13,
            wall_s=0.1,
        )
    )
    limit = {
        "method": "moreau",
        "what": "one mode",
        "damping_ratio": 0.0,
        "omega": 252.0,
        "theory_s": 2 / 252,
        "found_s": 2 / 252,
        "paper_s": 1e-3,
    }
    check = {
        "name": "two modes",
        "searches": 100,
        "misses": 0,
        "worst": 0.0,
        "first": "",
        "passed": True,
    }
    texts = {
        "cells": [bad, good],
        "limits": [limit | {"agrees": True}],
        "eigen": [eigen.accuracy(2)],
        "soaks": [SOAK],
        "checks": [check],
        "lost": [],
    }
    made = Measurement(
        texts, checkpoint.conditions() | {"wall_s": 1.0, "workers": 2, "quick": True}
    )
    (folder := tmp_path / "methods").mkdir()
    shutil.copy(DOCS / "methods.md", tmp_path)
    write_json(folder / "stability.json.gz", to_file_content(made))
    outcome = call(stability, "--redraw", "--out", folder)
    assert outcome.exit_code == 1, outcome.output
    assert "FAILED  gap: 0 m, exact: off | by much" in outcome.output
    text = (tmp_path / "methods.md").read_text()
    assert "off / by much" in text
    assert "1 good, 0 with fewer digits, 0 refused with an error, 1 failed" in text
    assert "| moreau, one mode |" in text
    assert "| two modes |      100 |" in text
    assert (folder / "stability.png").read_bytes().startswith(b"\x89PNG")
