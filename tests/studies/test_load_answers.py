"""The study of loads: two tones without contact superpose, what is written is what is printed, and pages are told again from the files."""

from pathlib import Path

import numpy as np
import pytest
from commands import call

from impact_env.ensemble import Lane
from impact_env.parameters import impact_absorber
from impact_env.scene import Scene
from optimisation.files import read_json
from studies import load_answers
from studies.cli.load_answers import main
from studies.load_answers import CASES, Settings, both_rows, both_text, levels_in_bands, orders
from studies.load_figures import FIGURES


def test_bands_of_two_orders_superpose() -> None:
    """Without contact each band is what its own order makes, and the higher one is proportional to its force."""
    case = CASES["cantilever"]
    each = [levels_in_bands(Lane(Scene(case.model), orders(case, share))) for share in (0.0, 0.1, 1.0)]
    assert each[1][1] == pytest.approx(0.1 * each[2][1], rel=0.02)
    assert each[0][0] == pytest.approx(each[2][0], rel=1e-3)
    assert each[0][1] < 1e-3 * each[2][1]
    wide = Scene(case.model, impact_absorber(1.0))
    assert levels_in_bands(Lane(wide, orders(case, 1.0))) == pytest.approx(each[2], rel=1e-9)


def test_an_absorber_at_the_node_is_left_alone_by_the_second_mode() -> None:
    for case in CASES.values():
        assert abs(case.at(case.node).tip_shape[1]) < 1e-6 * abs(case.model.tip_shape[1])
        np.testing.assert_allclose(np.abs(case.at(case.node).level_shape), np.abs(case.model.tip_shape))  # signs of modes are free


def test_rows_of_both_resonances_are_told_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"SHARES": (0.0, 1.0), "GAP_FACTORS": (2.0, 100.0), "LIMITS": (0.97, 1.0)}.items():
        monkeypatch.setattr(load_answers, name, value)
    monkeypatch.setattr(load_answers, "GROUPS", {name: load_answers.GROUPS[name] for name in ("share", "gap")})
    monkeypatch.setattr(load_answers, "CASES", {"cantilever": CASES["cantilever"]})
    rows = [row for group in ("share", "gap") for row in both_rows(CASES["cantilever"], group, Settings(2, False))]
    assert rows[0]["higher"] is None
    assert rows[3]["lower"] == pytest.approx([1.0, 1.0], abs=0.01)  # no wall is touched in so wide a cavity, and phases matter little
    best = f"gap 2 mm, best of 2 | {np.median(rows[2]['lower']):.2f}"
    assert best in " ".join(both_text(rows).split())
    FIGURES["loads_both"](tmp_path / "both.png", rows)
    assert (tmp_path / "both.png").stat().st_size > 1000


def test_the_command_from_runs_to_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(load_answers, "FACTORS", (0.8,))
    page = tmp_path / "loads.md"
    page.write_text("".join(f"<!-- {part.name} -->\n<!-- /{part.name} -->\n" for part in load_answers.STUDY.parts))
    monkeypatch.setattr(load_answers, "CASES", {"cantilever": CASES["cantilever"]})
    given = ["--only", "loads_gravity", "--only", "loads_start", "--members", 1, "--out", tmp_path]
    result = call(main, *given)
    assert result.exit_code == 0, result.output
    rows = read_json(tmp_path / "loads_start.json.gz")["rows"]
    assert {row["start"] for row in rows} == {"middle", "lower-wall", "bouncing"}
    assert f"{np.median(rows[0]['ratio']):.2f}" in page.read_text()
    before = page.read_text()
    page.write_text(before.replace(f"{np.median(rows[0]['ratio']):.2f}", ""))
    again = call(main, *given, "--redraw")
    assert again.exit_code == 0, again.output
    assert page.read_text() == before
    assert (tmp_path / "loads_start.png").stat().st_size > 1000
