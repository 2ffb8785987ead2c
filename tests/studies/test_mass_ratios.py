"""The table of the best gap over the mass: its numbers are those of the runs, and a page is written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from impact_env import Beam, modal_model
from optimisation.bounds import design_gap, reach
from optimisation.cli import mass_ratios
from optimisation.cli import mass_ratios as mass_table
from optimisation.gap_check import check_gap, scaled_absorber

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
