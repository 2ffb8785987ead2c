"""The study of where the design rule holds: a case on another beam, going on, the page, and the fitted factor."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from impact_env import Beam
from impact_env.modes import modal_model
from optimisation.bounds import design_gap, expected_factor, expected_gap, reach
from optimisation.cli import mass_ratios
from optimisation.cli import mass_ratios as mass_table
from optimisation.files import read_json, write_json
from optimisation.gap_check import check_gap, scaled_absorber
from optimisation.page import DOCS
from studies import rule
from studies.cli import design_rule
from studies.rule import STRUCTURES, Row, price_at, row_of, run_case, verdicts


def a_row(reach: float, best: float) -> Row:
    factors = tuple(np.geomspace(0.25, 4, 9).tolist())
    relative = tuple((0.2 * (1 + np.log(np.array(factors) / best) ** 2)).tolist())
    least = int(np.argmin(relative))
    key = f"case {reach}"
    return Row(key, "steel", "damping", reach, 1, reach, 1.0, 0.99, factors, relative, factors[least], relative[4] / relative[least], 1)


def test_light_damping_wants_a_wider_gap_on_the_steel_beam() -> None:
    """A case of the page, run: 0.5 % damping at the second resonance, where the rule's gap lies on the steep side."""
    (case,) = (c for c in rule.cases(quick=True) if c.key == "steel, resonance 2, damping 0.005")
    coarse, fine = run_case(case, 1, 2, None, fine=True)
    row = row_of(case, [coarse, fine])
    assert row.factors == tuple(sorted({*(coarse.gaps / coarse.rule).tolist(), *(fine.gaps / fine.rule).tolist()}))
    assert len(row.factors) in (6, 7)  # two gaps more beside the best, one at an end
    assert fine.level[fine.at_rule] == coarse.level[coarse.at_rule]  # the same members
    assert row.rate == 0.25
    assert row.sweep > 0.98
    assert row.reach == pytest.approx(7.55, rel=0.01)
    assert row.best > 1
    assert row.price > 1.3
    model = modal_model(case.beam)
    assert expected_gap(model, 0.02 * model.beam_mass, 3.0, 2) == pytest.approx(1.2 * design_gap(model, 0.02 * model.beam_mass, 3.0, 2))
    assert reach(model, 0.02 * model.beam_mass, 2) == row.reach
    assert case.beam.length == STRUCTURES["steel"].length


def test_expected_factor_is_one_where_the_rule_is_good() -> None:
    assert [expected_factor(x, 0.01) for x in (0.01, 3.0, 5.9, 6.1, 30.0)] == [0.25, 1.0, 1.0, 1.2, 1.2]
    assert expected_factor(0.9, 0.002) == pytest.approx((0.9 / 2.5) ** 0.6)


def test_light_damping_widens_the_expected_gap() -> None:
    assert expected_factor(5.0, 0.001) == 1.0
    assert expected_factor(7.0, 0.005) == 1.2
    assert expected_factor(20.0, 0.002) == pytest.approx(1.2 * 2.5**0.2)
    assert expected_factor(40.0, 0.0) == expected_factor(40.0, 0.0015) == pytest.approx(1.2 * (10 / 3) ** 0.2)


def test_prices_and_classes() -> None:
    row = a_row(3.0, 1.0)
    assert price_at(row, 1.0) == pytest.approx(1.0)
    assert price_at(row, 2.0) == pytest.approx(1 + np.log(2) ** 2)
    assert price_at(row, 2**0.25 * 1.0) < price_at(row, 2**0.5)
    found = verdicts([row, a_row(0.5, 0.354), a_row(20.0, 1.414), a_row(22.0, 2.0)])
    assert [(v.label, v.cases) for v in found] == [("0 to 1", 1), ("1.5 to 6", 1), ("6 and more", 2)]
    assert found[0].good == 0
    assert found[0].expected == 1
    assert found[2].low < found[2].median < found[2].high
    assert found[2].worst == pytest.approx(price_at(a_row(22.0, 2.0), 1.0))


def test_command_goes_on_and_writes_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    every = [case for case in rule.cases(quick=True) if case.structure == "steel" and case.resonance == 1]
    some = [
        next(c for c in every if c.varied == varied and c.value == value)
        for varied, value in (("damping", 0.02), ("mass ratio", 0.02), ("place", 0.9), ("fresh", 0.02))
    ]
    monkeypatch.setattr(rule, "cases", lambda _quick: some)
    monkeypatch.setattr(rule, "STEPS", 1)
    ran: list[str] = []
    folder = tmp_path / "which_gap"
    shutil.copy(DOCS / "which_gap.md", tmp_path)

    def counted(case: object, *arguments: object, **fine: bool) -> object:
        if len(ran) == 2:
            raise KeyboardInterrupt
        ran.append(case.key)
        return run_case(case, *arguments, **fine)

    with monkeypatch.context() as patch:
        patch.setattr(rule, "run_case", counted)
        broken = CliRunner().invoke(design_rule.main, ["--quick", "--out", str(folder)])
    assert broken.exit_code == 130
    assert len(read_json(folder / "design_rule.json.gz")["rows"]) == 2
    assert (tmp_path / "which_gap.md").read_text().count("Not measured yet.") == 1
    before = read_json(folder / "design_rule.json.gz")
    ran.clear()
    monkeypatch.setattr(rule, "run_case", lambda case, *arguments, **fine: ran.append(case.key) or run_case(case, *arguments, **fine))
    whole = CliRunner().invoke(design_rule.main, ["--quick", "--out", str(folder)])
    assert whole.exit_code == 0, whole.output
    assert ran == [case.key for case in some[2:]]
    rows = read_json(folder / "design_rule.json.gz")["rows"]
    assert rows[:2] == before["rows"]
    page = (tmp_path / "which_gap.md").read_text()
    assert "| steel, resonance 1, damping 0.02, mass 0.05, place 0.8 |" in page
    assert "fresh cases, any" in page
    assert "Measured on" in page
    write_json(folder / "design_rule.json.gz", {})
    assert "an earlier run of this command wrote" in CliRunner().invoke(design_rule.main, ["--quick", "--out", str(folder)]).stderr


# The table of the best gap over the mass: its numbers are those of the runs, and a page is written whole or not at all.


MODEL = modal_model(Beam(modes=2))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mass_table, "FACTORS", np.array([0.5, 1.0, 1.5]))


@pytest.mark.usefixtures("few")
def test_a_line_is_what_the_runs_of_that_mass_show() -> None:
    (found,) = mass_table.checks(MODEL, [0.05], [1], 1, 50.0, 1, None)
    own = check_gap(MODEL, 1.0, 1, scaled_absorber(MODEL, 1.0, 1, 0.05), factors=[0.5, 1.0, 1.5], members=1, percent_per_100_periods=50.0)
    np.testing.assert_array_equal(found.relative, own.relative)
    cells = [cell.strip() for cell in mass_table.text([found]).splitlines()[-1].strip("|").split("|")]
    best = int(np.argmin(found.relative))
    assert cells[0] == "5 %"
    assert float(cells[2]) == pytest.approx(reach(MODEL, 0.05 * MODEL.beam_mass), rel=5e-3)
    assert cells[3].split()[0] == f"{found.gaps[best] / design_gap(MODEL, 0.05 * MODEL.beam_mass, 1.0):.2f}"
    assert ("or" in cells[3]) == (best != 1)
    assert float(cells[4]) == pytest.approx(100 * found.relative[best], abs=0.06)
    assert float(cells[6]) == pytest.approx(found.relative[1] / found.relative[best], abs=0.006)


@pytest.mark.usefixtures("few")
def test_the_page_gets_the_table_between_its_markers(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- masses -->\nold\n<!-- /masses -->\nafter\n")
    line = ["--rate", "100", "--members", "1", "--mass-ratio", "0.02", "--resonances", "1", "1", "--threads", "1"]
    result = CliRunner().invoke(mass_ratios.main, [*line, "--page", str(page)])
    assert result.exit_code == 0, result.output
    text = page.read_text()
    assert text.startswith("before\n<!-- masses -->\n| mass ratio")
    assert text.endswith("<!-- /masses -->\nafter\n")
    assert "old" not in text
    assert text.count("| 2 %") == 1
    assert "kernels" in text  # where it was measured
