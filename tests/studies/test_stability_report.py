import math
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from impact_env import Beam, modal_model
from optimisation import machine, workers
from optimisation.files import write_json
from optimisation.page import DOCS
from studies import study as pattern
from studies.cli import stability
from studies.stability import cases, cells, checks, eigen, limits, study, tasks
from studies.stability import soak as soaks


def case(group: str, name: str) -> cases.Case:
    (found,) = [c for c in cases.cases() if (c.group, c.name) == (group, name)]
    return found


# --- reference and cells -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["impact", "impact and friction"])
def test_exact_cells_agree_with_the_reference(name: str) -> None:
    cell = cells.measure(case("ordinary", name), cases.EXACT)
    assert (cell.verdict, cell.reason) == (cells.GOOD, "")
    assert cell.deviation is not None
    assert cell.deviation < 1e-11
    assert cell.impacts is not None
    assert cell.impacts > 3


def test_a_wrong_number_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    known = cells._truth(case("ordinary", "impact"))
    monkeypatch.setattr(cells, "_truth", lambda _: replace(known, tip=known.tip * (1 + 1e-4)))
    cell = cells.measure(case("ordinary", "impact"), cases.EXACT)
    assert cell.verdict == cells.FAILED
    assert "from the reference" in cell.reason


def test_refusals_are_told_from_failures() -> None:
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


def test_a_stepping_method_must_converge() -> None:
    cell = cells.Cell("g", "c", cases.MOREAU, cells.FAILED, balance=1e-3, deviation=0.1, finer=0.01, identity=1e-14)
    assert cells._judge_steps(cell)[0] == cells.GOOD
    assert cells._judge_steps(replace(cell, finer=0.09))[0] == cells.FAILED
    assert cells._judge_steps(replace(cell, deviation=10.0, finer=1.0))[0] == cells.FAILED
    assert cells._judge_steps(replace(cell, identity=1e-3))[0] == cells.FAILED


# --- step limits -------------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.0, 0.01, 1.0, 20.0])
def test_theory_of_one_mode(ratio: float) -> None:
    moreau, runge_kutta = (limits.LimitCase(method, "one mode", ratio) for method in (limits.MOREAU, limits.RUNGE_KUTTA))
    omega = float(moreau.scene().model.omega[0])
    x = omega * limits.moreau_theory(moreau.scene())
    assert x**2 + 4 * ratio * x == pytest.approx(4)  # where z = -1 solves the scheme's quadratic
    y = omega * limits.runge_kutta_theory(runge_kutta.scene())
    if ratio == 0:
        assert y == pytest.approx(2 * math.sqrt(2), rel=1e-6)
    if ratio >= 1:
        assert y * (ratio + math.sqrt(ratio**2 - 1)) == pytest.approx(2.785293563405282, rel=1e-6)


def test_found_limit_is_the_theorys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "STEPS", 5000)
    monkeypatch.setattr(limits, "HALVINGS", 16)
    found = limits.find_limit(limits.LimitCase(limits.MOREAU, "one mode", 0.3))
    assert found.agrees
    assert found.found_s == pytest.approx(found.theory_s, rel=2e-4)
    assert not replace(found, found_s=1.01 * found.theory_s).agrees


# --- eigenproblem ------------------------------------------------------------------------------------------------------------------------------


def test_one_element_by_hand() -> None:
    """One element: det [[12 - 156 m, -6 + 22 m], [-6 + 22 m, 4 - 4 m]] = 140 m^2 - 408 m + 12, with m = omega^2/420."""
    square = 420 * (408 - math.sqrt(408**2 - 4 * 140 * 12)) / (2 * 140)
    assert float(eigen.exact_frequency(1, math.sqrt(square) * 1.001)) ** 2 == pytest.approx(square, rel=1e-12)


@pytest.mark.parametrize("elements", [2, 30])
def test_modes_have_all_digits(elements: int) -> None:
    found = eigen.accuracy(elements)
    assert not found.wrong
    assert max(found.rounding.values()) < 1e-14
    assert modal_model(Beam(elements=elements, modes=2)).modes == 2
    assert replace(found, rounding={1: 1e-3}).wrong


# --- very long runs ----------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({}, ""),
        ({"memory_mb": [100.0, 150.0]}, "memory"),
        ({"balance": [1e-12, 1e-6]}, "balance"),
        ({"impacts_per_period": [0.0, 0.0]}, "no impacts"),
    ],
)
def test_soaks_are_judged(values: dict[str, list[float]], word: str) -> None:
    good = soaks.Soak("x", [10, 1000], [1e-13, 1e-13], [100.0, 101.0], [5.0, 5.0], [2.0, 2.0])
    passed, reason = soaks._judge(replace(good, **values), exact=True)
    assert passed is (word == "")
    assert word in reason


# --- searches ----------------------------------------------------------------------------------------------------------------------------------


def test_searches_are_checked_until_there_are_enough() -> None:
    found = checks.check(next(iter(checks.CASES)), 100, 0)
    assert found.searches >= 100
    assert found.passed == (found.misses == 0) == (found.first == "")


# --- processes ---------------------------------------------------------------------------------------------------------------------------------


def double(x: int) -> int:
    return 2 * x


def stumble(x: int) -> int:
    raise ValueError(f"no {x}")


def test_tasks_in_processes() -> None:
    order = [workers.Task(double, (3,), "a", 60.0), workers.Task(stumble, (4,), "a", 60.0), workers.Task(time.sleep, (60,), "a", 0.2)]
    outcomes = {o.task.function: o for o in workers.Pool(1, 30.0).run(order)}
    assert outcomes[double].value == 6
    assert "no 4" in outcomes[stumble].error
    assert "not finished" in outcomes[time.sleep].error


# --- the report --------------------------------------------------------------------------------------------------------------------------------


def results() -> pattern.Measured:
    bad = tasks.asdict(cells.Cell("gap", "0 m", "exact", cells.FAILED, "off | by much", balance=1e-3, deviation=0.5, wall_s=0.1))
    good = tasks.asdict(cells.Cell("contact stiffness", "1e2 x 3EI/l^3", "exact", cells.GOOD, balance=1e-15, deviation=1e-13, wall_s=0.1))
    limit = {"method": "moreau", "what": "one mode", "damping_ratio": 0.0, "omega": 252.0, "theory_s": 2 / 252, "found_s": 2 / 252, "paper_s": 1e-3}
    entry = {"elements": 2, "rounding": {"1": 1e-16}, "discretisation": {"1": 1e-3}, "highest": None, "tip": 1e-3, "error": "", "wrong": False}
    soak = tasks.asdict(soaks.Soak("one, exact", [10, 100], [1e-13, 1e-13], [100.0, 101.0], [5.0, 5.0], [2.0, 2.0], True))
    check = tasks.asdict(checks.Checked("two modes", 100, 0)) | {"passed": True}
    found = tasks.Results([bad, good], [limit | {"agrees": True}], [entry], [soak], [check])
    return pattern.Measured(vars(found), machine.conditions() | {"wall_s": 1.0, "workers": 2, "quick": True})


def save(folder: Path, measured: pattern.Measured) -> None:
    write_json(folder / "stability.json.gz", study.STUDY.pack("stability", measured))


def test_redraw_writes_figure_and_page(tmp_path: Path) -> None:
    folder = tmp_path / "methods"
    folder.mkdir()
    shutil.copy(DOCS / "methods.md", tmp_path)
    save(folder, results())
    outcome = CliRunner().invoke(stability.main, ["--redraw", "--out", str(folder)])
    assert outcome.exit_code == 1, outcome.output
    assert "FAILED  gap: 0 m, exact: off | by much" in outcome.output
    text = (tmp_path / "methods.md").read_text()
    assert "off / by much" in text
    assert "1 good, 0 with fewer digits, 0 refused with an error, 1 failed" in text
    assert "| moreau, one mode |" in text
    assert "| two modes |      100 |" in text
    assert (folder / "stability.png").read_bytes().startswith(b"\x89PNG")


def test_lost_tasks_are_failures() -> None:
    order = [workers.Task(tasks.run_cell, ("gap", "0 m", "exact"), "k", 1.0), workers.Task(tasks.run_eigen, (2,), "k", 1.0)]
    lost = [workers.Outcome(task, None, "the process died", 1.0) for task in order]
    gathered = tasks.gather(lost, order)
    assert len(list(gathered.failures())) == 2
    assert [outcome.task for outcome in tasks.finished(order, vars(gathered))] == order[:1]  # the other is asked again
